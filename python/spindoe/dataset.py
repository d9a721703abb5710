"""Data sets of flights: clips to positions and spins, in the format of the published SpinDOE set, and as Parquet.

    import spindoe

    camera = spindoe.Camera.read("camera.yml")
    estimator = spindoe.Estimator("dots20", camera=camera)
    spindoe.dataset.write(["a.mp4", "b.mp4"], estimator, "flights")
    spindoe.dataset.to_parquet("flights", "flights.parquet")
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from . import _native
from ._common import Axes, clip_asked, optional, whole, write_whole
from ._pattern import PathLike
from ._vision import Estimator

if TYPE_CHECKING:
    import pyarrow

FORMAT_VERSION = 1


def write(
    clips: PathLike | Sequence[PathLike],
    estimators: Estimator | Sequence[Estimator],
    output: PathLike,
    *,
    names: Sequence[str] | None = None,
    fps: float | None = None,
    frame: Axes = "camera",
    circle: ArrayLike | None = None,
    roi: Sequence[int] | None = None,
    mirrored: bool = False,
    max_rps: float = 175.0,
    half_window: int = 8,
    min_log_odds: float = 20.0,
    min_jump_m_s: float = 0.7,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Writes the flights of clips to a folder, as ``spindoe dataset`` does.

    Args:
        clips: Videos, or folders of images.
        estimators: With the camera's intrinsics: one for each table that the ball may have.
        output: The folder.
        names: The tables' names in ``dataset.json``; by default their places.
        fps: Frames a second, instead of the videos' or names' own times.
        frame: Axes of positions, orientations and spins.
        circle: The ball's outline in all frames, where it is known.
        roi: The part of the images in which the ball is: left, top, width, height, pixels.
        mirrored: The images are mirrored: left and right are exchanged first.
        max_rps: Largest spin considered, revolutions per second.
        half_window: Positions before a bounce, and after it, that are fitted.
        min_log_odds: Ln of the odds for a bounce, at least.
        min_jump_m_s: Change of the velocity by a bounce, at least, m/s.
        overwrite: Whether a data set in the folder is replaced: the files that its ``dataset.json`` lists.

    Returns:
        What ``dataset.json`` says: tables, intrinsics, clips, and of each flight times, spin with its covariance, bounce.

    Raises:
        ValueError: For clips that cannot be read or have no times, a camera without intrinsics, a rate that is not positive, a folder
            that holds a data set or other files in its places, and one that is a clip.
    """
    several = [estimators] if isinstance(estimators, Estimator) else list(estimators)
    listed = [clips] if isinstance(clips, (str, Path)) or hasattr(clips, "__fspath__") else list(clips)
    called = [str(k) for k in range(len(several))] if names is None else [str(name) for name in names]
    if len(called) != len(several):
        raise ValueError(f"names: expected {len(several)}, found {len(called)}")
    asked = clip_asked(circle=circle, roi=roi, mirrored=mirrored, max_rps=max_rps)
    bounces = (whole("half_window", half_window), float(min_log_odds), float(min_jump_m_s))
    handles = [one._handle for one in several]
    found = _native.write_dataset(listed, handles, called, output, fps, frame, asked, bounces, overwrite)
    record: dict[str, Any] = json.loads(found)
    return record


def read(folder: PathLike) -> dict[str, Any]:
    """What a data set's ``dataset.json`` says.

    Raises:
        ValueError: For another kind of file or a later version.
        OSError: Where there is none.
    """
    path = Path(folder) / "dataset.json"
    try:
        record: dict[str, Any] = json.loads(path.read_text("utf-8"))
        version = record["format_version"]
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: expected the dataset.json of a data set") from error
    if version != FORMAT_VERSION:
        raise ValueError(f"{path}: expected format version {FORMAT_VERSION}, found {version}")
    return record


def to_arrow(folder: PathLike) -> pyarrow.Table:
    """A data set as a table of Arrow: a row for each frame of each flight. Needs pyarrow.

    The columns are ``flight``, ``clip``, those of the orientations' files (times of the clip, orientation, center and their covariances), and the
    flight's spin with its covariance, null where it has none. The schema's metadata has ``dataset.json`` under ``spindoe``.
    """
    arrow, csv = optional("pyarrow", "parquet"), optional("pyarrow.csv", "parquet")
    record = read(folder)
    parts = []
    for clip in record["clips"]:
        for flight in clip["flights"]:
            path = Path(folder) / "orientations" / f"{flight['number']:03}.csv"
            parts.append(_rows(arrow, csv, path, clip["path"], flight))
    if not parts:
        raise ValueError(f"{folder}: expected flights, found none")
    table: pyarrow.Table = arrow.concat_tables(parts)
    return table.replace_schema_metadata({"spindoe": json.dumps(record)})


def to_parquet(folder: PathLike, path: PathLike) -> None:
    """Writes a data set as one Parquet file, as `to_arrow` has it; it appears whole or not at all. Needs pyarrow."""
    parquet = optional("pyarrow.parquet", "parquet")
    content = io.BytesIO()
    parquet.write_table(to_arrow(folder), content)
    write_whole(path, content.getvalue())


# Columns of an orientations' file that are no numbers.
_WORDS = ("frame", "camera_frame")
_COUNTS = ("dots", "matched")


def _rows(arrow: Any, csv: Any, path: Path, clip: str, flight: dict[str, Any]) -> Any:
    """The rows of a flight."""
    with path.open("rb") as file:
        names = file.readline().decode().strip().split(",")
    kinds = {name: arrow.float64() for name in names}
    kinds |= {name: arrow.string() for name in _WORDS} | {name: arrow.int64() for name in _COUNTS}
    kinds = {name: kind for name, kind in kinds.items() if name in names}
    read = csv.read_csv(path, convert_options=csv.ConvertOptions(column_types=kinds))
    count, spin = read.num_rows, flight["spin"]
    vector = [None] * 3 if spin is None else spin["spin_rad_s"]
    covariance = None if spin is None else spin["covariance_rad2_s2"]
    columns = {
        "flight": arrow.array([flight["number"]] * count, arrow.int64()),
        "clip": arrow.array([clip] * count, arrow.string()),
        **{name: read.column(name) for name in names},
    }
    for k, axis in enumerate("xyz"):
        columns[f"spin_{axis}_rad_s"] = arrow.array([vector[k]] * count, arrow.float64())
    for i in range(3):
        for j in range(i, 3):
            value = None if covariance is None else covariance[i][j]
            name = f"spin_cov_{'xyz'[i]}{'xyz'[j]}_rad2_s2"
            columns[name] = arrow.array([value] * count, arrow.float64())
    return arrow.table(columns)
