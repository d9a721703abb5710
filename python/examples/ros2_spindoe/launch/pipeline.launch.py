"""Starts a camera's driver and image_proc's Debayer node in one process, without copies between them, and the node beside."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import ComposableNodeContainer, LoadComposableNodes
from launch_ros.descriptions import ComposableNode
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    def argument(name: str, default, description: str) -> DeclareLaunchArgument:
        return DeclareLaunchArgument(name, default_value=default, description=description)

    arguments = [
        DeclareLaunchArgument("table", description="the pattern's table, .npz, or the pattern, .csv"),
        DeclareLaunchArgument("driver_package", description="the package of the camera's driver, as usb_cam"),
        DeclareLaunchArgument("driver_plugin", description="its component, as usb_cam::UsbCamNode"),
        DeclareLaunchArgument("driver_params", description="file of its parameters"),
        argument("camera", "camera", "namespace of the camera"),
        argument("debayer", "true", "whether its images are Bayer mosaics"),
        argument("image", "image_color", "the images to take: image_color with debayer, else image_raw"),
    ]
    camera = LaunchConfiguration("camera")
    within = {"namespace": camera, "extra_arguments": [{"use_intra_process_comms": True}]}
    container = ComposableNodeContainer(
        name="camera_container",
        namespace=camera,
        package="rclcpp_components",
        executable="component_container_mt",
        composable_node_descriptions=[
            ComposableNode(
                package=LaunchConfiguration("driver_package"),
                plugin=LaunchConfiguration("driver_plugin"),
                name="driver",
                parameters=[LaunchConfiguration("driver_params")],
                **within,
            )
        ],
        output="screen",
    )
    # Takes image_raw, gives image_color and image_mono, each while somebody subscribes.
    debayer = LoadComposableNodes(
        target_container=container,
        composable_node_descriptions=[
            ComposableNode(package="image_proc", plugin="image_proc::DebayerNode", name="debayer", **within)
        ],
        condition=IfCondition(LaunchConfiguration("debayer")),
    )
    node = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(
            PathJoinSubstitution([FindPackageShare("spindoe_ros"), "launch", "spindoe.launch.py"])
        ),
        launch_arguments={
            "table": LaunchConfiguration("table"),
            "namespace": camera,
            "image": LaunchConfiguration("image"),
            "camera_info": "camera_info",
        }.items(),
    )
    return LaunchDescription([*arguments, container, debayer, node])
