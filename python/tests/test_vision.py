"""Images: estimates, memory layouts, cameras, trackers."""

from __future__ import annotations

import pickle

import numpy as np
import PIL.Image
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import spindoe

SPIN = (40.0, 150.0, -60.0)
EASY = {"ball_px": [100, 100], "camera_distance_radii": [20, 20]}


@pytest.fixture(scope="module")
def clip(pattern):
    return list(spindoe.synth(pattern, 20, seed=4, fps=350.0, spin_rad_s=SPIN, **EASY))


@pytest.fixture(scope="module")
def image(clip):
    return clip[0][0]


def _off(pose, truth) -> float:
    return float(np.rad2deg((pose.as_rotation() * truth.as_rotation().inv()).magnitude()))


def test_orientations_of_synthetic_images(pattern, estimator):
    posed, errors = 0, []
    for image, truth in spindoe.synth(pattern, 30, seed=2, **EASY):
        found = estimator.estimate(image, color="rgb")
        if found.pose:
            posed += 1
            errors.append(_off(found.pose, truth))
            assert found.matched >= 3 and found.circle is not None
            assert abs(found.circle[2] - truth.circle[2]) < 5
    assert posed >= 25 and np.median(errors) < 3.0 and np.sum(np.array(errors) > 20) <= 1


def test_a_clip_gives_its_spin(clip, estimator):
    images, truths = zip(*clip, strict=True)
    times = [truth.time_s for truth in truths]
    heard = []
    found = estimator.estimate_sequence(
        images, times, color="rgb", progress=lambda done, total: heard.append((done, total))
    )
    assert found.spin and np.linalg.norm(found.spin.spin_rad_s - SPIN) < 5.0
    assert found.spin.std_rps is not None and heard[-1] == (20, 20)
    assert found.quaternions_wxyz.shape == (20, 4) and found.confidences.shape == (20,)
    again = spindoe.fit_spin(
        times, found.quaternions_wxyz, confidences=found.confidences,
        residuals_rad=found.residuals_rad, matched=found.matched,
        covariances_rad2=found.covariances_rad2, view_turns_rad=found.view_turns_rad,
    )
    assert again and np.array_equal(again.spin_rad_s, found.spin.spin_rad_s)
    assert np.array_equal(again.covariance, found.spin.covariance)
    # Without the residuals nothing is known of the errors that frames share.
    alone = spindoe.fit_spin(times, found.quaternions_wxyz, confidences=found.confidences)
    assert alone and np.trace(alone.covariance) < np.trace(found.spin.covariance)
    stacked = estimator.estimate_sequence(np.stack(images), times, color="rgb")
    assert stacked.spin and np.array_equal(stacked.spin.spin_rad_s, found.spin.spin_rad_s)
    alone = estimator.estimate_sequence(images, color="rgb")
    assert not alone.spin
    for frame, image in zip(alone.frames, images, strict=True):
        single = estimator.estimate(image, color="rgb")
        assert np.array_equal(single.dots, frame.dots)
    assert len(estimator.estimate_sequence([]).frames) == 0


def test_a_tracker_follows_a_clip(clip, estimator):
    tracker = estimator.tracker()
    spins = []
    for image, truth in clip:
        state = tracker.update(image, truth.time_s, color="rgb")
        if state.frame.pose:
            assert _off(state.frame.pose, truth) < 20.0
        spins.append(state.spin)
    assert not spins[0] and "found 0" in spins[0].reason or "found 1" in spins[0].reason
    last = spins[-1]
    assert last and np.linalg.norm(last.spin_rad_s - SPIN) < 6.0 and last.covariance is not None
    with pytest.raises(ValueError, match="time_s"):
        tracker.update(clip[0][0], clip[0][1].time_s, color="rgb")
    with pytest.raises(ValueError, match="time_s"):
        tracker.update(clip[0][0], float("nan"), color="rgb")
    tracker.reset()
    assert not tracker.update(clip[0][0], 0.0, color="rgb").spin
    # What is older than the memory is forgotten.
    assert not tracker.update(clip[1][0], 10.0, color="rgb").spin
    tracker.reset()
    for k in range(24):
        state = tracker.update(clip[k % len(clip)][0][:, ::-1].copy(), k / 350.0, color="rgb")
    assert not state.frame.pose and tracker.verdict.answer == "mirrored"
    tracker.reset()
    assert tracker.verdict.answer == "open"
    with pytest.raises(ValueError, match="window"):
        estimator.tracker(window=2)


