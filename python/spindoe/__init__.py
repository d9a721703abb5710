"""Dot patterns for balls: design them, identify them in images, estimate orientation and spin.

Camera frame: x right, y up, z from the ball towards the camera. Orientations map the pattern's frame
to the camera's. Quaternions are scalar first where a name says ``wxyz``; ``as_rotation()`` gives
SciPy's. Angles are radians, times seconds, spins vectors in rad/s.

Answers that may be missing are `Rejection` where they are, which is false::

    found = recognizer.identify(dots)
    if found:
        print(found.quaternion_wxyz)
    else:
        print(found.reason)

Bad input raises `ValueError`, what the system refuses `OSError`, both with one line.
"""

from . import dataset
from ._balls import BallEstimate, Balls, GolfSpin, StrobeEstimate, StrobeHypothesis
from ._calibrate import Calibration, SteadyMark
from ._common import Rejection
from ._design import Design, DesignProgress, DesignResult, Proportion, Validation, merge, validate
from ._fictrac import FicTracPath, fictrac
from ._frame import BallView, Camera, FrameEstimate, Pose
from ._native import MIN_CONFIDENCE_DOTS, MIN_CONFIDENCE_IMAGES, __version__
from ._painted import PaintedEstimator, PaintedSequence, PaintedState, PaintedTracker, Surface
from ._pattern import DesignRecord, HashTable, KeepOut, Pattern, PatternSummary
from ._published import Trajectory, TrajectorySet, read_trajectories, write_onnx
from ._recognize import (
    Hint,
    Identification,
    Identifications,
    PaperSettings,
    Recognizer,
    RecognizerSettings,
    Rival,
)
from ._rerun import to_rerun
from ._rig import Rig, RigCamera
from ._sequence import Hypothesis, SequenceEstimate, Verdict
from ._spin import Alias, Spin, SpinCurve, fit_spin
from ._stencil import Stencil, StencilSettings
from ._synth import SynthSettings, Truth, synth, synth_rig
from ._vision import CircleSettings, Estimator, EstimatorSettings, Tracker, TrackerState

__all__ = [
    "Alias",
    "BallEstimate",
    "BallView",
    "Balls",
    "Calibration",
    "Camera",
    "CircleSettings",
    "Design",
    "DesignProgress",
    "DesignRecord",
    "DesignResult",
    "Estimator",
    "EstimatorSettings",
    "FicTracPath",
    "FrameEstimate",
    "GolfSpin",
    "HashTable",
    "Hint",
    "Hypothesis",
    "Identification",
    "Identifications",
    "KeepOut",
    "PaintedEstimator",
    "PaintedSequence",
    "PaintedState",
    "PaintedTracker",
    "PaperSettings",
    "Pattern",
    "PatternSummary",
    "Pose",
    "Proportion",
    "Recognizer",
    "RecognizerSettings",
    "Rejection",
    "Rig",
    "RigCamera",
    "Rival",
    "SequenceEstimate",
    "Spin",
    "SpinCurve",
    "SteadyMark",
    "Stencil",
    "StencilSettings",
    "StrobeEstimate",
    "StrobeHypothesis",
    "Surface",
    "SynthSettings",
    "Tracker",
    "TrackerState",
    "Trajectory",
    "TrajectorySet",
    "Truth",
    "Validation",
    "Verdict",
    "MIN_CONFIDENCE_DOTS",
    "MIN_CONFIDENCE_IMAGES",
    "__version__",
    "dataset",
    "fictrac",
    "fit_spin",
    "merge",
    "read_trajectories",
    "synth",
    "synth_rig",
    "to_rerun",
    "validate",
    "write_onnx",
]
