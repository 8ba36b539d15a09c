"""Maps of a field with several channels, or of one at the flown height, computed from the
scenario's map in a process of its own.

A Fourier transform of a large map takes several times its memory, most of which a process never
gives back. So that nodes stay small, another process computes the maps and leaves them in files:
the values as float32, no larger than the route needs, and what is known about them as JSON."""

import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.fields.flown_height import FlownMap
from isogal.fields.measured import measured_field
from isogal.fields.source_map import MapSource
from isogal.maps.channels import ChannelMap
from isogal.maps.corridor import corridor_of
from isogal.maps.field_map import FieldMap
from isogal.maps.load import check_coverage
from isogal.scenario import Settings, validate_scenario
from isogal.sensors.trajectory import build_trajectory

_REFUSED = 2
_ARRAYS = ("latitude", "longitude", "values", "sigma")
_BY_NODE = ("correlation_lengths", "error_ellipses")
_ABOUT = (
    *("unit", "quantity", "correlation_length", "quantisation"),
    *("provenance", "file_unit", "file_factor", "height", "error_stated"),
)


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
        return _read(Path(folder), json.loads(child.stdout))


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


def _read(folder: Path, about: list[dict[str, Any]]) -> ChannelMap:
    """Return maps that `_write` has left."""
    # mapped: only values that are looked up take memory; the deleted file stays on disk as long as
    # it is mapped
    latitude, longitude, values, sigma = (
        np.asarray(np.load(folder / f"{name}.npy", mmap_mode="c")) for name in _ARRAYS
    )
    return ChannelMap(
        [
            FieldMap(
                latitude,
                longitude,
                part,
                sigma=_uniform(error),
                **{name: np.load(path) for name, path in files.items() if path.exists()},
                **rest,
            )
            for part, error, files, rest in zip(
                values, sigma, _files(folder, len(about)), about, strict=True
            )
        ],
        values,
    )


def _files(folder: Path, count: int) -> list[dict[str, Path]]:
    """Return the files of what each channel may say of its error's correlation by node."""
    return [{name: folder / f"{name}-{index}.npy" for name in _BY_NODE} for index in range(count)]


def _uniform(sigma: Array) -> float | Array:
    """Return a sigma without axes as a number."""
    return float(sigma) if np.ndim(sigma) == 0 else sigma


def _write(folder: Path, maps: ChannelMap) -> list[dict[str, Any]]:
    """Leave the arrays of maps in a folder, and return the rest."""
    first = maps.channels[0]
    sigma = np.stack([channel.sigma for channel in maps.channels])
    arrays = first.latitude, first.longitude, maps.values, sigma
    for name, array in zip(_ARRAYS, arrays, strict=True):
        np.save(folder / f"{name}.npy", array)
    for files, channel in zip(_files(folder, len(maps.channels)), maps.channels, strict=True):
        for name, path in files.items():
            if getattr(channel, name) is not None:
                np.save(path, getattr(channel, name))
    return [{name: getattr(channel, name) for name in _ABOUT} for channel in maps.channels]


def _main(folder: Path) -> int:
    task = json.load(sys.stdin)
    try:
        maps = compute(validate_scenario(task["scenario"]), task["margin"])
    except InputError as error:
        sys.stdout.buffer.write(str(error).encode())
        return _REFUSED
    sys.stdout.write(json.dumps(_write(folder, maps)))
    return 0


if __name__ == "__main__":
    sys.exit(_main(Path(sys.argv[1])))
