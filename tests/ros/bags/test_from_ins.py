"""A table of what an INS has said becomes a recording, from which the navigator finds the way."""

import csv

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import NavSatFix

from helpers.command_line import answer, refusal
from isogal.earth.frames import horizontal_difference
from isogal.fields.measured import measured_field
from isogal.fields.scenario_map import maps_for_scenario
from isogal.fields.simulated_vehicle import simulate_vehicle
from isogal.inertial.rotations import matrix, to_angles
from isogal.scenario import load_scenario
from isogal.sensors.reduction import State
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.replay import replay
from isogal_ros.nodes.signals import Interrupt

KEYS = ("gravity.field=normal", "gravimeter.quantity=disturbance", "matcher.map_sigma=1e-6")
VELOCITY = ["velocity_north", "velocity_east", "velocity_down"]
NAMES = ["time", "latitude", "longitude", "height", *VELOCITY]
ANGLES = ["roll", "pitch", "heading"]


@pytest.fixture(scope="module")
def voyage():
    """A run whose INS is off by half a kilometre at the end, and readings (mGal) that an
    instrument on board has reduced with what it says."""
    keys = "ins.source=solution", "route.duration=900", "initial_error.velocity=1"
    scenario = load_scenario(None, [*KEYS, *keys])
    vehicle = simulate_vehicle(scenario, scenario.true, 0)
    value = maps_for_scenario(scenario).value(*vehicle.states[:, :2].T)
    reduction = measured_field(scenario).reduction(scenario)
    true, said = (State(*rows[:, :5].T) for rows in (vehicle.states, vehicle.solution))
    return vehicle, reduction.reduce(reduction.raw(value, true), said) * 1e5


@pytest.mark.parametrize("attitude", [True, False], ids=["with attitude", "without"])
def test_a_table_is_replayed(voyage, tmp_path, attitude) -> None:
    vehicle, values = voyage
    with (tmp_path / "ins.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([*NAMES, *(ANGLES if attitude else []), "value"])
        for k, (row, value) in enumerate(zip(vehicle.solution, values, strict=True)):
            angles = np.degrees(to_angles(matrix(row[6:]))) if attitude else []
            numbers = *np.degrees(row[:2]), *row[2:6], *angles
            reading = f"{value:.3f}" if k and k % 10 == 0 else ""
            writer.writerow([k, *(f"{x:.8f}" for x in numbers), reading])
    sets = [word for key in KEYS for word in ("--set", key)]
    bag = tmp_path / "bag"
    more = "--unit", "mGal", *sets, "--set", "initial_error.velocity=1"
    more += "--set", "route.duration=900"  # the route that the synthetic map is made for
    count = 901 * (1 if attitude else 2) + 90
    assert f"{count} messages" in answer("bag", tmp_path / "ins.csv", "--out", bag, *more)
    scenario = BagReader(bag).scenario()
    assert scenario.ins.gives_solution
    assert scenario.ins.attitude is attitude
    if not attitude:
        return  # how the filter goes by it, tests of the filter say
    result = replay(BagReader(bag), Interrupt())
    assert result.notes == []
    assert result.failures == []
    last = result.outputs.last_nav
    assert len(last) == 901
    truth = vehicle.states[-1, :2]
    end = deserialize_message(last[max(last)], NavSatFix)
    off = horizontal_difference(*np.radians([end.latitude, end.longitude]), *truth)
    unaided = horizontal_difference(*vehicle.solution[-1, :2], *truth)
    assert np.hypot(*unaided) > 500.0
    assert np.hypot(*off) < 150.0


def test_a_unit_of_another_field_and_a_way_back_are_refused(tmp_path) -> None:
    path, out = tmp_path / "ins.csv", tmp_path / "bag"
    path.write_text(
        "time,latitude,longitude,value\n0,-38,144.5,1\n1,-38.01,144.5,1\n2,-38,144.5,1"
    )
    said = refusal("bag", path, "--out", out)
    assert "the INS ends where it began; give --set route.start and route.end" in said
    rows = [f"{k},{-38 + 0.01 * (k > 5)},144.5,1" for k in range(9)]
    path.write_text("\n".join(["time,latitude,longitude,value[nT]", *rows]))
    assert "the INS stands still most of the time" in refusal("bag", path, "--out", out)
    sets = "--set", "route.start=[-38.0,144.4]"
    said = refusal("bag", path, "--out", out, *sets, "--unit", "nT")
    assert "--unit: 'nT' does not fit gravity, which is in m/s²" in said
    said = refusal("bag", path, "--out", out, *sets)
    assert "value: 'nT' does not fit gravity, which is in m/s²" in said
    moving = "\n".join(f"{k},{-38 + 0.001 * k},144.5,53" for k in range(9))
    path.write_text(f"time,latitude,longitude,value\n{moving}")
    assert "value: values 53 to 53 m/s² cannot be a gravity" in refusal("bag", path, "--out", out)
    assert not out.exists()
