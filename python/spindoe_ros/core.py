"""What the node does, without ROS: image and camera messages in, orientation and spin out.

Frames: by default the axes of an optical frame (REP 103: x right, y down, z forward). With intrinsics answers are in the frame
of the images' ``frame_id``. Without them they are in the view frame, whose z goes through the ball: another frame for every
place of the ball, which `frame_id_of` names as such. Quaternions leave as ROS orders them, x, y, z, w.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import spindoe
from spindoe import _palette
from spindoe._draw import discs, ring
from spindoe._image import Color, rgb8
from spindoe._native import read_image
from spindoe._pattern import as_table

# encoding: (type, channels in memory, color)
ENCODINGS: dict[str, tuple[str, int, Color]] = {
    "mono8": ("u1", 1, "gray"),
    "8UC1": ("u1", 1, "gray"),
    "mono16": ("u2", 1, "gray"),
    "16UC1": ("u2", 1, "gray"),
    "rgb8": ("u1", 3, "rgb"),
    "rgba8": ("u1", 4, "rgba"),
    "bgr8": ("u1", 3, "bgr"),
    "bgra8": ("u1", 4, "bgra"),
    "rgb16": ("u2", 3, "rgb"),
    "bgr16": ("u2", 3, "bgr"),
}
# encoding: (type, colors of the first two rows' first two pixels)
MOSAICS: dict[str, tuple[str, str]] = {
    f"bayer_{colors}{bits}": (kind, colors)
    for colors in ("rggb", "bggr", "gbrg", "grbg")
    for bits, kind in ((8, "u1"), (16, "u2"))
}
# Variance of what is not measured: m^2, (m/s)^2.
UNKNOWN = 1e6
# What a view frame's name adds to that of the camera's frame.
VIEW = "_view"


@dataclass(frozen=True)
class Settings:
    """The node's parameters."""

    table: str
    """The pattern's table, ``.npz``, or the pattern, ``.csv``."""
    frame: Literal["optical", "camera"] = "optical"
    intrinsics: tuple[float, ...] | None = None
    """``fx, fy, cx, cy`` in pixels, and OpenCV's distortion; they go before those of a ``CameraInfo``. Without either the ball's
    position is not known."""
    rectified: bool = False
    """Whether the images are rectified: then the projection matrix of a ``CameraInfo`` counts, without distortion."""
    ball_radius_m: float = 0.02
    min_confidence: float = spindoe.MIN_CONFIDENCE_IMAGES
    window: int = 12
    memory_s: float = 0.25
    max_rps: float = 175.0


@dataclass(frozen=True)
class Answer:
    """What is published after an image."""

    pose: spindoe.Pose | spindoe.Rejection
    """In the axes of the settings."""
    spin: spindoe.Spin | spindoe.Rejection
    position_m: NDArray[np.float64] | None
    """Ball's center, m, in the axes of the settings, also where the orientation is rejected; None without intrinsics, or without
    an outline."""
    axes: Literal["optical", "camera"]
    """Those of the settings."""
    frame: spindoe.FrameEstimate
    """All that was seen."""
    image: NDArray[Any]
    """The image, shape (height, width) or (height, width, channels), 8 or 16 bits."""
    color: Color
    """The order of its channels."""

    @property
    def reason(self) -> str:
        """Why something is missing."""
        return "; ".join(missing.reason for missing in (self.pose, self.spin) if not missing)

    def frame_id_of(self, camera: str, found: spindoe.Pose | spindoe.Spin) -> str:
        """The name of the frame of a pose or spin, by that of the camera."""
        return camera + VIEW if "view" in found.frame else camera

    def position(self) -> NDArray[np.float64]:
        """The ball's center, NaN where it is not measured."""
        return np.full(3, np.nan) if self.position_m is None else self.position_m

    def pose_covariance(self) -> NDArray[np.float64]:
        """Row-major 6 x 6 of ``PoseWithCovariance``: position first; about fixed axes."""
        if self.pose and self.position_m is not None:
            return self.frame.joint_covariance(self.axes).ravel()
        covariance = np.diag([UNKNOWN] * 6)
        if self.pose:
            covariance[3:, 3:] = self.pose.covariance
        return covariance.ravel()

    def overlay(self) -> NDArray[np.uint8]:
        """The image with the ball's outline and the detected dots drawn onto it; rgb, shape (height, width, 3)."""
        drawn = rgb8(self.image, self.color)
        if self.frame.circle is None:
            return drawn
        ring(drawn, self.frame.circle, _palette.OUTLINE)
        is_matched = self.frame.assignment >= 0
        radius = max(1.0, 0.03 * self.frame.circle[2])
        discs(drawn, self.frame.dots[~is_matched, :2], radius, _palette.OTHER)
        discs(drawn, self.frame.dots[is_matched, :2], radius, _palette.IDENTIFIED)
        return drawn

    def twist_covariance(self) -> NDArray[np.float64]:
        """Row-major 6 x 6 of ``TwistWithCovariance``: linear first, which is unknown."""
        covariance = np.diag([UNKNOWN] * 6)
        if self.spin and self.spin.covariance is not None:
            covariance[3:, 3:] = self.spin.covariance
        return covariance.ravel()


