"""Spins, against rotations that SciPy made."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import spindoe

SPIN = np.array([30.0, -120.0, 200.0])
TIMES = np.arange(12) / 350.0


def _sequence(noise=0.0, seed=0):
    rng = np.random.default_rng(seed)
    jitter = Rotation.from_rotvec(noise * rng.normal(size=(len(TIMES), 3)))
    return jitter * Rotation.from_rotvec(TIMES[:, None] * SPIN) * Rotation.random(random_state=1)


def test_the_spin_is_that_of_the_rotations():
    rotations = _sequence()
    found = spindoe.fit_spin(TIMES, rotations)
    assert found and np.allclose(found.spin_rad_s, SPIN, atol=1e-6)
    assert found.rps == pytest.approx(np.linalg.norm(SPIN) / (2 * np.pi))
    off = found.as_rotation(TIMES) * rotations.inv()
    assert off.magnitude().max() < 1e-6
    assert np.allclose(found.axis, SPIN / np.linalg.norm(SPIN))


def _moving(decay=0.0, body=(0.0, 0.0, 0.0), count=105):
    times = np.arange(count) / 350.0
    tau = (-np.expm1(-decay * times) / decay if decay else times)[:, None]
    start = Rotation.random(random_state=1)
    rotations = Rotation.from_rotvec(tau * SPIN) * start * Rotation.from_rotvec(tau * np.array(body))
    axis = SPIN / np.linalg.norm(SPIN)
    mean = SPIN + axis * (axis @ start.apply(body))
    return times, rotations, lambda t: mean * np.exp(-decay * t)


@pytest.mark.parametrize(
    ("model", "decay", "body"),
    [("constant", 0.0, (0, 0, 0)), ("decaying", 0.1, (0, 0, 0)), ("precessing", 0.1, (12, -6, 9))],
)
def test_the_motion_is_that_of_the_rotations(model, decay, body):
    times, rotations, spin = _moving(decay, body)
    found = spindoe.fit_spin(times, rotations)
    assert found and found.model == model and found.frame == "camera"
    middle = 0.5 * (times[0] + times[-1])
    assert found.time_s == pytest.approx(middle)
    assert np.allclose(found.spin_rad_s, spin(middle), atol=0.02)
    assert found.decay_per_s == pytest.approx(decay, abs=2e-3)
    assert np.allclose(found.body_rate_rad_s, np.array(body) * np.exp(-decay * middle), atol=0.05)
    assert (found.as_rotation(times) * rotations.inv()).magnitude().max() < 2e-3
    first = spindoe.fit_spin(times, rotations, at_s=times[0])
    assert first and first.time_s == times[0] and np.allclose(first.spin_rad_s, spin(0.0), atol=0.05)
    with pytest.raises(ValueError, match="at_s"):
        spindoe.fit_spin(times, rotations, at_s=-1.0)


def test_a_ball_that_is_pushed():
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    # A spin that swings about two axes, integrated in steps that are far shorter than a frame.
    def spin(t):
        return np.array([3.0 + 2.0 * np.sin(3.0 * t), -2.0 * np.cos(2.0 * t), 4.0])

    fine, turned, rotations = 40, rotation.identity(), []
    times = np.arange(120) / 60.0
    for t in times:
        rotations.append(turned.as_quat())
        for i in range(fine):
            turned = rotation.from_rotvec(spin(t + (i + 0.5) / 60.0 / fine) / 60.0 / fine) * turned
    noise = rotation.from_rotvec(np.random.default_rng(5).normal(0.0, 0.01, (120, 3)))
    truth = rotation.from_quat(rotations)
    found = spindoe.fit_spin(times, noise * truth)
    assert found and found.model == "free" and found.curve is not None
    mean = np.mean([spin(t) for t in np.linspace(times[0], times[-1], 2001)], axis=0)
    off = found.spin_rad_s - mean
    assert off @ np.linalg.solve(found.covariance, off) < 11.345
    curve = found.curve
    truths = np.array([spin(t) for t in curve.times_s])
    assert np.abs(curve.spins_rad_s - truths).max() < 0.8
    inside = np.abs(curve.rps - np.linalg.norm(truths, axis=1) / (2 * np.pi)) < 1.96 * curve.std_rps
    assert inside.mean() > 0.9 and (curve.std_rps > 0.0).all()
    assert (found.as_rotation(times) * truth.inv()).magnitude().max() < 0.03
    spread = np.sqrt(np.mean(np.sum((truths - mean) ** 2, axis=1)))
    assert curve.spread_rad_s == pytest.approx(spread, rel=0.1)
    optical = found.as_frame("optical")
    assert np.allclose(optical.curve.spins_rad_s, curve.spins_rad_s * [1, -1, -1])
    at = spindoe.fit_spin(times, noise * truth, at_s=0.5)
    assert at and np.linalg.norm(at.spin_rad_s - spin(0.5)) < 0.5


def test_a_ball_at_rest_has_no_axis_and_warns_of_nothing(recwarn):
    found = spindoe.fit_spin(np.arange(20) / 30.0, np.tile([1.0, 0.0, 0.0, 0.0], (20, 1)))
    assert found and found.model == "constant" and found.rps < 1e-12
    assert np.isfinite(found.axis).all() and np.isfinite(found.std_rps) and found.std_rps > 0.0
    assert not recwarn.list


def test_a_model_that_is_asked_for():
    times, rotations, _ = _moving(0.1)
    constant = spindoe.fit_spin(times, rotations, model="constant")
    assert constant and constant.model == "constant" and constant.lack_of_fit is not None
    assert constant.lack_of_fit > 4.0
    precessing = spindoe.fit_spin(times, rotations, model="precessing")
    assert precessing and precessing.model == "precessing"
    for bad in ({"model": "wobbling"}, {"frame": "map"}, {"method": "quatera", "model": "decaying"}):
        with pytest.raises(ValueError, match=list(bad)[-1]):
            spindoe.fit_spin(times, rotations, **bad)


def test_order_is_by_name():
    xyzw = _sequence(0.02).as_quat()
    a = spindoe.fit_spin(TIMES, xyzw, order="xyzw")
    b = spindoe.fit_spin(TIMES, np.roll(xyzw, 1, axis=1))
    assert a and b and np.array_equal(a.spin_rad_s, b.spin_rad_s)
    with pytest.raises(ValueError, match="order"):
        spindoe.fit_spin(TIMES, xyzw, order="zyxw")


def test_wrong_and_missing_ones_are_left_out():
    rows = np.roll(_sequence(0.02).as_quat(), 1, axis=1)
    rows[3] = np.roll(Rotation.random(random_state=9).as_quat(), 1)
    rows[6] = np.nan
    found = spindoe.fit_spin(TIMES, rows)
    assert found and found.inliers == 10
    assert np.flatnonzero(found.inlier_probabilities < 0.5).tolist() == [3]
    std = found.std_rad_s
    assert std is not None and np.all(np.abs(found.spin_rad_s - SPIN) < 5 * std)
    assert found.std_rps is not None and 0 < found.std_rps < 2
    assert pickle.loads(pickle.dumps(found)).rps == found.rps
    assert "rps" in repr(found)


def test_aliases_of_even_times():
    # None is listed above the largest spin that is considered.
    found = spindoe.fit_spin(TIMES, _sequence(0.01), max_rps=170.0)
    assert found and not found.aliases
    found = spindoe.fit_spin(TIMES, _sequence(0.01), max_rps=345.0)
    assert found and found.aliases
    rates = [np.linalg.norm(a.spin_rad_s) / (2 * np.pi) for a in found.aliases]
    assert min(abs(rate - (350.0 - found.rps)) for rate in rates) < 2.0


def test_the_papers_method():
    found = spindoe.fit_spin(TIMES, _sequence(0.01), method="quatera")
    assert found and np.allclose(found.spin_rad_s, SPIN, rtol=0.05)
    assert found.covariance is None and found.std_rps is None and found.std_rad_s is None


def test_what_has_no_spin_is_rejected():
    few = spindoe.fit_spin(TIMES[:2], _sequence()[:2])
    assert not few and "at least 3" in few.reason
    wild = spindoe.fit_spin(TIMES, Rotation.random(len(TIMES), random_state=3))
    assert not wild and "no spin" in wild.reason


@pytest.mark.parametrize(
    ("times", "rows", "words"),
    [
        (TIMES[::-1], None, "not earlier"),
        (TIMES[:3], None, "shape"),
        (TIMES * np.nan, None, "finite"),
        (TIMES * 1e-9, None, "in seconds"),
        (TIMES * 1e9, None, "in seconds"),
        (TIMES, np.ones((12, 4)), "unit quaternion"),
        (TIMES, np.ones((12, 3)), "shape"),
        (TIMES[:, None], None, "shape"),
    ],
)
def test_bad_input_is_named(times, rows, words):
    rows = np.roll(_sequence().as_quat(), 1, axis=1) if rows is None else rows
    with pytest.raises(ValueError, match=words):
        spindoe.fit_spin(times, rows)


def test_residuals_widen_the_covariance():
    rotations = _sequence(0.02)
    plain, wide = (
        spindoe.fit_spin(TIMES, rotations, residuals_rad=residuals)
        for residuals in (None, np.full(len(TIMES), 0.05))
    )
    assert plain and wide
    # Equal residuals say nothing of the frames' weights.
    assert np.allclose(plain.spin_rad_s, wide.spin_rad_s, rtol=0, atol=1e-9)
    assert np.all(np.linalg.eigvalsh(wide.covariance - plain.covariance) > 0.0)
    for bad in ({"residuals_rad": [0.1]}, {"residuals_rad": np.full(12, -0.1)},
                {"residuals_rad": np.full(12, np.nan)}, {"matched": [3]}, {"matched": [-1] * 12}):
        with pytest.raises(ValueError, match=next(iter(bad))):
            spindoe.fit_spin(TIMES, rotations, **bad)


def test_settings_are_checked():
    for settings in ({"max_rps": -1.0}, {"sigma_rad": 0.0}, {"prior_rps": (50.0, 0.0)}, {"method": "best"}):
        with pytest.raises(ValueError):
            spindoe.fit_spin(TIMES, _sequence(), **settings)


@settings(deadline=None, max_examples=50)
@given(
    st.floats(-300.0, 300.0), st.floats(-300.0, 300.0), st.floats(-300.0, 300.0), st.integers(0, 99)
)
def test_any_spin_below_the_limit_is_found(x, y, z, seed):
    spin = np.array([x, y, z])
    times = np.cumsum(np.random.default_rng(seed).uniform(0.5, 1.5, 15)) / 400.0
    rotations = Rotation.from_rotvec((times - times[0])[:, None] * spin)
    found = spindoe.fit_spin(times, rotations)
    assert found and np.allclose(found.spin_rad_s, spin, atol=1e-3)
