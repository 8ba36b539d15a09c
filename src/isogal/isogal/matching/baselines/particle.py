"""`particle`: a bootstrap particle filter over the position, Rao-Blackwellised over velocity and
bias.

Sources: Gordon, Salmond & Smith (1993), "Novel approach to nonlinear/non-Gaussian Bayesian state
estimation", IEE Proc. F 140(2):107-113; Schön, Gustafsson & Nordlund (2005), "Marginalized
particle filters for mixed linear/nonlinear state-space models", IEEE Trans. Signal Processing
53(7):2279-2289, which treats terrain navigation this way; systematic resampling after Kitagawa
(1996).

Each particle is a position error at the scan. Velocity error and the readings' bias enter
linearly, so each particle carries their Gaussian, whose covariance is the same for all. The prior
is the navigator's, so nothing is carried from batch to batch. All random numbers are one fixed
quasi-random set: the same batch gives the same fix."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array
from isogal.maps.field_map import FieldMap
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import UsableReadings, publish_posterior
from isogal.matching.failures import UNEXPLAINED
from isogal.matching.interfaces import Batch, Fix, declined
from isogal.matching.quasi_random import standard_normal

RESAMPLE = 0.5
"""Effective share of the particles below which they are resampled."""
ROUGHENING = 0.2
"""Spread added at a resampling, in 1-sigma of the particles over N^(1/4)."""
NOISE = 1.0
"""m, random walk of the position from scan to scan."""


class ParticleOptions(BaseModel):
    """Options of `particle`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    particles: int = Field(3000, ge=50, le=1_000_000, description="how many")
    least: float = Field(
        4.0,
        ge=0.0,
        description="effective particles below which, at any scan, the batch gives no fix",
    )


class Particle(Baseline[ParticleOptions]):
    """Settings of the matcher; it carries nothing from batch to batch."""

    name = "particle"
    options_model = ParticleOptions

    def solve(self, batch: Batch, field_map: FieldMap, readings: UsableReadings) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        options = self.options
        normal, uniform = _random_numbers(options.particles, len(readings) + 1)
        cloud = _first_cloud(readings.transition[0], batch.prior, self.bias_sigma, normal[0])
        motion = _Motion.of(readings, batch.transition[-1])
        smallest, rough = 1.0, np.zeros(2)
        for t in range(len(readings)):
            cloud = _weighed(readings, motion, t, cloud)
            effective = 1.0 / float((cloud.weight**2).sum()) / options.particles
            if not math.isfinite(effective):
                break
            smallest, rough = min(smallest, effective), np.zeros(2)
            if effective < RESAMPLE:
                cloud, spread = _resampled(cloud, uniform[t])
                rough = ROUGHENING * options.particles**-0.25 * spread
            cloud = _predicted(motion, t, cloud, normal[t + 1], rough)
        figures = {"effective_particles": smallest * options.particles}
        if not np.isfinite(cloud.weight).all():
            return declined(batch, "no particle lies on the map", **figures)
        if figures["effective_particles"] < options.least:
            figures[UNEXPLAINED] = 1.0
            return declined(batch, "too few particles agree with the readings", **figures)
        sample = np.concatenate([cloud.position, cloud.linear[:, :2]], axis=1)
        mean = cloud.weight @ sample
        covariance = (sample - mean).T @ (cloud.weight[:, None] * (sample - mean))
        covariance[2:, 2:] += cloud.covariance[:2, :2]
        # one particle that has taken all weight has no spread
        covariance += 1e-9 * np.diag(np.diag(batch.prior))
        return publish_posterior(batch, mean, covariance, figures, least_gain=0.02)


class _Motion(NamedTuple):
    """Linear dynamics of the position error p from scan to scan, and readings by p and by the
    velocity error v at the scan."""

    by_position: Array
    """(N, 2) d(reading)/dp by the reduction."""
    by_velocity: Array
    """(N, 2) d(reading)/dv."""
    move: Array
    """(N, 2, 2): p_next = move p + drive v from each scan to the next, from the last to the batch
    end."""
    drive: Array
    """(N, 2, 2)."""

    @classmethod
    def of(cls, readings: UsableReadings, last: Array) -> "_Motion":
        """Take both from the readings' dependence on xi; `last` (2, 4) is the transition of the
        batch end. With p = A_p xi_p + A_v v, xi = (A_p^-1 (p - A_v v), v)."""
        transition, jacobian = readings.transition, readings.jacobian
        inverse = np.linalg.inv(transition[:, :, :2])
        by_position = np.einsum("ti,tij->tj", jacobian[:, :2], inverse)
        by_velocity = jacobian[:, 2:] - np.einsum("ti,tij->tj", by_position, transition[:, :, 2:])
        following = np.concatenate([transition[1:], last[None]])
        move = following[:, :, :2] @ inverse
        return cls(
            by_position, by_velocity, move, following[:, :, 2:] - move @ transition[:, :, 2:]
        )


