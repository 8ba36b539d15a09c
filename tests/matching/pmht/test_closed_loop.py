"""Runs of the simulated navigator with the matcher in the loop, on the synthetic map.

NEES per axis of a run's posteriors hang together for half an hour or so: four runs of 45 minutes
after the first half hour are some six independent values of two axes. Their mean is within
`INTERVAL` in all but one of a thousand studies of a consistent matcher; the seeds are fixed."""

from functools import cache

import numpy as np
import pytest

from isogal.evaluation.consistency import chi_square_interval, nees_per_axis
from isogal.evaluation.records import Runs
from isogal.montecarlo.engine import simulate
from isogal.scenario import load_scenario

INTERVAL = chi_square_interval(6, confidence=0.999)


@cache
def runs_of(count: int, duration: float, *settings: str) -> Runs:
    scenario = load_scenario(
        None, [f"route.duration={duration}", "gravity.field=normal", "seed=515", *settings]
    )
    return simulate(scenario, range(count))


def after(runs: Runs, time: float) -> tuple[float, float, float]:
    """RMS error of the navigator and of the unaided INS (m), and NEES per axis."""
    later, ends = runs.time >= time, runs.fix_time >= time
    nees = nees_per_axis(runs.posterior_error[:, ends], runs.posterior_covariance[:, ends])
    aided, unaided = (
        float(np.sqrt((one[:, later] ** 2).sum(axis=-1).mean()))
        for one in (runs.error, runs.unaided_error)
    )
    return aided, unaided, float(nees.mean())


@pytest.mark.slow
def test_errors_keep_to_their_covariance_on_a_map_that_is_wrong():
    runs = runs_of(4, 4500.0, "map_error.sigma=3e-5")
    aided, unaided, nees = after(runs, 1800.0)
    assert aided < 0.7 * unaided
    assert INTERVAL[0] < nees < INTERVAL[1]


@pytest.mark.slow
def test_a_bias_that_nobody_has_told_of_is_found():
    """5 mGal and 1 mGal/h: less than half of the unaided error."""
    drift = ("truth.gravimeter.bias=5e-5", "truth.gravimeter.drift=2.8e-9")
    aided, unaided, nees = after(runs_of(2, 4500.0, *drift), 2700.0)
    assert aided < 0.5 * unaided
    assert nees < 2.0 * INTERVAL[1]


TURNING = (
    "route.waypoints=[[-37.0,146.5,22],[-36.9,146.5,22],[-36.9,146.57,22],[-37.0,146.57,22],"
    "[-37.0,146.64,22],[-36.9,146.64,22],[-36.9,146.71,22],[-37.0,146.71,22]]"
)
"""Legs of 11 km with half circles: readings change by 300 mGal in a turn."""


@pytest.mark.slow
@pytest.mark.parametrize(("delay", "filter_time"), [(20, 0), (15, 30)])
def test_an_instrument_that_is_late_in_turns_is_found_out(delay, filter_time):
    """Within twice the errors of one that is not late: a filter of a minute takes sharp features
    away."""
    told = runs_of(2, 2700.0, TURNING)
    late = f"truth.gravimeter.delay={delay}", f"truth.gravimeter.filter_time={filter_time}"
    aided, _, nees = after(runs_of(2, 2700.0, TURNING, *late), 1350.0)
    assert aided < 2.0 * after(told, 1350.0)[0]
    assert nees < INTERVAL[1]


@pytest.mark.slow
def test_a_hidden_start_is_found():
    """10 km off and not told: after 75 min each of two runs is where it believes to be."""
    runs = runs_of(2, 4500.0, "initial_error.hidden_position=10000")
    assert np.hypot(*runs.unaided_error[:, -1].T).min() > 3000.0
    last = np.hypot(*runs.error[:, -1].T)
    sigma = np.sqrt(np.trace(runs.covariance[:, -1], axis1=1, axis2=2))
    assert (last < 300.0).all()
    assert (last < 4.0 * sigma).all()
