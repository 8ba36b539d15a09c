"""The launch file, run with stand-ins for the launch packages, which the wheels do not have."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml

from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.plan import CLASSES, node_class

BRINGUP = Path(__file__).resolve().parents[3] / "src" / "isogal_bringup"


class Recorded:
    """Keeps what it was called with."""

    def __init__(self, *arguments: Any, **keys: Any) -> None:
        self.arguments, self.keys = arguments, keys


@pytest.fixture
def description(monkeypatch):
    made: dict[str, list[Recorded]] = {}

    def stand_in(name: str) -> type:
        class Made(Recorded):
            def __init__(self, *arguments: Any, **keys: Any) -> None:
                super().__init__(*arguments, **keys)
                made.setdefault(name, []).append(self)

        return Made

    modules = {
        "launch": ["LaunchDescription"],
        "launch.actions": ["DeclareLaunchArgument", "Shutdown"],
        "launch.conditions": ["IfCondition"],
        "launch.substitutions": [
            "LaunchConfiguration",
            "PathJoinSubstitution",
            "PythonExpression",
        ],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
        "launch_ros.parameter_descriptions": ["ParameterValue"],
        "launch_ros.substitutions": ["FindPackageShare"],
    }
    for name, classes in modules.items():
        module = ModuleType(name)
        for item in classes:
            setattr(module, item, stand_in(item))
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location(
        "launched", BRINGUP / "launch" / "isogal.launch.py"
    )
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.generate_launch_description()
    return made


def test_every_node_is_started_with_parameters_it_knows(description) -> None:
    nodes = {node.keys["executable"]: node.keys for node in description["Node"]}
    assert set(nodes) == set(CLASSES)
    for name, keys in nodes.items():
        assert keys["package"] == ("isogal_ros" if name == RECORDER else name)
        assert keys["name"] == name
        known = node_class(name).settings_model.model_fields
        for entry in keys["parameters"]:
            if isinstance(entry, dict):
                assert set(entry) <= set(known), name
    assert nodes["ins_sim_node"]["on_exit"].keys["reason"]


def test_arguments(description) -> None:
    names = {
        argument.arguments[0]: argument.keys for argument in description["DeclareLaunchArgument"]
    }
    assert set(names) == {"params", "rate", "run", "recorder", "bag"}
    assert all(keys["description"] for keys in names.values())
    used = {item.arguments[0] for item in description["LaunchConfiguration"]}
    assert used == set(names)
    (default,) = description["PathJoinSubstitution"]
    assert (BRINGUP / default.arguments[0][1] / default.arguments[0][2]).exists()


def test_viewer_layouts_show_topics_that_exist() -> None:
    import json
    import re

    from isogal_ros import topics

    known = {"/" + topic.name.lstrip("/") for topic in topics.ALL}
    layout = (BRINGUP / "viewer" / "foxglove.json").read_text()
    json.loads(layout)
    rviz = (BRINGUP / "viewer" / "isogal.rviz").read_text()
    shown = [
        display["Topic"]["Value"]
        for display in yaml.safe_load(rviz)["Visualization Manager"]["Displays"]
        if "Topic" in display
    ]
    shown += re.findall(r'"(/[a-z_]+(?:/[a-z_]+)?)[".]', layout)
    assert len(shown) > 8
    assert set(shown) <= known
