"""A ball as it was drawn: against the truth of a synthetic clip, and against the command."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
from conftest import ROOT, run
from scipy.spatial.transform import Rotation

import spindoe

TABLE = ROOT / "designs/dots20/table.npz"
TOLERANCE = 1e-12
FORGOTTEN = 5


@pytest.fixture(scope="module")
def drawn(pattern):
    """The pattern drawn by hand, 2 deg per axis, without one of its dots."""
    rng = np.random.default_rng(8)
    off = np.cross(pattern.dots, rng.normal(size=pattern.dots.shape))
    dots = Rotation.from_rotvec(np.deg2rad(2.0) * off).apply(pattern.dots)
    dots[FORGOTTEN] = np.nan
    return dots


@pytest.fixture(scope="module")
def clip(command, drawn, tmp_path_factory):
    """A folder of images named by their times, and the same as arrays."""
    image = pytest.importorskip("PIL.Image")
    folder = tmp_path_factory.mktemp("clip")
    np.savetxt(folder / "drawn.csv", drawn[~np.isnan(drawn[:, 0])], delimiter=",", fmt="%.17g")
    run(command, "synth", folder / "drawn.csv", "-o", folder / "set", "--frames", 40,
        "--fps", 60, "--rps", 3, "--seed", 9, "--preset", "good", "--ball-px", 80,
        "--config=placement_sigma_deg=0", "--config=logo_probability=0", "--exposure-ms", 0.5,
        "--config=camera_distance_radii=20")
    paths = sorted((folder / "set/images").glob("*.png"), key=lambda path: int(path.stem))
    images = [np.array(image.open(path).convert("RGB")) for path in paths]
    return folder / "set/images", images


@pytest.fixture(scope="module")
def theirs(command, clip, tmp_path_factory):
    """The folder that the command writes."""
    out = tmp_path_factory.mktemp("out") / "ball"
    run(command, "calibrate", "--table", TABLE, clip[0], "-o", out, "--samples", 40, "--seed", 3)
    return out


@pytest.fixture(scope="module")
def found(estimator, clip, theirs):
    # Seconds of the names' nanoseconds; the command reads them so.
    times = np.array([int(path.stem) for path in sorted(
        clip[0].glob("*.png"), key=lambda path: int(path.stem))]) / 1e9
    calls = []
    found = estimator.calibrate(
        clip[1], times, color="rgb", evaluate=40, seed=3, progress=lambda *of: calls.append(of)
    )
    assert calls[-1] == (40, 40)
    return found


def test_the_drawn_dots_are_measured(found, pattern, drawn):
    assert found and found.missing.tolist() == [FORGOTTEN]
    assert found.numbers[FORGOTTEN] == -1 and len(found.pattern) == len(pattern) - 1
    assert np.array_equal(found.pattern.dots, found.directions[found.numbers >= 0])
    measured = np.array(found.states) == "measured"
    assert measured.sum() >= 10
    # Against the truth, up to the turn that no clip can show, the offsets are gone.
    a, b = found.directions[measured], drawn[measured]
    turn, _ = Rotation.align_vectors(b, a)
    after = np.arccos(np.clip(np.einsum("ij,ij->i", turn.apply(a), b), -1, 1))
    before = found.offsets_rad[measured]
    assert np.median(after) < 0.4 * np.median(before)
    assert found.rms_offset_rad == pytest.approx(np.sqrt(np.mean(before**2)), rel=1e-9)
    assert len(found.frames) == 40 and found.fitted <= found.with_ball <= 40
    assert "1 missing" in repr(found)


def test_covariances_lie_in_the_tangent_plane(found):
    along = np.einsum("nij,nj->ni", found.covariances, found.directions)
    assert np.abs(along).max() < 1e-15
    kept = found.numbers >= 0
    assert np.allclose(found.table.dot_covariances, found.covariances[kept], rtol=0, atol=1e-18)


def test_it_is_the_command(found, theirs):
    report = json.loads((theirs / "report.json").read_text())
    # Only a command has a command line.
    assert report.pop("command").startswith("spindoe calibrate")
    assert {**found.report, "command": None} == {**report, "command": None}
    assert found.table.to_bytes() == (theirs / "table.npz").read_bytes()
    for dot, offset, sigma in zip(report["dots"], found.offsets_rad, found.sigmas_rad, strict=True):
        assert np.deg2rad(dot["offset_deg"]) == pytest.approx(offset, abs=TOLERANCE)
        assert np.deg2rad(dot["sigma_deg"]) == pytest.approx(sigma, abs=TOLERANCE)


def test_files_are_arrays(estimator, found, clip):
    of_files = estimator.calibrate(clip[0])
    assert of_files and of_files.report is None
    assert np.array_equal(of_files.directions, found.directions)
    assert np.array_equal(of_files.covariances, found.covariances)


def test_the_calibrated_table_is_used(command, found, clip, theirs, tmp_path):
    estimator = spindoe.Estimator(found.table)
    frames = json.loads(run(command, "estimate", "--table", theirs / "table.npz", clip[0], "--json"))
    ours = estimator.estimate_sequence(
        clip[1], [frame["time_s"] for frame in frames["frames"]], color="rgb"
    )
    # The command's are in the one view frame of the sequence.
    assert frames["frame"] == ours.frame == "view"
    for their, frame, wxyz in zip(frames["frames"], ours.frames, ours.quaternions_wxyz, strict=True):
        assert bool(frame.pose) == ("orientation_wxyz" in their)
        if frame.pose:
            assert np.abs(wxyz - their["orientation_wxyz"]).max() <= TOLERANCE
            assert frame.pose.residual_px == pytest.approx(their["residual_px"], abs=TOLERANCE)
    # With its own dots the residuals are smaller.
    nominal = spindoe.Estimator(TABLE).estimate_sequence(clip[1], color="rgb")
    assert np.nanmedian(ours.residuals_rad) < 0.7 * np.nanmedian(nominal.residuals_rad)
    # Calibrated again from the design's dots or from its own: the ball is the same.
    again = estimator.calibrate(clip[0])
    assert again and again.rms_offset_rad < 0.3 * found.rms_offset_rad


def test_it_pickles(found):
    again = pickle.loads(pickle.dumps(found))
    assert repr(again) == repr(found) and np.array_equal(again.covariances, found.covariances)
    assert np.array_equal(again.table.dot_covariances, found.table.dot_covariances)


def test_what_cannot_be_calibrated_has_a_reason(estimator, clip, tmp_path):
    few = estimator.calibrate(clip[1][:3], color="rgb")
    assert not few and "too few frames" in few.reason
    black = np.zeros((80, 80), np.uint8)
    nothing = estimator.calibrate([black] * 6)
    assert not nothing and "shows a ball" in nothing.reason
    for words, images, arguments in [
        ("found both", clip[1], {"times_s": [0.0], "fps": 60.0}),
        ("times_s: files have", clip[0], {"times_s": [0.0]}),
        ("times_s: files have", iter(["a.png", "b.png"]), {"times_s": [0.0]}),
        ("times_s", clip[1], {"times_s": [0.0], "color": "rgb"}),
        ("fps", clip[1], {"fps": -1.0, "color": "rgb"}),
        ("color", clip[1], {}),
        ("placement_sigma_rad", clip[1], {"placement_sigma_rad": 2.0, "color": "rgb"}),
        ("placement_sigma_rad", clip[1], {"placement_sigma_rad": np.nan, "color": "rgb"}),
        (r"images\[1\]", [black, black.astype(np.int32)], {}),
        ("circle", clip[1], {"circle": (1.0, 2.0, -3.0), "color": "rgb"}),
    ]:
        with pytest.raises(ValueError, match=words):
            estimator.calibrate(images, **arguments)
    with pytest.raises(OSError):
        estimator.calibrate(tmp_path / "none")
