"""GeoTIFF: any coordinate reference system, packing, and what is refused."""

import numpy as np
import pyproj
import pytest
from affine import Affine
from rasterio.transform import from_origin

from helpers.example_field import disturbance
from helpers.map_files import geotiff, refused
from isogal.maps.axes import Window
from isogal.maps.load import load_map

pytestmark = pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # inside rasterio

STEP = 0.01
CENTRES_LAT = -36.0 - STEP * (np.arange(120) + 0.5)  # from the north
CENTRES_LON = 144.0 + STEP * (np.arange(150) + 0.5)
MGAL = disturbance(CENTRES_LAT[:, None], CENTRES_LON[None, :]) * 1e5
NORTH_UP = from_origin(144.0, -36.0, STEP, STEP)
LAT, LON = np.meshgrid(np.linspace(-37.1, -36.1, 30), np.linspace(144.1, 145.4, 30), indexing="ij")
PART = Window(*np.radians([-36.6, -36.5, 144.5, 144.7]))


def check(path, tolerance, *asked, **options):
    """The map, and a part of it, have the values of the field."""
    field_map = load_map(path, *asked, **options)
    assert (field_map.unit, field_map.quantity) == ("m/s²", "disturbance")
    found = field_map.value(np.radians(LAT), np.radians(LON))
    known = np.isfinite(found)
    assert known.mean() > 0.95
    np.testing.assert_allclose(found[known], disturbance(LAT, LON)[known], atol=tolerance)
    part = load_map(path, *asked, window=PART, **options)
    assert part.values.shape[0] < 40
    expected = pytest.approx(float(disturbance(-36.55, 144.6)), abs=tolerance)
    assert part.value(np.radians(-36.55), np.radians(144.6)) == expected
    return field_map


def test_packed_with_no_data(tmp_path):
    packed = np.rint((MGAL - 5.0) / 0.01)
    packed[50, 60] = -32768
    how = {"nodata": -32768, "scale": (0.01, 5.0), "kind": "int16"}
    field_map = check(geotiff(tmp_path / "a.tif", packed, NORTH_UP, **how), 1.2e-7)
    assert field_map.quantisation == pytest.approx(1e-7)
    assert np.argwhere(np.isnan(field_map.values)).tolist() == [[119 - 50, 60]]


@pytest.mark.parametrize("crs", ["EPSG:32755", "EPSG:3857"])
def test_projected_systems_are_resampled(tmp_path, crs):
    """Written on a metric grid by an exact transformation of its cell centres; read back on a
    geographic one."""
    to_metres = pyproj.Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    to_degrees = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    x, y = to_metres.transform([143.9, 145.7], [-37.3, -35.9])
    x = np.arange(min(x) - 5e3, max(x) + 5e3, 500.0)
    y = np.arange(max(y) + 5e3, min(y) - 5e3, -500.0)
    lon, lat = to_degrees.transform(*np.meshgrid(x, y))
    corner = from_origin(x[0] - 250.0, y[0] + 250.0, 500.0, 500.0)
    check(geotiff(tmp_path / "a.tif", disturbance(lat, lon) * 1e5, corner, crs), 1e-6)


def test_a_rotated_raster_is_where_it_says(tmp_path):
    """A field that is linear in the place shows by how much the map is displaced: less than a
    hundredth of its cells of 500 m."""
    turned = Affine(470.0, 171.0, 330e3, 171.0, -470.0, 5.98e6)  # by 20 degrees
    to_degrees = pyproj.Transformer.from_crs("EPSG:32755", "EPSG:4326", always_xy=True)
    columns, rows = np.meshgrid(np.arange(120) + 0.5, np.arange(120) + 0.5)
    lon, lat = to_degrees.transform(*(turned * (columns, rows)))
    place = tmp_path / "a.tif"
    for degrees, axis in ((lat, 0), (lon, 1)):
        field_map = load_map(geotiff(place, degrees, turned, "EPSG:32755", unit="mGal"))
        nodes = (field_map.latitude[:, None], field_map.longitude)[axis]
        off = field_map.values / 1e-5 - np.degrees(nodes)
        # at the raster's rim the convolution lacks cells
        assert np.nanquantile(np.abs(off), 0.9) * 111e3 < 1.5


@pytest.mark.parametrize(
    ("crs", "corner", "words"),
    [
        ("EPSG:3995", (-6e4, 6e4), "holds a pole or crosses longitude 180; resample it"),
        ("EPSG:32701", (1.8e5, 5.9e6), "holds a pole or crosses longitude 180; resample it"),
        ('LOCAL_CS["mine",UNIT["metre",1]]', (0.0, 0.0), "does not say its coordinate reference"),
    ],
)
def test_rasters_that_cannot_be_resampled(tmp_path, crs, corner, words):
    transform = from_origin(*corner, 1e3, 1e3)
    assert words in refused(geotiff(tmp_path / "a.tif", MGAL, transform, crs))


def test_another_datum_is_transformed(tmp_path):
    """AGD66 lies 200 m from WGS 84; taken as it is, the field would be off by more than the
    tolerance."""
    transform = pyproj.Transformer.from_crs("EPSG:4202", "EPSG:4326", always_xy=True)
    lon, lat = transform.transform(*np.meshgrid(CENTRES_LON, CENTRES_LAT))
    shift = np.hypot(lon - CENTRES_LON, lat - CENTRES_LAT[:, None]).max()
    if shift < 5e-4:
        pytest.skip("this PROJ has no transformation from AGD66")
    check(geotiff(tmp_path / "a.tif", disturbance(lat, lon) * 1e5, NORTH_UP, "EPSG:4202"), 3e-6)


def test_what_the_file_does_not_say_is_asked_for(tmp_path):
    path = geotiff(tmp_path / "a.tif", MGAL, NORTH_UP, crs=None, unit=None, name=None)
    for given, words in (
        ({}, "does not say its coordinate reference system; give crs="),
        ({"crs": "EPSG:4326"}, "does not say what it is a map of; give quantity="),
        ({"crs": "EPSG:4326", "quantity": "disturbance"}, "does not say its unit; give unit="),
        ({"crs": "Mars"}, "crs 'Mars' is not known"),
    ):
        assert words in refused(path, **given)
    check(path, 1e-7, crs="EPSG:4326", quantity="disturbance", unit="mGal")


def test_bands(tmp_path):
    path = geotiff(tmp_path / "a.tif", MGAL, NORTH_UP, bands=2)
    assert "but 2 bands" in refused(path)
    assert "no band '3'" in refused(path, "3")
    check(path, 1e-7, "dg")
    check(path, 1e-7, "2", quantity="disturbance")


def test_refusals(tmp_path):
    swapped = geotiff(tmp_path / "a.tif", MGAL, from_origin(36.0, 144.0, STEP, STEP))
    assert "or swapped with longitude" in refused(swapped)
    odd = geotiff(tmp_path / "b.tif", MGAL, NORTH_UP, kind="complex64")
    assert "band 1 holds complex64, not numbers" in refused(odd)
    for content in (b"", b"PK\x03\x04" * 100, swapped.read_bytes()[:3000]):
        odd.write_bytes(content)
        assert "cannot be read as GeoTIFF" in refused(odd)
