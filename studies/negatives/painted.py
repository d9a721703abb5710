"""Painted balls: sets of frames each of which shows another ball, and clips of one ball.

    python painted.py draw nulls --clips 200 --seed 1 -o nulls/
    python painted.py draw balls --clips 200 --seed 2 -o balls/
    python painted.py judge nulls/ balls/ [--spindoe spindoe] [--json answers.json]

Needs numpy and OpenCV. 24 frames of 320 x 240 as JPEG files, a ball of 36 to 120 pixels painted with clouds, blotches, spots or one of the
kinds of `clips.py`, lit and drawn as there. Balls rest, turn evenly by up to 50 degrees a frame, or wander as under an animal. Of a
set of other balls nothing beyond the first frame has an orientation, and there is no spin; of a ball frames are right within 10 degrees,
relative to the first answered one.
"""

import argparse
import json
import math
import subprocess
from pathlib import Path

import cv2
import numpy as np
from clips import DIRECTIONS, KINDS, ROWS, Array, Rng, Scene, color, random_unit, soft, spot, turn, wilson

FRAMES = 24
FPS = 60
# Chi squared of 3 degrees of freedom, 95 %.
CHI2_95 = 7.815
# Sets that share a style and, of other balls, the balls, each in another order, light and pose.
PER_STYLE = 8
WRONG_DEG = 10


def field(rng: Rng, per_radian: float) -> Array:
    """A smooth random field on the ball, of variance 1: waves in space."""
    coarse = DIRECTIONS[::4, ::4]
    total = np.zeros(coarse.shape[:2], np.float32)
    for _ in range(24):
        wave = random_unit(rng) * per_radian * rng.uniform(0.4, 1.4)
        total += np.cos(coarse @ wave.astype(np.float32) + rng.uniform(0, 2 * math.pi))
    return cv2.resize(total / math.sqrt(12), (2 * ROWS, ROWS), interpolation=cv2.INTER_CUBIC)


def paint(style: dict[str, float | str], rng: Rng) -> Array:
    """A ball of a style; another one with each call."""
    name = style["name"]
    if name in KINDS:
        return KINDS[str(name)](rng).astype(np.float32).clip(0, 1)
    surface = np.ones((ROWS, 2 * ROWS, 3), np.float32) * color(rng, 0.5, 0.9).astype(np.float32)
    if name == "spots":
        for _ in range(int(style["spots"])):
            spot(surface, random_unit(rng), rng.uniform(0.06, 0.25), color(rng, 0.02, 0.3))
        return surface
    values = field(rng, float(style["per_radian"]))
    share = 0.5 + 0.5 * np.tanh(0.8 * values) if name == "clouds" else soft(values - 0.3, 0.05)
    return surface * (1 - float(style["contrast"]) * share)[..., None]


def style_of(rng: Rng) -> dict[str, float | str]:
    name = str(rng.choice(["clouds", "clouds", "blotches", "spots", "kind"]))
    if name == "kind":
        name = str(rng.choice(list(KINDS)))
    return {
        "name": name,
        "per_radian": float(rng.uniform(3, 10)),
        "contrast": float(rng.uniform(0.15, 0.8)),
        "spots": int(rng.integers(8, 30)),
    }


def motion(rng: Rng) -> tuple[str, list[Array]]:
    """What moves the ball, and its rotations from frame to frame, view frame."""
    name = str(rng.choice(["rest", "even", "even", "wanders"]))
    if name == "wanders":
        turns, now = [], rng.normal(0, 1, 3)
        for _ in range(FRAMES):
            now = 0.9 * now + math.sqrt(1 - 0.81) * rng.normal(0, 1, 3)
            turns.append(now)
        scale = math.radians(rng.uniform(2, 10))
        return name, [turn(scale * t) for t in turns]
    step = random_unit(rng) * math.radians(0 if name == "rest" else 50 ** rng.uniform(0, 1))
    return name, [turn(step)] * FRAMES


