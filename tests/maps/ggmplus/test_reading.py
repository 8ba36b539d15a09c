"""Maps from GGMplus tiles: joints, missing tiles, no-data, and what is refused."""

import numpy as np
import pytest

from helpers.map_files import refused
from isogal.maps.axes import Window
from isogal.maps.ggmplus.reading import is_ggmplus
from isogal.maps.ggmplus.tiles import CELLS, KINDS
from isogal.maps.load import load_map


def centres(corner):
    return corner + 0.001 + 0.002 * np.arange(CELLS)


def window(south, north, west, east):
    return Window(*np.radians([south, north, west, east]))


def tile_by_hand(path, kind, function, cut=None):
    """Write a tile as the format is described, without any code of the library: latitude fastest,
    big-endian."""
    south = (-1 if path.name[0] == "S" else 1) * int(path.name[1:3])
    west = (-1 if path.name[3] == "W" else 1) * int(path.name[4:7])
    lon, lat = np.meshgrid(centres(west), centres(south), indexing="ij")
    numbers = np.rint(function(lat, lon) / kind.step)
    numbers[np.isnan(numbers)] = kind.no_data
    data = numbers.astype(kind.dtype).tobytes()
    path.write_bytes(data[:cut])


def wave(lat, lon):
    return 1e-4 * np.sin(np.radians(40.0 * lat)) * np.cos(np.radians(25.0 * lon))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two neighbours of a disturbance map, with a hole; the tile to the north is missing."""
    folder = tmp_path_factory.mktemp("ggmplus")
    for name in ("S40E140.dg", "S40E145.dg"):
        tile_by_hand(
            folder / name,
            KINDS["dg"],
            lambda lat, lon: np.where(
                (np.abs(lat + 36.0) < 0.01) & (np.abs(lon - 147.0) < 0.01), np.nan, wave(lat, lon)
            ),
        )
    return folder


def test_values_are_where_the_format_puts_them(folder):
    field_map = load_map(folder, "dg", window=window(-37.1, -37.0, 146.0, 146.2))
    lat, lon = np.degrees(field_map.latitude), np.degrees(field_map.longitude)
    np.testing.assert_allclose(
        field_map.values, wave(lat[:, None], lon[None, :]), rtol=0, atol=0.51e-6
    )
    said = field_map.quantity, field_map.unit, field_map.quantisation
    assert said == ("disturbance", "m/s²", 1e-6)
    np.testing.assert_allclose((lat + 90.0) / 0.002 % 1.0, 0.5, atol=1e-6)


@pytest.mark.parametrize("extension", sorted(set(KINDS) - {"dg"}))
def test_other_kinds_of_tiles(tmp_path, extension):
    kind = KINDS[extension]
    middle = 9.8 if extension == "ga" else 0.0
    tile_by_hand(
        tmp_path / f"S40E140.{extension}",
        kind,
        lambda lat, lon: middle + 300.0 * kind.step * np.sin(40.0 * lat) * np.cos(25.0 * lon),
    )
    part = load_map(tmp_path, window=window(-37.1, -37.08, 141.0, 141.02))
    lat, lon = np.degrees(part.latitude), np.degrees(part.longitude)
    wave = np.sin(40.0 * lat[:, None]) * np.cos(25.0 * lon)
    assert (part.quantity, part.quantisation) == (kind.quantity, kind.step)
    np.testing.assert_allclose((part.values - middle) / kind.step, 300.0 * wave, atol=0.51)


def test_tiles_of_a_folder_are_joined(tmp_path, folder):
    assert is_ggmplus(folder) and is_ggmplus(folder / "S40E140.dg") and not is_ggmplus(tmp_path)
    field_map = load_map(folder, None, "disturbance", window(-37.2, -37.0, 144.8, 145.3))
    lat, lon = np.radians(np.full(200, -37.1)), np.radians(np.linspace(144.8, 145.3, 200))
    np.testing.assert_allclose(
        field_map.value(lat, lon), wave(np.degrees(lat), np.degrees(lon)), rtol=0, atol=2e-6
    )


def test_no_data_and_missing_tiles_are_nan(folder):
    field_map = load_map(folder, "dg", window=window(-36.1, -34.9, 146.9, 147.1))
    assert np.isnan(field_map.value(np.radians(-36.0), np.radians(147.0)))
    assert np.isnan(field_map.value(np.radians(-34.95), np.radians(147.0)))
    assert np.isfinite(field_map.value(np.radians(-35.5), np.radians(147.0)))
    assert "no tile S35E145.dg" in field_map.provenance


def test_refusals(tmp_path, folder):
    part = window(-37.2, -37.0, 144.8, 144.9)

    def said(path, variable, **more):
        return refused(path, variable, format_name="ggmplus", **{"window": part} | more)

    assert "has none of the tiles needed: S40E140.ga" in said(folder, "ga")
    assert "meant by zz of any quantity; give variable=" in said(folder, "zz")
    assert "meant by dg of gravity; give variable=" in said(folder, "dg", quantity="gravity")
    assert "meant by one variable of height" in said(folder, None, quantity="height")
    assert "unit cannot be given" in said(folder, "dg", unit="mGal")
    assert "no such folder" in said(tmp_path / "nix", "dg")
    assert "too many" in said(folder, "dg", window=window(-80.0, 80.0, -170.0, 170.0))
    tile = tmp_path / "S40E140.dg"
    tile_by_hand(tile, KINDS["dg"], wave, cut=-10)
    assert "has 12499990 bytes, a GGMplus dg tile has 12500000; cut short?" in said(tmp_path, "dg")
    np.fromfile(folder / tile.name, ">i2").astype("<i2").tofile(tile)
    assert "check the unit, scale, no-data value and byte order" in said(tmp_path, "dg")
    np.full(CELLS * CELLS, KINDS["dg"].no_data, ">i2").tofile(tile)
    assert "all missing" in said(tmp_path, "dg")
