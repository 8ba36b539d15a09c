"""What a map format is: how it is recognised and opened; and from what a file says to a map.
Formats are found by name (`isogal.plugins`)."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Values
from isogal.maps.axes import Read, Window, part_within
from isogal.maps.field_map import FieldMap
from isogal.maps.quantities import QUANTITIES, check_plausible, said, unit_factor, value_range


class Asked(NamedTuple):
    """What the user says of a file; None = nothing."""

    variable: str | None = None
    """Which variable, band, column or extension, where a source holds several."""
    quantity: str | None = None
    unit: str | None = None
    """Quantity and unit where the file does not say them, or says them wrong."""
    crs: str | None = None
    """Coordinate reference system, as ``EPSG:28355``."""


@dataclass(frozen=True, kw_only=True)
class FileGrid:
    """One grid of an open file: what the file says of it, and its numbers, read when asked for or
    before.

    The optional numbers below are fields of `FieldMap`; in the file's unit where they have one."""

    where: str
    """File and variable, for messages and provenance."""
    latitude: Array
    """(n,) rad, increasing."""
    longitude: Array
    """(m,) rad, increasing."""
    values: Values | Read
    """(n, m), NaN = missing; or what reads some of them."""
    unit: str | None = None
    quantity: str | None = None
    quantisation: float = 0.0
    sigma: float | Array | Read = 0.0
    sigma_unit: str | None = None
    """None = that of the values."""
    correlation_length: float | None = None
    error_ellipses: Read | None = None
    error_stated: bool | None = None
    unresolved: float = 0.0
    height: float | None = None

    def load(self, asked: Asked, window: Window | None) -> FieldMap:
        """Read the grid, or the part of it that a window needs: every format ends here. Units are
        converted, numbers that cannot be what the file says are refused.

        Raises
        ------
        InputError
            Nothing in the window, too much of it, quantity or unit unknown or not said, numbers
            that the quantity cannot have, and what `FieldMap` raises.
        """
        part = part_within(self.latitude, self.longitude, window, self.where)
        values = part.of(self.values)
        quantity, unit, factor = said(
            asked.quantity or self.quantity, asked.unit or self.unit, self.where
        )
        check_plausible(value_range(values), quantity, factor, self.where)
        of_sigma = unit_factor(self.sigma_unit or unit, self.where)[1]

        def at_nodes(nodes: Array | Read) -> Array:
            return np.asarray(part.of(nodes), dtype=np.float64)

        sigma = self.sigma if isinstance(self.sigma, float) else at_nodes(self.sigma)
        return FieldMap(
            part.latitude,
            part.longitude,
            values if factor == 1.0 else values * values.dtype.type(factor),
            unit=QUANTITIES[quantity].unit,
            quantity=quantity,
            sigma=sigma * of_sigma,
            correlation_length=self.correlation_length,
            error_ellipses=self.error_ellipses and at_nodes(self.error_ellipses),
            error_stated=self.error_stated,
            unresolved=self.unresolved * factor,
            quantisation=self.quantisation * factor,
            height=self.height,
            provenance=self.where,
            file_unit=unit,
            file_factor=factor,
        )


Reader = Callable[[Path, Asked, Window | None], FieldMap]
"""Reads a map, or what it has in a window with the nodes around it that interpolation needs;
raises InputError."""


@dataclass(frozen=True)
class Format:
    """One map format: its name in scenarios, what it recognises, and its reader."""

    name: str
    matches: Callable[[Path], bool]
    """Whether a file or folder has this format, by its name or by the names of its files."""
    read: Reader
    takes_crs: bool = False
    """Whether the reader heeds `Asked.crs`."""


Opener = Callable[[Path, Asked], AbstractContextManager[FileGrid]]
"""Opens a file as a context manager does, finds the grid that is asked for and what is said of
it; raises InputError for whatever is wrong with the file, also when it is read."""


def file_format(name: str, suffixes: tuple[str, ...], opener: Opener, crs: bool = False) -> Format:
    """Return the format of files that hold grids.

    Parameters
    ----------
    name : str
        In scenarios.
    suffixes : tuple of str
        Ends of the files' names, in any case: ``(".nc",)``.
    opener : Opener
        Opens one.
    crs : bool
        Whether it heeds `Asked.crs`.
    """

    def read(path: Path, asked: Asked, window: Window | None) -> FieldMap:
        with opener(path, asked) as grid:
            return grid.load(asked, window)

    return Format(name, lambda path: path.suffix.casefold() in suffixes, read, crs)
