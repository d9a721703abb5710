"""The frames of a sequence with its spin: kept, tabulated, drawn."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import _html
from ._common import Floats, Frame, Ints, Rejection, optional, write_whole
from ._fictrac import FicTracPath, fictrac_of
from ._frame import FrameEstimate, Pose, frame_of
from ._native import __version__
from ._pattern import PathLike
from ._spin import Alias, Spin, SpinCurve, spin_of

if TYPE_CHECKING:
    import matplotlib.axes
    import pandas

    from ._vision import TrackerState

FORMAT_VERSION = 1


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """A table that a ball may carry, seen directly or in mirrored images, and what a sequence says of it."""

    table: int
    """The table's place: 0 is the estimator's own, then come the others."""
    mirrored: bool
    """Whether the images are taken for mirrored."""
    frames: int
    """Number of frames that were asked."""
    answered: int
    """How many of these it explains."""
    common_motion: bool
    """Whether most of their orientations follow one motion."""
    ln_evidence: float
    """Ln of the evidence for it, against any other ball."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What all frames of a sequence together say: does a table fit, and are the images mirrored?"""

    answer: Literal["fits", "mirrored", "tied", "none", "open"]
    """``"mirrored"`` where the images are, ``"tied"`` where two hypotheses fit about as well, ``"none"`` where none does, ``"open"`` where
    too few frames say anything. Where the images are mirrored, no table fits or two tables tie, no frame keeps its pose."""
    table: int
    """The table in use: 0 is the estimator's own, then come the others."""
    ln_odds: float | None
    """Lead over the next best hypothesis, ln of the odds."""
    hypotheses: tuple[Hypothesis, ...]
    """What was weighed."""


