//! Samples of the nets for dots, and their targets.
//!
//! A sample's patch is cut as the estimator cuts it, around a circle that is displaced by the error of a fit.

use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

use super::Symmetry;
use crate::synth::Rendering;
use crate::vision::dots::net::cell_center;
use crate::vision::dots::patch::Patch;
use crate::vision::net::graph::CELLS;
use crate::vision::optics::camera::{BallCircle, Pixel};

/// Deviation of a dot's Gaussian in the heat map, in the patch's pixels (paper, Sec. III-A: 1.5 px
/// at 60 x 60).
const HEAT_SIGMA: f64 = 1.5;
/// Cells farther from a dot than this, in the patch's pixels, do not learn its position.
const NEAR: f64 = 2.4;
/// Radius about an undecidable dot, in the patch's pixels, within which the heat has no weight.
const BLIND: f64 = 4.0;
/// Relative deviations of a fitted circle's center and radius.
const CIRCLE_SIGMA: f64 = 0.012;
/// Share of the circles with three times that deviation.
const BAD_CIRCLES: f64 = 0.1;

/// A dot in a patch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PatchDot {
    /// Its column and row (as u and v).
    pub at: Pixel,
    /// Whether it must be found; otherwise it is undecidable.
    pub certain: bool,
}

/// A patch with its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct DotSample {
    /// The patch.
    pub patch: Patch,
    /// Its dots.
    pub dots: Vec<PatchDot>,
}

/// A patch of a frame, with its circle displaced by the error of a fit.
pub fn sample<R: Rng + ?Sized>(frame: &Rendering, rng: &mut R) -> DotSample {
    let gray = frame.image.to_gray();
    let far = if rng.random_bool(BAD_CIRCLES) {
        3.0
    } else {
        1.0
    };
    let mut off = || far * CIRCLE_SIGMA * rng.sample::<f64, _>(StandardNormal);
    let BallCircle { center, radius, .. } = frame.circle;
    let circle = BallCircle::new(
        Pixel {
            u: center.u + radius * off(),
            v: center.v + radius * off(),
        },
        radius * (1.0 + off()),
    );
    let patch = Patch::cut(&gray, &circle);
    let dots = frame
        .dots
        .iter()
        .map(|dot| PatchDot {
            at: patch.from_image(dot.pixel),
            // Neither beyond the image's edge nor behind a hand is there evidence of a dot.
            certain: dot.is_visible(),
        })
        .collect();
    DotSample { patch, dots }
}

/// The targets of a sample's dots, rotated and mirrored with its patch, in the order of
/// [`DOT_TARGETS`](super::DOT_TARGETS).
pub fn targets(dots: &[PatchDot], symmetry: Symmetry) -> Vec<f32> {
    let dots: Vec<PatchDot> = dots
        .iter()
        .map(|dot| PatchDot {
            at: symmetry.place(dot.at),
            ..*dot
        })
        .collect();
    let area = CELLS * CELLS;
    let mut all = vec![0.0; 5 * area];
    for row in 0..CELLS {
        for column in 0..CELLS {
            let cell = target(row, column, &dots);
            for (channel, value) in cell.into_iter().enumerate() {
                all[channel * area + row * CELLS + column] = value;
            }
        }
    }
    for dot in dots.iter().filter(|d| d.certain) {
        let index = |x: f64| ((x - 0.5) / 2.0).round().clamp(0.0, (CELLS - 1) as f64) as usize;
        let own = index(dot.at.v) * CELLS + index(dot.at.u);
        all[own] = 1.0;
        all[area + own] = 0.0;
    }
    all
}

/// The targets of a cell, as one without a dot of its own.
fn target(row: usize, column: usize, dots: &[PatchDot]) -> [f32; 5] {
    let (u, v) = (cell_center(column), cell_center(row));
    let distance = |dot: &PatchDot| (dot.at.u - u).hypot(dot.at.v - v);
    let nearest = dots
        .iter()
        .filter(|d| d.certain)
        .min_by(|a, b| distance(a).total_cmp(&distance(b)));
    let is_blind = dots.iter().any(|d| !d.certain && distance(d) < BLIND);
    let unless_blind = |weight: f64| if is_blind { 0.0 } else { weight as f32 };
    let Some(dot) = nearest else {
        return [0.0, unless_blind(1.0), 0.0, 0.0, 0.0];
    };
    let heat = (-0.5 * (distance(dot) / HEAT_SIGMA).powi(2)).exp();
    let elsewhere = unless_blind((1.0 - heat).powi(4));
    if distance(dot) < NEAR {
        let (right, down) = ((dot.at.u - u) as f32, (dot.at.v - v) as f32);
        [0.0, elsewhere, right, down, heat as f32]
    } else {
        [0.0, elsewhere, 0.0, 0.0, 0.0]
    }
}
