"""The node: parameters, subscription and publishers around `core.SpinCore`."""

from __future__ import annotations

from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped, TwistWithCovarianceStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image

from .core import Answer, Settings, SpinCore


class SpinNode(Node):  # type: ignore[misc]
    """Subscribes to ``image``, publishes ``ball/pose`` and ``ball/twist``."""

    def __init__(self) -> None:
        super().__init__("spindoe")
        value = self._declared
        intrinsics = value("intrinsics", [0.0, 0.0, 0.0, 0.0], "fx, fy, cx, cy in pixels; zeros: unknown")
        settings = Settings(
            table=value("table", "", "the pattern's table, .npz, or pattern, .csv"),
            frame=value("frame", "optical", "optical (REP 103) or camera (z towards the camera)"),
            intrinsics=tuple(intrinsics) if any(intrinsics) else None,
            ball_radius_m=value("ball_radius_m", 0.02, "radius of the ball, m"),
            min_confidence=value("min_confidence", Settings.min_confidence, "minimum probability of a published pose"),
            window=value("window", 12, "poses that the spin is fitted to"),
            memory_s=value("memory_s", 0.25, "age at which poses are forgotten, s"),
            max_rps=value("max_rps", 175.0, "largest spin considered, revolutions per second"),
        )
        self._core = SpinCore(settings)
        if settings.intrinsics is None:
            self.get_logger().warning("no intrinsics: the ball's position is published as the origin")
        self._pose = self.create_publisher(PoseStamped, "ball/pose", 10)
        self._twist = self.create_publisher(TwistWithCovarianceStamped, "ball/twist", 10)
        self.create_subscription(Image, "image", self._on_image, qos_profile_sensor_data)

    def _declared(self, name: str, default: Any, description: str) -> Any:
        described = ParameterDescriptor(description=description, read_only=True)
        return self.declare_parameter(name, default, described).value

    def _on_image(self, message: Image) -> None:
        try:
            answer = self._core.on_image(message)
        except ValueError as error:
            # One image that cannot be read is no reason to stop.
            self.get_logger().error(str(error), throttle_duration_sec=5.0)
            return
        if answer.reason:
            self.get_logger().debug(answer.reason)
        self._publish(message.header, answer)

    def _publish(self, header: Any, answer: Answer) -> None:
        if answer.quaternion_xyzw is not None:
            pose = PoseStamped(header=header)
            if answer.position_m is not None:
                point = pose.pose.position
                point.x, point.y, point.z = map(float, answer.position_m)
            q = pose.pose.orientation
            q.x, q.y, q.z, q.w = map(float, answer.quaternion_xyzw)
            self._pose.publish(pose)
        if answer.spin_rad_s is not None:
            twist = TwistWithCovarianceStamped(header=header)
            angular = twist.twist.twist.angular
            angular.x, angular.y, angular.z = map(float, answer.spin_rad_s)
            twist.twist.covariance = answer.twist_covariance()
            self._twist.publish(twist)


def main() -> None:
    """Runs the node until it is stopped."""
    rclpy.init()
    node = SpinNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
