"""NetCDF files that were written are read back, and appear whole or not at all."""

from dataclasses import replace

import numpy as np
import pytest

from isogal.errors import InputError
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map


@pytest.mark.parametrize("sigma", [0.0, 3e-5, "grid"])
def test_round_trip(tmp_path, small_map, sigma):
    if sigma == "grid":
        sigma = np.linspace(1e-5, 2e-5, small_map.values.size).reshape(small_map.values.shape)
    values = small_map.values.copy()
    values[3, 4] = np.nan
    said = {"correlation_length": 4000.0, "quantisation": 1e-6, "height": 50.0}
    field_map = replace(small_map, values=values, sigma=sigma, error_stated=False, **said)
    write_netcdf(field_map, tmp_path / "out.nc")
    read = load_map(tmp_path / "out.nc")
    for name in ("latitude", "longitude"):
        np.testing.assert_allclose(getattr(read, name), getattr(field_map, name), atol=1e-14)
    np.testing.assert_array_equal(read.values, values)
    np.testing.assert_array_equal(read.sigma, sigma)
    assert {name: getattr(read, name) for name in said} == said
    assert (read.quantity, read.error_stated) == ("disturbance", False)
    assert [p.name for p in tmp_path.iterdir()] == ["out.nc"]


def test_no_file_is_left_half_written(tmp_path, small_map, monkeypatch):
    with pytest.raises(InputError, match="is a file, where a folder is needed"):
        write_netcdf(small_map, "/dev/null/out.nc")
    write_netcdf(small_map, tmp_path / "out.nc")
    before = (tmp_path / "out.nc").read_bytes()

    def full_disk(field_map, path, name):
        path.write_bytes(b"half")
        raise RuntimeError("NetCDF: HDF error")

    monkeypatch.setattr("isogal.maps.formats.netcdf_writing._write", full_disk)
    with pytest.raises(InputError, match="cannot be written: NetCDF: HDF error"):
        write_netcdf(small_map, tmp_path / "out.nc")
    assert (tmp_path / "out.nc").read_bytes() == before and len(list(tmp_path.iterdir())) == 1
