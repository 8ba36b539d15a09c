"""What lies along a route: its window, and the small windows that cover it."""

import numpy as np
import pytest

from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.corridor import along_track, corridor_of


def around(latitude, longitude, metres, count=16):
    """Return points on a circle about each of some points."""
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    north, east = metres_per_radian(latitude[:, None])
    return (
        latitude[:, None] + metres * np.cos(angle) / north,
        longitude[:, None] + metres * np.sin(angle) / east,
    )


def contains(window, latitude, longitude):
    return (
        (window.south <= latitude)
        & (latitude <= window.north)
        & (window.west <= longitude)
        & (longitude <= window.east)
    )


@pytest.mark.parametrize("margin", [25_000.0, 0.0])
def test_the_windows_together_cover_all_within_the_margin_and_little_more(margin):
    # eastwards, then a sharp bend to the north-west
    latitude = np.radians(np.r_[np.full(200, -40.0), np.linspace(-40.0, -36.0, 300)])
    longitude = np.radians(np.r_[np.linspace(140.0, 145.0, 200), np.linspace(145.0, 141.0, 300)])
    corridor = corridor_of(latitude, longitude, margin)
    windows = corridor.windows()
    points = around(latitude, longitude, 0.99 * margin)
    covered = np.any([contains(window, *points) for window in windows], axis=0)
    assert covered.all()
    assert contains(corridor.window, *points).all()
    beyond = around(latitude[50:150], longitude[50:150], 1.6 * margin + 3_000.0)
    covered = np.any([contains(window, *beyond) for window in windows], axis=0)
    assert not covered[:, 0].any() and not covered[:, 8].any()  # due north and south


def test_longitudes_and_distances_go_on_across_the_date_line():
    longitude = np.radians([178.0, 179.9, -179.9, -179.0])
    corridor = corridor_of(np.zeros(4), longitude, 1e3)
    np.testing.assert_allclose(np.degrees(corridor.longitude), [178.0, 179.9, 180.1, 181.0])
    assert corridor.window.east > corridor.window.west
    distance = np.radians([0.0, 1.9, 2.1, 3.0]) * 6378137.0
    np.testing.assert_allclose(along_track(np.zeros(4), longitude), distance, rtol=1e-9)
