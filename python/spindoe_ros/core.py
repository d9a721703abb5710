"""What the node does, without ROS: image and camera messages in, orientation and spin out.

Frames: the axes of an optical frame (REP 103: x right, y down, z forward). With intrinsics answers are in the frame of the images'
``frame_id``. Without them they are in the view frame, whose z goes through the ball: another frame for every place of the ball,
which `Answer.frame_id_of` names as such. Quaternions leave as ROS orders them, x, y, z, w.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

import spindoe
from spindoe import _palette
from spindoe._draw import discs, ring
from spindoe._image import Color, rgb8
from spindoe._pattern import HashTable, as_table

from .images import image_of

# Variance of what is not measured: m^2, (m/s)^2.
UNKNOWN = 1e6
# What a view frame's name adds to that of the camera's frame.
VIEW = "_view"


def _setting(default: Any, description: str, low: float | None = None, high: float | None = None) -> Any:
    return field(default=default, metadata={"description": description, "range": None if low is None else (low, high)})


@dataclass(frozen=True)
class Settings:
    """What a user decides: the node declares each as a parameter, with its description and range.

    Raises:
        ValueError: For a number out of its range.
    """

    table: str = _setting("", "the pattern's table, .npz, or the pattern, .csv")
    """The pattern's table, ``.npz``, or the pattern, ``.csv``."""
    intrinsics: tuple[float, ...] = _setting(
        (0.0, 0.0, 0.0, 0.0), "fx, fy, cx, cy in pixels, and OpenCV's distortion; zeros: those of camera_info"
    )
    """``fx, fy, cx, cy`` in pixels, and OpenCV's distortion; they go before those of a ``CameraInfo``, which zeros leave it to.
    Without either the ball's position is not known."""
    bright_dots: bool = _setting(False, "a dark ball with bright dots: images are estimated as negatives")
    rectified: bool = _setting(False, "whether the images are rectified: then the matrix p of camera_info counts")
    """Whether the images are rectified: then the projection matrix of a ``CameraInfo`` counts, without distortion."""
    ball_radius_m: float = _setting(0.02, "radius of the ball, m", 0.0005, 0.5)
    min_confidence: float = _setting(
        spindoe.MIN_CONFIDENCE_IMAGES, "minimum probability that a published pose is correct", 0.0, 1.0
    )
    window: int = _setting(12, "number of poses that the spin is fitted to", 3, 1000)
    memory_s: float = _setting(0.25, "age at which poses are forgotten, s", 0.001, 60.0)
    max_rps: float = _setting(175.0, "largest spin considered, revolutions per second", 0.1, 1000.0)

    def __post_init__(self) -> None:
        for setting in fields(self):
            if limits := setting.metadata["range"]:
                (low, high), value = limits, getattr(self, setting.name)
                # NaN is in no range.
                if not low <= value <= high:
                    raise ValueError(f"{setting.name}: expected {low:g} to {high:g}, found {value!r}")

    def camera(self) -> spindoe.Camera | None:
        """The camera of the intrinsics; None where they are zeros.

        Raises:
            ValueError: For other than intrinsics.
        """
        if not any(self.intrinsics):
            return None
        if len(self.intrinsics) < 4:
            raise ValueError(f"intrinsics: expected fx, fy, cx, cy and the distortion, found {list(self.intrinsics)}")
        fx, fy, cx, cy, *distortion = self.intrinsics
        try:
            return spindoe.Camera([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]], distortion or None)
        except ValueError as error:
            raise ValueError(f"intrinsics: {error}") from error


@dataclass(frozen=True)
class Answer:
    """What is published after an image."""

    stamp: Any
    """The image's time, a ``builtin_interfaces/Time``."""
    frame_id: str
    """The camera's frame."""
    pose: spindoe.Pose | spindoe.Rejection
    """In optical axes, as are all that follow."""
    spin: spindoe.Spin | spindoe.Rejection
    position_m: NDArray[np.float64] | None
    """Ball's center, m, also where the orientation is rejected; None without intrinsics, or without an outline."""
    frame: spindoe.FrameEstimate
    """All that was seen."""
    image: NDArray[Any]
    """The image, shape (height, width) or (height, width, channels), 8 or 16 bits."""
    color: Color
    """The order of its channels."""
    note: str
    """Whether its time went back."""

    @property
    def reason(self) -> str:
        """Why something is missing."""
        return "; ".join(missing.reason for missing in (self.pose, self.spin) if not missing)

    def frame_id_of(self, found: spindoe.Pose | spindoe.Spin) -> str:
        """The name of the frame of a pose or spin: that of the camera, or one made of it."""
        return self.frame_id + VIEW if "view" in found.frame else self.frame_id

    def position(self) -> NDArray[np.float64]:
        """The ball's center, NaN where it is not measured."""
        return np.full(3, np.nan) if self.position_m is None else self.position_m

    def pose_covariance(self) -> NDArray[np.float64]:
        """Row-major 6 x 6 of ``PoseWithCovariance``: position first; about fixed axes."""
        if self.pose and self.position_m is not None:
            return self.frame.joint_covariance("optical").ravel()
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
    roi = message.roi
    binning = np.array([max(message.binning_x, 1), max(message.binning_y, 1)])
    k[:2, 2] -= [roi.x_offset, roi.y_offset]
    # As image_geometry has it: in the pixels of the whole sensor.
    k[:2] /= binning[:, None]
    # A region of no size is the whole sensor.
    width, height = np.array([roi.width or message.width, roi.height or message.height]) // binning
    size = (int(width), int(height)) if width and height else None
    return spindoe.Camera(k, distortion if distortion.size else None, fisheye=model == "equidistant", size=size)


