"""What a gravimeter, or another instrument of one number, adds to what it should read, and when it
reads nothing (docs/mathematics.md, section 2.8).

They are errors of the readings, after the instrument's own low-pass filter (`lag`)."""

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.scenario import Gravimeter
from isogal.seeds import generator
from isogal.sensors.noise import Noise, RunScans
from isogal.sensors.platform import levelling_error
from isogal.sensors.trajectory import Trajectory


def noise_of(settings: Gravimeter) -> Noise:
    """Return the random errors of an instrument."""
    return Noise(
        "gravimeter",
        settings.sigma,
        settings.outlier_fraction,
        settings.outlier_sigma,
        settings.bias,
        settings.drift,
        settings.correlated_sigma,
        settings.correlation_time,
        settings.bias_walk,
    )


def reading_errors(settings: Gravimeter, scans: RunScans) -> Array:
    """Return (scans,) what noise, the vehicle's accelerations, its speed and the platform's tilt
    add to the readings of a run, in their unit; `settings` is what is true of it."""
    error = noise_of(settings).draw(scans.seed, scans.run, scans.time)
    if settings.cross_coupling > 0.0:
        share = generator(scans.seed, scans.run, "gravimeter_coupling").standard_normal(2)
        trajectory, before = scans.trajectory, np.concatenate([[0], scans.index])
        moving = accelerations(trajectory.time[before], trajectory.velocity[before, :2])[1:]
        error += settings.cross_coupling * (moving @ share)
    if settings.dynamic_pressure > 0.0:
        random = generator(scans.seed, scans.run, "gravimeter_dynamic_pressure")
        square = (scans.trajectory.velocity[scans.index, :2] ** 2).sum(axis=1)
        error += settings.dynamic_pressure * random.standard_normal() * square
    return error + levelling_error(settings, scans)


def accelerations(time: Array, velocity: Array) -> Array:
    """Return (N, 2) mean forward and rightward acceleration (m/s²) over the interval before each
    of N >= 2 times, from north and east velocities (N, 2); at the first time that after it."""
    mean = np.diff(velocity, axis=0) / np.diff(time)[:, None]
    along = 0.5 * (velocity[1:] + velocity[:-1])
    speed = np.hypot(along[:, 0], along[:, 1])
    course = along / np.where(speed > 0.0, speed, 1.0)[:, None]
    forward = (mean * course).sum(axis=1)
    right = mean[:, 1] * course[:, 0] - mean[:, 0] * course[:, 1]
    return np.concatenate([np.stack([forward, right], axis=1)[:1], np.stack([forward, right], 1)])


def missing(settings: Gravimeter, scans: RunScans) -> Booleans:
    """Return (scans,) which readings of a run are missing: by chance, in a gap, or in a turn."""
    absent = without_readings(settings, scans.trajectory, scans.index)
    if settings.missing_fraction > 0.0:
        random = generator(scans.seed, scans.run, "gravimeter_missing")
        absent = absent | (random.random(len(absent)) < settings.missing_fraction)
    return absent


def without_readings(settings: Gravimeter, trajectory: Trajectory, index: Integers) -> Booleans:
    """Return (scans,) which readings every run misses: in a gap, or in a turn and after it."""
    time = trajectory.time[index]
    absent = np.zeros(len(index), dtype=np.bool_)
    for start, length in settings.gaps or ():
        absent |= (time >= start) & (time < start + length)
    if settings.dead_turn_rate is not None:
        north, east = trajectory.velocity[:, :2].T
        turned = np.abs(np.diff(np.unwrap(np.arctan2(east, north)))) / trajectory.dt
        ends = trajectory.time[1:][turned > settings.dead_turn_rate]
        # the newest turning interval that began before the reading
        last = np.searchsorted(ends - trajectory.dt, time - 1e-9) - 1
        since = np.where(last >= 0, time - ends[np.maximum(last, 0)] if len(ends) else 0.0, np.inf)
        absent |= since <= settings.dead_time + 1e-9
    return absent
