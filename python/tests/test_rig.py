"""Several cameras: rigs in the files of others, and one ball that two cameras see."""

from __future__ import annotations

import json
import subprocess

import numpy as np
import pytest

import spindoe

cv2 = pytest.importorskip("cv2")

K1 = np.array([[1500.0, 0, 159.5], [0, 1500.0, 139.5], [0, 0, 1]])
K2 = np.array([[1350.0, 0, 158.5], [0, 1360.0, 140.5], [0, 0, 1]])
DIST = np.array([-0.1, 0.02, 0.001, -0.0005, 0.0])
ROTATION = cv2.Rodrigues(np.array([0.05, 1.5, -0.1]))[0]
# A place on the first camera's axis, a meter away, is on the second one's.
TRANSLATION = np.array([0.0, 0.0, 1.0]) - ROTATION @ np.array([0.0, 0.0, 1.0])


def rig_of(path):
    return spindoe.Rig(path, "dots20")


def same(rig):
    first, second = rig.cameras
    assert first.rotation.tolist() == np.eye(3).tolist() and not first.translation_m.any()
    np.testing.assert_allclose(second.rotation, ROTATION, atol=1e-9)
    np.testing.assert_allclose(second.translation_m, TRANSLATION, atol=1e-9)
    np.testing.assert_allclose(second.camera.numbers[:4], [1350, 1360, 158.5, 140.5])


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
@pytest.mark.parametrize("names", ["K1 D1 K2 D2 R T", "cameraMatrix1 distCoeffs1 cameraMatrix2 distCoeffs2 R T", "M1 D1 M2 D2 R T"])
def test_what_people_save_of_stereo_calibrate_is_read(tmp_path, suffix, names):
    path = tmp_path / f"stereo.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    values = [K1, DIST[None], K2, DIST[None], ROTATION, TRANSLATION[:, None]]
    for name, value in zip(names.split(), values, strict=True):
        storage.write(name, value)
    storage.release()
    rig = rig_of(path)
    same(rig)
    assert [camera.name for camera in rig.cameras] == ["left", "right"]


def test_a_numpy_archive_is_read(tmp_path):
    np.savez(tmp_path / "stereo.npz", K1=K1, D1=DIST, K2=K2, D2=DIST, R=ROTATION, T=TRANSLATION[:, None])
    same(rig_of(tmp_path / "stereo.npz"))


def test_extrinsics_are_those_of_stereo_calibrate(tmp_path):
    """x2 = R x1 + T: points seen by both cameras as cv2.projectPoints shows them, calibrated by OpenCV and read from what it gives."""
    rng = np.random.default_rng(65)
    board = np.array([[x, y, 0.0] for y in range(6) for x in range(7)], np.float32) * 0.01
    board -= board.mean(axis=0)
    objects, seen = [], ([], [])
    for _ in range(12):
        turn, place = cv2.Rodrigues(rng.normal(0, 0.3, 3))[0], np.array([0, 0, 1.0]) + rng.normal(0, 0.015, 3)
        in_first = (board @ turn.T + place).astype(np.float64)
        in_second = in_first @ ROTATION.T + TRANSLATION
        objects.append(board)
        for own, points, k in zip(seen, (in_first, in_second), (K1, K2), strict=True):
            own.append(cv2.projectPoints(points, np.zeros(3), np.zeros(3), k, DIST)[0].astype(np.float32))
    found = cv2.stereoCalibrate(objects, *seen, K1, DIST, K2, DIST, (320, 280), flags=cv2.CALIB_FIX_INTRINSIC)
    rotation, translation = found[5], found[6]
    path = tmp_path / "stereo.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in {"K1": K1, "D1": DIST, "K2": K2, "D2": DIST, "R": rotation, "T": translation}.items():
        storage.write(name, value)
    storage.release()
    first, second = rig_of(path).cameras
    point = np.array([[0.02, -0.01, 1.03]])
    moved = point @ second.rotation.T + second.translation_m
    expected = [cv2.projectPoints(p, np.zeros(3), np.zeros(3), k, DIST)[0].reshape(1, 2) for p, k in ((point, K1), (point @ ROTATION.T + TRANSLATION, K2))]
    np.testing.assert_allclose(first.camera.project(point), expected[0], atol=1e-6)
    np.testing.assert_allclose(second.camera.project(moved), expected[1], atol=0.01)


