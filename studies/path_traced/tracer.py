"""Light on the sensor's pixels, by Mitsuba's path tracer."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from camera import Array, Camera, outline
from scene import Scene, rgb

mi.set_variant("scalar_rgb")
mi.set_log_level(mi.LogLevel.Error)
T = mi.ScalarTransform4f

Box = tuple[int, int, int, int]
"""First column and row, columns, rows."""

MARGIN_PX = 10
"""Rendered about a crop: defocus reaches so far, and the sharp part fades into the surroundings there."""
MAX_STEP_PX = 1.0
"""The ball's surface moves so far from one instant of an exposure to the next, where samples suffice."""


def rotated(rotation: Rotation) -> Any:
    """The renderer's transform of a rotation."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.as_matrix()
    return T(matrix)


def ball_transform(scene: Scene, instant: float) -> Any:
    """Where the ball is at an instant, -0.5 to 0.5 of the exposure."""
    turned = Rotation.from_rotvec(scene.spin_rad_s * scene.exposure_s * instant) * scene.rotation
    at = scene.center + scene.velocity * scene.exposure_s * instant
    return T().translate(at.tolist()) @ rotated(turned)


def sensor(camera: Camera, scale: int, samples: int, box: Box | None) -> dict[str, Any]:
    """The pinhole, at a whole fraction of its resolution, or a box of it. Pixels are boxes."""
    width, height = camera.width // scale, camera.height // scale
    film: dict[str, Any] = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}
    if box is not None:
        names = ("crop_offset_x", "crop_offset_y", "crop_width", "crop_height")
        film.update(zip(names, box, strict=True))
    return {
        "type": "perspective",
        "fov_axis": "x",
        "fov": float(np.degrees(2 * np.arctan(camera.width / 2 / camera.focal_px))),
        "principal_point_offset_x": ((camera.width - 1) / 2 - camera.cx) / camera.width,
        "principal_point_offset_y": ((camera.height - 1) / 2 - camera.cy) / camera.height,
        "near_clip": 0.1,
        "far_clip": 1e4,
        "to_world": T().look_at(origin=[0, 0, 0], target=[0, 0, -1], up=[0, 1, 0]),
        "film": {**film, "pixel_format": "rgb", "component_format": "float32"},
        "sampler": {"type": "multijitter", "sample_count": samples},
    }


def bitmap(values: NDArray[np.float32]) -> dict[str, Any]:
    """A texture of linear values."""
    return {"type": "bitmap", "bitmap": mi.Bitmap(np.ascontiguousarray(values)), "raw": True}


def thing(description: dict[str, Any]) -> dict[str, Any]:
    """A wall, a thing of the clutter, a finger."""
    if "bitmap" in description:
        bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": bitmap(description["bitmap"])}}
    else:
        plastic = {"type": "roughplastic", "alpha": 0.3, "diffuse_reflectance": rgb(description["color"])}
        bsdf = {"type": "twosided", "bsdf": plastic}
    if description["type"] == "cylinder":
        ends = {"p0": description["at"], "p1": description["end"], "radius": description["scale"]}
        return {"type": "cylinder", **ends, "bsdf": bsdf}
    about_x, about_y = description["tilt_deg"]
    placed = T().translate(description["at"]) @ T().rotate([1, 0, 0], about_x) @ T().rotate([0, 1, 0], about_y)
    return {"type": description["type"], "to_world": placed @ T().scale(description["scale"]), "bsdf": bsdf}


def ball(scene: Scene) -> dict[str, Any]:
    """The ball, or the disc in its place."""
    coat = {"type": "roughplastic", "alpha": scene.roughness, "nonlinear": True}
    bsdf = {"type": "twosided", "bsdf": {**coat, "diffuse_reflectance": bitmap(scene.bitmap)}}
    if not scene.is_disc:
        return {"type": "sphere", "to_world": ball_transform(scene, 0.0), "bsdf": bsdf}
    to_camera = T().look_at(origin=scene.center.tolist(), target=[0, 0, 0], up=[0, 1, 0])
    return {"type": "disk", "to_world": to_camera, "bsdf": bsdf}


def build(scene: Scene, sensors: list[dict[str, Any]], *, has_ball: bool = True) -> Any:
    """The renderer's scene."""
    light = [dict(lamp) for lamp in scene.light]
    for lamp in light:
        if lamp["type"] == "envmap":
            lamp["bitmap"] = mi.Bitmap(lamp.pop("pixels"))
    parts = {f"light{k}": lamp for k, lamp in enumerate(light)}
    parts |= {f"thing{k}": thing(t) for k, t in enumerate(scene.things)}
    parts |= {f"sensor{k}": s for k, s in enumerate(sensors)}
    integrator = {"type": "path", "max_depth": 3, "rr_depth": 3}
    balls = {"ball": ball(scene)} if has_ball else {}
    return mi.load_dict({"type": "scene", "integrator": integrator, **balls, **parts})


