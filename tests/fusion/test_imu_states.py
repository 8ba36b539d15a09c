"""States of the inertial sensors beside their biases: which there are, and that the filter is
consistent with them, and not without, where the vehicle turns."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from helpers.navigators import start_of
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.bound import unaided_covariance
from isogal.fusion.assumed import filter_model
from isogal.fusion.imu_states import states
from isogal.fusion.prediction import propagate
from isogal.fusion.state import FilterState
from isogal.scenario import Imu, load_scenario
from isogal.scenario.imu_grades import PAPER_GRADES
from isogal.sensors.imu import simulate_imu
from isogal.sensors.imu_model import bias_sigma, noise_density
from isogal.sensors.trajectory import build_trajectory

ROUND = (
    "[[-36,146,30],[-36.0,146.2,30],[-36.1,146.2,30],[-36.1,146.0,30],[-36.0,146.0,30],"
    "[-36.0,146.2,30]]"
)
RUNS = 40


@pytest.mark.parametrize("grade", PAPER_GRADES)
def test_the_papers_sensors_have_biases_and_noise_only(grade):
    assert states(Imu(grade=grade).sensors) == ()
    sensors = Imu(grade=grade).sensors
    assert tuple(bias_sigma(sensors)) == (*sensors.accelerometer.bias, *sensors.gyroscope.bias)
    assert tuple(noise_density(sensors, 1.0)) == (
        *sensors.accelerometer.random_walk,
        *sensors.gyroscope.random_walk,
    )


def test_states_are_those_of_the_data_sheet():
    made = {state.name: state for state in states(Imu(grade="tactical").sensors)}
    assert len(made) == 6 + 3 + 2
    in_run = made["gyroscope_in_run_z"]
    assert (in_run.enters, in_run.axis, in_run.time) == ("gyroscope", 2, 100.0)
    assert in_run.sigma == pytest.approx(0.35 * np.pi / 180.0 / 3600.0)
    tilt = made["gyroscope_scale_yz"]
    assert (tilt.enters, tilt.axis, tilt.source) == ("gyroscope_scale", 1, 2)
    assert tilt.sigma == pytest.approx(20.0 * np.pi / 648000.0)


def test_what_a_level_vehicle_feels_all_the_time_is_a_bias():
    imu = Imu(
        accelerometer={"misalignment": "20arcsec", "scale_factor": "100ppm"},
        gyroscope={"g_sensitivity": "0.1deg/h/g"},
    )
    sigma = bias_sigma(imu.sensors)
    np.testing.assert_allclose(sigma[:2], 9.80665 * 20.0 * np.pi / 648000.0, rtol=1e-4)
    assert sigma[2] == pytest.approx(9.80665e-4)
    np.testing.assert_allclose(sigma[3:], np.radians(0.1) / 3600.0, rtol=1e-3)


def test_rounded_angles_are_noise_of_the_accelerometers():
    density = noise_density(Imu(gyroscope={"quantisation": "10arcsec"}).sensors, 0.01)
    rounding = 9.80665 * 10.0 * np.pi / 648000.0 / np.sqrt(12.0) * 0.1
    assert density[0] == pytest.approx(np.hypot(8e-5, rounding))
    assert density[2] == 1.6e-6


def unaided(scenario, model):
    """Sum of the NEES of all runs at the end of the route, without aiding, and the RMS error."""
    trajectory, runs = build_trajectory(scenario), list(range(RUNS))
    imu = simulate_imu(scenario, trajectory, runs)
    place, errors, covariances = (trajectory.latitude[-1], trajectory.longitude[-1]), [], []
    for run in runs:
        state = FilterState.start(start_of(scenario, trajectory, run), model)
        samples = imu.specific_force[run], imu.angular_rate[run], trajectory.height[1:]
        propagate(state, model, *samples)
        errors.append(horizontal_difference(*state.position[:2], *place))
        covariances.append(state.covariance[:2, :2])
    error, P = np.array(errors), np.array(covariances)
    nees = np.einsum("ri,ri->", error, np.linalg.solve(P, error[..., None])[..., 0])
    return nees, np.sqrt((error**2).sum(axis=-1).mean()), np.sqrt(np.trace(P.mean(axis=0)))


def without(model, names):
    """The model with nothing of some states, which stay, since the filter is compiled for each
    number of them."""
    auxiliary = tuple(
        replace(state, sigma=1e-6 * state.sigma) if state.name in names else state
        for state in model.auxiliary
    )
    return replace(model, auxiliary=auxiliary)


STANDS = ["route.duration=2000.0", "gravity.field=normal", "imu.grade=navigation"]


@pytest.mark.parametrize(
    ("keys", "which", "count"),
    [
        ([f"route.waypoints={ROUND}"], lambda one: one.source not in (None, one.axis), 2),
        (
            [
                *("initial_error.velocity=0.01", "imu.accelerometer.bias_instability=200ug"),
                "imu.accelerometer.bias_time=200s",
            ],
            lambda one: "in_run" in one.name,
            3,
        ),
    ],
    ids=["misalignment in turns", "biases that change"],
)
def test_consistent_with_states_and_not_without_them(keys, which, count):
    scenario = load_scenario(None, STANDS + keys)
    low, high = chi2.ppf([0.0005, 0.9995], 2 * RUNS)
    model = filter_model(scenario)
    nees, rms, claimed = unaided(scenario, model)
    assert low < nees < high, nees / 2 / RUNS
    assert claimed == pytest.approx(rms, rel=0.25)
    # the bound's model has the same states
    bound = unaided_covariance(scenario.true, build_trajectory(scenario))
    assert float(bound.rms_at(np.array([2000.0]))[0]) == pytest.approx(claimed, rel=0.03)
    nil = [state.name for state in model.auxiliary if which(state)]
    assert len(nil) == count
    assert unaided(scenario, without(model, nil))[0] > high
