"""What is wrong with IMU samples that could each be right."""

import math
import time
from collections import deque
from collections.abc import Callable

from isogal.arrays import Array, Booleans
from isogal_ros.messages.checks import BadMessageError

AXES = (
    "accelerometer x", "accelerometer y", "accelerometer z",
    "gyroscope x", "gyroscope y", "gyroscope z",
)  # fmt: skip
STUCK = 60
"""Samples of exactly the same value after which an axis counts as stuck: noise never repeats."""
LEARNT = 60
"""Changes of an axis after which it is known how long it rests: of one that counts in coarse steps
the same value may come several times."""
LEAST = 5
"""Repetitions that are taken for noise of coarse steps at any rate; of an axis that has rested as
often as n times four times as many, and four: of steps so coarse that a value is repeated with
probability p, the longest of 60 rests was about log 60 / log(1/p) samples, and one rest in 60**4
is four times as long."""
SILENT = 10.0
"""s of wall time without a sample that are an error."""
GRAVITY = 9.81
REMEMBERED = 60
"""Changes from sample to sample that say how much the vehicle moves."""
BEYOND = 20.0
"""How many times the largest of them a sample has to be away. Of noise and waves the largest
change of one minute differs from that of another by a factor of two or three."""
FELT = 2.0
"""How many times the largest of them says that the other kind of sensor has felt it, too."""
BACK = 0.25
"""Of its distance, by which the next sample may miss the one before: more is a manoeuvre."""
LEAST_DISTANCE = 1e-2, 1e-3
"""m/s², rad/s: less, for one sample, does no harm."""
SENSORS = ("specific force", "angular rate")


class StuckError(BadMessageError):
    """A sample of which an axis has been stuck.

    Parameters
    ----------
    text : str
    samples : int
        How many samples before it were taken for true and are not, where that has just been found
        out; else 0.
    """

    def __init__(self, text: str, samples: int) -> None:
        super().__init__(text)
        self.samples = samples


class Watch:
    """Looks at samples one after the other.

    Parameters
    ----------
    acceleration, turn_rate : float
        Most that the vehicle can do, m/s² and rad/s; a sample beyond is a spike.
    clock : callable
        Wall time, s.
    noisy : (6,) array, optional
        Which axes have noise, so that a value does not come twice.
    """

    def __init__(
        self,
        acceleration: float,
        turn_rate: float,
        clock: Callable[[], float] = time.monotonic,
        noisy: Booleans | None = None,
    ) -> None:
        self._acceleration, self._turn_rate, self._clock = acceleration, turn_rate, clock
        self._noisy = [True] * 6 if noisy is None else noisy.tolist()
        self._last = [math.nan] * 6
        self._same, self._changes, self._longest = ([0] * 6 for _ in range(3))
        self._heard: float | None = None

    def take(self, force: Array, rate: Array) -> None:
        """Look at a sample (3,), (3,); raises BadMessageError where it cannot be true."""
        self._heard = self._clock()
        # of six numbers, lists are faster than arrays
        values = force.tolist() + rate.tolist()
        self._count(values)
        stuck = [axis for axis in range(6) if self._is_stuck(axis)]
        if stuck:
            same = [self._same[axis] for axis in stuck]
            new = all(self._same[axis] == self._limit(axis) for axis in stuck)
            raise StuckError(
                f"{_names(stuck)} stuck for {same[0] + 1} samples: taken as missing",
                max(same) if new else 0,
            )
        beyond = abs(math.hypot(*values[:3]) - GRAVITY)
        if beyond > self._acceleration:
            raise BadMessageError(
                f"specific force {beyond:.0f} m/s² beyond gravity; max_acceleration is"
                f" {self._acceleration:g} m/s²"
            )
        turn = math.hypot(*values[3:])
        if turn > self._turn_rate:
            raise BadMessageError(
                f"angular rate {turn:.2g} rad/s; max_turn_rate is {self._turn_rate:g} rad/s"
            )

    def _count(self, values: list[float]) -> None:
        """Count changes of each axis, and how often its value has come again."""
        for axis, value in enumerate(values):
            if value == self._last[axis]:
                self._same[axis] += 1
                continue
            rested = self._same[axis]
            if rested < self._limit(axis):
                self._longest[axis] = max(self._longest[axis], rested)
            self._changes[axis] += 1
            self._same[axis] = 0
        self._last = values

    def _limit(self, axis: int) -> int:
        """Return the repetitions after which an axis is stuck."""
        return max(LEAST, 4 * (self._longest[axis] + 1))

    def _is_stuck(self, axis: int) -> bool:
        known = self._noisy[axis] and self._changes[axis] >= LEARNT
        return known and self._same[axis] >= self._limit(axis)

    @property
    def stuck(self) -> str | None:
        """Which axes have not moved for long; None = all have."""
        resting = [axis for axis in range(6) if self._same[axis] >= STUCK]
        return f"stuck: {_names(resting)}" if resting else None

    @property
    def silent(self) -> str | None:
        """That there has been no sample for long; None = there has."""
        gone = 0.0 if self._heard is None else self._clock() - self._heard
        return f"no IMU samples for {gone:.0f} s of wall time" if gone > SILENT else None


