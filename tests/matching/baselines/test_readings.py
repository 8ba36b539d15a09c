"""What the baselines share: from a posterior or a measured shift to a fix, and back through a
filter."""

import numpy as np

from helpers.batches import field_map_of, make_batch
from isogal.earth.ellipsoid import metres_per_radian
from isogal.matching.baselines.readings import (
    AssumedNoise,
    UsableReadings,
    publish_measured,
    publish_posterior,
    shift_covariance,
)


def update(prior, z, R, H):
    K = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + R)
    return K @ z, prior - K @ H @ prior


def measured_error(batch, fix):
    """The navigator's error (2,) according to the fix."""
    metres = metres_per_radian(batch.latitude[-1])
    return np.array(
        [
            (batch.latitude[-1] - fix.latitude) * metres[0],
            (batch.longitude[-1] - fix.longitude) * metres[1],
        ]
    )


def test_publishing_a_posterior(rough_map):
    batch, _ = make_batch(rough_map, prior_sigma=(200.0, 0.05))
    mean = np.array([30.0, -40.0, 0.01, 0.0])
    covariance = np.diag([50.0**2, 60.0**2, 0.04**2, 0.05**2])
    fix = publish_posterior(batch, mean, covariance, {"figure": 1.0})
    new_mean, new_covariance = update(
        batch.prior, measured_error(batch, fix), fix.covariance, np.eye(2, 4)
    )
    np.testing.assert_allclose(new_mean[:2], mean[:2], rtol=1e-6)
    np.testing.assert_allclose(new_covariance[:2, :2], covariance[:2, :2], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        np.linalg.inv(np.linalg.inv(batch.prior) + fix.information.matrix),
        covariance,
        rtol=1e-6,
        atol=1e-9,
    )
    np.testing.assert_allclose(
        np.linalg.inv(fix.scan_covariance).sum(axis=0), np.linalg.inv(fix.covariance), rtol=1e-9
    )
    nothing = publish_posterior(batch, np.zeros(4), batch.prior, {})
    assert nothing.reason == "the readings tell nothing that the navigator does not know"


def test_publishing_a_measurement_counts_each_reading_once(rough_map):
    batch, _ = make_batch(rough_map, new=10)
    fix = publish_measured(batch, np.array([30.0, -40.0]), np.diag([100.0, 400.0]), {})
    np.testing.assert_allclose(measured_error(batch, fix), [30.0, -40.0], rtol=1e-9)
    np.testing.assert_allclose(fix.covariance, np.diag([300.0, 1200.0]))
    assert np.isnan(fix.scan_covariance[:20]).all()
    np.testing.assert_allclose(
        np.linalg.inv(fix.scan_covariance[20:]).sum(axis=0), np.linalg.inv(fix.covariance)
    )


def test_curvature_covariance_by_hand():
    # ten readings of slope 2 north, ten of slope 4 east, sigma 1: information 40 and 160; a
    # velocity error that looks like half a unit of the north slope shifts the fix by half a metre
    # per unit
    slope = np.zeros((20, 4))
    slope[:10, 0], slope[10:, 1], slope[:10, 2] = 2.0, 4.0, 1.0
    covariance = shift_covariance(slope, np.ones(20), np.diag([0.36, 0.0]), 1e3)
    np.testing.assert_allclose(covariance, np.diag([1 / 40 + 0.25 * 0.36, 1 / 160]), atol=1e-12)
    blind = shift_covariance(slope * [1, 0, 1, 1], np.ones(20), np.zeros((2, 2)), 1e3)
    np.testing.assert_allclose(blind, np.diag([1 / 40, 1e6]), rtol=1e-9)


def test_readings_in_and_out(rough_map):
    reading = np.array(make_batch(rough_map)[0].reading)
    reading[3] = np.nan
    batch, _ = make_batch(rough_map, reading=reading, new=20)
    noise = AssumedNoise(map_sigma=2e-5)
    whole = UsableReadings.of(batch, rough_map, noise, whole=True)
    new = UsableReadings.of(batch, rough_map, AssumedNoise(), whole=False)
    assert list(whole.row) == [0, 1, 2, *range(4, 30)]
    assert list(new.row) == list(range(10, 30))
    np.testing.assert_allclose(whole.arrays.sigma, np.hypot(1e-5, 2e-5))
    known = field_map_of(lambda n, e: 1e-8 * n + 0.0 * e, sigma=4e-5, quantisation=1e-6)
    np.testing.assert_allclose(
        UsableReadings.of(batch, known, noise, whole=True).arrays.sigma,
        np.sqrt(1e-10 + 16e-10 + 1e-12 / 12.0),
    )
