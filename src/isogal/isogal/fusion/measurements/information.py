"""What a batch of readings says, in information form (docs/mathematics.md, section 3.6):

    log p(readings | x) = b' x - x' A x / 2

of the navigator's error x at the batch end, in a batch's states (`isogal.inertial.error_state`),
n = 7, or position and velocity, n = 4. Where A is negative the estimate becomes less certain, by a
factor of four in variance at most."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.fusion.measurements.model import Innovation, moved
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import BATCH, Estimate, batch_difference
from isogal.matrices import symmetric

LEAST_INFORMATION = -4.0
"""Least eigenvalue of a likelihood's information, in units of the navigator's own, that is
accepted. A posterior has at most all of its prior's information less, -1; more than that is
possible where the navigator has become less certain since the batch was matched."""
LEAST_APPLIED = -0.75
"""Least eigenvalue that is applied: no variance becomes more than four times as large."""


@dataclass(slots=True, eq=False)
class InformationUpdate:
    """A likelihood in information form.

    Where the navigator's estimate is another than the one that the error is that of, or becomes
    another because an older fix comes later, the information is carried over to it."""

    vector: Array
    """(n,) b."""
    matrix: Array
    """(n, n) A."""
    relative_to: Estimate | None = None
    """The estimate that the error is that of; None = that of the state that it is first applied
    to."""

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`; the innovation is the correction, whose
        square the gate bounds, in the navigator's own sigmas.

        Raises
        ------
        ValueError
            Not finite, or more negative than `LEAST_INFORMATION`.
        """
        if self.relative_to is None:
            self.relative_to = Estimate(*(part.copy() for part in state.estimate))
        apart = batch_difference(state.estimate, self.relative_to)[: len(self.vector)]
        # with x = x_old + apart, b' x_old - x_old' A x_old / 2 has the vector b + A apart
        vector = self.vector + self.matrix @ apart
        if not (np.isfinite(vector).all() and np.isfinite(self.matrix).all()):
            raise ValueError("information is not finite")
        which, gate = BATCH[: len(vector)], model.gate(len(vector))
        P = state.covariance
        # axes A in which the navigator's own information is 1: matrix = A^-T diag(values) A^-1
        scale = np.sqrt(P[which, which])
        own = P[which[:, None], which] / np.outer(scale, scale)
        factor = np.linalg.cholesky(own) * scale[:, None]
        values, turn = np.linalg.eigh(factor.T @ self.matrix @ factor)
        pull = turn.T @ (factor.T @ vector)
        pull[np.abs(values) <= 1e-12 * np.abs(values).max()] = 0.0
        spread = P[:, which] @ np.linalg.solve(factor.T, turn)
        if values[0] < LEAST_INFORMATION:
            raise ValueError("information matrix is too negative")
        applied = np.maximum(values, LEAST_APPLIED)
        size = float(((pull / (1.0 + applied)) ** 2).sum())
        error = -spread @ (pull / (1.0 + applied))  # x is estimate minus truth
        if size > gate:
            return Innovation.of(error[:2], size, gate).far_away()
        reduced = symmetric(P - (spread * (applied / (1.0 + applied))) @ spread.T)
        moved(state, model, reduced, error)
        up = (values > 0.0) & (pull != 0.0)
        nis = float((pull[up] ** 2 / (values[up] * (1.0 + values[up]))).sum())
        result = Innovation.of(error[which][:2], nis, math.inf)
        gained = pull[up] ** 2 / (1.0 + values[up]) - np.log1p(values[up])
        result.log_likelihood = 0.5 * float(gained.sum())
        result.log_likelihood -= float(self.vector @ apart + 0.5 * apart @ self.matrix @ apart)
        return result

    def of_one_sign(self, sigma: Array) -> "InformationUpdate":
        """Return the information without the directions in which A is negative, in units (n,) of
        the states: how probable they make a wide state is an artefact."""
        values, vectors = np.linalg.eigh(self.matrix * sigma * sigma[:, None])
        up = values > 0.0
        kept, across = vectors[:, up] / sigma[:, None], vectors[:, up] * sigma[:, None]
        vector = kept @ (across.T @ self.vector)
        return InformationUpdate(vector, (kept * values[up]) @ kept.T, self.relative_to)
