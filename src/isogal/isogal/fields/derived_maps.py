"""Maps of a field with several channels, or of one at the flown height, computed from the
scenario's map in a process of its own.

A Fourier transform of a large map takes several times its memory, most of which a process never
gives back. So that nodes stay small, another process computes the maps and leaves them in files:
the values as float32, no larger than the route needs."""

import json
import pickle
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from isogal.errors import InputError
from isogal.fields.flown_height import FlownMap
from isogal.fields.measured import measured_field
from isogal.fields.source_map import MapSource
from isogal.maps.channels import ChannelMap
from isogal.maps.corridor import corridor_of
from isogal.maps.load import check_coverage
from isogal.scenario import Settings, validate_scenario
from isogal.sensors.trajectory import build_trajectory

_REFUSED = 2


def derived_maps(scenario: Settings, margin: float) -> ChannelMap:
    """Return the maps of a scenario's channels, or of its field, cut to its route.

    Parameters
    ----------
    scenario : Settings
    margin : float
        m of map kept around the route, as far as the map reaches.

    Raises
    ------
    InputError
        The map cannot be read or transformed, or does not cover the route.
    """
    task = json.dumps({"scenario": scenario.model_dump(mode="json"), "margin": margin})
    with tempfile.TemporaryDirectory(prefix="isogal-") as folder:
        try:
            child = subprocess.run(
                [sys.executable, "-m", __spec__.name, folder],
                input=task.encode(),
                capture_output=True,
                check=False,
            )
        except OSError:  # no other process can be started
            return compute(scenario, margin)
        if child.returncode == _REFUSED:
            raise InputError(child.stdout.decode())
        if child.returncode:
            return compute(scenario, margin)  # which raises here what went wrong there
        return _read(Path(folder))


def compute(scenario: Settings, margin: float) -> ChannelMap:
    """Do what `derived_maps` does, in this process."""
    trajectory = build_trajectory(scenario)
    route = trajectory.latitude, trajectory.longitude
    window = corridor_of(*route, margin).window
    channels = measured_field(scenario).channels
    if channels is None:
        return ChannelMap([FlownMap.of(scenario)(window=window)])
    source = MapSource.of(scenario)(window=window.grown(channels.reach))
    check_coverage(source, *route)
    maps = channels.maps(scenario, source)
    check_coverage(maps, *route)
    cut = [channel.window(*window[:4]) for channel in maps.channels]
    # float32 rounds to a ten-millionth: 1e-5 E of 100 E
    return ChannelMap(
        [replace(channel, values=channel.values.astype(np.float32)) for channel in cut]
    )


def _read(folder: Path) -> ChannelMap:
    """Return maps that `_write` has left."""
    # mapped: only values that are looked up take memory; a deleted file stays on disk as long as
    # it is mapped
    arrays = [np.memmap(path, mode="c") for path in sorted(folder.glob("*.array"))]
    maps: ChannelMap = pickle.loads((folder / "maps.pickle").read_bytes(), buffers=arrays)
    return maps


def _write(folder: Path, maps: ChannelMap) -> None:
    """Leave maps in a folder, each of their arrays in a file of its own."""
    arrays: list[pickle.PickleBuffer] = []
    content = pickle.dumps(maps, protocol=5, buffer_callback=arrays.append)
    (folder / "maps.pickle").write_bytes(content)
    for index, array in enumerate(arrays):
        (folder / f"{index:04d}.array").write_bytes(array.raw())


def _main(folder: Path) -> int:
    task = json.load(sys.stdin)
    try:
        _write(folder, compute(validate_scenario(task["scenario"]), task["margin"]))
    except InputError as error:
        sys.stdout.buffer.write(str(error).encode())
        return _REFUSED
    return 0


if __name__ == "__main__":
    sys.exit(_main(Path(sys.argv[1])))
