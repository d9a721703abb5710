"""The notices of third parties in the wheel are those of what it is built from."""

from __future__ import annotations

import importlib.metadata
import re
import shutil
import subprocess

import pytest
from conftest import ROOT

import spindoe

OURS = {("spindoe", spindoe.__version__), ("spindoe-python", spindoe.__version__)}
HOW = "make python/THIRD-PARTY.txt anew: see CONTRIBUTING.md"


@pytest.fixture(scope="module")
def named() -> set[tuple[str, str]]:
    """Crates and versions that the notices name."""
    text = (ROOT / "python/THIRD-PARTY.txt").read_text(encoding="utf-8")
    headings = re.findall(r"^={78}\n[^:\n]+: (.+)$", text, re.MULTILINE)
    crates = [crate.split(" ") for heading in headings for crate in heading.split(", ")]
    return {(name, version) for name, version in crates}


def test_every_crate_in_the_wheel_is_named(named):
    if shutil.which("cargo") is None:
        pytest.skip("cargo is not here: the notices are NOT compared with what the wheel is built from")
    words = ["cargo", "tree", "--locked", "--offline", "-p", "spindoe-python", "-e", "normal"]
    tree = subprocess.run(
        [*words, "--prefix", "none", "--format", "{p}"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )
    assert tree.returncode == 0, tree.stderr
    built_from = set(re.findall(r"^(\S+) v(\S+)", tree.stdout, re.MULTILINE))
    assert len(built_from) > 100
    assert not built_from - OURS - named, HOW


def test_no_other_crate_is_named(named):
    lock = (ROOT / "Cargo.lock").read_text(encoding="utf-8")
    locked = set(re.findall(r'^name = "(.+)"\nversion = "(.+)"$', lock, re.MULTILINE))
    assert OURS <= locked
    assert not named - locked, HOW


def test_they_go_with_the_wheel():
    files = importlib.metadata.files("spindoe") or []
    notices = [file for file in files if file.name == "THIRD-PARTY.txt"]
    assert len(notices) == 1
    assert notices[0].read_text(encoding="utf-8") == (ROOT / "python/THIRD-PARTY.txt").read_text(encoding="utf-8")
