"""Readings of a batch as rows that are linear but for the map; what a sensor adds beside white
noise, as states: the same as one covariance of all readings."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.bank import PLANE
from helpers.batches import INTERVAL, field_map_of, make_batch, noise_covariance, wavy
from isogal.earth.frames import horizontal_difference
from isogal.maps.channels import ChannelMap
from isogal.maps.error_model import smooth, tensor_covariance
from isogal.maps.roughness import roughness_at
from isogal.matching.expansion import Soundings, channel_batch
from isogal.matching.parameters import InstrumentErrors, Parameters
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.matching.pmht.models import Assumed, models_of
from isogal.matching.pmht.rows import Epoch, rows_of
from isogal.matching.pmht.states import (
    COUPLING_FORWARD,
    COUPLING_RIGHT,
    DRIFT,
    FILTER_ERROR,
    TENSOR_ORDER,
    UNKNOWN,
    States,
)
from isogal.matching.reading_noise import height_states, joined, noise_states
from isogal.passage import History
from isogal.scenario import Gravimeter, Height
from isogal.sensors.reduction import State

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


@pytest.mark.parametrize("quantity", ["disturbance", "field"])
def test_a_reduction_is_not_linear_in_a_velocity_that_is_far_off(quantity):
    """A reduction by a velocity that is v off adds v² / R less than its derivative says."""
    error = np.array([250.0, -300.0, 30.0, -20.0])
    field_map = replace(ROUGH, quantity=quantity, unit="m/s²")
    batch, _ = make_batch(field_map, error, seed=None, jacobian=(1e-9, 0.0, 3e-6, 1e-4))
    gravity = quantity == "disturbance"
    squares = (30.0**2 + 20.0**2) / 6.37e6 if gravity else 0.0
    made, _, states = rows(replace(batch, reading=batch.reading - squares), field_map)
    letter = models_of(Assumed(noise=1e-5, scale=1e-4, rough=1e-5, sigma=0.0, trust=1.0), states)
    sigma = np.zeros(states.count)
    sigma[:4] = 100.0, 100.0, 1.0, 1.0
    mean = np.pad(error, (0, states.count - 4))[None]
    bank = Hypotheses(letter, np.zeros(1, int), np.zeros(1), mean, np.diag(sigma**2)[None])
    after = bank.observed(field_map, made)
    np.testing.assert_allclose(after.mean[0, :4], error, rtol=1e-3)
    # over which a velocity is uncertain by 20 m/s that bends as much as a map does
    flat = replace(PLANE, quantity=quantity, unit="m/s²")
    made = rows(batch, flat)[0]
    sigma[2:4] = 20.0
    across = np.diag(sigma**2)
    across[0, 2] = across[2, 0] = 0.99 * sigma[0] * sigma[2]
    wide = replace(bank, covariance=across[None]).split(flat, made)
    assert (len(wide) > 1) == gravity


def test_the_velocity_of_each_scan_counts_in_the_reduction():
    """A tilt of 5 mrad about east has changed the velocity by 5 m/s since 100 s before the end."""
    field_map = replace(PLANE, quantity="disturbance", unit="m/s²")
    batch, _ = make_batch(field_map, jacobian=(0.0, 0.0, 3e-6, 1e-4))
    backward, age = batch.backward.copy(), batch.time[-1] - batch.time
    backward[:, 2, 5] = 9.8 * age
    error = np.array([0.0, 0.0, 30.0, -20.0, 0.0, 5e-3, 0.0])
    made = rows(replace(batch, backward=backward), field_map)[0]
    squares = np.square(made.swift @ error).sum(axis=1)
    expected = ((30.0 + 0.049 * age) ** 2 + 20.0**2) / 6.37e6
    np.testing.assert_allclose(squares, expected, rtol=0.01)


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
    moving = made.reading[:, 9 + COUPLING_FORWARD : 9 + FILTER_ERROR]
    np.testing.assert_allclose(moving, [[0.0, speed * 2e-3]] * 30, atol=1e-5)
    _, epoch, _ = rows(replace(turning.part(np.arange(10)), new=10), PLANE)
    jump = np.array([0.0, 0.0, 0.5, -0.3, 0.0, 0.0, 0.0])
    moved = replace(turning, velocity=turning.velocity + jump[2:4], new=20, history=History(jump))
    later, _, _ = rows(moved, PLANE, epoch)  # a fix is no acceleration
    np.testing.assert_allclose(later.reading[:, 9 + COUPLING_RIGHT], speed * 2e-3, rtol=0.05)


def test_told_parameters_have_states_before_those_nobody_tells_of():
    batch, _ = make_batch(PLANE)
    random = np.random.default_rng(0)
    told = Parameters(
        ("scale", ""), np.array([0.1, 2.0]), random.standard_normal((30, 2)),
        random.standard_normal((30, 2, 2)), np.array([np.inf, 100.0]), np.array([1e-3, 0.0]),
    )  # fmt: skip
    made, _, states = rows(replace(batch, instrument=InstrumentErrors(told, 1e-7)), PLANE)
    assert states.names == ("scale", "", *UNKNOWN)
    assert states.count == 7 + 2 + 2 + len(UNKNOWN)  # the map's error has a slope
    np.testing.assert_array_equal(made.reading[:, 9:11], told.reading)
    np.testing.assert_array_equal(made.place[:, :, 9:11], told.position)
    step = np.exp(-10.0 / 100.0)
    np.testing.assert_allclose(made.keep[1], [1.0, 1.0, 1.0, step, *np.ones(len(UNKNOWN))])
    told_of = [1e-6 * 10.0, 4.0 * (1.0 - step**2), 1e-14 * 10.0]
    fresh = [0.0, 0.0, *told_of, *np.zeros(len(UNKNOWN) - 1)]
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
    assert (rows(batch)[0].load == [1.0, 0.0]).all()


def test_what_a_grid_leaves_out_is_as_large_as_the_map_is_rough_there():
    batch, _ = make_batch(ROUGH)
    states, rough = States.of(batch, ROUGH), np.array([0.0, 2e-5])
    made, _ = rows_of(batch, ROUGH, states, np.array([4000.0, 500.0]), None, rough)
    here = roughness_at(ROUGH, batch.latitude, batch.longitude)
    assert (made.load[0] == [1.0, 0.0]).all()
    np.testing.assert_allclose(made.load[1, :, 0], here / 2e-5)
    # it has no kinks: its slope goes with it
    travelled = np.hypot(*batch.velocity[1:].T) * np.diff(batch.time)
    step, joined = smooth(travelled, 500.0)
    np.testing.assert_allclose(made.step[1, 1:], step)
    np.testing.assert_allclose(made.joined[1, 1:], joined)
    assert (made.step[0, :, 0, 1] == 0.0).all()


T, SIGMA = 12, 1e-5
TIME = 1000.0 + INTERVAL * np.arange(T)
TURNING = np.stack([14.0 + np.sin(TIME / 30.0), 17.0 + 2.0 * np.cos(TIME / 40.0)], axis=1)


def plane(north: float, east: float):
    """A map that is linear."""
    return field_map_of(lambda n, e: north * n + east * e, half=40e3, step=2000.0)


class Slope:
    """A reduction for which only its slope with height counts."""

    def height_slope(self, at):
        return np.full(len(at.latitude), -3.1e-6)


def only_model(batch, field_map):
    """The states, and the one model that the map has no error and nothing is wrong."""
    states = States.of(batch, field_map)
    known = Assumed(noise=SIGMA, scale=1e-4, rough=1e-6, sigma=0.0, trust=1.0)
    return states, models_of(known, states)


def by_bank(batch, field_map, steps=(T,)):
    """Posterior mean and covariance of a navigator's position and velocity, and log evidence,
    where the bank takes the readings in steps of so many scans."""
    states, models = only_model(batch, field_map)
    bank = Hypotheses.before(models, batch.covariance)
    each, epoch = batch.rows_per_scan, None
    for count, first in zip(steps, np.cumsum((0, *steps)), strict=False):
        rows = each * np.arange(first, first + count)[:, None] + np.arange(each)
        part = replace(batch.part(rows.ravel()), new=rows.size)
        new, epoch = rows_of(part, field_map, states, models.lengths, epoch)
        bank = bank.observed(field_map, new)
    return bank.mean[0, :4], bank.covariance[0, :4, :4], bank.log_evidence


def by_covariance(batch, field_map):
    """The same by one covariance of all readings, scipy's evidence."""
    each = np.zeros(len(batch), int) if batch.channel is None else batch.channel
    place = batch.latitude, batch.longitude
    maps = field_map.channels if batch.channel is not None else (field_map,)
    value, H = np.empty(len(batch)), np.empty((len(batch), 4))
    for k, one in enumerate(maps):
        rows = each == k
        value[rows], *slope = one.value_and_gradient(place[0][rows], place[1][rows])
        gradient = np.stack(slope, axis=-1)
        H[rows] = -np.einsum("ti,tij->tj", gradient, batch.transition[rows])
    H += batch.reading_jacobian
    S = H @ batch.prior @ H.T + covariance_of(batch)
    gain = np.linalg.solve(S, H @ batch.prior).T
    residual = batch.reading - value
    evidence = multivariate_normal(np.zeros(len(S)), S).logpdf(residual)
    return gain @ residual, batch.prior - gain @ H @ batch.prior, evidence


