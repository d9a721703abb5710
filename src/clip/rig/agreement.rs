//! Whether the cameras of a rig agree as a whole: their stated places, their clocks, which clip is whose.
//!
//! A camera's orientations `R_j`, in the rig's frame by its stated extrinsics, are compared with those `M(t_j)` of the first camera, by its
//! spin `w`, or where it has none by its frames of the same times. Were the camera turned by `E` against what is stated, and its
//! clock behind by `d`, all frames would show the same
//!
//! ```text
//! C = R_j M(t_j)^-1 = E exp(w d)
//! ```
//!
//! `C` is split into the turn about the spin's axis, which a clock explains, up to whole turns of the ball, and the rest, which only other
//! extrinsics do. Of the delays that whole turns leave open the positions over time choose. Positions that then lie apart speak for
//! other extrinsics, too.
//!
//! Guarantees: clips that fit as they are stated are left alone. Not guaranteed: a clock's delay of a ball at rest, or of one that
//! stays in place and has turned a whole number of times: that is said.

use std::f64::consts::TAU;

use super::fuse::{CameraReading, Widening, fuse};
use super::pairs::{CameraTrack, Group, by_time, reach_s, step_s};
use crate::geometry::{Rotation, Vec3, toward_mean};
use crate::stats::median;

/// Turns and places below these are those of calibrations: they are counted as errors. Beyond they are wrong.
const MAX_TURN_RAD: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// Turns about the spin's axis that are a calibration's as likely as a clock's.
const SMALL_RAD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// As a part of the distance.
const MAX_GAP: f64 = 0.05;
/// Standard deviations beyond which something is not chance.
const EVIDENT: f64 = 4.0;
/// Orientations that are candidates for what all have in common.
const CANDIDATES: usize = 32;
/// How far orientations may be off what they have in common, radians, beyond their noise.
const NEAR_RAD: f64 = 0.03;
/// Orientations of which this share has nothing in common are of no one motion.
const MIN_SHARE: f64 = 0.5;
/// Frames of both that it takes to say anything of a whole clip.
const MIN_PAIRS: usize = 3;
/// A ball that turns by this angle shows other dots: frames within it have their errors alike, of dots that are off their places.
const ANOTHER_VIEW_RAD: f64 = 1.0;
/// How much larger errors are than stated before any clip shows it, as a ratio of variances, and the frames that this is worth: centers and
/// orientations of rendered balls are off by 1.1 to 1.4 times as much in good conditions, by 2.5 in all (docs/measurements/position.md).
const USUAL_RATIO: f64 = 2.0;
const USUAL_FRAMES: f64 = 4.0;
/// Whole turns of the ball that a delay may be off by, to either side.
const MAX_TURNS: i64 = 400;
/// Delays whose positions differ by less than this much chi-squared are not distinguished.
const OPEN: f64 = 9.0;
/// Standard deviation of what two cameras see a ball apart in all frames alike, of its distance: edges that are blurred.
const ALIKE: f64 = 0.01;
/// Medians of chi-square with three degrees of freedom.
const MEDIAN_3: f64 = 2.366;

/// The clock of a camera beside the first one's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ClockCheck {
    /// It is as stated, to within the deviation.
    Agrees {
        /// Standard deviation, seconds.
        std_s: f64,
    },
    /// It is off, and corrected.
    Off {
        /// What is added to its times beyond what is stated, seconds.
        delay_s: f64,
        /// Standard deviation, seconds.
        std_s: f64,
        /// The time of a turn, seconds, where delays that differ by it are as likely.
        repeats_s: Option<f64>,
    },
    /// It cannot be known: the ball is at rest or moves in no even way, or frames have no times.
    Unknown,
}

/// How a camera agrees with the first one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraAgreement {
    /// Orientations that were compared.
    pub compared: usize,
    /// By what rotation the camera is turned against its stated place, as an angle, radians.
    pub turn_rad: f64,
    /// Its standard deviation about an axis, radians.
    pub turn_std_rad: f64,
    /// How far apart both see the ball, m; `None` where positions are not known.
    pub gap_m: Option<f64>,
    /// Its clock.
    pub clock: ClockCheck,
    /// How much larger the differences of orientations and positions are than their covariances say.
    pub factors: [f64; 2],
}

