"""Make the data of this example: a map of the magnetic anomaly, a calibration flight and a flight
over the map, of an aircraft whose own field changes by some 200 nT with heading."""

import argparse
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.magnetics.aircraft import MagneticAircraft, VectorErrors
from isogal.magnetics.manoeuvres import Flight, calibration_flight, ordinary_flight
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.seeds import generator
from isogal.sensors.magnetometer import field_vector

SOUTH_WEST = (56.0, -4.0)
"""deg, where the flights begin."""
METRES = (111_300.0, 62_400.0)
"""In a degree of latitude and of longitude there, as far as this example needs it."""
HEIGHT, YEAR = 1000.0, 2025.0
RATE = 5.0
"""Readings in a second."""
ASTRAY = 400.0
"""m by which the recorded positions of the flight over the map are too far north."""
AIRCRAFT = MagneticAircraft(
    permanent=np.array([130.0, -90.0, 160.0]),
    induced=1e-3 * np.array([[2.2, 0.3, -0.2], [0.1, -1.6, 0.4], [0.3, -0.1, 0.9]]),
    eddy=1e-3 * np.array([[3.3, 1.1, -2.2], [0.5, 4.4, 1.1], [-1.1, 0.7, 2.2]]),
)
FLUXGATE = VectorErrors(
    matrix=np.eye(3) + 1e-2 * np.array([[0.5, -0.8, 1.0], [0.6, -0.4, -1.0], [-0.9, 0.7, 0.3]]),
    offset=np.array([30.0, -50.0, 20.0]),
    noise=2.0,
)


def geology(flight: Flight, spacing: float = 400.0) -> FieldMap:
    """Return a map of the anomaly around a flight: waves of 4 to 20 km in all directions."""
    random = generator(0, 0, "example_geology")
    axes = [
        np.arange(part.min() - 8000.0, part.max() + 8000.0, spacing)
        for part in (flight.north, flight.east)
    ]
    values = np.zeros((axes[0].size, axes[1].size))
    for _ in range(60):
        wave = 2.0 * np.pi / random.uniform(4000.0, 20_000.0)
        angle, phase = random.uniform(0.0, 2.0 * np.pi, 2)
        along = np.add.outer(np.cos(angle) * axes[0], np.sin(angle) * axes[1])
        values += 15.0 * np.sin(wave * along + phase)
    degrees = [start + axis / m for start, axis, m in zip(SOUTH_WEST, axes, METRES, strict=True)]
    return FieldMap(
        np.radians(degrees[0]),
        np.radians(degrees[1]),
        values,
        "nT",
        "magnetic_anomaly",
        sigma=np.full(values.shape, 2.0),
        height=HEIGHT,
    )


def record(path: Path, flight: Flight, anomaly: Array, astray: float, seed: int) -> None:
    """Write what the instruments of the aircraft record over an anomaly (N,), nT."""
    random = generator(seed, 0, "example_instruments")
    place = [
        start + part / m
        for start, part, m in zip(SOUTH_WEST, (flight.north, flight.east), METRES, strict=True)
    ]
    main_field = field_vector(*place, HEIGHT, YEAR)
    length = np.linalg.norm(main_field, axis=-1)
    body = flight.in_body(main_field * (1.0 + anomaly / length)[:, None])
    felt = AIRCRAFT.field_on_board(body, np.gradient(body, flight.time, axis=0))
    scalar = np.linalg.norm(felt, axis=-1) + 0.1 * random.standard_normal(len(felt))
    rows = np.column_stack(
        [
            flight.time,
            place[0] + astray / METRES[0],
            place[1],
            np.full(len(felt), HEIGHT),
            scalar,
            FLUXGATE.read(felt, random),
        ]
    )
    header = "time,latitude,longitude,height,scalar,vector_x,vector_y,vector_z"
    np.savetxt(path, rows, "%.10g", ",", header=header, comments="")


def main(folder: Path, minutes: float = 15.0) -> None:
    """Write ``map.nc``, ``calibration.csv`` and ``flight.csv``, which takes some minutes."""
    folder.mkdir(parents=True, exist_ok=True)
    flight, square = ordinary_flight(1, minutes, RATE), calibration_flight(rate=RATE)
    field_map = geology(flight)
    write_netcdf(field_map, folder / "map.nc")
    south, west = (np.radians(one) for one in SOUTH_WEST)
    here = field_map.value(
        south + np.radians(flight.north / METRES[0]), west + np.radians(flight.east / METRES[1])
    )
    record(folder / "calibration.csv", square, np.zeros(len(square.time)), 0.0, 1)
    record(folder / "flight.csv", flight, here, ASTRAY, 2)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path(), help="default: here")
    parser.add_argument("minutes", type=float, nargs="?", default=15.0, help="of the flight: 15")
    main(**vars(parser.parse_args()))
