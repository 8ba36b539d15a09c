"""The example of a driver: its messages, played to the nodes, bring the vessel home."""

from importlib import import_module

import numpy as np
import pytest
import yaml
from rclpy.serialization import deserialize_message, serialize_message

from helpers.packages import ROOT
from isogal.earth.frames import horizontal_difference
from isogal.fields.simulated_vehicle import simulate_vehicle
from isogal_ros import topics
from isogal_ros.bags.record import Collector
from isogal_ros.graph.bus import Bus
from isogal_ros.graph.plan import node_class
from isogal_ros.messages.imu import read_imu
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.parameters.values import node_values

EXAMPLE = ROOT / "examples" / "sensor_driver"
MINUTES = 15


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The logs of the instruments, made with the example's own script."""
    made = tmp_path_factory.mktemp("driver")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)  # where the map is
        patch.syspath_prepend(EXAMPLE)
        patch.setattr("sys.argv", ["make_logs.py", str(made)])
        import_module("make_logs").main()
    return made


def play(folder, minutes, change=lambda message: None):
    """Return what the nodes answer to the messages of the first minutes, and their errors."""
    driver, scenario = import_module("driver"), import_module("make_logs").vehicle_scenario()
    parameters = yaml.safe_load((EXAMPLE / "vehicle.yaml").read_text())
    names = (topics.GRAVIMETER, topics.PMHT_MM, topics.UKF_FUSION)
    own = {name: {"peers": list(names)} for name in names}
    own[topics.GRAVIMETER] |= {"simulate": False}
    own[topics.UKF_FUSION] |= parameters["/**/ukf_fusion_node"]["ros__parameters"]
    heard = Collector(scenario)
    both = [
        *driver.imu_samples(folder / "imu.csv"),
        *driver.gravimeter_readings(folder / "gravimeter.csv"),
    ]
    with Bus() as bus:
        for topic in heard.topics():
            bus.hear(topic, lambda data, topic=topic: heard.take(topic, data))
        for name in names:
            bus.add(name, node_values(scenario, own[name], node_class(name).sections))
        for utc, topic, message in sorted(both, key=lambda sample: sample[0]):
            if utc > both[0][0] + 60 * minutes:
                break
            change(message)
            bus.send(topic, serialize_message(message))
            bus.run()
    return heard, bus.errors


@pytest.fixture(autouse=True)
def _here(monkeypatch) -> None:
    monkeypatch.chdir(ROOT)  # where the map is
    monkeypatch.syspath_prepend(EXAMPLE)


def test_its_messages_are_those_of_the_simulated_vehicle(folder) -> None:
    """The nodes' own way to write and to read what both have been made from."""
    driver, scenario = import_module("driver"), import_module("make_logs").vehicle_scenario()
    samples = simulate_vehicle(scenario, scenario.true, 0).imu
    read = [
        read_imu(serialize_message(message))[:2]
        for _, _, message in driver.imu_samples(folder / "imu.csv")
    ]
    force, rate = (np.array(column) for column in zip(*read, strict=True))
    np.testing.assert_allclose(force, samples.specific_force[0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(rate, samples.angular_rate[0], rtol=1e-9, atol=1e-12)
    readings = driver.gravimeter_readings(folder / "gravimeter.csv")
    felt = [message.accel.accel.linear.z for _, _, message in readings]
    np.testing.assert_allclose(felt, 9.797, atol=0.01)


def test_its_messages_bring_the_vessel_home(folder) -> None:
    heard, errors = play(folder, MINUTES)
    assert errors == []
    last = max(heard.last_nav)
    place = deserialize_message(heard.last_nav[last], topics.NAV_FIX.type)
    truth = {
        row[0]: row[1:] for row in np.loadtxt(folder / "truth.csv", delimiter=",", skiprows=1)
    }
    believed = np.radians([place.latitude, place.longitude])
    error = np.hypot(*horizontal_difference(*believed, *np.radians(truth[to_seconds(last)])))
    sigma = np.sqrt(place.position_covariance[0] + place.position_covariance[4])
    assert len(heard.fixes) == 60 * MINUTES // 50
    assert sum(found is not None for found in heard.fix_positions().values()) >= 10
    assert error < 3.0 * sigma < 300.0


def test_wrong_axes_are_said(folder) -> None:
    def turned_down(message) -> None:
        if isinstance(message, topics.IMU.type):
            for vector in (message.linear_acceleration, message.angular_velocity):
                vector.y, vector.z = -vector.y, -vector.z

    _, errors = play(folder, 2, turned_down)
    assert len(errors) == 1
    assert errors[0].startswith("ukf_fusion_node: specific force over a minute is -9.8 m/s²")
