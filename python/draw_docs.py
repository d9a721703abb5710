#!/usr/bin/env python3
"""Draws the pictures of the documentation, each by the command that made it.

    draw_docs.py SPINDOE [NAME...]

SPINDOE is the command; run it in the repository's root. Without names it draws all that take seconds: `stencil`,
`clip`, `images`, `camera`, `calibrate`, `spin`, `synth`, `marking`, `python`, `report`. `objectives`, `recognizer`
and `search` take minutes to an hour and are drawn only when named. `clip` and `images` need Pillow, `camera`
matplotlib, `python` this package with it, `marking` cairosvg, `report` playwright with a Chromium.
"""

import csv
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PATTERN = "designs/dots20/pattern.csv"
# The published pattern, on which docs/measurements/recognizer.md measures.
PUBLISHED = Path("../shared/data/spindoe2023/ref_pattern.csv")
STUDIES = ["cargo", "run", "--release", "-p", "spindoe-studies", "--"]


def run(*words):
    print("+", *words, flush=True)
    subprocess.run([str(w) for w in words], check=True)


def stencil(spindoe, _):
    run(spindoe, "stencil", PATTERN, "-o", "stencils/dots20", "--overwrite")
    run(spindoe, "stencil", "dots40", "-o", "stencils/dots40", "--overwrite")
    shutil.copy("stencils/dots20/stencil.png", "docs/stencil.png")


def clip(spindoe, aside):
    """A moving picture: one turn of a ball, with what was found in each frame."""
    from PIL import Image

    run(spindoe, "synth", "-o", aside / "clip", "--rps", "10", "--frames", "36", "--ball-px", "120", "--seed", "3")
    run(spindoe, "estimate", "--table", aside / "clip/table.npz", aside / "clip", "--overlay", aside / "seen", "-o",
        aside / "orientations.csv")
    frames = [Image.open(path).convert("RGB") for path in sorted((aside / "seen").glob("[0-9]*.png"))]
    frames[0].save("docs/clip.webp", save_all=True, append_images=frames[1:], duration=100, loop=0, quality=60, method=6)


def images(spindoe, aside):
    from PIL import Image

    run(spindoe, "synth", PATTERN, "--as=images", "-o", aside / "set", "--frames", "16", "--seed", "4")
    run(spindoe, "estimate", "--table", aside / "set/table.npz", aside / "set", "--no-sequence", "--overlay",
        aside / "seen", "-o", aside / "orientations.csv")
    sheet = Image.open(aside / "seen/contact_sheet.png").convert("RGB")
    sheet.save("docs/detector.webp", quality=80, method=6)


# Properties of a camera that a sweep varies, in words.
CAMERA = {
    "ball_px": "ball in the image, pixels",
    "exposure_ms": "exposure, ms",
    "noise_levels": "noise, of 255 levels",
    "defocus_px": "blur of the lens, pixels",
    "dot_diameter": "dot, of the ball's diameter",
}


def camera(spindoe, aside):
    """What one property of a camera does to single frames, all else as it is."""
    import matplotlib.pyplot as plt

    run(spindoe, "validate", PATTERN, "--camera", "any", "--ball-px", "45", "--exposure-ms", "0.5", "--sweep", "camera",
        "--samples", "100", "-o", aside / "sweep")
    with (aside / "sweep/sensitivity.csv").open(newline="") as file:
        points = list(csv.DictReader(file))
    figure, axes = plt.subplots(
        2, len(CAMERA), figsize=(11, 4), sharex="col", sharey="row", height_ratios=[1.5, 1], layout="constrained"
    )
    for (rates, errors), (name, words) in zip(axes.T, CAMERA.items(), strict=True):
        own = [{k: float(v) for k, v in p.items() if k != "parameter"} for p in points if p["parameter"] == name]
        values = [p["value"] for p in own]
        for kind, color in [("right", "#2a9d3a"), ("wrong", "#d1495b")]:
            found = [100 * p[kind] for p in own]
            bounds = [[100 * abs(p[kind] - p[f"{kind}_{end}"]) for p in own] for end in ("low", "high")]
            rates.errorbar(values, found, bounds, fmt="o-", markersize=3, capsize=3, color=color, label=kind)
        errors.plot(values, [p["mean_error_deg"] for p in own], "o-", markersize=3, color="#1f4e79")
        errors.set_xscale("log")
        errors.set_xticks(values, [f"{v:.3g}" for v in values])
        errors.minorticks_off()
        errors.tick_params(labelsize=7)
        errors.set_xlabel(words, fontsize=9)
    axes[0, 0].set(ylabel="frames, %", ylim=(-3, 103))
    axes[0, 0].legend(fontsize=8, loc="center right")
    highest = max(float(p["mean_error_deg"]) for p in points if p["parameter"] in CAMERA)
    axes[1, 0].set(ylabel="mean error, deg", ylim=(0, 1.12 * highest))
    figure.savefig("docs/camera.png", dpi=100)


