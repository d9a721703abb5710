//! Rates of both recognizers, and the robust one's orientation error against the bound.

use spindoe::recognize::RecognizerName;
use spindoe::recognize::robust::{RobustConfig, RobustRecognizer};
use spindoe::validate::{
    Proportion, Protocol, Trial, TrialGenerator, TrialResult, run_named, run_trials, summarize,
};
use spindoe_studies::orientation_bound::expected_error;

use crate::{Bench, SEED, protocols};

pub fn print(bench: &Bench) -> spindoe::Result<()> {
    println!("## Rates\n");
    println!("| protocol | recognizer | identity % | orientation % | skipped | median us |");
    println!("|---|---|---|---|---|---|");
    for (name, protocol) in protocols() {
        for recognizer in RecognizerName::ALL {
            let found = run_named(&bench.table, recognizer, &protocol, SEED, bench.trials)?;
            row(name, recognizer.as_str(), &found, &protocol);
        }
        let config = RobustConfig {
            usual_false_dots: None,
            ..protocol.recognizer_config()
        };
        let robust = RobustRecognizer::new(bench.pattern(), config)?;
        let found = run_trials(bench.pattern(), &robust, &protocol, SEED, bench.trials)?;
        row(name, "robust, given the mean only", &found, &protocol);
    }
    println!("\n## Orientation error of the successes against the bound\n");
    println!("| protocol | mean error deg | bound deg | ratio |");
    println!("|---|---|---|---|");
    for (name, protocol) in protocols() {
        against_bound(bench, name, &protocol)?;
    }
    println!();
    Ok(())
}

fn row(name: &str, recognizer: &str, found: &[TrialResult], protocol: &Protocol) {
    let v = summarize(found, protocol, SEED);
    let percent = |p: &Proportion| {
        let [rate, low, high] = [p.rate, p.low, p.high].map(|x| 100.0 * x);
        format!("{rate:.2} [{low:.2}, {high:.2}]")
    };
    println!(
        "| {name} | {recognizer} | {} | {} | {} | {:.1} |",
        percent(&v.identity),
        percent(&v.orientation),
        v.skipped,
        v.median_us_per_identification.unwrap_or(f64::NAN)
    );
}

/// Mean error over the orientation successes, and the mean bound of the same views' real dots.
fn against_bound(bench: &Bench, name: &str, protocol: &Protocol) -> spindoe::Result<()> {
    let robust = RecognizerName::Robust;
    let found = run_named(&bench.table, robust, protocol, SEED, bench.trials)?;
    let mut generator = TrialGenerator::new(bench.pattern(), *protocol, SEED);
    let mut trial = Trial::default();
    let (mut error, mut bound, mut count) = (0.0, 0.0, 0u32);
    for (index, result) in found.iter().enumerate() {
        let TrialResult::Judged { error_rad, .. } = *result else {
            continue;
        };
        if error_rad >= spindoe::validate::ORIENTATION_FAILURE_RAD {
            continue;
        }
        generator.generate(index as u64, &mut trial);
        if let Some(expected) = expected_error(bench.pattern(), &trial, &protocol.noise) {
            error += error_rad.to_degrees();
            bound += expected.to_degrees();
            count += 1;
        }
    }
    let (error, bound) = (error / f64::from(count), bound / f64::from(count));
    println!(
        "| {name} | {error:.3} | {bound:.3} | {:.3} |",
        error / bound
    );
    Ok(())
}
