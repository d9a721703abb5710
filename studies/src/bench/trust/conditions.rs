//! Files of frames with nothing stated of noise, misses and false dots, against the same files with
//! the protocol.

use std::num::NonZero;

use rayon::prelude::*;
use spindoe::Result;
use spindoe::ball::Ball;
use spindoe::pattern::Pattern;
use spindoe::pipeline::Sink;
use spindoe::recognize::observed::ObservedFrame;
use spindoe::recognize::robust::{RobustConfig, RobustRecognizer};
use spindoe::recognize::stream::{FrameAnswer, LearningConfig, LearningOrder, identify_learning};
use spindoe::recognize::{Explanations, Identification, Recognizer};
use spindoe::validate::ORIENTATION_FAILURE_RAD;
use spindoe::view::{FalseDots, ProtocolName, Trial, TrialGenerator, ViewModel};
use spindoe_studies::frames::Patterns;
use spindoe_studies::score::share;
use spindoe_studies::table::Table;
use spindoe_studies::{Outcome, row};

/// Frames of a file.
const FILES: [usize; 3] = [1, 10, 200];

/// What became of a frame.
#[derive(Debug, Clone, Copy)]
struct Judged {
    identity: bool,
    orientation: bool,
}

fn judge(found: Option<&Identification>, trial: &Trial) -> Judged {
    let is_right =
        |f: &Identification| f.rotation.angle_to(&trial.rotation) < ORIENTATION_FAILURE_RAD;
    Judged {
        identity: found.is_some_and(|f| f.assignment == trial.truth),
        orientation: found.is_some_and(is_right),
    }
}

/// Trials of a view model, `frames` a file.
pub fn files(
    pattern: &Pattern,
    view: ViewModel,
    trials: u64,
    frames: usize,
    seed: u64,
) -> Vec<Vec<Trial>> {
    let mut generator = TrialGenerator::new(pattern.dots(), view, seed);
    let mut all = Vec::new();
    for index in 0..trials {
        let mut trial = Trial::default();
        generator.generate(index, &mut trial);
        if trial.real_dots() >= view.min_dots {
            all.push(trial);
        }
    }
    all.chunks(frames).map(<[Trial]>::to_vec).collect()
}

/// Keeps the answers.
#[derive(Default)]
pub struct Answers(Vec<FrameAnswer>);

impl Sink<FrameAnswer> for Answers {
    type Error = spindoe::Error;

    fn take(&mut self, answer: FrameAnswer) -> Result<()> {
        self.0.push(answer);
        Ok(())
    }
}

/// The answers to a file of frames of which nothing is stated to the recognizer.
pub fn answers(
    ball: &Ball,
    frames: Vec<ObservedFrame>,
    order: LearningOrder,
) -> Result<Vec<FrameAnswer>> {
    let learning = LearningConfig {
        order,
        ..LearningConfig::default()
    };
    let (base, frames) = (RobustConfig::default(), frames.into_iter().map(Ok));
    let mut sink = Answers::default();
    identify_learning(
        ball,
        &base,
        &learning,
        frames,
        NonZero::<usize>::MIN,
        &mut sink,
    )?;
    Ok(sink.0)
}

/// The frames that show these trials.
pub fn observed(file: &[Trial]) -> Vec<ObservedFrame> {
    let frames = file.iter().enumerate().map(|(k, trial)| ObservedFrame {
        name: k.to_string(),
        time_s: None,
        is_numbered: false,
        dots: trial.dots.clone(),
    });
    frames.collect()
}

fn learned(pattern: &Pattern, file: &[Trial], order: LearningOrder) -> Result<Vec<Judged>> {
    let found = answers(&Ball::new(pattern.clone()), observed(file), order)?;
    let found = found.iter().map(FrameAnswer::identification);
    Ok(file.iter().zip(found).map(|(t, a)| judge(a, t)).collect())
}

fn fixed(pattern: &Pattern, file: &[Trial], config: RobustConfig) -> Result<Vec<Judged>> {
    let recognizer = RobustRecognizer::new(pattern, config)?;
    let mut workspace = recognizer.workspace();
    let one = |trial: &Trial| {
        let found = recognizer.explain(&trial.dots, None, &mut workspace);
        judge(found.ok().map(Explanations::best), trial)
    };
    Ok(file.iter().map(one).collect())
}

#[derive(clap::Args)]
pub struct Args {
    /// Trials a row.
    #[arg(long, default_value_t = 10_000)]
    trials: u64,
    /// Seed of the trials.
    #[arg(long, default_value_t = crate::TRUST_SEED)]
    seed: u64,
    #[command(flatten)]
    patterns: Patterns,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (trials, seed) = (self.trials, self.seed);
        println!("{trials} trials a row, seed {seed}");
        let table = Table::new(["pattern, protocol", "stated", "identity", "orientation"]);
        let mut views: Vec<(String, ViewModel)> = ProtocolName::ALL
            .map(|name| (name.to_string(), name.view()))
            .into();
        let harder = ViewModel {
            false_dots: FalseDots::Usual(3),
            ..ProtocolName::Paper.view().with_sigma_rad(8f64.to_radians())
        };
        views.push(("8 deg and 3 false".into(), harder));
        for (name, pattern) in self.patterns.read()? {
            for (view_name, view) in &views {
                let of = format!("{name}, {view_name}");
                let print = |stated: &str,
                             frames: usize,
                             judge: &(dyn Fn(&[Trial]) -> Result<Vec<Judged>> + Sync)|
                 -> Result<()> {
                    let all = files(&pattern, *view, trials, frames, seed);
                    let judged: Result<Vec<_>> = all.par_iter().map(|f| judge(f)).collect();
                    let judged = judged?.concat();
                    let orientation = share(&judged, |j| j.orientation);
                    row!(table; &of, stated, share(&judged, |j| j.identity), orientation);
                    Ok(())
                };
                print("the protocol", 200, &|f| fixed(&pattern, f, (*view).into()))?;
                print("the defaults", 200, &|f| {
                    fixed(&pattern, f, RobustConfig::default())
                })?;
                for frames in FILES {
                    let stated = format!("nothing, learned, frames a file: {frames}");
                    let order = LearningOrder::InAdvance;
                    print(&stated, frames, &|f| learned(&pattern, f, order))?;
                }
                let stated = "nothing, learned as they come, frames a file: 200";
                print(stated, 200, &|f| {
                    learned(&pattern, f, LearningOrder::AsTheyCome)
                })?;
            }
        }
        Ok(())
    }
}
