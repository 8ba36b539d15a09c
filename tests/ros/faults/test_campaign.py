"""The fault campaign: what a fault passes with, what is reported, and that none does harm in
silence."""

import math
import signal
import time
from dataclasses import replace
from pathlib import Path

import pytest

from isogal_ros import topics
from isogal_ros.faults import campaign
from isogal_ros.faults.campaign import (
    OUTCOMES,
    PAGE,
    Outcome,
    page_of,
    run_campaign,
    run_trial,
    simulated,
    table_of,
)
from isogal_ros.faults.catalogue import FAULTS, QUICK, Fault
from isogal_ros.graph.player import Recorded
from isogal_ros.nodes.signals import Interrupt


@pytest.fixture(scope="module")
def feed(scenario) -> Recorded:
    return simulated(scenario("route.duration=400.0", "matcher.name=pmht"), 0)


def test_the_quick_set_does_no_harm_and_is_not_run_again(feed, tmp_path, monkeypatch) -> None:
    short = feed.scenario
    monkeypatch.chdir(tmp_path.parent)  # what is made lies where the folder was when it was named
    out = Path(tmp_path.name)
    table = run_campaign(short, out, 1, True, Interrupt())
    assert table["trials"] == len(QUICK)
    assert len({fault.name for fault in FAULTS}) == len(FAULTS)
    for row in table["faults"]:
        assert (row["failures"], row["reported"]) == ([], 1), row
        assert row["reported_after_s"] <= 120.0, row
    page = (tmp_path / PAGE).read_text()
    assert all(name in page for name in QUICK)
    # what is there is taken as it is, but for a line that was cut off
    monkeypatch.setattr(campaign, "run_trial", None)
    with (tmp_path / OUTCOMES).open("a") as stream:
        stream.write('{"fault": "imu NaN", "tri')
    again = run_campaign(short, out, 1, True, Interrupt())
    assert again == table


@pytest.mark.parametrize(
    ("change", "limit", "words"),
    [
        (lambda *_: time.sleep(9.0), 0.5, "nothing came within"),
        (lambda *_: 1 // 0, 60.0, "ZeroDivisionError"),
    ],
)
def test_a_trial_that_hangs_or_fails_is_one(feed, monkeypatch, change, limit, words) -> None:
    monkeypatch.setattr(campaign, "LIMIT", limit)
    (error,) = run_trial(feed, Fault("x", ("imu",), change, 5.0)).errors
    assert words in error


@pytest.mark.parametrize("effect", ["stopped", "slow"])
def test_nodes_fail_for_a_time(feed, effect) -> None:
    """The run goes on after it, and a node that waited has lost nothing."""
    outcome = run_trial(feed, Fault("x", (topics.UKF_FUSION,), effect, 30.0))
    assert outcome.errors == []
    assert math.isfinite(outcome.error_after)
    assert outcome.lost < 30


def test_an_interrupt_ends_it_and_keeps_what_has_been_run(feed, monkeypatch, tmp_path) -> None:
    """While it simulates nothing."""
    interrupt, done = Interrupt(), []

    def play(_feed: Recorded, fault: Fault):
        done.append(fault)
        if len(done) == 2:
            interrupt(signal.SIGINT)
        return replace(GOOD, fault=fault.name)

    monkeypatch.setattr(campaign, "run_trial", play)
    with monkeypatch.context() as patch:
        patch.setattr(campaign, "simulated", lambda *_: feed)
        assert run_campaign(feed.scenario, tmp_path, 1, True, interrupt)["trials"] == 1
    assert len(done) == 2
    interrupt = Interrupt()
    monkeypatch.setattr(campaign, "run_in_process", lambda *_: interrupt(signal.SIGINT))
    assert run_campaign(feed.scenario, tmp_path / "b", 1, False, interrupt)["trials"] == 0
    assert not (tmp_path / "b" / OUTCOMES).exists()
    assert not interrupt.ends_at_once


GOOD = Outcome("x", 0, [], 0, 5.0, "filter: no samples", 90.0, 50.0, 50.0, 3)


@pytest.mark.parametrize(
    ("change", "passes", "unreported_passes"),
    [
        ({}, True, True),
        ({"errors": ["of a node:\nKeyError"]}, False, False),
        ({"not_finite": 1}, False, False),
        ({"reported_after": math.nan, "report": None}, False, True),
        ({"error_after": 94.0}, True, True),  # 1.3 times as large, and 30 m
        ({"error_after": 96.0}, False, False),
        ({"error_after": math.nan}, False, False),
    ],
)
def test_a_fault_passes_that_is_reported_and_recovered_from(
    scenario, change, passes, unreported_passes
) -> None:
    """One that does not matter passes unreported."""
    for matters, expected in ((True, passes), (False, unreported_passes)):
        fault = Fault("x", ("imu",), "stopped", matters=matters)
        table = table_of(scenario(), [fault], [replace(GOOD, **change)])
        assert table["failed"] == ([] if expected else ["x"])
        assert ("**no**" in page_of(table)) == (not expected)
