//! The surface of a ball by all frames of a clip, and frames laid on it.
//!
//! A place's brightness is the median over views from different sides: noise, glints, shadows and fingers do not turn with the ball
//! and leave. A frame is laid on the map by least squares: with `m` the map, `a` the frame's albedo at the pixel where the place `p` is
//! seen under the rotation `R`, and the true rotation `R exp(-w)`,
//!
//! ```text
//! a(R p) - m(p) = w . (p x grad m) + noise
//! ```
//!
//! so that the map's slopes serve every frame (S. Baker, I. Matthews, "Lucas-Kanade 20 years on", IJCV 2004: inverse compositional).
//! Residuals are weighted by Tukey's biweight: what is before the ball is not on it. The outline's center is taken as it is: fitted
//! along, it takes turns for shifts, and poses were worse by it.

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::Matrix3;

use super::Albedo;
use crate::error::{Error, Result};
use crate::geometry::{Rotation, Vec3, rotation_angle, spiral_directions};
use crate::stats::{SIGMA_PER_MAD, median};
use crate::vision::camera::BallView;

/// Places, 1 degree apart.
const PLACES: usize = 40_000;
/// Depth from which a view shows a place well enough, and from which where nothing better does.
const FACING: [f64; 2] = [0.2, 0.1];
/// The ball turns by so much, radians, between two views that count: in a pause the fingers do not move on it.
const TURNED: f64 = 0.05;
/// Fewer views of a place may be of a finger.
pub(crate) const SHOWN: usize = 2;
/// Steps of brightness, up to twice the bare ball's.
const STEPS: usize = 64;
/// Places so near, radians, are neighbors, and are averaged; so near, they give the slope.
const NEIGHBORS: f64 = 0.03;
const SLOPE: f64 = 0.045;
/// Places with the steepest slopes that frames are laid on, and every so many-th place that says how well a frame agrees.
const STEEP: usize = 5_000;
const COMPARED: usize = 8;
/// Depth from which a place takes part.
const ALIGNED: f64 = 0.25;
/// Steps of a fit, and the step, radians, at which it ends.
const FIT_STEPS: usize = 12;
const SETTLED: f64 = 1e-4;
/// The standard deviation of residuals in the first step, at least; half of it in each further one.
const COARSE: f64 = 0.15;
/// Residuals beyond so many standard deviations do not count.
const REACH: f32 = 4.0;
/// Fewer places in sight lay no frame.
const MIN_SEEN: usize = 50;

type Tree = ImmutableKdTree<f64, 3>;

/// A frame's albedo and how the ball lay in it.
#[derive(Debug, Clone, Copy)]
pub struct PosedAlbedo<'a> {
    /// What it shows.
    pub albedo: &'a Albedo,
    /// How it is seen.
    pub view: BallView,
    /// How the ball lay: map to view frame.
    pub rotation: Rotation,
}

impl PosedAlbedo<'_> {
    /// The depth of a place of the map, 0 at the limb and 1 in the middle, and its direction in the view frame.
    fn see(&self, place: &Vec3) -> (f64, Vec3) {
        let direction = self.rotation * place;
        let horizon = self.view.horizon();
        ((direction.z - horizon) / (1.0 - horizon), direction)
    }

    /// The albedo at a direction of the view frame.
    fn at(&self, direction: &Vec3) -> Option<f32> {
        self.albedo.at(self.view.project(direction))
    }
}

/// A ball's surface.
#[derive(Debug)]
pub struct AlbedoMap {
    directions: Vec<Vec3>,
    tree: Tree,
    /// For each place how many views show it how bright.
    counts: Vec<[u16; STEPS]>,
    views: Vec<usize>,
    raw: Vec<f32>,
    smooth: Vec<f32>,
    /// The steepest places and their `p x grad m`.
    steep: Vec<(usize, Vec3)>,
}

