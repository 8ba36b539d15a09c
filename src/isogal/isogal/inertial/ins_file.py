"""What an INS has said, in a text file with named columns, and readings taken meanwhile."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.inertial.inverse import level_attitude
from isogal.inertial.rotations import from_angles
from isogal.maps.gridding.rows import HEIGHT, LATITUDE, LONGITUDE, TIME, Column, Rows, read_rows

REQUIRED = ("time", "latitude", "longitude")
VELOCITY = ("velocity_north", "velocity_east", "velocity_down")
ANGLES = ("roll", "pitch", "heading")
LAST = 2.0**31
"""s since 1970: seconds of ROS's stamps have 32 bits, with a sign."""
OFF = 0.4
"""By which share of the way an INS's velocity may miss it: 0.46 where it is too small by the least
factor between two units, 1.85, of km/h in kn."""
STRETCH, OFTEN = 100.0, 60.0
"""m over which both are compared, at least; and s between solutions, with more of which the
velocity between them is not known."""
MOVING = 1.0
"""m/s, above which a vehicle has a course."""
ASIDE = math.radians(60.0)
"""By which heading and course differ, in the median, where one is in another unit."""
FASTEST, CORRECTION = 1000.0, 1e5
"""m/s, as for `route.speed`; and m by which no INS that is in use is corrected at once."""
_COLUMNS = {
    "time": TIME,
    "latitude": LATITUDE,
    "longitude": LONGITUDE,
    "height": HEIGHT,
    "velocity_north": Column(("velocity_north", "vn"), unit=" m/s"),
    "velocity_east": Column(("velocity_east", "ve"), unit=" m/s"),
    "velocity_down": Column(("velocity_down", "vd"), unit=" m/s"),
    "roll": Column(("roll",), -360.0, 360.0, " deg"),
    "pitch": Column(("pitch",), -360.0, 360.0, " deg"),
    "heading": Column(("heading", "yaw"), -360.0, 360.0, " deg"),
    "value": Column(("value",), gaps=True),
    "sigma": Column(("sigma",), least=math.ulp(0.0), gaps=True),
}


@dataclass(frozen=True, slots=True, eq=False)
class InsFile:
    """N solutions of an INS."""

    time: Array
    """(N,) s, increasing."""
    solution: Array
    """(N, 10) as `isogal.inertial.inverse.COLUMNS`; the attitude, where there is none, is that of
    a level vehicle on its course."""
    has_attitude: bool
    value: Array | None
    """(N,) readings, unit of the file, NaN = none at that time; None = the file has none."""
    sigma: Array | None
    """(N,) their 1-sigma."""
    unit: str | None
    """Of `value`, as its header says it: ``value[mGal]``; None = not said."""


def read_ins_file(path: str | Path, height: float) -> InsFile:
    """Read a file with a header line and the columns time, latitude, longitude (deg) and, as far
    as there are, height (m), velocity_north, velocity_east, velocity_down (m/s), roll, pitch,
    heading (deg), value and sigma; or in another unit that a header has: ``height[ft]``. Without
    the horizontal velocity it is taken from differences of the positions.

    Parameters
    ----------
    path : path
    height : float
        m, where the file has none.

    Raises
    ------
    InputError
        The file cannot be read, lacks a column, has one of several that belong together, or too
        few rows; times do not increase, or no recording can have them; a place cannot be reached
        from the one before.
    """
    rows = read_rows(path, ", ".join(REQUIRED))
    columns = rows.read(_COLUMNS, REQUIRED)
    _check(columns, rows)
    time, count = columns["time"], len(columns["time"])
    unit = rows.in_one_unit(columns, _COLUMNS, ("value", "sigma"))
    places = np.column_stack(
        [
            np.radians(columns["latitude"]),
            np.unwrap(np.radians(columns["longitude"])),
            columns.get("height", np.full(count, height)),
        ]
    )
    north, east = metres_per_radian(places[:, 0], places[:, 2])
    metres = np.column_stack([north, east, np.full(count, -1.0)])
    moved = np.diff(places, axis=0)[:, :2] * metres[1:, :2]
    check_steps(moved, time, rows, CORRECTION)
    velocity = np.gradient(places, time, axis=0) * metres
    if VELOCITY[0] in columns:
        _check_velocity(moved, columns, np.diff(time), rows)
    for axis, name in enumerate(VELOCITY):
        if name in columns:
            velocity[:, axis] = columns[name]
    has_attitude = ANGLES[0] in columns
    if has_attitude:
        _check_heading(columns["heading"], velocity, rows)
        angles = np.radians(np.column_stack([columns[name] for name in ANGLES]))
        attitude = np.array([from_angles(*row) for row in angles.tolist()])
    else:
        attitude = level_attitude(velocity)
    solution = np.concatenate([places, velocity, attitude], axis=1)
    return InsFile(time, solution, has_attitude, columns.get("value"), columns.get("sigma"), unit)


