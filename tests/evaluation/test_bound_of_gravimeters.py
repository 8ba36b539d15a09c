"""The bound of a gravimeter as it is built: missing readings, cross-coupling, filter and delay.

Its noise that is correlated in time and the walk of its bias are in `test_bound`."""

from typing import Any

import numpy as np
import pytest

from helpers.route_maps import field, tilted, waves
from isogal.evaluation.bound import PATTERNS, posterior_cramer_rao
from isogal.scenario import Scenario, validate_scenario
from isogal.sensors.gravimeter_errors import missing
from isogal.sensors.trajectory import build_trajectory


def scenario(**changes: Any) -> Scenario:
    return validate_scenario(changes)


def test_an_instrument_as_built_gives_larger_bounds():
    base = {"route": {"duration": 1800.0}}
    trajectory = build_trajectory(scenario(**base))
    field_map = field(waves)

    def rms(sigma: float = 1e-5, **gravimeter: Any) -> float:
        settings = scenario(**base, gravimeter={"sigma": sigma, **gravimeter})
        return float(posterior_cramer_rao(settings, trajectory, field_map).rms[-1])

    good = rms()
    assert rms(missing_fraction=0.5) == pytest.approx(rms(sigma=1e-5 * np.sqrt(2.0)), rel=0.02)
    assert good < rms(gaps=[[300.0, 900.0]]) < rms(gaps=[[0.0, 1700.0]])
    assert rms(dead_turn_rate=0.01) == good  # it goes straight
    assert rms(cross_coupling=1e-3) == pytest.approx(good, rel=1e-3)
    tilting = rms(platform_tilt=2e-3, platform_time=300.0)
    assert tilting == pytest.approx(rms(correlated_sigma=9.8 * 4e-6, correlation_time=150.0))
    # late by 5 s: the same field, seen a little later
    assert rms(delay=5.0) == pytest.approx(good, rel=0.1)
    assert 0.9 * good < rms(filter_time=20.0) < 1.5 * good


def test_readings_missing_by_chance_count_by_pattern():
    """The map's error stands at fewer places to be told from the field; of one pattern the bound
    is that of its gaps."""
    base = {"route": {"duration": 1800.0}, "map_error": {"sigma": 3e-5}}
    half = scenario(**base, gravimeter={"missing_fraction": 0.5})
    trajectory, field_map = build_trajectory(half), field(waves)
    mean = posterior_cramer_rao(half, trajectory, field_map).covariance[-1]
    index = np.arange(10, len(trajectory) + 1, 10)
    each = []
    for run in range(PATTERNS):
        absent = missing(half.gravimeter, half.seed, run, trajectory, index)
        gaps = [[float(trajectory.time[k]) - 1.0, 2.0] for k in index[absent]]
        one = scenario(**base, gravimeter={"gaps": gaps})
        each.append(posterior_cramer_rao(one, trajectory, field_map).covariance[-1])
    np.testing.assert_allclose(mean, np.mean(each, axis=0), rtol=1e-9)


def test_a_filter_takes_from_the_map_error_what_it_takes_from_the_field():
    # waves of 40 km and a map error of 4 km: the error is filtered away, the field is not
    base = {"route": {"duration": 3000.0}, "map_error": {"sigma": 3e-5}}
    trajectory = build_trajectory(scenario(**base))
    settings = scenario(**base, gravimeter={"filter_time": 100.0, "sigma": 1e-6})
    field_map = tilted(1e-7, -6e-8)
    late = scenario(**base, gravimeter={"delay": 100.0, "sigma": 1e-6})
    filtered, delayed = (
        float(posterior_cramer_rao(it, trajectory, field_map).rms[-1]) for it in (settings, late)
    )
    assert 0.7 * delayed < filtered < delayed


def test_in_turns_cross_coupling_counts():
    base = {
        "route": {
            "waypoints": [[-37.9, 144.8, 22], [-37.85, 144.9, 22], [-37.9, 145.0, 22]],
            "duration": None,
        }
    }
    trajectory = build_trajectory(scenario(**base))
    field_map = field(waves)
    blind, coupled, clean = (
        posterior_cramer_rao(scenario(**base, gravimeter=keys), trajectory, field_map).rms
        for keys in ({"dead_turn_rate": 0.01}, {"cross_coupling": 1.0}, {})
    )
    assert clean[-1] < coupled[-1]
    # readings of a turn that may be wrong by 0.4 m/s² say nothing but what their two unknown
    # shares leave
    assert coupled[-1] < 1.001 * blind[-1]
