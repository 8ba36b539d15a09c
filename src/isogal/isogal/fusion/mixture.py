"""What a navigator knows while it is open what has happened: one state, or several of which one is
true, each with a probability.

A measurement changes every state and, by how well each had foretold it, their probabilities; a
state that has become improbable is dropped (static multiple-model estimator: Bar-Shalom, Li &
Kirubarajan 2001, section 11.6.2). To others the navigator says the mean of all, and a covariance
that covers the most uncertain of those that are not improbable: a Gaussian with the covariance of
the mixture would call the place of a state with a probability of 0.1 impossible, and the map would
not be searched there."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.fusion.clone import Clone
from isogal.fusion.measurements import InformationUpdate, Innovation, Measurement, Outcome
from isogal.fusion.model import FilterModel
from isogal.fusion.nominal import error_between, move
from isogal.fusion.state import FilterState

DROPPED = 1e-3
"""Probability below which a state is dropped."""
COVERED = 1e-2
"""Probability above which a state is covered by what is said to others."""


@dataclass(slots=True, eq=False)
class Mixture:
    """States of one navigator, of which one is true."""

    states: list[FilterState]
    log_weights: Array
    """(B,) log probabilities."""

    @classmethod
    def of(cls, state: FilterState) -> "Mixture":
        """Return one state, which is shared."""
        return cls([state], np.zeros(1))

    def copy(self) -> "Mixture":
        """Return a mixture that shares nothing with this one."""
        return Mixture([state.copy() for state in self.states], self.log_weights.copy())

    def divided(self, log_probabilities: Sequence[float]) -> "Mixture":
        """Return one of several things having happened to the navigator, by their log
        probabilities; the states are still the same."""
        states = [self.merged.copy() for _ in log_probabilities]
        return Mixture(states, np.array(log_probabilities))

    @property
    def merged(self) -> FilterState:
        """One state for others, see the module; shared where there is one."""
        if len(self.states) == 1:
            return self.states[0]
        one, weights, about = self._about_the_mean()
        if weights.max() < 1.0 - COVERED:
            spread = [P[0, 0] + P[1, 1] for P, _ in about]
            P, one.clone = about[int(np.argmax(np.where(weights > COVERED, spread, 0.0)))]
            one.covariance[:] = P
        return one

    @property
    def moments(self) -> FilterState:
        """One state with the mean and the covariance of all."""
        return self._about_the_mean()[0]

    def _about_the_mean(self) -> tuple[FilterState, Array, list[tuple[Array, Clone]]]:
        """Return `moments`, and of each state the probability and the second moments about that
        mean: (N, N), and those of its clone."""
        weights = np.exp(self.log_weights - np.logaddexp.reduce(self.log_weights))
        one = self.states[int(np.argmax(weights))].copy()
        apart = np.array([error_between(state.nominal, one.nominal) for state in self.states])
        mean, then = weights @ apart, weights @ [state.clone.shift for state in self.states]
        about = [
            (state.covariance + np.outer(by, by), state.clone.about(by, then))
            for state, by in zip(self.states, apart - mean, strict=True)
        ]
        covariances, clones = zip(*about, strict=True)
        one.covariance[:] = np.tensordot(weights, covariances, 1)
        one.clone = Clone(*(np.tensordot(weights, part, 1) for part in zip(*clones, strict=True)))
        move(one.nominal, mean)
        return one, weights, about

    def update(self, measurement: Measurement, model: FilterModel) -> Innovation:
        """Update all states in place, and drop what has become improbable; return what became of
        the measurement in the most probable state that it was used in.

        Raises
        ------
        ValueError
            No state can be updated.
        """
        if len(self.states) == 1:
            return measurement.update(self.states[0], model)
        if isinstance(measurement, InformationUpdate):
            one = self.merged
            measurement.relative_to = measurement.relative_to or one.estimate
            sigma = np.sqrt(np.diag(one.batch_prior)[: len(measurement.vector)])
            measurement = measurement.of_one_sign(sigma)
        results: list[Innovation | None] = []
        refused = ValueError("no state can be updated")
        for state in self.states:
            try:
                results.append(measurement.update(state, model))
            except ValueError as error:
                refused = error
                results.append(None)
        found = [one for one in results if one is not None]
        if not found:
            raise refused
        used = [one for one in found if one.outcome is not Outcome.REJECTED]
        if not used:
            return min(found, key=lambda one: one.nis)
        # a state for which a measurement is of no use is neither more nor less probable by it; one
        # that is beyond its gate is not true, since another has foretold it
        best = max(one.log_likelihood for one in used)
        gained = [
            best if one is None else one.log_likelihood if one in used else -math.inf
            for one in results
        ]
        self.log_weights = self.log_weights + gained
        self.log_weights -= np.logaddexp.reduce(self.log_weights)
        order = np.argsort(self.log_weights)[::-1]
        answer = next(one for k in order if (one := results[k]) is not None and one in used)
        kept = np.flatnonzero(self.log_weights > math.log(DROPPED))
        self.states, self.log_weights = [self.states[k] for k in kept], self.log_weights[kept]
        return answer
