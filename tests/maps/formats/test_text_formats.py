"""ICGEM .gdf and XYZ text."""

import numpy as np
import pytest

from helpers.example_field import disturbance
from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.load import load_map

LAT, LON = -37.0 + 0.05 * np.arange(20), 144.5 + 0.05 * np.arange(24)


def table(small=None, north_first=True):
    lat = LAT[::-1] if north_first else LAT
    rows = [(lon, la, 1e5 * disturbance(la, lon)) for la in lat for lon in LON]
    return "\n".join("{:12.5f} {:12.5f} {:16.10f}".format(*row) for row in rows) + "\n"


def gdf(body=None, drop=(), **changes):
    header = {
        "generating_institute": "test",
        "modelname": "NONE",
        "functional": "gravity_disturbance",
        "unit": "mgal",
        "gapvalue": "9999.0",
        "latlimit_north": "-36.05",
        "latlimit_south": "-37.0",
        "longlimit_west": "144.5",
        "longlimit_east": "145.65",
        "gridstep": "0.05",
        "number_of_gridpoints": "480",
    } | changes
    lines = [f"{key:24s} {value}" for key, value in header.items() if key not in drop]
    names = "  longitude  latitude  gravity_disturbance\n  [deg.]  [deg.]  [mgal]\n"
    return (
        "\n".join(lines)
        + "\n\n"
        + names
        + "end_of_head "
        + "=" * 30
        + "\n"
        + (table() if body is None else body)
    )


def save(path, text):
    path.write_text(text, encoding="utf-8")
    return path


def same(field_map, small_map):
    assert (field_map.unit, field_map.quantity) == ("m/s²", "disturbance")
    np.testing.assert_allclose(field_map.values, small_map.values, rtol=0, atol=1e-14)
    np.testing.assert_allclose(field_map.latitude, small_map.latitude, rtol=0, atol=1e-12)
    np.testing.assert_allclose(field_map.longitude, small_map.longitude, rtol=0, atol=1e-12)


def test_gdf(tmp_path, small_map):
    path = save(tmp_path / "map.gdf", gdf())
    same(load_map(path), small_map)
    same(load_map(path, "gravity_disturbance", "disturbance"), small_map)
    part = load_map(path, window=Window(*np.radians([-36.6, -36.4, 145.0, 145.2])))
    assert part.values.shape < small_map.values.shape


def test_gdf_gaps_and_a_height_column(tmp_path, small_map):
    body = table().replace(f"{1e5 * disturbance(LAT[3], LON[4]):16.10f}", "9999.0")
    assert np.argwhere(
        np.isnan(load_map(save(tmp_path / "gap.gdf", gdf(body))).values)
    ).tolist() == [[3, 4]]
    text = gdf("".join(f"{a} {b} 500.0 {c}\n" for a, b, c in map(str.split, table().splitlines())))
    text = text.replace(
        "latitude  gravity_disturbance\n", "latitude  h_over_geoid  gravity_disturbance\n"
    )
    same(load_map(save(tmp_path / "height.gdf", text)), small_map)


CUT = "".join(table().splitlines(keepends=True)[:-30])


