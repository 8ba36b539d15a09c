"""The true route along a recorded track, and what a perfect IMU measures on it
(docs/mathematics.md, section 3.21).

Positions become a path by cubic smoothing splines of north, east and height, whose smoothness
generalised cross-validation chooses (Craven and Wahba 1979): as near to the positions as their own
scatter says. The vehicle is level and points along its course; at rest, and where it is too slow
to have a course, it turns evenly to the next one. The IMU's means are those of the inverse
strapdown (`isogal.inertial.inverse`), and the truth is where they lead: within centimetres of the
path, and exactly what a navigator without errors would find."""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.inertial.error_state import Estimate
from isogal.inertial.ins_file import check_steps
from isogal.inertial.inverse import NO_COURSE, inverse
from isogal.inertial.rotations import from_heading
from isogal.inertial.strapdown import propagate
from isogal.maps.gridding.rows import HEIGHT, LATITUDE, LONGITUDE, TIME, one_line, read_rows
from isogal.scenario import Route
from isogal.sensors.smoothness import smoothness

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

FEWEST = 5
"""Positions that a smoothing spline needs."""
NEAREST_POLE_DEG = 89.95
"""Beyond which there is no north to steer by: points are up to 89.9, and the shortest line between
two bows towards the pole."""
_SCATTER = 4.0
"""1-sigmas of the positions' own scatter within which those of a vehicle at rest are."""
_ROUNDED = 0.1
"""m; what rounding may move positions by that have no scatter."""
_WEIGHT = 1e4
"""Of the mean position of a rest beside one position: it is that of many."""
_COLUMNS = {
    "time": TIME,
    "latitude": LATITUDE,
    "longitude": LONGITUDE,
    "height": HEIGHT,
}


@dataclass(frozen=True, slots=True, eq=False)
class Positions:
    """N positions of a file."""

    time: Array
    """(N,) s, on the file's clock, increasing."""
    place: Array
    """(N, 2) rad, latitude and longitude, continuous."""
    height: Array | None
    """(N,) m; None = the file has none."""
    where: str


@lru_cache(maxsize=8)
def read_positions(path: str, line: str | None = None, changed: int = 0) -> Positions:
    """Read a file of text or a NetCDF file with the columns time, latitude and longitude (deg) and
    perhaps height (m), of one survey line where it has several; `changed`: see `changed_at`.

    Raises
    ------
    InputError
        It cannot be read, lacks a column, has a cell that cannot be, or too few rows; times do not
        increase, or a position cannot be reached from the one before.
    """
    rows = one_line(read_rows(path, "time, latitude, longitude"), line)
    columns = rows.read(_COLUMNS, ("time", "latitude", "longitude"))
    time = columns["time"]
    place = np.radians(np.column_stack([columns["latitude"], columns["longitude"]]))
    place[:, 1] = np.unwrap(place[:, 1])
    if len(time) < FEWEST:
        raise InputError(f"{rows.where}: a track needs {FEWEST} positions, has {len(time)}")
    rows.check_times(time)
    if (polar := np.abs(columns["latitude"]) > NEAREST_POLE_DEG).any():
        first = int(np.argmax(polar))
        raise InputError(
            f"{rows.where}: latitude in line {rows.number[first]} must be within"
            f" {NEAREST_POLE_DEG:g} deg north and south, is {columns['latitude'][first]:g}"
        )
    metres = np.column_stack(metres_per_radian(place[:-1, 0]))
    check_steps(np.diff(place, axis=0) * metres, time, rows)
    return Positions(time, place, columns.get("height"), rows.where)


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """A track as it is followed, in K steps of n samples."""

    start: float
    """s on the file's clock."""
    states: Array
    """(K n + 1, 10) as `isogal.inertial.inverse.COLUMNS`."""
    means: Array
    """(K n, 6) specific force (m/s²) and angular rate (rad/s), body axes."""


@lru_cache(maxsize=2)
def follow(route: Route, rate: float, samples: int, use_height: bool, changed: int) -> Followed:
    """Return how the track of a route is followed.

    Parameters
    ----------
    route : Route
        Its `track`; `duration` cuts it, and `height` holds where the file's are not used.
    rate : float
        Steps of the navigator per second, Hz.
    samples : int
        Of the IMU in a step.
    use_height : bool
        Whether the file's heights are used, where it has some.
    changed : int
        See `changed_at`.

    Raises
    ------
    InputError
        See `read_positions`; or the track is shorter than two steps.
    """
    assert route.track is not None  # the caller has checked
    try:
        positions = read_positions(route.track, route.track_line, changed)
    except InputError as error:
        raise InputError(f"route.track: {error}") from None
    span = float(np.ptp(positions.time))
    steps = int(min(span, route.duration or span) * rate + 1e-9)
    if steps < 2:
        raise InputError(
            f"{positions.where}: time spans {span:g} s; must be at least two steps of the"
            f" navigator (1/{rate:g} s)"
        )
    dt = 1.0 / (rate * samples)
    times = np.arange(steps * samples + 1, dtype=np.float64) * dt
    path = _path(positions, times, route.height, use_height)
    force, turn = inverse(path[None], dt)
    begin = Estimate(*(np.array(part) for part in np.split(path[:1], [3, 6], axis=1)))
    _, states = propagate(begin, force, turn, dt, path[:, 2], history=True)
    states = np.concatenate([path[:1], states[0]])
    return Followed(float(positions.time[0]), states, np.concatenate([force[0], turn[0]], axis=1))


