"""Plots on matplotlib's axes; each function takes axes, or makes some, and returns them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ._common import Floats, floats, optional, to_scipy, triple
from ._frame import FrameEstimate
from ._image import Color, Image, rgb8
from ._palette import DOT, EXPECTED, IDENTIFIED, OTHER, OUTLINE, css, on_white
from ._pattern import Pattern, Tabled, as_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ._recognize import Identification
    from ._sequence import SequenceEstimate
    from ._spin import Spin


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    made: Axes = optional("matplotlib.pyplot", "plot").figure().add_subplot()
    return made


def _ball(ax: Axes, center: tuple[float, float], radius: float, color: str = "0.4") -> None:
    ax.add_patch(optional("matplotlib.patches", "plot").Circle(center, radius, fill=False, edgecolor=color, linewidth=1.0))


def _rim(color: str) -> list[Any]:
    """The effect that sets letters off from what they stand on."""
    return [optional("matplotlib.patheffects", "plot").withStroke(linewidth=2.5, foreground=color)]


def pattern(pattern: Pattern, ax: Axes | None = None, *, dot_radius_rad: float = 0.1, **style: Any) -> Axes:
    """Draws a pattern from +z (left) and, turned about y, from -z (right), with the dots' numbers.

    Args:
        pattern: The pattern.
        ax: Where to draw.
        dot_radius_rad: Angular radius of a dot; 0.1 is a dot of 4 mm on a ball of 40 mm.
        style: Of the dots: arguments of `matplotlib.patches.Polygon`.
    """
    ax = _axes(ax)
    polygon = optional("matplotlib.patches", "plot").Polygon
    rim_of_number = _rim(css(DOT))
    given = {"color": css(DOT), **style}
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
            ax.add_patch(polygon(outline[:, :2] + [shift, 0.0], **given))
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
    image: Image | None = None,
    *,
    table: Tabled,
    dots: ArrayLike | None = None,
    circle: ArrayLike | None = None,
    color: Color | None = None,
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
        color: The order of the image's channels, as in `Estimator.estimate`.
        ax: Where to draw.
    """
    ax = _axes(ax)
    if image is None:
        place, sign, shade = (0.0, 0.0, 1.0), 1.0, on_white
        ax.set(xlim=(-1.15, 1.15), ylim=(-1.15, 1.15), aspect="equal")
    else:
        shown = rgb8(image, color)
        height, width = shown.shape[:2]
        middle = ((width - 1) / 2.0, (height - 1) / 2.0, min(width, height) / 2.0)
        place, sign, shade = (middle if circle is None else triple("circle", circle)), -1.0, css
        ax.imshow(shown)
    u, v, radius = place
    _ball(ax, (u, v), radius, shade(OUTLINE))

    def at(directions: Floats) -> Floats:
        return np.stack([u + radius * directions[:, 0], v + sign * radius * directions[:, 1]], 1)

    seen = found.as_rotation().apply(as_table(table).pattern.dots)
    matched = found.assignment[found.assignment >= 0]
    for index in np.flatnonzero(seen[:, 2] > 0.0):
        x, y = at(seen[index : index + 1])[0]
        paint = shade(IDENTIFIED) if index in matched else "0.5"
        ax.annotate(str(index), (x, y), color=paint, ha="center", va="center", fontsize=8)
    if dots is not None:
        points = at(floats("dots", dots))
        is_matched = found.assignment >= 0
        ring: dict[str, Any] = {"s": 110, "facecolors": "none", "linewidths": 1.2}
        ax.scatter(*points[is_matched].T, edgecolors=shade(IDENTIFIED), **ring)
        ax.scatter(*points[~is_matched].T, edgecolors=shade(OTHER), **ring)
    ax.set_title(f"p = {found.confidence:.4f}, {found.matched} dots", fontsize=9)
    return ax


