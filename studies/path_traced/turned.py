"""Renders a ball with dots drawn by hand, turned by hand before the camera, with a path tracer.

    python turned.py --frames 150 --seed 1 -o traced/turned/1
    python turned.py --frames 150 --seed 1 --print -o traced/turned-print/1

The dots are 14 to 26, 0.35 to 0.55 of a radius or more apart, not quite round, not quite alike; in two of five balls
one is faint. With `--print` the ball has a logo or lines, which the dots keep off. It is turned as docs/hand-drawn.md
asks for: a turn and a bit about an upright axis, then about a level one, then about one between. Every 10 to 25 frames
the fingers, of one hand or two, take hold elsewhere and the ball shifts. OUT is laid out as clip.py does.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import paint
import scene as scenes
import sensor
import tracer
import truth
from camera import Array, Camera, outline
from clip import NEAR_PX, add_ball, image_size, moment, surroundings
from render import ball_mask
from scene import Scene, stream

KIND = "turned"
FPS = 30.0
STROKES = 3
MORE_THAN_A_TURN = 1.15
TEXELS = 2048


def dot_places(rng: np.random.Generator, number: int, print_places: Array) -> Array:
    """Places at random, with bare ball between them, and off the print."""
    apart = rng.uniform(0.35, 0.55)
    while True:
        found: list[Array] = []
        for _ in range(4000):
            place = rng.standard_normal(3)
            place /= np.linalg.norm(place)
            off = np.linalg.norm(print_places - place, axis=-1).min(initial=9.0) > 0.22
            if off and all(np.linalg.norm(place - other) > apart for other in found):
                found.append(place)
                if len(found) == number:
                    return np.array(found)
        apart *= 0.95


def tangents(direction: Array) -> Array:
    """Two directions across another."""
    first = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(direction, first)])


def drawn_dot(
    rng: np.random.Generator, bitmap: Any, direction: Array, radius: float, ink: Array
) -> tuple[Array, float]:
    """Draws a dot as three strokes of a pen; the middle and the radius of the disc of its area."""
    across = tangents(direction)
    parts = [(np.zeros(2), radius * 0.9)]
    for _ in range(2):
        turn = rng.uniform(0, 2 * np.pi)
        parts.append(
            (rng.uniform(0.05, 0.25) * radius * np.array([np.cos(turn), np.sin(turn)]), radius * rng.uniform(0.8, 0.95))
        )
    # What the strokes cover together, on a grid of the tangent plane.
    side = np.linspace(-1.5, 1.5, 121) * radius
    x, y = np.meshgrid(side, side, indexing="ij")
    covered = np.zeros(x.shape, bool)
    for (dx, dy), part in parts:
        covered |= np.hypot(x - dx, y - dy) < part
        place = direction + dx * across[0] + dy * across[1]
        paint.add_cap(bitmap, place / np.linalg.norm(place), part, ink)
    middle = direction + x[covered].mean() * across[0] + y[covered].mean() * across[1]
    area = covered.sum() * (side[1] - side[0]) ** 2
    return middle / np.linalg.norm(middle), float(np.sqrt(area / np.pi))


def print_on(rng: np.random.Generator, bitmap: Any) -> Array:
    """Prints a logo of rings with a bar below it, or lines; places that lie on it."""
    middle = rng.standard_normal(3)
    middle /= np.linalg.norm(middle)
    across = tangents(middle)
    color = rng.uniform(0.03, 0.4, 3)
    places = []
    if rng.random() < 0.5:
        for k in range(rng.integers(1, 4)):
            outer = 0.32 - 0.11 * k
            paint.add_cap(bitmap, middle, outer, color, outer - rng.uniform(0.02, 0.05))
        places += [
            middle + 0.3 * r * (np.cos(a) * across[0] + np.sin(a) * across[1]) for a in range(6) for r in (0.3, 1.0)
        ]
        start, end = middle - 0.42 * across[1] - 0.25 * across[0], middle - 0.42 * across[1] + 0.25 * across[0]
        strokes = [(start, end)]
    else:
        # Letters: short strokes side by side.
        strokes = []
        for k in range(rng.integers(4, 9)):
            base = middle + (0.16 * k - 0.5) * across[0]
            for _ in range(rng.integers(1, 4)):
                a, b = rng.uniform(-0.08, 0.08, 2), rng.uniform(-0.08, 0.08, 2)
                strokes.append((base + a @ across, base + b @ across))
    for start, end in strokes:
        for share in np.linspace(0, 1, 24):
            place = start + share * (end - start)
            place /= np.linalg.norm(place)
            paint.add_cap(bitmap, place, 0.016, color)
            places.append(place)
    places = np.array(places)
    return places / np.linalg.norm(places, axis=-1, keepdims=True)


def painted(rng: np.random.Generator, scene: Scene, has_print: bool, number: int | None) -> None:
    """Gives the scene's ball its print and its dots."""
    bitmap = paint.ball(rng, TEXELS, scene.base, None, 0, logo=False)
    printed = print_on(rng, bitmap) if has_print else np.empty((0, 3))
    number = number or int(rng.integers(14, 27))
    places = dot_places(rng, number, printed)
    pen = rng.uniform(0.075, 0.12)
    radii = pen * np.clip(1 + 0.1 * rng.standard_normal(number), 0.75, 1.3)
    cover = rng.uniform(0.85, 1.0, number)
    if rng.random() < 0.4:
        cover[rng.integers(number)] = rng.uniform(0.4, 0.65)
    drawn = []
    for place, radius, share in zip(places, radii, cover, strict=True):
        ink = scene.base + share * (scene.dots.ink - scene.base)
        drawn.append(drawn_dot(rng, bitmap, place, float(radius), ink))
    scene.bitmap = np.clip(bitmap, 0.005, 0.95)
    scene.logo = has_print
    scene.dots = paint.Dots(np.array([d for d, _ in drawn]), np.array([r for _, r in drawn]), scene.dots.ink)