def test_a_trackers_covariance_counts_shared_errors(clip, estimator):
    """Its spin is that of the window's poses with their residuals."""
    tracker = estimator.tracker(window=8)
    times, poses = [], []
    for image, truth in clip:
        state = tracker.update(image, truth.time_s, color="rgb")
        pose = state.frame.pose
        if pose and not pose.hinted and pose.confidence >= 0.8:
            times.append(truth.time_s)
            poses.append(pose)
    window = poses[-8:]
    given = {"confidences": [pose.confidence for pose in window]}
    quaternions = np.array([pose.quaternion_wxyz for pose in window])
    plain = spindoe.fit_spin(times[-8:], quaternions, **given)
    shared = spindoe.fit_spin(
        times[-8:], quaternions, residuals_rad=[pose.residual_rad for pose in window], **given
    )
    assert state.spin and plain and shared
    # But for the view frame, which hardly turns here, and the camera, which the poses have in common: its error counts, too.
    assert np.abs(state.spin.spin_rad_s - shared.spin_rad_s).max() < 0.5
    assert np.linalg.eigvalsh(state.spin.covariance - shared.covariance).min() > -0.05 * np.trace(shared.covariance)
    assert np.all(np.linalg.eigvalsh(state.spin.covariance - plain.covariance) > 0.0)


def test_channels_by_name(image, estimator):
    rgb = estimator.estimate(image, color="rgb")
    bgr = estimator.estimate(np.ascontiguousarray(image[..., ::-1]), color="bgr")
    flipped = estimator.estimate(image[..., ::-1], color="bgr")
    for other in (bgr, flipped):
        assert np.array_equal(other.dots, rgb.dots) and other.pose and rgb.pose
        assert np.array_equal(other.pose.quaternion_wxyz, rgb.pose.quaternion_wxyz)


def test_gray_is_color_without_color(image, estimator):
    gray = np.ascontiguousarray(image[..., 1])
    a = estimator.estimate(gray)
    b = estimator.estimate(np.repeat(gray[..., None], 3, axis=2), color="rgb")
    assert a.pose and b.pose
    assert np.abs(a.pose.quaternion_wxyz - b.pose.quaternion_wxyz).max() < 1e-12


@settings(deadline=None, max_examples=25)
@given(
    deep=st.booleans(), order=st.sampled_from("CF"), margin=st.integers(0, 3), flip=st.booleans(),
    writable=st.booleans(),
)
def test_memory_layout_does_not_matter(estimator, image, deep, order, margin, flip, writable):
    plain = estimator.estimate(image, color="rgb")
    height, width, _ = image.shape
    kind = np.uint16 if deep else np.uint8
    # 257 * x / 65535 is x / 255.
    values = image.astype(kind) * (257 if deep else 1)
    large = np.zeros((height + 2 * margin, width + 2 * margin, 4), dtype=kind, order=order)
    inner = large[margin : margin + height, margin : margin + width, :3]
    inner[...] = values[::-1] if flip else values
    laid = inner[::-1] if flip else inner
    laid.flags.writeable = writable
    found = estimator.estimate(laid, color="rgb")
    assert np.allclose(found.dots, plain.dots, atol=1e-4)
    assert found.pose and plain.pose
    assert np.abs(found.pose.quaternion_wxyz - plain.pose.quaternion_wxyz).max() < 1e-4
    if not deep:
        assert np.array_equal(found.pose.quaternion_wxyz, plain.pose.quaternion_wxyz)


