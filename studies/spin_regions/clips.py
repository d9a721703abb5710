"""Do the 95 % regions of spins hold, by files alone? Clips of `spindoe synth` whose ball crosses the picture of a camera that is not known.

    python clips.py make --clips 50 --seed 5930000 --ball-px 60 -o clips/ [--crop]
    python clips.py judge clips/ [--spindoe spindoe]

Needs NumPy and SciPy. 12 frames of 640 x 480 at 400 a second, 5 to 80 revolutions per second, a camera 6 to 60 ball radii away, up to
20 degrees off the axis, 150 to 450 pixels of way. With --crop: crops about a ball that stays. The truth is the spin in the view frame of the
median of the balls' centers.
"""

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

# Quantiles of chi-square with three degrees of freedom.
QUANTILES = {0.68: 3.506, 0.9: 6.251, 0.95: 7.815, 0.99: 11.345}


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, capture_output=True, text=True, check=False)


def make(args: argparse.Namespace) -> None:
    folder: Path = args.output
    probe = folder / "probe"
    run(args.spindoe, "synth", "dots20", "--preset", "good", "--frames", "1", "-o", str(probe), "-q", "--overwrite")
    config = json.loads((probe / "truth.json").read_text())["config"]
    config |= {"max_off_axis_rad": 0.15 if args.crop else 0.35, "ball_px": [args.ball_px] * 2}
    if not args.crop:
        config["image_px"] = [640, 480]
    preset = folder / "preset.json"
    preset.write_text(json.dumps(config))
    for k in range(args.clips):
        rng = np.random.default_rng([args.seed, k])
        angle = rng.uniform(0, 2 * math.pi)
        way = rng.uniform(0, 12) if args.crop else rng.uniform(150, 450)
        drift = f"drift_px={way * math.cos(angle):.1f},{0.7 * way * math.sin(angle):.1f}"
        spin = ["--fps", "400", "--rps", f"{rng.uniform(5, 80):.2f}", "--frames", "12", "--seed", str(args.seed + k)]
        done = run(args.spindoe, "synth", "dots20", "--preset", str(preset), "--config", drift, *spin,
                   "-o", str(folder / f"{k:03d}"), "-q", "--overwrite")  # fmt: skip
        if done.returncode:
            sys.exit(done.stderr)


def in_view(spin: np.ndarray, intrinsics: dict[str, float], at: np.ndarray) -> np.ndarray:
    """A vector of the camera's frame in the view frame of a ball that is seen at a pixel."""
    towards = np.array([
        -(at[0] - intrinsics["cx"]) / intrinsics["fx"], (at[1] - intrinsics["cy"]) / intrinsics["fy"], 1.0,
    ])  # fmt: skip
    axis = np.cross([0, 0, 1.0], towards / np.linalg.norm(towards))
    sine = np.linalg.norm(axis)
    turn = Rotation.from_rotvec(axis * (math.asin(sine) / max(sine, 1e-12)))
    return turn.inv().apply(spin)


def judge(args: argparse.Namespace) -> None:
    squared, errors, deviations, unanswered = [], [], [], 0
    for clip in sorted(args.folder.glob("[0-9]*")):
        truth = json.loads((clip / "truth.json").read_text())["frames"][0]
        if not truth.get("intrinsics"):
            continue
        done = run(args.spindoe, "estimate", "--table", "dots20", str(clip / "images"), "--json", "-q")
        found = json.loads(done.stdout) if done.stdout.strip() else {}
        spin = found.get("spin")
        if not spin or spin.get("spin_rad_s") is None:
            unanswered += 1
            continue
        circles = [f["circle"] for f in found["frames"] if f.get("orientation_wxyz")]
        middle = np.median([[c["u"], c["v"]] for c in circles], axis=0)
        off = np.array(spin["spin_rad_s"]) - in_view(np.array(truth["spin_rad_s"]), truth["intrinsics"], middle)
        covariance = np.array(spin["covariance_rad2_s2"])
        squared.append(off @ np.linalg.solve(covariance, off))
        errors.append(np.linalg.norm(off))
        deviations.append(math.sqrt(np.trace(covariance)))
    d = np.array(squared)
    print(f"{len(d)} spins, {unanswered} clips without; squared distance: median {np.median(d):.2f}, mean {d.mean():.2f};")
    print("within " + ", ".join(f"{100 * q:.0f} %: {(d < bound).sum()}" for q, bound in QUANTILES.items()) + ";")
    print(f"error {np.median(errors):.2f} rad/s in the median, deviation {np.median(deviations):.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ways = parser.add_subparsers(dest="way", required=True)
    making, judging = ways.add_parser("make"), ways.add_parser("judge")
    for one in (making, judging):
        one.add_argument("--spindoe", default="spindoe")
    making.add_argument("--clips", type=int, default=50)
    making.add_argument("--seed", type=int, default=5930000)
    making.add_argument("--ball-px", type=float, default=60)
    making.add_argument("--crop", action="store_true")
    making.add_argument("-o", "--output", type=Path, required=True)
    judging.add_argument("folder", type=Path)
    args = parser.parse_args()
    make(args) if args.way == "make" else judge(args)


if __name__ == "__main__":
    main()
