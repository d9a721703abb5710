//! Does a race keep the best, and is what it reports true? The shipped designs before random cameras: their outcomes on
//! many rendered frames are recorded once, and races are drawn from them, each on scenes of its own (a bootstrap over
//! scenes; the same for all designs, as in a race). The table of docs/measurements/camera.md comes from here.
//!
//!     cargo run --release -p spindoe-studies -- camera-race --help
//!
//! Camera 0 is the default one in a dark room, camera 1 the same in any surroundings; the others are random: balls of 25 to
//! 150 pixels, exposures of 0.05 to 0.5 ms, spins up to 20 to 150 rps. With `--equal N` N copies of one design race,
//! each on scenes of its own: none is better than another.

use std::sync::atomic::AtomicBool;

use rand::RngExt;
use spindoe::camera::{
    CameraConditions, CameraTrials, DotSize, FrameOutcome, FrameRates, RaceConfig, Surroundings,
    race,
};
use spindoe::pattern::shipped_designs;
use spindoe::stats::Proportion;
use spindoe::synth::dataset::frame_rng;
use spindoe_studies::table::{Cell, Table, figure, interval};
use spindoe_studies::{Outcome, row};

/// Diameter of a table tennis ball, mm.
const BALL_MM: f64 = 40.0;

#[derive(clap::Args)]
pub struct Args {
    /// Frames of a design that are recorded.
    #[arg(long, default_value_t = 4000)]
    frames: u64,
    /// Races that are drawn from them.
    #[arg(long, default_value_t = 1000)]
    races: u64,
    /// Seed of cameras and scenes.
    #[arg(long, default_value_t = 29_200_001)]
    seed: u64,
    /// The first camera.
    #[arg(long, default_value_t = 0)]
    from: u64,
    /// Cameras.
    #[arg(long, default_value_t = 2)]
    cameras: u64,
    /// So many copies of dots32 instead of the designs.
    #[arg(long)]
    equal: Option<usize>,
}

/// A design's outcomes on the recorded frames, and its effective error on all of them.
struct Recorded {
    name: String,
    outcomes: Vec<FrameOutcome>,
    rates: FrameRates,
}

impl Args {
    pub fn run(&self) -> Outcome {
        for camera in self.from..self.from + self.cameras {
            let conditions = random_conditions(self.seed, camera);
            println!(
                "{}Balls of {:.0} px, {:.2} ms, surroundings: {}; {} frames of a design, seed {}.",
                if camera == self.from { "" } else { "\n" },
                conditions.ball_px,
                1e3 * conditions.exposure_s,
                conditions.surroundings.as_str(),
                self.frames,
                self.seed
            );
            let recorded = self.recorded(&conditions)?;
            let table = Table::new(["design", "error", "right", "wrong"]);
            for Recorded { name, rates, .. } in &recorded {
                row!(table; name, error(rates), rates.right, rates.wrong);
            }
            self.races(&recorded)?;
        }
        Ok(())
    }

    fn recorded(&self, conditions: &CameraConditions) -> spindoe::Result<Vec<Recorded>> {
        let size = DotSize::LargestHole { ball_mm: BALL_MM };
        let designs = shipped_designs()?;
        let of_them = |name: &str| self.equal.is_none() || name == "dots32";
        let recorded = designs.iter().filter(|d| of_them(&d.name)).map(|named| {
            let trials = CameraTrials::new(*conditions, self.seed)
                .with_dot_diameter(size.of(&named.pattern, conditions)?);
            let outcomes = trials.frames(&named.pattern, 0..self.frames, &|_| ())?;
            Ok(Recorded {
                name: named.name.clone(),
                rates: FrameRates::of(&outcomes, self.seed),
                outcomes,
            })
        });
        recorded.collect()
    }

    /// Races of scenes drawn from the recorded ones.
    fn races(&self, recorded: &[Recorded]) -> Outcome {
        let entries = self.equal.unwrap_or(recorded.len());
        let truth = |entry: usize| &recorded[entry % recorded.len()];
        let error_of = |entry: usize| truth(entry).rates.effective_error_deg;
        let best = (0..entries).min_by(|a, b| error_of(*a).total_cmp(&error_of(*b)));
        let best = best.unwrap_or_default();
        let config = RaceConfig::default();
        let (mut lost, mut won, mut held, mut held_in_race, mut read) = (0, 0, 0, 0, 0);
        let never = AtomicBool::new(false);
        for k in 0..self.races {
            let mut raced: Vec<Vec<FrameOutcome>> = vec![Vec::new(); entries];
            let results = race(entries, &config, &never, |entry, frames| {
                // Copies have scenes of their own, designs the same.
                let own = if self.equal.is_some() {
                    entry as u64
                } else {
                    0
                };
                let outcomes: Vec<FrameOutcome> = frames
                    .clone()
                    .map(|frame| {
                        let mut rng = frame_rng(self.seed ^ k << 24, frame | own << 32);
                        truth(entry).outcomes[rng.random_range(0..self.frames as usize)]
                    })
                    .collect();
                if frames.end <= config.max_frames {
                    raced[entry].extend_from_slice(&outcomes);
                }
                read += outcomes.len();
                Ok(outcomes)
            })?;
            let winner = &results[0];
            won += u64::from(winner.entry == best);
            lost += u64::from(results.iter().any(|r| r.entry == best && r.left));
            let holds = |outcomes: &[FrameOutcome]| {
                let interval = FrameRates::of(outcomes, 0).effective_error_interval_deg;
                interval.is_some_and(|[low, high]| (low..=high).contains(&error_of(winner.entry)))
            };
            held += u64::from(holds(&winner.outcomes));
            held_in_race += u64::from(holds(&raced[winner.entry]));
        }
        let share = |count| Proportion::new(count, self.races);
        println!(
            "\n{} races of {entries}, {} frames each:",
            self.races,
            read as u64 / self.races
        );
        let table = Table::new(["", "share of the races"]);
        row!(table; "the best leaves", share(lost));
        row!(table; "the best wins", share(won));
        row!(table; "the winner's error is within its interval", share(held));
        row!(table; "the same on the frames that chose", share(held_in_race));
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
