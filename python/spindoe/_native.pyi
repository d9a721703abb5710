"""The native part: handles and conversions. Use the classes of ``spindoe`` instead."""

from collections.abc import Callable, Sequence as _Sequence
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

_Path = str | PathLike[str]
_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]
_Hint = tuple[tuple[float, float, float, float], _Floats, float]
_Identified = tuple[_Floats, _Ints, float, float, float, list[tuple[_Floats, float]]]
_Pose = tuple[_Floats, _Floats, float, float, float, float, tuple[float, float] | None, bool, str]
_Frame = tuple[
    tuple[float, float, float] | None,
    _Floats,
    _Floats,
    _Ints,
    _Pose | str,
    tuple[float, float, float],
    tuple[_Floats, _Floats, _Floats | None] | None,
]
_Curve = tuple[_Floats, _Floats, _Floats, _Floats, float]
_Spin = tuple[
    float,
    _Floats,
    _Floats,
    _Floats | None,
    float | None,
    float | None,
    int,
    _Floats,
    list[tuple[_Floats, float]],
    str,
    tuple[str, float, _Floats, float | None, list[str], _Curve | None],
]
_Calibrated = tuple[
    HashTable,
    tuple[list[str], _Floats, _Floats, _Ints, _Floats, _Ints],
    list[tuple[_Floats, _Floats | None, int, int]],
    list[_Frame],
    tuple[int, int, int],
    tuple[float, float, bool, float | None],
    str | None,
]
_Camera = tuple[str, list[float]]
_Verdict = tuple[str, int, float | None, list[tuple[int, bool, int, int, bool, float]]]

__version__: str
"""The version of the package."""
MIN_CONFIDENCE_DOTS: float
"""The probability below which a `Recognizer` rejects an orientation, by default."""
MIN_CONFIDENCE_IMAGES: float
"""The probability below which an `Estimator` rejects an orientation, by default."""

def command(arguments: list[str]) -> int: ...
def read_trajectories(
    dir: _Path,
) -> tuple[list[tuple[int, _Floats, _Floats, list[float] | None]], str]: ...
def read_image(path: _Path, bytes: bytes | None) -> NDArray[np.uint16]: ...
def shipped_designs() -> list[tuple[str, Pattern]]: ...
def onnx_bytes(head: str, weights: _Path | None) -> bytes: ...
def fit_spin(rows: dict[str, Any], asked: dict[str, Any]) -> _Spin | str: ...
def write_dataset(
    clips: list[_Path],
    estimators: list[Estimator],
    names: list[str],
    output: _Path,
    fps: float | None,
    frame: str,
    asked: dict[str, Any],
    bounces: tuple[int, float, float],
    overwrite: bool,
) -> str: ...
def fictrac_rows(
    times_s: _Floats,
    quaternions: _Floats,
    covariances: _Floats | None,
    frame: str,
    c2a_r: list[float] | None,
    max_bad_frames: int | None,
) -> tuple[list[str], _Floats, str]: ...
def in_axes(
    frame: str,
    axes: str,
    wxyz: _Floats,
    vectors: list[_Floats],
    covariance: _Floats | None,
) -> tuple[str, _Floats, list[_Floats], _Floats | None]: ...
def validate(
    table: HashTable,
    protocol: str,
    recognizer: str,
    samples: int,
    seed: int,
    sigma_rad: float | None,
    progress: Callable[[int, int], object] | None,
) -> str: ...
def trial_views(
    table: HashTable, protocol: str, seed: int, first: int, count: int, sigma_rad: float | None
) -> list[tuple[_Floats, _Floats, _Ints, _Floats, int]]: ...
def design_request(flags: list[str]) -> tuple[Pattern | None, str]: ...
def merge(
    shards: _Sequence[_Path], out: _Path, resume: bool, callback: Callable[[str], object] | None
) -> tuple[HashTable, str]: ...
def independent_frame(
    table: HashTable, preset: str, settings: str, seed: int, k: int
) -> tuple[NDArray[np.uint8], str]: ...
def net_graph(net: str) -> str: ...
def samples_per_frame(net: str) -> int: ...
def training_batch(
    net: str, seed: int, first: int, last: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]: ...
def world_sha256(net: str, seed: int) -> str: ...

_Layers = _Sequence[tuple[NDArray[np.float32], NDArray[np.float32]]]

class TrainingSamples:
    def __new__(cls, net: str, seed: int, set: str, frames: int) -> TrainingSamples: ...
    def patches(self) -> NDArray[np.float32]: ...
    def cells(self, flat: _Layers) -> NDArray[np.float32]: ...
    def calibrate(self, flat: _Layers) -> str: ...
    def score(self, flat: _Layers, calibration: str) -> tuple[float, str, str]: ...

class NetWeights:
    def __new__(cls, flat: _Layers, meta: str, rounded: bool) -> NetWeights: ...
    @staticmethod
    def read(path: _Path) -> NetWeights: ...
    def write(self, path: _Path) -> None: ...
    def meta(self) -> str: ...
    def layers(self) -> _Layers: ...

