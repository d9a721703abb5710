"""Orientations of a treadmill's ball in FicTrac's columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from numpy.typing import ArrayLike

from . import _native
from ._common import Floats, Frame, floats, optional, write_whole
from ._pattern import PathLike

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FicTracPath:
    """The rows of FicTrac for an animal that walks on a ball."""

    names: tuple[str, ...]
    """The 25 columns, in FicTrac's order."""
    values: Floats
    """A row for each frame with an orientation, shape (rows, 25): radians, radii of the ball, milliseconds."""
    _text: str

    def save(self, path: PathLike) -> None:
        """Writes the file as FicTrac does, without a header; it appears whole or not at all."""
        write_whole(path, self._text.encode())

    def to_dataframe(self) -> pandas.DataFrame:
        """The rows with their columns' names. Needs pandas."""
        library = optional("pandas", "pandas")
        table: pandas.DataFrame = library.DataFrame(self.values, columns=list(self.names))
        return table

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        return f"<FicTracPath of {len(self)} rows>"


def fictrac(
    times_s: ArrayLike,
    quaternions_wxyz: ArrayLike,
    *,
    covariances_rad2: ArrayLike | None = None,
    frame: Frame = "camera",
    c2a_r: tuple[float, float, float] | None = None,
    max_bad_frames: int | None = None,
) -> FicTracPath:
    """The fictive path of an animal on a ball, in the columns of FicTrac, as ``spindoe estimate --as fictrac`` writes them.

    Args:
        times_s: Times of the frames, seconds, increasing, shape (n,).
        quaternions_wxyz: Orientations, pattern to `frame`, shape (n, 4); rows of NaN are frames without one, which have no row and
            count.
        covariances_rad2: Covariances of their errors, shape (n, 3, 3), for the column of the error.
        frame: The frame of the orientations.
        c2a_r: FicTrac's camera-to-lab rotation: the rotation vector, radians, that turns camera axes (x right, y down, z forward) into
            the animal's (x front, y right, z down). By default that of a level camera behind the animal.
        max_bad_frames: After more frames without an orientation the path begins anew; None or -1 is never.

    Raises:
        ValueError: For times that are missing or do not increase, and arrays of other shapes.
    """
    names, values, text = _native.fictrac_rows(
        floats("times_s", times_s),
        floats("quaternions_wxyz", quaternions_wxyz),
        None if covariances_rad2 is None else floats("covariances_rad2", covariances_rad2),
        frame,
        None if c2a_r is None else [float(x) for x in c2a_r],
        max_bad_frames,
    )
    return FicTracPath(tuple(names), values, text)


class Followed(Protocol):
    """What a clip of a ball has: times, orientations and their covariances, and their frame."""

    @property
    def times_s(self) -> Floats | None: ...
    @property
    def quaternions_wxyz(self) -> Floats: ...
    @property
    def covariances_rad2(self) -> Floats: ...
    @property
    def frame(self) -> Frame: ...


def fictrac_of(
    found: Followed, c2a_r: tuple[float, float, float] | None, max_bad_frames: int | None
) -> FicTracPath:
    """That of a clip.

    Raises:
        ValueError: Where the frames have no times.
    """
    if found.times_s is None:
        raise ValueError("times_s: expected times of the frames, found none")
    return fictrac(
        found.times_s, found.quaternions_wxyz, covariances_rad2=found.covariances_rad2, frame=found.frame, c2a_r=c2a_r,
        max_bad_frames=max_bad_frames,
    )
