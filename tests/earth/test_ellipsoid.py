"""GRS80 radii against the published constants (Moritz 2000), boule and PROJ's geodesics."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod
from scipy.integrate import quad

from isogal.earth.ellipsoid import E2, EARTH_RATE, GM, A, F, metres_per_radian, radii


def test_constants_are_those_of_moritz():
    # derived constants of the published table, to its last digit
    assert pytest.approx(6356752.3141, abs=5e-5) == (1.0 - F) * A
    assert pytest.approx(0.00669438002290, abs=5e-15) == E2
    import boule  # takes a second, also where no test of this file runs

    assert boule.GRS80.semimajor_axis == A
    assert boule.GRS80.flattening == pytest.approx(F, rel=1e-12)
    assert boule.GRS80.geocentric_grav_const == GM
    assert boule.GRS80.angular_velocity == EARTH_RATE


def test_radii_are_those_of_the_published_quadrant_and_polar_curvature():
    length, _ = quad(lambda latitude: float(radii(latitude)[0]), 0.0, np.pi / 2, epsabs=1e-6)
    assert length == pytest.approx(10001965.7293, abs=1e-4)  # Moritz (2000), as the next
    np.testing.assert_allclose(radii(np.pi / 2), 6399593.6259, atol=1e-4)
    assert radii(0.0)[1] == A


@given(st.floats(-85.0, 85.0), st.floats(0.0, 360.0))
def test_metres_per_radian_against_geodesics(latitude, azimuth):
    longitude_1, latitude_1, _ = Geod(ellps="GRS80").fwd(20.0, latitude, azimuth, 10.0)
    north, east = metres_per_radian(np.radians(latitude))
    moved = np.radians([latitude_1 - latitude, longitude_1 - 20.0]) * [north, east]
    expected = 10.0 * np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))])
    np.testing.assert_allclose(moved, expected, atol=2e-4)  # 10 m of curved meridians at 85 deg


def test_height_adds_to_the_radii():
    low, high = metres_per_radian(0.6), metres_per_radian(0.6, 1000.0)
    assert high[0] - low[0] == pytest.approx(1000.0)
    assert high[1] - low[1] == pytest.approx(1000.0 * np.cos(0.6))
