"""From images to orientations."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NoReturn, TypedDict, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._calibrate import Calibration, calibration_of
from ._common import (
    Axes,
    Floats,
    Frame,
    Ints,
    Progress,
    Rejection,
    floats,
    progress_of,
    rotation_matrix,
    settings_json,
    to_scipy,
    triple,
)
from ._image import Color, Image, frames_of, pixels
from ._pattern import HashTable, PathLike, Tabled, as_table
from ._recognize import Hint
from ._spin import Spin, spin_of

if TYPE_CHECKING:
    from ._sequence import SequenceEstimate
    import matplotlib.axes
    from scipy.spatial.transform import Rotation
    from typing_extensions import Unpack


@dataclass(frozen=True, slots=True, init=False)
class Camera:
    """What is known of the camera. Pixels: u right, v down, (0, 0) the center of the top-left one.

    ``Camera(K, dist)`` is one with intrinsics, as OpenCV and ROS have them; `read` takes them from a file. ``Camera()`` is one
    of which nothing is known.

    Args:
        matrix: The intrinsic matrix, rows ``fx s cx``, ``0 fy cy``, ``0 0 1``.
        distortion: OpenCV's coefficients: k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4]]]; of a fisheye k1 to k4.
        fisheye: Whether they are those of OpenCV's ``fisheye`` module, ROS' ``equidistant``.
    """

    kind: Literal["unknown", "parallel", "distance", "pinhole", "fisheye"]
    numbers: tuple[float, ...]
    """Of intrinsics fx, fy, cx, cy, skew, and the distortion."""

    def __init__(
        self, matrix: ArrayLike | None = None, distortion: ArrayLike | None = None, *, fisheye: bool = False
    ) -> None:
        if matrix is None:
            if distortion is not None:
                raise ValueError("distortion: expected the matrix with it")
            self._set("unknown", (0.07, 0.05))
            return
        k = floats("matrix", matrix)
        if k.shape != (3, 3):
            raise ValueError(f"matrix: expected shape (3, 3), found {k.shape}")
        if distortion is not None:
            coefficients = floats("distortion", distortion).ravel().tolist()
        else:
            coefficients = [0.0] * 4 if fisheye else []
        kind, numbers = _native.intrinsics_of(k.tolist(), coefficients, fisheye)
        self._set(kind, tuple(numbers))

    def _set(self, kind: str, numbers: tuple[float, ...]) -> None:
        object.__setattr__(self, "kind", kind)
        object.__setattr__(self, "numbers", numbers)

    @classmethod
    def _of(cls, kind: str, *numbers: float) -> Camera:
        camera = cls.__new__(cls)
        camera._set(kind, tuple(float(x) for x in numbers))
        return camera

    @classmethod
    def unknown(cls, inverse_distance: float = 0.07, sigma: float = 0.05) -> Camera:
        """Neither intrinsics nor distance: that is estimated, from this expectation of the ball radii
        over the camera's distance, and its standard deviation."""
        return cls._of("unknown", inverse_distance, sigma)

    @classmethod
    def parallel(cls) -> Camera:
        """Parallel rays: for a ball that is small compared with its distance."""
        return cls._of("parallel")

    @classmethod
    def at_distance(cls, radii: float) -> Camera:
        """From a known distance to the ball's center, in ball radii."""
        return cls._of("distance", radii)

    @classmethod
    def pinhole(cls, fx: float, fy: float, cx: float, cy: float) -> Camera:
        """Known focal lengths and principal point, pixels, without distortion."""
        return cls._of("pinhole", fx, fy, cx, cy, 0.0)

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Camera:
        """The camera of an intrinsic matrix of shape (3, 3) without distortion: ``Camera(matrix)``."""
        return cls(matrix)

    @classmethod
    def read(cls, path: PathLike) -> Camera:
        """The intrinsics of a file: OpenCV's YAML or JSON, or ROS' camera_info."""
        kind, numbers = _native.read_intrinsics(os.fspath(path))
        return cls._of(kind, *numbers)

    @property
    def has_intrinsics(self) -> bool:
        """Whether its intrinsics are known: then orientations are in its frame, and balls have a position."""
        return self.kind in ("pinhole", "fisheye")

    def project(self, points: ArrayLike) -> Floats:
        """Pixels ``u, v``, shape (n, 2), of points in OpenCV's frame (x right, y down, z forward), shape (n, 3), with the
        distortion: ``cv2.projectPoints`` without a pose."""
        optical = floats("points", points)
        return _native.project_points(self._given(), optical * [1.0, -1.0, -1.0])

    def view(self, circle: ArrayLike) -> BallView:
        """The view of a ball whose outline is the circle ``u, v, radius``, pixels."""
        return BallView(self, circle)

    def _given(self) -> tuple[str, list[float]]:
        return self.kind, list(self.numbers)


