//! The gain from each dot's own uncertainty, and the effect of a hint.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use spindoe::geometry::{Rotation, Vec3, random_rotation, rotation_angle};
use spindoe::recognize::robust::{RobustRecognizer, RobustWorkspace};
use spindoe::recognize::{Explanations, Hint, Recognizer, RecognizerRejection};
use spindoe::validate::{ORIENTATION_FAILURE_RAD, Proportion, TrialResult, Trials, Validation};
use spindoe::view::{Detection, DotUncertainty, ObservedDot, ProtocolName, Trial, ViewModel};
use spindoe_studies::row;
use spindoe_studies::score::share;
use spindoe_studies::table::{Table, figure};

use super::{Bench, SEED, doubting};

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

    fn explain<'w>(
        &self,
        dots: &[ObservedDot],
        hint: Option<&Hint>,
        (ws, alike): &'w mut Self::Workspace,
    ) -> Result<&'w Explanations, RecognizerRejection> {
        alike.clear();
        alike.extend(dots.iter().map(|d| ObservedDot {
            uncertainty: DotUncertainty::Isotropic {
                sigma_rad: self.sigma_rad,
            },
            ..*d
        }));
        self.robust.explain(alike, hint, ws)
    }

    fn min_dots(&self) -> usize {
        self.robust.min_dots()
    }
}

fn uncertainty(bench: &Bench) -> spindoe::Result<()> {
    println!("### Uncertainty per dot, protocol `image`");
    let table = Table::new(["given", "identity", "orientation", "mean error"]);
    let name = ProtocolName::Image;
    let (robust, trials) = (bench.robust(name.view())?, bench.trials(name.view()));
    let print = |given: &str, found: &[TrialResult]| {
        let v = Validation::of(found, name, &trials);
        row!(table; given, v.identity, v.orientation, figure(v.mean_error_deg, 3, "deg"));
    };
    print("each dot's 2x2 covariance", &trials.run(&robust, &|_| {})?);
    for factor in [1.0, 1.5, 2.0, 3.0] {
        let alike = Alike {
            robust: robust.clone(),
            sigma_rad: factor * trials.view.noise.sigma_rad(),
        };
        let given = format!("{factor} px over the radius for all dots");
        print(&given, &trials.run(&alike, &|_| {})?);
    }
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
    println!("\n### Hints");
    let table = Table::new(["protocol", "hint", "orientation"]);
    let [paper, sparse, clutter, _] = ProtocolName::ALL.map(ProtocolName::view);
    let dots = |n| ViewModel {
        detection: Detection::Given { dots: n },
        min_dots: n,
        ..paper
    };
    let all = [
        ("paper", paper),
        ("clutter", clutter),
        ("sparse", sparse),
        ("paper, two dots given", dots(2)),
        ("paper, three dots given", dots(3)),
    ];
    for (name, view) in all {
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
            if view.min_dots == 2 && matches!(given, PoseHypothesis::Nothing) {
                continue;
            }
            row!(table; name, hint, hinted(bench, view, given)?);
        }
    }
    Ok(())
}

fn hinted(bench: &Bench, view: ViewModel, given: PoseHypothesis) -> spindoe::Result<Proportion> {
    let (robust, trials) = (bench.robust(view)?, bench.trials(view));
    let mut generator = trials.generator();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED ^ 0x0041_1171);
    let (mut trial, mut ws) = (Trial::default(), robust.workspace());
    let mut is_right = Vec::new();
    for index in trials.range {
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
        if trial.dots.len() < view.min_dots {
            continue;
        }
        let found = robust.explain(&trial.dots, hint.as_ref(), &mut ws);
        is_right.push(found.is_ok_and(|f| {
            rotation_angle(&f.best().rotation, &trial.rotation) < ORIENTATION_FAILURE_RAD
        }));
    }
    Ok(share(&is_right, |r| *r))
}

fn mirrored(bench: &Bench) -> spindoe::Result<()> {
    println!("\n### Views said to be mirrored");
    let table = Table::new(["protocol", "mirrored views", "views as they are"]);
    for name in ProtocolName::ALL {
        let view = doubting(name);
        let robust = bench.robust(view)?;
        let trials = Trials::first(bench.pattern(), view, SEED, bench.samples / 4);
        let mut generator = trials.generator();
        let (mut trial, mut ws) = (Trial::default(), robust.workspace());
        let mut said = [0, 0];
        let mut views = 0;
        for index in trials.range {
            generator.generate(index, &mut trial);
            if trial.dots.len() < view.min_dots {
                continue;
            }
            views += 1;
            for said in &mut said {
                // The first time mirrored, the second time unchanged.
                trial.dots.iter_mut().for_each(flip);
                let outcome = robust.identify(&trial.dots, &mut ws);
                *said += u64::from(outcome == Err(RecognizerRejection::Mirrored));
            }
        }
        row!(table; name.to_string(); said.map(|n| Proportion::new(n, views)));
    }
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
