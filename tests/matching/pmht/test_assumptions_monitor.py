"""A navigator that has been told something wrong, and one that has not."""

import numpy as np
import pytest

from helpers.batches import make_batch
from helpers.navigators import random_covariance
from isogal.fields.scenario_map import map_for_scenario
from isogal.matching.batching import BatchBuilder
from isogal.matching.interfaces import declined
from isogal.matching.pmht.assumptions_monitor import AssumptionsMonitor, Trial, with_aids
from isogal.matching.pmht.past_batches import taken_before
from isogal.matching.registry import build_matcher
from isogal.montecarlo.engine import simulate
from isogal.scenario import Matcher, Scenario
from isogal.sensors.gravimeter import GravityReduction
from isogal.sensors.trajectory import build_trajectory

TOLD = {"map_sigma": 1e-6}
"""Nearly exact; who says that it is exact is believed."""


@pytest.fixture(scope="module")
def field_map():
    scenario = Scenario()
    return map_for_scenario(scenario, build_trajectory(scenario))


class Kept:
    """A matcher whose answers are kept."""

    def __init__(self, matcher):
        self.matcher, self.fixes, self.memories = matcher, [], []
        self.name, self.context = matcher.name, matcher.context

    def match(self, batch, field_map, memory):
        fix, memory = self.matcher.match(batch, field_map, memory)
        self.fixes.append(fix)
        self.memories.append(memory)
        return fix, memory


def flown(field_map, watched=True, runs=(0,), **keys):
    """Record of runs on the synthetic map, taken to be nearly exact where nothing else is told,
    and their fixes."""
    keys = {"matcher": TOLD, **keys}
    scenario = Scenario(route={"duration": 2500.0}, gravity={"field": "normal"}, **keys)
    matcher = build_matcher(scenario.matcher)
    assert isinstance(matcher, AssumptionsMonitor)
    kept = Kept(matcher if watched else matcher.matcher)
    return simulate(scenario, runs, field_map, kept), kept.fixes


def nees(record, after):
    """NEES per axis of the horizontal error, (R,), means over the time after so many s."""
    late = record.elapsed > after
    error, covariance = record.error[:, late, :2], record.covariance[:, late, :2, :2]
    solved = np.linalg.solve(covariance, error[..., None])[..., 0]
    return 0.5 * np.einsum("rti,rti->rt", error, solved).mean(axis=1)


def test_readings_that_are_late_are_put_where_they_belong(field_map):
    """20 s at 22 m/s are 430 m."""
    record, fixes = flown(field_map, truth={"gravimeter": {"delay": 20.0}})
    assert fixes[-1].diagnostics["as_assumed"] < 1e-3
    assert fixes[-1].diagnostics["delay"] == pytest.approx(20.0, abs=6.0)
    assert record.horizontal_error[0, record.elapsed > 2000.0].max() < 150.0
    assert nees(record, 2000.0)[0] < 4.0


def test_a_delay_that_is_told_to_be_unknown_is_estimated_and_no_other_place_believed(field_map):
    """It was forgotten wherever the readings had shown to have no bias, then learnt anew from
    readings that had been used."""
    record, fixes = flown(
        field_map,
        runs=range(4),
        truth={"gravimeter": {"delay": 6.0}},
        gravimeter={"delay_sigma": 6.0},
        matcher={},
    )
    last = fixes[-4:]
    assert {fix.time for fix in last} == {fixes[-1].time}
    for fix in last:
        said, sigma = (fix.diagnostics[key] for key in ("reading_delay", "reading_delay_sigma"))
        assert 0.5 < sigma < 4.0
        assert abs(said - 6.0) < 3.0 * sigma
        assert fix.diagnostics["as_assumed"] > 0.3
    assert not any(fix.reset for fix in fixes)
    assert nees(record, 600.0).mean() < 2.0


def test_a_navigator_that_is_worse_than_told_becomes_less_certain(field_map):
    worse, runs = {"truth": {"initial_error": "4x"}}, range(4, 8)
    record, fixes = flown(field_map, runs=runs, **worse)
    alone, _ = flown(field_map, watched=False, runs=runs, **worse)
    assert nees(record, 500.0).mean() < 0.6 * nees(alone, 500.0).mean()
    assert record.horizontal_error[:, -30:].mean() < alone.horizontal_error[:, -30:].mean()
    assert fixes[-1].diagnostics["as_assumed"] < 1e-3
    assert 2.0 < fixes[-1].diagnostics["navigator_sigma_factor"] < 8.0
    widened = [fix for fix in fixes if fix.widened is not None]
    assert widened
    for fix in widened:
        scale = np.sqrt(np.maximum(np.diag(fix.widened), 1e-30))
        assert np.linalg.eigvalsh(fix.widened / scale / scale[:, None])[0] > -1e-9


def test_in_doubt_the_track_without_fixes_is_still_known(field_map):
    """The navigator takes what the hypotheses say, not the fixes; a search for a lost one needs
    the track that it would have had without either."""
    scenario = Scenario(
        route={"duration": 2500.0},
        gravity={"field": "normal"},
        matcher=TOLD,
        truth={"initial_error": "4x"},
    )
    kept = Kept(build_matcher(scenario.matcher))
    record = simulate(scenario, [5], field_map, kept)
    last = kept.memories[-1]
    assert last.in_doubt
    history = last.memory.history
    taken = (taken_before(history)[-1] - history[-1].posterior[0])[:2]
    end = record.time.searchsorted(record.fix_time[-1])
    true = record.error[0, end] - record.unaided_error[0, end]
    assert np.hypot(*true) > 100.0
    np.testing.assert_allclose(taken, true, atol=0.1 * np.hypot(*true))


