"""The example for robot_localization, held against the parameters that it documents."""

import re

import pytest
import yaml

from helpers.launching import BRINGUP
from isogal_ros import topics

FILE = BRINGUP / "params" / "robot_localization.yaml"
# Names and types, of those that are used, as robot_localization documents them (its own
# params/ekf.yaml and params/navsat_transform.yaml, branch ros2, and
# doc/state_estimation_nodes.rst).
EKF = {
    **dict.fromkeys(("frequency", "history_length"), float),
    **dict.fromkeys(("two_d_mode", "publish_tf", "smooth_lagged_data"), bool),
    **dict.fromkeys(("map_frame", "odom_frame", "base_link_frame", "world_frame"), str),
}
INPUT = {"": str, "_config": list, "_queue_size": int, "_differential": bool, "_relative": bool}
NAVSAT = {
    **dict.fromkeys(("frequency", "delay", "magnetic_declination_radians", "yaw_offset"), float),
    **dict.fromkeys(("zero_altitude", "publish_filtered_gps", "use_odometry_yaw"), bool),
    **{"wait_for_datum": bool, "datum": list},
}


@pytest.fixture(scope="module")
def document() -> dict:
    return yaml.safe_load(FILE.read_text(encoding="utf-8"))


def kind_of(name: str) -> type | None:
    if name in EKF:
        return EKF[name]
    found = re.fullmatch(r"(?:odom|pose|twist|imu)\d+(\w*)", name)
    return INPUT.get(found[1]) if found else None


def test_every_parameter_is_documented_and_of_its_type(document) -> None:
    for name, value in document["ekf_filter_node_map"]["ros__parameters"].items():
        assert type(value) is kind_of(name), name
        if name.endswith("_config"):
            assert len(value) == 15, name
            assert {type(item) for item in value} == {bool}
    for name, value in document["navsat_transform_node"]["ros__parameters"].items():
        assert type(value) is NAVSAT.get(name), name


def test_it_takes_the_position_of_our_fixes_and_nothing_else(document) -> None:
    values = document["ekf_filter_node_map"]["ros__parameters"]
    assert values["pose0"] == topics.POSE.name
    assert [i for i, used in enumerate(values["pose0_config"]) if used] == [0, 1]
    # absolute positions that come late, in the frame that they are in
    assert values["world_frame"] == values["map_frame"] == "map"
    assert not values["pose0_differential"]
    assert values["smooth_lagged_data"]
    assert f"gps/fix:={topics.FIX.name}" in FILE.read_text(encoding="utf-8")
    route = yaml.safe_load((BRINGUP / "params" / "isogal.yaml").read_text(encoding="utf-8"))
    start = route["/**"]["ros__parameters"]["route"]["start"]
    assert document["navsat_transform_node"]["ros__parameters"]["datum"][:2] == start
