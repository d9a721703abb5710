"""The net with gradients, built from the description that the library's inference has."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from spindoe import _native
from torch import Tensor, nn
from torch.nn import functional

Layers = list[tuple[NDArray[np.float32], NDArray[np.float32]]]

#: Log odds with which an untrained net expects a dot in a cell.
FIRST_HEAT = -4.0
#: Gain of the last convolution's first weights.
LAST_GAIN = 0.1


class Net(nn.Module):
    """A net of the library: patches (n, 1, side, side) to cells (n, channels, side / 2, side / 2)."""

    def __init__(self, head: str) -> None:
        super().__init__()
        graph = json.loads(_native.net_graph(head))
        self.steps: list[list[Any]] = graph["steps"]
        self.convolutions = [
            nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2)
            for inputs, outputs, kernel, stride in graph["convolutions"]
        ]
        # What is not in such a list has no gradient.
        self.parts = nn.ModuleList(self.convolutions)
        self.head = head

    def randomize(self, generator: torch.Generator) -> None:
        """Random parameters (K. He et al., "Delving deep into rectifiers", ICCV 2015)."""
        last = len(self.convolutions) - 1
        with torch.no_grad():
            for i, convolution in enumerate(self.convolutions):
                weight = convolution.weight
                gain = LAST_GAIN if i == last else 1.0
                deviation = gain * (2.0 / weight[0].numel()) ** 0.5
                weight.copy_(torch.randn(weight.shape, generator=generator) * deviation)
                biases(convolution).zero_()
            if self.head != "outline":
                biases(self.convolutions[last])[0] = FIRST_HEAT

    def forward(self, patches: Tensor) -> Tensor:
        """The cells of patches."""
        values = [patches]
        for kind, *of in self.steps:
            if kind == "convolve":
                convolution, source, is_rectified = of
                value = self.convolutions[convolution](values[source])
                value = functional.relu(value) if is_rectified else value
            elif kind == "upsample":
                value = functional.interpolate(values[of[0]], scale_factor=2.0, mode="nearest")
            else:
                value = values[of[0]] + values[of[1]]
            values.append(value)
        return values[-1]

    def layers(self) -> Layers:
        """The parameters as the library takes them: kernels and biases of each convolution, flat."""
        return [
            (flat(convolution.weight), flat(biases(convolution))) for convolution in self.convolutions
        ]

    def load_layers(self, layers: Layers) -> None:
        """Takes parameters as `layers` gives them."""
        with torch.no_grad():
            for convolution, (weight, bias) in zip(self.convolutions, layers, strict=True):
                convolution.weight.copy_(torch.from_numpy(weight).view_as(convolution.weight))
                biases(convolution).copy_(torch.from_numpy(bias))


def biases(convolution: nn.Conv2d) -> Tensor:
    """A convolution's biases; each here has them."""
    assert convolution.bias is not None
    return convolution.bias


def flat(parameter: Tensor) -> NDArray[np.float32]:
    """A copy of a parameter's values."""
    values: NDArray[np.float32] = parameter.detach().cpu().numpy().ravel().copy()
    return values