class Pattern:
    def __new__(cls, dots: _Floats) -> Pattern: ...
    @staticmethod
    def load(path: _Path) -> Pattern: ...
    def save(self, path: _Path) -> None: ...
    def dots(self) -> _Floats: ...
    def sha256(self) -> str: ...
    def keep_out(self) -> list[tuple[tuple[float, float, float], float]]: ...
    def with_keep_out(
        self, zones: list[tuple[tuple[float, float, float], float]]
    ) -> Pattern: ...
    def summary(self) -> str: ...

class HashTable:
    @staticmethod
    def build(
        pattern: Pattern, min_cross: float, max_angle_rad: float, recognizer: str
    ) -> HashTable: ...
    @staticmethod
    def load(path: _Path) -> HashTable: ...
    @staticmethod
    def from_bytes(bytes: bytes) -> HashTable: ...
    def to_bytes(self) -> bytes: ...
    def save(self, path: _Path) -> None: ...
    def pattern(self) -> Pattern: ...
    def features(self) -> _Floats: ...
    def bases(self) -> NDArray[np.uint16]: ...
    def feature_dots(self) -> NDArray[np.uint16]: ...
    def meta(self) -> str: ...
    def dot_covariances(self) -> _Floats | None: ...

class Recognizer:
    @staticmethod
    def robust(
        table: HashTable,
        expect: str | None,
        settings: str,
        sigma_rad: float | None,
        min_confidence: float,
    ) -> Recognizer: ...
    @staticmethod
    def paper(
        table: HashTable,
        k: int | None,
        kappa: float | None,
        beta: float | None,
        alpha: float | None,
        verify_fraction: float | None,
        vote_sum: str | None,
        sigma_rad: float | None,
        min_confidence: float,
    ) -> Recognizer: ...
    def settings(self) -> str: ...
    def sigma_rad(self) -> float: ...
    def identify(
        self,
        dots: _Floats,
        sigma_rad: _Floats | None,
        covariances: _Floats | None,
        hint: _Hint | None,
        max_rivals: int,
        min_rival_confidence: float,
    ) -> _Identified | str: ...
    def identify_batch(
        self,
        dots: _Floats,
        offsets: _Ints,
        sigma_rad: _Floats | None,
        covariances: _Floats | None,
    ) -> tuple[_Floats, _Ints, _Floats, _Floats, _Floats, dict[int, str]]: ...

class Estimator:
    def __new__(
        cls,
        table: HashTable,
        camera: _Camera,
        detector: str,
        weights: _Path | None,
        settings: str,
    ) -> Estimator: ...
    def settings(self) -> str: ...
    def estimate(
        self,
        image: Any,
        color: str,
        circle: tuple[float, float, float] | None,
        hint: _Hint | None,
    ) -> _Frame: ...
    def estimate_sequence(
        self,
        images: _Sequence[Any],
        color: str,
        times_s: list[float] | None,
        others: _Sequence[Estimator],
        asked: dict[str, Any],
        exposure_s: float | None,
        progress: Callable[[int, int], object] | None,
    ) -> tuple[
        list[_Frame],
        int,
        tuple[_Floats, _Floats, _Floats | None, str],
        _Spin | str | None,
        list[float] | None,
        _Verdict | None,
    ]: ...
    def calibrate(
        self,
        images: _Sequence[Any],
        paths: _Sequence[_Path],
        color: str,
        times_s: list[float] | None,
        fps: float | None,
        circle: tuple[float, float, float] | None,
        placement_sigma_rad: float | None,
        learn_extra: bool,
        smooth: bool,
        evaluation: tuple[int, int] | None,
        size: tuple[int, int] | None,
        progress: Callable[[int, int], object] | None,
    ) -> _Calibrated | str: ...
    def tracker(
        self, window: int, memory_s: float, max_rps: float, max_latency_s: float | None
    ) -> Tracker: ...

_RigCamera = tuple[
    str,
    _Camera,
    tuple[int, int] | None,
    _Sequence[_Sequence[float]],
    _Sequence[float],
    float,
]

class Rig:
    def __new__(
        cls,
        path: _Path | None,
        cameras: _Sequence[_RigCamera],
        table: HashTable,
        detector: str,
        weights: _Path | None,
        settings: str,
    ) -> Rig: ...
    def cameras(self) -> tuple[list[_RigCamera], list[str]]: ...
    def estimate_sequence(
        self,
        images: _Sequence[_Sequence[Any]],
        color: str,
        times_s: list[list[float]] | None,
        asked: dict[str, Any],
        progress: Callable[[int, int], object] | None,
    ) -> tuple[
        list[_Frame],
        int,
        tuple[_Floats, _Floats, _Floats | None, str],
        _Spin | str | None,
        _Floats | None,
        _Ints,
        _Floats,
        list[str],
        list[str],
    ]: ...

_Ball = tuple[_Frame, int, list[float]]
_Golf = tuple[list[float], float, list[float] | None, str]
_Strobed = tuple[
    float,
    list[tuple[int, int]],
    list[int],
    str,
    list[float],
    tuple[_Floats, _Floats, list[list[float]], _Golf | None, str | None] | str,
]

