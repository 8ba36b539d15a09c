"""The graph in one process: what it records, that it is the library's closed loop, and that a
replay gives the same."""

from collections import Counter

import numpy as np
import pytest

from helpers.node_bench import run_here, topics_of
from helpers.recordings import collect, record, same
from isogal.errors import InputError
from isogal.montecarlo.engine import simulate
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader, decode
from isogal_ros.bags.replay import replay
from isogal_ros.graph.in_process import run_in_process
from isogal_ros.graph.plan import GraphError, Plan
from isogal_ros.messages.convert import read_position
from isogal_ros.messages.stamps import peek_ns
from isogal_ros.nodes.health import ERROR, figures_of
from isogal_ros.nodes.spin import Interrupt

pytestmark = pytest.mark.ros


def test_it_is_the_closed_loop_of_the_library(recording, scenario) -> None:
    graph, library = record(recording, scenario()), simulate(scenario(), [0])
    assert len(graph.fix_time) == 10
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
        ("matcher.stride=2",),
        ("imu.rate=2.0", "gravimeter.interval=5.0"),
        ("map_error.sigma=3e-5", "gravimeter.outlier_fraction=0.1"),
    ],
    ids=",".join,
)
def test_other_scenarios(scenario, tmp_path, changes) -> None:
    short = scenario("route.duration=200.0", *changes)
    run_here(short, tmp_path / "bag")
    # the sampler turns the nanometres that degrees cost into micrometres
    # retrodiction publishes a fix for each scan, of which the last is only a share of the batch's
    same(
        record(tmp_path / "bag", short),
        simulate(short, [0]),
        1e-4,
        fixes=short.matcher.mode == "standard",
    )


def test_every_topic_is_recorded(recording) -> None:
    reader = BagReader(recording)
    counts = Counter(message.topic for message in reader.messages())
    steps, scans, batches = 600, 60, 10
    assert (
        counts["/clock"]
        == counts["/ground_truth/fix"]
        == counts["/ground_truth/odom"]
        == counts["/ins/fix"]
        == steps + 1
    )
    assert counts["/imu/data_raw"] == steps
    assert (
        counts["/gravimeter/data_raw"]
        == counts["/gravimeter/gravity"]
        == counts["/gravimeter/disturbance"]
        == scans
    )
    assert (
        counts["/pmht_mm/fix"]
        == counts["/pmht_mm/candidates"]
        == counts["/pmht_mm/information"]
        == batches
    )
    assert (
        counts["/nav/fix"]
        == counts["/nav/odom"]
        == counts["/nav/covariance"]
        == steps + 1 + batches
    )
    assert counts["/nav/path"] == 11
    assert counts["/diagnostics"] > 2 * steps
    assert set(reader.types) == {
        "/" + topic.name.lstrip("/") for topic in topics_of("disturbance")
    }
    for topic in topics_of("disturbance"):
        assert reader.types["/" + topic.name.lstrip("/")] == topics.type_name(topic.type)


def test_recorded_time_is_the_simulations(recording) -> None:
    last = 0
    for message in BagReader(recording).messages():
        assert message.log_ns >= last
        last = message.log_ns
        if message.topic == "/imu/data_raw":
            assert message.log_ns == peek_ns(message.data)
    assert last == 600 * 10**9


def test_recorded_types_are_the_publishers(recording) -> None:
    import yaml
    from rosbags.highlevel import AnyReader

    with AnyReader([recording]) as reader:  # compares the hashes with the definitions
        assert len(reader.connections) == len(topics_of("disturbance"))
    information = yaml.safe_load((recording / "metadata.yaml").read_text())[
        "rosbag2_bagfile_information"
    ]
    for entry in information["topics_with_message_count"]:
        topic = entry["topic_metadata"]
        assert topic["type_description_hash"].startswith("RIHS01_")
        assert {qos["reliability"] for qos in topic["offered_qos_profiles"]} == {"reliable"}


def test_every_node_tells_how_it_is(recording) -> None:
    names: Counter = Counter()
    for message in BagReader(recording).messages():
        if message.topic == "/diagnostics":
            for item in decode(message.data, topics.DIAGNOSTICS.type).status:
                names[item.name] += 1
                assert item.level < ERROR, item.message
                assert item.hardware_id == "isogal"
                figures_of(item)
    assert {*topics.NODES, "isogal_recorder", "pmht_mm_node: batch"} == set(names)
    assert names["ins_sim_node"] >= 600
    assert names["pmht_mm_node: batch"] == 10