class _Cloud(NamedTuple):
    """K particles."""

    position: Array
    """(K, 2) m, position errors at the scan."""
    linear: Array
    """(K, 3) means of velocity error north and east and of the bias, given the position."""
    covariance: Array
    """(3, 3) of these, the same for all."""
    log: Array
    """(K,) logarithms of the weights, up to a constant."""
    weight: Array
    """(K,)."""


def _first_cloud(transition: Array, prior: Array, bias_sigma: float, normal: Array) -> _Cloud:
    """Spread particles over the prior of the first scan, by standard normal numbers (K, 2)."""
    covariance = transition @ prior @ transition.T
    cross = prior[2:] @ transition.T
    gain = np.linalg.solve(covariance, cross.T).T
    rest = prior[2:, 2:] - gain @ cross.T
    linear = np.zeros((3, 3))
    linear[:2, :2] = 0.5 * (rest + rest.T)
    linear[2, 2] = bias_sigma**2
    position = normal @ np.linalg.cholesky(covariance).T
    count = len(position)
    velocity = position[:, :1] * gain[:, 0] + position[:, 1:] * gain[:, 1]
    mean = np.concatenate([velocity, np.zeros((count, 1))], axis=1)
    return _Cloud(position, mean, linear, np.zeros(count), np.full(count, 1.0 / count))


@lru_cache(maxsize=8)
def _random_numbers(particles: int, scans: int) -> tuple[Array, Array]:
    """Fixed standard normal (scans, particles, 2) and uniform (scans,) numbers; the first normal
    row is quasi-random."""
    random = np.random.default_rng(20240607)
    normal = random.standard_normal((scans, particles, 2))
    normal[0] = standard_normal(particles, 2)
    uniform = random.random(scans)
    normal.setflags(write=False)
    uniform.setflags(write=False)
    return normal, uniform


def _weighed(readings: UsableReadings, motion: _Motion, t: int, cloud: _Cloud) -> _Cloud:
    """Take the reading of a scan: level - map(p) - by_position p = h u + noise; weights are NaN
    where all particles are off the map."""
    p, u, P, log, _ = cloud
    difference = readings.compared(p[None], slice(t, t + 1))[0][0]
    h = np.append(motion.by_velocity[t], 1.0)
    across = P @ h
    S = readings.sigma[t] ** 2 + h @ across
    r = difference - p @ motion.by_position[t] - u @ h
    off = np.isnan(r)
    r = np.where(off, 0.0, r)
    log = np.where(off, -np.inf, log - 0.5 * r**2 / S)
    largest = log.max()
    weight = np.exp(log - largest) if largest > -np.inf else np.full(len(log), np.nan)
    u = u + np.outer(r / S, across)
    return _Cloud(p, u, P - np.outer(across, across) / S, log, weight / weight.sum())


def _predicted(motion: _Motion, t: int, cloud: _Cloud, normal: Array, rough: Array) -> _Cloud:
    """Move the particles to the next scan: p' = move p + drive v + noise, and what p' says about
    v.

    Parameters
    ----------
    normal : (K, 2) array
        Standard normal numbers.
    rough : (2,) array
        m, 1-sigma of what is added after a resampling.
    """
    p, u, P, log, weight = cloud
    drive = motion.drive[t]
    G = drive @ P[:2]
    C = G[:, :2] @ drive.T + NOISE**2 * np.eye(2)
    step = normal @ np.linalg.cholesky(C).T
    gain = np.linalg.solve(C, G)
    moved = p @ motion.move[t].T + u[:, :2] @ drive.T + step
    # what is added says nothing of the velocity
    moved = moved + rough * normal[::-1, ::-1]
    return _Cloud(moved, u + step @ gain, P - G.T @ gain, log, weight)


def _resampled(cloud: _Cloud, uniform: float) -> tuple[_Cloud, Array]:
    """Resample systematically, by a uniform number; return also the 1-sigma (2,) of the
    particles, m."""
    count = len(cloud.weight)
    wanted = (np.arange(count) + uniform) / count
    source = np.minimum(np.searchsorted(np.cumsum(cloud.weight), wanted), count - 1)
    position = cloud.position[source]
    even = np.full(count, 1.0 / count)
    drawn = _Cloud(position, cloud.linear[source], cloud.covariance, np.zeros(count), even)
    return drawn, position.std(axis=0)
