//! The angles of a sequence's orientations on the circle that they share, and what readings of its times explain them: see
//! [`super::clock`].

use std::f64::consts::{PI, TAU};

use super::belief::Circle;
use super::clock::{TIE, TimesReading, counted, evened};
use super::motion::ConstantSpin;
use super::robust::{SpinConfig, TimeOrigin};
use super::{MIN_FRAMES, Measurement};

/// Longest sequence that is read in another way than its times say, and the shortest: of fewer orientations any is explained.
const MAX_READ: usize = 1024;
const MIN_READ: usize = 16;
/// Share of the orientations that must be on the circle.
const MIN_ON_CIRCLE: f64 = 0.8;
/// Evidence, natural logarithm, by which a reading must explain the angles better than chance: its rate and its kind are
/// found among some thousands, and odds of 20 to 1 must be left.
const MIN_GAIN: f64 = 12.0;
/// Probability that a step is of no reading.
const STRAY: f64 = 0.01;
/// Shares of steps with another count than the times say.
const SHARES: [f64; 3] = [0.03, 0.15, 0.5];
/// Counts that are tried: one interval less, and one or two more.
const SLIPS: [i64; 4] = [0, -1, 1, 2];
/// Of more of the steps it is another order that the counts explain; where every third frame is lost it is half of them.
const MAX_SLIPPED: f64 = 0.6;
/// Times are on a grid of intervals where they are off it by less, intervals.
const ON_LATTICE: f64 = 0.1;
/// Scatters of times that are tried, intervals.
const SCATTERS: [f64; 6] = [0.02, 0.05, 0.1, 0.2, 0.35, 0.5];
/// Angles times rates that a reading may cost.
const MAX_WORK: f64 = 4e6;
/// Longest sequence that is put in order.
const MAX_ORDERED: usize = 100;

/// The angles of a sequence's orientations on the circle that they share.
pub(super) struct Angles<'a> {
    measurements: &'a [Measurement],
    config: &'a SpinConfig,
    circle: Circle,
    /// Indices of those on the circle, and their angles.
    on: Vec<usize>,
    angles: Vec<f64>,
}

impl<'a> Angles<'a> {
    pub fn of(measurements: &'a [Measurement], config: &'a SpinConfig) -> Option<Self> {
        if !(MIN_READ..=MAX_READ).contains(&measurements.len()) {
            return None;
        }
        let circle = Circle::searched(measurements, config.noise())?;
        let on: Vec<usize> = (0..measurements.len())
            .filter(|k| circle.is_on(&measurements[*k]))
            .collect();
        let enough = MIN_ON_CIRCLE * measurements.len() as f64;
        (on.len() as f64 >= enough).then(|| Self {
            measurements,
            config,
            circle,
            angles: on.iter().map(|k| circle.angle(&measurements[*k])).collect(),
            on,
        })
    }

    fn on_circle(&self) -> impl Iterator<Item = &Measurement> + Clone {
        self.on.iter().map(|k| &self.measurements[*k])
    }

    fn sigma_rad(&self, m: &Measurement) -> f64 {
        self.circle.sigma_rad * m.sigma_scale
    }

