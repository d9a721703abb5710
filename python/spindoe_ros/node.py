"""The node: parameters, subscription and publishers around `core.SpinCore`."""

from __future__ import annotations

from typing import Any

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from .core import Answer, Settings, SpinCore


class SpinNode(Node):  # type: ignore[misc]
    """Subscribes to ``image``, or ``image/compressed``, and ``camera_info``; publishes ``ball/pose``, ``ball/twist``, and
    ``ball/overlay`` while somebody subscribes."""

    def __init__(self) -> None:
        super().__init__("spindoe")
        value = self._declared
        intrinsics = value(
            "intrinsics", [0.0, 0.0, 0.0, 0.0],
            "fx, fy, cx, cy in pixels, and OpenCV's distortion; zeros: those of camera_info",
        )
        settings = Settings(
            table=value("table", "", "the pattern's table, .npz, or pattern, .csv"),
            frame=value("frame", "optical", "optical (REP 103) or camera (z towards the camera)"),
            intrinsics=tuple(intrinsics) if any(intrinsics) else None,
            rectified=value("rectified", False, "whether the images are rectified"),
            ball_radius_m=value("ball_radius_m", 0.02, "radius of the ball, m"),
            min_confidence=value("min_confidence", Settings.min_confidence, "minimum probability of a published pose"),
            window=value("window", 12, "poses that the spin is fitted to"),
            memory_s=value("memory_s", 0.25, "age at which poses are forgotten, s"),
            max_rps=value("max_rps", 175.0, "largest spin considered, revolutions per second"),
        )
        transport = value("image_transport", "raw", "raw (image) or compressed (image/compressed)")
        if transport not in ("raw", "compressed"):
            raise ValueError(f"image_transport: expected raw or compressed, found {transport!r}")
        self._core = SpinCore(settings)
        self._pose = self.create_publisher(PoseWithCovarianceStamped, "ball/pose", 10)
        self._twist = self.create_publisher(TwistWithCovarianceStamped, "ball/twist", 10)
        self._overlay = self.create_publisher(Image, "ball/overlay", qos_profile_sensor_data)
        self.create_subscription(CameraInfo, "camera_info", self._on_camera_info, qos_profile_sensor_data)
        kind, topic = (Image, "image") if transport == "raw" else (CompressedImage, "image/compressed")
        self.create_subscription(kind, topic, self._on_image, qos_profile_sensor_data)

    def _declared(self, name: str, default: Any, description: str) -> Any:
        described = ParameterDescriptor(description=description, read_only=True)
        return self.declare_parameter(name, default, described).value

    def _on_camera_info(self, message: CameraInfo) -> None:
        try:
            if self._core.on_camera_info(message):
                self.get_logger().info(f"camera: {self._core.camera}")
        except ValueError as error:
            self.get_logger().error(f"camera_info: {error}", throttle_duration_sec=5.0)

    def _on_image(self, message: Image | CompressedImage) -> None:
        try:
            answer = self._core.on_image(message)
        except ValueError as error:
            # One image that cannot be read is no reason to stop.
            self.get_logger().error(str(error), throttle_duration_sec=5.0)
            return
        if not self._core.camera.has_intrinsics:
            self.get_logger().warning(
                "no camera_info and no intrinsics: the ball's position is not known, and answers are in the view "
                "frame, which is turned from the camera's by the angle of the ray to the ball",
                throttle_duration_sec=60.0,
            )
        if answer.reason:
            self.get_logger().debug(answer.reason)
        self._publish(message.header, answer)

    def _publish(self, header: Header, answer: Answer) -> None:
        if answer.pose:
            named = Header(stamp=header.stamp, frame_id=answer.frame_id_of(header.frame_id, answer.pose))
            message = PoseWithCovarianceStamped(header=named)
            point, q = message.pose.pose.position, message.pose.pose.orientation
            point.x, point.y, point.z = map(float, answer.position())
            q.w, q.x, q.y, q.z = map(float, answer.pose.quaternion_wxyz)
            message.pose.covariance = answer.pose_covariance()
            self._pose.publish(message)
        if answer.spin:
            named = Header(stamp=header.stamp, frame_id=answer.frame_id_of(header.frame_id, answer.spin))
            twist = TwistWithCovarianceStamped(header=named)
            angular = twist.twist.twist.angular
            angular.x, angular.y, angular.z = map(float, answer.spin.spin_rad_s)
            twist.twist.covariance = answer.twist_covariance()
            self._twist.publish(twist)
        if self._overlay.get_subscription_count() > 0:
            drawn = answer.overlay()
            height, width, _ = drawn.shape
            self._overlay.publish(
                Image(header=header, height=height, width=width, encoding="rgb8", step=3 * width, data=drawn.tobytes())
            )


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
