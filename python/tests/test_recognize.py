"""Recognizers: answers, arrays of every kind, and bad input."""

from __future__ import annotations

import gc
import pickle
import threading

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.spatial.transform import Rotation

import spindoe


def _turned(pattern, seed, noise=0.0, limit=0.2):
    rng = np.random.default_rng(seed)
    truth = Rotation.random(random_state=seed)
    dots = truth.apply(pattern.dots)
    index = rng.permutation(np.flatnonzero(dots[:, 2] > limit))
    seen = dots[index] + noise * rng.normal(size=(len(index), 3))
    return truth, index, seen / np.linalg.norm(seen, axis=1, keepdims=True)


def test_dots_get_their_names_and_the_ball_its_orientation(pattern, recognizer):
    for seed in range(50):
        truth, index, dots = _turned(pattern, seed, noise=0.02)
        found = recognizer.identify(dots)
        assert found and np.array_equal(found.assignment, index)
        assert (found.as_rotation() * truth.inv()).magnitude() < 0.05
        assert found.matched == len(index)
        assert 0.9 < found.dots_confidence <= found.confidence <= 1.0


def test_a_false_dot_gets_no_name(pattern, recognizer):
    truth, index, dots = _turned(pattern, 3)
    names = truth.apply(pattern.dots)
    rng = np.random.default_rng(0)
    while True:
        false = rng.normal(size=3)
        false /= np.linalg.norm(false)
        if false[2] > 0.3 and (names @ false).max() < np.cos(0.25):
            break
    found = recognizer.identify(np.vstack([dots, false]))
    assert found and found.assignment[-1] == -1
    assert np.array_equal(found.assignment[:-1], index)


def test_a_rejection_is_false_and_has_a_reason(view, recognizer):
    found = recognizer.identify(view[:2])
    assert not found and "too few dots: 2" in found.reason
    mirrored = recognizer.identify(view * [-1.0, 1.0, 1.0])
    assert not mirrored and "mirror" in mirrored.reason
    assert pickle.loads(pickle.dumps(found)) == found


def test_ambiguous_orientations_are_rejected(table, pattern):
    """Few and noisy dots: what is less probable than asked for is no answer, alone or in a batch."""
    views = [_turned(pattern, seed, noise=0.05)[2][:5] for seed in range(60)]
    every = spindoe.Recognizer(table, min_confidence=0.0)
    least = 0.7
    strict = spindoe.Recognizer(table, min_confidence=least)
    found = [(every.identify(view), strict.identify(view)) for view in views]
    doubtful = [bool(a) and a.confidence < least for a, _ in found]
    assert 0 < sum(doubtful) < len(views)
    for (a, b), is_doubtful in zip(found, doubtful, strict=True):
        if is_doubtful:
            assert b.reason == f"ambiguous: the best pose has a probability of {a.confidence:.2f}"
        elif a:
            assert b and np.array_equal(a.quaternion_wxyz, b.quaternion_wxyz)
    batch = strict.identify_batch(views)
    assert [bool(b) for b in batch] == [bool(b) for _, b in found]
    assert all(one == b for one, (_, b) in zip(batch, found, strict=True) if not b)
    for bad in (-0.1, 1.1, float("nan")):
        with pytest.raises(ValueError, match="min_confidence"):
            spindoe.Recognizer(table, min_confidence=bad)


def test_the_same_uncertainty_said_in_three_ways(view, recognizer):
    sigma = 0.03
    plain = recognizer.identify(view, sigma_rad=sigma)
    each = recognizer.identify(view, sigma_rad=np.full(len(view), sigma))
    flat = recognizer.identify(view, np.tile(sigma**2 * np.eye(2), (len(view), 1, 1)))
    space = recognizer.identify(view, np.tile(sigma**2 * np.eye(3), (len(view), 1, 1)))
    assert plain and each and flat and space
    assert each.dots_confidence == plain.dots_confidence
    for other in (flat, space):
        assert other.dots_confidence == pytest.approx(plain.dots_confidence, rel=1e-9)
        assert np.allclose(other.quaternion_wxyz, plain.quaternion_wxyz, atol=1e-12)


