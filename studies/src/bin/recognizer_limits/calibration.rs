//! Calibration of the confidence: predicted against observed rates.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use spindoe::geometry::random_direction_above;
use spindoe::plot::{RatePoint, RateSeries, ReliabilityPlot, reliability_plot};
use spindoe::recognize::Recognizer;
use spindoe::validate::{Proportion, TrialResult, Trials};
use spindoe::view::{ProtocolName, Trial, ViewModel};

use crate::{Bench, SEED, doubting};

/// Ends of the bins of predicted confidence.
const EDGES: [f64; 12] = [
    0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.99, 1.0001,
];
/// Bins with fewer answers are not printed.
const MIN: u64 = 30;
const SURE: f64 = 0.99;

/// A prediction and whether it was correct.
type Answer = (f64, bool);

pub fn print(bench: &Bench) -> spindoe::Result<()> {
    println!("## Calibration of the confidence (of the identity)\n");
    println!(
        "| views | answers | confidence >= 0.99 | of them wrong | wrong of 1 000 | expected |"
    );
    println!("|---|---|---|---|---|---|");
    let (mut all, mut null, mut series) = (Vec::new(), Vec::new(), Vec::new());
    for name in ProtocolName::ALL {
        let view = doubting(name);
        let found = bench.trials(view).run(&bench.robust(view)?, &|_| {})?;
        let answers: Vec<Answer> = found.iter().filter_map(identity).collect();
        row(name.as_str(), &answers);
        series.push(curve(name.as_str(), &answers));
        all.extend(answers);
        null.extend(random_dots(bench, view)?);
    }
    row("all four", &all);
    row("random dots", &null);
    all.extend(null);
    row("all, and random dots", &all);
    series.push(curve("all, and random dots", &all));
    println!();
    reliability_plot(
        &bench.out.join("reliability.png"),
        &ReliabilityPlot {
            title: "Confidence of the identity: predicted and observed".into(),
            x_label: "predicted".into(),
            y_label: "observed".into(),
            series,
        },
    )
}

fn identity(result: &TrialResult) -> Option<Answer> {
    match *result {
        TrialResult::Judged {
            identity,
            confidence,
            ..
        } => Some((confidence, identity)),
        TrialResult::Skipped => None,
    }
}

/// Views with as many dots as the protocol's, uniform on the visible cap: every answer is wrong.
fn random_dots(bench: &Bench, view: ViewModel) -> spindoe::Result<Vec<Answer>> {
    let robust = bench.robust(view)?;
    let trials = Trials::first(bench.pattern(), view, SEED ^ 0xf0_4e16, bench.samples / 4);
    let mut generator = trials.generator();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED ^ 0x4a_4d0a);
    let (mut trial, mut ws) = (Trial::default(), robust.workspace());
    let mut answers = Vec::new();
    for index in trials.range {
        generator.generate(index, &mut trial);
        if trial.dots.len() < view.min_dots {
            continue;
        }
        for dot in &mut trial.dots {
            // The uncertainty stays: its shape differs slightly from that of a null ball.
            dot.direction = random_direction_above(&mut rng, view.visibility_limit);
        }
        let found = robust.identify(&trial.dots, &mut ws);
        answers.push((found.map_or(0.0, |f| f.confidence), false));
    }
    Ok(answers)
}

fn row(views: &str, answers: &[Answer]) {
    let sure: Vec<_> = answers.iter().filter(|a| a.0 >= SURE).collect();
    let wrong = sure.iter().filter(|a| !a.1).count();
    let expected: f64 = sure.iter().map(|a| 1.0 - a.0).sum();
    println!(
        "| {views} | {} | {} | {wrong} | {:.2} | {expected:.1} |",
        answers.len(),
        sure.len(),
        1000.0 * wrong as f64 / sure.len().max(1) as f64
    );
}

fn curve(name: &str, answers: &[Answer]) -> RateSeries {
    let points = EDGES.windows(2).filter_map(|edge| {
        let bin: Vec<_> = answers
            .iter()
            .filter(|a| (edge[0]..edge[1]).contains(&a.0))
            .collect();
        let correct = bin.iter().filter(|a| a.1).count() as u64;
        let rate = Proportion::new(correct, bin.len() as u64);
        (rate.trials >= MIN).then(|| RatePoint {
            x: bin.iter().map(|a| a.0).sum::<f64>() / bin.len() as f64,
            rate: rate.rate,
            low: rate.low,
            high: rate.high,
        })
    });
    RateSeries {
        name: name.into(),
        points: points.collect(),
    }
}
