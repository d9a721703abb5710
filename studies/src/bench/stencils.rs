//! Stencils of many random patterns, for `tests/python/check_stencils.py` to examine.
//!
//!     cargo run --release -p spindoe-studies -- stencils --help
//! `DIR/SEED/{half_a.stl,half_b.stl,stencil.3mf,stencil.json,pattern.csv}` for each pattern that
//! is not rejected, with `pin.stl` where its hinge has a printed pin, pattern and settings in
//! `DIR/failed-SEED` where the stencil fails, and one line of `DIR/survey.csv` for every pattern.

use std::fmt::Write as _;
use std::path::PathBuf;

use rand::{Rng, RngExt, SeedableRng};
use spindoe::geometry::{Vec3, angle_between, random_direction};
use spindoe::pattern::{KeepOut, Pattern};
use spindoe::stencil::{Closure, Stencil, StencilConfig};
use spindoe::{Error, Result};
use spindoe_studies::Outcome;

/// `n` dots, each the one of `tries` random directions that is farthest from those before it: one
/// try gives a uniform pattern, many an even one.
fn random_pattern(n: usize, tries: usize, rng: &mut impl Rng) -> Result<Pattern> {
    let mut dots: Vec<Vec3> = Vec::new();
    while dots.len() < n {
        let mut best = (-1.0, Vec3::z());
        for _ in 0..tries {
            let d = random_direction(rng);
            let least = dots
                .iter()
                .map(|e| angle_between(e, &d))
                .fold(f64::INFINITY, f64::min);
            if least > best.0 {
                best = (least, d);
            }
        }
        dots.push(best.1);
    }
    Pattern::new(dots)
}

/// Up to three zones that no dot reaches into, as logos have them; half of the patterns have none.
fn random_zones(pattern: &Pattern, rng: &mut impl Rng) -> Vec<KeepOut> {
    let count = [0, 0, 0, 1, 2, 3][rng.random_range(0..6)];
    (0..count)
        .map(|_| {
            let axis = random_direction(rng);
            let free = pattern.dots().iter().map(|d| angle_between(d, &axis));
            KeepOut {
                axis,
                half_angle_rad: free.fold(f64::INFINITY, f64::min).min(1.5)
                    * rng.random_range(0.5..1.0),
            }
        })
        .filter(|zone| zone.half_angle_rad > 0.05)
        .collect()
}

/// Sizes as users might choose them, valid and invalid.
fn random_config(rng: &mut impl Rng) -> StencilConfig {
    let balls = [40.0, 40.3, 40.6, 67.0, 220.0, rng.random_range(25.0..100.0)];
    let ball_diameter_mm = balls[rng.random_range(0..balls.len())];
    StencilConfig {
        ball_diameter_mm,
        clearance_mm: rng.random_range(0.05..0.4),
        wall_mm: rng.random_range(1.8..4.0),
        hole_diameter_mm: ball_diameter_mm * rng.random_range(0.04..0.14),
        taper_rad: rng.random_range(0f64..40.0).to_radians(),
        screw_diameter_mm: [2.0, 2.5, 3.0, 4.0][rng.random_range(0..4)],
        hinge_length_mm: rng.random_range(9.0..20.0),
        knuckles: [3, 5][rng.random_range(0..2)],
        knuckle_clearance_mm: rng.random_range(0.2..0.5),
        numbers: rng.random_bool(0.5),
        closure: Closure::ALL[rng.random_range(0..2)],
        ..StencilConfig::default()
    }
}

#[derive(clap::Args)]
pub struct Args {
    /// Patterns.
    count: u64,
    /// Folder that is written.
    dir: PathBuf,
    /// Seed of the first pattern.
    #[arg(long, default_value_t = 0)]
    seed: u64,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let (count, first) = (self.count, self.seed);
        let dir = self.dir.as_path();
        spindoe::files::create_dir(dir)?;
        let mut table =
            String::from("seed,dots,tries,ball_mm,hole_mm,screw_mm,seconds,outcome,detail\n");
        for seed in first..first + count {
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
            let dots = rng.random_range(4..=40);
            let tries = [1, 10, 100][rng.random_range(0..3)];
            let pattern = random_pattern(dots, tries, &mut rng)?;
            let config = random_config(&mut rng);
            let zones = random_zones(&pattern, &mut rng);
            let pattern = pattern.with_keep_out(zones)?;
            let start = std::time::Instant::now();
            let built = Stencil::build(&pattern, &config);
            let seconds = start.elapsed().as_secs_f64();
            let (outcome, detail) = match &built {
                Ok(stencil) => {
                    let dir = dir.join(seed.to_string());
                    stencil.write(&dir)?;
                    pattern.write_csv(&dir.join("pattern.csv"))?;
                    ("built".to_owned(), String::new())
                }
                Err(Error::Argument {
                    parameter: name,
                    problem,
                }) => (format!("refused: {name}"), problem.clone()),
                Err(e) => {
                    // What it takes to repeat it.
                    let dir = dir.join(format!("failed-{seed}"));
                    spindoe::files::create_dir(&dir)?;
                    pattern.write_csv(&dir.join("pattern.csv"))?;
                    let config = format!("{config:#?}\n");
                    spindoe::files::write_bytes(&dir.join("config.txt"), config.as_bytes())?;
                    ("failed".to_owned(), e.to_string())
                }
            };
            let (ball, hole) = (config.ball_diameter_mm, config.hole_diameter_mm);
            let screw = config.screw_diameter_mm;
            let detail = detail.replace(',', ";");
            // Writing to a String cannot fail.
            let _ = writeln!(
                table,
                "{seed},{dots},{tries},{ball:.2},{hole:.2},{screw},{seconds:.2},{outcome},{detail}"
            );
        }
        spindoe::files::write_bytes(&dir.join("survey.csv"), table.as_bytes())?;
        Ok(())
    }
}