def grown(camera: Camera, box: Box) -> Box:
    """A box with its margin, within the picture."""
    x, y = max(0, box[0] - MARGIN_PX), max(0, box[1] - MARGIN_PX)
    right = min(camera.width, box[0] + box[2] + MARGIN_PX)
    return x, y, right - x, min(camera.height, box[1] + box[3] + MARGIN_PX) - y


def exposed(built: Any, scene: Scene, camera: Camera, seen_by: Any, samples: int, seed: int) -> NDArray:
    """The mean light of an exposure on a sensor, or on the scene's sensor of that number."""
    if scene.is_disc:
        return np.array(mi.render(built, sensor=seen_by, spp=samples, seed=seed), dtype=float)
    speed = np.linalg.norm(scene.spin_rad_s) + np.linalg.norm(scene.velocity)
    steps = np.ceil(speed * scene.exposure_s * outline(camera, scene.center).radius_px / MAX_STEP_PX)
    instants = int(np.clip(steps, 1, samples))
    params = mi.traverse(built)
    total: NDArray | float = 0.0
    for k in range(instants):
        params["ball.to_world"] = ball_transform(scene, (k + 0.5) / instants - 0.5)
        params.update()
        part = max(1, round(samples / instants))
        total = total + np.array(mi.render(built, sensor=seen_by, spp=part, seed=seed + k), dtype=float)
    return total / instants


def light(scene: Scene, camera: Camera, box: Box, samples: int, around: int, seed: int) -> tuple[NDArray, Any]:
    """The picture's light, and the renderer's scene. The box about the ball is rendered with so many samples a pixel,
    and through the exposure; what is around it with fewer, at half the resolution, somewhat out of focus."""
    near = grown(camera, box)
    sensors = [sensor(camera, 1, samples, near)]
    if around:
        sensors.append(sensor(camera, 2, around, None))
    built = build(scene, sensors)
    picture = np.zeros((camera.height, camera.width, 3))
    if around:
        far = np.array(mi.render(built, sensor=1, spp=around, seed=seed), dtype=float)
        far = ndimage.gaussian_filter(far, (0.8, 0.8, 0.0))
        picture = ndimage.zoom(far, (2, 2, 1), order=1, mode="nearest", grid_mode=True)
    sharp = exposed(built, scene, camera, 0, samples, seed + 1)
    x, y, width, height = near
    v, u = np.mgrid[0:height, 0:width]
    inwards = np.full((height, width), np.inf)
    # From the picture's own borders nothing fades.
    for distance, is_border in (
        (u, x == 0),
        (v, y == 0),
        (width - 1 - u, x + width == camera.width),
        (height - 1 - v, y + height == camera.height),
    ):
        inwards = inwards if is_border else np.minimum(inwards, distance)
    part = picture[y : y + height, x : x + width]
    part += np.clip((inwards + 1) / MARGIN_PX, 0, 1)[..., None] * (sharp - part) if around else sharp - part
    return picture, built


def is_seen(built: Any, points: Array) -> NDArray[np.bool_]:
    """Which places of the ball's near side nothing hides."""
    seen = []
    for point in points:
        distance = np.linalg.norm(point)
        ray = mi.Ray3f(mi.Point3f(0, 0, 0), mi.Vector3f(*(point / distance)))
        ray.maxt = float(distance * (1 - 2e-3))
        seen.append(not built.ray_test(ray))
    return np.array(seen)