    /// The reading that frames are lost or added.
    pub fn slipped(&self, given: TimesReading) -> Option<TimesReading> {
        let frames: Vec<Measurement> = self.on_circle().copied().collect();
        let (counts, interval) = counted(&frames, ON_LATTICE)?;
        let steps: Vec<AngleStep> = (1..frames.len())
            .map(|i| AngleStep {
                angle: self.angles[i] - self.angles[i - 1],
                variance: self.sigma_rad(&frames[i]).powi(2)
                    + self.sigma_rad(&frames[i - 1]).powi(2),
                count: counts[i] - counts[i - 1],
            })
            .collect();
        let (turn, share) = best_turn(&steps, self.circle.sigma_rad)?;
        let (mut now, mut moved) = (0, 0);
        let mut reading = TimesReading {
            measurements: vec![frames[0]],
            kept: vec![given.kept[self.on[0]]],
            ..given
        };
        let (mut shown, mut taken) = (vec![frames[0]], vec![0]);
        for (i, step) in steps.iter().enumerate() {
            let slip = step.slip(turn, share);
            reading.ln_prior += slip_prior(slip, share).ln();
            now += step.count + slip;
            moved += usize::from(slip != 0);
            if step.count + slip > 0 {
                reading.measurements.push(Measurement {
                    time_s: frames[0].time_s + interval * now as f64,
                    ..frames[i + 1]
                });
                reading.kept.push(given.kept[self.on[i + 1]]);
                shown.push(frames[i + 1]);
                taken.push(now);
            }
        }
        reading.clock.slipped = moved;
        // A video shows each image at the time of its own that is next: those at which they were taken are rounded to its grid.
        if self.config.times == TimeOrigin::Video && moved > 0 {
            let even = evened(&shown, &taken, interval)?;
            reading.clock.rate_ratio = Some(interval / even.interval_s);
            reading.config.clock_rate_std = even.rate_std;
            for (m, count) in reading.measurements.iter_mut().zip(&taken) {
                m.time_s = even.at(*count);
            }
        }
        let is_few = moved as f64 <= MAX_SLIPPED * steps.len() as f64;
        (moved > 0 && is_few && reading.measurements.len() >= MIN_FRAMES).then_some(reading)
    }

    /// The reading that the times scatter about those of a steady turn.
    pub fn scattered(&self, mut given: TimesReading) -> Option<TimesReading> {
        let frames: Vec<Measurement> = self.on_circle().copied().collect();
        let n = frames.len();
        let duration = frames[n - 1].time_s - frames[0].time_s;
        let limit = TAU * self.config.max_rps;
        let step = TAU / (8.0 * duration);
        let nodes = (limit / step).floor();
        if 2.0 * nodes * (n * SCATTERS.len()) as f64 > MAX_WORK {
            return None;
        }
        let middle = 0.5 * (frames[0].time_s + frames[n - 1].time_s);
        let interval = duration / (n - 1) as f64;
        let mut all: Vec<(f64, f64, f64, f64)> = Vec::new();
        for node in -(nodes as i64)..=nodes as i64 {
            let rate = node as f64 * step;
            let residuals = |start: f64| {
                let pairs = frames.iter().zip(&self.angles);
                pairs.map(move |(m, angle)| wrapped(angle - start - rate * (m.time_s - middle)))
            };
            let (sin, cos) =
                residuals(0.0).fold((0.0, 0.0), |(s, c), r| (s + r.sin(), c + r.cos()));
            let start = sin.atan2(cos);
            for scatter in SCATTERS {
                let std = rate * scatter * interval;
                let terms = residuals(start).zip(&frames).map(|(off, m)| {
                    let variance = self.sigma_rad(m).powi(2) + std * std;
                    ((1.0 - STRAY) * normal(off, variance) + STRAY / TAU).ln()
                });
                let worth = terms.sum::<f64>() + self.config.ln_prior(rate.abs() / TAU);
                all.push((worth, rate, start, scatter * interval));
            }
        }
        let best = all.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
        let (worth, rate, start, scatter_s) = best;
        let rival = all
            .iter()
            .filter(|a| (a.1 - rate).abs() > 2.5 * TAU / duration);
        let rival = rival.map(|a| a.0).fold(f64::NEG_INFINITY, f64::max);
        let gain = worth - self.config.ln_prior(rate.abs() / TAU) + n as f64 * TAU.ln();
        if gain < MIN_GAIN || worth - rival < TIE {
            return None;
        }
        let sigma_rad = self.circle.sigma_rad;
        for m in &mut given.measurements {
            m.sigma_scale = m.sigma_scale.hypot(rate * scatter_s / sigma_rad);
        }
        given.config.sigma_rad = sigma_rad;
        given.config.sigma_degrees = f64::INFINITY;
        given.ln_prior = -MIN_GAIN;
        given.clock.scatter_s = Some(scatter_s);
        given.start = Some(ConstantSpin {
            time_s: middle,
            orientation: self.circle.at(start),
            spin: self.circle.axis() * rate,
        });
        Some(given)
    }

