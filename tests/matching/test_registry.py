"""Matchers by name, and what they raise: a batch is declined and the memory stays."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from helpers.refusals import refusal
from isogal import plugins
from isogal.errors import InputError
from isogal.matching.failures import FAILED, match_or_decline
from isogal.matching.interfaces import Fix, Information, Status
from isogal.matching.registry import load_matcher
from isogal.scenario import Matcher, load_scenario

MATCHERS = plugins.names(plugins.MATCHERS)


@pytest.mark.parametrize(("changes", "reason"), [
    ({"latitude": np.full(30, np.nan)}, "latitude of the navigator is not finite"),
    ({"covariance": np.full((7, 7), np.nan)}, "covariance of the navigator is not finite"),
    ({"covariance": -np.eye(7)}, "the navigator's covariance is not positive definite"),
    ({"time": np.zeros(30)}, "the stamps of the scans do not increase"),
    ({"sigma": np.zeros(30)}, "sigma of a reading is not positive"),
])  # fmt: skip
@pytest.mark.parametrize("name", MATCHERS)
def test_what_no_matcher_can_use_is_declined(name, changes, reason, rough_map):
    batch = replace(make_batch(rough_map)[0], **changes)
    fix, memory = load_matcher(Matcher(name=name)).match(batch, rough_map, None)
    assert fix.reason == reason
    assert memory is None


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        *(
            ({"name": name, "options": {"nonsense": 1}}, "unknown key 'nonsense'")
            for name in MATCHERS
        ),
        ({"options": {"trus": 2.0}}, "unknown key 'trus', did you mean 'trust'?"),
        ({"options": {"trust": 0.5}}, "matcher.options of pmht: trust: must be "),
        ({"name": "pmth"}, "unknown matcher 'pmth' (did you mean 'pmht'?); allowed: iccp, "),
    ],
)
def test_wrong_settings_are_refused_in_one_line(keys, message):
    with refusal(message):
        load_matcher(Matcher().model_copy(update=keys))


def test_options_are_refused_where_a_scenario_is_read(tmp_path):
    path = tmp_path / "old.yaml"
    path.write_text("matcher: {options: {context: 3}}", encoding="utf-8")
    with refusal(f"{path}: matcher.options of pmht: unknown key 'context'; allowed: trust, "):
        load_scenario(path)


def test_only_pmht_takes_several_channels():
    assert load_matcher(Matcher(), channels=True).takes_channels
    for name in set(MATCHERS) - {"pmht"}:
        with pytest.raises(
            InputError,
            match=rf"^matcher\.name: {name} takes one number .* several channels give pmht$",
        ):
            load_matcher(Matcher(name=name), channels=True)


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


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (lambda: np.linalg.cholesky(-np.eye(2)), "LinAlgError: Matrix is not positive definite"),
        (lambda: np.zeros(2)[3], "IndexError: index 3"),
        (lambda: {}["no such\nkey"], "KeyError"),
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
