"""Readings that are late and filtered: matched at where the vehicle was."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of, wavy
from isogal.earth.frames import horizontal_difference
from isogal.fields.gravity import DISTURBANCE
from isogal.fields.map_error import TrueMapError
from isogal.fields.simulator import ReadingSimulator
from isogal.matching.batching import BatchBuilder
from isogal.matching.path import Path
from isogal.matching.pmht.matcher import Pmht
from isogal.scenario import Gravimeter, MapError, Matcher, Scenario
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import build_trajectory

START = tuple(np.degrees(ORIGIN))
BENT = {
    "waypoints": [
        [*START, 22.0],
        [START[0] + 0.05, START[1] + 0.05, 22.0],
        [START[0] + 0.02, START[1] + 0.16, 22.0],
    ],
    "duration": 700.0,
}
MAP = field_map_of(wavy)
PRIOR = np.diag(np.array([200.0, 200.0, 0.1, 0.1, 5e-5, 5e-5, 5e-4]) ** 2)


def scenario(route=BENT, **keys):
    return Scenario(
        route=route, gravimeter=Gravimeter(quantity="disturbance", sigma=1e-12, **keys)
    )


def batch_of(it, scans=60, error=(0.0, 0.0)):
    """The batch of a navigator that knows its state, or is wrong by a constant (m)."""
    trajectory = build_trajectory(it)
    simulator = ReadingSimulator(it, trajectory, MAP, [0])
    reduction = DISTURBANCE.reduction(it)
    builder = BatchBuilder(Matcher(batch_length=40), reduction, 0, it.gravimeter)
    metres = horizontal_difference(ORIGIN[0] + 1e-5, ORIGIN[1] + 1e-5, *ORIGIN) / 1e-5
    for j in range(scans):
        i = simulator.index[j]
        at = State(
            trajectory.latitude[i] + error[0] / metres[0],
            trajectory.longitude[i] + error[1] / metres[1],
            trajectory.height[i],
            *trajectory.velocity[i, :2],
        )
        reading = reduction.reduce(simulator.raw[0, j], at)
        builder.add_scan(
            trajectory.time[i], at.latitude, at.longitude, trajectory.velocity[i, :2],
            float(reading), 1e-6, height=at.height,
        )  # fmt: skip
    return builder.build(PRIOR), trajectory


def test_path_between_scans_in_a_turn():
    trajectory = build_trajectory(scenario())
    scans = np.arange(10, 701, 10)
    path = Path(
        trajectory.time[scans],
        trajectory.latitude[scans],
        trajectory.longitude[scans],
        trajectory.height[scans],
        trajectory.velocity[scans, :2],
    )
    at = path.at(trajectory.time)
    apart = horizontal_difference(
        at.latitude, at.longitude, trajectory.latitude, trajectory.longitude
    )
    assert np.abs(apart[10:]).max() < 1.5
    np.testing.assert_allclose(
        apart[0], 0.0, atol=0.1
    )  # straight before the first scan, as the route is
    velocity = np.stack([at.v_north, at.v_east], axis=-1)
    assert np.abs(velocity - trajectory.velocity[:, :2]).max() < 2.0


@pytest.mark.parametrize(("delay", "filter_time"), [(20.0, 0.0), (13.0, 0.0), (0.0, 20.0),
                                                    (20.0, 30.0)])  # fmt: skip
def test_a_late_reading_is_the_map_s_value_where_the_vehicle_was(delay, filter_time):
    batch, trajectory = batch_of(scenario(delay=delay, filter_time=filter_time))
    assert len(batch) == 40
    then = batch.time - delay - filter_time
    where = [
        np.interp(then, trajectory.time, values)
        for values in (trajectory.latitude, trajectory.longitude)
    ]
    assert np.abs(horizontal_difference(batch.latitude, batch.longitude, *where)).max() < 2.0
    assert batch.end == (trajectory.latitude[600], trajectory.longitude[600])
    path = batch.instrument.filter_path
    nodes = np.array([[[0.0, 0.0, 1.0]]]) if path is None else path.nodes(batch.latitude)
    along = batch.latitude[:, None] + nodes[..., 0], batch.longitude[:, None] + nodes[..., 1]
    residual = batch.reading - (MAP.value(*along) * nodes[..., 2]).sum(axis=1)
    assert np.isfinite(residual).all()
    scale = np.abs(batch.reading - MAP.value(batch.latitude, batch.longitude)).max()
    if filter_time:
        assert scale > 5e-6  # the filter matters here
    turning = np.abs(np.gradient(batch.velocity, axis=0)).max(axis=1) > 0.05
    turning |= np.convolve(turning, np.ones(15), "full")[:40] > 0  # what a filter remembers
    assert 15 < turning.sum() < 30
    assert np.abs(residual[~turning]).max() < 1e-7
    # the Eötvös acceleration changes by 70 mGal in the turn, which begins between two scans
    assert np.abs(residual).max() < (1e-5 if filter_time else 2e-5)
    raw, _ = batch_of(scenario(delay=delay, filter_time=filter_time), scans=60)
    np.testing.assert_array_equal(raw.reading, batch.reading)


def test_the_posterior_is_at_the_navigator_s_error():
    """Late, filtered or both: also far from where the navigator believes to be, where no straight
    line stands for the map."""
    for keys in ({"delay": 20.0}, {"delay": 5.0, "filter_time": 20.0}, {"filter_time": 30.0}):
        error = np.array([400.0, -300.0])
        batch, _ = batch_of(scenario(**keys), error=error)
        fix, _ = Pmht.from_settings(Matcher(map_sigma=0.0)).match(batch, MAP, None)
        assert fix.published, fix.reason
        seen = -horizontal_difference(fix.latitude, fix.longitude, *batch.end)
        assert np.abs(seen - error).max() < 20.0
        assert np.sqrt(np.trace(fix.covariance)) < 40.0


def test_without_filter_and_delay_nothing_changes():
    batch, _ = batch_of(scenario())
    assert batch.end_place is None
    assert batch.instrument.filter_path is None
    assert batch.instrument.parameters is None


def test_map_error_between_scans_is_a_gauss_markov_process():
    it = scenario(route={"start": START, "end": (-36.4, 147.2), "duration": 200.0})
    it = it.model_copy(update={"map_error": MapError(sigma=1.0, correlation_length=500.0)})
    trajectory = build_trajectory(it)
    runs = 4000
    step = np.exp(-220.0 / 500.0)
    random = np.random.default_rng(2)
    at_scans = np.empty((runs, 20))
    at_scans[:, 0] = random.standard_normal(runs)
    for k in range(1, 20):
        fresh = np.sqrt(1.0 - step**2) * random.standard_normal(runs)
        at_scans[:, k] = step * at_scans[:, k - 1] + fresh
    drawn = TrueMapError(it, trajectory, np.arange(10, 201, 10), range(runs))
    error = drawn.between(at_scans)
    np.testing.assert_array_equal(error[:, 10:201:10], at_scans)
    which = [0, 3, 10, 14, 17, 25, 61]
    distance = 22.0 * np.abs(np.subtract.outer(which, which))
    measured = error[:, which].T @ error[:, which] / runs
    np.testing.assert_allclose(measured, np.exp(-distance / 500.0), atol=5.0 * np.sqrt(2 / runs))


def test_missing_readings_leave_the_others_in_place():
    batch, _ = batch_of(scenario(delay=20.0, missing_fraction=0.5))
    whole, _ = batch_of(scenario(delay=20.0))
    there = np.isfinite(batch.reading)
    assert 8 < there.sum() < 32
    np.testing.assert_array_equal(batch.reading[there], whole.reading[there])
    np.testing.assert_array_equal(batch.time, whole.time)
    np.testing.assert_array_equal(batch.latitude, whole.latitude)
    assert replace(batch, reading=whole.reading).new == whole.new


def test_of_some_rows():
    batch, _ = batch_of(scenario(filter_time=30.0, correlated_sigma=1e-5))
    part = batch.part(10)
    few, every = part.instrument, batch.instrument
    assert few.filter_path.away.shape == (30, *every.filter_path.away.shape[1:])
    np.testing.assert_array_equal(few.parameters.reading, every.parameters.reading[10:])
    np.testing.assert_array_equal(part.by_error, batch.by_error[10:])
    np.testing.assert_array_equal(part.transition, batch.transition[10:])
