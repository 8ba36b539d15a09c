"""Make the data of this example: a gravity survey flown in lines, and the track of a vehicle that
crosses it with an inertial navigator that is some hundred metres wrong."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.seeds import generator

SOUTH_WEST = (-37.0, 146.0)
"""deg, a corner of the survey."""
METRES = (110_960.0, 89_000.0)
"""In a degree of latitude and of longitude there, as far as this example needs it."""
SIDE = 24_000.0
"""m, of the square that is surveyed."""
ASTRAY = (450.0, -600.0)
"""m north and east by which the vehicle's recorded positions are wrong."""


def gravity(north: Array, east: Array) -> Array:
    """Return the disturbance, mGal, at metres from the corner: waves of 5 to 20 km."""
    random, total = generator(0, 0, "example_gravity"), 0.0 * (north + east)
    for _ in range(40):
        length = random.uniform(5000.0, 20_000.0)
        angle, phase = random.uniform(0.0, 2.0 * np.pi, 2)
        along = np.cos(angle) * north + np.sin(angle) * east
        total = total + 1e-4 * length * np.sin(2.0 * np.pi * along / length + phase)
    return total


def lines(spacing: float) -> tuple[Array, Array, Array]:
    """Return metres north and east and the number of the line of each reading: lines to the east,
    and ties to the north every six lines."""
    random = generator(0, 0, "example_lines")
    along = np.arange(0.0, SIDE, 150.0)
    parts = []
    for number, across in enumerate(np.arange(0.0, SIDE + 1.0, spacing)):
        unsteady = across + 20.0 * random.standard_normal()
        parts.append((np.full_like(along, unsteady), along, np.full_like(along, 10.0 + number)))
    for number, across in enumerate(np.arange(0.0, SIDE + 1.0, 6.0 * spacing)):
        parts.append((along, np.full_like(along, across), np.full_like(along, 900.0 + number)))
    north, east, line = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    return north, east, line


def write(path: Path, names: str, columns: Sequence[Array]) -> None:
    """Write columns of numbers as CSV."""
    np.savetxt(path, np.column_stack(columns), "%.10g", ",", header=names, comments="")


def main(folder: Path, spacing: float = 1500.0) -> None:
    """Write ``survey.csv``, ``track.csv`` and ``truth.csv``."""
    folder.mkdir(parents=True, exist_ok=True)
    random = generator(0, 0, "example_readings")
    north, east, line = lines(spacing)
    offset = {number: 1.0 * random.standard_normal() for number in np.unique(line)}
    value = gravity(north, east) + 0.3 * random.standard_normal(len(north))
    value = value + np.array([offset[number] for number in line])
    latitude, longitude = SOUTH_WEST[0] + north / METRES[0], SOUTH_WEST[1] + east / METRES[1]
    names = "latitude,longitude,disturbance,line"
    write(folder / "survey.csv", names, [latitude, longitude, value, line])
    time = np.arange(0.0, 1500.0, 10.0)
    north = 4000.0 + 7.0 * time + 900.0 * np.sin(time / 150.0)
    east = 3000.0 + 11.0 * time
    value = gravity(north, east) + 0.5 * random.standard_normal(len(time))
    for name, off in (("truth", (0.0, 0.0)), ("track", ASTRAY)):
        place = [
            corner + (metres + by) / unit
            for corner, metres, by, unit in zip(
                SOUTH_WEST, (north, east), off, METRES, strict=True
            )
        ]
        write(folder / f"{name}.csv", "time,latitude,longitude,value", [time, *place, value])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path(), help="default: here")
    parser.add_argument("spacing", type=float, nargs="?", default=1500.0, help="of lines, m: 1500")
    main(**vars(parser.parse_args()))
