"""A camera that is twice too long is named by whatever reads a clip. Images are cast by rays, which share nothing with the package's."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import spindoe

SIDE, RADIUS_PX, DISTANCE, DOT_RAD = 96, 30.0, 12.0, 0.1
OFF_AXIS = np.radians(22.0)
FPS = 120.0


def _turn(axis: np.ndarray) -> np.ndarray:
    angle = np.linalg.norm(axis)
    x, y, z = axis / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def _clip(dots: np.ndarray, frames: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """The camera's matrix, and images of a ball of radius 1 that turns at one place (x right, y up, z to the camera)."""
    rng = np.random.default_rng(60)
    center = DISTANCE * np.array([np.sin(OFF_AXIS), 0.0, -np.cos(OFF_AXIS)])
    focal = RADIUS_PX * np.cos(OFF_AXIS) / np.tan(np.arcsin(1 / DISTANCE))
    middle = 0.5 * (SIDE - 1)
    k = np.array([[focal, 0, middle - focal * np.tan(OFF_AXIS)], [0, focal, middle], [0, 0, 1]])
    fine = (np.arange(4 * SIDE) + 0.5) / 4 - 0.5
    u, v = np.meshgrid(fine, fine)
    rays = np.stack([(u - k[0, 2]) / focal, -(v - k[1, 2]) / focal, -np.ones_like(u)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    along = rays @ center
    inside = 1 - (DISTANCE**2 - along**2)
    normals = rays * (along - np.sqrt(np.maximum(inside, 0)))[..., None] - center
    lamp = np.array([-0.4, 0.6, 0.7]) / np.linalg.norm([-0.4, 0.6, 0.7])
    shade = 0.5 + 0.5 * np.maximum(normals @ lamp, 0)
    rotation, images = _turn(np.array([0.3, -0.8, 0.5])), []
    for _ in range(frames):
        rotation = _turn(np.array([0.1, 0.25, 0.1])) @ rotation
        nearest = (normals @ (rotation @ dots.T)).max(axis=-1)
        light = np.where(nearest > np.cos(DOT_RAD), 0.1, 0.75) * shade
        light = np.where(inside < 0, 0.08, light).reshape(SIDE, 4, SIDE, 4).mean(axis=(1, 3))
        # A blur of 0.7 pixels, and noise.
        kernel = np.exp(-0.5 * (np.arange(-3, 4) / 0.7) ** 2)
        for axis in (0, 1):
            light = np.apply_along_axis(np.convolve, axis, light, kernel / kernel.sum(), "same")
        light = np.clip(light + 0.01 * rng.standard_normal(light.shape), 0, 1)
        images.append((255 * light ** (1 / 2.2) + 0.5).astype(np.uint8))
    return k, images


@pytest.mark.parametrize("mode", ["sequence", "alone", "balls", "tracker", "a few frames of a tracker"])
def test_a_camera_twice_too_long_is_named_in_every_mode(mode: str) -> None:
    pattern = spindoe.Pattern.shipped("dots20")
    k, images = _clip(np.asarray(pattern.dots), 12)
    times = np.arange(len(images)) / FPS
    for factor in (1.0, 2.0):
        camera = spindoe.Camera(k * np.array([[factor, 1, 1], [1, factor, 1], [1, 1, 1]]))
        estimator = spindoe.Estimator(pattern, camera=camera)
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            if mode == "sequence":
                estimator.estimate_sequence(images, times)
            elif mode == "alone":
                estimator.estimate_sequence(images)
            elif mode == "balls":
                spindoe.Balls(estimator).estimate_sequence(images, times)
            else:
                tracker = estimator.tracker()
                # No end is said to it.
                few = len(images) if mode == "tracker" else 5
                for image, time_s in zip(images[:few], times):
                    tracker.update(image, time_s)
        said = [str(w.message) for w in heard if "outlines contradict the intrinsics" in str(w.message)]
        assert len(said) == (factor == 2.0), (factor, said)
