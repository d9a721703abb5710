"""The live view: what is drawn is where it should be; sources keep their times; frames are dropped only when asked."""

from __future__ import annotations

import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import spindoe
from spindoe import live

cv2 = pytest.importorskip("cv2")
SPIN = (40.0, 150.0, -60.0)


@pytest.fixture(scope="module")
def clip(pattern):
    return list(spindoe.synth(pattern, 12, seed=4, fps=350.0, spin_rad_s=SPIN, ball_px=[100, 100]))


@pytest.fixture(scope="module")
def camera(clip):
    known = clip[0][1].everything["intrinsics"]
    return spindoe.Camera.pinhole(*(known[name] for name in ("fx", "fy", "cx", "cy")))


@pytest.fixture(scope="module")
def last(clip, table, camera):
    """The last frame's image, state and truth."""
    tracker = spindoe.Estimator(table, camera=camera).tracker()
    for image, truth in clip:
        state = tracker.update(image, truth.time_s, color="rgb")
    assert state.spin and state.frame.pose
    return image, state, truth


@pytest.fixture
def folder(clip, tmp_path):
    path = tmp_path / "clip"
    path.mkdir()
    for image, truth in clip:
        # The 10th frame's name is longer than the 9th's: in order of time, not of letters.
        cv2.imwrite(str(path / f"{round((truth.time_s - 999.98) * 1e9)}.png"), image[..., ::-1])
    return path


def _at(color, drawn):
    """Pixels u, v of a color, on black, also where its edge is smooth."""
    levels, color = drawn.astype(float), np.array(color, float)
    share = levels @ color / (color @ color)
    rows, columns = np.nonzero((share > 0.3) & (np.abs(levels - share[..., None] * color).max(axis=2) < 6.0))
    return np.stack([columns, rows], axis=1).astype(float)


def _nearest(points, to):
    return np.linalg.norm(points[None] - np.atleast_2d(to)[:, None], axis=2).min(axis=1)


def test_what_is_drawn_is_where_it_is(last, table, camera):
    """Crosses stand where OpenCV projects the dots of the sphere at the true place and orientation."""
    image, state, truth = last
    blank = np.zeros_like(image)
    scale = 4
    drawn = live.draw(blank, state, table=table, camera=camera, color="rgb", scale=scale)
    height, width = image.shape[:2]
    assert drawn.dtype == np.uint8 and drawn.shape == (scale * height + 72, scale * width, 3)
    assert not blank.any()
    picture = drawn[: scale * height]

    fx, fy, cx, cy = camera.numbers[:4]
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    # The sphere's center, in radii, from the true outline; OpenCV's camera looks along +z, y down.
    u, v, radius = truth.circle
    ray = np.array([(u - cx) / fx, (v - cy) / fy, 1.0])
    center = ray / np.linalg.norm(ray) / np.sin(np.arctan(radius / fx))
    flip = np.diag([1.0, -1.0, -1.0])
    dots = truth.as_rotation().apply(table.pattern.dots) @ flip
    facing = np.einsum("ij,ij->i", center + dots, dots) < -0.1 * np.linalg.norm(center)
    pixels = cv2.projectPoints(center + dots[facing], np.zeros(3), np.zeros(3), matrix, None)[0][:, 0]
    crosses = _at(live.EXPECTED, picture)
    assert facing.sum() >= 5
    assert _nearest(crosses, scale * (pixels + 0.5) - 0.5).max() < scale * 2.5
    hidden = cv2.projectPoints(center - dots[facing], np.zeros(3), np.zeros(3), matrix, None)[0][:, 0]
    assert np.median(_nearest(crosses, scale * (hidden + 0.5) - 0.5)) > scale * 5

    # The outline is a ring of that radius; each detection has a ring, in the color of its kind.
    ring = np.linalg.norm(_at(live.OUTLINE, picture) - (scale * (np.array([u, v]) + 0.5) - 0.5), axis=1)
    assert len(ring) > 300 and abs(np.median(ring) - scale * radius) < scale * 2.0
    for (x, y, _), number in zip(state.frame.dots, state.frame.assignment, strict=True):
        of_kind = _at(live.IDENTIFIED if number >= 0 else live.OTHER, picture)
        assert np.median(np.sort(np.linalg.norm(of_kind - (scale * (np.array([x, y]) + 0.5) - 0.5), axis=1))[:12]) < 9


