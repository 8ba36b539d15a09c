"""The monitor of lost navigators: batches as another navigator would have them, when a search
begins, and that a lost navigator is found on a wrong map."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import ORIGIN
from helpers.navigators import random_covariance
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fields.scenario_map import map_for_scenario
from isogal.matching.batching import BatchBuilder
from isogal.matching.interfaces import LOST_COVARIANCE, LOST_SIGMA, Information, declined
from isogal.matching.monitoring import Insight
from isogal.matching.pmht.attitude import joint_prior
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.elsewhere import Look
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.lost_navigator import LostNavigatorMonitor
from isogal.matching.pmht.map_error import MapErrorPrior
from isogal.matching.pmht.past_batches import posterior_of, seen_from, without_fixes
from isogal.matching.registry import build_matcher
from isogal.montecarlo.engine import simulate
from isogal.scenario import Matcher, Scenario
from isogal.sensors.gravimeter import GravityReduction
from isogal.sensors.trajectory import build_trajectory

SIGMA = np.array([80.0, 60.0, 0.3, 0.2, 5e-5, 5e-5, 5e-4])
SHIFT = np.array([900.0, -700.0, 0.4, -0.3, 8e-5, -5e-5, 2e-4])


def builder(scans: int = 30) -> BatchBuilder:
    """Scans of a navigator that flies straight, the last 25 of them in the batch, ten of those
    used by an earlier one."""
    made = BatchBuilder(Matcher(batch_length=15, stride=15), GravityReduction(), context=10)
    north, east = metres_per_radian(ORIGIN[0], 0.0)
    reading = np.random.default_rng(0).normal(0.0, 1e-4, scans)
    for t in range(scans):
        place = ORIGIN[0] + 10.0 * t * 12.0 / north, ORIGIN[1] + 10.0 * t * 18.0 / east
        made.add_scan(10.0 * t, *place, np.array([12.0, 18.0]), reading[t], 1e-5)
        if made.ready and t < scans - 1:
            made.build(np.eye(7))
    return made


@pytest.mark.parametrize("seed", range(3))
def test_a_batch_seen_from_another_navigator_is_the_one_that_navigator_would_have_built(seed):
    own, other = random_covariance(SIGMA, seed), random_covariance(30.0 * SIGMA, seed + 10)
    seen = seen_from(builder().build(own), SHIFT, other)
    corrected = builder()
    corrected.correct(290.0, -SHIFT)
    expected = corrected.build(other)
    for name in ("latitude", "longitude", "prior", "new", "time"):
        np.testing.assert_allclose(getattr(seen, name), getattr(expected, name), rtol=1e-9)
    np.testing.assert_allclose(seen.reading, expected.reading, rtol=0.0, atol=1e-9)
    for name in (
        "transition",
        "reading_jacobian",
        "back_transition",
    ):  # linearised 1 km and 0.5 m/s away
        wanted = getattr(expected, name)
        np.testing.assert_allclose(
            getattr(seen, name), wanted, rtol=1e-2, atol=2e-3 * np.abs(wanted).max()
        )

    def spread(batch):  # its components may be turned
        every = np.concatenate(
            [
                batch.nuisance_position.reshape(-1, 3),
                batch.nuisance_reading * 1e5,
                batch.back_nuisance[:4],
            ]
        )
        return every @ every.T

    np.testing.assert_allclose(
        spread(seen), spread(expected), rtol=2e-2, atol=1e-3 * np.abs(spread(expected)).max()
    )
    np.testing.assert_allclose(joint_prior(seen), other, rtol=1e-6, atol=1e-9)


def test_a_batch_seen_by_the_same_navigator_is_the_same():
    batch = builder().build(random_covariance(SIGMA, 0))
    seen = seen_from(batch, np.zeros(7), joint_prior(batch))
    for name in (
        "latitude",
        "longitude",
        "reading",
        "transition",
        "reading_jacobian",
        "back_transition",
        "prior",
    ):
        np.testing.assert_allclose(getattr(seen, name), getattr(batch, name), rtol=1e-7, atol=1e-9)


class Scripted:
    """Stands for `pmht`: a navigator that is sure gets a fix that moves it by JUMP, a lost one
    nothing before `sure`, then FOUND."""

    name, context = "pmht", 15

    def __init__(self, sure, jump=None):
        self.sure, self.seen_lost, self.jump = sure, [], JUMP if jump is None else jump

    def match(self, batch, field_map, memory):
        prior, lost = joint_prior(batch), batch.prior[0, 0] > 1e6
        count = 1 if memory is None else memory[0] + 1
        after = (count, count * (100.0 if lost else -100.0))
        if lost:
            self.seen_lost.append(batch)
            if count < self.sure:
                return declined(batch, "searching"), after
        mean = FOUND if lost else -self.jump
        precision = np.linalg.inv(prior)
        information = Information(vector=4.0 * precision @ mean, matrix=3.0 * precision)
        return (
            replace(
                declined(batch, ""), reason=None, information=information, covariance=np.eye(2)
            ),
            after,
        )

    def insight(self, memory):
        """Doubts what was told of the map from the first batch on."""
        return Insight(0.0 if memory is None else memory[1], 100.0, None, None)


JUMP, FOUND = np.array([40.0, -30.0, 0, 0, 0, 0, 0]), np.array([3000.0, -2000.0, 0, 0, 0, 0, 0])


@pytest.mark.parametrize("share", [None, 0.3])
def test_a_search_sees_the_track_without_fixes_and_its_place_becomes_the_navigators(share):
    """Whether the navigator takes each fix as it is or another monitor tells it a share of it."""
    north, east = metres_per_radian(ORIGIN[0], 0.0)
    script = Scripted(sure=4)
    matcher, memory, fixes = LostNavigatorMonitor(script), None, []
    aided = BatchBuilder(Matcher(batch_length=30, stride=30), GravityReduction(), context=15)
    jumps, prior = np.zeros(7), random_covariance(SIGMA, 0)
    alone = []
    for t in range(120):
        alone.append((ORIGIN[0] + 120.0 * t / north, ORIGIN[1] + 180.0 * t / east))
        place = alone[-1][0] + jumps[0] / north, alone[-1][1] + jumps[1] / east
        aided.add_scan(10.0 * t, *place, np.array([12.0, 18.0]), 0.0, 1e-5)
        if aided.ready:
            before = jumps
            fix, memory = matcher.match(aided.build(prior), None, memory)
            fixes.append(fix)
            moved = JUMP if share is None else share * JUMP
            if share is not None:
                memory = matcher.moved(memory, -moved, prior)
            jumps = jumps + moved
            aided.correct(10.0 * t, moved)
    assert [fix.reset for fix in fixes] == [False, False, False, True]
    for k, batch in enumerate(script.seen_lost):
        track = np.array(alone[30 * (k + 1) - len(batch) : 30 * (k + 1)])
        apart = (np.stack([batch.latitude, batch.longitude], axis=1) - track) * [north, east]
        np.testing.assert_allclose(apart, 0.0, atol=2.0)
    told = fixes[-1].information
    widened = prior + np.diag(np.repeat(np.square([*LOST_SIGMA, 0.0]), [2, 2, 2, 1]))
    mean = np.linalg.solve(np.linalg.inv(widened) + told.matrix, told.vector)
    # the navigator's estimate less its mean error is the lone one's less what was found
    np.testing.assert_allclose(mean[:2], (before + FOUND)[:2], atol=5.0)


def fixes_of(script, scans, covariance=None):
    """Fixes of batches of 30 scans of a navigator with a covariance (7, 7)."""
    prior = random_covariance(SIGMA, 0) if covariance is None else covariance
    matcher, memory, fixes = LostNavigatorMonitor(script), None, []
    made = BatchBuilder(Matcher(batch_length=30, stride=30), GravityReduction(), context=15)
    for t in range(scans):
        place = ORIGIN[0] + 2e-5 * t, ORIGIN[1] + 3e-5 * t
        made.add_scan(10.0 * t, *place, np.array([12.0, 18.0]), 0.0, 1e-5)
        if made.ready:
            fix, memory = matcher.match(made.build(prior), None, memory)
            fixes.append(fix)
    return fixes


@pytest.mark.parametrize(
    ("own", "probability", "found"), [(15e3, 0.995, True), (15e3, 0.9, False), (2e3, 0.9, True)]
)
def test_a_navigator_that_knows_little_of_its_place_is_told_a_sure_one(
    monkeypatch, own, probability, found
):
    """A search near the place of a look, 3.6 km off, is not one that comes back to its own place,
    however vague that is. One that is lost has none, and is told the place if it is sure."""
    sure = Look(15.0, FOUND[:2], 500.0**2 * np.eye(2), probability)
    monkeypatch.setattr(LostNavigatorMonitor, "_look", lambda *_: sure)
    wide = random_covariance(SIGMA, 0)
    wide[:2, :2] += own**2 * np.eye(2)
    script = Placeless(sure=1)
    script.own = own
    told = [fix for fix in fixes_of(script, 210, wide) if fix.reset]
    assert len(told) == found
    assert script.seen_lost
    for batch in script.seen_lost[:1]:
        assert np.sqrt(batch.prior[0, 0]) == pytest.approx(500.0, rel=0.01)
    if found:
        covariance = np.linalg.inv(
            np.linalg.inv(wide + LOST_COVARIANCE) + told[0].information.matrix
        )
        np.testing.assert_allclose(
            (covariance @ told[0].information.vector)[:2], FOUND[:2], rtol=0.2
        )


class Untold(Scripted):
    """Nobody has told it the map's error."""

    def insight(self, memory):
        return replace(super().insight(memory), map_error_prior=PRIOR, untold=True)


