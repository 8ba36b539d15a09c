"""The closed loop: runs are independent, fixes help, and matchers are called as their interface
says."""

from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.navigators import ROUTE
from helpers.studies import same_runs
from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.evaluation.consistency import nees_per_axis
from isogal.evaluation.summary import summarise
from isogal.matching.interfaces import LOST_SIGMA, Batch, Fix, declined
from isogal.montecarlo.engine import simulate
from isogal.montecarlo.recorder import Recorder
from isogal.scenario import Gravimeter, Gravity, InitialError, MapError, Matcher, Scenario
from isogal.sensors.imu import simulate_imu
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.ins_solution import unaided_solution
from isogal.sensors.trajectory import build_trajectory

MAP = field_map_of(wavy)


def scenario(duration=600.0, **matcher):
    length = matcher.get("batch_length", 15)  # batches do not overlap
    return Scenario(
        route=ROUTE.model_copy(update={"duration": duration}),
        initial_error=InitialError(position=300.0),
        gravimeter=Gravimeter(quantity="disturbance"),
        gravity=Gravity(field="normal"),  # the map is made up
        map_error=MapError(sigma=1e-5),
        matcher=Matcher(**({"batch_length": 15, "stride": length, "map_sigma": 1e-5} | matcher)),
    )


def test_a_study_without_runs_is_refused():
    with pytest.raises(InputError, match="at least one run"):
        simulate(scenario(), [], MAP)


@pytest.mark.parametrize("settings", [{}, {"mode": "retrodiction", "map_sigma": "auto"}])
def test_a_run_alone_equals_itself_in_a_batch_bit_for_bit(settings):
    it = scenario(duration=300.0, **settings)
    together = simulate(it, [0, 7], MAP)
    assert together.published.any()
    same_runs(simulate(it, [7], MAP), together.part([1]))
    assert (together.error[0] != together.error[1]).any()


def test_what_is_simulated_is_the_truth_and_what_is_assumed_the_rest():
    told = scenario(duration=300.0)
    truth = {"imu": {"grade": "quantum"}, "gravimeter": "3x", "initial_error": "0.5x"}
    it = told.model_copy(update={"truth": truth})
    one, world, blind = (simulate(its, [1], MAP) for its in (it, it.true.informed, told))
    np.testing.assert_array_equal(one.unaided_error, world.unaided_error)
    assert (one.unaided_error != blind.unaided_error).all()
    first = slice(0, 14)  # before the first fix: the filter's own
    np.testing.assert_allclose(one.covariance[:, first], blind.covariance[:, first], atol=1.0)
    assert (one.covariance[:, 0] > 3.9 * world.covariance[:, 0])[:, [0, 1], [0, 1]].all()


@pytest.mark.parametrize(("name", "share"), [("pmht", 0.3), ("pmht-paper", 0.6), ("sitan", 0.5)])
def test_fixes_help(name, share):
    runs = simulate(scenario(name=name), range(8), MAP)
    aided, unaided = (
        np.sqrt((e[:, -1] ** 2).sum(axis=-1).mean()) for e in (runs.error, runs.unaided_error)
    )
    assert aided < share * unaided
    assert runs.published.sum() > 8


@pytest.mark.parametrize("settings", [{"stride": 1}, {"batch_length": 2}])
def test_batches_of_one_or_two_new_readings_are_as_good(settings):
    assert _late_error(**settings) < 1.25 * _late_error(stride=5)


@cache
def _late_error(**settings):
    """RMS error of four runs after 5 min, m; of the same runs for all settings."""
    error = simulate(scenario(**settings), range(4), MAP).error[:, 30:]
    return float(np.sqrt((error**2).sum(axis=-1).mean()))


def test_retrodiction_ends_where_standard_aiding_does_and_has_smaller_steps():
    past = []

    def keep(run, navigator):
        past.append(navigator.inertial.track(np.arange(10.0, 601.0, 10.0))[:, :2])

    standard = simulate(scenario(), range(4), MAP)
    late = simulate(scenario(mode="retrodiction"), range(4), MAP, finished=keep)
    ends = [np.trace(one.posterior_covariance, axis1=2, axis2=3) for one in (late, standard)]
    np.testing.assert_allclose(*ends, rtol=0.1)
    apart = np.linalg.norm(late.posterior_error - standard.posterior_error, axis=2)
    assert (apart < 0.2 * np.sqrt(ends[1])).all()
    truth = standard.latitude[1:], standard.longitude[1:]
    error = horizontal_difference(*np.array(past).transpose(2, 0, 1), *truth)
    steps, jumps = (np.linalg.norm(np.diff(e, axis=1), axis=2) for e in (error, standard.error))
    assert np.sqrt((steps**2).mean()) < 0.5 * np.sqrt((jumps**2).mean())


