"""The example for robot_localization."""

import yaml

from helpers.launching import BRINGUP
from isogal_ros import topics

FILE = BRINGUP / "params" / "robot_localization.yaml"


def test_it_takes_the_position_of_our_fixes() -> None:
    document = yaml.safe_load(FILE.read_text(encoding="utf-8"))
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
