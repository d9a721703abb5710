"""The truth of a frame, in the fields of `spindoe synth`'s truth.json, and the files of a folder."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

import tracer
from camera import Array, Camera, facing, outline, view_rotation, wxyz
from scene import DOT_RADIUS_RAD, Scene
from sensor import LUMA

MIN_FACING = 0.12
"""Dots that face the camera less are not to be found, as in `spindoe synth`."""


def pixel(values: Array) -> dict[str, float]:
    """A pixel as the files have it."""
    return {"u": float(values[0]), "v": float(values[1])}


def dot_truths(scene: Scene, camera: Camera, built: Any) -> list[dict[str, Any]]:
    """The dots on the near side."""
    if scene.dots is None:
        return []
    turned = scene.rotation.apply(scene.dots.directions)
    cosines = facing(scene.center, turned)
    near = np.flatnonzero(cosines > 0)
    shown = tracer.is_seen(built, scene.center + turned[near])
    in_view = view_rotation(scene.center).apply(turned)
    places = camera.project(scene.center + turned)
    paint, ink = scene.base @ LUMA, scene.dots.ink @ LUMA
    contrast = float(abs(paint - ink) / max(paint, ink))
    return [
        {
            "index": int(k),
            "direction": in_view[k].tolist(),
            "pixel": pixel(places[k]),
            "radius_rad": float(scene.dots.radii_rad[k]),
            "facing": float(cosines[k]),
            "contrast": contrast,
            "inside": True,
            "occluded": not is_shown,
            "visible": bool(is_shown and cosines[k] >= MIN_FACING),
        }
        for k, is_shown in zip(near, shown, strict=True)
    ]


def visible_shares(scene: Scene, built: Any) -> tuple[float, float]:
    """Shares of the outline and of the area that nothing hides, by rays to 48 and 112 places."""
    to_camera = view_rotation(scene.center).inv()
    angles = np.arange(48) * 2 * np.pi / 48

    def share(radii: Array, angles: Array) -> float:
        height = np.sqrt(1 - radii**2)
        places = np.stack([radii * np.cos(angles), radii * np.sin(angles), height], axis=-1)
        return float(tracer.is_seen(built, scene.center + to_camera.apply(places)).mean())

    spiral = np.arange(112) + 0.5
    # The outline lies where the surface faces the camera by 0: at a height of one over the distance.
    limb = np.sqrt(1 - 1 / (scene.center @ scene.center))
    return share(np.full(48, 0.99 * limb), angles), share(0.98 * limb * np.sqrt(spiral / 112), spiral * 2.399963)


def frame_truth(name: str, scene: Scene, camera: Camera, built: Any) -> dict[str, Any]:
    """All fields, in the pixels of the whole picture."""
    seen = outline(camera, scene.center)
    rim, area = visible_shares(scene, built)
    sensor = scene.sensor
    jpeg = {"jpeg": {"quality": sensor.jpeg_quality, "half_color": sensor.half_color}}
    arc = float(np.linalg.norm(scene.spin_rad_s) * scene.exposure_s)
    return {
        "image": name,
        "kind": scene.shown,
        "time_s": None,
        "size": [camera.width, camera.height],
        "quaternion_wxyz": wxyz(view_rotation(scene.center) * scene.rotation),
        "camera_quaternion_wxyz": wxyz(scene.rotation),
        "spin_rad_s": scene.spin_rad_s.tolist(),
        "exposure_s": scene.exposure_s,
        "center": {"u": seen.u, "v": seen.v},
        "radius_px": seen.radius_px,
        "outline": {
            "center": {"u": seen.u, "v": seen.v},
            "half_axes_px": list(seen.half_axes_px),
            "angle_rad": seen.angle_rad,
        },
        "ball_center": pixel(camera.project(scene.center)),
        "intrinsics": {"fx": camera.focal_px, "fy": camera.focal_px, "cx": camera.cx, "cy": camera.cy},
        "distance": float(np.linalg.norm(scene.center)),
        "blur_px": arc * seen.radius_px,
        "logo": "ring" if scene.logo else None,
        "occluder": scene.occluder,
        "rim_visible": rim,
        "area_visible": area,
        "mirrored": False,
        "sensor": {
            "defocus_px": sensor.defocus_px,
            "gain": sensor.level,
            "read_noise": sensor.read_noise,
            "shot_noise": sensor.shot_noise,
            "color_noise": 0.0,
            "has_color": sensor.has_color,
            "has_mosaic": sensor.has_mosaic,
            "encoding": sensor.encoding,
            "gamma": sensor.gamma,
            "sharpening": 0.0,
            "compression": "none" if sensor.jpeg_quality is None else jpeg,
        },
        "dots": dot_truths(scene, camera, built),
        "scene": scene.kind,
        "ink": None if scene.dots is None else ("bright" if scene.dots.ink @ LUMA > scene.base @ LUMA else "dark"),
    }


def cropped(truth: dict[str, Any], name: str, box: tracer.Box) -> dict[str, Any]:
    """The same of a crop; `crop` says where it was cut."""
    x, y, width, height = box

    def moved(place: dict[str, float]) -> dict[str, float]:
        return {"u": place["u"] - x, "v": place["v"] - y}

    k = truth["intrinsics"]
    return truth | {
        "image": name,
        "size": [width, height],
        "center": moved(truth["center"]),
        "outline": truth["outline"] | {"center": moved(truth["outline"]["center"])},
        "ball_center": moved(truth["ball_center"]),
        "intrinsics": k | {"cx": k["cx"] - x, "cy": k["cy"] - y},
        "dots": [dot | {"pixel": moved(dot["pixel"])} for dot in truth["dots"]],
        "crop": [x, y, width, height],
    }


def write(folder: Path, origin: dict[str, Any], frames: list[dict[str, Any]]) -> None:
    """truth.json, index.csv, pattern.csv, circles.csv for `--circle`."""
    (folder / "truth.json").write_text(json.dumps(origin | {"frames": frames}))
    lines = []
    for frame in (f for f in frames if any(d["visible"] for d in f["dots"])):
        numbers = [str(q) for q in frame["quaternion_wxyz"]]
        places = [d["pixel"] for d in frame["dots"] if d["visible"]]
        numbers += [f"{value:.4f}" for place in places for value in (place["u"], place["v"])]
        lines.append(",".join([f"images/{frame['image']}", *numbers]))
    (folder / "index.csv").write_text("".join(line + "\n" for line in lines))
    rows = [",".join(str(x) for x in row) for row in origin["pattern"]]
    (folder / "pattern.csv").write_text("".join(row + "\n" for row in rows))
    circles = ["frame,u,v,radius"]
    circles += [
        f"{Path(f['image']).stem},{f['center']['u']},{f['center']['v']},{f['radius_px']}"
        for f in frames
        if "center" in f
    ]
    (folder / "circles.csv").write_text("\n".join(circles) + "\n")


def write_orientations(folder: Path, frames: list[dict[str, Any]]) -> None:
    """orientations.csv of a clip, as `spindoe spin` reads it."""
    lines = ["frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence"]
    for frame in frames:
        seen = sum(d["visible"] for d in frame["dots"])
        row = [Path(frame["image"]).stem, frame["time_s"], *frame["camera_quaternion_wxyz"], seen, seen, 0, 1]
        lines.append(",".join(str(cell) for cell in row))
    (folder / "orientations.csv").write_text("\n".join(lines) + "\n")


def origin(seed: int, kind: str, ball_px: float | None, placement_rad: float, pattern: Array) -> dict[str, Any]:
    """What all frames of a folder have in common. `config` has no ranges: they are in scene.py."""
    digest = hashlib.sha256(np.ascontiguousarray(pattern, "<f8").tobytes()).hexdigest()
    made = {"kind": kind, "ball_px": ball_px, "placement_sigma_rad": placement_rad, "dot_radius_rad": DOT_RADIUS_RAD}
    return {
        "format_version": 2,
        "seed": seed,
        "pattern_sha256": digest,
        "pattern": pattern.tolist(),
        "config": {},
        "sequence": None,
        "path_traced": made,
    }


def write_camera(file: Path, camera: Camera) -> None:
    """The whole picture's intrinsics, as OpenCV writes them."""
    matrix = [camera.focal_px, 0, camera.cx, 0, camera.focal_px, camera.cy, 0, 0, 1]
    numbers = ", ".join(repr(float(x)) for x in matrix)
    file.write_text(
        "%YAML:1.0\n---\n"
        f"image_width: {camera.width}\nimage_height: {camera.height}\n"
        "camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
        f"   data: [ {numbers} ]\n"
        "distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n"
        "   data: [ 0., 0., 0., 0., 0. ]\n"
    )


def save(file: Path, values: Any) -> None:
    """A picture without loss."""
    Image.fromarray(values).save(file, optimize=False, compress_level=1)
