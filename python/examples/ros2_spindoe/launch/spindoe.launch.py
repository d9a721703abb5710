"""Starts the node on a camera's images."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    arguments = (
        ("table", ""),
        ("image", "/camera/image_raw"),
        ("camera_info", "/camera/camera_info"),
        ("image_transport", "raw"),
    )
    image = LaunchConfiguration("image")
    return LaunchDescription(
        [
            *[DeclareLaunchArgument(name, default_value=value) for name, value in arguments],
            Node(
                package="spindoe_ros",
                executable="spindoe",
                parameters=[{name: LaunchConfiguration(name) for name in ("table", "image_transport")}],
                remappings=[
                    ("image", image),
                    ("image/compressed", [image, "/compressed"]),
                    ("camera_info", LaunchConfiguration("camera_info")),
                ],
            ),
        ]
    )
