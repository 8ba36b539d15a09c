"""Which answers a step needs."""

import pytest

from ins_sim_node.lock_step import LockStep
from isogal.scenario import load_scenario

S = 10**9


@pytest.fixture
def step() -> LockStep:
    return LockStep(load_scenario(None, ["matcher.batch_length=3"]))


def test_the_start_needs_no_answer(step) -> None:
    step.begin(0, 0)
    assert step.complete


def test_a_plain_step_needs_the_navigator(step) -> None:
    step.begin(1, S)
    assert not step.complete
    assert not step.nav(0)  # the one before
    assert step.nav(S)
    assert step.complete
    assert not step.nav(S)  # completed only once


def test_a_scan_needs_the_reading_too(step) -> None:
    step.begin(10, 10 * S)
    assert not step.nav(10 * S)
    assert "reading" in step.missing()
    assert not step.reading(9 * S)
    assert step.reading(10 * S)


def test_a_batch_end_needs_the_fix_and_its_answer(step) -> None:
    step.begin(30, 30 * S)
    assert not step.nav(30 * S)
    assert not step.reading(30 * S)
    assert "pmht_mm/fix" in step.missing()
    assert not step.fix(30 * S)
    assert "nav/odom (1 of 2)" in step.missing()
    assert step.nav(30 * S)


def test_the_order_of_the_answers_does_not_matter(step) -> None:
    step.begin(30, 30 * S)
    assert not step.fix(30 * S)
    assert not step.nav(30 * S)
    assert not step.nav(30 * S)
    assert step.reading(30 * S)


def test_retrodiction_has_as_many_answers_as_fixes(step) -> None:
    step.begin(30, 30 * S)
    step.reading(30 * S)
    step.nav(30 * S)
    for ns in (10 * S, 20 * S, 30 * S):
        assert not step.fix(ns)
    assert not step.nav(30 * S)
    assert not step.nav(30 * S)
    assert step.nav(30 * S)


def test_a_step_may_be_let_go(step) -> None:
    step.begin(30, 30 * S)
    assert not step.complete
    step.forget()
    assert step.complete
    assert not step.nav(30 * S)  # an answer that comes after all


def test_what_nobody_gives_is_not_waited_for(step) -> None:
    step.absent = {"fix"}
    step.begin(30, 30 * S)  # the end of a batch
    step.nav(30 * S)
    assert step.reading(30 * S)
    step.absent = {"nav"}
    step.begin(31, 31 * S)
    assert step.complete


def test_a_late_fix_of_a_step_that_was_not_waited_for_needs_no_answer(step) -> None:
    step.begin(31, 31 * S)
    assert not step.fix(30 * S)  # the filter has answered it by nav/odom of step 30
    assert step.nav(31 * S)


def test_steps_with_all_their_answers_are_counted(step) -> None:
    step.absent = {"fix"}
    step.begin(1, S)
    assert step.nav(S)
    assert step.answered == 0
    step.absent = set()
    step.begin(2, 2 * S)
    assert step.nav(2 * S)
    assert step.answered == 1
