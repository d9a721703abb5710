"""Built by colcon (ament_python): what ROS needs to find and start the node, which the Python package `spindoe` brings."""

from setuptools import setup

setup(
    name="spindoe_ros",
    version="0.1.0",
    packages=[],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/spindoe_ros"]),
        ("share/spindoe_ros", ["package.xml"]),
        ("share/spindoe_ros/config", ["config/spindoe.yaml"]),
        ("share/spindoe_ros/launch", ["launch/pipeline.launch.py", "launch/spindoe.launch.py"]),
    ],
    install_requires=["setuptools", "spindoe"],
    license="MIT OR Apache-2.0",
    entry_points={"console_scripts": ["spindoe = spindoe_ros.node:main"]},
)
