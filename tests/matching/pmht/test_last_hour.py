"""What the navigator's own error does to the readings of the last hour."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of
from helpers.navigators import random_covariance
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.gravity import eotvos
from isogal.matching.batching import BatchBuilder
from isogal.matching.interfaces import Beside, Information, declined
from isogal.matching.pmht.attitude import joint_prior
from isogal.matching.pmht.last_hour import LastHour
from isogal.matching.pmht.map_error import MapErrorEstimate
from isogal.matching.pmht.past_batches import PastBatch
from isogal.matching.transitions import unconditioned
from isogal.scenario import Matcher
from isogal.sensors.gravimeter import GravityReduction

FLAT = field_map_of(lambda north, east: 0.0 * (north + east))
SIGMA = np.array([80.0, 60.0, 0.3, 0.2, 5e-5, 5e-5, 5e-4])
FLOWN = np.array([12.0, 18.0])


@pytest.fixture(scope="module")
def history() -> tuple[PastBatch, ...]:
    """Four batches of thirty readings, with those of another field beside, of a navigator whose
    covariance is the same at each end; every fix tells it something."""
    made = BatchBuilder(Matcher(batch_length=30, stride=30), GravityReduction(), context=10)
    north, east = metres_per_radian(ORIGIN[0], 0.0)
    prior, past = random_covariance(SIGMA, 0), ()
    told = Information(np.zeros(7), 2.0 * np.linalg.inv(prior))
    for t in range(120):
        place = ORIGIN[0] + 10.0 * t * FLOWN[0] / north, ORIGIN[1] + 10.0 * t * FLOWN[1] / east
        made.add_scan(10.0 * t, *place, FLOWN, 0.0, 1e-6)
        if made.ready:
            batch = made.build(prior)
            batch = replace(batch, beside=(Beside(1, batch, FLAT),))
            fix = replace(declined(batch, ""), reason=None, information=told)
            past = (*past, PastBatch.of(batch, FLAT, fix, 0.0, past))
    return past


@pytest.fixture(scope="module")
def hour(history) -> LastHour:
    prior = MapErrorEstimate.unknown(history[0].batch, FLAT).coarse_prior
    return LastHour.of(history, {None: (FLAT, prior), 1: (FLAT, prior)})


def test_the_track_is_one_from_batch_to_batch(hour):
    own, other = hour.seen
    position = own.unaided.position
    assert len(position) == 120
    np.testing.assert_array_equal(position, other.unaided.position)
    time = 10.0 * np.arange(120) - 890.0  # the end of the third of four batches is the middle
    np.testing.assert_allclose(position[89, :, :2], np.eye(2), atol=1e-9)
    wrong = position @ np.array([100.0, -50.0, 0.1, -0.2, 0.0, 0.0, 0.0])
    schuler = np.sqrt(9.8 / 6.37e6)
    swung = np.sin(schuler * time) / schuler
    expected = np.array([100.0, -50.0]) + swung[:, None] * [0.1, -0.2]
    np.testing.assert_allclose(wrong, expected, atol=15.0)
    assert np.abs(np.diff(wrong, axis=0)).max() < 2.5


def test_readings_that_may_be_late_are_displaced_along_the_track(history, hour):
    *before, last = history
    late = replace(last, batch=replace(last.batch, delay_sigma=20.0))
    prior = hour.seen[0].prior
    own = LastHour.of([*before, late], {None: (FLAT, prior)}).own
    way = 20.0 * last.batch.velocity[-1]
    np.testing.assert_allclose(own - hour.own, np.outer(way, way))


def test_a_wrong_velocity_is_in_readings_of_gravity_as_eotvos_effect(hour):
    by_velocity = hour.seen[0].unaided.reading[89, 2:4]
    at = ORIGIN[0], 0.0
    for axis in range(2):
        faster, slower = FLOWN.copy(), FLOWN.copy()
        faster[axis] += 0.5
        slower[axis] -= 0.5
        change = eotvos(*at, *faster) - eotvos(*at, *slower)
        assert abs(by_velocity[axis]) == pytest.approx(abs(change), rel=0.02)


def test_an_aided_navigators_readings_are_as_wrong_as_it_says(history, hour):
    """Over a flat map only its velocity matters."""
    root, first = hour.seen[0].aided.root, 0
    for past in history:
        batch = past.new_readings
        by_end = unconditioned(batch, batch.reading_jacobian, batch.nuisance_reading)
        expected = by_end @ joint_prior(batch) @ by_end.T
        part = root[first : first + len(batch)]
        scale = expected.max()
        np.testing.assert_allclose(part @ part.T, expected, atol=0.02 * scale)
        first += len(batch)


def test_a_place_at_the_end_is_where_the_track_ends(hour):
    ends = np.array([[3000.0, -2000.0], [-500.0, 800.0]])
    drawn = np.random.default_rng(0).normal(size=(2, 5))
    error = hour.lost.with_end(ends, drawn)
    np.testing.assert_allclose(error @ hour.lost.last[:2].T, ends, atol=1e-6)
