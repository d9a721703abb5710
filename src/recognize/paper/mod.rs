//! The SpinDOE paper's recognizer (Gossard et al., arXiv 2303.03879, Alg. 2), kept as the baseline.
//!
//! 1. The first two observed dots, in the order given, span the basis `B = [d, d', d x d']`.
//! 2. Each further dot d'' has the hash value `h = B^-1 d''`. Each of the k features of the table
//!    nearest to it, with value `h_t`, basis b and dot t, votes for b with the score `p`.
//! 3. The better half of the bases with votes is verified. The basis pair gives a rotation, each
//!    observed dot is matched with the rotated pattern's nearest dot, and Kabsch over all dots
//!    refines the rotation. The remaining root mean square angle is the reprojection error.
//! 4. The basis with the smallest reprojection error wins.
//!
//! The score measures how well the point `x = B h_t` agrees with the dot d'' that it should be:
//! `p = Kent(x/|x|; d'') N(|x|; 1, alpha) |det B|`. The Kent density scores the direction, the
//! normal density scores the length, and `|det B|` converts a density of points to one of hash
//! values.
//!
//! The choice between a sum of `p` and a sum of `ln p` is decisive, see [`VoteSum`]. The authors'
//! published code adds up logarithms, and so does this recognizer unless configured otherwise: a
//! baseline must keep the original's failures.
//!
//! What it does not guarantee: the algorithm models neither false nor missed dots, so one false dot
//! among the first two makes it fail. Two observed dots may get the same index. Its confidence is
//! not calibrated.

mod tree;

pub use crate::ball::{PaperConfig, VoteSum};
pub use tree::{FeatureTree, Neighbor};

use std::num::NonZeroUsize;

use nalgebra::Matrix3;

use super::kent::KentShape;
use super::{Explanations, Hint, ObservedDot, Recognizer, RecognizerRejection};
use crate::ball::{Ball, Basis, BasisFrame, Feature};
use crate::error::Result;
use crate::geometry::{
    Rotation, Vec3, angle_between, pair_rotation, rotation_from_correlation, tangent_frame,
    to_rotation,
};

/// Minimum `|d x d'|` at which the first two observed dots span a basis.
const MIN_CROSS: f64 = 1e-6;

/// Minimum `p` of a vote where logarithms are added up.
const MIN_DENSITY: f64 = 1e-10;

/// A basis pair and one more dot.
const MIN_DOTS: usize = 3;

/// The paper's recognizer, with the hash features of its ball.
#[derive(Debug)]
pub struct PaperRecognizer {
    dots: Vec<Vec3>,
    tree: FeatureTree,
    config: PaperConfig,
    k: NonZeroUsize,
    kent: KentShape,
}

/// Votes and candidates of one identification.
#[derive(Debug, Default)]
pub struct PaperWorkspace {
    /// Score of each basis, at `first * n + second`; NaN where it has no vote.
    scores: Vec<f64>,
    /// Bases with votes.
    voted: Vec<Basis>,
    /// The rotated pattern.
    rotated: Vec<Vec3>,
    /// Assignment under test, and the best so far.
    assignment: Vec<u16>,
    best: Vec<u16>,
    explanations: Explanations,
}

/// A verified basis.
struct RotationCandidate {
    rotation: Rotation,
    error_rad: f64,
    score: f64,
}