def _check(columns: dict[str, Array], rows: Rows) -> None:
    """Raise InputError where columns are missing that belong to others, or times do not
    increase."""
    for whole in (VELOCITY[:2], ANGLES):
        there = [name for name in whole if name in columns]
        if there and len(there) < len(whole):
            raise InputError(
                f"{rows.where}: has {' and '.join(there)} but not all of {', '.join(whole)}"
            )
    if len(rows) < 3:
        raise InputError(f"{rows.where}: needs at least 3 rows, has {len(rows)}")
    time = columns["time"]
    rows.check_times(time)
    for k in np.flatnonzero((time < 0.0) | (time >= LAST))[:1].tolist():
        raise InputError(
            f"{rows.where}: time in line {rows.number[k]} is {time[k]:.10g} s, must be 0 to"
            f" {LAST:.0f}; a header time[ms] says another unit"
        )


def check_steps(moved: Array, time: Array, rows: Rows, correction: float = 0.0) -> None:
    """Raise InputError where places are further from those before, by (N - 1, 2) m, than a vehicle
    goes from one time (N,), s, to the next, and a correction (m) moves it."""
    way, steps = np.hypot(*moved.T), np.diff(time)
    for k in np.flatnonzero(way > FASTEST * steps + correction)[:1].tolist():
        raise InputError(
            f"{rows.where}: latitude and longitude in line {rows.number[k + 1]} are"
            f" {1e-3 * way[k]:.1f} km from those {steps[k]:.3g} s before, must be at most"
            f" {1e-3 * (FASTEST * steps[k] + correction):.1f} km"
        )


def _check_velocity(moved: Array, columns: dict[str, Array], steps: Array, rows: Rows) -> None:
    """Raise InputError where the horizontal velocity of an INS is not that of its places, which
    moved by (N - 1, 2) m, north and east, in steps of (N - 1,) s: another unit, sign or axis."""
    said = np.column_stack([columns[name] for name in VELOCITY[:2]])
    way = np.cumsum(np.hypot(*moved.T))
    if way[-1] < STRETCH or np.median(steps) > OFTEN:
        return
    stretch = (way / max(STRETCH, way[-1] / 50.0)).astype(np.int64)
    gone = 0.5 * (said[1:] + said[:-1]) * steps[:, None]
    of_places, of_velocity = (
        np.column_stack([np.bincount(stretch, axis) for axis in one.T]) for one in (moved, gone)
    )
    length = np.maximum(np.hypot(*of_places.T), 1e-3 * STRETCH)
    if np.median(np.hypot(*(of_places - of_velocity).T) / length) <= OFF:
        return
    factor = float(np.median(np.hypot(*of_velocity.T) / length))
    raise InputError(
        f"{rows.where}: velocity_north, velocity_east do not fit latitude, longitude and time:"
        f" they are {factor:.3g} times as large, or of another direction; they must be in m/s, or"
        " the header must say in what: velocity_north[kn], velocity_north[km/h]"
    )


def _check_heading(heading: Array, velocity: Array, rows: Rows) -> None:
    """Raise InputError where a heading (N,), taken as deg, is none of a vehicle that moves with a
    velocity (N, 3), m/s, but would be in rad."""
    moves = np.hypot(velocity[:, 0], velocity[:, 1]) > MOVING
    if not moves.any() or np.abs(heading).max() > 2.0 * math.pi:
        return
    course = np.arctan2(velocity[moves, 1], velocity[moves, 0])

    def aside(angle: Array) -> float:
        return float(np.median(np.abs(np.angle(np.exp(1j * (angle - course))))))

    if aside(np.radians(heading[moves])) > ASIDE > aside(heading[moves]):
        raise InputError(
            f"{rows.where}: heading fits the course in rad, and not in deg; write heading[rad],"
            " and roll[rad], pitch[rad]"
        )
