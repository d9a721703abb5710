//! Several balls from frame to frame: each keeps its number.
//!
//! What a track expects of a ball, and what a frame shows of it, differ by
//!
//! ```text
//! cost = (|c - c'| / s)^2 + (ln(r / r') / q)^2 - 2 ln sum_k p_k p'_k + min((angle / a)^2, m)
//! ```
//!
//! with the center and radius by the straight path of the last outlines, `p` the probabilities of the tables, and the angle between the
//! orientation and the one that the spin of the track's poses predicts, where both are there. The numbers are those that cost least
//! together. Where paths cross, table and orientation decide, since positions do not.
//!
//! Guarantees: the order of a frame's balls changes nothing; a number is never used twice. Not guaranteed: that two balls of the same
//! table keep their numbers where they cross while neither has a pose.

use std::collections::VecDeque;

use super::balls::BallEstimate;
use crate::geometry::Rotation;
use crate::spin::robust::{RobustEstimator, SpinConfig};
use crate::spin::{MIN_INTERVAL_S, Measurement};
use crate::vision::optics::camera::BallCircle;
use crate::vision::outline::path::{OutlineMotion, along};

/// Deviation of a center from its expected place, radii: of a track with a path, and of one seen once.
const OFF: [f64; 2] = [0.15, 1.5];
/// Each frame in which a ball was not seen adds so much, radii.
const LOST: f64 = 0.3;
/// Deviation of the logarithm of the radius.
const RADIUS: f64 = 0.08;
/// Probability that a table is wrong in spite of all evidence: such a ball rather begins a track than takes another's name.
const WRONG_TABLE: f64 = 1e-7;
/// Deviation of an expected orientation, radians, and the most that it can cost: by a spin of a few poses, and of many.
const TURNED: (f64, [f64; 2]) = (0.3, [12.0, 30.0]);
const MANY: usize = 5;
/// A ball whose cost is beyond this begins a new track.
const NEW: f64 = 30.0;
/// Frames after which a ball that is not seen is forgotten.
const PATIENCE: usize = 30;
/// Poses from which the spin is fitted.
const POSES: usize = 8;
/// The least ln probability that one frame gives a table.
const LEAST_LN: f64 = -6.0;
/// Frames from which on a ball with one pose alone is not confirmed.
const LONG: usize = 5;
/// Poses from which a ball that is missing in a frame is looked for, and frames before its first and after its last ones.
const CONFIRMED: usize = 3;
const BEYOND: usize = 3;
/// Balls beyond this number are assigned one after the other.
const MAX_TOGETHER: usize = 7;

/// A ball that is followed.
#[derive(Debug, Clone)]
struct Track {
    number: usize,
    motion: OutlineMotion,
    seen: usize,
    missed: usize,
    /// Sums of the ln probabilities of the tables.
    ln_tables: Vec<f64>,
    poses: VecDeque<(usize, Measurement)>,
}

/// Follows the balls of one camera's frames.
#[derive(Debug, Clone)]
pub struct BallTracks {
    tracks: Vec<Track>,
    next: usize,
    fitter: RobustEstimator,
}

impl BallTracks {
    /// No ball is followed yet. Expected orientations are those of spins by these settings.
    pub fn new(spin: SpinConfig) -> Self {
        Self {
            tracks: Vec::new(),
            next: 0,
            fitter: RobustEstimator::new(spin),
        }
    }

    /// The outlines that are expected at a time, seconds, of the balls that were seen in the last frames.
    pub fn expected(&self, time_s: f64) -> Vec<BallCircle> {
        let followed = self.tracks.iter().filter(|t| t.seen > 1);
        followed.filter_map(|t| t.motion.predict(time_s)).collect()
    }

    /// The numbers of the balls of the next frame, from 0, in order of their appearance; `time_s` is later than that of the frame
    /// before. A ball without an outline has none.
    pub fn update(&mut self, time_s: f64, balls: &[BallEstimate]) -> Vec<Option<usize>> {
        let costs: Vec<Vec<f64>> = balls.iter().map(|b| self.costs(time_s, b)).collect();
        let taken = assign(&costs, self.tracks.len());
        for track in &mut self.tracks {
            track.missed += 1;
        }
        let numbered = balls.iter().zip(taken).map(|(ball, track)| {
            let circle = ball.circle()?;
            let track = match track {
                Some(k) => k,
                None => self.begin(ball),
            };
            Some(self.learn(track, time_s, ball, circle))
        });
        let numbers = numbered.collect();
        self.tracks.retain(|t| t.missed <= PATIENCE);
        numbers
    }

