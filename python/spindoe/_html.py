"""What notebooks show of patterns, frames and sequences: small pictures as SVG, without a library."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from ._common import Floats
from ._palette import DOT, IDENTIFIED, OTHER, OUTLINE, css, on_white

if TYPE_CHECKING:
    from ._frame import FrameEstimate
    from ._sequence import SequenceEstimate

_DOT, _OUTLINE, _IDENTIFIED, _OTHER = css(DOT), on_white(OUTLINE), on_white(IDENTIFIED), on_white(OTHER)


def _page(width: float, height: float, shapes: Iterable[str], words: Iterable[str]) -> str:
    """A picture of this size, screen pixels, and lines of words beneath."""
    picture = (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}" height="{height:g}" '
        f'viewBox="0 0 {width:g} {height:g}" font-family="sans-serif">{"".join(shapes)}</svg>'
    )
    lines = "<br/>".join(escape(line) for line in words)
    return f"<div>{picture}<div><small>{lines}</small></div></div>"


def _circle(u: float, v: float, radius: float, style: str) -> str:
    return f'<circle cx="{u:.2f}" cy="{v:.2f}" r="{radius:.2f}" {style}/>'


def _number(u: float, v: float, number: int, color: str) -> str:
    return (
        f'<text x="{u:.2f}" y="{v:.2f}" font-size="9" fill="{color}" text-anchor="middle" '
        f'dominant-baseline="central">{number}</text>'
    )


def ball(dots: Floats, dot_radius_rad: float, words: str) -> str:
    """Both sides of a ball, from +z (left) and, turned about y, from -z (right), with the dots' numbers.

    Args:
        dots: Unit vectors in the pattern's frame, shape (n, 3).
        dot_radius_rad: Angular radius of a dot, radians.
        words: What stands beneath.
    """
    radius = 90.0
    shapes = []
    for side, u in ((1.0, 100.0), (-1.0, 300.0)):
        shapes.append(_circle(u, 100.0, radius, 'fill="white" stroke="gray"'))
        for number, (x, y, z) in enumerate(dots * [side, 1.0, side]):
            if z <= 0.0:
                continue
            at = (u + radius * x, 100.0 - radius * y)
            across = radius * np.sin(dot_radius_rad)
            # Seen at an angle, a dot is narrower in the direction of the ball's center.
            shapes.append(
                f'<ellipse cx="{at[0]:.2f}" cy="{at[1]:.2f}" rx="{across * z:.2f}" ry="{across:.2f}" fill="{_DOT}" '
                f'transform="rotate({-np.rad2deg(np.arctan2(y, x)):.2f} {at[0]:.2f} {at[1]:.2f})"/>'
            )
            shapes.append(_number(*at, number, "white"))
    return _page(400.0, 200.0, shapes, [words])


def frame(found: FrameEstimate) -> str:
    """The outline and the detections: those that are identified with their numbers."""
    words = [repr(found)]
    if found.circle is None:
        return _page(0.0, 0.0, [], words)
    u, v, radius = found.circle
    scale = 90.0 / radius
    shapes = [_circle(100.0, 100.0, 90.0, f'fill="white" stroke="{_OUTLINE}"')]
    for (x, y, _), number in zip(found.dots, found.assignment, strict=True):
        at = (100.0 + scale * (x - u), 100.0 + scale * (y - v))
        color = _IDENTIFIED if number >= 0 else _OTHER
        shapes.append(_circle(*at, 8.0, f'fill="none" stroke="{color}"'))
        if number >= 0:
            shapes.append(_number(*at, number, color))
    return _page(200.0, 200.0, shapes, words)


def sequence(found: SequenceEstimate) -> str:
    """A bar a frame, as high as its orientation's confidence and red where there is none, and the spin with its
    likeliest aliases."""
    words = [repr(found)]
    if found.spin and found.spin.aliases:
        others = [np.linalg.norm(alias.spin_rad_s) / (2.0 * np.pi) for alias in found.spin.aliases[:3]]
        words.append(f"or {', '.join(f'{rps:.1f}' for rps in others)} rps")
    width = min(8.0, 600.0 / max(len(found.frames), 1))
    shapes = []
    for k, estimate in enumerate(found.frames):
        height = 40.0 * estimate.pose.confidence if estimate.pose else 40.0
        color = _IDENTIFIED if estimate.pose else _OTHER
        shapes.append(
            f'<rect x="{width * k:.2f}" y="{40.0 - height:.2f}" width="{0.8 * width:.2f}" height="{height:.2f}" '
            f'fill="{color}"><title>{k}: {escape(repr(estimate))}</title></rect>'
        )
    return _page(width * len(found.frames), 40.0, shapes, words)
