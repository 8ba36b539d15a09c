"""The graph in one process: it is the library's closed loop, whatever is measured, and it ends as
it should."""

import errno

import numpy as np
import pytest

from helpers.node_bench import run_here
from helpers.recordings import collect, record, same
from isogal.errors import InputError
from isogal.fields.scenario_map import map_for_scenario
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.writer import BagWriter
from isogal_ros.graph.in_process import run_in_process
from isogal_ros.graph.plan import GraphError, Plan
from isogal_ros.nodes.signals import Interrupt
from ukf_fusion_node.node import UkfFusionNode

_LEARNT = (
    "route.duration=400.0",
    "gravity.field=map",
    "map_error.sigma=2e-4",
    "matcher.name=pmht",
    "matcher.map_sigma=auto",
)
"""What readings show of the map changes what the filter believes of gravity."""
ONE_IN_10000 = 18.4
"""Of a chi-square with two degrees of freedom."""


def test_it_is_the_closed_loop_of_the_library(recording, scenario) -> None:
    graph, library = record(recording, scenario()), simulate(scenario(), [0])
    assert len(graph.fix_time) == 6
    assert graph.published.any()
    same(graph, library, 1e-6)
    np.testing.assert_allclose(graph.detail.reading, library.detail.reading, atol=1e-14, rtol=0)
    np.testing.assert_allclose(
        graph.detail.candidate_latitude, library.detail.candidate_latitude, atol=1e-12
    )
    np.testing.assert_array_equal(graph.detail.candidate_scan, library.detail.candidate_scan)


def test_another_run_has_other_numbers(scenario, tmp_path) -> None:
    short = scenario("route.duration=120.0")
    run_in_process(Plan(short, tmp_path / "bag", run=5), Interrupt(), lambda progress: None)
    same(record(tmp_path / "bag", short), simulate(short, [5]))
    assert BagReader(tmp_path / "bag").texts["run"] == "5"


@pytest.mark.parametrize(
    "changes",
    [
        ("matcher.name=pmht",),
        ("matcher.name=pmht", "matcher.mode=retrodiction"),
        ("matcher.stride=2", "gravity.field=map"),
        (*_LEARNT, "matcher.mode=standard"),
        (*_LEARNT, "matcher.mode=retrodiction"),
        ("imu.rate=2.0", "gravimeter.interval=5.0"),
        ("imu.rate=50.0", "imu.grade=navigation", "route.duration=70.0"),
        ("imu.rate=40.0", "fusion.rate=4.0", "route.duration=70.0"),
        ("map_error.sigma=3e-5", "gravimeter.outlier_fraction=0.1"),
        (
            "gravimeter.delay=12",
            "gravimeter.filter_time=5",
            "gravimeter.missing_fraction=0.3",
            "gravimeter.correlated_sigma=1e-5",
            "gravimeter.delay_sigma=1",
            "gravimeter.bias_walk=1e-8",
        ),
        ("truth.imu.grade=quantum", "truth.gravimeter=3x", "truth.initial_error.position=2x"),
    ],
    ids=",".join,
)
def test_other_scenarios(scenario, tmp_path, changes) -> None:
    short = scenario("route.duration=130.0", *changes)
    run_here(short, tmp_path / "bag")
    # the sampler turns the nanometres that degrees cost into micrometres
    # retrodiction publishes a fix for each scan, of which the last is only a share of the batch's
    same(
        record(tmp_path / "bag", short),
        simulate(short, [0]),
        1e-4,
        fixes=short.matcher.mode == "standard",
    )


@pytest.mark.parametrize(
    ("field", "fixes", "rounding", "unaided"),
    [("magnetic", 6, 1e-6, 150.0), ("terrain", 6, 1e-6, 150.0), ("gradient", 6, 1e-15, 60.0)],
)
def test_other_fields(recorded, field, fixes, rounding, unaided) -> None:
    scenario, bag = recorded(field)
    field_map = map_for_scenario(scenario)
    graph, library = record(bag, scenario, field_map), simulate(scenario, [0], field_map)
    same(graph, library, 1e-4)
    np.testing.assert_allclose(graph.detail.reading, library.detail.reading, atol=rounding, rtol=0)
    assert graph.published.tolist() == [[True] * fixes]
    assert np.hypot(*graph.error[0, -1]) < 60.0
    assert np.hypot(*graph.unaided_error[0, -1]) > unaided
    error, covariance = graph.posterior_error[0], graph.posterior_covariance[0]
    normalised = np.einsum("bi,bij,bj->b", error, np.linalg.inv(covariance), error)
    assert normalised.max() < ONE_IN_10000


