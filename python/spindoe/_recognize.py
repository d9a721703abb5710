"""Recognizers: which dots are these, and what is the orientation?"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypedDict, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._common import Floats, Ints, Rejection, floats, settings_json, to_scipy, whole, wxyz
from ._pattern import HashTable, Tabled, as_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from scipy.spatial.transform import Rotation
    from typing_extensions import Unpack

    from ._image import Color, Image

RecognizerName = Literal["robust", "voting"]
ProtocolName = Literal["paper", "sparse", "clutter", "image"]


@dataclass(frozen=True, slots=True, eq=False)
class Hint:
    """A prior orientation: the last frame's, propagated by the spin."""

    quaternion_wxyz: ArrayLike
    """Expected rotation from the pattern's frame to the camera's, scalar first."""
    covariance: ArrayLike
    """Covariance of the rotation vector that leads from it to the true one, camera frame, rad^2: a
    standard deviation (radians, about every axis), or a matrix of shape (3, 3)."""
    wrong: float = 0.05
    """Probability that the hint is entirely wrong, in (0, 1)."""

    def _given(self) -> tuple[tuple[float, float, float, float], Floats, float]:
        covariance = floats("hint.covariance", self.covariance)
        if covariance.ndim == 0:
            covariance = np.eye(3) * covariance**2
        return wxyz("hint.quaternion_wxyz", self.quaternion_wxyz), covariance, float(self.wrong)


@dataclass(slots=True, eq=False)
class Rival:
    """Another pose that explains the dots."""

    quaternion_wxyz: Floats
    """Pattern to camera, scalar first, w >= 0."""
    confidence: float
    """Probability that this is the right one."""

    def as_rotation(self) -> Rotation:
        """SciPy's rotation."""
        return to_scipy(self.quaternion_wxyz)


@dataclass(slots=True, eq=False, repr=False)
class Identification:
    """The dots are identified. True where a truth value is wanted."""

    quaternion_wxyz: Floats
    """Rotation from the pattern's frame to the camera's, scalar first, w >= 0; shape (4,)."""
    assignment: Ints
    """For each observed dot the pattern's dot that it is, -1 for a false one; shape (n,)."""
    residual_rad: float
    """Root mean square angle between the matched dots and the rotated pattern, radians."""
    dots_confidence: float
    """Probability that every dot is identified correctly."""
    confidence: float
    """Probability that the orientation is correct, whatever single dots are."""
    rivals: tuple[Rival, ...] = ()
    """Other poses that explain the dots, the most probable first."""

    @property
    def matched(self) -> int:
        """Number of dots that are matched with one of the pattern."""
        return int(np.count_nonzero(self.assignment >= 0))

    def as_rotation(self) -> Rotation:
        """SciPy's rotation: ``found.as_rotation().apply(pattern.dots)`` are the dots as seen."""
        return to_scipy(self.quaternion_wxyz)

    def plot(
        self,
        image: Image | None = None,
        *,
        table: Tabled,
        dots: ArrayLike | None = None,
        circle: ArrayLike | None = None,
        color: Color | None = None,
        ax: Axes | None = None,
    ) -> Axes:
        """Draws the identified pattern onto the image; see `spindoe.plot.identification`."""
        from . import plot

        return plot.identification(
            self, image, table=table, dots=dots, circle=circle, color=color, ax=ax
        )

    def __bool__(self) -> Literal[True]:
        return True

    def __repr__(self) -> str:
        w, x, y, z = self.quaternion_wxyz
        return (
            f"<Identification wxyz [{w:.4f} {x:.4f} {y:.4f} {z:.4f}], {self.matched} of "
            f"{len(self.assignment)} dots, p = {self.confidence:.4f}>"
        )


@dataclass(slots=True, eq=False, repr=False)
class Identifications(Sequence[Identification | Rejection]):
    """Many views, in columns. An index gives one view's answer; views without one have NaN."""

    quaternions_wxyz: Floats
    """Shape (frames, 4)."""
    assignment: Ints
    """Of all dots in a row, shape (dots,)."""
    offsets: Ints
    """Frame ``i`` has the dots from ``offsets[i]`` to ``offsets[i + 1]``; shape (frames + 1,)."""
    residual_rad: Floats
    """Shape (frames,)."""
    dots_confidence: Floats
    """Shape (frames,)."""
    confidence: Floats
    """Shape (frames,)."""
    reasons: dict[int, str]
    """Why a frame has no answer."""

    @property
    def identified(self) -> NDArray[np.bool_]:
        """Which frames have an answer, shape (frames,)."""
        return ~np.isnan(self.dots_confidence)

    def as_rotations(self) -> Rotation:
        """SciPy's rotations of the frames that have one."""
        return to_scipy(self.quaternions_wxyz[self.identified])

    def __len__(self) -> int:
        return len(self.dots_confidence)

    @overload
    def __getitem__(self, index: int) -> Identification | Rejection: ...
    @overload
    def __getitem__(self, index: slice) -> list[Identification | Rejection]: ...
    def __getitem__(
        self, index: int | slice
    ) -> Identification | Rejection | list[Identification | Rejection]:
        if isinstance(index, slice):
            return [self[i] for i in range(*index.indices(len(self)))]
        i = index + len(self) if index < 0 else index
        if not 0 <= i < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        if i in self.reasons:
            return Rejection(self.reasons[i])
        return Identification(
            self.quaternions_wxyz[i],
            self.assignment[self.offsets[i] : self.offsets[i + 1]],
            float(self.residual_rad[i]),
            float(self.dots_confidence[i]),
            float(self.confidence[i]),
        )

    def __iter__(self) -> Iterator[Identification | Rejection]:
        return (self[i] for i in range(len(self)))

    def __repr__(self) -> str:
        return f"<Identifications: {int(self.identified.sum())} of {len(self)} frames identified>"

