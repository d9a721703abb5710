"""The notebooks run from a fresh kernel, show what they say, and are kept without outputs."""

from __future__ import annotations

import re

import nbformat
import pytest
from conftest import ROOT
from nbclient import NotebookClient

FOLDER = ROOT / "python/notebooks"
NAMES = sorted(path.stem for path in FOLDER.glob("*.ipynb"))


def _run(name, folder) -> tuple[str, list[str]]:
    """What a notebook prints, and the kinds of all that it shows."""
    notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
    client = NotebookClient(
        notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": str(folder)}}
    )
    client.execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert all(output.get("name") != "stderr" for output in outputs), outputs
    said = "".join(output["text"] for output in outputs if output.output_type == "stream")
    return said, [kind for output in outputs for kind in output.get("data", ())]


def _numbers(words) -> list[float]:
    return [float(number) for number in re.findall(r"\d+\.\d+", words)]


@pytest.fixture
def execute(tmp_path, monkeypatch):
    # The kernel's own: figures as pictures in the notebook.
    monkeypatch.delenv("MPLBACKEND", raising=False)
    return lambda name: _run(name, tmp_path)


def test_there_are_four_without_outputs():
    assert NAMES == ["batch", "calibrate", "clip_to_spin", "live"]
    for name in NAMES:
        notebook = nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)
        nbformat.validate(notebook)
        cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
        assert all(not cell.outputs and cell.execution_count is None for cell in cells), name


def test_clip_to_spin(execute):
    said, shown = execute("clip_to_spin")
    found, std, truth = _numbers(said)
    assert abs(found - truth) < max(5.0 * std, 0.3) and std < 0.5
    assert shown.count("image/png") == 2 and shown.count("text/html") == 3


def test_live(execute):
    said, shown = execute("live")
    *_, found, std = _numbers(said)
    # The notebook's own spin, (20, 90, 40) rad/s.
    assert abs(found - 100.5 / 6.2832) < max(5.0 * std, 0.5)
    assert said.startswith("60 frames") and shown.count("image/png") == 2


def test_calibrate(execute):
    said, shown = execute("calibrate")
    designed, drawn = _numbers(said)
    assert drawn < 0.7 * designed and "image/png" in shown


def test_batch(execute, tmp_path):
    said, shown = execute("batch")
    assert abs(_numbers(said)[0] - 25.0) < 0.5 and "text/html" in shown
    assert not list(tmp_path.iterdir())
