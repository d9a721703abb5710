"""Measures what the package costs beyond the library: time per call, batches, images, memory.

    python python/tools/measure.py designs/dots20/table.npz [--calls 100000]

Times of identifications are processor time, the least of several passes. The library's own part of a call
is what a frame takes in a batch of the same views; of a frame's estimate, `FrameEstimate.seconds`.
"""

from __future__ import annotations

import argparse
import gc
import itertools
import time

import numpy as np

import spindoe
from spindoe import _native

REPEATS = 7


def resident_mb() -> float:
    """Memory of this process."""
    gc.collect()
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * 4096 / 1e6


def seconds(work: object, items: list[np.ndarray]) -> float:
    """Processor time a call, the least of several passes: other processes only add to it."""
    assert callable(work)
    passes = []
    for _ in range(REPEATS):
        begun = time.process_time()
        for item in items:
            work(item)
        passes.append((time.process_time() - begun) / len(items))
    return min(passes)


def identification(table: spindoe.HashTable) -> list[np.ndarray]:
    """Single calls and batches."""
    views = _native.trial_views(table._handle, "paper", 0, 0, 2000, None)
    dots = [view[0] for view in views if view[4] >= 3]
    recognizer = spindoe.Recognizer(table, expect="paper")
    call = seconds(lambda view: recognizer.identify(view, max_rivals=0), dots)
    few = seconds(recognizer.identify, [dots[0][:2]] * 2000)
    frames = (dots * 6)[:10_000]
    rates = []
    for _ in range(REPEATS):
        begun, used = time.perf_counter(), time.process_time()
        recognizer.identify_batch(frames)
        wall, cpu = time.perf_counter() - begun, time.process_time() - used
        rates.append((len(frames) / wall, len(frames) / cpu))
    wall_rate, cpu_rate = np.max(rates, axis=0)
    print(f"identify: {1e6 * call:.1f} us a call, in a batch {1e6 / cpu_rate:.1f} us a frame")
    print(f"identify, rejected at once: {1e6 * few:.1f} us a call")
    print(
        f"identify_batch of {len(frames)} frames: {wall_rate:.0f} frames/s, "
        f"{cpu_rate:.0f} frames per second and core"
    )
    return dots


def images(table: spindoe.HashTable) -> None:
    """Single frames."""
    estimator = spindoe.Estimator(table)
    drawn = [image for image, _ in spindoe.synth(table.pattern, 60, seed=1, ball_px=[60, 60])]
    for name, color in (("crops of a ball of 60 px, rgb", "rgb"), ("the same, gray", "gray")):
        frames = [i if color == "rgb" else np.ascontiguousarray(i[..., 1]) for i in drawn]
        shares, walls = [], []
        for _ in range(REPEATS):
            for frame in frames:
                begun = time.perf_counter()
                found = estimator.estimate(frame, color=color)  # type: ignore[arg-type]
                wall = time.perf_counter() - begun
                shares.append(wall / sum(found.seconds) - 1.0)
                walls.append(wall)
        print(
            f"estimate, {name}: {1e3 * np.median(walls):.2f} ms a call, "
            f"{100 * np.median(shares):.1f} % beyond the library's stages"
        )


def tracking(table: spindoe.HashTable) -> None:
    """Whole frames of a camera whose ball flies through them, followed."""
    for ball_px in (60, 170):
        # The first clip in which the ball stays whole.
        for seed in itertools.count(41):
            drawn = list(
                spindoe.synth(
                    table.pattern, 100, preset="good", seed=seed, fps=400.0, drift_px=(420.0, -140.0),
                    image_px=[1280, 1024], ball_px=[ball_px, ball_px], parallel_share=0.0,
                )
            )
            ends = np.array([drawn[k][1].circle[:2] for k in (0, -1)])
            if np.all((ends > 0.5 * ball_px) & (ends < np.array([1280, 1024]) - 0.5 * ball_px)):
                break
        clip = [(np.ascontiguousarray(image[..., 1]), truth.time_s) for image, truth in drawn]
        tracker = spindoe.Estimator(table).tracker()
        used, beyond, answered = [], [], 0
        for image, time_s in clip:
            begun, clock = time.thread_time(), time.perf_counter()
            state = tracker.update(image, time_s, color="gray")
            used.append(1e3 * (time.thread_time() - begun))
            wall = time.perf_counter() - clock
            beyond.append(wall / sum(state.frame.seconds) - 1.0)
            answered += bool(state.frame.pose)
        # The first frames find the ball.
        p50, p99 = np.quantile(used[5:], [0.5, 0.99])
        print(
            f"Tracker.update, {len(clip)} frames of 1280 x 1024, seed {seed}, ball of {ball_px} px, {answered} answered: "
            f"CPU p50 {p50:.2f} ms, p99 {p99:.2f} ms, {100 * np.median(beyond[5:]):.1f} % beyond the library's stages"
        )


def memory(table: spindoe.HashTable, dots: list[np.ndarray], calls: int) -> None:
    """Memory over many calls of every kind."""
    recognizer = spindoe.Recognizer(table)
    estimator = spindoe.Estimator(table)
    tracker = estimator.tracker()
    image, _ = next(spindoe.synth(table.pattern, 1, seed=1, ball_px=[40, 40]))
    few = [view[:5] for view in dots[:50]]

    def once(k: int) -> None:
        recognizer.identify(few[k % 50])
        try:
            recognizer.identify(few[k % 50][:, :2])
        except ValueError:
            pass
        if k % 100 == 0:
            estimator.estimate(image, color="rgb")
            tracker.update(image, 1e-3 * (k + 1), color="rgb")
            recognizer.identify_batch(few)

    for k in range(calls // 10):
        once(k)
    before = resident_mb()
    for k in range(calls // 10, calls + calls // 10):
        once(k)
    print(f"memory after {calls} more calls: {before:.1f} MB -> {resident_mb():.1f} MB")


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure the package.")
    parser.add_argument("table")
    parser.add_argument("--calls", type=int, default=100_000)
    arguments = parser.parse_args()
    table = spindoe.HashTable.load(arguments.table)
    dots = identification(table)
    images(table)
    tracking(table)
    memory(table, dots, arguments.calls)


if __name__ == "__main__":
    main()