def test_axes_and_the_arrow_follow_the_orientation(last, table, camera):
    image, state, truth = last
    drawn = live.draw(np.zeros_like(image), state, table=table, camera=camera, color="rgb", scale=4)
    u, v, radius = state.frame.circle
    turned = truth.as_rotation().as_matrix()
    for axis, color in enumerate(live.AXES):
        tip = 4 * (np.array([u, v]) + 0.5 + 0.6 * radius * turned[:2, axis] * [1, -1])
        assert _nearest(_at(color, drawn), tip).min() < 4 * 0.08 * radius
    spin = np.array(SPIN) / np.linalg.norm(SPIN)
    tip = 4 * (np.array([u, v]) + 0.5 + 1.1 * radius * spin[:2] * [1, -1])
    assert _nearest(_at(live.SPIN, drawn), tip).min() < 4 * 0.15 * radius


def test_a_frame_without_a_ball_says_why(estimator, table):
    gray = np.full((90, 120), 90, np.uint8)
    state = estimator.tracker().update(gray, 0.0)
    drawn = live.draw(gray, state, table=table, latency_s=0.002, dropped=3)
    assert drawn.shape == (4 * 90 + 72, 4 * 120, 3)
    assert (drawn[: 4 * 90] == 90).all() and drawn[4 * 90 :].any()
    other = live.draw(gray, state, table=table, latency_s=0.002, dropped=4)
    assert (other != drawn).any() and (other[: 4 * 90] == 90).all()
    assert live.draw(np.zeros((500, 400), np.uint8), state, table=table).shape == (572, 400, 3)
    with pytest.raises(ValueError, match="scale"):
        live.draw(gray, state, table=table, scale=0)


def test_another_cameras_frame_is_refused(last, estimator, table, camera):
    image, state, _ = last
    with pytest.raises(ValueError, match="camera: .* known"):
        live.draw(image, state, table=table, color="rgb")
    own = estimator.tracker().update(image, 0.0, color="rgb")
    with pytest.raises(ValueError, match="camera: .* unknown"):
        live.draw(image, own, table=table, camera=camera, color="rgb")


def test_colors_of_the_image_are_kept(last, table):
    image, state, _ = last
    image = image.copy()
    image[0] = (200, 100, 10)
    bgr = np.ascontiguousarray(image[..., ::-1])
    a = live.draw(image, state, table=table, camera=spindoe.Camera.pinhole(900, 900, 60, 60), color="rgb")
    b = live.draw(bgr, state, table=table, camera=spindoe.Camera.pinhole(900, 900, 60, 60), color="bgr")
    assert np.array_equal(a, b) and tuple(a[0, 0]) == (10, 100, 200)


def test_a_folder_is_played_at_its_times(folder, estimator, clip):
    begun = time.monotonic()
    followed = list(live.follow(folder, estimator.tracker()))
    assert time.monotonic() - begun >= 11 / 350
    times = [truth.time_s - 999.98 for _, truth in clip]
    assert [frame.state.time_s for frame in followed] == pytest.approx(times, abs=1e-8)
    for frame, (image, _) in zip(followed, clip, strict=True):
        assert np.array_equal(frame.image, image[..., ::-1])
        assert frame.dropped == 0 and 0 < frame.latency_s < 5.0
    spin = followed[-1].state.spin
    assert spin and np.linalg.norm(spin.spin_rad_s - SPIN) < 12.0
    again = list(live.follow(folder, estimator.tracker(), fps=175.0))
    assert [frame.state.time_s for frame in again] == pytest.approx(np.arange(12) / 175.0)


def test_a_video_has_its_own_times(clip, estimator, tmp_path):
    path = tmp_path / "clip.avi"
    height, width = clip[0][0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 50.0, (width, height))
    for image, _ in clip[:6]:
        writer.write(image[..., ::-1])
    writer.release()
    followed = list(live.follow(path, estimator.tracker()))
    assert [frame.state.time_s for frame in followed] == pytest.approx(np.arange(6) / 50.0, abs=1e-3)
    # As the command reads it: the ball is found in each.
    assert all(frame.state.frame.pose for frame in followed)
    assert len(list(live.follow(str(path), estimator.tracker(), fps=350.0))) == 6