def kalibr(transform, shifts=("", "")):
    """A camchain after Kalibr's documentation (YAML formats, "camera calibration parameters")."""
    rows = "\n".join(f"  - [{', '.join(map(repr, row))}]" for row in transform.tolist())
    camera = (
        "  camera_model: pinhole\n  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]\n  distortion_model: radtan\n"
        "  intrinsics: [{}, {}, {}, {}]\n  resolution: [320, 280]\n  rostopic: /cam{}/image_raw\n  cam_overlaps: [{}]\n"
    )
    return (
        "cam0:\n" + camera.format(1500.0, 1500.0, 159.5, 139.5, 0, 1) + shifts[0]
        + "cam1:\n  T_cn_cnm1:\n" + rows + "\n" + camera.format(1350.0, 1360.0, 158.5, 140.5, 1, 0) + shifts[1]
    )


def transform():
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = ROTATION, TRANSLATION
    return whole


def test_kalibrs_camchain_is_read(tmp_path):
    path = tmp_path / "camchain.yaml"
    path.write_text(kalibr(transform()))
    rig = rig_of(path)
    same(rig)
    assert [camera.name for camera in rig.cameras] == ["cam0", "cam1"]
    # Kalibr's time shifts lead from each camera to the IMU: what is between the cameras is their difference.
    path.write_text(kalibr(transform(), ("  timeshift_cam_imu: 0.002\n", "  timeshift_cam_imu: 0.005\n")))
    assert rig_of(path).cameras[1].clock_offset_s == pytest.approx(0.003)


def test_transforms_of_ros_are_read(tmp_path):
    """p_parent = R p_camera + t, quaternion x, y, z, w, of each camera in one parent."""
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    in_parent = rotation.from_rotvec([0.4, -0.2, 1.0])
    at = np.array([0.3, 0.2, 1.1])
    # The second camera in the first one's frame, and then in the parent's.
    second = rotation.from_matrix(ROTATION).inv()
    place = in_parent.apply(-second.apply(TRANSLATION)) + at
    (tmp_path / "left.yaml").write_text("image_width: 320\nimage_height: 280\nK: [1500, 0, 159.5, 0, 1500, 139.5, 0, 0, 1]\n")
    x, y, z, w = in_parent.as_quat()
    path = tmp_path / "rig.yaml"
    path.write_text(
        f"left:\n  calibration: left.yaml\n  transform:\n    translation: {{x: {at[0]}, y: {at[1]}, z: {at[2]}}}\n"
        f"    rotation: {{x: {x}, y: {y}, z: {z}, w: {w}}}\n"
        "right:\n  image_width: 320\n  image_height: 280\n  camera_matrix: [1350, 0, 158.5, 0, 1360, 140.5, 0, 0, 1]\n"
        f"  transform:\n    translation: {place.tolist()}\n    rotation: {(in_parent * second).as_quat().tolist()}\n"
    )
    same(rig_of(path))


