"""Smoothing against conditioning of one Gaussian vector of all times, what it must not do, and a
smoothed voyage as files that others read."""

import csv
import io
import json
from xml.etree import ElementTree

import numpy as np
import pytest

from helpers.navigators import ROUTE, assert_close, error_between, fly, identical
from isogal.fusion.clone import Clone, inform_clone
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import (
    InformationUpdate,
    LearntMapError,
    PositionFix,
    SampleNoise,
    Widening,
)
from isogal.fusion.prediction import propagate
from isogal.fusion.smoothed_track import SmoothedTrack, as_csv, as_geojson, as_gpx, write_smoothed
from isogal.inertial.error_state import BATCH, batch_covariance
from isogal.scenario import Gravity, Height, Velocity

DURATION = 120
SHORT = ROUTE.model_copy(update={"duration": float(DURATION)})
FLIGHT = fly(route=SHORT)
EVERY = np.arange(0.0, DURATION + 1.0, 10.0)
R = np.array([[40.0**2, 300.0], [300.0, 25.0**2]])
WIDER = batch_covariance(200.0, 0.2, 1e-5, 1e-4)


def navigator() -> InertialNavigator:
    return InertialNavigator(FLIGHT.model, FLIGHT.start, horizon=np.inf)


def advance(it: InertialNavigator, until: int) -> None:
    k = round(it.time)
    it.imu(np.arange(k + 1.0, until + 1.0), *FLIGHT.samples(k, until))


def fix(stamp: int, north: float = 0.0, east: float = 0.0) -> PositionFix:
    return PositionFix(*FLIGHT.fix(stamp, north, east), R)


def information(sign: float = 1.0) -> InformationUpdate:
    A = np.diag([0.0, 0.0, 0.5 / 0.05**2, 0.0, 0.0, 0.0, 0.0])
    A[:2, :2] = np.linalg.inv(R)
    return InformationUpdate(np.array([0.01, -0.02, 0.3, 0.0, 0.0, 0.0, 0.0]), sign * A)