impl CameraAgreement {
    /// How a camera of this name agrees with the first one, a line each.
    pub fn words(&self, name: &str, first: &str) -> Vec<String> {
        let gap = self
            .gap_m
            .map_or(String::new(), |gap| format!(", {:.1} mm apart", 1e3 * gap));
        let is_evident = self.turn_rad > EVIDENT * self.turn_std_rad;
        let so = if is_evident {
            ": counted as an error"
        } else {
            ""
        };
        let turn_deg = self.turn_rad.to_degrees();
        let agree = format!("{name} and {first} agree within {turn_deg:.2} deg{gap}{so}");
        std::iter::once(agree)
            .chain(self.clock.words(name, first))
            .collect()
    }
}

impl ClockCheck {
    /// What is to be known of the clock of a camera of this name.
    pub fn words(&self, name: &str, first: &str) -> Option<String> {
        match *self {
            Self::Agrees { .. } => None,
            Self::Off {
                delay_s,
                std_s,
                repeats_s,
            } => {
                let or = repeats_s.map_or(String::new(), |turn_s| {
                    format!(
                        ", or that and any number of {:.3} ms, the time of a turn",
                        1e3 * turn_s
                    )
                });
                Some(format!(
                    "the clock of {name} is off: {:.4} +- {:.4} ms are added to its times{or}",
                    1e3 * delay_s,
                    1e3 * std_s
                ))
            }
            Self::Unknown => Some(format!(
                "whether the clocks of {name} and {first} agree is not known: the ball does not turn evenly, or frames have no times"
            )),
        }
    }
}

/// What is wrong between two cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Discord {
    /// They follow no one motion.
    Apart { share: f64 },
    /// One is turned against its stated place.
    Turned { angle_rad: f64, std_rad: f64 },
    /// They see the ball in different places.
    Gap { gap_m: f64, distance_m: f64 },
}

/// A camera beside the first one: what is to be corrected and how far it is off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Compared {
    pub agreement: CameraAgreement,
    pub discord: Option<Discord>,
    /// What is added to its times.
    pub delay_s: f64,
    pub widening: Widening,
}

/// A rotation that all frames have in common.
#[derive(Debug, Clone, Copy)]
struct Common {
    rotation: Rotation,
    /// About an axis, radians.
    std_rad: f64,
    compared: usize,
    share: f64,
}

/// The angle between what a rotation turns about an axis and the whole, and the rotation left: `rotation = rest * turn about axis`.
fn about(rotation: &Rotation, axis: &Vec3) -> (f64, Rotation) {
    let q = rotation.into_inner();
    let mut angle = 2.0 * q.imag().dot(axis).atan2(q.w);
    angle -= TAU * (angle / TAU).round();
    let rest = rotation * Rotation::from_scaled_axis(axis * angle).inverse();
    (angle, rest)
}

/// What most of the differences have in common, of a ball that has turned by this angle meanwhile.
fn common(differences: &[(Rotation, f64)], turned_rad: f64) -> Option<Common> {
    let stride = differences.len().div_ceil(CANDIDATES).max(1);
    let near = |center: &Rotation, (rotation, variance): &(Rotation, f64)| {
        center.angle_to(rotation) < NEAR_RAD + EVIDENT * (2.0 * variance).sqrt()
    };
    let count = |center: &Rotation| differences.iter().filter(|d| near(center, d)).count();
    let candidates = differences.iter().step_by(stride).map(|d| d.0);
    let mut center = candidates.max_by_key(|center| count(center))?;
    let mut std_rad = f64::INFINITY;
    let mut compared = 0;
    for _ in 0..4 {
        let within: Vec<_> = differences.iter().filter(|d| near(&center, d)).collect();
        compared = within.len();
        let weight = |v: f64| 1.0 / v.max(1e-12);
        let total: f64 = within.iter().map(|(_, v)| weight(*v)).sum();
        center = toward_mean(&center, within.iter().map(|(r, v)| (*r, weight(*v))));
        let squares = within.iter().map(|(r, _)| r.angle_to(&center).powi(2));
        let scattered = squares.sum::<f64>() / 3.0 / (compared.max(2) - 1) as f64;
        let stated = compared as f64 / total;
        let views = (1.0 + turned_rad / ANOTHER_VIEW_RAD).min(compared as f64);
        std_rad = (scattered.max(stated) / views.max(1.0)).sqrt();
    }
    Some(Common {
        rotation: center,
        std_rad,
        compared,
        share: compared as f64 / differences.len() as f64,
    })
}

