"""What the modules share: settings as JSON, arrays of numbers, progress."""

from __future__ import annotations

import importlib
import json
import math
import operator
import os
import uuid
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Progress = Callable[[int, int], object]
Axes = Literal["camera", "optical"]
"""x right, y up, z towards the camera; or x right, y down, z forward (REP 103)."""
Frame = Literal["camera", "optical", "view", "optical_view"]
"""The camera's frame, or without intrinsics the view frame, whose z points from the ball to the camera; each in either axes."""


def floats(name: str, values: ArrayLike) -> Floats:
    """The values as an array of float64, without a copy where they are one."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64:
        return values
    array = np.asarray(values)
    # Complex numbers, strings and objects would be bent into numbers, or fail without a name.
    if array.dtype.kind not in "fiub" and array.size:
        raise ValueError(f"{name}: expected real numbers, found {array.dtype}")
    return array.astype(np.float64)


def settings_json(settings: Mapping[str, Any]) -> str:
    """Settings as JSON; NumPy's numbers and arrays are taken as Python's."""

    def plain(value: Any) -> Any:
        if isinstance(value, (np.generic, np.ndarray)):
            return value.tolist()
        raise ValueError(f"settings: expected numbers, names or lists, found {type(value).__name__}")

    def check(name: str, value: Any) -> None:
        if isinstance(value, Mapping):
            for key, within in value.items():
                check(f"{name}.{key}", within)
        elif isinstance(value, (list, tuple, np.ndarray)):
            for within in np.asarray(value, dtype=object).ravel():
                check(name, within)
        elif isinstance(value, (float, np.floating)) and not math.isfinite(value):
            raise ValueError(f"{name}: expected a finite number, found {value}")

    for name, value in settings.items():
        check(name, value)
    return json.dumps(dict(settings), default=plain)


def whole(name: str, value: Any, least: int = 0) -> int:
    """A whole number that is no less than this."""
    try:
        number = operator.index(value)
    except TypeError:
        raise ValueError(f"{name}: expected a whole number, found {value!r}") from None
    if not least <= number < 1 << 63:
        raise ValueError(f"{name}: expected a whole number from {least} on, found {number}")
    return number


def triple(name: str, values: ArrayLike) -> tuple[float, float, float]:
    """Three numbers."""
    array = floats(name, values)
    if array.shape != (3,):
        raise ValueError(f"{name}: expected 3 numbers, found shape {array.shape}")
    x, y, z = (float(v) for v in array)
    return x, y, z


def clip_asked(
    *,
    circle: ArrayLike | None = None,
    roi: Sequence[int] | None = None,
    mirrored: bool = False,
    independent: bool = False,
    judge: bool = True,
    readout_s: float = 0.0,
    max_rps: float,
) -> dict[str, Any]:
    """What is asked of a clip, as the library takes it."""
    region = None if roi is None else [whole("roi", number) for number in roi]
    if region is not None and (len(region) != 4 or 0 in region[2:]):
        raise ValueError(f"roi: expected left, top, width and height, with an area, found {region}")
    return {
        "circle": None if circle is None else triple("circle", circle),
        "roi": region,
        "mirrored": bool(mirrored),
        "independent": bool(independent),
        "judge": bool(judge),
        "readout_s": float(readout_s),
        "max_rps": float(max_rps),
    }


def wxyz(name: str, quaternion: ArrayLike) -> tuple[float, float, float, float]:
    """A quaternion's four numbers, scalar first."""
    array = floats(name, quaternion)
    if array.shape != (4,):
        raise ValueError(f"{name}: expected 4 numbers w, x, y, z, found shape {array.shape}")
    w, x, y, z = (float(v) for v in array)
    return w, x, y, z


def optional(module: str, extra: str) -> Any:
    """A module that the package does without.

    Raises:
        ValueError: Where it is not installed: with what installs it. Where it is and cannot be imported: with the reason.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        name = module.partition(".")[0]
        # A module that it needs itself, or a library of the system, is another matter.
        if isinstance(error, ModuleNotFoundError) and f"{module}.".startswith(f"{error.name}."):
            raise ValueError(f"{name}: expected it to be installed: pip install spindoe[{extra}]") from error
        reason = " ".join(str(error).split())
        raise ValueError(f"{name}: it is installed and cannot be imported: {reason}") from error


def scipy_rotation() -> type[Rotation]:
    """SciPy's class of rotations."""
    rotation: type[Rotation] = optional("scipy.spatial.transform", "scipy").Rotation
    return rotation


def to_scipy(quaternion_wxyz: Floats) -> Rotation:
    """SciPy's rotation of a quaternion, or of many; SciPy puts the scalar last."""
    return scipy_rotation().from_quat(np.roll(quaternion_wxyz, -1, axis=-1))


def rotation_matrix(quaternion_wxyz: Floats) -> Floats:
    """The matrix of a unit quaternion, shape (3, 3)."""
    w, x, y, z = quaternion_wxyz
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@contextmanager
def aside_of(path: str | os.PathLike[str]) -> Generator[Path]:
    """A place to write a file beside `path`, with its ending; it is moved there when all went well, else it is removed."""
    stem, ending = os.path.splitext(os.fspath(path))
    aside = Path(f"{stem}.{uuid.uuid4().hex}.part{ending}")
    try:
        yield aside
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)


def write_whole(path: str | os.PathLike[str], content: bytes) -> None:
    """Writes a file that appears whole or not at all, with the rights that a new file has."""
    with aside_of(path) as aside:
        aside.write_bytes(content)


def progress_of(progress: bool | Progress, total: int, unit: str) -> tuple[Progress | None, Any]:
    """What is called with `(done, total)`, and what to close: a bar of `tqdm` for True, where that
    is installed."""
    if callable(progress):
        return progress, None
    if not progress:
        return None, None
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return None, None
    bar = tqdm(total=total, unit=unit)

    def show(done: int, _total: int) -> None:
        bar.update(done - bar.n)

    return show, bar


class Rejection:
    """There is no answer. False where a truth value is wanted.

    Attributes:
        reason: Why not, in one sentence.
    """

    __slots__ = ("reason",)
    reason: str

    def __init__(self, reason: str) -> None:
        self.reason = reason

    def __bool__(self) -> Literal[False]:
        return False

    def __repr__(self) -> str:
        return f"Rejection({self.reason!r})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Rejection) and self.reason == other.reason

    def __hash__(self) -> int:
        return hash(self.reason)

    def __reduce__(self) -> tuple[type[Rejection], tuple[str]]:
        return Rejection, (self.reason,)
