"""What a recorded graph left behind, as the library's record of a run."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import NavSatFix

from isogal.evaluation.records import Runs
from isogal.fields.scenario_map import maps_for_scenario
from isogal.maps.several import RunMap
from isogal.scenario import Scenario
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import record_of
from isogal_ros.bags.writer import BagWriter
from isogal_ros.messages.position import read_position
from isogal_ros.topics import Topic


def rewritten(bag: Path, folder: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """A copy of a bag with each message as `change` (topic, serialised message) makes it; None
    leaves it out."""
    reader = BagReader(bag)
    writer = BagWriter(folder, dict(reader.texts))
    for message in reader.messages():
        data = change(message.topic, message.data)
        if data is None:
            continue
        if not writer.knows(message.topic):
            writer.add_topic(message.topic, reader.types[message.topic], [], "")
        writer.write(message.topic, data, message.log_ns, message.log_ns)
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
        np.testing.assert_allclose(
            getattr(a, name), getattr(b, name), rtol=1e-6, atol=1e-6, err_msg=name
        )
