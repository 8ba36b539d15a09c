"""The navigator: prediction and updates of the unscented filter, for many runs at once
(docs/mathematics.md, sections 3.5 and 3.6)."""

import math
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.fusion import ukf
from isogal.fusion.gate import RejectedError
from isogal.fusion.model import FilterModel
from isogal.fusion.nominal import move
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import BATCH
from isogal.matrices import eigen, inverse_of_lower, lower, product

LEAST_INFORMATION = -4.0
"""Least eigenvalue of a likelihood's information, in units of the navigator's own, that is
accepted. A posterior has at most all of its prior's information less, -1; more than that is
possible where the navigator has become less certain since the batch was matched."""
LEAST_APPLIED = -0.75
"""Least eigenvalue that is applied: no variance becomes more than four times as large."""


class FilterDivergenceError(RuntimeError):
    """The covariance lost positive definiteness: the filter's numbers can no longer be trusted."""


def _reference() -> ModuleType:
    """Return `isogal.fusion.reference`, which takes some time to import."""
    from isogal.fusion import reference

    return reference


def propagate(
    state: FilterState,
    model: FilterModel,
    specific_force: Array,
    angular_rate: Array,
    height: Array,
) -> None:
    """Advance all runs over S intervals, in place.

    Parameters
    ----------
    specific_force, angular_rate : (R, S, 3) arrays
        Means over each interval, body axes.
    height : (S,) or (R, S) array
        Known or measured height after each interval, m, NaN = none (used while model.height_sigma
        > 0).

    Raises
    ------
    FilterDivergenceError
        A covariance is no longer positive definite; it is not repaired.
    """
    advance = _reference().advance if model.filter == "reference" else ukf.advance
    # In one memory layout, whatever came: the filter is compiled anew for each, for ten seconds.
    height = np.array(np.broadcast_to(height, specific_force.shape[:2]), dtype=float, order="C")
    force, rate = np.ascontiguousarray(specific_force), np.ascontiguousarray(angular_rate)
    samples = force, rate, height
    done = advance(
        state.nominal, state.covariance, state.residual_gravity, *samples, model.assumptions
    )
    steps = specific_force.shape[1]
    failed = [run for run, reached in enumerate(done.tolist()) if reached < steps]
    if failed:
        raise FilterDivergenceError(f"covariance of run(s) {failed} is not positive definite")


def update_information(
    state: FilterState, run: int, vector: Array, matrix: Array, gate: float = math.inf
) -> tuple[Array, float]:
    """Update one run with the likelihood of its error in information form, in place
    (docs/mathematics.md, section 3.6).

    Parameters
    ----------
    vector, matrix : (n,), (n, n) arrays
        log p = vector' x - x' matrix x / 2 of the error x in a batch's states, n = 7, or its
        position and velocity, n = 4. Where the matrix is negative the estimate becomes less
        certain, by a factor of four in variance at most.
    gate : float
        The largest squared correction, in the navigator's own sigmas, that is made
        (`FilterModel.gate` of n dimensions).

    Returns
    -------
    correction : (n,) array
        Change of the estimate.
    nis : float
        Normalised innovation squared, of the directions in which the matrix is positive.

    Raises
    ------
    ValueError
        Not finite, or more negative than `LEAST_INFORMATION`; the state is as it was.
    RejectedError
        It is beyond the gate; likewise.
    """
    if not (np.isfinite(vector).all() and np.isfinite(matrix).all()):
        raise ValueError("information is not finite")
    P, which = state.covariance[run], BATCH[: len(vector)]
    error, reduced, values, told = _informed(
        P, which, np.ascontiguousarray(vector), np.ascontiguousarray(matrix)
    )
    if not np.isfinite(values[0]):
        raise np.linalg.LinAlgError("Matrix is not positive definite")
    if values[0] < LEAST_INFORMATION:
        raise ValueError("information matrix is too negative")
    size = float(((told / (1.0 + np.maximum(values, LEAST_APPLIED))) ** 2).sum())
    if size > gate:
        raise RejectedError(error[:2], size, gate)
    state.covariance[run] = reduced
    move(state.nominal_of(run), error)
    up = (values > 0.0) & (told != 0.0)
    return error[which], float((told[up] ** 2 / (values[up] * (1.0 + values[up]))).sum())


@kernel
def _informed(P, which, vector, matrix):  # type: ignore[no-untyped-def]
    """Return what `update_information` adds to the state (N,), the covariance (N, N) after it, and
    in the directions in which the navigator's own information is 1 that of the measurements, in
    rising order, and their vector, (n,) each. NaN where P is not positive definite."""
    n, size = vector.shape[0], P.shape[0]
    scale, scaled = np.empty(n), np.empty((n, n))
    for i in range(n):
        scale[i] = math.sqrt(P[which[i], which[i]])
    for i in range(n):
        for j in range(n):
            scaled[i, j] = P[which[i], which[j]] / (scale[i] * scale[j])
    factor = lower(scaled)
    for i in range(n):
        for j in range(n):
            factor[i, j] *= scale[i]
    # columns A of these directions: matrix = A diag(values) A', A' own A = 1
    values, turn = eigen(product(product(factor.T, matrix), factor))
    back = inverse_of_lower(factor)
    largest = max(abs(values[0]), abs(values[n - 1]))
    told, spread = np.zeros(n), np.zeros((size, n))
    error, reduced = np.zeros(size), P.copy()
    for k in range(n):
        if abs(values[k]) > 1e-12 * largest:
            for i in range(n):
                for j in range(n):
                    told[k] += turn[j, k] * factor[i, j] * vector[i]
        for i in range(n):
            along = 0.0
            for j in range(n):
                along += back[j, i] * turn[j, k]
            for s in range(size):
                spread[s, k] += P[s, which[i]] * along
        applied = max(values[k], LEAST_APPLIED)
        for s in range(size):
            error[s] -= spread[s, k] * told[k] / (1.0 + applied)  # x is estimate minus truth
            for t in range(s + 1):
                reduced[s, t] -= spread[s, k] * spread[t, k] * applied / (1.0 + applied)
    for s in range(size):
        for t in range(s):
            reduced[t, s] = reduced[s, t]
    return error, reduced, values, told


