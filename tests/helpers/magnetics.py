"""Flights of a magnetic aircraft built by hand."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.magnetics.aircraft import MagneticAircraft, VectorErrors
from isogal.magnetics.manoeuvres import Flight
from isogal.magnetics.readings import Readings

MAIN_FIELD = np.array([17_281.0, -169.0, 47_147.0])
"""nT, north, east, down: in Scotland."""
INTENSITY = float(np.linalg.norm(MAIN_FIELD))
_TENSORS = 1e-3 * np.array(
    [
        [[2.0, 0.3, -0.2], [0.1, -1.5, 0.4], [0.3, -0.1, 0.8]],
        [[3.0, 1.0, -2.0], [0.5, 4.0, 1.0], [-1.0, 0.6, 2.0]],
    ]
)
BAD_SENSOR = VectorErrors(
    np.array([[1.012, -0.008, 0.01], [0.006, 0.991, -0.012], [-0.009, 0.011, 1.007]]),
    np.array([30.0, -50.0, 20.0]),
    5.0,
)
"""Scale 1 %, misalignment 0.6 degrees, offset 60 nT, noise 5 nT."""


STROBE = np.array([8.0, -5.0, 6.0])
"""nT/A, of a circuit that is switched."""


def aircraft(size: float = 1.1) -> MagneticAircraft:
    """Return one with a heading error of about 200 nT (peak to peak) for a size of 1.1."""
    moment = size * np.array([120.0, -80.0, 150.0])
    return MagneticAircraft(moment, size * _TENSORS[0], size * _TENSORS[1])


@dataclass
class Circumstances:
    """What else is in the readings."""

    anomaly: float = 20.0
    """nT, amplitude over wavelengths of 4 and 5 km."""
    diurnal: float = 0.0
    """nT, amplitude over half an hour."""
    noise: float = 0.1
    """nT, of the scalar magnetometer."""
    lag: float = 0.0
    """s, of the vector magnetometer."""
    errors: VectorErrors = field(default_factory=VectorErrors)
    strobe: bool = False
    """Whether a circuit is switched."""


def fly(
    flight: Flight, craft: MagneticAircraft, around: Circumstances | None = None, seed: int = 1
) -> tuple[Readings, Array]:
    """Return the readings of a flight and the (N,) total field without the aircraft, nT."""
    around, random = around or Circumstances(), np.random.default_rng(seed)
    anomaly = around.anomaly * np.sin(2.0 * np.pi * flight.north / 4000.0)
    anomaly = anomaly * np.cos(2.0 * np.pi * flight.east / 5000.0)
    total = INTENSITY + anomaly + around.diurnal * np.sin(2.0 * np.pi * flight.time / 1800.0)
    body = flight.in_body(total[:, None] * MAIN_FIELD / INTENSITY)
    felt, currents = craft.field_on_board(body, np.gradient(body, flight.time, axis=0)), {}
    if around.strobe:
        currents["strobe"] = 5.0 * (np.sin(2.0 * np.pi * flight.time / 7.3) > 0.3)
        felt = felt + currents["strobe"][:, None] * STROBE
    scalar = np.linalg.norm(felt, axis=-1)
    scalar = scalar + around.noise * random.standard_normal(scalar.size)
    vector = around.errors.read(felt, random)
    if around.lag:
        shift = np.clip(flight.time - around.lag, flight.time[0], None)
        vector = np.stack([np.interp(shift, flight.time, v) for v in vector.T], axis=-1)
    return Readings(flight.time, scalar, vector, "flight", currents), total


def write_flight(path: Path, flight: Flight, readings: Readings, **columns: object) -> Path:
    """Write a flight over Scotland as a file of `isogal mag`; columns may be given, or left out
    by None."""
    place = {
        "latitude": 56.0 + flight.north / 111_200.0,
        "longitude": -4.0 + flight.east / 62_200.0,
        "height": np.full(len(readings), 500.0),
    }
    vector = {f"vector_{axis}": readings.vector[:, i] for i, axis in enumerate("xyz")}
    currents = {f"current_{name}": value for name, value in readings.currents.items()}
    table = {"time": readings.time, **place, "scalar": readings.total, **vector, **currents}
    table = {name: column for name, column in (table | columns).items() if column is not None}
    rows = np.stack([np.asarray(column, float) for column in table.values()], axis=-1)
    np.savetxt(path, rows, "%.14g", ",", header=",".join(table), comments="")
    return path


def spread(error: Array) -> float:
    """Return the largest deviation from the mean of what is known."""
    return float(np.nanmax(np.abs(error - np.nanmean(error))))