/// By how much each orientation of `other` is turned against `first`, with the variance about an axis.
fn differences(first: &CameraTrack, other: &CameraTrack) -> Vec<(Rotation, f64)> {
    let variance = |reading: &CameraReading| reading.block(0, 0).trace() / 3.0;
    if let (Some(fit), Some([from, to])) = (&first.fit, first.span_s()) {
        let sigma = fit.sigma_rad.unwrap_or(0.0) / (fit.inliers.max(1) as f64).sqrt();
        let step = step_s(&first.times_s());
        let inside = |t: f64| (from - step..=to + step).contains(&t);
        let own = other.readings.iter().filter(|(t, _)| inside(*t));
        return own
            .filter_map(|(t, reading)| {
                let turn = reading.rotation? * fit.motion.at(*t).inverse();
                Some((turn, variance(reading) + sigma * sigma))
            })
            .collect();
    }
    let groups = paired(first, other);
    let both = groups.iter().filter_map(|group| {
        let [(_, a), (_, b)] = members(group, first, other)?;
        Some((
            b.rotation? * a.rotation?.inverse(),
            variance(a) + variance(b),
        ))
    });
    both.collect()
}

/// Frames of both, of one time.
fn paired(first: &CameraTrack, other: &CameraTrack) -> Vec<Group> {
    let times = [first.times_s(), other.times_s()];
    let reach = reach_s(step_s(&times[0]), first.fit.is_some());
    by_time(&times, reach)
}

/// What both say at one time, each with its own.
fn members<'a>(
    group: &Group,
    first: &'a CameraTrack,
    other: &'a CameraTrack,
) -> Option<[&'a (f64, CameraReading); 2]> {
    let [Some(a), Some(b)] = group.members[..] else {
        return None;
    };
    Some([&first.readings[a], &other.readings[b]])
}

/// How far apart two cameras see the ball at the same times.
struct Apart {
    mean_m: Vec3,
    /// Along an axis, m.
    std_m: f64,
    /// Of the mean, with what all frames have alike.
    chi2: f64,
    compared: usize,
    distance_m: f64,
}

fn apart(first: &CameraTrack, other: &CameraTrack, delay_s: f64) -> Option<Apart> {
    let gaps = other.readings.iter().filter_map(|(t, reading)| {
        let place = first.place(t + delay_s)?;
        let own = reading.center_m?;
        let variance = place.variance + reading.block(3, 3).trace() / 3.0;
        Some((own - place.center_m, variance, own.norm()))
    });
    let gaps: Vec<(Vec3, f64, f64)> = gaps.collect();
    if gaps.is_empty() {
        return None;
    }
    let middle = |f: &dyn Fn(&(Vec3, f64, f64)) -> f64| {
        let mut values: Vec<f64> = gaps.iter().map(f).collect();
        median(&mut values)
    };
    let mean_m = Vec3::new(middle(&|g| g.0.x), middle(&|g| g.0.y), middle(&|g| g.0.z));
    // What an outline is off by is much alike in all frames.
    let (std_m, distance_m) = (middle(&|g| g.1).sqrt(), middle(&|g| g.2));
    Some(Apart {
        mean_m,
        std_m,
        chi2: mean_m.norm_squared() / (std_m * std_m + (ALIKE * distance_m).powi(2)),
        compared: gaps.len(),
        distance_m,
    })
}

