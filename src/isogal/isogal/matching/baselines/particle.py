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

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.matching import quasi_random
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import Scans, publish_posterior
from isogal.matching.interfaces import Batch, Fix, declined


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

    def solve(self, batch: Batch, field_map: FieldMap, scans: Scans) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        move, drive = _dynamics(scans.transition, batch.transition[-1])
        # readings by position error at the scan and by velocity error: xi = (A_p^-1 (p - A_v v),
        # v)
        inverse = np.linalg.inv(scans.transition[:, :, :2])
        by_position = np.einsum("ti,tij->tj", scans.jacobian[:, :2], inverse)
        by_velocity = scans.jacobian[:, 2:] - np.einsum(
            "ti,tij->tj", by_position, scans.transition[:, :, 2:]
        )
        start, velocity_gain, rest = _start(scans.transition[0], batch.prior)
        linear = np.zeros((3, 3))
        linear[:2, :2] = rest
        linear[2, 2] = self.noise.bias_sigma**2
        options = self.options
        normal, uniform = _random_numbers(options.particles, len(scans) + 1)
        position, velocity, spread, weight, smallest = _run(
            scans.grid, scans.latitude, scans.longitude, scans.radian, scans.level, scans.sigma**2, by_position, by_velocity,
            move, drive, normal[0] @ start.T, velocity_gain, linear, normal[1:], uniform,
            options.noise**2, options.resample, options.roughening,
        )  # fmt: skip
        figures = {"effective_particles": smallest * options.particles}
        if not np.isfinite(weight).all():
            return declined(batch, "no particle lies on the map", **figures)
        if figures["effective_particles"] < options.least:
            return declined(batch, "too few particles agree with the readings", **figures)
        sample = np.concatenate([position, velocity], axis=1)
        mean = weight @ sample
        covariance = (sample - mean).T @ (weight[:, None] * (sample - mean))
        covariance[2:, 2:] += spread
        # one particle that has taken all weight has no spread
        covariance += 1e-9 * np.diag(np.diag(batch.prior))
        return publish_posterior(batch, mean, covariance, figures, least_gain=0.02)


def _dynamics(transition: Array, last: Array) -> tuple[Array, Array]:
    """Matrices (N, 2, 2) with p_next = move p + drive v from each scan to the next, from the last
    to the batch end."""
    inverse = np.linalg.inv(transition[:, :, :2])
    following = np.concatenate([transition[1:], last[None]])
    move = following[:, :, :2] @ inverse
    return move, following[:, :, 2:] - move @ transition[:, :, 2:]


def _start(transition: Array, prior: Array) -> tuple[Array, Array, Array]:
    """Root (2, 2) of the position covariance at the first scan, gain (2, 2) of velocity on it,
    covariance of the rest of velocity."""
    covariance = transition @ prior @ transition.T
    cross = prior[2:] @ transition.T
    gain = np.linalg.solve(covariance, cross.T).T
    rest = prior[2:, 2:] - gain @ cross.T
    root = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    return root, np.asarray(gain, dtype=np.float64), 0.5 * (rest + rest.T)


@lru_cache(maxsize=8)
def _random_numbers(particles: int, scans: int) -> tuple[Array, Array]:
    """Fixed standard normal (scans, particles, 2) and uniform (scans,) numbers; the first normal
    row is quasi-random."""
    random = np.random.default_rng(20240607)
    normal = random.standard_normal((scans, particles, 2))
    normal[0] = quasi_random.normal(quasi_random.sobol(particles, 2, 20240607))
    uniform = random.random(scans)
    normal.setflags(write=False)
    uniform.setflags(write=False)
    return normal, uniform