class Surface:
    def __new__(cls, name: str, bytes: bytes) -> Surface: ...
    def to_bytes(self) -> bytes: ...
    def known(self) -> float: ...
    def chart(self) -> _Floats: ...

class PaintedTracker:
    def update(
        self,
        image: Any,
        color: str,
        time_s: float,
        circle: tuple[float, float, float] | None,
    ) -> tuple[
        tuple[
            tuple[_Floats, _Floats, float] | None,
            tuple[float, float, float] | None,
            tuple[_Floats, _Floats] | None,
            str | None,
        ],
        _Spin | str,
    ]: ...
    def frame(self) -> Any: ...
    def reset(self) -> None: ...

class PaintedEstimator:
    def __new__(cls, camera: _Camera, outline: str, ball_radius_m: float) -> PaintedEstimator: ...
    def tracker(self, surface: Surface, window: int, memory_s: float, max_rps: float) -> PaintedTracker: ...
    def estimate_sequence(
        self,
        images: _Sequence[Any],
        color: str,
        times_s: list[float] | None,
        surface: Surface | None,
        asked: dict[str, Any],
        progress: Callable[[int, int], object] | None,
    ) -> tuple[
        tuple[_Floats, _Floats, _Floats | None, Any],
        _Floats,
        _Floats,
        list[str | None],
        _Floats,
        _Floats,
        _Floats,
        Surface | None,
        _Spin | str | None,
        bool,
        float,
    ]: ...

class Balls:
    def __new__(cls, estimators: _Sequence[Estimator], count: int | None) -> Balls: ...
    def estimate(self, image: Any, color: str) -> list[_Ball]: ...
    def estimate_sequence(
        self,
        images: _Sequence[Any],
        color: str,
        times_s: list[float],
        asked: dict[str, Any],
        progress: Callable[[int, int], object] | None,
    ) -> list[list[tuple[int | None, _Ball]]]: ...
    def estimate_strobe(
        self, image: Any, color: str, times_s: list[float], flight: str | None, max_rps: float
    ) -> tuple[list[_Ball], list[_Strobed]]: ...

class Tracker:
    def update(
        self,
        image: Any,
        color: str,
        time_s: float,
        circle: tuple[float, float, float] | None,
    ) -> tuple[_Frame, _Spin | str]: ...
    def verdict(self) -> _Verdict | None: ...
    def reset(self) -> None: ...

def size_doubt(camera: tuple[str, _Sequence[float]], size: tuple[int, int]) -> str | None: ...
def read_intrinsics(path: _Path) -> tuple[str, list[float], tuple[int, int] | None, list[str]]: ...
def intrinsics_of(
    matrix: list[list[float]], distortion: list[float], fisheye: bool
) -> tuple[str, list[float]]: ...
def project_points(camera: _Camera, points: _Floats) -> _Floats: ...

class BallView:
    def __new__(cls, camera: _Camera, circle: tuple[float, float, float]) -> BallView: ...
    def project(self, directions: _Floats) -> _Floats: ...
    def back_project(
        self, pixels: _Floats, covariances_px2: _Floats
    ) -> tuple[_Floats, _Floats]: ...
    def horizon(self) -> float: ...
    def to_camera(self) -> _Floats: ...

class Stencil:
    @staticmethod
    def build(
        table: HashTable,
        ball_diameter_mm: float | None,
        hole_diameter_mm: float | None,
        settings: str,
    ) -> Stencil: ...
    @staticmethod
    def largest_hole_mm(
        table: HashTable, ball_diameter_mm: float | None, settings: str
    ) -> float | None: ...
    def half(self, name: str) -> tuple[_Floats, NDArray[np.uint32]]: ...
    def save(self, dir: _Path) -> None: ...
    def description(self) -> str: ...

class Sequence:
    def __new__(
        cls,
        table: HashTable,
        preset: str,
        settings: str,
        seed: int,
        frames: int,
        fps: float,
        spin: tuple[float, float, float] | None,
        exposure_s: float | None,
        drift_px: tuple[float, float] | None,
    ) -> Sequence: ...
    def frame(self, k: int) -> tuple[NDArray[np.uint8], str]: ...

class RigSequence:
    def __new__(
        cls,
        rig: Rig,
        preset: str,
        settings: str,
        seed: int,
        frames: int,
        fps: float,
        spin: tuple[float, float, float] | None,
        exposure_s: float | None,
    ) -> RigSequence: ...
    def frame(self, camera: int, k: int) -> tuple[NDArray[np.uint8], str]: ...

class DesignJob:
    def __new__(
        cls,
        dir: _Path,
        pattern: Pattern | None,
        settings: str,
        pictures: list[str],
        unlimited: bool,
    ) -> DesignJob: ...
    def run(
        self, callback: Callable[[str], object] | None, resume: bool, budget_s: float | None
    ) -> tuple[HashTable, str]: ...
    def run_shard(
        self, index: int, count: int, callback: Callable[[str], object] | None, resume: bool
    ) -> None: ...
