"""Several fields together: what their readings say of one navigator, counted once; each field
alone is matched as ever."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from helpers.bank import LETTER, close, posterior_of
from helpers.batches import field_map_of, make_batch, wavy
from isogal.errors import InputError
from isogal.matching.information import informed
from isogal.matching.interfaces import Batch, Information, SecondaryBatch
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.registry import matcher_of_fields
from isogal.matching.update_schedule import UpdateSchedule
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


def test_the_order_of_fields_does_not_matter():
    first, second = both(**NARROW)
    one, _ = joint().match(beside(first, second), FIRST, None)
    other, _ = joint(lead=1).match(beside(second, first, FIRST, 0), SECOND, None)
    close(posterior_of(other, first.prior), posterior_of(one, first.prior), 0.05)


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


def test_a_bias_of_the_first_is_known_better_by_the_place_of_the_second():
    first, second = both(prior_sigma=(200.0, 0.05))
    first = replace(first, reading=first.reading + 4e-5)
    matcher = joint(settings(bias_sigma=1e-4), settings())
    _, one = matcher.match(first, FIRST, None)
    _, two = matcher.match(beside(first, second), FIRST, None)
    banks = [memory.fields[0].bank for memory in (one, two)]
    sigma = [np.sqrt(bank.weight @ bank.covariance[:, 8, 8]) for bank in banks]
    assert sigma[1] < 0.97 * sigma[0]
    bias = banks[1].weight @ banks[1].mean[:, 8]
    assert abs(bias - 4e-5) < 3.0 * sigma[1]


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


def test_figures_name_their_fields_and_the_map_error_is_gravity_s():
    first, second = both(**NARROW)
    fix, memory = joint().match(beside(first, second), FIRST, None)
    assert {"map_sigma", "field1.map_sigma", "field1.bias"} <= set(fix.diagnostics)
    assert fix.map_error == memory.fields[0].bank.map_error
    fix, _ = joint(lead=1).match(beside(second, first, FIRST, 0), SECOND, None)
    assert fix.map_error == pytest.approx((1e-5, 4000.0))
    fix, _ = joint(lead=1).match(second, SECOND, None)
    assert fix.map_error is None


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
    schedule = UpdateSchedule.of(scenario.each_field)
    assert schedule == UpdateSchedule(1, (100.0, 40.0))
    assert schedule.marks(1, scenario.each_field[1]) == 0
    assert schedule.marks(0, scenario.each_field[0]) == 16
