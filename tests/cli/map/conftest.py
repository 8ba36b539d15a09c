"""What the tests of `isogal map` share."""

import pytest

from isogal.maps.formats.netcdf_writing import write_netcdf


@pytest.fixture(scope="package", autouse=True)
def own_cache(tmp_path_factory):
    """Keep the tiles of the synthetic map out of the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ISOGAL_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def file(small_map, tmp_path):
    """A map of gravity disturbances."""
    write_netcdf(small_map, tmp_path / "map.nc")
    return str(tmp_path / "map.nc")
