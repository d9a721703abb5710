"""The ament package: its launch files, through the node that they start, and what it installs."""

from __future__ import annotations

import runpy
import shutil
import sys
import xml.etree.ElementTree as ElementTree
from types import ModuleType

import pytest
from conftest import ROOT

pytest.importorskip("rosbags")

import ros_launch
from test_ros_node import PARAMETERS, TABLE, camera_info, clip, images, world  # noqa: F401 (fixtures)

PACKAGE = ROOT / "python/examples/ros2_spindoe"


@pytest.fixture
def launch(monkeypatch, tmp_path):
    """Of the package as it is installed."""
    ros_launch.install(monkeypatch)
    made = {}
    setuptools = ModuleType("setuptools")
    setuptools.setup = lambda **given: made.update(given)
    monkeypatch.setitem(sys.modules, "setuptools", setuptools)
    runpy.run_path(str(PACKAGE / "setup.py"))
    for folder, files in made["data_files"]:
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
        for file in files:
            shutil.copy(PACKAGE / file, tmp_path / folder)
    return ros_launch.Launch(tmp_path / "share/spindoe_ros")


def start(world, launched):  # noqa: F811
    """The node as ROS starts it: with the parameters, names and remappings that launch hands to it."""
    world.overrides = {name: list(v) if isinstance(v, list) else v for name, v in launched["parameters"].items()}
    world.remappings, world.namespace = launched["remappings"], launched["namespace"]
    return world.module.SpinNode(launched["name"])


def test_a_launch_starts_the_node_on_a_camera(world, clip, launch):  # noqa: F811
    launch.configurations.update(table=TABLE, image="/cam/image_raw", camera_info="/cam/camera_info", namespace="left")
    launch.run(launch.share / "launch/spindoe.launch.py")
    (launched,) = launch.started
    assert (launched["package"], launched["what"]) == ("spindoe_ros", "spindoe")
    node = start(world, launched)
    assert {one.topic for one in node._subscriptions} == {"/cam/image_raw", "/cam/camera_info"}
    world.send("/cam/camera_info", camera_info(world, clip))
    for one in images(world, clip):
        assert world.send("/cam/image_raw", one) == 1
    assert len(world.publisher("/left/ball/pose").sent) >= 8


def test_its_file_of_parameters_has_the_defaults(world, launch):  # noqa: F811
    launch.configurations["table"] = TABLE
    launch.run(launch.share / "launch/spindoe.launch.py")
    (launched,) = launch.started
    assert launched["files"] == [launch.share / "config/spindoe.yaml"]
    given = launched["parameters"]
    assert given == {**{name: default for name, (default, _) in PARAMETERS.items()}, "table": TABLE, "use_sim_time": False}
    assert [type(given[name]) for name in PARAMETERS] == [type(default) for default, _ in PARAMETERS.values()]
    start(world, launched)


def test_arguments_of_a_launch(world, launch):  # noqa: F811
    with pytest.raises(RuntimeError, match="missing required argument 'table'"):
        launch.run(launch.share / "launch/spindoe.launch.py")
    # A name of digits stays a name.
    launch.configurations.update(table="2024", image_transport="compressed", use_sim_time="true")
    launch.run(launch.share / "launch/spindoe.launch.py")
    (launched,) = launch.started
    assert launched["parameters"]["table"] == "2024" and launched["parameters"]["use_sim_time"] is True
    launched["parameters"]["table"] = TABLE
    node = start(world, launched)
    assert "/camera/image_raw/compressed" in {one.topic for one in node._subscriptions}


@pytest.mark.parametrize("is_bayer", [True, False])
def test_a_pipeline_of_components(world, clip, launch, tmp_path, is_bayer):  # noqa: F811
    """The driver and image_proc in one process; the node takes what they give."""
    launch.configurations.update(
        table=TABLE, driver_package="usb_cam", driver_plugin="usb_cam::UsbCamNode", driver_params=str(tmp_path / "none.yaml"),
        camera="cam",
    )
    if not is_bayer:
        launch.configurations.update(debayer="false", image="image_raw")
    launch.run(launch.share / "launch/pipeline.launch.py")
    container, launched = launch.started
    assert (container["package"], container["what"]) == ("rclcpp_components", "component_container_mt")
    components = [("usb_cam::UsbCamNode", "cam"), ("image_proc::DebayerNode", "cam")][: 1 + is_bayer]
    assert [(one["what"], one["namespace"]) for one in launch.loaded] == components
    assert launch.loaded[0]["files"] == [tmp_path / "none.yaml"]
    node = start(world, launched)
    topic = "/cam/image_color" if is_bayer else "/cam/image_raw"
    assert {one.topic for one in node._subscriptions} == {topic, "/cam/camera_info"}
    assert world.send(topic, next(images(world, clip))) == 1 and len(world.publisher("/cam/ball/pose").sent) == 1


def test_the_package_is_whole():
    package = ElementTree.parse(PACKAGE / "package.xml").getroot()
    needed = {element.text for element in package.iter("exec_depend")}
    imported = {"rclpy", "sensor_msgs", "geometry_msgs", "diagnostic_msgs", "std_msgs", "rcl_interfaces", "launch", "launch_ros"}
    assert imported <= needed
    assert package.findtext("name") == "spindoe_ros"
    # What ROS starts is in the Python package.
    setup = (PACKAGE / "setup.py").read_text()
    assert '"spindoe = spindoe_ros.node:main"' in setup and "packages=[]" in setup
    page = (ROOT / "docs/ros.md").read_text()
    for name in PARAMETERS:
        assert f"`{name}`" in page, name
