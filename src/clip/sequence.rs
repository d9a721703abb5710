//! Frames of one sequence help each other: a ball turns and moves evenly for a while.
//!
//! A sequence is two passes of [`Estimator::estimate`]. In the first each frame stands for itself. In the second the frames that
//! are *in doubt* are estimated again, with what their neighbors expect as a [`Prior`]: the orientation by the spin of
//! the answered frames nearest in time, forward and backward, and the outline by [the path](crate::vision::outline::path) of theirs. In doubt is a
//! frame without a pose, one off the expected orientation, and one whose outline lies off the path. An answer of the second pass
//! that needed no hint is a neighbor in turn: the pass is repeated for the frames that learn from it.
//!
//! Guarantees: a prior is made of other frames only, and only of poses found without a hint: no frame confirms itself, neither
//! directly nor by way of a frame that it has itself helped. The order in which frames are estimated changes nothing. An
//! expected outline may be wrong: a pose there replaces another one only where its dots are evident.

use std::convert::Infallible;

use nalgebra::Matrix3;

use super::orientations::{NamedFrame, orientations};
use super::rolling::{correct_rows, seen_times};
use crate::concurrency::{self, StopFlag};
use crate::geometry::CameraFrame;
use crate::image::ImageView;
use crate::recognize::Hint;
use crate::spin::robust::{RobustEstimator, SpinConfig};
use crate::spin::{Fit, Measurement, SpinRejection};
use crate::vision::estimator::search::is_evident;
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection};
use crate::vision::frame::outline::OutlineSource;
use crate::vision::frame::prior::{Budget, OutlinePrior, Prior};
use crate::vision::optics::camera::BallCircle;
use crate::vision::outline::path::{MAX_SCATTER, NEIGHBORS, expected_outline, off};
use crate::vision::pose::identify::DISAGREEMENT;

/// An outline farther off the path than this, in radii, is in doubt.
const OFF_PATH: f64 = 0.1;
/// Independent frames nearest in time that predict a frame's orientation.
const AROUND: usize = 10;
/// Minimum probability of frames that predict others.
pub(super) const TRUSTED: f64 = 0.8;
/// Error of a predicted orientation beyond the fit's own, radians, about every axis: the spin changes, and so does the
/// direction under which the ball is seen.
const HINT_SIGMA_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// Probability that a hint is altogether wrong.
const WRONG: f64 = 0.1;
/// Frames that one thread estimates after each other in the same memory.
const CHUNK: usize = 4;

/// How frames of a sequence help each other.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SequenceConfig {
    /// Estimation of the spin.
    pub spin: SpinConfig,
    /// Time from row to row of a rolling shutter, the upper first, seconds; 0 for a global one. The times of the frames are then those of
    /// their first rows, and poses those of the times at which the ball is seen: [`seen_times`](super::rolling::seen_times).
    pub row_s: f64,
    /// What ends the search in the frames before.
    pub stop: Option<StopFlag>,
}

/// What the second pass over a sequence did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SequenceSummary {
    /// Frames with a pose after the first pass.
    pub alone: usize,
    /// Frames with a pose now.
    pub together: usize,
}

/// A frame that its neighbors may settle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameInDoubt {
    /// Its number in the sequence.
    pub frame: usize,
    /// What they expect.
    pub prior: Prior,
    /// Whether the outline of the prior is where they expect the ball, and not the frame's own.
    on_path: bool,
}

/// A frame that predicts others.
struct NeighborFrame {
    frame: usize,
    circle: BallCircle,
    measurement: Measurement,
}

impl NeighborFrame {
    fn of(frame: usize, time_s: f64, estimate: &FrameEstimate) -> Option<Self> {
        let pose = estimate.pose()?;
        (!pose.hinted && pose.confidence >= TRUSTED).then_some(Self {
            frame,
            circle: estimate.circle?,
            measurement: measurement(time_s, pose.rotation, pose.confidence),
        })
    }
}

