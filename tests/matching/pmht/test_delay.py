"""Readings that are later than told."""

from dataclasses import replace

import numpy as np

from helpers.batches import make_batch
from isogal.matching.pmht.delay import later


def test_rows_are_where_the_vehicle_was_a_time_before(rough_map):
    batch, _ = make_batch(rough_map)
    moved = later(batch, 10.0)
    np.testing.assert_allclose(moved.latitude[1:], batch.latitude[:-1], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(moved.longitude[1:], batch.longitude[:-1], rtol=0.0, atol=1e-12)
    assert moved.end == batch.end
    assert later(batch, 0.0) is batch


def test_channels_of_a_scan_stay_together(rough_map):
    batch, _ = make_batch(rough_map)
    rows = np.repeat(np.arange(len(batch)), 3)
    several = replace(
        batch,
        time=batch.time[rows],
        latitude=batch.latitude[rows],
        longitude=batch.longitude[rows],
        velocity=batch.velocity[rows],
    )
    one, moved = later(batch, 7.0), later(several, 7.0)
    np.testing.assert_array_equal(moved.latitude, one.latitude[rows])
    np.testing.assert_array_equal(moved.velocity, one.velocity[rows])