def test_a_replay_gives_the_same_fixes(recording) -> None:
    told = []
    result = replay(BagReader(recording), Interrupt(), lambda *progress: told.append(progress))
    comparison = result.comparison
    assert comparison.recorded == comparison.replayed == comparison.common > 0
    assert comparison.disagreements == 0
    assert comparison.largest_difference < 1e-6
    assert result.notes == []
    # and the same navigation
    old, new = collect(recording).last_nav, result.outputs.last_nav
    assert set(old) == set(new)
    places = [
        [read_position(decode(store[ns], topics.NAV_FIX.type)) for ns in sorted(store)]
        for store in (old, new)
    ]
    np.testing.assert_allclose(places[0], places[1], atol=1e-13, rtol=0)


def test_a_replay_of_a_bag_that_is_cut_off(recording, tmp_path) -> None:
    data = (recording / "bag_0.mcap").read_bytes()
    (tmp_path / "part.mcap").write_bytes(data[: len(data) // 2])
    result = replay(BagReader(tmp_path / "part.mcap"), Interrupt(), lambda *_: None)
    (note,) = result.notes
    assert "cut off" in note
    assert "read up to" in note
    assert 100 < result.simulated < 500
    assert result.comparison.disagreements == 0
    assert 1 <= result.comparison.common < 10
    assert result.comparison.largest_difference < 1e-6


def test_a_replay_can_be_interrupted(recording) -> None:
    interrupt = Interrupt()
    interrupt(2)
    result = replay(BagReader(recording), interrupt, lambda *_: None)
    assert result.interrupted
    assert result.simulated == 0.0


def test_a_bag_without_what_is_needed(recording, tmp_path) -> None:
    from isogal_ros.bags.writer import BagWriter, qos_text

    writer = BagWriter(tmp_path / "poor")
    writer.add_topic("/nav/fix", "sensor_msgs/msg/NavSatFix", qos_text([topics.LOSSLESS]), "")
    for message in BagReader(recording).messages():
        if message.topic == "/nav/fix":
            writer.write("/nav/fix", message.data, message.log_ns, message.log_ns)
    writer.close()
    with pytest.raises(InputError) as error:
        replay(BagReader(tmp_path / "poor"), Interrupt(), lambda *_: None)
    text = str(error.value)
    assert "no messages on imu/data_raw and gravimeter/gravity" in text
    assert "the bag has /nav/fix" in text


def test_wall_clock_rate_gives_the_same(scenario, tmp_path) -> None:
    short = scenario("route.duration=65.0")
    outcome = run_in_process(
        Plan(short, tmp_path / "bag", rate=40.0), Interrupt(), lambda progress: None
    )
    assert outcome.wall_seconds > 65.0 / 40.0 * 0.9
    same(record(tmp_path / "bag", short), simulate(short, [0]))


def test_without_lock_step_fixes_come_late_and_count_all_the_same(scenario, tmp_path) -> None:
    short = scenario("route.duration=400.0")
    plan = Plan(short, tmp_path / "bag", rate=100.0, lock_step=False)
    run_in_process(plan, Interrupt(), lambda progress: None)
    graph, library = record(tmp_path / "bag", short), simulate(short, [0])
    np.testing.assert_array_equal(graph.fix_time, library.fix_time)
    np.testing.assert_array_equal(graph.published, library.published)
    # the last state has all fixes in it, late or not
    np.testing.assert_allclose(graph.fix_error, library.fix_error, atol=5.0)
    np.testing.assert_allclose(graph.error[0, -2], library.error[0, -2], atol=1.0)


def test_an_interrupt_keeps_the_bag(scenario, tmp_path) -> None:
    interrupt = Interrupt()

    def report(progress) -> None:
        if progress.simulated > 50.0:
            interrupt(2)

    outcome = run_in_process(
        Plan(scenario("route.duration=1900.0"), tmp_path / "bag", rate=100.0), interrupt, report
    )
    assert outcome.interrupted
    collector = collect(tmp_path / "bag")
    assert 50 < len(collector.truth) < 1900
    assert len(collector.last_nav) >= len(collector.truth) - 2


def test_a_node_that_cannot_start(scenario, tmp_path) -> None:
    with pytest.raises(InputError, match="does not cover the route"):
        run_here(
            scenario("route.end=[-35.0, 150.0]", "route.duration=10000.0", "route.speed=30.0"),
            tmp_path / "bag",
        )


def test_a_node_that_falls_silent(scenario, tmp_path, monkeypatch) -> None:
    from ukf_fusion_node.node import UkfFusionNode

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
