"""A small map that every format can hold."""

import numpy as np
import pytest

from helpers.example_field import disturbance
from isogal.maps.field_map import FieldMap


@pytest.fixture(scope="session")
def small_map():
    """20 x 24 nodes, 0.05 deg apart, near 37 S, 145 E."""
    lat, lon = -37.0 + 0.05 * np.arange(20), 144.5 + 0.05 * np.arange(24)
    return FieldMap(
        np.radians(lat),
        np.radians(lon),
        disturbance(lat[:, None], lon[None, :]),
        "m/s²",
        "disturbance",
        provenance="small",
    )
