"""All balls of a frame, and the images of one ball in an exposure with several flashes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._common import Floats, Progress, Rejection, clip_asked, floats, progress_of, whole
from ._frame import FrameEstimate, frame_of
from ._image import Color, Image, frames_of, pixels
from ._pattern import HashTable
from ._vision import Estimator

Flight = Literal["left", "right", "up", "down"]
"""The direction in which a ball flies across the picture."""


@dataclass(frozen=True, slots=True)
class BallEstimate:
    """One of the balls of a frame."""

    frame: FrameEstimate
    """Its outline, dots and pose, or why it has none."""
    table: HashTable
    """The table that fits it best."""
    table_probabilities: tuple[float, ...]
    """Probability of each table by the dots of this frame, in the order of the estimators."""
    number: int | None = None
    """Its number in a sequence, which it keeps; None in single frames, and without an outline."""


@dataclass(frozen=True, slots=True)
class GolfSpin:
    """A spin in golf's words, as ``spindoe estimate --preset golf`` gives them."""

    total_rpm: float
    """Magnitude, revolutions per minute."""
    backspin_rpm: float
    """About the horizontal axis across the flight; positive lifts the ball."""
    sidespin_rpm: float
    """About the vertical; positive bends the flight to the right."""
    rifle_rpm: float
    """About the line of flight."""
    tilt_deg: float
    """Tilt of the spin's axis, degrees; positive bends the flight to the right."""
    std_rpm: tuple[float, float] | None
    """Standard deviations of backspin and sidespin, rpm, where they are known."""
    spin_type: Literal["measured", "estimated"]
    """Measured: three images or more agree on the spin, and odds of 20 to 1 or better exclude any other and any other order of the
    images. Estimated: it rests on an assumption, as that of two images does."""


@dataclass(frozen=True, slots=True)
class StrobeHypothesis:
    """One way in which the images of an exposure and its flashes may belong together."""

    probability: float
    """Its probability among all."""
    lit: tuple[tuple[int, int], ...]
    """The balls, by their place in `StrobeEstimate.balls`, with the flashes that lit them, in order of time."""
    missed: tuple[int, ...]
    """Flashes without an image."""
    flight: Flight
    """The direction of flight: as given, else the one nearest to that motion."""
    velocity_px_s: tuple[float, float]
    """Velocity of the ball's center in the picture, pixels a second (u, v)."""
    spin_rad_s: Floats | Rejection
    """The spin vector, in the frame of the poses, or why there is none."""
    covariance: Floats | None
    """Its covariance, (rad/s)^2."""
    alternatives: Floats
    """Faster spins that explain the images as well, shape (n, 3)."""
    golf: GolfSpin | None
    """The spin in golf's words, of a flight in that direction; None without a spin."""
    _shot: str | None = None

    def open_connect(self, shot_number: int = 1) -> dict[str, Any] | None:
        """The shot as golf simulators read it, GSPro's Open Connect V1; None without a spin. ``json.dumps`` makes the message of it.

        Speed and directions are in it where the ball's positions are known, by intrinsics and the ball's diameter; only then
        ``ContainsBallData`` is true. ``SpinType`` says whether the spin is measured or estimated.
        """
        if self._shot is None:
            return None
        shot: dict[str, Any] = json.loads(self._shot)
        return shot | {"ShotNumber": shot_number}


@dataclass(frozen=True, slots=True)
class StrobeEstimate:
    """An exposure with several flashes."""

    balls: list[BallEstimate]
    """All images of the ball, those with a pose first."""
    hypotheses: list[StrobeHypothesis]
    """What they may show, the likeliest first; none for fewer than two images."""


