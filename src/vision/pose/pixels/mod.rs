//! A small ball's orientation from all of its pixels at once, without first deciding what is a dot.
//!
//! On a ball of 16 pixels dots are one and a half pixels wide and two apart: no detector parts them, but together they darken the
//! ball as only one orientation does. A pixel `p` within the outline shows, on a line of the light,
//!
//! ```text
//! I(p) = S(p) (1 - k C(p; R)),   S = sum of a_i Y_i(n(p)),   C = sum over the visible dots j of  g_j(p)
//! ```
//!
//! with the nine spherical harmonics `Y` up to the second degree, which hold 98 % of any light on a matt ball (R. Basri, D. Jacobs,
//! "Lambertian reflectance and linear subspaces", PAMI 25, 2003), and a dot `g_j`, which lens and pixel blur to a Gaussian of the
//! variance `s^2 + rho^2 / 4` along the limb and `s^2 + z^2 rho^2 / 4` across it, of the mass `pi rho^2 z`.
//!
//! The image is divided by the light that its brighter pixels show. Then each dot adds to the likelihood by its own place alone,
//! so that all rotations are searched ([`rotations`](super::rotations)); the best of them, and those that others propose, are
//! fitted to the pixels ([`fit`]), and compared by Student's distribution of the residuals. The mirrored pattern is no
//! ball's: it competes as all other orientations do.

mod field;
mod fit;

pub(crate) use field::Pixels;
pub use field::PlacedDot;
pub(crate) use fit::{FitStart, PixelFit};

use super::rotations::{self, RotationMatch, RotationSearch, STARTS, SearchWorkspace};
use super::trust::PixelsEvidence;
use crate::geometry::Rotation;
use fit::{Fitter, PixelProblem};

/// So many of the best rotations are considered for those that are not next to each other: their sums have broad peaks.
const CONSIDERED: usize = 600;
/// Rotations that are fitted to the end.
const FINISHED: usize = 16;
/// The most rotations that others propose.
const PROPOSED: usize = 3;
/// Steps of the fit of all, and further ones of the best.
const STEPS: [usize; 2] = [3, 6];
/// The least standard deviation of the residuals, of the ball's light: what the model leaves out.
const MIN_SCALE: f64 = 0.03;

/// What a rotation is worth before the pixels are seen.
pub(crate) type RotationPrior<'a> = &'a dyn Fn(&Rotation) -> f64;

/// Matches by a small ball's pixels; keeps its memory.
#[derive(Debug, Clone)]
pub(crate) struct PixelsMatcher {
    pixels: Pixels,
    found: Vec<RotationMatch<PixelFit>>,
    fitter: Fitter,
}

impl Default for PixelsMatcher {
    fn default() -> Self {
        Self {
            pixels: Pixels::default(),
            found: Vec::with_capacity(2 * (STARTS + PROPOSED)),
            fitter: Fitter::default(),
        }
    }
}

impl PixelsMatcher {
    /// The pixels, to be read.
    pub fn pixels(&mut self) -> &mut Pixels {
        &mut self.pixels
    }

    /// The best rotation (view frame) by the pixels read. `proposed` are rotations that are tried in any case.
    pub fn best(
        &mut self,
        start: &FitStart<'_>,
        proposed: impl Iterator<Item = Rotation>,
        search: &RotationSearch,
        ws: &mut SearchWorkspace,
    ) -> Option<(PixelFit, PixelsEvidence)> {
        self.pixels.fill(&mut ws.terms);
        let (horizon, proposed) = (Some(start.view.horizon()), proposed.take(PROPOSED));
        let Self {
            pixels,
            found,
            fitter,
        } = self;
        search.fit_best(horizon, CONSIDERED, proposed, ws, found, |tried, _| {
            let begun = PixelFit::new(tried.rotation, start);
            // What it is worth is weighed when all are fitted.
            Some((
                fitter.fit(&pixels.problem(start, tried.is_mirrored), begun, STEPS[0])?,
                0.0,
            ))
        });
        self.weigh(start, &|_| 0.0);
        self.found.truncate(FINISHED);
        for RotationMatch {
            fit, is_mirrored, ..
        } in &mut self.found
        {
            let problem = self.pixels.problem(start, *is_mirrored);
            *fit = self.fitter.fit(&problem, *fit, STEPS[1]).unwrap_or(*fit);
        }
        self.weigh_expected(start, &|_| 0.0)
    }

    /// The same by the rotations that were fitted, with a prior.
    pub fn weigh_expected(
        &mut self,
        start: &FitStart<'_>,
        prior: RotationPrior<'_>,
    ) -> Option<(PixelFit, PixelsEvidence)> {
        self.weigh(start, prior);
        let (best, other) = rotations::best(&self.found, |fit| fit.rotation)?;
        let left = self
            .fitter
            .squares(&self.pixels.problem(start, false), &best.fit)?;
        let evidence = PixelsEvidence {
            margin: best.score - other?,
            explained: (1.0 - left / self.pixels.squares()).max(0.0),
        };
        Some((best.fit, evidence))
    }

    /// Weighs what was found by the residuals' deviation of the likeliest, and sorts it, the likeliest first.
    fn weigh(&mut self, start: &FitStart<'_>, prior: RotationPrior<'_>) {
        let scales = self.found.iter().map(|f| f.fit.scale);
        let scale = scales.fold(f64::INFINITY, f64::min).max(MIN_SCALE);
        for RotationMatch {
            fit,
            is_mirrored,
            score,
        } in &mut self.found
        {
            let of_rotation = match is_mirrored {
                true => 0.0,
                false => prior(&fit.rotation),
            };
            let problem = self.pixels.problem(start, *is_mirrored);
            let cost = self.fitter.cost(&problem, fit, scale);
            *score = of_rotation - cost.unwrap_or(f64::INFINITY);
        }
        self.found
            .sort_unstable_by(|a, b| b.score.total_cmp(&a.score));
    }

    /// The visible dots where the pixels have them, about a match.
    pub fn place(
        &mut self,
        start: &FitStart<'_>,
        fit: &PixelFit,
        min_depth: f64,
        out: &mut Vec<PlacedDot>,
    ) {
        let problem = self.pixels.problem(start, false);
        self.fitter.place(&problem, fit, min_depth, out);
    }
}

impl Pixels {
    fn problem<'a>(&'a self, start: &'a FitStart<'a>, is_mirrored: bool) -> PixelProblem<'a> {
        PixelProblem {
            pixels: self,
            start,
            is_mirrored,
        }
    }
}