class BallView:
    """A ball in an image: from pixels to directions from its center, and back.

    Args:
        camera: A camera that is not unknown.
        circle: The ball's outline ``u, v, radius``, pixels.
    """

    __slots__ = ("_handle", "camera", "circle")
    _handle: _native.BallView
    camera: Camera
    circle: tuple[float, float, float]

    def __init__(self, camera: Camera, circle: ArrayLike) -> None:
        self.camera = camera
        self.circle = triple("circle", circle)
        self._handle = _native.BallView(camera._given(), self.circle)

    def project(self, directions: ArrayLike) -> Floats:
        """Pixels ``u, v``, shape (n, 2), of directions in the camera frame, shape (n, 3), seen or not."""
        return self._handle.project(floats("directions", directions))

    def back_project(
        self, pixels: ArrayLike, sigma_px: float | None = None, covariances: ArrayLike | None = None
    ) -> tuple[Floats, Floats]:
        """Directions, shape (n, 3), with their covariances, shape (n, 3, 3), camera frame: what
        `Recognizer.identify` takes. NaN for pixels outside the ball.

        Args:
            pixels: Shape (n, 2).
            sigma_px: Their standard deviation per axis, pixels; 1 where nothing is given.
            covariances: Or their covariances, px^2, shape (n, 2, 2).
        """
        points = floats("pixels", pixels)
        if covariances is None:
            variance = (1.0 if sigma_px is None else float(sigma_px)) ** 2
            blocks = np.broadcast_to(np.eye(2) * variance, (len(points), 2, 2))
        elif sigma_px is not None:
            raise ValueError("covariances: expected them or sigma_px, found both")
        else:
            blocks = floats("covariances", covariances)
        return self._handle.back_project(points, blocks)

    @property
    def horizon(self) -> float:
        """Minimum z, towards the camera, of a point in sight."""
        return self._handle.horizon()

    def as_rotation(self) -> Rotation:
        """From the frame whose z points at the camera to the camera's frame."""
        return to_scipy(self._handle.to_camera())

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return BallView, (self.camera, self.circle)


@dataclass(slots=True, eq=False, repr=False)
class Pose:
    """An orientation from an image. True where a truth value is wanted."""

    quaternion_wxyz: Floats
    """Pattern to camera, scalar first, w >= 0; shape (4,); in `frame`."""
    covariance: Floats
    """Covariance of the small rotation vector, in `frame`, that leads to the true orientation, rad^2; shape (3, 3)."""
    dots_confidence: float
    """Probability that every dot is identified correctly."""
    confidence: float
    """Probability that the orientation is correct."""
    residual_rad: float
    """Root mean square angle between the matched dots and the rotated pattern, radians."""
    residual_px: float
    """The same in the image, pixels."""
    distance: tuple[float, float] | None
    """Ball radii over the camera's distance with its standard deviation (0 where it was given); None where the camera's intrinsics are known."""
    hinted: bool
    """Whether a hint decided: the dots alone gave no orientation, or another one."""

    frame: Frame = "camera"
    """The frame of the orientation: the camera's, or without intrinsics the view frame, whose z points from this ball to
    the camera. `as_frame` gives the pose in other axes."""

    def as_frame(self, frame: Axes) -> Pose:
        """The same pose in other axes: x right, y up, z towards the camera for ``"camera"``; x right, y down, z forward (REP
        103) for ``"optical"``. One in the view frame stays in the view frame."""
        name, quaternion, _, covariance = _native.in_axes(
            self.frame, frame, self.quaternion_wxyz, [], self.covariance
        )
        return replace(
            self, quaternion_wxyz=quaternion, covariance=cast("Floats", covariance), frame=cast("Frame", name)
        )

    def as_rotation(self, frame: Axes | None = None) -> Rotation:
        """SciPy's rotation from the pattern; in the axes of `frame`, or in others as `as_frame`."""
        return to_scipy((self if frame is None else self.as_frame(frame)).quaternion_wxyz)

    def __bool__(self) -> Literal[True]:
        return True

    def __repr__(self) -> str:
        w, x, y, z = self.quaternion_wxyz
        return f"<Pose wxyz [{w:.4f} {x:.4f} {y:.4f} {z:.4f}] ({self.frame}), p = {self.confidence:.4f}>"


