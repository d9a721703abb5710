"""The training in ``python/train``: needs PyTorch, and says loudly that nothing was tested without it."""

from __future__ import annotations

import dataclasses
import json
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from spindoe import _native

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
try:
    import torch
except ImportError:
    warnings.warn("PyTorch is not here: the training is NOT tested", stacklevel=1)
    pytest.skip("PyTorch is not here: the training is NOT tested", allow_module_level=True)

from train.net import Net
from train.trainer import Settings, Trainer, TrainingError

HEADS = ["dots", "dots-large", "outline"]


def short(head: str, steps: int = 12) -> Settings:
    """A training of seconds."""
    return Settings(
        head, seed=1, steps=steps, batch=8, warmup_steps=2, eval_every=6, eval_frames=8
    )


@pytest.mark.parametrize("head", HEADS)
def test_pytorch_and_the_estimator_compute_the_same_cells(head: str, root: Path) -> None:
    samples = _native.TrainingSamples(head, 1_000, "test", 8)
    patches = torch.from_numpy(samples.patches())[:, None]
    shipped = Net(head)
    shipped.load_layers(_native.NetWeights.read(root / "models" / f"{head}.npz").layers())
    nets = [shipped]
    for seed in range(2):
        nets.append(Net(head))
        nets[-1].randomize(torch.Generator().manual_seed(seed))
    for net in nets:
        with torch.no_grad():
            expected = net(patches).flatten(1).numpy()
        assert np.abs(samples.cells(net.layers()) - expected).max() < 1e-4


@pytest.mark.parametrize("head", HEADS)
def test_a_few_steps_lower_the_loss(head: str) -> None:
    trainer = Trainer(dataclasses.replace(short(head, 40), warmup_steps=5))
    arrays = _native.training_batch(head, 1, 0, 4)
    losses = [trainer.learn(arrays) for _ in range(25)]
    assert losses[-1] < 0.8 * losses[0] if losses[0] > 0.0 else losses[-1] < losses[0]


def test_a_resumed_training_ends_as_one_without_a_break(tmp_path: Path) -> None:
    checkpoint = tmp_path / "checkpoint.pt"
    whole = Trainer(short("dots"))
    whole.run(None, lambda line: None)
    broken = Trainer(short("dots"))

    class Break(Exception):
        pass

    def stop(line: str) -> None:
        # The checkpoint of step 6 is written after its report: stop at that of step 12.
        if broken.step == 12:
            raise Break

    with pytest.raises(Break):
        broken.run(checkpoint, stop)
    resumed = Trainer(short("dots"))
    resumed.read_checkpoint(checkpoint)
    assert resumed.step == 6
    resumed.run(None, lambda line: None)
    for name, trained in (("whole", whole), ("resumed", resumed)):
        weights, _ = trained.finish()
        weights.write(tmp_path / f"{name}.npz")
    assert (tmp_path / "whole.npz").read_bytes() == (tmp_path / "resumed.npz").read_bytes()
    meta = json.loads(_native.NetWeights.read(tmp_path / "whole.npz").meta())
    assert meta["command"].startswith("python -m train --head dots --seed 1 --steps 12 ")
    assert len(meta["world_sha256"]) == 64
    with pytest.raises(TrainingError, match="same settings"):
        Trainer(short("dots", 13)).read_checkpoint(checkpoint)


def test_the_large_net_is_rounded_to_eight_bits(tmp_path: Path) -> None:
    trainer = Trainer(short("dots-large", 2))
    weights, _ = trainer.finish()
    weights.write(tmp_path / "large.npz")
    with np.load(tmp_path / "large.npz") as arrays:
        assert arrays["convolution_00_weight"].dtype == np.int8


def test_samples_depend_on_the_number_of_their_frame_only() -> None:
    for head in HEADS:
        patches, targets = _native.training_batch(head, 5, 0, 4)
        last_patches, last_targets = _native.training_batch(head, 5, 3, 4)
        assert np.array_equal(patches[-len(last_patches) :], last_patches)
        assert np.array_equal(targets[-len(last_targets) :], last_targets)


def test_bad_settings_are_rejected_in_one_line() -> None:
    for bad in (dict(steps=0), dict(batch=7), dict(learning_rate=0.0)):
        with pytest.raises(TrainingError, match="expected"):
            Trainer(dataclasses.replace(short("dots"), **bad))
    with pytest.raises(ValueError, match="head"):
        Trainer(dataclasses.replace(short("dots"), head="other"))
