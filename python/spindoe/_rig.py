"""Several cameras that see one ball."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._common import Floats, Progress, clip_asked, floats, progress_of, settings_json
from ._frame import Camera
from ._image import Color, Image, frames_of
from ._pattern import HashTable, PathLike, Tabled, as_table
from ._sequence import SequenceEstimate, sequence_of
from ._vision import EstimatorSettings, _times

if TYPE_CHECKING:
    from typing_extensions import Unpack


@dataclass(frozen=True, slots=True, eq=False)
class RigCamera:
    """One of several cameras: ``x = rotation @ x_common + translation_m`` leads into its frame from a frame that all have in common,
    both with OpenCV's axes (x right, y down, z forward). For ``cv2.stereoCalibrate`` that frame is the first camera's: its
    rotation is the identity, its translation 0, and the second camera has ``R`` and ``T``."""

    name: str
    """What it is called."""
    camera: Camera
    """Its intrinsics."""
    rotation: Floats
    """Shape (3, 3)."""
    translation_m: Floats
    """Meters, shape (3,)."""
    clock_offset_s: float = 0.0
    """What is added to its times gives the first camera's, as far as it is known."""

    def _given(self) -> tuple[str, tuple[str, list[float]], tuple[int, int] | None, Any, Any, float]:
        rotation, translation = floats("rotation", self.rotation), floats("translation_m", self.translation_m)
        if rotation.shape != (3, 3):
            raise ValueError(f"rotation: expected shape (3, 3), found {rotation.shape}")
        if translation.size != 3:
            raise ValueError(f"translation_m: expected 3 numbers, found shape {translation.shape}")
        given = self.camera._given()
        return self.name, given, self.camera.size, rotation.tolist(), translation.ravel().tolist(), float(self.clock_offset_s)


class Rig:
    """Cameras that see one ball; orientations, positions and spins are in the first one's frame.

    Args:
        cameras: The file of a rig: OpenCV's of ``stereoCalibrate`` (``K1, D1, K2, D2, R, T``; YAML, XML, JSON, NPZ), Kalibr's
            camchain, or a transform of each camera as ROS' tf has it; or `RigCamera`\\ s.
        table: As of an `Estimator`, with its other settings.
    """

    __slots__ = ("_handle", "cameras", "table")
    _handle: _native.Rig
    cameras: tuple[RigCamera, ...]
    """The cameras; rotations and translations lead from the first one's frame."""
    table: HashTable
    """The table in use."""

    def __init__(
        self,
        cameras: PathLike | Sequence[RigCamera],
        table: Tabled,
        *,
        detector: Literal["cnn", "blob"] = "cnn",
        weights: PathLike | None = None,
        **settings: Unpack[EstimatorSettings],
    ) -> None:
        self.table = as_table(table)
        is_file = isinstance(cameras, (str, os.PathLike))
        path = os.fspath(cast("PathLike", cameras)) if is_file else None
        given = [] if is_file else [camera._given() for camera in cast("Sequence[RigCamera]", cameras)]
        self._handle = _native.Rig(path, given, self.table._handle, detector, weights, settings_json(settings))
        known, notes = self._handle.cameras()
        self.cameras = tuple(
            RigCamera(name, Camera._of(kind, *numbers, size=size), np.array(rotation), np.array(translation), offset)
            for name, (kind, numbers), size, rotation, translation, offset in known
        )
        for note in notes:
            warnings.warn(f"{path}: {note}", stacklevel=2)

    def estimate_sequence(
        self,
        images: Sequence[Sequence[Image] | NDArray[Any]],
        times_s: ArrayLike | Sequence[ArrayLike] | None = None,
        *,
        color: Color | None = None,
        mirrored: bool = False,
        judge: bool = True,
        independent: bool = False,
        max_rps: float = 175.0,
        progress: bool | Progress = False,
    ) -> SequenceEstimate:
        """Estimates the frames of all cameras, on all cores. Frames of one time are one measurement, and what one camera misses the others
        answer.

        Args:
            images: The frames of each camera, as of `Estimator.estimate_sequence`.
            times_s: Their times in seconds, increasing: one list for all cameras, or one for each, by its own clock. Without them frames
                of the same number are of one time.
            color: As in `Estimator.estimate`.
            mirrored: The images of all cameras are mirrored: left and right are exchanged first.
            judge: Whether all frames of a camera together decide if the table fits and its images are mirrored; a camera of which that is
                not so is left out.
            independent: Keep the frames from informing each other.
            max_rps: Largest spin considered, revolutions per second.
            progress: As in `Estimator.estimate_sequence`.

        Returns:
            The sequence in the first camera's frame, with `SequenceEstimate.cameras` and `SequenceEstimate.notes`. Its
            frames have the dots and the outline that the first camera saw.

        Warns:
            UserWarning: Where the cameras disagree as a whole: a camera that is turned against its stated place, clips that are exchanged
                or mirrored. Nothing is answered then.
        """
        frames, orders = [], set()
        for camera, own in zip(self.cameras, images, strict=False):
            read, order = frames_of(own, color)
            for k, image in enumerate(read):
                camera.camera._check(f"images of {camera.name}, {k}", image)
            frames.append(read)
            orders.add(order)
        frames += [[] for _ in range(len(images) - len(frames))]
        if len(orders) > 1:
            raise ValueError("images: expected the same channels of all cameras: give color")
        times = None if times_s is None else _each(times_s, len(self.cameras))
        asked = clip_asked(mirrored=mirrored, judge=judge, independent=independent, max_rps=max_rps)
        total = sum(len(own) for own in frames)
        show, bar = progress_of(progress, total, "frame")
        try:
            found, independently, rows, spin, seen_s, cameras, chi2, notes, doubts = self._handle.estimate_sequence(
                frames, orders.pop() if orders else "rgb", times, asked, show
            )
        finally:
            if bar is not None:
                bar.close()
        for doubt in doubts:
            warnings.warn(doubt, stacklevel=2)
        together = sequence_of(found, independently, rows, spin, seen_s)
        return replace(together, cameras=cameras, chi2=chi2, notes=(*doubts, *notes))

    def __repr__(self) -> str:
        return f"<Rig: {', '.join(camera.name for camera in self.cameras)}>"


def _each(times_s: ArrayLike | Sequence[ArrayLike], count: int) -> list[list[float]]:
    """Times of each camera."""
    is_one = np.ndim(cast("Any", times_s)[0]) == 0 if len(cast("Any", times_s)) else True
    each: list[ArrayLike]
    each = [cast("ArrayLike", times_s)] * count if is_one else list(cast("Sequence[ArrayLike]", times_s))
    return [_times(times) or [] for times in each]
