"""Readings of a batch as rows that are linear but for the map; what a sensor adds beside white
noise, as states: the same as one covariance of all readings."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.bank import PLANE
from helpers.batches import INTERVAL, field_map_of, make_batch, noise_covariance, wavy
from isogal.maps.channels import ChannelMap
from isogal.matching.expansion import channel_batch
from isogal.matching.parameters import InstrumentErrors
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.matching.pmht.models import Assumed, models_of
from isogal.matching.pmht.rows import Epoch, rows_of
from isogal.matching.pmht.states import (
    States,
)
from isogal.matching.reading_noise import height_states, joined, noise_states
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
