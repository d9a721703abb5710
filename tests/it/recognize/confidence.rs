//! The confidence against sums over all explanations that are written out here: all rotations, all
//! assignments. Nothing in them is the recognizer's but the view model's own functions.

use std::f64::consts::{PI, TAU};
use std::num::NonZero;
use std::path::Path;

use nalgebra::{Matrix2, Matrix3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use spindoe::ball::{Ball, CalibrationRecord};
use spindoe::geometry::{
    Rotation, Vec3, random_direction_above, random_rotation, rotation_angle, tangent_frame,
};
use spindoe::pattern::Pattern;
use spindoe::recognize::observed::{ObservedFrame, observed_frames};
use spindoe::recognize::robust::{RobustConfig, RobustRecognizer};
use spindoe::recognize::stream::{
    FrameAnswer, LearnedView, LearningConfig, LearningOrder, identify_learning,
};
use spindoe::recognize::{Hint, ORIENTATION_FAILURE_RAD, Recognizer};
use spindoe::validate::Trials;
use spindoe::view::{
    Detection, DotUncertainty, FalseDots, Noise, ObservedDot, ProtocolName, Trial, ViewModel,
};

const SEED: u64 = 20_261_207;

/// The recognizer's visibility: a logistic curve of this slope and width in z about the limit.
fn visible(z: f64, limit: f64) -> f64 {
    1.0 / (1.0 + (-1.7 * (z - limit) / 0.03).exp())
}

/// ln of the density of an observed dot about a place, per steradian.
fn ln_density(dot: &ObservedDot, place: &Vec3, noise: &Noise) -> f64 {
    let determinant = match dot.uncertainty {
        DotUncertainty::Isotropic { sigma_rad } => sigma_rad.powi(4),
        DotUncertainty::Tangent { covariance } => covariance.determinant(),
    };
    let u = dot.squared_deviations(place).sqrt();
    noise.shape().ln_kernel(u) - TAU.ln() - 0.5 * determinant.ln()
}

/// The density of a view at a rotation: of one assignment, and of all together.
struct Density<'a> {
    pattern: &'a [Vec3],
    view: &'a ViewModel,
    dots: &'a [ObservedDot],
    own: &'a [Option<u16>],
}

impl Density<'_> {
    /// `(own assignment, all assignments)`.
    fn at(&self, rotation: &Rotation) -> [f64; 2] {
        let Detection::Each { probability } = self.view.detection else {
            unreachable!("the views here find each dot on its own");
        };
        let limit = self.view.visibility_limit;
        let places: Vec<Vec3> = self.pattern.iter().map(|p| rotation * p).collect();
        let found: Vec<f64> = places
            .iter()
            .map(|q| probability * visible(q.z, limit))
            .collect();
        let missed: f64 = found.iter().map(|d| 1.0 - d).product();
        let false_dot = self.view.false_dots.mean() / (TAU * (1.0 - self.view.false_dot_limit));
        let none = (-self.view.false_dots.mean()).exp() * missed;
        let odds: Vec<Vec<f64>> = self
            .dots
            .iter()
            .map(|dot| {
                let near = |q: &Vec3| q.dot(&dot.direction) > 0.5;
                let of = |(q, d): (&Vec3, &f64)| match near(q) {
                    true => d / (1.0 - d) * ln_density(dot, q, &self.view.noise).exp(),
                    false => 0.0,
                };
                places.iter().zip(&found).map(of).collect()
            })
            .collect();
        // Over the sets of pattern dots that are taken.
        let mut sums = vec![0.0; 1 << places.len()];
        sums[0] = none;
        for odds in &odds {
            let mut next: Vec<f64> = sums.iter().map(|s| s * false_dot).collect();
            for (taken, sum) in sums.iter().enumerate().filter(|(_, s)| **s > 0.0) {
                for (j, o) in odds.iter().enumerate() {
                    if taken >> j & 1 == 0 {
                        next[taken | 1 << j] += sum * o;
                    }
                }
            }
            sums = next;
        }
        let each = odds.iter().zip(self.own);
        let own: f64 = each
            .map(|(odds, name)| name.map_or(false_dot, |j| odds[usize::from(j)]))
            .product();
        [none * own, sums.iter().sum()]
    }
}