/// The delay of a camera's clock, of those that the orientations leave open the one by which positions meet.
fn delay_by_places(
    first: &CameraTrack,
    other: &CameraTrack,
    delay_s: f64,
    turn_s: f64,
) -> (f64, bool) {
    let span = |track: &CameraTrack| track.span_s().map_or(0.0, |[from, to]| to - from);
    let reach = span(first).max(span(other));
    let most = ((reach / turn_s) as i64).min(MAX_TURNS);
    let mut tried: Vec<(f64, Option<f64>)> = (-most..=most)
        .map(|k| delay_s + turn_s * k as f64)
        .map(|delay| {
            let apart = apart(first, other, delay);
            // Delays that leave few frames in common say nothing.
            let apart = apart.filter(|a| 2 * a.compared >= other.readings.len());
            (delay, apart.map(|a| a.chi2))
        })
        .collect();
    tried.sort_by(|a, b| a.0.abs().total_cmp(&b.0.abs()));
    let Some(least) = tried.iter().filter_map(|(_, chi2)| *chi2).reduce(f64::min) else {
        return (delay_s, false);
    };
    let likely = |chi2: &Option<f64>| chi2.is_some_and(|chi2| chi2 < least + OPEN);
    let mut open = tried.iter().filter(|(_, chi2)| likely(chi2));
    let nearest = open.next().map_or(delay_s, |(delay, _)| *delay);
    (nearest, open.next().is_none())
}

impl Common {
    /// A turn from which on it is evident, radians.
    fn evident_rad(&self) -> f64 {
        EVIDENT * self.std_rad
    }

    /// Whether the cameras contradict each other, by the turn that no clock explains and by how far apart the centers are.
    fn discord(&self, turn_rad: f64, apart: Option<&Apart>) -> Option<Discord> {
        if self.share < MIN_SHARE {
            return Some(Discord::Apart { share: self.share });
        }
        if turn_rad > MAX_TURN_RAD.max(self.evident_rad()) {
            return Some(Discord::Turned {
                angle_rad: self.rotation.angle(),
                std_rad: self.std_rad,
            });
        }
        let far = apart.filter(|a| {
            let gap = a.mean_m.norm();
            gap > MAX_GAP * a.distance_m && gap > EVIDENT * a.std_m
        });
        far.map(|a| Discord::Gap {
            gap_m: a.mean_m.norm(),
            distance_m: a.distance_m,
        })
    }
}

/// What the turn between two cameras says of their clocks.
struct Clocks {
    /// The turn that these leave.
    rest: Rotation,
    /// How far the camera's times are behind the first one's, seconds.
    delay_s: f64,
    clock: ClockCheck,
}

impl Clocks {
    fn of(first: &CameraTrack, other: &CameraTrack, found: &Common) -> Self {
        let same = |clock| Self {
            rest: found.rotation,
            delay_s: 0.0,
            clock,
        };
        let Some(fit) = first.fit.filter(|fit| !fit.is_at_rest()) else {
            return same(ClockCheck::Unknown);
        };
        let (spin, evident) = (fit.motion.spin, found.evident_rad());
        let rate = spin.norm();
        let (turned, rest) = about(&found.rotation, &(spin / rate));
        // The camera's times are behind where its ball is ahead.
        let (delay, std_s, turn_s) = (turned / rate, found.std_rad / rate, TAU / rate);
        let (delay_s, is_sure) = delay_by_places(first, other, delay, turn_s);
        let is_off = delay_s.abs() * rate > SMALL_RAD.max(evident);
        if !is_off || rest.angle() >= MAX_TURN_RAD.max(evident) {
            return same(ClockCheck::Agrees { std_s });
        }
        Self {
            rest,
            delay_s,
            clock: ClockCheck::Off {
                delay_s,
                std_s,
                repeats_s: (!is_sure).then_some(turn_s),
            },
        }
    }
}

