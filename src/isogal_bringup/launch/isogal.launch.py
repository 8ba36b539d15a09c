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
    params = LaunchConfiguration("params")
    recorder = LaunchConfiguration("recorder")
    run = ParameterValue(LaunchConfiguration("run"), value_type=int)
    # how many recorders each node waits for before it calls itself ready
    recorders = ParameterValue(
        PythonExpression(["int('", recorder, "'.lower() in ('true', '1'))"]), value_type=int
    )
    common = {"run": run, "recorders": recorders}
    default_params = PathJoinSubstitution(
        [FindPackageShare("isogal_bringup"), "params", "isogal.yaml"]
    )
    default_bag = f"isogal_{datetime.now():%Y-%m-%d_%H-%M-%S}"
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "params",
                default_value=default_params,
                description="parameter file (YAML) for all nodes",
            ),
            DeclareLaunchArgument(
                "rate",
                default_value="1.0",
                description="simulated seconds per second; 0.0 = as fast as the graph can",
            ),
            DeclareLaunchArgument(
                "run",
                default_value="0",
                description="index of the run: which random numbers of the seed",
            ),
            DeclareLaunchArgument(
                "recorder", default_value="true", description="whether everything is recorded"
            ),
            DeclareLaunchArgument(
                "bag", default_value=default_bag, description="folder of the recording"
            ),
            Node(
                package="isogal_ros",
                executable="isogal_recorder",
                name="isogal_recorder",
                parameters=[
                    params,
                    {
                        "run": run,
                        "bag": ParameterValue(LaunchConfiguration("bag"), value_type=str),
                    },
                ],
                condition=IfCondition(recorder),
                output="screen",
            ),
            Node(
                package="ukf_fusion_node",
                executable="ukf_fusion_node",
                name="ukf_fusion_node",
                parameters=[params, common],
                output="screen",
            ),
            Node(
                package="pmht_mm_node",
                executable="pmht_mm_node",
                name="pmht_mm_node",
                parameters=[params, common],
                output="screen",
            ),
            Node(
                package="gravimeter_node",
                executable="gravimeter_node",
                name="gravimeter_node",
                parameters=[params, common],
                output="screen",
            ),
            Node(
                package="ins_sim_node",
                executable="ins_sim_node",
                name="ins_sim_node",
                parameters=[
                    params,
                    common,
                    {"rate": ParameterValue(LaunchConfiguration("rate"), value_type=float)},
                ],
                on_exit=Shutdown(reason="the simulated vehicle has arrived"),
                output="screen",
            ),
        ]
    )