@dataclass(slots=True, eq=False, repr=False)
class FrameEstimate:
    """Everything seen in a frame."""

    circle: tuple[float, float, float] | None
    """The ball's outline ``u, v, radius``, pixels; None where there is no ball."""
    dots: Floats
    """Detections ``u, v, probability``, the likeliest first; shape (n, 3)."""
    dot_covariances: Floats
    """Their covariances, px^2; shape (n, 2, 2)."""
    assignment: Ints
    """For each detection the pattern's dot that it is, -1 for none; shape (n,)."""
    pose: Pose | Rejection
    """The orientation, or why there is none."""
    seconds: tuple[float, float, float]
    """Time of finding the ball, detecting the dots, and identifying them."""

    @property
    def matched(self) -> int:
        """Number of detections that are matched with a dot of the pattern."""
        return int(np.count_nonzero(self.assignment >= 0))

    def view(self, camera: Camera = Camera()) -> BallView:  # noqa: B008 (immutable)
        """The view of the ball in which its orientation is, for projections.

        Args:
            camera: The estimator's; without intrinsics the view has the distance that the pose was found at.

        Raises:
            ValueError: Where the frame has no orientation, or it is that of another camera.
        """
        if not self.pose or self.circle is None:
            raise ValueError("frame: expected one with an orientation")
        if camera.has_intrinsics != (self.pose.frame in ("camera", "optical")):
            known = "unknown" if camera.has_intrinsics else "known"
            raise ValueError(f"camera: expected the estimator's, whose intrinsics are {known}")
        if camera.has_intrinsics:
            return camera.view(self.circle)
        inverse = self.pose.distance[0] if self.pose.distance else 0.0
        return (Camera.at_distance(1.0 / inverse) if inverse > 0.0 else Camera.parallel()).view(self.circle)

    def expected_dots(
        self, table: Tabled, camera: Camera = Camera()  # noqa: B008 (immutable)
    ) -> tuple[Floats, NDArray[np.bool_]]:
        """Where the orientation expects the pattern's dots: pixels ``u, v``, shape (n, 2), and which of them face the
        camera, shape (n,).

        Without intrinsics the outline is taken for a circle: 30 degrees off the camera's axis, where it is an ellipse, dots
        are off by about a tenth of its radius.

        Args:
            table: The pattern, or its table.
            camera: As in `view`.
        """
        view = self.view(camera)
        pose = cast("Pose", self.pose).as_frame("camera")
        seen = as_table(table).pattern.dots @ rotation_matrix(pose.quaternion_wxyz).T
        towards = rotation_matrix(view._handle.to_camera())[:, 2]
        return view.project(seen), seen @ towards > view.horizon

    def plot(
        self,
        image: Image,
        *,
        table: Tabled,
        color: Color | None = None,
        ax: matplotlib.axes.Axes | None = None,
    ) -> matplotlib.axes.Axes:
        """Draws outline, detections and the identified pattern onto the image; see
        `spindoe.plot.frame`."""
        from . import plot

        return plot.frame(self, image, table=table, color=color, ax=ax)

    def _repr_html_(self) -> str:
        from . import _html

        return _html.frame(self)

    def __repr__(self) -> str:
        return f"<FrameEstimate: {self.matched} of {len(self.dots)} dots, {self.pose!r}>"


def frame_of(found: Any) -> FrameEstimate:
    """The native part's answer."""
    circle, dots, covariances, assignment, pose, seconds = found
    answer = Rejection(pose) if isinstance(pose, str) else Pose(*pose)
    return FrameEstimate(circle, dots, covariances, assignment, answer, seconds)


