//! Is the confidence the share of answers that are right? Bin by bin, for the pose and for all names.
//!
//! Views are *stated*, the recognizer knows the protocol that they are drawn from, or *learned*: it
//! gets files of [`FILE`] frames and learns from each what they show. Learned are the protocols, and
//! four mixtures that draw noise, misses and false dots anew for each file. Files of dots at random
//! have no right answer.

use std::num::NonZero;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spindoe::geometry::{random_direction_above, rotation_angle};
use spindoe::plot::{RatePoint, RateSeries, ReliabilityPlot, reliability_plot};
use spindoe::recognize::observed::ObservedFrame;
use spindoe::recognize::robust::RobustConfig;
use spindoe::recognize::stream::{FrameAnswer, LearningConfig, identify_learning};
use spindoe::validate::{ORIENTATION_FAILURE_RAD, Proportion, TrialResult, Trials};
use spindoe::view::{
    Detection, DotUncertainty, FalseDots, ObservedDot, ProtocolName, Trial, ViewModel,
};

use super::{Bench, SEED};

/// Ends of the bins of claims; the last one is open.
const EDGES: [f64; 8] = [0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 0.999];
/// Points of the plot from fewer answers are left out.
const MIN: u64 = 30;
/// Minimum confidence of an answer by default.
const ANSWERED: f64 = 0.5;
/// Frames of a file.
const FILE: usize = 200;
/// Dots of a frame of dots at random.
const RANDOM_DOTS: usize = 8;

/// A claim, and whether it was right.
#[derive(Clone, Copy)]
struct Claim {
    confidence: f64,
    is_right: bool,
}

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
    /// A file's view model; the recognizer is told a noise of 3 degrees.
    fn draw(&self, rng: &mut ChaCha8Rng) -> ViewModel {
        let within =
            |[from, to]: [f64; 2], rng: &mut ChaCha8Rng| from + (to - from) * rng.random::<f64>();
        let told = ProtocolName::Paper.view();
        let sigma_deg = told.noise.sigma_rad().to_degrees();
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
            ..told
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

/// Keeps the answers.
#[derive(Default)]
struct Answers(Vec<FrameAnswer>);

impl spindoe::pipeline::Sink<FrameAnswer> for Answers {
    type Error = spindoe::Error;

    fn take(&mut self, answer: FrameAnswer) -> spindoe::Result<()> {
        self.0.push(answer);
        Ok(())
    }
}

/// The claims on one file, whose conditions are learned.
fn learned(bench: &Bench, files: Files, number: u64) -> spindoe::Result<Vec<Claims>> {
    let (frames, truths) = files.draw(bench, number);
    let mut answers = Answers::default();
    identify_learning(
        &bench.ball,
        &RobustConfig::default(),
        &LearningConfig::default(),
        frames.into_iter().map(Ok),
        NonZero::<usize>::MIN,
        &mut answers,
    )?;
    let each = answers.0.iter().zip(&truths);
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
    println!("## Confidence: claimed and right, in %\n");
    println!("Bold: the mean claim lies outside the 95 % interval.\n");
    let mut head = String::from("| views | of | answers | right at 0.5 | answered |");
    for edge in EDGES.windows(2) {
        head += &format!(" {}-{} |", edge[0], edge[1]);
    }
    println!("{head} more |\n|{}", "---|".repeat(EDGES.len() + 5));
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
    println!();
    let poses = |claims: &[Claims]| claims.iter().map(|c| c.pose).collect::<Vec<_>>();
    let names = |claims: &[Claims]| claims.iter().map(|c| c.names).collect::<Vec<_>>();
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

fn rows(views: &str, claims: &[Claims]) {
    row(views, "pose", claims.iter().map(|c| c.pose));
    row(views, "names", claims.iter().map(|c| c.names));
}

fn row(views: &str, of: &str, claims: impl Iterator<Item = Claim>) {
    let claims: Vec<Claim> = claims.collect();
    let share = |is: &dyn Fn(&Claim) -> bool| {
        let count = claims.iter().filter(|c| is(c)).count() as u64;
        100.0 * Proportion::new(count, claims.len() as u64).rate
    };
    let mut line = format!(
        "| {views} | {of} | {} | {:.2} | {:.2} |",
        claims.len(),
        share(&|c| c.is_right && c.confidence >= ANSWERED),
        share(&|c| c.confidence >= ANSWERED),
    );
    let ends = EDGES.windows(2).map(|e| [e[0], e[1]]);
    for [from, to] in ends.chain([[EDGES[EDGES.len() - 1], f64::INFINITY]]) {
        line += &match bin(&claims, from, to) {
            None => " - |".to_owned(),
            Some(point) => {
                let is_inside = (point.low..=point.high).contains(&point.x);
                let mark = if is_inside { "" } else { "**" };
                let n = claims
                    .iter()
                    .filter(|c| (from..to).contains(&c.confidence))
                    .count();
                format!(
                    " {mark}{:.1}: {:.1}{mark} of {n} |",
                    100.0 * point.x,
                    100.0 * point.rate
                )
            }
        };
    }
    println!("{line}");
}

/// The mean claim between two ends, with the share that is right.
fn bin(claims: &[Claim], from: f64, to: f64) -> Option<RatePoint> {
    let inside = || claims.iter().filter(|c| (from..to).contains(&c.confidence));
    let count = inside().count() as u64;
    let right = inside().filter(|c| c.is_right).count() as u64;
    let rate = Proportion::new(right, count);
    (count > 0).then(|| RatePoint {
        x: inside().map(|c| c.confidence).sum::<f64>() / count as f64,
        rate: rate.rate,
        low: rate.low,
        high: rate.high,
    })
}

fn curve(name: &str, claims: &[Claim]) -> RateSeries {
    let ends: Vec<f64> = (0..=10).map(|k| f64::from(k) / 10.0).collect();
    let enough = |e: &&[f64]| {
        let inside = |c: &&Claim| (e[0]..e[1]).contains(&c.confidence);
        claims.iter().filter(inside).count() as u64 >= MIN
    };
    let points = ends.windows(2).filter(enough);
    RateSeries {
        name: name.into(),
        points: points
            .filter_map(|e| bin(claims, e[0], e[1] + 1e-9))
            .collect(),
    }
}
