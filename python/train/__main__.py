"""The command ``python -m train``: trains one net or all, from random weights."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

from spindoe import _native

from .trainer import CHECKPOINT, Settings, Trainer, TrainingError

#: What trained the built-in nets.
BUILT_IN = {
    "dots": Settings("dots", seed=11, steps=12_000),
    "outline": Settings("outline", seed=21, steps=12_000),
    "dots-large": Settings("dots-large", seed=31, steps=8_000),
}


def arguments() -> argparse.Namespace:
    """What the user asks for."""
    parser = argparse.ArgumentParser(
        prog="python -m train",
        description="Trains the nets of spindoe on synthetic frames, from random weights. "
        "What is not given is as it was for the built-in nets.",
    )
    parser.add_argument("--head", choices=list(BUILT_IN), help="the net; all of them by default")
    parser.add_argument("-o", "--output", dest="out", type=Path, help="folder for weights, scores and checkpoints")
    parser.add_argument("--score", type=Path, metavar="NPZ", help="only score these weights")
    parser.add_argument("--force", action="store_true", help="train nets that are up to date, too")
    for name, kind, text in (
        ("seed", int, "seed of the first weights and of all frames"),
        ("steps", int, "steps of the optimizer"),
        ("batch", int, "samples a step"),
        ("learning-rate", float, "highest learning rate"),
        ("warmup-steps", int, "steps of the linear warm-up"),
        ("weight-decay", float, "weight decay of AdamW"),
        ("eval-every", int, "steps between evaluations, each of which leaves a checkpoint"),
        ("eval-frames", int, "frames of each of the three sets that evaluate"),
        ("threads", int, "threads of PyTorch"),
    ):
        parser.add_argument(f"--{name}", type=kind, help=text)
    return parser.parse_args()


def settings_of(head: str, given: argparse.Namespace) -> Settings:
    """The built-in net's settings with what is given."""
    names = [name for name in vars(BUILT_IN[head]) if name != "head"]
    changes = {name: getattr(given, name) for name in names if getattr(given, name) is not None}
    return Settings(**{**vars(BUILT_IN[head]), **changes})


def report(line: str) -> None:
    """One line of progress."""
    print(line, file=sys.stderr, flush=True)


def is_up_to_date(path: Path, settings: Settings) -> bool:
    """Whether weights are there that this training would make."""
    if not path.exists():
        return False
    meta = json.loads(_native.NetWeights.read(path).meta())
    world = _native.world_sha256(settings.head, settings.seed)
    return bool(meta["command"] == settings.command() and meta.get("world_sha256") == world)


def train(settings: Settings, out: Path, force: bool) -> None:
    """Trains one net, or continues, and writes weights and score."""
    weights_path = out / f"{settings.head}.npz"
    if not force and is_up_to_date(weights_path, settings):
        report(f"{weights_path}: up to date")
        return
    folder = out / settings.head
    folder.mkdir(parents=True, exist_ok=True)
    trainer = Trainer(settings)
    checkpoint = folder / CHECKPOINT
    if checkpoint.exists():
        trainer.read_checkpoint(checkpoint)
        report(f"{checkpoint}: continues after step {trainer.step}")
    started = time.monotonic()
    trainer.run(checkpoint, report)
    weights, outcome = trainer.finish()
    outcome["minutes"] = round((time.monotonic() - started) / 60.0, 2)
    weights.write(weights_path)
    (folder / "score.json").write_text(json.dumps(outcome, indent=1) + "\n")
    checkpoint.unlink(missing_ok=True)
    report(f"{weights_path}: {outcome['words']}")


def score(path: Path, given: argparse.Namespace) -> None:
    """Prints the score of weights on frames that no training with this seed used."""
    weights = _native.NetWeights.read(path)
    meta = json.loads(weights.meta())
    settings = settings_of(meta["head"], given)
    samples = _native.TrainingSamples(
        settings.head, settings.seed, "test", settings.eval_frames
    )
    _, _, words = samples.score(weights.layers(), json.dumps(meta["calibration"]))
    print(words)


def main() -> int:
    """Runs the command; 2 where the user can mend what is wrong."""
    given = arguments()
    try:
        if given.score is not None:
            score(given.score, given)
            return 0
        if given.out is None:
            raise TrainingError("--output: expected a folder")
        for head in BUILT_IN if given.head is None else [given.head]:
            train(settings_of(head, given), given.out, given.force)
    except (TrainingError, ValueError, OSError) as error:
        report(f"train: {error}")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