def nanoseconds(stamp: Any) -> int:
    """A time stamp as a whole number."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


class SpinCore:
    """Follows one ball through the images of a topic.

    Raises:
        ValueError: For settings that do not fit.
        OSError: For a table that cannot be read.
    """

    def __init__(self, settings: Settings, *, table: HashTable | None = None) -> None:
        if not settings.table:
            raise ValueError("table: expected the path of a table, .npz, or of a pattern, .csv")
        self.settings = settings
        # Once: every camera has an estimator of its own.
        self._table = as_table(settings.table) if table is None else table
        self._info: Any = None
        self.camera_missing = "no camera_info has come"
        """Why no intrinsics are known; only where none are."""
        self._begin(settings.camera() or spindoe.Camera())

    def with_settings(self, settings: Settings) -> SpinCore:
        """A new beginning with other settings, and what camera_info said.

        Raises:
            ValueError, OSError: As the constructor.
        """
        core = SpinCore(settings, table=self._table if settings.table == self.settings.table else None)
        if self._info is not None:
            # What is wrong with it is said in `camera_missing`, and is none of the settings' fault.
            with suppress(ValueError):
                core.on_camera_info(self._info)
        return core

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
        self._first_ns: int | None = None
        self._last_ns = 0

    def on_camera_info(self, message: Any) -> bool:
        """Takes a ``CameraInfo``, unless the settings have intrinsics; whether the camera is another one now.

        Raises:
            ValueError: As `camera_of`.
        """
        self._info = message
        if any(self.settings.intrinsics):
            return False
        try:
            camera = camera_of(message, self.settings.rectified)
        except ValueError as error:
            self.camera_missing = f"camera_info: {error}"
            raise
        if camera is None:
            self.camera_missing = "camera_info has none, k is 0: calibrate the camera"
        if camera is None or camera == self.camera:
            return False
        self._begin(camera)
        return True

    def on_image(self, message: Any) -> Answer:
        """Takes the next image, a ``sensor_msgs/Image`` or ``CompressedImage``. A stamp that goes back, as when a bag starts
        again, is a new beginning.

        Raises:
            ValueError: As `image_of`; for an image of another size than the camera's, and for one at the time of the last.
        """
        image, color = image_of(message)
        height, width = image.shape[:2]
        if self.camera.size not in (None, (width, height)):
            expected = " x ".join(map(str, self.camera.size or ()))
            raise ValueError(
                f"image: expected {expected} pixels, of which camera_info is by its size, roi and binning, found {width} x {height}"
            )
        time_s, note = self._time_of(message.header.stamp)
        # What is kept to be shown is the camera's picture.
        seen = np.invert(image) if self.settings.bright_dots else image
        state = self.tracker.update(seen, time_s, color=color)
        pose, spin = state.frame.pose, state.spin
        pose = pose.as_frame("optical") if pose else pose
        spin = spin.as_frame("optical") if spin else spin
        center = state.frame.position_m
        position = None if center is None else np.asarray(center * [1.0, -1.0, -1.0], dtype=np.float64)
        frame_id = message.header.frame_id or (self._info.header.frame_id if self._info is not None else "")
        return Answer(
            message.header.stamp, frame_id, pose, spin, position, state.frame, image, color, note
        )

    def _time_of(self, stamp: Any) -> tuple[float, str]:
        """The time since the beginning, which a float holds to the nanosecond; and whether it went back."""
        now, note = nanoseconds(stamp), ""
        if self._first_ns is not None and now == self._last_ns:
            raise ValueError(
                f"header.stamp: expected one after that of the last image, found the same, {stamp.sec}.{stamp.nanosec:09d}"
            )
        if self._first_ns is not None and now < self._last_ns:
            note = f"stamps went back by {1e-9 * (self._last_ns - now):.3f} s, to a new beginning"
            self.tracker.reset()
            self._first_ns = None
        if self._first_ns is None:
            self._first_ns = now
        self._last_ns = now
        return 1e-9 * (now - self._first_ns), note
