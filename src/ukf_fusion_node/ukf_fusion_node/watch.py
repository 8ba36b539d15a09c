"""What is wrong with IMU samples that could each be right."""

import time
from collections.abc import Callable

import numpy as np

from isogal.arrays import Array
from isogal_ros.messages.checks import BadMessageError

AXES = (
    "accelerometer x", "accelerometer y", "accelerometer z",
    "gyroscope x", "gyroscope y", "gyroscope z",
)  # fmt: skip
STUCK = 60
"""Samples of exactly the same value after which an axis counts as stuck: noise never repeats."""
SILENT = 10.0
"""s of wall time without a sample that are an error."""
GRAVITY = 9.81


class Watch:
    """Looks at samples one after the other.

    Parameters
    ----------
    acceleration, turn_rate : float
        Most that the vehicle can do, m/s² and rad/s; a sample beyond is a spike.
    clock : callable
        Wall time, s.
    """

    def __init__(
        self, acceleration: float, turn_rate: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._acceleration, self._turn_rate, self._clock = acceleration, turn_rate, clock
        self._last = np.full(6, np.nan)
        self._same = np.zeros(6, int)
        self._heard: float | None = None

    def take(self, force: Array, rate: Array) -> None:
        """Look at a sample (3,), (3,); raises BadMessageError where it cannot be true."""
        self._heard = self._clock()
        values = np.concatenate([force, rate])
        self._same = np.where(values == self._last, self._same + 1, 0)
        self._last = values
        beyond = abs(float(np.linalg.norm(force)) - GRAVITY)
        if beyond > self._acceleration:
            raise BadMessageError(
                f"specific force {beyond:.0f} m/s² beyond gravity; max_acceleration is"
                f" {self._acceleration:g} m/s²"
            )
        turn = float(np.linalg.norm(rate))
        if turn > self._turn_rate:
            raise BadMessageError(
                f"angular rate {turn:.2g} rad/s; max_turn_rate is {self._turn_rate:g} rad/s"
            )

    @property
    def stuck(self) -> str:
        """Which axes have not moved for long; empty = none."""
        return ", ".join(
            name for name, count in zip(AXES, self._same, strict=True) if count >= STUCK
        )

    @property
    def silent(self) -> str | None:
        """That there has been no sample for long; None = there has."""
        gone = 0.0 if self._heard is None else self._clock() - self._heard
        return f"no IMU samples for {gone:.0f} s of wall time" if gone > SILENT else None


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
