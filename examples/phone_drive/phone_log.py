"""A drive recorded by a telephone, as readings of a vehicle.

The axes of a telephone say nothing of the car it lies in. Its own estimate of gravity says which
way is up, at any time, also after somebody has moved it; the turn rate about that is the car's.
Which way is forward follows from how the speed changes: over the first minutes the level part of
the specific force is that of a car, whose acceleration is dv/dt forward and v times the turn rate
to the right, but for one angle."""

from dataclasses import dataclass
from pathlib import Path

import netCDF4
import numpy as np

Array = np.ndarray
GRAVITY = 9.80665
STANDS, HANDLED = 0.5, 3e-3
"""m/s, and rad/s: a car that is slower than that does not turn, and what turns faster is the
telephone in somebody's hand."""
SAMPLED = 0.1
"""1-sigma of what a turn between two samples is off by, as a share of the rate at a sample: turns
of 0.7 rad within five seconds are off by 0.03 rad (standard deviation over 100 turns)."""
LEAST_SPEED = 3.0
"""m/s above which acceleration says which way is forward."""


@dataclass(frozen=True, eq=False)
class Drive:
    """Readings of a drive once a second. SI, radians; NaN = none."""

    time: Array
    """(N,) s since the start."""
    start: float
    """Of these, s since 1970."""
    force: Array
    """(N, 3) specific force, forward, right, down of a level vehicle, mean of a second."""
    rate: Array
    """(N, 3) angular rate likewise."""
    turn_variance: Array
    """(N,) of the noise of its last component, (rad/s)²."""
    pressure: Array
    """(N,) Pa."""
    speed: Array
    """(N,) of the satellite receiver, which stands for an odometer."""
    latitude: Array
    longitude: Array
    altitude: Array
    course: Array
    """(N,) of the satellite receiver, also below."""
    horizontal_sigma: Array
    speed_sigma: Array


def read_drive(path: Path, known: float = 300.0) -> Drive:
    """Read a drive; of the satellites' speed only what is before `known` (s) tells which way is
    forward."""
    with netCDF4.Dataset(path) as file:
        columns = {
            name: np.ma.filled(variable[:].astype(float), np.nan)
            for name, variable in file.variables.items()
        }
        clock = file["time"]
        begin = netCDF4.num2date(clock[0], clock.units, clock.calendar)
    time = columns["time"] - columns["time"][0]
    force, rate, up = (
        _filled(np.stack([columns[f"{name}_{axis}"] for axis in "xyz"], axis=1))
        for name in ("acc", "gyro", "grav")
    )
    speed = np.where(columns["speed"] < 0.0, np.nan, columns["speed"])
    level, turn = _levelled(force, rate, up)
    turn = np.where((speed < STANDS) & (np.abs(turn) > HANDLED), 0.0, turn)
    forward = _forward(level, turn, speed, time < known)
    turned = level @ forward
    down = -np.einsum("ni,ni->n", force, _unit(up))
    specific = np.column_stack([turned, down])
    rates = np.column_stack([np.zeros((len(turn), 2)), turn])
    start = begin.timestamp() if hasattr(begin, "timestamp") else 0.0
    return Drive(
        time,
        start,
        _means(specific),
        _means(rates),
        _means(np.square(SAMPLED * np.linalg.norm(rate, axis=1))[:, None])[:, 0],
        100.0 * columns["pressure"],
        speed,
        np.radians(columns["latitude"]),
        np.radians(columns["longitude"]),
        columns["altitude"],
        np.radians(np.where(columns["bearing"] < 0.0, np.nan, columns["bearing"])),
        np.where(columns["horizontalAccuracy"] > 0.0, columns["horizontalAccuracy"], np.nan),
        np.where(columns["speedAccuracy"] > 0.0, columns["speedAccuracy"], np.nan),
    )


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _filled(vectors: Array) -> Array:
    """Return readings (N, 3) in which a missing one is the one before, or the first."""
    known = np.isfinite(vectors).all(axis=1)
    which = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
    return vectors[np.where(which < 0, int(np.argmax(known)), which)]


def _means(samples: Array) -> Array:
    """Return the means over each second of samples (N, 3) at its ends."""
    before = np.vstack([samples[:1], samples[:-1]])
    return 0.5 * (before + samples)


def _levelled(force: Array, rate: Array, up: Array) -> tuple[Array, Array]:
    """Return (N, 2) the level part of the specific force, in axes that turn with the telephone
    about the vertical, and (N,) the turn rate about down."""
    vertical = _unit(up)
    # the telephone's axis that is most nearly level at the start stays one of reference
    axis = np.eye(3)[int(np.argmin(np.abs(vertical[:60].mean(axis=0))))]
    x = _unit(axis - (vertical @ axis)[:, None] * vertical)
    y = np.cross(-vertical, x)  # x, y, down
    level = np.column_stack([np.einsum("ni,ni->n", force, e) for e in (x, y)])
    return level, -np.einsum("ni,ni->n", rate, vertical)


def _forward(level: Array, turn: Array, speed: Array, known: Array) -> Array:
    """Return (2, 2) by which level readings are multiplied to be forward and right."""
    acceleration = np.gradient(speed)
    expected = acceleration + 1j * speed * turn
    sensed = level[:, 0] + 1j * level[:, 1]
    use = known & np.isfinite(expected) & (speed > LEAST_SPEED)
    turned = np.vdot(sensed[use], expected[use]) if use.any() else 1.0
    cos, sin = np.real(turned) / abs(turned), np.imag(turned) / abs(turned)
    return np.array([[cos, sin], [-sin, cos]])
