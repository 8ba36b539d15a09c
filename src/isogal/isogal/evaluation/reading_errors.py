"""What the bound takes of the errors of one field's readings: a state for each error that changes
slowly, and variances of white noise (docs/mathematics.md, sections 2.8 and 11.1)."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fields.beams import Footprints
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.maps.error_model import Chain, chained, decay, shares
from isogal.maps.tiled_map import ScalarMap
from isogal.matching.reading_noise import noise_states
from isogal.scenario import Altimeter, Gradiometer, Gravimeter, MapError
from isogal.sensors.gradiometer import EOTVOS, tilt_effect
from isogal.sensors.trajectory import Trajectory

_BEFORE = 4
"""Scans before on which the map's errors at a scan are conditioned. The information of a straight
track is then right within 5 %."""


class SlowError(NamedTuple):
    """An error of readings that changes slowly."""

    state: AuxiliaryState
    by: Array
    """d(reading)/d(state), to be broadcast to (S, C): S scans of C channels."""

    @classmethod
    def of(
        cls,
        name: str,
        sigma: float,
        by: Array,
        time: float = math.inf,
        length: float = math.inf,
        walk: float = 0.0,
    ) -> "SlowError":
        """Return one with a 1-sigma at the start and a process; see `AuxiliaryState`."""
        return cls(AuxiliaryState(name, "none", 0, sigma, time, length, walk), by)


class MapSteps(NamedTuple):
    """How U map errors of one potential go on from scan to scan, u -> step u, with `joined` added
    to their covariance (`isogal.maps.error_model.chained`)."""

    step: Array
    """(S, U, U)."""
    joined: Array
    """(S, U, U); 0 of a scan at the place of the one before."""
    by: Array
    """(U, C) how much of each is in the channels."""


def beam_channels(
    altimeter: Altimeter,
    trajectory: Trajectory,
    field_map: ScalarMap,
    scans: Integers,
    correlation_length: float,
) -> tuple[Array, Array, Array]:
    """Return the beams of an altimeter, turned into B channels whose map errors are independent.

    The map's errors under the beams are taken to be correlated as they are where the clearance is
    its mean, and from scan to scan as under one beam; the scale of the ranges is taken to be
    known. Both make the bound smaller.

    Parameters
    ----------
    altimeter : Altimeter
    trajectory : Trajectory
    field_map : ScalarMap
        Of heights, m.
    scans : (S,) array of int
        Of each scan in the trajectory.
    correlation_length : float
        m, of the map's error.

    Returns
    -------
    (S, B, 4), (B,) and (B,) arrays
        d(reading)/d(navigator's error); the map's error in each channel, as a variance in units of
        that of one beam; and how much of what all beams have in common is in each: tide, height.
    """
    foot = Footprints(altimeter, trajectory, field_map, scans)
    _, north, east = field_map.value_and_gradient(*foot.places(foot.range))
    across = foot.body * foot.range.mean(axis=0)[:, None]
    apart = np.hypot(*(across[:, None, :2] - across[None, :, :2]).transpose(2, 0, 1))
    values, turn = np.linalg.eigh(decay(apart, correlation_length))
    sensitivity = np.zeros((*foot.range.shape, 4))
    sensitivity[..., 0] = -np.einsum("bc,sb->sc", turn, north)
    sensitivity[..., 1] = -np.einsum("bc,sb->sc", turn, east)
    return sensitivity, np.maximum(values, 0.0), turn.sum(axis=0)


def gravimeter_errors(
    settings: Gravimeter, trajectory: Trajectory, index: Integers
) -> list[SlowError]:
    """Return those of an instrument: noise correlated in time, cross-coupling with the two
    horizontal accelerations, dynamic pressure, and what its platform's tilt takes of the vertical
    and of the horizontal specific force. What they are by is (S, 1).

    Parameters
    ----------
    index : (S,) array
        Of each scan in the trajectory.
    """
    before = np.concatenate([[0], index])
    time, velocity = trajectory.time[before], trajectory.velocity[before, :2]
    moved, since = np.diff(velocity, axis=0), np.diff(time)[:, None]
    force = np.concatenate([moved[:1], moved / since])  # the first is of the start, which is none
    states = noise_states(settings, time, velocity, force)
    return [SlowError.of(name, sigma, by[1:, None], time) for name, sigma, time, by in states]


def gradiometer_errors(
    settings: Gradiometer, trajectory: Trajectory, index: Integers, turn: Array
) -> list[SlowError]:
    """Return those of a gradiometer, for channels that are its components turned by (C, C), whose
    columns they are: its platform's tilt about north and about east, with what the normal gradient
    makes of it in the middle of the route, and the components' offsets. What they are by is (C,).

    Parameters
    ----------
    index : (S,) array
        Of each scan in the trajectory.
    """
    found = []
    if settings.platform_tilt > 0.0:
        middle = trajectory.latitude[index[len(index) // 2]]
        effect = turn.T @ tilt_effect(settings.components, middle)
        lasting = settings.platform_time
        found += [
            SlowError.of("tilt", settings.platform_tilt, by, time=lasting) for by in effect.T
        ]
    bias, walk = EOTVOS * settings.bias_eotvos, EOTVOS * settings.bias_walk_eotvos
    if bias > 0.0 or walk > 0.0:
        found += [SlowError.of("offset", bias, by, walk=walk) for by in turn]
    return found


def effective_noise_variance(gravimeter: Gravimeter, quantisation: float = 0.0) -> float:
    """Return the variance (map's unit squared) whose information equals that of a reading on
    average; `quantisation` is the step of the map's values.

    White noise and the map's rounding (step² / 12) add. With outliers the bound is that of a
    navigator that knows which readings are outliers: the mean of the two informations. So is that
    of readings of which a share is missing by chance."""
    covariance = np.array([[gravimeter.sigma**2]])
    return float(effective_noise(gravimeter, covariance, np.array([quantisation]))[0, 0])


def effective_noise(gravimeter: Gravimeter, covariance: Array, quantisation: Array) -> Array:
    """Return the same as a covariance (C, C), for readings of C channels with a covariance of
    their noise, and steps (C,) of the maps' values."""
    good = covariance + np.diag(quantisation**2 / 12.0)
    outlier = good + gravimeter.outlier_sigma**2 * covariance
    share = gravimeter.outlier_fraction
    known = (1.0 - share) * np.linalg.inv(good) + share * np.linalg.inv(outlier)
    return np.asarray(np.linalg.inv((1.0 - gravimeter.missing_fraction) * known))


def map_errors(
    error: MapError, of_channel: Array, share: Array, steps: MapSteps | None
) -> list[SlowError]:
    """Return the map's errors: one for each channel, or those of the last scans.

    Parameters
    ----------
    error : MapError
    of_channel : (C,) array
        Variances in units of that of `error`.
    share : (S,) array
        1-sigma at each scan in units of that of `error`.
    steps : MapSteps or None
        How the errors go on where they do not do so independently in each channel.
    """
    if steps is None:
        length = error.correlation_length
        sigmas = error.sigma * np.sqrt(of_channel)
        return [
            SlowError.of("map", sigma, share[:, None] * one, length=length)
            for sigma, one in zip(sigmas.tolist(), np.eye(len(of_channel)), strict=True)
        ]
    # known by nothing before the first scan
    return [SlowError.of("map", 0.0, share[:, None] * one) for one in steps.by]


def map_steps(
    components: tuple[str, ...] | None,
    error: MapError,
    trajectory: Trajectory,
    scans: Integers,
    turn: Array,
) -> MapSteps | None:
    """Return how map errors of one potential go on from scan to scan together; None where they are
    independent Gauss-Markov processes (docs/mathematics.md, section 11.1).

    Parameters
    ----------
    components : tuple of str or None
        Of the gradient, whose maps' errors are those of one potential; None = they are not.
    error : MapError
        Of each component.
    trajectory : Trajectory
    scans : (S,) array of int
        Of each scan in the trajectory.
    turn : (C, C) array
        Its columns are the channels, by the components.
    """
    sigma, length = error.sigma, error.correlation_length
    if components is None or sigma == 0.0:
        return None
    latitude, longitude = trajectory.latitude[scans], np.unwrap(trajectory.longitude[scans])
    metres = np.stack(metres_per_radian(0.5 * (latitude[1:] + latitude[:-1])), axis=1)
    moved = np.stack([np.diff(latitude), np.diff(longitude)], axis=1) * metres
    first = moved[:1] if len(moved) else np.full((1, 2), length)
    moved, before = np.concatenate([first, moved]), np.tile(first, (_BEFORE, 1))
    chain = Chain(_BEFORE, np.zeros((len(components), 2)), components)
    _, step, joined = chained(chain, moved, before, np.array([length]), True)
    by = sigma * np.sqrt(shares(components))[:, None] * turn
    older = np.zeros(((_BEFORE - 1) * len(components), len(components)))  # in no reading
    return MapSteps(step[0], joined[0], np.concatenate([by, older]))
