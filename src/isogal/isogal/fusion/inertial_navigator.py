"""Strapdown and filter of one navigator, with a history: measurements of any age are applied where
they belong.

The history consists of segments: IMU samples, the state after them, and the measurements of that
time. A measurement of within a segment divides it, also within a sample, whose means then hold for
both parts. The state there is updated, and carried through all samples and measurements that came
after: the result is exactly that of a measurement that had come on time."""

import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.fusion.aid_monitor import AidMonitor, Without, aid_of, by_itself, of_aid
from isogal.fusion.clone import Clone
from isogal.fusion.measurements import Innovation, Measurement
from isogal.fusion.measurements.ground_velocity import GNSS
from isogal.fusion.mixture import Mixture
from isogal.fusion.model import FilterModel
from isogal.fusion.nominal import error_between
from isogal.fusion.outage import HELD, UnknownMotion, grow, steady_sample
from isogal.fusion.prediction import (
    TRACK_COLUMNS,
    FilterDivergenceError,
    propagate,
    require_definite,
)
from isogal.fusion.segment import AT_ONCE, Segment
from isogal.fusion.smoothing import smoothed
from isogal.fusion.state import FilterState
from isogal.inertial.dead_reckoning import dead_reckoned
from isogal.inertial.error_state import BATCH_STATES, batch_difference
from isogal.passage import Passage


def track_row(state: FilterState) -> Array:
    """Return (13,) the track's row of a state."""
    of_position = state.covariance[:2, :2].ravel()[[0, 1, 3]]
    return np.concatenate([*state.estimate, of_position])


