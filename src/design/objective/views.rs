//! What a view shows of a pattern: which dots are detected, from which direction, with which
//! probability.

use super::confusion::Detection;
use super::cube_map::Interpolated;
use crate::geometry::{Vec3, spiral_directions};

/// Width in z over which a dot fades at the visibility limit.
const SOFTNESS: f64 = 0.04;
/// Viewing directions.
pub(super) const VIEWS: usize = 400;
/// A count of dots from this one on is not distinguished from larger ones.
pub(super) const MAX_COUNT: usize = 9;
/// Largest detection probability; a certain one would make every missed dot impossible.
const MAX_PROBABILITY: f64 = 0.98;

/// A dot's part in a view, by its height `z` above the image plane, each with its derivative.
#[derive(Debug, Clone, Copy, Default)]
struct Part {
    /// Probability of being detected.
    found: [f64; 2],
    /// Factor of a match of this dot with one like it.
    matched: [f64; 2],
    /// Logarithm of the factor of a dot that nothing matches.
    ln_unmatched: [f64; 2],
}

/// How a dot is detected.
#[derive(Debug, Clone, Copy)]
pub(super) struct DotModel {
    detection: Detection,
    limit: f64,
    /// Bhattacharyya coefficient of a dot's position with a false dot's.
    by_chance: f64,
}

impl DotModel {
    pub fn new(detection: Detection, limit: f64, sigma: f64) -> Self {
        let by_chance = match detection {
            Detection::Given { .. } => 0.0,
            Detection::Independent { false_dots, .. } => {
                let cap = std::f64::consts::TAU * (1.0 - limit);
                (false_dots / cap * 8.0 * std::f64::consts::PI).sqrt() * sigma
            }
        };
        Self {
            detection,
            limit,
            by_chance,
        }
    }

    fn part(&self, z: f64) -> Part {
        let seen = 1.0 / (1.0 + (-(z - self.limit) / SOFTNESS).exp());
        let slope = (1.0 - seen) / SOFTNESS;
        match self.detection {
            Detection::Given { .. } => Part {
                found: [seen, seen * slope],
                matched: [seen, seen * slope],
                ln_unmatched: [0.0, 0.0],
            },
            Detection::Independent { probability, .. } => {
                let p = probability.min(MAX_PROBABILITY) * seen;
                let by_z = p * slope;
                let missed = (1.0 - p).sqrt();
                let u = missed + self.by_chance * p.sqrt();
                let u_slope = -0.5 * by_z / missed + 0.5 * self.by_chance * p.sqrt() * slope;
                Part {
                    found: [p, by_z],
                    matched: [
                        p / (u * u),
                        by_z / (u * u) - 2.0 * p * u_slope / (u * u * u),
                    ],
                    ln_unmatched: [u.ln(), u_slope / u],
                }
            }
        }
    }
}

/// The views of a pattern.
pub(super) struct Views {
    model: DotModel,
    directions: Vec<Vec3>,
    /// By view and dot.
    parts: Vec<Part>,
    /// The logarithm of each view's weight: nothing matches, or one over the number of choices.
    pub ln_weight: Vec<f64>,
    /// The same of the view that a wrong pose claims; none where a fixed number of dots is given.
    pub claimed: Option<Interpolated>,
    /// Mean probability of a view of so many detected dots; the last entry is of that or more.
    pub count: [f64; MAX_COUNT + 1],
    n: usize,
}

/// Derivatives of a value with respect to what [`Views`] holds.
pub(super) struct ViewSlopes {
    pub ln_weight: Vec<f64>,
    pub claimed: Vec<f64>,
    pub count: [f64; MAX_COUNT + 1],
}

impl Views {
    pub fn new(dots: &[Vec3], model: DotModel) -> Self {
        let directions: Vec<Vec3> = spiral_directions(VIEWS).collect();
        let n = dots.len();
        let parts: Vec<Part> = directions
            .iter()
            .flat_map(|v| dots.iter().map(|d| model.part(d.dot(v))))
            .collect();
        let mut count = [0.0; MAX_COUNT + 1];
        let ln_weight = parts
            .chunks_exact(n)
            .map(|view| match model.detection {
                Detection::Given { dots } => -choices(view, dots).max(1.0).ln(),
                Detection::Independent { .. } => {
                    let distribution = distribution(view);
                    for (c, p) in count.iter_mut().zip(distribution) {
                        *c += p / VIEWS as f64;
                    }
                    view.iter().map(|p| p.ln_unmatched[0]).sum()
                }
            })
            .collect();
        let claimed = match model.detection {
            Detection::Given { .. } => None,
            Detection::Independent { .. } => Some(Interpolated::new(|v| {
                dots.iter()
                    .map(|d| model.part(d.dot(v)).ln_unmatched[0])
                    .sum()
            })),
        };
        Self {
            model,
            directions,
            parts,
            ln_weight,
            claimed,
            count,
            n,
        }
    }

