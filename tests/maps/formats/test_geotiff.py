"""GeoTIFF: any coordinate reference system, packing, and what is refused."""

from types import SimpleNamespace

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from helpers.example_field import disturbance
from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.load import load_map

pytestmark = pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # inside rasterio


PROPERTIES = {
    "unit": "mGal",
    "name": "gravity disturbance",
    "nodata": None,
    "scale": None,
    "dtype": "float64",
    "bands": 1,
}


def write(path, values, transform, crs="EPSG:4326", **changes):
    """Write rows from the north, as GeoTIFFs are."""
    how = SimpleNamespace(**PROPERTIES | changes)
    with rasterio.open(
        path,
        "w",
        driver="GTiff",
        height=values.shape[0],
        width=values.shape[1],
        count=how.bands,
        dtype=how.dtype,
        crs=crs,
        transform=transform,
        nodata=how.nodata,
    ) as out:
        bands = range(1, how.bands + 1)
        for band in bands:
            out.write(values.astype(how.dtype), band)
        if how.unit:
            out.units = (how.unit,) * how.bands
        if how.name:
            out.descriptions = tuple(f"{how.name} {b}" if b > 1 else how.name for b in bands)
        if how.scale:
            out.scales, out.offsets = (how.scale[0],) * how.bands, (how.scale[1],) * how.bands
    return path


STEP = 0.01
CENTRES_LAT = -36.0 - STEP * (np.arange(120) + 0.5)  # from the north
CENTRES_LON = 144.0 + STEP * (np.arange(150) + 0.5)
MGAL = disturbance(CENTRES_LAT[:, None], CENTRES_LON[None, :]) * 1e5
NORTH_UP = from_origin(144.0, -36.0, STEP, STEP)
LAT, LON = np.meshgrid(np.linspace(-37.1, -36.1, 30), np.linspace(144.1, 145.4, 30), indexing="ij")


def check(field_map, tolerance):
    assert (field_map.unit, field_map.quantity) == ("m/s²", "disturbance")
    np.testing.assert_allclose(
        field_map.value(np.radians(LAT), np.radians(LON)),
        disturbance(LAT, LON),
        rtol=0,
        atol=tolerance,
    )


def test_geographic(tmp_path):
    path = write(tmp_path / "a.tif", MGAL, NORTH_UP)
    check(load_map(path), 1e-7)
    part = load_map(path, window=Window(*np.radians([-36.6, -36.5, 144.5, 144.7])))
    assert part.values.shape[0] < 20
    assert part.value(np.radians(-36.55), np.radians(144.6)) == pytest.approx(
        float(disturbance(-36.55, 144.6)), abs=1e-7
    )


def test_packed_with_no_data(tmp_path):
    packed = np.rint((MGAL - 5.0) / 0.01)
    packed[50, 60] = -32768
    path = write(
        tmp_path / "a.tif", packed, NORTH_UP, nodata=-32768, scale=(0.01, 5.0), dtype="int16"
    )
    field_map = load_map(path)
    assert field_map.quantisation == pytest.approx(1e-7)
    assert np.isnan(field_map.values).sum() == 1 and np.isnan(field_map.values[119 - 50, 60])
    known = np.isfinite(field_map.value(np.radians(LAT), np.radians(LON)))
    assert known.mean() > 0.95
    np.testing.assert_allclose(
        field_map.value(np.radians(LAT), np.radians(LON))[known],
        disturbance(LAT, LON)[known],
        rtol=0,
        atol=1.2e-7,
    )