    /// Revolutions per second of the even turn that has these angles in another order.
    pub fn in_order_rps(&self) -> Option<f64> {
        let frames: Vec<Measurement> = self.on_circle().copied().collect();
        let (counts, interval) = counted(&frames, ON_LATTICE)?;
        // As they are off the circle: what was expected would make every place near.
        let squares: f64 = frames.iter().map(|m| self.circle.square_off(m)).sum();
        let sigma = (squares / (2 * frames.len() - 4) as f64).sqrt().max(1e-4);
        let (n, span) = (frames.len(), counts[counts.len() - 1] as f64);
        let tolerance = 4.5 * std::f64::consts::SQRT_2 * sigma;
        let step = 2.0 * sigma / span;
        let nodes = (PI / step).ceil();
        // By chance one of these would have all angles within reach.
        let chance = n as f64 * (2.0 * tolerance * n as f64 / TAU).min(1.0).ln();
        if n > MAX_ORDERED || chance + (nodes * n as f64).ln() > -7.0 {
            return None;
        }
        // Every angle has its place, and every place its angle.
        let fits = |turn: f64, offset: f64| {
            let is_near =
                |angle: &f64, k: &i64| wrapped(angle - offset - turn * *k as f64).abs() < tolerance;
            let angles = || self.angles.iter();
            angles().all(|angle| counts.iter().any(|k| is_near(angle, k)))
                && counts
                    .iter()
                    .all(|k| angles().any(|angle| is_near(angle, k)))
        };
        (1..=nodes as i64)
            .map(|i| i as f64 * step)
            .find_map(|turn| {
                let mut offsets = counts.iter().map(|k| self.angles[0] - turn * *k as f64);
                let found = offsets.any(|offset| fits(turn, offset));
                found.then_some(turn / TAU / interval)
            })
    }
}

/// From one orientation on the circle to the next.
struct AngleStep {
    angle: f64,
    variance: f64,
    /// Intervals by the times.
    count: i64,
}

impl AngleStep {
    /// What each slip explains of it, with its share.
    fn weights(&self, turn: f64, share: f64) -> impl Iterator<Item = (i64, f64)> {
        SLIPS.into_iter().filter_map(move |slip| {
            let count = self.count + slip;
            let off = wrapped(self.angle - turn * count as f64);
            let weight = slip_prior(slip, share) * normal(off, self.variance);
            (count >= 0).then_some((slip, weight))
        })
    }

    /// The likeliest slip.
    fn slip(&self, turn: f64, share: f64) -> i64 {
        let likeliest = self.weights(turn, share).max_by(|a, b| a.1.total_cmp(&b.1));
        likeliest.map_or(0, |(slip, _)| slip)
    }
}

/// Probability of a slip where this share of the steps has one.
fn slip_prior(slip: i64, share: f64) -> f64 {
    match slip {
        0 => 1.0 - share,
        _ => share / (SLIPS.len() - 1) as f64,
    }
}

/// The turn in one interval, with the share of slips, that explains the steps better than chance and any other turn.
fn best_turn(steps: &[AngleStep], sigma_rad: f64) -> Option<(f64, f64)> {
    let spacing = (0.5 * sigma_rad).max(1e-3);
    let nodes = (PI / spacing).ceil() as i64;
    let worth = |turn: f64, share: f64| -> f64 {
        let one = |step: &AngleStep| {
            let right: f64 = step.weights(turn, share).map(|(_, w)| w).sum();
            ((1.0 - STRAY) * right + STRAY / TAU).ln()
        };
        steps.iter().map(one).sum()
    };
    let all: Vec<(f64, f64, f64)> = (-nodes..nodes)
        .flat_map(|i| {
            let turn = i as f64 * spacing;
            SHARES.map(|share| (worth(turn, share), turn, share))
        })
        .collect();
    let (top, turn, share) = all.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let others = all
        .iter()
        .filter(|a| wrapped(a.1 - turn).abs() > 6.0 * sigma_rad);
    let rival = others.map(|a| a.0).fold(f64::NEG_INFINITY, f64::max);
    let gain = top + steps.len() as f64 * TAU.ln();
    (gain > MIN_GAIN && top - rival > TIE).then_some((turn, share))
}

/// An angle within half a turn.
fn wrapped(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}

/// The normal density.
fn normal(off: f64, variance: f64) -> f64 {
    (-0.5 * off * off / variance).exp() / (TAU * variance).sqrt()
}
