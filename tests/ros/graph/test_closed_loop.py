"""The graph in one process is the library's closed loop, whatever is measured, and its recording
is replayed to the same fixes."""

import re
from collections import Counter
from typing import Any

import numpy as np
import pytest
from sensor_msgs.msg import NavSatStatus

from helpers.magnetics import aircraft
from helpers.node_bench import absolute, run_here, topics_of
from helpers.recordings import (
    assert_closed_loop,
    assert_replayed,
    assert_replayed_as_run,
    messages_of,
    record,
)
from helpers.sea_floor import DVL, SOUNDING, sea_floor
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.montecarlo.engine import simulate
from isogal.scenario import changed_scenario, load_scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.plan import Plan
from isogal_ros.graph.running import run_in_process
from isogal_ros.messages.aids import each_aid
from isogal_ros.messages.prepared import peek_ns
from isogal_ros.nodes.signals import Interrupt

ONE_IN_10000 = 18.4
"""Of a chi-square with two degrees of freedom."""


def counts(bag) -> Counter[str]:
    """Messages by topic."""
    return Counter("/" + item.topic.lstrip("/") for item in BagReader(bag).messages())


def test_it_is_the_closed_loop_of_the_library(recording, scenario) -> None:
    graph, library = assert_closed_loop(recording, scenario(), 1e-6)
    assert len(graph.fix_time) == 6
    assert graph.published.any()
    np.testing.assert_allclose(graph.detail.reading, library.detail.reading, atol=1e-14, rtol=0)
    np.testing.assert_allclose(
        graph.detail.candidate_latitude, library.detail.candidate_latitude, atol=1e-12
    )
    assert_replayed(recording)


class Ahead(Plan):
    """Steps without a reading are published at once, as by a simulator in a process of its own."""

    def own(self, name: str) -> dict[str, Any]:
        return super().own(name) | ({"ahead": 10} if name == topics.INS_SIM else {})


def test_steps_that_are_published_at_once_change_nothing(scenario, tmp_path) -> None:
    """In retrodiction mode, which publishes a fix for each scan, of which the last is only a share
    of the batch's."""
    bag = tmp_path / "bag"
    varied = scenario(
        *("route.duration=130.0", "imu.rate=4.0", "fusion.rate=2.0", "matcher.name=pmht"),
        *("matcher.mode=retrodiction", "truth.imu.grade=quantum", "truth.gravimeter=3x"),
    )
    run_in_process(Ahead(varied, bag), Interrupt())
    assert_closed_loop(bag, varied, fixes=False)
    assert counts(bag)["/pmht_mm/fix"] == 12
    for item in BagReader(bag).messages():  # the clock may be ahead of what the navigator says
        if item.topic == "/nav/odom":
            assert item.log_ns == peek_ns(item.data)


WRONG_MAP = (
    *("route.duration=400.0", "gravity.field=map", "map_error.sigma=2e-4"),
    *("matcher.name=pmht", "matcher.map_sigma=auto"),
)
BLACK_BOX = "ins.source=solution", "ins.attitude=false"
FAST_BLACK_BOX = "ins.source=solution", "imu.rate=40.0", "fusion.rate=1.0", "gravity.field=map"
FAST = "imu.rate=50.0", "imu.grade=navigation", "gravimeter.interval=5.0", "route.duration=35.0"


@pytest.mark.parametrize(
    ("changes", "counted"),
    [
        (WRONG_MAP, {"imu/data_raw": 400}),
        # at the start there is a solution, but no sample
        (
            BLACK_BOX,
            {"imu/data_raw": 0, "ins/solution_fix": 71, "ins/solution_velocity": 71},
        ),
        (FAST_BLACK_BOX, {"imu/data_raw": 0, "ins/solution": 71}),
        (FAST, {"imu/data_raw": 1_750, "ground_truth/fix": 36}),
    ],
    ids=["a wrong map", "an INS", "an INS of a fast IMU", "50 Hz"],
)
def test_other_scenarios(scenario, tmp_path, changes, counted) -> None:
    varied, bag = scenario("route.duration=70.0", *changes), tmp_path / "bag"
    run_here(varied, bag)
    assert_closed_loop(bag, varied)
    found = counts(bag)
    assert {name: found[f"/{name}"] for name in counted} == counted
    assert found["/ins/error"] == (found["/nav/odom"] if varied.ins.gives_solution else 0)
    if changes != WRONG_MAP:  # whose topics are those of the plain scenario
        assert_replayed(bag, 1e-4)


@pytest.mark.parametrize(
    ("field", "fixes", "rounding", "unaided"),
    [("magnetic", 4, 1e-6, 150.0), ("terrain", 4, 1e-6, 150.0), ("gradient", 4, 1e-15, 60.0)],
)
def test_other_fields(request, tmp_path, field, fixes, rounding, unaided) -> None:
    scenario, bag = request.getfixturevalue(field), tmp_path / "bag"
    run_here(scenario, bag)
    graph, library = assert_closed_loop(bag, scenario)
    assert set(counts(bag)) == {absolute(topic) for topic in topics_of(scenario)}
    assert not any("gravimeter" in name for name in counts(bag))
    np.testing.assert_allclose(graph.detail.reading, library.detail.reading, atol=rounding, rtol=0)
    assert graph.published.tolist() == [[True] * fixes]
    assert np.hypot(*graph.error[0, -1]) < 60.0
    assert np.hypot(*graph.unaided_error[0, -1]) > unaided
    error, covariance = graph.posterior_error[0], graph.posterior_covariance[0]
    normalised = np.einsum("bi,bij,bj->b", error, np.linalg.inv(covariance), error)
    assert normalised.max() < ONE_IN_10000
    if field != "terrain":  # whose messages are played as those of the others are
        assert assert_replayed(bag, 1e-4).common == fixes


