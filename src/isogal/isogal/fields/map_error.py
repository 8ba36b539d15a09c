"""How far the true field differs from its map: samples along a route, of the random field of
`isogal.maps.error_model` and of a wrong datum. Several components of gravity, or of its gradient,
have the errors that one wrong potential gives them all (docs/mathematics.md, section 12.4).

Samples at few places are exact, by a root of their covariance; that of many does not fit into
memory, and they are sums of plane waves."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import TypeVar

import numpy as np
from scipy.special import ndtr, stdtrit

from isogal.arrays import Array, Integers
from isogal.earth.plane import Plane
from isogal.maps.error_model import covariance, decay, tensor_covariance, wave_factors
from isogal.matrices import square_root, symmetric
from isogal.scenario import Truth
from isogal.seeds import generator
from isogal.sensors.trajectory import Trajectory

_KEPT_PLACES = 2000
"""Places at most for a matrix to stay in memory (32 MB)."""
_EXACT_PLACES = 3000
"""Places at most of exact samples: 1 GB and a second or two. With 9000 it was 9 GB and 2 min."""
_EVERY = 3
"""Scans from one draw of the horizontal components to the next."""
_JITTER = 1e-6
"""Of the variance, against rounding: the places of the disturbance's draws are on the sphere,
those of the horizontal ones in a plane."""
_WAVES = 2000
"""Plane waves that make a field. Its covariance is right on the mean over fields with any number;
with so many its distribution is Gaussian but for a part in a thousand of the kurtosis."""
_CHUNK = 4000
"""Places that waves are summed at together (130 MB)."""


T = TypeVar("T")


def _kept(compute: Callable[[Array, Array, float], T]) -> Callable[[Array, Array, float], T]:
    """Keep the last result of a function of two sets of places, if they are few, and a length,
    for the next runs."""
    last: dict[tuple[bytes, bytes, float], T] = {}

    @wraps(compute)
    def result(first: Array, second: Array, length: float) -> T:
        if max(len(first), len(second)) > _KEPT_PLACES:
            return compute(first, second, length)
        key = first.tobytes(), second.tobytes(), length
        if key not in last:
            last.clear()
            last[key] = compute(first, second, length)
        return last[key]

    return result


@_kept
def _correlation_root(latitude: Array, longitude: Array, length: float) -> Array:
    """Return (N, N) a square root of the correlation of the map's errors at places (N,), rad."""
    correlation = covariance(latitude, longitude, np.ones(latitude.size), length)
    return np.asarray(np.linalg.cholesky(correlation + 1e-12 * np.eye(latitude.size)))


