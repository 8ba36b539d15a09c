"""Maps around the default route's start, for the tests of the bound."""

from typing import Any

import numpy as np

from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.field_map import FieldMap


def field(function: Any, step_deg: float = 0.01, **changes: Any) -> FieldMap:
    """Map of function(north m, east m) round the default route's start."""
    latitude = np.radians(np.arange(-38.2, -37.2, step_deg))
    longitude = np.radians(np.arange(144.3, 146.0, step_deg))
    north, east = metres_per_radian(np.radians(-38.0))
    values = function(
        (latitude[:, None] - latitude[0]) * north, (longitude[None, :] - longitude[0]) * east
    )
    return FieldMap(latitude, longitude, values, "m/s²", "gravity", **changes)


def tilted(north: float, east: float, **changes: Any) -> FieldMap:
    return field(lambda n, e: 9.8 + north * n + east * e, **changes)


def waves(n: np.ndarray, e: np.ndarray) -> np.ndarray:
    return 9.8 + 2e-4 * np.sin(n / 2e3) * np.cos(e / 2.5e3) + 1e-4 * np.sin((n + 2 * e) / 4e3)


def made_up(
    unit: str = "m/s²",
    quantity: str = "gravity",
    level: float = 9.8,
    turn: float = 0.0,
    provenance: str = "",
) -> FieldMap:
    """Waves about the tracks of made-up records; longitudes may count from another turn (deg)."""
    latitude, longitude = (
        np.radians(np.arange(-38.5, -36.5, 0.02)),
        np.radians(np.arange(144.0, 146.6, 0.02) + turn),
    )
    values = level + 3e-4 * np.sin(latitude[:, None] * 300) * np.cos(longitude[None, :] * 250)
    return FieldMap(latitude, longitude, values, unit, quantity, provenance=provenance)
