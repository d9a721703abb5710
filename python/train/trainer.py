"""The optimizer: steps, evaluations, checkpoints, and the net that is kept.

AdamW (I. Loshchilov, F. Hutter, ICLR 2019) with a linear warm-up and a cosine decay of the learning rate, on frames
that are drawn during the training and never seen twice. The net is evaluated at fixed intervals on frames of another
seed; the best is kept. Frames of a third seed calibrate it, those of a fourth give its score.

A run is a function of its settings on processors with the same instructions and the same number of threads. A resumed
run ends as one without a break.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import shlex
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from spindoe import _native

from .loss import loss
from .net import Layers, Net

Arrays = tuple[NDArray[np.float32], NDArray[np.float32]]

#: Version of the weights' format.
FORMAT_VERSION = 1
#: Name of the checkpoint in the folder of a training.
CHECKPOINT = "checkpoint.pt"
#: Batches that are drawn ahead of the net.
AHEAD = 4
#: Nets whose convolutions are computed in bfloat16, in half the time.
HALF_PRECISION = ("dots-large",)
#: Steps between reports.
REPORT_EVERY = 20


class TrainingError(Exception):
    """What a user can mend, in one line."""


@dataclasses.dataclass(frozen=True)
class Settings:
    """What a training is a function of."""

    head: str
    seed: int
    steps: int
    batch: int = 64
    learning_rate: float = 2e-3
    warmup_steps: int = 300
    weight_decay: float = 1e-4
    eval_every: int = 500
    eval_frames: int = 500
    threads: int = 2

    def rate(self, step: int) -> float:
        """The learning rate of a step, counted from 0."""
        warmup = min((step + 1) / self.warmup_steps, 1.0)
        return self.learning_rate * warmup * 0.5 * (1.0 + math.cos(math.pi * step / self.steps))

    def frames(self, step: int) -> tuple[int, int]:
        """The frames of a step: the first, and the one behind the last."""
        each = self.batch // _native.samples_per_frame(self.head)
        return step * each, (step + 1) * each

    def command(self) -> str:
        """The command that repeats this training, independent of other versions' defaults."""
        words = ["python", "-m", "train"]
        for name, value in dataclasses.asdict(self).items():
            words += ["--" + name.replace("_", "-"), str(value)]
        return shlex.join(words)

    def check(self) -> None:
        """Raises `TrainingError` where a setting is out of its domain."""
        _native.net_graph(self.head)
        for name in ("steps", "batch", "warmup_steps", "eval_every", "eval_frames", "threads"):
            if getattr(self, name) < 1:
                raise TrainingError(f"{name}: expected at least 1, found {getattr(self, name)}")
        if not (0.0 < self.learning_rate < math.inf):
            raise TrainingError(
                f"learning_rate: expected a positive number, found {self.learning_rate}"
            )
        each = _native.samples_per_frame(self.head)
        if self.batch % each:
            raise TrainingError(f"batch: expected a multiple of {each}, found {self.batch}")


def batches(settings: Settings, first: int) -> Iterator[Arrays]:
    """The batches of the steps from `first` on, drawn ahead."""
    with ThreadPoolExecutor(max_workers=1) as pool:

        def draw(step: int) -> Any:
            first_frame, end = settings.frames(step)
            return pool.submit(
                _native.training_batch, settings.head, settings.seed, first_frame, end
            )

        ahead = [draw(step) for step in range(first, min(first + AHEAD, settings.steps))]
        for step in range(first, settings.steps):
            yield ahead.pop(0).result()
            if step + AHEAD < settings.steps:
                ahead.append(draw(step + AHEAD))


