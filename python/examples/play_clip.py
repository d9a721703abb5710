"""Plays a clip as a camera would, frame by frame, and follows the ball: orientation and spin now, and the
latency.

    python play_clip.py ../../designs/dots20/table.npz [--fps 100] [--frames 300]
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import spindoe


def main() -> None:
    parser = argparse.ArgumentParser(description="Follow a ball.")
    parser.add_argument("table")
    parser.add_argument("--fps", type=float, default=100.0)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--rps", type=float, default=20.0)
    parser.add_argument("--ball-px", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    table = spindoe.HashTable.load(arguments.table)
    spin = np.array([0.2, 0.9, 0.4])
    spin *= 2.0 * np.pi * arguments.rps / np.linalg.norm(spin)
    clip = list(
        spindoe.synth(
            table.pattern, arguments.frames, seed=arguments.seed, fps=arguments.fps,
            spin_rad_s=spin, ball_px=[arguments.ball_px, arguments.ball_px],
        )
    )

    # As a calibration gives it. Without it answers are in the view frame, which turns as the ball crosses the image.
    known = clip[0][1].everything["intrinsics"]
    camera = spindoe.Camera.pinhole(*(known[name] for name in ("fx", "fy", "cx", "cy")))
    tracker = spindoe.Estimator(table, camera=camera).tracker()
    late = posed = 0
    latencies: list[float] = []
    spins: list[spindoe.Spin] = []
    begun = time.perf_counter()
    for k, (image, truth) in enumerate(clip):
        due = begun + k / arguments.fps
        time.sleep(max(0.0, due - time.perf_counter()))
        taken = max(due, time.perf_counter())
        assert truth.time_s is not None
        state = tracker.update(image, truth.time_s, color="rgb")
        latencies.append(time.perf_counter() - taken)
        late += latencies[-1] > 1.0 / arguments.fps
        posed += bool(state.frame.pose)
        if state.spin:
            spins.append(state.spin)
            if k % max(1, arguments.frames // 5) == 0:
                print(f"{truth.time_s:.3f} s  {state.frame.pose}  {state.spin}")
    ms = 1e3 * np.array(latencies)
    size = "{1}x{0}".format(*clip[0][0].shape[:2])
    print(f"{len(clip)} frames of {size} at {arguments.fps} fps: {posed} orientations")
    print(f"latency p50 {np.percentile(ms, 50):.2f} ms, p99 {np.percentile(ms, 99):.2f} ms; {late} late")
    if spins:
        off = [np.linalg.norm(found.spin_rad_s - spin) / (2.0 * np.pi) for found in spins]
        print(
            f"spin known after {len(clip) - len(spins)} frames, {spins[-1].frame} frame, off by {np.median(off):.3f} rps (median)"
        )


if __name__ == "__main__":
    main()
