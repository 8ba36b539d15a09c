"""Maps of a field with several channels, computed from the scenario's map in a process of its own.

A Fourier transform of a large map takes several times its memory, most of which a process never
gives back. Nodes shall stay small, so another process does it and leaves the result, float32 and
no larger than the route needs, in a file."""

import json
import pickle
import subprocess
import sys
import tempfile
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from isogal.errors import InputError
from isogal.fields.measured import measured_field
from isogal.fields.source_map import source_map
from isogal.maps.channels import ChannelMap
from isogal.maps.corridor import corridor_of
from isogal.maps.field_map import FieldMap
from isogal.maps.load import check_coverage
from isogal.scenario import Scenario, validate_scenario
from isogal.sensors.trajectory import build_trajectory

_REFUSED = 2


def derived_maps(scenario: Scenario, margin: float) -> ChannelMap:
    """Return the maps of a scenario's channels, cut to its route.

    Parameters
    ----------
    scenario : Scenario
        Of a field that has a `sensors.fields.Channels`.
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
        except OSError:  # no further process is to be had
            return compute(scenario, margin)
        if child.returncode == _REFUSED:
            raise InputError(child.stdout.decode())
        if child.returncode:
            return compute(scenario, margin)  # and fail here, if it must fail
        about: list[dict[str, Any]] = pickle.loads(child.stdout)
        # mapped, so that of the maps only what is looked at takes memory; the file lives on
        # without its name as long as the mapping
        values = np.asarray(np.load(Path(folder) / "values.npy", mmap_mode="c"))
    return ChannelMap(
        [FieldMap(values=part, **rest) for part, rest in zip(values, about, strict=True)], values
    )


def compute(scenario: Scenario, margin: float) -> ChannelMap:
    """Do what `derived_maps` does, in this process."""
    channels = measured_field(scenario).channels
    assert channels is not None
    trajectory = build_trajectory(scenario)
    route = trajectory.latitude, trajectory.longitude
    window = corridor_of(*route, margin).window
    source = source_map(scenario, window.grown(channels.reach))
    check_coverage(source, *route)
    maps = channels.maps(scenario, source)
    check_coverage(maps, *route)
    cut = [channel.window(*window[:4]) for channel in maps.channels]
    # the last of float32's digits is a millionth of what is measured, 1e-5 E of 100 E
    return ChannelMap(
        [replace(channel, values=channel.values.astype(np.float32)) for channel in cut]
    )


def _main(folder: Path) -> int:
    task = json.load(sys.stdin)
    try:
        maps = compute(validate_scenario(task["scenario"]), task["margin"])
    except InputError as error:
        sys.stdout.buffer.write(str(error).encode())
        return _REFUSED
    np.save(folder / "values.npy", maps.values)
    names = [field.name for field in fields(FieldMap) if field.name != "values"]
    about = [{name: getattr(channel, name) for name in names} for channel in maps.channels]
    sys.stdout.buffer.write(pickle.dumps(about))
    return 0


if __name__ == "__main__":
    sys.exit(_main(Path(sys.argv[1])))