def test_image_axes_point_outward_and_across(pattern):
    """A covariance along one image axis is that of the same direction in space."""
    truth, _, dots = _turned(pattern, 11, noise=0.03)
    recognizer = spindoe.Recognizer(pattern)
    outward = dots * dots[:, 2:] - [0.0, 0.0, 1.0]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    across = np.cross(dots, outward)
    radial, tangential, mixed = 0.05**2, 0.02**2, 0.0004
    in_image = np.tile([[radial, mixed], [mixed, tangential]], (len(dots), 1, 1))
    axes = np.stack([outward, across], axis=2)
    in_space = axes @ in_image @ axes.transpose(0, 2, 1)
    a, b = recognizer.identify(dots, in_image), recognizer.identify(dots, in_space)
    assert a and b
    assert np.allclose(a.quaternion_wxyz, b.quaternion_wxyz, atol=1e-9)
    assert a.dots_confidence == pytest.approx(b.dots_confidence, abs=1e-9)


def test_a_hint_helps_two_dots(table, pattern):
    # Two dots where eight are expected are doubtful whatever the hint says.
    recognizer = spindoe.Recognizer(table, min_confidence=0.0)
    truth, index, dots = _turned(pattern, 5)
    w_last = truth.as_quat()
    hint = spindoe.Hint(np.roll(w_last, 1), 0.02)
    found = recognizer.identify(dots[:2], hint=hint)
    assert found and np.array_equal(found.assignment, index[:2])
    full = spindoe.Hint(np.roll(w_last, 1), 0.02**2 * np.eye(3))
    again = recognizer.identify(dots[:2], hint=full)
    assert again and np.array_equal(again.quaternion_wxyz, found.quaternion_wxyz)
    with pytest.raises(ValueError, match="hint.quaternion_wxyz"):
        recognizer.identify(dots, hint=spindoe.Hint([2.0, 0, 0, 0], 0.1))
    with pytest.raises(ValueError, match="positive definite"):
        recognizer.identify(dots, hint=spindoe.Hint([1.0, 0, 0, 0], -np.eye(3)))
    with pytest.raises(ValueError, match="hint.wrong"):
        recognizer.identify(dots, hint=spindoe.Hint([1.0, 0, 0, 0], 0.1, wrong=2.0))


def test_a_symmetric_pattern_has_rivals():
    square = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]
    dots = np.array(square) * np.cos(0.9) + [0, 0, np.sin(0.9)]
    below = dots * [1, 1, -1]
    symmetric = spindoe.Pattern(np.vstack([dots, below]))
    assert "ambiguous" in spindoe.Recognizer(symmetric).identify(dots).reason
    recognizer = spindoe.Recognizer(symmetric, min_confidence=0.0)
    found = recognizer.identify(dots, max_rivals=20)
    assert found and len(found.rivals) >= 3
    assert recognizer.identify(dots, max_rivals=0).rivals == ()
    assert found.rivals[0].as_rotation().magnitude() >= 0.0


def test_batches_answer_as_single_views_do(pattern, recognizer):
    frames = [_turned(pattern, seed, noise=0.03)[2] for seed in range(200)]
    frames[7] = frames[7][:2]
    frames[8] = np.zeros((0, 3))
    batch = recognizer.identify_batch(frames)
    assert len(batch) == 200 and not batch.identified[7] and not batch.identified[8]
    for frame, found in zip(frames, batch, strict=True):
        single = recognizer.identify(frame)
        assert bool(single) == bool(found)
        if single:
            assert np.array_equal(single.quaternion_wxyz, found.quaternion_wxyz)
            assert np.array_equal(single.assignment, found.assignment)
            assert single.dots_confidence == found.dots_confidence
        else:
            assert single == found
    flat = recognizer.identify_batch(np.concatenate(frames), batch.offsets)
    assert np.array_equal(flat.assignment, batch.assignment)
    assert batch[-1].dots_confidence == batch[199].dots_confidence and len(batch[3:5]) == 2
    assert len(batch.as_rotations()) == batch.identified.sum()
    assert len(recognizer.identify_batch([])) == 0
    with pytest.raises(IndexError):
        batch[200]