def test_record_of_the_loop():
    it = scenario(stride=5)
    trajectory = build_trajectory(it)
    runs = simulate(it, [2, 4], MAP)
    np.testing.assert_array_equal(runs.time, np.arange(0.0, 601.0, 10.0))
    np.testing.assert_array_equal(runs.fix_time, np.arange(150.0, 601.0, 50.0))
    np.testing.assert_array_equal(runs.latitude, trajectory.latitude[::10])
    assert (runs.error[:, 0] == runs.unaided_error[:, 0]).all()
    np.testing.assert_allclose(runs.covariance[:, 0], np.tile(300.0**2 * np.eye(2), (2, 1, 1)))
    start = draw_initial_state(it.initial_error, trajectory, it.seed, [2, 4])
    imu = simulate_imu(it, trajectory, [2, 4])
    unaided = unaided_solution(start, trajectory, imu, it.samples_per_step > 1)[:, ::10]
    np.testing.assert_array_equal(
        runs.unaided_error,
        horizontal_difference(unaided[..., 0], unaided[..., 1], runs.latitude, runs.longitude),
    )
    ends = np.searchsorted(runs.time, runs.fix_time)
    np.testing.assert_array_equal(runs.posterior_error, runs.error[:, ends])
    np.testing.assert_array_equal(runs.posterior_covariance, runs.covariance[:, ends])
    assert (runs.fix_seconds > 0.0).all()
    np.testing.assert_array_equal(np.isnan(runs.fix_error).all(axis=-1), ~runs.published)
    detail = runs.detail
    np.testing.assert_allclose(detail.map_value, MAP.value(runs.latitude[1:], runs.longitude[1:]))
    assert np.abs(detail.reading - detail.map_value_navigator).max() < 1e-3


def test_batches_that_the_navigator_could_not_make_say_why():
    recorder = Recorder(
        build_trajectory(scenario()), np.arange(0, 601, 10), np.array([15]), 2, False
    )
    runs = recorder.record(np.zeros((2, 61, 2)), MAP)
    assert not runs.published.any()
    assert set(runs.fix_reason.flat) == {"no batch: not aligned, or no reading"}


@dataclass
class Scripted:
    """Answers by a function of the batch; remembers what it was given."""

    answer: Any
    context: int = 0
    name: str = "scripted"
    batches: list[Batch] = field(default_factory=list)
    memories: list[Any] = field(default_factory=list)

    def match(self, batch, field_map, memory):
        self.batches.append(batch)
        self.memories.append(memory)
        return self.answer(batch), (memory or 0) + 1


def nothing(batch):
    return declined(batch, "nothing")


def at(batch, latitude, longitude, sigma, **keys):
    return Fix(float(batch.time[-1]), latitude, longitude, sigma**2 * np.eye(2), **keys)


def truth_at(it, batch):
    trajectory = build_trajectory(it)
    k = round(float(batch.time[-1]))
    return float(trajectory.latitude[k]), float(trajectory.longitude[k])


def test_without_fixes_the_navigator_only_predicts():
    it = scenario()
    runs = simulate(it, [0, 1], MAP, Scripted(nothing))
    assert runs.fix_reason.tolist() == [["nothing"] * 4] * 2
    assert np.isnan(runs.fix_error).all()
    # the filter's mean goes with the strapdown but for what its known height and its nonlinearity
    # add
    np.testing.assert_allclose(runs.error, runs.unaided_error, atol=0.5)
    trace = np.trace(runs.covariance[0], axis1=1, axis2=2)
    assert (np.diff(trace) > 0.0).all()


def test_a_matcher_that_raises_and_a_fix_78_km_off_cost_a_batch_each():
    """They change nothing, and the matcher goes on with what it knew."""
    it, calls = scenario(), iter(range(4))

    def answer(batch):
        call = next(calls)
        if call == 1:
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        false = at(batch, batch.latitude[-1] + 0.0122, batch.longitude[-1], 1.0)
        return false if call == 2 else nothing(batch)

    scripted = Scripted(answer)
    runs = simulate(it, [0], MAP, scripted)
    assert scripted.memories == [None, 1, 1, 2]
    _, raised, rejected, _ = runs.fix_reason[0]
    assert raised.startswith("the matcher failed: LinAlgError: Matrix is not positive definite (")
    assert rejected.startswith("rejected by the navigator: 77.")
    fixes = summarise(runs, it, np.full(runs.time.shape, np.nan))["fixes"]
    assert fixes == {"published": 0, "declined": 4, "failed": 1, "rejected": 1}
    without = simulate(it, [0], MAP, Scripted(nothing))
    np.testing.assert_array_equal(runs.error, without.error)
    np.testing.assert_array_equal(runs.covariance, without.covariance)


