//! Is the confidence the share of answers that are right? Bin by bin, for the pose and for all names.
//!
//! Views are *stated*, the recognizer knows the protocol that they are drawn from, or *learned*: it
//! gets files of [`FILE`] frames and learns from each what they show. Learned are the protocols, and
//! four mixtures that draw noise, misses and false dots anew for each file. Files of dots at random
//! have no right answer.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::geometry::{random_direction_above, rotation_angle};
use spindoe::plot::{RatePoint, RateSeries, ReliabilityPlot, reliability_plot};
use spindoe::recognize::observed::ObservedFrame;
use spindoe::recognize::stream::{FrameAnswer, LearningOrder};
use spindoe::validate::{ORIENTATION_FAILURE_RAD, TrialResult, Trials};
use spindoe::view::{
    Detection, DotUncertainty, FalseDots, ObservedDot, ProtocolName, Trial, ViewModel,
};
use spindoe_studies::row;
use spindoe_studies::score::{Bin, Claim, bins, claimed, share};
use spindoe_studies::table::Table;

use super::{Bench, SEED};
use crate::trust::conditions::answers;

/// Edges of the bins of claims.
const EDGES: [f64; 8] = [0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 0.999];
/// Points of the plot from fewer answers are left out.
const MIN: u64 = 30;
/// Minimum confidence of an answer by default.
const ANSWERED: f64 = 0.5;
/// Frames of a file.
const FILE: usize = 200;
/// Dots of a frame of dots at random.
const RANDOM_DOTS: usize = 8;

/// The two claims of an answer.
#[derive(Clone, Copy)]
struct Claims {
    pose: Claim,
    names: Claim,
}

impl Claims {
    fn of(result: &TrialResult) -> Option<Self> {
        match *result {
            TrialResult::Skipped => None,
            TrialResult::Judged {
                identity,
                error_rad,
                dots_confidence,
                confidence,
                ..
            } => Some(Self {
                pose: Claim {
                    confidence,
                    is_right: error_rad < ORIENTATION_FAILURE_RAD,
                },
                names: Claim {
                    confidence: dots_confidence,
                    is_right: identity,
                },
            }),
        }
    }
}

/// What files of frames show.
#[derive(Clone, Copy)]
enum Files {
    Protocol(ProtocolName),
    Mixture(Mixture),
    RandomDots,
}

/// Between which ends each file draws its view model.
#[derive(Clone, Copy)]
struct Mixture {
    name: &'static str,
    noise_deg: [f64; 2],
    misses: [f64; 2],
    false_dots: [u16; 2],
    /// Share of frames of dots at random.
    foreign: [f64; 2],
}

const MIXTURES: [Mixture; 4] = [
    Mixture {
        name: "1-3 deg, 0-15 % missed, 0-1 false",
        noise_deg: [1.0, 3.0],
        misses: [0.0, 0.15],
        false_dots: [0, 1],
        foreign: [0.0, 0.0],
    },
    Mixture {
        name: "3-8 deg, 0-20 % missed, 0-1 false",
        noise_deg: [3.0, 8.0],
        misses: [0.0, 0.2],
        false_dots: [0, 1],
        foreign: [0.0, 0.0],
    },
    Mixture {
        name: "1-8 deg, 0-40 % missed, 0-3 false",
        noise_deg: [1.0, 8.0],
        misses: [0.0, 0.4],
        false_dots: [0, 3],
        foreign: [0.0, 0.0],
    },
    Mixture {
        name: "the same, 0-50 % of the frames random",
        noise_deg: [1.0, 8.0],
        misses: [0.0, 0.4],
        false_dots: [0, 3],
        foreign: [0.0, 0.5],
    },
];

