"""Searching for patterns, and validating them by Monte Carlo."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass, fields
from typing import Any, Literal

from . import _native
from ._common import Progress, progress_of, settings_json
from ._pattern import HashTable, KeepOut, PathLike, Pattern, Tabled, as_table
from ._recognize import ProtocolName, RecognizerName, check_recognizer


@dataclass(frozen=True, slots=True)
class Proportion:
    """A rate with its Wilson 95 % interval."""

    successes: int
    trials: int
    rate: float
    low: float
    high: float

    def __str__(self) -> str:
        percent = [100.0 * x for x in (self.rate, self.low, self.high)]
        return "{:.2f} % [{:.2f}, {:.2f}]".format(*percent)


@dataclass(frozen=True, slots=True)
class Validation:
    """How often a pattern is identified correctly."""

    recognizer: str
    protocol: str
    samples: int
    sigma_deg: float
    """The noise, degrees."""
    seed: int
    answered: Proportion
    """The orientation is within 20 degrees, of all views: one with too few dots is a failure."""
    skipped: int
    """Views with too few dots to be identified; not among the trials of the next two."""
    identity: Proportion
    """Every dot has its own index, every false dot none."""
    orientation: Proportion
    """The orientation is within 20 degrees."""
    mean_error_deg: float | None
    """Of the right orientations; None without any."""
    median_error_deg: float | None
    us_per_identification: float | None = None
    median_us_per_identification: float | None = None

    @classmethod
    def _of(cls, report: dict[str, Any]) -> Validation:
        rates = {name: Proportion(**report[name]) for name in ("answered", "identity", "orientation")}
        return cls(**{**report, **rates})


def validate(
    table: Tabled,
    protocol: ProtocolName = "paper",
    *,
    recognizer: RecognizerName = "robust",
    samples: int = 10_000,
    seed: int = 0,
    sigma_rad: float | None = None,
    progress: bool | Progress = False,
) -> Validation:
    """Measures how often a pattern is identified correctly; the numbers are those of `spindoe validate`.

    Args:
        table: The table, a pattern, or the path of either.
        protocol: How views are made.
        recognizer: Which recognizer is tried.
        samples: Number of trials.
        seed: The same seed gives the same trials.
        sigma_rad: Noise instead of the protocol's, radians.
        progress: True shows a bar (with `tqdm`); a function is called with (done, total).
    """
    check_recognizer(recognizer)
    show, bar = progress_of(progress, samples, "trial")
    try:
        native = as_table(table)._handle
        report = _native.validate(native, protocol, recognizer, samples, seed, sigma_rad, show)
    finally:
        if bar is not None:
            bar.close()
    return Validation._of(json.loads(report))


@dataclass(frozen=True, slots=True)
class DesignProgress:
    """What a search has done so far."""

    stage: str
    """``scout``, ``climb``, ``try``, ``halve``, or ``finish``."""
    rounds: int
    """Rounds completed."""
    elapsed_s: float
    best: Pattern | None
    """The best pattern so far; None in the first round."""
    step: str
    """What is done, in the stage ``finish``."""


@dataclass(slots=True, eq=False, repr=False)
class DesignResult:
    """A design: its files lie in the folder."""

    dir: str
    table: HashTable
    report: dict[str, Any]
    """What ``report.json`` holds."""

    @property
    def pattern(self) -> Pattern:
        """The pattern."""
        return self.table.pattern

    @property
    def validation(self) -> list[Validation]:
        """The rates on trials that the search never used: of the default recognizer on every protocol, of the
        paper's on the paper's views, and on all where the search is for it."""
        return [Validation._of(found) for found in self.report["validation"]]

    def __repr__(self) -> str:
        return f"<DesignResult {self.pattern!r} in {self.dir}>"


ObjectiveName = Literal["mean-nn", "whitened-nn", "failure-rate"]
DesignViews = Literal["mixed", "paper", "sparse", "clutter", "image"]


@dataclass(frozen=True, slots=True)
class Design:
    """A search for a pattern: what ``spindoe design`` does, with its defaults. What is None follows from the
    rest.

    Raises:
        ValueError: For a value outside its domain, and dots so large that they do not fit.
    """

    out: PathLike
    """The folder for pattern, table, stencil and report."""
    _: KW_ONLY
    pattern: Tabled | None = None
    """A pattern to improve instead of starting at random; with `add`, the dots that are on the ball already."""
    add: int = 0
    """Dots to add to those of `pattern`, which stay exactly where they are."""
    dots: int | None = None
    """Number of dots, 4 to 64; None: those of `pattern`, else 20."""
    seed: int = 0
    """Seed of the random starts; the seeds of all trials are derived from it."""
    starts: int = 8
    """Random starts per round."""
    rounds: int = 1
    """Rounds."""
    scout_steps: int = 20
    """Descent steps from every start."""
    climb_steps: int = 60
    """Further descent steps of the best quarter of the starts."""
    samples: int = 10_000
    """Monte Carlo trials per candidate, again for each protocol of the winner's evaluation, and a fifth of it
    for each point of the sensitivity sweeps."""
    protocol: DesignViews = "mixed"
    """The views to optimize for; mixed is sparse, image and clutter in equal parts."""
    recognizer: RecognizerName = "robust"
    """The recognizer that candidates are tried with."""
    descent: Literal["program", "lbfgs", "gradient"] = "program"
    """How a descent finds its steps: by sequential convex programming, limited-memory BFGS, or steepest descent over
    spherical coordinates as in the SpinDOE paper."""
    ball_px: float = 60.0
    """Diameter of the ball in the image, pixels; sets the noise of the protocol ``image``."""
    pixel_noise: float = 1.0
    """Error of a detected dot per image axis, pixels; sets the noise of the protocol ``image``."""
    blur: float = 0.0
    """Length of the motion blur at the ball, pixels; an eighth of it counts as further error per axis."""
    objective: ObjectiveName | None = None
    """What a descent minimizes; None: ``failure-rate``, for more than 24 dots ``whitened-nn``."""
    bound_weight: float = 10.0
    """Weight of the orientation bound's worst direction beside the objective."""
    bound_goal: tuple[float, float] | None = None
    """Orientation bound, mean and worst over the directions in units of a dot's noise, that is preferred;
    None: from 20 dots on that of the published SpinDOE pattern; ``(1e9, 1e9)`` prefers none."""
    basis_weight: float = 0.0
    """Weight of the pairs' quality as bases, for the paper's recognizer."""
    min_separation_rad: float | None = None
    """Minimum angle between two dots, radians; None: the separation that the stencil's holes need, at least
    18 degrees."""
    min_visible: int | None = None
    """Minimum number of visible dots from any direction; None: 3 in 10 of them."""
    seam_margin_rad: float | None = None
    """Minimum angle between a dot and the stencil's seam, radians, 0 sets no limit; None: 10 degrees, less
    for more than 24 dots."""
    keep_out: Sequence[KeepOut] = ()
    """Cones without dots; none: those of `pattern`."""
    ball_diameter_mm: float = 40.0
    """Diameter of the ball that the stencil fits, millimeters."""
    dot_diameter_mm: float | None = None
    """Diameter of a dot, which is that of the stencil's holes at the ball, millimeters; None: a tenth of the
    ball."""
    pictures: Sequence[Literal["png", "svg"]] = ()
    """Formats in which the ball, its features, its rates and the search are drawn too."""

    def __post_init__(self) -> None:
        # A value outside its domain is reported here, not once the search begins. Files of before have another name.
        check_recognizer(self.recognizer)
        self._job(self.out)

    def _job(self, folder: PathLike, *, is_unlimited: bool = False) -> _native.DesignJob:
        pattern = None if self.pattern is None else as_table(self.pattern).pattern._handle
        settings = self._settings()
        return _native.DesignJob(folder, pattern, settings, list(self.pictures), is_unlimited)

    def _settings(self) -> str:
        """The fields by the library's names, as JSON."""
        given: dict[str, Any] = {
            field.name: getattr(self, field.name)
            for field in fields(self)
            if field.name not in ("out", "pattern", "pictures")
        }
        given["keep_out"] = [KeepOut(*zone)._asdict() for zone in self.keep_out]
        if self.bound_goal is not None:
            given["bound_goal"] = dict(zip(("mean", "worst"), self.bound_goal, strict=True))
        return settings_json(given)

    def run(
        self,
        callback: Callable[[DesignProgress], object] | None = None,
        *,
        resume: bool = False,
        budget_s: float | None = None,
    ) -> DesignResult:
        """Searches, evaluates and writes everything. Ctrl-C raises at once. The folder keeps the last
        checkpoint, from which `resume` continues once the present step has ended: until then it is locked.

        Args:
            callback: Called with the progress, on another thread; what it raises ends the search.
            resume: Continue the search saved in the folder.
            budget_s: Begin rounds until this time is spent, seconds, instead of `rounds`.
        """
        if budget_s is not None and not budget_s > 0.0:
            raise ValueError(f"budget_s: expected a positive number, found {budget_s}")
        job = self._job(self.out, is_unlimited=budget_s is not None)
        table, report = job.run(_progress_callback(callback), resume, budget_s)
        return DesignResult(os.fspath(self.out), HashTable._of(table), json.loads(report))

    def run_shard(
        self,
        index: int,
        count: int,
        callback: Callable[[DesignProgress], object] | None = None,
    ) -> str:
        """Searches one of `count` shards, from where it was left if it has begun; returns its folder,
        ``shards/INDEX`` within `out`. `merge` makes a design of all of them.

        Args:
            index: The shard's number, from 1.
            count: The number of shards.
            callback: As in `run`.
        """
        folder = os.path.join(os.fspath(self.out), "shards", str(index))
        begun = os.path.exists(os.path.join(folder, "search.json"))
        self._job(folder).run_shard(index, count, _progress_callback(callback), begun)
        return folder


