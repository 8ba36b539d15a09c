"""A map with gravity and disturbance, and a reproduction of the paper on it in miniature."""

import numpy as np
import pytest

from isogal.earth.gravity import normal_gravity


@pytest.fixture(scope="session")
def two_maps(tmp_path_factory):
    """A NetCDF file with `ga` and `dg`: waves of 30 mGal and a few kilometres along the first 100
    km of the default route."""
    import xarray

    latitude, longitude = np.linspace(-38.3, -37.2, 367), np.linspace(144.2, 145.9, 426)
    north, east = np.radians(latitude[:, None]) * 6.4e6, np.radians(longitude[None, :]) * 5.0e6
    waves = 3e-4 * np.sin(north / 2500.0) * np.cos(east / 3100.0 + north / 9000.0)
    gravity = normal_gravity(np.radians(latitude))[:, None] + waves
    path = tmp_path_factory.mktemp("maps") / "waves.nc"
    xarray.Dataset(
        {
            "ga": (("latitude", "longitude"), gravity, {"units": "m s-2", "long_name": "gravity"}),
            "dg": (
                ("latitude", "longitude"),
                waves,
                {"units": "m s-2", "long_name": "gravity disturbance"},
            ),
        },
        {
            "latitude": ("latitude", latitude, {"units": "degrees_north"}),
            "longitude": ("longitude", longitude, {"units": "degrees_east"}),
        },
    ).to_netcdf(path)
    return path
