"""NetCDF: CF and GMT conventions in every arrangement, what is refused, and what is written."""

from dataclasses import replace

import netCDF4
import numpy as np
import pytest

from helpers.map_files import axes, netcdf, refused
from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map

OTHER = {"lat": "north", "lon": "east", "z": "field"}
GMT = {"lat": "y", "lon": "x", "z": "z"}
PART = Window(*np.radians([-36.6, -36.4, 145.0, 145.2]))


def same(one, other, tolerance=1e-15):
    assert (one.unit, one.quantity) == (other.unit, other.quantity)
    lat, lon = np.meshgrid(other.latitude[2:-2], other.longitude[2:-2], indexing="ij")
    known = other.value(lat + 1e-5, lon + 1e-5)
    assert np.isfinite(known).all()
    np.testing.assert_allclose(one.value(lat + 1e-5, lon + 1e-5), known, rtol=0, atol=tolerance)


@pytest.mark.parametrize(
    "arrangement",
    [
        {},
        {"flip": ("lat", "lon"), "order": ("lon", "lat")},
        {"turn": -360.0},
        {"radians": True},
        {"extra": ("time", "level")},
        {"pack": (3e-8, 1e-4)},
        {"names": GMT, "long_name": "gravity disturbance"},
        {"names": OTHER, "standard_name": "gravity_disturbance"},
    ],
    ids=str,
)
def test_every_arrangement_is_the_same_map(tmp_path, small_map, arrangement):
    path = netcdf(tmp_path / "map.nc", small_map, **arrangement)
    same(load_map(path), small_map, 2e-8 if "pack" in arrangement else 1e-15)
    part = load_map(path, window=PART)
    assert part.values.shape < small_map.values.shape
    lat, lon = np.radians([-36.6, -36.45, -36.4]), np.radians([145.0, 145.11, 145.2])
    np.testing.assert_allclose(part.value(lat, lon), small_map.value(lat, lon), atol=2e-8)


@pytest.mark.parametrize(
    ("units", "factor"),
    [("milligal", 1e5), ("µGal", 1e8), ("1e-5 m s-2", 1e5)],
)
def test_units_are_converted(tmp_path, small_map, units, factor):
    scaled = replace(small_map, values=small_map.values * factor)
    read = load_map(netcdf(tmp_path / "map.nc", scaled, units=units))
    same(read, small_map, 1e-12)
    assert read.file_unit == units and read.file_factor == pytest.approx(1.0 / factor)


