"""Estimates many clips, each a folder of images or a video, on a Ray cluster or on this machine.

    python -m spindoe.batch clips/* --table table.npz -o results --ray auto

Each clip gives ``results/NAME.json``, what ``spindoe estimate --json`` prints. Clips that have one are not
estimated again: what was interrupted is continued by the same command. ``results/summary.csv`` has a row
a clip. Files and folders must be the same on all machines.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from typing import Any

from . import _cluster
from ._pattern import PathLike

COLUMNS = ("clip", "frames", "identified", "rps", "std_rps", "reason")


def _estimate(clip: str, table: str, target: str, flags: list[str]) -> dict[str, Any]:
    """One task: estimates a clip unless its result is there; its row of the summary."""
    if not os.path.exists(target):
        command = [sys.executable, "-m", "spindoe", "estimate", clip, "--table", table, "--json", *flags]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            lines = done.stderr.strip().splitlines()
            return {"clip": clip, "reason": lines[-1] if lines else f"exit code {done.returncode}"}
        # The result appears whole or not at all.
        folder = os.path.dirname(target)
        with tempfile.NamedTemporaryFile("w", dir=folder, delete=False, suffix=".part") as aside:
            aside.write(done.stdout)
        os.replace(aside.name, target)
    with open(target, encoding="utf-8") as file:
        found = json.load(file)
    spin = found.get("spin", {})
    return {
        "clip": clip,
        "frames": len(found["frames"]),
        "identified": found["identified"],
        "rps": spin.get("rps"),
        "std_rps": spin.get("std_rps"),
        "reason": found.get("spin_refusal", ""),
    }


def batch(
    clips: Sequence[PathLike],
    table: PathLike,
    out: PathLike,
    *,
    ray: str | None = None,
    cpus: int = 1,
    flags: Sequence[str] = (),
) -> list[dict[str, Any]]:
    """Estimates clips; returns the rows of the summary, in the clips' order.

    Args:
        clips: Folders of images, or videos, of different names.
        table: The pattern's table, or the pattern.
        out: The folder for the results.
        ray: Address of the Ray cluster, ``auto`` or ``local``; None runs here, one after another.
        cpus: Cores of a clip on the cluster.
        flags: Further flags of ``spindoe estimate``.

    Raises:
        ValueError: Where two clips have the same name, or there is none.
    """
    paths = [os.path.abspath(clip) for clip in clips]
    names = [os.path.basename(path.rstrip(os.sep)) for path in paths]
    if not paths:
        raise ValueError("clips: expected at least one, found none")
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"clips: expected different names, found {name} twice")
    folder = os.path.abspath(out)
    os.makedirs(folder, exist_ok=True)
    tasks = [
        (path, os.path.abspath(table), os.path.join(folder, f"{name}.json"), list(flags))
        for path, name in zip(paths, names, strict=True)
    ]
    rows = {row["clip"]: row for row in _cluster.run(_estimate, tasks, ray=ray, cpus=cpus)}
    ordered = [rows[path] for path in paths]
    with open(os.path.join(folder, "summary.csv"), "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(ordered)
    return ordered


def main(words: list[str] | None = None) -> int:
    """The command line; returns the exit code: 3 where no clip has a result."""
    parser = argparse.ArgumentParser(prog="python -m spindoe.batch", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("clips", nargs="+", help="folders of images, or videos")
    parser.add_argument("--table", required=True, help="the pattern's table, or the pattern")
    parser.add_argument("-o", "--output", dest="out", required=True, help="folder for the results")
    _cluster.add_arguments(parser)
    arguments, flags = parser.parse_known_args(words)
    try:
        rows = batch(
            arguments.clips, arguments.table, arguments.out,
            ray=arguments.ray, cpus=arguments.cpus, flags=flags,
        )
    except ValueError as error:
        print(f"spindoe.batch: {error}", file=sys.stderr)
        return 2
    for row in rows:
        if "frames" not in row:
            print(f"{row['clip']}: {row['reason']}", file=sys.stderr)
    done = sum("frames" in row for row in rows)
    print(f"{done} of {len(rows)} clips: {arguments.out}")
    return 0 if done else 3


if __name__ == "__main__":
    sys.exit(main())
