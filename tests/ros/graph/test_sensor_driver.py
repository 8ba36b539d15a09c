"""The example of a driver: its messages, played to the nodes, bring the vessel home."""

from importlib import import_module

import numpy as np
import pytest
import yaml
from rclpy.serialization import deserialize_message, serialize_message

from helpers.packages import ROOT
from isogal.earth.frames import horizontal_difference
from isogal_ros import topics
from isogal_ros.bags.record import Collector
from isogal_ros.graph.bus import Bus
from isogal_ros.graph.plan import node_class
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.parameters.values import node_values

EXAMPLE = ROOT / "examples" / "sensor_driver"
MINUTES = 10


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The logs of the instruments, made with the example's own script."""
    monkeypatch.chdir(ROOT)  # where the map is
    monkeypatch.syspath_prepend(EXAMPLE)
    monkeypatch.setattr("sys.argv", ["make_logs.py", str(tmp_path)])
    import_module("make_logs").main()
    return tmp_path


def test_its_messages_bring_the_vessel_home(folder) -> None:
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
            if utc > both[0][0] + 60 * MINUTES:
                break
            bus.send(topic, serialize_message(message))
            bus.run()
    assert bus.errors == []
    last = max(heard.last_nav)
    place = deserialize_message(heard.last_nav[last], topics.NAV_FIX.type)
    rows = np.loadtxt(folder / "truth.csv", delimiter=",", skiprows=1)
    truth = {row[0]: row[1:] for row in rows}
    believed = np.radians([place.latitude, place.longitude])
    error = np.hypot(*horizontal_difference(*believed, *np.radians(truth[to_seconds(last)])))
    sigma = np.sqrt(place.position_covariance[0] + place.position_covariance[4])
    assert len(heard.fixes) == 60 * MINUTES // 50
    assert sum(found is not None for found in heard.fix_positions().values()) >= 6
    assert error < 3.0 * sigma < 300.0