def _times(times_s: ArrayLike | None) -> list[float] | None:
    """Times as the library takes them; None where there are none."""
    if times_s is None:
        return None
    array = floats("times_s", times_s)
    if array.ndim != 1:
        raise ValueError(f"times_s: expected shape (n,), found {array.shape}")
    return [float(time) for time in array]


class CircleSettings(TypedDict):
    """What is accepted as a ball; all of it, where some is set."""

    min_radius_px: float
    """Minimum radius, pixels; 8."""
    max_radius: float
    """Largest radius as a multiple of the image's longer side; 0.75."""
    min_support: float
    """Minimum share of the rays within the image on which the outline's edge is seen; 0.6."""
    min_visible: float
    """Minimum share of the whole circle that lies within the image; 0.3."""
    min_contrast: float
    """Minimum difference in brightness across the outline, where the image's values span 0 to 1; 0.016."""
    rival_score: float
    """Another circle counts as a second ball where its score is this part of the best one's; 0.6."""


class EstimatorSettings(TypedDict, total=False):
    """What an estimator may have otherwise than usual."""

    min_confidence: float
    """Minimum probability of a pose that is accepted; ``MIN_CONFIDENCE_IMAGES``."""
    placement_sigma_rad: float
    """Standard deviation of a drawn dot's place from the pattern's, along one tangent axis, radians; 1.2 degrees."""
    max_blur: float
    """Width of the outline's edge, in radii, from which on a rejection is put down to blur; 0.6."""
    outline: Literal["net", "edges"]
    """How the outline is found: by its edges where they show it whole, else with a net; or by its edges alone."""
    circle: CircleSettings
    """What is accepted as a ball."""
    dot_probability: Sequence[float]
    """Minimum probability of the detections that are used first, and where these leave doubt; 0.5 and 0.15."""
    doubtful_false_dots: float
    """False dots expected beyond the recognizer's where doubtful detections are used; 1.5."""
    recognizer: dict[str, Any]
    """What is expected of the dots that are likely enough: all of ``settings["recognizer"]`` of an estimator."""
    trust: dict[str, Any]
    """From the recognizer's probability of a pose to the one that is reported: all of ``settings["trust"]``."""
    measures_blur: bool
    """Whether it is measured how the identified dots are blurred; false."""


