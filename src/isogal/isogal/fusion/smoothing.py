"""Fixed-interval smoothing: the states of the past, given all that has been measured since.

A pass backwards over a navigator's history (Rauch, Tung & Striebel 1965; docs/mathematics.md,
section 3.18). With m, P the filter's mean and covariance at a time and s, S what is known of then
from all data, d = s - m and D = S - P go backwards over whatever happened by

    d = G d' + b,        D = G D' G' + B,        G = C P'^-1

where a prime marks what is later, and C is the covariance of the error before it with that after
it, b and B what it has told of the error before: all of that is in a clone (`isogal.fusion.clone`)
of the state before.

While it is open what has happened (`isogal.fusion.mixture`), each state has d and D of its own and
a probability, which is that of the end."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.fusion.clone import Clone
from isogal.fusion.mixture import Mixture
from isogal.fusion.model import FilterModel
from isogal.fusion.nominal import error_between, move
from isogal.fusion.outage import HELD, UnknownMotion, grow
from isogal.fusion.prediction import propagate
from isogal.fusion.segment import AT_ONCE, Segment
from isogal.fusion.state import FilterState


@dataclass(frozen=True, slots=True, eq=False)
class Hindsight:
    """What all data say of a state beside what those up to its time said."""

    shift: Array
    """(N,) error state from the filter's mean to the smoothed one."""
    change: Array
    """(N, N) smoothed covariance less the filter's."""
    log_weight: float = 0.0
    """Log probability of the state, where there are several."""

    @classmethod
    def none(cls, states: int, log_weight: float = 0.0) -> "Hindsight":
        """Return that of the newest state."""
        return cls(np.zeros(states), np.zeros((states, states)), log_weight)

    def of(self, state: FilterState) -> FilterState:
        """Return a state as all data have it."""
        found = state.copy()
        move(found.nominal, self.shift)
        found.covariance += self.change
        found.covariance[:] = 0.5 * (found.covariance + found.covariance.T)
        return found


class Way(NamedTuple):
    """From hindsight after something to that before it: d = gain d' + shift, D = gain D' gain' +
    change."""

    gain: Array
    """(N, N)."""
    shift: Array
    change: Array

    @classmethod
    def of(cls, state: FilterState) -> "Way":
        """Return that over all that has happened to a state since its clone was of all its
        errors."""
        scale = np.sqrt(np.diag(state.covariance))
        unit, across = state.covariance / np.outer(scale, scale), state.clone.cross / scale
        return cls(np.linalg.solve(unit, across.T).T / scale, *state.clone[1:])

    def back(self, later: Hindsight) -> Hindsight:
        """Return hindsight before it."""
        change = self.gain @ later.change @ self.gain.T + self.change
        shift = self.gain @ later.shift + self.shift
        return Hindsight(shift, 0.5 * (change + change.T), later.log_weight)


class _Stage(NamedTuple):
    """What happened to the states of a mixture."""

    before: tuple[FilterState, ...]
    each: tuple[tuple[int, Way], ...]
    """Of each state after it: which one it was before, and the way back."""
    merged: FilterState | None = None
    """One state for all of those before it, which the way back leads to; None = they were not
    merged."""

    def back(self, later: Sequence[Hindsight]) -> list[Hindsight]:
        """Return hindsight of each state before it."""
        found: list[list[Hindsight]] = [[] for _ in self.before]
        for (index, way), one in zip(self.each, later, strict=True):
            found[index].append(way.back(one))
        size = len(self.before[0].covariance)
        if self.merged is not None:
            every = [one for parts in found for one in parts]
            return _divided(_together(every, size), self.merged, self.before)
        return [_together(parts, size) for parts in found]


def smoothed(
    segments: Sequence[Segment], model: FilterModel, motion: UnknownMotion, time: Array
) -> list[FilterState]:
    """Return the states at times (K,), s, rising, as the whole history has them.

    Parameters
    ----------
    segments : sequence of Segment
        The history, divided at these times.
    model : FilterModel
    motion : UnknownMotion
        How the vehicle may move where samples are missing.
    time : (K,) array
    """
    time = np.asarray(time, dtype=float)
    ends = np.array([segment.end for segment in segments])
    wanted = np.searchsorted(ends, time - AT_ONCE)
    first = int(wanted.min()) if len(wanted) else len(segments)
    found: dict[int, FilterState] = {}
    newest = segments[-1].after
    hindsight = [
        Hindsight.none(len(state.covariance), float(weight))
        for state, weight in zip(newest.states, newest.log_weights, strict=True)
    ]
    asked = set(wanted.tolist())
    for k in range(len(segments) - 1, first - 1, -1):
        if k in asked:
            states = [
                one.of(state)
                for one, state in zip(hindsight, segments[k].after.states, strict=True)
            ]
            weights = np.array([one.log_weight for one in hindsight])
            found[k] = Mixture(states, weights).moments if len(states) > 1 else states[0]
        if k > first:
            for stage in reversed(stages(segments[k - 1].after, segments[k], model, motion)):
                hindsight = stage.back(hindsight)
    return [found[k] for k in wanted.tolist()]


