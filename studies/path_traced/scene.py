"""Scenes by kind and seed: a ball, its paint, light, walls, things, a hand, the camera's sensor.

Ranges are written here as a photographer would set up a room; nothing in them is taken from the estimator's own
synthetic world or fitted to its results.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import paint
import sensor
from camera import Array, Camera, outline, place

KINDS = ("good", "clutter", "dim", "near", "empty")
CLIP_KINDS = ("flying", "held", "nothing", "noise", "turned")
"""Of clip.py, and, the last, of turned.py."""
SIZE = (640, 480)
"""Columns and rows of a still."""
DOT_RADIUS_RAD = 0.1001674211615598
"""Of dots of 4 mm on a ball of 40 mm."""


@dataclass
class Scene:
    """All that a picture is made of."""

    kind: str
    shown: str
    """What stands in the ball's place, by the names of the setting `kind` of `spindoe synth`."""
    center: Array
    rotation: Rotation
    """Pattern to camera frame, at mid-exposure."""
    spin_rad_s: Array
    exposure_s: float
    bitmap: NDArray[np.float32]
    roughness: float
    dots: paint.Dots | None
    base: NDArray
    sensor: sensor.Sensor
    velocity: Array = field(default_factory=lambda: np.zeros(3))
    """Ball radii a second."""
    logo: bool = False
    occluder: str | None = None
    light: list[dict[str, Any]] = field(default_factory=list)
    things: list[dict[str, Any]] = field(default_factory=list)
    is_disc: bool = False


def stream(seed: int, kind: str, *names: int) -> np.random.Generator:
    """Random numbers of a folder (no names) or of one part of one of its frames."""
    return np.random.default_rng([seed, (KINDS + CLIP_KINDS).index(kind), *names])


def folder_camera(seed: int, kind: str, ball_px: float | None, size: tuple[int, int] = SIZE) -> Camera:
    """The camera of a folder: all of its frames have the same."""
    rng = stream(seed, kind)
    width, height = size
    if kind == "near":
        focal = rng.uniform(420, 700)
    elif kind in CLIP_KINDS:
        # 20 to 65 degrees across, as of machines' and phones' lenses.
        focal = width * np.exp(rng.uniform(*np.log((0.8, 2.8))))
    else:
        radius = (ball_px or 100.0) / 2
        focal = np.clip(radius * np.exp(rng.uniform(*np.log((6.5, 60.0)))), 450, 3000)
    cx, cy = (width - 1) / 2 + rng.normal(0, 4), (height - 1) / 2 + rng.normal(0, 4)
    return Camera(width, height, float(focal), float(cx), float(cy))


def is_whole(camera: Camera, center: Array) -> bool:
    """Whether the outline lies in the picture."""
    seen = outline(camera, center)
    room = seen.half_axes_px[0] + 6
    return bool(room < seen.u < camera.width - 1 - room and room < seen.v < camera.height - 1 - room)


def ball_place(rng: np.random.Generator, kind: str, camera: Camera, ball_px: float | None) -> Array:
    """A center: the whole outline lies in the picture."""
    if kind == "near":
        radius = camera.focal_px * rng.uniform(0.05, 0.15)
    elif ball_px is not None:
        radius = ball_px / 2 * rng.uniform(0.95, 1.05)
    else:
        radius = np.exp(rng.uniform(*np.log((25.0, 80.0))))
    while True:
        u, v = rng.uniform(0, camera.width - 1), rng.uniform(0, camera.height - 1)
        center = place(camera, u, v, radius)
        if is_whole(camera, center):
            return center


def colors(rng: np.random.Generator, kind: str) -> tuple[NDArray, NDArray]:
    """A ball's paint and its dots' ink: white, orange, or, of stills, dark with bright dots."""
    choice = rng.random() * (0.8 if kind in CLIP_KINDS else 1.0)
    ink = np.full(3, rng.uniform(0.02, 0.06))
    if choice < 0.45:
        return rng.uniform(0.7, 0.85) * np.array([1.0, 0.99, 0.96]), ink
    if choice < 0.8:
        return np.array([rng.uniform(0.7, 0.85), rng.uniform(0.25, 0.4), rng.uniform(0.03, 0.1)]), ink
    return rng.uniform(0.03, 0.1, 3), np.full(3, rng.uniform(0.6, 0.85))


def rgb(values: Any) -> dict[str, Any]:
    """A color of the renderer."""
    return {"type": "rgb", "value": [float(x) for x in values]}