def camera_of(message: Any, rectified: bool = False) -> spindoe.Camera | None:
    """The camera of a ``sensor_msgs/CameraInfo``, for images of its binning and region of interest; None where it is not
    calibrated (``K[0] = 0``).

    Raises:
        ValueError: For a distortion model or a matrix that is not known.
    """
    k = np.array(message.k, dtype=np.float64).reshape(3, 3)
    if k[0, 0] == 0.0:
        return None
    model = message.distortion_model
    distortion = np.array(message.d, dtype=np.float64)
    if rectified:
        k = np.array(message.p, dtype=np.float64).reshape(3, 4)[:, :3]
        model, distortion = "plumb_bob", np.zeros(0)
    if model not in ("", "plumb_bob", "rational_polynomial", "equidistant"):
        raise ValueError(
            f"distortion_model: expected plumb_bob, rational_polynomial or equidistant, found {model!r}"
        )
    corner = np.array([message.roi.x_offset, message.roi.y_offset], dtype=np.float64)
    binning = np.array([max(message.binning_x, 1), max(message.binning_y, 1)], dtype=np.float64)
    k[:2, 2] -= corner
    # As image_geometry has it: in the pixels of the whole sensor.
    k[:2] /= binning[:, None]
    return spindoe.Camera(k, distortion if distortion.size else None, fisheye=model == "equidistant")


def image_of(message: Any) -> tuple[NDArray[Any], Color]:
    """The pixels of a ``sensor_msgs/Image``, where they lie, or of a ``sensor_msgs/CompressedImage``, and the order of their
    channels. Bayer mosaics are made color images.

    Raises:
        ValueError: For an encoding or a format that has no pixels, too few bytes, or bytes that cannot be decoded.
    """
    if hasattr(message, "format"):
        return _decoded(message)
    if message.encoding in MOSAICS:
        kind, colors = MOSAICS[message.encoding]
        return demosaic(_rows(message, kind, 1)[..., 0], colors), "rgb"
    if message.encoding not in ENCODINGS:
        known = ", ".join([*ENCODINGS, *MOSAICS])
        raise ValueError(f"encoding: expected one of {known}, found {message.encoding!r}")
    kind, channels, color = ENCODINGS[message.encoding]
    pixels = _rows(message, kind, channels)
    return (pixels[..., 0] if color == "gray" else pixels), color


def _rows(message: Any, kind: str, channels: int) -> NDArray[Any]:
    """The numbers of an ``Image``, without the padding of its rows; shape (height, width, channels)."""
    order = ">" if message.is_bigendian and kind == "u2" else "<"
    dtype = np.dtype(order + kind)
    data = np.frombuffer(message.data, dtype=np.uint8)
    size, used = message.height * message.step, message.width * channels * dtype.itemsize
    if len(data) < size or message.step < used:
        raise ValueError(
            f"data: expected {message.height} rows of {used} bytes or more, found {len(data)} bytes in rows of {message.step}"
        )
    rows = np.ascontiguousarray(data[:size].reshape(message.height, message.step)[:, :used])
    pixels = rows.view(dtype).reshape(message.height, message.width, channels)
    return pixels.astype(dtype.newbyteorder("="), copy=False)


def _decoded(message: Any) -> tuple[NDArray[Any], Color]:
    """The pixels of a ``CompressedImage``. Its format reads ``bgr8; jpeg compressed bgr8``, the encoding at the camera, the codec
    and the encoding of what is compressed; or names the codec alone."""
    if "compressedDepth" in message.format:
        raise ValueError(f"format: expected an image, found {message.format!r}")
    pixels = read_image("data", bytes(message.data))
    compressed = message.format.split()[-1:]
    if compressed and compressed[0] in MOSAICS:
        return demosaic(pixels[..., 0], MOSAICS[compressed[0]][1]), "rgb"
    return pixels, "rgb"


