"""Readings of a batch as rows that are linear but for the map."""

from dataclasses import replace

import numpy as np

from helpers.bank import PLANE
from helpers.batches import field_map_of, make_batch, wavy
from isogal.maps.roughness import roughness_at
from isogal.matching.parameters import InstrumentErrors, Parameters
from isogal.matching.pmht.rows import Epoch, rows_of
from isogal.matching.pmht.states import (
    COUPLING_FORWARD,
    COUPLING_RIGHT,
    DRIFT,
    UNKNOWN,
    States,
)
from isogal.passage import History

ROUGH = field_map_of(wavy)
LENGTHS = np.array([1000.0, 4000.0])


def rows(batch, field_map=ROUGH, last=None):
    states = States.of(batch, field_map)
    made, epoch = rows_of(batch, field_map, states, LENGTHS, last)
    return made, epoch, states


def predicted(made, field_map, state):
    """What the rows say of a state without noise."""
    moved = made.place @ state
    value = field_map.value(
        made.latitude - moved[:, 0] * made.radian[:, 0],
        made.longitude - moved[:, 1] * made.radian[:, 1],
    )
    return value + made.reading @ state


def test_rows_foretell_the_readings_of_a_navigator_with_an_error():
    error = np.array([250.0, -300.0, 0.03, 0.02])
    batch, _ = make_batch(ROUGH, error, seed=None, jacobian=(1e-9, 0.0, 3e-6, 1e-4))
    made, _, states = rows(batch)
    state = np.zeros(states.count)
    state[:4] = error
    np.testing.assert_allclose(made.level, predicted(made, ROUGH, state), atol=2e-8)
    assert np.abs(made.level - predicted(made, ROUGH, 0.0 * state)).max() > 1e-5
    np.testing.assert_allclose(made.noise, 1e-10)


def test_only_new_readings_that_are_there_are_rows():
    batch, _ = make_batch(PLANE)
    reading = batch.reading.copy()
    reading[[22, 27]] = np.nan
    made, epoch, _ = rows(replace(batch, reading=reading, new=12, cut=20), PLANE)
    kept = [20, 21, 23, 24, 25, 26, 28, 29]
    np.testing.assert_array_equal(made.latitude, batch.latitude[kept])
    assert epoch.time == batch.time[29]
    last = Epoch(0.0, 900.0, np.zeros(2), np.zeros((2, 2)))
    none, same, _ = rows(replace(batch, reading=np.full(30, np.nan)), PLANE, last)
    assert none is None
    assert same is last


def test_distance_and_time_go_on_from_the_last_reading():
    batch, _ = make_batch(PLANE)
    made, epoch, states = rows(batch, PLANE)
    away = 10.0 * np.hypot(*batch.velocity.T)
    np.testing.assert_allclose(made.step[0, :, 0, 0], np.exp(-np.r_[0.0, away[1:]] / 1000.0))
    assert epoch.start == batch.time[0]
    drift = states.count - len(UNKNOWN) + DRIFT
    np.testing.assert_array_equal(made.reading[:, drift - 1], 1.0)  # a bias
    np.testing.assert_array_equal(made.reading[:, drift], batch.time - batch.time[0])
    first, epoch, _ = rows(replace(batch.part(np.arange(10)), new=10), PLANE)
    later, _, _ = rows(replace(batch, new=20), PLANE, epoch)
    both = np.concatenate([first.step, later.step], axis=1)
    np.testing.assert_allclose(both, made.step, rtol=1e-12)
    np.testing.assert_array_equal(np.concatenate([first.reading, later.reading]), made.reading)


def test_accelerations_are_those_since_the_reading_before():
    """In a turn to the right at constant speed: v times the turn rate, to the right."""
    batch, _ = make_batch(PLANE)
    angle, speed = 2e-3 * batch.time, 20.0
    turning = replace(batch, velocity=speed * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
    made, _, _ = rows(turning, PLANE)
    moving = made.reading[:, 8 + COUPLING_FORWARD :]
    np.testing.assert_allclose(moving, [[0.0, speed * 2e-3]] * 30, atol=1e-5)
    _, epoch, _ = rows(replace(turning.part(np.arange(10)), new=10), PLANE)
    jump = np.array([0.0, 0.0, 0.5, -0.3, 0.0, 0.0, 0.0])
    moved = replace(turning, velocity=turning.velocity + jump[2:4], new=20, history=History(jump))
    later, _, _ = rows(moved, PLANE, epoch)  # a fix is no acceleration
    np.testing.assert_allclose(later.reading[:, 8 + COUPLING_RIGHT], speed * 2e-3, rtol=0.05)


def test_told_parameters_have_states_before_those_nobody_tells_of():
    batch, _ = make_batch(PLANE)
    random = np.random.default_rng(0)
    told = Parameters(
        ("scale", ""), np.array([0.1, 2.0]), random.standard_normal((30, 2)),
        random.standard_normal((30, 2, 2)), np.array([np.inf, 100.0]), np.array([1e-3, 0.0]),
    )  # fmt: skip
    made, _, states = rows(replace(batch, instrument=InstrumentErrors(told, 1e-7)), PLANE)
    assert states.names == ("scale", "", *UNKNOWN)
    assert states.count == 7 + 1 + 2 + len(UNKNOWN)
    np.testing.assert_array_equal(made.reading[:, 8:10], told.reading)
    np.testing.assert_array_equal(made.place[:, :, 8:10], told.position)
    step = np.exp(-10.0 / 100.0)
    np.testing.assert_allclose(made.keep[1], [1.0, 1.0, step, *np.ones(len(UNKNOWN))])
    fresh = [0.0, 1e-6 * 10.0, 4.0 * (1.0 - step**2), 1e-14 * 10.0, *np.zeros(len(UNKNOWN) - 1)]
    np.testing.assert_allclose(made.fresh[1], fresh)
    np.testing.assert_array_equal(made.fresh[0], 0.0)  # nothing before the first one


def test_a_map_that_is_worse_in_places_has_a_larger_error_there():
    sigma = np.full(ROUGH.shape, 1e-5)
    sigma[: ROUGH.shape[0] // 2] = 3e-5
    batch, _ = make_batch(ROUGH)
    made, _, _ = rows(batch, replace(ROUGH, sigma=sigma))
    own = replace(ROUGH, sigma=sigma).sigma_at(batch.latitude, batch.longitude)
    np.testing.assert_allclose(made.load[0, :, 0], own / sigma.mean())
    assert np.ptp(made.load[0]) > 0.5
    assert (rows(batch)[0].load == 1.0).all()


def test_what_a_grid_leaves_out_is_as_large_as_the_map_is_rough_there():
    batch, _ = make_batch(ROUGH)
    states, rough = States.of(batch, ROUGH), np.array([0.0, 2e-5])
    made, _ = rows_of(batch, ROUGH, states, np.array([4000.0, 500.0]), None, rough)
    here = roughness_at(ROUGH, batch.latitude, batch.longitude)
    assert (made.load[0] == 1.0).all()
    np.testing.assert_allclose(made.load[1, :, 0], here / 2e-5)


def test_rounding_of_the_map_is_noise():
    batch, _ = make_batch(ROUGH)
    made, _, _ = rows(batch, replace(ROUGH, quantisation=6e-5))
    np.testing.assert_allclose(made.noise, 1e-10 + 3e-10)
