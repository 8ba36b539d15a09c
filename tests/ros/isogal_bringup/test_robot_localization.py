"""The example for robot_localization, held against the parameters that it documents."""

import re

import yaml

from helpers.launching import BRINGUP
from isogal_ros import topics

FILE = BRINGUP / "params" / "robot_localization.yaml"
# Names and types, of those that are used, as robot_localization documents them (its own
# params/ekf.yaml and params/navsat_transform.yaml, branch ros2, and
# doc/state_estimation_nodes.rst).
DOCUMENTED = {
    float: "frequency|history_length|delay|magnetic_declination_radians|yaw_offset",
    bool: "two_d_mode|publish_tf|smooth_lagged_data|zero_altitude|publish_filtered_gps"
    r"|use_odometry_yaw|wait_for_datum|(odom|pose|twist|imu)\d+_(differential|relative)",
    str: r"(map|odom|base_link|world)_frame|(odom|pose|twist|imu)\d+",
    int: r"(odom|pose|twist|imu)\d+_queue_size",
    list: r"(odom|pose|twist|imu)\d+_config|datum",
}


def test_every_parameter_is_documented_and_it_takes_the_position_of_our_fixes() -> None:
    document = yaml.safe_load(FILE.read_text(encoding="utf-8"))
    for node in document.values():
        for name, value in node["ros__parameters"].items():
            assert re.fullmatch(DOCUMENTED[type(value)], name), name
            assert not name.endswith("_config") or len(value) == 15, name
    values = document["ekf_filter_node_map"]["ros__parameters"]
    assert values["pose0"] == topics.POSE.name
    assert values["pose0_config"] == [True] * 2 + [False] * 13
    # absolute positions that come late, in the frame that they are in
    assert values["world_frame"] == values["map_frame"] == "map"
    assert not values["pose0_differential"]
    assert values["smooth_lagged_data"]
    assert f"gps/fix:={topics.FIX.name}" in FILE.read_text(encoding="utf-8")
    route = yaml.safe_load((BRINGUP / "params" / "isogal.yaml").read_text(encoding="utf-8"))
    start = route["/**"]["ros__parameters"]["route"]["start"]
    assert document["navsat_transform_node"]["ros__parameters"]["datum"][:2] == start
