"""What the tests share: the shipped design, and the published data where it is there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Generator
from pathlib import Path

import numpy as np
import pytest

import spindoe

ROOT = Path(__file__).resolve().parents[2]


def _published() -> Path | None:
    """The published data set, in a folder `shared` above the repository."""
    for above in [ROOT, *ROOT.parents]:
        found = above / "shared/data/spindoe2023"
        if found.is_dir():
            return found
    return None


@pytest.fixture(scope="session")
def root() -> Path:
    return ROOT


@pytest.fixture(scope="session")
def table() -> spindoe.HashTable:
    return spindoe.HashTable.load(ROOT / "designs/dots20/table.npz")


@pytest.fixture(scope="session")
def pattern(table: spindoe.HashTable) -> spindoe.Pattern:
    return table.pattern


@pytest.fixture(scope="session")
def recognizer(table: spindoe.HashTable) -> spindoe.Recognizer:
    return spindoe.Recognizer(table)


@pytest.fixture(scope="session")
def estimator(table: spindoe.HashTable) -> spindoe.Estimator:
    return spindoe.Estimator(table)


@pytest.fixture(scope="session")
def view(pattern: spindoe.Pattern) -> np.ndarray:
    """The dots with z > 0.2, in the pattern's own orientation, without noise."""
    return np.array(pattern.dots[pattern.dots[:, 2] > 0.2])


@pytest.fixture(scope="session")
def published() -> Path:
    found = _published()
    if found is None:
        pytest.skip("the published data set is not there")
    return found


@pytest.fixture(scope="session")
def command() -> list[str]:
    """The command to compare with: that of the environment variable SPINDOE, or the wheel's own."""
    given = os.environ.get("SPINDOE")
    if given and not shutil.which(given):
        raise RuntimeError(f"SPINDOE: no such command: {given}")
    return [given] if given else [sys.executable, "-m", "spindoe"]


def run(command: list[str], *arguments: object) -> str:
    done = subprocess.run(
        [*command, *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


# Skips that are stated and accepted: data of others, which no clone has, and what is too large to be fetched.
ACCEPTED = ("the published data set is not there", "PyTorch is not here")


def _fails(report: pytest.TestReport | pytest.CollectReport) -> bool:
    """Whether a skip fails, since everything is required."""
    is_accepted = any(words in str(report.longrepr) for words in ACCEPTED)
    return report.skipped and "SPINDOE_REQUIRE_ALL" in os.environ and not is_accepted


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A test that is skipped fails where all are required."""
    report = yield
    if _fails(report):
        report.outcome = "failed"
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """So does a module that is skipped."""
    report = yield
    if _fails(report):
        report.outcome = "failed"
    return report
