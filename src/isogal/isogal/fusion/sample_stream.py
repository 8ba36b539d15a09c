"""Samples of a fast IMU, one by one as they come, as steps of the navigator.

A step ends at each whole multiple of its duration in the time of the stamps, whatever the jitter
of the stamps: a sample that reaches over the end is divided. Samples that are missing for a short
time are filled in by the mean of those at either side; after a longer time the step that had begun
ends with the last sample, and the next one says how long nothing was measured
(`isogal.fusion.outage`)."""

from collections import deque
from dataclasses import dataclass
from fractions import Fraction
from statistics import fmean, median

import numpy as np

from isogal.arrays import Array
from isogal.inertial.preintegration import preintegrate

SECOND = 1_000_000_000
FILLED = 500_000_000
"""ns, longest time without samples that is filled in."""
SMOOTH = 10.0
"""s over which a vehicle's acceleration changes. An acceleration that wanders with this
correlation time between two that are known is, on the mean of a gap T, that the mean of the two is
taken for, wrong by sqrt(T / 6 SMOOTH) of its 1-sigma (variance of the integral of a Brownian
bridge, T³ / 12)."""
TOGETHER = 1000
"""ns by which a sample may miss the end of a step that it ends."""
COUNTED, LEARNT = 64, 16
"""Intervals between samples that say how fast the samples come, and after how many of them that is
seen anew."""


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """A step of the navigator."""

    ns: int
    """Its end."""
    force: Array
    """(3,) m/s², for the strapdown."""
    rate: Array
    """(3,) rad/s."""
    missing: float
    """s at its beginning without samples, for `BufferedNavigator.propagate`; of gaps filled in, as
    many as have the same effect."""


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """A sample, or a part of one."""

    force: Array
    rate: Array
    duration: int
    """ns."""


class SampleStream:
    """Makes steps of samples.

    Parameters
    ----------
    sample_rate : float
        Hz, as specified; what comes decides.
    samples_per_step : int
        So many samples at that rate make a step.
    """

    def __init__(self, sample_rate: float, samples_per_step: int) -> None:
        rate = Fraction(sample_rate).limit_denominator(1_000_000)
        self._step = samples_per_step * SECOND / rate
        self._usual = self._told = round(SECOND / rate)
        self._intervals: deque[int] = deque(maxlen=COUNTED)
        self._taken = 0
        self.missing = 0
        """Samples missing so far."""
        self.begin(0)

    def begin(self, ns: int) -> None:
        """Start at the time of the navigator's state; what was pending is dropped."""
        self.ns = ns
        """Stamp of the newest sample."""
        self._before: _Piece | None = None
        self._pieces: list[_Piece] = []
        self._unknown = 0.0
        self._first = True
        self._aim(ns)

    @property
    def measured_rate(self) -> float:
        """Hz at which samples come, as far as is known."""
        return SECOND / self._usual

    @property
    def known(self) -> bool:
        """Whether enough samples have come to know how fast they come."""
        return self._taken >= LEARNT

    @property
    def as_told(self) -> bool:
        """Whether samples come as fast as specified, within a twentieth."""
        return abs(self._usual - self._told) <= 0.05 * self._told

    @property
    def pending(self) -> int:
        """Samples, and gaps filled in, in the step that has begun."""
        return len(self._pieces)

    @property
    def newest_rate(self) -> Array:
        """(3,) rad/s of the newest sample; some must be pending."""
        return self._pieces[-1].rate

    def unfinished(self) -> Step:
        """Return the step that has begun, as if it ended with the newest sample; some must be
        pending."""
        return self._so_far(self.ns)

    def take(self, ns: int, force: Array, rate: Array) -> list[Step]:
        """Take a sample and return the steps that end with it.

        Parameters
        ----------
        ns : int
            Its stamp, later than the last.
        force, rate : (3,) arrays
            Means over the time before it, body axes, m/s² and rad/s.
        """
        start, steps = self.ns, list[Step]()
        gap = ns - start - self._usual
        if 2 * gap > self._usual:
            self.missing += round(gap / self._usual)
            if gap > FILLED:
                self._count(ns - start)
                self.ns = ns
                return self._resume(start, force, rate, gap)
            steps = self._fill(start, force, rate, gap)
            start += gap
        steps += self._add(_Piece(force, rate, ns - start), ns)
        self._count(ns - self.ns)
        self.ns = ns
        return steps

    def _fill(self, start: int, force: Array, rate: Array, gap: int) -> list[Step]:
        """Fill a gap from a time (ns) on with the mean of the samples at either side."""
        last = self._pieces[-1] if self._pieces else self._before
        if last is not None:
            force, rate = 0.5 * (last.force + force), 0.5 * (last.rate + rate)
        seconds = gap / SECOND
        self._unknown += seconds**2 * min(1.0, seconds / (6.0 * SMOOTH))
        return self._add(_Piece(force, rate, gap), start + gap)

    def _resume(self, start: int, force: Array, rate: Array, gap: int) -> list[Step]:
        """End the step that had begun with the last sample (its stamp), and go on with a step that
        is only the new one."""
        steps = [self._finish(start)] if self._pieces else []
        steps.append(Step(self.ns, force, rate, gap / SECOND))
        self._before = _Piece(force, rate, self._usual)
        self._aim(self.ns)
        return steps

    def _add(self, piece: _Piece, end: int) -> list[Step]:
        """Add a piece that ends at a time (ns); return the steps that end with or within it."""
        steps = []
        while end >= self._end - TOGETHER:
            stop = end if end <= self._end + TOGETHER else self._end
            first = piece.duration - (end - stop)
            if first > 0:
                self._pieces.append(_Piece(piece.force, piece.rate, first))
                piece = _Piece(piece.force, piece.rate, piece.duration - first)
            steps.append(self._finish(stop))
            self._aim(stop)
        if piece.duration > 0:
            self._pieces.append(piece)
        return steps

    def _aim(self, ns: int) -> None:
        """Set the end of the next step: the next multiple of its duration."""
        self._end = round(((ns + TOGETHER) // self._step + 1) * self._step)

    def _finish(self, ns: int) -> Step:
        """End the step that has begun."""
        step = self._so_far(ns)
        self._before, self._pieces, self._unknown = self._pieces[-1], [], 0.0
        return step

    def _so_far(self, ns: int) -> Step:
        """Make a step of what is pending."""
        before = [] if self._before is None else [self._before]
        pieces = before + self._pieces
        force, rate = preintegrate(
            np.array([[piece.force for piece in pieces]]),
            np.array([[piece.rate for piece in pieces]]),
            np.array([piece.duration / SECOND for piece in pieces]),
            np.array([len(before), len(pieces)]),
        )
        return Step(ns, force[0, 0], rate[0, 0], self._unknown**0.5)

    def _count(self, interval: int) -> None:
        """Learn how fast samples come; what seemed missing when they were first known not to come
        as specified was not."""
        if self._first:  # its interval is only assumed
            self._first = False
            return
        self._intervals.append(interval)
        self._taken += 1
        if self._taken % LEARNT == 0:
            # jitter of stamps cancels in the mean, which gaps are kept out of
            usual = median(self._intervals)
            self._usual = round(fmean(i for i in self._intervals if 2 * abs(i - usual) <= usual))
            if self._taken == LEARNT and not self.as_told:
                self.missing = sum(max(0, round(one / self._usual) - 1) for one in self._intervals)
