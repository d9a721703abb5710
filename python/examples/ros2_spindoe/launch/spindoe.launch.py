"""Starts the node on a camera's images."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    arguments = ("table", ""), ("image", "/camera/image_raw"), ("camera_info", "/camera/camera_info")
    return LaunchDescription(
        [
            *[DeclareLaunchArgument(name, default_value=value) for name, value in arguments],
            Node(
                package="spindoe_ros",
                executable="spindoe",
                parameters=[{"table": LaunchConfiguration("table")}],
                remappings=[(name, LaunchConfiguration(name)) for name in ("image", "camera_info")],
            ),
        ]
    )
