//! Rates of both recognizers, and the robust one's orientation error against the bound.

use spindoe::recognize::{NamedRecognizer, RecognizerName};
use spindoe::validate::{ORIENTATION_FAILURE_RAD, Proportion, TrialResult, Trials, Validation};
use spindoe::view::{FalseDots, ProtocolName, Trial, ViewModel};
use spindoe_studies::orientation_bound::expected_error;

use super::{Bench, views};

pub fn print(bench: &Bench) -> spindoe::Result<()> {
    println!("## Rates\n");
    println!("| protocol | recognizer | identity % | orientation % | skipped | median us |");
    println!("|---|---|---|---|---|---|");
    for (name, protocol, view) in views() {
        let trials = bench.trials(view);
        for recognizer in RecognizerName::ALL {
            let named = NamedRecognizer::new(recognizer, &bench.ball, &view)?;
            let found = trials.run(&named, &|_| {})?;
            row((name, recognizer.as_str()), &found, protocol, &trials);
        }
        let told_the_mean = bench.robust(ViewModel {
            false_dots: FalseDots::Poisson(view.false_dots.mean()),
            ..view
        })?;
        let found = trials.run(&told_the_mean, &|_| {})?;
        let recognizer = "robust, given the mean only";
        row((name, recognizer), &found, protocol, &trials);
    }
    println!("\n## Orientation error of the successes against the bound\n");
    println!("| protocol | mean error deg | bound deg | ratio |");
    println!("|---|---|---|---|");
    for (name, _, view) in views() {
        against_bound(bench, name, view)?;
    }
    println!();
    Ok(())
}

fn row(
    (name, recognizer): (&str, &str),
    found: &[TrialResult],
    protocol: ProtocolName,
    trials: &Trials<'_>,
) {
    let v = Validation::of(found, protocol, trials);
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
fn against_bound(bench: &Bench, name: &str, view: ViewModel) -> spindoe::Result<()> {
    let trials = bench.trials(view);
    let found = trials.run(&bench.robust(view)?, &|_| {})?;
    let mut generator = trials.generator();
    let mut trial = Trial::default();
    let (mut error, mut bound, mut count) = (0.0, 0.0, 0u32);
    for (index, result) in found.iter().enumerate() {
        let TrialResult::Judged { error_rad, .. } = *result else {
            continue;
        };
        if error_rad >= ORIENTATION_FAILURE_RAD {
            continue;
        }
        generator.generate(index as u64, &mut trial);
        if let Some(expected) = expected_error(bench.pattern(), &trial, &view.noise) {
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
