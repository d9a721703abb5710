"""From images to orientations."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NoReturn, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._calibrate import Calibration, calibration_of
from ._common import Progress, Rejection, clip_asked, floats, progress_of, settings_json, triple, whole
from ._frame import Camera, FrameEstimate, frame_of
from ._image import Color, Image, frames_of, pixels
from ._pattern import HashTable, PathLike, Tabled, as_table
from ._recognize import Hint
from ._sequence import SequenceEstimate, Verdict, sequence_of, verdict_of
from ._spin import Spin, spin_of

if TYPE_CHECKING:
    from typing_extensions import Unpack


def _times(times_s: ArrayLike | None) -> list[float] | None:
    """Times as the library takes them; None where there are none."""
    if times_s is None:
        return None
    array = floats("times_s", times_s)
    if array.ndim != 1:
        raise ValueError(f"times_s: expected shape (n,), found {array.shape}")
    return [float(time) for time in array]


class CircleSettings(TypedDict, total=False):
    """What is accepted as a ball."""

    min_radius_px: float
    """Minimum radius, pixels; 8. Where no ball is found in a small image, smaller ones are searched, down to five eighths of that."""
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
    ball_radius_m: float | None
    """Radius of the ball, m: with the camera's intrinsics it says where the ball is; by default that of the table, else 0.02."""
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
    """What is expected of the dots that are likely enough: any of ``settings["recognizer"]`` of an estimator."""
    trust: dict[str, Any]
    """From the recognizer's probability of a pose to the one that is reported: any of ``settings["trust"]``."""
    measures_blur: bool
    """Whether it is measured how the identified dots are blurred; false."""


class Estimator:
    """From images to orientations.

    Args:
        table: The table, a pattern, or the path of either. The dots of a calibrated table have their
            own covariances.
        camera: What is known of the camera, or its intrinsic matrix of shape (3, 3); by default its distance is estimated with
            the orientation.
        detector: ``"cnn"``, the built-in net, or ``"blob"``.
        weights: Another net's weights, ``.npz``.
        settings: Any of `EstimatorSettings`.

    An image is an array of uint8 or uint16, or of floats from 0 to 1: shape (height, width) or (height, width, 1) for gray,
    (height, width, 3) for color, (height, width, 4) for color with alpha, which is left out. Of 16 bits 65 535 is white.
    Arrays of whole numbers are read where they lie; views of larger images need no copy. An image is also one of Pillow, or
    the path of an image file: these say their channels themselves. An instance may be used from several threads.
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
        camera: Camera | ArrayLike = Camera(),  # noqa: B008 (immutable)
        detector: Literal["cnn", "blob"] = "cnn",
        weights: PathLike | None = None,
        **settings: Unpack[EstimatorSettings],
    ) -> None:
        self.table = as_table(table)
        self.camera = _camera_of(camera)
        self._arguments = (self.camera, detector, weights, settings)
        given = settings_json(settings)
        self._handle = _native.Estimator(
            self.table._handle, self.camera._given(), detector, weights, given
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
            circle: The ball's outline ``u, v, radius``, pixels, where it is known: the circle that the image shows, of an ellipse that
                of the same center and area.
            hint: Prior orientation.

        Raises:
            ValueError: For another type or shape. What is seen, or not, is no error: see
                `FrameEstimate.pose`.
        """
        taken, order = pixels("image", image, color)
        self.camera._check("image", taken)
        return frame_of(
            self._handle.estimate(
                taken,
                order,
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
        roi: Sequence[int] | None = None,
        mirrored: bool = False,
        others: Sequence[Tabled] = (),
        judge: bool = True,
        independent: bool = False,
        max_rps: float = 175.0,
        exposure_s: float | None = None,
        readout_s: float = 0.0,
        progress: bool | Progress = False,
    ) -> SequenceEstimate:
        """Estimates the frames of one sequence on all cores, as ``spindoe estimate`` does; with times they help each other, and give
        the spin.

        Args:
            images: The frames: a sequence of images, or one array with the frames in front. All are in memory at once, those of
                paths decoded to 6 bytes a pixel: for long clips of files use ``spindoe estimate``.
            times_s: Their times in seconds, increasing, shape (n,).
            color: As in `estimate`.
            circle: The ball's outline in all frames, where it is known.
            roi: The part of the images in which the ball is: left, top, width, height, pixels.
            mirrored: The images are mirrored: left and right are exchanged first. Pixels in the answer are those of images so exchanged.
            others: Other tables that the ball may carry. The first frames choose, and all judge: `SequenceEstimate.verdict`.
            judge: Whether all frames together decide if the table fits and the images are mirrored; where they do not fit, no frame keeps
                its pose.
            independent: Keep the frames from informing each other.
            max_rps: Largest spin considered, revolutions per second.
            exposure_s: Time that the shutter is open for a frame, seconds. How far dots are smeared then settles which of the
                spins is right that the frame rate leaves open; of an ``Estimator(..., measures_blur=True)``.
            readout_s: Rolling shutter: time from the exposure of an image's first row to that of its last, seconds, of whole images, not
                crops. Times and orientations are then those at which the ball's center is exposed.
            progress: True shows a bar (with `tqdm`); a function is called with (done, total).
        """
        frames, order = frames_of(images, color)
        self.camera._check_all(frames)
        asked = clip_asked(
            circle=circle, roi=roi, mirrored=mirrored, independent=independent, judge=judge, readout_s=readout_s, max_rps=max_rps
        )
        camera, detector, weights, settings = self._arguments
        tables = [Estimator(table, camera=camera, detector=detector, weights=weights, **settings) for table in others]
        times = _times(times_s)
        show, bar = progress_of(progress, len(frames), "frame")
        try:
            found, independently, rows, spin, seen_s, verdict = self._handle.estimate_sequence(
                frames,
                order,
                times,
                [table._handle for table in tables],
                asked,
                None if exposure_s is None else float(exposure_s),
                show,
            )
        finally:
            if bar is not None:
                bar.close()
        seen = None if seen_s is None else np.array(seen_s, dtype=np.float64)
        return sequence_of(found, independently, rows, spin, seen, verdict_of(verdict))

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
        self.camera._check_all(frames)
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
                None if evaluate is None else (whole("evaluate", evaluate), whole("seed", seed)),
                self.camera.size,
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


def _camera_of(given: Any) -> Camera:
    """The camera, or that of an intrinsic matrix."""
    if isinstance(given, Camera):
        return given
    try:
        return Camera(given)
    except (TypeError, ValueError) as error:
        raise ValueError(f"camera: expected a spindoe.Camera or a matrix of shape (3, 3): {error}") from None


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
            whole("window", window, 1), float(memory_s), float(max_rps), latency
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
        taken, order = pixels("image", image, color)
        self.estimator.camera._check("image", taken)
        frame, spin = self._handle.update(taken, order, float(time_s), given)
        return TrackerState(float(time_s), frame_of(frame), spin_of(spin))

    @property
    def verdict(self) -> Verdict | None:
        """What the last frames together say of the ball: as long as its table does not fit them, or the images are mirrored, no frame keeps a
        pose."""
        return verdict_of(self._handle.verdict())

    def reset(self) -> None:
        """Forgets everything: the next frame is the first of another trajectory.

        Where the frames so far contradict the camera's focal lengths, this warns, as `update` does as soon as they say so.
        """
        self._handle.reset()

    def __reduce__(self) -> NoReturn:
        raise TypeError("Tracker: cannot be pickled, since it follows a camera: pickle its estimator, and call tracker()")
