"""Starts the node on a camera's images."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    def argument(name: str, default, description: str) -> DeclareLaunchArgument:
        return DeclareLaunchArgument(name, default_value=default, description=description)

    arguments = [
        # Without a default: launch asks for it.
        DeclareLaunchArgument("table", description="the pattern's table, .npz, or the pattern, .csv"),
        argument("image", "/camera/image_raw", "topic of the images"),
        argument("camera_info", "/camera/camera_info", "topic of the camera's intrinsics"),
        argument("image_transport", "raw", "raw, or compressed: then the images are those of the topic's /compressed"),
        argument("name", "spindoe", "the node's name"),
        argument("namespace", "", "its namespace: one for each node"),
        argument("use_sim_time", "false", "whether /clock gives the time, as of a bag that is played with --clock"),
        argument(
            "params", PathJoinSubstitution([FindPackageShare("spindoe_ros"), "config", "spindoe.yaml"]),
            "file of the other parameters",
        ),
    ]
    # As they are: a path of digits would be read as a number.
    words = {name: ParameterValue(LaunchConfiguration(name), value_type=str) for name in ("table", "image_transport")}
    sim_time = ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)
    image = LaunchConfiguration("image")
    node = Node(
        package="spindoe_ros",
        executable="spindoe",
        name=LaunchConfiguration("name"),
        namespace=LaunchConfiguration("namespace"),
        output="screen",
        parameters=[LaunchConfiguration("params"), {**words, "use_sim_time": sim_time}],
        remappings=[
            ("image", image),
            ("image/compressed", [image, "/compressed"]),
            ("camera_info", LaunchConfiguration("camera_info")),
        ],
    )
    return LaunchDescription([*arguments, node])
