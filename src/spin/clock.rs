//! The clock of a sequence, examined: what is wrong with its times is said, and mended where the orientations say how.
//!
//! | what is wrong | how it shows | what is done |
//! |---|---|---|
//! | images that repeat the one before | equal orientations among others that differ | they are left out; where they repeat as in a clip that was brought to a higher rate, the others were taken at even times |
//! | times on a coarse grid | even times, rounded: no other explains all steps | the even times are taken; their rate has the error that rounding leaves |
//! | frames lost or added, the others numbered on | steps of the turn that are whole multiples of one | the times are moved by whole intervals; of a video's own times, whose duration is right, the intervals are shortened or lengthened |
//! | times that scatter | angles that scatter about a steady turn, more the faster it is | the orientations have that error along the turn |
//! | a wrong order | the angles are those of an even turn, in another order | it is said; there is no spin |
//!
//! The first two are looked for beforehand. The others are readings of a sequence whose orientations turn about one axis but
//! follow no motion at the given times (`belief`): the angles on their circle are then compared with each reading's, and
//! one that explains them better than random angles do, by more than its free numbers may, is tried. Whatever it leads to must
//! be believed on its own.
//!
//! Not guaranteed: that a reading which fits is right. Frames that lose every second one, evenly, are a slower camera's.

use super::angles::Angles;
use super::belief::Belief;
use super::motion::ConstantSpin;
use super::robust::SpinConfig;
use super::{MIN_FRAMES, Measurement, SpinRejection};

/// Images are equal where their orientations differ by less, radians (a file of six decimals rounds to 1e-6) ...
const EQUAL_RAD: f64 = 1e-5;
/// ... and the median of the other steps by more: noise of a hundredth of a degree.
const DIFFERENT_RAD: f64 = 1e-4;
/// Grids that times are rounded to, seconds.
const GRIDS_S: [f64; 3] = [1e-2, 1e-3, 1e-4];
/// Even times are off their rounded ones by half a grid, and a fit of them by a little more.
const MAX_ROUNDED: f64 = 0.6;
/// Off by less in the mean square, times are even as they are.
const MIN_ROUNDED: f64 = 0.05;
/// Times that show whether they are rounded.
const MIN_ROUNDED_TIMES: usize = 8;
/// From so many repeated images on they may be those of a clip that was brought to a higher rate: then they repeat regularly.
const MIN_RESAMPLED: usize = 3;
/// Along the turn the orientations are off by so many times as much as across it where the times are in doubt though a motion
/// holds: of noise that is the same in all directions ten frames are so once in a hundred thousand times.
const LOPSIDED: f64 = 3.0;
/// Readings that differ by less do not decide.
pub(super) const TIE: f64 = 3.0;

/// What was found wrong with the times of a sequence, and mended.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Clock {
    /// Images that repeat the one before, left out.
    pub repeated: usize,
    /// The grid that even times are rounded to, seconds.
    pub grid_s: Option<f64>,
    /// Steps that are longer or shorter than the times say, by whole intervals.
    pub slipped: usize,
    /// Of a video whose steps are such: the rate at which its images were taken over that at which it shows them. Its
    /// duration is kept.
    pub rate_ratio: Option<f64>,
    /// Standard deviation by which times are off, seconds.
    pub scatter_s: Option<f64>,
}

impl Clock {
    /// Whether nothing was found.
    pub fn is_right(&self) -> bool {
        *self == Self::default()
    }

