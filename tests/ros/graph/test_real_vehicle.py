"""What a real vehicle's recording has not: the truth, an unaided INS, stamps that coincide, its
beginning at the scenario's start."""

import json
import re

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from helpers.command_line import answer
from helpers.recordings import collect, nav_positions, replayed, rewritten
from isogal.fields.scenario_map import map_for_scenario
from isogal_ros import topics
from isogal_ros.bags.viewing import viewed_run
from isogal_ros.messages.prepared import peek_ns
from isogal_ros.messages.stamps import set_stamp

SIMULATED = ("/ground_truth/fix", "/ground_truth/odom", "/ins/fix", "/clock")
BEGIN = 100
"""s of the run at which the recording begins."""
SECOND = 10**9


@pytest.fixture(scope="module")
def voyage(recording, tmp_path_factory):
    """The recording without what only a simulation knows, and without its first part."""

    def kept(topic: str, data: bytes) -> bytes | None:
        stamped = topic not in ("/nav/covariance", "/nav/protection_level", "/diagnostics")
        early = stamped and peek_ns(data) < BEGIN * SECOND
        return None if topic in SIMULATED or early else data

    return rewritten(recording, tmp_path_factory.mktemp("voyage") / "bag", kept)


def test_it_is_viewed_without_errors(voyage, tmp_path) -> None:
    pytest.importorskip("bokeh", reason="needs bokeh, which draws the page")
    answer("view", voyage, "--out", tmp_path / "view.html")
    text = (tmp_path / "view.html").read_text(encoding="utf-8")
    data = json.loads(re.search(r'id="data" type="application/json">(.*?)</script>', text)[1])
    states, batches, readings = (data[name] for name in ("states", "batches", "readings"))
    assert data["is_true"] is False
    assert len(states["t"]) == 27  # a scan each 10 s
    unknown = [states[name] for name in ("error", "north", "nees", "unaided")]
    unknown += [batches["nees"], readings["truth"]]
    assert {value for column in unknown for value in column} == {None}
    known = [states[name] for name in ("aided_x", "nn", "level")] + [readings["difference"]]
    assert None not in {value for column in known for value in column}
    assert batches["reason"].count(None) > 2
    assert "was not recorded, so errors are not known" in data["missing"][0]


def test_it_is_replayed_from_where_the_navigator_was(voyage, recording) -> None:
    """It once began at the scenario's start: 100 s of way off."""
    result = replayed(voyage)
    (note,) = result.notes
    assert "begins at 100 s: the filter starts there where the recorded navigator was" in note
    known = collect(recording)
    known.last_nav = {ns: known.last_nav[ns] for ns in result.outputs.last_nav}
    apart = 6.4e6 * (nav_positions(result.outputs) - nav_positions(known))[:, :2]
    assert np.hypot(*apart[0]) < 1.0
    assert np.hypot(*apart[-1]) < 200.0  # fixes before it began are missing


def test_stamps_need_not_coincide(recording) -> None:
    """Readings between the navigator's samples: their places are between its places."""
    whole, late = collect(recording), collect(recording)

    def later(ns: int, data: bytes) -> bytes:
        message = deserialize_message(data, topics.DISTURBANCE.type)
        set_stamp(message.header.stamp, ns + SECOND // 2)
        return serialize_message(message)

    late.readings = {ns + SECOND // 2: later(ns, data) for ns, data in late.readings.items()}
    field_map = map_for_scenario(whole.scenario)
    runs, exact = (viewed_run(one, field_map, "").runs for one in (late, whole))
    assert len(runs.detail.scan_time) == len(exact.detail.scan_time) - 1  # the last is after all
    np.testing.assert_allclose(runs.time[1:], exact.time[1:-1] + 0.5)
    moved = np.diff(exact.latitude[1:]) * 0.05  # half a second of ten
    np.testing.assert_allclose(runs.latitude[1:], exact.latitude[1:-1] + moved, atol=1e-9)
    np.testing.assert_allclose(runs.error[0, 1:], exact.error[0, 1:-1], atol=2.0)
