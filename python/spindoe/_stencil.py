"""Stencils to print, as files and as meshes."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._common import Floats, settings_json
from ._pattern import HashTable, PathLike, Pattern, Tabled, as_ball

if TYPE_CHECKING:
    import trimesh


class Stencil:
    """Two half shells with a hole for every dot.

    Args:
        pattern: A table, a pattern, the path of either, or dots of shape (n, 3).
        ball_diameter_mm: Diameter of the ball; that of the design where not given, else 40 mm.
        hole_diameter_mm: Diameter of a dot; that of the design where not given, as much larger or smaller
            on a ball of another size; else a tenth of the ball's.
        settings: Any other field of the library's ``StencilConfig``, lengths in millimeters, angles in
            radians: ``clearance_mm``, ``wall_mm``, ...

    Raises:
        ValueError: For a setting outside its domain, or holes that do not fit.
    """

    __slots__ = ("_ball", "_handle", "_settings")
    _handle: _native.Stencil
    _ball: HashTable

    def __init__(
        self,
        pattern: Tabled | ArrayLike,
        *,
        ball_diameter_mm: float | None = None,
        hole_diameter_mm: float | None = None,
        **settings: Any,
    ) -> None:
        self._ball = as_ball(pattern)
        self._settings = {
            "ball_diameter_mm": ball_diameter_mm,
            "hole_diameter_mm": hole_diameter_mm,
            **settings,
        }
        self._handle = _native.Stencil.build(
            self._ball._handle, ball_diameter_mm, hole_diameter_mm, settings_json(settings)
        )

    @staticmethod
    def largest_hole_mm(
        pattern: Tabled | ArrayLike, *, ball_diameter_mm: float | None = None, **settings: Any
    ) -> float | None:
        """Diameter of the largest hole that fits, mm; None where none does."""
        native = as_ball(pattern)._handle
        return _native.Stencil.largest_hole_mm(native, ball_diameter_mm, settings_json(settings))

    @property
    def pattern(self) -> Pattern:
        """The pattern that it draws."""
        return self._ball.pattern

    def arrays(self, half: Literal["a", "b"]) -> tuple[Floats, NDArray[np.uint32]]:
        """Vertices, shape (n, 3), millimeters, and triangles, shape (m, 3), of a half as it is printed."""
        return self._handle.half(half)

    def to_trimesh(self, half: Literal["a", "b"]) -> trimesh.Trimesh:
        """A half as `trimesh.Trimesh`, millimeters."""
        import trimesh

        vertices, faces = self.arrays(half)
        return trimesh.Trimesh(vertices, faces.astype(np.int64), process=False)

    def save(self, dir: PathLike) -> None:
        """Writes ``half_a.stl``, ``half_b.stl``, ``stencil.3mf`` and ``stencil.json``."""
        self._handle.save(dir)

    @property
    def description(self) -> dict[str, Any]:
        """What ``stencil.json`` holds."""
        description: dict[str, Any] = json.loads(self._handle.description())
        return description

    def __repr__(self) -> str:
        return f"<Stencil of {self.pattern!r}>"

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return _stencil, (self._ball, self._settings)


def _stencil(ball: HashTable, settings: dict[str, Any]) -> Stencil:
    """What unpickling calls."""
    return Stencil(ball, **settings)