    /// What was found, one line each.
    pub fn words(&self) -> Vec<String> {
        let mut words = Vec::new();
        if self.repeated > 0 {
            words.push(format!(
                "{} of the images repeat the one before: they are left out, and the times of the others kept",
                self.repeated
            ));
        }
        if let Some(grid_s) = self.grid_s {
            words.push(format!(
                "the times are even ones rounded to {grid_s} s: the even ones are taken, and their error counted"
            ));
        }
        if let Some(ratio) = self.rate_ratio {
            words.push(format!(
                "at {} steps the ball turns a whole multiple of the others, or not at all: the video was brought to another \
                 rate, its images were taken at {ratio:.3} times that rate, and its duration is kept",
                self.slipped
            ));
        } else if self.slipped > 0 {
            words.push(format!(
                "at {} steps the ball turns a whole multiple of the others, or not at all: frames are lost or repeated there \
                 though the times go on, and the spin is that with the times moved by whole intervals",
                self.slipped
            ));
        }
        if let Some(scatter_s) = self.scatter_s {
            words.push(format!(
                "the orientations lead or lag a steady turn as if the times were off by {:.2} ms; the deviations count it",
                1e3 * scatter_s
            ));
        }
        words
    }
}

/// Room for a look at the times, kept from one sequence to the next.
#[derive(Debug, Clone, Default)]
pub(super) struct Room {
    steps: Vec<f64>,
    counts: Vec<i64>,
    /// The sequence as it was read, where its clock is not right.
    pub reading: TimesReading,
}

impl Room {
    /// Makes room for a sequence of so many frames, which then needs no more whatever its clock says.
    fn reserve(&mut self, frames: usize) {
        let Self {
            steps,
            counts,
            reading,
        } = self;
        steps.clear();
        counts.clear();
        reading.kept.clear();
        reading.measurements.clear();
        steps.reserve(frames);
        counts.reserve(frames);
        reading.kept.reserve(frames);
        reading.measurements.reserve(frames);
    }

    /// The sequence as it was read last, `given` where nothing is wrong with its times.
    pub fn taken<'a>(&'a self, given: &'a [Measurement]) -> &'a [Measurement] {
        match self.reading.clock.is_right() {
            true => given,
            false => &self.reading.measurements,
        }
    }

    fn median_step(&mut self, steps: impl Iterator<Item = f64>) -> f64 {
        self.steps.clear();
        self.steps.extend(steps);
        crate::stats::median(&mut self.steps)
    }
}

/// A sequence with the times that are taken.
#[derive(Debug, Clone, Default)]
pub(super) struct TimesReading {
    pub clock: Clock,
    pub measurements: Vec<Measurement>,
    /// The index of each among those given.
    pub kept: Vec<usize>,
    /// The settings that go with it.
    pub config: SpinConfig,
    /// Where a fit starts, if that is known.
    pub start: Option<ConstantSpin>,
    /// Logarithm of the probability of so many changes beforehand.
    pub ln_prior: f64,
}

impl TimesReading {
    /// The sequence as given, without those that are left out.
    fn take(
        &mut self,
        given: &[Measurement],
        config: &SpinConfig,
        is_kept: impl Fn(usize) -> bool,
    ) {
        self.measurements.clear();
        self.kept.clear();
        self.kept.extend((0..given.len()).filter(|k| is_kept(*k)));
        let kept = self.kept.iter().map(|k| given[*k]);
        self.measurements.extend(kept);
        (self.config, self.start, self.ln_prior) = (*config, None, 0.0);
        self.clock.repeated = given.len() - self.kept.len();
    }
}

