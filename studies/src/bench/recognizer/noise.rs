//! Is the noise learned right? Files of [`VIEWS`] views of every protocol, of which nothing is stated: the shape
//! learned, and its scale, of which 1 is true.
//!
//! Beside it the scale that the true displacements have under the same shape, the most likely one
//! where every rotation and every name is known: the file's own share of the error, which no
//! recognizer can avoid.

use std::num::NonZero;

use rayon::prelude::*;
use spindoe::recognize::robust::RobustConfig;
use spindoe::recognize::stream::{LearningConfig, identify_learning};
use spindoe::view::{NoiseShape, ProtocolName, Trial};
use spindoe_studies::row;
use spindoe_studies::score::mean;
use spindoe_studies::table::{Table, figure};

use super::Bench;
use crate::trust::conditions::{Answers, files, observed};

/// Views of a file.
const VIEWS: u64 = 250;
/// Error of the scale up to which a file counts as right.
const RIGHT: f64 = 0.03;
/// Seeds of the files.
const SEEDS: std::ops::RangeInclusive<u64> = 64_951..=64_970;

/// What a file shows.
struct Learned {
    shape: NoiseShape,
    scale: f64,
    /// Of the true displacements.
    shown: f64,
}

fn learned(bench: &Bench, name: ProtocolName, seed: u64) -> spindoe::Result<Learned> {
    let file = files(bench.pattern(), name.view(), VIEWS, VIEWS as usize, seed);
    let trials = file.concat();
    let found = identify_learning(
        &bench.ball,
        &RobustConfig::default(),
        &LearningConfig::default(),
        observed(&trials).into_iter().map(Ok),
        NonZero::<usize>::MIN,
        &mut Answers::default(),
    )?;
    let shape = found.view.noise.shape();
    Ok(Learned {
        shape,
        scale: found.view.noise_scale,
        shown: shown(bench, shape, &trials),
    })
}

/// The most likely scale of the true displacements, by golden sections.
fn shown(bench: &Bench, shape: NoiseShape, trials: &[Trial]) -> f64 {
    let dots = bench.pattern().dots();
    let deviations = trials.iter().flat_map(|trial| {
        let real = trial.dots.iter().zip(&trial.truth);
        real.filter_map(|(dot, name)| {
            let place = trial.rotation * dots[usize::from((*name)?)];
            Some(dot.squared_deviations(&place).sqrt())
        })
    });
    let deviations: Vec<f64> = deviations.collect();
    let ln_likelihood = |ln_scale: f64| -> f64 {
        let each = deviations.iter();
        each.map(|u| shape.ln_density(u * (-ln_scale).exp()) - 2.0 * ln_scale)
            .sum()
    };
    let (mut low, mut high) = (-1.0f64, 1.0f64);
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    while high - low > 1e-5 {
        let [a, b] = [high - golden * (high - low), low + golden * (high - low)];
        if ln_likelihood(a) > ln_likelihood(b) {
            high = b;
        } else {
            low = a;
        }
    }
    (0.5 * (low + high)).exp()
}

/// The shape that is learned of noise of this one: of those that are learned, normal noise is nearest to the
/// heavy-tailed.
fn learnable(shape: NoiseShape) -> NoiseShape {
    match shape {
        NoiseShape::Normal | NoiseShape::HeavyTailed => NoiseShape::HeavyTailed,
        NoiseShape::RandomAxis => NoiseShape::RandomAxis,
    }
}

pub fn print(bench: &Bench) -> spindoe::Result<()> {
    println!("### The noise learned\n");
    let (files, percent) = (SEEDS.count(), 100.0 * RIGHT);
    println!(
        "{files} files of {VIEWS} views a protocol, seeds {SEEDS:?}; right: within {percent} %.\n"
    );
    let headings = [
        "views",
        "shape right",
        "scale right",
        "mean",
        "spread",
        "shown right",
        "mean",
        "spread",
        "learned over shown, rms off 1",
        "scales",
    ];
    let table = Table::new(headings.map(String::from));
    for name in ProtocolName::ALL {
        let found: spindoe::Result<Vec<_>> = SEEDS
            .into_par_iter()
            .map(|seed| learned(bench, name, seed))
            .collect();
        let found = found?;
        let own = learnable(name.view().noise.shape());
        let shapes = found.iter().filter(|f| f.shape == own).count();
        let [scales, shown] = [|f: &Learned| f.scale, |f: &Learned| f.shown]
            .map(|of| found.iter().map(of).collect::<Vec<_>>());
        let right = |all: &[f64]| all.iter().filter(|s| (*s - 1.0).abs() <= RIGHT).count();
        let off = found.iter().map(|f| (f.scale / f.shown - 1.0).powi(2));
        let rms = (off.sum::<f64>() / found.len() as f64).sqrt();
        let each: Vec<String> = scales.iter().map(|s| format!("{s:.3}")).collect();
        row!(
            table; format!("`{name}`"), shapes, right(&scales), figure(mean(&scales, |x| *x), 3, ""),
            figure(spread(&scales), 3, ""), right(&shown), figure(mean(&shown, |x| *x), 3, ""),
            figure(spread(&shown), 3, ""), figure(rms, 3, ""), each.join(" ")
        );
    }
    Ok(())
}

fn spread(all: &[f64]) -> f64 {
    let mean = mean(all, |x| *x);
    let squares: f64 = all.iter().map(|x| (x - mean).powi(2)).sum();
    (squares / (all.len() as f64 - 1.0)).sqrt()
}