def frame(
    found: FrameEstimate,
    image: Image,
    *,
    table: Tabled,
    color: Color | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draws the outline, the detections and the names of an estimated frame onto its image, around the ball.

    Args:
        found: The frame.
        image: Its image, as in `Estimator.estimate`.
        table: The pattern's table.
        color: The order of the image's channels, as there.
        ax: Where to draw.
    """
    ax = _axes(ax)
    rim_of_number = _rim("white")
    ax.imshow(rgb8(image, color))
    if found.circle is not None:
        u, v, radius = found.circle
        _ball(ax, (u, v), radius, css(OUTLINE))
        ax.set(xlim=(u - 1.3 * radius, u + 1.3 * radius), ylim=(v + 1.3 * radius, v - 1.3 * radius))
    is_matched = found.assignment >= 0
    ring: dict[str, Any] = {"s": 90, "facecolors": "none", "linewidths": 1.2}
    ax.scatter(*found.dots[is_matched, :2].T, edgecolors=css(IDENTIFIED), **ring)
    ax.scatter(*found.dots[~is_matched, :2].T, edgecolors=css(OTHER), **ring)
    for dot, index in zip(found.dots[is_matched], found.assignment[is_matched], strict=True):
        ax.annotate(
            str(index), dot[:2], color=on_white(IDENTIFIED), xytext=(6, 6), textcoords="offset points",
            path_effects=rim_of_number,
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
    ax.errorbar(range(4), values, bars, **{"fmt": "o", "capsize": 5, "color": css(DOT), **style})
    others = [np.linalg.norm(alias.spin_rad_s) / (2.0 * np.pi) for alias in found.aliases]
    ax.axhline(0.0, color="0.8", linewidth=0.8)
    ax.set_xticks(range(4), names)
    ax.set_ylabel("revolutions per second")
    # Aliases are far off: on the same axis they would leave nothing to be seen of the intervals.
    words = f"; or {', '.join(f'{rps:.0f}' for rps in others)} rps" if others else ""
    ax.set_title(f"{found.inliers} inliers{words}", fontsize=9)
    return ax


def sequence(found: SequenceEstimate, ax: Axes | None = None, **style: Any) -> Axes:
    """Draws how far the ball has turned about the spin's axis, with 95 % intervals, over the time after the first
    frame; the fit; and up to three aliases as faint lines, which the limits leave aside.

    Args:
        found: A sequence with a spin.
        ax: Where to draw.
        style: Of the orientations: arguments of `matplotlib.axes.Axes.errorbar`.

    Raises:
        ValueError: Where the sequence has no spin.
    """
    motion = found.spin
    if not motion or found.times_s is None:
        reason = "it has no times" if motion else motion.reason
        raise ValueError(f"found: expected a sequence with a spin: {reason}")
    ax = _axes(ax)
    posed = ~np.isnan(found.quaternions_wxyz[:, 0])
    times, start = found.times_s[posed], found.times_s[0]
    off = to_scipy(found.quaternions_wxyz[posed]) * motion.as_rotation(times).inv()
    axis = motion.axis

    def turns(at_s: Floats, rps: float) -> Floats:
        elapsed, decay = at_s - motion.time_s, motion.decay_per_s
        turned: Floats = rps * (-np.expm1(-decay * elapsed) / decay if decay else elapsed)
        return turned

    turned = turns(times, motion.rps) + off.as_rotvec() @ axis / (2.0 * np.pi)
    variances = np.einsum("i,nij,j->n", axis, found.covariances_rad2[posed], axis)
    errors = 1.96 * np.sqrt(np.maximum(variances, 0.0)) / (2.0 * np.pi)
    given = {"fmt": "o", "markersize": 3, "capsize": 3, "color": css(DOT), **style}
    ax.errorbar(times - start, turned, errors, **given)
    line = np.linspace(found.times_s[0], found.times_s[-1], 200)
    ax.plot(line - start, turns(line, motion.rps), color=on_white(EXPECTED), linewidth=1.0, label=f"{motion.rps:.1f} rps")
    # By the orientations and the fit: an alias runs through them many times as steeply.
    ax.set(xlim=ax.get_xlim(), ylim=ax.get_ylim())
    for alias in motion.aliases[:3]:
        along = float(alias.spin_rad_s @ axis) / (2.0 * np.pi)
        magnitude = np.linalg.norm(alias.spin_rad_s) / (2.0 * np.pi)
        ax.plot(line - start, turns(line, along), color="0.8", linewidth=0.8, zorder=0, label=f"or {magnitude:.0f} rps")
    ax.set(xlabel="time after the first frame, s", ylabel="turns about the axis")
    ax.legend(fontsize=8, frameon=False)
    return ax