/// Fits a sequence as it is given, or as its clock says that it must be read; then it stands in `room`, and its clock is not right. `fit`
/// says how far its answer is believed.
pub(super) fn examined<T>(
    measurements: &[Measurement],
    config: &SpinConfig,
    room: &mut Room,
    mut fit: impl FnMut(
        &[Measurement],
        &SpinConfig,
        Option<&ConstantSpin>,
    ) -> Result<(T, Belief), SpinRejection>,
) -> Result<T, SpinRejection> {
    room.reserve(measurements.len());
    mend(measurements, config, room);
    let (taken, settings) = match room.reading.clock.is_right() {
        true => (measurements, config),
        false => (&room.reading.measurements[..], &room.reading.config),
    };
    let found = fit(taken, settings, None).and_then(|(found, belief)| {
        belief.check()?;
        Ok((found, belief))
    });
    let needed = match &found {
        Ok((_, belief)) if belief.along_over_across > LOPSIDED => Some(belief.gain() + TIE),
        Err(SpinRejection::NotAtTheseTimes { .. }) => Some(f64::NEG_INFINITY),
        _ => None,
    };
    let found = found.map(|(found, _)| found);
    let in_doubt = needed.and_then(|needed| Some((needed, Angles::of(taken, settings)?)));
    let Some((needed, angles)) = in_doubt else {
        return found;
    };
    let mut as_given = room.reading.clone();
    if as_given.clock.is_right() {
        as_given.take(measurements, config, |_| true);
    }
    for reading in [angles.slipped(as_given.clone()), angles.scattered(as_given)] {
        let Some(reading) = reading else {
            continue;
        };
        let start = reading.start.as_ref();
        let again = fit(&reading.measurements, &reading.config, start);
        if let Ok((again, belief)) = again
            && belief.check().is_ok()
            && belief.gain() + reading.ln_prior > needed
        {
            room.reading = reading;
            return Ok(again);
        }
    }
    match found {
        Err(SpinRejection::NotAtTheseTimes {
            agreeing, frames, ..
        }) => Err(SpinRejection::NotAtTheseTimes {
            agreeing,
            frames,
            in_order_rps: angles.in_order_rps(),
        }),
        found => found,
    }
}

/// Leaves repeated images out, and takes even times where they are rounded; the clock is right where nothing is to be mended.
fn mend(measurements: &[Measurement], config: &SpinConfig, room: &mut Room) {
    room.reading.clock = Clock::default();
    let is_repeated = |k: usize| k > 0 && turn(measurements, k) < EQUAL_RAD;
    if has_repeated(measurements, room) {
        room.reading.take(measurements, config, |k| !is_repeated(k));
    } else if rounding(measurements, room).is_some() {
        room.reading.take(measurements, config, |_| true);
    } else {
        return;
    }
    let taken = std::mem::take(&mut room.reading.measurements);
    let even = resampled(&taken, measurements, room).or_else(|| rounding(&taken, room));
    room.reading.measurements = taken;
    if let Some(even) = even {
        room.reading.clock.grid_s = Some(even.grid_s);
        room.reading.config.clock_rate_std = even.rate_std;
        for (m, count) in room.reading.measurements.iter_mut().zip(&room.counts) {
            m.time_s = even.at(*count);
        }
    }
}

/// The angle between an orientation and the one before.
fn turn(measurements: &[Measurement], k: usize) -> f64 {
    let [before, here] = [k - 1, k].map(|k| &measurements[k].orientation);
    before.angle_to(here)
}

/// Whether images repeat the one before, unless the ball is at rest.
fn has_repeated(measurements: &[Measurement], room: &mut Room) -> bool {
    let turns = || (1..measurements.len()).map(|k| turn(measurements, k));
    if !turns().any(|turn| turn < EQUAL_RAD) {
        return false;
    }
    let median = room.median_step(turns().filter(|turn| *turn >= EQUAL_RAD));
    room.steps.len() + 1 >= MIN_FRAMES && median >= DIFFERENT_RAD
}

/// Even times that were rounded.
pub(super) struct Rounding {
    grid_s: f64,
    /// Mean count, and time at it, seconds.
    middle: f64,
    mean_s: f64,
    pub interval_s: f64,
    /// Relative deviation of the rate that the rounded ones leave.
    pub rate_std: f64,
}

impl Rounding {
    /// Whether the grid is finer than the interval, so that no two times become one.
    fn is_fine(&self) -> bool {
        self.grid_s < self.interval_s
    }

    /// The even time of a count.
    pub fn at(&self, count: i64) -> f64 {
        self.mean_s + self.interval_s * (count as f64 - self.middle)
    }
}

