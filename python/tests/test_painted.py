"""Painted balls: Python and the command give the same, and what is made of it."""

from __future__ import annotations

import csv
import json
import pickle

import numpy as np
import PIL.Image
import pytest
from conftest import ROOT, run

import spindoe

FRAMES, FPS, RPS = 24, 200, 5


@pytest.fixture(scope="module")
def clip(command, tmp_path_factory):
    """A folder with the clip, its images and times, and what the command makes of it."""
    folder = tmp_path_factory.mktemp("painted")
    turning = ("--frames", FRAMES, "--fps", FPS, "--rps", RPS, "--seed", 3)
    run(command, "synth", "--preset", ROOT / "studies/spin_regions/painted.json", "-o", folder / "clip", *turning)
    flags = ("--camera-distance-radii", 20, "--write-surface", folder / "ball.npz", "--json", "-o", folder / "found.csv")
    theirs = json.loads(run(command, "estimate", "--painted", folder / "clip/images", *flags))
    paths = sorted((folder / "clip/images").iterdir())
    images = [np.asarray(PIL.Image.open(path).convert("RGB")) for path in paths]
    times = [frame["time_s"] for frame in theirs["frames"]]
    return folder, images, times, theirs


@pytest.fixture(scope="module")
def estimator():
    return spindoe.PaintedEstimator(spindoe.Camera.at_distance(20.0))


@pytest.fixture(scope="module")
def found(clip, estimator):
    _, images, times, _ = clip
    return estimator.estimate_sequence(images, times, color="rgb")


def test_it_is_what_the_command_finds(clip, found):
    folder, _, times, theirs = clip
    posed = [frame.get("orientation_wxyz") for frame in theirs["frames"]]
    assert [reason is None for reason in found.reasons] == [one is not None for one in posed]
    assert sum(one is not None for one in posed) > FRAMES * 0.8
    for ours, one in zip(found.quaternions_wxyz, posed, strict=True):
        if one is not None:
            np.testing.assert_allclose(ours, one, atol=1e-9)
    agreements = [frame.get("agreement", np.nan) for frame in theirs["frames"]]
    np.testing.assert_allclose(found.agreements, agreements, atol=1e-9)
    assert found.frame == theirs["frame"] and found.answered and found.diameter_px == pytest.approx(78, abs=3)
    np.testing.assert_array_equal(found.times_s, times)
    assert found.spin
    assert np.linalg.norm(found.spin.spin_rad_s) / (2 * np.pi) == pytest.approx(theirs["spin"]["rps"], abs=1e-9)
    assert found.spin.model == theirs["spin"]["motion"]
    assert theirs["spin"]["rps"] == pytest.approx(RPS, rel=0.05)
    # Fitted anew it is the same.
    more = {"covariances_rad2": found.covariances_rad2, "residuals_rad": found.residuals_rad, "frame": found.frame,
            "view_turns_rad": found.view_turns_rad}
    again = spindoe.fit_spin(times, found.quaternions_wxyz, **more)
    np.testing.assert_allclose(again.spin_rad_s, found.spin.spin_rad_s, rtol=1e-9)
    np.testing.assert_allclose(again.covariance, found.spin.covariance, rtol=1e-6)
    surface = spindoe.Surface.load(folder / "ball.npz")
    np.testing.assert_array_equal(surface.chart(), found.surface.chart())
    assert surface.known == theirs["surface_known"]


def test_a_surface_places_frames_of_another_clip(clip, estimator, found, tmp_path):
    _, images, _, _ = clip
    found.surface.save(tmp_path / "again.npz")
    chart = found.surface.chart()
    assert chart.shape == (120, 240)
    assert np.isfinite(chart).mean() == pytest.approx(found.surface.known, abs=0.15)
    copied = pickle.loads(pickle.dumps(found.surface))
    np.testing.assert_array_equal(copied.chart(), chart)
    # In another order, without times: each by itself.
    order = [17, 3, 9, 12]
    for surface in (tmp_path / "again.npz", copied):
        placed = pickle.loads(pickle.dumps(estimator)).estimate_sequence([images[k] for k in order], surface=surface, color="rgb")
        assert placed.times_s is None and not placed.spin and "no times" in placed.spin.reason
        for ours, k in zip(placed.quaternions_wxyz, order, strict=True):
            if not np.isnan(ours[0]) and found.reasons[k] is None:
                angle = 2 * np.arccos(min(1.0, abs(ours @ found.quaternions_wxyz[k])))
                assert angle < np.radians(3)
        assert sum(reason is None for reason in placed.reasons) >= 3
    with pytest.raises(ValueError, match="times_s"):
        placed.fictrac()