@kernel
def _run(
    grid: Grid,
    latitude: Array,
    longitude: Array,
    radian: Array,
    level: Array,
    variance: Array,
    by_position: Array,
    by_velocity: Array,
    move: Array,
    drive: Array,
    position: Array,
    velocity_gain: Array,
    linear: Array,
    normal: Array,
    uniform: Array,
    noise: float,
    resample: float,
    roughening: float,
) -> tuple[Array, Array, Array, Array, float]:
    """Run all scans and predict to the batch end.

    Returns positions (K, 2), velocities (K, 2), their common covariance (2, 2), weights (K,) and
    the least effective share on the way."""
    count, scans = position.shape[0], level.shape[0]
    p = position.copy()
    u = np.zeros((count, 3))  # velocity north, east, bias
    for s in range(count):
        for i in range(2):
            u[s, i] = velocity_gain[i, 0] * p[s, 0] + velocity_gain[i, 1] * p[s, 1]
    P = linear.copy()
    log = np.zeros(count)
    weight = np.full(count, 1.0 / count)
    h = np.array([0.0, 0.0, 1.0])
    Ph = np.zeros(3)
    G = np.zeros((2, 3))
    smallest = 1.0
    for t in range(scans):
        # measurement: level - map(p) - by_position p = h u + noise
        h[0], h[1] = by_velocity[t, 0], by_velocity[t, 1]
        S = variance[t]
        for i in range(3):
            Ph[i] = P[i, 0] * h[0] + P[i, 1] * h[1] + P[i, 2] * h[2]
            S += h[i] * Ph[i]
        largest = -np.inf
        for s in range(count):
            value = value_and_gradient(
                grid,
                latitude[t] - p[s, 0] * radian[t, 0],
                longitude[t] - p[s, 1] * radian[t, 1],
            )[0]
            r = level[t] - value - by_position[t, 0] * p[s, 0] - by_position[t, 1] * p[s, 1]
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
            weight[s] = np.exp(log[s] - largest)  # NaN where all are off the map
            total += weight[s]
            square += weight[s] * weight[s]
        effective = total * total / square / count
        smallest = min(smallest, effective)
        for s in range(count):
            weight[s] /= total
        rough_north = rough_east = 0.0
        if effective < resample:
            rough_north, rough_east = _resample(p, u, weight, log, uniform[t], roughening)
        # time: p' = move p + drive v + noise, and what p' tells about v
        for i in range(2):
            for j in range(3):
                G[i, j] = drive[t, i, 0] * P[0, j] + drive[t, i, 1] * P[1, j]
        a = G[0, 0] * drive[t, 0, 0] + G[0, 1] * drive[t, 0, 1] + noise
        b = G[0, 0] * drive[t, 1, 0] + G[0, 1] * drive[t, 1, 1]
        d = G[1, 0] * drive[t, 1, 0] + G[1, 1] * drive[t, 1, 1] + noise
        root_a = np.sqrt(a)
        root_b = b / root_a
        root_d = np.sqrt(d - root_b * root_b)
        determinant = a * d - b * b
        for s in range(count):
            step_north = root_a * normal[t, s, 0]
            step_east = root_b * normal[t, s, 0] + root_d * normal[t, s, 1]
            mean_north = (
                move[t, 0, 0] * p[s, 0]
                + move[t, 0, 1] * p[s, 1]
                + drive[t, 0, 0] * u[s, 0]
                + drive[t, 0, 1] * u[s, 1]
            )
            mean_east = (
                move[t, 1, 0] * p[s, 0]
                + move[t, 1, 1] * p[s, 1]
                + drive[t, 1, 0] * u[s, 0]
                + drive[t, 1, 1] * u[s, 1]
            )
            p[s, 0] = mean_north + step_north + rough_north * normal[t, count - 1 - s, 1]
            p[s, 1] = mean_east + step_east + rough_east * normal[t, count - 1 - s, 0]
            along = (d * step_north - b * step_east) / determinant
            across = (a * step_east - b * step_north) / determinant
            for i in range(3):
                u[s, i] += G[0, i] * along + G[1, i] * across
        for i in range(3):
            first = (d * G[0, i] - b * G[1, i]) / determinant
            second = (a * G[1, i] - b * G[0, i]) / determinant
            for j in range(3):
                P[i, j] -= first * G[0, j] + second * G[1, j]
    return p, u[:, :2].copy(), P[:2, :2].copy(), weight, smallest


@kernel
def _resample(
    p: Array, u: Array, weight: Array, log: Array, uniform: float, roughening: float
) -> tuple[float, float]:
    """Resample in place systematically; return the 1-sigma north and east (m) that roughening
    adds."""
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