@pytest.mark.parametrize(
    ("image", "color", "words"),
    [
        (np.full((40, 40, 3), 255.0), "rgb", "image: expected floats from 0 to 1, found 255 to 255"),
        (np.full((40, 40), np.nan), None, "image: expected floats from 0 to 1"),
        (np.full((40, 40), -0.1, np.float16), None, "image: expected floats from 0 to 1"),
        (np.zeros((40, 40, 3), np.int8), "rgb", "found int8"),
        (np.zeros((40, 40, 4), np.uint8), "rgb", r'image: expected shape .* color="rgba" leaves alpha out'),
        (np.zeros((40, 40, 3), np.uint8), "bgra", "image: expected shape .height, width, 4. for bgra"),
        (np.zeros((40, 40, 1), np.uint8), "rgb", "expected shape"),
        (np.zeros((40, 40), np.uint8), "rgb", "expected shape"),
        (np.zeros((40, 40, 3), np.uint8), "gray", "expected shape"),
        (np.zeros((40, 40, 3), np.uint8), None, "color"),
        (np.zeros((40, 40, 3), np.uint8), "hsv", "color: expected gray, rgb, bgr, rgba or bgra"),
        (np.zeros((0, 40, 3), np.uint8), "rgb", "at least 1"),
        (np.zeros(40, np.uint8), "gray", "expected shape"),
        ([[1, 2], [3, 4]], "gray", "expected an array"),
        (None, "gray", "image: expected an image, found None: cv2.imread"),
        ("image.png", "gray", 'color: expected "rgb" or none for an image file'),
        (__file__, None, r"test_vision.py: image: expected a PNG"),
        (b"bytes", "gray", "image: expected an array .*bytes"),
        (np.zeros((40, 40), ">i4"), "gray", "image: expected an array .*int32"),
        # It has a mode, and is no image of Pillow.
        (open(__file__, "rb"), "bgr", "image: expected an array .*BufferedReader"),  # noqa: SIM115
    ],
)
def test_bad_images_are_named(estimator, image, color, words):
    with pytest.raises(ValueError, match=words):
        estimator.estimate(image, color=color)


def same(a, b) -> bool:
    """Whether two estimates are the same to the last bit."""
    return np.array_equal(a.dots, b.dots) and np.array_equal(a.pose.quaternion_wxyz, b.pose.quaternion_wxyz)


def test_all_that_an_image_may_be(image, estimator, tmp_path):
    """The same picture gives the same answer, whatever holds it; gray and color are pictures of their own."""
    cv2, pil = pytest.importorskip("cv2"), PIL.Image
    gray = np.ascontiguousarray(image[..., 1])
    alpha = np.random.default_rng(0).integers(0, 256, (*gray.shape, 1), dtype=np.uint8)
    color_file, gray_file, deep_file = (tmp_path / name for name in ("color.png", "gray.png", "deep.png"))
    deep = image.astype(np.uint16) * 251 + 7
    assert cv2.imwrite(str(color_file), image[..., ::-1]) and cv2.imwrite(str(gray_file), gray)
    assert cv2.imwrite(str(deep_file), deep[..., ::-1])
    in_color, in_gray = estimator.estimate(image, color="rgb"), estimator.estimate(gray)
    given = [
        (color_file, None), (str(color_file), "rgb"), (cv2.imread(str(color_file)), "bgr"),
        (pil.open(color_file), None), (pil.fromarray(image), "rgb"),
        (pil.fromarray(np.dstack([image, alpha])), None),
        (np.dstack([image, alpha]), "rgba"), (np.dstack([image[..., ::-1], alpha]), "bgra"),
        (image / 255.0, "rgb"), (image.astype(np.float32) / 255, "rgb"),
    ]
    for one, color in given:
        assert same(estimator.estimate(one, color=color), in_color)
    for one in (gray[..., None], pil.fromarray(gray), gray / 255.0, pil.fromarray(gray.astype(np.uint16) * 257)):
        assert same(estimator.estimate(one), in_gray)
    in_depth = estimator.estimate(deep, color="rgb")
    assert same(estimator.estimate(deep_file), in_depth)
    mapped = np.memmap(tmp_path / "mapped", np.uint16, "w+", shape=deep.shape)
    mapped[:] = deep
    for one in (deep.astype(">u2"), deep.astype("<u2"), mapped):
        assert same(estimator.estimate(one, color="rgb"), in_depth)
    assert same(estimator.estimate((image / 255.0).astype(">f8"), color="rgb"), in_color)
    together = estimator.estimate_sequence([color_file, pil.fromarray(image), str(color_file)])
    assert all(same(frame, in_color) for frame in together.frames)
    assert same(estimator.tracker().update(pil.fromarray(image), 0.0).frame, in_color)
    with pytest.raises(FileNotFoundError, match="none.png"):
        estimator.estimate(tmp_path / "none.png")
    for mode in ("P", "1", "CMYK", "F"):
        with pytest.raises(ValueError, match=f"image: expected a Pillow image of mode .*found {mode}: image.convert"):
            estimator.estimate(pil.fromarray(image).convert("L").convert(mode))
    with pytest.raises(ValueError, match='color: expected "rgb" or none for a Pillow image of mode RGB, found "bgr"'):
        estimator.estimate(pil.fromarray(image), color="bgr")


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 2**16), st.booleans())
def test_any_image_is_answered(estimator, height, width, seed, deep):
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 65536 if deep else 256, (height, width)).astype(
        np.uint16 if deep else np.uint8
    )
    found = estimator.estimate(image)
    assert found.pose or found.pose.reason


