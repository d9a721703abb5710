"""Spin from time-stamped orientations."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._common import Axes, Floats, Frame, Rejection, floats, scipy_rotation, to_scipy

if TYPE_CHECKING:
    import matplotlib.axes
    from scipy.spatial.transform import Rotation


@dataclass(slots=True, eq=False)
class Alias:
    """Another spin that explains the same orientations."""

    spin_rad_s: Floats
    """Spin vector, rad/s, in the frame of the estimate."""
    log_likelihood_ratio: float
    """Natural logarithm of its likelihood over that of the estimate; 0 is a tie."""


@dataclass(slots=True, eq=False)
class SpinCurve:
    """The spin of a ball that is pushed, at the times of its orientations; straight lines in between."""

    times_s: Floats
    """Seconds, shape (n,)."""
    spins_rad_s: Floats
    """In the frame of the estimate, rad/s, shape (n, 3)."""
    covariances: Floats
    """Their covariances, (rad/s)^2, shape (n, 3, 3)."""
    quaternions_wxyz: Floats
    """The orientations then, scalar first, shape (n, 4)."""
    spread_rad_s: float
    """Root mean square by which the spin is off its mean over the time."""

    @property
    def rps(self) -> Floats:
        """Revolutions per second, shape (n,)."""
        rps: Floats = np.linalg.norm(self.spins_rad_s, axis=1) / (2.0 * np.pi)
        return rps

    @property
    def std_rps(self) -> Floats:
        """Standard deviations of the magnitudes: 1.96 times as much to either side is a band of 95 %."""
        axes = np.array([_axis(spin) for spin in self.spins_rad_s]).reshape(-1, 3)
        variances = np.einsum("ni,nij,nj->n", axes, self.covariances, axes)
        std: Floats = np.sqrt(np.maximum(variances, 0.0)) / (2.0 * np.pi)
        return std

    def as_rotation(self, time_s: ArrayLike) -> Rotation:
        """SciPy's rotation at these times."""
        times = np.asarray(time_s, dtype=np.float64)
        before = np.clip(np.searchsorted(self.times_s, times, side="right") - 1, 0, len(self.times_s) - 1)
        after = np.minimum(before + 1, len(self.times_s) - 1)
        whole = self.times_s[after] - self.times_s[before]
        elapsed = times - self.times_s[before]
        is_inside = (elapsed > 0.0) & (whole > 0.0)
        share = np.where(is_inside, elapsed / np.where(whole > 0.0, whole, 1.0), 0.0)
        a, b = self.spins_rad_s[before], self.spins_rad_s[after]
        start, end = to_scipy(self.quaternions_wxyz[before]), to_scipy(self.quaternions_wxyz[after])
        turn = scipy_rotation().from_rotvec
        rest = (end * (turn((a + b) * (0.5 * whole)[..., None]) * start).inv()).as_rotvec()
        part = (a + (b - a) * (0.5 * share)[..., None]) * elapsed[..., None]
        return turn(rest * share[..., None]) * turn(part) * start


def _axis(spin: Floats) -> Floats:
    """The direction of a spin; nothing where it has none."""
    rate = float(np.linalg.norm(spin))
    axis: Floats = spin / rate if rate > 0.0 else np.zeros(3)
    return axis


