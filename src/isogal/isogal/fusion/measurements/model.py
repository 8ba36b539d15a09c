"""A measurement, what became of it, and the update with one that is linear in the error state."""

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple, Protocol

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.fusion.clone import inform_clone
from isogal.fusion.model import FilterModel
from isogal.fusion.nominal import move
from isogal.fusion.state import FilterState
from isogal.inertial.rotations import cross_matrix
from isogal.matrices import inverse_of_lower, lower, product

NOTHING = np.full(2, np.nan)
LEAST_WHITE = 0.1
"""Share of a stated variance that is taken as white noise at least, however much of it changes
slowly: an aid whose whole error is smaller than the scenario's slow part is still not exact."""


class Outcome(Enum):
    """What became of a measurement."""

    USED = "used"
    REJECTED = "rejected"
    """It is beyond the gate: so far from what was expected that it cannot be right."""
    UNTRUSTED = "untrusted"
    """It was not used because it, or the navigator, has been contradicted by others."""
    REFUSED = "refused"
    """It cannot be used: its time or its numbers are not possible."""


@dataclass(slots=True, eq=False)
class Innovation:
    """What a measurement said that was not expected, and what became of it."""

    outcome: Outcome
    innovation: Array = field(default_factory=NOTHING.copy)
    """(m,) measured minus expected."""
    nis: float = np.nan
    """Normalised innovation squared; of information beyond the gate a lower bound of it."""
    allowed: float = np.inf
    """The largest that is used (`FilterModel.gate`)."""
    expected: Array = field(default_factory=NOTHING.copy)
    """(m,) what the navigator expected, in the measured axes."""
    reason: str | None = None
    """Why it was not used, in one line; None = it was."""
    log_likelihood: float = 0.0
    """Log density of the measurement over the state as it was before, but for what is the same for
    all states."""

    @property
    def used(self) -> bool:
        """Whether it was used."""
        return self.outcome is Outcome.USED

    @property
    def measured(self) -> Array:
        """(m,) what was measured."""
        return self.expected + self.innovation

    @classmethod
    def of(
        cls, innovation: Array, nis: float, allowed: float, expected: Array | None = None
    ) -> "Innovation":
        """Return that of a measurement which is used if it is within the gate.

        Parameters
        ----------
        innovation : (m,) array
        nis, allowed : float
            Normalised innovation squared, and the largest that is used.
        expected : (m,) array, optional
            Default: zeros.
        """
        expected = np.zeros(len(innovation)) if expected is None else expected
        if nis <= allowed:
            return cls(Outcome.USED, innovation, nis, allowed, expected)
        reason = f"normalised innovation squared {nis:.1f}, allowed {allowed:.1f}"
        return cls(Outcome.REJECTED, innovation, nis, allowed, expected, reason)

    @classmethod
    def refused(cls, reason: str) -> "Innovation":
        """Return that of a measurement that cannot be used."""
        return cls(Outcome.REFUSED, reason=reason)

    def far_away(self) -> "Innovation":
        """Say of a position that was rejected how far it is from the estimate; return itself."""
        if self.outcome is not Outcome.REJECTED:
            return self
        away = float(np.hypot(*self.innovation[:2]))
        distance = f"{away:.0f} m" if away < 1e4 else f"{away / 1e3:.1f} km"
        self.reason = f"{distance} from the estimate: {self.reason}"
        return self


class Measurement(Protocol):
    """What changes a state at one time."""

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """Update a state, in place, unless the measurement is beyond the gate.

        Raises
        ------
        ValueError
            It cannot be used: not finite, or its covariance is none. The state is as it was.
        """
        ...


class Rows(NamedTuple):
    """A measurement that is linear in the error state."""

    measured: Array
    """(m,) z."""
    expected: Array
    """(m,) h(state)."""
    H: Array
    """(m, 15 + M)."""
    R: Array
    """(m, m)."""
    over_ground: bool = False
    """Whether they are of the velocity in the navigation frame (`moved`)."""


