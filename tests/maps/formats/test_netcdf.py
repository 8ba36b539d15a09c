"""NetCDF: CF and GMT conventions in every arrangement, and what is refused."""

from types import SimpleNamespace

import netCDF4
import numpy as np
import pytest

from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.load import load_map

ARRANGEMENT = {
    "order": ("lat", "lon"),
    "flip": (),
    "names": {"lat": "lat", "lon": "lon", "z": "dg"},
    "turn": 0.0,
    "pack": None,
    "radians": False,
    "extra": (),
}
UNITS = {"lat": "degrees_north", "lon": "degrees_east"}


def write(path, small_map, units="m s-2", **changes):
    """Write the small map in some arrangement; other changes are attributes of the variable."""
    how = SimpleNamespace(**{key: changes.pop(key, usual) for key, usual in ARRANGEMENT.items()})
    axes = {
        "lat": np.degrees(small_map.latitude),
        "lon": np.degrees(small_map.longitude) + how.turn,
    }
    values = small_map.values
    for index, key in enumerate(("lat", "lon")):
        if key in how.flip:
            axes[key], values = axes[key][::-1], np.flip(values, index)
    if how.order == ("lon", "lat"):
        values = values.T
    with netCDF4.Dataset(path, "w") as dataset:
        for key in how.extra:
            dataset.createDimension(key, 1)
        for key in ("lat", "lon"):
            dataset.createDimension(how.names[key], axes[key].size)
            variable = dataset.createVariable(how.names[key], "f8", (how.names[key],))
            variable.units = "radians" if how.radians else UNITS[key]
            if how.radians:
                variable.standard_name = {"lat": "latitude", "lon": "longitude"}[key]
            variable[:] = np.radians(axes[key]) if how.radians else axes[key]
        dims = (*how.extra, *(how.names[key] for key in how.order))
        if how.pack:
            data = dataset.createVariable(how.names["z"], "i2", dims, fill_value=-32768)
            data.scale_factor, data.add_offset = how.pack
        else:
            data = dataset.createVariable(how.names["z"], "f8", dims)
        if units:
            data.units = units
        for key, value in changes.items():
            data.setncattr(key, value)
        data[:] = values[(None,) * len(how.extra)]
    return path


def same(one, other, tolerance=1e-15):
    assert (one.unit, one.quantity) == (other.unit, other.quantity)
    lat, lon = np.meshgrid(other.latitude[1:-1], other.longitude[1:-1], indexing="ij")
    lat, lon = lat + 1e-5, lon + 1e-5
    inside = np.s_[1:-1, 1:-1]
    np.testing.assert_allclose(
        one.value(lat, lon)[inside], other.value(lat, lon)[inside], rtol=0, atol=tolerance
    )
    assert np.isfinite(other.value(lat, lon)[inside]).all()


GMT = {"lat": "y", "lon": "x", "z": "z"}


@pytest.mark.parametrize(
    "arrangement",
    [
        {},
        {"order": ("lon", "lat")},
        {"flip": ("lat",)},
        {"flip": ("lat", "lon"), "order": ("lon", "lat")},
        {"turn": 360.0},
        {"turn": -360.0},
        {"radians": True},
        {"extra": ("time", "level")},
        {"pack": (3e-8, 1e-4)},
        {"names": GMT, "long_name": "gravity disturbance"},
        {
            "names": {"lat": "north", "lon": "east", "z": "field"},
            "standard_name": "gravity_disturbance",
        },
    ],
    ids=str,
)
def test_every_arrangement_is_the_same_map(tmp_path, small_map, arrangement):
    path = write(tmp_path / "map.nc", small_map, **arrangement)
    same(load_map(path), small_map, 2e-8 if "pack" in arrangement else 1e-15)
    part = load_map(path, window=Window(*np.radians([-36.6, -36.4, 145.0, 145.2])))
    assert part.values.shape < small_map.values.shape
    lat, lon = np.radians([-36.6, -36.45, -36.4]), np.radians([145.0, 145.11, 145.2])
    np.testing.assert_allclose(part.value(lat, lon), small_map.value(lat, lon), atol=2e-8)


def test_units_are_converted(tmp_path, small_map):
    for units, factor in (
        ("mGal", 1e5),
        ("milligal", 1e5),
        ("µGal", 1e8),
        ("1e-5 m s-2", 1e5),
        ("m/s2", 1.0),
    ):
        scaled = type(small_map)(
            small_map.latitude,
            small_map.longitude,
            small_map.values * factor,
            "any",
            "disturbance",
        )
        read = load_map(write(tmp_path / "map.nc", scaled, units=units))
        same(read, small_map, 1e-12)
        assert read.file_unit == units and read.file_factor == pytest.approx(1.0 / factor)


