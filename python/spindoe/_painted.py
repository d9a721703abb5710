"""Balls with paint of any shape, and no dots: their orientations, and what a clip shows of their surface."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._common import Floats, Frame, Progress, Rejection, clip_asked, progress_of, triple, whole, write_whole
from ._fictrac import FicTracPath, fictrac_of
from ._frame import Camera
from ._image import Color, Image, frames_of, pixels
from ._pattern import PathLike
from ._sequence import FrameColumns, frame_table
from ._spin import Spin, spin_of
from ._vision import _camera_of, _times

if TYPE_CHECKING:
    import pandas


class Surface:
    """What a clip showed of a ball's paint: further clips of the ball are laid on it, and have its frame. It is what ``spindoe estimate
    --write-surface`` writes. Pickles."""

    __slots__ = ("_handle",)
    _handle: _native.Surface

    @classmethod
    def _of(cls, handle: _native.Surface) -> Surface:
        surface = cls.__new__(cls)
        surface._handle = handle
        return surface

    @classmethod
    def load(cls, path: PathLike) -> Surface:
        """Reads what `save` or the command wrote.

        Raises:
            ValueError: For a file of another kind, naming its array.
        """
        return cls._of(_native.Surface(os.fspath(path), Path(path).read_bytes()))

    def save(self, path: PathLike) -> None:
        """Writes it as ``.npz``; the file appears whole or not at all."""
        write_whole(path, self._handle.to_bytes())

    @property
    def known(self) -> float:
        """Share of the ball that is known, 0 to 1."""
        return self._handle.known()

    def chart(self) -> Floats:
        """The paint by latitude and longitude, shape (120, 240): the logarithm of the brightness less its mean about the place, NaN where
        it is not known. The first row is nearest to +z of the surface's frame, the first column begins at -x, and columns go about +z
        by the right-hand rule."""
        return self._handle.chart()

    def __repr__(self) -> str:
        return f"<Surface of a painted ball, {100 * self.known:.0f} % known>"

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return _surface, (self._handle.to_bytes(),)


def _surface(content: bytes) -> Surface:
    return Surface._of(_native.Surface("surface", content))


@dataclass(slots=True, eq=False, repr=False)
class PaintedSequence:
    """The frames of a clip of a painted ball, and its spin. What a frame lacks is NaN."""

    quaternions_wxyz: Floats
    """Orientations, surface to `frame`, shape (frames, 4): relative to the first frame with one, or by the surface that was given."""
    covariances_rad2: Floats
    """Covariances of their errors, rotation vectors in `frame`; shape (frames, 3, 3)."""
    frame: Frame
    """The frame of orientations, positions and spin."""
    agreements: Floats
    """Correlation of what each frame shows with the surface; shape (frames,)."""
    residuals_rad: Floats
    """What light, outline and surface err alike in frames that show the same side, radians, as `fit_spin` takes residuals; shape (frames,)."""
    view_turns_rad: Floats | None
    """How far the clip may have drifted by each frame, as `fit_spin` takes it; shape (frames, 12); None where there are no times."""
    reasons: list[str | None]
    """Why a frame has no orientation; None where it has one."""
    circles: Floats
    """The ball's outlines, ``u, v, radius``, pixels; shape (frames, 3)."""
    positions_m: Floats
    """The ball's center, m, where the camera's intrinsics are known; shape (frames, 3)."""
    position_covariances_m2: Floats
    """Covariances of their errors; shape (frames, 3, 3)."""
    times_s: Floats | None
    """Times of the frames, seconds; None where there were none."""
    spin: Spin | Rejection
    """The spin, or why there is none."""
    surface: Surface
    """What the clip shows of the paint; or the surface that was given."""
    answered: bool
    """Whether the orientations say anything. That of the first frame alone, where the surface begins, does not."""
    diameter_px: float
    """The ball's diameter, pixels, the median, 0 where no frame shows it; below 50 its paint is followed less well, and lost sooner."""

    def to_dataframe(self) -> pandas.DataFrame:
        """A row a frame; ``attrs`` has the frame as ``frame``, and as ``units`` the unit of each column that has one. Needs pandas."""
        found = FrameColumns(
            self.times_s, self.quaternions_wxyz, self.covariances_rad2, self.frame, self.positions_m, self.position_covariances_m2,
            self.circles, {"residual_rad": self.residuals_rad}, self.view_turns_rad,
        )
        reasons = ["" if reason is None else reason for reason in self.reasons]
        return frame_table(found, {"agreement": self.agreements, "reason": reasons})

    def fictrac(
        self, *, c2a_r: tuple[float, float, float] | None = None, max_bad_frames: int | None = None
    ) -> FicTracPath:
        """The fictive path of an animal that walks on the ball, in FicTrac's columns; see `spindoe.fictrac`.

        Raises:
            ValueError: Where the frames have no times.
        """
        return fictrac_of(self, c2a_r, max_bad_frames)

    def __len__(self) -> int:
        return len(self.reasons)

    def __repr__(self) -> str:
        posed = sum(reason is None for reason in self.reasons)
        return f"<PaintedSequence: {posed} of {len(self)} frames, {self.spin!r}>"