def test_bad_images_of_a_sequence_are_numbered(image, estimator):
    with pytest.raises(ValueError, match=r"images\[1\]"):
        estimator.estimate_sequence([image, image.astype(float)], color="rgb")
    with pytest.raises(ValueError, match=r"images\[1\]: expected an image, found None"):
        estimator.estimate_sequence([image, None], color="rgb")
    with pytest.raises(ValueError, match=r"images\[1\]: expected gray as the first image, found rgb"):
        estimator.estimate_sequence([image[..., 0], PIL.Image.fromarray(image)])
    for other in (None, "clip/", 3):
        with pytest.raises(ValueError, match="images: expected a sequence of images"):
            estimator.estimate_sequence(other, color="rgb")
    with pytest.raises(ValueError, match="times_s"):
        estimator.estimate_sequence([image, image], [0.0], color="rgb")
    with pytest.raises(ValueError, match="times_s"):
        estimator.estimate_sequence([image, image], [0.1, 0.0], color="rgb")
    with pytest.raises(ZeroDivisionError):
        estimator.estimate_sequence([image], color="rgb", progress=lambda *_: 1 // 0)


def test_cameras(table, clip):
    image, truth = clip[0]
    intrinsics = truth.everything["intrinsics"]
    k = [intrinsics[name] for name in ("fx", "fy", "cx", "cy")]
    matrix = np.array([[k[0], 0, k[2]], [0, k[1], k[3]], [0, 0, 1]])
    cameras = [
        spindoe.Camera.pinhole(*k),
        spindoe.Camera.at_distance(20.0),
        spindoe.Camera.unknown(),
        spindoe.Camera.parallel(),
    ]
    assert spindoe.Camera.from_matrix(matrix) == spindoe.Camera(matrix) == cameras[0]
    assert pickle.loads(pickle.dumps(cameras[0])) == cameras[0] and spindoe.Camera() == cameras[2]
    for camera in cameras:
        found = spindoe.Estimator(table, camera=camera).estimate(image, color="rgb")
        assert found.pose and _off(found.pose, truth) < 8.0
        assert (found.pose.distance is not None) == (camera.kind != "pinhole")
    sized = spindoe.Camera(matrix, size=(image.shape[1], image.shape[0]))
    assert spindoe.Estimator(table, camera=sized).estimate(image, color="rgb").pose
    small = sized.for_image(image.shape[1] * 2, image.shape[0] * 2)
    assert small.numbers[0] == pytest.approx(2 * k[0]) and small.numbers[2] == pytest.approx(2 * k[2] + 0.5)
    with pytest.raises(ValueError, match="for_image"):
        spindoe.Estimator(table, camera=small).estimate(image, color="rgb")
    with pytest.raises(ValueError, match="aspect"):
        sized.for_image(image.shape[1] * 2, image.shape[0])
    with pytest.raises(ValueError, match="size"):
        cameras[0].for_image(640, 480)
    for bad in (spindoe.Camera.at_distance(0.5), spindoe.Camera.pinhole(-1, 1, 0, 0)):
        with pytest.raises(ValueError):
            spindoe.Estimator(table, camera=bad)
    optical = Rotation.from_matrix(np.diag([1.0, -1, -1])) * found.pose.as_rotation()
    assert (found.pose.as_rotation("optical") * optical.inv()).magnitude() < 1e-12


@pytest.mark.parametrize("known", [False, True])
def test_frames_are_named_and_turned(clip, table, known):
    intrinsics = clip[0][1].everything["intrinsics"]
    k = [intrinsics[name] for name in ("fx", "fy", "cx", "cy")]
    camera = spindoe.Camera.pinhole(*k) if known else spindoe.Camera()
    images, truths = zip(*clip, strict=True)
    estimator = spindoe.Estimator(table, camera=camera)
    found = estimator.estimate_sequence(images, [t.time_s for t in truths], color="rgb")
    frame, optical = ("camera", "optical") if known else ("view", "optical_view")
    turn = np.diag([1.0, -1.0, -1.0])
    assert found.spin and found.frame == found.spin.frame == frame
    spin = found.spin.as_frame("optical")
    assert spin.frame == optical and np.allclose(spin.spin_rad_s, turn @ found.spin.spin_rad_s)
    assert np.allclose(spin.covariance, turn @ found.spin.covariance @ turn)
    assert len(spin.aliases) == len(found.spin.aliases)
    for one, other in zip(spin.aliases, found.spin.aliases, strict=True):
        assert np.allclose(one.spin_rad_s, turn @ other.spin_rad_s)
    back = spin.as_frame("camera")
    assert back.frame == frame and np.allclose(back.spin_rad_s, found.spin.spin_rad_s)
    expected = Rotation.from_matrix(turn) * found.spin.as_rotation(0.01)
    assert (spin.as_rotation(0.01) * expected.inv()).magnitude() < 1e-9
    pose = next(f.pose for f in found.frames if f.pose)
    seen = pose.as_frame("optical")
    assert pose.frame == frame and seen.frame == optical and seen.confidence == pose.confidence
    assert np.allclose(seen.covariance, turn @ pose.covariance @ turn)
    with pytest.raises(ValueError, match="frame: expected camera or optical"):
        pose.as_frame("view")


LENSES = [
    ([-0.28, 0.09, 0.0012, -0.0001], False),
    ([-0.28, 0.09, 0.0012, -0.0001, -0.01], False),
    ([0.4, 0.1, 0.001, -0.002, 0.03, 0.5, 0.2, 0.01], False),
    ([-0.1, 0.02, 0.001, 0.0, 0.0, 0.01, 0.0, 0.0, 2e-3, 1e-3, -1e-3, 5e-4], False),
    ([-0.02, 0.004, -0.002, 0.0004], True),
]


@pytest.mark.parametrize(("distortion", "fisheye"), LENSES)
def test_points_are_projected_as_opencv_does(distortion, fisheye):
    cv2 = pytest.importorskip("cv2")
    k = np.array([[820.0, 0.0 if not fisheye else 0.7, 655.5], [0.0, 810.0, 500.25], [0.0, 0.0, 1.0]])
    camera = spindoe.Camera(k, distortion, fisheye=fisheye)
    points = np.random.default_rng(3).uniform([-0.6, -0.5, 1.0], [0.6, 0.5, 3.0], (200, 3))
    if fisheye:
        # OpenCV's alpha is the skew over fx.
        skew = k[0, 1] / k[0, 0]
        seen, _ = cv2.fisheye.projectPoints(
            points[:, None], np.zeros(3), np.zeros(3), np.diag(np.diag(k)) + k * [[0, 0, 1]], np.array(distortion), alpha=skew
        )
    else:
        seen, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), k, np.array(distortion))
    assert np.abs(camera.project(points) - seen[:, 0]).max() < 1e-9
    view = camera.view((300.0, 200.0, 40.0))
    pixels = np.array([[300.0, 200.0], [320.0, 190.0]])
    directions, _ = view.back_project(pixels)
    assert np.allclose(view.project(directions), pixels, atol=1e-9)


