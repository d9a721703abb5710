//! Files of frames that are told nothing of noise, misses and false dots, against the same files told
//! the protocol.

use std::num::NonZero;
use std::path::Path;

use rayon::prelude::*;
use spindoe::ball::Ball;
use spindoe::pattern::Pattern;
use spindoe::pipeline::Sink;
use spindoe::recognize::observed::ObservedFrame;
use spindoe::recognize::robust::{RobustConfig, RobustRecognizer};
use spindoe::recognize::stream::{FrameAnswer, LearningConfig, LearningOrder, identify_learning};
use spindoe::recognize::{Explanations, Identification, Recognizer};
use spindoe::validate::{ORIENTATION_FAILURE_RAD, Proportion};
use spindoe::view::{FalseDots, ProtocolName, Trial, TrialGenerator, ViewModel};
use spindoe::{Error, Result};

/// Frames of a file.
const FILES: [usize; 3] = [1, 10, 200];

/// What became of a frame.
#[derive(Debug, Clone, Copy)]
struct Judged {
    identity: bool,
    orientation: bool,
    confidence: f64,
}

fn judge(found: Option<&Identification>, trial: &Trial) -> Judged {
    match found {
        Some(found) => Judged {
            identity: found.assignment == trial.truth,
            orientation: found.rotation.angle_to(&trial.rotation) < ORIENTATION_FAILURE_RAD,
            confidence: found.confidence,
        },
        None => Judged {
            identity: false,
            orientation: false,
            confidence: 0.0,
        },
    }
}

/// Trials of a view model, `frames` a file.
fn files(
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

#[derive(Default)]
struct Answers(Vec<FrameAnswer>);

impl Sink<FrameAnswer> for Answers {
    type Error = Error;

    fn take(&mut self, answer: FrameAnswer) -> Result<()> {
        self.0.push(answer);
        Ok(())
    }
}

fn learned(pattern: &Pattern, file: &[Trial], order: LearningOrder) -> Result<Vec<Judged>> {
    let frames = file.iter().enumerate().map(|(k, trial)| {
        Ok(ObservedFrame {
            name: k.to_string(),
            time_s: None,
            dots: trial.dots.clone(),
        })
    });
    let frames: Vec<_> = frames.collect();
    let learning = LearningConfig {
        order,
        ..LearningConfig::default()
    };
    let mut sink = Answers::default();
    let base = RobustConfig::default();
    let threads = NonZero::<usize>::MIN;
    let frames = frames.into_iter();
    let told = identify_learning(
        &Ball::new(pattern.clone()),
        &base,
        &learning,
        frames,
        threads,
        &mut sink,
    )?;
    if std::env::var_os("SHOW").is_some() {
        eprintln!("{told:?}");
    }
    let answers = sink.0.iter().map(FrameAnswer::identification);
    Ok(file.iter().zip(answers).map(|(t, a)| judge(a, t)).collect())
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

fn percent(judged: &[Judged], of: impl Fn(&Judged) -> bool) -> String {
    let n = judged.iter().filter(|j| of(j)).count() as u64;
    let p = Proportion::new(n, judged.len() as u64);
    format!(
        "{:.2} [{:.2}, {:.2}]",
        100.0 * p.rate,
        100.0 * p.low,
        100.0 * p.high
    )
}

/// Bounds of the bins in which confidences are compared with the truth.
const BINS: [(f64, f64); 3] = [(0.5, 0.9), (0.9, 0.99), (0.99, 1.1)];

fn row(name: &str, judged: &[Judged]) {
    // For each bin what was claimed on average, and how often it was so.
    let bins = BINS.map(|(from, to)| {
        let of = |j: &&Judged| (from..to).contains(&j.confidence);
        let within: Vec<Judged> = judged.iter().filter(of).copied().collect();
        let claimed: f64 = within.iter().map(|j| j.confidence).sum();
        let claimed = 100.0 * claimed / within.len().max(1) as f64;
        format!("{claimed:.2}: {}", percent(&within, |j| j.orientation))
    });
    println!(
        "| {name} | {} | {} | {} |",
        percent(judged, |j| j.identity),
        percent(judged, |j| j.orientation),
        bins.join(" | "),
    );
}

pub fn print(trials: u64, seed: u64) -> Result<()> {
    let patterns = [
        ("published", "../shared/data/spindoe2023/ref_pattern.csv"),
        ("dots20", "designs/dots20/pattern.csv"),
    ];
    println!("{trials} trials a row, seed {seed}\n");
    println!(
        "| file | identity % | orientation % | claimed: right %, 0.5 to 0.9 | 0.9 to 0.99 | above |"
    );
    println!("|---|---|---|---|---|---|");
    let mut views: Vec<(String, ViewModel)> = ProtocolName::ALL
        .map(|name| (name.to_string(), name.view()))
        .into();
    let harder = ViewModel {
        false_dots: FalseDots::Usual(3),
        ..ProtocolName::Paper.view().with_sigma_rad(8f64.to_radians())
    };
    views.push(("8 deg, 3 false".into(), harder));
    for (name, path) in patterns {
        if !Path::new(path).exists() {
            eprintln!("{name}: skipped, {path} is not here");
            continue;
        }
        let pattern = Pattern::read_csv(path.as_ref())?;
        for (view_name, view) in &views {
            let all = files(&pattern, *view, trials, 200, seed);
            let each = |of: &(dyn Fn(&[Trial]) -> Result<Vec<Judged>> + Sync),
                        files: &[Vec<Trial>]|
             -> Result<Vec<Judged>> {
                let judged: Result<Vec<_>> = files.par_iter().map(|f| of(f)).collect();
                Ok(judged?.concat())
            };
            let of = format!("{name}, {view_name}");
            let told = each(&|f| fixed(&pattern, f, (*view).into()), &all)?;
            row(&format!("{of}: told the protocol"), &told);
            let default = each(&|f| fixed(&pattern, f, RobustConfig::default()), &all)?;
            row(&format!("{of}: defaults"), &default);
            for frames in FILES {
                let split = files(&pattern, *view, trials, frames, seed);
                let order = LearningOrder::InAdvance;
                let judged = each(&|f| learned(&pattern, f, order), &split)?;
                row(&format!("{of}: learned, {frames} frames"), &judged);
            }
            let judged = each(&|f| learned(&pattern, f, LearningOrder::AsTheyCome), &all)?;
            row(&format!("{of}: learned as they come, 200 frames"), &judged);
        }
    }
    Ok(())
}