/// Density of a rotation drawn about `center`, of uniform rotations' density.
fn drawn_density(rotation: &Rotation, center: &Rotation, sigma: f64) -> f64 {
    let angle = rotation_angle(rotation, center);
    let volume = match angle < 1e-6 {
        true => 1.0,
        false => 2.0 * (1.0 - angle.cos()) / (angle * angle),
    };
    let normal = (-0.5 * (angle / sigma).powi(2)).exp() / (sigma * TAU.sqrt()).powi(3);
    normal * 8.0 * PI * PI / volume
}

/// A view of eight dots with errors, misses and false dots: the probability of the pose and of the
/// names is that of all rotations and assignments.
#[test]
fn confidences_are_shares_of_all_explanations() {
    let pattern = crate::common::random_pattern(8, 31);
    let view = ViewModel {
        noise: Noise::HeavyTailed {
            sigma_rad: 5f64.to_radians(),
        },
        detection: Detection::Each { probability: 0.8 },
        false_dots: FalseDots::Poisson(0.7),
        min_dots: 3,
        ..ProtocolName::Paper.view()
    };
    let recognizer = RobustRecognizer::new(&pattern, view.into()).unwrap();
    let trials = Trials::first(&pattern, view, SEED, 1000);
    let (mut generator, mut ws) = (trials.generator(), recognizer.workspace());
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let sigma = 8f64.to_radians();
    let (mut views, mut off) = (0, [0.0f64; 2]);
    for index in trials.range {
        let mut trial = Trial::default();
        generator.generate(index, &mut trial);
        if !(4..=5).contains(&trial.dots.len()) {
            continue;
        }
        let Ok(found) = recognizer.explain(&trial.dots, None, &mut ws) else {
            continue;
        };
        // Views in doubt tell most.
        if found.best().confidence > 0.95 {
            continue;
        }
        let best = found.best();
        let centers: Vec<Rotation> = [best]
            .into_iter()
            .chain(found.rivals())
            .map(|e| e.rotation)
            .collect();
        let density = Density {
            pattern: pattern.dots(),
            view: &view,
            dots: &trial.dots,
            own: &best.assignment,
        };
        let [mut names, mut pose, mut all] = [0.0; 3];
        for k in 0..30_000 {
            // One in three uniform, the others about an explanation.
            let rotation = if k % 3 == 0 {
                random_rotation(&mut rng)
            } else {
                let center = centers[rng.random_range(0..centers.len())];
                let turn = Vec3::from_fn(|_, _| {
                    sigma * Distribution::<f64>::sample(&StandardNormal, &mut rng)
                });
                Rotation::new(turn) * center
            };
            let about: f64 = centers
                .iter()
                .map(|c| drawn_density(&rotation, c, sigma))
                .sum();
            let drawn = 1.0 / 3.0 + 2.0 / 3.0 * about / centers.len() as f64;
            let [own, sum] = density.at(&rotation).map(|p| p / drawn);
            all += sum;
            if rotation_angle(&rotation, &best.rotation) < 20f64.to_radians() {
                pose += sum;
                names += own;
            }
        }
        views += 1;
        for (off, (claimed, exact)) in off.iter_mut().zip([
            (best.confidence, pose / all),
            (best.dots_confidence, names / all),
        ]) {
            println!("{index}: claimed {claimed:.3}, exact {exact:.3}");
            *off += (claimed - exact).abs();
        }
        if views == 20 {
            break;
        }
    }
    let mean = off.map(|sum| sum / f64::from(views));
    println!("{views} views: off by {mean:?} on average");
    assert!(views == 20 && mean.iter().all(|m| *m < 0.04), "{mean:?}");
}

