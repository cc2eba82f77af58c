"""Start `palpate live` with a rig, and RViz if wanted: `ros2 launch palpate_ros live.launch.py rig:=rig.toml`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

CONFIG = PathJoinSubstitution([FindPackageShare("palpate_ros"), "config"])
SHOWN = ("markers", "pose", "wrench")  # topics in the RViz file


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the two programs."""
    group = LaunchConfiguration("group")
    return LaunchDescription(
        [
            DeclareLaunchArgument("rig", description="the rig, with a [source]"),
            DeclareLaunchArgument(
                "params",
                default_value=PathJoinSubstitution([CONFIG, "live.yaml"]),
                description="other options of palpate live",
            ),
            DeclareLaunchArgument("rviz", default_value="false", description="whether to start RViz"),
            DeclareLaunchArgument("frame", default_value="surface", description="RViz's fixed frame"),
            DeclareLaunchArgument(
                "group", default_value="contact", description="topics that RViz shows: /palpate/GROUP/..."
            ),
            Node(
                package="palpate_ros",
                executable="live",
                parameters=[
                    LaunchConfiguration("params"),
                    {"rig": ParameterValue(LaunchConfiguration("rig"), value_type=str)},
                ],
                output="screen",
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", PathJoinSubstitution([CONFIG, "palpate.rviz"]), "-f", LaunchConfiguration("frame")],
                remappings=[(f"/palpate/contact/{name}", ["/palpate/", group, f"/{name}"]) for name in SHOWN],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