impl PaperRecognizer {
    /// A recognizer for `ball`, with the parameters that the ball records ([`Ball::recognizer`]).
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) where the ball's pair rule leaves out every pair
    /// of its dots, or a parameter is outside its domain.
    pub fn for_ball(ball: &Ball) -> Result<Self> {
        let dots = ball.pattern().dots().to_vec();
        Self::new(dots, FeatureTree::new(ball)?, *ball.recognizer())
    }

    /// The same recognizer with other parameters.
    ///
    /// # Errors
    /// [`Error::Argument`](crate::Error::Argument) naming the parameter outside its domain.
    pub fn with_config(self, config: PaperConfig) -> Result<Self> {
        Self::new(self.dots, self.tree, config)
    }

    fn new(dots: Vec<Vec3>, tree: FeatureTree, config: PaperConfig) -> Result<Self> {
        config.check()?;
        Ok(Self {
            dots,
            tree,
            // Checked to be one.
            k: NonZeroUsize::new(config.k).unwrap_or(NonZeroUsize::MIN),
            kent: KentShape::new(config.kappa, config.beta)?,
            config,
        })
    }

    /// The parameters.
    pub fn config(&self) -> &PaperConfig {
        &self.config
    }

    /// `ln p` of the point `x` about the unit vector `mean`, in a basis of determinant
    /// `determinant`.
    fn ln_score(&self, x: &Vec3, mean: &Vec3, determinant: f64) -> f64 {
        let length = x.norm();
        // The Kent density needs the whole frame only where it is oval.
        let [along_major, along_minor] = if self.config.beta > 0.0 {
            tangent_frame(mean).map(|axis| axis.dot(x) / length)
        } else {
            [0.0; 2]
        };
        let direction = self
            .kent
            .ln_density(mean.dot(x) / length, along_major, along_minor);
        let alpha = self.config.alpha;
        let radial =
            -0.5 * ((length - 1.0) / alpha).powi(2) - (alpha * std::f64::consts::TAU.sqrt()).ln();
        direction + radial + determinant.ln()
    }

    /// Adds up the votes of all dots but the first two.
    fn vote(&self, frame: &BasisFrame, dots: &[ObservedDot], ws: &mut PaperWorkspace) {
        let n = self.dots.len();
        ws.scores.clear();
        ws.scores.resize(n * n, f64::NAN);
        ws.voted.clear();
        for dot in &dots[2..] {
            let h = frame.feature(&dot.direction);
            for neighbor in self.tree.nearest(&h, self.k) {
                let Feature { basis, value, .. } = self.tree.features()[neighbor.index];
                let x = frame.point(&value);
                let ln_p = self.ln_score(&x, &dot.direction, frame.determinant());
                let score = &mut ws.scores[index(basis, n)];
                if score.is_nan() {
                    *score = 0.0;
                    ws.voted.push(basis);
                }
                *score += match self.config.vote_sum {
                    VoteSum::LogDensity => ln_p.max(MIN_DENSITY.ln()),
                    VoteSum::Density => ln_p.exp(),
                };
            }
        }
        // Best first; ties in the order of the bases, so that the result does not depend on the
        // tree.
        let score = |b: &Basis| ws.scores[index(*b, n)];
        ws.voted
            .sort_unstable_by(|a, b| score(b).total_cmp(&score(a)).then(a.cmp(b)));
    }

    /// Rotation, assignment (left in the workspace) and reprojection error under the hypothesis
    /// that the first two observed dots are `basis`; `None` where the points determine no rotation.
    fn verify(
        &self,
        basis: Basis,
        dots: &[ObservedDot],
        ws: &mut PaperWorkspace,
    ) -> Option<RotationCandidate> {
        let pattern = &self.dots;
        let (i, j) = (usize::from(basis.first), usize::from(basis.second));
        let coarse = rotation_from_pairs(
            [&pattern[i], &pattern[j]],
            [&dots[0].direction, &dots[1].direction],
        )?;
        ws.rotated.clear();
        ws.rotated.extend(pattern.iter().map(|d| coarse * d));
        ws.assignment.clear();
        let mut correlation = Matrix3::zeros();
        for dot in dots {
            let nearest = nearest(&ws.rotated, &dot.direction);
            ws.assignment.push(nearest as u16);
            correlation += dot.direction * pattern[nearest].transpose();
        }
        let rotation = rotation_from_correlation(&correlation).ok()?;
        let sum: f64 = dots
            .iter()
            .zip(&ws.assignment)
            .map(|(dot, &t)| {
                angle_between(&dot.direction, &(rotation * pattern[usize::from(t)])).powi(2)
            })
            .sum();
        Some(RotationCandidate {
            rotation,
            error_rad: (sum / dots.len() as f64).sqrt(),
            score: ws.scores[index(basis, pattern.len())],
        })
    }

    /// Verifies the better part of the bases; the best candidate, and its share of their scores.
    fn best_of_verified(
        &self,
        dots: &[ObservedDot],
        ws: &mut PaperWorkspace,
    ) -> Option<(RotationCandidate, f64)> {
        let count = (ws.voted.len() as f64 * self.config.verify_fraction).ceil() as usize;
        let mut best: Option<RotationCandidate> = None;
        // The first in rank has the largest score; relative to it no sum of logarithms overflows.
        let top = ws
            .voted
            .first()
            .map(|b| ws.scores[index(*b, self.dots.len())])?;
        let weight = |score: f64| match self.config.vote_sum {
            VoteSum::LogDensity => (score - top).exp(),
            // Scores far from every feature underflow to nothing: then no basis is preferred.
            VoteSum::Density if top <= 0.0 => 1.0,
            VoteSum::Density => score,
        };
        let mut total = 0.0;
        for rank in 0..count {
            let Some(candidate) = self.verify(ws.voted[rank], dots, ws) else {
                continue;
            };
            total += weight(candidate.score);
            if best
                .as_ref()
                .is_none_or(|b| candidate.error_rad < b.error_rad)
            {
                best = Some(candidate);
                std::mem::swap(&mut ws.best, &mut ws.assignment);
            }
        }
        let best = best?;
        // Far behind the first in rank every weight may underflow; then there is nothing to share.
        let share = weight(best.score) / total.max(f64::MIN_POSITIVE);
        Some((best, share.min(1.0)))
    }
}