class PartlyTold(Untold):
    """Of several fields: of one somebody has told it, and that is in doubt."""

    def insight(self, memory):
        return replace(super().insight(memory), told_doubt=100.0)


class Placeless(Untold):
    """Finds nothing but near a place."""

    own = 0.0
    """m, the navigator's own 1-sigma."""

    def match(self, batch, field_map, memory):
        prior = joint_prior(batch)
        after = (1, 0.0)
        if batch.prior[0, 0] > 0.5 * self.own**2:
            return declined(batch, "ambiguous"), after
        self.seen_lost.append(batch)
        information = Information(np.zeros(7), 3.0 * np.linalg.inv(prior))
        fix = replace(declined(batch, ""), reason=None, information=information)
        return replace(fix, covariance=np.eye(2)), after

    def insight(self, memory):
        here = Mixture.gaussian(np.zeros(4), 100.0 * np.eye(4))
        return replace(super().insight(memory), hypotheses=here)


class RightAtFirst(Untold):
    """A search agrees with the navigator's place for three batches."""

    def insight(self, memory):
        early = memory is None or memory[0] < 4
        here = Mixture.gaussian(-FOUND[:4] * early, 100.0 * np.eye(4))
        return replace(super().insight(memory), hypotheses=here)


def test_a_search_goes_on_where_the_navigator_was_right_long_ago(monkeypatch):
    sure = Look(15.0, FOUND[:2], 500.0**2 * np.eye(2), 0.995)
    monkeypatch.setattr(LostNavigatorMonitor, "_look", lambda *_: sure)
    fixes = fixes_of(RightAtFirst(sure=4), 120)
    assert [fix.reset for fix in fixes] == [False, False, False, True]


