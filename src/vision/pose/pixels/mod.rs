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
//! so that 60 000 orientations are summed as in [`dense`](super::dense); the best of them, and those that others propose, are
//! fitted to the pixels ([`fit`]), and compared by Student's distribution of the residuals. The mirrored pattern is no
//! ball's: it competes as all other orientations do.

mod field;
mod fit;

pub(crate) use field::Pixels;
pub use field::PlacedDot;
pub(crate) use fit::Fit;

use super::dense::{DenseMatcher, DenseWorkspace};
use crate::geometry::{Rotation, Vec3};
use crate::vision::optics::camera::BallView;

/// Orientations of the pattern and of its mirror image each that are fitted, and those that are fitted to the end.
const STARTS: usize = 16;
const FINISHED: usize = 8;
/// The most orientations that others propose.
const PROPOSED: usize = 3;
/// Steps of the fit of all, and further ones of the best.
const STEPS: [usize; 2] = [3, 6];
/// Orientations that differ by more are different answers, radians: 20 degrees.
const DIFFERENT: f64 = 0.35;
/// The least standard deviation of the residuals, of the ball's light: what the model leaves out.
const MIN_SCALE: f64 = 0.03;

/// The orientation by a small ball's pixels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WholeMatch {
    pub fit: Fit,
    /// By how much its logarithmic likelihood exceeds that of any other orientation and of the mirrored pattern.
    pub margin: f64,
    /// The part of the squares that shading leaves which the dots explain.
    pub explained: f64,
}

/// What an orientation is worth before the pixels are seen.
pub(crate) type RotationPrior<'a> = &'a dyn Fn(&Rotation) -> f64;

/// Working memory.
#[derive(Debug, Clone)]
pub(crate) struct WholeWorkspace {
    pixels: Pixels,
    starts: Vec<Rotation>,
    found: Vec<Found>,
    fitter: fit::Fitter,
}

impl Default for WholeWorkspace {
    fn default() -> Self {
        let most = STARTS + PROPOSED;
        Self {
            pixels: Pixels::default(),
            starts: Vec::with_capacity(most),
            found: Vec::with_capacity(2 * most),
            fitter: fit::Fitter::default(),
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Found {
    fit: Fit,
    is_mirrored: bool,
    /// Minus the logarithm of its likelihood.
    cost: f64,
}

impl WholeWorkspace {
    /// The pixels, to be read.
    pub fn pixels(&mut self) -> &mut Pixels {
        &mut self.pixels
    }

    /// The best orientation (view frame) of the dots by the pixels read. `proposed` are orientations that are tried in any case.
    /// `start` is the view of the ball, whose camera's distance is fitted where it `is_unknown`.
    pub fn best(
        &mut self,
        dots: &[Vec3],
        matcher: &DenseMatcher,
        start: &fit::Start,
        proposed: impl Iterator<Item = Rotation>,
        search: &mut DenseWorkspace,
    ) -> Option<WholeMatch> {
        self.found.clear();
        self.starts.clear();
        self.starts.extend(proposed.take(PROPOSED));
        let horizon = start.view.horizon();
        for is_mirrored in [false, true] {
            let terms = self.pixels.terms(is_mirrored);
            let count = self.starts.len() + STARTS;
            matcher.starts(terms, horizon, count, search, &mut self.starts);
            for &rotation in &self.starts {
                let begun = Fit::new(rotation, start);
                let fit = self
                    .fitter
                    .fit(&self.pixels, dots, start, begun, is_mirrored, STEPS[0]);
                self.found.extend(fit.map(|fit| Found {
                    fit,
                    is_mirrored,
                    cost: 0.0,
                }));
            }
            self.starts.clear();
        }
        self.weigh(dots, start, &|_| 0.0);
        let count = self.found.len().min(2 * FINISHED);
        self.found.truncate(count);
        for k in 0..count {
            let Found {
                fit, is_mirrored, ..
            } = self.found[k];
            let finished = self
                .fitter
                .fit(&self.pixels, dots, start, fit, is_mirrored, STEPS[1]);
            self.found[k].fit = finished.unwrap_or(fit);
        }
        self.weigh_expected(dots, start, &|_| 0.0)
    }

    /// The same by the orientations that were fitted, with a prior.
    pub fn weigh_expected(
        &mut self,
        dots: &[Vec3],
        start: &fit::Start,
        prior: RotationPrior<'_>,
    ) -> Option<WholeMatch> {
        self.weigh(dots, start, prior);
        let best = *self.found.iter().find(|f| !f.is_mirrored)?;
        let is_other =
            |f: &&Found| f.is_mirrored || f.fit.rotation.angle_to(&best.fit.rotation) > DIFFERENT;
        let other = self.found.iter().find(is_other).map(|f| f.cost)?;
        let left = self.fitter.squares(&self.pixels, dots, start, &best.fit)?;
        Some(WholeMatch {
            fit: best.fit,
            explained: (1.0 - left / self.pixels.squares()).max(0.0),
            margin: other - best.cost,
        })
    }

    /// Sorts what was found, the likeliest first, by the residuals' deviation of the likeliest.
    fn weigh(&mut self, dots: &[Vec3], start: &fit::Start, prior: RotationPrior<'_>) {
        let scales = self.found.iter().map(|f| f.fit.scale);
        let scale = scales.fold(f64::INFINITY, f64::min).max(MIN_SCALE);
        for found in &mut self.found {
            let Found {
                fit, is_mirrored, ..
            } = *found;
            let of_rotation = match is_mirrored {
                true => 0.0,
                false => prior(&fit.rotation),
            };
            let cost = self
                .fitter
                .cost(&self.pixels, dots, start, &fit, is_mirrored, scale);
            found.cost = cost.unwrap_or(f64::INFINITY) - of_rotation;
        }
        self.found
            .sort_unstable_by(|a, b| a.cost.total_cmp(&b.cost));
    }

    /// The visible dots where the pixels have them, about a match.
    pub fn place(
        &mut self,
        dots: &[Vec3],
        start: &fit::Start,
        fit: &Fit,
        min_depth: f64,
        out: &mut Vec<PlacedDot>,
    ) {
        self.fitter
            .place(&self.pixels, dots, start, fit, min_depth, out);
    }
}

/// How a match begins: the ball as its outline has it.
pub(crate) fn start(view: BallView, outline_sigma_px: [f64; 2], is_unknown: bool) -> fit::Start {
    fit::Start {
        view,
        outline_sigma_px,
        is_unknown,
    }
}
