"""A small stand-in for ROS 2's Python packages: as much of `rclpy` and of the messages as the node uses.

It checks what `rclpy` checks: parameters are declared once, with a descriptor, and keep their type;
messages are built by keyword from the fields that they have; publishers take messages of their type.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from types import ModuleType
from typing import Any

import numpy as np


@dataclass
class Time:
    sec: int = 0
    nanosec: int = 0


@dataclass
class Header:
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Image:
    header: Header = field(default_factory=Header)
    height: int = 0
    width: int = 0
    encoding: str = ""
    is_bigendian: int = 0
    step: int = 0
    data: Any = b""


@dataclass
class CompressedImage:
    header: Header = field(default_factory=Header)
    format: str = ""
    data: Any = b""


@dataclass
class RegionOfInterest:
    x_offset: int = 0
    y_offset: int = 0
    height: int = 0
    width: int = 0
    do_rectify: bool = False


@dataclass
class CameraInfo:
    header: Header = field(default_factory=Header)
    height: int = 0
    width: int = 0
    distortion_model: str = ""
    d: Any = field(default_factory=lambda: np.zeros(0))
    k: Any = field(default_factory=lambda: np.zeros(9))
    r: Any = field(default_factory=lambda: np.zeros(9))
    p: Any = field(default_factory=lambda: np.zeros(12))
    binning_x: int = 0
    binning_y: int = 0
    roi: RegionOfInterest = field(default_factory=RegionOfInterest)


class Numbers:
    """Fields that are floats, as in the generated messages: anything else is refused."""

    def __setattr__(self, name: str, value: object) -> None:
        assert name in {f.name for f in fields(self)}, f"{type(self).__name__} has no field {name}"
        assert isinstance(value, float), f"{name}: expected a float, found {type(value).__name__}"
        object.__setattr__(self, name, value)


@dataclass
class Vector3(Numbers):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass
class Quaternion(Numbers):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


@dataclass
class Pose:
    position: Vector3 = field(default_factory=Vector3)
    orientation: Quaternion = field(default_factory=Quaternion)


class Covariance:
    """A field `covariance` of 36 numbers: anything else is refused."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name == "covariance":
            assert isinstance(value, np.ndarray) and value.dtype == np.float64
            assert value.shape == (36,)
        object.__setattr__(self, name, value)


@dataclass
class PoseWithCovariance(Covariance):
    pose: Pose = field(default_factory=Pose)
    covariance: Any = field(default_factory=lambda: np.zeros(36))


@dataclass
class PoseWithCovarianceStamped:
    header: Header = field(default_factory=Header)
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)


@dataclass
class Twist:
    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass
class TwistWithCovariance(Covariance):
    twist: Twist = field(default_factory=Twist)
    covariance: Any = field(default_factory=lambda: np.zeros(36))


@dataclass
class TwistWithCovarianceStamped:
    header: Header = field(default_factory=Header)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@dataclass
class ParameterDescriptor:
    description: str = ""
    read_only: bool = False


@dataclass
class Parameter:
    value: Any


@dataclass
class Publisher:
    kind: type
    topic: str
    qos: Any
    sent: list[Any] = field(default_factory=list)
    listeners: int = 0

    def get_subscription_count(self) -> int:
        return self.listeners

    def publish(self, message: Any) -> None:
        assert type(message) is self.kind, f"{self.topic}: {type(message).__name__}"
        self.sent.append(message)


class Logger:
    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []

    def debug(self, line: str) -> None:
        self.lines.append(("debug", line))

    def info(self, line: str) -> None:
        self.lines.append(("info", line))

    def warning(self, line: str, *, throttle_duration_sec: float = 0.0) -> None:
        assert throttle_duration_sec >= 0.0
        self.lines.append(("warning", line))

    def error(self, line: str, *, throttle_duration_sec: float = 0.0) -> None:
        assert throttle_duration_sec >= 0.0
        self.lines.append(("error", line))


class Node:
    """What a launch file gives is in `overrides`."""

    overrides: dict[str, Any] = {}

    def __init__(self, name: str) -> None:
        self.name = name
        self.parameters: dict[str, tuple[Any, ParameterDescriptor]] = {}
        self.publishers: dict[str, Publisher] = {}
        self.subscriptions: dict[str, tuple[type, Callable[[Any], None], Any]] = {}
        self.logger = Logger()
        self.is_destroyed = False

    def declare_parameter(self, name: str, default: Any, descriptor: ParameterDescriptor) -> Parameter:
        assert name not in self.parameters, f"{name} is declared already"
        assert isinstance(descriptor, ParameterDescriptor)
        value = self.overrides.get(name, default)
        if type(value) is not type(default):
            raise TypeError(f"{name}: expected {type(default).__name__}, found {value!r}")
        self.parameters[name] = (value, descriptor)
        return Parameter(value)

    def create_publisher(self, kind: type, topic: str, qos: Any) -> Publisher:
        self.publishers[topic] = Publisher(kind, topic, qos)
        return self.publishers[topic]

    def create_subscription(
        self, kind: type, topic: str, callback: Callable[[Any], None], qos: Any
    ) -> object:
        self.subscriptions[topic] = (kind, callback, qos)
        return object()

    def get_logger(self) -> Logger:
        return self.logger

    def destroy_node(self) -> None:
        self.is_destroyed = True


SENSOR_DATA = object()


def install(patch: Any) -> ModuleType:
    """Puts the modules where the node imports them from; returns `rclpy`, whose `events` are what was
    called and whose `spin` delivers `first`, a `CameraInfo`, and the messages `incoming` to the node's subscription of their type, then ends
    as Ctrl-C does."""
    modules = {
        name: ModuleType(name)
        for name in (
            "rclpy", "rclpy.node", "rclpy.qos", "sensor_msgs", "sensor_msgs.msg", "geometry_msgs",
            "geometry_msgs.msg", "rcl_interfaces", "rcl_interfaces.msg", "std_msgs", "std_msgs.msg",
        )
    }
    rclpy: Any = modules["rclpy"]
    rclpy.events, rclpy.incoming, rclpy.node_of, rclpy.first = [], [], None, None

    def spin(node: Node) -> None:
        rclpy.events.append("spin")
        rclpy.node_of = node
        if rclpy.first is not None:
            node.subscriptions["camera_info"][1](rclpy.first)
        for message in rclpy.incoming:
            for kind, callback, _ in node.subscriptions.values():
                if type(message) is kind:
                    callback(message)
        raise KeyboardInterrupt

    rclpy.init = lambda: rclpy.events.append("init")
    rclpy.spin = spin
    rclpy.try_shutdown = lambda: rclpy.events.append("shutdown")
    contents: dict[str, dict[str, Any]] = {
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": SENSOR_DATA},
        "sensor_msgs.msg": {"Image": Image, "CompressedImage": CompressedImage, "CameraInfo": CameraInfo},
        "std_msgs.msg": {"Header": Header},
        "geometry_msgs.msg": {
            "PoseWithCovarianceStamped": PoseWithCovarianceStamped,
            "TwistWithCovarianceStamped": TwistWithCovarianceStamped,
        },
        "rcl_interfaces.msg": {"ParameterDescriptor": ParameterDescriptor},
    }
    for name, content in contents.items():
        for key, value in content.items():
            setattr(modules[name], key, value)
    for name, module in modules.items():
        patch.setitem(sys.modules, name, module)
    return rclpy
