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

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import value_and_gradient
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import ReadingArrays, UsableReadings, publish_posterior
from isogal.matching.failures import UNEXPLAINED
from isogal.matching.interfaces import Batch, Fix, declined
from isogal.matching.quasi_random import standard_normal


class ParticleOptions(BaseModel):
    """Options of `particle`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    particles: int = Field(3000, ge=50, le=1_000_000, description="how many")
    resample: float = Field(
        0.5,
        gt=0.0,
        le=1.0,
        description="effective share of the particles below which they are resampled",
    )
    roughening: float = Field(
        0.2,
        ge=0.0,
        description="spread added at a resampling, in 1-sigma of the particles over N^(1/4)",
    )
    least: float = Field(
        4.0,
        ge=0.0,
        description="effective particles below which, at any scan, the batch gives no fix",
    )
    noise: float = Field(
        1.0, gt=0.0, description="random walk of the position from scan to scan, m"
    )


class Particle(Baseline[ParticleOptions]):
    """Settings of the matcher; it carries nothing from batch to batch."""

    name = "particle"
    options_model = ParticleOptions

    def solve(self, batch: Batch, field_map: FieldMap, readings: UsableReadings) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        options, arrays = self.options, readings.arrays
        normal, uniform = _random_numbers(options.particles, len(readings) + 1)
        cloud = _first_cloud(arrays.transition[0], batch.prior, self.noise.bias_sigma, normal[0])
        motion = _Motion.of(arrays, batch.transition[-1])
        tuning = _Tuning(options.noise**2, options.resample, options.roughening)
        smallest = _run(arrays, motion, cloud, normal[1:], uniform, tuning)
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
    def of(cls, readings: ReadingArrays, last: Array) -> "_Motion":
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
    """K particles, which kernels change in place."""

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


class _Tuning(NamedTuple):
    """Options of the filter."""

    variance: float
    """m², of the random walk from scan to scan."""
    resample: float
    """Effective share below which particles are resampled."""
    roughening: float
    """Spread added then."""


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


@kernel
def _run(
    readings: ReadingArrays,
    motion: _Motion,
    cloud: _Cloud,
    normal: Array,
    uniform: Array,
    tuning: _Tuning,
) -> float:
    """Run all scans and predict to the batch end; return the least effective share on the way."""
    smallest = 1.0
    for t in range(readings.level.shape[0]):
        effective = _weigh(readings, motion, t, cloud)
        smallest = min(smallest, effective)
        rough = (0.0, 0.0)
        if effective < tuning.resample:
            rough = _resample(cloud, uniform[t], tuning.roughening)
        _predict(motion, t, cloud, normal[t], tuning.variance, rough)
    return smallest


@kernel
def _weigh(readings: ReadingArrays, motion: _Motion, t: int, cloud: _Cloud) -> float:
    """Take the reading of a scan: level - map(p) - by_position p = h u + noise.

    Returns the effective share of the particles; weights are NaN where all are off the map."""
    p, u, P, log, weight = cloud
    grid, level = readings.grid, readings.level[t]
    latitude, longitude, radian = readings.latitude[t], readings.longitude[t], readings.radian[t]
    by_position = motion.by_position[t]
    count = p.shape[0]
    h = np.array([motion.by_velocity[t, 0], motion.by_velocity[t, 1], 1.0])
    Ph = np.zeros(3)
    S = readings.sigma[t] * readings.sigma[t]
    for i in range(3):
        Ph[i] = P[i, 0] * h[0] + P[i, 1] * h[1] + P[i, 2] * h[2]
        S += h[i] * Ph[i]
    largest = -np.inf
    for s in range(count):
        value = value_and_gradient(
            grid, latitude - p[s, 0] * radian[0], longitude - p[s, 1] * radian[1]
        )[0]
        r = level - value - by_position[0] * p[s, 0] - by_position[1] * p[s, 1]
        r -= h[0] * u[s, 0] + h[1] * u[s, 1] + h[2] * u[s, 2]
        log[s] += -0.5 * r * r / S
        if np.isnan(r):
            log[s] = -np.inf
            continue
        for i in range(3):
            u[s, i] += Ph[i] * r / S
        largest = max(largest, log[s])
    for i in range(3):
        for j in range(3):
            P[i, j] -= Ph[i] * Ph[j] / S
    total = square = 0.0
    for s in range(count):
        weight[s] = np.exp(log[s] - largest)
        total += weight[s]
        square += weight[s] * weight[s]
    for s in range(count):
        weight[s] /= total
    return total * total / square / count


@kernel
def _predict(
    motion: _Motion,
    t: int,
    cloud: _Cloud,
    normal: Array,
    variance: float,
    rough: tuple[float, float],
) -> None:
    """Move the particles to the next scan: p' = move p + drive v + noise, and what p' tells about
    v."""
    p, u, P = cloud.position, cloud.linear, cloud.covariance
    move, drive = motion.move[t], motion.drive[t]
    count = p.shape[0]
    G = np.zeros((2, 3))
    for i in range(2):
        for j in range(3):
            G[i, j] = drive[i, 0] * P[0, j] + drive[i, 1] * P[1, j]
    a = G[0, 0] * drive[0, 0] + G[0, 1] * drive[0, 1] + variance
    b = G[0, 0] * drive[1, 0] + G[0, 1] * drive[1, 1]
    d = G[1, 0] * drive[1, 0] + G[1, 1] * drive[1, 1] + variance
    root_a = np.sqrt(a)
    root_b = b / root_a
    root_d = np.sqrt(d - root_b * root_b)
    determinant = a * d - b * b
    for s in range(count):
        step_north = root_a * normal[s, 0]
        step_east = root_b * normal[s, 0] + root_d * normal[s, 1]
        mean_north = (
            move[0, 0] * p[s, 0]
            + move[0, 1] * p[s, 1]
            + drive[0, 0] * u[s, 0]
            + drive[0, 1] * u[s, 1]
        )
        mean_east = (
            move[1, 0] * p[s, 0]
            + move[1, 1] * p[s, 1]
            + drive[1, 0] * u[s, 0]
            + drive[1, 1] * u[s, 1]
        )
        p[s, 0] = mean_north + step_north + rough[0] * normal[count - 1 - s, 1]
        p[s, 1] = mean_east + step_east + rough[1] * normal[count - 1 - s, 0]
        along = (d * step_north - b * step_east) / determinant
        across = (a * step_east - b * step_north) / determinant
        for i in range(3):
            u[s, i] += G[0, i] * along + G[1, i] * across
    for i in range(3):
        first = (d * G[0, i] - b * G[1, i]) / determinant
        second = (a * G[1, i] - b * G[0, i]) / determinant
        for j in range(3):
            P[i, j] -= first * G[0, j] + second * G[1, j]


@kernel
def _resample(cloud: _Cloud, uniform: float, roughening: float) -> tuple[float, float]:
    """Resample systematically; return the 1-sigma north and east (m) that roughening adds."""
    p, u, _, log, weight = cloud
    count = p.shape[0]
    old_p, old_u = p.copy(), u.copy()
    north = east = north_square = east_square = 0.0
    source = 0
    passed = weight[0]
    for s in range(count):
        target = (s + uniform) / count
        while passed < target and source < count - 1:
            source += 1
            passed += weight[source]
        for i in range(2):
            p[s, i] = old_p[source, i]
        for i in range(3):
            u[s, i] = old_u[source, i]
        north += p[s, 0] / count
        east += p[s, 1] / count
        north_square += p[s, 0] * p[s, 0] / count
        east_square += p[s, 1] * p[s, 1] / count
        log[s] = 0.0
    for s in range(count):
        weight[s] = 1.0 / count
    scale = roughening / np.sqrt(np.sqrt(count))
    return (
        scale * np.sqrt(max(north_square - north * north, 0.0)),
        scale * np.sqrt(max(east_square - east * east, 0.0)),
    )