impl Mixture {
    /// A file's view model; the recognizer is given a noise of 3 degrees.
    fn draw(&self, rng: &mut ChaCha8Rng) -> ViewModel {
        let within =
            |[from, to]: [f64; 2], rng: &mut ChaCha8Rng| from + (to - from) * rng.random::<f64>();
        let given = ProtocolName::Paper.view();
        let sigma_deg = given.noise.sigma_rad().to_degrees();
        let [fewest, most] = self.false_dots;
        let usual = rng.random_range(fewest..=most);
        let varies = usual > 0 && rng.random::<bool>();
        ViewModel {
            noise_scale: within(self.noise_deg, rng) / sigma_deg,
            detection: Detection::Each {
                probability: 1.0 - within(self.misses, rng),
            },
            visibility_limit: 0.25 * rng.random::<f64>(),
            false_dots: match varies {
                true => FalseDots::Poisson(f64::from(usual)),
                false => FalseDots::Usual(usual),
            },
            foreign_share: within(self.foreign, rng),
            ..given
        }
    }
}

impl Files {
    fn name(&self) -> String {
        match self {
            Self::Protocol(name) => format!("`{name}`"),
            Self::Mixture(mixture) => mixture.name.to_owned(),
            Self::RandomDots => format!("{RANDOM_DOTS} random dots a frame"),
        }
    }

    /// One file, with the truth of each frame; `None` where it shows no ball.
    fn draw(&self, bench: &Bench, number: u64) -> (Vec<ObservedFrame>, Vec<Option<Trial>>) {
        let mut rng = ChaCha8Rng::seed_from_u64(SEED ^ 0x4a_4d0a);
        rng.set_stream(number);
        let view = match self {
            Self::Protocol(name) => name.view(),
            Self::Mixture(mixture) => mixture.draw(&mut rng),
            Self::RandomDots => ViewModel {
                foreign_share: 1.0,
                ..ProtocolName::Paper.view()
            },
        };
        let drawn = ViewModel {
            foreign_share: 0.0,
            ..view
        };
        let mut generator =
            Trials::first(bench.pattern(), drawn, SEED ^ (number << 20), 1).generator();
        let mut truths = Vec::with_capacity(FILE);
        let mut frames = Vec::with_capacity(FILE);
        for index in 0.. {
            if frames.len() == FILE {
                break;
            }
            let mut trial = Trial::default();
            let shows_ball = rng.random::<f64>() >= view.foreign_share;
            if shows_ball {
                generator.generate(index, &mut trial);
                if trial.real_dots() < view.min_dots {
                    continue;
                }
            } else {
                trial.dots = random_dots(&mut rng);
            }
            frames.push(ObservedFrame {
                name: index.to_string(),
                time_s: None,
                is_numbered: false,
                dots: trial.dots.clone(),
            });
            truths.push(shows_ball.then_some(trial));
        }
        (frames, truths)
    }
}

fn random_dots(rng: &mut ChaCha8Rng) -> Vec<ObservedDot> {
    let sigma_rad = ProtocolName::Paper.view().noise.tangent_sigma_rad();
    let dot = |_| ObservedDot {
        direction: random_direction_above(rng, 0.0),
        uncertainty: DotUncertainty::Isotropic { sigma_rad },
    };
    (0..RANDOM_DOTS).map(dot).collect()
}

/// The claims on one file, whose conditions are learned.
fn learned(bench: &Bench, files: Files, number: u64) -> spindoe::Result<Vec<Claims>> {
    let (frames, truths) = files.draw(bench, number);
    let answers = answers(&bench.ball, frames, LearningOrder::InAdvance)?;
    let each = answers.iter().zip(&truths);
    Ok(each
        .map(|(answer, truth)| claims(answer, truth.as_ref()))
        .collect())
}

fn claims(answer: &FrameAnswer, truth: Option<&Trial>) -> Claims {
    let found = answer.identification();
    let is_right = |by: &dyn Fn(&spindoe::Identification, &Trial) -> bool| {
        found
            .zip(truth)
            .is_some_and(|(found, truth)| by(found, truth))
    };
    Claims {
        pose: Claim {
            confidence: found.map_or(0.0, |f| f.confidence),
            is_right: is_right(&|found, truth| {
                rotation_angle(&found.rotation, &truth.rotation) < ORIENTATION_FAILURE_RAD
            }),
        },
        names: Claim {
            confidence: found.map_or(0.0, |f| f.dots_confidence),
            is_right: is_right(&|found, truth| found.assignment == truth.truth),
        },
    }
}

