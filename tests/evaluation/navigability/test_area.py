"""Expected errors over an area, against the bound along the same legs and hand-worked cases."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from isogal.errors import InputError
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.evaluation.navigability.area import Area, between, navigability
from isogal.evaluation.navigability.leg import leg_route
from isogal.scenario import validate_scenario
from isogal.sensors.trajectory import build_trajectory

ROUGH = field_map_of(wavy, half=40e3, step=500.0)


def scenario(**sections):
    return validate_scenario({"gravimeter": {"quantity": "disturbance"}, **sections}).true


@pytest.mark.parametrize(
    ("row", "column", "degrees", "sections"),
    [
        (70, 80, 20.0, {"map_error": {"sigma": 2e-5, "correlation_length": 2000.0}}),
        (
            *(95, 60, 251.0),
            {
                "gravimeter": {"quantity": "disturbance", "bias": 3e-5, "drift": 1e-7},
                "initial_error": {"velocity": 0.4},
                "route": {"duration": 200.0, "speed": 60.0},
            },
        ),
    ],
    ids=["map error", "slow errors"],
)
def test_at_a_node_it_is_the_bound(row, column, degrees, sections):
    settings = scenario(**sections)
    area, heading = Area(settings, ROUGH), np.radians(degrees)
    nodes = np.array([row]), np.array([column])
    found = area.errors(area.leg(heading), *nodes)[0, 0]
    route = leg_route(settings, ROUGH.latitude[row], ROUGH.longitude[column], heading)
    there = settings.model_copy(update={"route": route})
    bound = posterior_cramer_rao(there, build_trajectory(there), ROUGH)
    assert found == pytest.approx(bound.rms[-1], rel=0.01)
    leg = area.leg(heading)
    assert found < 0.95 * np.sqrt((leg.position[-1] ** 2).sum() + leg.rest)  # of the unaided one


def test_a_field_that_repeats_itself_is_ambiguous():
    settings = scenario(initial_error={"position": 4000.0})
    rough = Area(settings, field_map_of(wavy, half=40e3, step=400.0))
    nodes = np.array([100]), np.array([100])
    normal = rough.leg(0.0).approach.by_place[0]

    def repeating(slope):
        def value(north, east):
            waves = 5e-4 * np.sin(2.0 * np.pi * np.asarray(north) / 4000.0)
            return waves + slope * np.asarray(north) + 0.0 * np.asarray(east)

        area = Area(settings, field_map_of(value, half=40e3, step=400.0))
        return area.ambiguity(area.leg(0.0), *nodes)[0, 0]

    # places that many waves away are as likely but for the prior, by which the likeliest is
    # another one if the true one is more than half a 1-sigma off: 2 Phi(-1/2)
    assert repeating(normal) == pytest.approx(0.62, abs=0.07)
    # normal gravity tells them: from wave to wave it changes by three times a reading's noise
    assert normal == pytest.approx(8e-9, rel=0.05)
    assert repeating(0.0) < 1e-3
    assert rough.ambiguity(rough.leg(0.0), *nodes)[0, 0] < 0.3


def test_where_little_is_told_there_is_no_second_place():
    """One place, however vague: chance must not make ripples of it."""
    settings = scenario(initial_error={"position": 2000.0})
    faint = field_map_of(lambda north, east: 0.02 * wavy(north, east), half=40e3, step=500.0)
    area = Area(settings, faint)
    rows = np.arange(60, 100, 5)
    found = area.ambiguity(area.leg(0.5), rows, rows)
    assert np.median(found) < 0.01
    assert found.max() < 0.1


def test_between_nodes_it_is_linear(monkeypatch):
    monkeypatch.setattr("isogal.evaluation.navigability.area._COMPUTED", 7)
    rows, columns = np.arange(0, 40, 2), np.arange(3, 36)
    found = between(lambda i, j: 2.0 * i[:, None] - 0.5 * j[None, :], rows, columns)
    wanted = 2.0 * rows[:, None] - 0.5 * columns[None, :]
    np.testing.assert_allclose(found[:19, :31], wanted[:19, :31], atol=1e-12)
    # beyond the last that is computed, as there
    np.testing.assert_allclose(found[19:, 31:], wanted[18, 30])


def test_the_whole_area():
    holes = ROUGH.values.copy()
    holes[100:120, 40:70] = np.nan
    done = []
    found = navigability(
        scenario(), replace(ROUGH, values=holes), 4, lambda *progress: done.append(progress)
    )
    assert done[-1] == (4, 4)
    assert found.error.shape == (4, *ROUGH.shape)
    worst, mean, best, heading, *_ = (grid for grid, _, _ in found.layers().values())
    known = np.isfinite(mean)
    assert not known[100:120, 40:70].any()
    assert known[50:90, 50:90].all()
    assert ((best <= mean) & (mean <= worst) & (worst <= found.prior * 1.01))[known].all()
    assert set(np.unique(heading[known])) <= {0.0, 90.0, 180.0, 270.0}
    assert found.summary()["error_mean"]["median"] == pytest.approx(np.nanmedian(mean))


def test_a_map_that_says_its_error_counts():
    told = replace(ROUGH, sigma=np.full(ROUGH.shape, 5e-5), correlation_length=3000.0)
    by_ellipses = replace(told, error_ellipses=np.tile([9e6, 0.0, 9e6], (*ROUGH.shape, 1)))

    def error(field_map, **map_error):
        area = Area(scenario(map_error=map_error), field_map)
        return area.errors(area.leg(0.5), np.array([70]), np.array([80]))[0, 0]

    by_scenario = error(ROUGH, sigma=5e-5, correlation_length=3000.0)
    assert error(told) == pytest.approx(by_scenario, rel=1e-3)
    assert error(by_ellipses) == pytest.approx(error(told), rel=1e-12)
    assert error(told) > 1.1 * error(ROUGH)


def test_what_does_not_fit_is_refused():
    with pytest.raises(InputError, match="the scenario measures height"):
        Area(scenario(field="terrain", gravimeter={"sigma": 5.0}), ROUGH)
    with pytest.raises(InputError, match="several channels"):
        Area(scenario(field="gradient"), ROUGH)
