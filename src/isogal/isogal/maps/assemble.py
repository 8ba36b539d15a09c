"""From the contents of a file to a `FieldMap`: units, plausibility, size, and what the user has to
say because the file does not."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.axes import MOST_CELLS, TooManyCellsError, Window
from isogal.maps.field_map import FieldMap
from isogal.maps.quantities import (
    QUANTITIES,
    check_plausible,
    check_quantity,
    unit_factor,
    value_range,
)

_ONCE = ", or make a file that says so with 'isogal map convert'"


def check_size(cells: int, where: str, window: Window | None = None) -> None:
    """Refuse a grid that would take too much memory, before anything is read.

    Raises
    ------
    TooManyCellsError
        Names the number of cells.
    """
    most = MOST_CELLS if window is None else window.most_cells
    if cells > most:
        raise TooManyCellsError(
            f"{where}: {cells:,} cells are too many to read at once (at most {most:,}); give"
            " a window or a route"
        )


def said(quantity: str | None, unit: str | None, where: str) -> tuple[str, str, float]:
    """Return quantity, unit and the factor to the unit inside, provided that both are given and
    fit each other.

    Raises
    ------
    InputError
        Not said, unknown, or not fitting.
    """
    if quantity is None:
        raise InputError(
            f"{where}: does not say what it is a map of; give quantity= (--quantity) one of"
            f" {', '.join(QUANTITIES)}{_ONCE}"
        )
    known = check_quantity(quantity, where)
    if unit is None:
        raise InputError(
            f"{where}: does not say its unit; give unit= (--unit; for {quantity}: {known.unit} or"
            f" one that converts to it){_ONCE}"
        )
    inside, factor = unit_factor(unit, where)
    if inside != known.unit:
        raise InputError(f"{where}: unit '{unit}' does not fit a {quantity} map ({known.unit})")
    return quantity, unit, factor


def assemble(
    latitude: Array,
    longitude: Array,
    values: NDArray[Any],
    *,
    unit: str | None,
    quantity: str | None,
    where: str,
    sigma: Any = 0.0,
    **attributes: Any,
) -> FieldMap:
    """Convert to the unit inside, refuse impossible numbers, and build the map.

    Parameters
    ----------
    latitude, longitude : (n,), (m,) rad
        Increasing.
    values : (n, m)
        In ``unit``; NaN = missing.
    unit, quantity : str or None
        As the file says or the user gave; None = not known.
    where : str
        File and variable, for messages and provenance.
    sigma : float or (n, m)
        1-sigma, in ``unit``.
    attributes
        Further fields of `FieldMap`; ``quantisation`` in ``unit``.

    Raises
    ------
    InputError
        Quantity or unit unknown or not given, numbers that the quantity cannot have, and what
        `FieldMap` raises.
    """
    quantity, unit, factor = said(quantity, unit, where)
    check_plausible(value_range(values), quantity, factor, where)
    if factor != 1.0:
        values = (
            np.asarray(values) * values.dtype.type(factor)
            if values.dtype == np.float32
            else values * factor
        )
    attributes["quantisation"] = attributes.get("quantisation", 0.0) * factor
    return FieldMap(
        latitude,
        longitude,
        values,
        unit=QUANTITIES[quantity].unit,
        quantity=quantity,
        sigma=(
            np.asarray(sigma, dtype=np.float64) * factor
            if np.ndim(sigma)
            else float(sigma) * factor
        ),
        provenance=where,
        file_unit=unit,
        file_factor=factor,
        **attributes,
    )
