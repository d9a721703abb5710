"""Searching for patterns, and validating them by Monte Carlo."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from . import _native
from ._common import Progress, progress_of
from ._pattern import HashTable, PathLike, Pattern, Tabled, as_table
from ._recognize import ProtocolName, RecognizerName


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
    skipped: int
    """Views with too few dots to be identified; not among the trials."""
    identity: Proportion
    """Every dot has its own index, every false dot none."""
    orientation: Proportion
    """The orientation is within 20 degrees."""
    mean_error_deg: float
    median_error_deg: float
    us_per_identification: float | None = None
    median_us_per_identification: float | None = None

    @classmethod
    def _of(cls, report: dict[str, Any]) -> Validation:
        rates = {name: Proportion(**report[name]) for name in ("identity", "orientation")}
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
        """The rates on trials that the search never used: every recognizer, every protocol."""
        return [Validation._of(found) for found in self.report["validation"]]

    def __repr__(self) -> str:
        return f"<DesignResult {self.pattern!r} in {self.dir}>"


class Design:
    """A search for a pattern: what ``spindoe design`` does, with its names, units and defaults.

    Args:
        out: The folder for pattern, table, stencil, plots and report.
        dots: Number of dots.
        seed: Seed of the random starts.
        flags: Any other setting of ``spindoe design --print-config``: ``starts=8``,
            ``min_separation_deg=20``, ``keep_out=["0,0,1,25"]``, ``objective="confusion"``; and ``pattern``, one to
            improve.

    Raises:
        ValueError: For a flag that does not exist or is outside its domain.
    """

    __slots__ = ("_flags", "out")
    out: PathLike

    def __init__(self, out: PathLike, *, dots: int = 20, seed: int = 0, **flags: Any) -> None:
        for taken in ("resume", "budget", "json", "shard", "shards", "config", "output"):
            if taken in flags:
                raise ValueError(f"{taken}: expected as an argument of run, or not at all")
        self.out = out
        given: dict[str, Any] = {"seed": seed, **flags, "output": os.fspath(out)}
        if "pattern" not in flags:
            given = {"dots": dots, **given}
        self._flags = _words(given)
        # Wrong flags are reported here, not once the search begins.
        _native.DesignJob(self._flags)

    def run(
        self,
        callback: Callable[[DesignProgress], object] | None = None,
        *,
        resume: bool = False,
        budget_s: float | None = None,
    ) -> DesignResult:
        """Searches, evaluates and writes everything. Ctrl-C ends it within one unit of work and leaves
        what was found in the folder, from which `resume` continues.

        Args:
            callback: Called with the progress, on another thread; what it raises ends the search.
            resume: Continue the search saved in the folder.
            budget_s: Begin rounds until this time is spent, seconds.
        """
        flags = list(self._flags) + (["--resume"] if resume else [])
        if budget_s is not None:
            if not budget_s > 0.0:
                raise ValueError(f"budget_s: expected a positive number, found {budget_s}")
            flags += ["--budget", f"{max(1, round(1000 * budget_s))}ms"]
        job = _native.DesignJob(flags)
        table, report = job.run(_progress_callback(callback), budget_s)
        return DesignResult(str(job.dir()), HashTable._of(table), json.loads(report))

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
        flags = [word for word in self._flags if not word.startswith("--output=")]
        flags += [f"--output={folder}", f"--shard={index}/{count}", *(["--resume"] if begun else [])]
        _native.DesignJob(flags).run_shard(_progress_callback(callback), None)
        return folder

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return _design, (self.out, self._flags)


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


def _design(out: PathLike, flags: list[str]) -> Design:
    """What unpickling calls."""
    design = Design.__new__(Design)
    design.out = out
    design._flags = flags
    return design


def _words(flags: dict[str, Any]) -> list[str]:
    """Settings as the command line has them."""
    words = []
    for name, value in flags.items():
        several = isinstance(value, Sequence) and not isinstance(value, str)
        for one in value if several else [value]:
            if one is None:
                continue
            text = str(one).lower() if isinstance(one, bool) else one
            # The folder is no setting: flags such as --resume ask for it.
            words.append(f"--output={text}" if name == "output" else f"--config={name}={text}")
    return words
