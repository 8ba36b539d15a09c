"""A particle filter for drives with a telephone, independent of Isogal's navigator: the reference
of benchmarks/drives.py (`--reference`).

4,000 particles of place, heading, gyroscope bias, scale of the odometer and offset of the
barometer; each goes by the turn rate about the vertical and the speed, and is weighted by the
height against the terrain (bootstrap filter; Gordon, Salmond & Smith 1993)."""

import math

import numpy as np
from phone_log import INTERVAL, Drive, ground_pressure

from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.maps.field_map import FieldMap
from isogal.scenario import Scenario
from isogal.seeds import generator
from isogal.sensors.barometer import height_of

COUNT = 4000
HEIGHT = 12.0
"""m, white noise of barometer less map."""
OFFSET, SCALE, BIAS, BIAS_TIME, WALK = 12.0, 0.02, 4e-4, 300.0, 1e-3
"""1-sigmas of the offset that the first minutes tell (m), of the odometer's scale, of the
gyroscope's bias (rad/s; its correlation time, s), and of the heading's noise (rad/s^0.5)."""
JITTER = np.array([20.0, 20.0, 5e-3, 1e-5, 1e-3, 0.5])
"""1-sigma of what sets particles apart that come from one."""


def start(drive: Drive, terrain: FieldMap, scenario: Scenario, known: float) -> tuple:
    """Return the index of the last sample with satellites, and the mean (6,) and 1-sigma (6,) of
    place (rad), heading, bias, scale and offset there."""
    turned = np.cumsum(drive.rate[:, 2] * np.diff(drive.time, prepend=drive.time[0]))
    told = (drive.time < known) & np.isfinite(drive.course) & (drive.speed > 5.0)
    off = np.unwrap(drive.course[told] - turned[told])
    design = np.column_stack([np.ones(told.sum()), -drive.time[told]])
    (heading, bias), *_ = np.linalg.lstsq(design, off, rcond=None)
    last = int(np.flatnonzero((drive.time < known) & np.isfinite(drive.latitude))[-1])
    there = (drive.time < known) & np.isfinite(drive.pressure + drive.latitude)
    height = np.array([height_of(one, scenario.height) for one in drive.pressure[there]])
    offset = np.mean(height - terrain.value(drive.latitude[there], drive.longitude[there]))
    now = heading - bias * drive.time[last] + turned[last]
    mean = [drive.latitude[last], drive.longitude[last], now, bias, 1.0, offset]
    return last, np.array(mean), np.array([5.0, 5.0, 0.05, BIAS, SCALE, OFFSET])


def particles(
    drive: Drive, scenario: Scenario, terrain: FieldMap, known: float, seed: int = 0
) -> np.ndarray:
    """Return (K, 4) as `drives.navigate` does."""
    random = generator(seed, 0, "particles along a drive")
    last, mean, sigma = start(drive, terrain, scenario, known)
    metres = np.array(metres_per_radian(mean[0], 0.0))
    x = mean + random.standard_normal((COUNT, 6)) * sigma * [*(1.0 / metres), 1.0, 1.0, 1.0, 1.0]
    scans, rows, log = ground_pressure(drive), [], np.zeros(COUNT)
    for k in range(last + 1, len(drive.time)):
        dt = drive.time[k] - drive.time[k - 1]
        walk = math.sqrt(WALK**2 * dt + drive.turn_variance[k] * dt**2)
        x[:, 2] += (drive.rate[k, 2] - x[:, 3]) * dt + walk * random.standard_normal(COUNT)
        fresh = BIAS * math.sqrt(1.0 - math.exp(-2.0 * dt / BIAS_TIME))
        x[:, 3] = mean[3] + (x[:, 3] - mean[3]) * math.exp(-dt / BIAS_TIME)
        x[:, 3] += fresh * random.standard_normal(COUNT)
        gone = x[:, 4] * np.nan_to_num(drive.speed[k]) * dt
        x[:, 0] += gone * np.cos(x[:, 2]) / metres[0]
        x[:, 1] += gone * np.sin(x[:, 2]) / metres[1]
        if math.isfinite(scans.get(k, math.nan)):
            above = float(height_of(scans[k], scenario.height)) - x[:, 5]
            off = (above - terrain.value(x[:, 0], x[:, 1])) / HEIGHT
            log -= 0.5 * np.nan_to_num(off, nan=10.0) ** 2  # beside the map
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        if drive.time[k] % INTERVAL < dt and 1.0 / np.square(weight).sum() < 0.5 * COUNT:
            x = x[np.searchsorted(np.cumsum(weight), (random.random() + np.arange(COUNT)) / COUNT)]
            x += random.standard_normal(x.shape) * JITTER / [*metres, 1.0, 1.0, 1.0, 1.0]
            log, weight = np.zeros(COUNT), np.full(COUNT, 1.0 / COUNT)
        if math.isfinite(drive.latitude[k]):
            place = weight @ x[:, :2]
            P = np.cov(((x[:, :2] - place) * metres).T, aweights=weight)
            away = horizontal_difference(*place, drive.latitude[k], drive.longitude[k])
            error = np.array(away)
            nees = error @ np.linalg.solve(P, error) / 2.0
            rows.append((drive.time[k], math.hypot(*error), nees, math.sqrt(np.trace(P))))
    return np.array(rows)
