//! The gain from each dot's own uncertainty, and the effect of a hint.

use std::time::Instant;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use spindoe::geometry::{Rotation, Vec3, random_rotation, rotation_angle};
use spindoe::recognize::robust::{Hint, RobustRecognizer, RobustWorkspace};
use spindoe::recognize::{
    DotUncertainty, Identification, ObservedDot, Recognizer, RecognizerRejection,
};
use spindoe::validate::{
    ORIENTATION_FAILURE_RAD, Proportion, Protocol, ProtocolName, Trial, TrialGenerator, median,
    validate,
};

use crate::{Bench, SEED};

pub fn print(bench: &Bench) -> spindoe::Result<()> {
    uncertainty(bench)?;
    hints(bench)?;
    mirrored(bench)
}

/// Gives the robust recognizer the same standard deviation for every dot.
struct Alike {
    robust: RobustRecognizer,
    sigma_rad: f64,
}

impl Recognizer for Alike {
    type Workspace = (RobustWorkspace, Vec<ObservedDot>);

    fn workspace(&self) -> Self::Workspace {
        (self.robust.workspace(), Vec::new())
    }

    fn identify_into(
        &self,
        dots: &[ObservedDot],
        (ws, alike): &mut Self::Workspace,
        out: &mut Identification,
    ) -> Result<(), RecognizerRejection> {
        alike.clear();
        alike.extend(dots.iter().map(|d| ObservedDot {
            uncertainty: DotUncertainty::Isotropic {
                sigma_rad: self.sigma_rad,
            },
            ..*d
        }));
        self.robust.identify_into(alike, ws, out)
    }

    fn min_dots(&self) -> usize {
        self.robust.min_dots()
    }
}

fn uncertainty(bench: &Bench) -> spindoe::Result<()> {
    println!("## Uncertainty per dot, protocol `image`\n");
    println!("| given | identity % | orientation % | mean error deg |");
    println!("|---|---|---|---|");
    let protocol = Protocol::standard(ProtocolName::Image);
    let robust = RobustRecognizer::new(bench.pattern(), protocol.recognizer_config())?;
    let print = |given: &str, v: &spindoe::validate::Validation| {
        println!(
            "| {given} | {} | {} | {:.3} |",
            v.identity, v.orientation, v.mean_error_deg
        );
    };
    let own = validate(bench.pattern(), &robust, &protocol, SEED, bench.trials)?;
    print("each dot's 2x2 covariance", &own);
    for factor in [1.0, 1.5, 2.0, 3.0] {
        let alike = Alike {
            robust: robust.clone(),
            sigma_rad: factor * protocol.sigma_rad(),
        };
        let v = validate(bench.pattern(), &alike, &protocol, SEED, bench.trials)?;
        let given = format!("{factor} px over the radius for all dots");
        print(&given, &v);
    }
    println!();
    Ok(())
}

/// Prior knowledge beside the dots.
#[derive(Clone, Copy)]
enum PoseHypothesis {
    Nothing,
    /// The true orientation, off by N(0, sigma) about each axis.
    Near(f64),
    /// A random orientation, with the same stated uncertainty.
    Wrong(f64),
}

fn hints(bench: &Bench) -> spindoe::Result<()> {
    println!("## Hints\n");
    println!("| protocol | hint | orientation % | median us | mean us |");
    println!("|---|---|---|---|---|");
    let paper = Protocol::standard(ProtocolName::Paper);
    let dots = |n| Protocol {
        dots_given: Some(n),
        min_dots: n,
        ..paper
    };
    let all = [
        ("paper", paper),
        ("clutter", Protocol::standard(ProtocolName::Clutter)),
        ("sparse", Protocol::standard(ProtocolName::Sparse)),
        ("paper, two dots given", dots(2)),
        ("paper, three dots given", dots(3)),
    ];
    for (name, protocol) in all {
        let rows = [
            ("none", PoseHypothesis::Nothing),
            ("correct within 5 deg per axis", PoseHypothesis::Near(5.0)),
            ("correct within 10 deg per axis", PoseHypothesis::Near(10.0)),
            (
                "wrong, stated as within 10 deg",
                PoseHypothesis::Wrong(10.0),
            ),
        ];
        for (hint, given) in rows {
            if protocol.min_dots == 2 && matches!(given, PoseHypothesis::Nothing) {
                continue;
            }
            hinted_row(bench, (name, hint), &protocol, given)?;
        }
    }
    println!();
    Ok(())
}

