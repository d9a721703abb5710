"""Tasks on a Ray cluster, or one after another without one."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from typing import Any


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `run`."""
    parser.add_argument(
        "--ray",
        metavar="ADDRESS",
        help="run on this Ray cluster; auto: the one that is there; local: one on this machine "
        "[default: one task after another, here]",
    )
    parser.add_argument(
        "--cpus", type=int, default=1, help="cores of a task on the cluster [default: 1]"
    )


def run(
    work: Callable[..., Any],
    tasks: Sequence[tuple[Any, ...]],
    *,
    ray: str | None = None,
    cpus: int = 1,
    retries: int = 10,
) -> Iterator[Any]:
    """Yields `work(*task)` of all tasks, as they end.

    Args:
        work: A function that may be called again for the same task: a worker that dies is replaced.
        tasks: The arguments of each call.
        ray: Address of the cluster, ``auto`` or ``local``; None for none.
        cpus: Cores of a task.
        retries: How often a task is begun again after the death of its worker.

    Raises:
        ValueError: For fewer than one core.
        What `work` raises.
    """
    if cpus < 1:
        raise ValueError(f"cpus: expected 1 or more, found {cpus}")
    if ray is None:
        for task in tasks:
            yield work(*task)
        return
    try:
        import ray as cluster
    except ImportError as error:
        raise ValueError("ray: expected it to be installed: pip install spindoe[ray]") from error

    is_mine = not cluster.is_initialized()
    if is_mine:
        cluster.init(address=None if ray == "local" else ray, log_to_driver=False)
    try:
        remote = cluster.remote(work).options(
            num_cpus=cpus,
            max_retries=retries,
            runtime_env={"env_vars": {"RAYON_NUM_THREADS": str(cpus)}},
        )
        waiting = [remote.remote(*task) for task in tasks]
        while waiting:
            done, waiting = cluster.wait(waiting, num_returns=1)
            for reference in done:
                yield cluster.get(reference)
    finally:
        if is_mine:
            cluster.shutdown()
