"""Types of arrays, named once for the whole package."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Real numbers in double precision."""
Integers = NDArray[np.int64]
"""Indices and counts."""
Booleans = NDArray[np.bool_]
"""Masks."""
Values = NDArray[np.floating]
"""Of a map: in double precision, or in single where its file has no more."""