fn hinted_row(
    bench: &Bench,
    (name, hint): (&str, &str),
    protocol: &Protocol,
    given: PoseHypothesis,
) -> spindoe::Result<()> {
    let robust = RobustRecognizer::new(bench.pattern(), protocol.recognizer_config())?;
    let mut generator = TrialGenerator::new(bench.pattern(), *protocol, SEED);
    let mut rng = ChaCha8Rng::seed_from_u64(SEED ^ 0x0041_1171);
    let (mut trial, mut ws) = (Trial::default(), robust.workspace());
    let mut out = Identification::default();
    let (mut correct, mut times) = (0, Vec::new());
    for index in 0..bench.trials {
        generator.generate(index, &mut trial);
        let hint = match given {
            PoseHypothesis::Nothing => None,
            PoseHypothesis::Near(deg) => {
                let e = Vec3::from_fn(|_, _| StandardNormal.sample(&mut rng)) * deg.to_radians();
                let near = Rotation::from_scaled_axis(e) * trial.rotation;
                Some(Hint::isotropic(near, deg.to_radians()))
            }
            PoseHypothesis::Wrong(deg) => {
                Some(Hint::isotropic(random_rotation(&mut rng), deg.to_radians()))
            }
        };
        if trial.dots.len() < protocol.min_dots {
            continue;
        }
        let start = Instant::now();
        let done = match hint {
            Some(hint) => robust.identify_hinted(&trial.dots, &hint, &mut ws, &mut out),
            None => robust.identify_into(&trial.dots, &mut ws, &mut out),
        };
        times.push(start.elapsed().as_nanos() as f64 / 1000.0);
        let error = rotation_angle(&out.rotation, &trial.rotation);
        correct += u64::from(done.is_ok() && error < ORIENTATION_FAILURE_RAD);
    }
    let rate = Proportion::new(correct, times.len() as u64);
    let mean = times.iter().sum::<f64>() / times.len() as f64;
    println!(
        "| {name} | {hint} | {rate} | {:.1} | {mean:.1} |",
        median(&mut times)
    );
    Ok(())
}

fn mirrored(bench: &Bench) -> spindoe::Result<()> {
    println!("## Mirrored views\n");
    println!("| protocol | said to be mirrored: mirrored views % | views as they are % |");
    println!("|---|---|---|");
    for name in ProtocolName::ALL {
        let protocol = Protocol::standard(name);
        let robust = RobustRecognizer::new(bench.pattern(), protocol.recognizer_config())?;
        let mut generator = TrialGenerator::new(bench.pattern(), protocol, SEED);
        let (mut trial, mut ws) = (Trial::default(), robust.workspace());
        let mut out = Identification::default();
        let mut said = [0, 0];
        let mut trials = 0;
        for index in 0..bench.trials / 4 {
            generator.generate(index, &mut trial);
            if trial.dots.len() < protocol.min_dots {
                continue;
            }
            trials += 1;
            for said in &mut said {
                // The first time mirrored, the second time unchanged.
                trial.dots.iter_mut().for_each(flip);
                let outcome = robust.identify_into(&trial.dots, &mut ws, &mut out);
                *said += u64::from(outcome == Err(RecognizerRejection::Mirrored));
            }
        }
        let [flipped, straight] = said.map(|n| Proportion::new(n, trials));
        println!("| {name} | {flipped} | {straight} |");
    }
    println!();
    Ok(())
}

/// Reverses the image's u axis. Covariances keep their shape: only the sense of the axes changes.
fn flip(dot: &mut ObservedDot) {
    use spindoe::geometry::tangent_frame;
    let old = tangent_frame(&dot.direction).map(|e| Vec3::new(-e.x, e.y, e.z));
    dot.direction.x = -dot.direction.x;
    if let DotUncertainty::Tangent { covariance } = &mut dot.uncertainty {
        let new = tangent_frame(&dot.direction);
        let turn = nalgebra::Matrix2::from_fn(|i, j| new[i].dot(&old[j]));
        *covariance = turn * *covariance * turn.transpose();
    }
}