def update_linear(
    state: FilterState, run: int, H: Array, innovation: Array, R: Array
) -> tuple[Array, float]:
    """Update one run with a measurement that is linear in its error state, in place: z = h(x) + v,
    where h changes by H xi if the state moves by the error state xi.

    Parameters
    ----------
    H : (m, 15 + M) array
    innovation : (m,) array
        Measured minus predicted.
    R : (m, m) array
        Covariance of v.

    Returns
    -------
    correction : (15 + M,) array
        By which the state was moved.
    nis : float
        Normalised innovation squared.

    Raises
    ------
    ValueError
        Not finite, or the innovation's covariance is not positive definite; the state is as it
        was.
    """
    if not (np.isfinite(innovation).all() and np.isfinite(H).all() and np.isfinite(R).all()):
        raise ValueError("measurement is not finite")
    P = state.covariance[run]
    cross = P @ H.T
    S = H @ cross + 0.5 * (R + R.T)
    try:
        np.linalg.cholesky(0.5 * (R + R.T))
        np.linalg.cholesky(S)
    except np.linalg.LinAlgError:
        raise ValueError("covariance of the measurement is not positive definite") from None
    solved = np.linalg.solve(S, np.column_stack([innovation, cross.T]))
    correction = cross @ solved[:, 0]
    reduced = P - cross @ solved[:, 1:]
    state.covariance[run] = 0.5 * (reduced + reduced.T)
    move(state.nominal_of(run), correction)
    return correction, float(innovation @ solved[:, 0])


def update_position(
    state: FilterState,
    model: FilterModel,
    run: int,
    latitude: float,
    longitude: float,
    covariance: Array,
) -> tuple[Array, float]:
    """Update one run with a horizontal fix, in place.

    Parameters
    ----------
    latitude, longitude : float
        Fix, rad.
    covariance : (2, 2) array
        Of the fix, north-east, m².

    Returns
    -------
    innovation : (2,) array
        Fix minus prediction, north, east, m.
    nis : float
        Normalised innovation squared.

    Raises
    ------
    ValueError
        The fix is not finite or its covariance not positive definite; the state is as it was.
    RejectedError
        It is beyond the gate; likewise.
    """
    if not (
        math.isfinite(latitude) and math.isfinite(longitude) and np.isfinite(covariance).all()
    ):
        raise ValueError("fix is not finite")
    if not (
        covariance[0, 0] > 0.0
        and covariance[0, 0] * covariance[1, 1] > covariance[0, 1] * covariance[1, 0]
    ):
        raise ValueError("covariance of the fix is not positive definite")
    update = _reference().update_position if model.filter == "reference" else ukf.update_position
    north, east, nis = update(
        state.nominal_of(run),
        state.covariance[run],
        latitude,
        longitude,
        covariance,
        model.assumptions,
    )
    if math.isnan(nis):
        raise ValueError("innovation covariance is not positive definite")
    innovation, allowed = np.array([north, east]), model.gate(2)
    if nis > allowed:
        raise RejectedError(innovation, nis, allowed)
    return innovation, nis


def widen(state: FilterState, run: int, covariance: Array) -> None:
    """Add a covariance (7, 7) to that of one run's batch states, in place: the navigator was found
    lost, or not to be what it says. From then on its velocity aid is not used."""
    state.contradicted[run] = 1.0
    state.covariance[run][np.ix_(BATCH, BATCH)] += covariance


def assume_map_error(
    state: FilterState, model: FilterModel, run: int, sigma: float, length: float
) -> None:
    """Let one run take the gravity map for wrong by a 1-sigma (m/s²) over a correlation length
    (m), in place: so much of horizontal gravity is not taken off.

    Raises
    ------
    ValueError
        One of them is not positive and finite; the state is as it was.
    """
    if not (0.0 < sigma < math.inf and 0.0 < length < math.inf):
        raise ValueError("map error is not positive and finite")
    residual = model.gravity.residual
    if residual is not None:
        state.residual_gravity[run] = residual.given(sigma, length)


@dataclass(frozen=True, slots=True, eq=False)
class NavigatorRun:
    """One of the runs of a state (a `isogal.fix.FixTarget`)."""

    state: FilterState
    model: FilterModel
    run: int

    def assume_map_error(self, sigma: float, length: float) -> None:
        """See `assume_map_error`."""
        assume_map_error(self.state, self.model, self.run, sigma, length)

    def widen(self, covariance: Array) -> None:
        """See `widen`."""
        widen(self.state, self.run, covariance)

    def update_information(self, vector: Array, matrix: Array) -> tuple[Array, float]:
        """See `update_information`."""
        gate = self.model.gate(len(vector))
        return update_information(self.state, self.run, vector, matrix, gate)

    def update_position(
        self, latitude: float, longitude: float, covariance: Array
    ) -> tuple[Array, float]:
        """See `update_position`."""
        return update_position(self.state, self.model, self.run, latitude, longitude, covariance)
