"""What a collector keeps of diagnostics."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message

from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.record import Collector
from isogal_ros.nodes.health import OK, WARN, status


@pytest.mark.parametrize("frame", ["", "a", "abc", "abcd", "abcde"])
def test_only_what_is_not_ok_and_batches_are_kept_whatever_the_frame(frame) -> None:
    fine, warns = status("x", OK, "well", {}), status("y", WARN, "not well", {"n": 1})
    batch = status(f"{topics.PMHT_MM}: batch", OK, "fix published", {"stamp": "1.5"})
    collector = Collector(Scenario())

    def hear(*statuses: DiagnosticStatus) -> None:
        array = DiagnosticArray(status=list(statuses))
        array.header.frame_id = frame
        collector.take(topics.DIAGNOSTICS, serialize_message(array))

    hear()
    hear(fine)
    assert (collector.said, collector.batches) == ([], {})
    hear(warns)
    hear(fine, warns)
    assert [(one.name, one.text) for one in collector.said] == [("y", "not well")] * 2
    hear(fine, batch)
    assert list(collector.batches) == [1_500_000_000]