@pytest.mark.parametrize(
    "text,words",
    [
        (gdf(table()[:-20]), "not a table of numbers, or cut short"),
        (gdf().replace("end_of_head", "the_end"), "no line 'end_of_head'"),
        ("x" * 100_000, "no line 'end_of_head'"),
        (gdf(CUT), "points, the header says 480; cut short?"),
        (gdf(CUT, drop=("number_of_gridpoints",)), "header says latlimit_south -37; cut short"),
        (gdf(unit="furlong"), "unknown unit 'furlong'"),
        (gdf(drop=("unit",)), "does not say its unit"),
        (gdf(functional="second_r_derivative"), "does not say what it is a map of"),
        (gdf(functional="geoid", unit="mgal"), "unit 'mgal' does not fit a geoid map"),
        (gdf(unit="m/s2"), "these look like mGal"),
        (gdf(gapvalue="none"), "header gapvalue is not a number"),
        (gdf(table().replace("144.50000", "????", 1)), "not a table of numbers"),
        (
            gdf().replace("longitude  latitude  g", "latitude  longitude  g"),
            "columns must begin with longitude, latitude",
        ),
        (
            gdf(
                "\n".join(" ".join((b, a, c)) for a, b, c in map(str.split, table().splitlines()))
            ),
            "latitudes reach 145.65 deg",
        ),
        (
            gdf("".join(f"{a} {b} 9999.0\n" for a, b, _ in map(str.split, table().splitlines()))),
            "all missing",
        ),
        (gdf(""), "holds no numbers"),
        (gdf("1 2 3\n"), "points, the header says 480"),
    ],
)
def test_gdf_refusals(tmp_path, text, words):
    with pytest.raises(InputError) as error:
        load_map(save(tmp_path / "map.gdf", text))
    assert words in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        "lon lat dg[mGal]\n" + table(),
        "# longitude latitude gravity_disturbance(mGal)\n" + table(north_first=False),
        "latitude,longitude,dg[mGal]\n"
        + "".join(f"{b},{a},{c}\n" for a, b, c in map(str.split, table().splitlines())),
        "lon;lat;h;dg[mGal]\n"
        + "".join(f"{a};{b};7;{c}\n" for a, b, c in map(str.split, table().splitlines())),
        "lon lat dg[mGal]\n" + "\n".join(sorted(table().splitlines())) + "\n",
    ],
    ids=["plain", "comment", "comma", "semicolon", "any order"],
)
def test_xyz(tmp_path, small_map, text):
    path = save(tmp_path / "map.xyz", text)
    same(load_map(path, "dg" if ";" in text else None), small_map)
    assert load_map(
        path,
        "dg" if ";" in text else None,
        window=Window(*np.radians([-36.6, -36.4, 145.0, 145.2])),
    ).values.shape < (20, 24)


def test_xyz_without_names(tmp_path, small_map):
    path = save(tmp_path / "map.xyz", table())
    with pytest.raises(InputError, match="does not name its columns; give variable="):
        load_map(path)
    with pytest.raises(InputError, match="does not say its unit"):
        load_map(path, "lon,lat,dg")
    same(load_map(path, "lon,lat,dg", unit="mGal"), small_map)
    with pytest.raises(InputError, match="latitudes reach"):
        load_map(path, "lat,lon,dg", unit="mGal")


def test_xyz_with_holes(tmp_path, small_map):
    lines = table().splitlines()
    field_map = load_map(
        save(tmp_path / "map.xyz", "lon lat dg[mGal]\n" + "\n".join(lines[:100] + lines[103:]))
    )
    assert (
        np.isnan(field_map.values).sum() == 3 and field_map.values.shape == small_map.values.shape
    )


@pytest.mark.parametrize(
    "text,words",
    [
        ("", "does not name its columns"),
        ("lon lat dg[mGal]\n", "holds no numbers"),
        ("lon lat dg[mGal]\n1 2\n", "columns of numbers, not 3"),
        ("lon lat dg[mGal]\n1 2 3\n1 2 x\n", "not a table of numbers"),
        ("lon lat dg[mGal]\n1 nan 3\n1 2 3\n", "a point has no coordinates"),
        ("lon lat dg[mGal]\n500000 2 3\n500100 2 3\n", "is it a projected grid?"),
        ("lon lat dg[mGal]\n1 2 3\n2 2 3\n3 2 3\n", "all points have the same latitude"),
        ("lon lat dg[mGal]\n1 2 3\n2 3 3\n", "latitude has 2 nodes; at least 4 are needed"),
        (
            "lon lat dg[mGal]\n" + table() + table().splitlines()[0],
            "two points lie on the same node",
        ),
        (
            "lon lat dg[mGal]\n" + "".join(f"{np.sqrt(i)} {i % 7} 1\n" for i in range(99)),
            "regular grid",
        ),
        (
            "lon lat dg[mGal]\n" + "".join(f"{i} {i * 1.3 % 60} 1\n" for i in range(99)),
            "regular grid",
        ),
        ("lon lat dg[mGal]\n" + "1 2 3\n" * 9, "all points have the same latitude"),
        ("lon lat dg[mGal]\nnan 2 3\n", "no coordinates"),
        ("lon lat a b\n1 2 3 4\n", "needs one latitude, one longitude and one value column"),
        ("lon lat ga[m/s2]\n" + table(), "cannot be a gravity map"),
    ],
)
def test_xyz_refusals(tmp_path, text, words):
    with pytest.raises(InputError) as error:
        load_map(save(tmp_path / "map.xyz", text))
    assert words in str(error.value) and "\n" not in str(error.value)