def _together(parts: Sequence[Hindsight], states: int) -> Hindsight:
    """Return hindsight of one state of which several things are possible: their moments."""
    possible = [one for one in parts if one.log_weight > -math.inf]
    if not possible:
        return Hindsight.none(states, -math.inf)
    if len(possible) == 1:
        return possible[0]
    log_weight = float(np.logaddexp.reduce([one.log_weight for one in possible]))
    weight = np.exp([one.log_weight - log_weight for one in possible])
    shift = sum(w * one.shift for w, one in zip(weight, possible, strict=True))
    change = sum(
        w * (one.change + np.outer(one.shift - shift, one.shift - shift))
        for w, one in zip(weight, possible, strict=True)
    )
    return Hindsight(np.asarray(shift), np.asarray(change), log_weight)


def _divided(
    later: Hindsight, merged: FilterState, before: Sequence[FilterState]
) -> list[Hindsight]:
    """Return hindsight of several states from that of the one that stood for them.

    What later data said of the one, posterior less prior information, is said to each; how well
    each had foretold it changes their probabilities."""
    P = merged.covariance
    scale = np.sqrt(np.diag(P))
    prior = np.linalg.inv(P / np.outer(scale, scale))
    posterior = np.linalg.inv((P + later.change) / np.outer(scale, scale))
    values, vectors = np.linalg.eigh(posterior - prior)
    information = (vectors * np.maximum(values, 0.0)) @ vectors.T
    vector = posterior @ (later.shift / scale)
    found = []
    for state in before:
        apart = error_between(state.nominal, merged.nominal) / scale
        own = state.covariance / np.outer(scale, scale)
        pull = vector - information @ apart
        less = np.eye(len(own)) + own @ information
        gain = np.linalg.solve(less, own)
        log = vector @ apart - 0.5 * apart @ information @ apart + 0.5 * pull @ gain @ pull
        log -= 0.5 * np.linalg.slogdet(less)[1]
        change = (gain - own) * np.outer(scale, scale)
        found.append(Hindsight(gain @ pull * scale, change, float(log)))
    return found


def stages(
    before: Mixture, segment: Segment, model: FilterModel, motion: UnknownMotion
) -> list[_Stage]:
    """Return what happened to the states before a segment up to those after it, in order."""
    now, found = before.copy(), list[_Stage]()
    if segment.change is not None:
        now, stage = _over_gap(now, segment, model, motion)
        found.append(stage)
    states, them = _begun(now), list(now.states)
    for state in them:
        propagate(state, model, segment.force, segment.rate, segment.height, segment.dt)
    for measurement in segment.measurements:
        now.update(measurement, model)
    which = [next(k for k, one in enumerate(them) if one is state) for state in now.states]
    ways = [Way.of(state) for state in now.states]
    return [*found, _Stage(states, tuple(zip(which, ways, strict=True)))]


def _begun(now: Mixture) -> tuple[FilterState, ...]:
    """Return copies of the states of a mixture, which keep a clone of themselves from now on."""
    for state in now.states:
        state.clone = Clone.of(state.covariance)
    return tuple(state.copy() for state in now.states)


def _over_gap(
    now: Mixture, segment: Segment, model: FilterModel, motion: UnknownMotion
) -> tuple[Mixture, _Stage]:
    """Carry a mixture over the time without samples before a segment, and return it and what
    happened."""
    states, merged, whole = _begun(now), None, segment.missing > HELD
    if whole and len(states) > 1:
        merged = now.merged.copy()
        now = Mixture.of(merged.copy())
        _begun(now)
    after, motions = segment.bridged(now, model, motion)
    for state, seen in zip(after.states, motions, strict=True):
        grow(state, segment.missing, seen)
    each = [(0 if whole else k, Way.of(state)) for k, state in enumerate(after.states)]
    return after, _Stage(states, tuple(each), merged)
