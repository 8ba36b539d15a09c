"""Readings of a scalar and a vector magnetometer on one vehicle."""

from dataclasses import dataclass, field

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.errors import InputError
from isogal.magnetics.terms import derivative, terms

LEAST, MOST = 10_000.0, 100_000.0
"""nT: no total field at the Earth's surface is outside."""
_DISAGREE = 0.2
"""Share of the total field by which the vector's length may differ from it."""


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
        if self.time.size < 2 or not (np.diff(self.time) > 0.0).all():
            raise InputError(f"{self.where}: times must increase, and there must be two or more")
        usable = self.usable
        if not usable.any():
            raise InputError(f"{self.where}: no row has readings of both magnetometers")
        length = np.sqrt((self.vector[usable] ** 2).sum(axis=-1))
        for name, value in (("scalar", self.total[usable]), ("vector", length)):
            middle = float(np.median(value))
            if not LEAST < middle < MOST:
                raise InputError(
                    f"{self.where}: readings of the {name} magnetometer of {middle:.4g} (median)"
                    " are not the Earth's field in nT (10,000 to 100,000); give total fields, in"
                    " nT"
                )
        ratio = float(np.median(length / self.total[usable]))
        if abs(ratio - 1.0) > _DISAGREE:
            raise InputError(
                f"{self.where}: the vector magnetometer's length is {ratio:.2f} of the scalar"
                " magnetometer's reading; both must be total fields in nT"
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
        return terms(vector, derivative(vector, self.time), self.total, flow)


def shifted(time: Array, vector: Array, lag: float) -> Array:
    """Return what an instrument says that is late by `lag` (s) about the given times: its readings
    a lag later, by cubic splines; NaN beyond their ends."""
    from scipy.interpolate import CubicSpline

    known = np.isfinite(vector).all(axis=-1)
    spline = CubicSpline(time[known], vector[known], extrapolate=False)
    moved: Array = spline(time + lag)
    moved[~known] = np.nan
    return moved
