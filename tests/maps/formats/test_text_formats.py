"""ICGEM .gdf and XYZ text."""

import numpy as np
import pytest

from helpers.example_field import disturbance
from helpers.map_files import gdf, refused, save, table
from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap
from isogal.maps.load import load_map

LAT, LON = -37.0 + 0.05 * np.arange(20), 144.5 + 0.05 * np.arange(24)
SMALL = FieldMap(
    np.radians(LAT), np.radians(LON), disturbance(LAT[:, None], LON), "m/s²", "disturbance"
)
ROWS = table(SMALL)
CUT = "".join(ROWS.splitlines(keepends=True)[:-30])
FIRST = ROWS.splitlines()[0]
PART = Window(*np.radians([-36.6, -36.4, 145.0, 145.2]))


def check(path, *asked, **options):
    """The map is the small one, and a part of it a part."""
    field_map = load_map(path, *asked, **options)
    assert (field_map.unit, field_map.quantity) == ("m/s²", "disturbance")
    for name in ("values", "latitude", "longitude"):
        found, expected = getattr(field_map, name), getattr(SMALL, name)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert load_map(path, *asked, window=PART, **options).values.shape < SMALL.values.shape


def test_gdf(tmp_path):
    check(save(tmp_path / "map.gdf", gdf(ROWS)))
    check(tmp_path / "map.gdf", "gravity_disturbance", "disturbance")
    assert "holds 'gravity_disturbance', not 'geoid'" in refused(tmp_path / "map.gdf", "geoid")


def test_gdf_gaps_and_a_height_column(tmp_path):
    body = ROWS.replace(f"{1e5 * SMALL.values[3, 4]:.10f}", "9999.0")
    gaps = load_map(save(tmp_path / "gap.gdf", gdf(body)))
    assert np.argwhere(np.isnan(gaps.values)).tolist() == [[3, 4]]
    text = gdf(table(SMALL, extra="500.0")).replace(
        "latitude  gravity_disturbance\n", "latitude  h_over_geoid  gravity_disturbance\n"
    )
    check(save(tmp_path / "height.gdf", text))


@pytest.mark.parametrize(
    "text,words",
    [
        (gdf(ROWS[:-16]), "not a table of numbers, or cut short"),
        (gdf(ROWS).replace("end_of_head", "the_end"), "no line 'end_of_head'"),
        (gdf(CUT), "points, the header says 480; cut short?"),
        (gdf(ROWS, drop=("unit",)), "does not say its unit"),
        (gdf(ROWS, functional="second_r_derivative"), "does not say what it is a map of"),
        (gdf(ROWS, functional="geoid", unit="mgal"), "a geoid map: unfitting unit 'mgal'"),
        (gdf(ROWS, gapvalue="none"), "header gapvalue is not a number"),
        (
            gdf(ROWS).replace("longitude  latitude  g", "latitude  longitude  g"),
            "columns must begin with longitude, latitude",
        ),
        (gdf(table(SMALL, "lat lon value")), "latitudes reach 145.65 deg"),
        (gdf(""), "holds no numbers"),
    ],
)
def test_gdf_refusals(tmp_path, text, words):
    assert words in refused(save(tmp_path / "map.gdf", text))


@pytest.mark.parametrize(
    "text",
    [
        "lon lat dg[mGal]\n" + ROWS,
        "# longitude latitude gravity_disturbance(mGal)\n" + ROWS,
        "\ufefflatitude,longitude,dg[mGal]\n" + table(SMALL, "lat lon value", ","),  # of Excel
        "lon;lat;h;dg[mGal]\n" + table(SMALL, mark=";", extra="7"),
        "lon lat dg[mGal]\n" + "\n".join(sorted(ROWS.splitlines())) + "\n",
    ],
    ids=["plain", "comment", "comma", "semicolon", "any order"],
)
def test_xyz(tmp_path, text):
    check(save(tmp_path / "map.xyz", text), "dg" if ";" in text else None)


def test_xyz_without_names(tmp_path):
    path = save(tmp_path / "map.xyz", ROWS)
    assert "does not name its columns; give variable=" in refused(path)
    assert "does not say its unit" in refused(path, "lon,lat,dg")
    assert "latitudes reach" in refused(path, "lat,lon,dg", unit="mGal")
    assert "is empty; it needs columns" in refused(save(tmp_path / "empty.xyz", "\n"))
    check(path, "lon,lat,dg", unit="mGal")


def test_xyz_with_holes(tmp_path):
    lines = ROWS.splitlines()
    text = "lon lat dg[mGal]\n" + "\n".join(lines[:100] + lines[103:])
    field_map = load_map(save(tmp_path / "map.xyz", text))
    assert np.isnan(field_map.values).sum() == 3 and field_map.shape == SMALL.shape


@pytest.mark.parametrize(
    "text,words",
    [
        ("lon lat dg[mGal]\n1 nan 3\n1 2 3\n", "lat in line 2 is nan, not a finite number"),
        ("lon lat dg[mGal]\n500000 2 3\n500100 2 3\n", "is it a projected grid?"),
        ("lon lat dg[mGal]\n1 2 3\n2 2 3\n3 2 3\n", "latitude has 1 nodes; at least 4 are needed"),
        ("lon lat dg[mGal]\n1 2 3\n2 3 3\n", "latitude has 2 nodes; at least 4 are needed"),
        ("lon lat dg[mGal]\n" + ROWS + FIRST, "two points lie on the same node"),
        (
            "lon lat dg[mGal]\n" + "".join(f"{np.sqrt(i)} {i % 7} 1\n" for i in range(99)),
            "regular grid",
        ),
        ("lon lat a b\n1 2 3 4\n", "does not say which column holds the values"),
    ],
)
def test_xyz_refusals(tmp_path, text, words):
    assert words in refused(save(tmp_path / "map.xyz", text))
