"""Plots land on the axes that they are given, and show what they should."""

from __future__ import annotations

import matplotlib
import numpy as np

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
    ax = found.plot(image, table=pattern)
    assert len(ax.texts) == found.matched
    times = np.arange(8) / 300.0
    half = 0.5 * 100.0 * times
    rows = np.stack([np.cos(half), np.sin(half), 0 * half, 0 * half], axis=1)
    spin = spindoe.fit_spin(times, rows)
    assert spin
    ax = spin.plot()
    assert [t.get_text() for t in ax.get_xticklabels()] == ["x", "y", "z", "|w|"]
    plt.close("all")
