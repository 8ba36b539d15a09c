"""What a recorded graph left behind, as the library's record of a run."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import NavSatFix

from isogal.evaluation.records import Runs
from isogal.fields.scenario_map import maps_for_scenario
from isogal.maps.several import RunMap
from isogal.montecarlo.engine import simulate
from isogal.scenario import Scenario
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import Collector, record_of, wanted_messages
from isogal_ros.bags.writer import BagWriter
from isogal_ros.graph.replay import Replay, replay
from isogal_ros.messages.position import read_position
from isogal_ros.nodes.signals import Interrupt
from isogal_ros.topics import Topic

METRES = np.array([6.4e6, 6.4e6, 1.0])
"""What latitude, longitude (rad) and height are in metres, or a little more."""


def rewritten(
    bag: Path,
    folder: Path,
    change: Callable[[str, bytes], bytes | None] = lambda topic, data: data,
    texts: Mapping[str, str] | None = None,
    names: Mapping[str, str] = MappingProxyType({}),
) -> Path:
    """A copy of a bag with each message as `change` (topic, serialised message) makes it; None
    leaves it out. It may have other texts and other names of topics."""
    reader = BagReader(bag)
    writer = BagWriter(folder, dict(reader.texts if texts is None else texts))
    for message in reader.messages():
        name = names.get(message.topic, message.topic)
        data = change(message.topic, message.data)
        if data is None:
            continue
        if not writer.knows(name):
            writer.add_topic(name, reader.types[message.topic], [], "")
        writer.write(name, data, message.log_ns, message.log_ns)
    writer.close()
    return folder


def in_frame(topic: Topic, data: bytes, frame: str) -> bytes:
    """A serialised message with another frame."""
    message = deserialize_message(data, topic.type)
    message.header.frame_id = frame
    return serialize_message(message)


def collect(bag: Path) -> Collector:
    """Messages of a whole bag."""
    reader = BagReader(bag)
    collector = Collector(reader.scenario())
    collector.take_bag(reader)
    assert reader.cut is None
    return collector


def messages_of(bag: Path, *wanted: Topic) -> dict[str, list]:
    """The messages of a bag by topic."""
    found: dict[str, list] = {topic.name: [] for topic in wanted}
    for topic, data in wanted_messages(BagReader(bag), wanted):
        found[topic.name].append(deserialize_message(data, topic.type))
    return found


def nav_positions(collector: Collector) -> np.ndarray:
    """Latitude, longitude (rad) and height (m) of the navigator at every stamp, after fixes."""
    stamps = sorted(collector.last_nav)
    messages = [deserialize_message(collector.last_nav[ns], NavSatFix) for ns in stamps]
    return np.array([read_position(message) for message in messages])


def record(bag: Path, scenario: Scenario, field_map: RunMap | None = None) -> Runs:
    """Record of the run in a bag, over the scenario's map."""
    return record_of(collect(bag), maps_for_scenario(scenario) if field_map is None else field_map)


def same(a: Runs, b: Runs, tolerance: float = 1e-6, fixes: bool = True) -> None:
    """Assert that two records are equal but for rounding (m)."""
    np.testing.assert_array_equal(a.time, b.time)
    np.testing.assert_array_equal(a.fix_time, b.fix_time)
    np.testing.assert_array_equal(a.fix_status, b.fix_status)
    np.testing.assert_array_equal(a.fix_reason, b.fix_reason)
    for name in ("error", "unaided_error", "posterior_error", *(["fix_error"] if fixes else [])):
        np.testing.assert_allclose(
            getattr(a, name), getattr(b, name), atol=tolerance, rtol=0, err_msg=name
        )
    for name in ("covariance", "posterior_covariance", *(["fix_covariance"] if fixes else [])):
        found, expected = getattr(a, name), getattr(b, name)
        # of a component beside the variances that it is between
        deviation = np.sqrt(np.einsum("...ii->...i", expected))
        size = 1.0 + deviation[..., :, None] * deviation[..., None, :]
        np.testing.assert_allclose(found / size, expected / size, rtol=0, atol=1e-6, err_msg=name)


def assert_closed_loop(
    bag: Path, scenario: Scenario, tolerance: float = 1e-4, fixes: bool = True, run: int = 0
) -> tuple[Runs, Runs]:
    """Assert that a recorded graph is the closed loop of the library, and return both records.
    The sampler turns the nanometres that degrees cost into micrometres."""
    field_map = maps_for_scenario(scenario)
    graph, library = record(bag, scenario, field_map), simulate(scenario, [run], field_map)
    same(graph, library, tolerance, fixes)
    return graph, library


def replayed(bag: Path, scenario: Scenario | None = None) -> Replay:
    """A replay of a bag, by another scenario if there is one."""
    return replay(BagReader(bag), Interrupt(), scenario=scenario)


def assert_replayed(bag: Path, tolerance: float = 1e-6) -> Replay:
    """Assert that a replay gives the recorded fixes and the recorded navigation (m), and return
    it."""
    result, recorded = replayed(bag), collect(bag)
    found = result
    assert found.recorded == found.replayed == found.common > 0
    assert found.disagreements == 0
    assert found.largest_difference < tolerance
    assert result.outputs.last_nav.keys() == recorded.last_nav.keys()
    apart = METRES * (nav_positions(result.outputs) - nav_positions(recorded))
    np.testing.assert_allclose(apart, 0.0, atol=tolerance)
    assert result.notes == []
    return result


def assert_replayed_as_run(bag: Path, scenario: Scenario, tolerance: float = 1e-4) -> None:
    """Assert that a replay with another scenario is as if it had been run (m)."""
    result, field_map = replayed(bag, scenario), maps_for_scenario(scenario)
    library = simulate(scenario, [0], field_map)
    assert library.published.any()
    same(record_of(result.outputs, field_map), library, tolerance)
    assert result.notes == []
