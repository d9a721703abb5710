"""Plots land on the axes that they are given, and show what they should."""

from __future__ import annotations

import matplotlib
import numpy as np
import pytest
from PIL import Image

matplotlib.use("Agg")
import matplotlib.pyplot as plt

import spindoe


def _texts(ax):
    return {text.get_text() for text in ax.texts}


def test_every_dot_is_drawn_once(pattern):
    ax = pattern.plot()
    assert _texts(ax) == {str(k) for k in range(20)} | {"+z", "-z"}
    plt.close("all")


def test_an_identification_is_drawn(pattern, recognizer, view):
    found = recognizer.identify(view)
    figure, ax = plt.subplots()
    assert found.plot(table=pattern, dots=view, ax=ax) is ax
    visible = {str(k) for k in np.flatnonzero(found.as_rotation().apply(pattern.dots)[:, 2] > 0)}
    assert _texts(ax) == visible
    image = np.zeros((80, 80), np.uint8)
    on_image = found.plot(image, table=pattern, circle=(40, 40, 30))
    index = int(found.assignment[0])
    text = next(t for t in on_image.texts if t.get_text() == str(index))
    assert np.allclose(text.xy, [40 + 30 * view[0, 0], 40 - 30 * view[0, 1]], atol=0.1)
    figure.canvas.draw()
    plt.close("all")


def test_a_frame_and_a_spin_are_drawn(pattern, estimator):
    image, _ = next(spindoe.synth(pattern, 1, seed=4, ball_px=[100, 100]))
    found = estimator.estimate(image, color="rgb")
    ax = found.plot(image, table=pattern, color="rgb")
    assert len(ax.texts) == found.matched
    times = np.arange(8) / 300.0
    half = 0.5 * 100.0 * times
    rows = np.stack([np.cos(half), np.sin(half), 0 * half, 0 * half], axis=1)
    spin = spindoe.fit_spin(times, rows)
    assert spin
    ax = spin.plot()
    assert [t.get_text() for t in ax.get_xticklabels()] == ["x", "y", "z", "|w|"]
    plt.close("all")


def test_colors_are_right_and_the_ball_fills_the_plot(pattern, estimator):
    image, _ = next(spindoe.synth(pattern, 1, seed=4, ball_px=[100, 100]))
    image[..., 0] //= 2
    wide = np.zeros((400, 600, 3), np.uint8)
    wide[100 : 100 + image.shape[0], 300 : 300 + image.shape[1]] = image
    bgr = np.ascontiguousarray(wide[..., ::-1])
    found = estimator.estimate(bgr, color="bgr")
    assert found.pose
    ax = found.plot(bgr, table=pattern, color="bgr")
    assert np.array_equal(ax.images[0].get_array(), wide)
    sixteen = found.plot(bgr.astype(np.uint16) << 8, table=pattern, color="bgr")
    assert np.array_equal(sixteen.images[0].get_array(), wide)
    # What else an image may be is shown as it is read.
    for given, color in [(bgr / 255.0, "bgr"), (Image.fromarray(wide), None), (np.dstack([bgr, bgr[..., :1]]), "bgra")]:
        shown = found.plot(given, table=pattern, color=color).images[0].get_array()
        assert np.array_equal(shown, wide)
    u, v, radius = found.circle
    assert np.allclose(sorted(ax.get_xlim()), [u - 1.3 * radius, u + 1.3 * radius])
    assert np.allclose(ax.get_ylim(), [v + 1.3 * radius, v - 1.3 * radius])
    with pytest.raises(ValueError, match="color"):
        found.plot(bgr, table=pattern)
    plt.close("all")


def test_aliases_do_not_flatten_a_spin():
    """The axis is that of the spin and its intervals; an alias, many times as fast, is listed."""
    spin = spindoe.Spin(
        0.0, np.array([6.0, -3.0, 2.0]), np.array([1.0, 0, 0, 0]), 0.01 * np.eye(3), 0.01, 0.0, 9,
        aliases=(spindoe.Alias(np.array([2000.0, 0, 0]), 0.0),),
    )
    ax = spin.plot()
    low, high = ax.get_ylim()
    assert high < 2.0 and low > -1.0 and "318 rps" in ax.get_title()
    plt.close("all")
