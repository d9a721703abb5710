"""Times spindoe's Python package and two libraries of printed markers on the same pictures, on one thread.

    python peers.py traced/flying-60/1 traced/held-170/1 traced/nothing/1 traced/noise/1

takes folders of clip.py, or of `spindoe synth`, which have no tags. Every call gets the color frame as a camera gives
it: what a library converts is in its time, reading is not. Times are those of the processor, over all threads of the
process. pupil-apriltags and cv2.aruco look for tag36h11 with their default parameters; `Estimator.estimate` takes each
frame alone, `Tracker.update` one after the other, and its time counts from the second frame on. `found` is the share of
what the pictures show: tags with their centers within 2 px, orientations within 20 degrees; `false` is the number of
other answers.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

os.environ["RAYON_NUM_THREADS"] = "1"  # Read when a library is loaded.

import cv2
import numpy as np
from numpy.typing import NDArray

from score import RIGHT_WITHIN_DEG, rotation

TAG_WITHIN_PX = 2.0
Picture = NDArray[np.uint8]
Truth = dict[str, Any]


@dataclass
class Judged:
    """Right answers, things shown, other answers."""

    found: int = 0
    shown: int = 0
    false: int = 0

    def __add__(self, other: Judged) -> Judged:
        return Judged(self.found + other.found, self.shown + other.shown, self.false + other.false)


class Library:
    """What is timed."""

    skipped = 0
    """Frames of a clip that are not counted."""

    def __init__(self, args: argparse.Namespace) -> None:
        raise NotImplementedError

    def begin(self) -> None:
        """Before the first frame of a clip."""

    def answer(self, picture: Picture, time_s: float) -> Any:
        """The timed call."""
        raise NotImplementedError

    def judge(self, answer: Any, truth: Truth) -> Judged:
        """Compares with the truth."""
        raise NotImplementedError


def judge_tags(found: list[tuple[int, NDArray]], truth: Truth) -> Judged:
    """Tags by number and corners."""
    tags = truth.get("tags", [])
    true = {tag["id"]: np.mean([[c["u"], c["v"]] for c in tag["corners"]], axis=0) for tag in tags}
    right = {k for k, corners in found if k in true and np.linalg.norm(corners.mean(0) - true[k]) < TAG_WITHIN_PX}
    return Judged(len(right), len(true), len(found) - len(right))


class AprilTags(Library):
    """pupil-apriltags."""

    def __init__(self, args: argparse.Namespace) -> None:
        from pupil_apriltags import Detector

        self.detector = Detector("tag36h11", nthreads=1)

    def answer(self, picture: Picture, time_s: float) -> Any:
        return self.detector.detect(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY))

    def judge(self, answer: Any, truth: Truth) -> Judged:
        return judge_tags([(tag.tag_id, tag.corners) for tag in answer], truth)


class Aruco(Library):
    """cv2.aruco."""

    def __init__(self, args: argparse.Namespace) -> None:
        family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        self.detector = cv2.aruco.ArucoDetector(family)

    def answer(self, picture: Picture, time_s: float) -> Any:
        return self.detector.detectMarkers(picture)

    def judge(self, answer: Any, truth: Truth) -> Judged:
        corners, ids, _ = answer
        found = [] if ids is None else [(int(k), c[0]) for k, c in zip(ids.ravel(), corners, strict=True)]
        return judge_tags(found, truth)


class Alone(Library):
    """`Estimator.estimate`."""

    def __init__(self, args: argparse.Namespace) -> None:
        import spindoe

        self.estimator = spindoe.Estimator(args.table)

    def answer(self, picture: Picture, time_s: float) -> Any:
        return self.estimator.estimate(picture, color="bgr")

    def judge(self, answer: Any, truth: Truth) -> Judged:
        if truth["kind"] != "dotted":
            return Judged(0, 0, int(bool(answer.pose)))
        if not answer.pose:
            return Judged(0, 1, 0)
        # Without a camera the pose is in the view frame.
        off = rotation(truth["quaternion_wxyz"]) * rotation(answer.pose.quaternion_wxyz).inv()
        is_right = bool(np.degrees(off.magnitude()) < RIGHT_WITHIN_DEG)
        return Judged(int(is_right), 1, int(not is_right))


class Tracked(Alone):
    """`Tracker.update`."""

    skipped = 1

    def begin(self) -> None:
        self.tracker = self.estimator.tracker()

    def answer(self, picture: Picture, time_s: float) -> Any:
        return self.tracker.update(picture, time_s, color="bgr").frame


LIBRARIES: dict[str, type[Library]] = {
    "pupil-apriltags": AprilTags,
    "cv2.aruco": Aruco,
    "spindoe, alone": Alone,
    "spindoe, tracked": Tracked,
}


@dataclass
class Row:
    """A library on a folder."""

    ms: list[float] = field(default_factory=list)
    judged: Judged = field(default_factory=Judged)


def read(file: Path) -> Picture:
    """A picture, blue, green, red."""
    picture = cv2.imread(str(file), cv2.IMREAD_COLOR)
    if picture is None:
        raise SystemExit(f"{file}: no picture that can be read")
    return picture.astype(np.uint8, copy=False)


def run(library: Library, pictures: list[Picture], truths: list[Truth], row: Row) -> None:
    """One pass over a clip."""
    library.begin()
    for k, (picture, truth) in enumerate(zip(pictures, truths, strict=True)):
        time_s = truth["time_s"] if truth["time_s"] is not None else k / 100
        begun = time.process_time()
        answer = library.answer(picture, time_s)
        spent = time.process_time() - begun
        if k < library.skipped:
            continue
        row.ms.append(1e3 * spent)
        row.judged += library.judge(answer, truth)


def title(content: dict[str, Any]) -> str:
    """What a folder shows."""
    made = content.get("path_traced", {"kind": "spindoe synth", "ball_px": None})
    width, height = content["frames"][0]["size"]
    ball = "" if made["ball_px"] is None else f", {made['ball_px']:g} px"
    return f"{made['kind']}{ball}, {width} x {height}"


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--only", nargs="+", choices=LIBRARIES, default=list(LIBRARIES), metavar="LIBRARY")
    parser.add_argument("--repeats", type=int, default=3, help="passes over each folder")
    parser.add_argument("--table", default="dots20", help="the balls' pattern")
    return parser.parse_args()


def main() -> None:
    args = arguments()
    cv2.setNumThreads(1)
    try:
        libraries = {name: LIBRARIES[name](args) for name in args.only}
    except ModuleNotFoundError as error:
        raise SystemExit(f"{error}: install it, or name the libraries to time by --only") from error
    rows: dict[tuple[str, str], Row] = defaultdict(Row)
    for folder in args.folders:
        try:
            content = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        except OSError as error:
            raise SystemExit(f"{error.filename}: {error.strerror}") from error
        truths = content["frames"]
        pictures = [read(folder / "images" / frame["image"]) for frame in truths]
        for library in libraries.values():
            # What is set up with the first frame is not timed.
            library.begin()
            library.answer(pictures[0], 0.0)
        # In turns, so that what else the machine does meets all of them.
        for _ in range(args.repeats):
            for name, library in libraries.items():
                run(library, pictures, truths, rows[title(content), name])
    print("| pictures | library | n | found | false | p50, ms | p90 | p99 |\n|---|---|---|---|---|---|---|---|")
    for (pictures_of, name), row in rows.items():
        judged = row.judged
        found = f"{100 * judged.found / judged.shown:.1f} %" if judged.shown else "-"
        times = " | ".join(f"{ms:.2f}" for ms in np.percentile(row.ms, (50, 90, 99)))
        print(f"| {pictures_of} | {name} | {len(row.ms)} | {found} | {judged.false} | {times} |")


if __name__ == "__main__":
    main()