def test_frames_that_come_too_fast_are_dropped_and_counted(clip, estimator):
    """One frame is held back until all others have come: what is worked on next is the last."""
    all_came = threading.Event()

    def frames():
        for k, (image, truth) in enumerate(clip):
            yield image, truth.time_s
            if k == 0:
                first_taken.wait(10)
        all_came.set()

    first_taken = threading.Event()
    followed = live.follow(frames(), estimator.tracker(), color="rgb", drop=True)
    first = next(followed)
    first_taken.set()
    assert all_came.wait(10)
    rest = list(followed)
    assert first.dropped == 0 and [frame.state.time_s for frame in rest] == [clip[-1][1].time_s]
    assert rest[0].dropped == 10
    every = list(live.follow(((i, t.time_s) for i, t in clip), estimator.tracker(), color="rgb"))
    assert len(every) == 12 and every[-1].dropped == 0


def test_what_a_source_raises_is_raised(clip, estimator):
    def frames():
        yield clip[0][0], 0.0
        raise OSError("the cable is out")

    for drop in (False, True):
        with pytest.raises(OSError, match="the cable is out"):
            list(live.follow(frames(), estimator.tracker(), color="rgb", drop=drop))


def test_a_reader_ends_with_its_consumer(clip, estimator):
    closed = threading.Event()

    def frames():
        try:
            for k in range(10**9):
                yield clip[0][0], float(k)
        finally:
            closed.set()

    followed = live.follow(frames(), estimator.tracker(), color="rgb", drop=True)
    next(followed)
    followed.close()
    assert closed.wait(10)


@pytest.mark.parametrize("drop", [False, True])
def test_a_source_is_free_while_an_error_lives(clip, estimator, drop):
    """The tracker refuses the second frame: its time is that of the first."""
    closed = threading.Event()

    def frames():
        try:
            for _ in range(10**9):
                yield clip[0][0], 0.0
        finally:
            closed.set()

    with pytest.raises(ValueError, match="time_s") as raised:
        list(live.follow(frames(), estimator.tracker(), color="rgb", drop=drop))
    assert closed.wait(10) and raised.tb


@pytest.mark.parametrize("drop", [False, True])
def test_a_camera_is_free_while_an_error_lives(clip, estimator, monkeypatch, drop):
    released = threading.Event()

    class Capture:
        def __init__(self, index):
            assert index == 3

        def isOpened(self):  # noqa: N802 (OpenCV's name)
            return True

        def read(self):
            return True, clip[0][0]

        def release(self):
            released.set()

    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    tracker = estimator.tracker()
    tracker.update(clip[0][0], 1e12, color="rgb")
    with pytest.raises(ValueError, match="time_s") as raised:
        live.show(3, tracker, drop=drop, window=False)
    assert released.wait(10) and raised.tb


@pytest.mark.parametrize("name", ["seen.avi", "seen.mp4"])
def test_a_recording_is_there_whole_or_not_at_all(clip, estimator, tmp_path, name):
    video = tmp_path / name

    def source(end, size=slice(None)):
        for image, truth in clip[:3]:
            yield image, truth.time_s
        if end is not None:
            raise end
        yield np.ascontiguousarray(clip[3][0][size]), clip[3][1].time_s

    def record(frames):
        return live.show(frames, estimator.tracker(), color="rgb", record=video, window=False)

    for frames, error in [
        (source(None, np.s_[:-9, :-9]), "record: expected frames of one size"),
        (source(ValueError("bad pixels")), "bad pixels"),
        (source(RuntimeError("a fault")), "a fault"),
    ]:
        with pytest.raises((ValueError, RuntimeError), match=error):
            record(frames)
        assert list(tmp_path.iterdir()) == []
    # What was seen until the user or the system ended it is kept.
    for end in (KeyboardInterrupt(), OSError("the cable is out")):
        with pytest.raises(type(end)):
            record(source(end))
        assert [file.name for file in tmp_path.iterdir()] == [name]
        assert cv2.VideoCapture(str(video)).get(cv2.CAP_PROP_FRAME_COUNT) == 3
    before = video.read_bytes()
    with pytest.raises(ValueError, match="one size"):
        record(source(None, np.s_[:-9, :-9]))
    assert video.read_bytes() == before and len(list(tmp_path.iterdir())) == 1
    assert record(source(None)) == 4
    assert cv2.VideoCapture(str(video)).get(cv2.CAP_PROP_FRAME_COUNT) == 4
    with pytest.raises(OSError, match="nowhere.*cannot be written as a video"):
        live.show(source(None), estimator.tracker(), color="rgb", record=tmp_path / "nowhere" / name, window=False)


