"""Stencils to print, as files and as meshes."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Literal, TypedDict

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._common import Floats, optional, settings_json
from ._pattern import HashTable, PathLike, Pattern, Tabled, as_ball

if TYPE_CHECKING:
    import trimesh
    from typing_extensions import Unpack


_KNOWN = ("ball_diameter_mm", "hole_diameter_mm")


class StencilSettings(TypedDict, total=False):
    """What a stencil may have otherwise than usual: lengths in millimeters, angles in radians."""

    ball_diameter_mm: float
    """Diameter of the ball; that of the design, else 40. Table-tennis balls are 40.0 to 40.6 mm: measure yours."""
    clearance_mm: float
    """Gap between ball and shell, per side; 0.2."""
    wall_mm: float
    """Thickness of the shell; 2.8."""
    ceiling_relief_mm: float
    """How much farther from the ball the dome's inside lies around its top; 0.3."""
    hole_diameter_mm: float
    """Diameter of a dot; that of the design, as much larger or smaller on a ball of another size, else a tenth of the ball's."""
    throat_mm: float
    """Length of the cylindrical throat at the ball before a hole widens; 0.8."""
    taper_rad: float
    """Half-angle of the cone by which a hole widens outwards; 30 degrees."""
    min_web_mm: float
    """Minimum material between two holes, and between a hole and a rim, the hinge or the tab; 0.8."""
    seam_margin_rad: float
    """Wanted distance of the dots' centers from the seam; 10 degrees."""
    seam_gap_mm: float
    """Gap between the two rims, square to their cone; 0.2."""
    closure: Literal["screw", "pin"]
    """What holds the hinge together; a screw."""
    screw_diameter_mm: float
    """Nominal diameter of the hinge's screw or pin; 3."""
    bore_allowance_mm: float
    """By how much the bore is wider than the screw; 0.2."""
    hinge_length_mm: float
    """Length of the hinge along its screw; 15."""
    knuckles: int
    """Number of interleaved knuckles, odd; 3."""
    knuckle_clearance_mm: float
    """Gap between knuckles, and between knuckles and the other half's shell; 0.4."""
    knuckle_wall_mm: float
    """Material around the screw's bore; 1.2."""
    tab_mm: float
    """How far the thumb tab reaches beyond the shell; 6."""
    numbers: bool
    """Whether the dots' numbers are engraved; true."""
    nozzle_mm: float
    """Width of the printer's nozzle: no wall may be thinner; 0.4."""
    segments: int
    """Pieces of a half, cut along meridians, for beds that are too small; 1."""
    chord_error_mm: float
    """Maximum distance of a facet from the surface that it approximates; 0.02."""


class Stencil:
    """Two half shells with a hole for every dot.

    Args:
        pattern: A table, a pattern, the path of either, or dots of shape (n, 3).
        settings: Any of `StencilSettings`, lengths in millimeters, angles in radians.

    Raises:
        ValueError: For a setting outside its domain, or holes that do not fit.
    """

    __slots__ = ("_ball", "_handle", "_settings")
    _handle: _native.Stencil
    _ball: HashTable

    def __init__(self, pattern: Tabled | ArrayLike, **settings: Unpack[StencilSettings]) -> None:
        self._ball = as_ball(pattern)
        self._settings = settings
        ball_mm, hole_mm, rest = _parted(settings)
        self._handle = _native.Stencil.build(self._ball._handle, ball_mm, hole_mm, rest)

    @staticmethod
    def largest_hole_mm(
        pattern: Tabled | ArrayLike, **settings: Unpack[StencilSettings]
    ) -> float | None:
        """Diameter of the largest hole that fits, mm; None where none does."""
        native = as_ball(pattern)._handle
        ball_mm, _, rest = _parted(settings)
        return _native.Stencil.largest_hole_mm(native, ball_mm, rest)

    @property
    def pattern(self) -> Pattern:
        """The pattern that it draws."""
        return self._ball.pattern

    def arrays(self, half: Literal["a", "b"]) -> tuple[Floats, NDArray[np.uint32]]:
        """Vertices, shape (n, 3), millimeters, and triangles, shape (m, 3), of a half as it is printed."""
        return self._handle.half(half)

    def to_trimesh(self, half: Literal["a", "b"]) -> trimesh.Trimesh:
        """A half as `trimesh.Trimesh`, millimeters."""
        library = optional("trimesh", "mesh")
        vertices, faces = self.arrays(half)
        mesh: trimesh.Trimesh = library.Trimesh(vertices, faces.astype(np.int64), process=False)
        return mesh

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


def _parted(settings: StencilSettings) -> tuple[float | None, float | None, str]:
    """The diameters that a design may know, and what else is set."""
    rest = {name: value for name, value in settings.items() if name not in _KNOWN}
    return settings.get("ball_diameter_mm"), settings.get("hole_diameter_mm"), settings_json(rest)


def _stencil(ball: HashTable, settings: StencilSettings) -> Stencil:
    """What unpickling calls."""
    return Stencil(ball, **settings)
