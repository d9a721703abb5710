"""Renders pictures of dotted balls with a path tracer, with exact truth.

    python render.py good --ball-px 60 --frames 20 --seed 1 -o traced/good-60/1

writes two folders, each laid out as `spindoe synth --as images` does: OUT/whole, pictures of 640 x 480, all by
one camera (camera.yml, for `spindoe estimate --intrinsics`); and OUT/crops, cut from them about the ball
(`crop` in truth.json says where). Both have circles.csv, the true circles, for `--circle`.
The same seed and kind give the same pictures. README.md says what the scenes hold.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import sensor
import tracer
import truth
from camera import Camera, outline
from scene import KINDS, Scene, draw, folder_camera, stream

# Samples a pixel of the box about the ball: so many that a ball of 60 px has 64, larger ones fewer, as their
# pixels are more; what is left of the renderer's noise is part of the picture's.
BALL_SAMPLES, MIN_SAMPLES, MAX_SAMPLES = 230_000, 16, 64
AROUND_SAMPLES = 4


def crop_box(scene: Scene, camera: Camera, rng: np.random.Generator) -> tracer.Box:
    """A square about the ball, loosely cut, within the picture."""
    seen = outline(camera, scene.center)
    side = int(np.ceil(2 * seen.half_axes_px[0] * rng.uniform(1.12, 1.35) + 4))
    side = min(side, camera.height)
    shift = rng.uniform(-0.05, 0.05, 2) * seen.radius_px
    x = int(np.clip(round(seen.u + shift[0] - side / 2), 0, camera.width - side))
    y = int(np.clip(round(seen.v + shift[1] - side / 2), 0, camera.height - side))
    return x, y, side, side


def ball_mask(scene: Scene, camera: Camera) -> np.ndarray:
    """Which pixels lie within the ball's circle."""
    seen = outline(camera, scene.center)
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    return np.hypot(u - seen.u, v - seen.v) < seen.radius_px


def frame(
    out: Path, k: int, scene: Scene, camera: Camera, rng: np.random.Generator, samples: int | None
) -> tuple[dict, dict]:
    """Renders a frame and writes it, whole and cropped; the truth of both."""
    box = crop_box(scene, camera, rng)
    if samples is None:
        radius = outline(camera, scene.center).radius_px
        samples = int(np.clip(BALL_SAMPLES / (4 * radius**2), MIN_SAMPLES, MAX_SAMPLES))
    light, built = tracer.light(scene, camera, box, samples, AROUND_SAMPLES, int(rng.integers(1 << 30)))
    light = sensor.defocused(light, scene.sensor)
    bright = sensor.brightness(light, ball_mask(scene, camera))
    values, jpeg = sensor.picture(light, bright, scene.sensor, rng)
    stem = f"frame-{k:06d}"
    name = f"{stem}.jpg" if jpeg else f"{stem}.png"
    if jpeg:
        (out / "whole/images" / name).write_bytes(jpeg)
    else:
        truth.save(out / "whole/images" / name, values)
    x, y, width, height = box
    truth.save(out / "crops/images" / f"{stem}.png", values[y : y + height, x : x + width])
    whole = truth.frame_truth(name, scene, camera, built)
    return whole, truth.cropped(whole, f"{stem}.png", box)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("--ball-px", type=float, help="diameter; at random where not given (near: by the distance)")
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--pattern", type=Path, default=Path(__file__).resolve().parents[2] / "designs/dots20/pattern.csv"
    )
    parser.add_argument("--placement-sigma-deg", type=float, default=0.0, help="of the dots as drawn, along an axis")
    parser.add_argument("--samples", type=int, help="a pixel of the ball")
    parser.add_argument("--clean", action="store_true", help="a ball at rest, a perfect sensor: to check the geometry")
    parser.add_argument("-o", "--output", type=Path, required=True)
    return parser.parse_args()


def main() -> None:
    args = arguments()
    if args.output.exists():
        raise SystemExit(f"{args.output}: exists; name a folder that does not")
    pattern = np.loadtxt(args.pattern, delimiter=",")
    if not np.allclose(np.linalg.norm(pattern, axis=-1), 1, atol=1e-9):
        raise SystemExit(f"{args.pattern}: rows x,y,z of unit length are expected")
    placement = np.radians(args.placement_sigma_deg)
    camera = folder_camera(args.seed, args.kind, args.ball_px)
    for part in ("whole", "crops"):
        (args.output / part / "images").mkdir(parents=True)
    begun, truths = time.process_time(), []
    for k in range(args.frames):
        scene = draw(args.seed, args.kind, k, camera, args.ball_px, pattern, placement)
        if args.clean:
            scene.sensor, scene.exposure_s = sensor.CLEAN, 0.0
        truths.append(frame(args.output, k, scene, camera, stream(args.seed, args.kind, k, 4), args.samples))
    origin = truth.origin(args.seed, args.kind, args.ball_px, placement, pattern)
    for part, frames in zip(("whole", "crops"), zip(*truths, strict=True), strict=True):
        truth.write(args.output / part, origin, list(frames))
    truth.write_camera(args.output / "whole/camera.yml", camera)
    print(f"{args.output}: {args.frames} frames, {time.process_time() - begun:.0f} s of CPU time")


if __name__ == "__main__":
    main()
