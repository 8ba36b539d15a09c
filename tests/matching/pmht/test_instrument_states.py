"""What a sensor adds beside white noise, as states: the same as one covariance of all readings."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.batches import INTERVAL, field_map_of, make_batch, noise_covariance
from isogal.earth.frames import horizontal_difference
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import ChannelMap
from isogal.maps.error_model import tensor_covariance
from isogal.matching.expansion import Soundings, channel_batch
from isogal.matching.parameters import InstrumentErrors
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.matching.pmht.models import Assumed, models_of
from isogal.matching.pmht.rows import rows_of
from isogal.matching.pmht.states import TENSOR_ORDER, States
from isogal.matching.reading_noise import height_states, joined, noise_states
from isogal.scenario import Gravimeter, Height
from isogal.sensors.reduction import AsRead, State

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


def noisy(batch, seed=3):
    """The batch with noise of its covariance on top of its readings."""
    random = np.random.default_rng(seed)
    noise = random.multivariate_normal(np.zeros(len(batch)), covariance_of(batch))
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


def test_readings_that_do_not_depend_on_the_height_have_no_states_of_it():
    at = State(*np.zeros((2, T)), 300.0, *TURNING.T)
    height = Height(source="barometer")
    assert [name for name, *_ in height_states(height, Slope(), at)] == [
        "height_bias",
        "height_scale",
        "height_weather",
    ]
    assert height_states(height, AsRead(), at) == []


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


def test_beams_share_what_is_not_white():
    one, _ = make_batch(plane(2e-8, -3e-8), scans=T)
    noise = joined(noise_states(Gravimeter(correlated_sigma=1e-5), TIME, TURNING))
    several = replace(one, instrument=InstrumentErrors(noise))
    batch = Soundings(3, 0.0).expand(several, np.zeros((T, 3, 4)), np.zeros(T))
    states = States.of(batch, plane(2e-8, -3e-8))
    rows, _ = rows_of(batch, plane(2e-8, -3e-8), states, np.array([4000.0]), None)
    np.testing.assert_allclose(rows.noise, np.repeat(one.sigma**2, 3))
    np.testing.assert_array_equal(rows.reading[:, BATCH_STATES + 3], 1.0)
    np.testing.assert_array_equal(rows.joined[0, 1:3], 0.0)
