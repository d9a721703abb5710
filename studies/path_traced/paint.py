"""What is painted on balls, walls and discs, as bitmaps of linear reflectance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Bitmap = NDArray[np.float32]


@dataclass(frozen=True)
class Dots:
    """Dots as drawn: middles (pattern frame), angular radii, ink."""

    directions: NDArray
    radii_rad: NDArray
    ink: NDArray


def directions(rows: NDArray, columns: NDArray, width: int, height: int) -> NDArray:
    """Where texels lie on the sphere: longitude along the columns, colatitude along the rows."""
    theta = (rows + 0.5) * np.pi / height
    phi = (columns + 0.5) * 2 * np.pi / width
    sine = np.sin(theta)[:, None]
    z = np.broadcast_to(np.cos(theta)[:, None], (len(rows), len(columns)))
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), z], axis=-1)


def add_cap(bitmap: Bitmap, direction: NDArray, radius: float, color: NDArray, inner: float = 0.0) -> None:
    """Paints a cap, or a ring from an inner radius on; edges cover texels in part."""
    height, width, _ = bitmap.shape
    texel = np.pi / height
    theta = np.arccos(np.clip(direction[2], -1, 1))
    low = max(0, int((theta - radius) / texel) - 2)
    high = min(height, int((theta + radius) / texel) + 3)
    rows = np.arange(low, high)
    # Columns within the cap's longitudes; all of them where it holds a pole.
    sine = np.sin(np.clip(theta, 1e-6, np.pi - 1e-6))
    reach = min(radius + 2 * texel, np.pi / 2)
    half = width // 2 if np.sin(reach) >= sine else int(np.arcsin(np.sin(reach) / sine) / texel) + 2
    first = int(np.arctan2(direction[1], direction[0]) / texel) - half
    columns = np.arange(first, first + min(width, 2 * half + 1)) % width
    across = 2.0 * np.arcsin(
        np.clip(np.linalg.norm(directions(rows, columns, width, height) - direction, axis=-1) / 2, 0, 1)
    )
    cover = np.clip((radius - across) / texel + 0.5, 0, 1)
    if inner > 0.0:
        cover *= np.clip((across - inner) / texel + 0.5, 0, 1)
    place = np.ix_(rows, columns)
    bitmap[place] += (cover[..., None] * (color - bitmap[place])).astype(np.float32)


def smooth_noise(rng: np.random.Generator, shape: tuple[int, int], cells: int) -> NDArray:
    """Noise of mean 0 and deviation 1 with so many cells along a side."""
    coarse = rng.standard_normal((max(2, cells * shape[0] // shape[1]) + 3, cells + 3))
    rows = np.linspace(1, coarse.shape[0] - 2, shape[0])
    columns = np.linspace(1, coarse.shape[1] - 2, shape[1])
    mesh = np.meshgrid(rows, columns, indexing="ij")
    return ndimage.map_coordinates(coarse, mesh, order=1)


def ball(rng: np.random.Generator, height: int, base: NDArray, dots: Dots | None, stripes: int, logo: bool) -> Bitmap:
    """A ball's paint: stains, a logo of rings, stripes, dots."""
    bitmap = np.empty((height, 2 * height, 3), np.float32)
    bitmap[:] = base
    stains = (1 + 0.02 * smooth_noise(rng, (64, 128), 12)).astype(np.float32)
    scale = height // 64
    bitmap.reshape(64, scale, 128, 3 * scale)[:] *= stains[:, None, :, None]
    if logo:
        middle = rng.standard_normal(3)
        middle /= np.linalg.norm(middle)
        color = rng.uniform(0.03, 0.6, 3)
        for k in range(rng.integers(1, 4)):
            outer = 0.32 - 0.11 * k
            add_cap(bitmap, middle, outer, color, outer - rng.uniform(0.02, 0.06))
    for _ in range(stripes):
        middle = rng.standard_normal(3)
        radius = rng.uniform(0.3, 1.5)
        add_cap(
            bitmap, middle / np.linalg.norm(middle), radius, rng.uniform(0.02, 0.6, 3), radius - rng.uniform(0.05, 0.3)
        )
    if dots is not None:
        for direction, radius in zip(dots.directions, dots.radii_rad, strict=True):
            add_cap(bitmap, direction, radius, dots.ink)
    return np.clip(bitmap, 0.005, 0.95, out=bitmap)


def wall(rng: np.random.Generator, size: int, albedo: float, contrast: float) -> Bitmap:
    """A wall: boards, tiles, lines, clouds or blobs; a contrast of 0 leaves it plain."""
    v, u = np.mgrid[0:size, 0:size] / size
    kind = rng.integers(5)
    turn = rng.uniform(0, np.pi)
    along, across = u * np.cos(turn) + v * np.sin(turn), v * np.cos(turn) - u * np.sin(turn)
    count = rng.integers(6, 30)
    if kind == 0:
        value = np.sin(2 * np.pi * (across * count + 0.5 * smooth_noise(rng, (size, size), 8)))
    elif kind == 1:
        value = np.where((np.floor(along * count) + np.floor(across * count)) % 2 == 0, 1.0, -1.0)
    elif kind == 2:
        value = np.where((across * count) % 1 < 0.12, -2.0, 0.3)
    elif kind == 3:
        value = smooth_noise(rng, (size, size), 6) + 0.5 * smooth_noise(rng, (size, size), 24)
    else:
        value = np.where(smooth_noise(rng, (size, size), int(count)) > 0.6, 1.5, -0.3)
    tint = 1 + 0.25 * rng.standard_normal(3)
    return np.clip(albedo * np.exp(contrast * value)[..., None] * tint, 0.01, 0.9).astype(np.float32)


def face(rng: np.random.Generator) -> Bitmap:
    """A disc with eyes, a nose and a mouth. A disc's bitmap has its radius along u and its angle along v."""
    size = 256
    radius = ((np.arange(size) + 0.5) / size)[None, :]
    angle = (2 * np.pi * (np.arange(size) + 0.5) / size)[:, None]
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    bitmap = np.empty((size, size, 3), np.float32)
    bitmap[:] = np.array([0.75, 0.5, 0.38]) * rng.uniform(0.4, 1.1)
    eye = rng.uniform(0.06, 0.14)
    dark = np.hypot(x - 0.35, y - 0.3) < eye
    dark |= np.hypot(x + 0.35, y - 0.3) < eye
    dark |= np.hypot(x, y) < 0.6 * eye
    dark |= (abs(np.hypot(x, y - 0.1) - 0.55) < 0.06) & (y < -0.2)
    dark |= (radius > 0.8) & (y > 0.3)
    bitmap[dark] = 0.04
    return bitmap
