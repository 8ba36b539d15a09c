"""Types of arrays, named once for the whole package."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isogal.errors import InputError

Array = NDArray[np.float64]
"""Real numbers in double precision."""
Integers = NDArray[np.int64]
"""Indices and counts."""
Booleans = NDArray[np.bool_]
"""Masks."""
Values = NDArray[np.floating]
"""Of a map: in double precision, or in single where its file has no more."""


def real_numbers(given: Any, what: str) -> Values:
    """Return what a caller gives (list, array, column of a table) as an array of its own
    precision, in which masked numbers, such as netCDF4 gives, are NaN.

    Raises
    ------
    InputError
        They are no real numbers, but dates, say, whose unit nobody knows.
    """
    array = np.asarray(given)
    if array.dtype.kind not in "fiub":
        raise InputError(f"{what} must be numbers, is of type {array.dtype}")
    if isinstance(given, np.ma.MaskedArray):
        array = np.where(np.ma.getmaskarray(given), np.nan, array)
    return array
