"""Renders a clip of one dotted ball with a path tracer: whole color frames with exact truth.

    python clip.py flying --ball-px 60 --frames 40 --seed 1 -o traced/flying-60/1
    python clip.py held --ball-px 170 --frames 40 --seed 1 -o traced/held-170/1

writes OUT as `spindoe synth --as clip` does, with camera.yml for `spindoe estimate --intrinsics`, circles.csv, the true
circles, and in each frame of truth.json the corners of two printed AprilTags that lie in the scene. `nothing` gives
frames of as many rooms without a dotted ball, `noise` frames of independent bytes. What stands still is rendered once,
the ball's box for each frame.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

import scene as scenes
import sensor
import tracer
import truth
from camera import Array, Camera, outline
from render import BALL_SAMPLES, MAX_SAMPLES, MIN_SAMPLES, ball_mask
from scene import Scene, stream

FIRST_NS = 1_000_000_000_000
"""Time of the first frame, as `spindoe synth` has it."""
AROUND_SAMPLES, AROUND_BLUR_PX = 16, 0.7
"""Samples a pixel of what stands still, and what takes their noise away."""
NEAR_PX, FADE_PX = 3.0, 6.0
"""So far about the outline the ball's own rendering is shown, and so far it fades into what stands still."""
TRIES = 1000
"""Until a scene is given up in which a path or the tags find no room."""
TAGS = (0, 1)
CELLS = 10
"""Of a tag along a side: six of bits, two of its border, two of paper."""


@dataclass(frozen=True)
class Pace:
    """How fast what is filmed goes."""

    fps: float
    rps: tuple[float, float]
    exposure_s: tuple[float, float]
    path_radii: tuple[float, float]
    """Length of the path."""


