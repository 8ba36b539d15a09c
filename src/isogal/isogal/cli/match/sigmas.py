"""Sigmas on the command line: numbers in the track's unit, or with a unit of their own."""

import math
import re
from typing import TYPE_CHECKING

from isogal.errors import InputError

if TYPE_CHECKING:
    from isogal.maps.tiled_map import ScalarMap

_TEXT = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*)?$")
_LARGEST_SHARE = 1.0
"""Of the map's range: no error is larger than all that the map shows."""
_PLAUSIBLE = (1e-5, 0.5)
"""Shares of the map's range between which a sigma makes sense."""


def parse_sigma(
    text: str | float, option: str, field_map: "ScalarMap", factor: float, *, zero: bool = True
) -> float:
    """Return a sigma in the unit inside.

    Parameters
    ----------
    text : str or float
        Such as ``0.5``, in the track's unit, or ``0.5mGal``.
    option : str
        For messages.
    field_map : ScalarMap
        Whose unit and range it must fit.
    factor : float
        Units inside in one unit of the track.
    zero : bool
        Whether 0 is allowed.

    Raises
    ------
    InputError
        It is no number, its unit is not the map's, it is negative, or larger than the map's range:
        then the message says in which unit it would make sense.
    """
    from isogal.maps.quantities import unit_factor

    found = _TEXT.match(str(text))
    if found is None:
        raise InputError(f"{option}: must be a number, or one with its unit, not '{text}'")
    number, unit = float(found[1]), found[2]
    if unit is not None:
        inside, factor = unit_factor(unit, option)
        if inside != field_map.unit:
            raise InputError(
                f"{option}: '{unit}' does not fit a {field_map.quantity} map, which is in"
                f" {field_map.file_unit}"
            )
    value = number * factor
    if not math.isfinite(value) or value < 0.0 or (value == 0.0 and not zero):
        raise InputError(f"{option}: must be {'>=' if zero else '>'} 0, is {number:g}")
    _check_size(value, number, option, field_map)
    return value


def _check_size(value: float, number: float, option: str, field_map: "ScalarMap") -> None:
    import numpy as np

    from isogal.maps.quantities import UNITS

    values = np.concatenate([np.ravel(part.values) for part in field_map.parts()])
    extent = float(np.nanmax(values) - np.nanmin(values))
    if value <= _LARGEST_SHARE * extent or extent == 0.0:
        return
    least, most = (share * extent for share in _PLAUSIBLE)
    fitting = [
        name
        for name, (inside, factor) in UNITS.items()
        if inside == field_map.unit and least <= number * factor <= most
    ]
    preferred = [name for name in ("mGal", "nT", "m") if name in fitting] or fitting
    hint = f"; did you mean {number:g}{preferred[0]}?" if preferred else ""
    own = field_map.file_factor
    raise InputError(
        f"{option}: {value / own:g} {field_map.file_unit} is more than the whole map varies"
        f" ({extent / own:.3g} {field_map.file_unit}){hint}"
    )