    pub fn direction(&self, view: usize) -> &Vec3 {
        &self.directions[view]
    }

    /// The factor of a match of a dot, and its derivative with respect to the dot's height.
    pub fn matched(&self, view: usize, dot: usize) -> [f64; 2] {
        self.parts[view * self.n + dot].matched
    }

    pub fn slopes(&self) -> ViewSlopes {
        ViewSlopes {
            ln_weight: vec![0.0; VIEWS],
            claimed: self.claimed.as_ref().map_or(Vec::new(), |_| {
                vec![0.0; Interpolated::directions().count()]
            }),
            count: [0.0; MAX_COUNT + 1],
        }
    }

    /// Adds the derivative of a value with these slopes with respect to the dots.
    pub fn add_gradient(&self, dots: &[Vec3], slopes: &ViewSlopes, gradient: &mut [Vec3]) {
        let mut by_height = vec![0.0; self.n];
        for (k, v) in self.directions.iter().enumerate() {
            let view = &self.parts[k * self.n..(k + 1) * self.n];
            by_height.fill(0.0);
            match self.model.detection {
                Detection::Given { dots } => {
                    add_choices_slope(view, dots, slopes.ln_weight[k], &mut by_height)
                }
                Detection::Independent { .. } => {
                    for (h, p) in by_height.iter_mut().zip(view) {
                        *h += slopes.ln_weight[k] * p.ln_unmatched[1];
                    }
                    add_distribution_slope(view, &slopes.count, &mut by_height);
                }
            }
            for (g, h) in gradient.iter_mut().zip(&by_height) {
                *g += *h * v;
            }
        }
        if self.claimed.is_some() {
            for (v, slope) in Interpolated::directions().zip(&slopes.claimed) {
                if *slope != 0.0 {
                    for (g, d) in gradient.iter_mut().zip(dots) {
                        *g += slope * self.model.part(d.dot(&v)).ln_unmatched[1] * v;
                    }
                }
            }
        }
    }
}

/// The elementary symmetric polynomial of the visibilities: choices of so many dots in view.
fn choices(view: &[Part], dots: usize) -> f64 {
    let mut e = [0.0; MAX_COUNT + 1];
    e[0] = 1.0;
    for part in view {
        for k in (1..=dots).rev() {
            e[k] += part.found[0] * e[k - 1];
        }
    }
    e[dots]
}

/// Adds the derivative of `-slope ln(choices)`.
fn add_choices_slope(view: &[Part], dots: usize, slope: f64, by_height: &mut [f64]) {
    let all = choices(view, dots);
    if all <= 1.0 {
        return;
    }
    let mut e = [0.0; MAX_COUNT + 1];
    e[0] = 1.0;
    for part in view {
        for k in (1..=dots).rev() {
            e[k] += part.found[0] * e[k - 1];
        }
    }
    for (h, part) in by_height.iter_mut().zip(view) {
        // Without the dot the polynomials follow from below: f_k = e_k - s f_(k-1).
        let without = e[1..dots].iter().fold(1.0, |f, e| e - part.found[0] * f);
        *h -= slope * without / all * part.found[1];
    }
}

/// The distribution of the number of detected dots; the last entry is of that number or more.
fn distribution(view: &[Part]) -> [f64; MAX_COUNT + 1] {
    let mut p = [0.0; MAX_COUNT + 1];
    p[0] = 1.0;
    for part in view {
        step(&mut p, part.found[0]);
    }
    p
}

/// One more dot, found with this probability.
fn step(p: &mut [f64; MAX_COUNT + 1], found: f64) {
    p[MAX_COUNT] += found * p[MAX_COUNT - 1];
    for k in (1..MAX_COUNT).rev() {
        p[k] += found * (p[k - 1] - p[k]);
    }
    p[0] -= found * p[0];
}

/// Adds the derivative of `sum_k slopes_k P_k / VIEWS`, by the reverse of the recursion.
fn add_distribution_slope(view: &[Part], slopes: &[f64; MAX_COUNT + 1], by_height: &mut [f64]) {
    if slopes.iter().all(|s| *s == 0.0) {
        return;
    }
    let mut before = Vec::with_capacity(view.len());
    let mut p = [0.0; MAX_COUNT + 1];
    p[0] = 1.0;
    for part in view {
        before.push(p);
        step(&mut p, part.found[0]);
    }
    let mut by = slopes.map(|s| s / VIEWS as f64);
    for ((h, part), p) in by_height.iter_mut().zip(view).zip(&before).rev() {
        let found = part.found[0];
        let mut slope = 0.0;
        for k in 0..MAX_COUNT {
            slope += p[k] * (by[k + 1] - by[k]);
        }
        *h += slope * part.found[1];
        for k in 0..MAX_COUNT {
            by[k] += found * (by[k + 1] - by[k]);
        }
    }
}
