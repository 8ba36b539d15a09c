"""The same filter by filterpy's UnscentedKalmanFilter, some hundred times slower: what the
compiled one is compared with.

filterpy's state x is the error state, relative to a nominal state that goes through the strapdown
beside it: zero before each step, and added to the nominal state after it. `advance` does what
that of `isogal.fusion.ukf` does."""

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

from isogal.arrays import Array
from isogal.fusion.auxiliary import add_input, ageing, readings
from isogal.fusion.clone import Clone, inform_clone
from isogal.fusion.nominal import Nominal, error_between, move
from isogal.fusion.sigma_points import BETA
from isogal.fusion.state import FilterState
from isogal.fusion.ukf import Assumptions
from isogal.inertial.error_state import FILTER_STATES
from isogal.inertial.gravity import horizontal_gravity, misplaced
from isogal.inertial.rotations import matrix
from isogal.inertial.strapdown import step


def advance(
    state: FilterState,
    force: Array,
    rate: Array,
    height: Array,
    assumptions: Assumptions,
    track: Array,
) -> int:
    """Run prediction and the height update over S intervals, in place; return the steps done
    before a failure, as `ukf.advance` does.

    Parameters
    ----------
    state : FilterState
    force, rate : (S, 3) arrays
        Body axes, m/s² and rad/s.
    height : (S,) array
        m, NaN = not known.
    assumptions : Assumptions
    track : (S, 13) array
        Receives the track (`isogal.fusion.prediction.TRACK_COLUMNS`).
    """
    size, done = len(state.covariance), len(force)
    points = MerweScaledSigmaPoints(size, assumptions.alpha, BETA, 0.0)
    unscented = UnscentedKalmanFilter(size, 1, assumptions.dt, hx=None, fx=None, points=points)
    unscented.P, unscented.R = state.covariance.copy(), assumptions.height_sigma**2 * np.eye(1)
    for k, known in enumerate(height):
        try:
            end = _predict(unscented, state, force[k], rate[k], assumptions)
            if assumptions.height_sigma > 0.0 and not np.isnan(known):
                _take_height(unscented, float(known), end, assumptions, state.clone)
        except (np.linalg.LinAlgError, ValueError):  # not positive definite, or not finite
            done = k
            break
        move(end, unscented.x)
        for array, new in zip(state.nominal, end, strict=True):
            array[:] = new
        track[k] = np.concatenate([*end[:3], unscented.P[:2, :2].ravel()[[0, 1, 3]]])
    state.covariance[:] = 0.5 * (unscented.P + unscented.P.T)
    return done


def _take_height(
    unscented: UnscentedKalmanFilter,
    height: float,
    state: Nominal,
    assumptions: Assumptions,
    clone: Clone,
) -> None:
    """Update with a height (m), unless it is beyond the gate."""
    up, x, P = float(state.position[2]), unscented.x.copy(), unscented.P.copy()
    contents = assumptions.height_offset + assumptions.height_share * up

    def expected(error: Array) -> list[float]:
        return [up - error[2] + float(contents @ (state.auxiliary + error[FILTER_STATES:]))]

    unscented.update([height], hx=expected)
    if float(unscented.y @ unscented.SI @ unscented.y) > assumptions.height_gate:
        unscented.x, unscented.P = x, P
    inform_clone(clone, P, unscented.P, unscented.x - x)


def _predict(
    unscented: UnscentedKalmanFilter,
    of: FilterState,
    force: Array,
    rate: Array,
    assumptions: Assumptions,
) -> Nominal:
    """Predict over one interval; return the nominal state at its end, which filterpy's x is
    relative to then."""
    state, clone, dt = of.nominal, of.clone, assumptions.dt
    keep, fresh = np.empty((2, len(state.auxiliary)))
    more = misplaced(assumptions.compensation, 0.5 * float(np.trace(unscented.P[:2, :2])))
    ageing(assumptions.auxiliary, of.residual_gravity, more, state.velocity, dt, keep, fresh)
    # at the nominal place for all points
    gravity = np.array([*horizontal_gravity(assumptions.compensation, state.position), 0.0])

    read = readings(force, rate)

    def after(start: Nominal) -> Nominal:
        """Return the state after one interval of the strapdown."""
        total = np.zeros(9)
        for j, value in enumerate(start.auxiliary):
            add_input(assumptions.auxiliary, j, value, read, total)
        beside = tuple((gravity + total[:3]).tolist())
        felt = tuple((force - start.accelerometer_bias - total[3:6]).tolist())
        turned = tuple((rate - start.gyroscope_bias - total[6:]).tolist())
        latitude, first = start.position[0], (tuple(array.tolist()) for array in start[:3])
        sine, cosine = np.sin(latitude), np.cos(latitude)
        end = step(sine, cosine, *first, felt, turned, beside, dt, assumptions.coning)
        biases = start.accelerometer_bias.copy(), start.gyroscope_bias.copy()
        position, velocity, attitude = (np.array(part) for part in end)
        return Nominal(position, velocity, attitude, *biases, keep * start.auxiliary)

    centre = after(state)

    def process(error: Array, dt: float) -> Array:
        moved = Nominal(*(array.copy() for array in state))
        move(moved, error)
        return error_between(after(moved), centre)

    unscented.x = np.zeros(len(unscented.P))
    axes, noise = matrix(centre.attitude), np.square(assumptions.noise) * dt
    unscented.Q = np.zeros_like(unscented.P)
    unscented.Q[3:6, 3:6] = axes @ np.diag(noise[:3]) @ axes.T
    unscented.Q[6:9, 6:9] = axes @ np.diag(noise[3:]) @ axes.T
    unscented.Q[FILTER_STATES:, FILTER_STATES:] = np.diag(fresh)
    if len(clone.shift):
        before = unscented.points_fn.sigma_points(unscented.x, unscented.P)
        unscented.compute_process_sigmas(dt, process)
        across = (unscented.Wc[:, None] * before).T @ unscented.sigmas_f
        clone.cross[:] = clone.cross @ np.linalg.solve(unscented.P, across)
    unscented.predict(fx=process)
    return centre
