//! The failure rate as a smooth cost with its gradient, from a recognizer's Monte Carlo trials.
//!
//! A recognizer that knows the distribution of its views answers with the likeliest explanation. It
//! is wrong with the probability of all other explanations. The mean over views of
//!
//! ```text
//! 1 - max_k e_k / sum_k e_k,        e_k the evidence of explanation k,
//! ```
//!
//! is its failure rate (the Bayes risk), with less scatter than counting failures, and smooth in
//! the dots. It is a little low, since only the best few explanations of a view are summed. The
//! views are [`CommonRandomTrials`], so that neighboring patterns see the same ones.
//!
//! The derivative is taken by central differences of each dot's two tangent coordinates. It uses
//! only the views that leave a doubt, and there only the explanations that the full search has
//! found: all others do not change over so small a move.

use std::sync::atomic::{AtomicBool, Ordering};

use super::objective::Evaluation;
use crate::concurrency;
use crate::error::Result;
use crate::geometry::{Rotation, Vec3, tangent_frame};
use crate::pattern::Pattern;
use crate::recognize::robust::{RobustRecognizer, RobustWorkspace};
use crate::recognize::{Identification, Recognizer};
use crate::validate::{CommonRandomTrials, Protocol, Trial};

/// Views whose answer is more probable than this count as certain in the derivative.
const CERTAIN: f64 = 0.01;
/// Explanations with a smaller share than this are left out.
const MIN_SHARE: f64 = 1e-3;
/// Maximum number of explanations of a view that enter the derivative.
const MAX_EXPLANATIONS: usize = 5;
/// Half the difference that the derivative is taken over, radians: a tenth of the noise.
const DIFFERENCE_RAD: f64 = 0.004;
/// A pattern that never fails has no logarithm; half a failure replaces it.
const MIN_FAILURES: f64 = 0.5;
/// Views handled by one task.
const CHUNK: usize = 64;

/// A smooth failure rate over the trials of one seed.
#[derive(Debug, Clone, Copy)]
pub struct SmoothRate<'a> {
    /// The views.
    pub protocol: Protocol,
    /// Their seed.
    pub seed: u64,
    /// Their number.
    pub trials: u64,
    /// Where set, no more views are evaluated and the values are invalid: the caller is about to
    /// end.
    pub stop: &'a AtomicBool,
}

/// A view that leaves a doubt: its number, and the poses in question.
struct Doubt {
    index: u64,
    poses: Vec<Rotation>,
}

/// One thread's memory.
struct Scratch {
    views: CommonRandomTrials,
    trial: Trial,
    workspace: RobustWorkspace,
    answer: Identification,
}

