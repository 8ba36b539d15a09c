"""Names and places of GGMplus tiles."""

import numpy as np

from isogal.maps.axes import Window
from isogal.maps.ggmplus.tiles import corner_of, extent_of, tile_name, tiles_of


def test_names_and_corners():
    for corner, name in (
        ((-40, 145), "S40E145.ga"),
        ((0, -5), "N00W005.dg"),
        ((10, -180), "N10W180.ga"),
    ):
        assert tile_name(*corner, name[-2:]) == name
        assert tile_name(*corner_of(name), name[-2:]) == name
    across = tiles_of(Window(*np.radians([1.0, 2.0, 179.9, -179.9])))
    assert [tile_name(*corner, "ga") for corner in across] == ["N00E175.ga", "N00W180.ga"]


def test_the_extent_of_tiles_needs_no_others():
    names = ["S40E145.ga", "S35E145.ga", "S35E150.ga"]
    needed = {tile_name(*corner, "ga") for corner in tiles_of(extent_of(names))}
    assert needed == {*names, "S40E150.ga"}
