//! `spindoe spin`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::json;

use crate::error::{Error, Result};
use crate::geometry::Vec3;
use crate::spin::alias::{AliasOptions, Alternative, alternatives};
use crate::spin::orientations::Orientations;
use crate::spin::quatera::{QuateraEstimator, QuateraOptions};
use crate::spin::robust::{MagnitudePrior, RobustEstimator, RobustOptions, standard_deviations};
use crate::spin::{Fit, Measurement, Refusal};

/// Alternatives are listed up to this many times the largest spin that is searched.
const LISTED_BEYOND: f64 = 2.0;
/// Standard deviation of a prior magnitude for which none is given, as a fraction of it.
const PRIOR_SPREAD: f64 = 0.2;
/// Alternatives printed in words; `--json` has them all.
const MOST_PRINTED: usize = 6;

/// How the spin is estimated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Method {
    /// The paper's: regression in the plane of the quaternions after RANSAC.
    Quatera,
    /// Maximum likelihood on SO(3) under a mixture of noise and outliers.
    Robust,
}

#[derive(Debug, Args)]
pub struct Arguments {
    /// Orientations: CSV with a header, frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence
    /// (seconds; quaternion scalar first, pattern to camera, empty where there is none).
    orientations: PathBuf,
    /// How the spin is estimated.
    #[arg(long, value_enum, default_value = "robust")]
    method: Method,
    /// Largest spin considered, revolutions per second. At even times T apart, spins beyond 1/(2 T)
    /// look like slower ones.
    #[arg(long, default_value_t = 175.0, allow_negative_numbers = true)]
    max_spin_rps: f64,
    /// Expected magnitude of the spin, revolutions per second, where something is known of it.
    #[arg(long, allow_negative_numbers = true)]
    prior_rps: Option<f64>,
    /// Standard deviation of the expected magnitude [default: a fifth of it].
    #[arg(long, allow_negative_numbers = true, requires = "prior_rps")]
    prior_std_rps: Option<f64>,
    /// Noise of the orientations in degrees per axis, a first guess: the residuals correct it.
    #[arg(long, default_value_t = 2.0, allow_negative_numbers = true)]
    sigma_deg: f64,
    /// Print one JSON object instead of words.
    #[arg(long)]
    json: bool,
}

impl Arguments {
    fn check(&self) -> Result<()> {
        let flags = [
            ("--max-spin-rps", Some(self.max_spin_rps)),
            ("--prior-rps", self.prior_rps),
            ("--prior-std-rps", self.prior_std_rps),
            ("--sigma-deg", Some(self.sigma_deg)),
        ];
        for (name, value) in flags {
            if let Some(x) = value.filter(|x| !(*x > 0.0 && x.is_finite())) {
                let problem = format!("expected a positive number, found {x}");
                return Err(Error::argument(name, problem));
            }
        }
        Ok(())
    }

    fn robust_options(&self) -> RobustOptions {
        RobustOptions {
            max_rps: self.max_spin_rps,
            sigma_rad: self.sigma_deg.to_radians(),
            prior: self.prior_rps.map(|rps| MagnitudePrior {
                rps,
                std_rps: self.prior_std_rps.unwrap_or(PRIOR_SPREAD * rps),
            }),
            ..RobustOptions::default()
        }
    }

    fn fit(&self, measurements: &[Measurement]) -> std::result::Result<Fit, Refusal> {
        match self.method {
            Method::Robust => RobustEstimator::new(self.robust_options()).fit(measurements),
            Method::Quatera => {
                let max_rps = self.max_spin_rps;
                let options = QuateraOptions {
                    max_rps,
                    ..QuateraOptions::default()
                };
                QuateraEstimator::new(options).fit(measurements)
            }
        }
    }
}

pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.check()?;
    let file = Orientations::read_csv(&arguments.orientations)?;
    let measurements = file.measurements();
    let refused = |r: Refusal| r.in_file(&arguments.orientations);
    let fit = arguments.fit(&measurements).map_err(refused)?;
    let options = AliasOptions {
        max_rps: LISTED_BEYOND * arguments.max_spin_rps,
        sigma_rad: arguments.sigma_deg.to_radians(),
        ..AliasOptions::default()
    };
    let found = Found {
        method: arguments.method,
        frames: file.rows.len(),
        orientations: measurements.len(),
        alternatives: alternatives(&measurements, &fit, &options),
        fit,
    };
    if arguments.json {
        println!("{}", found.to_json());
    } else {
        found.print();
    }
    Ok(())
}

