"""What crosses Python's border: forks, Ctrl-C, limits, pickles, and one clear line for what is no input."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import textwrap
import time
import warnings

import numpy as np
import pytest

import spindoe

EASY = {"ball_px": [100, 100], "camera_distance_radii": [20, 20]}
# Seconds within which Ctrl-C raises.
PROMISED = 0.5

PREPARED = """
import multiprocessing, os, signal, sys, threading, time
import numpy as np, spindoe
pattern = spindoe.Pattern.shipped("dots20")
# A process that runs in the background is born deaf to it.
signal.signal(signal.SIGINT, signal.default_int_handler)
"""
TURNING = """
times = np.arange(12) / 100.0
angles = 30.0 * times
quaternions = np.stack([np.cos(angles / 2), 0 * angles, 0 * angles, np.sin(angles / 2)], axis=1)
"""
CLIP = """
frames = list(spindoe.synth(pattern, 8, seed=4, fps=350.0, ball_px=[100, 100], camera_distance_radii=[20, 20]))
images, times = [image for image, _ in frames], [truth.time_s for _, truth in frames]
estimator = spindoe.Estimator(pattern)
"""


def _script(text: str) -> list[str]:
    return [sys.executable, "-W", "ignore", "-c", textwrap.dedent(PREPARED) + textwrap.dedent(text)]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="fork")
@pytest.mark.parametrize(
    ("prepared", "work"),
    [
        (TURNING, "spindoe.fit_spin(times, quaternions)"),
        (TURNING, "spindoe.fit_spin(times, quaternions, model='precessing')"),
        (CLIP, "estimator.estimate_sequence(images, times, color='rgb')"),
        (CLIP, "estimator.estimate(images[0], color='rgb')"),
        (CLIP, "estimator.tracker().update(images[0], 0.0, color='rgb')"),
        (CLIP, "spindoe.Balls(estimator).estimate_sequence(images[:4], times[:4], color='rgb')"),
        ("", "spindoe.Recognizer(pattern).identify_batch([pattern.dots[pattern.dots[:, 2] > 0.2]] * 100)"),
        ("", "spindoe.validate(pattern, samples=200)"),
        ("", "spindoe.Stencil(pattern)"),
    ],
)
def test_a_forked_process_works(prepared, work):
    text = f"""
{prepared}
def work(_=None):
    {work}
    return 7
work()
with multiprocessing.get_context("fork").Pool(2) as pool:
    assert pool.map(work, range(2)) == [7, 7]
"""
    done = subprocess.run(_script(text), timeout=100, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.skipif(os.name != "posix", reason="signals")
@pytest.mark.parametrize(
    ("prepared", "work"),
    # Each would go on for many times as long, however fast the machine is and however fast the work has become.
    [
        ("black = [np.zeros((1080, 1920, 3), np.uint8)] * 2000\nestimator = spindoe.Estimator(pattern)",
         "estimator.estimate_sequence(black, color='rgb')"),
        ("black = np.zeros((2160, 3840, 3), np.uint8)\nestimator = spindoe.Estimator(pattern)",
         "[estimator.estimate(black, color='rgb') for _ in range(2000)]"),
        ("black = [np.zeros((1080, 1920, 3), np.uint8)] * 2000\nballs = spindoe.Balls(spindoe.Estimator(pattern))",
         "balls.estimate_sequence(black, np.arange(2000) / 100.0, color='rgb')"),
        ("rng = np.random.default_rng(1)\ndots = rng.normal(size=(5_000 * 200, 3))\ndots[:, 2] = abs(dots[:, 2])\n"
         "dots /= np.linalg.norm(dots, axis=1)[:, None]\nrecognizer = spindoe.Recognizer(pattern)",
         "recognizer.identify_batch(dots, np.arange(0, 5_000 * 200 + 1, 200))"),
        ("", "spindoe.validate(pattern, 'clutter', recognizer='voting', samples=5_000_000)"),
        ("", "[spindoe.Stencil(pattern) for _ in range(2000)]"),
        ("import tempfile\nfolder = tempfile.mkdtemp()", "spindoe.Design(folder + '/d', dots=64, starts=500).run()"),
        ("import tempfile\nfolder = tempfile.mkdtemp()",
         "spindoe.Design(folder + '/d', dots=8, starts=1, rounds=1, samples=2_000_000).run()"),
        ("frames = list(spindoe.synth(pattern, 40, seed=4, fps=60.0, spin_rad_s=(3.0, 5.0, 2.0), ball_px=[80, 80]))\n"
         "images, times = [image for image, _ in frames], [truth.time_s for _, truth in frames]\n"
         "estimator = spindoe.Estimator(pattern)",
         "[estimator.calibrate(images, times, color='rgb', evaluate=2_000_000) for _ in range(2000)]"),
    ],
)
def test_ctrl_c_raises_within_half_a_second(prepared, work):
    text = f"""
{prepared}
def interrupt():
    time.sleep(1.0)
    print("sent", time.monotonic(), flush=True)
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=interrupt, daemon=True).start()
try:
    {work}
    print("whole", time.monotonic(), flush=True)
except KeyboardInterrupt:
    print("raised", time.monotonic(), flush=True)
