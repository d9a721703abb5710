//! The error of the net for outlines that its own covariance does not hold.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::pattern::Pattern;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::independent_frame;
use spindoe::vision::net::outline::{OutlineNet, OutlineWorkspace};
use spindoe::vision::{BallCircle, Pixel};
use spindoe_studies::Outcome;
use spindoe_studies::frames::{DOTS20, all_conditions, good_conditions};
use spindoe_studies::score::{mean, median};

/// Frames, half in good and half in all conditions, and their seed.
const FRAMES: u64 = 1_200;
const SEED: u64 = 14_230_001;
/// The rough circle is off by up to so much, in radii.
const ROUGH: f64 = 0.1;
/// The surest share of the outlines: there what the covariance lacks is seen best.
const SUREST: f64 = 0.1;
/// Standard deviation of a normal distribution over its median absolute value.
const SIGMA_PER_MEDIAN: f64 = 1.4826;

/// An outline of the net: the errors of the center's u and v and of the radius, and their standard deviations, in radii.
struct Seen {
    errors: [f64; 3],
    deviations: [f64; 3],
}

impl Seen {
    fn variance(&self) -> f64 {
        mean(&self.deviations, |s| s * s)
    }
}

/// The standard deviation, in radii, that all three errors of the surest tenth of the outlines have beyond their covariance: by
/// the median of the absolute errors, so that the few outlines of something else do not count.
pub fn systematic() -> Outcome<f64> {
    let pattern = Pattern::read_csv(DOTS20.as_ref())?;
    let net = OutlineNet::built_in()?;
    let seen: spindoe::Result<Vec<Option<Seen>>> = (0..FRAMES)
        .into_par_iter()
        .map_init(OutlineWorkspace::default, |ws, k| {
            see(&net, &pattern, k, ws)
        })
        .collect();
    let mut seen: Vec<Seen> = seen?.into_iter().flatten().collect();
    seen.sort_by(|a, b| a.variance().total_cmp(&b.variance()));
    seen.truncate((SUREST * seen.len() as f64) as usize);
    let errors: Vec<f64> = seen.iter().flat_map(|s| s.errors).collect();
    let total = (SIGMA_PER_MEDIAN * median(&errors, |e| e.abs())).powi(2);
    let stated = mean(&seen, Seen::variance);
    eprintln!(
        "{} outlines: errors of {:.4} radii, stated {:.4}",
        seen.len(),
        total.sqrt(),
        stated.sqrt()
    );
    Ok((total - stated).max(0.0).sqrt())
}

fn see(
    net: &OutlineNet,
    pattern: &Pattern,
    k: u64,
    ws: &mut OutlineWorkspace,
) -> spindoe::Result<Option<Seen>> {
    let set = match k % 2 {
        0 => good_conditions(),
        _ => all_conditions(),
    };
    // An ellipse is no error of the net's circle.
    let config = SynthConfig {
        max_off_axis_rad: 0.0,
        ..set.config
    };
    let frame = independent_frame(pattern, &config, SEED, k as usize)?;
    let truth = BallCircle::new(frame.truth.center, frame.truth.radius_px);
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    rng.set_stream(k);
    let mut off = || truth.radius * rng.random_range(-ROUGH..ROUGH);
    let center = Pixel {
        u: truth.center.u + off(),
        v: truth.center.v + off(),
    };
    let rough = BallCircle::new(center, truth.radius + off());
    Ok(net
        .find_near(&frame.image.to_gray(), &rough, ws)
        .map(|found| {
            let circle = found.circle;
            let off = [
                circle.center.u - truth.center.u,
                circle.center.v - truth.center.v,
                circle.radius - truth.radius,
            ];
            Seen {
                errors: off.map(|e| e / truth.radius),
                deviations: [0, 1, 2].map(|i| found.covariance[(i, i)].sqrt() / circle.radius),
            }
        }))
}