/// Everything that is reported.
struct Found {
    method: Method,
    frames: usize,
    orientations: usize,
    fit: Fit,
    alternatives: Vec<Alternative>,
}

impl Found {
    fn std_rad_s(&self) -> Option<Vec3> {
        self.fit.spin_covariance.as_ref().map(standard_deviations)
    }

    /// Standard deviation of the magnitude, rad/s.
    fn std_along(&self) -> Option<f64> {
        let axis = unit(&self.fit.motion.spin);
        let covariance = self.fit.spin_covariance?;
        Some(axis.dot(&(covariance * axis)).max(0.0).sqrt())
    }

    fn to_json(&self) -> serde_json::Value {
        let spin = &self.fit.motion.spin;
        let q = self.fit.motion.orientation.into_inner();
        let q = if q.w < 0.0 { -q } else { q };
        let alternatives: Vec<_> = self
            .alternatives
            .iter()
            .map(|a| {
                let mut entry = vector_json(&a.spin);
                entry["log_likelihood_ratio"] = a.log_likelihood_ratio.into();
                entry
            })
            .collect();
        let mut json = vector_json(spin);
        json["method"] = match self.method {
            Method::Quatera => "quatera",
            Method::Robust => "robust",
        }
        .into();
        json["std_rad_s"] = json!(self.std_rad_s().map(|s| [s.x, s.y, s.z]));
        json["std_rps"] = json!(self.std_along().map(|s| s / std::f64::consts::TAU));
        json["covariance_rad2_s2"] = json!(
            self.fit
                .spin_covariance
                .map(|c| [0, 1, 2].map(|i| [0, 1, 2].map(|j| c[(i, j)])))
        );
        json["sigma_deg"] = json!(self.fit.sigma_rad.map(f64::to_degrees));
        json["inliers"] = self.fit.inliers.into();
        json["frames"] = self.frames.into();
        json["orientations"] = self.orientations.into();
        json["time_s"] = self.fit.motion.time_s.into();
        json["orientation_wxyz"] = json!([q.w, q.i, q.j, q.k]);
        json["alternatives"] = alternatives.into();
        json
    }

    fn print(&self) {
        let spin = &self.fit.motion.spin;
        let along = self.std_along().map_or(String::new(), |s| {
            format!(" +- {:.3}", s / std::f64::consts::TAU)
        });
        let [x, y, z] = [spin.x, spin.y, spin.z];
        println!(
            "{:.3}{along} rps about {}",
            self.fit.motion.rps(),
            axis_words(spin)
        );
        println!("  spin      [{x:.3}, {y:.3}, {z:.3}] rad/s, camera frame");
        if let Some(s) = self.std_rad_s() {
            println!("  std       [{:.3}, {:.3}, {:.3}] rad/s", s.x, s.y, s.z);
        }
        println!(
            "  {} frames, {} with an orientation, {} of them agree",
            self.frames, self.orientations, self.fit.inliers
        );
        if let Some(sigma) = self.fit.sigma_rad {
            println!("  noise     {:.2} deg per axis", sigma.to_degrees());
        }
        for a in self.alternatives.iter().take(MOST_PRINTED) {
            println!(
                "  also possible: {:.3} rps about {} (log-likelihood ratio {:+.2})",
                a.spin.norm() / std::f64::consts::TAU,
                axis_words(&a.spin),
                a.log_likelihood_ratio
            );
        }
        let more = self.alternatives.len().saturating_sub(MOST_PRINTED);
        if more > 0 {
            println!("  and {more} more");
        }
    }
}

/// A spin's fields; no axis where it does not turn.
fn vector_json(spin: &Vec3) -> serde_json::Value {
    let axis = unit(spin);
    json!({
        "spin_rad_s": [spin.x, spin.y, spin.z],
        "rps": spin.norm() / std::f64::consts::TAU,
        "axis": [axis.x, axis.y, axis.z],
    })
}

fn axis_words(spin: &Vec3) -> String {
    let axis = unit(spin);
    format!("[{:.4}, {:.4}, {:.4}]", axis.x, axis.y, axis.z)
}

/// The direction of a spin; zero where it has none.
fn unit(spin: &Vec3) -> Vec3 {
    spin.try_normalize(0.0).unwrap_or_default()
}