def test_intrinsics_are_those_of_files(tmp_path):
    path = tmp_path / "camera.yaml"
    k, distortion = np.array([[820.0, 0.0, 655.5], [0.0, 810.0, 500.25], [0.0, 0.0, 1.0]]), [-0.2, 0.1, 0.001, 0.002, 0.0]
    expected = spindoe.Camera(k, distortion)
    data = ", ".join(map(str, k.ravel()))
    path.write_text(f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: [{data}]\ndistortion_coefficients: {distortion}\n")
    points = np.array([[0.1, 0.2, 1.0]])
    assert np.array_equal(spindoe.Camera.read(path).project(points), expected.project(points))
    cv2 = pytest.importorskip("cv2")
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", k)
    storage.write("distortion_coefficients", np.array(distortion))
    storage.release()
    assert np.array_equal(spindoe.Camera.read(path).project(points), expected.project(points))
    with pytest.raises(ValueError, match="transposed"):
        spindoe.Camera(k.T)
    with pytest.raises(ValueError, match="found 3"):
        spindoe.Camera(k, [0.1, 0.2, 0.3])
    with pytest.raises(ValueError, match="matrix"):
        spindoe.Camera(distortion=distortion)


def test_pixels_and_directions_are_inverse():
    for camera in (spindoe.Camera.at_distance(12.0), spindoe.Camera.pinhole(900, 910, 320, 240)):
        view = camera.view((350.0, 200.0, 40.0))
        pixels = np.array([[350.0, 200.0], [370.0, 190.0], [330.0, 225.0], [500.0, 200.0]])
        directions, covariances = view.back_project(pixels, sigma_px=0.5)
        assert np.all(np.isnan(directions[3])) and np.allclose(np.linalg.norm(directions[:3], axis=1), 1)
        assert np.allclose(view.project(directions[:3]), pixels[:3], atol=1e-9)
        # The covariance lies in the tangent plane, and is what the projection's derivative says.
        assert np.allclose(np.einsum("nij,nj->ni", covariances[:3], directions[:3]), 0, atol=1e-15)
        assert 0 < view.horizon < 0.2 and view.as_rotation().magnitude() < 0.3
    with pytest.raises(ValueError, match="known"):
        spindoe.Camera.unknown().view((0, 0, 1))


def test_estimators_pickle(image, table):
    estimator = spindoe.Estimator(table, camera=spindoe.Camera.at_distance(20.0), min_confidence=0.7)
    again = pickle.loads(pickle.dumps(estimator))
    assert again.settings == estimator.settings and again.settings["min_confidence"] == 0.7
    a, b = estimator.estimate(image, color="rgb"), again.estimate(image, color="rgb")
    assert np.array_equal(a.dots, b.dots)
    c = pickle.loads(pickle.dumps(a))
    assert repr(c) == repr(a) and np.array_equal(c.pose.covariance, a.pose.covariance)
    with pytest.raises(ValueError, match="no such setting"):
        spindoe.Estimator(table, min_confidenc=0.7)
    with pytest.raises(TypeError, match="Tracker: cannot be pickled.*pickle its estimator"):
        pickle.dumps(estimator.tracker())


def test_synth_is_seeded(pattern):
    a, b = (next(spindoe.synth(pattern, 1, seed=7)) for _ in range(2))
    assert np.array_equal(a[0], b[0]) and a[1].everything == b[1].everything
    assert not np.array_equal(next(spindoe.synth(pattern, 1, seed=8))[0].shape, (0, 0, 3))
    truth = a[1]
    seen = truth.as_rotation().apply(pattern.dots)
    assert np.all(seen[truth.indices[truth.visible], 2] > -0.05)
    with pytest.raises(ValueError, match="frames"):
        spindoe.synth(pattern, fps=100.0)
    with pytest.raises(ValueError, match="fps"):
        spindoe.synth(pattern, 3, spin_rad_s=(1, 2, 3))
    with pytest.raises(ValueError, match="no such setting"):
        next(spindoe.synth(pattern, 1, ball_pixels=3))
