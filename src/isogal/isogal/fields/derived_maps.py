"""Maps of a field with several channels, or of one at the flown height, computed from the
scenario's map in a process of its own.

A Fourier transform of a large map takes several times its memory, most of which a process never
gives back. So that nodes stay small, another process computes the maps and leaves them in files,
no larger than the route needs. Processes that start together take them from one folder
(`shared_maps`), where each map is computed once."""

import contextlib
import hashlib
import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from isogal.fields.measured import measured_field
from isogal.fields.source_map import MapSource
from isogal.maps.channels import ChannelMap
from isogal.maps.corridor import corridor_of
from isogal.maps.load import check_coverage
from isogal.scenario import Settings, validate_scenario
from isogal.sensors.trajectory import build_trajectory

SHARED = "ISOGAL_SHARED_MAPS"
"""Environment variable: the folder of `shared_maps`."""
_SECTIONS = frozenset(
    {"route", "imu", "fusion", "map", "field", "fields"}
    | {"gravimeter", "magnetometer", "altimeter", "gradiometer"}
)
"""What the maps depend on. A node knows the sections of the scenario that it uses only."""


@contextlib.contextmanager
def shared_maps() -> Iterator[None]:
    """Have this process and those that it starts share the maps that one of them has computed."""
    if SHARED in os.environ:
        yield
        return
    with tempfile.TemporaryDirectory(prefix="isogal-maps-") as folder:
        os.environ[SHARED] = folder
        try:
            yield
        finally:
            del os.environ[SHARED]


def derived_maps(settings: Settings, margin: float) -> ChannelMap:
    """Return the maps of a scenario's channels, or of its field, cut to its route.

    Parameters
    ----------
    settings : Settings
    margin : float
        m of map kept around the route, as far as the map reaches.

    Raises
    ------
    InputError
        The map cannot be read or transformed, or does not cover the route.
    """
    content = settings.model_dump(mode="json")
    used = {key: content[key] for key in _SECTIONS & content.keys()}
    text, shared = json.dumps([used, margin], sort_keys=True), os.environ.get(SHARED)
    with tempfile.TemporaryDirectory(prefix="isogal-", dir=shared) as temporary:
        kept = Path(shared or temporary) / hashlib.sha256(text.encode()).hexdigest()
        if not kept.exists():
            folder = Path(temporary) / "maps"
            folder.mkdir()
            try:
                subprocess.run(
                    [sys.executable, "-m", __spec__.name, folder],
                    input=json.dumps({"scenario": content, "margin": margin}).encode(),
                    capture_output=True,
                    check=True,
                )
            except (OSError, subprocess.SubprocessError):  # there is none, or it has failed
                return compute(settings, margin)  # which raises here what went wrong there
            with contextlib.suppress(OSError):  # another process was first
                folder.rename(kept)
        return _read(kept)


def compute(settings: Settings, margin: float) -> ChannelMap:
    """Do what `derived_maps` does, in this process."""
    trajectory = build_trajectory(settings)
    route = trajectory.latitude, trajectory.longitude
    window = corridor_of(*route, margin).window
    source, channels = MapSource.of(settings), measured_field(settings).channels
    if channels is None:
        return ChannelMap([source.flown(settings.route.height, window)])
    disturbance = source(window.grown(channels.reach))
    partly = settings.route.track is not None
    check_coverage(disturbance, *route, partly=partly)
    maps = channels.maps(settings, disturbance)
    check_coverage(maps, *route, partly=partly)
    return ChannelMap([channel.window(*window[:4]) for channel in maps.channels])


def _read(folder: Path) -> ChannelMap:
    """Return maps that `_write` has left."""
    # mapped: only values that are looked up take memory; a deleted file stays on disk as long as
    # it is mapped
    arrays = [np.memmap(path, mode="c") for path in sorted(folder.glob("*.array"))]
    return pickle.loads((folder / "maps.pickle").read_bytes(), buffers=arrays)


def _write(folder: Path, maps: ChannelMap) -> None:
    """Leave maps in a folder, each of their arrays in a file of its own."""
    arrays: list[pickle.PickleBuffer] = []
    content = pickle.dumps(maps, protocol=5, buffer_callback=arrays.append)
    (folder / "maps.pickle").write_bytes(content)
    for index, array in enumerate(arrays):
        (folder / f"{index:04d}.array").write_bytes(array.raw())


if __name__ == "__main__":
    _task = json.load(sys.stdin)
    _write(Path(sys.argv[1]), compute(validate_scenario(_task["scenario"]), _task["margin"]))
