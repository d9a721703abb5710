"""The node: parameters, subscriptions, publishers and diagnostics around `core.SpinCore`."""

from __future__ import annotations

import array
import importlib
import time
import warnings
from dataclasses import fields, replace
from typing import Any

import numpy as np
import rclpy
from numpy.typing import NDArray
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from . import health, messages
from .core import Answer, Settings, SpinCore, nanoseconds

COMPRESSED = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
REPORT_S = 1.0
SETTINGS = {setting.name: setting for setting in fields(Settings)}


def kind_of(name: str) -> Any:
    """The class of a message, as ``sensor_msgs/msg/Image``."""
    package, _, kind = name.partition("/msg/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)


class RosMessages:
    """Makes messages of ROS' generated classes."""

    def make(self, kind: str, **fields: Any) -> Any:
        """A message with all its fields."""
        return kind_of(kind)(**fields)

    def octet(self, value: int) -> bytes:
        """A value of type ``byte``."""
        return bytes([value])

    def octets(self, values: NDArray[np.uint8]) -> Any:
        """Values of type ``uint8[]``: anything but an array or bytes is taken number by number."""
        return array.array("B", values.tobytes())


class SpinNode(Node):  # type: ignore[misc]
    """Subscribes to ``image``, or ``image/compressed``, and ``camera_info``; publishes ``ball/pose``, ``ball/twist``, each second
    ``/diagnostics``, and ``ball/overlay`` while somebody subscribes.

    Args:
        node_name: Its name; several in a process have a name or a namespace each.
        options: As ``rclpy.node.Node`` has them.

    Raises:
        ValueError: For parameters that do not fit.
        OSError: For a table that cannot be read.
        ParameterException: For parameters of another type or out of range.
    """

    def __init__(self, node_name: str = "spindoe", **options: Any) -> None:
        super().__init__(node_name, **options)
        for name, setting in SETTINGS.items():
            self._declare(name, setting.default, setting.metadata["description"], setting.metadata["range"])
        words = "raw (image) or compressed (image/compressed)"
        transport = self._declare("image_transport", "raw", words, is_fixed=True)
        if transport not in ("raw", "compressed"):
            raise ValueError(f"image_transport: expected raw or compressed, found {transport!r}")
        self._core = SpinCore(self._settings())
        self._candidate = self._core
        self._refused: Settings | None = None
        self._health = health.Health()
        self._verdict: health.Verdict | None = None
        self._reported_s = time.monotonic()
        self._messages = RosMessages()
        self._pose = self.create_publisher(kind_of(messages.POSE), "ball/pose", 10)
        self._twist = self.create_publisher(kind_of(messages.TWIST), "ball/twist", 10)
        self._status = self.create_publisher(kind_of(messages.DIAGNOSTICS), "/diagnostics", 10)
        # Reliable, as displays expect it; one, so that a slow one does not lag.
        self._overlay = self.create_publisher(kind_of(messages.IMAGE), "ball/overlay", 1)
        self._subscribe(CAMERA_INFO, "camera_info", self._on_camera_info)
        kind, topic = (messages.IMAGE, "image") if transport == "raw" else (COMPRESSED, "image/compressed")
        self._topic = self.resolve_topic_name(topic)
        self._subscribe(kind, topic, self._on_image)
        self.add_on_set_parameters_callback(self._on_parameters)
        # Reports come also while simulated time stands still.
        self.create_timer(REPORT_S, self._report, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _declare(
        self, name: str, default: Any, description: str, limits: Any = None, is_fixed: bool = False
    ) -> Any:
        """Declares a parameter; its value."""
        described = ParameterDescriptor(description=description, read_only=is_fixed)
        if isinstance(default, int) and limits:
            low, high = limits
            described.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
        elif limits:
            low, high = limits
            described.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
        default = list(default) if isinstance(default, tuple) else default
        return self.declare_parameter(name, default, described).value

    def _subscribe(self, kind: str, topic: str, callback: Any) -> Any:
        """Takes what drivers send, reliable or not (REP 2003); ``qos_overrides`` may ask for more. A profile of its own, since
        these are written into it."""
        profile = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=5, reliability=ReliabilityPolicy.BEST_EFFORT
        )
        options = QoSOverridingOptions.with_default_policies()
        return self.create_subscription(kind_of(kind), topic, callback, profile, qos_overriding_options=options)

    def _settings(self) -> Settings:
        """The parameters as they are."""
        values = {name: self.get_parameter(name).value for name in SETTINGS}
        return Settings(**{**values, "intrinsics": tuple(values["intrinsics"])})

    def _on_parameters(self, parameters: list[Any]) -> SetParametersResult:
        """Whether parameters may become these: tried here, taken with the next message, since others may yet refuse."""
        asked = {parameter.name: parameter.value for parameter in parameters if parameter.name in SETTINGS}
        if "intrinsics" in asked:
            asked["intrinsics"] = tuple(asked["intrinsics"])
        try:
            self._candidate = self._core.with_settings(replace(self._settings(), **asked))
        except (ValueError, OSError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._refused = None
        return SetParametersResult(successful=True, reason="")

    def _current(self) -> SpinCore:
        """The core of the parameters as they are, or of those before where they do not fit any more."""
        settings = self._settings()
        if settings in (self._core.settings, self._refused):
            return self._core
        try:
            fits = settings == self._candidate.settings
            self._core = self._candidate if fits else self._core.with_settings(settings)
        except (ValueError, OSError) as error:
            # As of a table that is gone by now: said once.
            self._refused = settings
            self.get_logger().error(f"{error}: going on with {self._core.settings}")
            return self._core
        self.get_logger().info(f"a new beginning with {settings}")
        return self._core

    def _on_camera_info(self, message: Any) -> None:
        core = self._current()
        try:
            if core.on_camera_info(message):
                self.get_logger().info(f"camera: {core.camera}", throttle_duration_sec=5.0)
        except ValueError as error:
            self.get_logger().error(f"{core.camera_missing or error}", throttle_duration_sec=5.0)

    def _on_image(self, message: Any) -> None:
        core, begin_s = self._current(), time.perf_counter()
        try:
            answer = core.on_image(message)
        except ValueError as error:
            # One image that cannot be read is no reason to stop.
            self._health.refuse(str(error))
            self.get_logger().error(f"{self._topic}: {error}", throttle_duration_sec=5.0)
            return
        self._publish(answer)
        age_ns = self.get_clock().now().nanoseconds - nanoseconds(answer.stamp)
        self._health.take(answer, time.perf_counter() - begin_s, 1e-9 * age_ns)
        if answer.note:
            self.get_logger().warning(answer.note, throttle_duration_sec=5.0)
        if answer.reason:
            self.get_logger().debug(answer.reason)

    def _publish(self, answer: Answer) -> None:
        if answer.pose:
            self._pose.publish(messages.pose(self._messages, answer, answer.pose))
        if answer.spin:
            self._twist.publish(messages.twist(self._messages, answer, answer.spin))
        if self._overlay.get_subscription_count() > 0:
            self._overlay.publish(messages.overlay(self._messages, answer))

    def _report(self) -> None:
        """Publishes diagnostics, and logs a verdict that is new."""
        now_s = time.monotonic()
        seconds, self._reported_s = now_s - self._reported_s, now_s
        core = self._core
        report = self._health.report(seconds, "" if core.camera.has_intrinsics else core.camera_missing)
        if report.verdict == "no images":
            words = f"no images on {self._topic}, which has {self.count_publishers(self._topic)} publishers"
            report = replace(report, message=words)
        stamp = self.get_clock().now().to_msg()
        self._status.publish(messages.diagnostics(self._messages, stamp, self.get_name(), report))
        if report.verdict == self._verdict:
            return
        self._verdict = report.verdict
        # A place in the code logs at one level: rclpy refuses another.
        if report.level == health.OK:
            self.get_logger().info(report.message, throttle_duration_sec=10.0)
        elif report.level == health.WARN:
            self.get_logger().warning(report.message, throttle_duration_sec=10.0)
        else:
            self.get_logger().error(report.message, throttle_duration_sec=10.0)


def main(args: list[str] | None = None) -> int:
    """Runs the node until it is stopped; returns the exit code, 2 for parameters that do not fit."""
    rclpy.init(args=args)
    try:
        node = SpinNode()
    except (ValueError, OSError, ParameterException) as error:
        get_logger("spindoe").fatal(str(error))
        rclpy.shutdown()
        return 2
    logger = node.get_logger()
    # What the library warns of is said where ROS looks for it.
    warnings.showwarning = lambda message, *_args, **_words: logger.warning(str(message))
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        # Whoever stopped it from outside has shut it down.
        if rclpy.ok():
            rclpy.shutdown()
    return 0
