"""Files of others: the published trajectories, and the nets as ONNX."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from ._common import write_whole
from ._pattern import PathLike


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A ball's flight, in the publisher's frame (z up)."""

    number: int
    """Its number, which is its file's name."""
    time_s: npt.NDArray[np.float64]
    """Times, (n,), seconds."""
    position_m: npt.NDArray[np.float64]
    """Positions, (n, 3), meters."""
    spin: npt.NDArray[np.float64] | None
    """Spin, (3,), rad/s; None where the index has none."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TrajectorySet:
    """The trajectories of a folder, in order of their numbers."""

    trajectories: list[Trajectory]
    _summary: str

    def summary(self) -> dict[str, Any]:
        """Numbers of trajectories and points; smallest, median and largest of points, durations (s) and spins (rps); the
        median interval (s) and speed (m/s)."""
        found: dict[str, Any] = json.loads(self._summary)
        return found

    def __len__(self) -> int:
        return len(self.trajectories)

    def __repr__(self) -> str:
        return f"<TrajectorySet of {len(self)}>"


def read_trajectories(folder: PathLike) -> TrajectorySet:
    """Reads trajectories with known spins, in the format of the published SpinDOE set: ``index.csv``
    (``traj_file,x_spin,y_spin,z_spin``; rad/s) and a file ``NNN.csv`` for each (``t;x;y;z``; seconds and meters).

    Raises:
        ValueError: For a file that is not in this format, with its line.
    """
    found, summary = _native.read_trajectories(folder)
    trajectories = [
        Trajectory(number, times, positions, None if spin is None else np.asarray(spin))
        for number, times, positions, spin in found
    ]
    return TrajectorySet(trajectories, summary)


def write_onnx(path: PathLike, head: str = "dots", weights: PathLike | None = None) -> None:
    """Writes a net as ONNX, for estimators in other languages.

    Args:
        path: The file to write.
        head: The built-in net: ``dots``, ``dots-large`` or ``outline``.
        weights: Weights made by ``python -m train``, instead.
    """
    write_whole(path, _native.onnx_bytes(head, weights))
