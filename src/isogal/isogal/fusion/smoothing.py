"""Fixed-interval smoothing: the states of the past, given all that has been measured since.

A pass backwards over a navigator's history (Rauch, Tung & Striebel 1965; docs/mathematics.md,
section 3.18). With m, P the filter's mean and covariance at a time and s, S what is known of then
from all data, d = s - m and D = S - P go backwards by

    over an interval        d = G d',            D = G D' G',     G = C P'^-1
    over a measurement      d = d' + (m' - m),   D = D' + (P' - P)

where a prime marks what is later, P' over an interval is the predicted covariance, and C the
covariance of the error before the interval with that after it, from the filter's own sigma points
(Särkkä 2008). A measurement is of the same state, whatever its form: nothing more need be known of
it than what it made of mean and covariance. What makes the navigator less certain without
measuring anything (`Widening`, `SampleNoise`, a gap in the inertial data) is an interval in which
noise comes in: C = P.

While it is open what has happened (`isogal.fusion.mixture`), each state has d and D of its own and
a probability, which is that of the end."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.fusion.measurements import Measurement, SampleNoise, Widening
from isogal.fusion.measurements.ground_velocity import GroundVelocity
from isogal.fusion.mixture import Mixture
from isogal.fusion.model import FilterModel
from isogal.fusion.nominal import error_between, move
from isogal.fusion.outage import UnknownMotion, grow
from isogal.fusion.prediction import propagate
from isogal.fusion.segment import AT_ONCE, Segment, joined, runs
from isogal.fusion.state import FilterState
from isogal.fusion.trace import Trace
from isogal.inertial.rotations import cross_matrix


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

    gain: Array | None
    """(N, N); None = identity."""
    shift: Array
    change: Array

    def of(self, later: Hindsight) -> Hindsight:
        """Return hindsight before it."""
        if self.gain is None:
            shift, change = later.shift, later.change
        else:
            shift = self.gain @ later.shift
            change = self.gain @ later.change @ self.gain.T
        change = change + self.change
        return Hindsight(shift + self.shift, 0.5 * (change + change.T), later.log_weight)

    def then(self, later: "Way") -> "Way":
        """Return the way back over it and over what comes after it."""
        before = self.of(Hindsight(later.shift, later.change))
        gain = later.gain if self.gain is None else self.gain
        if self.gain is not None and later.gain is not None:
            gain = self.gain @ later.gain
        return Way(gain, before.shift, before.change)


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
            found[index].append(way.of(one))
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
    now = before.copy()
    found: list[_Stage] = []
    if segment.change is not None:
        now, found = _over_gap(now, segment, model, motion)
    states = tuple(state.copy() for state in now.states)
    ways = [_propagated(state, model, segment) for state in now.states]
    found.append(_Stage(states, tuple(enumerate(ways))))
    for measurement in segment.measurements:
        found.append(_measured(now, measurement, model))
    return found


def _propagated(state: FilterState, model: FilterModel, segment: Segment) -> Way:
    """Carry a state over a segment's samples, in place, and return the way back."""
    trace = Trace.of(len(segment.force), len(state.covariance))
    samples = segment.force, segment.rate, segment.height
    propagate(state, model, *samples, segment.dt, trace)
    return _way_back([trace])


def _way_back(traces: Sequence[Trace]) -> Way:
    """Return the way back over intervals one after the other."""
    size = traces[0].cross.shape[-1]
    gain, shift, change = np.eye(size), np.zeros(size), np.zeros((size, size))
    for trace in traces:
        each = _gains(trace.cross, trace.predicted)
        by_height = trace.filtered - trace.predicted
        for one, correction, reduced in zip(each, trace.correction, by_height, strict=True):
            gain = gain @ one
            shift += gain @ correction
            change += gain @ reduced @ gain.T
    return Way(gain, shift, change)


def _gains(cross: Array, predicted: Array) -> Array:
    """Return C P'^-1 (..., N, N), in units of the 1-sigmas."""
    scale = np.sqrt(np.diagonal(predicted, axis1=-2, axis2=-1))
    scaled = predicted / (scale[..., :, None] * scale[..., None, :])
    across = cross / scale[..., None, :]
    solved = np.linalg.solve(scaled, np.swapaxes(across, -1, -2))
    return np.asarray(np.swapaxes(solved, -1, -2) / scale[..., None, :])


def _widened(before: Array, after: Array) -> Way:
    """Return the way back over noise that has come in."""
    size = len(before)
    return Way(_gains(before, after), np.zeros(size), np.zeros((size, size)))


def _measured(now: Mixture, measurement: Measurement, model: FilterModel) -> _Stage:
    """Update a mixture with a measurement, in place, and return what happened."""
    before, them = tuple(state.copy() for state in now.states), list(now.states)
    now.update(measurement, model)
    each = []
    for state in now.states:
        index = next(k for k, one in enumerate(them) if one is state)
        was = before[index]
        if isinstance(measurement, Widening | SampleNoise):
            way = _widened(was.covariance, state.covariance)
        else:
            way = _informed(was, state, model, isinstance(measurement, GroundVelocity))
        each.append((index, way))
    return _Stage(before, tuple(each))


def _informed(was: FilterState, state: FilterState, model: FilterModel, over_ground: bool) -> Way:
    """Return the way back over a measurement, which re-expresses errors of the velocity
    (`isogal.fusion.measurements.model.moved`)."""
    shift, gain = error_between(state.nominal, was.nominal), None
    after = state.covariance
    if model.unsure_heading and not over_ground:
        gain = np.eye(len(after))
        gain[3:6, 6:9] = cross_matrix(state.velocity - was.velocity)
        after = gain @ after @ gain.T
    return Way(gain, shift, after - was.covariance)


def way_over(
    before: Mixture, segments: Sequence[Segment], model: FilterModel, motion: UnknownMotion
) -> Way | None:
    """Return the way back over segments that follow one another on what is known before them;
    None while it is open what has happened."""
    size = model.states
    way = Way(None, np.zeros(size), np.zeros((size, size)))
    for those in runs(segments):
        for stage in stages(before, joined(those), model, motion):
            if len(stage.before) != 1 or len(stage.each) != 1:
                return None
            way = way.then(stage.each[0][1])
        before = those[-1].after
    return way


def _over_gap(
    now: Mixture, segment: Segment, model: FilterModel, motion: UnknownMotion
) -> tuple[Mixture, list[_Stage]]:
    """Carry a mixture over the time without samples before a segment, and return it and what
    happened."""
    several = tuple(state.copy() for state in now.states)
    traces: list[Trace] = []
    after, motions = segment.bridged(now, model, motion, traces)
    found, before = [], several
    if traces:
        merged = now.merged.copy() if len(several) > 1 else None
        found.append(_Stage(several, ((0, _way_back(traces)),), merged))
        before = (after.states[0].copy(),)  # they are still the same
    ways = []
    for index, (state, seen) in enumerate(zip(after.states, motions, strict=True)):
        was = state.covariance.copy()
        grow(state, segment.missing, seen)
        ways.append((0 if traces else index, _widened(was, state.covariance)))
    found.append(_Stage(before, tuple(ways)))
    return after, found