class PaintedEstimator:
    """From images of a ball with paint of any shape to orientations: as ``spindoe estimate --painted``.

    Args:
        camera: What is known of the camera, or its intrinsic matrix of shape (3, 3). Where the ball turns far, give its distance or
            intrinsics.
        ball_radius_m: Radius of the ball, m: with intrinsics it says where the ball is.
        outline: How the outline is found: by its edges where they show it whole, else with a net; or by its edges alone.

    An instance may be used from several threads.
    """

    __slots__ = ("_arguments", "_handle", "camera")
    camera: Camera
    """What is known of the camera."""

    def __init__(
        self,
        camera: Camera | ArrayLike = Camera(),  # noqa: B008 (immutable)
        *,
        ball_radius_m: float = 0.02,
        outline: Literal["net", "edges"] = "net",
    ) -> None:
        if not 0 < ball_radius_m < np.inf:
            raise ValueError(f"ball_radius_m: expected a positive number, found {ball_radius_m}")
        self.camera = _camera_of(camera)
        self._arguments = (self.camera, float(ball_radius_m), outline)
        self._handle = _native.PaintedEstimator(self.camera._given(), outline, float(ball_radius_m))

    def estimate_sequence(
        self,
        images: Sequence[Image] | NDArray[Any],
        times_s: ArrayLike | None = None,
        *,
        surface: Surface | PathLike | None = None,
        color: Color | None = None,
        circle: ArrayLike | None = None,
        roi: Sequence[int] | None = None,
        mirrored: bool = False,
        max_rps: float = 175.0,
        progress: bool | Progress = False,
    ) -> PaintedSequence:
        """Estimates the frames of one clip, in the order of time, on all cores.

        Args:
            images: The frames, as of `Estimator.estimate_sequence`.
            times_s: Their times in seconds, increasing, shape (n,). Without them there is no spin.
            surface: What an earlier clip showed of the ball, or its file: orientations are then in that clip's frame.
            color: As in `Estimator.estimate`.
            circle: The ball's outline ``u, v, radius`` in all frames, pixels, where it is known, as on a treadmill.
            roi: The part of the images in which the ball is: left, top, width, height, pixels.
            mirrored: The images are mirrored: left and right are exchanged first.
            max_rps: Largest spin considered, revolutions per second.
            progress: As in `Estimator.estimate_sequence`.
        """
        frames, order = frames_of(images, color)
        self.camera._check_all(frames)
        times = _times(times_s)
        known = surface if surface is None or isinstance(surface, Surface) else Surface.load(surface)
        asked = clip_asked(circle=circle, roi=roi, mirrored=mirrored, judge=False, max_rps=max_rps)
        show, bar = progress_of(progress, len(frames), "frame")
        try:
            found = self._handle.estimate_sequence(
                frames, order, times, None if known is None else known._handle, asked, show
            )
        finally:
            if bar is not None:
                bar.close()
        rows, agreements, residuals, reasons, circles, positions, blocks, made, spin, answered, diameter_px = found
        quaternions, covariances, turns, frame = rows
        if known is None:
            assert made is not None
            known = Surface._of(made)
        return PaintedSequence(
            quaternions,
            covariances,
            frame,
            agreements,
            residuals,
            turns,
            reasons,
            circles,
            positions,
            blocks,
            None if times is None else np.array(times, dtype=np.float64),
            Rejection("there are no times, or only one") if spin is None else spin_of(spin),
            known,
            answered,
            diameter_px,
        )

    def tracker(
        self,
        surface: Surface | PathLike,
        *,
        window: int = 12,
        memory_s: float = 0.25,
        max_rps: float = 175.0,
    ) -> PaintedTracker:
        """What follows a ball with this surface as its frames come.

        Args:
            surface: What an earlier clip showed of the ball, or its file.
            window: Number of poses that the spin is fitted to.
            memory_s: Poses older than this are forgotten, seconds.
            max_rps: Largest spin considered, revolutions per second.
        """
        known = surface if isinstance(surface, Surface) else Surface.load(surface)
        handle = self._handle.tracker(known._handle, whole("window", window, 1), float(memory_s), float(max_rps))
        return PaintedTracker(self.camera, handle)

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return _estimator, self._arguments


