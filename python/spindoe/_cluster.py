"""Tasks on a Ray cluster, or one after another without one."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ._common import optional


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
        cpus: Cores of a task. Where no machine of the cluster has so many yet, a warning says so.
        retries: How often a task is begun again after the death of its worker.

    Raises:
        ValueError: For fewer than one core, or more than this machine has where it is the cluster; for a
            cluster that is not there.
        What `work` raises.
    """
    if cpus < 1:
        raise ValueError(f"cpus: expected 1 or more, found {cpus}")
    if ray is None:
        for task in tasks:
            yield work(*task)
        return
    cluster = optional("ray", "ray")
    is_mine = not cluster.is_initialized()
    if is_mine:
        try:
            cluster.init(address=None if ray == "local" else ray, log_to_driver=False)
        except (ConnectionError, RuntimeError, ValueError) as error:
            first = str(error).strip().partition("\n")[0]
            raise ValueError(f"ray: expected a cluster at {ray}, found none: {first}") from error
    try:
        largest = max(int(node["Resources"].get("CPU", 0)) for node in cluster.nodes())
        if cpus > largest and ray == "local":
            raise ValueError(f"cpus: expected at most {largest}, the cores of this machine, found {cpus}")
        if cpus > largest:
            # A cluster may grow.
            warnings.warn(f"cpus: no machine of the cluster has {cpus} cores, but {largest}: waiting for one",
                          stacklevel=2)
        remote = cluster.remote(work).options(
            num_cpus=cpus,
            max_retries=retries,
            runtime_env={"env_vars": {"RAYON_NUM_THREADS": str(cpus)}},
        )
        waiting = [remote.remote(*task) for task in tasks]
        while waiting:
            done, waiting = cluster.wait(waiting, num_returns=1)
            for reference in done:
                try:
                    yield cluster.get(reference)
                except cluster.exceptions.RayTaskError as error:
                    # What the task raised, without the worker's traceback in its words.
                    raise error.cause from None
    finally:
        if is_mine:
            cluster.shutdown()
