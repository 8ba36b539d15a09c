"""The fault campaign: what is told, and that no fault does harm in silence."""

import json
import os
import signal
import time
from pathlib import Path

import pytest

from isogal_ros import topics
from isogal_ros.faults import campaign, process_trial, trial
from isogal_ros.faults.campaign import OUTCOMES, run_campaign
from isogal_ros.faults.catalogue import FAULTS, QUICK, Fault
from isogal_ros.faults.node_faults import NODE_FAULTS
from isogal_ros.faults.process_faults import PROCESS_FAULTS
from isogal_ros.faults.stage import Feed
from isogal_ros.faults.table import PAGE
from isogal_ros.faults.trial import Reference, run_trials
from isogal_ros.nodes.signals import Interrupt


def test_there_are_forty_faults_with_names_of_their_own() -> None:
    names = [fault.name for fault in (*FAULTS, *NODE_FAULTS, *PROCESS_FAULTS)]
    assert len(names) >= 90
    assert len(set(names)) == len(names)
    assert set(QUICK) <= set(names)


@pytest.fixture(scope="module")
def feed(scenario) -> Feed:
    return Feed.of(scenario("route.duration=400.0", "matcher.name=pmht"), 0)


def test_the_quick_set_does_no_harm_and_is_not_run_again(feed, tmp_path, monkeypatch) -> None:
    short = feed.scenario
    monkeypatch.chdir(tmp_path.parent)  # what is made lies where the folder was when it was named
    out = Path(tmp_path.name)
    table = run_campaign(short, out, (1, 1), True, Interrupt(), lambda text: None)
    assert table["trials"] == len(QUICK)
    for row in table["faults"]:
        assert (row["crashes"], row["not_finite"], row["surprises"]) == (0, 0, [])
        assert row["told"] == 1, json.dumps(row)
        assert row["told_after_s"] <= 120.0, row
        assert row["passed"], row
    page = (tmp_path / PAGE).read_text()
    assert all(name in page for name in QUICK)
    # what is there is taken as it is, but for a line that was cut off
    monkeypatch.setattr(campaign, "run_trials", None)
    with (tmp_path / OUTCOMES).open("a") as stream:
        stream.write('{"fault": "imu NaN", "tri')
    again = run_campaign(short, out, (1, 1), True, Interrupt(), lambda text: None)
    assert again == table


def one(feed: Feed, change, monkeypatch, limit: float = 60.0):
    monkeypatch.setattr(trial, "LIMIT", limit)
    fault = Fault("x", "imu", change, lasts=5.0)
    (outcome,) = run_trials(feed, [fault], Reference.of(feed), Interrupt())
    return outcome


def test_a_trial_that_dies_or_hangs_or_surprises_is_one(feed, monkeypatch) -> None:
    assert "the process ended" in one(feed, lambda *_: os._exit(3), monkeypatch).crash
    assert "nothing came within" in one(feed, lambda *_: time.sleep(9.0), monkeypatch, 0.5).crash
    assert "ZeroDivisionError" in one(feed, lambda *_: 1 // 0, monkeypatch).crash


def test_a_leap_of_one_stamp_costs_one_sample(scenario) -> None:
    from helpers.node_bench import bench, stamps

    with bench(topics.UKF_FUSION, scenario()) as made:
        for k in (1, 2, 3, 3600, 4, 5, 6, 106, 107, 108):
            made.imu(k)
        made.wait(lambda: 108 in stamps(made, topics.NAV_FIX))
        assert stamps(made, topics.NAV_FIX) == [0, 1, 2, 3, 4, 5, 6, 107, 108]
        assert made.node.health.dropped == {"imu/data_raw": 2}


def test_an_interrupted_campaign_keeps_nothing_that_is_not_whole(
    scenario, tmp_path, monkeypatch
) -> None:
    """A recording that was cut short was once taken for the run without a fault."""
    interrupt, short = Interrupt(), scenario("route.duration=400.0")

    def cut(plan, interrupt, report) -> None:
        plan.bag.mkdir()
        interrupt(signal.SIGINT)

    monkeypatch.setattr(process_trial, "run_in_process", cut)
    table = run_campaign(short, tmp_path, (0, 1), False, interrupt, lambda text: None)
    assert table["trials"] == 0
    assert not (tmp_path / "recording-0").exists()


@pytest.mark.parametrize("kind", [Feed, Reference], ids=["simulating", "playing"])
def test_an_interrupt_ends_the_run_that_faults_are_compared_with(
    scenario, tmp_path, monkeypatch, kind
) -> None:
    interrupt, made, of = Interrupt(), [], kind.of

    def interrupted(*words):
        interrupt(signal.SIGINT)
        made.append(of(*words))
        return made[-1]

    monkeypatch.setattr(kind, "of", interrupted)
    short = scenario("route.duration=400.0")
    table = run_campaign(short, tmp_path, (1, 0), False, interrupt, lambda text: None)
    assert table["trials"] == 0
    assert not (tmp_path / OUTCOMES).exists()
    (cut,) = made
    assert len(cut.truth if kind is Feed else cut.track.time) == 0


def test_a_trial_of_processes_is_stopped(scenario, tmp_path, monkeypatch) -> None:
    stop, seen = Interrupt(), []

    def run(plan, folder, interrupt, report, meddle) -> None:
        folder.mkdir()
        meddle(None, -1.0)
        seen.append(bool(interrupt))
        stop(signal.SIGINT)
        meddle(None, -1.0)
        seen.append(bool(interrupt))

    monkeypatch.setattr(process_trial, "run_processes", run)
    found = process_trial.run_process_trial(
        scenario("route.duration=400.0"), tmp_path / "run", tmp_path, PROCESS_FAULTS[0], 0, stop
    )
    assert found is None
    assert seen == [False, True]
    assert not (tmp_path / "run").exists()
