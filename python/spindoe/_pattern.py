"""Patterns, and the hash tables that estimators load."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _html, _native
from ._common import Floats, floats, settings_json

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PathLike = str | os.PathLike[str]


@dataclass(frozen=True, slots=True)
class PatternSummary:
    """Values that describe a pattern."""

    dots: int
    """Number of dots."""
    min_separation_rad: float
    """Minimum angle between two dots, radians."""
    mean_nearest_separation_rad: float
    """Mean over dots of the angle to the nearest other dot, radians."""
    min_visible: int
    """Minimum number of dots with z > 0 over all viewing directions (sampled)."""
    mean_visible: float
    """Mean number of dots with z > 0 over all viewing directions."""


class KeepOut(NamedTuple):
    """A cone that stays free of dots: a printed logo."""

    axis: tuple[float, float, float]
    """Its axis, a unit vector in the pattern's frame."""
    half_angle_rad: float
    """Angle between the axis and the nearest dot's center, radians."""


class Pattern:
    """4 to 64 distinct dots on the unit sphere.

    Args:
        dots: Array of shape (n, 3), unit vectors in the pattern's frame; the row is the dot's index.
            Lengths off 1 by up to 1e-3 are normalized.

    Raises:
        ValueError: For another shape, numbers that are not finite, lengths that are not 1, or dots
            that coincide.
    """

    __slots__ = ("_dots", "_handle")
    _handle: _native.Pattern
    _dots: Floats

    def __init__(self, dots: ArrayLike) -> None:
        self._set(_native.Pattern(floats("pattern", dots)))

    def _set(self, native: _native.Pattern) -> None:
        self._handle = native
        self._dots = native.dots()

    @classmethod
    def _of(cls, native: _native.Pattern) -> Pattern:
        pattern = cls.__new__(cls)
        pattern._set(native)
        return pattern

    @classmethod
    def load(cls, path: PathLike) -> Pattern:
        """Reads a CSV file, one dot a row, ``x,y,z``, with or without a header."""
        return cls._of(_native.Pattern.load(path))

    @classmethod
    def shipped(cls, name: str) -> Pattern:
        """A design that comes with the package, for instance ``"dots20"``; `HashTable.load` takes the names too.

        Raises:
            ValueError: For a name that is not one of `shipped_names`.
        """
        designs = dict(_native.shipped_designs())
        if name not in designs:
            raise ValueError(f"name: expected one of {', '.join(designs)}, found {name!r}")
        return cls._of(designs[name])

    @staticmethod
    def shipped_names() -> tuple[str, ...]:
        """The names of the designs that come with the package."""
        return tuple(name for name, _ in _native.shipped_designs())

    def save(self, path: PathLike) -> None:
        """Writes a CSV file without a header; digits enough to read back the same bits."""
        self._handle.save(path)

    @property
    def dots(self) -> Floats:
        """Unit vectors, shape (n, 3); a copy."""
        copy: Floats = self._dots.copy()
        return copy

    @property
    def keep_out(self) -> tuple[KeepOut, ...]:
        """Cones without dots that its file states."""
        return tuple(KeepOut((x, y, z), angle) for (x, y, z), angle in self._handle.keep_out())

    @property
    def sha256(self) -> str:
        """SHA-256 of the coordinates as little-endian float64, row by row."""
        return self._handle.sha256()

    def summary(self) -> PatternSummary:
        """Separations, and the number of dots visible from anywhere."""
        return PatternSummary(**json.loads(self._handle.summary()))

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draws both sides of the ball with the dots' numbers; see `spindoe.plot.pattern`."""
        from . import plot

        return plot.pattern(self, ax, **style)

    def _repr_html_(self) -> str:
        return _html.ball(self.dots, 0.1, repr(self))

    def __len__(self) -> int:
        return len(self._dots)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Pattern) and np.array_equal(self._dots, other._dots)

    def __hash__(self) -> int:
        return hash(self._dots.tobytes())

    def __repr__(self) -> str:
        return f"<Pattern of {len(self)} dots, {self.sha256[:8]}>"

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return _pattern, (self._dots, self._handle.keep_out())


def _pattern(dots: Floats, keep_out: list[tuple[tuple[float, float, float], float]]) -> Pattern:
    """What unpickling calls."""
    return Pattern._of(_native.Pattern(dots).with_keep_out(keep_out))


@dataclass(frozen=True, slots=True)
class DesignRecord:
    """What a pattern was designed for."""

    ball_diameter_mm: float
    """Diameter of the ball, mm."""
    dot_diameter_mm: float
    """Diameter of a dot on it, mm."""
    camera: dict[str, Any] | None = None
    """The camera's conditions, where it was designed for a camera: as in ``report.json``."""
    criterion: str | None = None
    """What it was chosen by among the candidates, in words."""