/// A view in which all is certain but which of two dots is which: the two dots 4 degrees apart, each seen
/// with this uncertainty at an offset from the middle between them, along and across (degrees).
fn exchange(uncertainty: DotUncertainty, offsets: [[f64; 2]; 2], placement_deg: f64) -> [f64; 2] {
    let noise = Noise::of_shape(spindoe::view::NoiseShape::Normal, 2f64.to_radians());
    let middle = Vec3::z();
    let [e1, e2] = tangent_frame(&middle);
    let at = |[along, across]: [f64; 2]| {
        (middle + e1 * along.to_radians() + e2 * across.to_radians()).normalize()
    };
    let pair = [at([-2.0, 0.0]), at([2.0, 0.0])];
    let others = crate::common::random_pattern(14, 77);
    let others: Vec<Vec3> = others
        .dots()
        .iter()
        .copied()
        .filter(|d| d.z < 0.8)
        .collect();
    let dots: Vec<Vec3> = pair.into_iter().chain(others).collect();
    let pattern = Pattern::new(dots.clone()).unwrap();
    let variance = placement_deg.to_radians().powi(2);
    let covariances = dots.iter().enumerate().map(|(j, d)| {
        // What all dots have is for the observer to state.
        let own = if j < 2 { variance } else { 0.0 } + 1e-12;
        (Matrix3::identity() - d * d.transpose()) * own
    });
    let record = CalibrationRecord {
        nominal_sha256: None,
        nominal_numbers: vec![None; dots.len()],
        views: vec![9; dots.len()],
    };
    let ball = Ball::new(pattern.clone());
    let ball = ball
        .with_calibration(covariances.collect(), record)
        .unwrap();
    let view = ViewModel {
        noise,
        detection: Detection::Each { probability: 0.999 },
        false_dots: FalseDots::Poisson(1e-4),
        ..ProtocolName::Paper.view()
    };
    let recognizer = RobustRecognizer::for_ball(&ball, view.into()).unwrap();
    let sure = DotUncertainty::Isotropic { sigma_rad: 1e-3 };
    let seen = dots[2..].iter().filter(|d| d.z > 0.15);
    let mut view: Vec<ObservedDot> = seen
        .map(|d| ObservedDot {
            direction: *d,
            uncertainty: sure,
        })
        .collect();
    let two = offsets.map(|offset| ObservedDot {
        direction: at(offset),
        uncertainty,
    });
    view.extend(two);
    let found = recognizer
        .identify(&view, &mut recognizer.workspace())
        .unwrap();
    // Of the assignment that is answered, and of the exchanged one.
    let weight = |swapped: usize| -> f64 {
        let each = two.iter().enumerate().map(|(k, dot)| {
            let widened = ObservedDot {
                uncertainty: dot.uncertainty.widened(placement_deg.to_radians()),
                ..*dot
            };
            ln_density(&widened, &pair[k ^ swapped], &noise)
        });
        each.sum::<f64>().exp()
    };
    let names = &found.assignment[view.len() - 2..];
    let answered = match names {
        [Some(0), Some(1)] => 0,
        [Some(1), Some(0)] => 1,
        other => panic!("the two dots are named {other:?}"),
    };
    let exact = weight(answered) / (weight(0) + weight(1));
    [found.dots_confidence, exact]
}

#[test]
fn two_dots_that_may_be_exchanged_count_once() {
    let two_deg = DotUncertainty::Isotropic {
        sigma_rad: 2f64.to_radians(),
    };
    // Seen on the line that separates them: a toss of a coin.
    let [claimed, exact] = exchange(two_deg, [[0.0, 2.0], [0.0, -2.0]], 0.0);
    assert!((exact - 0.5).abs() < 1e-9, "{exact}");
    assert!((claimed - 0.5).abs() < 0.01, "{claimed}");
    for off in [0.25, 0.5, 1.0, 2.0] {
        let [claimed, exact] = exchange(two_deg, [[-off, 1.0], [off, -1.0]], 0.0);
        println!("{off} deg to their sides: claimed {claimed:.4}, exact {exact:.4}");
        assert!(
            (claimed - exact).abs() < 0.01,
            "{off}: {claimed} for {exact}"
        );
    }
}

#[test]
fn variances_of_a_dot_and_of_its_place_add_up() {
    let [along, across] = [2.5f64, 0.5].map(|deg| deg.to_radians().powi(2));
    // Half way between the two axes.
    let [mean, off] = [0.5 * (along + across), 0.5 * (along - across)];
    for covariance in [
        Matrix2::new(along, 0.0, 0.0, across),
        Matrix2::new(across, 0.0, 0.0, along),
        Matrix2::new(mean, off, off, mean),
        Matrix2::new(mean, -off, -off, mean),
    ] {
        let elongated = DotUncertainty::Tangent { covariance };
        // sqrt(2.5^2 + 1.2^2) = 2.773, and 1.3 across.
        let wide = elongated.widened(1.2f64.to_radians());
        let DotUncertainty::Tangent { covariance: sum } = wide else {
            panic!("an elongated dot remains one");
        };
        let deviations = sum.symmetric_eigenvalues().map(|v| v.sqrt().to_degrees());
        assert!((deviations.max() - 2.773).abs() < 5e-4, "{deviations}");
        assert!((deviations.min() - 1.3).abs() < 5e-4, "{deviations}");
        for placement_deg in [0.0, 1.2, 3.0] {
            let offsets = [[-1.0, 0.8], [1.2, -0.7]];
            let [claimed, exact] = exchange(elongated, offsets, placement_deg);
            println!("placed to {placement_deg} deg: claimed {claimed:.4}, exact {exact:.4}");
            assert!(
                (claimed - exact).abs() < 0.015,
                "{placement_deg}: {claimed} for {exact}"
            );
        }
    }
}