def scaled(covariance: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """In units of 1-sigmas."""
    return covariance / np.outer(sigma, sigma)


def is_positive_definite(state) -> bool:
    relative = scaled(state.covariance, np.sqrt(np.diag(state.covariance)))
    return np.linalg.eigvalsh(relative).min() > 0.0


SCHEDULES = {
    "fixes": {20: [("fix", 30.0, -40.0)], 50: [("fix", -25.0, 10.0)], 90: [("fix", 15.0, 20.0)]},
    "information": {20: ["information"], 70: ["information"], 100: ["negative"]},
    "widened": {20: [("fix", 0.0, 0.0)], 60: ["wider", ("fix", 150.0, 100.0)]},
    "noisy": {20: [("fix", 0.0, 0.0)], 60: ["noisy"], 90: [("fix", 50.0, 40.0)]},
    "learnt": {30: ["learnt", ("fix", 20.0, 0.0)], 80: [("fix", -40.0, 5.0)]},
}


def made(what, stamp: int):
    """A new measurement: information refers to the state that it meets first."""
    if isinstance(what, tuple):
        return fix(stamp, *what[1:])
    return {
        "information": information(),
        "negative": information(-0.1),
        "wider": Widening(WIDER),
        "noisy": SampleNoise(np.full(3, 1e-4), 1.0),
        "learnt": LearntMapError(5e-5, 4000.0),
    }[what]


def flown(schedule) -> InertialNavigator:
    it = navigator()
    for stamp, those in schedule.items():
        advance(it, stamp)
        for what in those:
            it.measure(float(stamp), made(what, stamp))
    advance(it, DURATION)
    return it


FLIGHTS = {
    "plain": FLIGHT,
    "auxiliary": fly(
        route=SHORT,
        gravity=Gravity(field="normal", residual_sigma=1e-4, residual_correlation_length=1000.0),
        velocity=Velocity(kind="dvl", current_sigma=0.3),
    ),
    "barometer": fly(route=SHORT, height=Height(source="barometer")),
}


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_clone_says_how_the_error_goes_on(name) -> None:
    """P' = F P F' + Q with F from the cross-covariance and noise that is no less than that of the
    sensors, and the same numbers as without a clone; a height says as much as one that comes
    afterwards."""
    flight = FLIGHTS[name]
    state, expected = flight.start.copy(), np.array(flight.model.noise[:3]).min() ** 2
    for k in range(60):
        force, rate, height = flight.samples(k, k + 1)
        before, plain, unmeasured = state.covariance.copy(), state.copy(), state.copy()
        for one in (state, unmeasured):
            one.clone = Clone.of(one.covariance)
        propagate(state, flight.model, force, rate, height)
        propagate(plain, flight.model, force, rate, height)
        propagate(unmeasured, flight.model, force, rate, np.full_like(height, np.nan))
        assert identical(plain, state)
        clone, P = unmeasured.clone, unmeasured.covariance
        sigma = np.sqrt(np.diag(P))
        F = np.linalg.solve(scaled(before, sigma), scaled(clone.cross, sigma)).T
        noise = scaled(P, sigma) - F @ scaled(before, sigma) @ F.T
        assert np.linalg.eigvalsh(noise).min() > -1e-9
        assert (np.diag(noise)[3:6] * sigma[3:6] ** 2).min() > 0.99 * expected
        moved = error_between(state, unmeasured)
        inform_clone(clone, P, state.covariance, moved)
        unit = np.sqrt(np.diag(before))
        np.testing.assert_allclose(clone.shift / unit, state.clone.shift / unit, atol=1e-6)
        for one, other in ((clone.change, state.clone.change), (clone.cross, state.clone.cross)):
            np.testing.assert_allclose(scaled(one, unit), scaled(other, unit), atol=1e-6)


def test_a_clone_of_another_number_of_states_is_refused() -> None:
    """Compiled loops would write beyond its end."""
    state = FLIGHT.start.copy()
    state.clone = Clone.of(np.eye(len(state.covariance) + 1))
    with pytest.raises(ValueError, match="of 16 states, not of 15"):
        state.copy()


def free(until: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ten samples without a height, which would be a measurement."""
    force, rate, height = FLIGHT.samples(until - 10, until)
    return force, rate, np.full_like(height, np.nan)


def fly_free(it: InertialNavigator, stamp: int) -> None:
    it.imu(np.arange(stamp - 9.0, stamp + 1.0), *free(stamp))


def dense(schedule) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Means, as error states from the unaided ones, and covariances of the states at `EVERY`, by
    conditioning one vector of all of them."""
    state, size, count = FLIGHT.start.copy(), FLIGHT.model.states, len(EVERY)
    unit = np.sqrt(np.diag(state.covariance))
    C = np.zeros((count * size,) * 2)
    C[:size, :size] = scaled(state.covariance, unit)
    M, pull = np.zeros_like(C), np.zeros(count * size)
    for k in range(1, count):
        stamp, P = 10 * k, state.covariance.copy()
        state.clone = Clone.of(P)
        propagate(state, FLIGHT.model, *free(stamp))
        F = np.linalg.solve(scaled(P, unit), scaled(state.clone.cross, unit)).T
        Q = scaled(state.covariance, unit) - F @ scaled(P, unit) @ F.T
        here, last = slice(k * size, (k + 1) * size), slice((k - 1) * size, k * size)
        C[here, : k * size] = F @ C[last, : k * size]
        C[: k * size, here] = C[here, : k * size].T
        C[here, here] = F @ C[last, last] @ F.T + Q
        for what in schedule.get(stamp, ()):
            A, vector, one = np.zeros((size, size)), np.zeros(size), made(what, stamp)
            if what == "wider":
                wide = np.zeros((size, size))
                wide[np.ix_(BATCH, BATCH)] = WIDER
                C[here, here] += scaled(wide, unit)
            elif isinstance(one, PositionFix):
                metres = FLIGHT.fix(stamp, 1.0, 1.0) - np.array(FLIGHT.fix(stamp, 0.0, 0.0))
                away = (np.array([one.latitude, one.longitude]) - state.position[:2]) / metres
                A[:2, :2] = np.linalg.inv(R)
                vector[:2] = A[:2, :2] @ away
            else:
                A[np.ix_(BATCH, BATCH)] = one.matrix
            M[here, here] += A * np.outer(unit, unit)
            pull[here] += vector * unit
    after = np.linalg.solve(np.eye(len(C)) + C @ M, C)
    mean = np.split(after @ pull, count)
    parts = [slice(k * size, (k + 1) * size) for k in range(count)]
    covariances = [after[part, part] * np.outer(unit, unit) for part in parts]
    return [one * unit for one in mean], covariances


@pytest.mark.parametrize("name", ["fixes", "information", "widened"])
def test_it_is_the_conditional_of_all_states_at_once(name) -> None:
    it, unaided = navigator(), navigator()
    for stamp in range(10, DURATION + 1, 10):
        for one in (it, unaided):
            fly_free(one, stamp)
        for what in SCHEDULES[name].get(stamp, ()):
            assert it.measure(float(stamp), made(what, stamp)).used
    for time, one, mean, P in zip(EVERY, it.smoothed(EVERY), *dense(SCHEDULES[name]), strict=True):
        sigma = np.sqrt(np.diag(P))
        np.testing.assert_allclose(scaled(one.covariance - P, sigma), 0.0, atol=2e-3)
        if name != "information":
            moved = error_between(one, unaided.state_at(time))
            np.testing.assert_allclose(moved / sigma, mean / sigma, atol=0.02)


@pytest.mark.parametrize("name", SCHEDULES)
def test_the_newest_state_is_the_filters_and_no_other_is_less_certain(name) -> None:
    it = flown(SCHEDULES[name])
    filtered = [it.state_at(time).copy() for time in EVERY]
    found = it.smoothed(EVERY)
    assert identical(found[-1], filtered[-1])
    for one, other in zip(found, filtered, strict=True):
        assert is_positive_definite(one)
        if name != "information":  # negative information makes earlier states less certain
            sigma = np.sqrt(np.diag(other.covariance))
            less = scaled(other.covariance - one.covariance, sigma)
            assert np.linalg.eigvalsh(less).min() > -1e-6


def test_a_late_fix_and_other_times_change_nothing() -> None:
    """The past is the same in whatever order fixes came, and whatever else is asked for."""
    on_time = flown(SCHEDULES["fixes"])
    late = navigator()
    advance(late, DURATION)
    for stamp, those in reversed(SCHEDULES["fixes"].items()):
        late.measure(float(stamp), *(made(what, stamp) for what in those))
    every = on_time.smoothed(EVERY)
    for it in (on_time, late):
        few = it.smoothed(np.array([40.0, 80.0]))
        for one, other in zip(few, (every[4], every[8]), strict=True):
            assert_close(one, other, 1e-6, 1e-6)


def after_gaps(*gaps: tuple[float, int]) -> InertialNavigator:
    """A navigator with a fix at the first gap's begin and without data in the gaps, to the end."""
    it = navigator()
    advance(it, 20)
    it.measure(20.0, fix(20))
    for begin, end in gaps:
        force, rate, height = FLIGHT.samples(end, end + 1)
        it.imu(end + 1.0, force[0], rate[0], height[0], end - begin)
    assert it.undecided
    advance(it, DURATION)
    return it


def test_what_happened_in_a_gap_is_settled_by_a_later_fix() -> None:
    """The vehicle turned in a gap: right after it that is as improbable as it seemed, afterwards
    it is known, and so is where the vehicle was."""
    found = {}
    for name, away in {"straight": 0.0, "manoeuvre": 400.0}.items():
        it = after_gaps((20.0, 60))
        assert it.undecided
        it.measure(110.0, fix(110, away))
        if name == "manoeuvre":
            assert not it.undecided
        found[name] = it.smoothed(np.array([20.0, 61.0, 110.0]))
        after = found[name][1]
        assert is_positive_definite(after)
        assert after.covariance[0, 0] < it.state_at(61.0).covariance[0, 0]
    apart = error_between(found["manoeuvre"][1], found["straight"][1])
    assert 40.0 < apart[0] < 300.0  # it had moved some of the way when the data came back
    again = error_between(found["manoeuvre"][0], found["straight"][0])
    assert abs(again[0]) < 60.0  # before the gap there was a fix


def test_a_passage_over_a_gap_is_of_all_that_may_have_happened() -> None:
    """While it is open what has: the joint covariance of the errors at both times is one, and its
    later part is what the navigator says."""
    it = after_gaps((20.0, 60))
    assert it.undecided
    for since in (20.0, 61.0):
        passage = it.passage(since)
        assert passage is not None
        np.testing.assert_allclose(passage.after, it.state.batch_prior, rtol=1e-12)
        joint = np.block([[passage.smoothed, passage.cross], [passage.cross.T, passage.after]])
        sigma = np.sqrt(np.diag(joint))
        assert np.linalg.eigvalsh(scaled(joint, sigma)).min() > -1e-9
        assert np.abs(scaled(passage.cross, sigma[:7])).max() > 0.1


def test_several_gaps_while_it_is_undecided() -> None:
    """States that were merged for a second gap are told apart by what came after it."""
    it = after_gaps((20.0, 50), (51.0, 80))
    it.measure(float(DURATION), fix(DURATION))
    for one in it.smoothed(np.array([20.0, 51.0, 81.0])):
        assert is_positive_definite(one)
        assert np.isfinite(np.concatenate(one.estimate)).all()


def test_times_that_are_not_in_the_history() -> None:
    it = navigator()
    advance(it, DURATION)
    with pytest.raises(ValueError, match="older than the buffer"):
        it.smoothed(np.array([-5.0]))
    assert it.smoothed(np.empty(0)) == []


def track(*longitudes: float) -> SmoothedTrack:
    states = []
    for k, longitude in enumerate(longitudes):
        state = FLIGHT.start.copy()
        state.position[:] = np.radians(-36.5 + 0.001 * k), np.radians(longitude), 100.0
        states.append(state)
    return SmoothedTrack(10.0 * np.arange(len(longitudes)), states)


def test_csv(tmp_path) -> None:
    paths = write_smoothed(track(147.0, 147.002), tmp_path)
    assert [path.name for path in paths] == ["smoothed.csv", "smoothed.geojson", "smoothed.gpx"]
    assert all(path.stat().st_size > 100 for path in paths)
    rows = list(csv.DictReader(io.StringIO(paths[0].read_text())))
    assert [float(row["time"]) for row in rows] == [0.0, 10.0]
    assert float(rows[1]["longitude"]) == pytest.approx(147.002, abs=1e-9)
    velocity, P = FLIGHT.start.velocity, FLIGHT.start.covariance
    assert float(rows[0]["velocity_east"]) == pytest.approx(velocity[1], abs=1e-4)
    for name, expected in (
        ("covariance_north_north", P[0, 0]),
        ("variance_velocity_north", P[3, 3]),
        ("variance_heading", np.degrees(np.degrees(P[8, 8]))),
    ):
        assert float(rows[0][name]) == pytest.approx(expected, rel=1e-4)


def test_stamps_of_real_clocks_keep_milliseconds() -> None:
    made = track(147.0)._replace(time=np.array([1.7e9 + 0.125]))
    row = next(csv.DictReader(io.StringIO(as_csv(made))))
    assert float(row["time"]) == pytest.approx(1.7e9 + 0.125, abs=1e-3)
    assert "2023-11-14T22:13:20.125Z" in as_gpx(made)


def test_geojson_is_cut_at_the_date_line() -> None:
    one = json.loads(as_geojson(track(147.0, 147.002)))["features"][0]
    assert one["geometry"]["type"] == "LineString"
    assert one["geometry"]["coordinates"][1][:2] == pytest.approx([147.002, -36.499])
    assert len(one["properties"]["sigma_north"]) == len(one["properties"]["time"]) == 2
    two = json.loads(as_geojson(track(179.99, 179.999, 180.001, 180.01)))["features"][0]
    assert two["geometry"]["type"] == "MultiLineString"
    assert [len(line) for line in two["geometry"]["coordinates"]] == [2, 2]
    assert two["geometry"]["coordinates"][1][0][0] == pytest.approx(-179.999)


def test_gpx() -> None:
    root = ElementTree.fromstring(as_gpx(track(147.0, 147.002)))
    space = {"gpx": "http://www.topografix.com/GPX/1/1"}
    points = root.findall(".//gpx:trkpt", space)
    assert [float(point.attrib["lon"]) for point in points] == pytest.approx([147.0, 147.002])
    assert points[1].findtext("gpx:time", namespaces=space) == "1970-01-01T00:00:10.000Z"