def test_a_meter_out_of_range_makes_empty_scans(terrain, tmp_path) -> None:
    limited = terrain.model_copy(
        update={
            "altimeter": terrain.altimeter.model_copy(update={"max_range": 1500.0}),
            "route": terrain.route.model_copy(update={"duration": 450.0}),
        }
    )
    run_here(limited, tmp_path / "bag")
    graph, library = record(tmp_path / "bag", limited), simulate(limited, [0])
    none = np.isnan(graph.detail.reading)
    assert 0 < none.sum() < none.size
    np.testing.assert_array_equal(none, np.isnan(library.detail.reading))
    same(graph, library, 1e-4)


def test_retrodiction_of_vectors_has_one_fix_for_each_scan(gradient, tmp_path) -> None:
    made = gradient.model_copy(
        update={"matcher": gradient.matcher.model_copy(update={"mode": "retrodiction"})}
    )
    run_here(made, tmp_path / "bag")
    messages = BagReader(tmp_path / "bag").messages()
    assert sum(item.topic == "/pmht_mm/fix" for item in messages) == 36
    field_map = map_for_scenario(made)
    graph, library = record(tmp_path / "bag", made, field_map), simulate(made, [0], field_map)
    same(graph, library, 1e-4, fixes=False)


def test_a_gravimeters_sigma_is_refused_for_another_field(magnetic) -> None:
    default = Scenario().gravimeter
    with pytest.raises(
        InputError, match=r"gravimeter\.sigma: must be in nT where field is magnetic"
    ):
        run_here(magnetic.model_copy(update={"gravimeter": default}), None)


def test_wall_clock_rate_gives_the_same(scenario, tmp_path) -> None:
    short = scenario("route.duration=65.0")
    outcome = run_in_process(
        Plan(short, tmp_path / "bag", rate=80.0), Interrupt(), lambda progress: None
    )
    assert outcome.wall_seconds > 65.0 / 80.0 * 0.9
    same(record(tmp_path / "bag", short), simulate(short, [0]))


def test_without_lock_step_late_fixes_count(scenario, tmp_path) -> None:
    short = scenario("route.duration=240.0")
    plan = Plan(short, tmp_path / "bag", rate=100.0, lock_step=False)
    run_in_process(plan, Interrupt(), lambda progress: None)
    graph, library = record(tmp_path / "bag", short), simulate(short, [0])
    np.testing.assert_array_equal(graph.fix_time, library.fix_time)
    np.testing.assert_array_equal(graph.published, library.published)
    # the last state has all fixes in it, late or not
    np.testing.assert_allclose(graph.fix_error, library.fix_error, atol=5.0)
    np.testing.assert_allclose(graph.error[0, -2], library.error[0, -2], atol=1.0)


def test_a_node_that_cannot_start(scenario, tmp_path) -> None:
    with pytest.raises(InputError, match="does not cover the route"):
        run_here(
            scenario("route.end=[-35.0, 150.0]", "route.duration=10000.0", "route.speed=30.0"),
            tmp_path / "bag",
        )


def test_a_recorder_that_fails_fails_the_run(scenario, tmp_path, monkeypatch) -> None:
    write = BagWriter.write

    def full(self, *words) -> None:
        if self.messages == 300:
            raise OSError(errno.ENOSPC, "No space left on device")
        write(self, *words)

    monkeypatch.setattr(BagWriter, "write", full)
    with pytest.raises(GraphError, match=r"^isogal_recorder: .* No space left on device"):
        run_here(scenario(), tmp_path / "bag")
    assert len(collect(tmp_path / "bag").truth) > 10


def test_a_node_that_stops_answering(scenario, tmp_path, monkeypatch) -> None:
    publish, own = UkfFusionNode._publish, Plan.own
    monkeypatch.setattr(
        UkfFusionNode, "_publish", lambda self: publish(self) if self.samples < 20 else None
    )
    impatient = {"reply_timeout": 1.0}
    monkeypatch.setattr(
        Plan,
        "own",
        lambda plan, name: own(plan, name) | (impatient if name == topics.INS_SIM else {}),
    )
    with pytest.raises(
        GraphError, match=r"no answer to the step at 20\.000 s .* missing nav/odom \(0 of 1\)"
    ):
        run_here(scenario(), tmp_path / "bag")
