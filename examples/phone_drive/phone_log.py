"""A drive recorded by a telephone, as readings of a vehicle.

The axes of a telephone say nothing of the car it lies in. Its own estimate of gravity says which
way is up, at any time, also after somebody has moved it; the turn rate about that is the car's.
Which way is forward follows from how the speed changes: the level part of the specific force is
that of a car, whose acceleration is dv/dt forward and v times the turn rate to the right, but for
one angle, which the minutes before tell."""

import math
from dataclasses import dataclass
from pathlib import Path

import netCDF4
import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, minimum_filter1d

from isogal.errors import InputError
from isogal.files import reading
from isogal.sensors.scans import Thinning

Array = np.ndarray
GRAVITY = 9.80665
SENSED = [f"{name}_{axis}" for name in ("acc", "gyro", "grav") for axis in "xyz"]
OTHERS = ("time", "pressure", "latitude", "longitude", "altitude", "speed", "bearing")
"""Columns of a log."""
UNITS = {
    "acc": {"m/s2": 1.0, "m s-2": 1.0, "m/s^2": 1.0, "m/s²": 1.0, "g": GRAVITY},
    "gyro": {"rad/s": 1.0, "rad s-1": 1.0, "deg/s": math.pi / 180.0, "°/s": math.pi / 180.0},
}
UNITS["grav"] = UNITS["acc"]
"""That the log may name; without one it is the first."""
WEIGHT = 3.0
"""m/s² by which the weight of a telephone that lies in a car, in the median, may differ from that
of rest."""
TURNS = 95.0
"""% of the seconds in which a car has less than 1 g across: 1.6 m/s² at most in four drives."""
STANDS, HANDLED, NEAR = 0.5, 0.1, 15
"""m/s, rad/s about level axes, s: where the wheels stand, what tilts faster, and faster than it
turns, is the telephone in somebody's hand, then and so long before and after. Of a car on its
springs 90 % of the seconds have less than 0.06."""
REST = 3e-3
"""rad/s: what reads less where the wheels stand and no hand is at it is the gyroscope's bias."""
BRIEF = 2
"""s: where the wheels stand that long before and after, what turns for no longer is a telephone
that was touched, or a door; what carries a car turns for longer."""
LATEST = 0.1
"""Share of the newest sample in what the gyroscope reads at rest."""
SAMPLED = 0.6 / math.sqrt(12.0)
"""1-sigma of what a turn between two samples is off by, as a share of the second difference of the
rate: samples of noise have one of sqrt(12) 1-sigmas of the mean of two, a smooth turn next to
none. The factor of 0.6 is measured (541 parts of a minute of four drives)."""
FORGOTTEN = 300.0
"""s after which it counts 1/e what told the forward direction: a telephone may be put elsewhere.
"""
LEAST_FIX, LEAST_VELOCITY = 3.0, 0.2
"""m and m/s, 1-sigma at least of what satellites say: its error changes slowly."""
LEAST_SPEED = 3.0
"""m/s above which acceleration says which way is forward."""
INTERVAL = 10.0
"""s from one scan to the next, `gravimeter.interval` of car.yaml."""
SPACING = 350.0
"""m between heights that are compared with the map: half the correlation length of its error. What
is measured again at the same place has the same error of the map, and says nothing new of the
place.
"""


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
    course_sigma: Array
    horizontal_sigma: Array
    speed_sigma: Array


def ground_pressure(drive: Drive) -> dict[int, float]:
    """Return the pressure (Pa) that is compared with the map at each scan, by its sample; NaN
    where the car has not gone on by SPACING since the last one."""
    thinning, gone = Thinning(round(1e9 * INTERVAL)), math.inf
    scans = dict[int, float]()
    for k in range(1, len(drive.time)):
        gone += float(np.nan_to_num(drive.speed[k])) * (drive.time[k] - drive.time[k - 1])
        if thinning.takes(round(1e9 * drive.time[k])):
            apart = gone >= SPACING and math.isfinite(drive.pressure[k])
            scans[k] = float(drive.pressure[k]) if apart else math.nan
            gone = 0.0 if apart else gone
    return scans


