"""Tutorial 1: design your pattern, see how good it is, and make what you need to use it.

    python design_pattern.py my-ball [--starts 16] [--plot ball.png]
"""

from __future__ import annotations

import argparse

import spindoe


def main() -> None:
    parser = argparse.ArgumentParser(description="Design a pattern.")
    parser.add_argument("out")
    parser.add_argument("--dots", type=int, default=20)
    parser.add_argument("--starts", type=int, default=16)
    parser.add_argument("--samples", type=int, default=10_000)
    parser.add_argument("--plot")
    arguments = parser.parse_args()

    # 1. The search. Ctrl-C leaves what was found in the folder; run(resume=True) continues.
    design = spindoe.Design(
        arguments.out, dots=arguments.dots, starts=arguments.starts, samples=arguments.samples
    )
    found = design.run(lambda progress: print(f"{progress.stage:8} {progress.step}", end="\r"))
    print(f"\n{found}")

    # 2. How often is it identified correctly, on trials that the search never used?
    for validation in found.validation:
        if validation.recognizer == "robust":
            print(f"{validation.protocol:8} {validation.identity}")

    # 3. The same for any pattern, under conditions of your own.
    noisy = spindoe.validate(found.table, "paper", samples=arguments.samples, sigma_rad=0.1)
    print(f"with 0.1 rad of noise: {noisy.identity}")

    # 4. The stencil that draws it on your ball: measure that first.
    stencil = spindoe.Stencil(found.pattern, ball_diameter_mm=40.3, hole_diameter_mm=3.5)
    stencil.save(f"{arguments.out}/stencil-of-my-ball")
    vertices, triangles = stencil.arrays("a")
    print(f"half A: {len(vertices)} vertices, {len(triangles)} triangles")

    if arguments.plot:
        import matplotlib.pyplot as plt

        figure, ax = plt.subplots(figsize=(8, 5))
        found.pattern.plot(ax)
        figure.savefig(arguments.plot)


if __name__ == "__main__":
    main()
