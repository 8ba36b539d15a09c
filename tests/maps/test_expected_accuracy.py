"""Expected position information along a track."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.displacement import displacement_at
from isogal.maps.error_ellipses import ellipses_of
from isogal.maps.expected_accuracy import Errors, position_information

LAT, LON = ORIGIN
EAST = float(metres_per_radian(LAT)[1])


def saddle(quantity="height", unit="m", scale=1.0):
    """Values a·north + b·east + c·north·east: gradients (a + c·east, b + c·north)."""
    field_map = field_map_of(
        lambda n, e: scale * (3e-3 * n + 1e-3 * e + 4e-7 * n * e), half=60e3, step=1000.0
    )
    return replace(field_map, unit=unit, quantity=quantity)


def track(count=60, spacing=500.0):
    return np.full(count, LAT), LON + spacing / EAST * (np.arange(count) - count // 2)


@pytest.mark.parametrize("errors", [Errors(0.5, 0.0), Errors(0.5, 0.4, 3000.0, 0.3)], ids=str)
def test_by_hand(errors):
    """The covariance of least squares with the known gradients of the saddle, east along the
    parallel: the Cramér-Rao bound of a rigid shift."""
    latitude, longitude = track()
    found = position_information(saddle(), latitude, longitude, errors, stretch=0.0)
    east = EAST * (longitude - LON)
    slope = np.stack([3e-3 + 4e-7 * east, np.full(60, 1e-3)], axis=1)
    noise = 0.25 * np.eye(60)
    if errors.map_sigma:
        noise += 0.16 * np.exp(-np.abs(east[:, None] - east) / 3000.0) + 0.09
    expected = np.linalg.inv(slope.T @ np.linalg.solve(noise, slope))
    np.testing.assert_allclose(found.covariance[0], expected, rtol=1e-3)
    best, worst = found.axes
    axes = np.linalg.eigvalsh(found.covariance[0])
    np.testing.assert_allclose([best[0] ** 2, worst[0] ** 2], axes, rtol=1e-9)
    assert found.gradient[0] == pytest.approx(np.sqrt(np.mean(np.sum(slope**2, axis=1))), rel=1e-4)


def test_where_an_error_is_not_said_the_usual_one_counts():
    field_map = field_map_of(lambda n, e: 1e-8 * n * e, step=1000.0)
    sigma = np.full(field_map.shape, 2e-5)
    line = np.full(5, ORIGIN[0]), ORIGIN[1] + np.linspace(0.0, 1e-3, 5)
    whole = Errors(1e-5).covariance(replace(field_map, sigma=sigma), *line)
    sigma = np.where(np.arange(len(sigma)) % 2, sigma.T, np.nan).T
    np.testing.assert_allclose(
        Errors(1e-5).covariance(replace(field_map, sigma=sigma), *line), whole
    )


def test_a_gridded_map_may_be_displaced():
    latitude, longitude = track()
    plain = replace(saddle(), sigma=np.full((121, 121), 2.0), correlation_length=3000.0)
    ellipse = ellipses_of(*(np.array(one) for one in (3000.0, 3000.0, 0.0)))
    gridded = replace(plain, error_ellipses=np.broadcast_to(ellipse, (121, 121, 3)))
    told, without, with_ = (
        position_information(one, latitude, longitude, errors, stretch=0.0).covariance[0]
        for one, errors in (
            (gridded, Errors(0.5, 2.0)),
            (plain, Errors(0.5)),
            (gridded, Errors(0.5)),
        )
    )
    beside = displacement_at(gridded, latitude, longitude)
    assert np.mean(beside**2) > 100.0
    np.testing.assert_allclose(with_ - without, np.mean(beside**2) * np.eye(2), rtol=1e-9)
    np.testing.assert_allclose(told, without, rtol=1e-9)


def test_a_plane_leaves_a_direction_open_and_a_hole_is_nan():
    plane = field_map_of(lambda n, e: 3e-3 * n, step=1000.0)
    plane = replace(plane, unit="m", quantity="height")
    latitude, longitude = track()
    assert np.isinf(position_information(plane, latitude, longitude, Errors(0.5)).axes[1]).all()
    plane.values[:, 40:] = np.nan
    holed = position_information(plane, latitude, longitude, Errors(0.5))
    assert np.isnan(holed.axes[1][-1])
