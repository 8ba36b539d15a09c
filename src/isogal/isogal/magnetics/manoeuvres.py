"""Simulated flights: attitude and field along a calibration flight, and along an ordinary one."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.seeds import generator

_MANOEUVRES = ((0, 0.175), (1, 0.0875), (2, 0.0875))
"""Angle about each body axis, rad: 10 degrees of roll, 5 of pitch and of yaw."""
_SPEED = 70.0
"""m/s."""
_PERIOD = 6.0
"""s of one roll, pitch or yaw."""
_EACH = 30.0
"""s of each manoeuvre."""
_TURN_RATE = 0.05
"""rad/s in turns."""
_BANK = 0.35
"""rad in turns."""


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """Attitude and place of N readings."""

    time: Array
    """(N,) s."""
    angles: Array
    """(N, 3) roll, pitch, heading, rad."""
    north: Array
    """(N,) m from the start."""
    east: Array
    """(N,) m."""

    def in_body(self, field: Array) -> Array:
        """Return (N, 3) a field (N, 3) or (3,) given in north, east, down, in body axes (Groves
        2013, eq. 2.22)."""
        from scipy.spatial.transform import Rotation

        attitude = Rotation.from_euler("xyz", self.angles)
        return np.asarray(attitude.apply(field, inverse=True))


def calibration_flight(rate: float = 10.0) -> Flight:
    """Return a flight round a square, with rolls, pitches and yaws on each side; `rate` readings
    in a second."""
    pieces = []
    for heading in 0.5 * math.pi * np.arange(4.0):
        pieces += [_side(rate, heading), _turn(rate, heading, heading + 0.5 * math.pi)]
    return _flown(np.concatenate(pieces), rate)


def ordinary_flight(seed: int, minutes: float = 20.0, rate: float = 10.0) -> Flight:
    """Return a flight with turns to headings drawn by a seed, a minute or two apart, and the
    unrest of moderate turbulence (1 degree of roll, 0.5 of pitch and yaw, over some seconds).

    Parameters
    ----------
    seed : int
    minutes : float
    rate : float
        Readings in a second, Hz.
    """
    random = generator(seed, 0, "ordinary_flight")
    pieces: list[Array] = []
    heading, count = 0.0, round(minutes * 60.0 * rate)
    while sum(len(piece) for piece in pieces) < count:
        straight = np.zeros((round(random.uniform(40.0, 100.0) * rate), 3))
        straight[:, 2] = heading
        new = heading + math.copysign(random.uniform(0.6, 2.5), random.uniform(-1.0, 1.0))
        pieces += [straight, _turn(rate, heading, new)]
        heading = new
    angles = np.concatenate(pieces)[:count]
    angles = angles + np.radians([1.0, 0.5, 0.5]) * _unrest(random, count, rate)
    return _flown(angles, rate)


def _side(rate: float, heading: float) -> Array:
    """Return (N, 3) angles of one side, with a pause before each manoeuvre."""
    time = np.arange(round(_EACH * rate)) / rate
    swing = np.sin(2.0 * math.pi * time / _PERIOD) * np.minimum(1.0, (_EACH - time) / 2.0)
    parts = []
    for axis, size in _MANOEUVRES:
        pause, part = np.zeros((round(5.0 * rate), 3)), np.zeros((time.size, 3))
        part[:, axis] = size * swing
        parts += [pause, part]
    angles = np.concatenate(parts)
    angles[:, 2] += heading
    return angles


def _turn(rate: float, before: float, after: float) -> Array:
    """Return (N, 3) angles of a banked turn that begins and ends smoothly."""
    way = after - before
    count = max(8, round((abs(way) / _TURN_RATE + 6.0) * rate))
    share = np.linspace(0.0, 1.0, count, endpoint=False)
    smooth = share - np.sin(2.0 * math.pi * share) / (2.0 * math.pi)
    angles = np.zeros((count, 3))
    angles[:, 0] = math.copysign(_BANK, way) * np.sin(math.pi * share) ** 2
    angles[:, 2] = before + way * smooth
    return angles


def _unrest(random: np.random.Generator, count: int, rate: float) -> Array:
    """Return (count, 3) smooth noise of unit variance, correlated over a second or two."""
    from scipy.signal import butter, sosfiltfilt

    sos = butter(2, 0.3, fs=rate, output="sos")
    smooth: Array = sosfiltfilt(sos, random.standard_normal((count, 3)), axis=0)
    return smooth / smooth.std(axis=0)


def _flown(angles: Array, rate: float) -> Flight:
    time = np.arange(len(angles)) / rate
    north = np.cumsum(np.cos(angles[:, 2])) * _SPEED / rate
    east = np.cumsum(np.sin(angles[:, 2])) * _SPEED / rate
    return Flight(time, angles, north, east)
