"""The camera, where it sees a ball, and the project's frames.

Lengths are ball radii. Camera frame: x right, y up, z from the scene towards the camera, which stands at the
origin. Pixels: u right, v down, the center of the top-left pixel at (0, 0).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """A pinhole with square pixels."""

    width: int
    height: int
    focal_px: float
    cx: float
    cy: float

    def project(self, points: Array) -> Array:
        """Pixels (u, v) of points of the camera frame."""
        depth = -points[..., 2]
        u = self.cx + self.focal_px * points[..., 0] / depth
        v = self.cy - self.focal_px * points[..., 1] / depth
        return np.stack([u, v], axis=-1)

    def ray(self, u: float, v: float) -> Array:
        """The unit vector towards a pixel."""
        ray = np.array([(u - self.cx) / self.focal_px, (self.cy - v) / self.focal_px, -1.0])
        return ray / np.linalg.norm(ray)


@dataclass(frozen=True)
class Outline:
    """The ellipse that a ball is seen within."""

    u: float
    v: float
    half_axes_px: tuple[float, float]
    angle_rad: float

    @property
    def radius_px(self) -> float:
        """Radius of the circle of the same area."""
        return float(np.sqrt(self.half_axes_px[0] * self.half_axes_px[1]))


def outline(camera: Camera, center: Array) -> Outline:
    """The outline of a ball of radius 1.

    Rays x that touch it satisfy (x . c)^2 = (c . c - 1) (x . x): a conic, whose center and axes are those of the
    ellipse in the image.
    """
    # Right, down, forward, so that (x, y, 1) is a ray.
    c = center * np.array([1.0, -1.0, -1.0])
    conic = np.outer(c, c) - (c @ c - 1.0) * np.eye(3)
    middle = np.linalg.solve(conic[:2, :2], -conic[:2, 2])
    value = conic[2, 2] + conic[:2, 2] @ middle
    eigenvalues, axes = np.linalg.eigh(conic[:2, :2])
    half = np.sqrt(-value / eigenvalues) * camera.focal_px
    order = np.argsort(-half)
    long = axes[:, order[0]]
    u, v = camera.cx + camera.focal_px * middle[0], camera.cy + camera.focal_px * middle[1]
    halves = (float(half[order[0]]), float(half[order[1]]))
    return Outline(float(u), float(v), halves, float(np.arctan2(long[1], long[0])))


def place(camera: Camera, u: float, v: float, radius_px: float) -> Array:
    """The center of a ball whose center is seen at a pixel, with an outline as large as a circle of this radius."""
    ray = camera.ray(u, v)
    distance = camera.focal_px / radius_px
    for _ in range(20):
        distance *= outline(camera, distance * ray).radius_px / radius_px
    return distance * ray


def view_rotation(center: Array) -> Rotation:
    """From the camera frame to the view frame: the smallest rotation that turns the direction from the ball to the
    camera into z."""
    back = -center / np.linalg.norm(center)
    axis = np.cross(back, [0.0, 0.0, 1.0])
    sine = np.linalg.norm(axis)
    if sine < 1e-12:
        return Rotation.identity()
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, back[2]))


def wxyz(rotation: Rotation) -> list[float]:
    """A quaternion, scalar first, not negative."""
    x, y, z, w = rotation.as_quat()
    sign = -1.0 if w < 0 else 1.0
    return [float(sign * q) for q in (w, x, y, z)]


def facing(center: Array, directions: Array) -> Array:
    """Cosines under which places of the ball's surface face the camera."""
    points = center + directions
    return -(directions * points).sum(-1) / np.linalg.norm(points, axis=-1)
