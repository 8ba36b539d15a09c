"""A piece of a navigator's history (`isogal.fusion.inertial_navigator`)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from isogal.arrays import Array
from isogal.fusion.measurements import Measurement
from isogal.fusion.mixture import Mixture
from isogal.fusion.model import FilterModel
from isogal.fusion.outage import HELD, UnknownMotion, keep_going

AT_ONCE = 1e-6
"""s by which two stamps may differ that are the same time."""
TOGETHER = 100
"""Samples in a run: more at once are no faster."""


@dataclass(slots=True, eq=False)
class Segment:
    """IMU samples of equal intervals, and the state after them."""

    time: Array
    """(S,) s, ends of the intervals."""
    force: Array
    """(S, 3)."""
    rate: Array
    """(S, 3)."""
    height: Array
    """(S,) known height, m; NaN = none."""
    dt: float
    """s, the interval that a sample is of."""
    after: Mixture
    """After the last interval, and the measurements of then."""
    track: Array
    """(S, 13) before these measurements (`isogal.fusion.prediction.TRACK_COLUMNS`)."""
    missing: float = 0.0
    """s before the first interval without data, or at its beginning up to `HELD`."""
    change: tuple[Array, Array] | None = None
    """Of specific force and angular rate, (3,) each, over that."""
    measurements: list[Measurement] = field(default_factory=list)

    @property
    def end(self) -> float:
        """s."""
        return float(self.time[-1])

    def goes_on(self, later: "Segment") -> bool:
        """Whether a later segment's samples follow on this one's as if of the same segment."""
        return later.change is None and abs(later.dt - self.dt) < AT_ONCE

    def bridged(
        self, before: Mixture, model: FilterModel, motion: UnknownMotion
    ) -> tuple[Mixture, list[UnknownMotion]]:
        """Return what is known after the time without samples before it, and of each state how the
        vehicle may have moved meanwhile, by which it is still to grow; `before` may be changed."""
        assert self.change is not None
        rate = float(self.rate[0, 2])
        rates = rate - float(self.change[1][2]), rate
        motions = motion.possible(self.missing, self.change, rates)
        if model.unsure_heading:
            # hypotheses of the matcher go on by `Passage`, which is of one state
            motions = [(0.0, motions[-1][1])]
        if self.missing <= HELD:
            return before, [motions[0][1]] * len(before.states)
        one = before.merged.copy()
        keep_going(one, model, self.missing, float(self.height[0]), motion.turns, rates)
        after = Mixture.of(one)
        if len(motions) > 1:
            after = after.divided([probability for probability, _ in motions])
        return after, [seen for _, seen in motions]

    def part(self, first: int, last: int, cut: tuple[float, float] = (0.0, 0.0)) -> "Segment":
        """Return the samples from one to before another, less two times (s) at the beginning and
        at the end, which may be of a single sample."""
        part = replace(
            self,
            time=self.time[first:last] - cut[1],
            force=self.force[first:last],
            rate=self.rate[first:last],
            height=self.height[first:last],
            track=self.track[first:last],
            dt=self.dt - sum(cut),
            measurements=[],
        )
        if first > 0 or cut[0] > 0.0:
            part.missing, part.change = 0.0, None
        return part

    def divided(self, time: float) -> "list[Segment]":
        """Return the parts of a segment that end at a time (s) within it, and those after it, all
        of equal intervals; the last has the measurements."""
        count = len(self.time)
        k = int(np.searchsorted(self.time, time - AT_ONCE))
        after = float(self.time[k]) - time
        if after <= AT_ONCE:
            parts = [self.part(0, k + 1)]
        else:
            before = self.dt - after
            parts = [self.part(0, k)] if k > 0 else []
            parts += [self.part(k, k + 1, (0.0, after)), self.part(k, k + 1, (before, 0.0))]
        if k + 1 < count:
            parts.append(self.part(k + 1, count))
        parts[-1].measurements = self.measurements
        return parts


def runs(segments: Sequence[Segment]) -> Iterator[list[Segment]]:
    """Yield segments that follow one another in runs that go on from each other, with measurements
    after the last of them only, of not many more samples than `TOGETHER`."""
    run: list[Segment] = []
    for segment in segments:
        if run and not run[-1].goes_on(segment):
            yield run
            run = []
        run.append(segment)
        if segment.measurements or sum(len(one.time) for one in run) > TOGETHER:
            yield run
            run = []
    if run:
        yield run


def joined(segments: Sequence[Segment]) -> Segment:
    """Return a run as one segment."""
    if len(segments) == 1:
        return segments[0]
    return replace(
        segments[0],
        time=np.concatenate([one.time for one in segments]),
        force=np.concatenate([one.force for one in segments]),
        rate=np.concatenate([one.rate for one in segments]),
        height=np.concatenate([one.height for one in segments]),
        track=np.concatenate([one.track for one in segments]),
        measurements=segments[-1].measurements,
    )