def as_one_covariance(batch, field_map, steps):
    """Compare both."""
    found, expected = by_bank(batch, field_map, steps), by_covariance(batch, field_map)
    scale = np.sqrt(np.diag(batch.prior))
    np.testing.assert_allclose(found[0] / scale, expected[0] / scale, atol=2e-3)
    np.testing.assert_allclose(
        found[1] / np.outer(scale, scale), expected[1] / np.outer(scale, scale), atol=2e-3
    )
    assert found[2] == pytest.approx(expected[2], abs=0.1)


def covariance_of(batch):
    return noise_covariance(batch.instrument.parameters, batch.sigma, batch.time)


def noisy(batch, seed=4):
    """The batch with noise of its covariance on top of its readings."""
    random = np.random.default_rng(seed)
    root = np.linalg.cholesky(covariance_of(batch))  # the same on every machine
    noise = root @ random.standard_normal(len(batch))
    return replace(batch, reading=batch.reading + noise)


@pytest.mark.parametrize(
    ("keys", "height"),
    [
        ({"correlated_sigma": 3e-5, "correlation_time": 45.0}, {}),
        ({"cross_coupling": 1e-3}, {}),
        ({"dynamic_pressure": 3e-8}, {}),
        ({"platform_tilt": 2e-3, "platform_time": 60.0}, {}),
        ({}, {"bias": 5.0, "scale": 0.01, "weather_sigma": 3.0, "weather_time": 100.0}),
        ({"correlated_sigma": 1e-5, "cross_coupling": 5e-4}, {"bias": 2.0}),
    ],
)
@pytest.mark.parametrize("steps", [(T,), (5, 4, 3)])
def test_as_one_covariance(keys, height, steps):
    batch, _ = make_batch(plane(2e-8, -3e-8), (100.0, 50.0, 0.1, -0.1), scans=T, seed=None)
    at = State(batch.latitude, batch.longitude, 300.0 + TIME - TIME[0], *TURNING.T)
    states = noise_states(Gravimeter(**keys), TIME, TURNING)
    if height:
        told = Height(source="barometer", **{"bias": 0.0, "scale": 0.0, **height})
        states += height_states(told, Slope(), at)
    batch = noisy(replace(batch, velocity=TURNING, instrument=InstrumentErrors(joined(states))))
    field_map = plane(2e-8, -3e-8)
    as_one_covariance(batch, field_map, steps)


