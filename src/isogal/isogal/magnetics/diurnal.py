"""The daily variation of the field, by a base station (docs/magnetometer.md, section 4.2)."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.magnetics.readings import LEAST, MOST

_LARGEST_VARIATION = 3000.0
"""nT, of a magnetic storm."""


@dataclass(frozen=True, slots=True, eq=False)
class BaseStation:
    """What a magnetometer that stays where it is has measured.

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
        if self.time.size < 2 or not (np.diff(self.time) > 0.0).all():
            raise InputError(f"{self.where}: times must increase, and there must be two or more")
        middle = float(np.median(self.value))
        total = LEAST < middle < MOST
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
        return np.interp(time, self.time, self.value) - (middle if middle > LEAST else 0.0)