    /// The table of a numbered ball by all frames that showed it, with its probability; none of a ball that is forgotten.
    pub fn table(&self, number: usize) -> Option<(usize, f64)> {
        let ln = &self.tracks.iter().find(|t| t.number == number)?.ln_tables;
        let most = ln.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = ln.iter().map(|l| (l - most).exp()).sum();
        let best = ln.iter().position(|l| *l == most)?;
        Some((best, 1.0 / sum))
    }

    /// Takes back the poses of the last frame's balls that are by another table than all frames of their ball speak for; `numbers`
    /// are those of [`BallTracks::update`].
    pub fn reject_foreign(&self, balls: &mut [BallEstimate], numbers: &[Option<usize>]) {
        for (ball, number) in balls.iter_mut().zip(numbers) {
            let table = number.and_then(|n| self.table(n));
            if table.is_some_and(|(table, _)| table != ball.table) {
                ball.frame.reject_pose();
            }
        }
    }

    /// How many balls were numbered so far.
    pub fn count(&self) -> usize {
        self.next
    }

    /// What a ball costs as the next of each track.
    fn costs(&mut self, time_s: f64, ball: &BallEstimate) -> Vec<f64> {
        let Some(circle) = ball.circle() else {
            return vec![f64::INFINITY; self.tracks.len()];
        };
        let Self { tracks, fitter, .. } = self;
        let cost = |track: &Track| {
            let Some(expected) = track.motion.predict(time_s) else {
                return f64::INFINITY;
            };
            let (a, b) = (circle.center, expected.center);
            let apart = (a.u - b.u).hypot(a.v - b.v) / expected.radius;
            let off = OFF[usize::from(track.seen == 1)] + LOST * track.missed as f64;
            let size = (circle.radius / expected.radius).ln() / RADIUS;
            let place = (apart / off).powi(2) + size * size;
            place + track.table_cost(ball) + track.turn_cost(time_s, ball, fitter)
        };
        tracks.iter().map(cost).collect()
    }

    fn begin(&mut self, ball: &BallEstimate) -> usize {
        self.tracks.push(Track {
            number: self.next,
            motion: OutlineMotion::default(),
            seen: 0,
            missed: 0,
            ln_tables: vec![0.0; ball.tables.len()],
            poses: VecDeque::with_capacity(POSES + 1),
        });
        self.next += 1;
        self.tracks.len() - 1
    }

    /// The track's number, after it has learned what the frame shows.
    fn learn(&mut self, k: usize, time_s: f64, ball: &BallEstimate, circle: BallCircle) -> usize {
        let track = &mut self.tracks[k];
        track.motion.push(time_s, circle);
        (track.missed, track.seen) = (0, track.seen + 1);
        if ball.frame.pose().is_some() {
            for (sum, p) in track.ln_tables.iter_mut().zip(&ball.tables) {
                *sum += p.ln().max(LEAST_LN);
            }
        }
        if let Some(pose) = ball.frame.pose().filter(|p| !p.hinted) {
            if track.poses.len() == POSES {
                track.poses.pop_front();
            }
            let measured = Measurement {
                confidence: pose.confidence,
                ..Measurement::new(time_s, pose.rotation)
            };
            track.poses.push_back((ball.table, measured));
        }
        track.number
    }
}

impl Track {
    fn table_cost(&self, ball: &BallEstimate) -> f64 {
        let most = self
            .ln_tables
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = self.ln_tables.iter().map(|l| (l - most).exp()).collect();
        let sum: f64 = weights.iter().sum();
        let pairs = weights.iter().zip(&ball.tables);
        let same: f64 = pairs.map(|(w, p)| w / sum * p).sum();
        // Tables of which nothing is known are no evidence.
        let by_chance = 1.0 / self.ln_tables.len().max(1) as f64;
        -2.0 * ((same + WRONG_TABLE) / by_chance.max(WRONG_TABLE))
            .ln()
            .min(0.0)
    }

    fn turn_cost(&self, time_s: f64, ball: &BallEstimate, fitter: &mut RobustEstimator) -> f64 {
        let Some(pose) = ball.frame.pose() else {
            return 0.0;
        };
        let expected = self.predict(time_s, ball.table, fitter);
        expected.map_or(0.0, |expected| {
            let off = expected.angle_to(&pose.rotation) / TURNED.0;
            let is_sure = self.poses.len() >= MANY;
            (off * off).min(TURNED.1[usize::from(is_sure)])
        })
    }

    /// The orientation that the spin of the last poses leads to.
    fn predict(&self, time_s: f64, table: usize, fitter: &mut RobustEstimator) -> Option<Rotation> {
        let of_table = self.poses.iter().filter(|(t, _)| *t == table);
        let mut measured: Vec<Measurement> = of_table.map(|(_, m)| *m).collect();
        measured.dedup_by(|a, b| a.time_s - b.time_s < MIN_INTERVAL_S);
        let fit = fitter.fit(&measured).ok()?;
        Some(fit.motion.at(time_s))
    }
}

