//! What is drawn on a ball: the dark marks of its surface, each with its shape.
//!
//! Every place belongs to the darkest place that is reached by always going to the darkest neighbor (a watershed). Those of a top
//! that are at least half as dark as it are a mark. A dot is a disc: as long as wide, filled, with nothing around it.

use nalgebra::Matrix2;

use crate::geometry::{Vec3, tangent_frame};
use crate::stats::median;
use crate::surface::Darkness;

/// The minimum darkness of a mark, over the bare ball's brightness and over the noise of a place.
const LEAST: f32 = 0.008;
const OVER_NOISE: f32 = 4.0;
/// A mark's darkest place is the darkest so near, radians.
const TOP: f64 = 0.075;
/// Two tops are one where no place between them, each so near the next, radians, is brighter than this share of the lower.
const NEXT: f64 = 0.04;
const SADDLE: f32 = 0.7;
/// Around a mark is what lies between so many of its radii, and so many radians more, and so many of its radii and radians.
const AROUND: [[f64; 2]; 2] = [[1.6, 0.03], [2.4, 0.06]];
/// A disc is at most so long over its width, fills at least so much of its ellipse, and is surrounded by at most so much of its own
/// darkness. Chosen on balls drawn by hand (`bench calibration-unknown`, seeds 35100001 and
/// 35100002): of 1 359 dots 96 % were such, of 95 other marks 11.
const DISC: MarkShape = MarkShape {
    elongation: 1.6,
    solidity: 0.85,
    around: 0.25,
};
/// How a mark looks.
#[derive(Debug, Clone, Copy)]
pub(super) struct MarkShape {
    /// Length over width.
    pub elongation: f64,
    /// Its area over that of the ellipse of the same moments.
    pub solidity: f64,
    /// Mean darkness around it over its own.
    pub around: f64,
}

/// A dark mark.
#[derive(Debug, Clone, Copy)]
pub(super) struct DarkMark {
    /// Its middle.
    pub direction: Vec3,
    /// How dark it is, over the bare ball's brightness.
    pub darkness: f64,
    /// The angular radius of a disc of its area, radians.
    pub radius: f64,
    pub shape: MarkShape,
    /// The minimum number of views that show a place of it.
    pub views: usize,
    /// See [`Place::steady`](crate::surface::SurfacePlace::steady), the mean over its places.
    pub steady: f64,
}

impl DarkMark {
    /// Whether it is no longer than a disc and has no gaps, whatever is around it.
    pub fn is_round(&self) -> bool {
        self.shape.elongation <= DISC.elongation && self.shape.solidity >= DISC.solidity
    }

    /// Whether it is a disc.
    pub fn is_disc(&self) -> bool {
        self.is_round() && self.shape.around <= DISC.around
    }
}

/// The marks of a surface, each with the places that it is of.
pub(super) fn marks(surface: &Darkness) -> Vec<(DarkMark, Vec<usize>)> {
    let least = LEAST.max(OVER_NOISE * surface.noise);
    let dark = |k: usize| surface.places[k].darkness;
    let is_above = |a: usize, b: usize| (dark(a), a) > (dark(b), b);
    let mut uphill: Vec<usize> = (0..surface.places.len()).collect();
    for (k, up) in uphill.iter_mut().enumerate() {
        if dark(k) >= 0.5 * least {
            let about = surface.places[k].direction;
            surface.near(&about, TOP, |j| {
                if is_above(j, *up) {
                    *up = j;
                }
            });
        }
    }
    join_across_saddles(surface, &mut uphill, 0.5 * least);
    let top_of = |k: usize| top(&uphill, k);
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); surface.places.len()];
    for k in 0..surface.places.len() {
        let top = top_of(k);
        if dark(top) >= least && dark(k) > 0.5 * dark(top) {
            members[top].push(k);
        }
    }
    let tops = members.into_iter().enumerate();
    tops.filter(|(_, members)| !members.is_empty())
        .map(|(top, members)| (mark(surface, top, &members), members))
        .collect()
}

/// The middle disc.
#[derive(Debug, Clone, Copy)]
pub(super) struct MiddleDisc {
    pub radius: f64,
    pub darkness: f64,
}

impl MiddleDisc {
    /// Of those among these marks, if there is one.
    pub fn of(marks: &[(DarkMark, Vec<usize>)]) -> Option<Self> {
        let discs = || marks.iter().map(|(mark, _)| mark).filter(|m| m.is_disc());
        discs().next()?;
        Some(Self {
            radius: median(&mut discs().map(|m| m.radius).collect::<Vec<_>>()),
            darkness: median(&mut discs().map(|m| m.darkness).collect::<Vec<_>>()),
        })
    }
}

/// The top that is reached from a place.
fn top(uphill: &[usize], mut k: usize) -> usize {
    while uphill[k] != k {
        k = uphill[k];
    }
    k
}

/// Makes one of two tops where the way between them stays dark: a bar and a large dot have several.
fn join_across_saddles(surface: &Darkness, uphill: &mut [usize], least: f32) {
    let dark = |k: usize| surface.places[k].darkness;
    for k in (0..uphill.len()).filter(|k| dark(*k) >= least) {
        surface.near(&surface.places[k].direction, NEXT, |j| {
            let (a, b) = (top(uphill, k), top(uphill, j));
            let (low, high) = if (dark(a), a) < (dark(b), b) {
                (a, b)
            } else {
                (b, a)
            };
            if low != high && dark(k).min(dark(j)) > SADDLE * dark(low) {
                uphill[low] = high;
            }
        });
    }
}

/// The mark of these places, the darkest of which is `top`.
pub(super) fn mark(surface: &Darkness, top: usize, members: &[usize]) -> DarkMark {
    let places = || members.iter().map(|k| &surface.places[*k]);
    let sum: Vec3 = places().map(|p| p.direction * f64::from(p.darkness)).sum();
    let direction = sum.normalize();
    let area = surface.area() * members.len() as f64;
    let radius = (area / std::f64::consts::PI).sqrt();
    let [a, b] = tangent_frame(&direction);
    let mut moments = Matrix2::zeros();
    for place in places() {
        let [x, y] = [place.direction.dot(&a), place.direction.dot(&b)];
        moments += Matrix2::new(x * x, x * y, x * y, y * y) / members.len() as f64;
    }
    // A place is no point.
    let of_place = surface.area() / (4.0 * std::f64::consts::PI);
    let spread = (moments + Matrix2::identity() * of_place).symmetric_eigenvalues();
    let (short, long) = (spread.min().sqrt(), spread.max().sqrt());
    let darkness = f64::from(surface.places[top].darkness);
    let floor = f64::from(surface.floor);
    let [inner, outer] = AROUND.map(|[radii, more]| radii * radius + more);
    let (mut dark, mut count) = (0.0, 0.0);
    surface.near(&direction, outer.min(1.5), |k| {
        let place = &surface.places[k];
        if place.direction.dot(&direction) < inner.cos() && place.views > 0 {
            dark += f64::from(place.darkness);
            count += 1.0;
        }
    });
    let mut views = usize::MAX;
    surface.near(&direction, radius, |k| {
        views = views.min(surface.places[k].views)
    });
    DarkMark {
        direction,
        darkness,
        radius,
        shape: MarkShape {
            elongation: long / short,
            solidity: area / (4.0 * std::f64::consts::PI * long * short),
            around: if count > 0.0 {
                (dark / count - floor).max(0.0) / darkness
            } else {
                0.0
            },
        },
        views: views.min(surface.places[top].views),
        steady: places().map(|p| f64::from(p.steady)).sum::<f64>() / members.len() as f64,
    }
}