/// The frames of a sequence that are to be estimated again, and with what prior. `times_s` are in seconds, one a frame, each
/// later than the one before.
pub fn frames_in_doubt(
    config: &SequenceConfig,
    times_s: &[f64],
    frames: &[FrameEstimate],
) -> Vec<FrameInDoubt> {
    let numbered = times_s.iter().zip(frames).enumerate();
    let trusted: Vec<NeighborFrame> = numbered
        .clone()
        .filter_map(|(k, (time_s, frame))| NeighborFrame::of(k, *time_s, frame))
        .collect();
    let mut fitter = RobustEstimator::new(config.spin);
    let doubt = |(k, (time_s, frame)): (usize, (&f64, &FrameEstimate))| {
        let around: Vec<Measurement> = nearest(&trusted, k, *time_s, AROUND)
            .iter()
            .map(|n| n.measurement)
            .collect();
        let fit = match fitter.fit(&around) {
            // Before rows are corrected their error stands along the turn and speaks against a motion that all follow.
            Err(_) if config.row_s > 0.0 => {
                let fit = fitter.provisional(&around).ok();
                fit.filter(|fit| fit.inliers == around.len())
            }
            fit => fit.ok(),
        };
        let hint = fit.map(|fit| predict(config, &fit, &around, *time_s));
        let outlines: Vec<_> = nearest(&trusted, k, *time_s, NEIGHBORS)
            .iter()
            .map(|n| (n.measurement.time_s - time_s, n.circle))
            .collect();
        let expected = expected_outline(&outlines);
        in_doubt(k, frame, hint, expected)
    };
    numbered.filter_map(doubt).collect()
}

/// A frame with what is expected of it, where it is in doubt.
fn in_doubt(
    number: usize,
    frame: &FrameEstimate,
    hint: Option<Hint>,
    expected: Option<BallCircle>,
) -> Option<FrameInDoubt> {
    let is_given = frame.outline.is_some_and(|o| o.is_given());
    let expected = expected.filter(|_| !is_given);
    let is_off_path = expected.is_some_and(|e| frame.circle.is_none_or(|c| off(&c, &e) > OFF_PATH));
    let is_doubtful = match (frame.pose(), &hint) {
        _ if frame.outcome == Err(FrameRejection::Unreadable) => false,
        (None, _) => hint.is_some() || expected.is_some(),
        (Some(pose), Some(hint)) => {
            is_off_path || pose.rotation.angle_to(&hint.rotation) >= DISAGREEMENT
        }
        (Some(_), None) => is_off_path,
    };
    let near = |circle: BallCircle| OutlinePrior::found(circle, MAX_SCATTER * circle.radius);
    let own = frame.outline.map(|outline| match is_given {
        true => OutlinePrior {
            sigma_px: outline.covariance[(0, 0)].sqrt(),
            ..OutlinePrior::given(outline.circle)
        },
        false => near(outline.circle),
    });
    let path = expected.map(near);
    // Without either nothing says where to look.
    let outline = path.or(own).filter(|_| is_doubtful)?;
    Some(FrameInDoubt {
        frame: number,
        prior: Prior {
            outline: Some(outline),
            rotation: hint,
            ..Prior::default()
        },
        on_path: path.is_some(),
    })
}

impl FrameInDoubt {
    /// A frame of which others than its neighbors in time expect this.
    pub(super) fn expected(frame: usize, prior: Prior) -> Self {
        Self {
            frame,
            prior,
            on_path: false,
        }
    }

    /// Whether an estimate with the prior takes the place of the one before.
    fn is_settled_by(&self, before: &FrameEstimate, again: &FrameEstimate) -> bool {
        let is_off = |frame: &FrameEstimate| {
            let path = self.prior.outline.filter(|_| self.on_path);
            path.is_some_and(|p| {
                frame
                    .outline
                    .is_none_or(|o| off(&o.circle, &p.circle) > OFF_PATH)
            })
        };
        if is_off(again) {
            return false;
        }
        match (before.pose(), again.pose()) {
            (None, Some(pose)) => pose.hinted || is_evident(again),
            // Both are of dots alone; the path speaks for one of them.
            (Some(_), _) if is_off(before) => is_evident(again),
            (Some(_), _) => true,
            (None, None) => false,
        }
    }

    /// What it lacks, beside another one.
    fn learns(&self, earlier: &Self) -> bool {
        (self.prior.rotation.is_some() && earlier.prior.rotation.is_none())
            || (self.on_path && !earlier.on_path)
    }
}