/// Position of a basis among all ordered pairs of `n` dots.
fn index(basis: Basis, n: usize) -> usize {
    usize::from(basis.first) * n + usize::from(basis.second)
}

impl Recognizer for PaperRecognizer {
    type Workspace = PaperWorkspace;

    fn workspace(&self) -> PaperWorkspace {
        PaperWorkspace::default()
    }

    /// Alg. 2, which knows no hints and no rivals. Every dot is assigned. The confidence is the winner's share of the votes among the
    /// verified bases (of `exp(score)` where logarithms are added up): in [0, 1] and larger where
    /// votes agree, but **not calibrated**. The paper has none.
    ///
    /// The workspace avoids all allocations except those of the search tree, one short list per
    /// dot.
    fn explain<'w>(
        &self,
        dots: &[ObservedDot],
        _hint: Option<&Hint>,
        ws: &'w mut PaperWorkspace,
    ) -> std::result::Result<&'w Explanations, RecognizerRejection> {
        if dots.len() < MIN_DOTS {
            return Err(RecognizerRejection::TooFewDots {
                found: dots.len(),
                needed: MIN_DOTS,
            });
        }
        let are_directions = dots
            .iter()
            .all(|d| (d.direction.norm() - 1.0).abs() <= crate::pattern::LENGTH_TOLERANCE);
        let frame = BasisFrame::new(&dots[0].direction, &dots[1].direction, MIN_CROSS);
        let (true, Some(frame)) = (are_directions, frame) else {
            return Err(RecognizerRejection::Degenerate);
        };
        self.vote(&frame, dots, ws);
        let (best, confidence) = self
            .best_of_verified(dots, ws)
            .ok_or(RecognizerRejection::NoHypothesis)?;
        let out = ws.explanations.begin();
        out.rotation = best.rotation;
        out.assignment.clear();
        out.assignment.extend(ws.best.iter().map(|&t| Some(t)));
        out.residual_rad = best.error_rad;
        out.dots_confidence = confidence;
        out.confidence = confidence;
        Ok(&ws.explanations)
    }

    fn min_dots(&self) -> usize {
        MIN_DOTS
    }
}

/// Index of the direction nearest to `dot`.
fn nearest(directions: &[Vec3], dot: &Vec3) -> usize {
    let mut best = (0, f64::NEG_INFINITY);
    for (i, direction) in directions.iter().enumerate() {
        let cosine = direction.dot(dot);
        if cosine > best.1 {
            best = (i, cosine);
        }
    }
    best.0
}

/// Kabsch for two pairs of unit vectors, in closed form: the best rotation maps the bisector to the
/// bisector and the normal to the normal. `None` where a pair is collinear.
fn rotation_from_pairs(from: [&Vec3; 2], to: [&Vec3; 2]) -> Option<Rotation> {
    pair_rotation(from, to).as_ref().map(to_rotation)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{kabsch, random_direction, random_rotation, rotation_angle};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn two_pairs_in_closed_form_are_kabsch() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for _ in 0..500 {
            let [a, b, c, d] = [(); 4].map(|()| random_direction(&mut rng));
            let closed = rotation_from_pairs([&a, &b], [&c, &d]).expect("generic pairs");
            let svd = kabsch(&[a, b], &[c, d], None).expect("generic pairs");
            assert!(rotation_angle(&closed, &svd) < 1e-7);
        }
        let r = random_rotation(&mut rng);
        let (a, b) = (Vec3::x(), Vec3::new(0.6, 0.8, 0.0));
        let found = rotation_from_pairs([&a, &b], [&(r * a), &(r * b)]).expect("generic pairs");
        assert!(rotation_angle(&found, &r) < 1e-12);
        assert!(rotation_from_pairs([&a, &a], [&a, &b]).is_none());
    }
}
