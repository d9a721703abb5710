"""Stencils to print, as files and as meshes."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._common import Floats, settings_json
from ._pattern import PathLike, Pattern, as_pattern

if TYPE_CHECKING:
    import trimesh


class Stencil:
    """Two half shells with a hole for every dot.

    Args:
        pattern: The pattern, or its dots of shape (n, 3).
        settings: Any field of the library's ``StencilConfig``, lengths in millimeters, angles in
            radians: ``ball_diameter_mm``, ``hole_diameter_mm``, ``clearance_mm``, ``wall_mm``, ...

    Raises:
        ValueError: For a setting outside its domain, or holes that do not fit.
    """

    __slots__ = ("_handle", "_settings", "pattern")
    _handle: _native.Stencil
    pattern: Pattern

    def __init__(self, pattern: Pattern | ArrayLike, **settings: Any) -> None:
        self.pattern = as_pattern(pattern)
        self._settings = settings
        self._handle = _native.Stencil.build(self.pattern._handle, settings_json(settings))

    @staticmethod
    def largest_hole_mm(pattern: Pattern | ArrayLike, **settings: Any) -> float | None:
        """Diameter of the largest hole that fits, mm; None where none does."""
        native = as_pattern(pattern)._handle
        return _native.Stencil.largest_hole_mm(native, settings_json(settings))

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
        return _stencil, (self.pattern, self._settings)


def _stencil(pattern: Pattern, settings: dict[str, Any]) -> Stencil:
    """What unpickling calls."""
    return Stencil(pattern, **settings)