@dataclass(slots=True, eq=False, repr=False)
class SequenceEstimate:
    """The frames of one sequence, and its spin."""

    frames: list[FrameEstimate]
    """In the order of the images."""
    spin: Spin | Rejection
    """The spin, or why there is none."""
    independent: int
    """Number of frames that had an orientation before they informed each other."""
    quaternions_wxyz: Floats
    """Orientations, shape (frames, 4), NaN where there is none, in the frame of the spin: without
    intrinsics the view frames of the poses are brought into one."""
    covariances_rad2: Floats
    """Covariances of their errors, rotation vectors in that frame; shape (frames, 3, 3)."""
    view_turns_rad: Floats | None
    """The turns of the view frame, and what one standard deviation of each of three errors of the camera,
    which all frames share, does to the orientation: four rotation vectors, shape (frames, 12); None where
    the poses are in the camera frame."""
    frame: Frame
    """The frame of these orientations and of the spin."""
    times_s: Floats | None = None
    """Times of the frames, seconds, shape (frames,), of a rolling shutter those at which the ball's center is seen; None where there were
    none."""
    cameras: Ints | None = None
    """Of a rig: how many cameras' orientations each frame's is of, 0 where there is none; shape (frames,)."""
    chi2: Floats | None = None
    """Of a rig: by how much the cameras of each frame differ, chi2 for each degree of freedom, NaN where one camera or none has an
    orientation; shape (frames,)."""
    notes: tuple[str, ...] = ()
    """Of a rig: how its cameras and their clocks agree."""
    verdict: Verdict | None = None
    """Whether the tables fit and the images are mirrored; None where that was not asked."""

    @property
    def positions_m(self) -> Floats:
        """The ball's center in each frame, m, in the camera's frame, NaN where it is not known; shape (frames, 3)."""
        return _column((3,), [frame.position_m for frame in self.frames])

    @property
    def confidences(self) -> Floats:
        """Probability of each orientation, 0 where there is none; shape (frames,)."""
        return np.array([f.pose.confidence if f.pose else 0.0 for f in self.frames])

    @property
    def residuals_rad(self) -> Floats:
        """Residual of each orientation, radians, NaN where there is none; shape (frames,)."""
        return np.array([f.pose.residual_rad if f.pose else np.nan for f in self.frames])

    @property
    def matched(self) -> Ints:
        """Number of matched dots of each frame; shape (frames,)."""
        return np.array([f.matched for f in self.frames], dtype=np.int64)

    def save(self, path: PathLike) -> None:
        """Writes all of it as ``.npz``, which `load` and NumPy read; the file appears whole or not at all.

        Rows are frames; ``dots``, ``dot_covariances_px2`` and ``assignment`` have those of frame ``i`` from
        ``dot_offsets[i]`` to ``dot_offsets[i + 1]``. What a frame lacks is NaN, what the sequence lacks is no array.
        ``meta`` is JSON in bytes: the format's version, the frames of orientations, and reasons.
        """
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **_arrays(self))
        write_whole(path, content.getvalue())

    @classmethod
    def load(cls, path: PathLike) -> SequenceEstimate:
        """Reads what `save` wrote, bit by bit the same.

        Raises:
            ValueError: For a file of another kind or a later version, that is damaged, or with an array that is missing or of
                another shape.
        """
        name, content = os.fspath(path), Path(path).read_bytes()
        try:
            with np.load(io.BytesIO(content), allow_pickle=False) as file:
                arrays = dict(file.items())
            meta = json.loads(arrays["meta"].tobytes())
            version = meta["sequence_format_version"]
        except Exception as error:
            # A damaged archive takes its readers anywhere: to other compressions, passwords, sizes, places before the file.
            raise ValueError(f"{name}: expected a sequence that SequenceEstimate.save wrote") from error
        if version != FORMAT_VERSION:
            raise ValueError(f"{name}: expected format version {FORMAT_VERSION}, found {version}")
        try:
            return _sequence(arrays, meta)
        except KeyError as error:
            raise ValueError(f"{name}: {error.args[0]}: expected it, found none") from error
        except (AttributeError, IndexError, TypeError, ValueError) as error:
            raise ValueError(f"{name}: {error}") from error

    @classmethod
    def of_states(cls, states: Iterable[TrackerState]) -> SequenceEstimate:
        """What a tracker has said of its frames, to be tabulated, saved, drawn, or written as FicTrac's path. The spin is that of the last
        state.

        Without intrinsics each orientation is in the view frame of its own frame.
        """
        all_states = list(states)
        frames = [state.frame for state in all_states]
        poses = [frame.pose or None for frame in frames]
        posed = [pose for pose in poses if pose is not None]
        return cls(
            frames,
            all_states[-1].spin if all_states else Rejection("there are no frames"),
            sum(not pose.hinted for pose in posed),
            _column((4,), [pose and pose.quaternion_wxyz for pose in poses]),
            _column((3, 3), [pose and pose.covariance for pose in poses]),
            None,
            posed[0].frame if posed else "camera",
            np.array([state.time_s for state in all_states], np.float64),
        )

    def to_dataframe(self) -> pandas.DataFrame:
        """A row a frame, with the columns of ``spindoe estimate``'s CSV, but for ``residual_rad``, and the outline, whether
        a hint decided, and the reason of a rejection. Needs pandas.

        Orientations, centers and covariances are in the frame that ``camera_frame`` names; outlines are pixels. ``attrs`` has that
        frame as ``frame``, and as ``units`` the unit of each column that has one.
        """
        count = len(self.frames)
        found = FrameColumns(
            self.times_s,
            self.quaternions_wxyz,
            self.covariances_rad2,
            self.frame,
            self.positions_m,
            _column((3, 3), [f.position_covariance_m2 for f in self.frames]),
            np.array([f.circle or (np.nan,) * 3 for f in self.frames]).reshape(count, 3),
            {
                "dots": np.array([len(f.dots) for f in self.frames], dtype=np.int64),
                "matched": self.matched,
                "residual_rad": self.residuals_rad,
                "confidence": self.confidences,
            },
            self.view_turns_rad,
        )
        further: dict[str, Any] = {}
        if self.cameras is not None:
            further["cameras"] = self.cameras
        if self.chi2 is not None:
            further["chi2"] = self.chi2
        further["hinted"] = [bool(f.pose and f.pose.hinted) for f in self.frames]
        further["reason"] = ["" if f.pose else f.pose.reason for f in self.frames]
        return frame_table(found, further)

    def fictrac(
        self, *, c2a_r: tuple[float, float, float] | None = None, max_bad_frames: int | None = None
    ) -> FicTracPath:
        """The fictive path of an animal that walks on the ball, in FicTrac's columns; see `spindoe.fictrac`.

        Raises:
            ValueError: Where the frames have no times.
        """
        return fictrac_of(self, c2a_r, max_bad_frames)

    def plot(self, ax: matplotlib.axes.Axes | None = None, **style: Any) -> matplotlib.axes.Axes:
        """Draws the rotation about the spin's axis over time with the fit; see `spindoe.plot.sequence`."""
        from . import plot

        return plot.sequence(self, ax, **style)

    def _repr_html_(self) -> str:
        return _html.sequence(self)

    def __repr__(self) -> str:
        posed = sum(bool(frame.pose) for frame in self.frames)
        return f"<SequenceEstimate: {posed} of {len(self.frames)} frames, {self.spin!r}>"


