#!/usr/bin/env python3
"""Draws the pictures of docs/marking.md: `spindoe mark` writes each SVG, cairosvg turns it into a PNG.

    draw_marks.py SPINDOE PATTERN.csv DIR

SPINDOE is the command, DIR takes gores.png, stickers.png and plotter.png. Needs cairosvg.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import cairosvg

WIDTH = 1200
WAYS = {
    "gores": [],
    "stickers": [],
    "plotter": ["--config=pen_diameter_mm=0.8"],
}


def main():
    if len(sys.argv) != 4:
        sys.exit("usage: draw_marks.py SPINDOE PATTERN.csv DIR")
    command, pattern, folder = sys.argv[1], sys.argv[2], Path(sys.argv[3])
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as aside:
        for way, flags in WAYS.items():
            svg = Path(aside) / f"{way}.svg"
            subprocess.run([command, "mark", pattern, "--as", way, "-o", svg, *flags], check=True)
            cairosvg.svg2png(url=str(svg), write_to=str(folder / f"{way}.png"), output_width=WIDTH,
                             background_color="white")


if __name__ == "__main__":
    main()