def test_a_file_that_is_no_rig_is_refused_with_its_field(tmp_path):
    whole = transform()
    flat = "K1: [1500, 0, 159.5, 0, 1500, 139.5, 0, 0, 1]\nK2: [1350, 0, 158.5, 0, 1360, 140.5, 0, 0, 1]\n"
    r = f"R: {ROTATION.ravel().tolist()}\n"
    mirror = f"R: {(np.diag([1, 1, -1]) @ ROTATION).ravel().tolist()}\n"
    cases = {
        flat: ["right", "R and T", "extrinsics.yml"],
        flat + r + "T: [-120.0, 0, 3.0]\n": ["T", "millimeters"],
        flat + "R: [1, 0, 0, 0, 1, 0, 0, 0, 2]\nT: [1, 0, 0]\n": ["R", "expected a rotation"],
        flat + mirror + "T: [1, 0, 0]\n": ["R", "mirror image"],
        flat + r + "T: [1, 0]\n": ["T", "three finite numbers"],
        flat + r + "T: [0, .nan, 0]\n": ["T", "three finite numbers"],
        flat + r + "T: [1, 0, 0]\nunits: furlongs\n": ["units", "m, cm or mm"],
        "K: [1500, 0, 159.5, 0, 1500, 139.5, 0, 0, 1]\n": ["cameras", "two cameras or more"],
        kalibr(np.diag([1.0, 1.0, 1.0, 2.0])): ["cam1.T_cn_cnm1", "4 x 4"],
        kalibr(np.diag([1.0, -1.0, 1.0, 1.0])): ["cam1.T_cn_cnm1", "determinant"],
        "a:\n  K: [9, 0, 5, 0, 9, 5, 0, 0, 1]\n  transform: {translation: [0, 0, 0], rotation: [0, 0, 0, 1]}\n"
        "b:\n  K: [9, 0, 5, 0, 9, 5, 0, 0, 1]\n  transform: {translation: [1, 0, 0], rotation: [0, 0, 0, 2]}\n": ["b.transform.rotation", "length 2"],
    }
    assert whole.shape == (4, 4)
    path = tmp_path / "rig.yaml"
    for text, words in cases.items():
        path.write_text(text)
        with pytest.raises(ValueError) as raised:
            rig_of(path)
        message = str(raised.value)
        assert str(path) in message and all(word in message for word in words) and "\n" not in message, message
    # Stated millimeters are millimeters.
    path.write_text(flat + r + f"T: {(1e3 * TRANSLATION).tolist()}\nunits: mm\n")
    same(rig_of(path))
    with pytest.raises(OSError, match="none"):
        rig_of(tmp_path / "none.yaml")


