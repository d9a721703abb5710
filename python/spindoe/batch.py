"""Estimates many clips, each a folder of images or a video, on a Ray cluster or on this machine.

    python -m spindoe.batch clips/* --table table.npz -o results --ray auto

Each clip gives ``results/NAME.json``: what ``spindoe estimate --json`` prints, and ``inputs_sha256``, a digest of
all that it follows from: the clip, the table, the flags with the files that they name, and this package's version.
A clip whose result has the same digest is not estimated again: what was interrupted is continued by the same
command. ``results/summary.csv`` has a row a clip. Files and folders must be the same on all machines.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import io
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from . import _cluster
from ._common import write_whole
from ._native import __version__
from ._pattern import PathLike

COLUMNS = (
    "clip", "frames", "identified", "rps", "std_rps",
    *(f"axis_{axis}" for axis in "xyz"),
    *(f"spin_{axis}_rad_s" for axis in "xyz"),
    *(f"cov_{pair}_rad2_s2" for pair in ("xx", "xy", "xz", "yy", "yz", "zz")),
    "reason",
)


def _estimate(clip: str, table: str, target: str, flags: list[str]) -> dict[str, Any]:
    """One task: estimates a clip unless its result is there; its row of the summary."""
    digest = inputs_sha256(clip, table, flags)
    found = _kept(target, digest)
    if found is None:
        # What follows from other inputs must not stand for this clip's result where it has none.
        Path(target).unlink(missing_ok=True)
        command = [sys.executable, "-m", "spindoe", "estimate", clip, "--table", table, "--json", *flags]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            lines = done.stderr.strip().splitlines()
            return {"clip": clip, "reason": lines[-1] if lines else f"exit code {done.returncode}"}
        found = {**json.loads(done.stdout), "inputs_sha256": digest}
        write_whole(target, json.dumps(found).encode())
    spin = found.get("spin", {})
    axis = spin.get("axis") or [None] * 3
    vector = spin.get("spin_rad_s") or [None] * 3
    covariance = spin.get("covariance_rad2_s2") or [[None] * 3] * 3
    return {
        "clip": clip,
        "frames": len(found["frames"]),
        "identified": found["identified"],
        "rps": spin.get("rps"),
        "std_rps": spin.get("std_rps"),
        **{f"axis_{name}": axis[k] for k, name in enumerate("xyz")},
        **{f"spin_{name}_rad_s": vector[k] for k, name in enumerate("xyz")},
        **{
            f"cov_{'xyz'[i]}{'xyz'[j]}_rad2_s2": covariance[i][j]
            for i in range(3)
            for j in range(i, 3)
        },
        "reason": found.get("spin_refusal", ""),
    }


def inputs_sha256(clip: PathLike, table: PathLike, flags: Sequence[str]) -> str:
    """The digest of all that a clip's result follows from: version, flags, and the content of the clip, the
    table and the files that flags name."""
    named = [word.partition("=")[2] if word.startswith("--") else word for word in flags]
    digest = hashlib.sha256(json.dumps([__version__, list(flags)]).encode())
    for path in [clip, table, *(name for name in named if os.path.exists(name))]:
        files = sorted(Path(path).rglob("*")) if os.path.isdir(path) else [Path(path)]
        for file in files:
            if file.is_file():
                of_file = hashlib.sha256()
                with file.open("rb") as content:
                    while piece := content.read(1 << 20):
                        of_file.update(piece)
                name = os.path.relpath(file, path)
                digest.update(json.dumps([name, of_file.hexdigest()]).encode())
    return digest.hexdigest()


def _kept(target: str, digest: str) -> dict[str, Any] | None:
    """The result that is there, where it follows from the same inputs."""
    try:
        with open(target, encoding="utf-8") as file:
            found: dict[str, Any] = json.load(file)
    except (FileNotFoundError, json.JSONDecodeError):
        return None
    return found if found.get("inputs_sha256") == digest else None


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
    summary = io.StringIO(newline="")
    writer = csv.DictWriter(summary, COLUMNS)
    writer.writeheader()
    writer.writerows(ordered)
    write_whole(os.path.join(folder, "summary.csv"), summary.getvalue().encode())
    return ordered


def main(words: list[str] | None = None) -> int:
    """The command line; returns the exit code: 3 where no clip has a result."""
    parser = argparse.ArgumentParser(
        prog="python -m spindoe.batch", description=__doc__, allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
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
