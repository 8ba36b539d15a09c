"""Names and places of GGMplus tiles."""

import numpy as np

from isogal.maps.axes import Window
from isogal.maps.ggmplus.tiles import corner_of, extent_of, tile_name, tiles_of


def window(south, north, west, east):
    return Window(*np.radians([south, north, west, east]))


def test_names_and_corners():
    assert tile_name(-40, 145, "ga") == "S40E145.ga" and tile_name(0, -5, "dg") == "N00W005.dg"
    assert tile_name(10, 180, "ga") == "N10W180.ga" and tile_name(-5, 355, "ga") == "S05W005.ga"
    route = window(-38.0, -35.0, 144.5, 150.0).grown(25_000.0)
    names = {tile_name(*corner, "ga") for corner in tiles_of(route)}
    assert names == {
        "S40E140.ga",
        "S40E145.ga",
        "S40E150.ga",
        "S35E140.ga",
        "S35E145.ga",
        "S35E150.ga",
    }
    assert [tile_name(*c, "ga") for c in tiles_of(window(1.0, 2.0, 179.9, -179.9))] == [
        "N00E175.ga",
        "N00W180.ga",
    ]
    for name in ("S40E145.ga", "N00W005.dg", "S05W180.ha"):
        assert tile_name(*corner_of(name), name[-2:]) == name


def test_the_extent_of_tiles_needs_no_others():
    names = ["S40E145.ga", "S35E145.ga", "S35E150.ga"]
    needed = {tile_name(*corner, "ga") for corner in tiles_of(extent_of(names))}
    assert needed == {*names, "S40E150.ga"}
