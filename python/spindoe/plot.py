"""Plots on matplotlib's axes; each function takes axes, or makes some, and returns them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._common import Floats, floats, triple
from ._pattern import Pattern, Tabled, as_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ._recognize import Identification
    from ._spin import Spin
    from ._vision import FrameEstimate

DOT = "#1f4e79"
MATCHED = "#2a9d3a"
LEFT_OUT = "#d1495b"


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.figure().add_subplot()


def _ball(ax: Axes, center: tuple[float, float], radius: float) -> None:
    from matplotlib.patches import Circle

    ax.add_patch(Circle(center, radius, fill=False, edgecolor="0.4", linewidth=1.0))


def pattern(pattern: Pattern, ax: Axes | None = None, *, dot_radius_rad: float = 0.1, **style: Any) -> Axes:
    """Draws a pattern from +z (left) and, turned about y, from -z (right), with the dots' numbers.

    Args:
        pattern: The pattern.
        ax: Where to draw.
        dot_radius_rad: Angular radius of a dot; 0.1 is a dot of 4 mm on a ball of 40 mm.
        style: Of the dots: arguments of `matplotlib.patches.Polygon`.
    """
    from matplotlib.patches import Polygon
    from matplotlib.patheffects import withStroke

    ax = _axes(ax)
    rim_of_number = [withStroke(linewidth=2.5, foreground=DOT)]
    given = {"color": DOT, **style}
    around = np.linspace(0.0, 2.0 * np.pi, 25)
    for side, shift in ((1.0, -1.1), (-1.0, 1.1)):
        _ball(ax, (shift, 0.0), 1.0)
        turned = pattern.dots * [side, 1.0, side]
        for index in np.flatnonzero(turned[:, 2] > 0.0):
            dot = turned[index]
            helper = np.eye(3)[np.argmin(np.abs(dot))]
            first = np.cross(dot, helper)
            first /= np.linalg.norm(first)
            second = np.cross(dot, first)
            rim = np.outer(np.cos(around), first) + np.outer(np.sin(around), second)
            outline = np.cos(dot_radius_rad) * dot + np.sin(dot_radius_rad) * rim
            ax.add_patch(Polygon(outline[:, :2] + [shift, 0.0], **given))
            ax.annotate(
                str(index), dot[:2] + [shift, 0.0], ha="center", va="center", fontsize=7,
                color="white", path_effects=rim_of_number,
            )
        ax.annotate("+z" if side > 0 else "-z", (shift, -1.18), ha="center", va="center")
    ax.set(xlim=(-2.25, 2.25), ylim=(-1.3, 1.15), aspect="equal")
    ax.axis("off")
    return ax


def identification(
    found: Identification,
    image: NDArray[Any] | None = None,
    *,
    table: Tabled,
    dots: ArrayLike | None = None,
    circle: ArrayLike | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draws the dots of an identification with their names; without an image, on a unit circle.

    Args:
        found: The identification.
        image: The image to draw onto.
        table: The pattern's table.
        dots: The observed dots, shape (n, 3), to be drawn beside the pattern's.
        circle: The ball's outline ``u, v, radius`` in the image, pixels; by default the largest in
            its middle.
        ax: Where to draw.
    """
    ax = _axes(ax)
    if image is None:
        place, sign = (0.0, 0.0, 1.0), 1.0
        ax.set(xlim=(-1.15, 1.15), ylim=(-1.15, 1.15), aspect="equal")
    else:
        height, width = image.shape[:2]
        middle = ((width - 1) / 2.0, (height - 1) / 2.0, min(width, height) / 2.0)
        place, sign = (middle if circle is None else triple("circle", circle)), -1.0
        ax.imshow(image, cmap="gray" if image.ndim == 2 else None)
    u, v, radius = place
    _ball(ax, (u, v), radius)

    def at(directions: Floats) -> Floats:
        return np.stack([u + radius * directions[:, 0], v + sign * radius * directions[:, 1]], 1)

    seen = found.as_rotation().apply(as_table(table).pattern.dots)
    matched = found.assignment[found.assignment >= 0]
    for index in np.flatnonzero(seen[:, 2] > 0.0):
        x, y = at(seen[index : index + 1])[0]
        color = MATCHED if index in matched else "0.5"
        ax.annotate(str(index), (x, y), color=color, ha="center", va="center", fontsize=8)
    if dots is not None:
        points = at(floats("dots", dots))
        is_matched = found.assignment >= 0
        ring: dict[str, Any] = {"s": 110, "facecolors": "none", "linewidths": 1.2}
        ax.scatter(*points[is_matched].T, edgecolors=MATCHED, **ring)
        ax.scatter(*points[~is_matched].T, edgecolors=LEFT_OUT, **ring)
    ax.set_title(f"p = {found.confidence:.4f}, {found.matched} dots", fontsize=9)
    return ax


def frame(
    found: FrameEstimate, image: NDArray[Any], *, table: Tabled, ax: Axes | None = None
) -> Axes:
    """Draws the outline, the detections and the names of an estimated frame onto its image."""
    from matplotlib.patheffects import withStroke

    ax = _axes(ax)
    rim_of_number = [withStroke(linewidth=2.5, foreground="white")]
    ax.imshow(image, cmap="gray" if image.ndim == 2 else None)
    if found.circle is not None:
        u, v, radius = found.circle
        _ball(ax, (u, v), radius)
    is_matched = found.assignment >= 0
    ring: dict[str, Any] = {"s": 90, "facecolors": "none", "linewidths": 1.2}
    ax.scatter(*found.dots[is_matched, :2].T, edgecolors=MATCHED, **ring)
    ax.scatter(*found.dots[~is_matched, :2].T, edgecolors=LEFT_OUT, **ring)
    for dot, index in zip(found.dots[is_matched], found.assignment[is_matched], strict=True):
        ax.annotate(
            str(index), dot[:2], color=DOT, xytext=(6, 6), textcoords="offset points", path_effects=rim_of_number
        )
    words = f"p = {found.pose.confidence:.3f}" if found.pose else found.pose.reason
    ax.set_title(words, fontsize=9)
    ax.axis("off")
    return ax


def spin(found: Spin, ax: Axes | None = None, **style: Any) -> Axes:
    """Draws the spin's components in revolutions per second with their 95 % intervals, and names the
    magnitudes of the aliases.

    Args:
        found: The spin.
        ax: Where to draw.
        style: Of the bars: arguments of `matplotlib.axes.Axes.errorbar`.
    """
    ax = _axes(ax)
    components = found.spin_rad_s / (2.0 * np.pi)
    std = found.std_rad_s
    errors = None if std is None else 1.96 * std / (2.0 * np.pi)
    names = ["x", "y", "z", "|w|"]
    values = [*components, found.rps]
    bars = None if errors is None else [*errors, 1.96 * (found.std_rps or 0.0)]
    ax.errorbar(range(4), values, bars, **{"fmt": "o", "capsize": 5, "color": DOT, **style})
    others = [np.linalg.norm(alias.spin_rad_s) / (2.0 * np.pi) for alias in found.aliases]
    ax.axhline(0.0, color="0.8", linewidth=0.8)
    ax.set_xticks(range(4), names)
    ax.set_ylabel("revolutions per second")
    # Aliases are far off: on the same axis they would leave nothing to be seen of the intervals.
    words = f"; or {', '.join(f'{rps:.0f}' for rps in others)} rps" if others else ""
    ax.set_title(f"{found.inliers} inliers{words}", fontsize=9)
    return ax
