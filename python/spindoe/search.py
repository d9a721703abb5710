"""A search for a pattern in shards, on a Ray cluster or on this machine.

    python -m spindoe.search --shards 8 -o my-ball --ray auto --seed 7 --config rounds=20

Other flags are those of ``spindoe design`` that say what is searched. The folder must be the same on all machines: the shards'
checkpoints lie in it, from which a shard whose worker died is taken up again. The result is that of
``spindoe design --config shards=8`` with the same flags.
"""

from __future__ import annotations

import argparse
import os
import sys

from . import _cluster
from ._design import Design, DesignResult, design_of_flags, merge
from ._pattern import PathLike


def _shard(design: Design, index: int, count: int) -> str:
    """One task."""
    return design.run_shard(index, count)


def search(
    design: Design, shards: int, *, ray: str | None = None, cpus: int = 1, verbose: bool = False
) -> DesignResult:
    """Runs all shards of a design, and merges them. What has begun is continued.

    Args:
        design: The design.
        shards: Number of shards.
        ray: Address of the Ray cluster, ``auto`` or ``local``; None runs here, one after another.
        cpus: Cores of a shard on the cluster.
        verbose: Say on standard error which shards are done.
    """
    if shards < 1:
        raise ValueError(f"shards: expected 1 or more, found {shards}")
    tasks = [(design, index, shards) for index in range(1, shards + 1)]
    folders: list[PathLike] = []
    for folder in _cluster.run(_shard, tasks, ray=ray, cpus=cpus):
        folders.append(folder)
        if verbose:
            print(f"{len(folders)} of {shards} shards: {folder}", file=sys.stderr)
    # A design that is there is not made again.
    is_done = os.path.exists(os.path.join(os.fspath(design.out), "report.json"))
    return merge(folders, design.out, resume=not is_done)


def main(words: list[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m spindoe.search", description=__doc__, allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--shards", type=int, required=True, help="number of shards")
    parser.add_argument("-o", "--output", dest="out", required=True, help="folder, the same on all machines")
    _cluster.add_arguments(parser)
    arguments, rest = parser.parse_known_args(words)
    try:
        design = design_of_flags(arguments.out, rest)
        found = search(
            design, arguments.shards, ray=arguments.ray, cpus=arguments.cpus, verbose=True
        )
    except ValueError as error:
        print(f"spindoe.search: {error}", file=sys.stderr)
        return 2
    print(found.dir)
    return 0


if __name__ == "__main__":
    sys.exit(main())
