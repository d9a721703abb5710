"""The dots of a ball as they were really drawn."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ._common import Floats, Ints
from ._pattern import HashTable, Pattern

if TYPE_CHECKING:
    from ._frame import FrameEstimate

DotState = Literal["measured", "unseen", "doubtful", "missing"]


@dataclass(slots=True, eq=False)
class SteadyMark:
    """A mark on the ball that the pattern lacks: a logo, dirt, a dot drawn far off."""

    direction: Floats
    """Where it is, pattern frame; shape (3,)."""
    covariance: Floats | None
    """As a dot's; None where the mark was not taken into the pattern."""
    found: int
    """Frames in which it was found."""
    views: int
    """Frames in which it faced the camera well."""


@dataclass(slots=True, eq=False, repr=False)
class Calibration:
    """A ball's own pattern. True where a truth value is wanted.

    Arrays over dots have the nominal pattern's order, n dots.
    """

    nominal: Pattern
    """The pattern as designed."""
    table: HashTable
    """The table of the ball as drawn, with the dots' covariances: give it to `Estimator`."""
    states: tuple[DotState, ...]
    """Of each dot: measured; doubtful, what is seen may be print or a stain; unseen, left at its nominal
    place; or missing, never found where it should be and left out of `pattern`."""
    directions: Floats
    """Where each dot is, unit vectors, pattern frame, shape (n, 3); the nominal place where it was not
    measured."""
    covariances: Floats
    """Their covariances, rad^2, pattern frame, shape (n, 3, 3); singular along the dot."""
    views: Ints
    """Frames in which each was found, shape (n,)."""
    expected_views: Floats
    """Frames in which it would be found, facing the camera well, at the rate of the other dots, shape (n,). It does
    not count the ball's edge, `views` does."""
    numbers: Ints
    """Its number in `pattern`, -1 where it is missing; shape (n,)."""
    marks: tuple[SteadyMark, ...]
    """Steady marks that the nominal pattern lacks."""
    frames: list[FrameEstimate]
    """All frames, identified with `pattern`."""
    with_ball: int
    """Frames that show a ball."""
    fitted: int
    """Frames that took part in the fit."""
    with_other_balls: int
    """Frames that show more than one ball."""
    noise_scale: float
    """Standard deviation of the detections over what the detector states."""
    detection_rate: float
    """Mean rate at which a dot is found that faces the camera well."""
    smooth: bool
    """Whether a smooth rotation was used."""
    inverse_distance: float | None
    """Ball radii over the camera's distance, where that was fitted."""
    report: dict[str, Any] | None
    """What the calibration is worth, as in the command's ``report.json``; None where it was not
    evaluated."""

    @property
    def pattern(self) -> Pattern:
        """The pattern as drawn: the dots that are not missing, then the marks that were taken in."""
        return self.table.pattern

    @property
    def offsets_rad(self) -> Floats:
        """Angle of each dot from its nominal place, radians; shape (n,)."""
        cross = np.linalg.norm(np.cross(self.nominal.dots, self.directions), axis=1)
        cosine = np.einsum("ij,ij->i", self.nominal.dots, self.directions)
        offsets: Floats = np.arctan2(cross, cosine)
        return offsets

    @property
    def sigmas_rad(self) -> Floats:
        """Standard deviation of each dot per tangent axis, radians; shape (n,)."""
        sigmas: Floats = np.sqrt(0.5 * np.trace(self.covariances, axis1=1, axis2=2))
        return sigmas

    @property
    def missing(self) -> Ints:
        """Numbers of the dots that are missing, in the nominal pattern."""
        return np.flatnonzero([state == "missing" for state in self.states])

    @property
    def rms_offset_rad(self) -> float:
        """Root mean square offset of the measured dots, radians."""
        measured = [state == "measured" for state in self.states]
        squares = self.offsets_rad[measured] ** 2
        return float(np.sqrt(squares.mean())) if squares.size else 0.0

    def __bool__(self) -> Literal[True]:
        return True

    def __repr__(self) -> str:
        measured = self.states.count("measured")
        off = np.rad2deg(self.rms_offset_rad)
        return (
            f"<Calibration: {measured} of {len(self.states)} dots measured, {len(self.missing)} "
            f"missing, {off:.2f} deg rms off, from {self.fitted} of {len(self.frames)} frames>"
        )


def calibration_of(found: Any, frames: list[FrameEstimate], nominal: Pattern) -> Calibration:
    """The native part's answer, its frames made."""
    table, dots, marks, _, counts, (noise, rate, smooth, inverse_distance), report = found
    states, directions, covariances, views, expected, numbers = dots
    with_ball, fitted, with_other_balls = counts
    return Calibration(
        nominal=nominal,
        table=HashTable._of(table),
        states=tuple(states),
        directions=directions,
        covariances=covariances,
        views=views,
        expected_views=expected,
        numbers=numbers,
        marks=tuple(SteadyMark(*mark) for mark in marks),
        frames=frames,
        with_ball=with_ball,
        fitted=fitted,
        with_other_balls=with_other_balls,
        noise_scale=noise,
        detection_rate=rate,
        smooth=smooth,
        inverse_distance=inverse_distance,
        report=None if report is None else json.loads(report),
    )
