//! What all views of a clip show of a ball, place by place.
//!
//! A place's brightness is the middle of the views that show it: noise, glints, shadows and fingers do not turn with the ball and leave. Views in
//! which something is known to hide it ([`cover`](super::cover)) count where hardly any other shows it.

use super::face::Face;
use crate::concurrency;
use crate::geometry::{Rotation, Vec3};

/// Steps of the values up to [`FARTHEST`] either way, of which the median is taken.
const STEPS: usize = 256;
const FARTHEST: f64 = 2.56;
/// Steps about the median whose mean is the place's brightness.
const ABOUT: usize = 8;
/// Places that one thread looks at in a row.
const CHUNK: usize = 500;

/// Which views of a place count: those that it faces by the depth `well`, and where these are not `enough`, those by `least` too.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facing {
    pub well: f64,
    pub least: f64,
    pub enough: u32,
}

/// What views show of places on a ball.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewedPlaces {
    directions: Vec<Vec3>,
    counts: Vec<[u16; STEPS]>,
    views: Vec<u32>,
    values: Vec<f32>,
}

impl ViewedPlaces {
    /// Of faces and their rotations, map to view frame.
    pub(crate) fn new(directions: &[Vec3], views: &[(&Face, Rotation)], facing: Facing) -> Self {
        let turned: Vec<_> = views
            .iter()
            .map(|(face, rotation)| (*face, rotation.to_rotation_matrix()))
            .collect();
        let chunks: Vec<&[Vec3]> = directions.chunks(CHUNK).collect();
        let counted = concurrency::map(&chunks, |places| {
            let mut counts = vec![[0u16; STEPS]; places.len()];
            for (place, counts) in places.iter().zip(&mut counts) {
                let mut hidden = [0u16; STEPS];
                let mut below = f64::INFINITY;
                for least in [facing.well, facing.least] {
                    for (face, turn) in &turned {
                        let at = turn * place;
                        let depth = face.depth(&at);
                        if depth >= least && depth < below {
                            let part = (face.at(&at) + FARTHEST) / (2.0 * FARTHEST);
                            let step = (part * STEPS as f64).max(0.0) as usize;
                            let counts = match face.is_covered(&at) {
                                true => &mut hidden,
                                false => &mut *counts,
                            };
                            let count = &mut counts[step.min(STEPS - 1)];
                            *count = count.saturating_add(1);
                        }
                    }
                    if facing.least >= least || sum(counts) >= facing.enough {
                        break;
                    }
                    below = least;
                }
                if sum(counts) < facing.enough {
                    for (count, hidden) in counts.iter_mut().zip(hidden) {
                        *count = count.saturating_add(hidden);
                    }
                }
            }
            counts
        });
        let counts: Vec<[u16; STEPS]> = counted.into_iter().flatten().collect();
        let views: Vec<u32> = counts.iter().map(sum).collect();
        let values = counts.iter().zip(&views).map(|(c, n)| middle(c, *n));
        Self {
            directions: directions.to_vec(),
            values: values.collect(),
            views,
            counts,
        }
    }

    /// The places' directions.
    pub fn directions(&self) -> &[Vec3] {
        &self.directions
    }

    /// The logarithms of the places' brightnesses, less their means about each; 0 where no view shows them.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Numbers of views that show the places.
    pub fn views(&self) -> &[u32] {
        &self.views
    }

    /// Share of the views of a place that show a smaller value than `limit`.
    pub fn darker(&self, place: usize, limit: f32) -> f32 {
        let part = (f64::from(limit) + FARTHEST) / (2.0 * FARTHEST);
        let step = (part * STEPS as f64).round().max(0.0) as usize;
        let dark = &self.counts[place][..step.min(STEPS)];
        let dark: u32 = dark.iter().map(|n| u32::from(*n)).sum();
        dark as f32 / self.views[place].max(1) as f32
    }
}

fn sum(counts: &[u16; STEPS]) -> u32 {
    counts.iter().map(|n| u32::from(*n)).sum()
}

/// The mean of what lies about the median; 0 where there is nothing.
fn middle(counts: &[u16; STEPS], views: u32) -> f32 {
    if views == 0 {
        return 0.0;
    }
    let (mut below, mut at) = (0, 0);
    for (step, count) in counts.iter().enumerate() {
        below += u32::from(*count);
        if 2 * below >= views {
            at = step;
            break;
        }
    }
    let near = at.saturating_sub(ABOUT)..(at + ABOUT + 1).min(STEPS);
    let (mut sum, mut count) = (0.0, 0.0);
    for step in near {
        let n = f32::from(counts[step]);
        sum += n * (step as f32 + 0.5);
        count += n;
    }
    FARTHEST as f32 * (2.0 * sum / count / STEPS as f32 - 1.0)
}