def _path(positions: Positions, at: Array, height: float, use_height: bool) -> Array:
    """Return (M, 10) positions, velocities and attitudes at times (M,), s after the first
    position."""
    from scipy.interpolate import make_smoothing_spline

    since = positions.time - positions.time[0]
    scale = np.array([float(one) for one in metres_per_radian(positions.place[0, 0])])
    measured = (positions.place - positions.place[0]) * scale
    if use_height and positions.height is not None:
        measured = np.column_stack([measured, positions.height])
    unit = float(np.median(np.diff(since)))  # GCV looks for smoothness by the number of positions

    def splines(values: Array, weight: Array) -> list["BSpline"]:
        time, each = since / unit, zip(values.T, weight.T, strict=True)
        return [
            make_smoothing_spline(time, axis, w=own, lam=smoothness(time, axis, own))
            for axis, own in each
        ]

    def velocity(fitted: list["BSpline"], time: Array) -> Array:
        return np.column_stack([one.derivative()(time / unit) / unit for one in fitted])

    weight = np.ones_like(measured)
    fitted = splines(measured, weight)
    left = measured - np.column_stack([one(since / unit) for one in fitted])
    near = _SCATTER * float(np.sqrt((left[:, :2] ** 2).sum(axis=1).mean())) + _ROUNDED
    rests = _rests(measured, since, near)
    for first, end in rests:
        measured[first:end, :2] = measured[first:end, :2].mean(axis=0)
        weight[first:end, :2] = _WEIGHT
    if rests:
        fitted = splines(measured, weight)
    place, speed = np.column_stack([one(at / unit) for one in fitted]), velocity(fitted, at)
    moving = np.hypot(speed[:, 0], speed[:, 1]) >= NO_COURSE
    for first, end in rests:
        within = (at >= since[first]) & (at <= since[end - 1])
        place[within, :2], speed[within, :2], moving[within] = measured[first, :2], 0.0, False
    rows = np.zeros((len(at), 10))
    rows[:, :2] = positions.place[0] + place[:, :2] / scale
    rows[:, 2] = height if len(fitted) < 3 else place[:, 2]
    rows[:, 3:5] = speed[:, :2] * np.column_stack(metres_per_radian(*rows[:, [0, 2]].T)) / scale
    if len(fitted) > 2:
        rows[:, 5] = -speed[:, 2]
    rows[:, 6:] = from_heading(_heading(rows[:, 3:5], moving))
    return rows


def _rests(measured: Array, since: Array, near: float) -> list[tuple[int, int]]:
    """Return first row and end of the stretches of three positions or more at which the vehicle
    was at rest: all of them, and those of each time within which one too slow to have a course
    would have left, are within a distance of their mean.

    Parameters
    ----------
    measured : (N, 2) or (N, 3) array
        Positions, m.
    since : (N,) array
        Their times, s.
    near : float
        m.
    """

    def together(first: int, end: int) -> bool:
        part = measured[first:end, :2]
        return bool(np.hypot(*(part - part.mean(axis=0)).T).max() <= near)

    still: Booleans = np.zeros(len(since), dtype=np.bool_)
    for first, last in enumerate(np.searchsorted(since, since + 2.0 * near / NO_COURSE).tolist()):
        end = max(last, first + 1) + 1
        if end <= len(since) and together(first, end):
            still[first:end] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    return [
        (first, end)
        for first, end in edges.reshape(-1, 2).tolist()
        if end - first >= 3 and together(first, end)
    ]


def _heading(velocity: Array, moving: Booleans) -> Array:
    """Return (M,) rad, the course (of velocities (M, 2), m/s) where the vehicle moves, and between
    that an even turn from one to the next; north where it never moves."""
    if not moving.any():
        return np.zeros(len(velocity))
    known = np.flatnonzero(moving)
    course = np.unwrap(np.arctan2(velocity[known, 1], velocity[known, 0]))
    return np.interp(np.arange(len(velocity)), known, course)