def test_what_the_file_does_not_say_is_asked_for(tmp_path, small_map):
    silent = write(tmp_path / "silent.nc", small_map, units=None)
    with pytest.raises(InputError, match=r"does not say its unit; give unit= \(--unit;"):
        load_map(silent)
    same(load_map(silent, unit="m/s²"), small_map)
    nameless = write(tmp_path / "nameless.nc", small_map, names=GMT)
    with pytest.raises(
        InputError, match=r"does not say what it is a map of; give quantity= \(--quantity\) one of"
    ):
        load_map(nameless)
    same(load_map(nameless, quantity="disturbance"), small_map)


def test_missing_values(tmp_path, small_map):
    path = write(tmp_path / "map.nc", small_map, missing_value=float(small_map.values[5, 7]))
    assert np.isnan(load_map(path).values[5, 7]) and np.isnan(load_map(path).values).sum() == 1
    path = write(
        tmp_path / "range.nc", small_map, valid_min=float(np.sort(small_map.values.ravel())[3])
    )
    assert np.isnan(load_map(path).values).sum() == 3


def test_a_global_map_from_0_to_360_cut_at_greenwich(tmp_path):
    lat, lon = np.arange(-60.0, 61.0, 2.0), np.arange(0.0, 361.0, 2.0)
    with netCDF4.Dataset(tmp_path / "global.nc", "w") as dataset:
        for name, axis, unit in (("lat", lat, "degrees_north"), ("lon", lon, "degrees_east")):
            dataset.createDimension(name, axis.size)
            dataset.createVariable(name, "f8", (name,)).units = unit
            dataset[name][:] = axis
        dataset.createVariable("dg", "f8", ("lat", "lon")).units = "m s-2"
        dataset["dg"][:] = 1e-4 * np.cos(np.radians(lon))[None, :] * np.ones((lat.size, 1))
    whole = load_map(tmp_path / "global.nc")
    assert whole.longitude.size == 180
    for read in (
        whole,
        load_map(tmp_path / "global.nc", window=Window(*np.radians([-5.0, 5.0, -7.0, 9.0]))),
    ):
        for degrees in (-6.9, 0.0, 8.9, 352.0):
            assert read.value(0.01, np.radians(degrees)) == pytest.approx(
                1e-4 * np.cos(np.radians(degrees)), abs=1e-8
            )
    assert read.values.shape[1] < 20


def test_longitudes_that_jump_at_180(tmp_path, small_map):
    lon = np.radians(179.5 + 0.05 * np.arange(24))
    shifted = type(small_map)(small_map.latitude, lon, small_map.values, "m/s²", "disturbance")
    path = write(tmp_path / "map.nc", shifted)
    with netCDF4.Dataset(path, "a") as dataset:
        dataset["lon"][:] = (dataset["lon"][:] + 180.0) % 360.0 - 180.0
    same(load_map(path), shifted)


def test_the_shared_maps(shared_data):
    lake = load_map(shared_data / "clear_lake_gravity_map.nc")
    assert (lake.quantity, lake.unit) == ("bouguer_disturbance", "m/s²")
    assert np.nanmedian(lake.sigma) == pytest.approx(1.67e-5, rel=0.3)
    scotland = load_map(shared_data / "scotland_magnetic_map.nc")
    assert (scotland.quantity, scotland.unit) == ("magnetic_anomaly", "nT")
    australia = shared_data / "se_australia_gravity.nc"
    assert load_map(australia, "ga").quantisation == pytest.approx(1e-9)
    assert load_map(australia, quantity="height").unit == "m"
    with pytest.raises(InputError, match=r"give variable= \(--variable\) one of dg, ga"):
        load_map(australia)


def test_refusals(tmp_path, small_map):
    cases = [
        (
            write(tmp_path / "a.nc", small_map, units="furlong"),
            {},
            "unknown unit 'furlong'; known: m/s²",
        ),
        (
            write(tmp_path / "b.nc", small_map, units="nT"),
            {},
            "unit 'nT' does not fit a disturbance map",
        ),
        (
            write(tmp_path / "c.nc", small_map, units="mGal"),
            {},
            "these look like m/s²: give unit=m/s²",
        ),
        (
            write(tmp_path / "d.nc", small_map),
            {"variable": "dg", "quantity": "gravity"},
            "cannot be a gravity map",
        ),
        (write(tmp_path / "e.nc", small_map), {"variable": "lat"}, "'lat' is not a grid"),
        (write(tmp_path / "f.nc", small_map), {"variable": "nix"}, "no variable 'nix'"),
        (
            write(tmp_path / "g.nc", small_map),
            {"quantity": "gravity"},
            "does not say which variable for gravity; give variable= (--variable) one of dg",
        ),
        (
            write(tmp_path / "h.nc", small_map),
            {"window": Window(0.0, 0.1, 0.0, 0.1)},
            "has nothing at",
        ),
    ]
    for path, options, words in cases:
        with pytest.raises(InputError) as error:
            load_map(path, **options)
        assert words in str(error.value) and "\n" not in str(error.value)