def verdict_of(found: Any) -> Verdict | None:
    """The library's verdict, or that of a file."""
    if found is None:
        return None
    answer, table, ln_odds, hypotheses = found
    return Verdict(answer, table, ln_odds, tuple(Hypothesis(*one) for one in hypotheses))


def sequence_of(
    found: list[Any], independently: int, rows: tuple[Any, ...], spin: Any, times_s: Floats | None, verdict: Verdict | None = None
) -> SequenceEstimate:
    """What the library found: frames, how many of them alone, the rows of its file, and the spin where there are times."""
    quaternions, covariances, turns, frame = rows
    answer = Rejection("there are no times, or only one") if spin is None else spin_of(spin)
    return SequenceEstimate(
        [frame_of(f) for f in found], answer, independently, quaternions, covariances, turns, frame, times_s, verdict=verdict
    )


def _column(shape: tuple[int, ...], rows: list[Any]) -> Floats:
    """A row a frame, NaN where there is none."""
    blank = np.full(shape, np.nan)
    filled = [blank if row is None else row for row in rows]
    return np.array(filled, np.float64).reshape(len(rows), *shape)


@dataclass(frozen=True, slots=True)
class FrameColumns:
    """What frames have in common of which a table is made: a row a frame, NaN where one lacks it."""

    times_s: Floats | None
    quaternions_wxyz: Floats
    covariances_rad2: Floats
    frame: Frame
    positions_m: Floats
    position_covariances_m2: Floats
    circles: Floats
    dots: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    """What is known of the dots, by the column's name."""
    view_turns_rad: Floats | None = None


def frame_table(found: FrameColumns, further: Mapping[str, Any]) -> pandas.DataFrame:
    """A table, with the frame and the units of its columns; `further` columns come last."""
    library = optional("pandas", "pandas")
    count = len(found.quaternions_wxyz)
    posed = ~np.isnan(found.quaternions_wxyz[:, 0])
    columns: dict[str, Any] = {
        "time_s": np.full(count, np.nan) if found.times_s is None else found.times_s,
        **{f"q{axis}": found.quaternions_wxyz[:, k] for k, axis in enumerate("wxyz")},
        **found.dots,
        "camera_frame": [found.frame if has_pose else "" for has_pose in posed],
    }
    for i, j in zip(*np.triu_indices(3), strict=True):
        columns[f"cov_{'xyz'[i]}{'xyz'[j]}"] = found.covariances_rad2[:, i, j]
    if found.frame in ("camera", "optical"):
        columns |= {f"{axis}_m": found.positions_m[:, k] for k, axis in enumerate("xyz")}
        for i, j in zip(*np.triu_indices(3), strict=True):
            columns[f"cov_m2_{'xyz'[i]}{'xyz'[j]}"] = found.position_covariances_m2[:, i, j]
    if found.view_turns_rad is not None:
        names = [f"{vector}_{axis}" for vector in ("turn", "sd1", "sd2", "sd3") for axis in "xyz"]
        columns |= {name: found.view_turns_rad[:, k] for k, name in enumerate(names)}
    columns |= {name: found.circles[:, k] for k, name in enumerate(("u_px", "v_px", "radius_px"))}
    columns |= further
    table: pandas.DataFrame = library.DataFrame(columns, index=library.RangeIndex(count, name="frame"))
    table.attrs = {"frame": found.frame, "units": {name: unit for name in columns if (unit := _unit(name))}}
    return table


def _unit(column: str) -> str | None:
    """The unit of a column of a table of frames, by its name."""
    if column.startswith("cov_m2_"):
        return "m^2"
    if column.startswith("cov_"):
        return "rad^2"
    if column.startswith("turn_"):
        return "rad"
    ends = {"_s": "s", "_rad": "rad", "_m": "m", "_px": "px"}
    return next((unit for end, unit in ends.items() if column.endswith(end)), None)