/// The track of each ball, each at most once, such that all costs together are least; without one a ball costs [`NEW`].
fn assign(costs: &[Vec<f64>], tracks: usize) -> Vec<Option<usize>> {
    let mut best = (f64::INFINITY, vec![None; costs.len()]);
    let mut chosen = vec![None; costs.len()];
    let mut taken = vec![false; tracks];
    if costs.len() <= MAX_TOGETHER {
        search(costs, 0, 0.0, &mut chosen, &mut taken, &mut best);
        return best.1;
    }
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (ball, row) in costs.iter().enumerate() {
        pairs.extend(row.iter().enumerate().map(|(track, c)| (*c, ball, track)));
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    for (_, ball, track) in pairs.into_iter().filter(|p| p.0 < NEW) {
        if chosen[ball].is_none() && !taken[track] {
            (chosen[ball], taken[track]) = (Some(track), true);
        }
    }
    chosen
}

fn search(
    costs: &[Vec<f64>],
    ball: usize,
    so_far: f64,
    chosen: &mut Vec<Option<usize>>,
    taken: &mut Vec<bool>,
    best: &mut (f64, Vec<Option<usize>>),
) {
    if so_far >= best.0 {
        return;
    }
    let Some(row) = costs.get(ball) else {
        *best = (so_far, chosen.clone());
        return;
    };
    for (track, cost) in row.iter().enumerate() {
        if !taken[track] && *cost < NEW {
            (taken[track], chosen[ball]) = (true, Some(track));
            search(costs, ball + 1, so_far + cost, chosen, taken, best);
            (taken[track], chosen[ball]) = (false, None);
        }
    }
    search(costs, ball + 1, so_far + NEW, chosen, taken, best);
}

/// The balls of the frames of one sequence, numbered; see [`number_balls`].
#[derive(Debug, Clone)]
pub struct NumberedBalls {
    /// For each frame the numbers of its balls, in their order; none for a frame that shows no outline.
    pub numbers: Vec<Vec<Option<usize>>>,
    /// For each number the table that all its frames speak for, with its probability.
    pub tables: Vec<(usize, f64)>,
}

/// Numbers the balls of all frames of a sequence. A pose by another table than all frames of its ball speak for is taken back, and so is
/// that of a ball which has a pose in one of many frames only: of several tables a wrong one fits by accident now and then.
pub fn number_balls(
    spin: SpinConfig,
    times_s: &[f64],
    frames: &mut [Vec<BallEstimate>],
) -> NumberedBalls {
    let mut tracks = BallTracks::new(spin);
    let mut tables: Vec<(usize, f64)> = Vec::new();
    let timed = times_s.iter().zip(frames.iter());
    let numbers: Vec<Vec<Option<usize>>> = timed
        .map(|(time_s, balls)| {
            let numbers = tracks.update(*time_s, balls);
            // A track that is lost is forgotten: what was known of its table is kept here.
            tables.resize(tracks.count(), (0, 1.0));
            for number in numbers.iter().flatten() {
                tables[*number] = tracks.table(*number).unwrap_or((0, 1.0));
            }
            numbers
        })
        .collect();
    let mut posed = vec![0; tracks.count()];
    let all = frames.iter().flatten().zip(numbers.iter().flatten());
    for (_, number) in all.filter(|(ball, _)| ball.frame.pose().is_some()) {
        if let Some(number) = number {
            posed[*number] += 1;
        }
    }
    let has_several = frames.iter().flatten().any(|b| b.tables.len() > 1);
    let is_long = frames.len() >= LONG && has_several;
    for (balls, numbers) in frames.iter_mut().zip(&numbers) {
        for (ball, number) in balls.iter_mut().zip(numbers) {
            let is_foreign = |n: usize| tables[n].0 != ball.table || (is_long && posed[n] < 2);
            if number.is_some_and(is_foreign) {
                ball.frame.reject_pose();
            }
        }
    }
    NumberedBalls { numbers, tables }
}

/// Where balls of a sequence are missing: for each frame the outlines that those have by the frames before and after it, within a
/// gap on the straight line between its ends, and beyond a ball's first and last frames on its path. Balls with fewer than
/// three poses are not looked for. They are what [`BallsEstimator::look_again`](super::balls::BallsEstimator::look_again) takes.
pub fn missing_balls(
    spin: SpinConfig,
    times_s: &[f64],
    frames: &[Vec<BallEstimate>],
) -> Vec<Vec<BallCircle>> {
    let mut tracks = BallTracks::new(spin);
    let mut seen: Vec<Vec<(usize, BallCircle)>> = Vec::new();
    let mut posed: Vec<usize> = Vec::new();
    for (k, (time_s, balls)) in times_s.iter().zip(frames).enumerate() {
        let numbers = tracks.update(*time_s, balls);
        seen.resize(tracks.count(), Vec::new());
        posed.resize(tracks.count(), 0);
        for (ball, number) in balls.iter().zip(numbers) {
            if let (Some(number), Some(circle)) = (number, ball.circle()) {
                seen[number].push((k, circle));
                posed[number] += usize::from(ball.frame.pose().is_some());
            }
        }
    }
    let mut missing = vec![Vec::new(); frames.len()];
    let confirmed = seen.iter().zip(posed).filter(|(_, n)| *n >= CONFIRMED);
    for (seen, _) in confirmed {
        let mut expect = |a: usize, b: usize, k: usize| {
            let ((from, first), (to, last)) = (seen[a], seen[b]);
            let share = (times_s[k] - times_s[from]) / (times_s[to] - times_s[from]);
            missing[k].push(between(&first, &last, share));
        };
        for (a, pair) in seen.windows(2).enumerate() {
            for k in pair[0].0 + 1..pair[1].0 {
                expect(a, a + 1, k);
            }
        }
        let last = seen.len() - 1;
        for k in (seen[0].0.saturating_sub(BEYOND)..seen[0].0).rev() {
            expect(0, 1, k);
        }
        for k in seen[last].0 + 1..(seen[last].0 + 1 + BEYOND).min(frames.len()) {
            expect(last - 1, last, k);
        }
    }
    missing
}

/// The outline at a part of the way from one to another.
fn between(a: &BallCircle, b: &BallCircle, share: f64) -> BallCircle {
    let circle = along(a, b, share);
    BallCircle {
        eccentricity: a.eccentricity.lerp(&b.eccentricity, share.clamp(0.0, 1.0)),
        radius: circle.radius.max(0.5 * a.radius),
        ..circle
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;
    use crate::geometry::Vec3;
    use crate::vision::frame::estimate::{FrameEstimate, Pose};
    use crate::vision::optics::camera::Pixel;

    #[test]
    fn the_cheapest_assignment_together_is_taken() {
        // The first ball's own favorite costs the second one more than it gains.
        let costs = [vec![1.0, 2.0], vec![1.5, 20.0]];
        assert_eq!(assign(&costs, 2), [Some(1), Some(0)]);
        // A ball that fits no track begins one.
        let costs = [vec![f64::INFINITY, 2.0], vec![31.0, 2.5]];
        assert_eq!(assign(&costs, 2), [Some(1), None]);
        assert_eq!(assign(&[vec![]], 0), [None]);
        // Many balls at once, each nearest to its own track.
        let cost = |ball: usize, track: usize| 9.0 * (ball as f64 - track as f64).powi(2);
        let many: Vec<Vec<f64>> = (0..9)
            .map(|b| (0..9).map(|t| cost(8 - b, t)).collect())
            .collect();
        let expected: Vec<_> = (0..9).rev().map(Some).collect();
        assert_eq!(assign(&many, 9), expected);
    }

    /// Two balls that meet in one place: each keeps its number by how it turns.
    #[test]
    fn balls_that_meet_are_told_apart_by_their_turns() {
        let ball = |u: f64, angle: f64| {
            let pose = Pose {
                rotation: Rotation::from_scaled_axis(Vec3::x() * angle),
                covariance: Matrix3::from_diagonal_element(1e-4),
                dots_confidence: 0.99,
                confidence: 0.99,
                residual_rad: 0.01,
                residual_px: 0.3,
                distance: None,
                view: None,
                position: None,
                hinted: false,
            };
            let frame = FrameEstimate {
                circle: Some(BallCircle::new(Pixel { u, v: 50.0 }, 20.0)),
                outcome: Ok(pose),
                ..FrameEstimate::default()
            };
            BallEstimate::of(frame, 0)
        };
        // One turns to and the other fro; they move toward each other.
        let pair = |k: f64| [ball(100.0 + k, 0.2 * k), ball(114.0 - k, 2.0 - 0.2 * k)];
        let mut tracks = BallTracks::new(SpinConfig::default());
        for k in 0..7 {
            let k = f64::from(k);
            assert_eq!(tracks.update(0.01 * k, &pair(k)), [Some(0), Some(1)]);
        }
        let [one, other] = pair(7.0);
        assert_eq!(tracks.update(0.07, &[other, one]), [Some(1), Some(0)]);
    }
}