@pytest.mark.parametrize("crs", ["EPSG:28355", "EPSG:32755", "EPSG:3857"])
def test_projected_systems_are_resampled(tmp_path, crs):
    """Written on a metric grid by an exact transformation of its cell centres; read back on a
    geographic one."""
    import pyproj

    to_degrees = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    x, y = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True).transform(
        [143.9, 145.7], [-37.3, -35.9]
    )
    x, y = (
        np.arange(min(x) - 5e3, max(x) + 5e3, 500.0),
        np.arange(max(y) + 5e3, min(y) - 5e3, -500.0),
    )
    lon, lat = to_degrees.transform(*np.meshgrid(x, y))
    path = write(
        tmp_path / "a.tif",
        disturbance(lat, lon) * 1e5,
        from_origin(x[0] - 250.0, y[0] + 250.0, 500.0, 500.0),
        crs,
    )
    check(load_map(path), 1e-6)
    part = load_map(path, window=Window(*np.radians([-36.6, -36.5, 144.5, 144.7])))
    assert part.value(np.radians(-36.55), np.radians(144.6)) == pytest.approx(
        float(disturbance(-36.55, 144.6)), abs=1e-6
    )


def test_another_datum_is_transformed(tmp_path):
    """AGD66 lies 200 m from WGS 84; taken as it is, the field would be off by more than the
    tolerance."""
    import pyproj

    transform = pyproj.Transformer.from_crs("EPSG:4202", "EPSG:4326", always_xy=True)
    lon, lat = transform.transform(*np.meshgrid(CENTRES_LON, CENTRES_LAT))
    shift = np.hypot(lon - CENTRES_LON, lat - CENTRES_LAT[:, None]).max()
    if shift < 5e-4:
        pytest.skip("this PROJ has no transformation from AGD66")
    path = write(tmp_path / "a.tif", disturbance(lat, lon) * 1e5, NORTH_UP, "EPSG:4202")
    check(load_map(path), 3e-6)


def test_what_the_file_does_not_say_is_asked_for(tmp_path):
    path = write(tmp_path / "a.tif", MGAL, NORTH_UP, crs=None, unit=None, name=None)
    for given, words in (
        ({}, "does not say its coordinate reference system; give crs="),
        ({"crs": "EPSG:4326"}, "does not say what it is a map of; give quantity="),
        ({"crs": "EPSG:4326", "quantity": "disturbance"}, "does not say its unit; give unit="),
        ({"crs": "Mars"}, "crs 'Mars' is not known"),
    ):
        with pytest.raises(InputError) as error:
            load_map(path, **given)
        assert words in str(error.value)
    check(load_map(path, crs="EPSG:4326", quantity="disturbance", unit="mGal"), 1e-7)


def test_bands(tmp_path):
    path = write(tmp_path / "a.tif", MGAL, NORTH_UP, bands=2)
    with pytest.raises(InputError, match="has 2 bands"):
        load_map(path)
    with pytest.raises(InputError, match="no band '3'"):
        load_map(path, "3")
    check(load_map(path, "gravity disturbance"), 1e-7)
    check(load_map(path, "2", quantity="disturbance"), 1e-7)


def test_refusals(tmp_path):
    cases = [
        ((MGAL, NORTH_UP), {"unit": "m/s²"}, "these look like mGal: give unit=mGal"),
        ((np.full_like(MGAL, np.nan), NORTH_UP), {}, "all missing"),
        ((MGAL, from_origin(36.0, 144.0, STEP, STEP)), {}, "axes swapped, or a projected CRS?"),
        ((MGAL, NORTH_UP), {"window": Window(0.0, 0.1, 0.0, 0.1)}, "has nothing at"),
    ]
    for index, (content, options, words) in enumerate(cases):
        path = write(tmp_path / f"{index}.tif", *content)
        with pytest.raises(InputError) as error:
            load_map(path, **options)
        assert words in str(error.value) and "\n" not in str(error.value)
    with pytest.raises(InputError, match=r"none\.tif: no such file"):
        load_map(tmp_path / "none.tif")
    path = write(tmp_path / "complex.tif", MGAL, NORTH_UP, dtype="complex64")
    with pytest.raises(InputError, match="band 1 holds complex64, not numbers"):
        load_map(path)
    for name, content in (
        ("empty", b""),
        ("foreign", b"PK\x03\x04" * 100),
        ("cut", path.read_bytes()[:3000]),
    ):
        (tmp_path / f"{name}.tif").write_bytes(content)
        with pytest.raises(InputError, match="cannot be read as GeoTIFF") as error:
            load_map(tmp_path / f"{name}.tif")
        assert "\n" not in str(error.value)
