"""What a gravimeter, or another instrument of one number, adds to what it should read, and when it
reads nothing (docs/mathematics.md, section 2.8).

Time-correlated noise is a first-order Gauss-Markov process, a bias that wanders a random walk
(Groves 2013, sections 4.4.3 and 14.2.6; Allan variances in IEEE Std 952-1997, annex C). They are
errors of the readings, after the instrument's own low-pass filter (`lag`)."""

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.scenario import Gravimeter
from isogal.seeds import generator
from isogal.sensors.trajectory import Trajectory


def slow_errors(
    settings: Gravimeter, seed: int, run: int, trajectory: Trajectory, index: Integers
) -> Array:
    """Return (scans,) what time-correlated noise, the walk of the bias and the vehicle's
    accelerations add to the readings of a run, in their unit.

    Parameters
    ----------
    index : (scans,) array
        Of each scan in the trajectory.
    """
    time = trajectory.time[index]
    error = np.zeros(len(index))
    if settings.correlated_sigma > 0.0:
        random = generator(seed, run, "gravimeter_correlated")
        normal = random.standard_normal(len(index))
        error += gauss_markov(settings.correlated_sigma, settings.correlation_time, time, normal)
    if settings.bias_walk > 0.0:
        steps = generator(seed, run, "gravimeter_walk").standard_normal(len(index))
        error += settings.bias_walk * np.cumsum(np.sqrt(np.diff(time, prepend=0.0)) * steps)
    if settings.cross_coupling > 0.0:
        share = generator(seed, run, "gravimeter_coupling").standard_normal(2)
        before = np.concatenate([[0], index])
        moving = accelerations(trajectory.time[before], trajectory.velocity[before, :2])[1:]
        error += settings.cross_coupling * (moving @ share)
    return error


def gauss_markov(sigma: float, correlation_time: float, time: Array, normal: Array) -> Array:
    """Return (..., N) a stationary first-order Gauss-Markov process of covariance sigma²
    exp(-|dt| / correlation_time) at increasing times (N,), from standard normal numbers
    (..., N)."""
    keep = np.exp(-np.diff(time) / correlation_time)
    fresh = np.sqrt(1.0 - keep**2)
    process = np.array(normal, dtype=float)
    for k in range(len(keep)):
        process[..., k + 1] = keep[k] * process[..., k] + fresh[k] * normal[..., k + 1]
    return sigma * process


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


def missing(
    settings: Gravimeter, seed: int, run: int, trajectory: Trajectory, index: Integers
) -> Booleans:
    """Return (scans,) which readings of a run are missing: by chance, in a gap, or in a turn."""
    absent = without_readings(settings, trajectory, index)
    if settings.missing_fraction > 0.0:
        random = generator(seed, run, "gravimeter_missing")
        absent = absent | (random.random(len(index)) < settings.missing_fraction)
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
