"""Height from pressure against the published standard atmosphere, and simulated readings."""

import numpy as np
import pytest

from isogal.errors import InputError
from isogal.scenario import Height, load_scenario
from isogal.sensors.barometer import (
    height_of,
    height_slope,
    pressure_of,
    simulate_heights,
    standard_height,
    standard_pressure,
)
from isogal.sensors.trajectory import build_trajectory

STANDARD = {
    0.0: 101325.0,
    1000.0: 89876.0,
    5000.0: 54048.0,
    10000.0: 26500.0,
    20000.0: 5529.3,
    30000.0: 1197.0,
    40000.0: 287.14,
}
"""Pa by geometric height, m: US Standard Atmosphere, 1976, table I."""


def test_the_standard_atmosphere_is_the_published_one():
    height, pressure = np.array(list(STANDARD)), np.array(list(STANDARD.values()))
    np.testing.assert_allclose(standard_pressure(height), pressure, rtol=6e-5)


@pytest.mark.parametrize("settings", [Height(source="barometer"), Height(source="depth")])
def test_height_and_pressure_are_each_others_inverse(settings):
    height = np.linspace(-400.0, 45000.0 if settings.source == "barometer" else 5.0, 60)
    pressure = pressure_of(height, settings)
    np.testing.assert_allclose(height_of(pressure, settings), height, atol=1e-6)
    step = 1e-3
    slope = np.diff(height_of([pressure[3], pressure[3] + step], settings))[0] / step
    assert height_slope(float(pressure[3]), settings) == pytest.approx(slope, rel=1e-4)
    assert standard_height(101325.0) == pytest.approx(0.0, abs=1e-9)


def test_ten_metres_of_sea_water_are_an_atmosphere():
    depth = Height(source="depth")
    assert pressure_of(-10.0, depth) == pytest.approx(101325.0 + 100518.0, abs=1.0)


def simulated(runs, *more):
    it = load_scenario(
        None,
        ["route.duration=300", "route.height=1000", "gravity.field=normal",
         "height.source=barometer", *more],
    )  # fmt: skip
    read = simulate_heights(it.true.height, build_trajectory(it), it.seed, range(runs))
    return read.ends, read.values - 1000.0


def test_simulated_errors_are_as_large_as_told():
    """400 runs: sizes within 15 % (four times the standard deviation of such an estimate)."""
    none = {"sigma": 1e-6, "weather_sigma": 0.0, "bias": 0.0, "scale": 0.0}

    def errors(runs, duration=10, **told):
        keys = [f"height.{key}={value}" for key, value in (none | told).items()]
        return simulated(runs, f"route.duration={duration}", *keys)[1]

    assert errors(400, bias=8.0)[:, 5].std() == pytest.approx(8.0, rel=0.15)
    assert errors(400, scale=0.02)[:, 5].std() == pytest.approx(20.0, rel=0.15)
    assert errors(20, 300, sigma=0.7).std() == pytest.approx(0.7, rel=0.03)
    weather = errors(400, 300, weather_sigma=10.0, weather_time=60.0)
    assert weather[:, -1].std() == pytest.approx(10.0, rel=0.15)
    together = np.mean(weather[:, -1] * weather[:, -61]) / 100.0
    assert together == pytest.approx(np.exp(-1.0), abs=0.2)


def test_readings_come_at_their_interval_and_do_not_depend_on_other_runs():
    ends, rare = simulated(3, "height.interval=20")
    assert ends.tolist() == list(range(20, 301, 20))
    np.testing.assert_array_equal(simulated(2, "height.interval=20")[1], rare[:2])


def test_an_interval_between_steps_is_refused():
    with pytest.raises(InputError, match=r"height.interval \(0\.7 s\) must be a whole number"):
        load_scenario(None, ["height.source=barometer", "height.interval=0.7"])
    load_scenario(None, ["height.interval=0.7"])  # nobody reads it
