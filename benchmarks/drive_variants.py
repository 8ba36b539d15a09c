"""Other drives made out of logged ones (benchmarks/drives.py): begun later, driven backwards, and
with what happens to a telephone and a car.

Each takes the columns of a log (`phone_log.read_log`) and returns those of another."""

from collections.abc import Callable

import numpy as np

from isogal.inertial.rotations import from_rotation_vector, matrix

Log = dict[str, np.ndarray]
AXES = "xyz"
HAPPENS = 900.0
"""s, when it does."""
VECTORS = "acc", "gyro", "grav", "mag"
STANDS = 0.1
"""m/s."""


def rows(log: Log, which: np.ndarray) -> Log:
    """Return rows of a log, from time zero on."""
    found = {name: column[which] for name, column in log.items() if name != "start"}
    return found | {"start": log["start"]}


def later(log: Log, seconds: float) -> Log:
    """Return what is logged from a time on."""
    found = rows(log, np.flatnonzero(log["time"] >= seconds))
    return found | {"time": found["time"] - found["time"][0]}


def backwards(log: Log) -> Log:
    """Return the drive back on the same road: time reversed, the car turned round. A turn keeps
    its curvature's size and changes its sense as the rate does, accelerations along the road
    change theirs, and so does, with the car, what its sides feel."""
    found = rows(log, np.arange(len(log["time"]))[::-1])
    found["time"] = log["time"][-1] - found["time"]
    up = np.stack([found[f"grav_{axis}"] for axis in AXES])
    up = up / np.linalg.norm(up, axis=0)
    force = np.stack([found[f"acc_{axis}"] for axis in AXES])
    # the telephone keeps its place in the car: forward and right change their sign
    force = 2.0 * up * np.einsum("in,in->n", up, force) - force
    for k, axis in enumerate(AXES):
        found[f"acc_{axis}"], found[f"gyro_{axis}"] = force[k], -found[f"gyro_{axis}"]
    known = found["bearing"] >= 0.0
    found["bearing"] = np.where(known, (found["bearing"] + 180.0) % 360.0, found["bearing"])
    return found


def silent(log: Log, names: tuple[str, ...], begin: float, seconds: float) -> Log:
    """Return a log without values of some columns for a time."""
    now = (log["time"] >= begin) & (log["time"] < begin + seconds)
    return log | {name: np.where(now, np.nan, log[name]) for name in names}


def without_samples(log: Log, begin: float, seconds: float) -> Log:
    """Return a log without rows of a time."""
    return rows(log, np.flatnonzero((log["time"] < begin) | (log["time"] >= begin + seconds)))


def stopped(log: Log, begin: float, seconds: int) -> Log:
    """Return a drive whose first stop of 8 s after a time is longer by so many: its samples again
    and again."""
    stands = (log["speed"] >= 0.0) & (log["speed"] < STANDS)  # below 0 there is none
    still = np.convolve(stands, np.ones(8), "valid") == 8
    first = int(np.flatnonzero(still & (log["time"][: len(still)] >= begin))[0])
    again = first + 1 + np.arange(seconds) % 6
    count = len(log["time"])
    found = rows(log, np.concatenate([np.arange(first), again, np.arange(first, count)]))
    found["time"] = np.concatenate(
        [
            log["time"][:first],
            log["time"][first] + np.arange(seconds),
            log["time"][first:] + seconds,
        ]
    )
    return found


def carried(log: Log, begin: float, seconds: float) -> Log:
    """Return a drive whose wheels stand for a while in which it goes on (on a ferry, towed)."""
    now = (log["time"] >= begin) & (log["time"] < begin + seconds)
    return log | {"speed": np.where(now, 0.0, log["speed"])}


def remounted(log: Log, begin: float) -> Log:
    """Return a drive whose telephone is turned in its holder."""
    turn = matrix(np.array(from_rotation_vector(0.5, -0.8, 1.2)))
    found, now = dict(log), log["time"] >= begin
    for name in VECTORS:
        vectors = np.stack([log[f"{name}_{axis}"] for axis in AXES])
        for axis, turned in zip(AXES, turn @ vectors, strict=True):
            found[f"{name}_{axis}"] = np.where(now, turned, log[f"{name}_{axis}"])
    return found


SATELLITES = "latitude", "longitude", "bearing"
DRIVES: dict[str, Callable[[Log], Log]] = {
    "as logged": lambda log: log,
    "from 600 s on": lambda log: later(log, 600.0),
    "from 1200 s on": lambda log: later(log, 1200.0),
    "backwards": backwards,
    "backwards from 600 s on": lambda log: later(backwards(log), 600.0),
}
"""Whole drives, by what they are."""
EVENTS: dict[str, Callable[[Log], Log]] = {
    "30 s without samples": lambda log: without_samples(log, HAPPENS, 30.0),
    "60 s without speed": lambda log: silent(log, ("speed",), HAPPENS, 60.0),
    "an hour's stop": lambda log: stopped(log, HAPPENS, 3600),
    "carried for 300 s": lambda log: carried(log, HAPPENS, 300.0),
    "telephone turned": lambda log: remounted(log, HAPPENS),
    "no satellites, 100 to 200 s": lambda log: silent(log, SATELLITES, 100.0, 100.0),
}
"""What happens on a drive as it was logged."""