def test_hints_for_impossible_numbers(tmp_path, small_map):
    mgal = type(small_map)(
        small_map.latitude, small_map.longitude, small_map.values * 1e5, "any", "disturbance"
    )
    with pytest.raises(InputError, match="these look like mGal: give unit=mGal"):
        load_map(write(tmp_path / "a.nc", mgal))
    gravity = type(small_map)(
        small_map.latitude, small_map.longitude, small_map.values + 9.8, "any", "disturbance"
    )
    with pytest.raises(InputError, match="these look like gravity: give quantity=gravity"):
        load_map(write(tmp_path / "b.nc", gravity))
    with pytest.raises(InputError, match=r"cannot be a gravity map.*give unit=mGal"):
        gal = type(small_map)(
            small_map.latitude,
            small_map.longitude,
            (small_map.values + 9.8) * 1e5,
            "any",
            "gravity",
        )
        load_map(write(tmp_path / "c.nc", gal), "dg", quantity="gravity")


def test_bad_axes(tmp_path, small_map):
    def broken(name, **changes):
        path = write(tmp_path / f"{name}.nc", small_map)
        with netCDF4.Dataset(path, "a") as dataset:
            for key, (attribute, value) in changes.items():
                if attribute == "data":
                    dataset[key][:] = value
                else:
                    dataset[key].setncattr(attribute, value)
        return path

    swapped = broken("swapped", lat=("units", "degrees_east"), lon=("units", "degrees_north"))
    with pytest.raises(InputError, match="axes swapped"):
        load_map(swapped)
    with pytest.raises(InputError, match="lat has the unit 'parsec'"):
        load_map(broken("parsec", lat=("units", "parsec")))
    with pytest.raises(InputError, match="regularly spaced"):
        load_map(broken("uneven", lat=("data", np.linspace(0.0, 1.0, 20) ** 2)))
    with pytest.raises(InputError, match="missing coordinates"):
        load_map(broken("holes", lon=("data", np.r_[np.nan, 144.0 + np.arange(23)])))
    with pytest.raises(InputError, match="all missing"):
        load_map(broken("empty", dg=("data", np.nan)))
    with pytest.raises(InputError, match="'y' is not said to be latitude or longitude"):
        path = write(tmp_path / "metres.nc", small_map, names={"lat": "y", "lon": "x", "z": "dg"})
        with netCDF4.Dataset(path, "a") as dataset:
            dataset["x"].units = dataset["y"].units = "m"
        load_map(path)


def test_a_huge_grid_is_refused_before_it_is_read(tmp_path):
    with netCDF4.Dataset(tmp_path / "huge.nc", "w") as dataset:
        for name, size, unit in (
            ("lat", 40_000, "degrees_north"),
            ("lon", 80_000, "degrees_east"),
        ):
            dataset.createDimension(name, size)
            dataset.createVariable(name, "f8", (name,)).units = unit
            dataset[name][:] = np.linspace(-40.0, 40.0, size)
        dataset.createVariable("dg", "f4", ("lat", "lon"), chunksizes=(100, 100)).units = "mGal"
        dataset["dg"][20_000:20_050, 40_000:40_050] = 3.0
    with pytest.raises(InputError, match="3,200,000,000 cells are too many"):
        load_map(tmp_path / "huge.nc")
    part = load_map(tmp_path / "huge.nc", window=Window(*np.radians([0.003, 0.08, 0.003, 0.04])))
    assert np.isfinite(part.values).any()


@pytest.mark.parametrize(
    "layout", ["NETCDF3_CLASSIC", "NETCDF3_64BIT_OFFSET", "NETCDF3_64BIT_DATA"]
)
def test_classic_files(tmp_path, small_map, layout):
    good = tmp_path / "map.nc"
    with (
        netCDF4.Dataset(write(tmp_path / "new.nc", small_map)) as new,
        netCDF4.Dataset(good, "w", format=layout) as old,
    ):
        old.title = "a title of odd length"
        for name in ("lat", "lon"):
            old.createDimension(name, new[name].size)
        for name in ("lat", "lon", "dg"):
            old.createVariable(name, "f8", new[name].dimensions).units = new[name].units
            old[name][:] = new[name][:]
    same(load_map(good), small_map)
    whole = good.read_bytes()
    bad = tmp_path / "bad.nc"
    for missing in (800, 8):  # less than the header, too
        bad.write_bytes(whole[:-missing])
        with pytest.raises(InputError, match="cut short"):
            load_map(bad)
    count = whole.index(b"\x00\x00\x00\x0b") + 4  # of the list of variables
    bad.write_bytes(whole[:count] + b"\x7f\xff\xff\xff" + whole[count + 4 :])
    with pytest.raises(InputError, match="cannot be read as NetCDF"):
        load_map(bad)
    bad.write_bytes(whole[:60])
    with pytest.raises(InputError, match=r"damaged header|cut short"):
        load_map(bad)