def rotations(rng: np.random.Generator, frames: int, start: Rotation) -> list[Rotation]:
    """Of each frame, in the camera frame: even strokes with a hand's unevenness."""
    slant = rng.uniform(0.6, 1.0)
    axes = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, slant, 0.0]])
    found, now = [], start
    for part in np.array_split(np.arange(frames), STROKES):
        axis = axes[len(found) * STROKES // frames] + 0.12 * rng.standard_normal(3)
        axis *= rng.choice([-1.0, 1.0]) / np.linalg.norm(axis)
        pace = np.exp(0.25 * np.convolve(rng.standard_normal(len(part) + 4), np.ones(5) / 5, "valid"))
        steps = 2 * np.pi * MORE_THAN_A_TURN * pace / pace.sum()
        for step in steps:
            found.append(now)
            now = Rotation.from_rotvec(step * axis + np.radians(0.6) * rng.standard_normal(3)) * now
    return found


def grips(rng: np.random.Generator, frames: int) -> list[list[int]]:
    """Frames that are filmed with the fingers in one place."""
    found: list[list[int]] = []
    at = 0
    while at < frames:
        end = min(frames, at + int(rng.integers(10, 26)))
        found.append(list(range(at, end)))
        at = end
    return found


def ball_frames(args: argparse.Namespace, camera: Camera) -> tuple[list[dict[str, Any]], Scene]:
    """Writes the frames; their truth, and the scene."""
    first = scenes.draw(args.seed, KIND, 0, camera, args.ball_px, np.eye(3), 0.0)
    painted(stream(args.seed, KIND, 0, 6), first, args.print, args.dots)
    first.sensor = replace(first.sensor, has_color=True, jpeg_quality=None)
    rng = stream(args.seed, KIND, 0, 4)
    turned = rotations(rng, args.frames, first.rotation)
    things, bright, truths = first.things, None, []
    for grip in grips(rng, args.frames):
        center = first.center + 0.06 * rng.standard_normal(3)
        hands = [thing for _ in range(1 + (rng.random() < 0.35)) for thing in scenes.hand(rng, center)]
        way = 0.004 * rng.standard_normal(3)
        held = replace(first, center=center, things=things + hands, occluder="hand", rotation=turned[grip[0]])
        still = surroundings(held, camera, int(rng.integers(1 << 30)), has_ball=True)
        built = tracer.build(held, [])
        drift = outline(camera, center).radius_px * float(np.linalg.norm(way)) * len(grip)
        for k in grip:
            spin = (turned[min(k + 1, args.frames - 1)] * turned[max(k - 1, 0)].inv()).as_rotvec() * FPS / 2
            scene = replace(
                held, center=center + (k - grip[0]) * way, rotation=turned[k], spin_rad_s=spin, velocity=way * FPS
            )
            light = still.copy()
            add_ball(light, built, scene, camera, NEAR_PX + drift, int(rng.integers(1 << 30)))
            light = sensor.defocused(light, scene.sensor)
            bright = bright or sensor.brightness(light, ball_mask(scene, camera))
            values, _ = sensor.picture(light, bright, scene.sensor, rng)
            name, time_s = moment(FPS, k)
            truth.save(args.output / "images" / name, values)
            truths.append(truth.frame_truth(name, scene, camera, built) | {"time_s": time_s, "tags": []})
    return truths, first


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ball-px", type=float, default=110.0)
    parser.add_argument("--frames", type=int, default=150)
    parser.add_argument("--dots", type=int, help="14 to 26 at random where not given")
    parser.add_argument("--print", action="store_true", help="print on the ball")
    parser.add_argument("--image-size", type=image_size, default=(400, 320), metavar="WIDTHxHEIGHT")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    if args.output.exists():
        raise SystemExit(f"{args.output}: exists; name a folder that does not")
    camera = scenes.folder_camera(args.seed, KIND, args.ball_px, args.image_size)
    (args.output / "images").mkdir(parents=True)
    begun = time.process_time()
    frames, scene = ball_frames(args, camera)
    pattern = scene.dots.directions
    truth.write(args.output, truth.origin(args.seed, KIND, args.ball_px, 0.0, pattern), frames)
    truth.write_orientations(args.output, frames)
    truth.write_camera(args.output / "camera.yml", camera)
    print(f"{args.output}: {len(pattern)} dots, {time.process_time() - begun:.0f} s of CPU time")


if __name__ == "__main__":
    main()
