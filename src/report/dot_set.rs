//! What a calibration says of the ball's set of dots: is it good, and where would one more dot help?

#[cfg(feature = "plot")]
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::DotPlace;
#[cfg(feature = "plot")]
use crate::ball::Ball;
use crate::ball::USUAL_BALL_MM;
use crate::calibrate::{Calibration, DotState};
use crate::design::dot_set::{Answers, DotSet, DotSetConfig, answers};
use crate::design::{Constraints, DesignRequest};
use crate::error::Result;
use crate::geometry::Vec3;
use crate::pattern::Pattern;
use crate::recognize::MIN_CONFIDENCE_IMAGES;
use crate::stats::median;
use crate::view::{Detection, FalseDots, Noise, ProtocolName, ViewModel};
use crate::vision::dots::detector::LIKELY_DOT;
use crate::vision::{EstimatorConfig, FrameEstimate};

/// Distinguishes the trials from those of the protocols.
const DOT_SET: u64 = 0xd075_e700 << 32;

/// How good the ball's dots are; their numbers are those of the calibrated pattern.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DotSetReport {
    /// Views as the clip has them; none where no frame says.
    pub clip: Option<ViewModel>,
    /// What comes of them.
    pub clip_answers: Option<Answers>,
    /// The views of protocol `clutter`, harder than most clips: what follows is of these.
    pub hard: DotSet,
    /// Where one more dot helps, beyond chance.
    pub add: Option<DotPlace>,
}

impl DotSetReport {
    /// Judges the dots of a calibrated ball, of this angular radius if it is known: further dots keep the distance that
    /// `design --add` keeps.
    ///
    /// # Errors
    /// As [`DotSet::of`].
    pub fn of(
        calibration: &Calibration,
        pattern: &Pattern,
        dot_radius_rad: Option<f64>,
        (samples, seed): (u64, u64),
    ) -> Result<Self> {
        let seed = seed ^ DOT_SET;
        let further = DesignRequest {
            add: 1,
            dot_diameter_mm: dot_radius_rad.map(|radius| USUAL_BALL_MM * radius.sin()),
            ..DesignRequest::default()
        };
        let clip = clip_view(calibration);
        let clip_answers = clip
            .map(|view| answers(pattern, &view, seed, samples))
            .transpose()?;
        // A logo may hide what is missing.
        let missing = calibration
            .dots
            .iter()
            .filter(|d| d.state == DotState::Missing);
        let missing = missing.map(|d| d.nominal);
        let marks = calibration.marks.iter().map(|m| m.direction);
        let hard = DotSetConfig {
            view: ProtocolName::Clutter.view(),
            samples,
            seed,
            constraints: Constraints {
                min_separation_rad: further.usual_separation_deg().to_radians(),
                ..Constraints::default()
            },
            avoided: missing.chain(marks).collect(),
        };
        let hard = DotSet::of(pattern, &hard)?;
        let helps = hard.next_dot.as_ref().filter(|next| next.helps());
        let add = helps.map(|next| {
            let direction = Vec3::from(next.direction);
            DotPlace::new(pattern.len(), &direction, pattern.dots(), USUAL_BALL_MM)
        });
        Ok(Self {
            clip,
            clip_answers,
            hard,
            add,
        })
    }

    /// The answer in words, a line each.
    pub fn words(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if let (Some(view), Some(found)) = (&self.clip, &self.clip_answers) {
            lines.push(identified("as in this clip", view, found));
        }
        let hard = &self.hard;
        lines.push(identified("in hard views", &hard.view, &hard.answers));
        for set in &hard.lookalikes {
            lines.push(format!(
                "dots {} look like {}: in {} of {} hard views that are not identified",
                numbers(&set.dots),
                numbers(&set.like),
                set.views,
                set.of
            ));
        }
        if let Some(side) = &hard.weak_side {
            lines.push(format!(
                "worst where dots {} face the camera: {} of {} hard views not identified",
                numbers(&side.dots),
                side.failed,
                side.failed.trials
            ));
        }
        lines.push(self.next_words());
        lines
    }

    /// Where one more dot helps.
    fn next_words(&self) -> String {
        let Some(next) = &self.hard.next_dot else {
            return match self.hard.answers.right.rate < 1.0 {
                true => "there is no room for one more dot".to_owned(),
                false => "no more dots are needed".to_owned(),
            };
        };
        let gain = &next.gain;
        let [points, low, high] = [gain.difference, gain.low, gain.high].map(|x| 100.0 * x);
        let measured = format!(
            "{points:+.2} [{low:+.2}, {high:+.2}] points of {} hard views",
            gain.trials
        );
        match &self.add {
            Some(place) => format!(
                "add one here, {measured}: {place} (straight distances on a ball of {USUAL_BALL_MM} mm; the ring in \
                 dots.png)"
            ),
            None => format!(
                "one more dot helps nowhere measurably: {measured} at the best of {} places",
                next.places
            ),
        }
    }
}

