"""What the tests of `isogal match` share."""

import pytest

from helpers.tracks import FIELDS, field_of, made_track, write_csv
from isogal.maps.formats.netcdf_writing import write_netcdf


@pytest.fixture(scope="package")
def files(tmp_path_factory):
    """By quantity: map, track, 1-sigma of its readings, true latitude and longitude (rad). The
    navigator was 700 m too far north and 500 m too far west."""
    folder = tmp_path_factory.mktemp("match")
    result = {}
    for quantity in FIELDS:
        field_map = field_of(quantity)
        sigma = 1e-5 * FIELDS[quantity][1]
        track, latitude, longitude = made_track(field_map, error=(700.0, -500.0), sigma=sigma)
        map_file, track_file = (folder / f"{quantity}.{suffix}" for suffix in ("nc", "csv"))
        write_netcdf(field_map, map_file)
        write_csv(track_file, track)
        result[quantity] = map_file, track_file, sigma, latitude, longitude
    return result
