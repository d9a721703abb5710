//! Predictions of `spindoe::predict` against rendered frames that the whole estimator reads, over
//! random cameras and several patterns.
//!
//!     cargo run --release -p spindoe-studies --bin camera_predictions -- [MODEL.json] [CAMERAS] [FRAMES] [SEED] [PATTERN.csv ...]
//!
//! Cameras: balls of 25 to 150 pixels, exposures of 0.05 to 0.5 ms, spins up to 20 to 150 rps, dots
//! of 0.07 to 0.13 ball diameters, half of them before dark and half before any surroundings, half
//! of them with distance, blur and noise stated. Neither the seed nor a pattern occurs in learning.

use std::error::Error;

use spindoe::Pattern;
use spindoe::predict::{
    DetectionModel, FrameOutcome, FrameRates, Predictor, Surroundings, rendered,
};
use spindoe::vision::EstimatorConfig;
use spindoe_studies::cameras::random_conditions;

type Outcome<T> = Result<T, Box<dyn Error + Send + Sync>>;

fn main() -> Outcome<()> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().unwrap_or("models/camera.json".into());
    let model = DetectionModel::from_json(&std::fs::read_to_string(path)?)?;
    let cameras: u64 = arguments.next().map_or(Ok(12), |a| a.parse())?;
    let frames: u64 = arguments.next().map_or(Ok(300), |a| a.parse())?;
    let seed: u64 = arguments.next().map_or(Ok(15_200_001), |a| a.parse())?;
    let mut paths: Vec<String> = arguments.collect();
    if paths.is_empty() {
        paths = ["dots12", "dots16", "dots20", "dots24"]
            .map(|d| format!("designs/{d}/pattern.csv"))
            .to_vec();
    }
    let (mut within, mut close, mut all) = (0, 0, 0);
    let mut pooled: Vec<(Vec<FrameOutcome>, Vec<FrameOutcome>)> = vec![Default::default(); 2];
    println!(
        "| camera | pattern | right: rendered | predicted | wrong: rendered | predicted | mean error, deg | predicted |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for camera in 0..cameras {
        let conditions = random_conditions(seed, camera);
        println!("| {} |", serde_json::to_string(&conditions)?);
        for path in &paths {
            let pattern = Pattern::read_csv(path.as_ref())?;
            let own = seed + 1 + camera;
            let real = rendered(
                &pattern,
                &conditions,
                EstimatorConfig::default(),
                own,
                frames,
            )?;
            let predictor = Predictor::new(&model, &pattern, EstimatorConfig::default())?;
            // Other scenes than those rendered: both have the noise of their draws.
            let (predicted, _) = predictor.outcomes(&conditions, own + 1_000_000, 4 * frames)?;
            let (r, p) = (FrameRates::of(&real), FrameRates::of(&predicted));
            println!(
                "| {camera} | {path} | {} | {:.2} % | {} | {:.2} % | {:.3} | {:.3} |",
                r.right,
                100.0 * p.right.rate,
                r.wrong,
                100.0 * p.wrong.rate,
                r.mean_error_deg,
                p.mean_error_deg,
            );
            let failures = |x: &FrameRates| 1.0 - x.right.rate;
            let ratio = failures(&p) / failures(&r).max(1e-9);
            let overlaps = p.right.low <= r.right.high && r.right.low <= p.right.high;
            all += 1;
            within += usize::from((0.8..=1.25).contains(&ratio) || overlaps);
            close += usize::from((p.mean_error_deg / r.mean_error_deg - 1.0).abs() < 0.1);
            let k = usize::from(conditions.surroundings == Surroundings::Any);
            pooled[k].0.extend(real);
            pooled[k].1.extend(predicted);
        }
    }
    println!(
        "\nfailures within 25 % or in the interval: {within} of {all}; mean errors within 10 %: {close} of {all}"
    );
    for (name, (r, p)) in ["dark", "any"].iter().zip(&pooled) {
        println!(
            "{name}: rendered {:?}\n  predicted {:?}",
            FrameRates::of(r),
            FrameRates::of(p)
        );
    }
    Ok(())
}
