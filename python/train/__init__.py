"""Training of the built-in nets in PyTorch: ``python -m train --help``.

Frames, targets, calibration and scores come from the package's native part, so that nothing of them is written twice.
Here are the net with gradients (`net`), its loss (`loss`) and the optimizer with checkpoints (`trainer`).
"""
