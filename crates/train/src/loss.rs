//! The training loss.
//!
//! The heat map's loss is CenterNet's focal loss (Zhou et al. 2019, eq. 1, after Law and Deng
//! 2018), `alpha = 2`, `beta = 4`: for the probability `p` and the target `y`, a Gaussian about
//! each dot,
//!
//! `-(1 - p)^2 ln p` where a dot's own cell is, `-(1 - y)^4 p^2 ln(1 - p)` elsewhere,
//!
//! summed and divided by the number of dots. Cells with an undecidable dot (at the limb, under a
//! logo) have no weight.
//!
//! Position and its uncertainty are learned together, from the cells about each dot. Their loss is
//! the negative logarithm of a Student density with 4 degrees of freedom in two dimensions,
//! `3 ln(1 + |L e|^2 / 4) - ln a - ln c`. Its heavy tails keep a few outliers from inflating all
//! deviations.

use burn::tensor::Tensor;
use burn::tensor::activation::log_sigmoid;

use spindoe::vision::net::graph::Channel;

/// Weight of the positions beside the heat map.
const POSITION_WEIGHT: f32 = 0.25;
/// Bound of the logarithms of the factor's diagonal, the same as in inference.
const LN_RANGE: [f32; 2] = [-2.5, 4.0];

/// Targets of the cells: all (n, 1, cells, cells), except the positions.
#[derive(Debug, Clone)]
pub struct Targets {
    /// 1 in a dot's own cell.
    pub own: Tensor<4>,
    /// `(1 - y)^4` elsewhere; 0 in own cells and in undecidable ones.
    pub elsewhere: Tensor<4>,
    /// Dot minus cell, (n, 2, cells, cells): columns, rows, in the patch's values.
    pub position: Tensor<4>,
    /// Weight of the position in a cell.
    pub near: Tensor<4>,
}

/// The parts of the loss, one value each.
#[derive(Debug, Clone)]
pub struct Loss {
    /// The minimized sum.
    pub total: Tensor<1>,
    /// The heat map's part.
    pub heat: Tensor<1>,
    /// The positions' part, before its weight.
    pub position: Tensor<1>,
}

/// The loss of a batch's cells (n, channels, cells, cells).
pub fn loss(cells: Tensor<4>, targets: &Targets) -> Loss {
    let channel = |c: Channel| cells.clone().narrow(1, c as usize, 1);
    let heat = focal(channel(Channel::Heat), targets);
    let position = student(channel, targets);
    Loss {
        total: heat.clone() + position.clone() * POSITION_WEIGHT,
        heat,
        position,
    }
}

fn focal(odds: Tensor<4>, targets: &Targets) -> Tensor<1> {
    let ln_p = log_sigmoid(odds.clone());
    let ln_q = log_sigmoid(-odds);
    let (p, q) = (ln_p.clone().exp(), ln_q.clone().exp());
    let hit = q.clone() * q * ln_p * targets.own.clone();
    let miss = p.clone() * p * ln_q * targets.elsewhere.clone();
    let dots = targets.own.clone().sum().clamp_min(1.0);
    -(hit + miss).sum() / dots
}

fn student(channel: impl Fn(Channel) -> Tensor<4>, targets: &Targets) -> Tensor<1> {
    let off = |c: Channel, axis: usize| targets.position.clone().narrow(1, axis, 1) - channel(c);
    let (eu, ev) = (off(Channel::Column, 0), off(Channel::Row, 1));
    let ln_a = channel(Channel::LnA).clamp(LN_RANGE[0], LN_RANGE[1]);
    let ln_c = channel(Channel::LnC).clamp(LN_RANGE[0], LN_RANGE[1]);
    let zu = ln_a.clone().exp() * eu.clone();
    let zv = channel(Channel::B) * eu + ln_c.clone().exp() * ev;
    let squared = zu.clone() * zu + zv.clone() * zv;
    let each = (squared / 4.0 + 1.0).log() * 3.0 - ln_a - ln_c;
    let weight = targets.near.clone().sum().clamp_min(1.0);
    (each * targets.near.clone()).sum() / weight
}
