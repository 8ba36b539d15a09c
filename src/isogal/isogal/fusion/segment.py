"""A piece of a navigator's history (`isogal.fusion.inertial_navigator`)."""

from dataclasses import dataclass, field

import numpy as np

from isogal.arrays import Array
from isogal.fusion.measurements import Measurement
from isogal.fusion.mixture import Mixture
from isogal.fusion.model import FilterModel
from isogal.fusion.outage import HELD, UnknownMotion, keep_going

AT_ONCE = 1e-6
"""s by which two stamps may differ that are the same time."""


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
        which, dt = slice(first, last), self.dt - sum(cut)
        samples = self.force[which], self.rate[which], self.height[which]
        part = Segment(self.time[which] - cut[1], *samples, dt, self.after, self.track[which])
        if first == 0 and cut[0] == 0.0:
            part.missing, part.change = self.missing, self.change
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