def position_at(drive: Drive, k: int) -> tuple[Array, Array]:
    """Return latitude, longitude (rad) and height (m) by satellites, and their covariance (3, 3),
    NED, m²."""
    sigma = max(float(np.nan_to_num(drive.horizontal_sigma[k])), LEAST_FIX)
    place = np.array([drive.latitude[k], drive.longitude[k], drive.altitude[k]])
    return place, sigma**2 * np.diag([1.0, 1.0, 4.0])


def velocity_at(drive: Drive, k: int) -> tuple[Array, Array]:
    """Return the velocity by satellites, NED, m/s, without its vertical part, and its covariance:
    along the course as well as the speed is known, across it as well as the course is."""
    speed, course = float(drive.speed[k]), float(drive.course[k])
    along = max(float(np.nan_to_num(drive.speed_sigma[k])), LEAST_VELOCITY)
    across = max(speed * float(np.nan_to_num(drive.course_sigma[k], nan=math.pi)), LEAST_VELOCITY)
    cos, sin = math.cos(course), math.sin(course)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    covariance = turn @ np.diag([along**2, across**2, 0.0]) @ turn.T
    return np.array([speed * cos, speed * sin, math.nan]), covariance


def read_log(path: Path) -> dict[str, Array]:
    """Return the columns of a log, (N,) each; NaN = none. `time` is in s since the first row,
    `start` (1,) the time of that since 1970."""
    with reading(path, "NetCDF"), netCDF4.Dataset(path) as file:
        if missing := [name for name in (*SENSED, *OTHERS) if name not in file.variables]:
            raise InputError(f"{path}: has no {', '.join(missing)}")
        columns = {
            name: np.ma.filled(variable[:].astype(float), np.nan)
            for name, variable in file.variables.items()
        }
        for name in SENSED:
            columns[name] *= factor_of(getattr(file[name], "units", None), name)
        clock = file["time"]
        begin = netCDF4.num2date(clock[0], clock.units, clock.calendar)
    columns["time"] = columns["time"] - columns["time"][0]
    columns["start"] = np.array([begin.timestamp() if hasattr(begin, "timestamp") else 0.0])
    return columns


def factor_of(unit: str | None, name: str) -> float:
    """Return the number of SI units in the unit of a column of `SENSED`."""
    known = UNITS[name.rpartition("_")[0]]
    if unit is not None and unit not in known:
        raise InputError(f"{name}: unknown unit '{unit}'; must be one of {', '.join(known)}")
    return 1.0 if unit is None else known[unit]


def check_units(force: Array, drive: "Drive") -> None:
    """Refuse what no telephone in a car senses: force (N, 3) of another size than its weight, or
    turns that no car takes at its speed."""
    weight = float(np.median(np.linalg.norm(force, axis=1)))
    if abs(weight - GRAVITY) > WEIGHT:
        raise InputError(
            f"acc_x, acc_y, acc_z: are {weight:.3g} in the median, and must be 9.8 m/s², with the"
            " weight; for other units set their attribute units, such as 'g'"
        )
    across = np.abs(drive.rate[:, 2] * np.nan_to_num(drive.speed))[drive.speed > LEAST_SPEED]
    if len(across) and np.percentile(across, TURNS) > GRAVITY:
        raise InputError(
            "gyro_x, gyro_y, gyro_z: turn faster than a car at its speed, and must be in rad/s;"
            " for other units set their attribute units, such as 'deg/s'"
        )


def drive_of(log: dict[str, Array], known: float = 300.0) -> Drive:
    """Return the drive of a log's columns; rows without inertial readings are left out. Of the
    satellites' speed only what is before `known` (s) tells which way is forward."""
    there = np.isfinite([log[name] for name in SENSED]).all(axis=0)
    columns = {name: column[there] for name, column in log.items() if name != "start"}
    time = columns["time"]
    force, rate, up = (
        np.stack([columns[name] for name in SENSED], axis=1).reshape(-1, 3, 3).swapaxes(0, 1)
    )
    speed = np.where(columns["speed"] < 0.0, np.nan, columns["speed"])
    level, turn, tilting = _levelled(force, rate, up)
    turn = _unhandled(turn, tilting, speed < STANDS)
    turned = _forward(_means(level), _means(turn), speed, time < known)
    down = _means(-np.einsum("ni,ni->n", force, _unit(up)))
    specific = np.column_stack([turned, down])
    rates = np.column_stack([np.zeros((len(turn), 2)), turn])
    drive = Drive(
        time,
        float(log["start"][0]),
        specific,
        _means(rates),
        _means(np.square(SAMPLED * np.pad(np.diff(turn, 2), 1))),
        100.0 * columns["pressure"],
        speed,
        np.radians(columns["latitude"]),
        np.radians(columns["longitude"]),
        columns["altitude"],
        np.radians(np.where(columns["bearing"] < 0.0, np.nan, columns["bearing"])),
        np.radians(np.where(columns["bearingAccuracy"] > 0.0, columns["bearingAccuracy"], np.nan)),
        np.where(columns["horizontalAccuracy"] > 0.0, columns["horizontalAccuracy"], np.nan),
        np.where(columns["speedAccuracy"] > 0.0, columns["speedAccuracy"], np.nan),
    )
    check_units(force, drive)
    return drive