class Balls:
    """Estimates all balls of a frame.

    Args:
        estimators: One for each table that a ball may carry.
        count: How many balls a frame has; by default as many as there are.

    An instance may be used from several threads.
    """

    __slots__ = ("_handle", "count", "estimators")
    estimators: tuple[Estimator, ...]
    """One for each table."""
    count: int | None
    """How many balls a frame has, where that is given."""

    def __init__(self, estimators: Estimator | Sequence[Estimator], count: int | None = None) -> None:
        several = (estimators,) if isinstance(estimators, Estimator) else tuple(estimators)
        self.estimators = several
        self.count = None if count is None else whole("count", count)
        self._handle = _native.Balls([one._handle for one in several], self.count)

    def estimate(self, image: Image, *, color: Color | None = None) -> list[BallEstimate]:
        """The balls of one frame, those with a pose first."""
        return [self._ball(ball) for ball in self._handle.estimate(*self._pixels(image, color))]

    def estimate_sequence(
        self,
        images: Sequence[Image] | NDArray[Any],
        times_s: ArrayLike,
        *,
        color: Color | None = None,
        roi: Sequence[int] | None = None,
        mirrored: bool = False,
        judge: bool = True,
        max_rps: float = 175.0,
        progress: bool | Progress = False,
    ) -> list[list[BallEstimate]]:
        """The balls of every frame of a sequence, from left to right; each keeps its number. Balls that are missing in a frame are
        searched where the neighboring frames predict them. A pose by another table than that of all frames of its ball together is
        removed.

        Args:
            images: The frames, as of `Estimator.estimate_sequence`.
            times_s: Their times in seconds, increasing, shape (n,).
            color: As in `Estimator.estimate`.
            roi: The part of the images in which the balls are: left, top, width, height, pixels.
            mirrored: The images are mirrored: left and right are exchanged first.
            judge: Whether all frames of a ball together decide if one of the tables fits and the images are mirrored; a ball that none
                fits keeps no pose.
            max_rps: Largest spin considered, revolutions per second.
            progress: As in `Estimator.estimate_sequence`.
        """
        frames, order = frames_of(images, color)
        self.estimators[0].camera._check_all(frames)
        times = [float(t) for t in floats("times_s", times_s)]
        asked = clip_asked(roi=roi, mirrored=mirrored, judge=judge, max_rps=max_rps)
        show, bar = progress_of(progress, len(frames), "frame")
        try:
            found = self._handle.estimate_sequence(frames, order, times, asked, show)
        finally:
            if bar is not None:
                bar.close()
        return [[self._ball(ball, number) for number, ball in balls] for balls in found]

    def estimate_strobe(
        self,
        image: Image,
        times_s: ArrayLike,
        *,
        flight: Flight | None = None,
        color: Color | None = None,
        max_rps: float = 250.0,
    ) -> StrobeEstimate:
        """The images of one ball in an exposure with flashes at these times, seconds; its spin follows from them alone. Of
        several tables all images have the one that explains them best together.

        Args:
            image: The exposure.
            times_s: Times of the flashes, ascending: 2 to 8 within a second.
            flight: The direction of flight; where it is not given and the images leave it open, both are hypotheses.
            color: As in `Estimator.estimate`.
            max_rps: Largest spin considered, revolutions per second.
        """
        times = [float(t) for t in floats("times_s", times_s)]
        balls, found = self._handle.estimate_strobe(
            *self._pixels(image, color), times, flight, float(max_rps)
        )
        return StrobeEstimate([self._ball(ball) for ball in balls], [_hypothesis(h) for h in found])

    def _pixels(self, image: Image, color: Color | None) -> tuple[Any, Any]:
        taken, order = pixels("image", image, color)
        self.estimators[0].camera._check("image", taken)
        return taken, order

    def __reduce__(self) -> tuple[type[Balls], tuple[Any, ...]]:
        return Balls, (self.estimators, self.count)

    def _ball(self, found: _native._Ball, number: int | None = None) -> BallEstimate:
        frame, table, probabilities = found
        return BallEstimate(
            frame_of(frame), self.estimators[table].table, tuple(probabilities), number
        )


def _hypothesis(found: _native._Strobed) -> StrobeHypothesis:
    probability, lit, missed, flight, velocity, spin = found
    vector: Floats | Rejection
    covariance: Floats | None
    others: list[list[float]]
    golf: _native._Golf | None
    shot: str | None
    if isinstance(spin, str):
        vector, covariance, others, golf, shot = Rejection(spin), None, [], None, None
    else:
        vector, covariance, others, golf, shot = spin
    return StrobeHypothesis(
        probability,
        tuple(lit),
        tuple(missed),
        cast("Flight", flight),
        (velocity[0], velocity[1]),
        vector,
        covariance,
        np.array(others, dtype=np.float64).reshape(-1, 3),
        None if golf is None else _golf(golf),
        shot,
    )


def _golf(words: _native._Golf) -> GolfSpin:
    (total, back, side, rifle), tilt, std, spin_type = words
    return GolfSpin(
        total, back, side, rifle, tilt, None if std is None else (std[0], std[1]), cast("Any", spin_type)
    )
