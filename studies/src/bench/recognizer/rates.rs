//! Rates of both recognizers, and the robust one's orientation error against the bound.

use spindoe::recognize::{NamedRecognizer, RecognizerName};
use spindoe::validate::{ORIENTATION_FAILURE_RAD, TrialResult, Validation};
use spindoe::view::{FalseDots, Trial, ViewModel};
use spindoe_studies::orientation_bound::expected_error;
use spindoe_studies::row;
use spindoe_studies::score::{mean, ratio};
use spindoe_studies::table::{Table, figure};

use super::{Bench, views};

pub fn print(bench: &Bench) -> spindoe::Result<()> {
    println!("### Rates");
    let table = Table::new([
        "protocol",
        "recognizer",
        "identity",
        "orientation",
        "skipped",
    ]);
    for (name, protocol, view) in views() {
        let trials = bench.trials(view);
        let row = |recognizer: &str, found: &[TrialResult]| {
            let v = Validation::of(found, protocol, &trials);
            row!(table; name, recognizer, v.identity, v.orientation, v.skipped);
        };
        for recognizer in RecognizerName::ALL {
            let named = NamedRecognizer::new(recognizer, &bench.ball, &view)?;
            row(recognizer.as_str(), &trials.run(&named, &|_| {})?);
        }
        let told_the_mean = bench.robust(ViewModel {
            false_dots: FalseDots::Poisson(view.false_dots.mean()),
            ..view
        })?;
        row(
            "robust, given the mean only",
            &trials.run(&told_the_mean, &|_| {})?,
        );
    }
    println!("\n### Orientation error of the right answers against the bound");
    let table = Table::new(["protocol", "mean error, deg", "bound, deg", "ratio"]);
    for (name, _, view) in views() {
        against_bound(&table, bench, name, view)?;
    }
    Ok(())
}

/// Mean error over the orientation successes, and the mean bound of the same views' real dots.
fn against_bound(table: &Table, bench: &Bench, name: &str, view: ViewModel) -> spindoe::Result<()> {
    let trials = bench.trials(view);
    let found = trials.run(&bench.robust(view)?, &|_| {})?;
    let mut generator = trials.generator();
    let mut trial = Trial::default();
    let mut pairs = Vec::new();
    for (index, result) in found.iter().enumerate() {
        let TrialResult::Judged { error_rad, .. } = *result else {
            continue;
        };
        if error_rad >= ORIENTATION_FAILURE_RAD {
            continue;
        }
        generator.generate(index as u64, &mut trial);
        if let Some(expected) = expected_error(bench.pattern(), &trial, &view.noise) {
            pairs.push([error_rad, expected].map(f64::to_degrees));
        }
    }
    let [error, bound] = [0, 1].map(|k: usize| figure(mean(&pairs, |p| p[k]), 3, ""));
    row!(table; name, error, bound, figure(ratio(&pairs).0, 3, ""));
    Ok(())
}
