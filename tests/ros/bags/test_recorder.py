"""What the recorder keeps of a run."""

from collections import Counter
from collections.abc import Iterable

import yaml
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader

from helpers.node_bench import absolute, bench, topics_of
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.messages.prepared import peek_ns
from isogal_ros.messages.stamps import from_seconds, set_stamp
from isogal_ros.nodes.health import ERROR, figures_of


def test_every_topic_is_recorded(recording, scenario) -> None:
    reader = BagReader(recording)
    counts = Counter(message.topic for message in reader.messages())
    steps, scans, batches = 360, 36, 6
    expected = {
        steps: ["/imu/data_raw"],
        steps + 1: ["/clock", "/ground_truth/fix", "/ground_truth/odom", "/ins/fix", "/nav/path"],
        scans: ["/gravimeter/data_raw", "/gravimeter/gravity", "/gravimeter/disturbance"],
        batches: [f"/pmht_mm/{what}" for what in ("fix", "candidates", "information", "pose")],
        steps + 1 + batches: [
            f"/nav/{what}" for what in ("fix", "odom", "covariance", "protection_level")
        ],
    }
    for count, names in expected.items():
        assert {name: counts[name] for name in names} == dict.fromkeys(names, count)
    assert counts["/diagnostics"] > 0  # once a second of wall time, and on change
    assert set(reader.types) == {absolute(topic) for topic in topics_of(scenario())}
    for topic in topics_of(scenario()):
        assert reader.types[absolute(topic)] == topics.type_name(topic.type)


def test_recorded_time_is_the_simulations(recording) -> None:
    last = {True: 0, False: 0}
    for message in BagReader(recording).messages():
        by_navigator = message.topic.startswith("/nav/")  # which has a time of its own
        assert message.log_ns >= last[by_navigator]
        last[by_navigator] = message.log_ns
        if message.topic in ("/imu/data_raw", "/nav/odom", "/nav/fix"):
            assert message.log_ns == peek_ns(message.data)
    assert last == {True: 360 * 10**9, False: 360 * 10**9}


def test_recorded_time_goes_on_after_a_wrong_stamp_and_follows_time_that_begins_anew(
    scenario, tmp_path
) -> None:
    """The clock of another simulation, which jumps to and fro, is no time of this one."""
    with bench(RECORDER, scenario(), bag=str(tmp_path / "bag")) as made:

        def play(times: Iterable[float], of_clock: float) -> None:
            for k in times:
                clock = topics.CLOCK.type()
                set_stamp(clock.clock, from_seconds(k + of_clock))
                made.publish(topics.CLOCK, clock)
                made.imu(k)

        play((1.0, 2.0), 0.0)
        play((3.0, 4.0), 5000.0)
        made.imu(9000.0)
        play((5.0, 6.0), -4.0)
        play((1000.0, 1001.0, 1002.0), 0.0)  # a real gap, of which the first is held
        play((1.0, 2.0, 3.0), 0.0)  # begun anew
        made.node.writer.close()
    logged = [m.log_ns // 10**9 for m in BagReader(tmp_path / "bag").messages()]
    assert [second for second in logged if second] == [
        *[1, 1, 2, 2],
        *[2, 3, 3, 4],
        4,
        *[4, 5, 5, 6],
        *[6, 6, 6, 1001, 1002, 1002],
        *[1002, 1002, 1002, 2, 3, 3],
    ]


def test_recorded_types_are_the_publishers(recording, scenario) -> None:
    with AnyReader([recording]) as reader:  # compares the hashes with the definitions
        assert len(reader.connections) == len(topics_of(scenario()))
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
            for item in deserialize_message(message.data, topics.DIAGNOSTICS.type).status:
                names[item.name] += 1
                assert item.level < ERROR, item.message
                assert item.hardware_id == "isogal"
                figures_of(item)
    assert {*topics.NODES, "isogal_recorder", "pmht_mm_node: batch"} == set(names)
    assert names["ins_sim_node"] >= 1
    assert names["pmht_mm_node: batch"] == 6
