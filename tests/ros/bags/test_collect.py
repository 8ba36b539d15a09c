"""What the record of a run takes of messages, and what a recording is viewed as."""

import math
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message
from sensor_msgs.msg import NavSatFix, NavSatStatus
from std_msgs.msg import String

from helpers.recordings import rewritten
from isogal.errors import InputError
from isogal.evaluation.view.page import write_view
from isogal.evaluation.view.record import AidUse, Event
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.record import Collector, gaps
from isogal_ros.bags.viewing import open_bag, uses_of
from isogal_ros.bags.writer import BagWriter
from isogal_ros.nodes.health import OK, WARN, status
from isogal_ros.topics import Topic


@pytest.mark.parametrize("frame", ["", "abc", "abcde"])
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
    assert [(one.source, one.text) for one in collector.said] == [("y", "not well")] * 2
    hear(fine, batch)
    assert list(collector.batches) == [1_500_000_000]
    collector.namespace = "ship"  # of another graph in the domain nothing is kept
    hear(warns)
    assert len(collector.said) == 2


@pytest.mark.parametrize(
    ("lacking", "found"), [((), []), (range(20, 31), [[19.0, 31.0]]), ((0, 5, 99), [[4.0, 6.0]])]
)
def test_gaps_of_a_recording(lacking, found) -> None:
    collector = Collector(Scenario())
    for k in range(100):
        if k not in lacking:
            message = NavSatFix()
            message.header.stamp.sec = k
            collector.take(topics.TRUTH_FIX, serialize_message(message))
    assert gaps(collector) == found


def test_a_use_goes_on_until_something_else_is_said() -> None:
    said = [
        Event(time, level, name, text)
        for time, level, name, text in (
            (0, "OK", "gnss/fix", "used"),
            (0, "WARN", "velocity/data_raw", "never: nothing has come yet"),
            (1, "OK", "gnss/fix", "used"),
            (5, "WARN", "gnss/fix", "not since 2 s: the receiver has no fix"),
            (5, "OK", "velocity/data_raw", "used"),
            (6, "WARN", "gnss/fix", "not since 3 s: the receiver has no fix"),
            (9, "OK", "gnss/fix", "used"),
            (12, "OK", "gnss/fix", "used"),
        )
    ]
    assert uses_of(said) == [
        AidUse("gnss/fix", 0.0, 5.0, True, "used"),
        AidUse("velocity/data_raw", 0.0, 5.0, False, "never: nothing has come yet"),
        AidUse("gnss/fix", 5.0, 9.0, False, "not since 2 s: the receiver has no fix"),
        AidUse("velocity/data_raw", 5.0, 5.0, True, "used"),
        AidUse("gnss/fix", 9.0, 12.0, True, "used"),
    ]


def places(folder: Path, *each: tuple[float, float], kind: type = NavSatFix) -> Path:
    """A bag with one place (deg) a second on nav/fix, at no known height."""
    bag = BagWriter(folder)
    for second, place in enumerate(each):
        message = kind()
        if kind is NavSatFix:
            message.latitude, message.longitude, message.altitude = *place, math.nan
            message.header.stamp.sec = second
            message.status.status = 0 if any(place) else NavSatStatus.STATUS_NO_FIX
        bag.put(Topic(topics.NAV_FIX.name, kind), message, second * 10**9)
    bag.close()
    return folder


def test_a_receivers_places_are_viewed_without_those_that_are_none(tmp_path) -> None:
    """Each ended the command with a traceback."""
    none = (math.nan, math.nan), (91.0, 0.0), (0.0, 0.0)
    bag = places(tmp_path / "bag", (-38.0, 144.5), none[0], (-38.1, 144.5), *none[1:])
    viewed, _ = open_bag(bag)
    np.testing.assert_allclose(np.degrees(viewed.runs.latitude), [-38.0, -38.1])


def test_a_way_around_a_pole_is_viewed(tmp_path) -> None:
    """It was refused with `no map: has no value at all`."""
    way = [(-89.9, float(longitude)) for longitude in range(-170, 180, 20)]
    page = write_view(tmp_path / "page.html", *open_bag(places(tmp_path / "bag", *way)))
    assert "does not say which scenario" in page.read_text()


def test_what_cannot_be_read_is_left_out_and_said(tmp_path, capsys) -> None:
    bag = places(tmp_path / "string", (0.0, 0.0), kind=String)
    with pytest.raises(InputError, match="has no two messages on nav/fix"):
        open_bag(bag)
    said = "/nav/fix is left out: it is std_msgs/msg/String, not sensor_msgs/msg/NavSatFix"
    assert said in capsys.readouterr().err
    bag = BagWriter(tmp_path / "cut")
    bag.add_topic("/nav/fix", "sensor_msgs/msg/NavSatFix", [], "")
    for length in (0, 8, 40):
        bag.write("/nav/fix", serialize_message(NavSatFix())[:length], 0, 0)
    bag.close()
    with pytest.raises(InputError, match="has no two messages on nav/fix"):
        open_bag(tmp_path / "cut")


@pytest.mark.parametrize("cut", ["pmht_mm/fix", "pmht_mm/candidates", "gravimeter/disturbance"])
def test_a_message_that_is_cut_off_in_its_body_is_left_out(
    recording, tmp_path, capsys, cut
) -> None:
    """One ended view and replay with a traceback."""
    seen: list[bytes] = []

    def change(topic: str, data: bytes) -> bytes:
        seen.extend([data] if topic == f"/{cut}" else [])
        return data[: len(data) * 2 // 3] if topic == f"/{cut}" and len(seen) == 2 else data

    bag = rewritten(recording, tmp_path / "bag", change)
    viewed, _ = open_bag(bag)
    said = f"messages left out of /{cut}: 1 (cut off, or of another type)"
    assert said in capsys.readouterr().err
    whole, _ = open_bag(recording)
    missing = {"pmht_mm/fix": (0, 1), "gravimeter/disturbance": (1, 0)}.get(cut, (0, 0))
    for name, less in zip(("time", "fix_time"), missing, strict=True):
        assert len(getattr(viewed.runs, name)) == len(getattr(whole.runs, name)) - less
