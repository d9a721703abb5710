"""What a type checker sees of the package: right calls pass, wrong names and types do not."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import spindoe

PACKAGE = Path(spindoe.__file__).parent

# A line that ends in `# wrong` must be reported, all others must not.
CALLS = '''
import cv2
import numpy as np
from cv2.typing import MatLike
from PIL import Image

import spindoe
from spindoe_compat import DOE, SpinDOE

table = spindoe.HashTable.load("dots20")
read = cv2.imread("frame.png")
assert read is not None
frame: MatLike = read
spectrum = np.zeros((40, 40), np.complex128)
estimator = spindoe.Estimator(table, min_confidence=0.7, outline="edges", dot_probability=(0.5, 0.2))
estimator.estimate(frame, color="bgr")
estimator.estimate(np.zeros((40, 40), np.float32))
estimator.estimate(Image.open("frame.png"))
estimator.estimate_sequence(["a.png", "b.png"])
estimator.estimate_sequence([frame, frame], color="bgra")
estimator.tracker().update(frame, 0.0, color="gray")
estimator.estimate(None)  # wrong
estimator.estimate(b"frame")  # wrong
estimator.estimate(frame, color="hsv")  # wrong
estimator.estimate(spectrum)  # wrong
spindoe.Estimator(table, min_confidenc=0.7)  # wrong
spindoe.Estimator(table, min_confidence="high")  # wrong
spindoe.Estimator(table, outline="contour")  # wrong
spindoe.Recognizer(table, passes=32, noise="normal", expect="clutter")
spindoe.Recognizer(table, "voting", k=10, vote_sum="density")
spindoe.Recognizer(table, k=10)  # wrong
spindoe.Recognizer(table, "voting", passes=3)  # wrong
spindoe.Recognizer(table, noise="gauss")  # wrong
spindoe.synth(table, 3, ball_px=[60, 60], kind="fruit", stains=False)
spindoe.synth(table, 3, ball_pixels=[60, 60])  # wrong
spindoe.synth(table, 3, max_noise="none")  # wrong
spindoe.Pattern.shipped("dots20").dots
DOE(None, pattern=table, min_confidence=0.9)
SpinDOE(None).estimate([0.0], [frame])[3].dtype
DOE(None, min_confidenc=0.9)  # wrong
settings: spindoe.EstimatorSettings = {"max_blur": 0.5}
spindoe.Estimator(table, **settings)
'''


def test_mypy_sees_wrong_names_and_types(tmp_path):
    pytest.importorskip("mypy")
    pytest.importorskip("cv2")
    pytest.importorskip("PIL")
    calls = tmp_path / "calls.py"
    calls.write_text(CALLS)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "cache"), str(calls)],
        capture_output=True, text=True, check=False, cwd=tmp_path,
    )
    found = {int(line.split(":")[1]) for line in done.stdout.splitlines() if line.startswith("calls.py:")}
    expected = {i for i, line in enumerate(CALLS.splitlines(), 1) if line.endswith("# wrong")}
    assert found == expected, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("settings", "theirs"),
    [
        (spindoe.EstimatorSettings, lambda: set(spindoe.Estimator("dots20").settings) - {"camera"}),
        (spindoe.CircleSettings, lambda: set(spindoe.Estimator("dots20").settings["circle"])),
        (spindoe.RecognizerSettings, lambda: set(spindoe.Recognizer("dots20").settings)),
    ],
)
def test_typed_settings_are_those_of_the_library(settings, theirs):
    assert set(settings.__annotations__) == theirs()


def test_typed_settings_of_images_are_those_of_the_library():
    with pytest.raises(ValueError, match="no such setting") as refused:
        next(spindoe.synth("dots20", 1, none=0))
    known = str(refused.value).split("expected one of ")[1].split(", ")
    assert set(spindoe.SynthSettings.__annotations__) == set(known)


def imports(module: Path) -> tuple[set[str], set[str]]:
    """The modules of the package that a module imports: when it is loaded, and later, in functions. What is imported for
    types only is not run."""
    at_once, later = set(), set()

    def visit(node: ast.AST, into: set[str]) -> None:
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            return
        if isinstance(node, ast.ImportFrom) and node.level == 1:
            into.update([node.module] if node.module else [name.name for name in node.names])
        inner = later if isinstance(node, (ast.FunctionDef, ast.Lambda)) else into
        for child in ast.iter_child_nodes(node):
            visit(child, inner)

    visit(ast.parse(module.read_text()), at_once)
    return at_once, later


def cycle_of(graph: dict[str, set[str]]) -> list[str]:
    """A row of modules each of which imports the next, and the last the first; empty where there is none."""
    done: set[str] = set()

    def walk(name: str, path: list[str]) -> list[str]:
        if name in path:
            return path[path.index(name) :]
        if name in done or name not in graph:
            return []
        for other in sorted(graph[name]):
            if found := walk(other, [*path, name]):
                return found
        done.add(name)
        return []

    return next((found for name in sorted(graph) if (found := walk(name, []))), [])


@pytest.mark.parametrize("package", ["spindoe", "spindoe_ros"])
def test_imports_run_one_way(package):
    modules = {path.stem: imports(path) for path in PACKAGE.with_name(package).glob("*.py")}
    assert cycle_of({name: at_once for name, (at_once, _) in modules.items()}) == []
    # A method that draws loads what draws when it is called; nothing else is put off.
    assert set().union(*(later for _, later in modules.values())) <= {"plot"}


def test_a_cycle_would_be_found(tmp_path):
    (tmp_path / "a.py").write_text("from . import b\nif TYPE_CHECKING:\n    from .d import D\n")
    (tmp_path / "b.py").write_text("try:\n    from .c import C\nexcept ImportError:\n    pass\n")
    (tmp_path / "c.py").write_text("def f():\n    from .a import A\n")
    modules = {path.stem: imports(path) for path in tmp_path.glob("*.py")}
    assert modules == {"a": ({"b"}, set()), "b": ({"c"}, set()), "c": (set(), {"a"})}
    assert cycle_of({name: at_once | later for name, (at_once, later) in modules.items()}) == ["a", "b", "c"]
    assert cycle_of({"a": {"b"}, "b": {"c"}, "c": set()}) == []
