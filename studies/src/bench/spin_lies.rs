//! Whether a spin is believed only where the frames believe it: true clips, clips whose times lie, and clips that show no
//! motion (`tests/it/spin/lies.rs`), and whether the slowest of equals is taken.
//!
//!     cargo run --release -p spindoe-studies -- spin-lies --clips 100 --seed 1

use rand::RngExt;
use rayon::prelude::*;
use spindoe::spin::simulate::stream;
use spindoe::stats::Proportion;
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

#[path = "../../../tests/it/spin/lies.rs"]
mod lies;
use lies::{Fate, Judged, LIES, Maker, NOISE_DEG, Name, TRUTHS, judge, turning};

#[derive(clap::Args)]
pub struct Args {
    /// Clips of a line.
    #[arg(long, default_value_t = 100)]
    clips: u64,
    /// Seed of the clips.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print each clip that is answered wrongly.
    #[arg(long)]
    verbose: bool,
}

impl Args {
    pub fn run(&self) -> Outcome {
        println!(
            "{} clips a line, seed {}; wrong: without a word of the times, with one",
            self.clips, self.seed
        );
        let table = Table::new([
            "clips",
            "right",
            "wrong, no word",
            "wrong, a word",
            "no spin",
            "times named",
            "median error",
        ]);
        let truths = TRUTHS.map(|(name, make)| (format!("true: {name}"), make, None));
        let lies =
            LIES.map(|(name, make, told)| (format!("wrong input: {name}"), make, Some(told)));
        let kinds: Vec<(String, Maker, Option<Name>)> = truths.into_iter().chain(lies).collect();
        for (number, (name, make, told)) in kinds.iter().enumerate() {
            let judged: Vec<Judged> = (0..self.clips)
                .into_par_iter()
                .map(|i| judge(&make(&mut stream(self.seed + 1000 * number as u64, i))))
                .collect();
            let share = |is: &dyn Fn(&Judged) -> bool| {
                Proportion::new(judged.iter().filter(|j| is(j)).count() as u64, self.clips)
            };
            let mut errors: Vec<f64> = judged
                .iter()
                .map(|j| j.error)
                .filter(|e| e.is_finite())
                .collect();
            let median = match errors.is_empty() {
                true => f64::NAN,
                false => 100.0 * spindoe::stats::median(&mut errors),
            };
            row!(
                table; name,
                share(&|j| j.fate == Fate::Right),
                share(&|j| j.fate == Fate::Wrong && !j.told.anything()),
                share(&|j| j.fate == Fate::Wrong && j.told.anything()),
                share(&|j| j.fate == Fate::Rejected),
                share(&|j| told.map_or(j.told.anything(), |told| told(&j.told))),
                figure(median, 2, "%")
            );
            self.say_each(name, &judged);
        }
        self.slowest_of_equals();
        Ok(())
    }

    fn say_each(&self, name: &str, judged: &[Judged]) {
        let judged = judged.iter().enumerate();
        for (i, j) in judged.filter(|(_, j)| self.verbose && j.fate != Fate::Right) {
            println!("{name} {i}: {}", j.words);
        }
    }

    fn slowest_of_equals(&self) {
        println!(
            "\nThe slowest of equals: 0.1 to 5 rps (below half the rate), {NOISE_DEG} deg, 10 to 300 frames"
        );
        let table = Table::new(["frames per second", "wrong", "no spin"]);
        for fps in [
            10.0, 15.0, 20.0, 24.0, 25.0, 29.97, 30.0, 60.0, 120.0, 240.0,
        ] {
            let fates: Vec<Judged> = (0..self.clips)
                .into_par_iter()
                .map(|i| {
                    let rng = &mut stream(self.seed + 77, i);
                    let fastest = 5f64.min(0.49 * fps);
                    let rps = 0.1 * (fastest / 0.1).powf(rng.random());
                    let count = rng.random_range(10..=300);
                    // Times as files have them.
                    let micro = |k: usize| (k as f64 / fps * 1e6).round() * 1e-6;
                    let times: Vec<f64> = (0..count).map(micro).collect();
                    judge(&turning(rng, rps, NOISE_DEG, &times))
                })
                .collect();
            self.say_each(&format!("{fps} fps"), &fates);
            let share = |fate: Fate| {
                Proportion::new(
                    fates.iter().filter(|j| j.fate == fate).count() as u64,
                    self.clips,
                )
            };
            row!(table; fps, share(Fate::Wrong), share(Fate::Rejected));
        }
    }
}