@pytest.mark.parametrize(("position", "aided"), [(100.0, True), (15e3, False)])
def test_of_a_lost_navigator_nobody_says_that_it_is_aided(position, aided):
    """Its dynamics are not linear; a velocity that is known better than they say is no aid."""
    sigma = np.array([position, position, 0.5, 0.5, 1e-4, 1e-4, 3e-4])
    made = BatchBuilder(Matcher(batch_length=6, stride=6), GravityReduction())
    monitor, memory = AssumptionsMonitor(Silent()), None
    for t in range(12):
        made.add_scan(10.0 * t, 0.5, 1.0 + 1e-5 * t, np.array([0.0, 50.0]), 0.0, 1e-5)
        if made.ready:
            prior = np.diag(sigma**2)
            prior[2:4] *= 0.5 if memory is not None else 1.0
            prior[:, 2:4] *= 0.5 if memory is not None else 1.0
            _, memory = monitor.match(made.build(prior), None, memory)
    assert memory.aided == aided


class Silent:
    """A matcher that finds nothing."""

    name, context, takes_channels = "silent", 0, False

    def match(self, batch, field_map, memory):
        return declined(batch, "nothing"), None


def test_doubt_does_not_feed_on_itself_while_there_are_no_fixes(field_map):
    """A navigator that was made uncertain grows more so by itself; that is no sign of sensors
    that are even worse than thought."""
    keys = {"truth": {"initial_error": "4x"}, "gravimeter": {"gaps": [[1000.0, 1500.0]]}}
    record, fixes = flown(field_map, runs=(5,), **keys)
    assert any(fix.widened is not None for fix in fixes)
    alone, _ = flown(field_map, watched=False, runs=(5,), **keys)
    sigma, told = (np.sqrt(np.trace(one.covariance[0, -1, :2, :2])) for one in (record, alone))
    assert told < sigma < 20.0 * told


def test_a_speed_log_in_an_untold_current_is_no_longer_used(field_map):
    """0.5 m/s for 2500 s are 1.2 km."""
    log = {"kind": "log", "scale": 0.0, "current_sigma": 0.0}
    keys = {"velocity": log, "truth": {"velocity": {"current_sigma": 0.5}}, "runs": (2,)}
    record, fixes = flown(field_map, **keys)
    alone, _ = flown(field_map, watched=False, **keys)
    widened = [fix for fix in fixes if fix.widened is not None]
    assert len(widened) == 1
    assert not widened[0].published
    assert "velocity aid" in widened[0].reason
    late = record.elapsed > 1500.0
    assert alone.horizontal_error[0, late].max() > 500.0
    assert record.horizontal_error[0, late].max() < 350.0
    assert nees(record, 1500.0)[0] < 4.0


def test_nothing_changes_while_all_is_as_told(field_map):
    record, fixes = flown(field_map)
    alone, others = flown(field_map, watched=False)
    np.testing.assert_array_equal(record.error, alone.error)
    assert all(fix.widened is None for fix in fixes)
    assert all(fix.diagnostics["as_assumed"] > 0.3 for fix in fixes if fix.published)
    assert len(fixes) == len(others)


def test_a_batch_without_attitude_is_passed_on(rough_map):
    matcher = build_matcher(Matcher())
    batch, _ = make_batch(rough_map, (30.0, -20.0, 0.0, 0.0))
    assert batch.attitude is None
    fix, memory = matcher.match(batch, rough_map, None)
    assert fix.published
    assert "as_assumed" not in fix.diagnostics
    assert isinstance(memory, Trial)
    assert memory.hypotheses is None


def test_a_map_that_is_told_to_be_exact_is_believed():
    assert not isinstance(build_matcher(Matcher(map_sigma=0.0)), AssumptionsMonitor)


@pytest.mark.parametrize("seed", range(4))
def test_growth_and_aids_are_those_of_numpy(seed):
    sigma = np.array([50.0, 50.0, 0.05, 0.05, 2e-5, 2e-5, 3e-4])
    random = np.random.default_rng(seed)
    posterior, prior = random_covariance(sigma, seed), random_covariance(1.2 * sigma, 9 + seed)
    forward = np.eye(7) + 0.1 * random.standard_normal((7, 7)) * sigma[:, None] / sigma

    def positive(matrix):
        values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
        return np.outer(scale, scale) * ((vectors * np.maximum(values, 0.0)) @ vectors.T)

    scale = np.sqrt(np.diag(prior))
    unaided = forward @ posterior @ forward.T
    unaided = unaided + positive(prior - unaided)
    kept = prior @ np.linalg.inv(unaided)
    expected = kept @ forward
    growth = positive(prior - expected @ posterior @ expected.T)
    found, grown, trace = with_aids(forward, posterior, prior)
    unit, ratio = np.outer(scale, scale), scale / scale[:, None]
    np.testing.assert_allclose(found * ratio, expected * ratio, atol=1e-9)
    np.testing.assert_allclose(grown / unit, growth / unit, atol=1e-9)
    assert trace == pytest.approx(np.trace(kept), rel=1e-9)
    assert trace < 6.9
