//! Which frames of several cameras are of one time, and how the ball moves between times that are not quite the same.

use super::fuse::{CameraReading, Drift};
use crate::geometry::Vec3;
use crate::spin::Fit;
use crate::stats::median;

/// Times that differ by less, over the step from frame to frame, are one.
const SAME: f64 = 1e-3;
/// Frames to either side that show a velocity.
const AROUND: usize = 4;

/// Frames of one time: the number of each camera's, where it has one.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Group {
    /// Seconds, by the rig's clock; `None` where there are no times.
    pub time_s: Option<f64>,
    pub members: Vec<Option<usize>>,
}

/// Frames without times, by their numbers.
pub(super) fn by_number(counts: &[usize]) -> Vec<Group> {
    let most = counts.iter().copied().max().unwrap_or(0);
    let group = |k: usize| Group {
        time_s: None,
        members: counts.iter().map(|n| (k < *n).then_some(k)).collect(),
    };
    (0..most).map(group).collect()
}

/// The median step of times, seconds; 0 of fewer than two.
pub(super) fn step_s(times_s: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times_s.windows(2).map(|w| w[1] - w[0]).collect();
    median(&mut steps).max(0.0)
}

/// Frames by their times, those of each camera by the rig's clock and ascending: one that is within `reach_s` of another camera's and is
/// its nearest goes with it.
pub(super) fn by_time(times_s: &[Vec<f64>], reach_s: f64) -> Vec<Group> {
    let mut groups: Vec<Group> = Vec::new();
    for (camera, times) in times_s.iter().enumerate() {
        let known = groups.len();
        for (frame, time_s) in times.iter().enumerate() {
            let alone = || Group {
                time_s: Some(*time_s),
                members: (0..times_s.len())
                    .map(|c| (c == camera).then_some(frame))
                    .collect(),
            };
            let off = |group: &Group, time_s: f64| {
                group.time_s.map_or(f64::INFINITY, |t| (t - time_s).abs())
            };
            // Those before this camera's own are in order of time.
            let after = groups[..known].partition_point(|g| g.time_s < Some(*time_s));
            let near = [after.checked_sub(1), Some(after).filter(|k| *k < known)];
            let near = near.into_iter().flatten();
            let nearest =
                near.min_by(|a, b| off(&groups[*a], *time_s).total_cmp(&off(&groups[*b], *time_s)));
            let within = nearest.filter(|k| off(&groups[*k], *time_s) <= reach_s);
            let Some(k) = within else {
                groups.push(alone());
                continue;
            };
            match groups[k].members[camera] {
                // Two of one camera are nearest to one of another: the nearer goes with it.
                Some(earlier) if off(&groups[k], times[earlier]) <= off(&groups[k], *time_s) => {
                    groups.push(alone());
                }
                Some(earlier) => {
                    let mut other = alone();
                    other.time_s = Some(times[earlier]);
                    other.members[camera] = Some(earlier);
                    groups.push(other);
                    groups[k].members[camera] = Some(frame);
                }
                None => groups[k].members[camera] = Some(frame),
            }
        }
        groups.sort_by(|a, b| {
            let time = |g: &Group| g.time_s.unwrap_or(f64::INFINITY);
            time(a).total_cmp(&time(b))
        });
    }
    groups
}

/// How far frames may be apart to be of one time: half a step where the motion between them is known.
pub(super) fn reach_s(step_s: f64, is_motion_known: bool) -> f64 {
    step_s * if is_motion_known { 0.5 } else { SAME }
}

/// What one camera says of the ball over time, in the rig's frame and by its clock.
#[derive(Debug, Clone, Default)]
pub(super) struct CameraTrack {
    /// Ascending in time.
    pub readings: Vec<(f64, CameraReading)>,
    /// The spin of its frames, in the rig's frame and by its clock, where they have one.
    pub fit: Option<Fit>,
}

impl CameraTrack {
    /// Adds to all times.
    pub fn delay(&mut self, by_s: f64) {
        self.readings.iter_mut().for_each(|(t, _)| *t += by_s);
        if let Some(fit) = &mut self.fit {
            fit.motion.time_s += by_s;
        }
    }

    pub fn times_s(&self) -> Vec<f64> {
        self.readings.iter().map(|(t, _)| *t).collect()
    }

    /// Times of the first and last reading.
    pub fn span_s(&self) -> Option<[f64; 2]> {
        Some([self.readings.first()?.0, self.readings.last()?.0])
    }

