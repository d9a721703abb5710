"""A frame's estimate: the camera, the view of the ball, the orientation, and what was detected."""

from __future__ import annotations

import functools
import operator
import os
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _html, _native
from ._common import (
    Axes,
    Floats,
    Frame,
    Ints,
    Rejection,
    floats,
    rotation_matrix,
    to_scipy,
    triple,
)
from ._image import Color, Image
from ._pattern import PathLike, Tabled, as_table

if TYPE_CHECKING:
    import matplotlib.axes
    from scipy.spatial.transform import Rotation


def _size(name: str, given: tuple[int, int]) -> tuple[int, int]:
    """Columns and rows of an image."""
    width, height = (operator.index(side) for side in given)
    if width < 1 or height < 1:
        raise ValueError(f"{name}: expected columns and rows of an image, found {given!r}")
    return width, height


@functools.lru_cache(maxsize=64)
def _size_doubt(kind: str, numbers: tuple[float, ...], width: int, height: int) -> str | None:
    """What contradicts intrinsics being those of images of this size."""
    return _native.size_doubt((kind, numbers), (width, height))


def _outside() -> int:
    """How many calls up the stack the package ends: there its warnings belong."""
    frame, depth = sys._getframe(1), 1
    while frame.f_back is not None and frame.f_globals.get("__package__") == __package__:
        frame, depth = frame.f_back, depth + 1
    return depth


