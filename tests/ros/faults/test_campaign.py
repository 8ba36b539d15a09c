"""The fault campaign: what is told, and that no fault does harm in silence."""

import json

import pytest

from isogal_ros import topics
from isogal_ros.faults.campaign import OUTCOMES, PAGE, run_campaign
from isogal_ros.faults.catalogue import FAULTS, QUICK
from isogal_ros.graph import replay
from isogal_ros.nodes.signals import Interrupt


def test_there_are_forty_faults_with_names_of_their_own() -> None:
    names = [fault.name for fault in FAULTS]
    assert len(names) >= 40
    assert len(set(names)) == len(names)
    assert set(QUICK) <= set(names)


@pytest.mark.slow
def test_the_quick_set_does_no_harm_and_is_not_run_again(scenario, tmp_path, monkeypatch) -> None:
    short = scenario("route.duration=400.0", "matcher.name=pmht")
    table = run_campaign(short, tmp_path, 1, True, Interrupt(), lambda text: None)
    assert table["trials"] == len(QUICK)
    for row in table["faults"]:
        assert (row["crashes"], row["not_finite"]) == (0, 0)
        assert row["told"] == 1, json.dumps(row)
        assert row["told_after_s"] <= 120.0, row
        assert row["passed"], row
    page = (tmp_path / PAGE).read_text()
    assert all(name in page for name in QUICK)
    # what is there is taken as it is, but for a line that was cut off
    monkeypatch.setattr(replay, "_run", None)
    with (tmp_path / OUTCOMES).open("a") as stream:
        stream.write('{"fault": "imu NaN", "tri')
    again = run_campaign(short, tmp_path, 1, True, Interrupt(), lambda text: None)
    assert again == table


def test_a_leap_of_one_stamp_costs_one_sample(scenario) -> None:
    from helpers.node_bench import bench, stamps

    with bench(topics.UKF_FUSION, scenario()) as made:
        for k in (1, 2, 3, 3600, 4, 5, 6, 106, 107, 108):
            made.imu(k)
        made.wait(lambda: 108 in stamps(made, topics.NAV_FIX))
        assert stamps(made, topics.NAV_FIX) == [0, 1, 2, 3, 4, 5, 6, 107, 108]
        assert made.node.health.dropped == {"imu/data_raw": 2}