impl AlbedoMap {
    /// By the frames of a clip, in the order of time.
    ///
    /// # Errors
    /// [`Error::Argument`] where no search tree can be made.
    pub fn new(frames: &[PosedAlbedo<'_>]) -> Result<Self> {
        let directions: Vec<Vec3> = spiral_directions(PLACES).collect();
        let points: Vec<[f64; 3]> = directions.iter().map(|d| [d.x, d.y, d.z]).collect();
        let tree = Tree::new_from_slice(&points)
            .map_err(|e| Error::argument("surface", format!("no search tree: {e}")))?;
        let counts = count(frames, &directions);
        let views: Vec<usize> = counts.iter().map(sum).collect();
        let mut map = Self {
            raw: counts.iter().map(middle).collect(),
            directions,
            tree,
            counts,
            views,
            smooth: Vec::new(),
            steep: Vec::new(),
        };
        map.smooth = (0..PLACES).map(|k| map.mean_about(k)).collect();
        map.find_steep();
        Ok(map)
    }

    /// The places' directions.
    pub fn directions(&self) -> &[Vec3] {
        &self.directions
    }

    /// The brightness of the places over that of the bare ball; 1 where no view shows them.
    pub fn values(&self) -> &[f32] {
        &self.smooth
    }

    /// Numbers of views that show the places.
    pub fn views(&self) -> &[usize] {
        &self.views
    }

    /// Standard deviation of a place's brightness.
    pub fn noise(&self) -> f32 {
        let off = (0..PLACES).filter(|k| self.views[*k] > 0);
        let mut off: Vec<f64> = off
            .map(|k| f64::from((self.raw[k] - self.smooth[k]).abs()))
            .collect();
        (SIGMA_PER_MAD * median(&mut off)) as f32
    }

    /// Share of the views of a place that show it darker than `limit`.
    pub fn darker(&self, place: usize, limit: f32) -> f32 {
        let step = (0.5 * limit * STEPS as f32).round() as usize;
        let dark = &self.counts[place][..step.min(STEPS)];
        let dark: usize = dark.iter().map(|n| usize::from(*n)).sum();
        dark as f32 / self.views[place].max(1) as f32
    }

    /// Calls `take` with every place nearer to a direction than `within`, radians.
    pub fn near(&self, direction: &Vec3, within: f64, mut take: impl FnMut(usize)) {
        let chord = 2.0 * (0.5 * within).sin();
        let point = [direction.x, direction.y, direction.z];
        let found = self
            .tree
            .query(&point)
            .within::<SquaredEuclidean<f64>>(chord * chord)
            .execute();
        found.iter().for_each(|n| take(n.item as usize));
    }

    /// Lays a frame on the map, from its rotation on; `None` where too little of it is known.
    pub fn align(&self, frame: &PosedAlbedo<'_>) -> Option<Rotation> {
        let mut frame = *frame;
        let mut residuals: Vec<(f32, Vec3, f64)> = Vec::with_capacity(STEEP);
        let mut sorted: Vec<f64> = Vec::with_capacity(STEEP);
        for step in 0..FIT_STEPS {
            residuals.clear();
            for (k, turn) in &self.steep {
                let (depth, seen) = frame.see(&self.directions[*k]);
                if depth < ALIGNED {
                    continue;
                }
                let Some(value) = frame.at(&seen) else {
                    continue;
                };
                residuals.push((value - self.smooth[*k], *turn, depth));
            }
            if residuals.len() < MIN_SEEN {
                return None;
            }
            sorted.clear();
            sorted.extend(residuals.iter().map(|r| f64::from(r.0.abs())));
            // Most places are bare: by their noise alone the edges of a frame that is degrees off would all be outliers.
            let coarse = COARSE * 0.5f64.powi(step as i32);
            let sigma = (SIGMA_PER_MAD * median(&mut sorted)).max(coarse);
            let turn = solve(&residuals, sigma)?;
            frame.rotation *= Rotation::from_scaled_axis(-turn);
            if turn.norm() < SETTLED {
                break;
            }
        }
        Some(frame.rotation)
    }

    /// How well a frame agrees with the map: the correlation of their brightnesses, places weighted by their depths.
    pub fn agreement(&self, frame: &PosedAlbedo<'_>) -> f64 {
        let mut sums = [0.0; 6];
        for k in (0..PLACES).step_by(COMPARED).filter(|k| self.views[*k] > 0) {
            let (depth, seen) = frame.see(&self.directions[k]);
            if depth < ALIGNED {
                continue;
            }
            let Some(value) = frame.at(&seen) else {
                continue;
            };
            let [a, b] = [f64::from(value), f64::from(self.smooth[k])];
            let terms = [1.0, a, b, a * a, b * b, a * b];
            for (sum, term) in sums.iter_mut().zip(terms) {
                *sum += depth * term;
            }
        }
        let [n, a, b, aa, bb, ab] = sums;
        if n < 1.0 {
            return 0.0;
        }
        let spread = ((aa - a * a / n) * (bb - b * b / n)).max(1e-12).sqrt();
        (ab - a * b / n) / spread
    }

    fn mean_about(&self, k: usize) -> f32 {
        let (mut sum, mut weight) = (0.0, 0.0);
        self.near(&self.directions[k], NEIGHBORS, |j| {
            if self.views[j] > 0 {
                sum += self.raw[j];
                weight += 1.0;
            }
        });
        if weight > 0.0 { sum / weight } else { 1.0 }
    }

    fn find_steep(&mut self) {
        let known = (0..PLACES).filter(|k| self.views[*k] > 0);
        let mut steep: Vec<(usize, Vec3)> = known
            .map(|k| {
                let place = self.directions[k];
                let (mut slope, mut squares) = (Vec3::zeros(), 0.0);
                self.near(&place, SLOPE, |j| {
                    if self.views[j] > 0 {
                        let off = self.directions[j] - place;
                        let off = off - place * off.dot(&place);
                        slope += off * f64::from(self.smooth[j] - self.smooth[k]);
                        squares += 0.5 * off.norm_squared();
                    }
                });
                let slope = slope / squares.max(1e-12);
                (k, place.cross(&slope))
            })
            .collect();
        if steep.len() > STEEP {
            let by_slope = |a: &(usize, Vec3), b: &(usize, Vec3)| {
                b.1.norm_squared().total_cmp(&a.1.norm_squared())
            };
            steep.select_nth_unstable_by(STEEP, by_slope);
            steep.truncate(STEEP);
        }
        self.steep = steep;
    }
}

/// The step of a fit: the turn in the map's frame.
fn solve(residuals: &[(f32, Vec3, f64)], sigma: f64) -> Option<Vec3> {
    let mut matrix = Matrix3::identity() * 1e-9;
    let mut vector = Vec3::zeros();
    for (residual, row, depth) in residuals {
        let t = *residual / (REACH * sigma as f32);
        let weight = depth * f64::from((1.0 - t * t).max(0.0).powi(2));
        if weight > 0.0 {
            matrix.ger(weight, row, row, 1.0);
            vector.axpy(weight * f64::from(*residual), row, 1.0);
        }
    }
    Some(matrix.cholesky()?.solve(&vector))
}

/// For each place how many views show it how bright.
fn count(frames: &[PosedAlbedo<'_>], directions: &[Vec3]) -> Vec<[u16; STEPS]> {
    let mut counts = vec![[0u16; STEPS]; directions.len()];
    let mut apart: Vec<&PosedAlbedo<'_>> = Vec::new();
    for frame in frames {
        let is_apart =
            |last: &&PosedAlbedo<'_>| rotation_angle(&last.rotation, &frame.rotation) >= TURNED;
        if apart.last().is_none_or(is_apart) {
            apart.push(frame);
        }
    }
    for facing in FACING {
        let poor: Vec<usize> = (0..counts.len())
            .filter(|k| sum(&counts[*k]) < SHOWN)
            .collect();
        for frame in &apart {
            for k in &poor {
                let (depth, seen) = frame.see(&directions[*k]);
                // What faces the camera well enough for the first round is counted already.
                let is_counted = facing < FACING[0] && depth >= FACING[0];
                if depth < facing || is_counted {
                    continue;
                }
                if let Some(ratio) = frame.at(&seen) {
                    let step = (ratio * 0.5 * STEPS as f32) as usize;
                    let count = &mut counts[*k][step.min(STEPS - 1)];
                    *count = count.saturating_add(1);
                }
            }
        }
    }
    counts
}

fn sum(counts: &[u16; STEPS]) -> usize {
    counts.iter().map(|n| usize::from(*n)).sum()
}

/// The median of counted brightnesses; that of the bare ball where there is none.
fn middle(counts: &[u16; STEPS]) -> f32 {
    let half = 0.5 * sum(counts) as f32;
    let mut below = 0.0;
    for (step, count) in counts.iter().enumerate() {
        let count = f32::from(*count);
        if count > 0.0 && below + count >= half {
            return 2.0 * (step as f32 + (half - below) / count) / STEPS as f32;
        }
        below += count;
    }
    1.0
}
