"""Formats of maps that many people have: spherical harmonic models, EMAG2, DTED, GEBCO."""

import math

import netCDF4
import numpy as np
import pytest
from rasterio import shutil
from rasterio.transform import from_origin

from helpers.map_files import axes, geotiff, refused, save
from isogal.earth.ellipsoid import GM, A, radii
from isogal.maps.axes import Window
from isogal.maps.load import load_map

PART = Window(*np.radians([-36.6, -36.4, 145.0, 145.2]))
J2, E2 = 108263e-8, 0.00669438002290
MASS = 1e9
"""GM of a point mass, m³/s²."""
WHERE = 0.9 * A, math.radians(-36.0), math.radians(146.0)
"""Its radius, geocentric latitude and longitude."""


def model(path, degree, mass=MASS, radius=A, gm=GM):
    """Write GRS80 and a point mass as a model up to a degree."""
    legendre = pytest.importorskip("pyshtools").legendre
    r, phi, lam = WHERE
    P = legendre.PlmBar(degree, math.sin(phi))
    lines = []
    for k in range(degree + 1):
        for m in range(k + 1):
            size = mass / gm / (2 * k + 1) * (r / radius) ** k * P[k * (k + 1) // 2 + m]
            c, s = size * math.cos(m * lam), size * math.sin(m * lam)
            if m == 0 and k % 2 == 0 and k <= 10:
                n = k // 2
                j = 3.0 * (-1.0) ** (n + 1) * E2**n / ((2 * n + 1) * (2 * n + 3))
                j *= 1.0 - n + 5.0 * n * J2 / E2
                c -= j * GM / gm * (A / radius) ** k / math.sqrt(2 * k + 1)
            lines.append(f"gfc {k} {m} {c:.17e} {s:.17e}")
    head = [
        "product_type gravity_field", "modelname test", f"earth_gravity_constant {gm!r}",
        f"radius {radius!r}", f"max_degree {degree}", "errors no", "norm fully_normalized",
        "tide_system tide_free", "end_of_head" + 40 * "=",
    ]  # fmt: skip
    return save(path, "\n".join([*head, *lines]) + "\n")


def attraction(field_map, height):
    """Downward attraction of the point mass along the ellipsoid's normal."""
    lat, lon = np.meshgrid(field_map.latitude, field_map.longitude, indexing="ij")
    N = radii(lat)[1]
    up = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    place = np.stack([*((N + height) * up[:2]), (N * (1.0 - E2) + height) * up[2]])
    r, phi, lam = WHERE
    mass = r * np.array(
        [math.cos(phi) * math.cos(lam), math.cos(phi) * math.sin(lam), math.sin(phi)]
    )
    away = place - mass[:, None, None]
    return MASS * (away * up).sum(axis=0) / (away**2).sum(axis=0) ** 1.5


@pytest.mark.parametrize("height", [0.0, 5000.0])
def test_the_disturbance_of_a_point_mass(tmp_path, height):
    """In closed form; degrees beyond 150 hold (0.9)^150, a part in ten million."""
    path = model(tmp_path / "m.gfc", 150, radius=6378136.3, gm=3.986004415e14)
    field_map = load_map(path, f"{height:g}", window=PART)
    assert (field_map.quantity, field_map.unit, field_map.height) == (
        "disturbance", "m/s²", height,
    )  # fmt: skip
    expected = attraction(field_map, height)
    np.testing.assert_allclose(field_map.values, expected, rtol=2e-4)
    assert field_map.values.max() > 1e-5 * 100


def test_a_model_that_is_refused(tmp_path):
    path = model(tmp_path / "m.gfc", 4)
    assert "the height of the map above the ellipsoid, in m, not 'geoid'" in refused(path, "geoid")
    broken = save(tmp_path / "b.gfc", path.read_text().replace("radius", "radios"))
    assert "b.gfc: cannot be read as ICGEM model" in refused(broken)


def emag2(path, longitudes=range(4340, 4360)):
    """Write a part of the CSV file, the anomaly at sea level missing at one node."""
    rows = []
    for j in range(1590, 1620):
        for i in longitudes:
            lon, lat = (i + 0.5) / 30.0 % 360.0, -90.0 + (j + 0.5) / 30.0
            value = 99999 if (i, j) == (4350, 1600) else 10.0 * math.sin(i) + j
            rows.append(f"{i},{j},{lon:.6f},{lat:.6f},{value:.3f},{0.5 * j:.3f},1,{25 + i % 3}")
    return save(path, "\n".join(rows) + "\n")


def test_emag2_as_csv(tmp_path):
    path = emag2(tmp_path / "EMAG2_V3_20170530.csv")
    sea, air = load_map(path), load_map(path, "UpCont")
    assert (sea.quantity, sea.unit, sea.height, air.height) == ("magnetic_anomaly", "nT", 0, 4000)
    assert np.argwhere(np.isnan(sea.values)).tolist() == [[10, 10]]
    assert sea.values[0, 0] == pytest.approx(10.0 * math.sin(4340) + 1590, abs=1e-3)
    assert air.values[3, 0] == pytest.approx(0.5 * 1593) and set(sea.sigma[0]) == {25, 26, 27}
    assert "UpCont.csv:upcont" in load_map(emag2(tmp_path / "EMAG2_V3_UpCont.csv")).provenance
    window = Window(*np.radians([-36.5, -36.4, 144.9, 145.0]))
    assert load_map(path, window=window).values.shape < sea.values.shape
    assert "has no variable 'tmi'; it has sealevel, upcont" in refused(path, "tmi")
    far = Window(*np.radians([10.0, 11.0, 0.0, 1.0]))
    assert "has no rows in latitude 10.0000" in refused(path, window=far)


def test_emag2_where_its_longitudes_begin_anew(tmp_path):
    path = emag2(tmp_path / "EMAG2.csv", range(10790, 10810))
    field_map = load_map(path, window=Window(*np.radians([-36.7, -36.3, -0.1, 0.1])))
    assert field_map.values.shape[1] >= 6 and np.ptp(field_map.longitude) < np.radians(1.0)


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")  # inside rasterio
def test_emag2_as_geotiff(tmp_path):
    values = np.arange(400.0).reshape(20, 20)
    corner = from_origin(145.0, -36.0, 1 / 30, 1 / 30)
    path = tmp_path / "EMAG2_V3_UpCont_DataTiff.tif"
    found = load_map(geotiff(path, values, corner, unit=None, name=None))
    assert (found.quantity, found.unit, found.height) == ("magnetic_anomaly", "nT", 4000)
    np.testing.assert_allclose(found.values, values[::-1])


def test_dted(tmp_path):
    """A cell of one degree whose posts are on its edges."""
    path = tmp_path / "s37.dt0"
    step = 1.0 / 120.0
    posts = (np.arange(121)[:, None] + 2 * np.arange(121)).astype(np.int16)
    posts[5, 7] = -32767
    corner = from_origin(145 - step / 2, -36 + step / 2, step, step)
    how = {"kind": "int16", "nodata": -32767, "unit": None, "name": None}
    shutil.copy(geotiff(tmp_path / "cell.tif", posts, corner, **how), path, driver="DTED")
    found = load_map(path)
    assert (found.quantity, found.unit, found.quantisation) == ("height", "m", 1.0)
    np.testing.assert_allclose(np.degrees(found.latitude[[0, -1]]), [-37, -36], atol=1e-9)
    np.testing.assert_allclose(np.degrees(found.longitude[[0, -1]]), [145, 146], atol=1e-9)
    assert np.argwhere(np.isnan(found.values)).tolist() == [[115, 7]]
    assert found.values[-1, 3] == 6.0
    path.write_bytes(path.read_bytes()[:2000])
    assert "s37.dt0: cannot be read as DTED" in refused(path)


def test_depths_are_no_heights(tmp_path):
    path = tmp_path / "sea.nc"
    with netCDF4.Dataset(path, "w") as file:
        axes(file, -37.0 + np.arange(8) / 240.0, 145.0 + np.arange(8) / 240.0)
        for name, sign in (("depth", 1.0), ("depth_up", -1.0)):
            depths = file.createVariable(name, "f8", ("lat", "lon"))
            depths.units, depths[:] = "m", sign * (4000.0 - 10.0 * np.arange(8))
    assert "depth: values up to 4000 m by the name are depths" in refused(path, "depth", "height")
    assert load_map(path, "depth_up", "height").values.max() < 0.0


def test_gebco(tmp_path):
    """As its files say what they hold."""
    path, cells = tmp_path / "GEBCO_2024.nc", (np.arange(24) + 0.5) / 240.0
    with netCDF4.Dataset(path, "w") as file:
        axes(file, -37.0 + cells, 145.0 + cells)
        file["lat"].standard_name, file["lon"].standard_name = "latitude", "longitude"
        crs = file.createVariable("crs", "S1", ())
        crs.grid_mapping_name = "latitude_longitude"
        heights = file.createVariable("elevation", "i2", ("lat", "lon"), fill_value=-32767)
        heights.standard_name = "height_above_mean_sea_level"
        heights.long_name, heights.units = "Elevation relative to sea level", "m"
        heights.grid_mapping = "crs"
        heights[:] = -4000 + 3 * np.arange(24)[:, None] + np.arange(24)
    found = load_map(path)
    assert (found.quantity, found.unit, found.quantisation) == ("height", "m", 1.0)
    assert found.values[2, 1] == -3993
