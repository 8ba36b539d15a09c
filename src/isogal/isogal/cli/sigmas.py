"""Sigmas on the command line: numbers in the unit of the track, or of a map inside (SI, nT), or
with a unit of their own."""

import math
import re
from typing import TYPE_CHECKING

from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.tiled_map import ScalarMap

_TEXT = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*)?$")
_PLAUSIBLE = (1e-5, 0.5)
"""Shares of the map's range between which a sigma makes sense; none is larger than all that the
map shows."""


def factor_of(unit: str, option: str, field_map: "ScalarMap") -> float:
    """Return how many units inside a unit has; raises InputError where it is not one of the
    map's."""
    from isogal.maps.quantities import unit_factor

    inside, factor = unit_factor(unit, option)
    if inside != field_map.unit:
        raise InputError(
            f"{option}: '{unit}' does not fit a {field_map.quantity} map, which is in"
            f" {field_map.file_unit}"
        )
    return factor


def parse_sigma(
    text: str | None,
    option: str,
    field_map: "ScalarMap",
    factor: float,
    *,
    zero: bool = True,
    possible: bool = False,
) -> float | None:
    """Return a sigma in the unit inside; None where none is given.

    Parameters
    ----------
    text : str, optional
        Such as ``0.5``, or ``0.5mGal``.
    option : str
        For messages.
    field_map : ScalarMap
        Whose unit and range it must fit.
    factor : float
        Units inside in one unit of a number that has none.
    zero : bool
        Whether 0 is allowed.
    possible : bool
        Compare with what a map of this quantity can vary by, instead of this map, which may be a
        small part.

    Raises
    ------
    InputError
        It is no number, its unit is not the map's, it is negative, or larger than that range:
        then the message says in which unit it would make sense.
    """
    from isogal.maps.quantities import fitting_unit

    if text is None:
        return None
    found = _TEXT.match(text)
    if found is None:
        raise InputError(f"{option}: must be a number, or one with its unit, not '{text}'")
    number = float(found[1])
    value = number * (factor_of(found[2], option, field_map) if found[2] else factor)
    if not math.isfinite(value) or value < 0.0 or (value == 0.0 and not zero):
        raise InputError(f"{option}: must be {'>=' if zero else '>'} 0, is {number:g}")
    extent = _extent(field_map, possible)
    if value <= extent or extent == 0.0:
        return value
    least, most = (share * extent for share in _PLAUSIBLE)
    unit = fitting_unit(field_map.unit, lambda one: least <= number * one <= most)
    hint = f"; did you mean {number:g}{unit}?" if unit else ""
    own = field_map.file_factor
    raise InputError(
        f"{option}: {value / own:g} {field_map.file_unit} is more than"
        f" {f'any {field_map.quantity} map' if possible else 'the whole map'} varies"
        f" ({extent / own:.3g} {field_map.file_unit}){hint}"
    )


def _extent(field_map: "ScalarMap", possible: bool) -> float:
    """Return by how much a map varies, or any map of its quantity can."""
    import numpy as np

    from isogal.maps.quantities import QUANTITIES

    if possible:
        return QUANTITIES[field_map.quantity].highest - QUANTITIES[field_map.quantity].lowest
    known = (part.values[np.isfinite(part.values)] for part in field_map.parts())
    ends = [(float(part.min()), float(part.max())) for part in known if part.size]
    return max(high for _, high in ends) - min(low for low, _ in ends)