impl SmoothRate<'_> {
    /// The rate's logarithm.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for invalid dots.
    pub fn value(&self, dots: &[Vec3]) -> Result<f64> {
        Ok(self.logarithm(self.survey(dots)?.0))
    }

    /// The rate's logarithm with its derivative in the tangent planes.
    ///
    /// # Errors
    /// As [`SmoothRate::value`].
    pub fn evaluate(&self, dots: &[Vec3]) -> Result<Evaluation> {
        let (total, doubts) = self.survey(dots)?;
        let floored = total.max(MIN_FAILURES);
        let coordinates: Vec<(usize, Vec3)> = dots
            .iter()
            .enumerate()
            .flat_map(|(i, d)| tangent_frame(d).map(|axis| (i, axis)))
            .collect();
        let slopes = concurrency::map(&coordinates, |(i, axis)| {
            if self.stop.load(Ordering::Relaxed) {
                return Ok(0.0);
            }
            let ahead = self.doubted(dots, *i, axis * DIFFERENCE_RAD, &doubts)?;
            let behind = self.doubted(dots, *i, axis * -DIFFERENCE_RAD, &doubts)?;
            Ok((ahead - behind) / (2.0 * DIFFERENCE_RAD * floored))
        });
        let slopes: Result<Vec<f64>> = slopes.into_iter().collect();
        let mut gradient = vec![Vec3::zeros(); dots.len()];
        for ((i, axis), slope) in coordinates.iter().zip(slopes?) {
            gradient[*i] += axis * slope;
        }
        Ok(Evaluation {
            value: self.logarithm(total),
            gradient,
        })
    }

    fn logarithm(&self, failures: f64) -> f64 {
        (failures.max(MIN_FAILURES) / self.trials as f64).ln()
    }

    fn scratch(&self, recognizer: &RobustRecognizer) -> Scratch {
        Scratch {
            views: CommonRandomTrials::new(self.protocol, self.seed),
            trial: Trial::default(),
            workspace: recognizer.workspace(),
            answer: Identification::default(),
        }
    }

    /// The expected number of failures over all views, and the views that leave a doubt.
    fn survey(&self, dots: &[Vec3]) -> Result<(f64, Vec<Doubt>)> {
        let pattern = Pattern::new(dots.to_vec())?;
        let recognizer = RobustRecognizer::new(&pattern, self.protocol.recognizer_config())?;
        let size = CHUNK as u64;
        let found = concurrency::map_range(0..self.trials.div_ceil(size), |chunk| {
            let mut scratch = self.scratch(&recognizer);
            let from = chunk * size;
            let to = if self.stop.load(Ordering::Relaxed) {
                from
            } else {
                (from + size).min(self.trials)
            };
            let identify = |index| self.identify_trial(&pattern, &recognizer, index, &mut scratch);
            (from..to).map(identify).collect::<Vec<_>>()
        });
        let found: Vec<(f64, Option<Doubt>)> = found.into_iter().flatten().collect();
        let total = found.iter().map(|(failure, _)| failure).sum();
        Ok((total, found.into_iter().filter_map(|(_, d)| d).collect()))
    }

    /// Searches one view in full.
    fn identify_trial(
        &self,
        pattern: &Pattern,
        recognizer: &RobustRecognizer,
        index: u64,
        scratch: &mut Scratch,
    ) -> (f64, Option<Doubt>) {
        scratch.views.generate(pattern, index, &mut scratch.trial);
        let (dots, answer) = (&scratch.trial.dots, &mut scratch.answer);
        if scratch.trial.real_dots() < self.protocol.min_dots.max(recognizer.min_dots()) {
            return (0.0, None);
        }
        if recognizer
            .identify_into(dots, &mut scratch.workspace, answer)
            .is_err()
        {
            return (1.0, None);
        }
        // Shares among the explanations found: the null hypothesis is no failure here.
        let best = answer.confidence;
        let mut all = answer.pose_confidence;
        let mut poses = vec![answer.rotation];
        for rank in 1..MAX_EXPLANATIONS {
            let found = recognizer.explanation(rank, &scratch.workspace, answer);
            if !found || answer.pose_confidence < MIN_SHARE * best {
                break;
            }
            all += answer.pose_confidence;
            poses.push(answer.rotation);
        }
        let failure = 1.0 - best / all;
        (
            failure,
            (failure > CERTAIN).then_some(Doubt { index, poses }),
        )
    }

    /// The expected number of failures over the views in doubt, one dot moved.
    fn doubted(&self, dots: &[Vec3], moved: usize, by: Vec3, doubts: &[Doubt]) -> Result<f64> {
        let mut dots = dots.to_vec();
        dots[moved] = (dots[moved] + by).normalize();
        let pattern = Pattern::new(dots)?;
        let recognizer = RobustRecognizer::new(&pattern, self.protocol.recognizer_config())?;
        let mut scratch = self.scratch(&recognizer);
        Ok(doubts
            .iter()
            .map(|doubt| self.weigh(&pattern, &recognizer, doubt, &mut scratch))
            .sum())
    }

    /// The probability of a failure in one view, among known poses.
    fn weigh(
        &self,
        pattern: &Pattern,
        recognizer: &RobustRecognizer,
        doubt: &Doubt,
        scratch: &mut Scratch,
    ) -> f64 {
        scratch
            .views
            .generate(pattern, doubt.index, &mut scratch.trial);
        let mut worth = [(f64::NEG_INFINITY, 1.0); MAX_EXPLANATIONS];
        for (w, pose) in worth.iter_mut().zip(&doubt.poses) {
            let (answer, workspace) = (&mut scratch.answer, &mut scratch.workspace);
            if let Some(ln_evidence) =
                recognizer.evidence_near(&scratch.trial.dots, pose, workspace, answer)
            {
                *w = (ln_evidence, answer.pose_confidence / answer.confidence);
            }
        }
        let top = worth.iter().map(|w| w.0).fold(f64::NEG_INFINITY, f64::max);
        if top == f64::NEG_INFINITY {
            return 1.0;
        }
        let all: f64 = worth.iter().map(|w| (w.0 - top).exp() * w.1).sum();
        1.0 - 1.0 / all
    }
}
