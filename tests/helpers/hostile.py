"""Files as a stranger might send them: valid ones with something changed."""

import importlib.util
from collections.abc import Callable
from pathlib import Path

import numpy as np
import yaml

from helpers.bags import drive, write_bag
from helpers.map_files import WRITERS
from isogal import checkpoints
from isogal.checkpoints import Saved
from isogal.magnetics.compensation import Compensation, read_compensation
from isogal.magnetics.terms import COUNT
from isogal.maps.field_map import FieldMap
from isogal.maps.load import load_map
from isogal.scenario import load_scenario
from isogal.scenario.inertial import parse as parse_grades
from isogal.tracks.csv_file import read_csv_tracks
from isogal.tracks.recording import read_recording

PIECES = (
    b"nan", b"-inf", b"1e999", b"-1", b"99999999999", b"0", b",", b"\n", b"\x00", b"\xff\xff\xff",
    b"!!python/object/apply:os.system ['true']", b"&a [*a, *a]", b"../../x", b"{", b": ", b'"',
)  # fmt: skip
"""What is put somewhere into a file."""


_HEADER = 2000  # bytes, where half of the changes are: there they matter most


def mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Bytes with one to four changes: flipped, cut, left out, repeated, put in."""
    changed = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        reach = len(changed) if rng.random() < 0.5 else min(len(changed), _HEADER)
        at = int(rng.integers(0, reach + 1))
        length = int(rng.integers(1, 64))
        match int(rng.integers(0, 6)):
            case 0 if changed:
                changed[at % len(changed)] ^= 1 << int(rng.integers(0, 8))
            case 1:
                del changed[at:]
            case 2:
                del changed[at : at + length]
            case 3:
                changed[at:at] = changed[at : at + length]
            case 4:
                changed[at : at + length] = rng.bytes(length)
            case _:
                changed[at:at] = PIECES[int(rng.integers(0, len(PIECES)))]
    return bytes(changed)


def _points_of(path: Path) -> None:
    load_map(path, "lon,lat,dg", "disturbance", unit="mGal")


def _bag(path: Path) -> None:
    from isogal_ros.bags.reader import BagReader

    reader = BagReader(path)
    reader.scenario()
    for _ in reader.messages():
        pass


def _grades(path: Path) -> None:
    parse_grades(path.read_text(encoding="utf-8", errors="replace"), str(path))


READERS: dict[str, Callable[[Path], object]] = {
    "scenario.yaml": load_scenario,
    "track.csv": read_csv_tracks,
    **dict.fromkeys(WRITERS, load_map),
    "points.xyz": _points_of,
    "state.checkpoint": lambda path: checkpoints.load(path, "x", ("isogal",)),
    "bag.mcap": _bag,
    "flight.mcap": read_recording,
    "grades.yaml": _grades,
    "compensation.yaml": read_compensation,
}
"""Reads a file of that name; may raise InputError and nothing else."""


def valid_files(folder: Path, field_map: FieldMap) -> dict[str, bytes]:
    """Contents of one small valid file of each kind."""
    document = load_scenario(None, ["route.duration=600.0"]).model_dump(mode="json")
    (folder / "scenario.yaml").write_text(yaml.safe_dump(document))
    rows = [f"{k}.0,{-37.0 + 0.01 * k:.5f},145.0,{k}.25,0.5" for k in range(30)]
    text = "time,latitude,longitude,value,sigma\n" + "\n".join(rows)
    (folder / "track.csv").write_text(text + "\n")
    for name, write in WRITERS.items():
        write(folder / name, field_map)
    points = [
        f"{145 + 0.1 * i:.1f} {-37 + 0.1 * j:.1f} {i * j}" for j in range(5) for i in range(6)
    ]
    (folder / "points.xyz").write_text("\n".join(points) + "\n")
    grade = {"gyroscope": {"bias": "7deg/h"}, "accelerometer": {"bias": ["1ug", 2e-5, 0.0]}}
    (folder / "grades.yaml").write_text(yaml.safe_dump({"mine": grade}))
    Compensation(0.1 * np.arange(COUNT)).write(folder / "compensation.yaml")
    write_bag(folder / "flight.mcap", *drive(10))
    checkpoints.save(folder / "state.checkpoint", "x", Saved(5, {"a": np.arange(9.0)}))
    if importlib.util.find_spec("rclpy") is not None:
        _write_bag(folder)
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def _write_bag(folder: Path) -> None:
    from isogal_ros import topics
    from isogal_ros.bags.metadata import qos_entries
    from isogal_ros.bags.writer import BagWriter

    writer = BagWriter(folder / "bag", {"scenario": "seed: 3"})
    writer.add_topic("/nav/fix", "sensor_msgs/msg/NavSatFix", qos_entries([topics.LOSSLESS]), "")
    for k in range(50):
        writer.write("/nav/fix", bytes(range(200)), k, k)
    writer.close()
    (folder / "bag" / "bag_0.mcap").rename(folder / "bag.mcap")
