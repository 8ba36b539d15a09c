"""The Earth: GRS80's radii, frames, normal gravity and the Eötvös acceleration against published
values (Moritz 2000), boule and PROJ."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod, Transformer

from isogal.earth.ellipsoid import E2, EARTH_RATE, GM, A, F, metres_per_radian
from isogal.earth.frames import (
    LocalFrame,
    ecef_to_geodetic,
    geodetic_to_ecef,
    horizontal_difference,
)
from isogal.earth.gravity import (
    eotvos,
    eotvos_jacobian,
    normal_gradient,
    normal_gravity,
    normal_gravity_at,
    normal_gravity_gradient_north,
)
from isogal.errors import InputError


def test_constants_are_those_of_moritz():
    # derived constants of the published table, to its last digit
    assert pytest.approx(6356752.3141, abs=5e-5) == (1.0 - F) * A
    assert pytest.approx(0.00669438002290, abs=5e-15) == E2
    import boule  # takes a second, also where no test of this file runs

    assert boule.GRS80.semimajor_axis == A
    assert boule.GRS80.flattening == pytest.approx(F, rel=1e-12)
    assert boule.GRS80.geocentric_grav_const == GM
    assert boule.GRS80.angular_velocity == EARTH_RATE


@pytest.mark.parametrize(
    "use",
    [
        normal_gravity,
        normal_gradient,
        normal_gravity_gradient_north,
        lambda latitude: eotvos(latitude, 0.0, 1.0, 1.0),
        lambda latitude: LocalFrame(latitude, 144.5),
    ],
)
def test_degrees_are_refused_where_radians_belong(use):
    with pytest.raises(InputError, match=r"^latitude must be in radians, within .*, is -38; is"):
        use(-38.0)
    use(-0.5 * np.pi)  # a pole


def test_masked_latitudes_are_missing():
    gravity = normal_gravity(np.ma.array([0.5, 0.6], mask=[False, True]))
    assert gravity[0] == normal_gravity(0.5) and np.isnan(gravity[1])


@given(st.floats(-85.0, 85.0), st.floats(0.0, 360.0))
def test_metres_per_radian_against_geodesics(latitude, azimuth):
    longitude_1, latitude_1, _ = GEOD.fwd(20.0, latitude, azimuth, 10.0)
    north, east = metres_per_radian(np.radians(latitude))
    moved = np.radians([latitude_1 - latitude, longitude_1 - 20.0]) * [north, east]
    expected = 10.0 * np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))])
    np.testing.assert_allclose(moved, expected, atol=2e-4)  # 10 m of curved meridians at 85 deg
    higher = np.subtract(metres_per_radian(np.radians(latitude), 1000.0), [north, east])
    assert higher == pytest.approx([1000.0, 1000.0 * np.cos(np.radians(latitude))])


PROJ, GEOD = Transformer.from_pipeline("+proj=cart +ellps=GRS80"), Geod(ellps="GRS80")
latitudes = st.floats(-np.pi / 2, np.pi / 2)
longitudes = st.floats(-np.pi, np.pi)
heights = st.floats(-12e3, 4e7)


@given(latitudes, longitudes, heights)
def test_geodetic_to_ecef_equals_proj_and_back(latitude, longitude, height):
    ecef = geodetic_to_ecef(latitude, longitude, height)
    expected = PROJ.transform(longitude, latitude, height, radians=True)
    np.testing.assert_allclose(ecef, expected, rtol=0, atol=1e-7)
    lat, lon, h = ecef_to_geodetic(ecef)
    assert lat == pytest.approx(latitude, abs=1e-14)
    assert h == pytest.approx(height, abs=1e-7)
    turn = np.remainder(lon - longitude + np.pi, 2 * np.pi) - np.pi
    assert abs(turn) * np.cos(latitude) < 1e-14


def test_local_frame_points_where_it_says():
    origin, step = np.array([np.radians(-38.0), np.radians(144.5), 100.0]), 1e-5
    frame = LocalFrame(*origin)
    metres = horizontal_difference(origin[0] + step, step, origin[0], 0.0)
    for moved, expected in (
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
        ([step, 0.0, 0.0], [0.0, metres[0], 0.0]),
        ([0.0, step, 0.0], [metres[1], 0.0, 0.0]),
        ([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]),
    ):
        np.testing.assert_allclose(frame.from_geodetic(*(origin + moved)), expected, atol=2e-3)
    there = np.radians(-35.0), np.radians(150.0)
    up = frame.from_geodetic(*there, 1.0) - frame.from_geodetic(*there, 0.0)
    np.testing.assert_allclose(frame.rotation_from(*there) @ [0.0, 0.0, 1.0], up, atol=1e-8)


@pytest.mark.parametrize("longitude", [0.0, 179.9999, -180.0, 359.9999])
def test_horizontal_difference_crosses_the_date_line(longitude):
    step = 0.001
    difference = horizontal_difference(
        np.radians(-30.0),
        np.radians(np.remainder(longitude + step, 360.0)),
        np.radians(-30.001),
        np.radians(longitude),
    )
    np.testing.assert_allclose(difference, [110.85, 96.49], atol=0.02)


MGAL = 1e-5
KNOT = 1852.0 / 3600.0


@pytest.mark.parametrize(
    ("latitude", "published"),
    [(0.0, 9.7803267715), (-45.0, 9.806199203), (90.0, 9.8321863685)],
)
def test_normal_gravity_is_the_published_one(latitude, published):
    assert normal_gravity(np.radians(latitude)) == pytest.approx(published, abs=1e-9)
    kernel = normal_gravity_at(np.sin(np.radians(latitude)), 100.0)
    assert kernel == pytest.approx(float(normal_gravity(np.radians(latitude), 100.0)), rel=1e-15)


@pytest.mark.parametrize(("height", "within"), [(0.0, 1e-9), (100.0, 1.5e-8), (9000.0, 2e-6)])
def test_normal_gravity_equals_boule(height, within):
    import boule  # takes a second, also where no test of this file runs

    latitude = np.linspace(-90.0, 90.0, 37)
    expected = boule.GRS80.normal_gravity(
        (np.zeros(37), latitude, np.full(37, height)), si_units=True
    )
    np.testing.assert_allclose(
        normal_gravity(np.radians(latitude), height), expected, rtol=0, atol=within
    )


@given(st.floats(-1.55, 1.55))
def test_gradient_to_the_north_against_finite_differences(latitude):
    step = 1e-5
    metres = 6335439.3271 / (1.0 - 0.00669438 * np.sin(latitude) ** 2) ** 1.5 * 2 * step
    difference = (normal_gravity(latitude + step) - normal_gravity(latitude - step)) / metres
    assert normal_gravity_gradient_north(latitude) == pytest.approx(
        float(difference), abs=1e-15, rel=1e-6
    )


@pytest.mark.parametrize(
    ("latitude", "course", "knots"), [(36.5, 57.0, 43.0), (0.0, 90.0, 10.0), (60.0, 270.0, 20.0)]
)
def test_eotvos_against_the_published_formula(latitude, course, knots):
    # 7.503 v cos(lat) sin(course) + 0.004154 v² mGal, v in knots (Glicken 1962; Dehlinger 1978,
    # Marine Gravity)
    published = (
        7.503 * knots * np.cos(np.radians(latitude)) * np.sin(np.radians(course))
        + 0.004154 * knots**2
    ) * MGAL
    speed, course = knots * KNOT, np.radians(course)
    value = eotvos(np.radians(latitude), 0.0, speed * np.cos(course), speed * np.sin(course))
    assert value == pytest.approx(published, rel=2e-4)


@given(st.floats(-1.4, 1.4), st.floats(-300.0, 300.0), st.floats(-300.0, 300.0))
def test_eotvos_jacobian_against_finite_differences(latitude, north, east):
    found, step = eotvos_jacobian(latitude, north, east), 1e-2
    for slope, move in zip(found, ((step, 0.0), (0.0, step)), strict=True):
        up, down = (
            eotvos(latitude, 0.0, north + sign * move[0], east + sign * move[1])
            for sign in (1, -1)
        )
        assert slope == pytest.approx(float(up - down) / (2 * step), abs=1e-11)