def draw(what: str, clips: int, seed: int, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(clips):
        if k % PER_STYLE == 0:
            rng = np.random.default_rng([seed, 1, k])
            style = style_of(rng)
            surfaces = [paint(style, rng) for _ in range(FRAMES if what == "nulls" else PER_STYLE)]
        rng = np.random.default_rng([seed, k])
        scene = Scene(rng, rng.uniform(18, 60))
        to = folder / f"{k:04d}"
        to.mkdir(exist_ok=True)
        pose = turn(random_unit(rng) * rng.uniform(0, math.pi))
        moved, turns = motion(rng)
        shown = rng.permutation(FRAMES) if what == "nulls" else [k % PER_STYLE] * FRAMES
        poses = []
        for i in range(FRAMES):
            poses.append(pose.tolist())
            (to / f"{i:03d}.jpg").write_bytes(scene.jpeg(surfaces[shown[i]], pose, rng).tobytes())
            pose = turn(random_unit(rng) * rng.uniform(0, math.pi)) if what == "nulls" else turns[i] @ pose
        said = {"what": what, "radius_px": scene.radius, "motion": moved, **style}
        (folder / f"{k:04d}.json").write_text(json.dumps({**said, "poses": poses if what == "balls" else None}))


def matrix(wxyz: list[float]) -> Array:
    w, v = wxyz[0], np.array(wxyz[1:])
    length = float(np.linalg.norm(v))
    return turn(v / max(length, 1e-12) * 2 * math.atan2(length, w))


def wrong(frames: list[dict[str, object]], poses: list[list[list[float]]]) -> int:
    """Answered frames that are not as the first answered one says."""
    answered = [(matrix(f["orientation_wxyz"]), np.array(p)) for f, p in zip(frames, poses) if f.get("orientation_wxyz")]
    if not answered:
        return 0
    found0, true0 = answered[0]
    off = [(np.trace((found @ found0.T).T @ (true @ true0.T)) - 1) / 2 for found, true in answered]
    return sum(math.degrees(math.acos(max(-1, min(1, c)))) > WRONG_DEG for c in off)


def spin(report: dict[str, dict[str, object]], poses: list[list[list[float]]]) -> dict[str, object] | None:
    """How far the spin of a ball that turns evenly is off, and its chi2: by the turns from frame to frame, in the view frame."""
    found = report.get("spin")
    if not found or not found.get("covariance_rad2_s2"):
        return None
    step = np.array(poses[1]) @ np.array(poses[0]).T
    angle = math.acos(max(-1, min(1, (np.trace(step) - 1) / 2)))
    axis = np.array([step[2, 1] - step[1, 2], step[0, 2] - step[2, 0], step[1, 0] - step[0, 1]]) / (2 * math.sin(angle))
    true = axis * angle * FPS
    off = np.array(found["spin_rad_s"]) - true
    chi2 = float(off @ np.linalg.solve(np.array(found["covariance_rad2_s2"]), off))
    return {"motion": found.get("motion", "constant"), "off": float(np.linalg.norm(off) / np.linalg.norm(true)), "chi2": chi2}


def print_spins(answers: list[dict[str, object]]) -> None:
    """Of the balls that turn evenly and are followed rightly."""
    some = [a["turns"] for a in answers if a["turns"] and not a["wrong"]]
    if not some:
        return
    constant = sum(s["motion"] == "constant" for s in some)
    within = sum(s["chi2"] < CHI2_95 for s in some)
    off, chi2 = (float(np.median([s[name] for s in some])) for name in ("off", "chi2"))
    print("\n| even spins | constant | within the 95 % region | error, median | chi2 of 3, median (2.4) |\n|---|---|---|---|---|")
    print(f"| {len(some)} | {wilson(constant, len(some))} | {wilson(within, len(some))} | {100 * off:.2f} % | {chi2:.1f} |")


def judge(folders: list[Path], spindoe: str, to: Path | None) -> None:
    answers = []
    for said in sorted(f for folder in folders for f in folder.glob("*.json")):
        about = json.loads(said.read_text())
        clip = said.with_suffix("")
        run = [spindoe, "estimate", "--painted", str(clip), "--fps", str(FPS), "--json"]
        done = subprocess.run(run, capture_output=True, text=True, check=False)
        report = json.loads(done.stdout) if done.stdout.strip() else {}
        frames = report.get("frames", [])
        poses = about.pop("poses")
        answers.append({
            **about,
            "clip": f"{said.parent.name}/{said.stem}",
            "answered": sum(f.get("orientation_wxyz") is not None for f in frames),
            "wrong": wrong(frames, poses) if poses else 0,
            "spin": report.get("spin_refusal") is None and bool(report),
            "turns": spin(report, poses) if poses and about["motion"] == "even" else None,
            "said": done.stderr[-2000:],
        })  # fmt: skip
        if to:
            to.write_text(json.dumps(answers))
    print("| clips | sets | with an orientation beyond the first | with a spin | frames answered | of these wrong |\n|---|---|---|---|---|---|")
    groups = {(a["what"], a["motion"] if a["what"] == "balls" else "other balls") for a in answers}
    for what, moved in sorted(groups):
        some = [a for a in answers if a["what"] == what and (what == "nulls" or a["motion"] == moved)]
        beyond, spins = sum(a["answered"] > 1 for a in some), sum(a["spin"] for a in some)
        answered = sum(a["answered"] for a in some)
        print(
            f"| {moved} | {len(some)} | {wilson(beyond, len(some))} | {wilson(spins, len(some))} "
            f"| {wilson(answered, FRAMES * len(some))} | {wilson(sum(a['wrong'] for a in some), answered)} |"
        )
    print_spins(answers)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    ways = parser.add_subparsers(dest="way", required=True)
    drawing = ways.add_parser("draw")
    drawing.add_argument("what", choices=["nulls", "balls"])
    drawing.add_argument("--clips", type=int, default=200)
    drawing.add_argument("--seed", type=int, default=1)
    drawing.add_argument("-o", "--output", type=Path, required=True)
    judging = ways.add_parser("judge")
    judging.add_argument("folders", type=Path, nargs="+")
    judging.add_argument("--spindoe", default="spindoe")
    judging.add_argument("--json", type=Path)
    args = parser.parse_args()
    if args.way == "draw":
        draw(args.what, args.clips, args.seed, args.output)
    else:
        judge(args.folders, args.spindoe, args.json)


if __name__ == "__main__":
    main()