@pytest.mark.parametrize("offsets", [[0, 3, 2, 8], [1, 8], [0, 9], [], [0.0, 8.0], [[0, 8]], [-1, 8]])
def test_bad_offsets_are_refused(view, recognizer, offsets):
    with pytest.raises(ValueError, match="offsets"):
        recognizer.identify_batch(np.tile(view, (2, 1))[:8], offsets)


@pytest.mark.parametrize(
    ("dots", "words"),
    [
        (np.zeros((4, 2)), r"dots: expected shape \(n, 3\), found \[4, 2\]"),
        (np.zeros(3), "dots: expected shape"),
        (np.zeros((2, 4, 3)), "dots: expected shape"),
        (np.zeros((4, 3)), "row 0: expected a unit vector"),
        (np.full((4, 3), np.nan), "row 0: expected finite"),
        (np.array([[0.0, 0, 1], [np.inf, 0, 0]]), "row 1: expected finite"),
        (None, "dots: expected real numbers"),
        ("dots", "dots: expected real numbers"),
    ],
)
def test_bad_dots_are_named(recognizer, dots, words):
    with pytest.raises(ValueError, match=words):
        recognizer.identify(dots)


@pytest.mark.parametrize(
    "covariances",
    [np.eye(2), np.zeros((3, 2, 2)), np.zeros((8, 3, 2)), -np.ones((8, 2, 2)), np.full((8, 3, 3), np.nan)],
)
def test_bad_covariances_are_named(view, recognizer, covariances):
    with pytest.raises(ValueError, match="covariances"):
        recognizer.identify(view[:8], covariances)


def test_bad_sigmas_are_named(view, recognizer):
    for sigma in (0.0, -1.0, np.nan, np.ones(3)):
        with pytest.raises(ValueError, match="sigma_rad"):
            recognizer.identify(view, sigma_rad=sigma)


def test_settings_are_checked(table):
    with pytest.raises(ValueError, match="foreign_share"):
        spindoe.Recognizer(table, foreign_share=2.0)
    with pytest.raises(ValueError, match="no such setting"):
        spindoe.Recognizer(table, nul_prior=0.2)
    with pytest.raises(ValueError, match="recognizer"):
        spindoe.Recognizer(table, "best")
    with pytest.raises(ValueError, match="protocol"):
        spindoe.Recognizer(table, expect="none")
    with pytest.raises(ValueError, match="finite"):
        spindoe.Recognizer(table, foreign_share=float("nan"))
    made = spindoe.Recognizer(table, foreign_share=np.float64(0.3))
    assert made.settings["foreign_share"] == 0.3


def test_a_setting_takes_the_place_of_what_the_protocol_states(table):
    def found(expect, **given):
        return spindoe.Recognizer(table, expect=expect, **given).settings

    stated = found("clutter")
    assert stated["usual_false_dots"] == 2 and stated["expected_false_dots"] == 2.0
    assert stated["foreign_share"] == 0.0 and stated["noise"] == "random_axis"
    mean = found("clutter", expected_false_dots=0.5)
    assert mean["expected_false_dots"] == 0.5 and mean["usual_false_dots"] is None
    number = found(None, usual_false_dots=1)
    assert number["expected_false_dots"] == 1.0 and number["usual_false_dots"] == 1
    assert found("clutter", usual_false_dots=None)["expected_false_dots"] == 2.0
    # Four of on average 6.7 visible dots are given.
    assert found("sparse")["detection_probability"] == pytest.approx(0.6)
    assert found("sparse", detection_probability=0.7)["detection_probability"] == 0.7
    for noise, name in (("gaussian", "heavy_tailed"), ("normal", "normal"), ("random_axis",) * 2):
        assert found(None, noise=noise)["noise"] == name