@dataclass(slots=True, eq=False, repr=False)
class Spin:
    """A spin with its uncertainty. True where a truth value is wanted.

    The model: ``R(t) = exp([p]x tau) R(t0) exp([q]x tau)`` with ``tau = (1 - exp(-c (t - t0))) / c``. A constant spin has
    ``p = w``, no ``c`` and no ``q``; one that decays has a rate ``c``; a ball that precesses also a rotation ``q`` that is fixed
    in the ball, and the spin is the mean one, along ``p``. A ball that is pushed (``free``) has a spin that changes in any smooth way:
    `curve` has it over time, and the spin is its mean over the time.
    """

    time_s: float
    """The time t0 of the spin, seconds: by default the middle of the orientations."""
    spin_rad_s: Floats
    """Spin vector, in `frame`, rad/s, right-hand rule; shape (3,)."""
    quaternion_wxyz: Floats
    """Orientation at that time, pattern to `frame`, scalar first; shape (4,)."""
    covariance: Floats | None
    """Covariance of the spin vector, in `frame`, (rad/s)^2, shape (3, 3), with what the frames' errors have in common and with
    the lack of fit; None where the method has none."""
    sigma_rad: float | None
    """Noise of an orientation per axis, radians."""
    log_likelihood: float | None
    inliers: int
    """Number of orientations that agree with the spin."""
    inlier_probabilities: Floats = field(default_factory=lambda: np.zeros(0))
    """Of each orientation, in order of time; empty where it is not known."""
    aliases: tuple[Alias, ...] = ()
    """Other spins that give the same orientations at these times, the likeliest first."""
    frame: Frame = "camera"
    """The frame of the spin and of all its vectors; `as_frame` gives them in other axes."""
    model: Literal["constant", "decaying", "precessing", "free"] = "constant"
    """The motion: by evidence, unless one was given."""
    decay_per_s: float = 0.0
    """The rate ``c`` at which the spin decays."""
    body_rate_rad_s: Floats = field(default_factory=lambda: np.zeros(3))
    """The rotation ``q`` that is fixed in the ball, pattern frame, rad/s; shape (3,)."""
    lack_of_fit: float | None = None
    """How much more parts of the sequence differ from the motion than their noise explains, a ratio of variances by which
    `covariance` is widened; None where that is not evident."""
    clock: tuple[str, ...] = ()
    """What was found wrong with the times, and corrected: repeated images, lost frames, rounded times, times that scatter. The spin
    is that with the times corrected."""
    curve: SpinCurve | None = None
    """The spin over time, of a free motion."""

    @property
    def rps(self) -> float:
        """Revolutions per second."""
        return float(np.linalg.norm(self.spin_rad_s) / (2.0 * np.pi))

    @property
    def axis(self) -> Floats:
        """Unit vector of the axis, in `frame`; zeros for a ball at rest."""
        return _axis(self.spin_rad_s)

    @property
    def std_rad_s(self) -> Floats | None:
        """Standard deviations of the spin's components, rad/s."""
        if self.covariance is None:
            return None
        std: Floats = np.sqrt(np.maximum(np.diagonal(self.covariance), 0.0))
        return std

    @property
    def std_rps(self) -> float | None:
        """Standard deviation of the magnitude, revolutions per second."""
        if self.covariance is None:
            return None
        axis = self.axis
        if not axis.any():
            variance = float(np.linalg.eigvalsh(self.covariance)[-1])
        else:
            variance = float(axis @ self.covariance @ axis)
        return float(np.sqrt(max(variance, 0.0)) / (2.0 * np.pi))

    def as_rotation(self, time_s: ArrayLike | None = None) -> Rotation:
        """SciPy's rotation at the reference time, or by the model at others."""
        start = to_scipy(self.quaternion_wxyz)
        if time_s is None:
            return start
        if self.curve is not None:
            return self.curve.as_rotation(time_s)
        elapsed = np.asarray(time_s, dtype=np.float64)[..., None] - self.time_s
        c, q = self.decay_per_s, self.body_rate_rad_s
        tau = -np.expm1(-c * elapsed) / c if c else elapsed
        p = self.spin_rad_s
        if np.any(q):
            p = p - self.axis * (self.axis @ start.apply(q))
        turn = scipy_rotation().from_rotvec
        return turn(tau * p) * start * turn(tau * q)

    def as_frame(self, frame: Axes) -> Spin:
        """The same spin in other axes: x right, y up, z towards the camera for ``"camera"``; x right, y down, z forward (REP
        103) for ``"optical"``. A spin in the view frame stays in the view frame."""
        vectors = [self.spin_rad_s, *(alias.spin_rad_s for alias in self.aliases)]
        name, quaternion, (spin, *others), covariance = _native.in_axes(
            self.frame, frame, self.quaternion_wxyz, vectors, self.covariance
        )
        aliases = tuple(
            Alias(other, alias.log_likelihood_ratio)
            for other, alias in zip(others, self.aliases, strict=True)
        )
        curve = self.curve
        if curve is not None:
            # The columns of the turn, and the orientations with it.
            identity = np.array([1.0, 0.0, 0.0, 0.0])
            _, turn, columns, _ = _native.in_axes(self.frame, frame, identity, list(np.eye(3)), None)
            matrix = np.array(columns).T
            turned = to_scipy(turn) * to_scipy(curve.quaternions_wxyz)
            curve = replace(
                curve, spins_rad_s=curve.spins_rad_s @ matrix.T, covariances=matrix @ curve.covariances @ matrix.T,
                quaternions_wxyz=np.roll(turned.as_quat(), 1, axis=-1),
            )
        return replace(
            self, curve=curve, spin_rad_s=spin, quaternion_wxyz=quaternion, covariance=covariance, aliases=aliases,
            frame=cast("Frame", name),
        )

    def plot(self, ax: matplotlib.axes.Axes | None = None, **style: Any) -> matplotlib.axes.Axes:
        """Draws the components with error bars, and the aliases; see `spindoe.plot.spin`."""
        from . import plot

        return plot.spin(self, ax, **style)

    def __bool__(self) -> Literal[True]:
        return True

    def __repr__(self) -> str:
        x, y, z = self.spin_rad_s
        std = "" if self.std_rps is None else f" +- {self.std_rps:.3f}"
        aliases = f", {len(self.aliases)} aliases" if self.aliases else ""
        return (
            f"<Spin {self.rps:.3f}{std} rps, [{x:.2f} {y:.2f} {z:.2f}] rad/s ({self.frame}), {self.model}, "
            f"{self.inliers} inliers{aliases}>"
        )


