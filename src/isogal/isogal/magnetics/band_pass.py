"""The band in which an aeroplane's manoeuvres are (docs/magnetometer.md, section 3)."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.errors import InputError

_ORDER = 4
_UNEVEN = 0.5
"""Of the interval: a step between readings that differs by more ends a stretch."""
_HIGHEST = 0.8
"""Of the Nyquist frequency: above it the upper edge means nothing."""


@dataclass(frozen=True)
class Band:
    """Frequencies that are kept, Hz. Slower ones hold geology and the daily variation, faster
    ones noise (Gnadt et al. 2022 have the same values)."""

    low: float = 0.1
    high: float = 0.9

    def __post_init__(self) -> None:
        if not 0.0 < self.low < self.high:
            raise InputError(
                f"band: must be 0 < low < high in Hz, is {self.low:g} to {self.high:g}"
            )

    @property
    def settling(self) -> float:
        """s at each end of a stretch that are left out, where the filter has not settled."""
        return 0.5 / self.low

    def check(self, interval: float, where: str) -> None:
        """Raise InputError if readings at this interval (s) cannot hold the band."""
        if self.low * 4.0 * interval > 1.0:
            raise InputError(
                f"{where}: readings every {interval:g} s are too far apart for the band from"
                f" {self.low:g} Hz; at least {4.0 * self.low:g} in a second are needed"
            )

    def apply(self, columns: Array, interval: float) -> Array:
        """Return (N, C) columns at an even interval (s), filtered forwards and backwards, without
        a delay, by a Butterworth filter of fourth order."""
        from scipy.signal import butter, sosfiltfilt

        rate = 1.0 / interval
        if self.high < _HIGHEST * rate / 2.0:
            sos = butter(_ORDER, (self.low, self.high), "bandpass", fs=rate, output="sos")
        else:
            sos = butter(_ORDER, self.low, "highpass", fs=rate, output="sos")
        return sosfiltfilt(sos, columns, axis=0)


def stretches(time: Array, usable: Booleans, interval: float) -> list[slice]:
    """Return the stretches of even, usable readings."""
    step = np.abs(np.diff(time) - interval) > _UNEVEN * interval
    begins = np.flatnonzero(usable & np.r_[True, step | ~usable[:-1]])
    ends = np.flatnonzero(usable & np.r_[step | ~usable[1:], True]) + 1
    return [slice(int(a), int(b)) for a, b in zip(begins, ends, strict=True)]


def filtered(time: Array, columns: Array, usable: Booleans, band: Band) -> tuple[Array, Booleans]:
    """Return (N, C) columns in the band, and (N,) where they hold: not near gaps and ends.

    Parameters
    ----------
    time : (N,) array
        s, of the readings.
    columns : (N, C) array
    usable : (N,) array
        Which readings there are.
    band : Band
    """
    interval = float(np.median(np.diff(time)))
    result, holds = np.full(columns.shape, np.nan), np.zeros(time.size, bool)
    edge = int(np.ceil(band.settling / interval))
    for part in stretches(time, usable, interval):
        if part.stop - part.start <= 4 * edge:
            continue
        result[part] = band.apply(columns[part], interval)
        holds[part.start + edge : part.stop - edge] = True
    return result, holds