def test_a_position_fix_is_weighted_by_its_covariance():
    it = scenario()
    runs = simulate(it, [0], MAP, Scripted(lambda batch: at(batch, *truth_at(it, batch), 1.0)))
    assert np.hypot(*runs.posterior_error[0].T).max() < 3.0
    assert runs.posterior_covariance[0, :, 0, 0].max() < 1.0
    np.testing.assert_allclose(runs.fix_error, 0.0, atol=1e-6)
    vague = simulate(it, [0], MAP, Scripted(lambda batch: at(batch, *truth_at(it, batch), 1e6)))
    np.testing.assert_allclose(vague.error, vague.unaided_error, atol=0.5)


def test_a_reset_widens_even_without_a_fix():
    it = scenario(duration=300.0)
    scripted = Scripted(lambda batch: replace(nothing(batch), reset=batch.time[-1] == 150.0))
    runs = simulate(it, [0], MAP, scripted)
    assert runs.covariance[0, 15, 0, 0] > LOST_SIGMA[0] ** 2
    assert runs.covariance[0, 14, 0, 0] < 400.0**2
    assert scripted.batches[1].prior[0, 0] > 0.9 * LOST_SIGMA[0] ** 2
    np.testing.assert_allclose(runs.error, runs.unaided_error, atol=20.0)


def test_a_correction_is_carried_back_to_earlier_scans():
    """After a perfect fix the older scans of the next, overlapping batch lie near the true track,
    and where the filter now says."""
    it = scenario(stride=5)
    scripted = Scripted(lambda batch: at(batch, *truth_at(it, batch), 0.1))
    simulate(it, [0], MAP, scripted)
    trajectory = build_trajectory(it)
    first, second = scripted.batches[:2]
    assert (first.time[5:] == second.time[:10]).all()
    k = second.time[:10].round().astype(int)
    truth = trajectory.latitude[k], trajectory.longitude[k]
    before, after = (
        np.hypot(*horizontal_difference(batch.latitude[part], batch.longitude[part], *truth).T)
        for batch, part in ((first, slice(5, None)), (second, slice(0, 10)))
    )
    assert before.min() > 100.0
    assert after[-1] < 1.0  # the scan of the fix
    assert after.max() < 0.1 * before.min()


def test_gravity_that_is_felt_and_not_known_of_spoils_the_unaided_ins():
    """The map's vector acts on the IMU, and its compensation takes it off again."""

    def error(**gravity):
        it = scenario(duration=300.0).model_copy(update={"gravity": Gravity(**gravity)})
        return simulate(it, [0], MAP, Scripted(nothing)).unaided_error[0, -1]

    unfelt = error(field="normal")
    felt = np.linalg.norm(error(field="map", compensation="none") - unfelt)
    assert felt > 1.0
    assert np.linalg.norm(error(field="map") - unfelt) < 0.1 * felt


def test_a_fixed_lag_lies_between_nothing_and_all():
    """Each state by data up to a lag later: the last ones by all, none by more."""
    it = scenario(duration=1200.0, stride=5)
    causal, found, whole = (simulate(it, range(2), MAP, lag=lag) for lag in (0.0, 300.0, np.inf))
    assert causal.smoothed is None
    same_runs(replace(found, smoothed_error=None, smoothed_covariance=None), causal)
    later, some, none = (
        np.trace(one.covariance, axis1=2, axis2=3)
        for one in (whole.smoothed, found.smoothed, causal)
    )
    assert (later <= some * 1.001).all()
    settled, last = causal.elapsed > 300.0, causal.elapsed > 900.0
    assert (some[:, settled].mean(axis=0) < none[:, settled].mean(axis=0) * 1.05).all()
    np.testing.assert_allclose(some[:, last], later[:, last], rtol=1e-6)


def test_a_navigator_that_was_lost_knows_its_past_afterwards():
    """It believes to know its start, and is some km away: fixes of the first part of the voyage
    are of wrong places, and what it says of them at the time is far from the truth."""
    it = scenario(duration=1900.0, stride=5).model_copy(
        update={"initial_error": InitialError(position=50.0, hidden_position=6000.0)}
    )
    found = simulate(it, [0], field_map_of(wavy, half=60e3, step=500.0), lag=np.inf)
    states = found.smoothed
    assert states is not None
    early = found.elapsed < 400.0
    assert np.sqrt(np.mean(found.horizontal_error[:, early] ** 2)) > 5000.0
    assert np.sqrt(np.mean(states.horizontal_error[:, early] ** 2)) < 300.0
    assert nees_per_axis(states.error, states.covariance).mean() < 4.0
