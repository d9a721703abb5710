"""What other programs read: FicTrac's columns, golf shots, data sets of flights."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

import spindoe

ROTATION = pytest.importorskip("scipy.spatial.transform").Rotation


def walk(ahead, right, clockwise):
    """The path of an animal by small steps, and the ball's orientations in the lab's frame (x front, y right, z down).

    FicTrac's documents: clockwise about +y is a step ahead, about +x one to the left, about +z a turn to the left.
    """
    turns = np.column_stack([-right, ahead, -clockwise])
    ball, place = [ROTATION.identity()], [np.zeros(3)]
    for step, turn in zip(np.column_stack([ahead, right, clockwise]), turns, strict=True):
        ball.append(ROTATION.from_rotvec(turn) * ball[-1])
        north, east, heading = place[-1]
        shares = (np.arange(4000) + 0.5) / 4000
        angles = heading + shares * step[2]
        north += np.mean(step[0] * np.cos(angles) - step[1] * np.sin(angles))
        east += np.mean(step[0] * np.sin(angles) + step[1] * np.cos(angles))
        place.append(np.array([north, east, heading + step[2]]))
    return ROTATION.concatenate(ball), np.array(place)


def test_fictracs_path_is_that_of_the_walk(tmp_path):
    rng = np.random.default_rng(65)
    ahead, right, clockwise = 0.05 + 0.02 * rng.normal(size=(3, 40))
    ball, place = walk(ahead, right, clockwise)
    c2a_r = (0.3, -1.1, 0.8)
    seen = ROTATION.from_rotvec(c2a_r).inv() * ball * ROTATION.random(random_state=1)
    times = np.arange(41) / 100
    found = spindoe.fictrac(times, np.roll(seen.as_quat(), 1, axis=1), frame="optical", c2a_r=c2a_r)
    found.save(tmp_path / "run.dat")
    # Read as analyses read FicTrac's files.
    table = np.loadtxt(tmp_path / "run.dat", delimiter=",")
    assert table.shape == (41, 25) == found.values.shape and len(found.names) == 25
    np.testing.assert_array_equal(np.isnan(table), np.isnan(found.values))
    np.testing.assert_allclose(table[:, 14:16], place[:, :2], atol=1e-7)
    np.testing.assert_allclose(table[:, 16], place[:, 2] % (2 * np.pi), atol=1e-9)
    np.testing.assert_allclose(table[1:, 5:8], np.column_stack([-right, ahead, -clockwise]), atol=1e-9)
    np.testing.assert_allclose(table[1:, 18], np.hypot(ahead, right), atol=1e-9)
    np.testing.assert_allclose(table[1:, 19], np.cumsum(ahead), atol=1e-9)
    lab = ROTATION.from_rotvec(table[:, 11:14]) * ROTATION.from_rotvec(table[0, 11:14]).inv()
    assert np.max((lab * ball.inv()).magnitude()) < 1e-6
    np.testing.assert_allclose(table[:, 21], 1e3 * times)
    frame = found.to_dataframe()
    assert list(frame.columns) == list(found.names)
    with pytest.raises(ValueError, match="time"):
        spindoe.fictrac([0.0, 0.0], [[1, 0, 0, 0]] * 2)
    still = [[1.0, 0, 0, 0]] * 2
    assert len(spindoe.fictrac([0.0, 1.0], still, max_bad_frames=-1)) == 2
    for words, wrong in [("quaternions_wxyz", {"quaternions_wxyz": still[:1]}), ("^frame", {"frame": "lab"}), ("max_bad_frames", {"max_bad_frames": -2})]:
        with pytest.raises(ValueError, match=words):
            spindoe.fictrac(**{"times_s": [0.0, 1.0], "quaternions_wxyz": still, **wrong})


def test_an_independent_reader_reads_fictracs_file(tmp_path):
    interface = pytest.importorskip("neuroconv.datainterfaces", reason="neuroconv reads FicTrac's files: pip install neuroconv[fictrac]")
    from datetime import datetime, timezone

    ball, place = walk(np.full(30, 0.1), np.zeros(30), np.full(30, 0.05))
    c2a_r = (2 * np.pi / 3 / np.sqrt(3),) * 3
    seen = ROTATION.from_rotvec(c2a_r).inv() * ball
    found = spindoe.fictrac(np.arange(31) / 50, np.roll(seen.as_quat(), 1, axis=1), frame="optical")
    found.save(tmp_path / "run.dat")
    reader = interface.FicTracDataInterface(file_path=tmp_path / "run.dat")
    np.testing.assert_allclose(reader.get_timestamps(), np.arange(31) / 50, atol=1e-12)
    metadata = reader.get_metadata()
    metadata["NWBFile"]["session_start_time"] = datetime(2026, 1, 1, tzinfo=timezone.utc)
    series = reader.create_nwbfile(metadata=metadata).processing["behavior"]["FicTrac"].spatial_series
    np.testing.assert_allclose(series["SpatialSeriesPosition"].data[:], place[:, :2], atol=1e-7)
    heading = np.ravel(series["SpatialSeriesAnimalHeading"].data[:])
    np.testing.assert_allclose(heading, place[:, 2] % (2 * np.pi), atol=1e-9)
    speed = np.ravel(series["SpatialSeriesMovementSpeed"].data[:])
    np.testing.assert_allclose(speed[1:], 0.1, atol=1e-9)


def test_a_sequence_has_a_path():
    spin = 2 * np.pi * 2.0 * np.array([0.6, 0.8, 0.0])
    images, truths = zip(*spindoe.synth("dots20", 8, seed=5, fps=100.0, spin_rad_s=spin), strict=True)
    found = spindoe.Estimator("dots20").estimate_sequence(list(images), [truth.time_s for truth in truths], color="rgb")
    path = found.fictrac()
    posed = np.isfinite(found.quaternions_wxyz[:, 0])
    assert len(path) == posed.sum() and path.values[-1, 0] == np.flatnonzero(posed)[-1] + 1
    # The camera's axes are x right, y down, z forward.
    np.testing.assert_allclose(path.values[1:, 1:4], [spin / 100 * [1, -1, -1]] * (len(path) - 1), atol=0.02)
    assert np.all(path.values[1:, 4] > 0.0)


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clips")
    for name, seed in (("a", "3"), ("b", "4")):
        subprocess.run(
            [sys.executable, "-m", "spindoe", "synth", "dots20", "-o", str(folder / name), "--image-size", "640x480",
             "--ball-px", "60", "--frames", "10", "--seed", seed, "--rps", "25", "--config", "drift_px=200,-60"],
            check=True, capture_output=True,
        )
    k = json.loads((folder / "a/truth.json").read_text())["frames"][0]["intrinsics"]
    return folder, spindoe.Camera([[k["fx"], 0, k["cx"]], [0, k["fy"], k["cy"]], [0, 0, 1]])


def test_a_data_set_in_python_is_that_of_the_command(tmp_path, clip):
    folder, camera = clip
    estimator = spindoe.Estimator("dots20", camera=camera)
    record = spindoe.dataset.write(folder / "a/images", estimator, tmp_path / "own", names=["dots20"])
    numbers = ",".join(str(x) for x in camera.numbers[:4])
    subprocess.run(
        [sys.executable, "-m", "spindoe", "dataset", "--table", "dots20", str(folder / "a/images"), f"--intrinsics={numbers}",
         "-o", str(tmp_path / "command")],
        check=True, capture_output=True,
    )
    assert record == spindoe.dataset.read(tmp_path / "command") == spindoe.dataset.read(tmp_path / "own")
    for name in ("index.csv", "000.csv", "orientations/000.csv"):
        assert (tmp_path / "own" / name).read_bytes() == (tmp_path / "command" / name).read_bytes()
    with pytest.raises(ValueError, match="holds a data set already"):
        spindoe.dataset.write(folder / "a/images", estimator, tmp_path / "own")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/2024.csv").write_text("mine")
    with pytest.raises(ValueError, match=r"2024\.csv"):
        spindoe.dataset.write(folder / "a/images", estimator, tmp_path / "mine", overwrite=True)
    for fps in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="fps"):
            spindoe.dataset.write(folder / "a/images", estimator, tmp_path / "none", fps=fps)
    with pytest.raises(ValueError, match="intrinsics"):
        spindoe.dataset.write(folder / "a/images", spindoe.Estimator("dots20"), tmp_path / "none")
    with pytest.raises(ValueError, match="half_window"):
        spindoe.dataset.write(folder / "a/images", estimator, tmp_path / "none", half_window=0)
    # In a mirror these are images of no such ball.
    with pytest.raises(ValueError, match="no clip shows the ball"):
        spindoe.dataset.write(folder / "a/images", estimator, tmp_path / "mirrored", mirrored=True)
    assert not (tmp_path / "mirrored").exists()
    (tmp_path / "dataset.json").write_text("{}")
    with pytest.raises(ValueError, match=r"dataset\.json"):
        spindoe.dataset.read(tmp_path)


def test_parquet_has_every_frame_with_its_deviations(tmp_path, clip):
    parquet = pytest.importorskip("pyarrow.parquet")
    folder, camera = clip
    estimator = spindoe.Estimator("dots20", camera=camera)
    spindoe.dataset.write([folder / "a/images", folder / "b/images"], estimator, tmp_path / "set")
    spindoe.dataset.to_parquet(tmp_path / "set", tmp_path / "set.parquet")
    table = parquet.read_table(tmp_path / "set.parquet")
    record = json.loads(table.schema.metadata[b"spindoe"])
    assert record == spindoe.dataset.read(tmp_path / "set")
    flights = [flight for one in record["clips"] for flight in one["flights"]]
    assert table.num_rows == sum(flight["frames"] for flight in flights) == 20
    rows = table.to_pandas()
    for flight, trajectory in zip(flights, spindoe.read_trajectories(tmp_path / "set").trajectories, strict=True):
        own = rows[rows.flight == flight["number"]]
        placed = own[own.x_m.notna()]
        np.testing.assert_allclose(placed[["x_m", "y_m", "z_m"]], trajectory.position_m)
        np.testing.assert_allclose(placed.time_s - flight["start_s"], trajectory.time_s, atol=1e-9)
        np.testing.assert_array_equal(own[[f"spin_{axis}_rad_s" for axis in "xyz"]].iloc[0], trajectory.spin)
        np.testing.assert_allclose(own.spin_cov_xx_rad2_s2, flight["spin"]["covariance_rad2_s2"][0][0])
        assert (placed.cov_m2_zz > 0.0).all() and (own.cov_xx.dropna() > 0.0).all()


def test_a_shot_as_simulators_read_it(tmp_path):
    subprocess.run(
        [sys.executable, "-m", "spindoe", "synth", "dots20", "--strobe-ms", "0,0.9,2.1", "--frames", "1", "--seed", "4", "-o",
         str(tmp_path / "e")],
        check=True, capture_output=True,
    )
    balls = spindoe.Balls(spindoe.Estimator("dots20"), count=3)
    flashes = [0.0, 0.9e-3, 2.1e-3]
    found = balls.estimate_strobe(tmp_path / "e/images/frame-000000.png", flashes, max_rps=250.0).hypotheses[0]
    shot = found.open_connect(7)
    assert shot is not None and shot["ShotNumber"] == 7
    assert shot["BallData"]["BackSpin"] == found.golf.backspin_rpm and shot["SpinType"] == found.golf.spin_type
    assert "Speed" not in shot["BallData"] and not shot["ShotDataOptions"]["ContainsBallData"]
