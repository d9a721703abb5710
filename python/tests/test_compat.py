"""The drop-in: signatures, shapes, and the truth of what it returns."""

from __future__ import annotations

import inspect
import os
import pickle
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import scipy
from conftest import ROOT
from scipy.spatial.transform import Rotation

import spindoe
import spindoe_compat
from spindoe import compat
from spindoe.compat import DOE, BayGeoHasher, SpinDOE, SpinRegressor


def test_signatures_are_the_authors():
    hasher = inspect.signature(BayGeoHasher).parameters
    assert {name: p.default for name, p in hasher.items() if p.kind is p.POSITIONAL_OR_KEYWORD} == {
        "threshold": -5e4, "k_neighbour": 20, "upper_score_perc": 50, "projection_ll_scale": 0.03,
        "min_feature_dist": 3, "kappa": 5e2, "beta": 0,
    }
    regressor = inspect.signature(SpinRegressor).parameters
    assert {name: p.default for name, p in regressor.items() if p.kind is p.POSITIONAL_OR_KEYWORD} == {
        "n": 4, "k": 30, "t": 5e-2, "d": 2,
    }
    older = SpinRegressor(n=3, k=10, d=3)
    assert (older.n, older.k, older.t, older.d) == (3, 10, 5e-2, 3)
    theirs = [
        (DOE, ["dot_detector_model_path", "use_gpu"]), (DOE.estimate_single, ["self", "img"]),
        (DOE.estimate_multi, ["self", "imgs"]), (DOE.reproject_dots, ["self", "rot", "img", "color"]),
        (DOE.kps2pt3d, ["self", "kps"]), (SpinDOE, ["dot_detector_model"]), (SpinDOE.estimate, ["self", "t", "imgs"]),
        (SpinDOE.predicted_rots, ["self", "init_rot", "t0", "ts", "spin_vec"]),
        (BayGeoHasher.verification, ["self", "i", "j", "obs_points"]), (SpinRegressor.rot2quat, ["rot"]),
    ]
    for function, names in theirs:
        parameters = inspect.signature(function).parameters.values()
        assert [p.name for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD] == names


@pytest.mark.parametrize("recognizer", ["robust", "voting"])
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


def test_the_trees_are_of_the_table_and_the_pattern(pattern):
    hasher = BayGeoHasher()
    hasher.gen_hash_table(pattern.dots)
    wanted = np.array([0.4, -0.7, 1.1])
    distances, nearest = hasher.hash_tree.query(wanted, 20)
    brute = np.linalg.norm(hasher.hash_table - wanted, axis=1)
    assert np.allclose(distances, np.sort(brute)[:20]) and nearest[0] == np.argmin(brute)
    assert hasher.point_tree.query(pattern.dots[7] * 1.01)[1] == 7


