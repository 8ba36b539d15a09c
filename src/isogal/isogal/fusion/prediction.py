"""Prediction: a state is carried through IMU intervals by the unscented filter
(docs/mathematics.md, section 3.5)."""

import math

import numpy as np

from isogal.arrays import Array
from isogal.fusion import ukf
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.matrices import lower

TRACK_COLUMNS = 13
"""Of a track: position (3; rad, rad, m), velocity (3; NED, m/s), attitude (4; quaternion body to
NED), covariance of the position (north, north-east, east; m²)."""
_LOST = "the filter's covariance is not positive definite"


class FilterDivergenceError(RuntimeError):
    """The covariance lost positive definiteness: the filter's numbers can no longer be trusted."""


def propagate(
    state: FilterState,
    model: FilterModel,
    specific_force: Array,
    angular_rate: Array,
    height: Array,
    dt: float | None = None,
) -> Array:
    """Advance a state and its clone over S intervals, in place; return (S, 13) the track.

    Parameters
    ----------
    state : FilterState
    model : FilterModel
    specific_force, angular_rate : (S, 3) arrays
        Means over each interval, body axes, m/s² and rad/s.
    height : (S,) array
        Known or measured height after each interval, m, NaN = none.
    dt : float, optional
        The interval, s; default: the model's.

    Raises
    ------
    FilterDivergenceError
        The covariance is no longer positive definite, or not finite; it is not repaired.
    """
    assumed = model.assumptions
    if dt is not None and dt != assumed.dt:
        assumed = assumed._replace(dt=dt)
    track = np.empty((len(specific_force), TRACK_COLUMNS))
    force, rate = _in_one_layout(specific_force), _in_one_layout(angular_rate)
    samples = force, rate, _in_one_layout(height)
    if model.filter == "reference":
        from isogal.fusion import reference  # takes some time

        done = reference.advance(state, *samples, assumed, track)
    else:
        mean, known = state.nominal, (state.covariance, state.residual_gravity)
        done = ukf.advance(mean, *known, *samples, assumed, track, state.clone)
    if done < len(track):
        raise FilterDivergenceError(_LOST)
    require_definite(state)
    return track


def require_definite(state: FilterState) -> None:
    """Raise FilterDivergenceError unless the covariance is finite and positive definite."""
    if math.isnan(lower(state.covariance)[0, 0]):
        raise FilterDivergenceError(_LOST)


def _in_one_layout(part: Array) -> Array:
    """Return an array in one memory layout and writable, whatever came: for each other the filter
    would be compiled anew, for ten seconds. `np.require` takes ten times as long."""
    array = np.ascontiguousarray(part, dtype=float)
    return array if array.flags.writeable else array.copy()
