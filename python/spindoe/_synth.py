"""Synthetic images with their truth."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._common import Floats, settings_json, to_scipy, triple, whole
from ._pattern import Tabled, as_ball

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation
    from typing_extensions import Unpack

    from ._rig import Rig

SynthKind = Literal[
    "dotted", "other-pattern", "dotless", "logo-only", "seams-only", "fruit", "lamp", "wheel", "speckled", "noise",
]


class SynthSettings(TypedDict, total=False):
    """What synthetic images may have otherwise than the preset. Pairs are ``[minimum, maximum]``; a value is drawn once for a
    frame."""

    kind: SynthKind
    """What is shown."""
    size_px: Sequence[int]
    """Side of the square crop, pixels, log-uniform."""
    fill: Sequence[float]
    """The ball's diameter over the crop's side."""
    ball_px: Sequence[float]
    """The ball's diameter, pixels, log-uniform; where given, the crop's side follows from ``fill``."""
    image_px: Sequence[int]
    """Columns and rows of a whole frame, in which the ball lies anywhere; its diameter is that in the crop."""
    off_center: float
    """Maximum of the ball's center off the crop's, along either axis, over half the side."""
    cut_share: float
    """Share of the frames whose border cuts the ball."""
    max_cut: float
    """Maximum part of the diameter beyond the border."""
    mirrored: bool
    """Whether images are flipped left to right."""
    camera_distance_radii: Sequence[float]
    """Distance of the camera from the ball's center in ball radii, log-uniform."""
    parallel_share: float
    """Share of the frames taken along parallel rays."""
    max_off_axis_rad: float
    """Maximum angle between the optical axis and the ray to the ball's center, radians."""
    dot_radius_rad: Sequence[float]
    """Angular radius of the dots, radians."""
    dot_radius_spread: Sequence[float]
    """Relative standard deviation of the dots' radii within a ball."""
    placement_sigma_rad: Sequence[float]
    """Standard deviation of a dot's placement error, per tangent axis, radians."""
    max_dot_elongation: float
    """Maximum of (long axis - short axis) / (long + short) of a dot."""
    ink_density: Sequence[float]
    """Share of the light that a dot's ink takes: a worn pen leaves gray."""
    max_streaks: float
    """Maximum part of the ink that a streaky pen leaves out."""
    colored_ink_share: float
    """Share of the pens whose ink is colored."""
    left_out: float
    """Probability that a dot was not drawn."""
    logo_probability: float
    """Probability of a logo."""
    logo_radius_rad: Sequence[float]
    """Angular radius of the logo, radians."""
    seam_probability: float
    """Probability of a seam."""
    stains: bool
    """Whether the ball may be stained."""
    rps: Sequence[float]
    """Spin, revolutions per second."""
    max_arc_rad: float
    """Maximum angle that the ball turns during the exposure, radians."""
    max_shift_px: float
    """Maximum displacement of the ball during the exposure, pixels of a crop of 60."""
    ambient: Sequence[float]
    """Share of the light that comes from everywhere."""
    second_lamp_share: float
    """Share of the frames with a second lamp."""
    shadow_share: float
    """Share of the balls on which something casts a hard shadow."""
    max_gloss: float
    """Maximum strength of a lamp's highlight; 1 is a white surface in full light."""
    max_limb: float
    """Maximum darkening towards the limb."""
    max_background: float
    """Maximum brightness of the background against that of the ball's brightest part."""
    texture_share: float
    """Share of the frames with a textured background."""
    clutter_share: float
    """Share of the frames with discs, lamps or other balls in the background."""
    ground_share: float
    """Share of the frames with ground below the ball, most of them with its shadow there."""
    occlusion_share: float
    """Share of the frames in which something hides a part of the ball."""
    cords_share: float
    """Share of the frames in which cords or a net cross the whole ball."""
    occluder_shadow_share: float
    """Share of the occluders that cast a shadow on the ball."""
    max_occlusion: float
    """Maximum depth, over the diameter, to which a hand or a bat covers the ball."""
    defocus_px: Sequence[float]
    """Standard deviation of the lens' blur, pixels of a crop of 60."""
    max_noise: float
    """Maximum factor on the noise of a good camera."""
    bad_exposure: float
    """Share of the frames far over- or underexposed."""
    gamma: Sequence[float]
    """Exponent on the encoded values, log-uniform: a display's or an editor's correction."""
    gamma_share: float
    """Share of the frames with such an exponent; it is 1 elsewhere, and where the exposure is bad."""
    mosaic_share: float
    """Share of the color cameras with a Bayer mosaic."""
    sharpen_share: float
    """Share of the cameras that sharpen."""
    jpeg_share: float
    """Share of the frames compressed as JPEG."""
    jpeg_quality: Sequence[float]
    """Quality of the JPEG compression, 1 to 100."""
    video_share: float
    """Share of the frames compressed as video."""
    video_qp: Sequence[float]
    """Quantizer of the video compression, as H.264's QP."""


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
    **settings: Unpack[SynthSettings],
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
        settings: Any of `SynthSettings`: ``ball_px=[60, 60]``, ``camera_distance_radii=[12, 12]``, ``max_noise=0.01``, ...

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


def synth_rig(
    rig: Rig,
    frames: int,
    *,
    fps: float,
    seed: int = 0,
    preset: Literal["good", "wide"] = "good",
    spin_rad_s: ArrayLike | None = None,
    exposure_s: float | None = None,
    **settings: Unpack[SynthSettings],
) -> Iterator[tuple[tuple[NDArray[np.uint8], Truth], ...]]:
    """Draws the ball of a rig as all its cameras see it, one time after another: the same seed gives the same images.

    Args:
        rig: The cameras, with the size of their images, and the table of the ball.
        frames: Number of times.
        fps: Frames a second.
        seed: Of everything random.
        preset: As of `synth`.
        spin_rad_s: The ball's spin in the first camera's frame, rad/s; at random where not given.
        exposure_s: Exposure of the frames, seconds.
        settings: Any of `SynthSettings`.

    Yields:
        For each camera its image and `Truth`; orientations are in that camera's frame.
    """
    spin = None if spin_rad_s is None else triple("spin_rad_s", spin_rad_s)
    count = whole("frames", frames)
    sequence = _native.RigSequence(
        rig._handle, preset, settings_json(settings), seed, count, float(fps), spin, exposure_s
    )

    def of_sequence() -> Iterator[tuple[tuple[NDArray[np.uint8], Truth], ...]]:
        for k in range(count):
            views = (sequence.frame(camera, k) for camera in range(len(rig.cameras)))
            yield tuple((image, _truth(truth)) for image, truth in views)

    return of_sequence()
