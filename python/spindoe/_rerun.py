"""Estimates as a recording for the Rerun viewer."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from ._common import Floats, aside_of, optional
from ._frame import FrameEstimate
from ._image import Color, Image, rgb8
from ._palette import IDENTIFIED, OTHER, OUTLINE
from ._pattern import PathLike, Tabled, as_table
from ._sequence import SequenceEstimate
from ._spin import Spin
from ._vision import TrackerState

if TYPE_CHECKING:
    import rerun

_Row = tuple[float | None, FrameEstimate, Floats, Floats | None]
"""Of a frame its time, the frame, the orientation, and the spin."""


def to_rerun(
    found: SequenceEstimate | Iterable[TrackerState],
    *,
    table: Tabled,
    images: Iterable[Image] | None = None,
    color: Color | None = None,
    path: PathLike | None = None,
    recording: rerun.RecordingStream | None = None,
) -> rerun.RecordingStream:
    """Logs estimates for the Rerun viewer: images with what was detected, the ball in 3-D, the spin over time. Needs
    ``rerun-sdk``.

    Entities, on the timelines ``frame`` (a number) and, where there are times, ``time`` (seconds):

    - ``image``, ``image/outline``, ``image/dots``: pixels, with the numbers of identified dots.
    - ``world/ball``: the orientation, pattern to the frame of the orientations; x right, y up, z towards the camera; with
      the pattern's dots on a sphere of radius 1. It stays as it was where a frame has no orientation.
    - ``world/spin``: the spin's axis.
    - ``spin/x``, ``y``, ``z``: the spin in that frame, rad/s; ``spin/rps``: its magnitude, revolutions per second. Of a
      sequence by its motion, of a tracker as it was known at each frame.
    - ``pose/confidence``, 0 where there is no orientation, ``pose/matched``, ``pose/residual_rad``, and ``rejected``, the
      reasons.

    Args:
        found: A sequence, or a tracker's states.
        table: The pattern, or its table.
        images: The images, one a frame, as in `Estimator.estimate`.
        color: The order of their channels, as there.
        path: A file, ``.rrd``, to write; it appears whole or not at all.
        recording: Or the recording to log to; where neither is given, that of ``rerun.init``.

    Returns:
        The recording. A file is whole when this returns.

    Raises:
        ValueError: Where Rerun is missing or there is no recording; for another number of images than of frames, and
            images as `Estimator.estimate` refuses them. Nothing is logged then.
        OSError: Where the file cannot be written.
    """
    rr = optional("rerun", "rerun")
    if path is not None and recording is not None:
        raise ValueError("path: expected it or recording, found both")
    active = recording or rr.get_global_data_recording()
    if path is None and active is None:
        raise ValueError("recording: expected it, path, or rerun.init before")
    dots = as_table(table).pattern.dots
    rows = _rows(found)
    shown: list[Image | None] = [None] * len(rows) if images is None else list(images)
    if len(shown) != len(rows):
        raise ValueError(f"images: expected {len(rows)}, found {len(shown)}")
    for image in shown:
        if image is not None:
            # Refused here, before anything is logged; not kept, since all of a clip are large.
            rgb8(image, color)
    if path is None:
        _log(rr, active, dots, rows, shown, color)
        return active
    with aside_of(path) as aside:
        # Of a place that cannot be written to the system's error is the clearer one.
        aside.touch()
        stream: rerun.RecordingStream = rr.RecordingStream("spindoe")
        try:
            stream.save(os.fspath(aside))
            _log(rr, stream, dots, rows, shown, color)
        finally:
            stream.disconnect()
    return stream


def _log(
    rr: Any, stream: rerun.RecordingStream, dots: Floats, rows: list[_Row], shown: list[Image | None], color: Color | None
) -> None:
    numbers = [str(k) for k in range(len(dots))]
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
    stream.log("world/ball/sphere", rr.Ellipsoids3D(half_sizes=[[1.0, 1.0, 1.0]]), static=True)
    stream.log("world/ball/dots", rr.Points3D(dots, radii=0.06, labels=numbers, colors=IDENTIFIED), static=True)
    around = np.linspace(0.0, 2.0 * np.pi, 65)
    ring = np.stack([np.cos(around), np.sin(around)], axis=1)

    for k, ((time_s, frame, quaternion_wxyz, spin), image) in enumerate(zip(rows, shown, strict=True)):
        stream.set_time("frame", sequence=k)
        if time_s is not None:
            stream.set_time("time", duration=time_s)
        if image is not None:
            stream.log("image", rr.Image(rgb8(image, color)))
        # Pixels have their centers at whole numbers here, in Rerun between them.
        is_named = frame.assignment >= 0
        stream.log(
            "image/dots",
            rr.Points2D(
                frame.dots[:, :2] + 0.5,
                colors=[IDENTIFIED if named else OTHER for named in is_named],
                labels=[str(number) if number >= 0 else "" for number in frame.assignment],
            ),
        )
        if frame.circle is None:
            stream.log("image/outline", rr.Clear(recursive=False))
        else:
            u, v, radius = frame.circle
            outline = [u + 0.5, v + 0.5] + radius * ring
            stream.log("image/outline", rr.LineStrips2D([outline], colors=OUTLINE))
        stream.log("pose/confidence", rr.Scalars(frame.pose.confidence if frame.pose else 0.0))
        stream.log("pose/matched", rr.Scalars(frame.matched))
        if frame.pose:
            stream.log("pose/residual_rad", rr.Scalars(frame.pose.residual_rad))
            xyzw = np.roll(quaternion_wxyz, -1)
            stream.log("world/ball", rr.Transform3D(quaternion=rr.Quaternion(xyzw=xyzw)))
        else:
            stream.log("rejected", rr.TextLog(frame.pose.reason, level=rr.TextLogLevel.WARN))
        if spin is not None:
            rate = float(np.linalg.norm(spin))
            stream.log("spin/rps", rr.Scalars(rate / (2.0 * np.pi)))
            for axis, component in zip("xyz", spin, strict=True):
                stream.log(f"spin/{axis}", rr.Scalars(component))
            if rate > 0.0:
                arrow = 1.5 * spin / rate
                stream.log("world/spin", rr.Arrows3D(origins=[-arrow], vectors=[2.0 * arrow]))
    stream.flush()


def _rows(found: SequenceEstimate | Iterable[TrackerState]) -> list[_Row]:
    rows: list[_Row] = []
    if not isinstance(found, SequenceEstimate):
        none = np.full(4, np.nan)
        for state in found:
            pose, spin = state.frame.pose, state.spin
            quaternion = pose.quaternion_wxyz if pose else none
            rows.append((state.time_s, state.frame, quaternion, spin.spin_rad_s if spin else None))
        return rows
    for k, frame in enumerate(found.frames):
        time_s = None if found.times_s is None else float(found.times_s[k])
        rows.append((time_s, frame, found.quaternions_wxyz[k], _spin_at(found.spin or None, time_s)))
    return rows


def _spin_at(spin: Spin | None, time_s: float | None) -> Floats | None:
    """The spin vector at a time, rad/s: by its motion it decays and keeps its mean axis."""
    if spin is None or time_s is None:
        return None
    vector: Floats = spin.spin_rad_s * np.exp(-spin.decay_per_s * (time_s - spin.time_s))
    return vector
