//! The marks of balls that are drawn and turned by hand, and which of them are dots.

use rayon::prelude::*;
use spindoe::calibrate::{CalibrationConfig, KnownDots, MarkEvidence, SurfaceObserver, survey};
use spindoe::geometry::Vec3;
use spindoe::surface::PaintedFrame;
use spindoe::synth::SynthConfig;
use spindoe::vision::{Budget, FrameEstimate, Prior};
use spindoe::{DotUncertainty, ObservedDot, Pattern, Recognizer, RobustRecognizer, ViewModel};
use spindoe_studies::Outcome;
use spindoe_studies::frames::estimator;
use spindoe_studies::hand::{Habits, HandClip, Shown, Strokes};

/// A mark, and whether it is a dot.
pub struct JudgedMark {
    pub evidence: MarkEvidence,
    pub is_dot: bool,
}

/// A dot of the ball.
pub struct DrawnDot {
    pub number: usize,
    /// In the frame of the pattern that it is compared with.
    pub direction: Vec3,
}

/// What the frames of a clip show, without a table.
pub struct SeenClip {
    pub estimates: Vec<FrameEstimate>,
    pub taken: Vec<PaintedFrame>,
    pub shown: Shown,
}

impl SeenClip {
    /// As the command looks at a clip: for dots alone, and then with those that are likely.
    pub fn of(clip: &HandClip, config: &CalibrationConfig) -> Outcome<Self> {
        let seen = Self::looked(
            clip,
            &SurfaceObserver::stand_in()?,
            SurfaceObserver::budget(),
        )?;
        let known = KnownDots::Nothing;
        match survey(&seen.estimates, &seen.taken, &known, config)?.likely {
            Some(likely) => Self::looked(clip, &likely, Budget::default()),
            None => Ok(seen),
        }
    }

    fn looked(clip: &HandClip, pattern: &Pattern, budget: Budget) -> Outcome<Self> {
        let estimator = estimator(pattern)?;
        let mut workspace = estimator.workspace();
        let mut estimates = Vec::with_capacity(clip.frames());
        let mut taken = Vec::with_capacity(clip.frames());
        let shown = clip.show(|seen| {
            let mut found = FrameEstimate::default();
            estimator.estimate(
                &seen.image,
                &Prior::default(),
                &budget,
                &mut workspace,
                &mut found,
            );
            let shown = found.outline.map(|o| PaintedFrame::take(&seen.image, &o));
            taken.push(shown.unwrap_or_default());
            estimates.push(found);
        })?;
        Ok(Self {
            estimates,
            taken,
            shown,
        })
    }
}

/// The marks of so many balls, a quarter of them with print; half are drawn and turned as the guide asks for. What print hides in most frames
/// counts as neither.
pub fn fitting_marks(clips: u64, seed: u64) -> Outcome<Vec<JudgedMark>> {
    let looks = [SynthConfig::good().unprinted(), SynthConfig::good()];
    let all: Result<Vec<Vec<JudgedMark>>, String> = (0..clips)
        .into_par_iter()
        .map(|k| {
            let habits = match k / 4 % 2 {
                0 => Habits::Any,
                _ => Habits::Guided,
            };
            let looks = &looks[usize::from(k % 4 == 3)];
            let clip = HandClip::random(looks, habits, Strokes::Eased, seed, k)
                .map_err(|e| e.to_string())?;
            judged_marks(&clip).map_err(|e| e.to_string())
        })
        .collect();
    Ok(all?.into_iter().flatten().collect())
}

/// The marks of a clip; none where its frames do not hang together.
fn judged_marks(clip: &HandClip) -> Outcome<Vec<JudgedMark>> {
    let config = CalibrationConfig::default();
    let seen = SeenClip::of(clip, &config)?;
    let found = survey(&seen.estimates, &seen.taken, &KnownDots::Nothing, &config)?;
    let marks = found.surface.map(|s| s.marks).unwrap_or_default();
    let Ok(pattern) = Pattern::new(marks.iter().map(|m| m.direction).collect()) else {
        return Ok(Vec::new());
    };
    let named = named(&pattern, &clip.truth)?;
    let judged = marks.iter().zip(&named).filter_map(|(mark, dot)| {
        let is_hidden = dot.as_ref().is_some_and(|d| seen.shown.hidden[d.number]);
        let evidence = mark.evidence.filter(|_| !is_hidden)?;
        Some(JudgedMark {
            evidence,
            is_dot: dot.is_some(),
        })
    });
    Ok(judged.collect())
}

/// Which of the true dots those of a built pattern are, `None` for those that are none; empty where nothing fits.
pub fn named(built: &Pattern, truth: &Pattern) -> Outcome<Vec<Option<DrawnDot>>> {
    let view = ViewModel {
        visibility_limit: -0.99,
        ..ViewModel::default()
    };
    let recognizer = RobustRecognizer::new(truth, view.into())?;
    let observed: Vec<ObservedDot> = built
        .dots()
        .iter()
        .map(|d| ObservedDot {
            direction: *d,
            uncertainty: DotUncertainty::Isotropic { sigma_rad: 0.01 },
        })
        .collect();
    let Ok(found) = recognizer.identify(&observed, &mut recognizer.workspace()) else {
        return Ok(Vec::new());
    };
    let expected = |name: &Option<u16>| {
        let number = usize::from((*name)?);
        let direction = found.rotation * truth.dots()[number];
        Some(DrawnDot { number, direction })
    };
    Ok(found.assignment.iter().map(expected).collect())
}
