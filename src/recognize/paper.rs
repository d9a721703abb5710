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

use std::num::NonZeroUsize;

use nalgebra::Matrix3;

use super::kent::KentShape;
use super::{Explanations, Hint, ObservedDot, Recognizer, RecognizerRejection};
use crate::error::{Error, Result};
use crate::geometry::{
    Rotation, Vec3, angle_between, pair_rotation, rotation_from_correlation, tangent_frame,
};
use crate::hash::{Basis, BasisFrame, HashTable};

/// Minimum `|d x d'|` at which the first two observed dots span a basis.
const MIN_CROSS: f64 = 1e-6;

/// Minimum `p` of a vote where logarithms are added up.
const MIN_DENSITY: f64 = 1e-10;

/// A basis pair and one more dot.
const MIN_DOTS: usize = 3;

/// The sum that forms a basis' score.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum VoteSum {
    /// The sum of `max(ln p, ln 1e-10)`, as in the authors' published code.
    ///
    /// Poor votes are negative, but a dot that casts no vote counts as zero. The correct basis,
    /// supported by many dots of which some are far off, can score below a wrong one with a single
    /// vote. It then drops out of the better half and is never verified.
    LogDensity,
    /// The sum of `p`: a vote never lowers a score, and the correct basis rarely drops out.
    Density,
}

/// Parameters of the paper's recognizer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperConfig {
    /// Number of nearest features that vote for each further dot.
    pub k: usize,
    /// Concentration of the Kent density.
    pub kappa: f64,
    /// Ovalness of the Kent density, `0 <= 2 beta < kappa`.
    pub beta: f64,
    /// Standard deviation of `|x|` about 1, without unit.
    pub alpha: f64,
    /// Fraction of the bases with votes that is verified, best scores first, in (0, 1].
    pub verify_fraction: f64,
    /// The sum that forms a basis' score.
    pub vote_sum: VoteSum,
}

impl Default for PaperConfig {
    /// The values of the paper and of its published code.
    fn default() -> Self {
        Self {
            k: 20,
            kappa: 500.0,
            beta: 0.0,
            alpha: 0.03,
            verify_fraction: 0.5,
            vote_sum: VoteSum::LogDensity,
        }
    }
}

/// The paper's recognizer over a hash table.
#[derive(Debug)]
pub struct PaperRecognizer<'t> {
    table: &'t HashTable,
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
struct Candidate {
    rotation: Rotation,
    error_rad: f64,
    score: f64,
}

impl<'t> PaperRecognizer<'t> {
    /// A recognizer over `table`.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the parameter outside its domain.
    pub fn new(table: &'t HashTable, config: PaperConfig) -> Result<Self> {
        let Some(k) = NonZeroUsize::new(config.k) else {
            return Err(Error::argument("k", "expected at least 1, found 0"));
        };
        if !(config.alpha.is_finite() && config.alpha > 0.0) {
            let problem = format!("expected a positive number, found {}", config.alpha);
            return Err(Error::argument("alpha", problem));
        }
        if !(config.verify_fraction > 0.0 && config.verify_fraction <= 1.0) {
            let problem = format!(
                "expected a fraction in (0, 1], found {}",
                config.verify_fraction
            );
            return Err(Error::argument("verify_fraction", problem));
        }
        Ok(Self {
            table,
            config,
            k,
            kent: KentShape::new(config.kappa, config.beta)?,
        })
    }

    /// A recognizer with the parameters of the table's metadata, and the paper's values for the
    /// others.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the parameter outside its domain.
    pub fn from_table(table: &'t HashTable) -> Result<Self> {
        let made_for = &table.meta().recognizer;
        let config = PaperConfig {
            kappa: made_for.kappa,
            beta: made_for.beta,
            alpha: made_for.alpha,
            ..PaperConfig::default()
        };
        Self::new(table, config)
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
        let n = self.table.pattern().len();
        ws.scores.clear();
        ws.scores.resize(n * n, f64::NAN);
        ws.voted.clear();
        for dot in &dots[2..] {
            let h = frame.feature(&dot.direction);
            for neighbor in self.table.nearest(&h, self.k) {
                let basis = self.table.bases()[neighbor.index];
                let x = frame.point(&self.table.features()[neighbor.index]);
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
    ) -> Option<Candidate> {
        let pattern = self.table.pattern().dots();
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
        Some(Candidate {
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
    ) -> Option<(Candidate, f64)> {
        let count = (ws.voted.len() as f64 * self.config.verify_fraction).ceil() as usize;
        let mut best: Option<Candidate> = None;
        // The first in rank has the largest score; relative to it no sum of logarithms overflows.
        let top = ws
            .voted
            .first()
            .map(|b| ws.scores[index(*b, self.table.pattern().len())])?;
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

impl Recognizer for PaperRecognizer<'_> {
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
        out.confidence = confidence;
        out.pose_confidence = confidence;
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
    let matrix = nalgebra::Rotation3::from_matrix_unchecked(pair_rotation(from, to)?);
    Some(Rotation::from_rotation_matrix(&matrix))
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
