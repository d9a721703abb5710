"""The messages that the node publishes and that a written bag holds: filled here for both."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import spindoe

from .core import Answer
from .health import Report

IMAGE = "sensor_msgs/msg/Image"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TWIST = "geometry_msgs/msg/TwistWithCovarianceStamped"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"


class Messages(Protocol):
    """Makes messages of a definition: those of ROS' generated classes, or those of a bag's reader."""

    def make(self, kind: str, **fields: Any) -> Any:
        """A message with all its fields."""

    def octet(self, value: int) -> Any:
        """A value of type ``byte``."""

    def octets(self, values: NDArray[np.uint8]) -> Any:
        """Values of type ``uint8[]``."""


def _header(messages: Messages, stamp: Any, frame_id: str) -> Any:
    return messages.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame_id)


def _vector(messages: Messages, kind: str, values: Any) -> Any:
    x, y, z = map(float, values)
    return messages.make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)


def pose(messages: Messages, answer: Answer, found: spindoe.Pose) -> Any:
    """A ``PoseWithCovarianceStamped``: the ball's center and its orientation in the header's frame."""
    w, x, y, z = map(float, found.quaternion_wxyz)
    quaternion = messages.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
    place = messages.make(
        "geometry_msgs/msg/Pose", position=_vector(messages, "Point", answer.position()), orientation=quaternion
    )
    known = messages.make("geometry_msgs/msg/PoseWithCovariance", pose=place, covariance=answer.pose_covariance())
    return messages.make(POSE, header=_header(messages, answer.stamp, answer.frame_id_of(found)), pose=known)


def twist(messages: Messages, answer: Answer, found: spindoe.Spin) -> Any:
    """A ``TwistWithCovarianceStamped``: the spin in the header's frame. The linear velocity is not measured."""
    velocity = messages.make(
        "geometry_msgs/msg/Twist",
        linear=_vector(messages, "Vector3", (0.0, 0.0, 0.0)),
        angular=_vector(messages, "Vector3", found.spin_rad_s),
    )
    known = messages.make(
        "geometry_msgs/msg/TwistWithCovariance", twist=velocity, covariance=answer.twist_covariance()
    )
    return messages.make(TWIST, header=_header(messages, answer.stamp, answer.frame_id_of(found)), twist=known)


def overlay(messages: Messages, answer: Answer) -> Any:
    """An ``Image`` with what was found drawn onto it."""
    drawn = answer.overlay()
    height, width, _ = drawn.shape
    return messages.make(
        IMAGE, header=_header(messages, answer.stamp, answer.frame_id), height=height, width=width, encoding="rgb8",
        is_bigendian=0, step=3 * width, data=messages.octets(drawn.ravel()),
    )


def diagnostics(messages: Messages, stamp: Any, name: str, report: Report) -> Any:
    """A ``DiagnosticArray`` of one status."""

    def values(pairs: Mapping[str, str]) -> list[Any]:
        return [messages.make("diagnostic_msgs/msg/KeyValue", key=key, value=value) for key, value in pairs.items()]

    status = messages.make(
        "diagnostic_msgs/msg/DiagnosticStatus", level=messages.octet(report.level), name=f"{name}: ball",
        message=report.message, hardware_id=report.frame_id, values=values(report.values),
    )
    return messages.make(DIAGNOSTICS, header=_header(messages, stamp, ""), status=[status])
