"""Scores what `spindoe estimate` wrote for path-traced pictures.

    python score.py nothing.json traced/*/*/whole

reads in each folder truth.json (of render.py or of `spindoe synth`) and the named result, JSON (`--json`) or CSV
(`-o`), and prints a row for each kind and size; balls with bright dots, which are read by `--config bright_dots=true`, apart.
An answer is right within 20 degrees, as everywhere in the project; of pictures without the pattern every answer is
wrong. Rates have their Wilson 95 % intervals. Errors are those of right answers. "in the 95 % region" is the share of
right answers whose squared Mahalanobis distance is below the chi-square limit of three degrees of freedom. Outlines are
compared where the result has them (JSON, no intrinsics given): centers, and the radius with the ellipse's shorter half
axis, which it stands for.
"""

from __future__ import annotations

import argparse
import csv
import json
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import binomtest, chi2

RIGHT_WITHIN_DEG = 20.0
CHI2_95 = float(chi2.ppf(0.95, 3))
"""Of three degrees of freedom."""


@dataclass
class Answer:
    """An estimate of a frame."""

    rotation: Rotation | None
    is_view: bool
    covariance: np.ndarray | None
    circle: tuple[float, float, float] | None


@dataclass
class Row:
    """The frames of a kind and size."""

    frames: int = 0
    wrong: int = 0
    errors_deg: list[float] = field(default_factory=list)
    chi2: list[float] = field(default_factory=list)
    off_px: list[tuple[float, float]] = field(default_factory=list)


def rotation(wxyz: Any) -> Rotation:
    """Of a quaternion, scalar first."""
    w, x, y, z = (float(q) for q in wxyz)
    return Rotation.from_quat([x, y, z, w])


def answers(file: Path) -> dict[str, Answer]:
    """By the frames' names; frames that are not there have no answer."""
    found = {}
    if file.suffix == ".csv":
        for row in csv.DictReader(file.open(encoding="utf-8")):
            names = ("xx", "xy", "xz", "xy", "yy", "yz", "xz", "yz", "zz")
            cells = [row.get(f"cov_{name}") or "" for name in names]
            covariance = np.array([float(c) for c in cells]).reshape(3, 3) if all(cells) else None
            turned = rotation([row[q] for q in ("qw", "qx", "qy", "qz")]) if row["qw"] else None
            found[row["frame"]] = Answer(turned, row.get("camera_frame") == "view", covariance, None)
        return found
    for frame in json.loads(file.read_text(encoding="utf-8"))["frames"]:
        wxyz, covariance, circle = (frame.get(k) for k in ("orientation_wxyz", "covariance_rad2", "circle"))
        found[frame["frame"]] = Answer(
            rotation(wxyz) if wxyz else None,
            frame.get("camera_frame") == "view",
            np.array(covariance) if covariance else None,
            (circle["u"], circle["v"], circle["radius"]) if circle else None,
        )
    return found


def judge(row: Row, truth: dict[str, Any], answer: Answer | None) -> None:
    """Counts a frame."""
    row.frames += 1
    if answer is None or answer.rotation is None:
        return
    if truth["kind"] != "dotted":
        row.wrong += 1
        return
    true = rotation(truth["quaternion_wxyz" if answer.is_view else "camera_quaternion_wxyz"])
    # Covariances are tangent at the estimate, in the frame that it leads to.
    error = (true * answer.rotation.inv()).as_rotvec()
    degrees = np.degrees(np.linalg.norm(error))
    if degrees >= RIGHT_WITHIN_DEG:
        row.wrong += 1
        return
    row.errors_deg.append(float(degrees))
    if answer.covariance is not None:
        row.chi2.append(float(error @ np.linalg.solve(answer.covariance, error)))
    # With intrinsics the result's circle is that of the ball seen along the axis, which the picture does not show.
    if answer.circle is not None and answer.is_view:
        u, v, radius = answer.circle
        off = np.hypot(u - truth["center"]["u"], v - truth["center"]["v"])
        row.off_px.append((float(off), radius - min(truth["outline"]["half_axes_px"])))


def share(count: int, total: int) -> str:
    """A rate in percent with its Wilson 95 % interval."""
    if total == 0:
        return "-"
    low, high = binomtest(count, total).proportion_ci(method="wilson")
    return f"{100 * count / total:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"


def quantile(values: Any, q: float, form: str = "{:.3f}") -> str:
    """A quantile in words."""
    return form.format(np.quantile(values, q)) if len(values) else "-"


HEADINGS = (
    "pictures", "number", "right", "wrong", "unanswered", "median, deg", "95 %, deg", "in the 95 % region",
    "center off, px", "radius off, px (median, median of its size)",
)  # fmt: skip


def cells(name: str, row: Row) -> list[str]:
    """A row of the table."""
    right = len(row.errors_deg)
    off, radius = [p[0] for p in row.off_px], np.array([p[1] for p in row.off_px])
    return [
        name,
        str(row.frames),
        share(right, row.frames),
        share(row.wrong, row.frames),
        share(row.frames - right - row.wrong, row.frames),
        quantile(row.errors_deg, 0.5),
        quantile(row.errors_deg, 0.95, "{:.2f}"),
        share(sum(x < CHI2_95 for x in row.chi2), len(row.chi2)),
        quantile(off, 0.5),
        f"{quantile(radius, 0.5, '{:+.3f}')}, {quantile(abs(radius), 0.5)}",
    ]


def rank(row: tuple[str, Row]) -> tuple[bool, list[str]]:
    """Bright dots last, small balls first."""
    return "bright" in row[0], [part.rjust(8) if part[0].isdigit() else part for part in row[0].split(", ")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("result", help="the result's name in each folder")
    parser.add_argument("folders", nargs="+", type=Path)
    args = parser.parse_args()
    rows: dict[str, Row] = defaultdict(Row)
    for folder in args.folders:
        truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        found = answers(folder / args.result)
        made = truth.get("path_traced", {"kind": "spindoe synth", "ball_px": None})
        name = made["kind"] if made["ball_px"] is None else f"{made['kind']}, {made['ball_px']:g} px"
        for frame in truth["frames"]:
            is_bright = frame.get("ink") == "bright"
            row = rows[f"{made['kind']}, bright dots" if is_bright else name]
            judge(row, frame, found.get(Path(frame["image"]).stem))
    for line in (
        HEADINGS,
        ["---"] * len(HEADINGS),
        *(cells(name, row) for name, row in sorted(rows.items(), key=rank)),
    ):
        print("| " + " | ".join(line) + " |")


if __name__ == "__main__":
    main()