# The arrays of a free motion over time, and what each has for a time.
_CURVE_SHAPES = {"times_s": (), "spins_rad_s": (3,), "covariances": (3, 3), "quaternions_wxyz": (4,)}
# The fields of a frame that say where the ball is. Numbers of a pose and of a spin that are single, by their fields' names.
_PLACES = {"position_m": (3,), "position_covariance_m2": (3, 3), "position_rotation_covariance_m_rad": (3, 3)}
_POSE_NUMBERS = ("dots_confidence", "confidence", "residual_rad", "residual_px", "hinted")
_SPIN_SCALARS = ("time_s", "sigma_rad", "log_likelihood", "inliers", "frame", "model", "decay_per_s", "lack_of_fit")


def _arrays(found: SequenceEstimate) -> dict[str, NDArray[Any]]:
    """A file's arrays."""
    frames = found.frames
    poses = [frame.pose or None for frame in frames]

    def stack(shape: tuple[int, ...], rows: list[Any], dtype: type = np.float64) -> NDArray[Any]:
        return np.concatenate([np.zeros((0, *shape), dtype), *rows])

    spin: dict[str, Any]
    arrays: dict[str, NDArray[Any] | None] = {
        "times_s": found.times_s,
        "quaternions_wxyz": found.quaternions_wxyz,
        "covariances_rad2": found.covariances_rad2,
        "view_turns_rad": found.view_turns_rad,
        "cameras": found.cameras,
        "chi2": found.chi2,
        "circles": _column((3,), [frame.circle for frame in frames]),
        "seconds": _column((3,), [frame.seconds for frame in frames]),
        **{name: _column(shape, [getattr(frame, name) for frame in frames]) for name, shape in _PLACES.items()},
        "dot_offsets": np.cumsum([0, *(len(frame.dots) for frame in frames)]),
        "dots": stack((3,), [frame.dots for frame in frames]),
        "dot_covariances_px2": stack((2, 2), [frame.dot_covariances for frame in frames]),
        "assignment": stack((), [frame.assignment for frame in frames], np.int64),
        "pose_quaternions_wxyz": _column((4,), [pose and pose.quaternion_wxyz for pose in poses]),
        "pose_covariances_rad2": _column((3, 3), [pose and pose.covariance for pose in poses]),
        "pose_distances": _column((2,), [pose and pose.distance for pose in poses]),
        **{
            f"pose_{name}": _column((), [pose and getattr(pose, name) for pose in poses])
            for name in _POSE_NUMBERS
        },
    }
    if found.spin:
        arrays |= {
            "spin_rad_s": found.spin.spin_rad_s,
            "spin_quaternion_wxyz": found.spin.quaternion_wxyz,
            "spin_covariance": found.spin.covariance,
            "spin_inlier_probabilities": found.spin.inlier_probabilities,
            "spin_body_rate_rad_s": found.spin.body_rate_rad_s,
            "alias_spins_rad_s": stack((3,), [[alias.spin_rad_s] for alias in found.spin.aliases]),
            "alias_log_likelihood_ratios": np.array([a.log_likelihood_ratio for a in found.spin.aliases]),
        }
        curve = found.spin.curve
        if curve is not None:
            arrays |= {f"curve_{name}": getattr(curve, name) for name in _CURVE_SHAPES}
            arrays["curve_spread_rad_s"] = np.array(curve.spread_rad_s)
        spin = {name: getattr(found.spin, name) for name in _SPIN_SCALARS} | {"clock": list(found.spin.clock)}
    else:
        spin = {"reason": found.spin.reason}
    meta = {
        "sequence_format_version": FORMAT_VERSION,
        "spindoe": __version__,
        "independent": found.independent,
        "frame": found.frame,
        "notes": list(found.notes),
        "verdict": None if found.verdict is None else _verdict(found.verdict),
        "pose_frames": [pose and pose.frame for pose in poses],
        "reasons": [None if frame.pose else frame.pose.reason for frame in frames],
        "spin": spin,
    }
    given = {name: array for name, array in arrays.items() if array is not None}
    return {**given, "meta": np.frombuffer(json.dumps(meta).encode(), dtype=np.uint8)}


def _verdict(found: Verdict) -> list[Any]:
    """As `verdict_of` reads it."""
    return [found.answer, found.table, found.ln_odds, [list(astuple(one)) for one in found.hypotheses]]