    /// Where the ball is at a time and how fast it moves, with the variance of either along an axis, by a straight line through the
    /// readings nearest in time; `None` farther from them than their step.
    pub fn place(&self, time_s: f64) -> Option<PlacedBall> {
        let seen = |(t, reading): &(f64, CameraReading)| {
            Some((*t, reading.center_m?, reading.block(3, 3)))
        };
        let after = self.readings.partition_point(|(t, _)| *t < time_s);
        let from = after.saturating_sub(AROUND);
        let around = &self.readings[from..(after + AROUND).min(self.readings.len())];
        let around: Vec<_> = around.iter().filter_map(seen).collect();
        let (first, last) = (around.first()?, around.last()?);
        let step = (last.0 - first.0) / around.len().saturating_sub(1).max(1) as f64;
        if time_s < first.0 - step || time_s > last.0 + step {
            return None;
        }
        let n = around.len() as f64;
        let variance = around.iter().map(|(_, _, c)| c.trace() / 3.0).sum::<f64>() / n;
        let mean_s = around.iter().map(|(t, ..)| t).sum::<f64>() / n;
        let mean: Vec3 = around.iter().map(|(_, p, _)| p).sum::<Vec3>() / n;
        let square: f64 = around.iter().map(|(t, ..)| (t - mean_s).powi(2)).sum();
        let products: Vec3 = around.iter().map(|(t, p, _)| p * (t - mean_s)).sum();
        let (velocity, velocity_variance) = match square > 0.0 {
            true => (products / square, variance / square),
            false => (Vec3::zeros(), f64::INFINITY),
        };
        Some(PlacedBall {
            center_m: mean + velocity * (time_s - mean_s),
            variance: variance / n + velocity_variance.min(1e6) * (time_s - mean_s).powi(2),
            velocity_m_s: velocity,
            velocity_variance,
        })
    }

    /// How the ball moves at a time; `None` without a spin.
    pub fn drift(&self, time_s: f64) -> Option<Drift> {
        let fit = self.fit?;
        let place = self
            .place(time_s)
            .filter(|p| p.velocity_variance.is_finite());
        Some(Drift {
            spin: fit.motion.spin,
            spin_covariance: fit.spin_covariance.unwrap_or_default(),
            velocity_m_s: place.map_or(Vec3::zeros(), |p| p.velocity_m_s),
            velocity_variance: place.map_or(0.0, |p| p.velocity_variance),
        })
    }
}

/// A ball's place.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlacedBall {
    pub center_m: Vec3,
    /// Along each axis, m^2.
    pub variance: f64,
    pub velocity_m_s: Vec3,
    /// Along each axis, (m/s)^2.
    pub velocity_variance: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The variance of a straight line's value at a time, by least squares: `s^2 (1 / n + (t - m)^2 / sum (t_i - m)^2)`.
    #[test]
    fn a_place_is_less_certain_at_the_ends_of_its_line() {
        let at = |k: usize| {
            let reading = CameraReading {
                rotation: None,
                center_m: Some(Vec3::new(2.0 * k as f64, 0.0, -1.0)),
                covariance: nalgebra::Matrix6::identity() * 0.09,
                confidence: 0.9,
                hinted: false,
            };
            (k as f64, reading)
        };
        let track = CameraTrack {
            readings: (0..5).map(at).collect(),
            fit: None,
        };
        // Of the readings at 1, 2, 3 and 4 none is later: the four before the time count.
        let end = track.place(4.5).expect("a place");
        assert!((end.center_m - Vec3::new(9.0, 0.0, -1.0)).norm() < 1e-12);
        assert!((end.velocity_m_s - Vec3::new(2.0, 0.0, 0.0)).norm() < 1e-12);
        let expected = 0.09 * (0.25 + 4.0 / 5.0);
        assert!((end.variance - expected).abs() < 1e-12, "{}", end.variance);
        assert!((end.velocity_variance - 0.09 / 5.0).abs() < 1e-12);
        assert!(track.place(6.1).is_none());
    }

    #[test]
    fn the_nearest_frames_go_together() {
        let left = vec![0.0, 0.01, 0.02, 0.03];
        let right = vec![0.0101, 0.0199, 0.031, 0.041];
        let groups = by_time(&[left, right], 0.005);
        let members: Vec<_> = groups
            .iter()
            .map(|g| (g.members[0], g.members[1]))
            .collect();
        let expected = [
            (Some(0), None),
            (Some(1), Some(0)),
            (Some(2), Some(1)),
            (Some(3), Some(2)),
            (None, Some(3)),
        ];
        assert_eq!(members, expected);
        // Of two frames of one camera the nearer goes with another's.
        let groups = by_time(&[vec![0.01], vec![0.007, 0.0105]], 0.005);
        let members: Vec<_> = groups
            .iter()
            .map(|g| (g.members[0], g.members[1]))
            .collect();
        assert_eq!(members, [(None, Some(0)), (Some(0), Some(1))]);
    }

    #[test]
    fn without_times_numbers_count() {
        let groups = by_number(&[2, 3]);
        assert_eq!(groups[1].members, [Some(1), Some(1)]);
        assert_eq!(groups[2].members, [None, Some(2)]);
    }
}