os._exit(0)
"""
    done = subprocess.run(_script(text), timeout=100, check=False, capture_output=True, text=True)
    words = done.stdout.split()
    assert words[0] == "sent" and words[2] == "raised", done.stdout + done.stderr
    assert float(words[3]) - float(words[1]) < PROMISED, done.stdout


def test_frames_have_256_dots_at_most(recognizer):
    rng = np.random.default_rng(5)
    dots = rng.normal(size=(20_000, 3))
    dots /= np.linalg.norm(dots, axis=1)[:, None]
    begun = time.monotonic()
    for count in (257, 20_000):
        with pytest.raises(ValueError, match=f"^dots: expected at most 256 dots in a frame, found {count}$"):
            recognizer.identify(dots[:count])
        with pytest.raises(ValueError, match=rf"^frames\[1\]: expected at most 256 dots in a frame, found {count}$"):
            recognizer.identify_batch([dots[:10], dots[:count]])
    assert time.monotonic() - begun < 5.0
    recognizer.identify(dots[:256])


def test_balls_can_be_pickled(estimator, pattern):
    balls = pickle.loads(pickle.dumps(spindoe.Balls(estimator, count=1)))
    assert balls.count == 1 and len(balls.estimators) == 1
    image, _ = next(iter(spindoe.synth(pattern, 1, seed=2, **EASY)))
    ours, theirs = (one.estimate(image, color="rgb") for one in (spindoe.Balls(estimator, count=1), balls))
    assert len(ours) == len(theirs) == 1 and ours[0].frame.circle == theirs[0].frame.circle


def test_settings_may_be_given_in_part(table):
    usual = spindoe.Estimator(table).settings
    found = spindoe.Estimator(table, circle={"min_radius_px": 5.0}, recognizer={"passes": 32}).settings
    assert found["circle"] == {**usual["circle"], "min_radius_px": 5.0}
    assert found["recognizer"] == {**usual["recognizer"], "passes": 32}
    with pytest.raises(ValueError, match="^circle.min_radius: no such setting, expected one of .*min_radius_px"):
        spindoe.Estimator(table, circle={"min_radius": 5.0})  # type: ignore[typeddict-unknown-key]
    with pytest.raises(ValueError, match=r"^circle\.min_radius_px: expected a finite number, found nan$"):
        spindoe.Estimator(table, circle={"min_radius_px": float("nan")})


def test_a_camera_may_be_its_matrix(table):
    k = np.array([[650.0, 0.0, 320.5], [0.0, 640.0, 240.25], [0.0, 0.0, 1.0]])
    assert spindoe.Estimator(table, camera=k).camera == spindoe.Camera(k)
    with pytest.raises(ValueError, match=r"^camera: expected a spindoe.Camera or a matrix of shape \(3, 3\)"):
        spindoe.Estimator(table, camera=np.eye(4))
    with pytest.raises(ValueError, match=r"^camera: expected a spindoe.Camera or a matrix"):
        spindoe.Estimator(table, camera="camera.yaml")  # type: ignore[arg-type]


def test_frames_of_another_size_than_the_intrinsics_are_refused(table):
    k = np.array([[650.0, 0.0, 320.5], [0.0, 640.0, 240.25], [0.0, 0.0, 1.0]])
    estimator = spindoe.Estimator(table, camera=spindoe.Camera(k, size=(640, 480)))
    frames = [np.zeros((240, 320), np.uint8)] * 2
    for work in (
        lambda: estimator.estimate_sequence(frames),
        lambda: estimator.calibrate(frames),
        lambda: spindoe.Balls(estimator).estimate(frames[0]),
        lambda: spindoe.Balls(estimator).estimate_sequence(frames, [0.0, 1.0]),
    ):
        with pytest.raises(ValueError, match="640 x 480 pixels, which the camera's intrinsics are of, found 320 x 240"):
            work()


def test_intrinsics_that_look_like_those_of_other_images_warn(table):
    estimator = spindoe.Estimator(table, camera=spindoe.Camera.pinhole(650.0, 640.0, 319.5, 239.5))
    small = np.zeros((240, 320), np.uint8)
    for work in (
        lambda: estimator.estimate(small),
        lambda: estimator.estimate_sequence([small, small]),
        lambda: spindoe.Balls(estimator).estimate(small),
    ):
        with pytest.warns(UserWarning, match="middle of images of 640 x 480, these have 320 x 240") as heard:
            work()
        assert heard[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        estimator.estimate(np.zeros((480, 640), np.uint8))


def test_what_is_no_input_is_refused_in_a_line(estimator, recognizer, table):
    with pytest.raises(ValueError, match="^window: expected a whole number from 1 on, found -1$"):
        estimator.tracker(window=-1)
    with pytest.raises(ValueError, match="^max_latency_s: expected a positive number of seconds, found -1$"):
        estimator.tracker(max_latency_s=-1)
    with pytest.raises(ValueError, match="^dot_probability: expected a finite number, found nan$"):
        spindoe.Estimator(table, dot_probability=[float("nan"), 0.1])
    found = recognizer.identify([])
    assert not found and found.reason
    with pytest.raises(ValueError, match="^max_rivals: expected a whole number from 0 on, found -1$"):
        recognizer.identify([], max_rivals=-1)
