"""The trials of the SpinDOE authors' benchmark of their recognizer, through both: rates and times.

    python benchmark_compat.py PATTERN.csv [--samples 500] [--theirs FOLDER]

FOLDER is the folder `python` of a clone of https://github.com/cogsys-tuebingen/spindoe (it needs SciPy,
matplotlib and tqdm). Without it, the paper's recognizer of this package stands for theirs. As there: a
random rotation, a rotation of each dot about a random axis by a normal angle, four of the dots with
z > 1/3; a success is the right pair of indices of the first two.
"""

from __future__ import annotations

import argparse
import importlib
import sys
import time
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import spindoe
from spindoe.compat import BayGeoHasher


def views(pattern: np.ndarray, samples: int, std: float, seed: int) -> list[tuple[Any, Any]]:
    """Views of four dots with their true indices."""
    rng = np.random.default_rng(seed)
    made: list[tuple[Any, Any]] = []
    while len(made) < samples:
        turned = Rotation.from_rotvec(rng.uniform(0.0, np.pi, 3)).apply(pattern)
        axes = rng.uniform(0.0, 1.0, turned.shape)
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        angles = rng.normal(0.0, std, (len(turned), 1))
        dots = Rotation.from_rotvec(angles * axes).apply(turned)
        visible = np.flatnonzero(dots[:, 2] > 1.0 / 3.0)
        if len(visible) >= 4:
            chosen = rng.choice(visible, 4, replace=False)
            made.append((dots[chosen], chosen))
    return made


def main() -> None:
    parser = argparse.ArgumentParser(description="Benchmark of the drop-in.")
    parser.add_argument("pattern")
    parser.add_argument("--samples", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--theirs")
    arguments = parser.parse_args()
    pattern = np.array(spindoe.Pattern.load(arguments.pattern).dots)
    hashers: dict[str, Any] = {"spindoe.compat": BayGeoHasher()}
    if arguments.theirs:
        sys.path.insert(0, arguments.theirs)
        theirs = importlib.import_module("baygeohasher")
        hashers["theirs"] = theirs.BayGeoHasher()
    else:
        hashers["spindoe.compat, paper"] = BayGeoHasher(recognizer="voting")
    for hasher in hashers.values():
        hasher.gen_hash_table(pattern)
    print(f"{arguments.samples} views each, seed {arguments.seed}")
    for std in (0.01, 0.03, 0.05, 0.07, 0.1):
        trials = views(pattern, arguments.samples, std, arguments.seed)
        words = []
        for name, hasher in hashers.items():
            begun = time.perf_counter()
            right = sum(bool((truth[:2] == hasher.identify(dots)[0]).all()) for dots, truth in trials)
            each = (time.perf_counter() - begun) / len(trials)
            words.append(f"{name}: {100 * right / len(trials):.1f} %, {1e6 * each:.0f} us")
        print(f"std {std:.2f} rad   " + "   ".join(words))


if __name__ == "__main__":
    main()