def spin_of(found: Any) -> Spin | Rejection:
    """The native part's answer."""
    if isinstance(found, str):
        return Rejection(found)
    spin = Spin(*found[:8])
    aliases, spin.frame, motion = found[8:]
    spin.aliases = tuple(Alias(*alias) for alias in aliases)
    spin.model, spin.decay_per_s, spin.body_rate_rad_s, spin.lack_of_fit, clock, curve = motion
    spin.clock = tuple(clock)
    spin.curve = None if curve is None else SpinCurve(*curve)
    return spin


def fit_spin(
    times_s: ArrayLike,
    orientations: ArrayLike | Rotation,
    *,
    order: Literal["wxyz", "xyzw"] = "wxyz",
    confidences: ArrayLike | None = None,
    residuals_rad: ArrayLike | None = None,
    matched: ArrayLike | None = None,
    covariances_rad2: ArrayLike | None = None,
    view_turns_rad: ArrayLike | None = None,
    frame: Frame = "camera",
    method: Literal["robust", "quatera"] = "robust",
    model: Literal["auto", "constant", "decaying", "precessing", "free"] = "auto",
    at_s: float | None = None,
    max_rps: float = 175.0,
    sigma_rad: float = np.deg2rad(2.0),
    prior_rps: tuple[float, float] | None = None,
) -> Spin | Rejection:
    """The spin of time-stamped orientations, some of which may be wrong or missing.

    Args:
        times_s: Times in seconds, increasing, shape (n,).
        orientations: Unit quaternions of shape (n, 4), pattern to camera, in the order `order`; rows
            of NaN are frames without one. Or SciPy's `Rotation` of n rotations.
        order: Of the numbers of a quaternion: ``"wxyz"`` as everywhere here, ``"xyzw"`` as in SciPy
            and ROS.
        confidences: Probability of each orientation to be correct, shape (n,).
        residuals_rad: Residual of the dots of each orientation, radians, shape (n,). They show the
            errors that frames share, which widen the covariance; without them it is too small for
            hand-drawn dots.
        matched: Number of dots behind each orientation, shape (n,); with the residuals the frames'
            weights follow.
        covariances_rad2: Covariance of each orientation's error, a rotation vector in `frame`,
            shape (n, 3, 3): the frames' weights, in place of the residuals.
        view_turns_rad: Of orientations that were brought from view frames into one: the turn that each
            contains, and what one standard deviation of each of three errors of the camera does to it, four
            rotation vectors, shape (n, 12). All share these errors, which widen the covariance.
        frame: The frame that the orientations are in.
        method: ``"robust"``, or ``"quatera"``, the paper's, of constant spins.
        model: How the ball moves: ``"constant"``, ``"decaying"``, ``"precessing"``, ``"free"`` (pushed), or the
            one for which there is evidence.
        at_s: The time of the spin, seconds, within `times_s`; by default the middle, and of a free motion
            the mean over the time.
        max_rps: Largest spin considered, revolutions per second.
        sigma_rad: First estimate of the orientations' noise per axis, radians.
        prior_rps: Expected magnitude and its standard deviation, revolutions per second.

    Returns:
        A `Spin`, which is true, or a `Rejection`, which is false and has a reason.
    """
    of_scipy: Any = getattr(orientations, "as_quat", None)
    if of_scipy is not None:
        quaternions = np.atleast_2d(of_scipy())
        order = "xyzw"
    else:
        quaternions = floats("orientations", cast("ArrayLike", orientations))
    if order == "xyzw":
        quaternions = np.roll(quaternions, 1, axis=-1)
    elif order != "wxyz":
        raise ValueError(f"order: expected wxyz or xyzw, found {order!r}")
    return spin_of(
        _native.fit_spin(
            {
                "times_s": floats("times_s", times_s),
                "quaternions": quaternions,
                "confidences": None if confidences is None else floats("confidences", confidences),
                "residuals_rad": None if residuals_rad is None else floats("residuals_rad", residuals_rad),
                "matched": None if matched is None else np.asarray(matched, dtype=np.int64),
                "covariances_rad2": None if covariances_rad2 is None else floats("covariances_rad2", covariances_rad2),
                "view_turns_rad": None if view_turns_rad is None else floats("view_turns_rad", view_turns_rad),
            },
            {
                "frame": frame,
                "method": method,
                "model": model,
                "at_s": None if at_s is None else float(at_s),
                "max_rps": float(max_rps),
                "sigma_rad": float(sigma_rad),
                "prior_rps": prior_rps,
            },
        )
    )
