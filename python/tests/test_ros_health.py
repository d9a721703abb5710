"""What the diagnostics say of missed frames, by stamps whose truth is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from spindoe_ros import health

FPS = 60


def answer(ns):
    stamp = SimpleNamespace(sec=ns // 10**9, nanosec=ns % 10**9)
    found = SimpleNamespace(reason="", inliers=5)
    return SimpleNamespace(
        frame_id="camera", frame=SimpleNamespace(circle=(9.0, 9.0, 5.0)), pose=found, spin=found, stamp=stamp
    )


def reports(times_s, seconds_each=0.002):
    """One for each second of the images of these times."""
    counted, said = health.Health(), []
    for second in range(int(times_s[-1]) + 1):
        for time_s in times_s[(times_s >= second) & (times_s < second + 1)]:
            counted.take(answer(round(1e9 * (100.0 + time_s))), seconds_each, 0.01)
        said.append(counted.report(1.0, ""))
    return said


def regular(seconds):
    return (np.arange(seconds * FPS) + 0.5) / FPS


@pytest.mark.parametrize("shape", ["normal", "uniform"])
@pytest.mark.parametrize("jitter_ms", [2.0, 4.0, 6.0])
def test_jitter_is_no_missed_frame(jitter_ms, shape):
    rng = np.random.default_rng(7)
    times = regular(20)
    off = rng.normal(size=len(times)) if shape == "normal" else rng.uniform(-1.0, 1.0, len(times))
    for report in reports(np.sort(times + 1e-3 * jitter_ms * off)):
        assert report.verdict == "fine" and report.values["missed frames"] in ("", "0")


def test_frames_that_come_late_are_not_missed():
    """As over a network: one in ten is 10 ms late, and the next is in time."""
    times = regular(10)
    times[::10] += 0.010
    for report in reports(times):
        assert report.verdict == "fine" and report.values["missed frames"] == "0"


@pytest.mark.parametrize("jitter_ms", [0.0, 0.5, 1.0])
def test_frames_that_are_missed_are_counted(jitter_ms):
    rng = np.random.default_rng(8)
    times = regular(20) + 1e-3 * jitter_ms * rng.uniform(-1.0, 1.0, 20 * FPS)
    # One in seven, one by one and two in a row.
    is_missed = np.isin(np.arange(len(times)) % 28, [5, 12, 20, 21])
    said = reports(times[~is_missed])
    counts = np.array([int(report.values["missed frames"]) for report in said])
    truth = np.bincount(times[is_missed].astype(int), minlength=20)
    # A gap counts where its next image has come; the medians of jittered steps are not quite the period.
    assert abs(counts.sum() - truth.sum()) <= (1 if jitter_ms == 0.0 else 0.1 * truth.sum())
    assert np.all(np.abs(counts - truth) <= 2)
    seen = np.sum(times[~is_missed] >= 19.0)
    words = f"frames are missed: at least {counts[-1]} of {seen + counts[-1]}, with 2 ms for an image"
    assert said[-1].level == health.WARN and said[-1].message == words


def test_a_node_that_is_busy_says_what_it_knows():
    """It takes every image that it can, so that the steps are regular: none is known to be missed."""
    (report,) = reports(regular(1)[::3], seconds_each=0.048)
    assert report.level == health.WARN and report.values["missed frames"] == "0"
    assert report.message == "frames may be missed: images take 96 % of the time, with 48 ms for an image"


def test_of_one_image_nothing_is_known():
    (report,) = reports(regular(1)[:1])
    assert report.verdict == "fine" and report.values["missed frames"] == ""