class RecognizerSettings(TypedDict, total=False):
    """What the robust recognizer may expect otherwise than usual, or than ``expect`` says."""

    visibility_limit: float
    """Minimum z of a visible dot, camera frame, ball of radius 1; 0."""
    detection_probability: float
    """Probability that a dot well inside the visible cap is detected; 0.9."""
    expected_false_dots: float
    """Mean of the number of false dots of a view, where that varies; 0.5."""
    usual_false_dots: int
    """Or the number of nearly every view."""
    foreign_share: float
    """Share of the views that show something else than this ball; 0.2."""
    noise: Literal["normal", "heavy_tailed", "random_axis"]
    """Distribution of a dot's error; heavy-tailed."""
    passes: int
    """Maximum number of pairs of dots that the search aligns with the pattern; 64."""
    mirror_doubt: float
    """Probability of the pose below which a view is also searched mirrored; 0.9."""


class PaperSettings(TypedDict, total=False):
    """What the paper's recognizer may have otherwise than the table notes."""

    k: int
    """Number of nearest features that vote for each further dot."""
    kappa: float
    """Concentration of the Kent density."""
    beta: float
    """Its ovalness, ``0 <= 2 beta < kappa``."""
    alpha: float
    """Standard deviation of a dot's distance from the center, which is 1, in the score."""
    verify_fraction: float
    """Share of the bases with votes that is verified, best scores first."""
    vote_sum: Literal["log-density", "density"]
    """The sum that forms a basis' score."""


def check_recognizer(name: str) -> None:
    """Raises for a name that no recognizer has."""
    if name not in ("robust", "voting"):
        renamed = "; the paper's recognizer is now voting" if name == "paper" else ""
        raise ValueError(f"recognizer: expected robust or voting, found {name!r}{renamed}")


