"""What a navigator believes while it does not know what happened: one state, or several of which
one is true, each with a probability.

A fix changes every state and, by how well each had foretold it, their probabilities; a state that
has become improbable is dropped (static multiple-model estimator: Bar-Shalom, Li & Kirubarajan
2001, section 11.6.2). To others the navigator says the mean of all, and a covariance that covers
the most uncertain of those that are not improbable: a Gaussian with the covariance of the mixture
would call the place of a state with a probability of 0.1 impossible, and the map would not be
searched there."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fusion.gate import RejectedError
from isogal.fusion.navigator import update_information
from isogal.fusion.nominal import move
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate, batch_difference
from isogal.inertial.rotations import multiply, to_rotation_vector

DROPPED = 1e-3
"""Probability below which a state is dropped."""
COVERED = 1e-2
"""Probability above which a state is covered by what is said to others."""

Update = Callable[[FilterState], tuple[Array, float]]
"""Changes a state of one run in place; returns (innovation, normalised innovation squared); raises
ValueError where it cannot be used."""


@dataclass(frozen=True, slots=True, eq=False)
class UpdateResult:
    """What became of a fix."""

    accepted: bool
    reason: str | None
    """Why it was not accepted; None = accepted."""
    innovation: Array
    """(2,) m, north, east, at the fix's stamp."""
    nis: float
    """Normalised innovation squared."""
    late: float
    """s, age of the fix when it came."""
    rejected: bool = False
    """Whether it was not accepted because it is beyond the gate (`isogal.fusion.gate`)."""

    @classmethod
    def refused(cls, reason: str, late: float) -> "UpdateResult":
        """Return that of a fix that cannot be used."""
        return cls(False, reason, np.full(2, np.nan), np.nan, late)


@dataclass(slots=True, eq=False)
class InformationUpdate:
    """A likelihood in information form (`isogal.fusion.navigator.update_information`)."""

    vector: Array
    """(n,)."""
    matrix: Array
    """(n, n)."""
    relative_to: Estimate | None
    """The estimate that the error is that of; None = that of the first state it is applied to."""
    gate: float = math.inf
    """See `isogal.fusion.navigator.update_information`."""

    def __call__(self, state: FilterState) -> tuple[Array, float]:
        """See `Update`."""
        # with x = x_old + moved, v' x_old - x_old' M x_old / 2 has the vector v + M moved
        vector = self.vector + self.matrix @ self._moved(state)
        correction, nis = update_information(state, 0, vector, self.matrix, self.gate)
        return correction[:2], nis

    def log_evidence(self, state: FilterState) -> float:
        """Return the log of the mean of the likelihood over a state, which is not changed."""
        n = len(self.vector)
        moved, covariance = self._moved(state), state.batch_prior[0, :n, :n]
        vector = self.vector + self.matrix @ moved
        wider = np.eye(n) + covariance @ self.matrix
        sign, log_size = np.linalg.slogdet(wider)
        if sign <= 0.0:
            return -math.inf
        gained = float(vector @ np.linalg.solve(wider, covariance @ vector))
        before = float(self.vector @ moved + 0.5 * moved @ self.matrix @ moved)
        return 0.5 * (gained - float(log_size)) - before

    def of_one_sign(self, scale: Array) -> "InformationUpdate":
        """Return the update without the directions in which the matrix is negative, in units
        (n,) of the states: how probable they make a wide state is an artefact."""
        values, vectors = np.linalg.eigh(self.matrix * scale * scale[:, None])
        kept = vectors[:, values > 0.0] / scale[:, None]
        across = vectors[:, values > 0.0] * scale[:, None]
        matrix = (kept * values[values > 0.0]) @ kept.T
        vector = kept @ (across.T @ self.vector)
        return InformationUpdate(vector, matrix, self.relative_to, self.gate)

    def _moved(self, state: FilterState) -> Array:
        estimate = state.estimate_of(0)
        if self.relative_to is None:
            self.relative_to = Estimate(*(part.copy() for part in estimate))
            return np.zeros(len(self.vector))
        return batch_difference(estimate, self.relative_to)[: len(self.vector)]