def lights(rng: np.random.Generator, center: Array, textured: float) -> list[dict[str, Any]]:
    """One to three lamps on the camera's side of the ball, and light from all around."""
    found: list[dict[str, Any]] = []
    back = -center / np.linalg.norm(center)
    while len(found) < rng.integers(1, 4):
        towards = rng.standard_normal(3) + [0, 0.6, 0]
        towards /= np.linalg.norm(towards)
        distance, size = rng.uniform(8, 25), rng.uniform(0.5, 3.0)
        sideways = distance * np.linalg.norm(np.cross(towards, back))
        # In front of the wall, above the floor, and not before the ball.
        if towards @ back < 0.15 or towards[1] * distance < size - 0.9 or sideways < size + 2.5:
            continue
        position = center + distance * towards
        warmth = np.array([1.0, 1.0, 1.0]) + rng.uniform(-0.25, 0.25) * np.array([1.0, 0.0, -1.0])
        power = rng.uniform(0.5, 1.5) * distance**2
        if rng.random() < 0.4:
            found.append({"type": "point", "position": position.tolist(), "intensity": rgb(power * warmth)})
        else:
            emitter = {"type": "area", "radiance": rgb(power / (np.pi * size**2) * warmth)}
            found.append({"type": "sphere", "center": position.tolist(), "radius": float(size), "emitter": emitter})
    ambient = rng.uniform(0.08, 0.4)
    if rng.random() > textured:
        return [*found, {"type": "constant", "radiance": rgb(np.full(3, ambient))}]
    room = np.exp(0.6 * paint.smooth_noise(rng, (32, 64), 8))
    for _ in range(rng.integers(1, 4)):
        row, column = rng.integers(4, 24), rng.integers(0, 56)
        room[row : row + rng.integers(2, 8), column : column + rng.integers(2, 8)] *= rng.uniform(2, 6)
    room *= ambient / room.mean()
    tint = 1 + rng.uniform(-0.15, 0.15, 3)
    return [*found, {"type": "envmap", "pixels": (room[..., None] * tint).astype(np.float32)}]