class LinearMeasurement:
    """A measurement that is used by its rows: that of an aid, in the filter and in the bound."""

    __slots__ = ()

    def rows(self, state: FilterState, model: FilterModel) -> Rows:
        """Return it linearised at a state."""
        raise NotImplementedError

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `Measurement`."""
        return update_linear(state, model, self.rows(state, model))


def update_linear(state: FilterState, model: FilterModel, rows: Rows) -> Innovation:
    """Update a state with rows, in place, unless they are beyond the gate; see
    `Measurement.update`."""
    innovation = rows.measured - rows.expected
    if not np.isfinite(innovation).all():
        raise ValueError("measurement is not finite")
    R = 0.5 * (rows.R + rows.R.T)
    nis, correction, reduced, log_size = _posterior(state.covariance, rows.H, R, innovation)
    if not np.isfinite(nis):
        raise ValueError("covariance of the measurement is not positive definite")
    result = Innovation.of(innovation, nis, model.gate(len(innovation)), rows.expected)
    result.log_likelihood = -0.5 * (nis + log_size)
    if result.used:
        moved(state, model, reduced, correction, rows.over_ground)
    return result


def moved(
    state: FilterState,
    model: FilterModel,
    covariance: Array,
    correction: Array,
    over_ground: bool = False,
) -> None:
    """Move a state by a correction (N,), in place, and tell its clone; the covariance (N, N) is
    that of the errors from where it was.

    A navigator whose attitude is wrong by psi has a velocity that is wrong by psi x v: it takes
    what it measures in body axes for what it is in others. Once the velocity has been corrected
    from v to v', the same attitude error is one of psi x v', so that the error from there is dv -
    psi x (v' - v). Without that, each correction of the velocity would seem to measure the
    heading, of which an odometer knows nothing (docs/mathematics.md, section 3.17; Barrau &
    Bonnabel 2017, IEEE TAC 62:1797, for errors by which this need not be said). A velocity that
    was measured over ground is not wrong with the attitude."""
    before, clone = state.velocity.copy(), state.clone
    if len(clone.shift):
        inform_clone(clone, state.covariance, covariance, correction)
    state.covariance[:] = covariance
    move(state.nominal, correction)
    if over_ground or not model.unsure_heading:  # it would change the sixth digit
        return
    turn, P = cross_matrix(state.velocity - before), state.covariance
    P[3:6] -= turn @ P[6:9]
    P[:, 3:6] -= P[:, 6:9] @ turn.T
    clone.cross[:, 3:6] -= clone.cross[:, 6:9] @ turn.T


def stated(assumed: Array, covariance: Array | None) -> Array:
    """Return the covariance (n, n) of a reading's noise: what its message states, and what the
    scenario assumes where that is nothing (a variance that is not positive)."""
    result = np.array(assumed)
    if covariance is not None:
        known = np.flatnonzero(np.diag(covariance) > 0.0)
        result[np.ix_(known, known)] = np.asarray(covariance)[np.ix_(known, known)]
    return result


def white_part(stated: Array, slow: Array) -> Array:
    """Return the covariance (n, n) of white noise in a stated one of the whole error, of which
    variances (n,) are those of an error that changes slowly."""
    rest = np.asarray(stated) - np.diag(slow)
    rest[np.diag_indices(len(rest))] = np.maximum(np.diag(rest), LEAST_WHITE * np.diag(stated))
    return np.asarray(rest)


@kernel(error_model="numpy")
def _posterior(
    P: Array, H: Array, R: Array, innovation: Array
) -> tuple[float, Array, Array, float]:
    """Return the normalised innovation squared of rows, NaN where R or the innovation's covariance
    S is not positive definite, the correction (N,) and the covariance (N, N) after them, and log
    |S|: with S = H P H' + R = L L' and G = L^-1 H P, the first three are |L^-1 innovation|²,
    G' L^-1 innovation and P - G' G."""
    rows, size = H.shape
    by_state = product(H, P)
    S = product(by_state, H.T)
    for a in range(rows):
        for b in range(rows):
            S[a, b] += R[a, b]
    inverse = inverse_of_lower(lower(S))
    gain = product(inverse, by_state)
    nis, log_size = 0.0 * lower(R)[0, 0], 0.0
    correction, reduced = np.zeros(size), P.copy()
    for a in range(rows):
        scaled = 0.0
        for b in range(a + 1):
            scaled += inverse[a, b] * innovation[b]
        nis += scaled * scaled
        log_size -= 2.0 * math.log(inverse[a, a])
        for i in range(size):
            correction[i] += gain[a, i] * scaled
            for j in range(i + 1):
                reduced[i, j] -= gain[a, i] * gain[a, j]
    for i in range(size):
        for j in range(i):
            reduced[j, i] = reduced[i, j]
    return nis, correction, reduced, log_size
