"""A matcher that raises declines the batch, whatever it raises, and its memory stays."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.matching.failures import FAILED, match_or_decline
from isogal.matching.interfaces import Fix, Information, Status

FIELD = field_map_of(lambda north, east: 1e-9 * north)
BATCH, _ = make_batch(FIELD)
GOOD = Fix(10.0, 0.1, 0.2, np.diag([9.0, 16.0]))
NAN = np.full((2, 2), np.nan)


class Asked:
    """A matcher that does what it is told."""

    context = 0

    def __init__(self, action):
        self.action = action

    def match(self, batch, field_map, memory):
        return self.action(), "after"


def answer(action):
    return match_or_decline(Asked(action), BATCH, FIELD, "before")


def test_an_answer_is_passed_on():
    assert answer(lambda: GOOD) == (GOOD, "after")
    none = replace(GOOD, covariance=NAN, reason="too flat")
    assert answer(lambda: none) == (none, "after")
    assert not none.failed and none.status is Status.DECLINED


def floating_point_error():
    with np.errstate(divide="raise"):
        return 1.0 / np.zeros(1)


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (lambda: np.linalg.cholesky(-np.eye(2)), "LinAlgError: Matrix is not positive definite"),
        (floating_point_error, "FloatingPointError: divide by zero"),
        (lambda: np.zeros(0).max(), "ValueError: zero-size array"),
        (lambda: np.zeros(2)[3], "IndexError: index 3"),
        (lambda: {}["no such\nkey"], "KeyError"),
        (lambda: None + 1, "TypeError: unsupported"),
    ],
)
def test_what_it_raises_is_the_reason(action, words):
    fix, memory = answer(action)
    assert fix.reason.startswith(FAILED + words) and fix.failed and fix.status is Status.FAILED
    assert "\n" not in fix.reason
    # not in NumPy, where it was noticed
    assert fix.reason.endswith(")") and f"({__name__}, line " in fix.reason
    assert not fix.published and np.isnan(fix.covariance).all()
    assert fix.time == BATCH.time[-1]
    assert (fix.latitude, fix.longitude) == BATCH.end
    assert memory == "before"


@pytest.mark.parametrize(
    "change",
    [
        {"latitude": np.nan},
        {"covariance": NAN},
        {"covariance": np.array([[1.0, 2.0], [2.0, 1.0]])},
        {"information": Information(np.full(4, np.inf), np.eye(4))},
    ],
)
def test_a_fix_that_is_none_counts_as_raised(change):
    fix, memory = answer(lambda: replace(GOOD, **change))
    assert fix.reason.startswith(f"{FAILED}ValueError: ")
    assert memory == "before"


def test_who_interrupts_is_not_stopped():
    def interrupt():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        answer(interrupt)
