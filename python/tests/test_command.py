"""Python and the command give the same numbers."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from conftest import ROOT, run

import spindoe

TABLE = ROOT / "designs/dots20/table.npz"
TOLERANCE = 1e-12


@pytest.mark.parametrize("recognizer", ["robust", "voting"])
@pytest.mark.parametrize("protocol", ["paper", "sparse", "clutter", "image"])
def test_the_same_rates(command, table, protocol, recognizer):
    arguments = ("--samples", 1000, "--seed", 5, "--protocol", protocol, f"--config=recognizer={recognizer}")
    theirs = json.loads(run(command, "validate", TABLE, "--json", *arguments))
    ours = spindoe.validate(table, protocol, recognizer=recognizer, samples=1000, seed=5)
    for rate in ("identity", "orientation"):
        assert theirs[rate]["successes"] == getattr(ours, rate).successes
        assert theirs[rate]["high"] == pytest.approx(getattr(ours, rate).high, abs=TOLERANCE)
    for value in ("mean_error_deg", "median_error_deg"):
        assert theirs[value] == pytest.approx(getattr(ours, value), abs=TOLERANCE)


@pytest.mark.parametrize("recognizer", ["robust", "voting"])
@pytest.mark.parametrize("protocol", ["paper", "sparse", "clutter", "image"])
def test_the_same_identifications(command, table, protocol, recognizer, tmp_path):
    dump = tmp_path / "dots.csv"
    run(command, "synth", TABLE, "--as=dots", "--frames", 300, "--protocol", protocol, "-o", dump)
    flags = [] if recognizer == "voting" else ["--protocol", protocol]
    text = run(
        command, "identify", "--table", TABLE, dump, "--json", f"--config=recognizer={recognizer}", *flags
    )
    theirs = json.loads(text)["frames"]
    frames: dict[str, list[tuple[list[float], list[list[float]]]]] = {}
    with open(dump, newline="") as file:
        for row in csv.DictReader(file):
            xyz = [float(row[axis]) for axis in "xyz"]
            if row.get("sigma_deg"):
                variance = np.deg2rad(float(row["sigma_deg"])) ** 2
                covariance = [[variance, 0.0], [0.0, variance]]
            else:
                names = ("var_radial_deg2", "cov_deg2", "var_across_deg2")
                a, b, c = (float(row[name]) * np.deg2rad(1.0) ** 2 for name in names)
                covariance = [[a, b], [b, c]]
            frames.setdefault(row["frame"], []).append((xyz, covariance))
    expect = None if recognizer == "voting" else protocol
    mine = spindoe.Recognizer(table, recognizer, expect=expect)
    assert len(theirs) >= 290
    for their in theirs:
        dots, covariances = map(np.array, zip(*frames[their["frame"]], strict=True))
        isotropic = np.all(covariances[:, 0, 1] == 0.0)
        kinds = {"sigma_rad": np.sqrt(covariances[:, 0, 0])} if isotropic else {"covariances": covariances}
        found = mine.identify(dots, **kinds)
        assert bool(found) == ("refusal" not in their)
        if not found:
            assert found.reason == their["refusal"]
            continue
        assert np.abs(found.quaternion_wxyz - their["orientation_wxyz"]).max() <= TOLERANCE
        assert [None if j < 0 else j for j in found.assignment] == their["assignment"]
        assert found.dots_confidence == pytest.approx(their["dots_confidence"], abs=TOLERANCE)
        assert found.confidence == pytest.approx(their["confidence"], abs=TOLERANCE)


def _frames(folder, table, command):
    """Both estimates of the images of a folder, whose names are times in nanoseconds."""
    image = pytest.importorskip("PIL.Image")
    paths = sorted(folder.glob("*.png"), key=lambda path: int(path.stem))
    theirs = json.loads(run(command, "estimate", "--table", table, folder, "--json"))
    images = [np.array(image.open(path).convert("RGB")) for path in paths]
    # The names' nanoseconds in seconds, to the last bit as the command has them.
    times = [frame["time_s"] for frame in theirs["frames"]]
    return theirs, spindoe.Estimator(table).estimate_sequence(images, times, color="rgb")


def _compare(theirs, ours):
    assert len(theirs["frames"]) == len(ours.frames) > 0
    # Both are in the one view frame of the sequence.
    assert theirs["frame"] == ours.frame == "view"
    for their, frame, wxyz in zip(theirs["frames"], ours.frames, ours.quaternions_wxyz, strict=True):
        assert their["dots"] == len(frame.dots)
        for dot, row in zip(their["detections"], frame.dots, strict=True):
            assert abs(dot["u"] - row[0]) <= TOLERANCE and abs(dot["v"] - row[1]) <= TOLERANCE
            assert dot["probability"] == pytest.approx(row[2], abs=TOLERANCE)
        quaternion = their.get("orientation_wxyz")
        assert bool(frame.pose) == (quaternion is not None)
        if frame.pose:
            assert np.abs(wxyz - quaternion).max() <= TOLERANCE
            assert frame.pose.confidence == pytest.approx(their["confidence"], abs=TOLERANCE)
    spin = theirs.get("spin")
    if spin is None:
        assert ours.spin.reason == theirs["spin_refusal"]
        return
    assert ours.spin and ours.spin.inliers == spin["inliers"]
    assert (ours.spin.model, ours.spin.time_s) == (spin["motion"], spin["time_s"])
    assert np.abs(ours.spin.spin_rad_s - spin["spin_rad_s"]).max() <= TOLERANCE
    assert np.abs(ours.spin.covariance - spin["covariance_rad2_s2"]).max() <= TOLERANCE
    assert np.abs(ours.spin.std_rad_s - spin["std_rad_s"]).max() <= TOLERANCE
    assert ours.spin.std_rps == pytest.approx(spin["std_rps"], abs=TOLERANCE)
    assert np.rad2deg(ours.spin.sigma_rad) == pytest.approx(spin["sigma_deg"], abs=TOLERANCE)
    theirs_too = [alias["spin_rad_s"] for alias in spin["alternatives"]]
    assert len(ours.spin.aliases) == len(theirs_too)
    for alias, their in zip(ours.spin.aliases, theirs_too, strict=True):
        assert np.abs(alias.spin_rad_s - their).max() <= TOLERANCE


def test_the_same_published_frames(command, published):
    theirs, ours = _frames(published / "frames", published / "ref_pattern.csv", command)
    _compare(theirs, ours)


@pytest.fixture(scope="module")
def drawn(command, tmp_path_factory):
    """A folder of synthetic frames of one spin."""
    folder = tmp_path_factory.mktemp("drawn") / "set"
    run(command, "synth", ROOT / "designs/dots20/pattern.csv", "-o", folder,
        "--frames", 12, "--fps", 350, "--preset", "good")
    return folder / "images"


def test_the_same_synthetic_frames(command, drawn):
    theirs, ours = _frames(drawn, TABLE, command)
    _compare(theirs, ours)


def test_one_confidence_in_table_json_and_python(command, drawn, tmp_path):
    file = tmp_path / "orientations.csv"
    run(command, "estimate", "--table", TABLE, drawn, "-o", file)
    with file.open(newline="") as text:
        rows = [row["confidence"] for row in csv.DictReader(text)]
    theirs, ours = _frames(drawn, TABLE, command)
    assert len(rows) == len(theirs["frames"]) == len(ours.frames) == 12
    for row, their, frame in zip(rows, theirs["frames"], ours.frames, strict=True):
        if not frame.pose:
            assert row == "" and "confidence" not in their
            continue
        assert float(row) == pytest.approx(their["confidence"], abs=TOLERANCE)
        assert frame.pose.confidence == pytest.approx(their["confidence"], abs=TOLERANCE)
        assert frame.pose.confidence >= spindoe.MIN_CONFIDENCE_IMAGES
    settings = spindoe.Estimator(TABLE).settings
    assert settings["min_confidence"] == spindoe.MIN_CONFIDENCE_IMAGES
    for name, least in [
        ("identify", spindoe.MIN_CONFIDENCE_DOTS), ("estimate", spindoe.MIN_CONFIDENCE_IMAGES)
    ]:
        words = " ".join(run(command, name, "--help").split())
        assert f"[default: {least}" in words, words


@pytest.mark.parametrize("method", ["robust", "quatera"])
def test_the_same_spin_of_a_file(command, drawn, tmp_path, method):
    file = tmp_path / "orientations.csv"
    run(command, "estimate", "--table", TABLE, drawn, "-o", file)
    theirs = json.loads(run(command, "spin", file, "--json", f"--config=method={method}"))
    with open(file, newline="") as lines:
        rows = [row for row in csv.DictReader(lines) if row["qw"]]
    column = lambda name: np.array([float(row[name]) for row in rows])  # noqa: E731
    quaternions = np.stack([column(f"q{axis}") for axis in "wxyz"], axis=1)
    found = spindoe.fit_spin(
        column("time_s"), quaternions, confidences=column("confidence"), method=method,
        residuals_rad=np.deg2rad(column("residual_deg")), matched=column("matched").astype(int),
        covariances_rad2=np.array([[column(f"cov_{min(a, b)}{max(a, b)}") for a in "xyz"] for b in "xyz"]).T,
        view_turns_rad=np.stack(
            [column(f"{name}_{axis}") for name in ("turn", "sd1", "sd2", "sd3") for axis in "xyz"], axis=1
        ),
    )
    assert found and found.inliers == theirs["inliers"]
    assert np.abs(found.spin_rad_s - theirs["spin_rad_s"]).max() <= TOLERANCE
    if method == "quatera":
        assert found.covariance is None and theirs["covariance_rad2_s2"] is None
    else:
        assert np.abs(found.covariance - theirs["covariance_rad2_s2"]).max() <= TOLERANCE


def test_the_command_fails_as_it_does(command, tmp_path):
    import subprocess

    done = subprocess.run(
        [*command, "validate", str(tmp_path / "none.csv")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2 and done.stderr.startswith("spindoe: ")
    helped = subprocess.run([*command, "--help"], capture_output=True, text=True, check=False)
    assert helped.returncode == 0 and "design" in helped.stdout
