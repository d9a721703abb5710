"""Synthetic images with their truth."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._common import Floats, settings_json, to_scipy, triple
from ._pattern import Tabled, as_ball

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation


@dataclass(slots=True, eq=False, repr=False)
class Truth:
    """What a synthetic image shows."""

    quaternion_wxyz: Floats
    """Orientation at mid-exposure, pattern to camera frame, scalar first; shape (4,)."""
    spin_rad_s: Floats
    """Spin, camera frame, rad/s; shape (3,)."""
    time_s: float | None
    """Time of mid-exposure, in a sequence."""
    circle: tuple[float, float, float]
    """The ball's outline ``u, v, radius``, pixels."""
    dots: Floats
    """The dots' pixels ``u, v``, of those on the camera's side; shape (n, 2)."""
    indices: NDArray[np.int64]
    """Their indices in the pattern; shape (n,)."""
    visible: NDArray[np.bool_]
    """Which of them a detector should find; shape (n,)."""
    everything: dict[str, Any]
    """All that is known of the frame, as in ``truth.json``."""

    def as_rotation(self) -> Rotation:
        """SciPy's rotation, pattern to camera."""
        return to_scipy(self.quaternion_wxyz)

    def __repr__(self) -> str:
        return f"<Truth: {int(self.visible.sum())} visible dots, circle {self.circle}>"


def _truth(text: str) -> Truth:
    everything = json.loads(text)
    dots = everything["dots"]
    center = everything["center"]
    pixels = [(dot["pixel"]["u"], dot["pixel"]["v"]) for dot in dots]
    return Truth(
        np.array(everything["camera_quaternion_wxyz"]),
        np.array(everything["spin_rad_s"]),
        everything["time_s"],
        (center["u"], center["v"], everything["radius_px"]),
        np.array(pixels, dtype=np.float64).reshape(-1, 2),
        np.array([dot["index"] for dot in dots], dtype=np.int64),
        np.array([dot["visible"] for dot in dots], dtype=bool),
        everything,
    )


def synth(
    pattern: Tabled | ArrayLike,
    frames: int | None = None,
    *,
    seed: int = 0,
    preset: Literal["good", "wide"] = "good",
    fps: float | None = None,
    spin_rad_s: ArrayLike | None = None,
    exposure_s: float | None = None,
    drift_px: tuple[float, float] | None = None,
    **settings: Any,
) -> Iterator[tuple[NDArray[np.uint8], Truth]]:
    """Draws synthetic images, one after another: the same seed gives the same images.

    Args:
        pattern: A table, a pattern, the path of either, or dots of shape (n, 3). Dots are as large as a design
            says, unless ``dot_radius_rad`` is given.
        frames: Number of images; without end where not given (only without `fps`).
        seed: Of everything random.
        preset: ``"good"``, conditions that a user arranges; ``"wide"``, those that the detector is
            trained on.
        fps: Draw one turning ball at this rate instead of independent ones.
        spin_rad_s: Its spin, camera frame, rad/s; at random where not given.
        exposure_s: Exposure of the frames of a sequence, seconds.
        drift_px: Displacement of the ball over the whole sequence, pixels.
        settings: Any field of the library's ``SynthConfig``: ``ball_px=[60, 60]``,
            ``camera_distance_radii=[12, 12]``, ``max_noise=0.01``, ...

    Yields:
        Image of shape (height, width, 3), uint8, rgb, and its `Truth`.
    """
    native = as_ball(pattern)._handle
    given = settings_json(settings)
    if fps is None:
        alone = {"spin_rad_s": spin_rad_s, "exposure_s": exposure_s, "drift_px": drift_px}
        for name, value in alone.items():
            if value is not None:
                raise ValueError(f"{name}: expected only with fps")

        def independent() -> Iterator[tuple[NDArray[np.uint8], Truth]]:
            k = 0
            while frames is None or k < frames:
                image, truth = _native.independent_frame(native, preset, given, seed, k)
                yield image, _truth(truth)
                k += 1

        return independent()
    if frames is None:
        raise ValueError("frames: expected a number of frames for a sequence")
    spin = None if spin_rad_s is None else triple("spin_rad_s", spin_rad_s)
    sequence = _native.Sequence(
        native, preset, given, seed, frames, float(fps), spin, exposure_s, drift_px
    )

    def of_sequence() -> Iterator[tuple[NDArray[np.uint8], Truth]]:
        for k in range(frames):
            image, truth = sequence.frame(k)
            yield image, _truth(truth)

    return of_sequence()