pub fn print(bench: &Bench) -> spindoe::Result<()> {
    println!("### Confidence: claimed and right\n");
    println!("Bold: the mean claim lies outside the 95 % interval.");
    let ranges = bins(&EDGES).map(|bin| bin.named(""));
    let headings = ["views", "of", "answers", "right at 0.5", "answered"].map(String::from);
    let table = Table::new(headings.into_iter().chain(ranges));
    let rows = |views: &str, claims: &[Claims]| {
        row(&table, views, "pose", &poses(claims));
        row(&table, views, "names", &names(claims));
    };
    let mut stated = Vec::new();
    for name in ProtocolName::ALL {
        let view = name.view();
        let found = bench.trials(view).run(&bench.robust(view)?, &|_| {})?;
        let claims: Vec<Claims> = found.iter().filter_map(Claims::of).collect();
        rows(&format!("`{name}`, stated"), &claims);
        stated.extend(claims);
    }
    let protocols = ProtocolName::ALL.map(Files::Protocol);
    let kinds = protocols.into_iter().chain(MIXTURES.map(Files::Mixture));
    let mut all = Vec::new();
    for files in kinds.chain([Files::RandomDots]) {
        let count = bench.samples.div_ceil(FILE as u64);
        let found: spindoe::Result<Vec<_>> = (0..count)
            .into_par_iter()
            .map(|number| learned(bench, files, number))
            .collect();
        let claims = found?.concat();
        rows(&format!("{}, learned", files.name()), &claims);
        all.extend(claims);
    }
    reliability_plot(
        &bench.out.join("reliability.png"),
        &ReliabilityPlot {
            title: "Confidence: claimed and right".into(),
            x_label: "claimed".into(),
            y_label: "right".into(),
            series: vec![
                curve("pose, stated", &poses(&stated)),
                curve("names, stated", &names(&stated)),
                curve("pose, learned", &poses(&all)),
                curve("names, learned", &names(&all)),
            ],
        },
    )
}

fn poses(claims: &[Claims]) -> Vec<Claim> {
    claims.iter().map(|c| c.pose).collect()
}

fn names(claims: &[Claims]) -> Vec<Claim> {
    claims.iter().map(|c| c.names).collect()
}

fn row(table: &Table, views: &str, of: &str, claims: &[Claim]) {
    let is_answered = |c: &Claim| c.confidence >= ANSWERED;
    let cells = bins(&EDGES).map(|bin| {
        let (mean, right) = claimed(claims, bin);
        let is_inside = (right.low..=right.high).contains(&mean);
        let mark = if is_inside { "" } else { "**" };
        let [claim, rate] = [mean, right.rate].map(|x| 100.0 * x);
        let cell = format!("{mark}{claim:.1}: {rate:.1}{mark} of {}", right.trials);
        (right.trials > 0).then_some(cell)
    });
    row!(
        table; views, of, claims.len(), share(claims, |c| c.is_right && is_answered(c)),
        share(claims, is_answered); cells
    );
}

fn curve(name: &str, claims: &[Claim]) -> RateSeries {
    let points = (0..10).map(|k| [k, k + 1].map(|end| f64::from(end) / 10.0));
    let points = points.filter_map(|[from, to]| {
        // A claim of 1 belongs to the last of them.
        let to = if to < 1.0 { to } else { f64::INFINITY };
        let (x, right) = claimed(claims, Bin { from, to });
        (right.trials >= MIN).then_some(RatePoint {
            x,
            rate: right.rate,
            low: right.low,
            high: right.high,
        })
    });
    RateSeries {
        name: name.into(),
        points: points.collect(),
    }
}
