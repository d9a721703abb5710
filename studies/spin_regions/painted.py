"""Do the 95 % regions of painted balls' spins hold, and are even spins called constant? Clips of `spindoe synth`, even light.

    python painted.py --clips 50 --seed 5940000 [--distance] [--spindoe spindoe]

Needs NumPy and SciPy. 24 frames at 60 a second of a ball of 80 pixels with blotches, 0.15 to 6 revolutions per second, 8 to 40 ball radii
before a camera whose distance is given with --distance. The truth is the spin in the ball's view frame.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
from clips import QUANTILES
from scipy.spatial.transform import Rotation

FRAMES, FPS = 24, 60
# As the tests of painted balls have it, at other distances.
SCENE = json.loads(Path(__file__).with_suffix(".json").read_text()) | {"camera_distance_radii": [8, 40]}


def turn(wxyz: list[float]) -> Rotation:
    return Rotation.from_quat([*wxyz[1:], wxyz[0]])


def judged(spindoe: str, seed: int, is_given: bool) -> tuple[str, float, float]:
    """The motion that is taken, the error over the spin, and chi2."""
    rps = 0.15 * 40 ** np.random.default_rng(seed).random()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "scene.json").write_text(json.dumps(SCENE))
        drawn = [spindoe, "synth", "--preset", str(folder / "scene.json"), "-o", str(folder / "clip"), "--seed", str(seed)]
        drawn += ["--frames", str(FRAMES), "--fps", str(FPS), "--rps", f"{rps:.3f}"]
        subprocess.run(drawn, check=True, capture_output=True)
        first = json.loads((folder / "clip/truth.json").read_text())["frames"][0]
        estimate = [spindoe, "estimate", "--painted", str(folder / "clip/images"), "--json"]
        if is_given:
            estimate += ["--camera-distance-radii", str(first["distance"])]
        done = subprocess.run(estimate, capture_output=True, text=True, check=False)
    found = json.loads(done.stdout).get("spin") if done.stdout.strip() else None
    if not found:
        return "no spin", np.nan, np.nan
    to_view = turn(first["quaternion_wxyz"]) * turn(first["camera_quaternion_wxyz"]).inv()
    truth = to_view.apply(first["spin_rad_s"])
    off = np.array(found["spin_rad_s"]) - truth
    chi2 = off @ np.linalg.solve(np.array(found["covariance_rad2_s2"]), off)
    return found.get("motion", "constant"), float(np.linalg.norm(off) / np.linalg.norm(truth)), float(chi2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clips", type=int, default=50)
    parser.add_argument("--seed", type=int, default=5_940_000)
    parser.add_argument("--distance", action="store_true")
    parser.add_argument("--spindoe", default="spindoe")
    args = parser.parse_args()
    all_ = []
    for k in range(args.clips):
        all_.append(judged(args.spindoe, args.seed + k, args.distance))
        print(*all_[-1], file=sys.stderr)
    spins = [one for one in all_ if one[0] != "no spin"]
    within = sum(chi2 < QUANTILES[0.95] for *_, chi2 in spins)
    off, chi2 = (np.median([one[k] for one in spins]) for k in (1, 2))
    print(dict(Counter(one[0] for one in all_)))
    print(f"within the 95 % region: {within} of {len(spins)}; error, median {100 * off:.2f} %; chi2 of 3, median {chi2:.2f}")


if __name__ == "__main__":
    main()
