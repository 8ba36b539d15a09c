"""A map with gravity and disturbance, and a reproduction of the paper on it in miniature."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.map_files import together
from isogal.earth.gravity import normal_gravity
from isogal.maps.field_map import FieldMap


@pytest.fixture(scope="session")
def two_maps(tmp_path_factory):
    """A NetCDF file with `ga` and `dg`: waves of 30 mGal and a few kilometres along the first 100
    km of the default route."""
    latitude = np.radians(np.linspace(-38.3, -37.2, 367))
    longitude = np.radians(np.linspace(144.2, 145.9, 426))
    north, east = latitude[:, None] * 6.4e6, longitude[None, :] * 5.0e6
    waves = 3e-4 * np.sin(north / 2500.0) * np.cos(east / 3100.0 + north / 9000.0)
    disturbance = FieldMap(latitude, longitude, waves, "m/s²", "disturbance")
    gravity = waves + normal_gravity(latitude)[:, None]
    return together(
        tmp_path_factory.mktemp("maps") / "waves.nc",
        replace(disturbance, values=gravity, quantity="gravity"),
        disturbance,
        names=("ga", "dg"),
    )