def test_heights_may_be_in_feet(tmp_path, small_map):
    feet = netcdf(tmp_path / "map.nc", replace(small_map, values=1e6 * small_map.values))
    read = load_map(feet, "dg", quantity="height", unit="ft")
    assert (read.unit, read.file_unit) == ("m", "ft")
    np.testing.assert_allclose(read.values, 0.3048e6 * small_map.values, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("own", ["mGal", None])
def test_a_sigma_beside_the_values_is_in_its_own_unit_or_theirs(tmp_path, small_map, own):
    path = netcdf(tmp_path / "map.nc", small_map)
    with netCDF4.Dataset(path, "a") as dataset:
        sigma = dataset.createVariable("dg_sigma", "f8", ("lat", "lon"))
        sigma[:] = 2.0 if own else 2e-5
        if own:
            sigma.units = own
    np.testing.assert_allclose(load_map(path).sigma, np.full(small_map.shape, 2e-5))


def test_what_the_file_does_not_say_is_asked_for(tmp_path, small_map):
    silent = netcdf(tmp_path / "silent.nc", small_map, units=None)
    assert "does not say its unit; give unit= (--unit;" in refused(silent)
    same(load_map(silent, unit="m/s²"), small_map)
    nameless = netcdf(tmp_path / "nameless.nc", small_map, names=GMT)
    words = "does not say what it is a map of; give quantity= (--quantity) one of"
    assert words in refused(nameless)
    same(load_map(nameless, quantity="disturbance"), small_map)


def test_missing_values(tmp_path, small_map):
    lacking = float(small_map.values[5, 7])
    read = load_map(netcdf(tmp_path / "map.nc", small_map, missing_value=lacking))
    assert np.argwhere(np.isnan(read.values)).tolist() == [[5, 7]]
    least = float(np.sort(small_map.values.ravel())[3])
    path = netcdf(tmp_path / "range.nc", small_map, valid_min=least)
    assert np.isnan(load_map(path).values).sum() == 3


def test_a_global_map_from_0_to_360_cut_at_greenwich(tmp_path):
    lat, lon = np.radians(np.arange(-60.0, 61.0, 2.0)), np.radians(np.arange(0.0, 360.0, 2.0))
    values = 1e-4 * np.cos(lon) * np.ones((lat.size, 1))
    path = netcdf(tmp_path / "global.nc", FieldMap(lat, lon, values, "m/s²", "disturbance"))
    whole = load_map(path)
    part = load_map(path, window=Window(*np.radians([-5.0, 5.0, -7.0, 9.0])))
    assert whole.longitude.size == 180 and part.values.shape[1] < 20
    for read in (whole, part):
        for degrees in (-6.9, 0.0, 8.9, 352.0):
            expected = pytest.approx(1e-4 * np.cos(np.radians(degrees)), abs=1e-8)
            assert read.value(0.01, np.radians(degrees)) == expected


def test_longitudes_that_jump_at_180(tmp_path, small_map):
    shifted = replace(small_map, longitude=np.radians(179.5 + 0.05 * np.arange(24)))
    path = netcdf(tmp_path / "map.nc", shifted)
    with netCDF4.Dataset(path, "a") as dataset:
        dataset["lon"][:] = (dataset["lon"][:] + 180.0) % 360.0 - 180.0
    same(load_map(path), shifted)


@pytest.mark.parametrize(
    ("offset", "factor", "units", "asked", "words"),
    [
        (0.0, 1.0, "furlong", {}, "unknown unit 'furlong'; must be one of m/s²"),
        (0.0, 1.0, "nT", {}, "a disturbance map: unfitting unit 'nT'"),
        (0.0, 1.0, "m s-2", {"variable": "dg", "quantity": "gravity"}, "cannot be a gravity map"),
        (0.0, 1.0, "m s-2", {"variable": "lat"}, "has no grid 'lat'; it has dg"),
        (0.0, 1.0, "m s-2", {"quantity": "gravity"}, "map.variable) one of dg (disturbance)"),
        (-99999.0, 1.0, "mGal", {}, "so many nines are a missing value, which the file must say"),
        (0.0, 1e5, "m s-2", {}, "these look like mGal: give unit=mGal"),
        (9.8, 1.0, "m s-2", {}, "these look like gravity: give quantity=gravity"),
    ],
)
def test_refusals(tmp_path, small_map, offset, factor, units, asked, words):
    changed = replace(small_map, values=(small_map.values + offset) * factor)
    assert words in refused(netcdf(tmp_path / "a.nc", changed, units=units), **asked)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"lat": "degrees_east", "lon": "degrees_north"}, "swapped with longitude"),
        ({"lat": "parsec"}, "lat has the unit 'parsec'"),
        ({"lon": np.r_[np.nan, 144.0 + np.arange(23)]}, "must increase"),
        ({"dg": np.full((20, 24), np.nan)}, "all missing"),
        ({"x": "m", "y": "m"}, "'y' is not said to be latitude or longitude"),
    ],
    ids=lambda value: str(value)[:20],
)
def test_bad_axes(tmp_path, small_map, changes, words):
    how = {"names": GMT | {"z": "dg"}} if "x" in changes else {}
    path = netcdf(tmp_path / "a.nc", small_map, **how)
    with netCDF4.Dataset(path, "a") as dataset:
        for name, change in changes.items():
            if isinstance(change, str):
                dataset[name].units = change
            else:
                dataset[name][:] = change
    assert words in refused(path)


def test_a_grid_for_each_of_several_times_is_refused(tmp_path, small_map):
    path = netcdf(tmp_path / "a.nc", small_map)
    with netCDF4.Dataset(path, "a") as dataset:
        dataset.createDimension("time", 2)
        dataset.createVariable("each", "f8", ("time", "lat", "lon"))[:] = 1.0
    assert "has 2 values along 'time' at each place, where a map" in refused(path, variable="each")


def test_a_huge_grid_is_refused_before_it_is_read(tmp_path):
    path = tmp_path / "huge.nc"
    with netCDF4.Dataset(path, "w") as dataset:
        axes(dataset, np.linspace(-40.0, 40.0, 40_000), np.linspace(-40.0, 40.0, 80_000))
        dataset.createVariable("dg", "f4", ("lat", "lon"), chunksizes=(100, 100)).units = "mGal"
        dataset["dg"][20_000:20_050, 40_000:40_050] = 3.0
    assert "3,200,000,000 cells are too many" in refused(path)
    part = load_map(path, window=Window(*np.radians([0.003, 0.08, 0.003, 0.04])))
    assert np.isfinite(part.values).any()


@pytest.mark.parametrize("layout", ["NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET"])
def test_classic_files(tmp_path, small_map, layout):
    good, bad = netcdf(tmp_path / "map.nc", small_map, layout=layout), tmp_path / "bad.nc"
    same(load_map(good), small_map)
    whole = good.read_bytes()
    count = whole.index(b"\x00\x00\x00\x0b") + 4  # of the list of variables
    for content, words in (
        (whole[:-800], "cut short"),
        (whole[:-8], "cut short"),  # less than the header, too
        (whole[:count] + b"\x7f\xff\xff\xff" + whole[count + 4 :], "cannot be read as NetCDF"),
        (whole[:60], ""),
    ):
        bad.write_bytes(content)
        assert words in refused(bad)
    # of the newest, what is missing at its end would be read as zeros
    newest = netcdf(tmp_path / "newest.nc", small_map, layout="NETCDF3_64BIT_DATA")
    assert "convert it with 'nccopy -k nc4'" in refused(newest)


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
