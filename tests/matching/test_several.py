"""Matchers of several fields as one: what they say together is what their readings say, counted
once; each field alone is matched as ever."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch, wavy
from isogal.matching.information import informed
from isogal.matching.interfaces import Batch, Beside, Fix, Information, declined
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.several import JointMatcher, JointMemory, Rhythm
from isogal.scenario import Matcher, validate_scenario

FIRST = field_map_of(wavy)
SECOND = field_map_of(lambda north, east: 3.0 * wavy(-east + 7e3, north))
ERROR = (60.0, -40.0, 0.01, -0.02)


def pmht(**settings: Any) -> Pmht:
    return Pmht.from_settings(Matcher(**{"name": "pmht", "map_sigma": 1e-5} | settings))


def joint(*matchers: Any) -> JointMatcher:
    matchers = matchers or (pmht(), pmht())
    return JointMatcher(matchers, tuple(f"field{k}" for k in range(len(matchers))), 0)


def both(error=ERROR, sigma=(1e-5, 1e-5), **keys: Any) -> tuple[Batch, Batch]:
    """The batches of two fields on one track."""
    one, _ = make_batch(FIRST, error, sigma=sigma[0], seed=1, **keys)
    two, _ = make_batch(SECOND, error, sigma=sigma[1], seed=2, **keys)
    return one, two


def beside(first: Batch, second: Batch) -> Batch:
    return replace(first, beside=(Beside(1, second, SECOND),))


def test_one_field_alone_is_matched_as_ever():
    batch, _ = both()
    fix, memory = joint().match(batch, FIRST, None)
    alone, own = pmht().match(batch, FIRST, None)
    assert (fix.latitude, fix.longitude) == (alone.latitude, alone.longitude)
    np.testing.assert_array_equal(fix.information.matrix, alone.information.matrix)
    assert memory.memories[0].log_evidence == own.log_evidence


def test_two_fixes_are_one_with_the_information_of_both():
    """With a prior so narrow that all is linear, information adds up."""
    narrow = {"prior_sigma": (30.0, 0.02), "error": (10.0, -5.0, 0.005, 0.004)}
    first, second = both(**narrow)
    fix, _ = joint().match(beside(first, second), FIRST, None)
    each = [pmht().match(first, FIRST, None)[0], pmht().match(second, SECOND, None)[0]]
    told = [one.information for one in each]
    summed = Information(sum(one.vector for one in told), sum(one.matrix for one in told))
    mean, covariance = informed(first.prior, summed)
    found, spread = informed(first.prior, fix.information)
    sigma = np.sqrt(np.diag(covariance))
    assert (np.abs(found - mean) < 0.1 * sigma).all()
    np.testing.assert_allclose(np.sqrt(np.diag(spread)), sigma, rtol=0.03)


def test_a_field_without_readings_says_nothing():
    first, second = both(prior_sigma=(30.0, 0.02))
    silent = replace(second, reading=np.full(len(second), np.nan))
    fix, _ = joint().match(beside(first, silent), FIRST, None)
    alone, _ = pmht().match(first, FIRST, None)
    np.testing.assert_array_equal(fix.information.matrix, alone.information.matrix)
    assert (fix.latitude, fix.longitude) == (alone.latitude, alone.longitude)


def test_what_one_field_leaves_open_the_other_decides():
    """A field that repeats itself every 1.5 km leaves two places; another knows which."""

    def repeating(north, east):
        return 2e-4 * np.sin(2 * np.pi * np.asarray(north) / 1500.0) + 2e-4 * np.sin(
            2 * np.pi * np.asarray(east) / 1500.0
        )

    twice, error = field_map_of(repeating), (1200.0, 400.0, 0.0, 0.0)
    keys = {"prior_sigma": (900.0, 0.01), "scans": 30}
    first, _ = make_batch(twice, error, seed=1, **keys)
    second, truth = make_batch(SECOND, error, seed=2, sigma=3e-5, **keys)
    alone, open_ = pmht().match(first, twice, None)
    assert not alone.published
    assert len(open_.hypotheses) > 1
    fix, memory = joint().match(beside(first, second), twice, None)
    assert fix.published
    assert np.hypot(*truth.error_of(fix)) < 100.0
    assert memory.memories[1].hypotheses is memory.hypotheses


def test_bias_of_the_first_follows_the_fix_of_the_second():
    """What is left unknown of a bias goes together with the position: it moves as that does."""
    first, second = both(prior_sigma=(200.0, 0.05))
    matcher = joint(pmht(bias_sigma=2e-5), pmht())
    _, alone = matcher.match(replace(first, beside=()), FIRST, None)
    _, memory = matcher.match(beside(first, second), FIRST, None)
    before, after = alone.memories[0].bias, memory.memories[0].bias
    moved = after.mean - before.mean
    assert np.abs(moved).max() > 0.0
    np.testing.assert_array_equal(before.gain, after.gain)
    left = [one.covariance + one.gain @ one.error @ one.gain.T for one in (before, after)]
    assert left[1][0, 0] < left[0][0, 0]


def two_batches(matcher: JointMatcher, first: int) -> tuple[np.ndarray, np.ndarray, Any]:
    """Error left (4,), its covariance (4, 4) and the memory of the matcher that knows of a bias,
    after two batches one after the other of a biased field and of another, in either order."""
    north = field_map_of(lambda north, east: 1e-8 * np.asarray(north) + 0.0 * np.asarray(east))
    east = field_map_of(lambda north, east: 1e-8 * np.asarray(east) + 2e-9 * np.asarray(north))
    error, covariance = np.array([40.0, -30.0, 0.1, -0.05]), np.diag([1e4, 1e4, 0.04, 0.04])
    straight, memory = np.eye(4), None
    straight[:2, 2:] = 150.0 * np.eye(2)
    for k in range(2):
        start = (150.0 * k * 14.0, 150.0 * k * 17.0)
        keys = {"error": error, "scans": 15, "sigma": 1e-7, "start": start, "prior": covariance}
        keys["time"] = 1000.0 + 150.0 * k + 10.0 * np.arange(15)
        if k:
            keys |= {"back_transition": np.linalg.inv(straight), "back_nuisance": np.zeros((4, 0))}
        parts = [make_batch(ground, seed=k, **keys)[0] for ground in (north, east)]
        parts[0] = replace(parts[0], reading=parts[0].reading + 5e-7)
        grounds = (north, east) if first == 0 else (east, north)
        parts = parts if first == 0 else parts[::-1]
        batch = replace(parts[0], beside=(Beside(1, parts[1], grounds[1]),))
        fix, memory = matcher.match(batch, grounds[0], memory)
        mean, covariance = informed(covariance, fix.information)
        error = error - mean
        if k == 0:
            error, covariance = straight @ error, straight @ covariance @ straight.T
    return error, covariance, memory.memories[first]


def test_the_order_of_fields_does_not_matter_to_a_bias():
    """What is known of a bias goes together with the position where the last batch ended, of which
    the fix of another field tells something, too: exactly as if that field came last."""
    biased, plain = pmht(map_sigma=0.0, bias_sigma=1e-6), pmht(map_sigma=0.0)
    one = two_batches(joint(biased, plain), 0)
    other = two_batches(joint(plain, biased), 1)
    sigma = np.sqrt(np.diag(one[1]))
    assert (np.abs(one[0] - other[0]) < 0.02 * sigma).all()
    np.testing.assert_allclose(np.sqrt(np.diag(other[1])), sigma, rtol=0.01)
    figures = [memory.bias.figures() for *_, memory in (one, other)]
    assert abs(figures[0]["bias"] - figures[1]["bias"]) < 0.02 * figures[0]["bias_sigma"]
    assert figures[1]["bias_sigma"] == pytest.approx(figures[0]["bias_sigma"], rel=0.01)


@pytest.mark.parametrize("lead", [0, 1])
@pytest.mark.parametrize("told", [(1e-5, 1e-5), ("auto", 1e-5), (0.0, 1e-5)])
def test_doubt_of_any_field_counts(lead, told):
    """Readings of the second, and of no other, say that its map is far worse than told."""
    first, second = both(prior_sigma=(30.0, 0.02), error=(0.0, 0.0, 0.0, 0.0))
    noise = 1e-4 * np.random.default_rng(5).standard_normal(len(second))
    sigma = np.full(len(second), 3e-5)
    second = replace(second, reading=second.reading + noise, sigma=sigma)
    matchers, parts = [pmht(map_sigma=one) for one in told], [first, second]
    maps = [FIRST, SECOND]
    if lead == 1:
        matchers, parts, maps = matchers[::-1], parts[::-1], maps[::-1]
    batch = replace(parts[0], beside=(Beside(1, parts[1], maps[1]),))
    matcher = joint(*matchers)
    _, memory = matcher.match(batch, maps[0], None)
    insight = matcher.insight(memory)
    doubted = memory.memories[1 - lead]
    assert doubted.map_error.doubt > 1.0
    assert insight.told_doubt == doubted.map_error.doubt
    assert insight.map_error_doubt >= insight.told_doubt
    assert insight.untold == ("auto" in told)
    evidence = [one.log_evidence for one in memory.memories]
    assert insight.log_evidence == pytest.approx(sum(evidence))


@dataclass(frozen=True)
class Says:
    """A matcher that says what it is told to."""

    answer: Any
    name: str = "says"
    context: int = 0
    takes_channels: bool = False

    def match(self, batch: Batch, field_map: Any, memory: Any) -> tuple[Fix, Any]:
        return self.answer(batch), (memory or 0) + 1


def place(batch: Batch, error=(50.0, 0.0), sigma: float = 30.0) -> Fix:
    """A fix that says where the navigator is wrong, with a position and nothing else."""
    from isogal.earth.ellipsoid import metres_per_radian

    north, east = metres_per_radian(batch.end[0])
    return Fix(
        time=float(batch.time[-1]),
        latitude=batch.end[0] - error[0] / north,
        longitude=batch.end[1] - error[1] / east,
        covariance=sigma**2 * np.eye(2),
    )


def test_positions_of_any_matcher_are_joined():
    first, second = both()
    matcher = joint(Says(place), Says(lambda batch: place(batch, sigma=40.0)))
    fix, memory = matcher.match(beside(first, second), FIRST, None)
    mean, covariance = informed(first.prior, fix.information)
    weight = 1 / 30.0**2 + 1 / 40.0**2
    variance = 1.0 / (weight + 1.0 / first.prior[0, 0])
    # the second one's batch is that of a navigator that has taken the first fix: it says that it
    # is 50 m wrong once more
    taken = 50.0 / 30.0**2 / (1 / 30.0**2 + 1.0 / first.prior[0, 0])
    expected = variance * (50.0 / 30.0**2 + (50.0 + taken) / 40.0**2)
    assert covariance[0, 0] == pytest.approx(variance, rel=1e-3)
    assert mean[0] == pytest.approx(expected, rel=1e-3)
    assert memory.memories == (1, 1)


def test_one_that_disagrees_with_a_fix_does_not_lose_the_navigator():
    first, second = both()
    lost = Says(lambda batch: replace(declined(batch, "lost"), reset=True))
    fix, memory = joint(Says(place), lost).match(beside(first, second), FIRST, None)
    assert fix.published
    assert not fix.reset
    assert memory.memories == (1, None)  # as if it had not been asked
    fix, _ = joint(lost, Says(place)).match(beside(first, second), FIRST, None)
    assert fix.published
    assert fix.reset


def test_reasons_and_figures_name_their_fields():
    first, second = both()
    silent = Says(lambda batch: declined(batch, "says nothing", misfit=2.0))
    fix, _ = joint(silent, silent).match(beside(first, second), FIRST, JointMemory((None, None)))
    assert fix.reason == "field0: says nothing; field1: says nothing"
    assert fix.diagnostics == {"misfit": 2.0, "field1.misfit": 2.0}


def test_batches_end_with_those_of_the_field_with_the_shortest_rhythm():
    scenario = validate_scenario(
        {
            "fields": [
                {"field": "gravity", "interval": 20.0},
                {"field": "magnetic", "sigma": 2.0, "interval": 4.0, "matcher": {"stride": 10}},
            ]
        }
    )
    rhythm = Rhythm.of(scenario.each_field)
    assert rhythm == Rhythm(1, (100.0, 40.0))
    assert rhythm.marks(1, scenario.each_field[1]) == 0
    assert rhythm.marks(0, scenario.each_field[0]) == 16


def test_the_map_error_is_that_of_the_field_that_knows_one():
    first, second = both()
    silent = Says(lambda batch: declined(batch, "says nothing"))
    knows = Says(lambda batch: replace(declined(batch, "nothing new"), map_error=(8e-5, 3e3)))
    for matchers in ((silent, knows), (knows, silent), (Says(place), knows)):
        fix, _ = joint(*matchers).match(beside(first, second), FIRST, None)
        assert fix.map_error == (8e-5, 3e3)
    fix, _ = joint(silent, Says(place)).match(beside(first, second), FIRST, None)
    assert fix.map_error is None