class Recognizer:
    """Identifies the dots of views.

    Args:
        table: The table, a pattern, or the path of either.
        recognizer: ``"robust"``, which knows missed and false dots and is sure of itself with reason,
            or ``"voting"``, the SpinDOE paper's, the baseline.
        expect: Misses, false dots and noise as in this validation protocol.
        sigma_rad: Standard deviation of a dot along one tangent axis, radians, where `identify` gets
            none; by default the table's noise over sqrt 3.
        min_confidence: Orientations with a smaller probability are rejected as ambiguous; by default
            ``MIN_CONFIDENCE_DOTS``, and 0 for the paper's recognizer, whose confidence is a share of votes.
        settings: Any of `RecognizerSettings`; for ``"voting"`` any of `PaperSettings`.

    An instance may be used from several threads.
    """

    __slots__ = ("_arguments", "_handle", "table")
    _handle: _native.Recognizer
    table: HashTable
    """The table in use."""

    @overload
    def __init__(
        self,
        table: Tabled,
        recognizer: Literal["robust"] = "robust",
        *,
        expect: ProtocolName | None = None,
        sigma_rad: float | None = None,
        min_confidence: float | None = None,
        **settings: Unpack[RecognizerSettings],
    ) -> None: ...
    @overload
    def __init__(
        self,
        table: Tabled,
        recognizer: Literal["voting"],
        *,
        sigma_rad: float | None = None,
        min_confidence: float | None = None,
        **settings: Unpack[PaperSettings],
    ) -> None: ...
    def __init__(
        self,
        table: Tabled,
        recognizer: RecognizerName = "robust",
        *,
        expect: ProtocolName | None = None,
        sigma_rad: float | None = None,
        min_confidence: float | None = None,
        **settings: Any,
    ) -> None:
        self.table = as_table(table)
        self._arguments = (recognizer, expect, sigma_rad, min_confidence, settings)
        native = self.table._handle
        check_recognizer(recognizer)
        if recognizer == "robust":
            given = settings_json(settings)
            least = _native.MIN_CONFIDENCE_DOTS if min_confidence is None else min_confidence
            self._handle = _native.Recognizer.robust(native, expect, given, sigma_rad, least)
        else:
            if expect is not None:
                raise ValueError("expect: the paper's recognizer has no expectations")
            names = PaperSettings.__annotations__
            for name in settings:
                if name not in names:
                    raise ValueError(f"{name}: no such setting, expected one of {', '.join(names)}")
            get = settings.get
            self._handle = _native.Recognizer.paper(
                native,
                get("k"),
                get("kappa"),
                get("beta"),
                get("alpha"),
                get("verify_fraction"),
                get("vote_sum"),
                sigma_rad,
                0.0 if min_confidence is None else min_confidence,
            )

    @property
    def settings(self) -> dict[str, Any]:
        """The robust recognizer's settings in use."""
        settings: dict[str, Any] = json.loads(self._handle.settings())
        return settings

    def identify(
        self,
        dots: ArrayLike,
        covariances: ArrayLike | None = None,
        hint: Hint | None = None,
        *,
        sigma_rad: ArrayLike | None = None,
        max_rivals: int = 3,
        min_rival_confidence: float = 0.001,
    ) -> Identification | Rejection:
        """Identifies the dots of one view.

        Args:
            dots: Unit vectors in the camera frame (x right, y up, z towards the camera), shape
                (n, 3); 256 at most.
            covariances: Of the dots, rad^2: shape (n, 3, 3) in the camera frame, or (n, 2, 2) in
                the axes outward in the image and, counter-clockwise, across.
            hint: Prior orientation; for the robust recognizer.
            sigma_rad: Standard deviations along one tangent axis instead, one or shape (n,).
            max_rivals: Number of other poses that are listed at most; there are 59 at most.
            min_rival_confidence: Minimum probability of those, from 0.001 on.

        Returns:
            An `Identification`, which is true, or a `Rejection`, which is false and has a reason.

        Raises:
            ValueError: For wrong shapes, numbers that are not finite, and vectors that are no unit
                vectors.
        """
        given = floats("dots", dots)
        found = self._handle.identify(
            # An empty list has no second side.
            given if given.size else given.reshape(0, 3),
            None if sigma_rad is None else floats("sigma_rad", sigma_rad),
            None if covariances is None else floats("covariances", covariances),
            None if hint is None else hint._given(),
            whole("max_rivals", max_rivals),
            min_rival_confidence,
        )
        if isinstance(found, str):
            return Rejection(found)
        quaternion, assignment, residual_rad, dots_confidence, confidence, rivals = found
        return Identification(
            quaternion,
            assignment,
            residual_rad,
            dots_confidence,
            confidence,
            tuple(Rival(*rival) for rival in rivals),
        )

    def identify_batch(
        self,
        frames: Sequence[ArrayLike] | ArrayLike,
        offsets: ArrayLike | None = None,
        *,
        covariances: ArrayLike | None = None,
        sigma_rad: ArrayLike | None = None,
    ) -> Identifications:
        """Identifies the dots of many views on all cores.

        Args:
            frames: The views, each of shape (n_i, 3); or, with `offsets`, all dots in a row, shape
                (dots, 3).
            offsets: Frame ``i`` has the rows from ``offsets[i]`` to ``offsets[i + 1]``.
            covariances: As in `identify`, of all dots in a row.
            sigma_rad: As in `identify`, of all dots in a row.
        """
        if offsets is None:
            views = [floats(f"frames[{i}]", frame) for i, frame in enumerate(frames)]  # type: ignore[arg-type]
            for i, view in enumerate(views):
                if view.ndim != 2 or view.shape[1] != 3:
                    raise ValueError(f"frames[{i}]: expected shape (n, 3), found {view.shape}")
            ends = np.zeros(len(views) + 1, dtype=np.int64)
            np.cumsum([len(view) for view in views], out=ends[1:])
            dots = np.concatenate(views) if views else np.zeros((0, 3))
        else:
            dots = floats("frames", frames)  # type: ignore[arg-type]
            given = np.asarray(offsets)
            if given.ndim != 1 or given.dtype.kind not in "iu" or not len(given):
                raise ValueError("offsets: expected a row of whole numbers, from 0 on")
            ends = given.astype(np.int64)
        columns = self._handle.identify_batch(
            dots,
            ends,
            None if sigma_rad is None else floats("sigma_rad", sigma_rad),
            None if covariances is None else floats("covariances", covariances),
        )
        quaternions, assignment, residual, dots_confidence, confidence, reasons = columns
        return Identifications(
            quaternions, assignment, ends, residual, dots_confidence, confidence, reasons
        )

    def __repr__(self) -> str:
        return f"<Recognizer {self._arguments[0]} of {self.table.pattern!r}>"

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return _recognizer, (self.table, *self._arguments)


def _recognizer(
    table: HashTable,
    recognizer: Any,
    expect: ProtocolName | None,
    sigma_rad: float | None,
    min_confidence: float | None,
    settings: dict[str, Any],
) -> Recognizer:
    """What unpickling calls."""
    return Recognizer(
        table,
        recognizer,
        expect=expect,
        sigma_rad=sigma_rad,
        min_confidence=min_confidence,
        **settings,
    )