def _estimator(camera: Camera, ball_radius_m: float, outline: Literal["net", "edges"]) -> PaintedEstimator:
    return PaintedEstimator(camera, ball_radius_m=ball_radius_m, outline=outline)


@dataclass(slots=True, eq=False)
class PaintedState:
    """What is known after a frame of a stream."""

    time_s: float
    quaternion_wxyz: Floats | None
    """Orientation, surface to `frame`; None where there is none."""
    covariance_rad2: Floats | None
    """Covariance of its error, a rotation vector in `frame`; shape (3, 3)."""
    agreement: float
    """Correlation of what the frame shows with the surface; NaN without an orientation."""
    reason: str | None
    """Why there is no orientation."""
    frame: Frame
    """The frame of orientation, position and spin."""
    circle: tuple[float, float, float] | None
    """The ball's outline, ``u, v, radius``, pixels."""
    position_m: Floats | None
    """The ball's center, m, where the camera's intrinsics are known."""
    position_covariance_m2: Floats | None
    """Covariance of its error; shape (3, 3)."""
    spin: Spin | Rejection
    """The spin now, from the third orientation on, without aliases; or why there is none."""


class PaintedTracker:
    """Follows a painted ball through the frames of a camera, as they come, by the surface of an earlier clip: ``PaintedEstimator.tracker``."""

    __slots__ = ("_handle", "camera")
    _handle: _native.PaintedTracker
    camera: Camera

    def __init__(self, camera: Camera, handle: _native.PaintedTracker) -> None:
        self.camera = camera
        self._handle = handle

    def update(
        self,
        image: Image,
        time_s: float,
        *,
        color: Color | None = None,
        circle: ArrayLike | None = None,
    ) -> PaintedState:
        """Takes the next frame.

        Args:
            image: As in `Estimator.estimate`.
            time_s: Its time in seconds, later than that of the frame before.
            color: As in `Estimator.estimate`.
            circle: The ball's outline, where it is known, as on a treadmill.
        """
        given = None if circle is None else triple("circle", circle)
        taken, order = pixels("image", image, color)
        self.camera._check("image", taken)
        (posed, outline, position, reason), spin = self._handle.update(taken, order, float(time_s), given)
        orientation, covariance, agreement = (None, None, float("nan")) if posed is None else posed
        center, block = (None, None) if position is None else position
        return PaintedState(
            float(time_s), orientation, covariance, agreement, reason, self._handle.frame(), outline, center, block, spin_of(spin)
        )

    def reset(self) -> None:
        """Forgets where the ball was: the next frame is the first of another clip."""
        self._handle.reset()

    def __reduce__(self) -> NoReturn:
        raise TypeError("PaintedTracker: cannot be pickled, since it follows a camera: pickle estimator and surface")