/// One view in five has four dots at random: on average as many answers are right as they claim.
#[test]
fn claims_add_up_where_some_views_show_something_else() {
    let pattern = crate::common::dots20();
    let view = ViewModel {
        foreign_share: 0.2,
        ..ProtocolName::Sparse.view()
    };
    let recognizer = RobustRecognizer::new(&pattern, view.into()).unwrap();
    let trials = Trials::first(&pattern, view, SEED, 3000);
    let (mut generator, mut ws) = (trials.generator(), recognizer.workspace());
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let (mut claimed, mut right, mut variance) = (0.0, 0.0, 0.0);
    let mut trial = Trial::default();
    for index in trials.range {
        generator.generate(index, &mut trial);
        if trial.dots.len() < 4 {
            continue;
        }
        let is_foreign = rng.random::<f64>() < view.foreign_share;
        if is_foreign {
            // Views of something else have as many dots as those of the ball on average, 4 (Poisson): so
            // many have exactly four.
            if rng.random::<f64>() > 0.195_367 {
                continue;
            }
            for dot in &mut trial.dots {
                dot.direction = random_direction_above(&mut rng, view.visibility_limit);
            }
        }
        let Ok(found) = recognizer.identify(&trial.dots, &mut ws) else {
            continue;
        };
        let p = found.confidence;
        let off = rotation_angle(&found.rotation, &trial.rotation);
        claimed += p;
        variance += p * (1.0 - p);
        right += f64::from(!is_foreign && off < ORIENTATION_FAILURE_RAD);
    }
    println!(
        "claimed {claimed:.1}, right {right}, +- {:.1}",
        variance.sqrt()
    );
    assert!(
        (claimed - right).abs() < 4.0 * variance.sqrt(),
        "{claimed} {right}"
    );
}

/// What is learned of frames of which nothing is stated.
fn learned(
    ball: &Ball,
    frames: Vec<ObservedFrame>,
    answers: &mut Answers,
) -> spindoe::Result<LearnedView> {
    identify_learning(
        ball,
        &RobustConfig::default(),
        &LearningConfig::default(),
        frames.into_iter().map(Ok),
        NonZero::<usize>::MIN,
        answers,
    )
}

/// Frames in which a matched dot lies at the end of what the noise reaches: what is learned of them must be
/// finite, and the frames must be answered. Files of these seeds once were refused with a limit that is NaN.
#[test]
fn dots_at_the_end_of_the_noise_do_not_spoil_what_is_learned() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("designs/dots12/pattern.csv");
    let ball = Ball::new(Pattern::read_csv(&path).unwrap());
    for seed in [4, 8] {
        let view = ProtocolName::Image.view();
        let frames = observed_frames(ball.pattern(), &view, seed, 150);
        let mut answers = Answers::default();
        let learned = learned(&ball, frames, &mut answers);
        let learned = learned.unwrap_or_else(|e| panic!("seed {seed}: {e}"));
        assert!(learned.view.check().is_ok(), "seed {seed}: {learned:?}");
        let answered = answers.0.iter().filter(|a| a.identification().is_some());
        assert!(answered.count() > 140, "seed {seed}");
    }
}

/// Noise of which nothing is stated is learned with its shape and its scale, 1, whether four dots are seen of which
/// the rotation takes a part, or all.
#[test]
fn the_noise_is_learned_as_it_is() {
    let ball = Ball::new(crate::common::dots20());
    // Four standard deviations of the scale of so many dots.
    for (name, most_off) in [(ProtocolName::Paper, 0.07), (ProtocolName::Sparse, 0.13)] {
        let view = name.view();
        let frames = observed_frames(ball.pattern(), &view, 64_973, 250);
        let learned = learned(&ball, frames, &mut Answers::default());
        let found = learned.unwrap().view;
        assert_eq!(found.noise.shape(), view.noise.shape(), "{name}");
        assert!(
            (found.noise_scale - 1.0).abs() < most_off,
            "{name}: {}",
            found.noise_scale
        );
    }
}