class Estimator:
    """From images to orientations.

    Args:
        table: The table, a pattern, or the path of either. The dots of a calibrated table have their
            own covariances.
        camera: What is known of the camera; by default its distance is estimated with the orientation.
        detector: ``"cnn"``, the built-in net, or ``"blob"``.
        weights: Another net's weights, ``.npz``.
        settings: Any of `EstimatorSettings`.

    An image is an array of uint8 or uint16, or of floats from 0 to 1: shape (height, width) or (height, width, 1) for gray,
    (height, width, 3) for color, (height, width, 4) for color with alpha, which is left out. Arrays of whole numbers are read
    where they lie; views of larger images need no copy. An image is also one of Pillow, or the path of an image file: these
    say their channels themselves. An instance may be used from several threads.
    """

    __slots__ = ("_arguments", "_handle", "camera", "table")
    _handle: _native.Estimator
    table: HashTable
    """The table in use."""
    camera: Camera
    """What is known of the camera."""

    def __init__(
        self,
        table: Tabled,
        *,
        camera: Camera = Camera(),  # noqa: B008 (immutable)
        detector: Literal["cnn", "blob"] = "cnn",
        weights: PathLike | None = None,
        **settings: Unpack[EstimatorSettings],
    ) -> None:
        self.table = as_table(table)
        self.camera = camera
        self._arguments = (camera, detector, weights, settings)
        given = settings_json(settings)
        self._handle = _native.Estimator(
            self.table._handle, camera._given(), detector, weights, given
        )

    @property
    def settings(self) -> dict[str, Any]:
        """The settings in use."""
        settings: dict[str, Any] = json.loads(self._handle.settings())
        return settings

    def estimate(
        self,
        image: Image,
        *,
        color: Color | None = None,
        circle: ArrayLike | None = None,
        hint: Hint | None = None,
    ) -> FrameEstimate:
        """Estimates one frame.

        Args:
            image: The frame: a crop of the ball, or an image with the ball in it.
            color: Order of the channels, ``"rgb"``, ``"bgr"``, ``"rgba"`` or ``"bgra"``; needed for arrays that have them.
            circle: The ball's outline ``u, v, radius``, pixels, where it is known.
            hint: Prior orientation.

        Raises:
            ValueError: For another type or shape. What is seen, or not, is no error: see
                `FrameEstimate.pose`.
        """
        return frame_of(
            self._handle.estimate(
                *pixels("image", image, color),
                None if circle is None else triple("circle", circle),
                None if hint is None else hint._given(),
            )
        )

    def estimate_sequence(
        self,
        images: Sequence[Image] | NDArray[Any],
        times_s: ArrayLike | None = None,
        *,
        color: Color | None = None,
        circle: ArrayLike | None = None,
        independent: bool = False,
        max_rps: float = 175.0,
        progress: bool | Progress = False,
    ) -> SequenceEstimate:
        """Estimates the frames of one sequence on all cores; with times they help each other, and give
        the spin.

        Args:
            images: The frames: a sequence of images, or one array with the frames in front.
            times_s: Their times in seconds, increasing, shape (n,).
            color: As in `estimate`.
            circle: The ball's outline in all frames, where it is known.
            independent: Keep the frames from informing each other.
            max_rps: Largest spin considered, revolutions per second.
            progress: True shows a bar (with `tqdm`); a function is called with (done, total).
        """
        from ._sequence import SequenceEstimate

        frames, order = frames_of(images, color)
        times = _times(times_s)
        show, bar = progress_of(progress, len(frames), "frame")
        try:
            found, independently, rows, spin = self._handle.estimate_sequence(
                frames,
                order,
                times,
                None if circle is None else triple("circle", circle),
                independent,
                float(max_rps),
                show,
            )
        finally:
            if bar is not None:
                bar.close()
        answer = Rejection("there are no times, or only one") if spin is None else spin_of(spin)
        quaternions, covariances, turns, frame = rows
        return SequenceEstimate(
            [frame_of(f) for f in found],
            answer,
            independently,
            quaternions,
            covariances,
            turns,
            cast("Frame", frame),
            None if times is None else np.array(times),
        )

    def calibrate(
        self,
        images: Sequence[Image] | NDArray[Any] | PathLike,
        times_s: ArrayLike | None = None,
        *,
        fps: float | None = None,
        color: Color | None = None,
        circle: ArrayLike | None = None,
        placement_sigma_rad: float = math.radians(3.0),
        learn_extra: bool = False,
        smooth: bool = True,
        evaluate: int | None = None,
        seed: int = 0,
        progress: bool | Progress = False,
    ) -> Calibration | Rejection:
        """Measures the dots of a ball as they were really drawn, from a clip of it.

        Film the ball while you turn it slowly, once about one axis and once about another, so that
        every dot faces the camera for a while: 60 frames or more, sharp, with the ball 60 pixels wide
        or wider. The numbers are those of ``spindoe calibrate``.

        Args:
            images: The frames, as in `estimate_sequence`; or the path of a folder of images or a
                video, or several.
            times_s: Their times in seconds, increasing, shape (n,); for arrays.
            fps: Or frames per second. Files without it have the times of their names or their video.
            color: As in `estimate`; for arrays.
            circle: The ball's outline in all frames, where it is known.
            placement_sigma_rad: Expected error of a drawn dot per tangent axis, radians.
            learn_extra: Take steady marks that the pattern lacks into it.
            smooth: Use that the ball turns smoothly, where there are times.
            evaluate: Judge the calibration on frames that take no part, and by so many Monte Carlo
                trials for each protocol, 0 for none: see `Calibration.report`. None leaves that out.
            seed: Seed of the trials.
            progress: True shows a bar (with `tqdm`); a function is called with (done, total). For
                arrays.

        Returns:
            A `Calibration`, which is true, or a `Rejection`, which is false and has a reason.
        """
        if times_s is not None and fps is not None:
            raise ValueError("fps: expected it or times_s, found both")
        paths, frames, order = _clip(images, color)
        if paths and times_s is not None:
            raise ValueError("times_s: files have those of their names, their video, or fps")
        times = _times(times_s)
        show, bar = progress_of(progress, len(frames), "frame")
        try:
            found = self._handle.calibrate(
                frames,
                paths,
                order,
                times,
                None if fps is None else float(fps),
                None if circle is None else triple("circle", circle),
                float(placement_sigma_rad),
                learn_extra,
                smooth,
                None if evaluate is None else (evaluate, seed),
                show,
            )
        finally:
            if bar is not None:
                bar.close()
        if isinstance(found, str):
            return Rejection(found)
        return calibration_of(found, [frame_of(frame) for frame in found[3]], self.table.pattern)

    def tracker(
        self,
        *,
        window: int = 12,
        memory_s: float = 0.25,
        max_rps: float = 175.0,
        max_latency_s: float | None = None,
    ) -> Tracker:
        """Follows one ball through the frames of a camera; see `Tracker`."""
        return Tracker(
            self,
            window=window,
            memory_s=memory_s,
            max_rps=max_rps,
            max_latency_s=max_latency_s,
        )

    def __repr__(self) -> str:
        return f"<Estimator of {self.table.pattern!r}, {self.camera}>"

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return _estimator, (self.table, *self._arguments)