@dataclass(frozen=True, slots=True)
class TrueMapError:
    """How far the true field of some runs differs from its map, in the map's unit."""

    truth: Truth
    trajectory: Trajectory
    """Of K steps."""
    index: Integers
    """(scans,) of the scans in the trajectory."""
    runs: Sequence[int]
    """R, which seed the random streams."""

    def at(self, latitude: Array, longitude: Array, channels: tuple[int, ...] = ()) -> Array:
        """Return (R, *places, *channels) the error at true places (*places), rad: samples of a
        Gaussian field with covariance sigma² exp(-d / L), one per run and channel (of a reading
        of this shape); with `map_error.tails` each value is that of Student's t distribution of
        the same 1-sigma and the same probability (a translation process: Grigoriu 1984, J. Eng.
        Mech. 110:610)."""
        settings = self.truth.map_error
        sigma, length, tails = settings.sigma, settings.correlation_length, settings.tails
        if sigma == 0.0:
            return np.zeros((len(self.runs), *latitude.shape, *channels))
        flat = latitude.ravel(), longitude.ravel()
        if latitude.size > _EXACT_PLACES:
            drawn = self._by_waves(*flat, ("dd",), math.prod(channels))
        else:
            root = sigma * _correlation_root(*flat, length)
            # no matrix product of all: a run's numbers must not depend on how many are computed
            drawn = [root @ one for one in self._normal("map_error", latitude.size, *channels)]
        error = np.stack(drawn).reshape(len(self.runs), *latitude.shape, *channels)
        return error if tails is None else sigma * _with_tails(error / sigma, tails)

    def at_scans(self, channels: tuple[int, ...] = ()) -> Array:
        """Return (R, scans, *channels) what `at` does at the scans."""
        return self.at(*self._places, channels)

    @property
    def _places(self) -> tuple[Array, Array]:
        """(scans,) latitude and longitude of the scans, rad."""
        return self.trajectory.latitude[self.index], self.trajectory.longitude[self.index]

    def between(self, error: Array) -> Array:
        """Return (R, K + 1) the error along the whole trajectory, given that at the scans (R,
        scans): a Gauss-Markov process along the track, as `at_scans` is one along a straight line;
        after the last scan it stays as it is."""
        truth, trajectory = self.truth, self.trajectory
        steps, length = truth.steps_per_scan, truth.map_error.correlation_length
        scans = error.shape[1]
        speed = np.hypot(*trajectory.velocity[: scans * steps, :2].T)
        keep = decay(speed * trajectory.dt, length).reshape(scans, steps)
        normal = truth.map_error.sigma * np.stack(self._normal("map_error_between", scans, steps))
        before = error[:, 0] * keep[0].prod() + normal[:, 0, 0] * np.sqrt(
            1.0 - keep[0].prod() ** 2
        )
        whole = np.empty((len(self.runs), len(trajectory) + 1))
        whole[:, scans * steps :] = error[:, -1:]
        inside = whole[:, : scans * steps].reshape(len(self.runs), scans, steps)
        inside[:, :, 0] = np.concatenate([before[:, None], error[:, :-1]], axis=1)
        for k in range(1, steps):
            # a bridge: given the point before (correlation a) and the next scan (correlation b)
            a, b = keep[:, k - 1], keep[:, k:].prod(axis=1)
            rest = 1.0 - a**2 * b**2
            mean = a * (1.0 - b**2) / rest * inside[:, :, k - 1] + b * (1.0 - a**2) / rest * error
            spread = np.sqrt((1.0 - a**2) * (1.0 - b**2) / rest)
            inside[:, :, k] = mean + spread * normal[:, :, k]
        return whole

    def horizontal(self, vertical: Array) -> tuple[Integers, Array]:
        """Return where the error of the map's horizontal gravity is drawn, an index (S,) in the
        trajectory, and what it is there, (R, S, 2) to north and east, m/s².

        It is drawn given the error of the disturbance at the scans (R, scans), as `at_scans` has
        drawn it, so that both belong to one potential. The horizontal components move a position
        only after two integrations: every third scan is enough, and in between they are taken as
        linear."""
        sigma, length = self.truth.map_error.sigma, self.truth.map_error.correlation_length
        stations = np.unique(np.concatenate([[0], self.index[::_EVERY], self.index[-1:]]))
        if sigma == 0.0:
            return stations, np.zeros((len(self.runs), len(stations), 2))
        latitude, longitude = self.trajectory.latitude, self.trajectory.longitude
        if len(self.index) > _EXACT_PLACES:
            where = latitude[stations], longitude[stations]
            return stations, np.stack(self._by_waves(*where, ("nd", "ed")))
        places = _plane(self.trajectory, latitude, longitude)
        gain, root = _horizontal_given(places[self.index], places[stations], length)
        normal = self._normal("map_error_horizontal", 2 * len(stations))
        # a product for each run: its numbers must not depend on how many runs are computed
        drawn = [
            error @ gain + sigma * root @ own for own, error in zip(normal, vertical, strict=True)
        ]
        return stations, np.stack(drawn).reshape(len(self.runs), len(stations), 2)

    def of_one_potential(self) -> Array:
        """Return (R, scans, C) the error of the components of the gradient at the scans, 1/s²:
        one field for all components (`_by_waves`)."""
        components = self.truth.gradiometer.components
        if self.truth.map_error.sigma == 0.0:
            return np.zeros((len(self.runs), len(self.index), len(components)))
        return np.stack(self._by_waves(*self._places, components))

    def of_datum(self, channels: tuple[int, ...] = ()) -> Array:
        """Return (R, scans, *channels) how far the true field is above the map by
        `map_error.offset` and `map_error.tilt`.

        A plane a + b x + c y, north x and east y from the route's start; a, b and c are drawn once
        per run and channel."""
        settings, count = self.truth.map_error, len(self.index)
        if settings.offset == 0.0 and settings.tilt == 0.0:
            return np.zeros((len(self.runs), count, *channels))
        tilted = settings.tilt * _plane(self.trajectory, *self._places)
        plane = np.column_stack([np.full(count, settings.offset), tilted])
        # summed for each run by itself: its numbers must not depend on how many are computed
        drawn = self._normal("map_datum", 3, *channels)
        return np.stack([np.einsum("sk,k...->s...", plane, one) for one in drawn])

    def _by_waves(
        self, latitude: Array, longitude: Array, components: Sequence[str], channels: int = 1
    ) -> list[Array]:
        """Return (N, channels * C) for each run the error at places (N,), rad: of components of
        one field, or of several independent fields."""
        error, seed, drawn = self.truth.map_error, self.truth.seed, []
        places = _plane(self.trajectory, latitude, longitude) / error.correlation_length
        for run in self.runs:
            random = generator(seed, run, "map_error_potential")
            fields = [_by_waves(random, places, components) for _ in range(channels)]
            drawn.append(error.sigma * np.concatenate(fields, axis=1))
        return drawn

    def _normal(self, purpose: str, *shape: int) -> list[Array]:
        """Return standard normal numbers of each run."""
        seed = self.truth.seed
        return [generator(seed, run, purpose).standard_normal(shape) for run in self.runs]