/// The even times of which these are rounded; `None` where they are even already, or no even ones are.
fn rounding(measurements: &[Measurement], room: &mut Room) -> Option<Rounding> {
    if measurements.len() < MIN_ROUNDED_TIMES {
        return None;
    }
    let times = || measurements.iter().map(|m| m.time_s);
    let is_on = |grid: &f64| times().all(|t| (t / grid - (t / grid).round()).abs() < 1e-3);
    let grid_s = GRIDS_S.into_iter().find(is_on)?;
    lattice(measurements, 0.5, room)?;
    evened(measurements, &room.counts, grid_s).filter(Rounding::is_fine)
}

/// The even times of which these are rounded up or down to a grid, by their counts of the interval.
pub(super) fn evened(
    measurements: &[Measurement],
    counts: &[i64],
    grid_s: f64,
) -> Option<Rounding> {
    let times = || measurements.iter().map(|m| m.time_s);
    let n = measurements.len() as f64;
    let middle = counts.iter().sum::<i64>() as f64 / n;
    let mean_s = times().sum::<f64>() / n;
    let off = |k: &i64| *k as f64 - middle;
    let square: f64 = counts.iter().map(|k| off(k).powi(2)).sum();
    let products = counts
        .iter()
        .zip(times())
        .map(|(k, t)| off(k) * (t - mean_s));
    let interval_s = products.sum::<f64>() / square;
    let rounding = Rounding {
        grid_s,
        middle,
        mean_s,
        interval_s,
        rate_std: grid_s / (12.0 * square).sqrt() / interval_s,
    };
    let errors = || {
        let pairs = counts.iter().zip(times());
        pairs.map(|(k, t)| (t - rounding.at(*k)) / grid_s)
    };
    let largest = errors().map(f64::abs).fold(0.0, f64::max);
    let rms = (errors().map(|e| e * e).sum::<f64>() / n).sqrt();
    let is_rounded = largest < MAX_ROUNDED && rms > MIN_ROUNDED;
    is_rounded.then_some(rounding)
}

/// The even times at which the images were taken that a clip at another rate repeats, its own frames being the grid.
fn resampled(
    measurements: &[Measurement],
    given: &[Measurement],
    room: &mut Room,
) -> Option<Rounding> {
    if measurements.len() < MIN_ROUNDED_TIMES || given.len() - measurements.len() < MIN_RESAMPLED {
        return None;
    }
    let grid_s = lattice(given, 0.5, room)?;
    room.counts.clear();
    room.counts.extend(0..measurements.len() as i64);
    evened(measurements, &room.counts, grid_s).filter(Rounding::is_fine)
}

/// Counts of the interval that the times are multiples of, but for this share of it each; and that interval.
pub(super) fn counted(measurements: &[Measurement], off: f64) -> Option<(Vec<i64>, f64)> {
    let mut room = Room::default();
    let interval = lattice(measurements, off, &mut room)?;
    Some((room.counts, interval))
}

/// As [`counted`], with the counts in `room`.
fn lattice(measurements: &[Measurement], off: f64, room: &mut Room) -> Option<f64> {
    let steps = || measurements.windows(2).map(|w| w[1].time_s - w[0].time_s);
    let duration: f64 = steps().sum();
    // The shortest steps are one interval: a median of steps that are mostly longer is not.
    let shortest = steps().fold(f64::INFINITY, f64::min);
    let mut interval = room.median_step(steps()).min(1.5 * shortest);
    for _ in 0..4 {
        let total: f64 = steps().map(|s| (s / interval).round().max(1.0)).sum();
        interval = duration / total;
    }
    room.counts.clear();
    room.counts.push(0);
    let mut at = 0;
    for step in steps() {
        let count = (step / interval).round();
        if (step / interval - count).abs() > off || !(1.0..=1e6).contains(&count) {
            return None;
        }
        at += count as i64;
        room.counts.push(at);
    }
    Some(interval)
}