def _clip(images: Any, color: Color | None) -> tuple[list[str], list[Any], Color]:
    """The paths of a clip; or its frames, and the order of their channels."""
    if isinstance(images, (str, os.PathLike)):
        return [os.fspath(images)], [], "gray"
    given = list(images) if isinstance(images, Iterable) else images
    if given and all(isinstance(one, (str, os.PathLike)) for one in given):
        return [os.fspath(one) for one in given], [], "gray"
    return [], *frames_of(given, color)


def _estimator(
    table: HashTable, camera: Camera, detector: Any, weights: Any, settings: EstimatorSettings
) -> Estimator:
    """What unpickling calls."""
    return Estimator(table, camera=camera, detector=detector, weights=weights, **settings)


@dataclass(slots=True, eq=False)
class TrackerState:
    """What is known after a frame."""

    time_s: float
    frame: FrameEstimate
    """The frame; its pose is the orientation now."""
    spin: Spin | Rejection
    """The spin now, without aliases, or why there is none."""


class Tracker:
    """Follows one ball through the frames of a camera, as they come.

    The work for a frame does not depend on how many came before.

    Args:
        estimator: The estimator of single frames.
        window: Number of poses that the spin is fitted to.
        memory_s: Poses older than this are forgotten, seconds.
        max_rps: Largest spin considered, revolutions per second.
        max_latency_s: Time for a frame, seconds: then the search for the ball ends, and the frame has no
            answer. By default no limit.
    """

    __slots__ = ("_handle", "estimator")
    _handle: _native.Tracker
    estimator: Estimator

    def __init__(
        self,
        estimator: Estimator,
        *,
        window: int = 12,
        memory_s: float = 0.25,
        max_rps: float = 175.0,
        max_latency_s: float | None = None,
    ) -> None:
        self.estimator = estimator
        latency = None if max_latency_s is None else float(max_latency_s)
        self._handle = estimator._handle.tracker(
            window, float(memory_s), float(max_rps), latency
        )

    def update(
        self,
        image: Image,
        time_s: float,
        *,
        color: Color | None = None,
        circle: ArrayLike | None = None,
    ) -> TrackerState:
        """Takes the next frame.

        Args:
            image: As in `Estimator.estimate`.
            time_s: Its time in seconds, later than that of the frame before.
            color: As in `Estimator.estimate`.
            circle: The ball's outline, where it is known.
        """
        given = None if circle is None else triple("circle", circle)
        frame, spin = self._handle.update(*pixels("image", image, color), float(time_s), given)
        return TrackerState(float(time_s), frame_of(frame), spin_of(spin))

    def reset(self) -> None:
        """Forgets everything: the next frame is the first of another trajectory."""
        self._handle.reset()

    def __reduce__(self) -> NoReturn:
        raise TypeError("Tracker: cannot be pickled, since it follows a camera: pickle its estimator, and call tracker()")
