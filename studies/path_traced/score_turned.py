"""Builds the patterns of balls drawn by hand (turned.py) and compares them with the truth.

    python score_turned.py traced/turned/*
    python score_turned.py --no-count traced/turned/*

runs `spindoe calibrate FOLDER/images`, with `--dots` and the true number unless `--no-count`, and prints a line for
each clip, then rates with their Wilson 95 % intervals. A pattern is whole where each dot of the ball, and nothing else,
has one of its own within a degree; a written pattern that is not whole is wrong. Patterns are compared after the
rotation that fits them best.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest

WITHIN_DEG = 1.0
SHOWN_WELL = 0.35
"""A dot that nothing hides and that faces the camera by so much is shown well."""
ENOUGH_FRAMES = 10
"""A dot that is shown well in so many frames can be measured."""


@dataclass
class Outcome:
    """What became of a clip."""

    is_shown: bool
    """Whether every dot is shown in frames enough."""
    kind: str
    """`whole`, `wrong` or `refused`."""
    words: str


def aligned(found: np.ndarray, true: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The best match under the best rotation: rows of found, of true, and the angles between them, degrees."""
    best = None
    rng = np.random.default_rng(0)
    # Pairs of dots fix a rotation; the one under which most dots meet is refined.
    for _ in range(4000):
        a, b = rng.choice(len(found), 2, replace=False)
        between = np.arccos(np.clip(found[a] @ found[b], -1, 1))
        others = np.abs(np.arccos(np.clip(true @ true.T, -1, 1)) - between) < np.radians(2.0)
        np.fill_diagonal(others, val=False)
        pairs = np.argwhere(others)
        if between < 0.2 or len(pairs) == 0:
            continue
        c, d = pairs[rng.integers(len(pairs))]
        rotation = Rotation.align_vectors(true[[c, d]], found[[a, b]])[0]
        near = (rotation.apply(found) @ true.T).max(axis=1) > np.cos(np.radians(3.0))
        if best is None or near.sum() > best[0]:
            best = near.sum(), rotation
    rotation = best[1]
    for _ in range(3):
        cosines = np.clip(rotation.apply(found) @ true.T, -1, 1)
        rows, columns = linear_sum_assignment(-cosines)
        near = cosines[rows, columns] > np.cos(np.radians(4.0))
        rotation = Rotation.align_vectors(true[columns[near]], found[rows[near]])[0]
    angles = np.degrees(np.arccos(np.clip((rotation.apply(found)[rows] * true[columns]).sum(-1), -1, 1)))
    return rows, columns, angles


def judged(folder: Path, command: list[str], *, has_count: bool) -> Outcome:
    """Runs the command on a clip."""
    truth = json.loads((folder / "truth.json").read_text())
    true = np.array(truth["pattern"])
    well = [d["index"] for f in truth["frames"] for d in f["dots"] if d["facing"] >= SHOWN_WELL and not d["occluded"]]
    shown = np.bincount(well, minlength=len(true))
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "ball"
        flags = ["--dots", str(len(true))] if has_count else []
        run = subprocess.run(
            [*command, "calibrate", str(folder / "images"), *flags, "-o", str(out)], capture_output=True, text=True
        )
        is_shown = bool(shown.min() >= ENOUGH_FRAMES)
        if run.returncode != 0:
            lines = [line for line in run.stderr.splitlines() if line.startswith("error")] or run.stderr.splitlines()[
                -1:
            ]
            return Outcome(is_shown, "refused", re.sub(r"\S*/images:? ?", "", lines[0])[:230])
        found = np.loadtxt(out / "pattern.csv", delimiter=",")
    rows, columns, angles = aligned(found, true)
    is_whole = len(found) == len(true) and angles.max() < WITHIN_DEG
    words = f"{len(found)} dots, rms {np.sqrt((angles**2).mean()):.2f} deg, largest {angles.max():.2f}"
    return Outcome(is_shown, "whole" if is_whole else "wrong", words)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--no-count", action="store_true", help="do not say how many dots there are")
    parser.add_argument("--command", default="spindoe")
    args = parser.parse_args()
    outcomes = []
    for folder in args.folders:
        outcome = judged(folder, args.command.split(), has_count=not args.no_count)
        outcomes.append(outcome)
        shown = "" if outcome.is_shown else " (not every dot shown in ten frames)"
        print(f"{folder.name}: {outcome.kind}{shown}: {outcome.words}", flush=True)
    for name, of in (("all", outcomes), ("every dot shown", [o for o in outcomes if o.is_shown])):
        for kind in ("whole", "wrong"):
            count = sum(o.kind == kind for o in of)
            low, high = binomtest(count, max(len(of), 1)).proportion_ci(method="wilson")
            print(f"{name}: {kind} {count} of {len(of)} [{100 * low:.1f}, {100 * high:.1f}]")


if __name__ == "__main__":
    main()
