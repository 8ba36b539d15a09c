"""Readings of a scalar and a vector magnetometer on one vehicle, and those of a base station."""

from dataclasses import dataclass, field

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.errors import InputError
from isogal.magnetics.terms import terms

_LEAST, _MOST = 10_000.0, 100_000.0
"""nT: no total field at the Earth's surface is outside."""
_DISAGREE = 0.2
"""Share of the total field by which the vector's length may differ from it."""
_LARGEST_VARIATION = 3000.0
"""nT, of a magnetic storm."""


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """N readings of both instruments at the same times.

    Raises
    ------
    InputError
        Times do not increase, or the numbers are no total field in nT.
    """

    time: Array
    """(N,) s, increasing."""
    total: Array
    """(N,) nT, of the scalar magnetometer; NaN = none."""
    vector: Array
    """(N, 3) nT, in axes fixed to the vehicle; NaN = none."""
    where: str
    """File, for messages."""
    currents: dict[str, Array] = field(default_factory=dict)
    """(N,) A each, by name, of circuits that are switched."""

    def __post_init__(self) -> None:
        _check_times(self.time, self.where)
        usable = self.usable
        if not usable.any():
            raise InputError(f"{self.where}: no row has readings of both magnetometers")
        total, length = self.total[usable], np.sqrt((self.vector[usable] ** 2).sum(axis=-1))
        middle, ratio = float(np.median(total)), float(np.median(length / total))
        if not _LEAST < middle < _MOST or abs(ratio - 1.0) > _DISAGREE:
            raise InputError(
                f"{self.where}: readings of the scalar magnetometer of {middle:.4g} (median), and"
                f" {ratio:.3g} times that of the vector magnetometer, are not the Earth's field in"
                " nT (10,000 to 100,000)"
            )

    def __len__(self) -> int:
        return self.time.size

    @property
    def usable(self) -> Booleans:
        """(N,) whether both instruments have a reading."""
        known: Booleans = np.isfinite(self.total) & np.isfinite(self.vector).all(axis=-1)
        for current in self.currents.values():
            known = known & np.isfinite(current)
        return known

    @property
    def interval(self) -> float:
        """Median time between readings, s."""
        return float(np.median(np.diff(self.time)))

    def require(self, names: tuple[str, ...]) -> None:
        """Raise InputError where a current was not recorded."""
        missing = [name for name in names if name not in self.currents]
        if missing:
            raise InputError(f"{self.where}: has no column 'current_{missing[0]}'")

    def terms(self, names: tuple[str, ...] = (), lag: float = 0.0) -> Array:
        """Return the (N, 18 + 3 K) terms of the model.

        Parameters
        ----------
        names : tuple of str
            Currents whose terms are wanted.
        lag : float
            s by which the vector magnetometer is late; its readings are interpolated.

        Raises
        ------
        InputError
            A current was not recorded.
        """
        self.require(names)
        vector = self.vector if lag == 0.0 else shifted(self.time, self.vector, lag)
        flow = np.stack([self.currents[name] for name in names], axis=-1) if names else None
        return terms(vector, np.gradient(vector, self.time, axis=0), self.total, flow)


def _check_times(time: Array, where: str) -> None:
    if time.size < 2 or not (np.diff(time) > 0.0).all():
        raise InputError(f"{where}: times must increase, and there must be two or more")


def shifted(time: Array, vector: Array, lag: float) -> Array:
    """Return what an instrument says that is late by `lag` (s) about the given times: its readings
    a lag later, by cubic splines; NaN beyond their ends."""
    from scipy.interpolate import CubicSpline

    known = np.isfinite(vector).all(axis=-1)
    spline = CubicSpline(time[known], vector[known], extrapolate=False)
    moved: Array = spline(time + lag)
    moved[~known] = np.nan
    return moved


@dataclass(frozen=True, slots=True, eq=False)
class BaseStation:
    """What a magnetometer that stays where it is has measured: the daily variation of the field
    (docs/magnetometer.md, section 4.2).

    Raises
    ------
    InputError
        Its readings are neither total fields nor variations in nT, or times do not increase.
    """

    time: Array
    """(N,) s, on the clock of the readings that it is taken off."""
    value: Array
    """(N,) nT: total field, or its variation about a normal value."""
    where: str
    """File, for messages."""

    def __post_init__(self) -> None:
        _check_times(self.time, self.where)
        middle = float(np.median(self.value))
        total = _LEAST < middle < _MOST
        if not total and not np.abs(self.value).max() < _LARGEST_VARIATION:
            raise InputError(
                f"{self.where}: readings of {middle:.4g} (median) are neither a total field nor"
                " its variation in nT"
            )

    def variation(self, time: Array, where: str) -> Array:
        """Return (N,) nT by how much the field was above its normal value: the median of total
        fields, zero of variations. Between readings it is interpolated linearly.

        Raises
        ------
        InputError
            The station was not on at all these times; `where` is the file that they are of.
        """
        if time[0] < self.time[0] or time[-1] > self.time[-1]:
            raise InputError(
                f"{self.where}: from {self.time[0]:.10g} to {self.time[-1]:.10g} s, does not cover"
                f" {where}, from {time[0]:.10g} to {time[-1]:.10g} s"
            )
        middle = float(np.median(self.value))
        return np.interp(time, self.time, self.value) - (middle if middle > _LEAST else 0.0)