@dataclass(slots=True, eq=False)
class Belief:
    """States, as the runs of a `FilterState`, and their log probabilities (B,)."""

    state: FilterState
    log_weight: Array

    @classmethod
    def sure(cls, state: FilterState) -> "Belief":
        """Return the belief in one state; it is shared."""
        return cls(state, np.zeros(1))

    def __len__(self) -> int:
        return len(self.state)

    def copy(self) -> "Belief":
        """Return a belief that shares nothing with this one."""
        return Belief(self.state.copy(), self.log_weight.copy())

    @property
    def merged(self) -> FilterState:
        """One state for others (one run), see the module; shared where there is one."""
        if len(self) == 1:
            return self.state
        weight = np.exp(self.log_weight - np.logaddexp.reduce(self.log_weight))
        first = self._only(slice(0, 1)).copy()
        apart = np.array([_error_between(self.state, first, row) for row in range(len(self))])
        mean = weight @ apart
        away = apart - mean
        about = self.state.covariance + away[:, :, None] * away[:, None, :]
        widest = int(np.argmax(np.where(weight > COVERED, about[:, 0, 0] + about[:, 1, 1], 0.0)))
        mixed = np.einsum("b,bij->ij", weight, about)
        first.covariance[0] = about[widest] if weight.max() < 1.0 - COVERED else mixed
        move(first.nominal_of(0), mean)
        return first

    def each(self) -> list[FilterState]:
        """Return the states one by one; they share the arrays."""
        return [self._only(slice(row, row + 1)) for row in range(len(self))]

    def divided(self, log_probability: Sequence[float]) -> "Belief":
        """Return the belief that one of several things has happened to the navigator, by their
        log probabilities; the states are still the same."""
        one, count = self.merged, len(log_probability)
        arrays = (np.repeat(array, count, axis=0) for array in one.arrays())
        return Belief(FilterState(*arrays), np.array(log_probability))

    def apply(self, update: Update) -> tuple[Array, float]:
        """Update all states in place, and drop what has become improbable; return the innovation
        and its normalised square, of the most probable state.

        Raises
        ------
        ValueError
            No state can be updated.
        RejectedError
            It is beyond the gate of all that can; nothing is changed.
        """
        if len(self) == 1:
            return update(self.state)
        if isinstance(update, InformationUpdate):
            one = self.merged
            update.relative_to = update.relative_to or one.estimate_of(0)
            scale = np.sqrt(np.diag(one.batch_prior[0])[: len(update.vector)])
            update = update.of_one_sign(scale)
        found: list[tuple[Array, float] | None] = []
        evidence = np.full(len(self), -math.inf)
        refused: ValueError | None = None
        rejected: dict[int, RejectedError] = {}
        for row, state in enumerate(self.each()):
            try:
                evidence[row], result = _updated(state, update)
                found.append(result)
            except RejectedError as error:
                rejected[row] = error
                found.append(None)
            except ValueError as error:
                refused = error
                found.append(None)
        if not any(found):
            if rejected:
                raise min(rejected.values(), key=lambda error: error.nis)
            if refused is not None:
                raise refused
        # a state for which a fix is of no use is neither more nor less probable by it
        evidence[[result is None for result in found]] = evidence.max()
        evidence[list(rejected)] = -math.inf  # another foretold the fix: this one is not true
        self.log_weight = self.log_weight + evidence
        self.log_weight -= np.logaddexp.reduce(self.log_weight)
        best = max(
            (row for row, result in enumerate(found) if result is not None),
            key=lambda row: float(self.log_weight[row]),
        )
        answer = found[best]
        assert answer is not None
        self._keep(self.log_weight > math.log(DROPPED))
        return answer

    def _only(self, rows: slice) -> FilterState:
        return FilterState(*(array[rows] for array in self.state.arrays()))

    def _keep(self, rows: Booleans) -> None:
        if not rows.all():
            self.state = FilterState(*(array[rows].copy() for array in self.state.arrays()))
            self.log_weight = self.log_weight[rows]


def _updated(state: FilterState, update: Update) -> tuple[float, tuple[Array, float]]:
    """Update a state in place; return the log evidence, but for what is the same for all states,
    and what the update returns."""
    if isinstance(update, InformationUpdate):
        evidence = update.log_evidence(state)
        return evidence, update(state)
    before = float(np.linalg.slogdet(state.covariance[0])[1])
    result = update(state)
    # |S| / |R| = |P before| / |P after|
    after = float(np.linalg.slogdet(state.covariance[0])[1])
    return 0.5 * (after - before - result[1]), result


def _error_between(states: FilterState, origin: FilterState, row: int) -> Array:
    """Return the error state (15 + M,) that moves the state of one run to one of several."""
    latitude, _, height = origin.position[0]
    metres = np.array([*metres_per_radian(latitude, height), -1.0])
    w, x, y, z = origin.attitude[0]
    turn = to_rotation_vector(*multiply(*states.attitude[row], w, -x, -y, -z))
    return np.concatenate(
        [
            (states.position[row] - origin.position[0]) * metres,
            states.velocity[row] - origin.velocity[0],
            turn,
            states.accelerometer_bias[row] - origin.accelerometer_bias[0],
            states.gyroscope_bias[row] - origin.gyroscope_bias[0],
            states.auxiliary[row] - origin.auxiliary[0],
        ]
    )
