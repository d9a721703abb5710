"""Colors mean in Python's pictures what they mean in the command's."""

from __future__ import annotations

import re

import matplotlib
import pytest

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from conftest import ROOT

import spindoe
from spindoe import _palette, live

# The names of src/plot/overlay.rs.
THEIRS = {"OUTLINE": "OUTLINE", "NAMED": "IDENTIFIED", "UNNAMED": "OTHER", "EXPECTED": "EXPECTED"}


def test_colors_are_those_of_the_commands_overlays():
    source = (ROOT / "src/plot/overlay.rs").read_text()
    for theirs, ours in THEIRS.items():
        (found,) = re.findall(rf"^const {theirs}: RGBColor = RGBColor\((\d+), (\d+), (\d+)\);", source, re.M)
        color = getattr(_palette, ours)
        assert tuple(map(int, found)) == color
        # OpenCV's order.
        assert getattr(live, ours) == color[::-1]


@pytest.mark.parametrize("color", [_palette.OUTLINE, _palette.IDENTIFIED, _palette.OTHER])
def test_shades_on_white_can_be_read(color):
    """A contrast of 4.5, as WCAG 2 asks of text."""

    def luminance(shade):
        levels = [int(shade[k : k + 2], 16) / 255 for k in (1, 3, 5)]
        linear = [level / 12.92 if level <= 0.04045 else ((level + 0.055) / 1.055) ** 2.4 for level in levels]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    assert 1.05 / (luminance(_palette.on_white(color)) + 0.05) > 4.5
    assert _palette.css(color) == "#{:02x}{:02x}{:02x}".format(*color)


def test_pictures_use_them(pattern, estimator):
    image, _ = next(spindoe.synth(pattern, 1, seed=4, ball_px=[100, 100]))
    found = estimator.estimate(image, color="rgb")
    assert found.pose
    page = found._repr_html_()
    assert all(_palette.on_white(color) in page for color in (_palette.OUTLINE, _palette.IDENTIFIED))
    (outline,) = found.plot(image, table=pattern, color="rgb").patches
    assert outline.get_edgecolor()[:3] == pytest.approx([level / 255 for level in _palette.OUTLINE])
    plt.close("all")
