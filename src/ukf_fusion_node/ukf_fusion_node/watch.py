"""What is wrong with IMU samples that could each be right."""

import math
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from isogal.arrays import Array, Booleans, Integers
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
LEAST_DISTANCE = np.array([1e-2, 1e-3])
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
        self._noisy = np.ones(6, bool) if noisy is None else noisy
        self._last = np.full(6, np.nan)
        self._same, self._changes, self._longest = (np.zeros(6, int) for _ in range(3))
        self._heard: float | None = None

    def take(self, force: Array, rate: Array) -> None:
        """Look at a sample (3,), (3,); raises BadMessageError where it cannot be true."""
        self._heard = self._clock()
        values = np.concatenate([force, rate])
        self._count(values)
        limit = self._limit
        stuck = self._noisy & (self._changes >= LEARNT) & (self._same >= limit)
        if stuck.any():
            axis = int(np.argmax(stuck))
            new = bool((self._same[stuck] == limit[stuck]).all())
            raise StuckError(
                f"{_names(stuck)} stuck for {self._same[axis] + 1} samples: taken as missing",
                int(self._same[stuck].max()) if new else 0,
            )
        beyond = abs(_length(force) - GRAVITY)
        if beyond > self._acceleration:
            raise BadMessageError(
                f"specific force {beyond:.0f} m/s² beyond gravity; max_acceleration is"
                f" {self._acceleration:g} m/s²"
            )
        turn = _length(rate)
        if turn > self._turn_rate:
            raise BadMessageError(
                f"angular rate {turn:.2g} rad/s; max_turn_rate is {self._turn_rate:g} rad/s"
            )

    def _count(self, values: Array) -> None:
        """Count changes of each axis, and how often its value has come again."""
        moved = values != self._last
        if not moved.all() or self._same.any():
            rested = moved & (self._same < self._limit)
            self._longest = np.where(rested, np.maximum(self._longest, self._same), self._longest)
        self._changes += moved
        self._same = np.where(moved, 0, self._same + 1)
        self._last = values

    @property
    def _limit(self) -> Integers:
        """(6,) repetitions after which an axis is stuck."""
        return np.maximum(LEAST, 4 * (self._longest + 1))

    @property
    def stuck(self) -> str | None:
        """Which axes have not moved for long; None = all have."""
        resting = self._same >= STUCK
        return f"stuck: {_names(resting)}" if resting.any() else None

    @property
    def silent(self) -> str | None:
        """That there has been no sample for long; None = there has."""
        gone = 0.0 if self._heard is None else self._clock() - self._heard
        return f"no IMU samples for {gone:.0f} s of wall time" if gone > SILENT else None


def _names(axes: Booleans) -> str:
    return ", ".join(name for name, which in zip(AXES, axes, strict=True) if which)


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


class LoneSamples:
    """Finds a sample that differs from both its neighbours by much more than samples have differed
    for a while: a fault, not a motion. That shows when the next one comes.

    A motion that the accelerometers and the gyroscopes feel at once is believed.
    """

    def __init__(self) -> None:
        self._samples: deque[tuple[Array, Array]] = deque(maxlen=2)
        self._changes = np.zeros((REMEMBERED, 2))
        self._seen = 0
        """Changes so far: the newest takes the place of the oldest."""

    def take(self, force: Array, rate: Array) -> str | None:
        """Take a sample (3,), (3,), m/s² and rad/s; return what is wrong with the one before it,
        which is forgotten."""
        new = force, rate
        if len(self._samples) == 2:
            before, last = self._samples
            away, missed = _distance(last, before), _distance(new, before)
            if self._seen >= REMEMBERED:
                usual = self._changes.max(axis=0)
                lone = (away > np.maximum(BEYOND * usual, LEAST_DISTANCE)) & (missed < BACK * away)
                if lone.any() and (away > FELT * usual).sum() == 1:
                    self._samples.pop()
                    self._samples.append(new)
                    which = int(np.argmax(lone))
                    unit = ("m/s²", "rad/s")[which]
                    return f"{SENSORS[which]} of one sample {away[which]:.2g} {unit} out of line"
            self._changes[self._seen % REMEMBERED] = away
            self._seen += 1
        self._samples.append(new)
        return None


def _distance(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Return (2,) how far apart two samples are, m/s² and rad/s."""
    return np.array([_length(a - b) for a, b in zip(one, other, strict=True)])


def _length(vector: Array) -> float:
    return math.sqrt(vector @ vector)
