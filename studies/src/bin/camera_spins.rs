//! Predicted spins of sequences against those of rendered ones that the whole estimator reads, over random
//! cameras.
//!
//!     cargo run --release -p spindoe-studies --bin camera_spins -- [CAMERAS] [SEQUENCES] [FRAMES] [SEED] [PATTERN.csv]
//!
//! Cameras as in `camera_predictions`. SEQUENCES of FRAMES frames are rendered for each camera, and four times as
//! many others are predicted.

use std::error::Error;

use spindoe::Pattern;
use spindoe::predict::{DetectionModel, Predictor, SpinPrediction, rendered_spins};
use spindoe::stats::quantile;
use spindoe::validate::Proportion;
use spindoe::vision::EstimatorConfig;
use spindoe_studies::cameras::random_conditions;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let mut number = |default: u64| arguments.next().map_or(Ok(default), |a| a.parse());
    let (cameras, sequences) = (number(50)?, number(24)?);
    let (frames, seed) = (number(20)? as usize, number(15_400_001)?);
    let path = arguments
        .next()
        .unwrap_or("designs/dots20/pattern.csv".into());
    let pattern = Pattern::read_csv(path.as_ref())?;
    let model = DetectionModel::shipped()?;
    let predictor = Predictor::new(&model, &pattern, EstimatorConfig::default())?;
    println!("{path}, {sequences} sequences of {frames} frames a camera, seed {seed}\n");
    println!(
        "| camera | ball, px | rps up to | surroundings | spin right: rendered | predicted | error, rps | predicted | axis, deg | predicted |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let mut ratios: [Vec<f64>; 2] = Default::default();
    let (mut right, mut agree, mut within) = ([[0u64; 2]; 2], 0, 0);
    for camera in 0..cameras {
        let conditions = random_conditions(seed, camera);
        let own = seed + 1 + camera;
        let config = EstimatorConfig::default();
        let real = rendered_spins(&pattern, &conditions, config, own, sequences, frames)?;
        let other = predictor.spins(&conditions, own + 1_000_000, 4 * sequences, frames)?;
        println!(
            "| {camera} | {:.0} | {:.0} | {} | {} | {} | {:.3} | {:.3} | {:.2} | {:.2} |",
            conditions.ball_px,
            conditions.rps[1],
            serde_json::to_string(&conditions.surroundings)?,
            real.right,
            other.right,
            real.median_error_rps,
            other.median_error_rps,
            real.median_axis_error_deg,
            other.median_axis_error_deg
        );
        for (sums, found) in right.iter_mut().zip([&real, &other]) {
            sums[0] += found.right.successes;
            sums[1] += found.right.trials;
        }
        agree +=
            u64::from(real.right.low <= other.right.high && other.right.low <= real.right.high);
        let ratio = |of: fn(&SpinPrediction) -> f64| of(&other) / of(&real);
        let errors = [
            ratio(|p| p.median_error_rps),
            ratio(|p| p.median_axis_error_deg),
        ];
        within += u64::from((errors[0] - 1.0).abs() < 0.2);
        for (all, one) in ratios.iter_mut().zip(errors) {
            all.extend(Some(one).filter(|r| r.is_finite()));
        }
    }
    println!();
    for (name, [right, all]) in ["rendered", "predicted"].iter().zip(right) {
        println!("spins right, {name}: {}", Proportion::new(right, all));
    }
    println!("rates within each other's intervals: {agree} of {cameras}");
    println!("error of the spin within 20 %: {within} of {cameras}");
    for (name, ratios) in ["spin", "axis"].iter().zip(&mut ratios) {
        ratios.sort_by(f64::total_cmp);
        let at = |q: f64| quantile(ratios, q);
        println!(
            "predicted over rendered, median error of the {name}: {:.2} in the middle, quarters {:.2} and {:.2}, extremes {:.2} and {:.2}",
            at(0.5),
            at(0.25),
            at(0.75),
            at(0.0),
            at(1.0)
        );
    }
    Ok(())
}
