"""What diagnostics say: how many images were answered, how late, and what is wrong."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass
from statistics import median, quantiles
from typing import Literal

from .core import Answer, nanoseconds

OK, WARN, ERROR = 0, 1, 2
"""Levels of ``diagnostic_msgs/DiagnosticStatus``."""
Verdict = Literal["fine", "no images", "unreadable", "clock", "no camera", "slow", "doubt"]
# tf2 keeps transforms for 10 s: what is stamped further away is of no use to it.
MAX_AGE_S = 10.0
# Gaps beyond are pauses of the camera, not frames that were missed.
MAX_GAP_NS = 10**9
# Steps between images that the camera's period is taken from.
STEPS = 100
# Largest distance between the quartiles of what steps differ from whole periods, over the period: stamps that jitter more do
# not say what was missed.
STEADY = 0.2


@dataclass(frozen=True)
class Report:
    """What is known of the images since the last report."""

    level: int
    verdict: Verdict
    message: str
    values: dict[str, str]
    frame_id: str
    """The camera's."""


def most(reasons: Counter[str]) -> str:
    """The commonest, or nothing."""
    return reasons.most_common(1)[0][0] if reasons else ""


class Health:
    """Counts images and what became of them."""

    def __init__(self) -> None:
        self._steps_ns: deque[int] = deque(maxlen=STEPS)
        self._last_ns: int | None = None
        self._frame_id = ""
        self._begin()

    def _begin(self) -> None:
        self._images = self._balls = self._poses = self._spins = self._unchecked = 0
        self._new_ns: list[int] = []
        self._seconds: list[float] = []
        self._ages_s: list[float] = []
        self._reasons: Counter[str] = Counter()
        self._unreadable: Counter[str] = Counter()

    def refuse(self, problem: str) -> None:
        """Counts an image that cannot be read."""
        self._unreadable[problem] += 1

    def take(self, answer: Answer, seconds: float, age_s: float) -> None:
        """Counts an answer.

        Args:
            answer: The answer.
            seconds: Time that it took.
            age_s: Time from the image's stamp to the answer, by the node's clock.
        """
        self._frame_id = answer.frame_id
        self._images += 1
        self._balls += answer.frame.circle is not None
        self._poses += bool(answer.pose)
        self._spins += bool(answer.spin)
        # The slowest spin that leads from one pose to another: no third one checks it.
        self._unchecked += bool(answer.spin and answer.spin.inliers < 3)
        self._seconds.append(seconds)
        self._ages_s.append(age_s)
        if not answer.pose:
            self._reasons[answer.pose.reason] += 1
        now = nanoseconds(answer.stamp)
        step = now - self._last_ns if self._last_ns is not None else 0
        self._last_ns = now
        if 0 < step <= MAX_GAP_NS:
            self._steps_ns.append(step)
            self._new_ns.append(step)

    def _missed(self) -> int | None:
        """Frames missed since the last report, at least; None where the stamps have no steady period to count by."""
        if len(self._steps_ns) < 2:
            return None
        period = median(self._steps_ns)
        low, _, high = quantiles(step - period * max(1, round(step / period)) for step in self._steps_ns)
        if high - low > STEADY * period:
            return None
        by_steps = sum(max(0, round(step / period) - 1) for step in self._new_ns)
        # A late stamp makes a long step and then a short one: no more is missed than the time of all has room for.
        in_all = round(sum(self._new_ns) / period) - len(self._new_ns)
        return max(0, min(by_steps, in_all))

    def report(self, seconds: float, camera_missing: str) -> Report:
        """What is known since the last report.

        Args:
            seconds: Time since then.
            camera_missing: Why no intrinsics are known, empty where they are.
        """
        missed = self._missed()
        level, verdict, message = self._judge(seconds, camera_missing, missed)
        values = {
            "images": str(self._images),
            "images with a ball": str(self._balls),
            "answered": str(self._poses),
            "answered share": f"{self._poses / self._balls:.3f}" if self._balls else "",
            "spins": str(self._spins),
            "spins of two images": str(self._unchecked),
            "unreadable images": str(sum(self._unreadable.values())),
            "missed frames": "" if missed is None else str(missed),
            "processing ms": f"{1e3 * median(self._seconds):.1f}" if self._seconds else "",
            "latency ms": f"{1e3 * median(self._ages_s):.1f}" if self._ages_s else "",
            "largest latency ms": f"{1e3 * max(self._ages_s):.1f}" if self._ages_s else "",
            "intrinsics": camera_missing or "known",
            "reason": most(self._reasons),
        }
        self._begin()
        return Report(level, verdict, message, values, self._frame_id)

    def _judge(self, seconds: float, camera_missing: str, missed: int | None) -> tuple[int, Verdict, str]:
        """The first of what is wrong, the worst first."""
        unreadable = sum(self._unreadable.values())
        if unreadable:
            words = f"{unreadable} of {unreadable + self._images} images cannot be read: {most(self._unreadable)}"
            return (WARN if self._images else ERROR), "unreadable", words
        if not self._images:
            return WARN, "no images", "no images"
        off_s = median(self._ages_s)
        if abs(off_s) > MAX_AGE_S:
            words = f"the images' stamps and the node's clock are {abs(off_s):.0f} s apart: expected one (use_sim_time for bags)"
            return WARN, "clock", words
        if camera_missing:
            return WARN, "no camera", (
                f"no intrinsics, so no position, and answers are in the view frame of each image: {camera_missing}"
            )
        busy = sum(self._seconds) / seconds if seconds > 0.0 else 0.0
        least = missed or 0
        # A tenth is left to receive and publish.
        if busy > 0.9 or least > 0.1 * (self._images + least):
            words = (
                f"frames are missed: at least {least} of {self._images + least}" if least
                else f"frames may be missed: images take {100.0 * busy:.0f} % of the time"
            )
            return WARN, "slow", f"{words}, with {1e3 * median(self._seconds):.0f} ms for an image"
        if not self._balls:
            return OK, "fine", most(self._reasons)
        words = f"{self._poses} of {self._balls} images with a ball are answered"
        if 2 * self._poses < self._balls:
            return WARN, "doubt", f"{words}: {most(self._reasons)}"
        return OK, "fine", words