/// A share of views in words.
fn identified(name: &str, view: &ViewModel, found: &Answers) -> String {
    let noise_deg = view.noise_scale * view.noise.sigma_rad().to_degrees();
    let detected = match view.detection {
        Detection::Each { probability } => {
            format!("{:.0} % of the dots found", 100.0 * probability)
        }
        Detection::Given { dots } => format!("{dots} dots found"),
    };
    format!(
        "{name} (noise {noise_deg:.1} deg, {detected}, {:.1} false ones): {} of {} views identified, {:.2} % wrong, \
         {:.2} % unanswered",
        view.false_dots.mean(),
        found.right,
        found.right.trials,
        100.0 * found.wrong.rate,
        100.0 * found.unanswered.rate
    )
}

/// Numbers as a list.
fn numbers<T: ToString>(numbers: &[T]) -> String {
    let words: Vec<String> = numbers.iter().map(T::to_string).collect();
    words.join(", ")
}

/// The views of a clip: noise, detections and false dots as its answered frames have them; the limit of visibility is
/// the estimator's.
fn clip_view(calibration: &Calibration) -> Option<ViewModel> {
    let usual = EstimatorConfig::default().recognizer.view;
    let answered = |frame: &&FrameEstimate| {
        let pose = frame.pose();
        pose.is_some_and(|pose| pose.confidence >= MIN_CONFIDENCE_IMAGES)
    };
    let frames: Vec<&FrameEstimate> = calibration.frames.iter().filter(answered).collect();
    let mut radii: Vec<f64> = frames
        .iter()
        .filter_map(|f| Some(f.circle?.radius))
        .collect();
    let residuals = frames.iter().filter_map(|f| Some(f.pose()?.residual_px));
    let mut residuals: Vec<f64> = residuals.filter(|r| *r > 0.0).collect();
    if radii.is_empty() || residuals.is_empty() {
        return None;
    }
    let unnamed = |frame: &&FrameEstimate| {
        let detections = frame.dots.iter().zip(&frame.assignment);
        let unnamed = detections.filter(|(_, name)| name.is_none());
        unnamed
            .filter(|(dot, _)| dot.probability >= LIKELY_DOT)
            .count()
    };
    let false_dots: usize = frames.iter().map(unnamed).sum();
    Some(ViewModel {
        noise: Noise::Pixel {
            sigma_px: median(&mut residuals) / std::f64::consts::SQRT_2,
            radius_px: median(&mut radii),
        },
        detection: Detection::Each {
            probability: calibration.detection_rate.clamp(0.05, 1.0),
        },
        false_dots: match false_dots {
            0 => FalseDots::Usual(0),
            count => FalseDots::Poisson(count as f64 / frames.len() as f64),
        },
        foreign_share: 0.0,
        mirrored_share: 0.0,
        ..usual
    })
}

/// Draws the ball from both sides, with a ring where one more dot helps.
#[cfg(feature = "plot")]
pub(super) fn draw(path: &Path, ball: &Ball, add: Option<&DotPlace>) -> Result<()> {
    use crate::plot::{BallDrawing, pattern_views};
    let added = add.map(|place| Vec3::from(place.direction));
    let dots = ball.pattern().dots().iter().copied();
    let [ball_diameter_mm, dot_diameter_mm] = ball.sizes_mm(None, None);
    let view = BallDrawing {
        title: match add {
            Some(_) => "The dots of pattern.csv, and where one more helps most".to_owned(),
            None => "The dots of pattern.csv".to_owned(),
        },
        ball_diameter_mm,
        dot_diameter_mm,
        to_draw: usize::from(added.is_some()),
    };
    pattern_views(path, &Pattern::new(dots.chain(added).collect())?, &view)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Rotation;
    use crate::vision::frame::estimate::Pose;
    use crate::vision::optics::camera::{BallCircle, Pixel};

    /// A residual is that along both axes, a view's noise that along one: residuals of 5 px are noise of 5 px over the root of two.
    #[test]
    fn a_clips_noise_is_that_of_one_axis() {
        let pose = Pose {
            rotation: Rotation::identity(),
            covariance: nalgebra::Matrix3::identity(),
            dots_confidence: 1.0,
            confidence: 1.0,
            residual_rad: 0.1,
            residual_px: 5.0,
            distance: None,
            view: None,
            position: None,
            hinted: false,
        };
        let frame = FrameEstimate {
            circle: Some(BallCircle::new(Pixel { u: 60.0, v: 60.0 }, 50.0)),
            outcome: Ok(pose),
            ..FrameEstimate::default()
        };
        let calibration = Calibration {
            dots: Vec::new(),
            marks: Vec::new(),
            frames: vec![frame; 3],
            with_ball: 3,
            fitted: 3,
            with_rivals: 0,
            noise_scale: 1.0,
            smooth: false,
            inverse_distance: None,
            axis_rad: None,
            detection_rate: 0.9,
        };
        let view = clip_view(&calibration).expect("frames with poses");
        let Noise::Pixel {
            sigma_px,
            radius_px,
        } = view.noise
        else {
            panic!("{:?}", view.noise);
        };
        assert!((sigma_px - 3.535_533_9).abs() < 1e-6, "{sigma_px}");
        assert_eq!(radius_px, 50.0);
    }
}