def test_sources_that_are_none(estimator, tmp_path):
    tracker = estimator.tracker()
    for source, given, words in [
        (tmp_path / "nowhere.mp4", {}, "nowhere.mp4: expected a video or a folder"),
        (tmp_path, {}, "expected images"),
        (tmp_path, {"color": "rgb"}, "color"),
        (tmp_path, {"fps": 0.0}, "fps"),
        (0, {"fps": 30.0}, "fps"),
        ([], {"fps": 30.0}, "fps"),
    ]:
        with pytest.raises(ValueError, match=words):
            list(live.follow(source, tracker, **given))
    (tmp_path / "a.png").write_bytes(b"no image")
    with pytest.raises(ValueError, match=r"a\.png: expected fps"):
        list(live.follow(tmp_path, tracker))
    with pytest.raises(ValueError, match=r"a\.png: cannot be read"):
        list(live.follow(tmp_path, tracker, fps=10.0))
    with pytest.raises(ValueError, match="found an image"):
        list(live.follow(tmp_path / "a.png", tracker))
    (tmp_path / "a.avi").write_bytes(b"no video")
    with pytest.raises(OSError, match=r"a\.avi: cannot be read as a video"):
        list(live.follow(tmp_path / "a.avi", tracker))
    with pytest.raises(OSError, match="camera 99"):
        list(live.follow(99, tracker))


def test_the_command_records_what_it_draws(folder, root, tmp_path):
    video = tmp_path / "seen.avi"
    table = root / "designs/dots20/table.npz"
    words = [sys.executable, "-m", "spindoe.live", "--table", table, folder, "--no-window", "--record", video]
    done = subprocess.run(list(map(str, words)), capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "12 frames\n"), done.stderr
    capture = cv2.VideoCapture(str(video))
    shown = [capture.read()[1] for _ in range(12)]
    assert not capture.read()[0]
    # The outline is green in gray.
    green = (shown[-1][..., 1].astype(int) - shown[-1][..., 2] > 100).sum()
    assert green > 200


def test_without_windows_one_line_says_what_to_install(folder, root, estimator, monkeypatch):
    monkeypatch.setattr(cv2, "getBuildInformation", lambda: "  GUI:                           NONE\n")
    words = r"^window: .*opencv-python-headless.*pip install spindoe\[live\]$"
    with pytest.raises(ValueError, match=words):
        live.show(folder, estimator.tracker())
    monkeypatch.setattr(cv2, "getBuildInformation", lambda: "  GUI:                           QT5\n")
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(OSError, match="no screen"):
        live.show(folder, estimator.tracker())
    assert live.main(["--table", str(root / "designs/dots20/table.npz"), str(folder)]) == 1
    with pytest.raises(ValueError, match=r"record: .*\.mp4"):
        live.show(folder, estimator.tracker(), record="seen.gif", window=False)
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ValueError, match=r"^cv2: .*pip install spindoe\[live\]$"):
        live.show(folder, estimator.tracker())


def test_a_window_shows_every_frame_until_a_key(clip, estimator, monkeypatch):
    """With a stand-in for the window's functions, which the tests' OpenCV lacks."""
    shown = []
    monkeypatch.setattr(cv2, "getBuildInformation", lambda: "  GUI:                           QT5\n")
    monkeypatch.setenv("DISPLAY", ":7")
    monkeypatch.setattr(cv2, "namedWindow", lambda *_: None)
    monkeypatch.setattr(cv2, "imshow", lambda _, image: shown.append(image))
    monkeypatch.setattr(cv2, "waitKey", lambda _: ord("q") if len(shown) == 3 else -1)
    monkeypatch.setattr(cv2, "getWindowProperty", lambda *_: 1.0)
    monkeypatch.setattr(cv2, "destroyAllWindows", lambda: shown.append(None))
    frames = ((image, truth.time_s) for image, truth in clip)
    assert live.show(frames, estimator.tracker(), color="rgb") == 3
    assert len(shown) == 4 and shown[-1] is None and shown[0].shape[2] == 3