class InertialNavigator:
    """The filter of one navigator, fed with IMU samples and measurements.

    Parameters
    ----------
    model : FilterModel
    state : FilterState or Mixture
        At `time`.
    time : float
        s.
    horizon : float
        How old a measurement may be, s.
    motion : UnknownMotion, optional
        How the vehicle may move where samples are missing.
    sample : (3,) and (3,) arrays, optional
        Specific force and angular rate of the sample that ended at `time`; None = of a vehicle
        that moves steadily.
    """

    aligned: bool = True
    """Whether the state may be trusted; not while it is being aligned
    (`isogal.fusion.alignment`)."""

    def __init__(
        self,
        model: FilterModel,
        state: FilterState | Mixture,
        time: float = 0.0,
        horizon: float = 1200.0,
        motion: UnknownMotion | None = None,
        sample: tuple[Array, Array] | None = None,
    ) -> None:
        self.model = model
        self.horizon = horizon
        self.motion = motion or UnknownMotion()
        mixture = state.copy() if isinstance(state, Mixture) else Mixture.of(state.copy())
        state = mixture.merged
        self._unaided: list[Without] = []
        """See `unaided`: what was known at its last calls."""
        self._rows = model.passage_rows()
        self._kept = math.nan
        """Time of the errors that are kept along (`keep`), s; NaN = none."""
        self._newest_aid = -math.inf
        """Time of the newest measurement of an aid that says where the vehicle is, s."""
        self.monitors: dict[str, AidMonitor] = {}
        """Of each aid that has come and says where the vehicle is, by its name."""
        force, rate = steady_sample(state) if sample is None else sample
        self._segments = [
            Segment(
                np.array([time], dtype=float),
                np.array([force], dtype=float),
                np.array([rate], dtype=float),
                state.position[2:].copy(),
                model.dt,
                mixture,
                track_row(state)[None],
            )
        ]

    @property
    def time(self) -> float:
        """Stamp of the newest state, s."""
        return self._segments[-1].end

    @property
    def sample(self) -> tuple[Array, Array]:
        """Specific force and angular rate of the newest sample; do not change them."""
        return self._segments[-1].force[-1], self._segments[-1].rate[-1]

    def sample_at(self, time: float) -> tuple[Array, Array]:
        """Return specific force and angular rate of the sample that a time (s) of the history is
        in; do not change them."""
        segment = self._segments[min(self._index(time), len(self._segments) - 1)]
        k = min(int(np.searchsorted(segment.time, time - AT_ONCE)), len(segment.time) - 1)
        return segment.force[k], segment.rate[k]

    @property
    def state(self) -> FilterState:
        """The newest state; do not change it. While it is open whether there was a manoeuvre in a
        gap, mean and covariance over both."""
        return self._segments[-1].after.merged

    @property
    def known(self) -> Mixture:
        """All that is known at the newest sample; do not change it."""
        return self._segments[-1].after

    def unite(self) -> None:
        """Go on with one state that has the mean and the covariance of all."""
        self._segments[-1].after = Mixture.of(self.known.moments)

    @property
    def undecided(self) -> bool:
        """Whether it is open if there was a manoeuvre in a gap."""
        return len(self._segments[-1].after.states) > 1

    def imu(
        self,
        time: Array | float,
        specific_force: Array,
        angular_rate: Array,
        height: Array | float = np.nan,
        missing: float = 0.0,
    ) -> Array:
        """Advance over IMU samples, and return (S, 13) the track
        (`isogal.fusion.prediction.TRACK_COLUMNS`).

        Parameters
        ----------
        time : (S,) array or float
            Ends of the intervals, s; of several samples the intervals are the model's.
        specific_force, angular_rate : (S, 3) or (3,) arrays
            Means over each interval, body axes, m/s², rad/s.
        height : (S,) array or float
            Known or measured height at the end of each, m; NaN = none.
        missing : float
            How much of the time before the first sample it does not cover, s; the covariance grows
            by what may have happened meanwhile (`isogal.fusion.outage`).

        Raises
        ------
        ValueError
            Shapes differ from these, a stamp is not later than the one before, or a value is not
            finite; nothing is changed.
        FilterDivergenceError
            The covariance is no longer positive definite; nothing is changed.
        """
        times = np.array(time, dtype=float, ndmin=1)
        force = np.array(specific_force, dtype=float, ndmin=2)
        rate = np.array(angular_rate, dtype=float, ndmin=2)
        if not len(times) or not force.shape == rate.shape == (len(times), 3):
            shapes = f"{times.shape}, {force.shape} and {rate.shape}"
            raise ValueError(f"IMU samples must be (S,), (S, 3) and (S, 3), are {shapes}")
        if not times[0] > self.time:
            raise ValueError(f"stamp {times[0]:.3f} s is not later than {self.time:.3f} s")
        if len(times) > 1 and not (times[1:] > times[:-1]).all():
            raise ValueError("stamps of IMU samples must increase")
        heights = np.full(len(times), height, dtype=float)
        # a sum is not finite where one of its terms is not; of few numbers Python's is quicker
        total = sum(map(sum, force.tolist())) + sum(map(sum, rate.tolist()))
        if not math.isfinite(total) or any(map(math.isinf, heights.tolist())):
            raise ValueError("IMU sample is not finite")
        dt = self.model.dt
        if len(times) == 1:
            # over a short gap the sample stands for the gap as well
            interval = float(times[0]) - self.time - (missing if missing > HELD else 0.0)
            dt = dt if abs(interval - dt) < AT_ONCE else interval
        new = Segment(times, force, rate, heights, dt, self._segments[-1].after, _EMPTY, missing)
        if missing > 0.0:
            before = self.sample
            new.change = force[0] - before[0], rate[0] - before[1]
        self._carry(self._segments[-1].after, new)
        self._segments.append(new)
        while len(self._segments) > 2 and self._segments[1].end < self.time - self.horizon:
            del self._segments[0]
        return new.track

    def measure(self, time: float, *measurements: Measurement) -> Innovation:
        """Apply measurements of one time within the horizon, one after the other; return what
        became of the last."""
        return self.measure_all([(time, one) for one in measurements])[-1]

    def measure_all(self, measurements: Sequence[tuple[float, Measurement]]) -> list[Innovation]:
        """Apply measurements, each with its time (s) within the horizon, in order of their times;
        return what became of each.

        One that is beyond the gate is kept: with an older one that comes later it may be within.
        Where one cannot be used, none is."""
        for time, _ in measurements:
            reason = self._impossible(time)
            if reason is not None:
                return [Innovation.refused(reason)] * len(measurements)
        monitor = self._monitor(aid_of(measurements[0][1]))
        if monitor is not None:
            untrusted = monitor.untrusted(self, measurements)
            if untrusted is not None:
                return untrusted
        for time, _ in measurements:
            self._segment_at(time)
        marked = [(self._segment_at(time), one) for time, one in measurements]
        oldest = min(time for time, _ in measurements)
        first = self._index(oldest)
        aids = [time for time, one in measurements if of_aid(one)]
        self._newest_aid = max([self._newest_aid, *aids])
        while self._unaided and oldest <= self._unaided[-1].time + AT_ONCE:
            self._unaided.pop()
        before = self._segments[first].after.copy()
        try:
            results = self._apply(first, marked)
        except (ValueError, FilterDivergenceError) as error:
            for segment, one in marked:
                segment.measurements[:] = [
                    kept for kept in segment.measurements if kept is not one
                ]
            self._segments[first].after = before
            self._replay(first + 1)
            return [Innovation.refused(str(error))] * len(measurements)
        for (time, one), result in zip(measurements, results, strict=True):
            for monitor in self.monitors.values():
                monitor.note(self, time, one, result)
        return results

    def _monitor(self, source: str) -> AidMonitor | None:
        """Return what judges an aid; None where nothing does."""
        if not source or (source == GNSS and not self.model.judges_satellites):
            return None
        return self.monitors.setdefault(source, AidMonitor(source))

    def _apply(
        self, first: int, marked: Sequence[tuple[Segment, Measurement]]
    ) -> list[Innovation]:
        """Apply measurements to their segments, the earliest of which is given, and replay what
        comes after."""
        results: dict[int, Innovation] = {}
        for index in range(first, len(self._segments)):
            segment = self._segments[index]
            if index > first:
                self._redo(index)
            for k, (place, one) in enumerate(marked):
                if place is segment:
                    results[k] = segment.after.update(one, self.model)
                    segment.measurements.append(one)
            self._clone(segment)
        for state in self.known.states:
            require_definite(state)
        return [results[k] for k in range(len(marked))]

    def back(self, samples: int) -> None:
        """Forget the newest samples, which came one by one: they were not true. Up to one at which
        there was a measurement, the last true one stands for them."""
        self._unaided.clear()
        self._kept = math.nan
        first = max(1, len(self._segments) - samples)
        while len(self._segments) > first and not self._segments[-1].measurements:
            self._segments.pop()
        true = self._segments[first - 1]
        for segment in self._segments[first:]:
            segment.force, segment.rate = true.force[-1:], true.rate[-1:]
        self._replay(first)

    def state_at(self, time: float) -> FilterState:
        """Return the state at a time within the horizon, as it is known now; the newest after it.

        Raises
        ------
        ValueError
            It is older than the history.
        """
        if time >= self.time - AT_ONCE:
            return self.state
        if (reason := self._impossible(time)) is not None:
            raise ValueError(reason)
        return self._segment_at(time).after.merged

    def track(self, time: Array) -> Array:
        """Return (K, 13) the track (`isogal.fusion.prediction.TRACK_COLUMNS`) at times (K,), s,
        that the history covers; between samples by dead reckoning from the one before."""
        first = min(self._index(float(time[0])), len(self._segments) - 1)
        if first > 0 and time[0] < self._segments[first].time[0] - AT_ONCE:
            first -= 1  # it is between the two
        used = self._segments[first:]
        stamps = np.concatenate([segment.time for segment in used])
        rows = np.concatenate([segment.track for segment in used])
        ends = np.cumsum([len(segment.time) for segment in used]) - 1
        rows[ends] = [track_row(segment.after.merged) for segment in used]
        index = np.searchsorted(stamps, np.asarray(time) + AT_ONCE, side="right") - 1
        found, ahead = rows[index], np.asarray(time) - stamps[index]
        for k in np.flatnonzero(ahead > AT_ONCE):
            found[k, :3] = dead_reckoned(found[k, :3], found[k, 3:6], ahead[k])
        return found

    def smoothed(self, time: Array) -> list[FilterState]:
        """Return the states at times (K,), s, rising, as all that has been measured since then
        has them (`isogal.fusion.smoothing`). Nothing is changed.

        Raises
        ------
        ValueError
            At one of the times there is no state, or it is older than the history.
        """
        return smoothed(self.history(time), self.model, self.motion, time)

    def passage(self, since: float) -> Passage | None:
        """Return what has become of the error since a time (s) of the history; None where nothing
        is kept of then, and at that time. Of satellites that may be wrong it is told apart what
        they say."""
        if self._impossible(since) is not None:
            return None
        first = self._segment_at(since)
        if first is self._segments[-1]:
            return None
        if self._kept != since:
            self.keep(since)
        last, jump = self.state, np.zeros(BATCH_STATES)
        without = self.unaided(since) if self.model.judges_satellites else None
        if without is not None:
            jump, last = batch_difference(last.estimate, without.estimate), without
        begin, rows, clone = first.after.merged, self._rows, last.clone
        before, slow = rows @ begin.covariance @ rows.T, rows[BATCH_STATES:, 9:]
        return Passage(
            since,
            before,
            -clone.shift,
            before + clone.change,
            clone.cross @ rows.T,
            rows @ last.covariance @ rows.T,
            begin.velocity[:2].copy(),
            np.array([slow @ np.concatenate(one.nominal[3:]) for one in (begin, last)]),
            jump,
        )

    def keep(self, time: float) -> None:
        """Keep the errors of a time (s) of the history along from then on, instead of those of
        another: `passage` asks for them, and need not go over all since then."""
        self._kept = time
        self._clone(self._segment_at(time))
        self._replay(self._index(time) + 1)

    def _clone(self, segment: Segment) -> None:
        """Begin to keep the errors after a segment where they are asked for."""
        if not abs(segment.end - self._kept) <= AT_ONCE:  # nor where it is NaN
            return
        rows, one = self._rows, segment.after.merged
        for state in segment.after.states:
            state.clone = Clone.of(state.covariance, rows)
            if state is not one:
                state.clone.shift[:] = rows @ error_between(state.nominal, one.nominal)
                state.clone.change[:] = rows @ (state.covariance - one.covariance) @ rows.T

    def samples(self, after: float, until: float) -> tuple[Array, Array]:
        """Return the stamps (K,), s, after a time and up to another, of the samples that the
        history has, and the angular rates (K, 3), rad/s, that the gyroscopes measured."""
        used = [segment for segment in self._segments[1:] if segment.end > after + AT_ONCE]
        if not used:
            return np.empty(0), np.empty((0, 3))
        time = np.concatenate([segment.time for segment in used])
        rate = np.concatenate([segment.rate for segment in used])
        asked = (time > after + AT_ONCE) & (time < until + AT_ONCE)
        return time[asked], rate[asked]

    def history(self, time: Array) -> list[Segment]:
        """Return all that is kept, oldest first, divided at times (K,), s, that it covers; do not
        change it. Of the first segment only the state at its end counts.

        Raises
        ------
        ValueError
            At one of the times there is no state.
        """
        for stamp in np.asarray(time).tolist():
            self.state_at(stamp)
        return self._segments

    def unaided(self, since: float) -> FilterState | None:
        """Return the newest state as it would be without satellites after a time (s) of the
        history; None where there have been none."""
        if self._newest_aid <= since + AT_ONCE:
            return None
        if self._unaided and self._unaided[-1].since != since:
            self._unaided.clear()
        if not self._unaided:
            begin = self._segments[self._index(since)].after
            self._unaided.append(Without(since, since, begin))
        self._unaided = [*self._unaided[1 - _LATE :], self.later(self._unaided[-1])]
        return self._unaided[-1].after.merged

    @property
    def without_satellites(self) -> Without | None:
        """See `AidMonitor.without`."""
        monitor = self.monitors.get(GNSS)
        return None if monitor is None else monitor.without(self.time)

    def later(self, before: Without, source: str = "") -> Without:
        """Return what is known at the newest sample without an aid, by its name, or without all
        that say where the vehicle is, and without what fixes say."""
        one = before.after
        for segment in self._segments[self._index(before.time) + 1 :]:
            one, _ = self._carried(one, segment)
            for measurement in segment.measurements:
                if not of_aid(measurement, source) and by_itself(measurement):
                    one.update(measurement, self.model)
        return Without(before.since, self.time, one)

    def forget(self, source: str, without: Without) -> None:
        """Go on from what is known without an aid since a time: measurements of it after that
        never were."""
        self._unaided.clear()
        self._kept = math.nan
        first = self._index(without.since) + 1
        for segment in self._segments[first:]:
            segment.measurements[:] = [m for m in segment.measurements if not of_aid(m, source)]
        if self._segments[0].end <= without.since + AT_ONCE:
            self._replay(first)
        else:
            self.go_on_from(self.time, without.after)

    def go_on_from(self, time: float, known: Mixture) -> None:
        """Go on from what is known at a time (s) of the history, with the samples and measurements
        after it; all before is forgotten."""
        self._kept = math.nan
        first = self._segment_at(time)
        del self._segments[: self._index(time)]
        first.after = known
        self._replay(1)

    def follow(self, other: "InertialNavigator") -> None:
        """Go over the samples and measurements of another navigator after the time of this one,
        which is in the other's history.

        Raises
        ------
        FilterDivergenceError
            The covariance is no longer positive definite.
        """
        other.state_at(self.time)
        for segment in other._segments[other._index(self.time) + 1 :]:
            kept = list(segment.measurements)
            self._segments.append(replace(segment, measurements=kept))
        self._replay(1)

    def forecast(self, time: float, height: float = np.nan) -> FilterState:
        """Return the state at a later time, if the vehicle goes on as it does (a known height, m,
        or NaN)."""
        missing = max(0.0, time - self.time - self.model.dt)
        return self.carried(time, *self.sample, height, missing)

    def carried(
        self,
        time: float,
        specific_force: Array,
        angular_rate: Array,
        height: float = np.nan,
        missing: float = 0.0,
    ) -> FilterState:
        """Return the state after one more IMU sample (`imu`), which is not taken: what is known in
        the midst of a step."""
        ahead = InertialNavigator(self.model, self.state, self.time, 0.0, self.motion, self.sample)
        ahead.imu(time, specific_force, angular_rate, height, missing)
        return ahead.state

    def _impossible(self, time: float) -> str | None:
        """Return why there can be no measurement at a time; None = there can be."""
        oldest = self._segments[0].end
        if not np.isfinite(time) or time < oldest - AT_ONCE:
            return f"stamp {time:.1f} s is older than the buffer ({oldest:.1f} s)"
        if time > self.time + AT_ONCE:
            return f"stamp {time:.1f} s is ahead of the navigator ({self.time:.1f} s)"
        segment = self._segments[self._index(time)]
        if segment.missing > HELD and time < segment.time[0] - segment.dt - AT_ONCE:
            return f"stamp {time:.1f} s: there are no inertial data of then"
        return None

    def _index(self, time: float) -> int:
        """Return the first segment that ends at a time or later."""
        if abs(time - self.time) <= AT_ONCE:
            return len(self._segments) - 1
        return bisect_left(self._segments, time - AT_ONCE, key=lambda segment: segment.end)

    def _segment_at(self, time: float) -> Segment:
        """Return the segment that ends at a time, which is made if there is none."""
        index = self._index(time)
        segment = self._segments[index]
        if segment.end - time <= AT_ONCE:
            return segment
        parts = segment.divided(time)
        self._segments[index : index + 1] = parts
        for k, part in enumerate(parts[:-1], index):
            self._carry(self._segments[k - 1].after, part)
        return next(part for part in parts if abs(part.end - time) <= AT_ONCE)

    def _replay(self, index: int) -> None:
        """Carry the state before a segment through it and all after it."""
        for k in range(index, len(self._segments)):
            self._redo(k)

    def _redo(self, index: int) -> None:
        """Carry the state before a segment through it and its measurements."""
        segment = self._segments[index]
        self._carry(self._segments[index - 1].after, segment)
        for measurement in segment.measurements:
            segment.after.update(measurement, self.model)
        self._clone(segment)

    def _carry(self, before: Mixture, segment: Segment) -> None:
        """Set what is known after a segment's samples from what was known before them."""
        segment.after, segment.track = self._carried(before, segment)

    def _carried(self, before: Mixture, segment: Segment) -> tuple[Mixture, Array]:
        """Return what is known after a segment's samples, and the track over them."""
        after = before.copy()
        if segment.change is not None:
            after, motions = segment.bridged(after, self.model, self.motion)
            for state, motion in zip(after.states, motions, strict=True):
                grow(state, segment.missing, motion)
        samples = segment.force, segment.rate, segment.height
        tracks = [propagate(state, self.model, *samples, segment.dt) for state in after.states]
        return after, tracks[int(np.argmax(after.log_weights)) if len(tracks) > 1 else 0]


_EMPTY = np.empty((0, TRACK_COLUMNS))
_LATE = 30
"""States without satellites that are kept: where they are asked for after every measurement, those
after one that is late by so many are computed anew, not all since the last fix."""