def _with_tails(normal: Array, freedom: float) -> Array:
    """Return what has Student's t distribution of unit variance where an array is normal."""
    size = -math.sqrt(1.0 - 2.0 / freedom) * stdtrit(freedom, ndtr(-np.abs(normal)))
    return np.asarray(np.copysign(size, normal))


@_kept
def _horizontal_given(scans: Array, stations: Array, length: float) -> tuple[Array, Array]:
    """Return (scans, 2 S) by which the disturbance's error at the scans makes the mean of the
    horizontal ones at S stations, and (2 S, 2 S) a square root of what is left of their
    covariance, sigma = 1; places (N, 2) m in a plane."""
    down, sideways = np.zeros(len(scans), int), np.tile([1, 2], len(stations))

    def between(first: Integers, second: Integers, a: Array, b: Array) -> Array:
        apart = b[None] - a[:, None]
        return tensor_covariance(("dd", "nd", "ed"), first, apart, length, second)

    twice = np.repeat(stations, 2, axis=0)
    known = between(down, down, scans, scans)
    cross = between(down, sideways, scans, twice)
    gain = np.linalg.solve(known + _JITTER * np.eye(len(scans)), cross)
    rest = symmetric(between(sideways, sideways, twice, twice) - cross.T @ gain)
    try:
        root = np.linalg.cholesky(rest + _JITTER * np.eye(len(twice)))
    except np.linalg.LinAlgError:  # places that are passed again leave nothing to draw
        root = square_root(rest)
    return np.asarray(gain), np.asarray(root)


def _by_waves(random: np.random.Generator, places: Array, components: Sequence[str]) -> Array:
    """Draw one field of 1-sigma one and correlation length one, and return (N, C) components
    (`wave_factors`) of it at places (N, 2).

    It is a sum of plane waves of random direction and phase, whose wavenumbers are drawn from the
    spectrum (randomisation method: Shinozuka 1971, J. Acoust. Soc. Am. 49:357), so that it is one
    field for all components on any route, without a grid that limits its wavelengths. The
    wavenumbers are stratified: each of W equal shares of the variance has one wave."""
    share = (np.arange(_WAVES) + random.random(_WAVES)) / _WAVES
    # a share s of the variance has waves longer than k with 1 - 1 / sqrt(1 + k²) = s
    size = np.sqrt(np.maximum((1.0 - share) ** -2.0 - 1.0, 0.0))
    direction = 2.0 * np.pi * random.random(_WAVES)
    cosine, sine = random.standard_normal((2, _WAVES)) / np.sqrt(_WAVES)
    waves = size * np.stack([np.cos(direction), np.sin(direction)])
    factor = wave_factors(components, direction)
    # real part of factor (a - i b) exp(i k x)
    of_cosine = factor.real * cosine + factor.imag * sine
    of_sine = factor.real * sine - factor.imag * cosine
    total = np.empty((len(places), len(components)))
    for begin in range(0, len(places), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        phase = places[part] @ waves
        total[part] = np.cos(phase) @ of_cosine.T + np.sin(phase) @ of_sine.T
    return total


def _plane(trajectory: Trajectory, latitude: Array, longitude: Array) -> Array:
    """Return (N, 2) m, north and east of the route's first point, of places (N,), rad, in the
    plane of the route's middle."""
    begin = trajectory.latitude[0], trajectory.longitude[0]
    return Plane.at(*begin, float(trajectory.latitude.mean())).metres(latitude, longitude)
