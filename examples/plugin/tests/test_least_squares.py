"""The matcher on a map of two crossing waves, where the answer is known."""

import math

import numpy as np
import pytest

from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch
from isogal.scenario import Matcher
from isogal_example.least_squares import LeastSquares

LATITUDE, LONGITUDE = math.radians(-37.0), math.radians(145.0)
ERROR = np.array([350.0, -250.0])
SIGMA = 1e-5


def waves(north, east):
    return 1e-4 * (np.sin(north / 900.0) + np.cos(east / 1100.0 + north / 2500.0))


@pytest.fixture(scope="module")
def field_map():
    node = 250.0 * np.arange(-60, 61)
    north, east = metres_per_radian(LATITUDE)
    return FieldMap(
        LATITUDE + node / north,
        LONGITUDE + node / east,
        waves(node[:, None], node[None, :]),
        "m/s²",
        "disturbance",
    )


def batch(field_map, readings=30, seed=0):
    """A straight track whose positions are all wrong by ERROR (estimate minus truth)."""
    north, east = metres_per_radian(LATITUDE)
    place = np.stack([180.0 * np.arange(readings) - 2e3, 120.0 * np.arange(readings)], axis=-1)
    true = LATITUDE + place[:, 0] / north, LONGITUDE + place[:, 1] / east
    noise = SIGMA * np.random.default_rng(seed).standard_normal(readings)
    same = np.tile(np.eye(7), (readings, 1, 1))  # the errors do not change along the track
    return Batch(
        time=10.0 * np.arange(readings),
        latitude=true[0] + ERROR[0] / north,
        longitude=true[1] + ERROR[1] / east,
        velocity=np.tile([18.0, 12.0], (readings, 1)),
        reading=field_map.value(*true) + noise,
        sigma=np.full(readings, SIGMA),
        covariance=np.diag([300.0**2, 300.0**2, *[1e-8] * 5]),
        by_error=np.concatenate([same[:, :2], np.zeros((readings, 1, 7))], axis=1),
        backward=same,
        new=readings,
    )


def error_of(fix, batch):
    """Return north and east error of a fix, m."""
    metres = np.array(metres_per_radian(LATITUDE))
    place = np.array([batch.latitude[-1], batch.longitude[-1]]) - ERROR / metres
    return (np.array([fix.latitude, fix.longitude]) - place) * metres


def test_the_shift_is_found_and_its_covariance_is_honest(field_map):
    matcher = LeastSquares.from_settings(Matcher())
    squares = []
    for seed in range(40):
        data = batch(field_map, seed=seed)
        fix, _ = matcher.match(data, field_map, None)
        assert fix.published
        error = error_of(fix, data)
        assert np.hypot(*error) < 200.0
        squares.append(error @ np.linalg.solve(fix.covariance, error))
    # The mean of 40 values of chi-square with 2 degrees of freedom is outside of 1.15 to 3.13 once
    # in 500 times. As the covariance grows with large residuals, a little less is expected.
    assert 1.15 < np.mean(squares) < 3.13


def test_a_flat_map_gives_no_fix(field_map):
    flat = FieldMap(
        field_map.latitude, field_map.longitude, 0.0 * field_map.values, "m/s²", "disturbance"
    )
    fix, _ = LeastSquares.from_settings(Matcher()).match(batch(field_map), flat, None)
    assert fix.reason is not None


def test_missing_readings_are_left_out(field_map):
    data = batch(field_map)
    data.reading[::2] = np.nan
    fix, _ = LeastSquares.from_settings(Matcher()).match(data, field_map, None)
    assert fix.published
    assert np.hypot(*error_of(fix, data)) < 300.0
    data.reading[6:] = np.nan
    fix, _ = LeastSquares.from_settings(Matcher()).match(data, field_map, None)
    assert fix.reason == "only 3 of 30 scans have a reading (4 needed)"


def test_unknown_options_are_refused():
    with pytest.raises(InputError, match=r"^matcher\.options of least-squares: unknown key 'x'"):
        LeastSquares.from_settings(Matcher(options={"x": 1}))