def test_channels_of_a_scan_with_correlated_noise():
    maps = ChannelMap([plane(2e-8, -3e-8), plane(-1e-8, 2e-8), plane(3e-8, 0.0)])
    one, _ = make_batch(maps.channels[0], (100.0, 50.0, 0.1, -0.1), scans=T, seed=None)
    readings = np.stack([m.value(one.latitude, one.longitude) for m in maps.channels], axis=1)
    covariance = np.diag([1e-10, 4e-10, 9e-10])
    covariance[0, 1] = covariance[1, 0] = 1.2e-10
    covariance[0, 2] = covariance[2, 0] = -1e-10
    batch = channel_batch(one, readings, covariance)
    np.testing.assert_allclose(covariance_of(batch)[3:6, 3:6], covariance, atol=1e-16)
    batch = noisy(batch)
    as_one_covariance(batch, maps, (7, 5))


@pytest.mark.parametrize("velocity", [(14.0, 17.0), (-20.0, 5.0)])
def test_map_errors_of_one_potential_are_those_of_the_last_scans(velocity):
    """Of the first scans, one more than the chain has, nothing is left out."""
    names, count = ("nn", "ne", "nd", "ee"), TENSOR_ORDER + 1
    maps = ChannelMap([plane(*slope) for slope in ((2, -3), (-1, 2), (3, 0), (0, 1))])
    one, _ = make_batch(maps.channels[0], scans=count, seed=None, velocity=velocity)
    readings = np.zeros((count, 4))
    batch = channel_batch(one, readings, np.diag(np.full(4, 1e-10)))
    each = 4 * np.arange(count)
    apart = horizontal_difference(
        batch.latitude[:, None], batch.longitude[:, None], batch.latitude, batch.longitude
    )
    batch = replace(batch, layout=replace(batch.layout, of_one_potential=names))
    states = States.of(batch, maps)
    rows, _ = rows_of(batch, maps, states, np.array([400.0]), None)
    u = np.zeros((states.channels,) * 2)
    for t in each:
        u = rows.step[0, t] @ u @ rows.step[0, t].T + rows.joined[0, t]
    scale = rows.load[0, :4, :4].diagonal()
    expected = tensor_covariance(names, batch.channel, -apart, 400.0)
    size = states.channels
    last = np.arange(len(batch)).reshape(count, 4)[::-1].ravel()[:size]
    found = u * np.tile(scale, TENSOR_ORDER) * np.tile(scale, TENSOR_ORDER)[:, None]
    np.testing.assert_allclose(found, expected[np.ix_(last, last)], atol=2e-3)


def test_map_errors_under_beams_are_those_of_the_places_that_they_meet():
    """Those of the fore beam come back under the one behind it."""
    one, _ = make_batch(plane(2e-8, -3e-8), scans=5, seed=None, velocity=(10.0, 0.0))
    foot = np.array([[100.0, 0.0, 0.0], [-100.0, 0.0, 0.0], [0.0, 70.0, 0.0]])
    readings = np.tile(np.pad(foot, ((0, 0), (1, 0))), (5, 1, 1))
    batch = Soundings(3, 0.0).expand(one, readings, np.zeros(5))
    states = States.of(batch, plane(2e-8, -3e-8))
    assert states.order == 2
    rows, _ = rows_of(batch, plane(2e-8, -3e-8), states, np.array([80.0]), None)
    u = np.zeros((states.channels,) * 2)
    for t in range(0, 15, 3):
        u = rows.step[0, t] @ u @ rows.step[0, t].T + rows.joined[0, t]
    places = np.concatenate([foot[:, :2], foot[:, :2] - [100.0, 0.0]])
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    np.testing.assert_allclose(u, np.exp(-apart / 80.0), atol=2e-3)
