"""The navigator as a user of the library drives it."""

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from helpers.navigators import ROUTE, start_of
from isogal.errors import InputError
from isogal.fix import Fix
from isogal.montecarlo.engine import Simulation, simulate
from isogal.navigator import Navigator
from isogal.scenario import Gravimeter, Gravity, InitialError, Matcher, Scenario
from isogal.sensors.trajectory import build_trajectory

SCENARIO = Scenario(
    route=ROUTE.model_copy(update={"duration": 600.0}),
    initial_error=InitialError(position=300.0),
    gravimeter=Gravimeter(quantity="disturbance"),
    gravity=Gravity(field="normal"),  # the map is made up
    matcher=Matcher(batch_length=15, stride=15, map_sigma=1e-5),
)
MAP = field_map_of(wavy, half=60e3, step=500.0)


def driven(at_once: int, late: int = 0) -> tuple[np.ndarray, list[Fix]]:
    """The states (K, 2) at the scans, and the fixes, of a navigator that gets so many samples at a
    time, and its fixes so many samples late."""
    trajectory = build_trajectory(SCENARIO)
    truth = Simulation(SCENARIO, [3], trajectory, MAP)
    navigator = Navigator(SCENARIO, [MAP], start_of(SCENARIO, trajectory, 3))
    places, waiting, fixes = [], [], []
    for k in range(0, len(trajectory), at_once):
        navigator.imu(np.arange(k + 1.0, k + at_once + 1.0), *truth.samples(0, k, k + at_once))
        for when, fix, estimate in [one for one in waiting if one[0] <= navigator.time]:
            waiting.remove((when, fix, estimate))
            navigator.apply(fix, estimate)
        if navigator.time % 10.0 == 0.0:
            scan = np.array([round(navigator.time / 10.0)])
            navigator.read(0, 10.0 * scan, truth.sensed(0, 0, scan))
            if (matched := navigator.match()) is not None:
                fixes.append(matched.fix)
                estimate = type(navigator.state.estimate)(
                    *(part.copy() for part in navigator.state.estimate)
                )
                waiting.append((navigator.time + late, matched.fix, estimate))
                if not late:
                    navigator.apply(*waiting.pop()[1:])
            places.append(navigator.state.position[:2].copy())
    return np.array(places), fixes


def test_sample_by_sample_it_is_the_engine() -> None:
    places, fixes = driven(1)
    record = simulate(SCENARIO, [3], MAP)
    assert sum(fix.published for fix in fixes) == record.published.sum() > 2
    truth = np.stack([record.latitude, record.longitude], axis=-1)[1:]
    apart = (places - truth) * [6.36e6, 5.1e6] - record.error[0, 1:]
    assert np.abs(apart).max() < 0.02 * np.abs(record.error).max()
    np.testing.assert_allclose(places, driven(10)[0], rtol=0.0, atol=1e-13)


def test_fixes_that_come_late_end_where_those_in_time_do() -> None:
    """The last batch has been matched before the fix of the one before it came, so that only what
    has been applied counts."""
    in_time, late = driven(1)[0], driven(1, late=40)[0]
    apart = np.abs(in_time - late) * 6.36e6
    assert apart[-12:-1].max() < apart[:-12].max()
    assert apart[-2].max() < 30.0


def test_a_start_in_degrees_is_refused():
    start = start_of(SCENARIO, build_trajectory(SCENARIO))
    degrees = start._replace(position=np.degrees(start.position))
    with pytest.raises(InputError, match="latitude must be in radians"):
        Navigator(SCENARIO, [MAP], degrees)
