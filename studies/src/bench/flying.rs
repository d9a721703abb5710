//! Clips of two and three flying balls of different tables: are all found, does each keep its name?

use cpu_time::ThreadTime;
use rayon::prelude::*;
use spindoe::clip::{BallEstimate, BallsEstimator, missing_balls, number_balls};
use spindoe::pattern::Pattern;
use spindoe::spin::robust::SpinConfig;
use spindoe::stats::Proportion;
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{BallTruth, ClipConfig, SynthSequence};
use spindoe::validate::ORIENTATION_FAILURE_RAD;
use spindoe::vision::{Budget, FrameEstimate, Prior};
use spindoe_studies::frames::estimator;
use spindoe_studies::score::mean;
use spindoe_studies::table::{Table, figure};
use spindoe_studies::{Outcome, row};

use spindoe::camera::is_at;

/// The tables that a ball may have.
const TABLES: [&str; 3] = [
    "designs/dots20/pattern.csv",
    "designs/dots24/pattern.csv",
    "designs/dots32/pattern.csv",
];
/// Balls of which less is visible are not counted as missed.
const SEEN: f64 = 0.5;
const BALL_PX: f64 = 60.0;

/// The balls of each frame, and what is found of them.
type TruthAndFound = (Vec<Vec<BallTruth>>, Vec<Vec<BallEstimate>>);

/// What became of a clip.
#[derive(Default)]
struct Flown {
    balls: usize,
    visible: u64,
    found: u64,
    posed: u64,
    wrong: u64,
    other_table: u64,
    invented: u64,
    /// Numbers that were given to two balls, and balls with two numbers.
    swapped: u64,
    split: u64,
    /// Numbered balls whose table by all frames is wrong.
    misnamed: u64,
    named: u64,
    ms: f64,
    alone_ms: f64,
}

pub fn run(clips: u64, count: usize, seed: u64, failures: bool) -> Outcome {
    let patterns = TABLES
        .iter()
        .map(|path| Pattern::read_csv(path.as_ref()))
        .collect::<spindoe::Result<Vec<_>>>()?;
    let estimators = patterns.iter().map(estimator);
    let estimators = estimators.collect::<spindoe::Result<Vec<_>>>()?;
    let all = BallsEstimator::new(estimators, None)?;
    println!("{clips} clips of {count} frames, seed {seed}, balls of {BALL_PX} px, 3 tables");
    let flown = (0..clips)
        .into_par_iter()
        .map(|k| {
            clip(
                &all,
                &patterns,
                seed + k,
                2 + (k % 2) as usize,
                count,
                failures,
            )
        })
        .collect::<spindoe::Result<Vec<Flown>>>()?;
    let table = Table::new([
        "balls",
        "clips",
        "visible balls found",
        "with a pose",
        "poses wrong",
        "of another table",
        "invented",
        "clips with swapped names",
        "clips with a ball of two numbers",
        "numbered balls with the wrong table",
        "one ball, ms",
        "all balls, ms",
    ]);
    for balls in [2, 3] {
        let some: Vec<&Flown> = flown.iter().filter(|f| f.balls == balls).collect();
        let sum = |of: fn(&Flown) -> u64| some.iter().map(|f| of(f)).sum::<u64>();
        let clips = |is: fn(&Flown) -> bool| {
            let count = some.iter().filter(|f| is(f)).count();
            Proportion::new(count as u64, some.len() as u64)
        };
        let posed = sum(|f| f.posed) + sum(|f| f.invented);
        row!(
            table; balls, some.len(),
            Proportion::new(sum(|f| f.found), sum(|f| f.visible)),
            Proportion::new(sum(|f| f.posed), sum(|f| f.visible)),
            Proportion::new(sum(|f| f.wrong) + sum(|f| f.invented), posed),
            sum(|f| f.other_table), sum(|f| f.invented),
            clips(|f| f.swapped > 0), clips(|f| f.split > 0),
            Proportion::new(sum(|f| f.misnamed), sum(|f| f.named)),
            figure(mean(&some, |f| f.alone_ms), 2, ""),
            figure(mean(&some, |f| f.ms), 2, "")
        );
    }
    Ok(())
}

fn clip(
    all: &BallsEstimator,
    patterns: &[Pattern],
    seed: u64,
    balls: usize,
    count: usize,
    failures: bool,
) -> spindoe::Result<Flown> {
    let config = SynthConfig {
        ball_px: Some([BALL_PX; 2]),
        max_off_axis_rad: 0.0,
        rps: [10.0, 80.0],
        // Fields of view of up to 56 degrees over 640 pixels.
        camera_distance_radii: [20.0, 60.0],
        ..SynthConfig::good()
    };
    let timing = ClipConfig {
        fps: 350.0,
        exposure_s: Some(2e-4),
        ..ClipConfig::default()
    };
    let clip = SynthSequence::of_balls(&patterns[..balls], &config, &timing, seed, count)?;
    let mut flown = Flown {
        balls,
        ..Flown::default()
    };
    let (truths, mut frames) = flown.estimated(all, &clip, count)?;
    let times: Vec<f64> = (0..count).map(|k| k as f64 / timing.fps).collect();
    let numbered = number_balls(SpinConfig::default(), &times, &mut frames);
    // Which balls each number was given to.
    let mut given: Vec<Vec<u64>> = vec![vec![0; balls]; numbered.tables.len()];
    for ((truth, found), numbers) in truths.iter().zip(&frames).zip(&numbered.numbers) {
        flown.judge_frame(truth, found, numbers, &mut given, failures.then_some(seed));
    }
    flown.judge_numbers(&given, &numbered.tables);
    Ok(flown)
}