PACES = {
    "flying": Pace(350.0, (5.0, 60.0), (5e-5, 5e-4), (2.0, 5.0)),
    "held": Pace(60.0, (0.3, 3.0), (5e-4, 4e-3), (0.0, 0.1)),
    "nothing": Pace(60.0, (0.0, 0.0), (5e-4, 4e-3), (0.0, 0.0)),
    "noise": Pace(60.0, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
}


def path(rng: np.random.Generator, pace: Pace, camera: Camera, center: Array, seconds: float) -> Array:
    """A velocity, ball radii a second, at which the ball stays in the picture."""
    for _ in range(TRIES):
        way = rng.uniform(*pace.path_radii) * Rotation.random(rng=rng).apply([1.0, 0.0, 0.0])
        if all(scenes.is_whole(camera, center + side * way) for side in (-0.5, 0.5)):
            return way / max(seconds, 1e-9)
    raise SystemExit("no path stays in the picture: choose a smaller --ball-px or another --seed")


def is_clear(thing: dict[str, Any], centers: Array) -> bool:
    """Whether a thing leaves room for the ball at all of these places."""
    start = np.array(thing["at"])
    along = np.array(thing.get("end", thing["at"])) - start
    share = np.clip((centers - start) @ along / max(along @ along, 1e-9), 0, 1)
    reach = thing["scale"] * (1.75 if thing["type"] == "cube" else 1.0)
    return bool(np.min(np.linalg.norm(start + share[:, None] * along - centers, axis=-1)) > 1.1 + reach)


def tag_board() -> NDArray[np.float32]:
    """Reflectance of a board with the tags side by side, each in its paper."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    papers = [np.pad(cv2.aruco.generateImageMarker(family, tag, CELLS - 2), 1, constant_values=255) for tag in TAGS]
    # A bitmap's first row is a rectangle's lowest.
    ink = np.hstack(papers)[::-1].repeat(16, axis=0).repeat(16, axis=1)
    return np.where(ink[..., None] > 0, 0.8, 0.04).astype(np.float32).repeat(3, axis=-1)


def board_places(board: dict[str, Any], places: Array) -> Array:
    """Points of the camera frame of places on a board, -1 to 1 to the right and up."""
    about_x, about_y = board["tilt_deg"]
    turned = Rotation.from_euler("XY", [about_x, about_y], degrees=True)
    flat = np.concatenate([places * board["scale"][:2], np.zeros((len(places), 1))], axis=-1)
    return board["at"] + turned.apply(flat)


def tag_corners(board: dict[str, Any], camera: Camera) -> list[dict[str, Any]]:
    """The tags' corners in the picture, from the printed top left one clockwise."""
    found = []
    for k, tag in enumerate(TAGS):
        corners = np.array([[1, 1], [CELLS - 1, 1], [CELLS - 1, CELLS - 1], [1, CELLS - 1]]) / CELLS
        places = np.stack([2 * (corners[:, 0] + k) / len(TAGS) - 1, 1 - 2 * corners[:, 1]], axis=-1)
        pixels = camera.project(board_places(board, places))
        found.append({"family": "tag36h11", "id": tag, "corners": [truth.pixel(p) for p in pixels]})
    return found


def lay_board(rng: np.random.Generator, scene: Scene, camera: Camera, centers: Array) -> dict[str, Any]:
    """A board with the tags, between camera and things, where nothing hides it and it hides no ball."""
    built = tracer.build(scene, [], has_ball=False)
    edge = np.array([[x, y] for x in (-1, 0, 1) for y in (-1, 0, 1)], dtype=float)
    for _ in range(TRIES):
        half = rng.uniform(7, 13) * camera.width / 1280 * CELLS / 2
        at = np.array([rng.uniform(0, camera.width), rng.uniform(0, camera.height)])
        depth = rng.uniform(0.5, 1.0) * np.linalg.norm(scene.center)
        scale = half * depth / camera.focal_px
        board = {
            "type": "rectangle",
            "at": (depth * camera.ray(*at)).tolist(),
            "tilt_deg": rng.uniform(-25, 25, 2).tolist(),
            "scale": [float(len(TAGS) * scale), float(scale), 1.0],
            "bitmap": tag_board(),
        }
        points = board_places(board, edge)
        pixels = camera.project(points)
        room = np.min([pixels, [camera.width - 1, camera.height - 1] - pixels])
        away = [np.linalg.norm(pixels - camera.project(c), axis=-1).min() for c in centers]
        radius = outline(camera, scene.center).radius_px
        if room > 4 and min(away) > 1.3 * radius + half and tracer.is_seen(built, points).all():
            return board
    raise SystemExit("the tags find no room: choose a smaller --ball-px or another --seed")


def draw(args: argparse.Namespace, frame: int, camera: Camera, pattern: Array) -> tuple[Scene, list[dict[str, Any]]]:
    """The scene in the middle of the clip, and its tags."""
    pace, seconds = PACES[args.kind], (args.frames - 1) / args.fps
    scene = scenes.draw(args.seed, args.kind, frame, camera, args.ball_px, pattern, 0.0)
    rng = stream(args.seed, args.kind, frame, 5)
    axis = scene.spin_rad_s / np.linalg.norm(scene.spin_rad_s)
    scene.spin_rad_s = axis * 2 * np.pi * (rng.uniform(*pace.rps) if args.rps is None else args.rps)
    scene.exposure_s = float(min(np.exp(rng.uniform(*np.log(pace.exposure_s))), 0.5 / args.fps))
    scene.sensor = replace(scene.sensor, has_color=True, has_mosaic=bool(rng.random() < 0.5), jpeg_quality=None)
    scene.velocity = path(rng, pace, camera, scene.center, seconds)
    centers = scene.center + np.linspace(-0.5, 0.5, 21)[:, None] * scene.velocity * seconds
    if args.kind == "flying":
        # A hand beside the path, as of who threw the ball.
        side = np.cross(scene.center, rng.standard_normal(3))
        scene.things += scenes.hand(rng, scene.center + rng.uniform(3.0, 6.0) * side / np.linalg.norm(side))
        scene.things = [t for t in scene.things if "bitmap" in t or is_clear(t, centers)]
    board = lay_board(rng, scene, camera, centers)
    scene.things.append(board)
    return scene, tag_corners(board, camera)


def surroundings(scene: Scene, camera: Camera, seed: int, *, has_ball: bool) -> NDArray:
    """The light of what stands still."""
    built = tracer.build(scene, [tracer.sensor(camera, 1, AROUND_SAMPLES, None)], has_ball=has_ball)
    light = np.array(mi.render(built, spp=AROUND_SAMPLES, seed=seed), dtype=float)
    return ndimage.gaussian_filter(light, (AROUND_BLUR_PX, AROUND_BLUR_PX, 0.0))


def add_ball(picture: NDArray, built: Any, scene: Scene, camera: Camera, near_px: float, seed: int) -> None:
    """Renders the ball's box and shows it in the picture."""
    seen = outline(camera, scene.center)
    reach = seen.half_axes_px[0] + near_px + FADE_PX
    x, y = (max(0, int(np.floor(c - reach))) for c in (seen.u, seen.v))
    width = min(camera.width, int(np.ceil(seen.u + reach)) + 1) - x
    height = min(camera.height, int(np.ceil(seen.v + reach)) + 1) - y
    samples = int(np.clip(BALL_SAMPLES / (4 * seen.radius_px**2), MIN_SAMPLES, MAX_SAMPLES))
    eye = mi.load_dict(tracer.sensor(camera, 1, samples, (x, y, width, height)))
    sharp = tracer.exposed(built, scene, camera, eye, samples, seed)
    v, u = np.mgrid[y : y + height, x : x + width]
    shown = np.clip((reach - np.hypot(u - seen.u, v - seen.v)) / FADE_PX, 0, 1)[..., None]
    part = picture[y : y + height, x : x + width]
    part += shown * (sharp - part)


def ball_frames(args: argparse.Namespace, camera: Camera, pattern: Array) -> tuple[list[dict[str, Any]], Scene]:
    """Writes the frames of a clip; their truth, and the scene in its middle."""
    middle, tags = draw(args, 0, camera, pattern)
    rng = stream(args.seed, args.kind, 0, 4)
    # A held ball's place is nearly the same throughout: it shades what is around. That of a flying one is left bright.
    is_held = args.kind == "held"
    still = surroundings(middle, camera, int(rng.integers(1 << 30)), has_ball=is_held)
    built = tracer.build(middle, [])
    way = middle.velocity * (args.frames - 1) / args.fps
    drift = outline(camera, middle.center).radius_px * float(np.linalg.norm(way)) / 2
    near_px = NEAR_PX + (drift if is_held else 0.0)
    bright, truths = None, []
    for k in range(args.frames):
        name, time_s = moment(args.fps, k)
        since_s = (k - (args.frames - 1) / 2) / args.fps
        turned = Rotation.from_rotvec(middle.spin_rad_s * since_s) * middle.rotation
        scene = replace(middle, center=middle.center + middle.velocity * since_s, rotation=turned)
        light = still.copy()
        add_ball(light, built, scene, camera, near_px, int(rng.integers(1 << 30)))
        light = sensor.defocused(light, scene.sensor)
        # One setting for the whole clip.
        bright = bright or sensor.brightness(light, ball_mask(scene, camera))
        values, _ = sensor.picture(light, bright, scene.sensor, rng)
        truth.save(args.output / "images" / name, values)
        truths.append(truth.frame_truth(name, scene, camera, built) | {"time_s": time_s, "tags": tags})
    return truths, middle


def nothing_frame(args: argparse.Namespace, k: int, camera: Camera, pattern: Array) -> tuple[NDArray, list[dict]]:
    """A room without a ball, and its tags."""
    scene, tags = draw(args, k, camera, pattern)
    rng = stream(args.seed, args.kind, k, 4)
    light = surroundings(scene, camera, int(rng.integers(1 << 30)), has_ball=False)
    light = sensor.defocused(light, scene.sensor)
    bright = sensor.brightness(light, np.zeros(light.shape[:2], bool))
    return sensor.picture(light, bright, scene.sensor, rng)[0], tags


def bare_frames(args: argparse.Namespace, camera: Camera, pattern: Array) -> list[dict[str, Any]]:
    """Writes frames without a ball; what is true of them."""
    truths = []
    for k in range(args.frames):
        name, time_s = moment(args.fps, k)
        if args.kind == "nothing":
            values, tags = nothing_frame(args, k, camera, pattern)
        else:
            shape, tags = (camera.height, camera.width, 3), []
            values = stream(args.seed, args.kind, k).integers(0, 256, shape, dtype=np.uint8)
        truth.save(args.output / "images" / name, values)
        size = [camera.width, camera.height]
        truths.append({"image": name, "kind": args.kind, "time_s": time_s, "size": size, "dots": [], "tags": tags})
    return truths


def moment(fps: float, k: int) -> tuple[str, float]:
    """A frame's name and time, s, the same to the nanosecond."""
    ns = FIRST_NS + round(1e9 * k / fps)
    return f"{ns}.png", ns * 1e-9


def image_size(text: str) -> tuple[int, int]:
    """Of WIDTHxHEIGHT."""
    width, height = (int(n) for n in text.split("x"))
    if min(width, height) < 64:
        raise ValueError
    return width, height


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=PACES)
    parser.add_argument("--ball-px", type=float, default=100.0, help="diameter in the middle of the clip")
    parser.add_argument("--frames", type=int, default=40)
    parser.add_argument("--fps", type=float, help="350 flying, 60 otherwise")
    parser.add_argument("--rps", type=float, help="at random where not given: 5 to 60 flying, 0.3 to 3 held")
    parser.add_argument("--image-size", type=image_size, default=(1280, 1024), metavar="WIDTHxHEIGHT")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--pattern", type=Path, default=Path(__file__).resolve().parents[2] / "designs/dots20/pattern.csv"
    )
    parser.add_argument("-o", "--output", type=Path, required=True)
    args = parser.parse_args()
    args.fps = args.fps or PACES[args.kind].fps
    if args.ball_px > 0.6 * min(args.image_size):
        parser.error("--ball-px: the ball must be smaller than 0.6 of the picture")
    return args


def main() -> None:
    args = arguments()
    if args.output.exists():
        raise SystemExit(f"{args.output}: exists; name a folder that does not")
    pattern = np.loadtxt(args.pattern, delimiter=",")
    camera = scenes.folder_camera(args.seed, args.kind, args.ball_px, args.image_size)
    (args.output / "images").mkdir(parents=True)
    begun = time.process_time()
    has_ball = args.kind in ("flying", "held")
    origin = truth.origin(args.seed, args.kind, args.ball_px if has_ball else None, 0.0, pattern)
    if has_ball:
        frames, middle = ball_frames(args, camera, pattern)
        origin["sequence"] = {
            "fps": args.fps, "spin": middle.spin_rad_s.tolist(), "exposure_s": middle.exposure_s,
            "drift_px": [frames[-1]["center"][c] - frames[0]["center"][c] for c in "uv"], "readout_s": 0.0,
        }  # fmt: skip
        truth.write_orientations(args.output, frames)
    else:
        frames = bare_frames(args, camera, pattern)
    truth.write(args.output, origin, frames)
    truth.write_camera(args.output / "camera.yml", camera)
    print(f"{args.output}: {args.frames} frames, {time.process_time() - begun:.0f} s of CPU time")


if __name__ == "__main__":
    main()
