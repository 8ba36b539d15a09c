"""Random errors of an instrument's readings, as data: white noise with outliers, a bias that
drifts, time-correlated noise and a random walk (docs/mathematics.md, section 2.8).

Time-correlated noise is a first-order Gauss-Markov process, a bias that wanders a random walk
(Groves 2013, sections 4.4.3 and 14.2.6; Allan variances in IEEE Std 952-1997, annex C). What an
instrument does not have is not drawn, and each error has a random stream of its own, so that one
more error leaves the others as they were."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers
from isogal.seeds import generator
from isogal.sensors.trajectory import Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """1-sigmas of what is added to readings, in their unit; the same for each of their numbers,
    but for white noise that has a covariance."""

    name: str
    """What the random streams' names begin with."""
    white: float | Array
    """White noise, or a square root (C, C) of its covariance."""
    outlier_fraction: float = 0.0
    """Share of the readings that are outliers."""
    outlier_sigma: float = 0.0
    """Of an outlier, in units of the white noise that it comes on top of."""
    bias: float = 0.0
    """Constant over a run."""
    drift: float = 0.0
    """Of the bias, per second."""
    correlated: float = 0.0
    """Of the Gauss-Markov process."""
    correlation_time: float = 1.0
    """Its correlation time, s."""
    walk: float = 0.0
    """Of the random walk, per root second."""

    def draw(self, seed: int, run: int, time: Array, size: tuple[int, ...] = ()) -> Array:
        """Return (N, *size) the errors of a run's readings.

        Parameters
        ----------
        seed, run : int
            Of the random streams.
        time : (N,) array
            Of the readings, s, increasing.
        size : tuple of int
            Shape of a reading.
        """

        def normal(purpose: str, *shape: int) -> Array:
            draws = generator(seed, run, f"{self.name}_{purpose}")
            return draws.standard_normal((*shape, *size))

        count, column = len(time), (-1, *(1 for _ in size))
        white = normal("noise", count)
        if self.outlier_fraction > 0.0:
            random = generator(seed, run, f"{self.name}_outliers")
            # all numbers of a reading are outliers together, but beams are hit one by one
            shape = (count, 1) if np.ndim(self.white) else white.shape
            hit = random.random(shape) < self.outlier_fraction
            white = white + hit * self.outlier_sigma * random.standard_normal(white.shape)
        error = white @ self.white.T if isinstance(self.white, np.ndarray) else self.white * white
        if self.bias or self.drift:
            offset, rate = normal("bias", 2)
            error = error + self.bias * offset + self.drift * rate * time.reshape(column)
        if self.correlated > 0.0:
            keep = np.exp(-np.diff(time) / self.correlation_time)
            process = gauss_markov(keep, np.moveaxis(normal("correlated", count), 0, -1))
            error = error + self.correlated * np.moveaxis(process, -1, 0)
        if self.walk > 0.0:
            root = np.sqrt(np.diff(time, prepend=0.0)).reshape(column)
            error = error + self.walk * np.cumsum(root * normal("walk", count), axis=0)
        return np.asarray(error)


@dataclass(frozen=True, slots=True, eq=False)
class RunScans:
    """The scans of a run, at which an instrument's errors are drawn."""

    seed: int
    run: int
    """Both of the random streams."""
    trajectory: Trajectory
    index: Integers
    """(scans,) of each scan in the trajectory, evenly spaced."""

    @property
    def time(self) -> Array:
        """(scans,) s."""
        return self.trajectory.time[self.index]

    def tilts(self, name: str, sigma: float, time: float, axes: int) -> Array:
        """Return (axes, scans) rad the tilts of an instrument's platform: Gauss-Markov processes
        of a 1-sigma (rad) and a correlation time (s); the random stream's name begins with the
        instrument's."""
        normal = generator(self.seed, self.run, f"{name}_platform").standard_normal(
            (axes, len(self.index))
        )
        return sigma * gauss_markov(np.exp(-np.diff(self.time) / time), normal)


def gauss_markov(keep: Array | float, normal: Array) -> Array:
    """Return (..., N) a stationary first-order Gauss-Markov process of unit variance.

    Parameters
    ----------
    keep : (N - 1,) array, or float
        Correlation of each number with the one before, exp(-dt / correlation time).
    normal : (..., N) array
        Standard normal numbers.
    """
    fresh = np.sqrt(1.0 - np.square(keep))
    process = np.array(normal, dtype=float)
    process[..., 1:] *= fresh
    if np.ndim(keep) == 0:
        from scipy.signal import lfilter

        return np.asarray(lfilter([1.0], [1.0, -float(keep)], process))
    for k, share in enumerate(np.asarray(keep)):
        process[..., k + 1] += share * process[..., k]
    return process