impl Flown {
    /// The clip's truth, and what is found in it, with a second look where balls are missing; its costs are remembered.
    fn estimated(
        &mut self,
        all: &BallsEstimator,
        clip: &SynthSequence,
        count: usize,
    ) -> spindoe::Result<TruthAndFound> {
        let mut ws = all.workspace()?;
        let mut own = all.estimators()[0].workspace();
        let (mut truths, mut frames) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let (mut images, mut times) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let budget = Budget::default();
        for k in 0..count {
            let frame = clip.frame(k)?;
            let gray = frame.image.to_gray();
            let mut out = FrameEstimate::default();
            let begun = ThreadTime::now();
            all.estimators()[0].estimate(&gray, &Prior::default(), &budget, &mut own, &mut out);
            self.alone_ms += 1e3 * begun.elapsed().as_secs_f64() / count as f64;
            let begun = ThreadTime::now();
            frames.push(all.estimate(&gray, None, &[], &budget, &mut ws));
            self.ms += 1e3 * begun.elapsed().as_secs_f64() / count as f64;
            times.extend(frame.truth.time_s);
            truths.push(frame.truth.balls);
            images.push(gray);
        }
        let begun = ThreadTime::now();
        let missing = missing_balls(SpinConfig::default(), &times, &frames);
        for ((image, balls), expected) in images.iter().zip(&mut frames).zip(&missing) {
            let before = std::mem::take(balls);
            *balls = all.look_again(image, before, expected, &budget, &mut ws);
        }
        self.ms += 1e3 * begun.elapsed().as_secs_f64() / count as f64;
        Ok((truths, frames))
    }

    /// Counts what is right in a frame, and to which balls numbers were `given`; of the clip `said` each failure is printed.
    fn judge_frame(
        &mut self,
        truth: &[BallTruth],
        found: &[BallEstimate],
        numbers: &[Option<usize>],
        given: &mut [Vec<u64>],
        said: Option<u64>,
    ) {
        for image in truth {
            let is_seen = image.area_visible >= SEEN;
            self.visible += u64::from(is_seen);
            let there = found.iter().zip(numbers).filter(|(b, _)| {
                // Where one ball is before another, what is found is the one in front.
                let at = truth.iter().filter(|t| is_at(b, t));
                let shown = at.max_by(|a, b| a.area_visible.total_cmp(&b.area_visible));
                shown.is_some_and(|t| t.ball == image.ball)
            });
            let Some((ball, number)) = there.max_by_key(|(b, _)| b.frame.pose().is_some()) else {
                if let Some(seed) = said.filter(|_| is_seen) {
                    say_missed(seed, image, found);
                }
                continue;
            };
            self.found += u64::from(is_seen);
            let Some(pose) = ball.frame.pose() else {
                continue;
            };
            self.posed += u64::from(is_seen);
            let is_other = ball.table != image.ball;
            let error = pose.rotation.angle_to(&image.orientation());
            let is_wrong = is_other || error > ORIENTATION_FAILURE_RAD;
            if let Some(seed) = said.filter(|_| is_wrong) {
                eprintln!(
                    "clip {seed}: ball {} as {}: {:.2} rad, {:.3}",
                    image.ball, ball.table, error, pose.confidence
                );
            }
            self.wrong += u64::from(is_wrong);
            self.other_table += u64::from(is_other);
            if let Some(number) = number {
                given[*number][image.ball] += 1;
            }
        }
        let posed = found.iter().filter(|b| b.frame.pose().is_some());
        for ball in posed.filter(|b| !truth.iter().any(|t| is_at(b, t))) {
            self.invented += 1;
            if let Some(seed) = said {
                let off = truth.iter().map(|t| distance(ball, t));
                let off: Vec<_> = off.collect();
                eprintln!("clip {seed}: invented table {}, {off:.1?}", ball.table);
            }
        }
    }

    fn judge_numbers(&mut self, given: &[Vec<u64>], tables: &[(usize, f64)]) {
        let was_given = |to: &&Vec<u64>| to.iter().filter(|n| **n > 0).count() > 1;
        self.swapped = given.iter().filter(was_given).count() as u64;
        let numbers_of = |ball: usize| given.iter().filter(|to| to[ball] > 0).count();
        self.split = (0..self.balls).filter(|b| numbers_of(*b) > 1).count() as u64;
        for (to, (table, _)) in given.iter().zip(tables) {
            let most = (0..self.balls).max_by_key(|b| to[*b]);
            if let Some(ball) = most.filter(|b| to[*b] > 0) {
                self.named += 1;
                self.misnamed += u64::from(ball != *table);
            }
        }
    }
}

fn say_missed(seed: u64, image: &BallTruth, found: &[BallEstimate]) {
    let near = found.iter().filter_map(|b| {
        let c = b.circle()?;
        let off = (c.center.u - image.center.u).hypot(c.center.v - image.center.v);
        (off < image.radius_px).then_some((off, c.radius, b.frame.pose().is_some()))
    });
    eprintln!(
        "clip {seed}: ball {} of radius {:.1} with {:.2} of its area and {:.2} of its rim is missed; near it {:.1?}",
        image.ball,
        image.radius_px,
        image.area_visible,
        image.rim_visible,
        near.collect::<Vec<_>>()
    );
}

/// How far a ball that is found is from a true one, and both radii, pixels.
fn distance(ball: &BallEstimate, truth: &BallTruth) -> (f64, f64, f64) {
    let found = ball.circle();
    let found = found.unwrap_or(spindoe::vision::BallCircle::new(truth.center, 0.0));
    let (a, b) = (found.center, truth.center);
    ((a.u - b.u).hypot(a.v - b.v), found.radius, truth.radius_px)
}
