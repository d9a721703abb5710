"""The drop-in: signatures, shapes, and the truth of what it returns."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from spindoe.compat import BayGeoHasher, SpinRegressor


def test_signatures_are_the_authors():
    hasher = inspect.signature(BayGeoHasher).parameters
    assert {name: p.default for name, p in hasher.items() if p.kind is p.POSITIONAL_OR_KEYWORD} == {
        "threshold": -5e4, "k_neighbour": 20, "upper_score_perc": 50, "projection_ll_scale": 0.03,
        "min_feature_dist": 3, "kappa": 5e2, "beta": 0,
    }
    regressor = inspect.signature(SpinRegressor).parameters
    assert {name: p.default for name, p in regressor.items() if p.kind is p.POSITIONAL_OR_KEYWORD} == {
        "n": 3, "k": 10, "t": 5e-2, "d": 3,
    }


@pytest.mark.parametrize("recognizer", ["robust", "paper"])
def test_dots_are_identified(pattern, recognizer):
    hasher = BayGeoHasher(recognizer=recognizer)
    hasher.gen_hash_table(np.array(pattern.dots))
    assert hasher.n_points == 20 and hasher.hash_table.shape == (6840, 3)
    assert hasher.bases.shape == (6840, 2)
    right = 0
    for seed in range(20):
        truth = Rotation.random(random_state=seed)
        dots = truth.apply(pattern.dots)
        index = np.flatnonzero(dots[:, 2] > 0.3)
        pair, rotation, error = hasher.identify(dots[index] * 1.7)
        right += int(np.array_equal(pair, index[:2]))
        if np.array_equal(pair, index[:2]):
            assert (rotation * truth.inv()).magnitude() < 1e-5 and error < 1e-5
    assert right >= 19


def test_the_hash_table_is_theirs(pattern):
    """As their loops make it: every pair within the distance, every third dot within it of the first."""
    hasher = BayGeoHasher(min_feature_dist=1.2)
    hasher.gen_hash_table(pattern.dots)
    dots, limit = pattern.dots, 1.2
    expected = [
        (i, j, BayGeoHasher.cart2hash(BayGeoHasher.gen_basis(dots[[i, j]]), dots[k]))
        for i in range(20) for j in range(20) if i != j and np.linalg.norm(dots[i] - dots[j]) <= limit
        for k in range(20) if k not in (i, j) and np.linalg.norm(dots[i] - dots[k]) <= limit
    ]
    assert np.array_equal(hasher.bases, [row[:2] for row in expected])
    assert np.allclose(hasher.hash_table, [row[2] for row in expected], atol=1e-9)
    basis = BayGeoHasher.gen_basis(dots[:2])
    assert np.allclose(BayGeoHasher.hash2cart(basis, BayGeoHasher.cart2hash(basis, dots)), dots)


def test_arguments_may_change_between_calls(pattern):
    hasher = BayGeoHasher(recognizer="paper")
    with pytest.raises(RuntimeError, match="gen_hash_table"):
        hasher.identify(pattern.dots)
    hasher.gen_hash_table(pattern.dots)
    view = pattern.dots[pattern.dots[:, 2] > 0.2]
    first = hasher.identify(view)
    hasher.projection_ll_scale = 1.0
    second = hasher.identify(view)
    assert np.array_equal(hasher.identify(view)[0], second[0])
    hasher.projection_ll_scale = 0.03
    assert np.array_equal(hasher.identify(view)[0], first[0])
    hasher.threshold = 0.0
    with pytest.raises(ValueError, match="threshold"):
        hasher.identify(view)


def test_failures(pattern):
    hasher = BayGeoHasher()
    hasher.gen_hash_table(pattern.dots)
    with pytest.raises(ValueError, match="at least 3"):
        hasher.identify(pattern.dots[:2])
    with pytest.raises(ValueError, match="shape"):
        hasher.identify(pattern.dots[0])
    pair, rotation, error = hasher.identify(pattern.dots[pattern.dots[:, 2] > 0] * [-1, 1, 1])
    assert pair.tolist() == [-1, -1] and rotation is None and error == np.inf
    for arguments in ({"kappa": -1}, {"beta": -1}, {"beta": 300}):
        with pytest.raises(ValueError):
            BayGeoHasher(**arguments)


@pytest.mark.parametrize("method", ["robust", "quatera"])
def test_spins(method):
    spin = np.array([20.0, -90.0, 55.0])
    times = np.arange(10) / 350.0
    rots = [Rotation.from_rotvec(t * spin) * Rotation.random(random_state=1) for t in times]
    rots[4] = Rotation.random(random_state=8)
    regressor = SpinRegressor(k=40, method=method)
    found, valid = regressor.RANSAC_regress(times, rots)
    assert np.allclose(found, spin, atol=0.5)
    assert valid.tolist() == [0, 1, 2, 3, 5, 6, 7, 8, 9]
    found, first = regressor.regress(times, rots)
    assert np.allclose(found, spin, atol=0.5)
    assert (first * rots[0].inv()).magnitude() < 0.01


def test_no_spin():
    times = np.arange(10) / 350.0
    assert SpinRegressor().RANSAC_regress(times, Rotation.random(10, random_state=0)) == (None, None)
    with pytest.raises(ValueError, match="one for each"):
        SpinRegressor().RANSAC_regress(times, Rotation.random(9, random_state=0))
