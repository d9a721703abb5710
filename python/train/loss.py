"""The losses of the nets for dots and for outlines.

The heat map's loss is CenterNet's focal loss (Zhou et al. 2019, eq. 1, after Law and Deng 2018), ``alpha = 2``,
``beta = 4``: for the probability ``p`` and the target ``y``, a Gaussian about each dot,

    -(1 - p)^2 ln p                where a dot's own cell is,
    -(1 - y)^4 p^2 ln(1 - p)       elsewhere,

summed and divided by the number of dots. Cells with an undecidable dot (at the limb, under a logo) have no weight.

Position and its uncertainty are learned together, from the cells about each dot. Their loss is the negative logarithm
of a Student density with 4 degrees of freedom in two dimensions, ``3 ln(1 + |L e|^2 / 4) - ln a - ln c``. Its heavy
tails keep a few outliers from inflating all deviations. A cell's distance from the outline has the same in one
dimension, ``2.5 ln(1 + (a e)^2 / 4) - ln a``: where nothing shows the outline, the net says so by a small ``a``.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import logsigmoid

#: Weight of the positions beside the heat map.
POSITION_WEIGHT = 0.25
#: Bounds of the logarithms of precisions, the same as in inference.
LN_RANGE = (-2.5, 4.0)


def loss(head: str, cells: Tensor, targets: Tensor) -> Tensor:
    """The mean loss of a batch's cells (n, channels, cells, cells)."""
    if head == "outline":
        return outline_loss(cells, targets)
    return heat_loss(cells, targets) + POSITION_WEIGHT * position_loss(cells, targets)


def heat_loss(cells: Tensor, targets: Tensor) -> Tensor:
    """The heat map's part."""
    odds, own, elsewhere = cells[:, 0], targets[:, 0], targets[:, 1]
    ln_p, ln_q = logsigmoid(odds), logsigmoid(-odds)
    hit = (2.0 * ln_q).exp() * ln_p * own
    miss = (2.0 * ln_p).exp() * ln_q * elsewhere
    return -(hit + miss).sum() / own.sum().clamp_min(1.0)


def position_loss(cells: Tensor, targets: Tensor) -> Tensor:
    """The positions' part, before its weight."""
    error_u, error_v = targets[:, 2] - cells[:, 1], targets[:, 3] - cells[:, 2]
    ln_a, b, ln_c = cells[:, 3].clamp(*LN_RANGE), cells[:, 4], cells[:, 5].clamp(*LN_RANGE)
    z_u = ln_a.exp() * error_u
    z_v = b * error_u + ln_c.exp() * error_v
    each = 3.0 * torch.log1p((z_u.square() + z_v.square()) / 4.0) - ln_a - ln_c
    near = targets[:, 4]
    return (each * near).sum() / near.sum().clamp_min(1.0)


def outline_loss(cells: Tensor, targets: Tensor) -> Tensor:
    """The loss of the distances from the outline."""
    distance, weight = targets[:, 0], targets[:, 1]
    ln_a = cells[:, 1].clamp(*LN_RANGE)
    z = (distance - cells[:, 0]) * ln_a.exp()
    each = 2.5 * torch.log1p(z.square() / 4.0) - ln_a
    return (each * weight).sum() / weight.sum().clamp_min(1.0)
