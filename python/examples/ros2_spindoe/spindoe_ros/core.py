"""What the node does, without ROS: image messages in, orientation and spin out.

Frames: by default the camera's optical frame (REP 103: x right, y down, z forward), as the messages'
``frame_id`` should say. Quaternions leave as ROS orders them, x, y, z, w.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import spindoe

# encoding: (type, channels in memory, color)
ENCODINGS: dict[str, tuple[str, int, Literal["gray", "rgb", "bgr"]]] = {
    "mono8": ("u1", 1, "gray"),
    "8UC1": ("u1", 1, "gray"),
    "mono16": ("u2", 1, "gray"),
    "16UC1": ("u2", 1, "gray"),
    "rgb8": ("u1", 3, "rgb"),
    "rgba8": ("u1", 4, "rgb"),
    "bgr8": ("u1", 3, "bgr"),
    "bgra8": ("u1", 4, "bgr"),
}
# From the frame of `spindoe` (x right, y up, z towards the camera) to the optical one.
OPTICAL = np.diag([1.0, -1.0, -1.0])
# Variance of what a spin says nothing about, (m/s)^2.
UNKNOWN = 1e6


@dataclass(frozen=True)
class Settings:
    """The node's parameters."""

    table: str
    """The pattern's table, ``.npz``, or the pattern, ``.csv``."""
    frame: Literal["optical", "camera"] = "optical"
    intrinsics: tuple[float, float, float, float] | None = None
    """Focal lengths and principal point ``fx, fy, cx, cy``, pixels; without them the ball's position is
    not known, and is published as the origin."""
    ball_radius_m: float = 0.02
    min_confidence: float = spindoe.MIN_CONFIDENCE_IMAGES
    window: int = 12
    memory_s: float = 0.25
    max_rps: float = 175.0


@dataclass(frozen=True)
class Answer:
    """What is published after an image."""

    position_m: NDArray[np.float64] | None
    """Ball's center; None without intrinsics."""
    quaternion_xyzw: NDArray[np.float64] | None
    """Pattern to frame; None where the image has no answer."""
    confidence: float
    spin_rad_s: NDArray[np.float64] | None
    """None where no spin is known."""
    spin_covariance: NDArray[np.float64] | None
    reason: str
    """Why something is missing."""

    def twist_covariance(self) -> NDArray[np.float64]:
        """Row-major 6 x 6 of ``TwistWithCovariance``: linear first, which is unknown."""
        covariance = np.diag([UNKNOWN] * 6)
        if self.spin_covariance is not None:
            covariance[3:, 3:] = self.spin_covariance
        return covariance.ravel()


def image_of(message: Any) -> tuple[NDArray[Any], Literal["gray", "rgb", "bgr"]]:
    """The pixels of a ``sensor_msgs/Image``, where they lie.

    Raises:
        ValueError: For an encoding that has no pixels, or too few bytes.
    """
    if message.encoding not in ENCODINGS:
        known = ", ".join(ENCODINGS)
        raise ValueError(f"encoding: expected one of {known}, found {message.encoding!r}")
    kind, channels, color = ENCODINGS[message.encoding]
    order = ">" if message.is_bigendian and kind == "u2" else "<"
    dtype = np.dtype(order + kind)
    data = np.frombuffer(message.data, dtype=np.uint8)
    rows = data[: message.height * message.step].reshape(message.height, message.step)
    used = np.ascontiguousarray(rows[:, : message.width * channels * dtype.itemsize])
    pixels = used.view(dtype).reshape(message.height, message.width, channels)
    native = pixels.astype(dtype.newbyteorder("="), copy=False)
    return (native[..., 0] if color == "gray" else native[..., :3]), color


def seconds(stamp: Any) -> float:
    """A time stamp in seconds; a float holds them to a quarter of a microsecond."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


class SpinCore:
    """Follows one ball through the images of a topic."""

    def __init__(self, settings: Settings) -> None:
        if settings.frame not in ("optical", "camera"):
            raise ValueError(f"frame: expected optical or camera, found {settings.frame!r}")
        self.settings = settings
        k = settings.intrinsics
        self.camera = spindoe.Camera() if k is None else spindoe.Camera.pinhole(*k)
        estimator = spindoe.Estimator(
            settings.table, camera=self.camera, min_confidence=settings.min_confidence
        )
        self.tracker = estimator.tracker(
            window=settings.window, memory_s=settings.memory_s, max_rps=settings.max_rps
        )
        self._turn = OPTICAL if settings.frame == "optical" else np.eye(3)
        self._last_s: float | None = None

    def on_image(self, message: Any) -> Answer:
        """Takes the next image. A stamp that goes back, as when a bag starts again, is a new beginning."""
        time_s = seconds(message.header.stamp)
        if self._last_s is not None and time_s <= self._last_s:
            self.tracker.reset()
        self._last_s = time_s
        image, color = image_of(message)
        state = self.tracker.update(image, time_s, color=color)
        pose, spin = state.frame.pose, state.spin
        reasons = [missing.reason for missing in (pose, spin) if not missing]
        vector = covariance = None
        if spin:
            vector = self._turn @ spin.spin_rad_s
            if spin.covariance is not None:
                covariance = self._turn @ spin.covariance @ self._turn.T
        return Answer(
            self._position(state.frame.circle),
            self._quaternion(pose) if pose else None,
            pose.confidence if pose else 0.0,
            vector,
            covariance,
            "; ".join(reasons),
        )

    def _quaternion(self, pose: spindoe.Pose) -> NDArray[np.float64]:
        rotation = Rotation.from_matrix(self._turn) * pose.as_rotation()
        return np.asarray(rotation.as_quat(), dtype=np.float64)

    def _position(self, circle: tuple[float, float, float] | None) -> NDArray[np.float64] | None:
        """The ball's center by its size in the image."""
        if circle is None or self.settings.intrinsics is None:
            return None
        view = self.camera.view(circle)
        away = -view.as_rotation().apply([0.0, 0.0, 1.0])
        return np.asarray(
            self._turn @ away * self.settings.ball_radius_m / view.horizon, dtype=np.float64
        )