def laid(onto: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The rotation matrix that lays points onto others, by the singular value decomposition (Kabsch)."""
    u, _, v = np.linalg.svd(onto.T @ points)
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v


def test_verification_lays_the_pattern_onto_the_dots(pattern):
    hasher = BayGeoHasher()
    with pytest.raises(RuntimeError, match="gen_hash_table"):
        hasher.verification(0, 1, pattern.dots)
    hasher.gen_hash_table(pattern.dots)
    rng = np.random.default_rng(5)
    truth = Rotation.random(random_state=5)
    seen = truth.apply(pattern.dots)
    index = rng.permutation(np.flatnonzero(seen[:, 2] > 0.2))
    dots = seen[index] + rng.normal(0.0, 0.01, (len(index), 3))
    unit = dots / np.linalg.norm(dots, axis=1, keepdims=True)
    rotation, rmse = hasher.verification(index[0], index[1], dots)
    matrix = laid(unit, pattern.dots[index])
    assert np.allclose(rotation.as_matrix(), matrix, atol=1e-9)
    off = unit - pattern.dots[index] @ matrix.T
    assert rmse == pytest.approx(np.sqrt(np.mean(np.sum(off**2, axis=1))), rel=1e-9)
    assert (rotation * truth.inv()).magnitude() < 0.02
    # Another pair: nearest dots that do not fit, and an error that says so.
    assert hasher.verification(index[1], index[0], dots)[1] > 10 * rmse
    with pytest.raises(ValueError, match="at least 3"):
        hasher.verification(0, 1, dots[:2])


def test_arguments_may_change_between_calls(pattern):
    hasher = BayGeoHasher(recognizer="voting")
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


def test_quaternions_are_scalar_first():
    half, axis = 0.3, np.array([2.0, -1.0, 2.0]) / 3.0
    q = SpinRegressor().rot2quat(Rotation.from_rotvec(2.0 * half * axis))
    assert np.allclose(q, [np.cos(half), *(np.sin(half) * axis)], atol=1e-12)
    assert np.allclose(SpinRegressor.quat2rot(q).as_rotvec(), 2.0 * half * axis, atol=1e-12)


def turning(spin: np.ndarray, times: np.ndarray, seed: int) -> Rotation:
    """Orientations of a ball that spins: R(t) = exp([w]x t) R(0)."""
    return Rotation.from_rotvec(times[:, None] * spin) * Rotation.random(random_state=seed)


@pytest.mark.parametrize("method", ["robust", "quatera"])
@pytest.mark.parametrize("seed", range(6))
def test_the_spin_has_the_sign_of_the_motion(method, seed):
    rng = np.random.default_rng(seed)
    spin = rng.normal(size=3) * 60.0
    times = np.arange(12) / 380.0
    found, valid = SpinRegressor(method=method).RANSAC_regress(times, turning(spin, times, seed))
    assert np.allclose(found, spin, atol=0.05) and valid.tolist() == list(range(12))


@pytest.mark.parametrize("inverse", ["conjugate", "negated conjugate"])
def test_where_the_minus_sign_of_the_authors_came_from(inverse):
    """The axis of their formula is that of u2 * inverse(u1), for the plane u1, u2 of the quaternions, and the rate the slope of
    the angle in it. SciPy's `inv` gave the negated conjugate up to 1.10, and gives the conjugate since 1.11; both are the same
    rotation. Only with the former is a minus sign right."""
    spin, times = np.array([20.0, -90.0, 55.0]), np.arange(10) / 350.0
    y = np.roll(turning(spin, times, 1).as_quat(), 1, axis=1)
    (u1, u2, *_), _, _ = (part.T for part in np.linalg.svd(y.T @ y))
    other = u1 * [1.0, -1.0, -1.0, -1.0] * (1.0 if inverse == "conjugate" else -1.0)
    # The vector part of the product u2 * other.
    axis = u2[0] * other[1:] + other[0] * u2[1:] + np.cross(u2[1:], other[1:])
    slope = np.polyfit(times, np.unwrap(2.0 * np.arctan2(y @ u2, y @ u1)), 1)[0]
    assert np.allclose(axis * slope, spin if inverse == "conjugate" else -spin, atol=1e-6)
    if tuple(map(int, scipy.__version__.split(".")[:2])) >= (1, 11):
        some = Rotation.from_quat([0.1, 0.2, 0.3, 0.4])
        assert np.allclose(some.inv().as_quat() * some.as_quat(), some.as_quat() ** 2 * [-1, -1, -1, 1])


SPIN = np.array([40.0, 150.0, -60.0])


@pytest.fixture(scope="module")
def clip(pattern):
    drawn = spindoe.synth(
        pattern, 12, seed=4, fps=350.0, spin_rad_s=SPIN, ball_px=[100, 100], camera_distance_radii=[20, 20]
    )
    # As cv2.imread has them.
    return [(np.ascontiguousarray(image[..., ::-1]), truth) for image, truth in drawn]


def test_orientations_of_images(clip, pattern):
    doe = DOE(None, pattern=pattern)
    image, truth = clip[0]
    rot, heatmap, mask, keypoints = doe.estimate_single(image)
    assert (rot * truth.as_rotation().inv()).magnitude() < np.deg2rad(8.0)
    assert doe.last.pose.confidence > 0.9
    assert heatmap.shape == mask.shape == (60, 60) and 0.9 < heatmap.max() <= 1.0
    assert set(np.unique(mask)) == {0, 255} and np.array_equal(mask == 255, heatmap >= 0.1)
    # A visible dot is where the heat map is high, and a keypoint of its own.
    height, width, _ = image.shape
    places = (truth.dots[truth.visible] + 0.5) * [60 / width, 60 / height] - 0.5
    u, v = np.rint(places).astype(int).T
    assert np.mean(heatmap[v, u] > 0.5) > 0.8 and heatmap.mean() < 0.2
    found = np.array([dot.pt for dot in keypoints])
    off = np.linalg.norm(places[:, None] - found[None], axis=2).min(axis=1)
    assert np.mean(off < 1.0) > 0.8
    rots, heatmaps, masks, nothing = doe.estimate_multi([image for image, _ in clip])
    assert len(rots) == len(masks) == 12 and heatmaps.shape == (12, 60, 60) and nothing is None
    assert np.array_equal(heatmaps[0], heatmap) and (rots[0] * rot.inv()).magnitude() < 1e-9
    doe.rmse_thres = 0.0
    assert doe.estimate_single(image)[0] is None


def test_keypoints_lie_on_the_ball(pattern):
    """Of a ball that fills the image, along parallel rays: its center, right and upper limb, and beyond."""
    doe = DOE(None, pattern=pattern)
    places = [(30.0, 30.0), (60.0, 30.0), (30.0, 0.0), (45.0, 15.0), (60.0, 0.0)]
    found = doe.kps2pt3d([compat.KeyPoint(place, 3.0, 1.0) for place in places])
    expected = [[0, 0, 1], [1, 0, 0], [0, 1, 0], [0.5, 0.5, np.sqrt(0.5)], [1, 1, 0]]
    assert np.allclose(found, expected)
    assert doe.kps2pt3d([]).shape == (0, 3)


def test_dots_are_drawn_where_the_rotation_has_them(pattern):
    doe = DOE(None, pattern=pattern)
    rot = Rotation.random(random_state=3)
    image = np.zeros((200, 200, 3), np.uint8)
    drawn = doe.reproject_dots(rot, image)
    assert not image.any()
    seen = rot.apply(pattern.dots)
    for x, y, z in seen:
        u, v = round(100.0 * (1.0 + x) - 0.5), round(100.0 * (1.0 - y) - 0.5)
        is_drawn = 0 <= u < 200 and 0 <= v < 200 and tuple(drawn[v, u]) == doe.dot_color
        assert is_drawn == (z > 0.0) or np.hypot(*(seen[:, :2] - [x, y]).T).tolist().count(0.0) > 1
    # Five pixels a dot, and the z axis where it is visible.
    assert np.count_nonzero(drawn[..., 0]) == 5 * np.count_nonzero(seen[:, 2] > 0.0)
    assert np.count_nonzero(drawn[..., 1]) == 5 * (rot.apply([0.0, 0.0, 1.0])[2] > 0.0)
    assert doe.reproject_dots(rot, image[..., 0], (7,)).max() == 7


def test_the_spin_of_images(clip, pattern):
    images, truths = [image for image, _ in clip], [truth for _, truth in clip]
    images[5] = np.zeros_like(images[5])
    times = np.array([truth.time_s for truth in truths])
    estimator = SpinDOE(None, pattern=pattern)
    spin, rots, heatmaps, valid_idx = estimator.estimate(times, images)
    assert np.linalg.norm(spin - SPIN) < 8.0
    assert len(rots) == len(heatmaps) == 12 and rots[5] is None and heatmaps[5].shape == (60, 60)
    # Indices of the images, not of those that have an orientation.
    assert valid_idx.dtype == np.int64 and 5 not in valid_idx and len(valid_idx) >= 8 and max(valid_idx) > 9
    predicted = estimator.predicted_rots(rots[valid_idx[0]], times[valid_idx[0]], times, spin)
    for k in valid_idx:
        assert (predicted[int(k)] * truths[k].as_rotation().inv()).magnitude() < np.deg2rad(10.0)
    none, rots, _, valid_idx = estimator.estimate(times[:4], images[:4])
    assert none is None and valid_idx.tolist() == [i for i, rot in enumerate(rots) if rot is not None]
    with pytest.raises(ValueError, match="t: expected one for each of 12 images"):
        estimator.estimate(times[:3], images)


def test_what_a_detector_model_may_be(pattern, tmp_path, monkeypatch):
    with pytest.warns(UserWarning, match="dot_detector_model_path: .*spindoe.ckpt is not read, the built-in net"):
        DOE(tmp_path / "spindoe.ckpt", True, pattern=pattern)
    with pytest.raises(FileNotFoundError, match=r"weights.npz"):
        DOE(tmp_path / "weights.npz", pattern=pattern)
    with pytest.raises(FileNotFoundError, match=r"\.\./cad/ref_pattern.csv"):
        DOE(None)
    (tmp_path / "cad").mkdir()
    (tmp_path / "python").mkdir()
    pattern.save(tmp_path / "cad/ref_pattern.csv")
    monkeypatch.chdir(tmp_path / "python")
    assert np.array_equal(DOE(None).ref_pattern, pattern.dots)


def test_both_names_are_the_same_classes():
    assert set(spindoe_compat.__all__) == set(compat.__all__)
    for name in compat.__all__:
        assert getattr(spindoe_compat, name) is getattr(compat, name)


def test_a_file_that_hides_the_package(pattern, tmp_path):
    """A script in a folder with a `spindoe.py`, before and after that is imported: it keeps its own, and has the drop-in."""
    (tmp_path / "spindoe.py").write_text("from spindoe_compat import SpinRegressor\nMINE = 1\n")
    script = """
        import pickle, sys
        {first}
        from spindoe_compat import DOE, BayGeoHasher, SpinDOE
        import spindoe, spindoe_compat
        assert spindoe.MINE == 1 and spindoe.SpinRegressor is spindoe_compat.SpinRegressor
        import numpy as np
        dots = np.loadtxt("pattern.csv", delimiter=",")
        hasher = BayGeoHasher()
        hasher.gen_hash_table(dots)
        index = np.flatnonzero(dots[:, 2] > 0.2)
        pair, rotation, error = hasher.identify(dots[index])
        assert (pair == index[:2]).all() and rotation.magnitude() < 1e-6 and error < 1e-6
        found = DOE(None, pattern="pattern.csv").estimate_single(np.zeros((60, 60), np.uint8))
        assert found[0] is None
        sys.stdout.buffer.write(pickle.dumps((hasher.last, hasher._table)))
    """
    pattern.save(tmp_path / "pattern.csv")
    packages = str(Path(spindoe.__file__).parents[1])
    for first in ("import spindoe", ""):
        (tmp_path / "script.py").write_text(textwrap.dedent(script.format(first=first)))
        done = subprocess.run(
            [sys.executable, str(tmp_path / "script.py")], capture_output=True, check=False, cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": packages},
        )
        assert done.returncode == 0, done.stderr.decode()
    # What was pickled there is read by a process of its own kind.
    (tmp_path / "found.pickle").write_bytes(done.stdout)
    words = "import pickle; found, table = pickle.load(open('found.pickle', 'rb')); print(found.matched, len(table.pattern))"
    again = subprocess.run(
        [sys.executable, "-c", words], capture_output=True, text=True, check=False, cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": packages},
    )
    assert again.stdout.split() == [str(np.count_nonzero(pattern.dots[:, 2] > 0.2)), "20"], again.stderr
    # And by one that has the package by its name: as its own classes.
    found, table = pickle.loads(done.stdout)
    assert isinstance(found, spindoe.Identification) and table.pattern == pattern


def test_the_page_of_their_scripts(clip, pattern, tmp_path):
    """Its script runs in a folder like theirs, beside a `spindoe.py`; what it says is there is, what it says is not is not."""
    page = (ROOT / "docs/authors.md").read_text()
    section = page.split("\n## spindoe.py\n")[1].split("\n## ")[0]
    script = "\n".join(line[4:] for line in section.splitlines() if line.startswith("    ") or not line)
    for folder in ("python", "cad", "data/test"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "python/spindoe.py").write_text("raise ImportError('this is theirs')")
    (tmp_path / "python/script.py").write_text(script)
    pattern.save(tmp_path / "cad/ref_pattern.csv")
    cv2 = pytest.importorskip("cv2")
    for image, truth in clip:
        assert cv2.imwrite(str(tmp_path / f"data/test/{370_000_000_000 + round(truth.time_s * 1e9)}.png"), image)
    done = subprocess.run(
        [sys.executable, "script.py"], capture_output=True, text=True, check=False, cwd=tmp_path / "python",
        env={**os.environ, "PYTHONPATH": str(Path(spindoe.__file__).parents[1])},
    )
    assert done.returncode == 0, done.stderr
    spin = np.array(done.stdout.strip("[]\n").split(), dtype=np.float64)
    assert np.linalg.norm(spin - SPIN) < 8.0
    for line in re.findall(r"from spindoe_compat import ([\w, ]+)", page):
        assert set(line.split(", ")) <= set(compat.__all__)
    absent = page.split("`BayGeoHasher.asSpherical`")[1].split("are not there")[0]
    for name in ["asSpherical", *re.findall(r"`(?:\w+\.)?(\w+)`", absent)]:
        assert not any(hasattr(one, name) for one in (BayGeoHasher, DOE, SpinDOE, SpinRegressor)), name
