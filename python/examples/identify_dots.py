"""Tutorial 2: read a table and identify dots that your own detector found.

    python identify_dots.py ../../designs/dots20/table.npz [--plot dots.png]
"""

from __future__ import annotations

import argparse

import numpy as np

import spindoe


def main() -> None:
    parser = argparse.ArgumentParser(description="Identify dots.")
    parser.add_argument("table")
    parser.add_argument("--plot")
    arguments = parser.parse_args()
    table = spindoe.HashTable.load(arguments.table)
    recognizer = spindoe.Recognizer(table)

    # 1. A detector gives pixels. Here they are those of a synthetic image, moved by a pixel.
    image, truth = next(spindoe.synth(table.pattern, seed=3, ball_px=[80, 80]))
    rng = np.random.default_rng(0)
    pixels = truth.dots[truth.visible] + rng.normal(size=(truth.visible.sum(), 2))

    # 2. The ball's outline and what is known of the camera make directions of them, in the camera frame
    #    (x right, y up, z towards the camera), with their uncertainty.
    view = spindoe.Camera.at_distance(20.0).view(truth.circle)
    dots, covariances = view.back_project(pixels, sigma_px=1.0)

    # 3. Which dots are these, and what is the orientation?
    found = recognizer.identify(dots, covariances)
    if not found:
        raise SystemExit(f"no answer: {found.reason}")
    print(found)
    print("dots:        ", found.assignment)
    print("in truth:    ", truth.indices[truth.visible])
    error = (found.as_rotation() * truth.as_rotation().inv()).magnitude()
    print(f"off the truth by {np.rad2deg(error):.1f} deg")

    # 4. Many views at once: on all cores.
    batch = recognizer.identify_batch([dots] * 1000)
    print(batch)

    if arguments.plot:
        import matplotlib.pyplot as plt

        figure, ax = plt.subplots()
        found.plot(image, table=table, dots=dots, circle=truth.circle, color="rgb", ax=ax)
        figure.savefig(arguments.plot)


if __name__ == "__main__":
    main()
