"""The graph: simulated vehicle, gravimeter, map matching, filter, and a recorder.

ros2 launch isogal_bringup isogal.launch.py rate:=0.0 params:=my.yaml recorder:=false
ros2 launch isogal_bringup isogal.launch.py vehicle:=real namespace:=ship set:="route.height=0.0"
ros2 launch isogal_bringup isogal.launch.py vehicle:=real remap:="/sbg/imu:=imu/data_raw"

All arguments, maps and folders are checked before a node starts. Without respawn the end of any
node ends the launch; with it, a node that dies is started again and goes on from its checkpoint,
and the launch ends when the simulated vehicle has arrived. The launch exits with 1 where an
argument cannot be used or a node has failed.
"""

import os
import sys
from datetime import datetime
from pathlib import Path

from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from isogal_ros.graph.domain import defaults
from isogal_ros.graph.launching import DESCRIBED, Launched, check
from isogal_ros.topics import kind_of
from launch import LaunchDescription

RESPAWN_DELAY = 1.0


def generate_launch_description() -> LaunchDescription:
    params = PathJoinSubstitution([FindPackageShare("isogal_bringup"), "params", "isogal.yaml"])
    defaults = {"params": params, "bag": f"isogal_{datetime.now():%Y-%m-%d_%H-%M-%S}"}
    arguments = [
        DeclareLaunchArgument(
            name, default_value=defaults.get(name, default), description=description
        )
        for name, (default, description) in DESCRIBED.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=nodes)])


def nodes(context: object) -> list:
    """Check the arguments, then return the nodes."""
    print("isogal: checking parameters, maps and folders ...", file=sys.stderr)
    values = {name: LaunchConfiguration(name).perform(context) for name in DESCRIBED}
    launched = check(values, sys.argv, Path(__file__).name)
    return [node(name, launched) for name in launched.names]


def node(name: str, launched: Launched) -> Node:
    """A node with the parameters of the file and its own, which count where both say something."""

    def ended(event: object, context: object) -> Shutdown | None:
        # what this raises ends all, and is what makes launch exit with 1
        reason = launched.ends_all(name, event.returncode, context.is_shutdown)
        return Shutdown(reason=reason) if reason else None

    return Node(
        package=launched.package(name),
        executable=kind_of(name),
        name=name,
        namespace=launched.arguments.namespace,
        ros_arguments=["--log-level", launched.arguments.log_level],
        remappings=launched.arguments.remappings,
        parameters=[launched.arguments.params, launched.own(name)],
        additional_env=defaults(os.environ),
        output="screen",
        respawn=launched.arguments.respawn,
        respawn_delay=RESPAWN_DELAY,
        on_exit=ended,
    )
