"""Checks the truth against the pictures: `python check.py [--frames 3]`.

A matt ball of 200 px off the axis, at rest, without blur or noise, is rendered in even light with and without its dots.
What the dots take from the light, relative to the ball without them, covers a dot's image and nothing else: its
centroid is compared with that of the projected cap, from the truth's orientation and intrinsics alone. The same ball as
a lamp before black gives the outline: area and centroid are compared with the ellipse's. Fails beyond 0.1 px.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import mitsuba as mi
import numpy as np
from scipy.spatial.transform import Rotation

import paint
import render
import tracer
import truth
from camera import Camera
from scene import Scene, draw, folder_camera, rgb, stream

LIMIT_PX = 0.1
MIN_FACING = 0.3
SAMPLES = 64


def rendered(scene: Scene, camera: Camera, box: tracer.Box, bsdf: dict | None) -> np.ndarray:
    """The ball's brightness in the box with its margin: in even light, or, without a surface, as a lamp."""
    ball = {"type": "sphere", "to_world": tracer.ball_transform(scene, 0.0)}
    light = {"type": "constant", "radiance": rgb(np.ones(3))}
    if bsdf is None:
        ball["emitter"] = {"type": "area", "radiance": rgb(np.ones(3))}
    parts = {"ball": ball | {"bsdf": bsdf}, "light": light} if bsdf else {"ball": ball}
    seen = tracer.sensor(camera, 1, SAMPLES, tracer.grown(camera, box))
    integrator = {"type": "path", "max_depth": 2}
    built = mi.load_dict({"type": "scene", "integrator": integrator, "sensor": seen, **parts})
    return np.array(mi.render(built, spp=SAMPLES, seed=3))[..., 0].astype(float)


def matt(scene: Scene, dots: paint.Dots | None) -> dict:
    """The ball's surface without its gloss."""
    values = paint.ball(np.random.default_rng(0), 2048, scene.base, dots, 0, False)
    return {"type": "diffuse", "reflectance": tracer.bitmap(values)}


def cap(direction: np.ndarray, radius: float) -> np.ndarray:
    """Places spread evenly over a cap."""
    k = np.arange(4000) + 0.5
    height = 1 - (1 - np.cos(radius)) * k / len(k)
    across = np.sqrt(1 - height**2)
    places = np.stack([across * np.cos(2.399963 * k), across * np.sin(2.399963 * k), height], axis=-1)
    return Rotation.align_vectors([direction], [[0, 0, 1]])[0].apply(places)


def predicted(fields: dict, pattern: np.ndarray, dot: dict) -> np.ndarray:
    """A dot's centroid in the picture by the truth's fields alone."""
    k, (w, x, y, z) = fields["intrinsics"], fields["camera_quaternion_wxyz"]
    ray = np.array(
        [(fields["ball_center"]["u"] - k["cx"]) / k["fx"], (k["cy"] - fields["ball_center"]["v"]) / k["fy"], -1]
    )
    center = fields["distance"] * ray / np.linalg.norm(ray)
    normals = Rotation.from_quat([x, y, z, w]).apply(cap(pattern[dot["index"]], dot["radius_rad"]))
    points = center + normals
    distance = np.linalg.norm(points, axis=-1)
    # Area in the picture of a part of the surface: what it faces the camera, over the depth.
    area = np.clip(-(normals * points).sum(-1), 0, None) / distance**3 * (distance / -points[:, 2]) ** 3
    u, v = k["cx"] - k["fx"] * points[:, 0] / points[:, 2], k["cy"] + k["fy"] * points[:, 1] / points[:, 2]
    return np.array([u @ area, v @ area]) / area.sum()


def dots_off(scene: Scene, camera: Camera, box: tracer.Box, fields: dict, pattern: np.ndarray) -> list[float]:
    """How far the dots' centroids are from their prediction, pixels."""
    bare = rendered(scene, camera, box, matt(scene, None))
    inner = rendered(scene, camera, box, None) > 0.99
    dotted = rendered(scene, camera, box, matt(scene, scene.dots))
    taken = np.where(inner, 1 - dotted / np.maximum(bare, 1e-9), 0)
    x, y = tracer.grown(camera, box)[:2]
    v, u = np.indices(taken.shape) + np.array([y, x])[:, None, None]
    off = []
    for dot in (d for d in fields["dots"] if d["facing"] > MIN_FACING):
        place = predicted(fields, pattern, dot)
        inside = np.hypot(u - place[0], v - place[1]) < dot["radius_rad"] * fields["radius_px"] * 1.3 + 2
        weight = taken * inside
        found = np.array([(u * weight).sum(), (v * weight).sum()]) / weight.sum()
        off.append(float(np.hypot(*(found - place))))
    return off


def outline_off(scene: Scene, camera: Camera, box: tracer.Box, fields: dict) -> tuple[float, float]:
    """How far center and radius of the ball as a lamp are from the truth's, pixels."""
    cover = rendered(scene, camera, box, None)
    x, y = tracer.grown(camera, box)[:2]
    v, u = np.indices(cover.shape)
    center = np.array([(u * cover).sum(), (v * cover).sum()]) / cover.sum() + [x, y]
    middle = fields["outline"]["center"]
    radius = np.sqrt(cover.sum() / np.pi)
    return float(np.hypot(center[0] - middle["u"], center[1] - middle["v"])), float(radius - fields["radius_px"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=3)
    args = parser.parse_args()
    file = Path(__file__).resolve().parents[2] / "designs/dots20/pattern.csv"
    pattern = np.loadtxt(file, delimiter=",")
    worst = 0.0
    for k in range(args.frames):
        camera = folder_camera(k, "near" if k % 2 else "good", 200.0)
        scene = draw(k, "good", k, camera, 200.0, pattern, 0.0)
        scene.exposure_s, scene.logo = 0.0, False
        box = render.crop_box(scene, camera, stream(k, "good", k, 4))
        built = tracer.build(scene, [])
        # Through the file, as a reader gets it.
        with tempfile.TemporaryDirectory() as folder:
            made = truth.origin(k, "good", 200.0, 0.0, pattern)
            truth.write(Path(folder), made, [truth.frame_truth("frame.png", scene, camera, built)])
            fields = json.loads((Path(folder) / "truth.json").read_text())["frames"][0]
        off = dots_off(scene, camera, box, fields, pattern)
        center, radius = outline_off(scene, camera, box, fields)
        place = f"{fields['center']['u']:.0f}, {fields['center']['v']:.0f}"
        print(
            f"distance {fields['distance']:.1f} radii, center at {place}: "
            f"{len(off)} dots off by {np.median(off):.3f} px in the median, {max(off):.3f} at most; "
            f"outline's center by {center:.3f}, radius by {radius:+.4f} px"
        )
        worst = max(worst, max(off), center, abs(radius))
    if worst > LIMIT_PX:
        raise SystemExit(f"off by {worst:.3f} px, expected {LIMIT_PX} at most")


if __name__ == "__main__":
    main()
