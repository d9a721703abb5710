"""Patterns, tables, stencils."""

from __future__ import annotations

import json
import pickle
import shutil

import numpy as np
import pytest
import trimesh
from conftest import ROOT

import spindoe


def test_a_pattern_keeps_its_bits(pattern, tmp_path):
    path = tmp_path / "pattern.csv"
    pattern.save(path)
    again = spindoe.Pattern.load(path)
    assert np.array_equal(again.dots, pattern.dots)
    assert again == pattern and hash(again) == hash(pattern)
    assert pickle.loads(pickle.dumps(pattern)) == pattern
    assert again.sha256 == pattern.sha256



def test_the_summary_is_what_numpy_computes(pattern):
    cosines = pattern.dots @ pattern.dots.T - 3.0 * np.eye(len(pattern))
    nearest = np.arccos(cosines.max(axis=1))
    summary = pattern.summary()
    assert summary.min_separation_rad == pytest.approx(nearest.min(), abs=1e-9)
    assert summary.mean_nearest_separation_rad == pytest.approx(nearest.mean(), abs=1e-9)


@pytest.mark.parametrize(
    ("dots", "words"),
    [
        (np.eye(3), "4 to 64"),
        (np.ones((5, 2)), "shape"),
        (np.ones((4, 3)), "dot 0"),
        (np.full((4, 3), np.nan), "finite"),
        ([["a", "b", "c"]] * 4, "real numbers"),
        (np.ones((4, 3), dtype=complex), "real numbers"),
    ],
)
def test_bad_dots_are_named(dots, words):
    with pytest.raises(ValueError, match=words):
        spindoe.Pattern(dots)


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(FileNotFoundError, match="cannot be read"):
        spindoe.Pattern.load(tmp_path / "none.csv")
    with pytest.raises(FileNotFoundError):
        spindoe.HashTable.load(tmp_path / "none.npz")
    (tmp_path / "bad.csv").write_text("1,2\n")
    with pytest.raises(ValueError, match="line 1"):
        spindoe.Pattern.load(tmp_path / "bad.csv")


def test_features_follow_from_the_dots(table):
    dots = table.pattern.dots
    first, second = table.bases.T
    columns = [dots[first], dots[second], np.cross(dots[first], dots[second])]
    bases = np.stack(columns, axis=2)
    rebuilt = np.einsum("mij,mj->mi", bases, table.features)
    assert np.abs(rebuilt - dots[table.feature_dots]).max() < 1e-9


def test_a_table_keeps_its_bytes(table, root, tmp_path):
    table.save(tmp_path / "table.npz")
    with np.load(tmp_path / "table.npz") as arrays:
        assert np.array_equal(arrays["features"], table.features)
    again = pickle.loads(pickle.dumps(table))
    assert again.to_bytes() == table.to_bytes()
    assert again.meta == table.meta
    rebuilt = spindoe.HashTable.build(table.pattern)
    assert np.array_equal(rebuilt.features, table.features)


def test_a_damaged_table_is_refused(table):
    with pytest.raises(ValueError):
        spindoe.HashTable.from_bytes(table.to_bytes()[:-100])
    with pytest.raises(ValueError, match="kappa"):
        spindoe.HashTable.build(table.pattern, kappa=-1.0)
    with pytest.raises(ValueError, match="no such setting"):
        spindoe.HashTable.build(table.pattern, kapa=1.0)


def test_a_ball_knows_what_its_design_knows(table, pattern, root, tmp_path):
    design = table.design
    assert (design.ball_diameter_mm, design.dot_diameter_mm) == (40.0, 4.0)
    assert spindoe.HashTable.load(root / "designs/dots20/pattern.csv").design == design
    assert spindoe.HashTable.load(root / "designs/dots20").design == design
    assert spindoe.HashTable.load("dots20").design == design
    assert pickle.loads(pickle.dumps(table)).design == design
    # Dots alone know nothing.
    assert spindoe.HashTable.build(pattern).design is None


def test_what_a_design_knows_travels(root, pattern, tmp_path):
    shutil.copy(root / "designs/dots20/pattern.csv", tmp_path)
    record = json.loads((root / "designs/dots20/pattern.ball.json").read_text())
    camera = {"ball_px": 45.0}
    record["design"] = {
        "ball_diameter_mm": 52.0, "dot_diameter_mm": 3.9, "camera": camera, "criterion": "the camera",
    }
    (tmp_path / "pattern.ball.json").write_text(json.dumps(record))
    ball = spindoe.HashTable.load(tmp_path)
    assert ball.design == spindoe.DesignRecord(52.0, 3.9, camera, "the camera")

    def sizes(stencil):
        parameters = stencil.description["parameters"]
        return parameters["ball_diameter_mm"], parameters["hole_diameter_mm"]

    assert sizes(spindoe.Stencil(tmp_path)) == (52.0, 3.9)
    assert sizes(spindoe.Stencil(ball, ball_diameter_mm=104.0)) == (104.0, 7.8)
    assert sizes(spindoe.Stencil(ball, hole_diameter_mm=4.5)) == (52.0, 4.5)
    # Without a design the dots are a tenth of the ball.
    assert sizes(spindoe.Stencil(pattern, ball_diameter_mm=60.0)) == (60.0, 6.0)
    _, truth = next(spindoe.synth(ball, 1, seed=3))
    # Drawn dots scatter by up to a tenth; 0.1 would be those of no design.
    drawn = np.mean([dot["radius_rad"] for dot in truth.everything["dots"]])
    assert drawn == pytest.approx(np.arcsin(0.075), rel=0.05)


def test_a_stencil_is_two_closed_bodies(pattern, tmp_path):
    stencil = spindoe.Stencil(pattern, ball_diameter_mm=40.3)
    for half in ("a", "b"):
        mesh = stencil.to_trimesh(half)
        assert mesh.is_watertight and mesh.body_count == 1
        assert mesh.volume == pytest.approx(stencil.description[f"half_{half}"]["check"]["volume_mm3"])
    stencil.save(tmp_path)
    assert trimesh.load(tmp_path / "half_a.stl").is_watertight
    with pytest.raises(ValueError, match="hole_diameter_mm|holes"):
        spindoe.Stencil(pattern, hole_diameter_mm=15.0)


def test_the_stencil_s_settings_are_those_of_the_library(pattern):
    with pytest.raises(ValueError, match="^none: no such setting") as caught:
        spindoe.Stencil(pattern, none=1)
    theirs = str(caught.value).split("expected one of ")[1].split(", ")
    assert set(spindoe.StencilSettings.__annotations__) == set(theirs)


def test_shipped_designs_are_those_of_the_repository():
    folders = sorted(path.name for path in (ROOT / "designs").iterdir() if path.is_dir())
    assert list(spindoe.Pattern.shipped_names()) == folders
    for name in folders:
        written = np.loadtxt(ROOT / "designs" / name / "pattern.csv", delimiter=",")
        assert np.array_equal(spindoe.Pattern.shipped(name).dots, written)
        assert spindoe.HashTable.load(name).pattern == spindoe.Pattern.shipped(name)
    with pytest.raises(ValueError, match="name: expected one of dots12, .*found 'dots21'"):
        spindoe.Pattern.shipped("dots21")