PRIOR = MapErrorPrior(np.array([1e-5]), np.array([4000.0]), np.zeros((1, 1)))


@pytest.mark.parametrize(
    ("script", "searched"), [(Scripted(sure=9), True), (Untold(9), False), (PartlyTold(9), True)]
)
def test_doubt_begins_a_search_only_where_the_maps_error_is_told(script, searched):
    fixes_of(script, 90)
    assert bool(script.seen_lost) == searched


@pytest.fixture(scope="module")
def field_map():
    scenario = Scenario()
    return map_for_scenario(scenario, build_trajectory(scenario))


def flown(field_map, hidden: float, **matcher):
    """Errors (m) of a run on the synthetic map with 3 mGal added to it, and each batch's fix and
    memory."""
    scenario = Scenario(
        route={"duration": 3000.0},
        map_error={"sigma": 3e-5},
        matcher={"map_sigma": 3e-5, "batch_length": 15, **matcher},
        initial_error={"hidden_position": hidden},
    )
    watched = Watched(build_matcher(scenario.matcher))
    return simulate(scenario, [0], field_map, watched).horizontal_error[0], watched.seen


class Watched:
    """A matcher whose answers are kept."""

    def __init__(self, matcher):
        self.matcher, self.seen = matcher, []
        self.name, self.context = matcher.name, matcher.context

    def match(self, batch, field_map, memory):
        self.seen.append(self.matcher.match(batch, field_map, memory))
        return self.seen[-1]