impl Estimator {
    /// Estimates a frame in doubt again, by its neighbors; `None` where `before` stands.
    pub fn estimate_again<'a>(
        &self,
        image: impl Into<ImageView<'a>>,
        doubt: &FrameInDoubt,
        before: &FrameEstimate,
        stop: Option<StopFlag>,
        ws: &mut EstimatorWorkspace,
    ) -> Option<FrameEstimate> {
        let mut again = FrameEstimate::default();
        let budget = Budget {
            spent: before.attempts,
            stop,
            ..Budget::default()
        };
        let prior = Prior {
            outline: doubt.prior.outline.map(|outline| OutlinePrior {
                circle: self.shown_circle(&outline.circle),
                ..outline
            }),
            ..doubt.prior
        };
        self.estimate(image, &prior, &budget, ws, &mut again);
        if let Some(outline) = again.outline.as_mut().filter(|o| !o.is_given()) {
            outline.source = OutlineSource::Neighbors;
        }
        doubt.is_settled_by(before, &again).then_some(again)
    }
}

/// What is done with an image of a sequence, by its number; `None` where that changes nothing.
pub type ImageWork<'a> =
    dyn Fn(usize, ImageView<'_>, &mut EstimatorWorkspace) -> Option<FrameEstimate> + Sync + 'a;

/// What comes of the work on images, with their numbers, or why they cannot be had.
pub type ImageResults<E> = Result<Vec<(usize, FrameEstimate)>, E>;

/// Estimates the frames of one sequence in both passes, all with one prior; without times, in the first alone. `times_s` are in
/// seconds, one a frame, each later than the one before. `on_images` does the work on the images with these numbers, which
/// ascend, and returns what comes of it in their order.
///
/// # Errors
/// Those of `on_images`.
pub fn estimate_passes<E>(
    estimator: &Estimator,
    config: &SequenceConfig,
    prior: &Prior,
    count: usize,
    times_s: Option<&[f64]>,
    mut on_images: impl FnMut(&[usize], &ImageWork<'_>) -> ImageResults<E>,
) -> Result<(Vec<FrameEstimate>, SequenceSummary), E> {
    let mut frames = vec![FrameEstimate::default(); count];
    let all: Vec<usize> = (0..count).collect();
    let budget = Budget {
        stop: config.stop,
        ..Budget::default()
    };
    let alone = |_: usize, image: ImageView<'_>, ws: &mut EstimatorWorkspace| {
        let mut out = FrameEstimate::default();
        estimator.estimate(image, prior, &budget, ws, &mut out);
        Some(out)
    };
    for (k, found) in on_images(&all, &alone)? {
        frames[k] = found;
    }
    let times_s = times_s.unwrap_or_default();
    let summary = second_pass(estimator, config, times_s, &mut frames, on_images)?;
    Ok((frames, summary))
}

/// The second pass over frames that were each estimated alone, and what a rolling shutter does to their poses. `times_s` and `on_images` are those of [`estimate_passes`].
///
/// # Errors
/// Those of `on_images`; then the frames are as far as it has come.
pub fn second_pass<E>(
    estimator: &Estimator,
    config: &SequenceConfig,
    times_s: &[f64],
    frames: &mut [FrameEstimate],
    mut on_images: impl FnMut(&[usize], &ImageWork<'_>) -> ImageResults<E>,
) -> Result<SequenceSummary, E> {
    let answered = |frames: &[FrameEstimate]| frames.iter().filter(|f| f.pose().is_some()).count();
    let alone = answered(frames);
    let mut tried: Vec<Option<FrameInDoubt>> = vec![None; frames.len()];
    loop {
        let seen_s = seen_times(config.row_s, times_s, frames);
        let mut doubts = frames_in_doubt(config, &seen_s, frames);
        doubts.retain(|d| tried[d.frame].is_none_or(|t| d.learns(&t)));
        if doubts.is_empty() {
            break;
        }
        for doubt in &doubts {
            tried[doubt.frame] = Some(*doubt);
        }
        let numbers: Vec<usize> = doubts.iter().map(|d| d.frame).collect();
        let before = &*frames;
        let again = |k: usize, image: ImageView<'_>, ws: &mut EstimatorWorkspace| {
            let doubt = &doubts[numbers.binary_search(&k).ok()?];
            estimator.estimate_again(image, doubt, &before[k], config.stop, ws)
        };
        for (k, settled) in on_images(&numbers, &again)? {
            frames[k] = settled;
        }
    }
    let seen_s = seen_times(config.row_s, times_s, frames);
    correct_rows(estimator, config, &seen_s, frames);
    Ok(SequenceSummary {
        alone,
        together: answered(frames),
    })
}

/// The work on images that are all at hand, on all cores: for [`estimate_passes`] and [`second_pass`].
pub fn held_images<'a>(
    estimator: &'a Estimator,
    images: &'a [ImageView<'a>],
) -> impl FnMut(&[usize], &ImageWork<'_>) -> ImageResults<Infallible> {
    |numbers, work| {
        let chunks: Vec<_> = numbers.chunks(CHUNK).collect();
        let found = concurrency::map(&chunks, |chunk| {
            let mut ws = estimator.workspace();
            let one = |&k: &usize| Some((k, work(k, images[k], &mut ws)?));
            chunk.iter().filter_map(one).collect::<Vec<_>>()
        });
        Ok(found.into_iter().flatten().collect())
    }
}

