"""Whatever a file holds, a reader gives a map or one clear line; it never crashes and never
hangs."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.ggmplus.tiles import CELLS
from isogal.maps.load import load_map

FUZZ = settings(
    max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)


def netcdf4(small_map, path):
    write_netcdf(small_map, path)


def netcdf3(small_map, path):
    import netCDF4

    with netCDF4.Dataset(path, "w", format="NETCDF3_CLASSIC") as dataset:
        for name, axis, unit in (
            ("lat", small_map.latitude, "degrees_north"),
            ("lon", small_map.longitude, "degrees_east"),
        ):
            dataset.createDimension(name, axis.size)
            dataset.createVariable(name, "f8", (name,)).units = unit
            dataset[name][:] = np.degrees(axis)
        dataset.createVariable("dg", "f4", ("lat", "lon")).units = "m s-2"
        dataset["dg"][:] = small_map.values


def geotiff(small_map, path):
    import rasterio
    from rasterio.transform import from_origin

    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=20,
        width=24,
        count=1,
        dtype="float32",
        crs="EPSG:4326",
        transform=from_origin(144.5, -36.0, 0.05, 0.05),
    ) as out:
        out.write(small_map.values.astype("float32") * 1e5, 1)
        out.units, out.descriptions = ("mGal",), ("dg",)


def rows(small_map):
    lat, lon = np.degrees(small_map.latitude), np.degrees(small_map.longitude)
    return "".join(
        f"{x:.3f} {y:.3f} {1e5 * v:.4f}\n"
        for y, line in zip(lat, small_map.values, strict=True)
        for x, v in zip(lon, line, strict=True)
    )


def gdf(small_map, path):
    head = (
        "functional gravity_disturbance\nunit mgal\ngapvalue 9999.0\ngridstep 0.05\nlatlimit_north"
        " -36.05\nend_of_head ==\n"
    )
    path.write_text(head + rows(small_map))


def xyz(small_map, path):
    path.write_text("lon lat dg[mGal]\n" + rows(small_map))


def tile(small_map, path):
    raw = np.zeros((CELLS, CELLS), ">i2")
    raw[:60, :60] = 321
    raw.tofile(path)


MAKERS = {"map.nc": netcdf4, "old.nc": netcdf3, "map.tif": geotiff, "map.gdf": gdf, "map.xyz": xyz}
change = st.tuples(st.floats(0.0, 1.0), st.binary(min_size=1, max_size=8))
damage = st.fixed_dictionaries(
    {
        "changes": st.lists(change, max_size=6),
        "cut": st.one_of(st.none(), st.floats(0.0, 1.0)),
        "early": st.booleans(),
    }
)


def spoil(good: bytes, how) -> bytes:
    """Overwrite some bytes (mostly in the header, where they matter) and cut."""
    body = bytearray(good)
    reach = min(len(body), 2000) if how["early"] else len(body)
    for where, what in how["changes"]:
        at = int(where * reach)
        body[at : at + len(what)] = what
    return bytes(body[: int(how["cut"] * len(body))] if how["cut"] is not None else body)


def map_or_one_line(path):
    try:
        field_map = load_map(path)
    except InputError as error:
        assert "\n" not in str(error) and str(error)
    else:
        assert isinstance(field_map, FieldMap) and field_map.values.size


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", MAKERS)
def test_damaged_files(name, small_map):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        MAKERS[name](small_map, path)
        good = path.read_bytes()
        assert load_map(path).quantity == "disturbance"

        @FUZZ
        @given(damage)
        def check(how):
            path.write_bytes(spoil(good, how))
            map_or_one_line(path)

        check()


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", [*MAKERS, "S40E140.dg"])
def test_files_of_random_bytes(name):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name

        @FUZZ
        @given(st.one_of(st.binary(max_size=400), st.text(max_size=400).map(str.encode)))
        def check(content):
            path.write_bytes(content)
            map_or_one_line(path)

        check()


def test_damaged_tiles(small_map, tmp_path):
    path = tmp_path / "S40E140.dg"
    tile(small_map, path)
    good = np.fromfile(path, ">i2")
    window = Window(*np.radians([-39.95, -39.9, 140.05, 140.1]))

    @settings(FUZZ, max_examples=20)
    @given(
        st.lists(st.tuples(st.integers(0, 100_000), st.integers(-(2**15), 2**15 - 1)), max_size=9),
        st.integers(-3, 3),
    )
    def check(changes, longer):
        spoilt = good.copy()
        for at, number in changes:
            spoilt[at] = number
        path.write_bytes(
            spoilt.tobytes()[: longer or None] if longer < 0 else spoilt.tobytes() + b"x" * longer
        )
        try:
            assert load_map(tmp_path, "dg", window=window).quantity == "disturbance"
        except InputError as error:
            assert "\n" not in str(error)

    check()