class Trainer:
    """A training between its steps."""

    def __init__(self, settings: Settings) -> None:
        settings.check()
        torch.set_num_threads(settings.threads)
        torch.use_deterministic_algorithms(True)
        self.settings = settings
        self.net = Net(settings.head)
        self.net.randomize(torch.Generator().manual_seed(settings.seed))
        # The order of the values in memory in which convolutions are fastest.
        self.net.to(memory_format=torch.channels_last)
        self.optimizer = torch.optim.AdamW(
            self.net.parameters(), weight_decay=settings.weight_decay, fused=True
        )
        self.step = 0
        self.best: Layers | None = None
        self.best_quality = -math.inf
        self.best_step = 0
        self._sets: dict[str, _native.TrainingSamples] = {}

    def samples(self, name: str) -> _native.TrainingSamples:
        """The samples of a set that the net does not train on."""
        if name not in self._sets:
            s = self.settings
            self._sets[name] = _native.TrainingSamples(s.head, s.seed, name, s.eval_frames)
        return self._sets[name]

    def learn(self, arrays: Arrays) -> float:
        """One step of the optimizer; the loss before it."""
        patches, targets = (torch.from_numpy(array) for array in arrays)
        for group in self.optimizer.param_groups:
            group["lr"] = self.settings.rate(self.step)
        self.optimizer.zero_grad(set_to_none=True)
        is_half = self.settings.head in HALF_PRECISION
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=is_half):
            cells = self.net(patches)
        value = loss(self.settings.head, cells.float(), targets)
        value.backward()  # type: ignore[no-untyped-call]
        self.optimizer.step()
        self.step += 1
        return float(value.detach())

    def evaluate(self) -> str:
        """Evaluates the net and keeps it where it is the best so far; the score in words."""
        layers = self.net.layers()
        calibration = self.samples("calibration").calibrate(layers)
        quality, _, words = self.samples("validation").score(layers, calibration)
        if quality > self.best_quality:
            self.best, self.best_quality, self.best_step = layers, quality, self.step
        return words

    def run(self, checkpoint: Path | None, report: Callable[[str], None]) -> None:
        """Does the steps that are left; each evaluation leaves a checkpoint."""
        started, losses = time.monotonic(), []
        first = self.step
        for arrays in batches(self.settings, first):
            losses.append(self.learn(arrays))
            if self.step % REPORT_EVERY == 0:
                each = (time.monotonic() - started) / (self.step - first)
                left = each * (self.settings.steps - self.step)
                report(
                    f"{self.settings.head} step {self.step} of {self.settings.steps}: "
                    f"loss {sum(losses) / len(losses):.4f}, {1e3 * each:.0f} ms a step, {left / 60:.0f} min left"
                )
                losses.clear()
            if self.step % self.settings.eval_every == 0 or self.step == self.settings.steps:
                report(f"{self.settings.head} step {self.step}: {self.evaluate()}")
                if checkpoint is not None:
                    self.write_checkpoint(checkpoint)

    def finish(self) -> tuple[_native.NetWeights, dict[str, Any]]:
        """The best net, rounded where its kind is, then calibrated; and its score on frames that nothing else used."""
        if self.best is None:
            self.evaluate()
        assert self.best is not None
        settings = self.settings
        meta = {
            "format_version": FORMAT_VERSION,
            "head": settings.head,
            "calibration": {"slope": 1.0, "offset": 0.0, "covariance_factor": 1.0},
            "command": settings.command(),
            "frames": settings.frames(self.best_step)[0],
            "world_sha256": _native.world_sha256(settings.head, settings.seed),
        }
        # The large net would be the greater part of what ships the crate.
        is_rounded = settings.head == "dots-large"
        layers = _native.NetWeights(self.best, json.dumps(meta), is_rounded).layers()
        calibration = self.samples("calibration").calibrate(layers)
        meta["calibration"] = json.loads(calibration)
        _, score, words = self.samples("test").score(layers, calibration)
        weights = _native.NetWeights(layers, json.dumps(meta), is_rounded)
        return weights, {"score": json.loads(score), "words": words, "best_step": self.best_step}

    def write_checkpoint(self, path: Path) -> None:
        """Writes all that is needed to continue, atomically."""
        state = {
            "settings": dataclasses.asdict(self.settings),
            "net": self.net.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "step": self.step,
            "best": None
            if self.best is None
            else [[torch.from_numpy(part) for part in layer] for layer in self.best],
            "best_quality": self.best_quality,
            "best_step": self.best_step,
        }
        partial = path.with_suffix(".partial")
        torch.save(state, partial)
        os.replace(partial, path)

    def read_checkpoint(self, path: Path) -> None:
        """Continues where a training with the same settings stopped."""
        try:
            state = torch.load(path, weights_only=True)
            found = state["settings"]
        except Exception as error:
            line = str(error).splitlines()[0]
            raise TrainingError(f"{path}: not a training's checkpoint: {line}") from error
        if found != dataclasses.asdict(self.settings):
            raise TrainingError(f"{path}: expected the checkpoint of a training with the same settings")
        self.net.load_state_dict(state["net"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.step = state["step"]
        best = state["best"]
        self.best = None if best is None else [(w.numpy(), b.numpy()) for w, b in best]
        self.best_quality, self.best_step = state["best_quality"], state["best_step"]
