//! Does a race find the order of many more frames? The shipped designs before random cameras: those that
//! `spindoe advise` keeps to the end, against the effective errors of many rendered frames of another seed.
//! The table of docs/measurements/camera.md comes from here.
//!
//!     cargo run --release -p spindoe-studies -- camera-race --help
//!
//! Camera 0 is the default one, camera 1 the same in any surroundings; the others are random: balls of 25 to
//! 150 pixels, exposures of 0.05 to 0.5 ms, spins up to 20 to 150 rps.

use rand::RngExt;
use spindoe::camera::{
    CameraConditions, CameraTrials, DotSize, FrameRates, RaceConfig, Racer, Surroundings,
    race_patterns,
};
use spindoe::pattern::shipped_designs;
use spindoe::synth::dataset::frame_rng;
use spindoe_studies::table::{Cell, Table, figure, interval};
use spindoe_studies::{Outcome, row};

/// Diameter of a table tennis ball, mm.
const BALL_MM: f64 = 40.0;

#[derive(clap::Args)]
pub struct Args {
    /// Frames of a design that the race is compared with.
    #[arg(long, default_value_t = 5000)]
    frames: u64,
    /// Seed of cameras and scenes.
    #[arg(long, default_value_t = 29_200_001)]
    seed: u64,
    /// Cameras.
    #[arg(long, default_value_t = 2)]
    cameras: u64,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (frames, seed, cameras) = (self.frames, self.seed, self.cameras);
        let designs = shipped_designs()?;
        for camera in 0..cameras {
            let conditions = random_conditions(seed, camera);
            let size = DotSize::LargestHole { ball_mm: BALL_MM };
            let racers = designs.iter().map(|named| {
                Ok(Racer {
                    pattern: &named.pattern,
                    dot_diameter: size.of(&named.pattern, &conditions)?,
                })
            });
            let racers = racers.collect::<spindoe::Result<Vec<_>>>()?;
            let trials = CameraTrials::new(conditions, seed);
            let standings = race_patterns(&trials, &racers, &RaceConfig::default(), &|_| ())?;
            let read: usize = standings.iter().map(|s| s.outcomes.len()).sum();
            println!(
                "{}Balls of {:.0} px, {:.2} ms, surroundings: {}; frames in the race: {read}, beside it {frames} a \
                 design.",
                if camera == 0 { "" } else { "\n" },
                conditions.ball_px,
                1e3 * conditions.exposure_s,
                conditions.surroundings.as_str()
            );
            let table = Table::new([
                "design",
                "frames in the race",
                "error in it",
                "error",
                "right",
                "wrong",
            ]);
            for standing in &standings {
                let racer = &racers[standing.entry];
                let raced = FrameRates::of(&standing.outcomes, seed);
                let many = CameraTrials::new(conditions, seed + 1)
                    .with_dot_diameter(racer.dot_diameter)
                    .frames(racer.pattern, 0..frames, &|_| ())?;
                let many = FrameRates::of(&many, seed + 1);
                row!(
                    table; &designs[standing.entry].name, raced.right.trials,
                    error(&raced), error(&many), many.right, many.wrong
                );
            }
        }
        Ok(())
    }
}

fn error(rates: &FrameRates) -> Cell {
    let value = rates.effective_error_deg;
    match rates.effective_error_interval_deg {
        Some(ends) => interval(value, ends, 3, "deg"),
        None => figure(value, 3, "deg"),
    }
}

fn random_conditions(seed: u64, camera: u64) -> CameraConditions {
    let surroundings = Surroundings::ALL[(camera % 2) as usize];
    let usual = CameraConditions {
        surroundings,
        ..CameraConditions::default()
    };
    if camera < 2 {
        return usual;
    }
    let mut rng = frame_rng(seed, 1 << 60 | camera);
    let mut log = |low: f64, high: f64| low * (high / low).powf(rng.random::<f64>());
    CameraConditions {
        ball_px: log(25.0, 150.0),
        exposure_s: log(5e-5, 5e-4),
        rps: [0.0, log(20.0, 150.0)],
        ..usual
    }
}