def walls(
    rng: np.random.Generator, camera: Camera, center: Array, albedo: float, contrast: float
) -> list[dict[str, Any]]:
    """A wall behind the ball, every other time with a floor below it."""
    behind = center * (1 + rng.uniform(3, 12) / np.linalg.norm(center))
    half = -behind[2] * camera.width / camera.focal_px
    texels = 512 * -(-camera.width // SIZE[0])
    found = [
        {
            "type": "rectangle",
            "at": behind.tolist(),
            "tilt_deg": rng.uniform(-8, 8, 2).tolist(),
            "scale": float(1.6 * half),
            "bitmap": paint.wall(rng, texels, albedo, contrast),
        }
    ]
    if rng.random() < 0.5:
        # Below the ball and below the camera, else it would hide the one from the other.
        level = min(center[1] - 1 - rng.uniform(0.0, 3.0), -1.0)
        found.append(
            {
                "type": "rectangle",
                "at": [float(behind[0]), float(level), float(behind[2])],
                "tilt_deg": [-90.0, 0.0],
                "scale": float(1.6 * half + 10),
                "bitmap": paint.wall(rng, texels, albedo * rng.uniform(0.6, 1.5), contrast),
            }
        )
    return found


def clutter(rng: np.random.Generator, center: Array) -> list[dict[str, Any]]:
    """Balls, discs, boxes and rods beside and behind the ball."""
    found = []
    for _ in range(rng.integers(4, 11)):
        angle, away = rng.uniform(0, 2 * np.pi), rng.uniform(2.2, 6.0)
        size = rng.uniform(0.3, 1.3)
        at = center + [away * np.cos(angle), away * np.sin(angle), rng.uniform(-3.0, 1.0)]
        thing: dict[str, Any] = {"color": rng.uniform(0.03, 0.8, 3), "at": at.tolist(), "scale": float(size)}
        thing["type"] = ("sphere", "disk", "cube", "cylinder")[rng.integers(4)]
        thing["tilt_deg"] = rng.uniform(-60, 60, 2).tolist()
        if thing["type"] == "cylinder":
            end = at + rng.uniform(-4, 4, 3) * [1, 1, 0.3]
            # A rod that would pass through the ball is none.
            along = np.clip((center - at) @ (end - at) / max((end - at) @ (end - at), 1e-9), 0, 1)
            if np.linalg.norm(at + along * (end - at) - center) < 1.6:
                continue
            thing.update(end=end.tolist(), scale=float(rng.uniform(0.05, 0.4)))
        found.append(thing)
    return found


def hand(rng: np.random.Generator, center: Array) -> list[dict[str, Any]]:
    """One to four fingers that touch the ball from a side and hide a part of it."""
    back = -center / np.linalg.norm(center)
    side = np.cross(back, rng.standard_normal(3))
    side /= np.linalg.norm(side)
    beside = np.cross(back, side)
    thick = rng.uniform(0.25, 0.42)
    skin = np.array([0.7, 0.45, 0.34]) * rng.uniform(0.25, 1.1)
    outward = side + back * rng.uniform(-0.1, 0.4) + 0.3 * rng.standard_normal() * beside
    outward /= np.linalg.norm(outward)
    found = []
    for k in range(rng.integers(1, 5)):
        turn = np.arcsin(rng.uniform(0.45, 0.95))
        tip = center + (1.02 + thick) * (np.sin(turn) * side + np.cos(turn) * back) + 2.1 * k * thick * beside
        middle = tip + rng.uniform(1.0, 1.6) * outward
        end = middle + 5.0 * (outward + 0.3 * rng.standard_normal() * back)
        for a, b in ((tip, middle), (middle, end)):
            found.append(
                {"type": "cylinder", "at": a.tolist(), "end": b.tolist(), "scale": float(thick), "color": skin}
            )
            found.append(
                {"type": "sphere", "at": a.tolist(), "scale": float(thick), "color": skin, "tilt_deg": [0.0, 0.0]}
            )
    return found


def draw(
    seed: int, kind: str, frame: int, camera: Camera, ball_px: float | None, pattern: Array, placement_rad: float
) -> Scene:
    """Frame `frame` of a folder's seed."""
    rng = stream(seed, kind, frame, 0)
    center = ball_place(rng, kind, camera, ball_px)
    base, ink = colors(rng, kind)
    axis = rng.standard_normal(3)
    spin = 2 * np.pi * rng.uniform(0, 150) * axis / np.linalg.norm(axis)
    exposure = np.exp(rng.uniform(*np.log((5e-5, 5e-4))))
    shown, dots, stripes, logo = "dotted", None, 0, bool(rng.random() < 0.4)
    if kind == "empty":
        shown = ("dotless", "seams-only", "lamp")[rng.integers(3)]
        stripes = int(rng.integers(2, 6)) if shown == "seams-only" else 0
    else:
        placed = pattern + placement_rad * rng.standard_normal(pattern.shape)
        placed /= np.linalg.norm(placed, axis=-1, keepdims=True)
        radii = DOT_RADIUS_RAD * (1 + 0.05 * rng.standard_normal(len(pattern)))
        dots = paint.Dots(placed, np.clip(radii, 0.08, 0.12), ink)
    scene = Scene(
        kind=kind,
        shown=shown,
        center=center,
        rotation=Rotation.random(rng=rng),
        spin_rad_s=spin,
        exposure_s=float(exposure),
        bitmap=np.zeros((1, 1, 3), np.float32),
        roughness=float(rng.uniform(0.08, 0.4)),
        dots=dots,
        base=base,
        sensor=sensor.draw(stream(seed, kind, frame, 1), kind),
        logo=logo,
        is_disc=shown == "lamp",
    )
    height = 2048 if outline(camera, center).radius_px > 70 else 1024
    painter = stream(seed, kind, frame, 2)
    scene.bitmap = paint.face(painter) if scene.is_disc else paint.ball(painter, height, base, dots, stripes, logo)
    furnish(scene, stream(seed, kind, frame, 3), camera)
    return scene


def furnish(scene: Scene, rng: np.random.Generator, camera: Camera) -> None:
    """Light, walls and things."""
    has_clutter = scene.kind in ("clutter", *CLIP_KINDS) or (scene.kind in ("near", "empty") and rng.random() < 0.4)
    scene.light = lights(rng, scene.center, textured=0.5)
    # Before a bright ball a darker wall, before a dark one a brighter.
    brightness = float(scene.base @ sensor.LUMA)
    albedo = brightness * rng.uniform(0.05, 0.5) if brightness > 0.15 else rng.uniform(0.2, 0.6)
    if has_clutter:
        albedo = rng.uniform(0.05, 0.6)
    contrast = rng.uniform(0.2, 0.6) if has_clutter else rng.uniform(0.0, 0.15)
    scene.things = walls(rng, camera, scene.center, albedo, contrast)
    if has_clutter:
        scene.things += clutter(rng, scene.center)
    if scene.kind == "held" or (scene.kind == "clutter" and rng.random() < 0.6):
        scene.occluder = "hand"
        scene.things += hand(rng, scene.center)
