"""Built by colcon (ament_python)."""

from setuptools import setup

setup(
    name="spindoe_ros",
    version="0.1.0",
    packages=["spindoe_ros"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/spindoe_ros"]),
        ("share/spindoe_ros", ["package.xml"]),
        ("share/spindoe_ros/launch", ["launch/spindoe.launch.py"]),
    ],
    install_requires=["setuptools", "spindoe"],
    license="MIT OR Apache-2.0",
    entry_points={"console_scripts": ["spindoe = spindoe_ros.node:main"]},
)
