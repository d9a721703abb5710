"""The examples run, and say what they should."""

from __future__ import annotations

import subprocess
import sys

import matplotlib.image
import pytest
from conftest import ROOT

EXAMPLES = ROOT / "python/examples"
TABLE = ROOT / "designs/dots20/table.npz"


def run(name: str, *arguments: object) -> str:
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / name), *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        env={"MPLBACKEND": "Agg", "PATH": "", **_python_path()},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def _python_path() -> dict[str, str]:
    import os

    return {k: v for k, v in os.environ.items() if k in ("PYTHONPATH", "HOME", "RAYON_NUM_THREADS")}


def test_tutorial_1_design_your_pattern(tmp_path):
    plot = tmp_path / "ball.png"
    said = run(
        "design_pattern.py", tmp_path / "d", "--dots", 12, "--starts", 2, "--samples", 100, "--plot", plot
    )
    assert "12 dots" in said and "half A" in said
    assert (tmp_path / "d/stencil-of-my-ball/stencil.3mf").exists()
    assert matplotlib.image.imread(plot).std() > 0.01


def test_tutorial_2_identify_dots(tmp_path):
    plot = tmp_path / "dots.png"
    said = run("identify_dots.py", TABLE, "--plot", plot)
    lines = dict(line.split(":", 1) for line in said.splitlines() if ":" in line)
    assert lines["dots"].split() == lines["in truth"].split()
    assert "1000 of 1000 frames" in said and matplotlib.image.imread(plot).std() > 0.01


def test_tutorial_3_from_a_clip_to_a_spin(tmp_path):
    plot = tmp_path / "spin.png"
    said = run("clip_to_spin.py", TABLE, "--plot", plot)
    found = float(next(line for line in said.splitlines() if "+-" in line and "about" in line).split()[0])
    assert found == pytest.approx(30.20, abs=0.5)
    assert matplotlib.image.imread(plot).std() > 0.01


def test_the_readme_reads_a_clip(tmp_path):
    """Its lines run in a folder with the sample, and print the spin that stands beside them."""
    block = (ROOT / "README.md").read_text().split("```python\n")[1].split("```")[0]
    for arguments in (["-m", "spindoe", "synth"], ["-c", block]):
        done = subprocess.run(
            [sys.executable, *arguments], capture_output=True, text=True, check=False, cwd=tmp_path, env=_python_path()
        )
        assert done.returncode == 0, done.stderr
    shown = block.splitlines()[-1].split("#")[1].strip()
    assert shown in done.stdout


def test_a_clip_is_played():
    said = run("play_clip.py", TABLE, "--frames", 40, "--fps", 100)
    assert "latency p50" in said and "40 frames of" in said


def test_the_benchmark_of_the_drop_in():
    said = run("benchmark_compat.py", ROOT / "designs/dots20/pattern.csv", "--samples", 40)
    rates = [float(line.split("compat: ")[1].split(" %")[0]) for line in said.splitlines()[1:]]
    assert len(rates) == 5 and rates[0] > 95 and rates[0] >= rates[-1]
