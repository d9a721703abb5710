"""Drop-in for the classes of the SpinDOE authors' Python: the same names, arguments and order of the
results, this package's estimators beneath.

In scripts of theirs change the import::

    from spindoe.compat import BayGeoHasher, SpinRegressor

The signatures are those of https://github.com/cogsys-tuebingen/spindoe, folder ``python``. What differs:

- The default recognizer is this package's robust one. As theirs it expects that all dots are the
  pattern's and that any of the visible ones may be missing, with the noise that `kappa` says
  (``1 / sqrt(kappa)`` along a tangent axis); `settings` change that. It needs none of the arguments
  that tune the paper's voting; ``recognizer="paper"`` uses them.
- Nothing is printed.
- Where no orientation is found, `BayGeoHasher.identify` returns ``([-1, -1], None, inf)``; theirs
  always returns one. A script that compares the pair, or the error, counts it as a failure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._common import Floats, Rejection, floats
from ._pattern import HashTable, Pattern
from ._recognize import Identification, Recognizer

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

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
        threshold: Minimum logarithm of a vote; with ``"paper"`` only values that leave out none are
            supported.
        k_neighbour: Number of nearest features that vote, with ``"paper"``.
        upper_score_perc: Percentile of the scores from which on bases are verified, with ``"paper"``.
        projection_ll_scale: Standard deviation of the dots' distance from the center, with ``"paper"``.
        min_feature_dist: Pairs of dots farther apart than this are left out of `hash_table`.
        kappa: Concentration of the Kent density, with ``"paper"``.
        beta: Its ovalness, with ``"paper"``.
        recognizer: ``"robust"`` or ``"paper"``.
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
        recognizer: Literal["robust", "paper"] = "robust",
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
        """Prepares the recognition of a pattern, shape (n, 3)."""
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
        state = (self.recognizer, tuple(paper.values()), self.min_feature_dist, self.threshold)
        if self._made is None or self._made[0] != state:
            if self.recognizer == "paper":
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
                made = Recognizer(self._table, "paper", **{**paper, **self.settings})
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
        points = floats("obs_points", obs_points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"obs_points: expected shape (n, 3), found {points.shape}")
        if len(points) < 3:
            raise ValueError(f"obs_points: expected at least 3 dots, found {len(points)}")
        lengths = np.linalg.norm(points, axis=1, keepdims=True)
        if not np.all(lengths > 0):
            raise ValueError("obs_points: expected directions, found a zero or a NaN")
        unit = points / lengths
        self.last = recognizer.identify(unit, max_rivals=0)
        if not self.last:
            return np.array([-1, -1]), None, math.inf
        rotation = self.last.as_rotation()
        seen = rotation.apply(self.ref_points)
        nearest = np.argmax(unit @ seen.T, axis=1)
        indices = np.where(self.last.assignment >= 0, self.last.assignment, nearest)
        squared = np.sum((unit - seen[indices]) ** 2, axis=1)
        return indices[:2], rotation, float(np.sqrt(squared.mean()))

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


class SpinRegressor:
    """Spin from a sequence of orientations.

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
        n: int = 3,
        k: int = 10,
        t: float = 5e-2,
        d: int = 3,
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
            times,
            np.roll(quaternions, 1, axis=1),
            None,
            None,
            None,
            None,
            None,
            "camera",
            self.method,
            "constant",
            times[0] if len(times) else None,
            self.max_rps,
            math.radians(2.0),
            None,
            (self.n, self.k, self.t, self.d + 1),
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
        from scipy.spatial.transform import Rotation

        times, found = self._fit(t, rots)
        if isinstance(found, str):
            return None, None
        time_s, spin, quaternion = found[:3]
        start = Rotation.from_quat(np.roll(quaternion, -1))
        return spin, Rotation.from_rotvec((times[0] - time_s) * spin) * start