def _sequence(arrays: Mapping[str, NDArray[Any]], meta: Mapping[str, Any]) -> SequenceEstimate:
    """The sequence of a file's arrays."""

    def get(name: str, *shape: int, dtype: type = np.float64) -> NDArray[Any]:
        array = arrays[name]
        if array.shape != shape or array.dtype != dtype:
            raise ValueError(f"{name}: expected shape {shape}, {dtype.__name__}, found {array.shape}, {array.dtype}")
        return array

    def optional(name: str, *shape: int) -> Floats | None:
        return get(name, *shape) if name in arrays else None

    def numbers(row: Floats) -> Any:
        return None if np.isnan(row).all() else tuple(row.tolist())

    count = len(meta["reasons"])
    circles, seconds = get("circles", count, 3), get("seconds", count, 3)
    offsets = get("dot_offsets", count + 1, dtype=np.int64)
    total = int(offsets[-1])
    if offsets[0] != 0 or np.any(np.diff(offsets) < 0):
        raise ValueError("dot_offsets: expected numbers that do not decrease, from 0 on")
    dots = get("dots", total, 3)
    dot_covariances = get("dot_covariances_px2", total, 2, 2)
    assignment = get("assignment", total, dtype=np.int64)
    quaternions = get("pose_quaternions_wxyz", count, 4)
    covariances = get("pose_covariances_rad2", count, 3, 3)
    distances = get("pose_distances", count, 2)
    singles = {name: get(f"pose_{name}", count) for name in _POSE_NUMBERS}
    # Earlier files have none.
    places = [optional(name, count, *shape) for name, shape in _PLACES.items()]

    def place(i: int) -> list[Floats | None]:
        return [None if rows is None or np.isnan(rows[i]).all() else rows[i] for rows in places]

    def pose(i: int) -> Pose | Rejection:
        if meta["reasons"][i] is not None:
            return Rejection(meta["reasons"][i])
        single = {name: column[i].item() for name, column in singles.items()}
        single["hinted"] = bool(single["hinted"])
        return Pose(
            quaternions[i], covariances[i], distance=numbers(distances[i]), frame=meta["pose_frames"][i], **single
        )

    frames = [
        FrameEstimate(
            numbers(circles[i]), dots[a:b], dot_covariances[a:b], assignment[a:b], pose(i), tuple(seconds[i].tolist()),
            *place(i),
        )
        for i, (a, b) in enumerate(zip(offsets, offsets[1:], strict=False))
    ]
    spin: Spin | Rejection
    if "reason" in meta["spin"]:
        spin = Rejection(meta["spin"]["reason"])
    else:
        curve: SpinCurve | None = None
        if "curve_times_s" in arrays:
            knots = len(arrays["curve_times_s"])
            columns = {name: get(f"curve_{name}", knots, *shape) for name, shape in _CURVE_SHAPES.items()}
            curve = SpinCurve(**columns, spread_rad_s=get("curve_spread_rad_s").item())
        ratios = arrays["alias_log_likelihood_ratios"]
        aliases = zip(get("alias_spins_rad_s", len(ratios), 3), ratios.tolist(), strict=True)
        spin = Spin(
            spin_rad_s=get("spin_rad_s", 3),
            quaternion_wxyz=get("spin_quaternion_wxyz", 4),
            covariance=optional("spin_covariance", 3, 3),
            inlier_probabilities=arrays["spin_inlier_probabilities"],
            body_rate_rad_s=get("spin_body_rate_rad_s", 3),
            aliases=tuple(Alias(vector, ratio) for vector, ratio in aliases),
            clock=tuple(meta["spin"].get("clock", ())),
            curve=curve,
            **{name: meta["spin"][name] for name in _SPIN_SCALARS},
        )
    return SequenceEstimate(
        frames,
        spin,
        meta["independent"],
        get("quaternions_wxyz", count, 4),
        get("covariances_rad2", count, 3, 3),
        optional("view_turns_rad", count, 12),
        meta["frame"],
        optional("times_s", count),
        cameras=get("cameras", count, dtype=np.int64) if "cameras" in arrays else None,
        chi2=optional("chi2", count),
        notes=tuple(meta.get("notes", ())),
        verdict=verdict_of(meta.get("verdict")),
    )
