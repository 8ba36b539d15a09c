"""Several fields together, and several channels of one: what they say of one navigator, counted
once."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from helpers.bank import LETTER, close, posterior_of
from helpers.batches import field_map_of, make_batch, wavy
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.maps.channels import ChannelMap
from isogal.maps.potential import derivatives
from isogal.matching.expansion import channel_batch
from isogal.matching.information import informed
from isogal.matching.interfaces import Batch, Information, SecondaryBatch
from isogal.matching.map_matching import MapMatching
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.registry import matcher_of_fields
from isogal.scenario import Matcher, validate_scenario

FIRST = field_map_of(wavy)
SECOND = replace(field_map_of(lambda north, east: 3.0 * wavy(-east + 7e3, north)),
                 unit="nT", quantity="magnetic_anomaly")  # fmt: skip
ERROR = (60.0, -40.0, 0.01, -0.02)
NARROW = {"prior_sigma": (30.0, 0.02), "error": (10.0, -5.0, 0.005, 0.004)}


def settings(**keys: Any) -> Matcher:
    return Matcher(**({"map_sigma": 1e-5} | LETTER | keys))


def alone(**keys: Any) -> Pmht:
    return Pmht.from_settings(settings(**keys))


def joint(*each: Matcher, lead: int = 0) -> Pmht:
    each = each or (settings(), settings())
    return Pmht.of_fields(each, tuple(f"field{k}" for k in range(len(each))), lead)


def both(error=ERROR, sigma=(1e-5, 1e-5), **keys: Any) -> tuple[Batch, Batch]:
    """The batches of two fields on one track."""
    one, _ = make_batch(FIRST, error, sigma=sigma[0], seed=1, **keys)
    two, _ = make_batch(SECOND, error, sigma=sigma[1], seed=2, **keys)
    return one, two


def beside(first: Batch, second: Batch, field_map=SECOND, index: int = 1) -> Batch:
    return replace(first, secondary=(SecondaryBatch(index, second, field_map),))


def test_two_fixes_are_one_with_the_information_of_both():
    """With a prior so narrow that all is linear, information adds up."""
    first, second = both(**NARROW)
    fix, _ = joint().match(beside(first, second), FIRST, None)
    each = [alone().match(first, FIRST, None)[0], alone().match(second, SECOND, None)[0]]
    told = [one.information for one in each]
    summed = Information(sum(one.vector for one in told), sum(one.matrix for one in told))
    close(posterior_of(fix, first.prior), informed(first.prior, summed), 0.1)


def test_a_field_without_readings_says_nothing():
    first, second = both(prior_sigma=(30.0, 0.02))
    silent = replace(second, reading=np.full(len(second), np.nan))
    expected, _ = alone().match(first, FIRST, None)
    fix, _ = joint().match(beside(first, silent), FIRST, None)
    np.testing.assert_allclose(fix.information.matrix, expected.information.matrix, rtol=1e-9)
    silent = replace(first, reading=np.full(len(first), np.nan))
    expected, _ = alone().match(second, SECOND, None)
    fix, _ = joint().match(beside(silent, second), FIRST, None)
    assert fix.published, fix.reason
    np.testing.assert_allclose(fix.information.matrix, expected.information.matrix, rtol=1e-9)


def test_what_one_field_leaves_open_the_other_decides():
    """A field that repeats itself every 1.5 km leaves two places; another knows which."""

    def repeating(north, east):
        return 2e-4 * np.sin(2 * np.pi * np.asarray(north) / 1500.0) + 2e-4 * np.sin(
            2 * np.pi * np.asarray(east) / 1500.0
        )

    twice, error = field_map_of(repeating), (1000.0, 400.0, 0.0, 0.0)
    keys = {"prior_sigma": (480.0, 0.01), "scans": 30}
    first, _ = make_batch(twice, error, seed=1, **keys)
    second, truth = make_batch(SECOND, error, seed=2, sigma=3e-5, **keys)
    open_, _ = alone().match(first, twice, None)
    fix, memory = joint().match(beside(first, second), twice, None)
    spread = [np.sqrt(np.trace(posterior_of(one, first.prior)[1][:2, :2])) for one in (open_, fix)]
    assert spread[0] > 300.0
    assert spread[1] < 0.3 * spread[0]
    assert np.hypot(*truth.error_of(fix)) < 100.0
    # what the second has told is known to the hypotheses of the first
    sigmas = [np.sqrt(np.trace(memory.fields[k].bank.moments()[1][:2, :2])) for k in (0, 1)]
    assert sigmas[0] < 20.0


def test_each_field_learns_its_own_map_s_error():
    """The second map is far worse than the first; nothing is told."""
    memory, matcher = None, joint(settings(map_sigma="auto"), settings(map_sigma="auto"))
    for number in range(3):
        keys = {"start": (-6e3 + 4e3 * number, -3e3), "time": 1000.0 + 300.0 * number
                + 10.0 * np.arange(30)} | NARROW  # fmt: skip
        first, second = both(**keys)
        noise = 2e-4 * np.cumsum(np.random.default_rng(number).standard_normal(30)) / 3.0
        second = replace(second, reading=second.reading + noise)
        fix, memory = matcher.match(beside(first, second), FIRST, memory)
    assert fix.diagnostics["map_sigma"] < 2e-5
    assert fix.diagnostics["field1.map_sigma"] > 5e-5


def test_only_a_matcher_of_several_fields_is_built():
    both_ = [Matcher(), Matcher()]
    assert matcher_of_fields(both_, ("a", "b"), 1).lead == 1
    with pytest.raises(InputError, match=r"fields: matcher sitan does not have it; give pmht$"):
        matcher_of_fields([Matcher(), Matcher(name="sitan")], ("a", "b"), 0)


def test_batches_end_with_those_of_the_field_with_the_shortest_rhythm():
    scenario = validate_scenario(
        {
            "fields": [
                {"field": "gravity", "interval": 20.0},
                {"field": "magnetic", "sigma": 2.0, "interval": 4.0, "matcher": {"stride": 10}},
            ]
        }
    )
    matching = MapMatching(scenario, [FIRST, SECOND])
    assert matching.lead == 1
    # a batch of 30 scans every 20 s has 15 ends, 40 s apart, and perhaps one more
    longest = [builder._longest - matching.matcher.context for builder in matching.builders]
    assert longest == [30 + 16, 30]


EOTVOS = 1e-9
DISTURBANCE = field_map_of(wavy, half=50e3)
TENSOR = derivatives(DISTURBANCE, edge=15e3)
C = len(TENSOR)
COVARIANCE = EOTVOS**2 * (9.0 * np.eye(C) + 4.0 * np.ones((C, C)))
"""3 E on each channel and 2 E that all have together."""


def values_at(field_map, latitude, longitude):
    return np.stack([one.value(latitude, longitude) for one in field_map.channels], axis=-1)


def tensor_batch(
    error=(0.0, 0.0, 0.0, 0.0), seed=0, covariance=COVARIANCE, field_map=TENSOR, **keys
):
    """A batch of tensors along the track of `make_batch`; also the truth at its end."""
    scalar, truth = make_batch(DISTURBANCE, error, **keys)
    moved = scalar.transition @ np.array(error)
    north, east = metres_per_radian(scalar.latitude)
    tensors = values_at(
        field_map, scalar.latitude - moved[:, 0] / north, scalar.longitude - moved[:, 1] / east
    )
    noise = np.random.default_rng(seed).multivariate_normal(
        np.zeros(tensors.shape[1]), covariance, len(scalar), method="cholesky"
    )
    return channel_batch(scalar, tensors + noise, covariance), scalar, truth


def test_a_channel_without_a_reading_is_left_out():
    """A channel that reads nothing tells what is told without it."""
    batch, scalar, _ = tensor_batch()
    reading = batch.reading.reshape(-1, C).copy()
    reading[:, 4] = np.nan
    alone = 9.0 * EOTVOS**2 * np.eye(C)
    four = ChannelMap(TENSOR.channels[:4])
    matcher = Pmht.from_settings(Matcher(map_sigma=0.0))
    holed, _ = matcher.match(channel_batch(scalar, reading, alone), TENSOR, None)
    kept = channel_batch(scalar, reading[:, :4], alone[:4, :4])
    expected, _ = matcher.match(kept, four, None)
    np.testing.assert_allclose(holed.covariance, expected.covariance, rtol=1e-6)
    reading[3, 2] = np.nan
    fix, _ = matcher.match(channel_batch(scalar, reading, alone), TENSOR, None)
    assert np.trace(fix.covariance) > np.trace(holed.covariance)


def test_what_does_not_fit_is_refused_or_declined():
    scalar, _ = make_batch(DISTURBANCE)
    readings = np.zeros((30, 2))
    for bad, covariance, message in (
        (np.zeros((29, 2)), np.eye(2), r"must have shape \(30, channels\), have \(29, 2\)"),
        (np.zeros(30), np.eye(1), r"must have shape \(30, channels\), have \(30,\)"),
        (readings, np.eye(3), r"have shape \(2, 2\); has \(3, 3\)"),
        (readings, -np.eye(2), "must be positive definite"),
        (readings, np.full((2, 2), np.nan), "must be positive definite"),
    ):
        with pytest.raises(InputError, match=message):
            channel_batch(scalar, bad, covariance)
    batch = channel_batch(scalar, readings, EOTVOS**2 * np.eye(2))
    fix, _ = Pmht.from_settings(Matcher()).match(batch, ChannelMap(TENSOR.channels[:1]), None)
    assert fix.reason == "the readings have 2 channels, the map 1"


def test_channels_must_lie_on_one_grid():
    for other in (field_map_of(wavy, step=1000.0), replace(DISTURBANCE, unit="nT")):
        with pytest.raises(InputError, match="channel 1 of a vector map"):
            ChannelMap([DISTURBANCE, other])


def test_noise_worse_than_told_does_not_send_the_navigator_away():
    """Many noisy readings fit somewhere else by chance: five times the noise told, which is half
    of what the map changes."""
    matcher = Pmht.from_settings(Matcher())
    told = (35.0 * EOTVOS) ** 2 * np.eye(C)
    for seed in range(2):
        good, noisy = (
            tensor_batch(seed=seed, covariance=factor * told, prior_sigma=(50.0, 0.02))[0]
            for factor in (1.0, 25.0)
        )
        fix, _ = matcher.match(replace(good, reading=noisy.reading), TENSOR, None)
        assert not fix.reset, fix.reason