def demosaic(mosaic: NDArray[Any], colors: str) -> NDArray[Any]:
    """The color image of a Bayer mosaic, bilinear: what a pixel lacks is the mean of its nearest neighbors that have it.

    Args:
        mosaic: Shape (height, width), each at least 2; whole numbers of 8 or 16 bits.
        colors: Those of the first two rows' first two pixels, row by row: ``"rggb"``, ...

    Returns:
        Shape (height, width, 3), rgb, of the same type.
    """
    if min(mosaic.shape) < 2:
        raise ValueError(f"image: expected a mosaic of at least 2 x 2 pixels, found {mosaic.shape}")
    # Mirrored about the outer pixels, the mosaic goes on as it is.
    wide = np.pad(mosaic.astype(np.uint32), 1, mode="reflect")
    image: NDArray[Any] = np.empty((*mosaic.shape, 3), dtype=mosaic.dtype)
    for channel, color in enumerate("rgb"):
        only = np.zeros_like(wide)
        for place in (k for k in range(4) if colors[k] == color):
            own = np.s_[(place // 2 + 1) % 2 :: 2, (place % 2 + 1) % 2 :: 2]
            only[own] = wide[own]
        total = 4 * only[1:-1, 1:-1]
        beside = only[:-2, 1:-1] + only[2:, 1:-1] + only[1:-1, :-2] + only[1:-1, 2:]
        if color == "g":
            total += beside
        else:
            total += 2 * beside + only[:-2, :-2] + only[:-2, 2:] + only[2:, :-2] + only[2:, 2:]
        image[..., channel] = (total + 2) >> 2
    return image


def seconds(stamp: Any) -> float:
    """A time stamp in seconds; a float holds them to a quarter of a microsecond."""
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


class SpinCore:
    """Follows one ball through the images of a topic."""

    def __init__(self, settings: Settings) -> None:
        if settings.frame not in ("optical", "camera"):
            raise ValueError(f"frame: expected optical or camera, found {settings.frame!r}")
        self.settings = settings
        # Once: every camera has an estimator of its own.
        self._table = as_table(settings.table)
        k = settings.intrinsics
        if k is None:
            self._begin(spindoe.Camera())
        else:
            fx, fy, cx, cy, *distortion = k
            matrix = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
            self._begin(spindoe.Camera(matrix, distortion or None))

    def _begin(self, camera: spindoe.Camera) -> None:
        """A new beginning with this camera."""
        settings = self.settings
        self.camera = camera
        estimator = spindoe.Estimator(
            self._table, camera=camera, min_confidence=settings.min_confidence, ball_radius_m=settings.ball_radius_m
        )
        self.tracker = estimator.tracker(
            window=settings.window, memory_s=settings.memory_s, max_rps=settings.max_rps
        )
        self._last_s: float | None = None

    def on_camera_info(self, message: Any) -> bool:
        """Takes a ``CameraInfo``, unless the settings have intrinsics; whether the camera is another one now.

        Raises:
            ValueError: As `camera_of`.
        """
        if self.settings.intrinsics is not None:
            return False
        camera = camera_of(message, self.settings.rectified)
        if camera is None or camera == self.camera:
            return False
        self._begin(camera)
        return True

    def on_image(self, message: Any) -> Answer:
        """Takes the next image, a ``sensor_msgs/Image`` or ``CompressedImage``. A stamp that goes back, as when a bag starts again, is a new beginning."""
        image, color = image_of(message)
        time_s = seconds(message.header.stamp)
        if self._last_s is not None and time_s <= self._last_s:
            self.tracker.reset()
        self._last_s = time_s
        state = self.tracker.update(image, time_s, color=color)
        pose, spin, axes = state.frame.pose, state.spin, self.settings.frame
        pose = pose.as_frame(axes) if pose else pose
        spin = spin.as_frame(axes) if spin else spin
        signs = [1.0, -1.0, -1.0] if axes == "optical" else [1.0, 1.0, 1.0]
        center = state.frame.position_m
        position = None if center is None else np.asarray(center * signs, dtype=np.float64)
        return Answer(pose, spin, position, axes, state.frame, image, color)
