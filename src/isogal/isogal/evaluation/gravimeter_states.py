"""What the bound takes for a gravimeter's errors: states for what it adds slowly to its readings,
and their white noise (docs/mathematics.md, sections 2.8 and 11.1)."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.scenario import Gradiometer, Gravimeter
from isogal.sensors.gradiometer_errors import EOTVOS, tilt_effect
from isogal.sensors.gravimeter_errors import accelerations
from isogal.sensors.platform import mean_error
from isogal.sensors.trajectory import Trajectory


class SlowStates(NamedTuple):
    """E stationary states over S scans; the last is the map's error after the filter, if there is
    one."""

    variance: Array
    """(E,) map's unit squared."""
    time: Array
    """(E,) s, correlation time."""
    share: Array
    """(S, E) what a reading has of each."""
    walk: float
    """Of the bias, map's unit per root second."""
    filter_time: float
    """s; 0 = there is no filter."""
    of_channel: Array
    """(C, E) what each channel has of each, beside `share`."""
    growth: Array
    """(E,) random walk of each, map's unit per root second."""

    @classmethod
    def none(cls, scans: int) -> "SlowStates":
        """Return those of a sensor with white noise."""
        return cls(
            np.zeros(0), np.zeros(0), np.zeros((scans, 0)), 0.0, 0.0, np.zeros((1, 0)), np.zeros(0)
        )

    def with_delay(self, sigma: float, share: Array) -> "SlowStates":
        """Return them with a delay (1-sigma, s) that is known no better, by which readings (S,)
        change as `share`, map's unit per s; before the others, of which the filter's is last."""
        return self._replace(
            variance=np.r_[sigma**2, self.variance],
            time=np.r_[np.inf, self.time],
            share=np.concatenate([share[:, None], self.share], axis=1),
            of_channel=np.concatenate([np.ones((1, 1)), self.of_channel], axis=1),
            growth=np.r_[0.0, self.growth],
        )


def slow_states(settings: Gravimeter, trajectory: Trajectory, index: Integers) -> SlowStates:
    """Return those of an instrument: noise correlated in time, cross-coupling with the two
    horizontal accelerations, what its platform's tilt takes of the vertical and of the horizontal
    specific force, and its filter.

    Parameters
    ----------
    index : (S,) array
        Of each scan in the trajectory.
    """
    variance, time, share = [], [], []
    if settings.correlated_sigma > 0.0:
        variance.append(settings.correlated_sigma**2)
        time.append(settings.correlation_time)
        share.append(np.ones(len(index)))
    before = np.concatenate([[0], index])
    if settings.cross_coupling > 0.0:
        moving = accelerations(trajectory.time[before], trajectory.velocity[before, :2])[1:]
        variance += [settings.cross_coupling**2] * 2
        time += [np.inf] * 2
        share += list(moving.T)
    if settings.platform_tilt > 0.0:
        variance += [mean_error(settings) ** 2, *[settings.platform_tilt**2] * 2]
        time += [0.5 * settings.platform_time, *[settings.platform_time] * 2]
        force = np.diff(trajectory.velocity[before, :2], axis=0)
        force /= np.diff(trajectory.time[before])[:, None]
        share += [np.ones(len(index)), *force.T]
    if settings.filter_time > 0.0:
        variance.append(0.0)  # settled when the first reading is given
        time.append(np.inf)
        share.append(np.zeros(len(index)))  # instead of the map's error itself
    return SlowStates(
        np.array(variance),
        np.array(time),
        np.stack(share, axis=1) if share else np.zeros((len(index), 0)),
        settings.bias_walk,
        settings.filter_time,
        np.ones((1, len(variance))),
        np.zeros(len(variance)),
    )


@kernel
def fill_slow(transition, half_noise, slow, map_error, dt):  # type: ignore[no-untyped-def]
    """Write what becomes of them and of the bias, the last state but one, over dt (s), in place;
    half of the noise enters at either end. `map_error` is the state of the map's error."""
    n = transition.shape[0]
    first = n - 2 - slow.variance.shape[0]
    for j in range(first, n - 2):
        keep = math.exp(-dt / slow.time[j - first])
        transition[j, j] = keep
        half_noise[j, j] = slow.variance[j - first] * (1.0 - keep**2) / (1.0 + keep**2)
        half_noise[j, j] += 0.5 * dt * slow.growth[j - first] ** 2
    half_noise[n - 2, n - 2] = 0.5 * dt * slow.walk**2
    if slow.filter_time > 0.0:  # of the map's error
        keep = math.exp(-dt / slow.filter_time)
        transition[n - 3, map_error], transition[n - 3, n - 3] = 1.0 - keep, keep
        half_noise[n - 3, n - 3] = 0.0


def effective_noise_variance(gravimeter: Gravimeter, quantisation: float = 0.0) -> float:
    """Return the variance (map's unit squared) whose information equals that of a reading on
    average.

    White noise and the map's rounding (step² / 12) add. With outliers the bound is that of a
    navigator that knows which readings are outliers: the mean of the two informations. So is that
    of readings of which a share is missing by chance."""
    rounding = quantisation**2 / 12.0
    good = gravimeter.sigma**2 + rounding
    outlier = good + (gravimeter.sigma * gravimeter.outlier_sigma) ** 2
    known = (1.0 - gravimeter.outlier_fraction) / good + gravimeter.outlier_fraction / outlier
    return 1.0 / ((1.0 - gravimeter.missing_fraction) * known)


def effective_noise(gravimeter: Gravimeter, covariance: Array, rounding: Array) -> Array:
    """Return the same as a covariance (C, C), for readings of C channels with a covariance of
    their noise, and variances (C,) of the maps' rounding."""
    good = covariance + np.diag(rounding)
    outlier = good + gravimeter.outlier_sigma**2 * covariance
    share = gravimeter.outlier_fraction
    known = (1.0 - share) * np.linalg.inv(good) + share * np.linalg.inv(outlier)
    return np.asarray(np.linalg.inv((1.0 - gravimeter.missing_fraction) * known))


def gradiometer_states(
    settings: Gradiometer, trajectory: Trajectory, index: Integers, turn: Array
) -> SlowStates:
    """Return the slow states of a gradiometer, for channels that are its components turned by
    (C, C), whose columns they are: its platform's tilt about north and about east, with what the
    normal gradient makes of it in the middle of the route, and the components' offsets.

    Parameters
    ----------
    index : (S,) array
        Of each scan in the trajectory.
    """
    none = SlowStates.none(len(index))
    variance, time, growth = [], [], []
    parts = [np.zeros((len(turn), 0))]
    if settings.platform_tilt > 0.0:
        middle = trajectory.latitude[index[len(index) // 2]]
        parts.append(turn.T @ tilt_effect(settings.components, middle))
        variance += [settings.platform_tilt**2] * 2
        time += [settings.platform_time] * 2
        growth += [0.0] * 2
    if settings.bias_eotvos > 0.0 or settings.bias_walk_eotvos > 0.0:
        parts.append(turn.T)
        variance += [(settings.bias_eotvos * EOTVOS) ** 2] * len(turn)
        time += [np.inf] * len(turn)
        growth += [settings.bias_walk_eotvos * EOTVOS] * len(turn)
    return none._replace(
        variance=np.array(variance),
        time=np.array(time),
        share=np.ones((len(index), len(variance))),
        of_channel=np.ascontiguousarray(np.concatenate(parts, axis=1)),
        growth=np.array(growth),
    )