def test_its_tables(command, clip, found, tmp_path):
    folder, _, _, _ = clip
    table = found.to_dataframe()
    assert table.attrs["frame"] == found.frame and table.attrs["units"]["cov_xx"] == "rad^2"
    with (folder / "found.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {name for name in rows[0] if name.startswith(("q", "cov_", "camera", "time", "turn_", "sd"))} <= set(table.columns)
    residuals = [float(row["residual_deg"] or "nan") for row in rows]
    np.testing.assert_allclose(np.deg2rad(residuals), table["residual_rad"], rtol=1e-3)
    np.testing.assert_allclose([float(row["qw"] or "nan") for row in rows], table["qw"], atol=1e-9)
    flags = ("--camera-distance-radii", 20, "--as", "fictrac", "-o", tmp_path / "theirs.dat")
    run(command, "estimate", "--painted", folder / "clip/images", *flags)
    found.fictrac().save(tmp_path / "ours.dat")
    ours, theirs = (np.genfromtxt(tmp_path / name, delimiter=",") for name in ("ours.dat", "theirs.dat"))
    np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_a_given_circle_and_bad_input(clip, estimator, found, tmp_path):
    folder, images, times, _ = clip
    circle = np.nanmedian(found.circles, axis=0)
    given = estimator.estimate_sequence(images[:8], times[:8], circle=circle, color="rgb")
    np.testing.assert_allclose(given.circles, np.tile(circle, (8, 1)))
    assert given.answered
    seen = []
    estimator.estimate_sequence(images[:2], color="rgb", progress=lambda done, total: seen.append((done, total)))
    assert seen == [(2, 2)]
    with pytest.raises(ValueError, match="times_s"):
        estimator.estimate_sequence(images, times[:3], color="rgb")
    (tmp_path / "no.npz").write_bytes(b"PK")
    with pytest.raises(ValueError, match=r"no\.npz"):
        spindoe.Surface.load(tmp_path / "no.npz")
    with pytest.raises(ValueError, match="ball_radius_m"):
        spindoe.PaintedEstimator(ball_radius_m=0.0)
    with pytest.raises(ValueError, match="outline"):
        spindoe.PaintedEstimator(outline="by hand")  # type: ignore[arg-type]
    with pytest.raises(OSError, match="absent"):
        spindoe.Surface.load(folder / "absent.npz")


def test_a_stream_is_followed_on_the_surface(clip, estimator, found):
    folder, images, times, _ = clip
    tracker = estimator.tracker(folder / "ball.npz")
    states = [tracker.update(image, time, color="rgb") for image, time in zip(images, times, strict=True)]
    placed = [k for k, state in enumerate(states) if state.reason is None]
    assert len(placed) > FRAMES * 0.8
    for k in placed:
        state = states[k]
        off = abs(float(state.quaternion_wxyz @ found.quaternions_wxyz[k]))
        assert found.reasons[k] is not None or 2 * np.degrees(np.arccos(min(off, 1.0))) < 8
        assert state.covariance_rad2.shape == (3, 3) and state.agreement > 0.65 and state.frame == found.frame
    assert not states[0].spin and "at least 3" in states[0].spin.reason
    last = states[placed[-1]]
    assert np.linalg.norm(last.spin.spin_rad_s) / (2 * np.pi) == pytest.approx(RPS, rel=0.1)
    with pytest.raises(ValueError, match="later than the frame before"):
        tracker.update(images[0], times[0], color="rgb")
    tracker.reset()
    assert tracker.update(images[0], times[0], color="rgb").time_s == times[0]
    with pytest.raises(TypeError, match="cannot be pickled"):
        pickle.dumps(tracker)