@pytest.fixture(scope="module")
def clips(tmp_path_factory, command):
    """A ball that two cameras see under a right angle."""
    folder = tmp_path_factory.mktemp("rig")
    size = "  image_width: 320\n  image_height: 280\n"
    (folder / "rig.yaml").write_text(
        f"left:\n{size}  camera_matrix: {K1.ravel().tolist()}\nright:\n{size}  camera_matrix: {K2.ravel().tolist()}\n"
        f"  R: {ROTATION.ravel().tolist()}\n  T: {TRANSLATION.tolist()}\n"
    )
    make = ["synth", "dots20", "--rig", "rig.yaml", "--preset", "good", "--frames", "6", "--rps", "30", "--exposure-ms", "0.2", "-o", "c"]
    done = subprocess.run([*command, *make], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    truths = [json.loads((folder / f"c/{name}/truth.json").read_text())["frames"] for name in ("left", "right")]
    return folder / "c", truths


def test_both_cameras_are_one_sequence(clips, tmp_path):
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    folder, (left, right) = clips
    # The renderer's truth: the second camera's orientation is the first one's, turned as the rig says (optical axes).
    turn = np.diag([1.0, -1, -1])
    of = lambda truth: rotation.from_quat(np.roll(truth["camera_quaternion_wxyz"], -1))  # noqa: E731
    for a, b in zip(left, right, strict=True):
        between = (of(b) * of(a).inv()).as_matrix()
        np.testing.assert_allclose(turn @ between @ turn, ROTATION, atol=1e-6)
    rig = spindoe.Rig(folder / "rig.yaml", "dots20")
    images = [[folder / name / "images" / truth["image"] for truth in truths] for name, truths in (("left", left), ("right", right))]
    times = [truth["time_s"] for truth in left]
    found = rig.estimate_sequence(images, times)
    assert found.cameras.tolist().count(2) >= 4 and found.frame == "camera"
    posed = found.cameras > 0
    errors = (rotation.from_quat(np.roll(found.quaternions_wxyz[posed], -1, axis=1)) * rotation.concatenate([of(t) for t, is_posed in zip(left, posed, strict=True) if is_posed]).inv()).magnitude()
    assert np.degrees(errors.max()) < 1.0
    assert found.spin and np.allclose(found.spin.spin_rad_s, left[0]["spin_rad_s"], atol=0.05 * np.linalg.norm(left[0]["spin_rad_s"]))
    assert np.nanmax(found.chi2) < 5.0 and any("right and left agree within" in note for note in found.notes)
    found.save(tmp_path / "found.npz")
    again = spindoe.SequenceEstimate.load(tmp_path / "found.npz")
    assert again.cameras.tolist() == found.cameras.tolist() and again.notes == found.notes
    assert found.to_dataframe()["cameras"].tolist() == found.cameras.tolist()
    # The same of cameras that no file has; with the clips exchanged it is said and nothing is answered.
    same_rig = spindoe.Rig(rig.cameras, "dots20")
    assert same_rig.estimate_sequence(images, [times, times]).cameras.tolist() == found.cameras.tolist()
    with pytest.warns(UserWarning, match="exchanged"):
        swapped = rig.estimate_sequence(images[::-1], times)
    assert not swapped.cameras.any() and not swapped.spin
    with pytest.raises(ValueError, match="one for each of 2 cameras"):
        rig.estimate_sequence(images[:1], times)


def test_a_rig_is_drawn_as_its_cameras_see_it(clips):
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    folder, _ = clips
    rig, spin = spindoe.Rig(folder / "rig.yaml", "dots20"), (20.0, 150.0, -40.0)
    drawn = list(spindoe.synth_rig(rig, 6, fps=200.0, seed=3, spin_rad_s=spin, exposure_s=2e-4))
    again = list(spindoe.synth_rig(rig, 6, fps=200.0, seed=3, spin_rad_s=spin, exposure_s=2e-4))
    turn = np.diag([1.0, -1, -1])
    for ((left, a), (right, b)), same in zip(drawn, again, strict=True):
        assert left.shape == right.shape == (280, 320, 3) and np.array_equal(right, same[1][0])
        np.testing.assert_allclose(a.spin_rad_s, spin, rtol=1e-12)
        np.testing.assert_allclose(turn @ b.spin_rad_s, ROTATION @ (turn @ a.spin_rad_s), atol=1e-6)
        of = lambda truth: rotation.from_quat(np.roll(truth.quaternion_wxyz, -1)).as_matrix()  # noqa: E731
        np.testing.assert_allclose(turn @ of(b), ROTATION @ turn @ of(a), atol=1e-6)
    images = [[views[camera][0] for views in drawn] for camera in (0, 1)]
    found = rig.estimate_sequence(images, [views[0][1].time_s for views in drawn], color="rgb")
    assert found.spin and np.allclose(found.spin.spin_rad_s, spin, atol=0.05 * np.linalg.norm(spin))
    with pytest.raises(ValueError, match="frames"):
        spindoe.synth_rig(rig, -1, fps=200.0)


def test_the_guides_example_runs(clips, root, monkeypatch):
    folder, (left, right) = clips
    monkeypatch.chdir(folder)
    text = (root / "docs/lab.md").read_text().split("## Two cameras")[1].split("## ")[0]
    example = text.split("```python\n")[1].split("```")[0]
    left_images, right_images = ([f"{name}/images/{truth['image']}" for truth in truths] for name, truths in (("left", left), ("right", right)))
    names = {"left_images": left_images, "right_images": right_images, "times_s": [truth["time_s"] for truth in left]}
    exec(compile(example, "docs/lab.md", "exec"), names)
    assert names["found"].spin and names["found"].positions_m.shape == (6, 3)


def test_equal_times_are_one_orientation():
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    rng = np.random.default_rng(3)
    times = np.repeat(np.arange(12) / 350, 2)
    spin = np.array([150.0, 90.0, -40.0])
    noise = rotation.from_rotvec(rng.normal(0, 0.01, (24, 3)))
    seen = noise * rotation.from_rotvec(times[:, None] * spin)
    found = spindoe.fit_spin(times, np.roll(seen.as_quat(), 1, axis=1), sigma_rad=0.01)
    assert found and np.linalg.norm(found.spin_rad_s - spin) < 3.0
    assert found.inlier_probabilities.shape == (24,)
    # All of one time are one orientation, and three are needed.
    alone = spindoe.fit_spin(times * 0, np.roll(seen.as_quat(), 1, axis=1))
    assert not alone and "at least 3" in alone.reason