/// How a camera agrees with the first one, by what each saw in the rig's frame; `None` where too little was seen by both.
pub(super) fn compare(first: &CameraTrack, other: &CameraTrack) -> Option<Compared> {
    let turned_rad = match (&first.fit, first.span_s()) {
        (Some(fit), Some([from, to])) => fit.motion.spin.norm() * (to - from),
        _ => 0.0,
    };
    let found = common(&differences(first, other), turned_rad)?;
    if found.compared < MIN_PAIRS {
        return None;
    }
    let read = Clocks::of(first, other, &found);
    let placed = apart(first, other, read.delay_s);
    let gap_m = placed.as_ref().map(|a| a.mean_m.norm());
    let turn_rad = read.rest.angle();
    let discord = found.discord(turn_rad, placed.as_ref());
    let evident = found.evident_rad();
    let evident_gap = placed.filter(|a| a.mean_m.norm() > EVIDENT * a.std_m);
    let mut widening = Widening {
        factors: [1.0; 2],
        variances: [
            if turn_rad > evident {
                turn_rad * turn_rad / 3.0
            } else {
                0.0
            },
            evident_gap.map_or(0.0, |a| a.mean_m.norm_squared() / 3.0),
        ],
    };
    let mut later = other.clone();
    later.delay(read.delay_s);
    widening.factors = factors(first, &later, &widening);
    Some(Compared {
        agreement: CameraAgreement {
            compared: found.compared,
            turn_rad,
            turn_std_rad: found.std_rad,
            gap_m,
            clock: read.clock,
            factors: widening.factors,
        },
        discord,
        delay_s: read.delay_s,
        widening,
    })
}