def read_drive(path: Path, known: float = 300.0) -> Drive:
    """Return the drive of a log (`read_log`, `drive_of`)."""
    log = read_log(path)
    try:
        return drive_of(log, known)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _means(samples: Array) -> Array:
    """Return the means over each second of samples (N, ...) at its ends."""
    before = np.concatenate([samples[:1], samples[:-1]])
    return 0.5 * (before + samples)


def _levelled(force: Array, rate: Array, up: Array) -> tuple[Array, Array, Array]:
    """Return (N, 2) the level part of the specific force, in axes that turn with the telephone
    about the vertical, (N,) the turn rate about down and (N,) that about level axes."""
    vertical = _unit(up)
    # the telephone's axis that is most nearly level at the start stays one of reference
    axis = np.eye(3)[int(np.argmin(np.abs(vertical[:60].mean(axis=0))))]
    x = _unit(axis - (vertical @ axis)[:, None] * vertical)
    y = np.cross(-vertical, x)  # x, y, down
    level = np.column_stack([np.einsum("ni,ni->n", force, e) for e in (x, y)])
    turn = -np.einsum("ni,ni->n", rate, vertical)
    return level, turn, np.linalg.norm(rate + turn[:, None] * vertical, axis=1)


def _unhandled(turn: Array, tilting: Array, stands: Array) -> Array:
    """Return turn rates (N,) in which those of a telephone in somebody's hand, while the wheels
    stand, are what the gyroscope has read at rest before: its bias. A hand also tilts (N,) it,
    which a car that is carried, and turns, does not; or it turns it briefly."""
    shaken = tilting > np.maximum(HANDLED, np.abs(turn))
    held, size = maximum_filter1d(shaken, 2 * NEAR + 1), 2 * BRIEF + 1
    still = minimum_filter1d(stands, size) & (median_filter(np.abs(turn), size) < REST)
    found, bias = turn.copy(), 0.0
    for k in np.flatnonzero(stands):
        if held[k] or (still[k] and abs(turn[k]) >= REST):
            found[k] = bias
        elif abs(turn[k]) < REST:
            bias += LATEST * (turn[k] - bias)
    return found


def _forward(level: Array, turn: Array, speed: Array, known: Array) -> Array:
    """Return (N, 2) means of the specific force over each second, forward and right, from those
    in axes that turn with the telephone (N, 2), the turn rates (N,) and speeds (N,) at the ends.

    Each is turned by what those before it have told, over FORGOTTEN; those of the first minutes
    by what these have told."""
    held = _held(speed)
    acceleration = np.diff(held, prepend=held[0])
    middle = _means(held)
    expected = acceleration + 1j * middle * turn
    sensed = level[:, 0] + 1j * level[:, 1]
    told = np.where(middle > LEAST_SPEED, np.conj(sensed) * expected, 0.0)
    total, by_then = told[known].sum(), np.empty(len(told), dtype=complex)
    for k, one in enumerate(told):
        by_then[k] = total
        if not known[k]:
            total = total * math.exp(-1.0 / FORGOTTEN) + one
    size = np.abs(by_then)
    turned = sensed * np.where(size > 0.0, by_then / np.maximum(size, 1e-12), 1.0)
    return np.column_stack([turned.real, turned.imag])


def _held(values: Array) -> Array:
    """Return values in which a missing one is between those beside it."""
    index, there = np.arange(len(values)), np.isfinite(values)
    return np.interp(index, index[there], values[there])