def _names(axes: list[int]) -> str:
    return ", ".join(AXES[axis] for axis in axes)


class Leaps:
    """Holds a sample whose stamp leaps ahead back until the next one says that time has passed: a
    single wrong stamp would make the filter bridge hours, and refuse all samples after it.

    Parameters
    ----------
    longest : int
        Longest gap that is believed at once, ns.
    """

    def __init__(self, longest: int) -> None:
        self._longest = longest
        self._held: int | None = None

    def check(self, ns: int, newest: int) -> None:
        """Look at a stamp after the newest that was used; raises BadMessageError where it has to
        wait for the next."""
        if ns - newest <= self._longest:
            self._held = None
            return
        held, self._held = self._held, ns
        if held is None or not 0 < ns - held <= self._longest:
            raise BadMessageError(
                f"stamp is {(ns - newest) / 1e9:.0f} s ahead; used if the next one is, too"
            )


_Sample = tuple[list[float], list[float]]
"""Specific force and angular rate."""
_Pair = tuple[float, float]
"""Of both, m/s² and rad/s."""


class LoneSamples:
    """Finds a sample that differs from both its neighbours by much more than samples have differed
    for a while: a fault, not a motion. That shows when the next one comes.

    A motion that the accelerometers and the gyroscopes feel at once is believed.
    """

    def __init__(self) -> None:
        self._samples: deque[_Sample] = deque(maxlen=2)
        self._changes: deque[_Pair] = deque(maxlen=REMEMBERED)

    def take(self, force: Array, rate: Array) -> str | None:
        """Take a sample (3,), (3,), m/s² and rad/s; return what is wrong with the one before it,
        which is forgotten."""
        new = force.tolist(), rate.tolist()
        if len(self._samples) == 2:
            before, last = self._samples
            away = _distance(last, before)
            if (which := self._lone(away, _distance(new, before))) is not None:
                self._samples[-1] = new
                unit = ("m/s²", "rad/s")[which]
                return f"{SENSORS[which]} of one sample {away[which]:.2g} {unit} out of line"
            self._changes.append(away)
        self._samples.append(new)
        return None

    def _lone(self, away: _Pair, missed: _Pair) -> int | None:
        """Return which of `SENSORS` alone has felt something of which the next sample knows
        nothing; None = neither."""
        both = range(2)
        if len(self._changes) < REMEMBERED or all(away[k] <= LEAST_DISTANCE[k] for k in both):
            return None
        usual = [max(change[k] for change in self._changes) for k in both]
        felt = [k for k in both if away[k] > FELT * usual[k]]
        beyond = (max(BEYOND * usual[k], LEAST_DISTANCE[k]) for k in both)
        lone = [k for k, far in enumerate(beyond) if away[k] > far and missed[k] < BACK * away[k]]
        return lone[0] if lone and len(felt) == 1 else None


def _distance(one: _Sample, other: _Sample) -> _Pair:
    """Return how far apart two samples are, m/s² and rad/s."""
    return math.dist(one[0], other[0]), math.dist(one[1], other[1])