def calibrate(spindoe, aside):
    run(spindoe, "synth", PATTERN, "-o", aside / "clip", "--preset", "good", "--frames", "120", "--rps", "3", "--ball-px",
        "90", "--seed", "5")
    run(spindoe, "calibrate", "--table", aside / "clip/table.npz", aside / "clip", "-o", aside / "ball")
    shutil.copy(aside / "ball/offsets.png", "docs/calibrate.png")


def spin(spindoe, aside):
    sequence = aside / "sequence.csv"
    run(spindoe, "synth", "--as=orientations", "-o", sequence, "--rps", "80", "--axis", "1,-2,0.5", "--frames", "210",
        "--config=decay_per_s=0.091", "--seed", "4")
    run(spindoe, "spin", sequence, "--motion=decaying", "--picture", "docs/spin_over_time.png")


def synth(spindoe, aside):
    for name, flags in {"contact_sheet": ["--config=dot_radius_deg=2.3,7.4"], "good": ["--preset", "good"]}.items():
        run(spindoe, "synth", PATTERN, "--as=images", "-o", aside / name, "--frames", "64", "--seed", "6", *flags)
        shutil.copy(aside / name / "contact_sheet.png", f"docs/synth/{name}.png")


def marking(spindoe, _):
    run(sys.executable, "tests/python/draw_marks.py", spindoe, PATTERN, "docs/marking")


def python(_, __):
    """The package's own plots: a pattern, a frame that was read, and the spin of its sequence."""
    import matplotlib.pyplot as plt

    # The package that is installed, not its sources beside this file.
    sys.path.remove(str(Path(__file__).resolve().parent))
    import spindoe as package

    table = package.HashTable.load("designs/dots20/table.npz")
    drawn = package.synth(table.pattern, 12, seed=10, fps=350, spin_rad_s=(40, 150, 20), ball_px=[120, 120])
    images, truths = zip(*drawn, strict=True)
    times = [truth.time_s for truth in truths]
    found = package.Estimator(table).estimate_sequence(images, times, color="rgb")
    figure, axes = plt.subplots(1, 3, figsize=(11, 3.6), width_ratios=[1.6, 1, 1], layout="constrained")
    table.pattern.plot(axes[0])
    found.frames[6].plot(images[6], table=table, color="rgb", ax=axes[1])
    found.spin.plot(axes[2])
    figure.savefig("docs/python.png", dpi=100)


def report(spindoe, aside):
    """The page of the shipped design with its stencil, as a browser shows it."""
    folder = aside / "design"
    shutil.copytree("designs/dots20", folder)
    shutil.copytree("stencils/dots20", folder / "stencil")
    run(spindoe, "report", folder)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"),
            args=["--no-sandbox", "--enable-unsafe-swiftshader", "--use-angle=swiftshader"],
        )
        page = browser.new_page(viewport={"width": 1180, "height": 900})
        page.set_default_timeout(240_000)
        page.goto((folder / "report.html").resolve().as_uri())
        page.wait_for_selector("html[data-ready=true]")
        page.wait_for_timeout(1000)
        page.screenshot(path="docs/report.png", full_page=True, clip={"x": 0, "y": 0, "width": 1180, "height": 1640})
        browser.close()


def objectives(_, __):
    run(*STUDIES, "objectives", "--out", "docs", "--patterns", "300", "--trials", "20000")


def recognizer(_, __):
    bench = [*STUDIES, "recognizer", "--pattern", PUBLISHED, "--out", "docs/recognizer"]
    run(*bench, "failures")
    run(*bench, "--trials", "20000", "confidence")


def search(spindoe, aside):
    run(spindoe, "design", "--seed", "0", "--budget", "30m", "--pictures", "png", "-o", aside / "search")
    shutil.copy(aside / "search" / "progress.png", "docs/search_30_minutes.png")


QUICK = [stencil, clip, images, camera, calibrate, spin, synth, marking, python, report]
SLOW = [objectives, recognizer, search]


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    spindoe, names = sys.argv[1], sys.argv[2:]
    known = {f.__name__: f for f in QUICK + SLOW}
    unknown = [n for n in names if n not in known]
    if unknown:
        sys.exit(f"unknown: {', '.join(unknown)}; expected {', '.join(known)}")
    for name in names or [f.__name__ for f in QUICK]:
        with tempfile.TemporaryDirectory() as aside:
            known[name](spindoe, Path(aside))


if __name__ == "__main__":
    main()
