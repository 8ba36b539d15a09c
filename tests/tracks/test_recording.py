"""Tracks in bags that are written with the mcap library: topics, stamps, incomplete files, wrong
types."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from helpers.bags import (
    ANOMALY,
    FIX,
    READING,
    TEXT,
    anomaly,
    drive,
    ground,
    position,
    reading,
    write_bag,
)
from isogal.errors import InputError
from isogal.tracks.recording import is_recording, read_recording


def tracks_of(path, *topic):
    """The tracks of a bag by quantity."""
    return {track.quantity: track for track in read_recording(path, *topic)}


@pytest.mark.parametrize("prefix", ["", "/ship/"])
def test_readings_get_the_position_at_their_stamp(tmp_path, prefix):
    write_bag(tmp_path / "bag" / "bag_0.mcap", *drive(prefix=prefix))
    assert is_recording(tmp_path) and is_recording(Path("a.MCAP"))
    tracks = tracks_of(tmp_path / "bag")
    track = tracks["gravity"]
    np.testing.assert_allclose(track.time, np.arange(2.5, 19.0, 2.0))
    np.testing.assert_allclose(np.degrees(track.latitude), -36.0 + 1e-3 * track.time, rtol=1e-12)
    np.testing.assert_allclose(track.value, 9.8 + 1e-5 * (track.time - 0.5), rtol=1e-12)
    np.testing.assert_allclose(track.sigma, 1e-5)
    assert track.reduction == "velocity"
    np.testing.assert_allclose(tracks["disturbance"].value, 1e-5 * (track.time - 0.5), rtol=1e-12)


def test_readings_of_other_sensors(tmp_path):
    others = [("/magnetometer/anomaly", ANOMALY, anomaly(t, 10.0 * t, 2.0)) for t in range(3, 9)]
    others += [("/altimeter/terrain", FIX, ground(t, 100.0 + t, 3.0)) for t in range(4, 10)]
    others += [("/altimeter/terrain", FIX, ground(10, np.nan, 3.0, status=-1))]
    tracks = tracks_of(write_bag(tmp_path / "b.mcap", *drive(), *others))
    magnetic, terrain = tracks["magnetic_anomaly"], tracks["height"]
    np.testing.assert_allclose(magnetic.value, 10.0 * magnetic.time, rtol=1e-12)
    np.testing.assert_allclose(magnetic.sigma, 2.0)
    np.testing.assert_allclose(terrain.value, [*(100.0 + terrain.time[:-1]), np.nan])
    np.testing.assert_allclose(terrain.sigma, 3.0)
    assert (magnetic.reduction, terrain.reduction) == ("main-field", "none")
    # heights of the ground are not positions of the navigator
    np.testing.assert_allclose(np.degrees(terrain.latitude), -36.0 + 1e-3 * terrain.time)
    for track, quantity in ((magnetic, "magnetic_anomaly"), (terrain, "height")):
        assert track.jacobian(quantity).any() == (quantity == "magnetic_anomaly")


def test_later_positions_of_a_stamp_those_without_a_fix_and_other_topics_are_ignored(tmp_path):
    messages = drive()
    expected = tracks_of(write_bag(tmp_path / "first.mcap", *messages))["gravity"]
    # the filter publishes once more after it has used a fix
    messages.insert(9, ("/nav/fix", FIX, position(3, -40.0, 147.0)))
    messages += [
        ("/nav/fix", FIX, position(30.0, 0.0, 0.0, status=-1)),
        ("/gravimeter/gravity", READING, reading(25.0, 9.8)),
        ("/talk", TEXT, SimpleNamespace(data="x")),
    ]
    bag = write_bag(tmp_path / "b.mcap", *messages)
    found = tracks_of(bag)["gravity"]
    np.testing.assert_array_equal(found.latitude, expected.latitude)
    assert found.time[-1] == 18.5
    topics = "/gravimeter/disturbance, /gravimeter/gravity, /nav/fix, /talk"
    with pytest.raises(InputError, match=f"has no message on 'ins/fix'; it has {topics}"):
        read_recording(bag, "ins/fix")


def test_a_bag_in_several_files_and_one_cut_short(tmp_path):
    messages = drive(40)
    write_bag(tmp_path / "bag" / "bag_2.mcap", *messages[:40])
    write_bag(tmp_path / "bag" / "bag_10.mcap", *messages[40:])
    assert len(tracks_of(tmp_path / "bag")["gravity"]) == 19
    file = tmp_path / "cut.mcap"
    write_bag(file, *messages, chunk_size=1000)
    data = file.read_bytes()
    sizes = []
    for share in (0.3, 0.5, 0.95):
        file.write_bytes(data[: int(share * len(data))])
        sizes.append(len(tracks_of(file)["gravity"]))
    assert 1 <= sizes[0] < sizes[1] < 19
    assert sizes[2] == 19  # the summary at the end is not needed


SAYS = SimpleNamespace(data="x")
READINGS = [message for message in drive() if "nav" not in message[0]]
EARLY = [*READINGS, *(message for message in drive(4)[:4] if message[1] == FIX)]


@pytest.mark.parametrize(
    ("messages", "says"),
    [
        ([], "has no message on 'nav/fix'; it has none at all"),
        ([m for m in drive() if "nav" in m[0]], "has no message on 'gravimeter/gravity'"),
        ([("gravimeter/gravity", TEXT, SAYS)], f"'gravimeter/gravity' must be of type {READING}"),
        (EARLY, "no reading lies between the first and the last position"),
    ],
)
def test_bags_without_a_track_are_refused_in_one_line(tmp_path, messages, says):
    with pytest.raises(InputError, match=says) as caught:
        read_recording(write_bag(tmp_path / "b.mcap", *messages))
    assert "\n" not in str(caught.value)


def test_what_is_no_bag_is_refused_in_one_line(tmp_path):
    with pytest.raises(InputError, match="no such file or folder"):
        read_recording(tmp_path / "none")
    with pytest.raises(InputError, match="no MCAP file in this folder"):
        read_recording(tmp_path)
    file = tmp_path / "x.mcap"
    for data in (b"", b"hello", b"\x89MCAP0\r\n" + bytes(50)):
        file.write_bytes(data)
        with pytest.raises(InputError, match=r"cannot be read as MCAP|has no message"):
            read_recording(file)


def test_readings_without_a_variance_cannot_be_used(tmp_path):
    silent = tracks_of(write_bag(tmp_path / "s.mcap", *drive(variance=0.0)))["gravity"]
    with pytest.raises(InputError, match="a reading has no sigma; give --sensor-sigma"):
        silent.in_unit(1.0, None)