@dataclass(frozen=True, slots=True, init=False)
class Camera:
    """What is known of the camera. Pixels: u right, v down, (0, 0) the center of the top-left one.

    ``Camera(K, dist)`` is one with intrinsics, as OpenCV and ROS have them; `read` takes them from a file. ``Camera()`` is one
    of which nothing is known.

    Args:
        matrix: The intrinsic matrix, rows ``fx s cx``, ``0 fy cy``, ``0 0 1``.
        distortion: OpenCV's coefficients: k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4]]]; of a fisheye k1 to k4.
        fisheye: Whether they are those of OpenCV's ``fisheye`` module, ROS' ``equidistant``.
        size: Columns and rows of the images that the matrix is of, where they are known: images of another size are then
            refused, and `for_image` scales it to them.
    """

    kind: Literal["unknown", "parallel", "distance", "pinhole", "fisheye"]
    numbers: tuple[float, ...]
    """Of intrinsics fx, fy, cx, cy, skew, and the distortion."""
    size: tuple[int, int] | None
    """Columns and rows of the images that the intrinsics are of, where they are known."""

    def __init__(
        self,
        matrix: ArrayLike | None = None,
        distortion: ArrayLike | None = None,
        *,
        fisheye: bool = False,
        size: tuple[int, int] | None = None,
    ) -> None:
        if matrix is None:
            for name, given in (("distortion", distortion), ("size", size)):
                if given is not None:
                    raise ValueError(f"{name}: expected the matrix with it")
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
        self._set(kind, tuple(numbers), None if size is None else _size("size", size))

    def _set(self, kind: str, numbers: tuple[float, ...], size: tuple[int, int] | None = None) -> None:
        object.__setattr__(self, "kind", kind)
        object.__setattr__(self, "numbers", numbers)
        object.__setattr__(self, "size", size)

    @classmethod
    def _of(cls, kind: str, *numbers: float, size: tuple[int, int] | None = None) -> Camera:
        camera = cls.__new__(cls)
        camera._set(kind, tuple(float(x) for x in numbers), size)
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
        """The intrinsics of a file: of OpenCV (YAML, JSON, XML, NPZ), ROS (camera_info), Kalibr, EuRoC, VINS, ORB-SLAM, COLMAP
        (cameras.txt), OpenSfM, NeRF (transforms.json), librealsense, ZED or MATLAB (JSON), with the size of their images where the file
        says it. ``FILE:NAME`` is one of several cameras, as in ``stereo.yml:left``. A key that is not understood is named by a warning."""
        kind, numbers, size, notes = _native.read_intrinsics(os.fspath(path))
        for note in notes:
            warnings.warn(f"{path}: {note}", stacklevel=2)
        return cls._of(kind, *numbers, size=size)

    def for_image(self, width: int, height: int) -> Camera:
        """The camera of images of this size, to which the intrinsics are scaled.

        Raises:
            ValueError: Where the size that they are of is not known, or has another aspect.
        """
        wanted = _size("width, height", (width, height))
        if self.size is None:
            raise ValueError("size: expected that of the images which the matrix is of: Camera(K, dist, size=(w, h))")
        across, down = wanted[0] / self.size[0], wanted[1] / self.size[1]
        # Within a pixel of rounding.
        if abs(across - down) * max(self.size) > max(1.0, across):
            raise ValueError(f"width, height: expected the aspect of {self.size}, found {wanted}")
        fx, fy, cx, cy, skew, *lens = self.numbers
        cx, cy = across * (cx + 0.5) - 0.5, down * (cy + 0.5) - 0.5
        return Camera._of(self.kind, across * fx, down * fy, cx, cy, across * skew, *lens, size=wanted)

    def _check(self, name: str, image: Any) -> None:
        """Refuses an image of another size than that of the intrinsics; without that, warns where their numbers look like those of
        another."""
        shape = getattr(image, "shape", None)
        if not self.has_intrinsics or not shape or len(shape) < 2:
            return
        height, width = shape[:2]
        if self.size is None:
            if words := _size_doubt(self.kind, self.numbers, width, height):
                warnings.warn(f"camera: {words}", stacklevel=_outside())
            return
        if (width, height) != self.size:
            raise ValueError(
                f"{name}: expected {self.size[0]} x {self.size[1]} pixels, which the camera's intrinsics are of, found "
                f"{width} x {height}: camera.for_image({width}, {height}) scales them"
            )

    def _check_all(self, frames: Sequence[Any]) -> None:
        """The same of the frames of a clip."""
        known: set[tuple[int, ...]] = set()
        for k, frame in enumerate(frames):
            size = tuple(getattr(frame, "shape", ())[:2])
            if size not in known:
                self._check(f"images[{k}]", frame)
                known.add(size)

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
        """The view of a ball whose outline is the circle ``u, v, radius``, pixels: with intrinsics one as `FrameEstimate.circle` has it."""
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
        """Minimum z, towards the camera, of a visible point."""
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
    """The ball's outline ``u, v, radius``, pixels; None where there is no ball. With intrinsics its center is where the ball's center is seen,
    and the radius that of the ball seen straight on, as `Camera.view` takes it."""
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
    position_m: Floats | None = None
    """The ball's center, m, in the camera's frame (x right, y up, z towards the camera); shape (3,). Also where the orientation is
    rejected: then by the outline alone, which may be of another round thing. None without intrinsics or an outline."""
    position_covariance_m2: Floats | None = None
    """Its covariance, m^2, in the same frame; shape (3, 3). What all frames share is not in it: a ball that is larger than stated by
    a part of its diameter, or a focal length that is, moves the center by that part of its distance."""
    position_rotation_covariance_m_rad: Floats | None = None
    """Covariance of the center (rows) with the small rotation vector of `Pose.covariance` (columns), m rad; shape (3, 3). None where
    there is no orientation."""

    def joint_covariance(self, frame: Axes = "camera") -> Floats:
        """The covariance of center and orientation together, shape (6, 6): x, y, z of the center in m, then of the small rotation
        vector in rad; as ROS has it in ``PoseWithCovariance`` for the axes ``"optical"``.

        Raises:
            ValueError: Where the frame has no orientation or no position.
        """
        both = self.position_rotation_covariance_m_rad
        if not self.pose or self.position_covariance_m2 is None or both is None:
            raise ValueError("frame: expected one with an orientation and a position")
        joint = np.block([[self.position_covariance_m2, both], [both.T, self.pose.as_frame("camera").covariance]])
        signs = np.tile([1.0, -1.0, -1.0] if frame == "optical" else [1.0, 1.0, 1.0], 2)
        found: Floats = joint * np.outer(signs, signs)
        return found

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
        return _html.frame(self)

    def __repr__(self) -> str:
        return f"<FrameEstimate: {self.matched} of {len(self.dots)} dots, {self.pose!r}>"


def frame_of(found: Any) -> FrameEstimate:
    """The native part's answer."""
    circle, dots, covariances, assignment, pose, seconds, position = found
    answer = Rejection(pose) if isinstance(pose, str) else Pose(*pose)
    return FrameEstimate(circle, dots, covariances, assignment, answer, seconds, *(position or ()))