/// How much larger the differences of rotations and of centers are than stated: by their medians, which wrong frames do not move.
fn factors(first: &CameraTrack, other: &CameraTrack, widening: &Widening) -> [f64; 2] {
    let groups = paired(first, other);
    let mut of_turns = Vec::new();
    let mut of_centers = Vec::new();
    let both = groups.iter().filter_map(|g| members(g, first, other));
    for [(at, a), (seen, b)] in both {
        let later = first
            .drift(*at)
            .map_or(*b, |drift| b.moved(at - seen, &drift));
        let later = later.widened(&Widening {
            factors: [1.0; 2],
            ..*widening
        });
        let turn_alone = |r: &CameraReading| CameraReading {
            center_m: None,
            ..*r
        };
        if a.rotation.is_some() && b.rotation.is_some() {
            of_turns.extend(fuse(&[turn_alone(a), turn_alone(&later)]).map(|f| f.chi2));
        }
        if a.center_m.is_some() && b.center_m.is_some() {
            let both = [a.center_alone(), later.center_alone()];
            of_centers.extend(fuse(&both).map(|f| f.chi2));
        }
    }
    let factor = |mut chi2: Vec<f64>| {
        let count = chi2.len() as f64;
        let seen = count * median(&mut chi2) / MEDIAN_3;
        let ratio = (seen + USUAL_FRAMES * USUAL_RATIO) / (count + USUAL_FRAMES);
        ratio.max(1.0).sqrt()
    };
    [factor(of_turns), factor(of_centers)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spin::motion::ConstantSpin;
    use nalgebra::{Matrix3, Matrix6, Vector6};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::StandardNormal;

    const SIGMA_RAD: f64 = 0.004;
    const SIGMA_M: f64 = 5e-4;

    /// What a camera sees of a ball that turns and flies, by its own clock `late_s` behind, with its place wrong by `turn`.
    fn track(seed: u64, late_s: f64, turn: Vec3, velocity: Vec3, spin: Vec3) -> CameraTrack {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut normal =
            |sigma: f64| Vec3::from_fn(|_, _| sigma * rng.sample::<f64, _>(StandardNormal));
        let covariance = Vector6::from_fn(|k, _| if k < 3 { SIGMA_RAD } else { SIGMA_M }.powi(2));
        let error = Rotation::from_scaled_axis(turn);
        let motion = ConstantSpin {
            time_s: 0.0,
            orientation: Rotation::from_scaled_axis(Vec3::new(0.3, 0.8, -0.2)),
            spin,
        };
        let readings = (0..40).map(|k| {
            let time_s = k as f64 / 350.0;
            let noise = Rotation::from_scaled_axis(normal(SIGMA_RAD));
            let center = Vec3::new(0.1, 0.0, -1.0) + velocity * time_s;
            let reading = CameraReading {
                rotation: Some(noise * error * motion.at(time_s)),
                center_m: Some(error * (center + normal(SIGMA_M))),
                covariance: Matrix6::from_diagonal(&covariance),
                confidence: 0.95,
                hinted: false,
            };
            (time_s - late_s, reading)
        });
        let fit = crate::spin::Fit {
            motion: ConstantSpin {
                time_s: -late_s,
                orientation: error * motion.orientation,
                spin: error * spin,
            },
            spin_covariance: Some(Matrix3::from_diagonal_element(0.01)),
            sigma_rad: Some(SIGMA_RAD),
            log_likelihood: None,
            inliers: 40,
            lack_of_fit: None,
        };
        CameraTrack {
            readings: readings.collect(),
            fit: Some(fit),
        }
    }

    const SPIN: Vec3 = Vec3::new(150.0, 90.0, -40.0);
    const FLIGHT: Vec3 = Vec3::new(3.0, 0.5, 1.0);

    #[test]
    fn cameras_as_stated_agree() {
        let first = track(1, 0.0, Vec3::zeros(), FLIGHT, SPIN);
        let other = track(2, 0.0, Vec3::zeros(), FLIGHT, SPIN);
        let found = compare(&first, &other).expect("both saw the ball");
        assert_eq!((found.discord, found.delay_s), (None, 0.0));
        assert!(matches!(found.agreement.clock, ClockCheck::Agrees { std_s } if std_s < 1e-5));
        assert!(found.widening.factors.iter().all(|f| *f < 1.5), "{found:?}");
    }

    #[test]
    fn a_clock_that_is_late_is_found_with_its_error() {
        // By a fraction of a turn, and by two turns and more: the flight tells these apart.
        for late_s in [0.0021, -0.0104, 0.0743] {
            let first = track(3, 0.0, Vec3::zeros(), FLIGHT, SPIN);
            let other = track(4, late_s, Vec3::zeros(), FLIGHT, SPIN);
            let found = compare(&first, &other).expect("both saw the ball");
            let ClockCheck::Off {
                delay_s,
                std_s,
                repeats_s,
            } = found.agreement.clock
            else {
                panic!("{late_s}: {found:?}");
            };
            assert!(
                (delay_s - late_s).abs() < 4.0 * std_s,
                "{delay_s} +- {std_s}"
            );
            assert!(
                std_s < 2e-5 && repeats_s.is_none() && found.discord.is_none(),
                "{found:?}"
            );
        }
    }

    #[test]
    fn a_ball_in_its_place_leaves_whole_turns_open_and_one_at_rest_all() {
        let still = Vec3::zeros();
        let [first, other] =
            [(5, 0.0), (6, 0.0021)].map(|(s, late)| track(s, late, still, still, SPIN));
        let found = compare(&first, &other).expect("both saw the ball");
        let ClockCheck::Off {
            repeats_s: Some(turn_s),
            ..
        } = found.agreement.clock
        else {
            panic!("{found:?}");
        };
        assert!((turn_s - TAU / SPIN.norm()).abs() < 1e-9);
        let [first, other] =
            [(7, 0.0), (8, 0.0021)].map(|(s, late)| track(s, late, still, still, still));
        let found = compare(&first, &other).expect("both saw the ball");
        assert_eq!(found.agreement.clock, ClockCheck::Unknown);
    }

    #[test]
    fn a_camera_that_is_turned_is_found() {
        let first = track(9, 0.0, Vec3::zeros(), FLIGHT, SPIN);
        let turn = Vec3::new(-0.05, 0.1, 0.12);
        let found =
            compare(&first, &track(10, 0.0, turn, FLIGHT, SPIN)).expect("both saw the ball");
        let Some(Discord::Turned { angle_rad, std_rad }) = found.discord else {
            panic!("{found:?}");
        };
        assert!(
            (angle_rad - turn.norm()).abs() < 4.0 * std_rad && std_rad < 2e-3,
            "{found:?}"
        );
        // About the spin's axis it looks like a late clock, but for the positions.
        let about = SPIN.normalize() * 0.2;
        let found =
            compare(&first, &track(11, 0.0, about, FLIGHT, SPIN)).expect("both saw the ball");
        assert!(
            matches!(found.discord, Some(Discord::Gap { .. })),
            "{found:?}"
        );
    }
}
