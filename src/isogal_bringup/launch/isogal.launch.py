"""The graph: simulated vehicle, gravimeter, map matching, filter, and a recorder.

ros2 launch isogal_bringup isogal.launch.py rate:=0.0 params:=my.yaml recorder:=false
"""

from datetime import datetime

from launch.actions import DeclareLaunchArgument, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription([*arguments(), *nodes()])


def arguments() -> list[DeclareLaunchArgument]:
    params = PathJoinSubstitution([FindPackageShare("isogal_bringup"), "params", "isogal.yaml"])
    bag = f"isogal_{datetime.now():%Y-%m-%d_%H-%M-%S}"
    described = {
        "params": (params, "parameter file (YAML) for all nodes"),
        "rate": ("1.0", "simulated seconds per second; 0.0 = as fast as the graph can"),
        "run": ("0", "index of the run: which random numbers of the seed"),
        "recorder": ("true", "whether everything is recorded"),
        "bag": (bag, "folder of the recording"),
    }
    return [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in described.items()
    ]


def nodes() -> list[Node]:
    recorder = LaunchConfiguration("recorder")
    run = {"run": value_of("run", int)}
    # how many recorders each node waits for before it calls itself ready
    recorders = PythonExpression(["int('", recorder, "'.lower() in ('true', '1'))"])
    common = run | {"recorders": ParameterValue(recorders, value_type=int)}
    return [
        node(
            "isogal_recorder",
            run | {"bag": value_of("bag", str)},
            package="isogal_ros",
            condition=IfCondition(recorder),
        ),
        node("ukf_fusion_node", common),
        node("pmht_mm_node", common),
        node("gravimeter_node", common),
        node(
            "ins_sim_node",
            common | {"rate": value_of("rate", float)},
            on_exit=Shutdown(reason="the simulated vehicle has arrived"),
        ),
    ]


def node(name: str, own: dict, package: str | None = None, **more: object) -> Node:
    """A node with the parameters of the file and its own, which count where both say something."""
    return Node(
        package=package or name,
        executable=name,
        name=name,
        parameters=[LaunchConfiguration("params"), own],
        output="screen",
        **more,
    )


def value_of(argument: str, kind: type) -> ParameterValue:
    return ParameterValue(LaunchConfiguration(argument), value_type=kind)
