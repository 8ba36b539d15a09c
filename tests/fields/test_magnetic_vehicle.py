"""A magnetic vehicle in a scenario: what it does to the readings, and what is taken off."""

import numpy as np
import pytest

from helpers.magnetics import aircraft
from isogal.errors import InputError
from isogal.fields.magnetic_vehicle import (
    assumed_compensation,
    prior_sigma,
    specified_compensation,
)
from isogal.fields.simulator import ReadingSimulator, compensated
from isogal.magnetics.compensation import Compensation
from isogal.maps.field_map import FieldMap
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory

ROUTE = (
    "route.waypoints=[[55.70,-4.60,40],[55.80,-4.40,40],[55.75,-4.20,40],[55.6,-4.3,40]]",
    "route.duration=1150.0",
)
CRAFT = aircraft(size=1.5)
PARTS = {
    "permanent": CRAFT.permanent.tolist(),
    "induced": CRAFT.induced.ravel().tolist(),
    "eddy": CRAFT.eddy.ravel().tolist(),
}
TOLD = [f"magnetometer.aircraft.{key}={value}" for key, value in PARTS.items()]
TRUE = [f"truth.{item}" for item in TOLD]


@pytest.fixture(scope="module")
def clean(field_map):
    """Readings of a vehicle that is not magnetic."""
    return readings_of(field_map)


@pytest.fixture(scope="module")
def field_map():
    latitude = np.radians(np.arange(55.4, 56.0, 0.01))
    longitude = np.radians(np.arange(-4.8, -3.9, 0.01))
    values = 50.0 * np.sin(1e3 * latitude)[:, None] * np.cos(700.0 * longitude)
    return FieldMap(latitude, longitude, values, "nT", "magnetic_anomaly")


def scenario_of(*items):
    return load_scenario(None, ["field=magnetic", "gravimeter.sigma=1.0", *ROUTE, *items])


def readings_of(field_map, *items, runs=(0, 1)):
    scenario = scenario_of(*items)
    trajectory = build_trajectory(scenario)
    simulator = ReadingSimulator(scenario.true, trajectory, field_map, list(runs))
    return compensated(scenario, trajectory, simulator)


def test_what_is_told_is_taken_off(field_map, clean):
    dirty = readings_of(field_map, *TRUE)
    assert np.ptp(dirty - clean) > 100.0
    np.testing.assert_allclose((dirty - clean)[0], (dirty - clean)[1], atol=1e-6)
    left = readings_of(field_map, *TOLD) - clean
    assert np.ptp(left) < 3.0  # of second order, and eddy currents over a second in turns
    moment = readings_of(field_map, TOLD[0], *TRUE) - clean  # the tensors are not told
    assert np.ptp(moment) > 5.0


def test_coefficients_from_a_file(field_map, clean, tmp_path):
    file = tmp_path / "own.yaml"
    Compensation(CRAFT.coefficients()).write(file)
    left = readings_of(field_map, *TRUE, f"magnetometer.compensation={file}") - clean
    assert np.ptp(left) < 3.0
    with pytest.raises(InputError, match="cannot be read"):
        readings_of(field_map, "magnetometer.compensation=nowhere.yaml")


def test_without_an_aircraft_nothing_changes(field_map, clean):
    assert specified_compensation(scenario_of().magnetometer) is None
    twice = scenario_of(*TOLD, "truth.magnetometer.aircraft.permanent=2x").true.magnetometer
    assert twice.aircraft.permanent == pytest.approx(2.0 * CRAFT.permanent)
    assert assumed_compensation(load_scenario(None, TOLD)) is None  # a gravimeter does not mind
    np.testing.assert_array_equal(clean, readings_of(field_map, "magnetometer.vector_sigma=5.0"))


def test_noise_of_the_vector_magnetometer_is_each_runs_own(field_map):
    items = (*TOLD, "magnetometer.vector_sigma=50.0")
    several = readings_of(field_map, *items, runs=(0, 1))
    np.testing.assert_array_equal(several[1:], readings_of(field_map, *items, runs=(1,)))
    assert 0.1 < np.std(several - readings_of(field_map, *TOLD)) < 3.0


def test_terms_of_what_is_not_told(field_map, clean):
    plain = readings_of(field_map, *TRUE)
    online = readings_of(field_map, *TRUE, "magnetometer.online=true")
    assert online.shape == (*plain.shape, 19)
    np.testing.assert_array_equal(online[..., 0], plain)
    own = online[..., 1:] @ CRAFT.coefficients()
    assert np.ptp(plain - own - clean) < 3.0
    started = readings_of(field_map, *TOLD, "magnetometer.online=true")
    assert np.ptp(started[..., 0] - clean) < 3.0


def test_prior_of_the_coefficients(tmp_path):
    online = "magnetometer.online=true"
    np.testing.assert_array_equal(prior_sigma(scenario_of(online).magnetometer), 300.0)
    own = Compensation(CRAFT.coefficients(), sigma=np.linspace(1.0, 200.0, 18))
    own.write(tmp_path / "own.yaml")
    known = scenario_of(online, f"magnetometer.compensation={tmp_path / 'own.yaml'}")
    told = prior_sigma(known.magnetometer)
    assert (told[0], told[-1]) == (3.0, 300.0)