def test_a_lost_navigator_is_found_on_a_wrong_map(field_map):
    error, seen = flown(field_map, hidden=10e3)
    told = [fix for fix, _ in seen if fix.published and fix.reset]
    assert error[0] > 9e3
    assert len(told) == 1
    assert any("search_readings" in fix.diagnostics for fix, _ in seen)
    assert error[-1] < 500.0
    assert seen[-1][1].memory.memory.map_error.doubt < CONSTANTS.doubt_log_evidence


@pytest.mark.parametrize("assumed", [3e-5, 1.5e-5])
def test_a_navigator_that_is_right_stays_where_it_is(field_map, assumed):
    error, seen = flown(field_map, hidden=0.0, map_sigma=assumed)
    assert not any(fix.reset for fix, _ in seen)
    assert error[-600:].max() < 500.0
    searched = any("search_readings" in fix.diagnostics for fix, _ in seen)
    assert searched == (assumed == 1.5e-5)


@pytest.mark.parametrize(("stride", "share"), [(30, None), (5, None), (5, 0.5)])
def test_what_is_remembered_is_the_track_without_fixes(stride, share):
    """Also of batches that overlap, each of which moved the navigator, by all that its fix said or
    by a share."""
    north, east = metres_per_radian(ORIGIN[0], 0.0)
    jump = np.array([20.0, -15.0, 0.02, 0.01, 0.0, 0.0, 0.0])
    matcher, memory = LostNavigatorMonitor(Scripted(99, jump)), None
    aided = BatchBuilder(Matcher(batch_length=30, stride=stride), GravityReduction(), context=15)
    jumps, prior, alone = np.zeros(7), random_covariance(SIGMA, 0), []
    for t in range(120):
        alone.append((ORIGIN[0] + 120.0 * t / north, ORIGIN[1] + 180.0 * t / east))
        jumps[:2] += 10.0 * jumps[2:4]
        place = alone[-1][0] + jumps[0] / north, alone[-1][1] + jumps[1] / east
        flown = np.array([12.0, 18.0]) + jumps[2:4]
        aided.add_scan(10.0 * t, *place, flown, 0.0, 1e-5)
        if aided.ready:
            fix, memory = matcher.match(aided.build(prior), None, memory)
            mean = posterior_of(prior, fix.information)[0]
            if share is not None:
                mean = share * mean
                memory = matcher.moved(memory, mean, prior)
            jumps = jumps - mean
            aided.correct(10.0 * t, -mean)
    seen = without_fixes(memory.history)
    track = np.concatenate([np.stack([one.latitude, one.longitude], axis=1) for one in seen])
    apart = (track - np.array(alone)[-len(track) :]) * [north, east]
    assert len(track) == 120
    assert np.abs(jumps[:2]).max() > 80.0 * (share or 1.0)
    # the test moves the navigator in straight lines, the library as the Earth turns
    np.testing.assert_allclose(apart, 0.0, atol=0.05 * np.abs(jumps[:2]).max())
