"""Tutorial 3: from a clip to a spin with its error bar.

    python clip_to_spin.py ../../designs/dots20/table.npz [CLIP.npz] [--plot spin.png]

CLIP.npz holds `images` (n, height, width, 3), uint8, rgb, and `times_s` (n,). Without one a synthetic
clip is taken, whose spin is known.
"""

from __future__ import annotations

import argparse

import numpy as np

import spindoe


def main() -> None:
    parser = argparse.ArgumentParser(description="Estimate a spin.")
    parser.add_argument("table")
    parser.add_argument("clip", nargs="?")
    parser.add_argument("--plot")
    arguments = parser.parse_args()
    table = spindoe.HashTable.load(arguments.table)

    # 1. Images and their times. Cameras give them; OpenCV's are "bgr".
    if arguments.clip:
        with np.load(arguments.clip) as clip:
            images, times_s = list(clip["images"]), clip["times_s"]
    else:
        spin = (0.0, 180.0, 60.0)
        drawn = spindoe.synth(table.pattern, 16, seed=1, fps=350.0, spin_rad_s=spin, ball_px=[80, 80])
        images, truths = map(list, zip(*drawn, strict=True))
        times_s = np.array([truth.time_s for truth in truths])
        print(f"in truth {np.linalg.norm(spin) / (2 * np.pi):.2f} rps")

    # 2. Orientations of all frames, which help each other, and the spin.
    estimator = spindoe.Estimator(table)
    found = estimator.estimate_sequence(images, times_s, color="rgb")
    print(found)
    for frame in found.frames[:4]:
        print("  ", frame)

    # 3. The spin is not found in every clip; where it is, it has an uncertainty and aliases.
    if not found.spin:
        raise SystemExit(f"no spin: {found.spin.reason}")
    print(f"{found.spin.rps:.2f} +- {found.spin.std_rps or np.nan:.2f} rps about {found.spin.axis}")
    for alias in found.spin.aliases[:3]:
        print(f"   or {np.linalg.norm(alias.spin_rad_s) / (2 * np.pi):.1f} rps")

    if arguments.plot:
        import matplotlib.pyplot as plt

        figure, ax = plt.subplots()
        found.spin.plot(ax)
        figure.savefig(arguments.plot)


if __name__ == "__main__":
    main()
