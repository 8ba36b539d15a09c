"""The bound with sensors of height and velocity."""

import numpy as np
import pytest

from helpers.batches import field_map_of, wavy
from isogal.evaluation.bound import posterior_cramer_rao, unaided_covariance
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory

ROUTE = ["route.start=[-36.6, 146.9]", "route.end=[-36.4, 147.2]", "route.duration=1200",
         "gravimeter.quantity=disturbance", "gravity.field=normal"]  # fmt: skip


def bound(*more, function=posterior_cramer_rao):
    it = load_scenario(None, [*ROUTE, *more])
    trajectory = build_trajectory(it)
    arguments = (field_map_of(wavy),) if function is posterior_cramer_rao else ()
    return function(it.true, trajectory, *arguments).rms[-1]


def unaided(*more):
    return bound(*more, function=unaided_covariance)


def test_an_unknown_height_is_an_unknown_offset_of_the_readings():
    """10 m constant are 3.086 mGal of bias; as are 2 % of 500 m."""
    still = ["height.source=barometer", "height.weather_sigma=0", "route.height=500"]
    by_bias = bound("gravimeter.bias=3.086e-5", "route.height=500")
    assert bound(*still, "height.bias=10", "height.scale=0") == pytest.approx(by_bias, rel=1e-9)
    assert bound(*still, "height.bias=0", "height.scale=0.02") == pytest.approx(by_bias, rel=1e-9)


def test_a_drifting_height_costs_more_than_none_and_less_than_a_known_offset_costs():
    weather = ["height.source=barometer", "height.bias=0", "height.scale=0"]
    slow = bound(*weather, "height.weather_sigma=10", "height.weather_time=1e7")
    assert slow == pytest.approx(bound("gravimeter.bias=3.086e-5"), rel=1e-3)
    fast = bound(*weather, "height.weather_sigma=10", "height.weather_time=600")
    assert bound() < slow < fast


def test_a_dvl_bounds_the_drift_and_a_current_takes_from_it():
    dvl = unaided("velocity.kind=dvl")
    assert dvl < 0.95 * unaided()
    assert dvl < unaided("velocity.kind=dvl", "velocity.current_sigma=0.3") < unaided()


def test_readings_within_a_stretch_count_together():
    dvl = ["imu.rate=10", "velocity.kind=dvl"]
    once = unaided(*dvl, "velocity.interval=1.0", f"velocity.sigma={0.02 / np.sqrt(10.0)}")
    assert unaided(*dvl, "velocity.interval=0.1") == pytest.approx(once, rel=1e-6)


def test_a_second_height_tells_the_offset_of_the_first():
    first = ["height.source=barometer", "height.bias=10", "height.weather_sigma=10"]
    exact = "heights=[{name: b, sigma: 1e-3, bias: 0, scale: 0, weather_sigma: 0}]"
    known = bound("route.height=500")
    assert bound(*first, exact, "route.height=500") == pytest.approx(known, rel=1e-6)


def test_velocities_by_name_are_as_good_as_that_of_the_section():
    """Two logs in one water know no more of the current than one whose noise is less."""
    named = unaided("velocities=[{name: one, kind: airspeed}]")
    assert named == pytest.approx(unaided("velocity.kind=airspeed"), rel=1e-9)
    log = ["velocity.kind=log", "velocity.scale=0", "velocity.misalignment=0"]
    other = "velocities=[{name: two, kind: log, scale: 0, misalignment: 0}]"
    less = unaided(*log, f"velocity.sigma={0.05 / np.sqrt(2.0)}")
    assert unaided(*log, "velocity.sigma=0.05", other) == pytest.approx(less, rel=1e-9)