def test_an_altimeter_with_several_beams(tmp_path) -> None:
    keys = DVL, "altimeter.scale_sigma=0.01", "altimeter.max_range=180"
    write_netcdf(sea_floor(), tmp_path / "floor.nc")
    scenario = load_scenario(None, [*SOUNDING, f"map.source={tmp_path / 'floor.nc'}", *keys])
    run_here(scenario, tmp_path / "bag")
    graph, _ = assert_closed_loop(tmp_path / "bag", scenario, 1e-3)
    assert graph.published.sum() > 1
    assert_replayed(tmp_path / "bag", 1e-3)
    assert {"/altimeter/points", "/altimeter/footprints"} <= set(counts(tmp_path / "bag"))


def test_a_magnetic_vehicle_whose_field_the_matcher_estimates_from_a_cold_start(
    magnetic, tmp_path
) -> None:
    craft = aircraft()
    changes = [
        "matcher.name=pmht",
        "matcher.map_sigma=2",
        "route.duration=400",
        "magnetometer.online=true",
        f"truth.magnetometer.aircraft.permanent={craft.permanent.tolist()}",
        f"truth.magnetometer.aircraft.induced={craft.induced.ravel().tolist()}",
    ]
    scenario, bag = changed_scenario(magnetic, changes, "test"), tmp_path / "bag"
    run_here(scenario, bag)
    graph, library = assert_closed_loop(bag, scenario, 1e-3)
    assert graph.published.any()
    np.testing.assert_allclose(graph.detail.reading, library.detail.reading, atol=1e-6, rtol=0)
    assert "/magnetometer/terms" in counts(bag)
    # the readings of both instruments are reduced anew for a matcher that does otherwise
    assert_replayed_as_run(bag, changed_scenario(scenario, ["matcher.map_sigma=4"], "test"), 1e-3)


def test_another_run_by_the_wall_clock(scenario, tmp_path) -> None:
    """Has the numbers of its own, whatever the rate."""
    short = scenario("route.duration=65.0")
    seconds = run_here(short, tmp_path / "bag", run=5, rate=80.0)
    assert seconds > 0.9 * 65.0 / 80.0
    assert_closed_loop(tmp_path / "bag", short, 1e-6, run=5)
    assert BagReader(tmp_path / "bag").texts["run"] == "5"


def test_without_lock_step_late_fixes_count(scenario, tmp_path) -> None:
    short = scenario("route.duration=240.0")
    run_here(short, tmp_path / "bag", rate=100.0, lock_step=False)
    graph, library = record(tmp_path / "bag", short), simulate(short, [0])
    np.testing.assert_array_equal(graph.fix_time, library.fix_time)
    np.testing.assert_array_equal(graph.published, library.published)
    # the last state has all fixes in it, late or not
    np.testing.assert_allclose(graph.fix_error, library.fix_error, atol=5.0)
    np.testing.assert_allclose(graph.error[0, -2], library.error[0, -2], atol=1.0)


def test_aids_by_name_and_satellites_lost_and_back(scenario, tmp_path) -> None:
    """Two of height, velocity, position and heading, each as late as it is, beside a receiver
    whose fixes come late, and which has none in between."""
    short = scenario(
        "height.source=barometer",
        "heights=[{name: second, interval: 2, bias: 1}]",
        "velocity.kind=log",
        "velocities=[{name: wind, kind: airspeed}, {name: other, kind: log, interval: 5}]",
        "route.duration=70.0",
        "gnss.available=[[0, 20], [50, 70]]",
        "gnss.lever_arm=[3, -1, -2]",
        "gnss.delay=2",
        "gnss.correlated_sigma=0.5",
        "positions=[{interval: 10, sigma: 5, correlated_sigma: 3},"
        " {name: usbl, interval: 5, delay: 3, lever_arm: [2, 0, 4], available: [[15, 45]]}]",
        "headings=[{}, {name: mag, kind: compass, interval: 2, delay: 1}]",
    )
    run_here(short, tmp_path / "bag")
    assert_closed_loop(tmp_path / "bag", short)
    found = messages_of(tmp_path / "bag", topics.NAV_AIDS, *(aid.topic for aid in each_aid(short)))
    status = [message.status.status for message in found["gnss/fix"]]
    assert status.count(NavSatStatus.STATUS_NO_FIX) == 29
    said = [{item.name: item.message for item in one.status} for one in found["nav/aids"]]
    assert "not since 20 s: the receiver has no fix" in [one.get("gnss/fix") for one in said]
    alone = [one.get("navigator", "") for one in said]
    assert "no satellites are used" in alone
    assert any(
        re.fullmatch(r"without satellites since [1-5] s it would be \d+ m", one) for one in alone
    )
    lost = "not since 45 s: the receiver has no fix"
    # those of the last 3, 2 and 1 s have not come
    for name, count, words in (
        ("gnss/fix", 68, "used"),
        ("position/fix", 7, "used"),
        ("position/usbl/fix", 13, lost),
        ("heading/data_raw", 70, "used"),
        ("heading/mag/data_raw", 34, "used"),
        ("barometer/data_raw", 70, "used"),
        ("barometer/second/data_raw", 35, "used"),
        ("velocity/data_raw", 70, "used"),
        ("velocity/wind/data_raw", 70, "used"),
        ("velocity/other/data_raw", 14, "used"),
    ):
        assert (name, len(found[name]), said[-1][name]) == (name, count, words)
    assert_replayed(tmp_path / "bag")
