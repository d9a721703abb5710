"""Drop-in for the classes of the SpinDOE authors' Python: the same names, arguments and order of the
results, with this package's estimators.

In scripts of theirs change the imports::

    from spindoe_compat import DOE, BayGeoHasher, SpinDOE, SpinRegressor

``spindoe_compat`` is this module under a name that their ``spindoe.py`` does not hide. The signatures are those of the
newest files of https://github.com/cogsys-tuebingen/spindoe, folder ``python``. What differs:

- **The sign of the spin.** `SpinRegressor` returns ``w`` of ``R(t) = exp([w]x (t - t0)) R(t0)``, camera frame. With SciPy 1.11
  or later theirs returns ``-w``: the minus sign in their code made up for quaternions that ``Rotation.inv()`` of older
  versions returned with the other sign. Scripts that turn the spin around again must stop doing so.
- **Rotations** lead from the pattern to the camera throughout.
- The default recognizer is this package's robust one. As theirs it expects that all dots are the
  pattern's and that any of the visible ones may be missing, with the noise that `kappa` says
  (``1 / sqrt(kappa)`` along a tangent axis); `settings` change that. It needs none of the arguments
  that tune the paper's voting; ``recognizer="voting"`` uses them.
- Nothing is printed.
- Where no orientation is found, `BayGeoHasher.identify` returns ``([-1, -1], None, inf)``; theirs
  always returns one. A script that compares the pair, or the error, counts it as a failure.
- Dots are detected by this package's net, and the ball's outline is found: it need not fill the image.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._common import Floats, Rejection, floats, optional, scipy_rotation, to_scipy
from ._draw import discs
from ._frame import FrameEstimate
from ._image import Color, Image, frames_of, pixels
from ._pattern import HashTable, PathLike, Pattern, Tabled, as_ball
from ._recognize import Identification, Recognizer, check_recognizer
from ._vision import Estimator, EstimatorSettings

if TYPE_CHECKING:
    from scipy.spatial import KDTree
    from scipy.spatial.transform import Rotation
    from typing_extensions import Unpack

__all__ = ["DOE", "BayGeoHasher", "KeyPoint", "SpinDOE", "SpinRegressor"]

_LEAST_LOG_LIKELIHOOD = math.log(1e-10)
# What the paper's algorithm takes for granted: a view of this pattern, every dot one of it.
_EXPECTED: dict[str, Any] = {
    "detection_probability": 0.6,
    "usual_false_dots": 0,
    "foreign_share": 1e-6,
    "noise": "random_axis",
}


class BayGeoHasher:
    """Identifies the dots of a view.

    Args:
        threshold: Minimum logarithm of a vote; with ``"voting"`` only values that leave out none are
            supported.
        k_neighbour: Number of nearest features that vote, with ``"voting"``.
        upper_score_perc: Percentile of the scores from which on bases are verified, with ``"voting"``.
        projection_ll_scale: Standard deviation of the dots' distance from the center, with ``"voting"``.
        min_feature_dist: Pairs of dots farther apart than this are left out of `hash_table`.
        kappa: Concentration of the Kent density, with ``"voting"``.
        beta: Its ovalness, with ``"voting"``.
        recognizer: ``"robust"`` or ``"voting"``.
        settings: Further arguments of `spindoe.Recognizer`, for instance ``sigma_rad``.
    """

    def __init__(
        self,
        threshold: float = -5e4,
        k_neighbour: int = 20,
        upper_score_perc: float = 50,
        projection_ll_scale: float = 0.03,
        min_feature_dist: float = 3,
        kappa: float = 5e2,
        beta: float = 0,
        *,
        recognizer: Literal["robust", "voting"] = "robust",
        **settings: Any,
    ) -> None:
        if kappa < 0:
            raise ValueError("kappa: expected a number not below 0")
        if not 0 <= 2 * beta <= kappa:
            raise ValueError("beta: expected 0 <= 2 beta <= kappa")
        self.threshold = threshold
        self.k_neighbour = k_neighbour
        self.upper_score_perc = upper_score_perc
        self.projection_ll_scale = projection_ll_scale
        self.min_feature_dist = min_feature_dist
        self.kappa = kappa
        self.beta = beta
        self.recognizer = recognizer
        self.settings = settings
        self.last: Identification | Rejection | None = None
        """What the last call of `identify` found, with its confidence."""
        self._table: HashTable | None = None
        self._made: tuple[Any, Recognizer] | None = None

    def gen_hash_table(self, ref_points: ArrayLike) -> None:
        """Prepares the recognition of a pattern, shape (n, 3).

        Sets ``n_points``; ``ref_points``, shape (n, 3); ``hash_table``, shape (m, 3), and ``bases``, shape (m, 2), in their
        order; ``hash_tree`` and ``point_tree``, SciPy's k-d trees of the hash values and of the dots.
        """
        tree = optional("scipy.spatial", "scipy").KDTree
        pattern = Pattern(ref_points)
        self.ref_points = np.array(pattern.dots)
        self.n_points = len(pattern)
        self._table = HashTable.build(pattern, min_cross=1e-6, max_angle_rad=math.pi)
        self._made = None
        near = (
            np.linalg.norm(self.ref_points[:, None] - self.ref_points[None], axis=2)
            <= self.min_feature_dist
        )
        first, second = self._table.bases.astype(np.int64).T
        kept = near[first, second] & near[first, self._table.feature_dots.astype(np.int64)]
        self.hash_table = self._table.features[kept]
        self.bases = np.stack([first, second], axis=1)[kept]
        self.hash_tree: KDTree = tree(self.hash_table)
        self.point_tree: KDTree = tree(self.ref_points)

    def _recognizer(self) -> Recognizer:
        """The recognizer of the arguments as they are now: scripts change them between calls."""
        if self._table is None:
            raise RuntimeError("gen_hash_table: expected a call before identify")
        paper: dict[str, Any] = {
            "k": self.k_neighbour,
            "kappa": float(self.kappa),
            "beta": float(self.beta),
            "alpha": float(self.projection_ll_scale),
            "verify_fraction": 1.0 - self.upper_score_perc / 100.0,
        }
        check_recognizer(self.recognizer)
        state = (self.recognizer, tuple(paper.values()), self.min_feature_dist, self.threshold)
        if self._made is None or self._made[0] != state:
            if self.recognizer == "voting":
                if self.min_feature_dist < 2:
                    raise ValueError(
                        "min_feature_dist: expected 2 or more with the paper's recognizer, which "
                        f"keeps all features, found {self.min_feature_dist}"
                    )
                if self.threshold >= _LEAST_LOG_LIKELIHOOD:
                    raise ValueError(
                        f"threshold: expected less than {_LEAST_LOG_LIKELIHOOD:.2f}, the least "
                        f"logarithm of a vote, found {self.threshold}"
                    )
                made = Recognizer(self._table, "voting", **{**paper, **self.settings})
            else:
                noise = {"sigma_rad": 1.0 / math.sqrt(max(self.kappa, 1.0)), "min_confidence": 0.0}
                made = Recognizer(self._table, **{**_EXPECTED, **noise, **self.settings})
            self._made = (state, made)
        return self._made[1]

    def identify(self, obs_points: ArrayLike) -> tuple[NDArray[np.int64], Rotation | None, float]:
        """Identifies observed dots.

        Args:
            obs_points: Directions in the camera frame, shape (n, 3), n >= 3; of any length.

        Returns:
            The indices of the first two dots, shape (2,); SciPy's rotation from the pattern to the
            view; the root mean square distance of the dots from the rotated pattern.
        """
        recognizer = self._recognizer()
        unit = _directions(obs_points)
        self.last = recognizer.identify(unit, max_rivals=0)
        if not self.last:
            return np.array([-1, -1]), None, math.inf
        rotation = self.last.as_rotation()
        seen = rotation.apply(self.ref_points)
        nearest = np.argmax(unit @ seen.T, axis=1)
        indices = np.where(self.last.assignment >= 0, self.last.assignment, nearest)
        squared = np.sum((unit - seen[indices]) ** 2, axis=1)
        return indices[:2], rotation, float(np.sqrt(squared.mean()))

    def verification(self, i: int, j: int, obs_points: ArrayLike) -> tuple[Rotation, float]:
        """The orientation that has the first two dots be the pattern's ``i`` and ``j``: the pair is laid onto them, each further
        dot is taken for the pattern's nearest, and the pattern is laid onto all of them by least squares.

        Args:
            i: The pattern's dot that the first one is.
            j: The pattern's dot that the second one is.
            obs_points: As in `identify`.

        Returns:
            SciPy's rotation from the pattern to the view; the root mean square distance of the dots from it.
        """
        if self._table is None:
            raise RuntimeError("gen_hash_table: expected a call before verification")
        unit = _directions(obs_points)
        align = scipy_rotation().align_vectors
        by_pair, _ = align(unit[:2], self.ref_points[[i, j]])
        _, nearest = self.point_tree.query(by_pair.apply(unit[2:], inverse=True))
        matched = self.ref_points[[i, j, *nearest]]
        rotation, _ = align(unit, matched)
        squared = np.sum((unit - rotation.apply(matched)) ** 2, axis=1)
        return rotation, float(np.sqrt(squared.mean()))

    @staticmethod
    def gen_basis(basis_points: ArrayLike) -> Floats:
        """The basis ``[d, d', d x d']`` (columns) of two dots, shape (2, 3)."""
        first, second = floats("basis_points", basis_points)
        return np.column_stack([first, second, np.cross(first, second)])

    @staticmethod
    def cart2hash(basis: Floats, points: Floats) -> Floats:
        """Hash values of points, shape (n, 3) or (3,)."""
        values: Floats = np.asarray(np.linalg.solve(basis, np.transpose(points)).T, np.float64)
        return values

    @staticmethod
    def hash2cart(basis: Floats, hash_values: Floats) -> Floats:
        """Points of hash values, shape (n, 3) or (3,)."""
        points: Floats = np.asarray(hash_values, dtype=np.float64) @ np.transpose(basis)
        return points


def _directions(obs_points: ArrayLike) -> Floats:
    """Dots of any length as unit vectors, shape (n, 3), n >= 3."""
    points = floats("obs_points", obs_points)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"obs_points: expected shape (n, 3), found {points.shape}")
    if len(points) < 3:
        raise ValueError(f"obs_points: expected at least 3 dots, found {len(points)}")
    lengths = np.linalg.norm(points, axis=1, keepdims=True)
    if not np.all(lengths > 0):
        raise ValueError("obs_points: expected directions, found a zero or a NaN")
    unit: Floats = points / lengths
    return unit


class SpinRegressor:
    """Spin from a sequence of orientations: ``w`` of ``R(t) = exp([w]x (t - t0)) R(t0)``, which is minus theirs with SciPy 1.11
    or later (see the module's head).

    The defaults are those of their newest file; their older one had ``n=3, k=10, d=3``.

    Args:
        n: Orientations in a sample, with ``"quatera"``.
        k: Number of samples, with ``"quatera"``.
        t: Largest distance from the plane of quaternions, with ``"quatera"``.
        d: More orientations than this must join a sample, with ``"quatera"``.
        method: ``"robust"`` or ``"quatera"``, the paper's.
        max_rps: Largest spin considered, revolutions per second.
    """

    def __init__(
        self,
        n: int = 4,
        k: int = 30,
        t: float = 5e-2,
        d: int = 2,
        *,
        method: Literal["robust", "quatera"] = "robust",
        max_rps: float = 175.0,
    ) -> None:
        self.n, self.k, self.t, self.d = n, k, t, d
        self.method: Literal["robust", "quatera"] = method
        self.max_rps = max_rps

    def _fit(self, t: ArrayLike, rots: Rotation | Sequence[Rotation]) -> Any:
        times = floats("t", t)
        if len(times) != len(rots):
            raise ValueError(f"rots: expected one for each of {len(times)} times, found {len(rots)}")
        quaternions = np.array([rot.as_quat() for rot in rots]).reshape(-1, 4)
        return times, _native.fit_spin(
            {"times_s": times, "quaternions": np.roll(quaternions, 1, axis=1)},
            {
                "frame": "camera",
                "method": self.method,
                "model": "constant",
                "at_s": times[0] if len(times) else None,
                "max_rps": self.max_rps,
                "sigma_rad": math.radians(2.0),
                "quatera": (self.n, self.k, self.t, self.d + 1),
            },
        )

    def RANSAC_regress(  # noqa: N802 (their name)
        self, t: ArrayLike, rots: Rotation | Sequence[Rotation]
    ) -> tuple[Floats, NDArray[np.int64]] | tuple[None, None]:
        """The spin, some of whose orientations may be wrong.

        Args:
            t: Times in seconds, increasing, shape (n,).
            rots: SciPy's rotations, pattern to camera.

        Returns:
            The spin vector, camera frame, rad/s, and the indices of the orientations that agree with
            it; ``(None, None)`` where no spin does.
        """
        _, found = self._fit(t, rots)
        if isinstance(found, str):
            return None, None
        return found[1], np.flatnonzero(found[7] > 0.5)

    def regress(
        self, t: ArrayLike, rots: Rotation | Sequence[Rotation]
    ) -> tuple[Floats, Rotation] | tuple[None, None]:
        """As `RANSAC_regress`; returns the spin and the first orientation by the fit."""
        times, found = self._fit(t, rots)
        if isinstance(found, str):
            return None, None
        time_s, spin, quaternion = found[:3]
        return spin, scipy_rotation().from_rotvec((times[0] - time_s) * spin) * self.quat2rot(quaternion)

    @staticmethod
    def rot2quat(rot: Rotation) -> Floats:
        """The quaternion ``w, x, y, z`` of SciPy's rotation, shape (4,)."""
        return np.roll(np.asarray(rot.as_quat(), dtype=np.float64), 1)

    @staticmethod
    def quat2rot(q: ArrayLike) -> Rotation:
        """SciPy's rotation of a quaternion ``w, x, y, z``."""
        return to_scipy(floats("q", q))


class KeyPoint(NamedTuple):
    """A detected dot. OpenCV's is ``cv2.KeyPoint(*dot.pt, dot.size)``."""

    pt: tuple[float, float]
    """Its place ``x, y`` in an image of `DOE.size` pixels a side."""
    size: float
    """Diameter of what is drawn for it, pixels."""
    response: float
    """Probability that it is a dot."""


# Standard deviation of a dot in the heat maps that their net is trained on, pixels.
_HEAT_SIGMA_PX = 1.5


class DOE:
    """Orientations from images of the ball.

    Args:
        dot_detector_model_path: Weights of this package's net, ``.npz``. Of any other path, as of a checkpoint of theirs,
            nothing is read: a warning says so, and the built-in net detects the dots. None says nothing.
        use_gpu: Without effect: the net runs on the processor.
        pattern: The table, the pattern, the path of either, or dots of shape (n, 3); by default the file that theirs reads.
        settings: Any of `spindoe.EstimatorSettings`.
    """

    def __init__(
        self,
        dot_detector_model_path: PathLike | None,
        use_gpu: bool = False,
        *,
        pattern: Tabled | ArrayLike = "../cad/ref_pattern.csv",
        **settings: Unpack[EstimatorSettings],
    ) -> None:
        table = as_ball(pattern)
        path = None if dot_detector_model_path is None else os.fspath(dot_detector_model_path)
        weights = path if path is not None and path.endswith(".npz") else None
        if path is not None and weights is None:
            warnings.warn(
                f"dot_detector_model_path: {path} is not read, the built-in net detects the dots", stacklevel=2
            )
        self.use_gpu = use_gpu
        self.estimator = Estimator(table, weights=weights, **settings)
        self.ref_pattern = table.pattern.dots
        self.geohasher = BayGeoHasher()
        self.geohasher.gen_hash_table(self.ref_pattern)
        self.size = 60
        """Side of heat maps and masks, pixels."""
        self.thresh_ratio = 0.1
        """Minimum probability of a keypoint, and minimum of the heat map in the mask."""
        self.rmse_thres = 0.12
        """Maximum root mean square residual of an orientation, radians."""
        self.dot_color = (255, 0, 0)
        self.logo_color = (0, 255, 0)
        self.last: FrameEstimate | None = None
        """All that was seen in the last image, with the confidence of its orientation."""

    def estimate_single(
        self, img: Image
    ) -> tuple[Rotation | None, NDArray[np.float32], NDArray[np.uint8], list[KeyPoint]]:
        """One image.

        Args:
            img: Gray, or with the channels of ``cv2.imread``; whatever else `spindoe.Estimator` takes.

        Returns:
            SciPy's rotation from the pattern to the camera, None where there is none; the heat map, shape (size, size): a bump
            at each detected dot, as high as it is probable; where it reaches `thresh_ratio`, 255, elsewhere 0; the detected
            dots.
        """
        image, order = pixels("img", img, _color(img))
        return self._answer(self.estimator.estimate(image, color=order), image.shape)

    def estimate_multi(
        self, imgs: Sequence[Image]
    ) -> tuple[list[Rotation | None], NDArray[np.float32], list[NDArray[np.uint8]], None]:
        """Images of the same channels, on all cores, each on its own.

        Returns:
            The rotations; the heat maps, shape (n, size, size); the masks; None, as theirs. One that has no orientation is None
            in its place, and ends nothing.
        """
        images, order = frames_of(imgs, _color(imgs[0]) if len(imgs) else None)
        frames = self.estimator.estimate_sequence(images, color=order, judge=False).frames
        answers = [self._answer(found, img.shape) for found, img in zip(frames, images, strict=True)]
        heatmaps = np.array([heatmap for _, heatmap, _, _ in answers], dtype=np.float32)
        return (
            [rot for rot, _, _, _ in answers],
            heatmaps.reshape(-1, self.size, self.size),
            [mask for _, _, mask, _ in answers],
            None,
        )

    def _answer(
        self, found: FrameEstimate, shape: tuple[int, ...]
    ) -> tuple[Rotation | None, NDArray[np.float32], NDArray[np.uint8], list[KeyPoint]]:
        self.last = found
        scale = self.size / np.array([shape[1], shape[0]])
        likely = found.dots[found.dots[:, 2] >= self.thresh_ratio]
        places = (likely[:, :2] + 0.5) * scale - 0.5
        v, u = np.mgrid[: self.size, : self.size]
        heatmap = np.zeros((self.size, self.size), dtype=np.float32)
        for (x, y), probability in zip(places, likely[:, 2], strict=True):
            bump = np.exp(-0.5 * ((u - x) ** 2 + (v - y) ** 2) / _HEAT_SIGMA_PX**2)
            heatmap = np.maximum(heatmap, (probability * bump).astype(np.float32))
        mask = np.where(heatmap >= self.thresh_ratio, 255, 0).astype(np.uint8)
        keypoints = [
            KeyPoint((float(x), float(y)), 2.0 * _HEAT_SIGMA_PX, float(probability))
            for (x, y), probability in zip(places, likely[:, 2], strict=True)
        ]
        pose = found.pose
        rot = pose.as_rotation() if pose and pose.residual_rad <= self.rmse_thres else None
        return rot, heatmap, mask, keypoints

    def kps2pt3d(self, kps: Sequence[KeyPoint]) -> Floats:
        """Directions, camera frame, shape (n, 3), of keypoints on a ball that fills the image, along parallel rays; those beyond
        its outline have z = 0."""
        pixels = np.array([dot.pt for dot in kps], dtype=np.float64).reshape(-1, 2)
        xy = (2.0 * pixels / self.size - 1.0) * [1.0, -1.0]
        z = np.sqrt(np.maximum(1.0 - np.sum(xy**2, axis=1), 0.0))
        return np.column_stack([xy, z])

    def reproject_dots(self, rot: Rotation, img: NDArray[Any], color: Any = None) -> NDArray[Any]:
        """A copy of the image with the pattern's visible dots drawn onto a ball that fills it, along parallel rays.

        Args:
            rot: From the pattern to the camera.
            img: Shape (height, width) or (height, width, 3).
            color: Of the dots; by default `dot_color`, and the pattern's z axis in `logo_color`.
        """
        drawn: NDArray[Any] = img.copy()
        height, width = img.shape[:2]

        def draw(points: Floats, color: Any) -> None:
            seen = rot.apply(points)
            x, y, _ = seen[seen[:, 2] > 0.0].T
            places = np.stack([(x + 1.0) * 0.5 * width, (1.0 - y) * 0.5 * height], axis=1) - 0.5
            discs(drawn, places, 1.0, color if img.ndim == 3 else color[0])

        draw(self.ref_pattern, self.dot_color if color is None else color)
        if color is None:
            draw(np.array([[0.0, 0.0, 1.0]]), self.logo_color)
        return drawn


def _color(img: Any) -> Color | None:
    """Arrays with channels are read as ``cv2.imread`` has them."""
    return "bgr" if isinstance(img, np.ndarray) and img.ndim == 3 and img.shape[2] == 3 else None


class SpinDOE:
    """Spins from images of the ball.

    Args:
        dot_detector_model: As `DOE` has it.
        pattern: As `DOE` has it.
        settings: As `DOE` has them.
    """

    # Theirs too gives no spin of fewer orientations.
    _MIN_ORIENTATIONS = 5

    def __init__(
        self,
        dot_detector_model: PathLike | None,
        *,
        pattern: Tabled | ArrayLike = "../cad/ref_pattern.csv",
        **settings: Unpack[EstimatorSettings],
    ) -> None:
        self.doe = DOE(dot_detector_model, pattern=pattern, **settings)
        self.spin_regressor = SpinRegressor()

    def estimate(
        self, t: ArrayLike, imgs: Sequence[Image]
    ) -> tuple[Floats | None, list[Rotation | None], list[NDArray[np.float32]], NDArray[np.int64]]:
        """The spin of a sequence.

        Args:
            t: Times in seconds, increasing, shape (n,).
            imgs: The images, as `DOE.estimate_multi` takes them.

        Returns:
            The spin vector, camera frame, rad/s, None where there is none; the rotation of each image, or None; the heat maps;
            the indices of the images whose orientations agree with the spin, or without one of all that have an orientation.
        """
        times = floats("t", t)
        if times.shape != (len(imgs),):
            raise ValueError(f"t: expected one for each of {len(imgs)} images, found shape {times.shape}")
        rots, heatmaps, _, _ = self.doe.estimate_multi(imgs)
        posed = np.array([i for i, rot in enumerate(rots) if rot is not None], dtype=np.int64)
        spin = None
        if len(posed) >= self._MIN_ORIENTATIONS:
            spin, agree = self.spin_regressor.RANSAC_regress(times[posed], [rot for rot in rots if rot is not None])
            posed = posed if agree is None else posed[agree]
        return spin, rots, list(heatmaps), posed

    def predicted_rots(self, init_rot: Rotation, t0: float, ts: ArrayLike, spin_vec: ArrayLike) -> Rotation:
        """SciPy's rotations at the times `ts`, shape (n,), of a ball that has `init_rot` at `t0` and spins by `spin_vec`, rad/s."""
        turns = (floats("ts", ts) - t0)[:, None] * floats("spin_vec", spin_vec)
        return scipy_rotation().from_rotvec(turns) * init_rot