@settings(deadline=None, max_examples=60)
@given(
    order=st.sampled_from("CF"),
    dtype=st.sampled_from([np.float64, np.float32, np.longdouble]),
    step=st.sampled_from([1, 2, -1]),
    writable=st.booleans(),
    swapped=st.booleans(),
)
def test_memory_layout_does_not_matter(view, recognizer, order, dtype, step, writable, swapped):
    plain = recognizer.identify(np.ascontiguousarray(view.astype(np.float32).astype(np.float64)))
    spread = np.zeros((2 * len(view), 5), dtype=dtype, order=order)
    spread[::2, 1:4] = view.astype(np.float32)
    laid = spread[::2, 1:4]
    if step == -1:
        laid = np.ascontiguousarray(laid[::-1])[::-1]
    elif step == 2:
        laid = np.repeat(laid, 2, axis=0)[::2]
    if swapped and dtype is not np.longdouble:
        laid = laid.astype(np.dtype(dtype).newbyteorder())
    laid = laid.view() if writable else laid.copy(order)
    laid.flags.writeable = writable
    found = recognizer.identify(laid)
    assert found and plain
    assert np.array_equal(found.quaternion_wxyz, plain.quaternion_wxyz)


@settings(deadline=None, max_examples=200)
@given(
    arrays.arrays(
        st.sampled_from([np.float64, np.float32, np.int64, np.uint8, np.bool_]),
        arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=6),
    )
)
def test_any_array_is_answered_or_refused(recognizer, dots):
    try:
        found = recognizer.identify(dots)
    except ValueError as error:
        assert str(error).startswith("dots: ")
    else:
        assert found or found.reason


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(0, 12))
def test_any_directions_are_answered_or_rejected(recognizer, seed, count):
    dots = np.random.default_rng(seed).normal(size=(count, 3))
    dots /= np.linalg.norm(dots, axis=1, keepdims=True)
    found = recognizer.identify(dots)
    if found:
        assert found.assignment.shape == (count,)
        assert np.linalg.norm(found.quaternion_wxyz) == pytest.approx(1.0)
        named = found.assignment[found.assignment >= 0]
        assert len(set(named)) == len(named)


def test_recognizers_pickle(table, view):
    for recognizer in (
        spindoe.Recognizer(table, expect="clutter", sigma_rad=0.04, passes=32),
        spindoe.Recognizer(table, "voting", k=10),
    ):
        again = pickle.loads(pickle.dumps(recognizer))
        assert again.settings == recognizer.settings
        a, b = recognizer.identify(view), again.identify(view)
        assert a and b and np.array_equal(a.quaternion_wxyz, b.quaternion_wxyz)
        c = pickle.loads(pickle.dumps(a))
        assert np.array_equal(c.assignment, a.assignment) and repr(c) == repr(a)


def test_threads_share_a_recognizer(pattern, recognizer):
    views = [_turned(pattern, seed, noise=0.03)[2] for seed in range(40)]
    expected = [recognizer.identify(v).quaternion_wxyz for v in views]
    wrong = []

    def work() -> None:
        for _ in range(5):
            for dots, quaternion in zip(views, expected, strict=True):
                if not np.array_equal(recognizer.identify(dots).quaternion_wxyz, quaternion):
                    wrong.append(dots)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_memory_stays_flat(view, recognizer):
    def resident() -> int:
        gc.collect()
        with open("/proc/self/statm") as statm:
            return int(statm.read().split()[1]) * 4096

    try:
        resident()
    except OSError:
        pytest.skip("no /proc")
    few = view[:5]
    for _ in range(2_000):
        recognizer.identify(few)
    before = resident()
    for k in range(20_000):
        recognizer.identify(few)
        if k % 4 == 0:
            recognizer.identify(few[:2])
            with pytest.raises(ValueError):
                recognizer.identify(few[:, :2])
    assert resident() - before < 4e6