/// Estimates the frames of one sequence whose images are all at hand, in both passes, on all cores. `times_s` are in seconds, one an
/// image, each later than the one before.
pub fn estimate_sequence(
    estimator: &Estimator,
    config: &SequenceConfig,
    times_s: &[f64],
    images: &[ImageView<'_>],
) -> (Vec<FrameEstimate>, SequenceSummary) {
    let (prior, held) = (Prior::default(), held_images(estimator, images));
    let Ok(found) = estimate_passes(estimator, config, &prior, images.len(), Some(times_s), held);
    found
}

/// The neighbors nearest in time to frame `k`, without itself, in order of time.
fn nearest(trusted: &[NeighborFrame], k: usize, time_s: f64, count: usize) -> Vec<&NeighborFrame> {
    let apart = |n: &NeighborFrame| (n.measurement.time_s - time_s).abs();
    let split = trusted.partition_point(|n| n.frame < k);
    let before = &trusted[split.saturating_sub(count)..split];
    let after = trusted[split..].iter().filter(|n| n.frame != k);
    let mut found: Vec<&NeighborFrame> = before.iter().rev().chain(after.take(count)).collect();
    found.sort_by(|a, b| apart(a).total_cmp(&apart(b)));
    found.truncate(count);
    found.sort_unstable_by_key(|n| n.frame);
    found
}

fn measurement(
    time_s: f64,
    orientation: crate::geometry::Rotation,
    confidence: f64,
) -> Measurement {
    Measurement {
        confidence,
        ..Measurement::new(time_s, orientation)
    }
}

/// The orientation at `time_s` by a fit, with its error.
pub(crate) fn predict(
    config: &SequenceConfig,
    fit: &Fit,
    around: &[Measurement],
    time_s: f64,
) -> Hint {
    // The fit is best known in the middle of its frames; from there its error grows with the spin's.
    let middle = around.iter().map(|m| m.time_s).sum::<f64>() / around.len().max(1) as f64;
    let elapsed = time_s - middle;
    let own = fit
        .spin_covariance
        .map_or(Matrix3::zeros(), |c| c * (elapsed * elapsed));
    let noise = fit.sigma_rad.unwrap_or(config.spin.sigma_rad) / (fit.inliers.max(1) as f64).sqrt();
    let sigma2 = HINT_SIGMA_RAD.powi(2) + noise * noise;
    Hint {
        rotation: fit.motion.at(time_s),
        covariance: own + Matrix3::from_diagonal_element(sigma2),
        wrong: WRONG,
    }
}

/// The spin of a sequence, from the orientations of its frames: the same as that of their file ([`orientations`]).
///
/// Without intrinsics it is in the view frame of a ball in the middle of the path ([`SequenceView`](super::sequence_view::SequenceView)), else in the camera's.
/// Each frame has the weight of its pose's covariance; how large the deviations are altogether is
/// estimated from the residuals, with the covariances' typical value for a prior.
///
/// It is not refined on the dots of all frames: those of one frame share the errors of its outline and of the camera's
/// distance, so that taking them as independent makes the covariance too small and the spin no better.
///
/// # Errors
/// A [`SpinRejection`] where too few frames have a pose, or they agree on nothing.
pub fn estimate_spin(
    config: &SequenceConfig,
    times_s: &[f64],
    frames: &[FrameEstimate],
) -> Result<Fit, SpinRejection> {
    let named = NamedFrame::of_times(times_s, frames);
    let file = orientations(&named, CameraFrame::default(), true);
    RobustEstimator::new(file.spin_config(config.spin)).fit(&file.measurements())
}
