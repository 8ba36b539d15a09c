"""The sensor's node on a magnetic vehicle: two instruments, and what is taken off."""

import math

import numpy as np
import pytest

from helpers.magnetics import aircraft
from helpers.node_bench import bench, field_of, stamps
from isogal.fields.scenario_map import map_for_scenario
from isogal.fields.simulator import ReadingSimulator, compensated
from isogal.magnetics.compensation import Compensation
from isogal.scenario import changed_scenario
from isogal.sensors.magnetometer import field_vector, intensity
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics
from isogal_ros.messages.magnetometer import read_vector
from isogal_ros.nodes.health import WARN

PLACE = np.radians([55.9, -3.9])
CRAFT = aircraft()


def felt(heading):
    """What the aircraft feels when it is level on a heading, 321 nT above the main field."""
    field = field_vector(*np.degrees(PLACE), 100.0, 2025.0)
    field = field * (1.0 + 321.0 / np.linalg.norm(field))
    c, s = np.cos(heading), np.sin(heading)
    body = np.array([c * field[0] + s * field[1], c * field[1] - s * field[0], field[2]])
    return CRAFT.field_on_board(body, np.zeros(3))


@pytest.fixture
def told(magnetic, tmp_path):
    file = tmp_path / "own.yaml"
    Compensation(CRAFT.coefficients()).write(file)
    return changed_scenario(magnetic, [f"magnetometer.compensation={file}"], "test")


def test_both_instruments(told) -> None:
    """Bad messages of either are dropped."""
    with bench(topics.GRAVIMETER, told, simulate=False) as made:
        made.publisher(topics.SCALAR_FIELD)
        for seconds, heading in ((10.0, 0.0), (20.0, 2.0), (30.0, 4.0)):
            vector = felt(heading)
            for k in (-1, 1):
                made.publish(topics.MAGNETIC_FIELD, field_of(seconds + 0.05 * k, vector))
            total = np.linalg.norm(vector)
            made.publish(topics.SCALAR_FIELD, field_of(seconds, (math.nan, math.nan, total)))
            made.nav(seconds, *PLACE)
        made.publish(topics.MAGNETIC_FIELD, field_of(31.0, vector))
        found = [m.magnetic_field.z * 1e9 for m in made.heard["magnetometer/anomaly"]]
        assert found == pytest.approx([321.0] * 3, abs=2.0)
        assert not made.node.health.dropped
        made.publish(topics.SCALAR_FIELD, field_of(40.0, (0.0, 0.0, 5e13)))
        made.publish(topics.MAGNETIC_FIELD, field_of(41.0, (0.0, math.nan, 5e4)))
        assert sum(made.node.health.dropped.values()) == 2


def test_a_silent_vector_instrument_is_said(told) -> None:
    with bench(topics.GRAVIMETER, told, simulate=False) as made:
        for seconds in np.arange(10.0, 80.0, 10.0):
            made.publish(topics.SCALAR_FIELD, field_of(seconds, (0.0, 0.0, 5e4)))
            made.nav(seconds, *PLACE)
        assert math.isnan(made.heard["magnetometer/anomaly"][0].magnetic_field.z)
        text = "no readings of the vector magnetometer"
        made.wait(lambda: any(level == WARN and text in said for level, said, _ in made.says()))


def test_a_simulated_vehicle_has_both_instruments(magnetic) -> None:
    scenario = changed_scenario(magnetic, ["magnetometer.aircraft.permanent=[0, 200, 0]"], "test")
    with bench(topics.GRAVIMETER, scenario) as made:
        message = topics.TRUTH_FIX.type()
        for k in range(1, 22):
            message.header.stamp.sec = k
            made.publish(topics.TRUTH_FIX, message)
        made.nav(10.0, *PLACE)
        assert len(made.heard["magnetometer/data_raw"]) == 21
        assert stamps(made, topics.SCALAR_FIELD) == [10, 20]
        vector = read_vector(made.heard["magnetometer/data_raw"][9])
        assert vector[2] > 4e4  # down, as the main field is
        scalar = made.heard["magnetometer/scalar"][0].magnetic_field
        assert (scalar.x, scalar.y) == (0.0, 0.0)
        assert scalar.z * 1e9 == pytest.approx(np.linalg.norm(vector), abs=10.0)  # noise of 2 nT
        # what the node makes of it is what the Monte Carlo engine does
        trajectory = build_trajectory(scenario)
        field_map = map_for_scenario(scenario, trajectory)
        readings = ReadingSimulator(scenario, trajectory, field_map, [0])
        clean = compensated(scenario, trajectory, readings)[0, 0]
        assert abs(clean - readings.raw[0, 0]) > 50.0
        main_field = float(intensity(*np.degrees(PLACE), 100.0, 2025.0))
        anomaly = made.heard["magnetometer/anomaly"][0].magnetic_field.z * 1e9
        assert anomaly == pytest.approx(clean - main_field, abs=0.05)