def merge(
    shards: Sequence[PathLike],
    out: PathLike,
    callback: Callable[[DesignProgress], object] | None = None,
    *,
    resume: bool = False,
) -> DesignResult:
    """Merges the finished shards of one search: their finalists meet on trials that no shard has drawn.

    Args:
        shards: The folders of all shards, in any order.
        out: The folder for pattern, table, stencil, plots and report.
        callback: As in `Design.run`.
        resume: Continue a merge of these shards that was interrupted; begin one where none has begun.

    Raises:
        ValueError: Where a shard is missing, twice there, not finished, or of another search.
    """
    table, report = _native.merge(list(shards), out, resume, _progress_callback(callback))
    return DesignResult(os.fspath(out), HashTable._of(table), json.loads(report))


def _progress_callback(
    callback: Callable[[DesignProgress], object] | None,
) -> Callable[[str], object] | None:
    """What the native part calls."""
    if callback is None:
        return None

    def report(event: str) -> None:
        state = json.loads(event)
        best = state.get("best")
        callback(
            DesignProgress(
                state["stage"],
                state.get("rounds", 0),
                state.get("elapsed_s", 0.0),
                None if best is None else Pattern(best["dots"]),
                state.get("step", ""),
            )
        )

    return report


def design_of_flags(out: PathLike, flags: Sequence[str]) -> Design:
    """The design that flags of ``spindoe design`` ask for.

    Raises:
        ValueError: For a flag that does not exist, is outside its domain, or says where and when to search.
    """
    native, settings = _native.design_request(list(flags))
    given = json.loads(settings)
    goal = given["bound_goal"]
    given["bound_goal"] = None if goal is None else (goal["mean"], goal["worst"])
    given["keep_out"] = tuple(
        KeepOut(tuple(zone["axis"]), zone["half_angle_rad"]) for zone in given["keep_out"]
    )
    return Design(out, pattern=None if native is None else Pattern._of(native), **given)
