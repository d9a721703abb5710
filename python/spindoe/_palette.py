"""Colors with one meaning in all pictures, that of the command's overlays: the outline, identified and other detections, and
what the orientation or motion expects. Red, green, blue."""

from __future__ import annotations

Rgb = tuple[int, int, int]

OUTLINE: Rgb = (0, 220, 120)
IDENTIFIED: Rgb = (60, 200, 255)
OTHER: Rgb = (255, 90, 60)
EXPECTED: Rgb = (255, 230, 40)
# The paint of dots where a pattern is drawn.
DOT: Rgb = (31, 78, 121)


def css(color: Rgb) -> str:
    """As ``#rrggbb``."""
    return "#" + bytes(color).hex()


def on_white(color: Rgb) -> str:
    """As ``#rrggbb``, as dark as lines and numbers on white must be."""
    red, green, blue = (6 * level // 10 for level in color)
    return css((red, green, blue))
