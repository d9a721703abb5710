"""Marks on images as arrays, where a plot would be too slow or too large."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._common import Floats


def discs(image: NDArray[Any], centers: Floats, radius: float, color: Any) -> None:
    """Fills discs in place, cut by the border.

    Args:
        image: Shape (height, width) or (height, width, channels).
        centers: Pixels ``u, v``, shape (n, 2); (0, 0) is the center of the top-left one.
        radius: Pixels.
        color: A value, or one for each channel.
    """
    reach = int(np.ceil(radius))
    steps = np.arange(-reach, reach + 1)
    u, v = (grid.ravel() for grid in np.meshgrid(steps, steps))
    inside = u**2 + v**2 <= radius**2
    spread = np.stack([u, v], axis=1)[inside]
    places = (np.rint(centers).astype(np.int64)[:, None] + spread).reshape(-1, 2)
    height, width = image.shape[:2]
    kept = places[np.all((places >= 0) & (places < [width, height]), axis=1)]
    image[kept[:, 1], kept[:, 0]] = color


def ring(image: NDArray[Any], circle: tuple[float, float, float], color: Any) -> None:
    """Draws the circle ``u, v, radius``, pixels, in place, one pixel wide."""
    u, v, radius = circle
    around = np.linspace(0.0, 2.0 * np.pi, max(16, int(np.ceil(8.0 * radius))), endpoint=False)
    places = np.stack([u + radius * np.cos(around), v + radius * np.sin(around)], axis=1)
    discs(image, places, 0.0, color)