class HashTable:
    """A ball with its hash table: what a design ships.

    Made by `build` or `load`. The features follow from the dots and are made when asked for. Feature ``i`` is ``inv([d, d', d x d']) @ d''`` with the dots ``d, d' =
    bases[i]`` and ``d'' = feature_dots[i]``.
    """

    __slots__ = ("_handle",)
    _handle: _native.HashTable

    def __init__(self) -> None:
        raise TypeError("HashTable: expected HashTable.build(pattern) or HashTable.load(path)")

    @classmethod
    def _of(cls, native: _native.HashTable) -> HashTable:
        table = cls.__new__(cls)
        table._handle = native
        return table

    @classmethod
    def build(
        cls,
        pattern: Pattern | ArrayLike,
        *,
        min_cross: float = 0.1,
        max_angle_rad: float = math.radians(170.0),
        **recognizer: float,
    ) -> HashTable:
        """Computes the features of a pattern.

        Args:
            pattern: The pattern, or its dots of shape (n, 3).
            min_cross: Pairs of dots whose cross product is shorter are left out.
            max_angle_rad: Pairs farther apart, radians, are left out.
            recognizer: What the table notes of the recognizer that it is made for: ``sigma_rad``,
                ``kappa``, ``beta``, ``alpha``, ``visibility_limit``.
        """
        native = as_pattern(pattern)._handle
        given = settings_json(recognizer)
        return cls._of(_native.HashTable.build(native, min_cross, max_angle_rad, given))

    @classmethod
    def load(cls, path: PathLike) -> HashTable:
        """Reads an ``.npz`` and checks it whole; or makes the table of a pattern's CSV. A folder of a
        design or a calibration does too."""
        return cls._of(_native.HashTable.load(path))

    @classmethod
    def from_bytes(cls, data: bytes) -> HashTable:
        """The table of an ``.npz`` in memory."""
        return cls._of(_native.HashTable.from_bytes(data))

    def to_bytes(self) -> bytes:
        """The table as an ``.npz`` in memory."""
        return self._handle.to_bytes()

    def save(self, path: PathLike) -> None:
        """Writes the table as ``.npz``; the file appears whole or not at all."""
        self._handle.save(path)

    @property
    def pattern(self) -> Pattern:
        """The pattern."""
        return Pattern._of(self._handle.pattern())

    @property
    def features(self) -> Floats:
        """Hash values, shape (m, 3)."""
        return self._handle.features()

    @property
    def bases(self) -> NDArray[np.uint16]:
        """The ordered pair of dots of each feature, shape (m, 2)."""
        return self._handle.bases()

    @property
    def feature_dots(self) -> NDArray[np.uint16]:
        """The third dot of each feature, shape (m,)."""
        return self._handle.feature_dots()

    @property
    def dot_covariances(self) -> Floats | None:
        """Covariances of a calibrated ball's dots, rad^2, pattern frame, shape (n, 3, 3); None for a
        table of a design."""
        return self._handle.dot_covariances()

    @property
    def design(self) -> DesignRecord | None:
        """What the pattern was designed for: sizes, camera and criterion; None where that is not known."""
        record = self.meta.get("design")
        return None if record is None else DesignRecord(**record)

    @property
    def meta(self) -> dict[str, Any]:
        """The metadata: version, recognizer, pair rule, objective, and the validation it shipped with."""
        meta: dict[str, Any] = json.loads(self._handle.meta())
        return meta

    def _repr_html_(self) -> str:
        design = self.design
        radius_rad = design.dot_diameter_mm / design.ball_diameter_mm if design else 0.1
        return _html.ball(self.pattern.dots, radius_rad, repr(self))

    def __repr__(self) -> str:
        rows = len(self._handle.feature_dots())
        return f"<HashTable of {rows} features, {self.pattern!r}>"

    def __reduce__(self) -> tuple[Any, tuple[bytes]]:
        return HashTable.from_bytes, (self.to_bytes(),)


def as_pattern(given: Pattern | ArrayLike) -> Pattern:
    """A pattern, or dots as one."""
    return given if isinstance(given, Pattern) else Pattern(given)


Tabled = HashTable | Pattern | str | os.PathLike[str]


def as_table(given: Tabled) -> HashTable:
    """A table, the one of a pattern, or that of a file or folder (`HashTable.load`)."""
    if isinstance(given, HashTable):
        return given
    if isinstance(given, Pattern):
        return HashTable.build(given)
    if isinstance(given, (str, os.PathLike)):
        return HashTable.load(given)
    raise ValueError(f"table: expected a HashTable, a Pattern or a path, found {type(given).__name__}")


def as_ball(given: Tabled | ArrayLike) -> HashTable:
    """As `as_table`, or the table of dots."""
    if isinstance(given, (HashTable, Pattern, str, os.PathLike)):
        return as_table(given)
    return as_table(Pattern(given))
