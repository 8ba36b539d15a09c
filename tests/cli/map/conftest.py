"""What the tests of `isogal map` share."""

import pytest

from isogal.maps.formats.netcdf_writing import write_netcdf


@pytest.fixture
def file(small_map, tmp_path):
    """A map of gravity disturbances."""
    write_netcdf(small_map, tmp_path / "map.nc")
    return str(tmp_path / "map.nc")
