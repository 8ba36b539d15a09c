"""Readings of height and velocity sensors in the filter (docs/mathematics.md, sections 3.11 and
3.12)."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.fusion import velocity_states as names
from isogal.fusion.model import FilterModel
from isogal.fusion.navigator import update_linear
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import FILTER_STATES
from isogal.inertial.rotations import cross_matrix, matrix
from isogal.scenario import Velocity


@dataclass(frozen=True, slots=True, eq=False)
class Innovation:
    """What a reading said that was not expected."""

    accepted: bool
    """Whether it was used; False = so far from what was expected that it cannot be right."""
    nis: float
    """Normalised innovation squared."""
    allowed: float
    """The largest that is used (`isogal.fusion.gate`)."""
    expected: Array
    """(m,) what the navigator expected in the measured axes."""
    measured: Array
    """(m,)."""
    contradicted: bool = False
    """Whether it was not used because fixes have contradicted the navigator."""


def update_height(
    state: FilterState, model: FilterModel, run: int, height: float, variance: float | None = None
) -> Innovation:
    """Update one run with a reading of the height (m), in place.

    Parameters
    ----------
    variance : float, optional
        Of its white noise, m²; None or 0 = as the model has it.

    Raises
    ------
    ValueError
        Not finite.
    """
    reading = model.height_reading
    up = float(state.position[run, 2])
    contents = reading.offset + reading.share * up
    H = np.zeros((1, state.covariance.shape[1]))
    H[0, 2], H[0, FILTER_STATES:] = -1.0, contents
    expected = np.array([up + contents @ state.auxiliary[run]])
    R = np.array([[variance or model.height_sigma**2]])
    return _applied(state, model, run, (H, expected), np.array([height]), R)


def update_velocity(
    state: FilterState,
    model: FilterModel,
    run: int,
    settings: Velocity,
    velocity: Array,
    covariance: Array | None = None,
) -> Innovation | None:
    """Update one run with a reading (3,) of the velocity in body axes (forward, right, down; m/s,
    NaN = not measured), in place; None where it has no number.

    A reading slower than `standstill_speed` means that the vehicle stands still on the ground.
    Others are not used once fixes have contradicted the navigator (`widen`): its own velocity has
    no error that fixes do not correct in time, an aid that is not what it says pulls it away from
    the truth again and again.

    Parameters
    ----------
    covariance : (3, 3) array, optional
        Of its white noise; None, or zero variances = as the settings have it.
    """
    axes = np.flatnonzero(np.isfinite(velocity))
    if axes.size == 0:
        return None
    measured = np.asarray(velocity, dtype=float)[axes]
    if np.linalg.norm(measured) < settings.standstill_speed:
        standing = np.eye(3) * settings.standstill_sigma**2
        H, expected = _at_rest(state, run)
        return _applied(state, model, run, (H, expected), np.zeros(3), standing)
    H, expected = _through(state, model, run)
    if state.contradicted[run]:
        allowed = model.gate(len(axes))
        return Innovation(False, 0.0, allowed, expected[axes], measured, contradicted=True)
    R = np.eye(len(axes)) * settings.number("sigma") ** 2
    if covariance is not None:
        told = np.asarray(covariance)[np.ix_(axes, axes)]
        known = np.flatnonzero(np.diag(told) > 0.0)
        R[np.ix_(known, known)] = told[np.ix_(known, known)]
    return _applied(state, model, run, (H[axes], expected[axes]), measured, R)


def _applied(
    state: FilterState,
    model: FilterModel,
    run: int,
    reading: tuple[Array, Array],
    measured: Array,
    R: Array,
) -> Innovation:
    H, expected = reading
    innovation = measured - expected
    if not np.isfinite(innovation).all():
        raise ValueError("measurement is not finite")
    S = H @ state.covariance[run] @ H.T + R
    nis = float(innovation @ np.linalg.solve(S, innovation))
    allowed = model.gate(len(measured))
    accepted = nis <= allowed
    if accepted:
        update_linear(state, run, H, innovation, R)
    return Innovation(accepted, nis, allowed, expected, measured)


def _at_rest(state: FilterState, run: int) -> tuple[Array, Array]:
    """Return H (3, n) of the velocity to north, east and down, and what it is expected to be."""
    H = np.zeros((3, state.covariance.shape[1]))
    H[:, 3:6] = np.eye(3)
    return H, state.velocity[run].copy()


def _through(state: FilterState, model: FilterModel, run: int) -> tuple[Array, Array]:
    """Return H (3, n) of a velocity aid, and what it is expected to read."""
    values = dict(
        zip([one.name for one in model.auxiliary], state.auxiliary[run].tolist(), strict=True)
    )
    past = state.velocity[run].copy()
    past[:2] -= values.get(names.NORTH, 0.0), values.get(names.EAST, 0.0)
    return velocity_reading(model, matrix(state.attitude[run]), past, values)


def velocity_reading(
    model: FilterModel, rotation: Array, past: Array, values: dict[str, float]
) -> tuple[Array, Array]:
    """Return d(reading)/d(error state) (3, 15 + M) of a velocity aid, and the reading.

    Parameters
    ----------
    rotation : (3, 3) array
        Body to NED.
    past : (3,) array
        Velocity relative to the ground, or to the water or air, NED, m/s.
    values : dict
        Of the auxiliary states, by name; those that are not there are zero.
    """
    body = rotation.T @ past
    mounting = np.array([0.0, values.get(names.PITCH, 0.0), values.get(names.YAW, 0.0)])
    factor = 1.0 + values.get(names.SCALE, 0.0)
    turned = body + np.cross(body, mounting)
    by_body = factor * (np.eye(3) - cross_matrix(mounting))
    by_past = by_body @ rotation.T
    H = np.zeros((3, model.states))
    H[:, 3:6], H[:, 6:9] = by_past, by_past @ cross_matrix(past)
    columns = {
        names.SCALE: turned,
        names.PITCH: factor * np.cross(body, [0.0, 1.0, 0.0]),
        names.YAW: factor * np.cross(body, [0.0, 0.0, 1.0]),
        names.NORTH: -by_past[:, 0],
        names.EAST: -by_past[:, 1],
    }
    for j, one in enumerate(model.auxiliary):
        if one.name in columns:
            H[:, FILTER_STATES + j] = columns[one.name]
    return H, factor * turned
