"""The low-pass filter and the delay of an instrument (docs/mathematics.md, section 2.8).

What is reported at time t is y(t - delay) with T dy/dt = x - y: the mean of what was sensed
before, with weights exp(-s / T) / T for what is s older."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.scenario import Gravimeter

SETTLING = 4.0
"""Time constants after its start until a filter's readings are given: what was before counts with
less than 2 %, and that is much like what came after."""
REACH = 6.0
"""Time constants over which a filter's past is looked at: what is older counts with 0.2 %."""
NODES = 40
"""Of the quadrature that stands for the filter's past. The nodes of 12 are a kilometre apart at
22 m/s and 60 s, by which a map's mean is wrong by more than the noise: NEES 2.0, with 40 1.05."""


class Lag(NamedTuple):
    """By how much the readings of an instrument are old, s."""

    delay: float
    filter_time: float

    @classmethod
    def of(cls, settings: Gravimeter) -> "Lag":
        """Return that of an instrument."""
        return cls(settings.delay, settings.filter_time)

    @property
    def mean(self) -> float:
        """Mean age of what a reading tells of, s."""
        return self.delay + self.filter_time

    @property
    def reach(self) -> float:
        """Age beyond which nothing counts any more, s."""
        return self.delay + REACH * self.filter_time

    def ages(self) -> tuple[Array, Array]:
        """Return ages (K,) in s and weights (K,) whose sum stands for the filter and the delay: by
        Gauss-Laguerre quadrature, which is exact for polynomials of the age."""
        if self.filter_time == 0.0:
            return np.array([self.delay]), np.ones(1)
        nodes, weights = np.polynomial.laguerre.laggauss(NODES)
        return self.delay + self.filter_time * nodes, weights / weights.sum()

    def report(self, time: Array, sensed: Array, when: Array) -> Array:
        """Return (..., N) what the instrument reports at times (N,) in s; NaN until its filter
        has settled.

        Parameters
        ----------
        time : (K,) array
            Evenly spaced, s; the instrument starts at the first.
        sensed : (..., K) array
            By a perfect instrument, linear in between.
        """
        smooth = low_pass(sensed, float(time[1] - time[0]), self.filter_time)
        at = when - self.delay
        flat = smooth.reshape(-1, len(time))
        reported = np.stack([np.interp(at, time, one) for one in flat])
        reported[:, at < time[0] + SETTLING * self.filter_time] = math.nan
        return reported.reshape(*sensed.shape[:-1], len(when))


def low_pass(signal: Array, dt: float, filter_time: float) -> Array:
    """Return (..., K) a signal after a first-order low-pass filter that starts settled: exact for
    a signal that is linear between its samples, dt (s) apart."""
    from scipy.signal import lfilter

    if filter_time == 0.0:
        return np.array(signal, dtype=float)
    keep = math.exp(-dt / filter_time)
    share = filter_time / dt * (1.0 - keep)
    old, new = share - keep, 1.0 - share
    settled = signal[..., :1] * (1.0 - new)
    return np.asarray(lfilter([new, old], [1.0, -keep], signal, zi=settled)[0])