/// Two frames in five show eight dots at random: so much is learned of them.
#[test]
fn the_share_of_other_frames_is_learned() {
    let ball = Ball::new(crate::common::dots20());
    let view = ProtocolName::Clutter.view();
    let mut frames = observed_frames(ball.pattern(), &view, SEED, 200);
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    for (k, frame) in frames.iter_mut().enumerate() {
        if k % 5 < 2 {
            let uncertainty = DotUncertainty::Isotropic { sigma_rad: 0.05 };
            let dot = |_| ObservedDot {
                direction: random_direction_above(&mut rng, 0.0),
                uncertainty,
            };
            frame.dots = (0..8).map(dot).collect();
        }
    }
    let mut answers = Answers::default();
    let learned = learned(&ball, frames, &mut answers);
    let share = learned.unwrap().view.foreign_share;
    assert!((share - 0.4).abs() < 0.08, "{share}");
    let sure = |a: &&FrameAnswer| a.identification().is_some_and(|f| f.confidence >= 0.99);
    let random = answers.0.iter().enumerate().filter(|(k, _)| k % 5 < 2);
    assert_eq!(random.filter(|(_, a)| sure(a)).count(), 0);
}

#[derive(Default)]
struct Answers(Vec<FrameAnswer>);

impl spindoe::pipeline::Sink<FrameAnswer> for Answers {
    type Error = spindoe::Error;

    fn take(&mut self, answer: FrameAnswer) -> spindoe::Result<()> {
        self.0.push(answer);
        Ok(())
    }
}

/// Six dots as a pose has them to which a hint leads, ten as another pose has them: the hint's pose stands
/// far above "no ball", but the search finds the other.
#[test]
fn a_hint_that_explains_some_dots_does_not_end_the_search() {
    let pattern = crate::common::random_pattern(20, 12);
    let view = ViewModel {
        detection: Detection::Each { probability: 0.8 },
        false_dots: FalseDots::Poisson(3.0),
        ..ProtocolName::Paper.view()
    };
    let recognizer = RobustRecognizer::new(&pattern, view.into()).unwrap();
    let mut ws = recognizer.workspace();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut tried = 0;
    for _ in 0..40 {
        let [truth, hinted] = [0; 2].map(|_| random_rotation(&mut rng));
        let seen = |rotation: Rotation, dots: usize| {
            let seen = pattern
                .dots()
                .iter()
                .map(move |d| rotation * d)
                .filter(|d| d.z > 0.1);
            seen.take(dots).map(|direction| ObservedDot {
                direction,
                uncertainty: DotUncertainty::Isotropic { sigma_rad: 0.02 },
            })
        };
        let dots: Vec<ObservedDot> = seen(truth, 10).chain(seen(hinted, 6)).collect();
        let near = recognizer.explain_near(&dots, &hinted, &mut ws);
        // Nine nats once were enough for the search to be left out.
        if dots.len() < 14 || !near.is_some_and(|pose| pose.ln_evidence > 9.0) {
            continue;
        }
        tried += 1;
        let hint = Hint::isotropic(hinted, 3f64.to_radians());
        let found = recognizer.explain(&dots, Some(&hint), &mut ws).unwrap();
        let off = rotation_angle(&found.best().rotation, &truth).to_degrees();
        assert!(off < 5.0, "{off} deg off");
    }
    assert!(tried >= 5, "{tried}");
}

/// One frame has no others to learn from, and none confirms itself: learned from in advance or not at all, its answer is the same.
#[test]
fn a_frame_alone_does_not_confirm_itself() {
    let ball = Ball::new(crate::common::random_pattern(12, 5));
    let view = ProtocolName::Clutter.view();
    let frames = observed_frames(ball.pattern(), &view, 17, 8);
    let mut compared = 0;
    for frame in frames {
        let answer = |order| {
            let mut answers = Answers::default();
            let learning = LearningConfig {
                order,
                ..LearningConfig::default()
            };
            let frames = [Ok(frame.clone())].into_iter();
            let base = RobustConfig::default();
            identify_learning(
                &ball,
                &base,
                &learning,
                frames,
                NonZero::<usize>::MIN,
                &mut answers,
            )
            .unwrap();
            let one = answers.0.pop().unwrap();
            one.identification().map(|i| i.confidence)
        };
        let in_advance = answer(LearningOrder::InAdvance);
        assert_eq!(in_advance, answer(LearningOrder::AsTheyCome));
        compared += usize::from(in_advance.is_some());
    }
    assert!(compared > 4, "{compared}");
}
