//! A ball's outline by the image's own pixels.
//!
//! The rim is cut into sectors. In each the light at `x` pixels within the outline is what is behind the ball, the step to the ball,
//! and what Lambert's law adds as the surface turns towards the camera, like the root of the depth; all blurred by a Gaussian of `s`:
//!
//! ```text
//! light = a + b Phi((x - e) / s) + c E sqrt(max(0, x - e + s n)),   n ~ N(0, 1)
//! ```
//!
//! So neither the tone curve, which makes a bright ball larger by a quarter of a pixel, nor shading, which makes its dark side smaller,
//! moves the outline. The sectors' `e` are a change of center and radius, fitted with the weights of Student's distribution: a dot
//! at the rim, a shadow or a hand counts little. Apart from that they are fitted once more with an [oval](Oval): what `cos 2a` and
//! `sin 2a` of the direction `a` add to the radius.
//!
//! The tone curve `light = (1 - q) I + q I^2` is what the dots say of it, if any. A wrong one moves every edge the same way, by up to
//! 0.8 `s`, and with it the radius. [`RimFitter::fit_in_doubt`] therefore fits with a line, sRGB's curve and one between, and
//! weighs them by what is known of `q` and by how well the edges' own shape fits: the error of `q` becomes one of the outline.
//!
//! Not promised: an outline where the ball is not within a pixel or two of where it was found; then there is none.

mod sector;

use std::f64::consts::TAU;

use fearless_simd::Level;
use nalgebra::{Matrix3, SMatrix, SVector, Vector2};

use self::sector::{
    EXPECTED_PIXELS, LEAST_VARIANCE, Place, RimPixels, Sector, density_cost, place, sector_at,
    sector_of,
};
use crate::fit::{Student, Sums};
use crate::geometry::Vec3;
use crate::vision::dots::cap::{CapShape, Tone};
use crate::vision::frame::outline::Outline;
use crate::vision::optics::ball_pixels::BallPixels;
use crate::vision::optics::camera::{BallCircle, Pixel};
use crate::vision::optics::oval::Oval;

/// Number of sectors.
const SECTORS: usize = 32;
/// Pixels are read from so many within the outline to so many beyond it, and so many deviations of the blur: what is
/// behind the ball has to be seen apart from its edge.
const READ: ([f64; 2], [f64; 2]) = ([3.0, 1.5], [1.2, 2.5]);
/// Of larger balls every second, third, ... pixel is read, so that there are about so many.
const MANY_PIXELS: f64 = 3000.0;
/// Maximum change of the outline, pixels.
const MAX_CHANGE: f64 = 1.5;
/// After a larger one it is fitted again about the changed outline, pixels.
const FAR: f64 = 0.25;
/// Steps, and the loss, of the fit to the sectors.
const ROUNDS: usize = 6;
const LOSS: Student = Student::new(3, 1);
/// Fewer sectors are no outline, and no oval.
const MIN_SECTORS: usize = 14;
const MIN_OVAL_SECTORS: usize = 16;
/// Standard deviations of what the model leaves out, pixels: of center and radius.
const MODEL_ERROR: [f64; 3] = [0.03, 0.03, 0.08];
/// The bends of the tone curve that are tried.
const BENDS: [f64; 3] = [0.0, 0.5, 1.0];
/// The least deviation of the bend: curves of cameras are not quite of this family.
const MIN_BEND_ERROR: f64 = 0.1;
/// All pixels count as so many where they say how the curve bends.
const INDEPENDENT: f64 = 200.0;
/// Fits outlines; keeps its memory.
#[derive(Debug)]
pub(crate) struct RimFitter {
    level: Level,
    /// By sector.
    pixels: [RimPixels; SECTORS],
}

impl Default for RimFitter {
    fn default() -> Self {
        Self {
            level: Level::new(),
            pixels: std::array::from_fn(|_| RimPixels::with_capacity(EXPECTED_PIXELS)),
        }
    }
}

/// The change of an outline's center and radius, with its covariance.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RimFit {
    pub change: Vec3,
    pub covariance: Matrix3<f64>,
    pub oval: Option<Oval>,
}

impl RimFit {
    /// An outline as the rim has it that was fitted about `circle`.
    pub fn correct(&self, circle: &BallCircle, outline: &Outline) -> Outline {
        Outline {
            circle: BallCircle {
                eccentricity: outline.circle.eccentricity,
                ..self.moved(circle)
            },
            covariance: self.covariance,
            ..*outline
        }
    }

    fn moved(&self, circle: &BallCircle) -> BallCircle {
        BallCircle {
            center: Pixel {
                u: circle.center.u + self.change.x,
                v: circle.center.v + self.change.y,
            },
            radius: circle.radius + self.change.z,
            ..*circle
        }
    }
}

impl RimFitter {
    /// Fits the rim about the outline of a view, by blur and tone curve of the ball's dots.
    pub fn fit(&mut self, pixels: &BallPixels<'_>, shape: &CapShape) -> Option<RimFit> {
        self.about(pixels, |fitter, pixels| {
            let sectors = fitter.read_sectors(pixels, shape)?;
            fitter.fit_at(&sectors, shape.blur, shape.tone.bend).0
        })
    }

    /// The same by what is known of the tone curve and what the rim itself says of it, in three times the time.
    pub fn fit_in_doubt(&mut self, pixels: &BallPixels<'_>, shape: &CapShape) -> Option<RimFit> {
        self.about(pixels, |fitter, pixels| fitter.fit_bent(pixels, shape))
    }

    /// Fits about the outline of a view, and where that moves it far about the moved one.
    fn about(
        &mut self,
        pixels: &BallPixels<'_>,
        fit: impl Fn(&mut Self, &BallPixels<'_>) -> Option<RimFit>,
    ) -> Option<RimFit> {
        let found = fit(self, pixels)?;
        if found.change.amax() < FAR {
            return Some(found);
        }
        let view = pixels.view.at(found.moved(pixels.view.circle())).ok()?;
        let moved = BallPixels {
            view: &view,
            ..*pixels
        };
        let Some(again) = fit(self, &moved) else {
            return Some(found);
        };
        let change = found.change + again.change;
        (change.amax() < MAX_CHANGE).then_some(RimFit { change, ..again })
    }

    fn fit_bent(&mut self, pixels: &BallPixels<'_>, shape: &CapShape) -> Option<RimFit> {
        let sectors = self.read_sectors(pixels, shape)?;
        let mut costs = [0.0; BENDS.len()];
        let mut fits = [None; BENDS.len()];
        for ((bend, cost), fit) in BENDS.into_iter().zip(&mut costs).zip(&mut fits) {
            (*fit, *cost) = self.fit_at(&sectors, shape.blur, bend);
            *cost += self
                .pixels
                .iter()
                .map(|p| density_cost(p, bend))
                .sum::<f64>();
        }
        let [Some(line), Some(middle), Some(root)] = fits else {
            return self.fit_at(&sectors, shape.blur, shape.tone.bend).0;
        };
        // Neighbors share blur, and what is behind the ball is not even.
        let count: usize = self.pixels.iter().map(RimPixels::len).sum();
        let share = (INDEPENDENT / count as f64).min(1.0);
        let (bend, variance) = bend(&costs.map(|cost| share * cost), &shape.tone);
        // The parabola through the three.
        let by = [
            middle.change * 4.0 - line.change * 3.0 - root.change,
            (line.change - middle.change * 2.0 + root.change) * 2.0,
        ];
        let slope = by[0] + by[1] * (2.0 * bend);
        let nearest = [line, middle, root][(2.0 * bend).round() as usize];
        Some(RimFit {
            change: line.change + (by[0] + by[1] * bend) * bend,
            covariance: nearest.covariance + slope * slope.transpose() * variance,
            oval: nearest.oval,
        })
    }

    fn read_sectors(
        &mut self,
        pixels: &BallPixels<'_>,
        shape: &CapShape,
    ) -> Option<[Sector; SECTORS]> {
        let mut sectors = [Sector::default(); SECTORS];
        for (k, sector) in sectors.iter_mut().enumerate() {
            *sector = sector_at(pixels.view, TAU * (k as f64 + 0.5) / SECTORS as f64)?;
        }
        self.read(pixels, &sectors, shape);
        Some(sectors)
    }

    /// Fits the pixels read, whose tone curve has this bend; also minus two log-likelihoods of the lights of all sectors, each with a
    /// noise of its own.
    fn fit_at(&self, sectors: &[Sector; SECTORS], blur: f64, bend: f64) -> (Option<RimFit>, f64) {
        let mut cost = 0.0;
        let mut places: [Place; SECTORS] = [None; SECTORS];
        let occupied = self.pixels.iter().zip(&mut places);
        for (part, found) in occupied.filter(|(part, _)| part.len() > 0) {
            let count = part.len() as f64;
            let (at, squares) = place(self.level, part, blur, bend);
            *found = at;
            cost += count * (squares / count).max(LEAST_VARIANCE).ln();
        }
        (outline(sectors, &places), cost)
    }

    fn read(&mut self, pixels: &BallPixels<'_>, sectors: &[Sector; SECTORS], shape: &CapShape) {
        let BallPixels { gray, grid, view } = pixels;
        let (depths, blurs) = READ;
        let [inner, outer] = [0, 1].map(|k| depths[k] + blurs[k] * shape.blur);
        let circle = view.circle();
        let stride = (TAU * circle.radius * (inner + outer) / MANY_PIXELS).ceil() as usize;
        let stride = stride.max(1);
        // An ellipse's longer half axis.
        let longest = circle.radius / (1.0 - circle.eccentricity.norm_squared()).sqrt();
        let ring = [
            (circle.radius - inner - 2.0).max(0.0),
            longest + outer + 2.0,
        ];
        let middle = grid.pixel_to_part(circle.center);
        // From the first to the last of so many that lie within `side` of the middle.
        let near = |middle: f64, side: f64, count: usize| {
            let end = (middle + side + 1.0).clamp(0.0, count as f64 - 1.0);
            (middle - side).ceil().max(1.0) as usize..end as usize
        };
        self.pixels.iter_mut().for_each(RimPixels::clear);
        for v in near(middle.v, ring[1], gray.height()) {
            let row = gray.row(v, 0, gray.width());
            let off = (v as f64 - middle.v).powi(2);
            let [hole, end] = ring.map(|radius| (radius * radius - off).max(0.0).sqrt());
            for u in near(middle.u, end, gray.width()) {
                if (u as f64 - middle.u).abs() < hole || (u + v) % stride != 0 {
                    continue;
                }
                let aside = view.aside(pixels.place(u, v));
                let sector = sector_of(&aside);
                let within = (1.0 - aside.norm()) / sectors[sector].scale;
                if (-outer..=inner).contains(&within) {
                    self.pixels[sector].push(&[within, f64::from(row[u])]);
                }
            }
        }
    }
}

/// The bend of the tone curve and its variance, by the costs of [`BENDS`] and what is known of it.
fn bend([line, middle, root]: &[f64; 3], known: &Tone) -> (f64, f64) {
    let least = MIN_BEND_ERROR * MIN_BEND_ERROR;
    let weight = known.variance.max(least).recip();
    // cost = a q^2 + b q + c.
    let a = 2.0 * (line - 2.0 * middle + root);
    let b = 4.0 * middle - 3.0 * line - root;
    let cost = |q: f64| (a * q + b) * q + weight * (q - known.bend).powi(2);
    let curvature = a + weight;
    if curvature > 0.0 {
        let best = (weight * known.bend - 0.5 * b) / curvature;
        return (best.clamp(0.0, 1.0), curvature.recip().max(least));
    }
    let best = if cost(0.0) < cost(1.0) { 0.0 } else { 1.0 };
    (best, known.variance.max(least))
}

/// The outline by its sectors.
fn outline(sectors: &[Sector; SECTORS], places: &[Place; SECTORS]) -> Option<RimFit> {
    let round = |n: &Vector2<f64>| [n.x, n.y, 1.0].into();
    let oval = |n: &Vector2<f64>| [n.x, n.y, 1.0, n.x * n.x - n.y * n.y, 2.0 * n.x * n.y].into();
    let (change, mut covariance) = fit(sectors, places, MIN_SECTORS, round)?;
    let errors = MODEL_ERROR.map(|e| e * e);
    covariance += Matrix3::from_diagonal(&errors.into());
    let drawn_out = fit::<5>(sectors, places, MIN_OVAL_SECTORS, oval);
    (change.amax() < MAX_CHANGE).then(|| RimFit {
        change,
        covariance,
        oval: drawn_out.map(|(change, covariance)| Oval {
            stretch_px: change.fixed_rows::<2>(3).into_owned(),
            covariance: covariance.fixed_view::<2, 2>(3, 3).into_owned(),
        }),
    })
}

/// What moves the rim as the sectors have it, each unknown by its derivative there, and its covariance.
fn fit<const N: usize>(
    sectors: &[Sector; SECTORS],
    places: &[Place; SECTORS],
    min_count: usize,
    by_normal: impl Fn(&Vector2<f64>) -> SVector<f64, N>,
) -> Option<(SVector<f64, N>, SMatrix<f64, N, N>)> {
    let seen = || {
        let both = sectors.iter().zip(places);
        both.filter_map(|(sector, place)| Some((by_normal(&sector.normal), (*place)?)))
    };
    let count = seen().count();
    if count < min_count {
        return None;
    }
    let mut change = SVector::<f64, N>::zeros();
    let mut scale = 1.0;
    let mut covariance = SMatrix::<f64, N, N>::zeros();
    for _ in 0..ROUNDS {
        let mut sums = Sums::<N>::default();
        for (by, (at, variance)) in seen() {
            let residual = at - by.dot(&change);
            let weight = LOSS.weight(residual * residual / (variance * scale));
            sums.add(&by.into(), residual, weight / variance);
        }
        let inverse = sums.symmetric().cholesky()?.inverse();
        change += inverse * SVector::from(sums.gradient);
        scale = (sums.squares / (count - N) as f64).max(1.0);
        covariance = inverse * (scale / LOSS.information());
    }
    Some((change, covariance))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::GrayImage;
    use crate::stats::normal_cdf_and_density;
    use crate::vision::optics::camera::{BallView, Camera};
    use crate::vision::optics::grid::Grid;

    const SIDE: usize = 80;
    const BLUR: f64 = 0.8;

    /// A lit ball before a dark background, as a camera stores it.
    fn drawn(circle: &BallCircle) -> GrayImage {
        let lamp = Vec3::new(0.6, 0.3, 0.75).normalize();
        let view = BallView::new(&Camera::Orthographic, *circle).expect("a value");
        GrayImage::from_fn(SIDE, SIDE, |u, v| {
            let at = Pixel {
                u: u as f64,
                v: v as f64,
            };
            let off = (at.u - circle.center.u).hypot(at.v - circle.center.v);
            let covered = normal_cdf_and_density((circle.radius - off) / BLUR).0;
            // The limb's own light beyond it.
            let inward = (circle.radius - 0.5).min(off) / off.max(1e-9);
            let toward = Pixel {
                u: circle.center.u + inward * (at.u - circle.center.u),
                v: circle.center.v + inward * (at.v - circle.center.v),
            };
            let lit = view
                .direction(toward)
                .map_or(0.0, |d| d.dot(&lamp).max(0.0));
            (0.04 + covered * (0.25 + 0.3 * lit)).sqrt() as f32
        })
    }

    fn fitted(gray: &GrayImage, view: &BallView) -> Option<RimFit> {
        let grid = Grid::halved(0);
        let shape = CapShape {
            radius: 0.1,
            blur: BLUR,
            tone: Tone::of_root(),
            is_known: true,
        };
        RimFitter::default().fit(&BallPixels { gray, grid, view }, &shape)
    }

    #[test]
    fn an_outline_that_is_off_is_corrected() {
        let circle = BallCircle::new(Pixel { u: 40.2, v: 38.7 }, 30.0);
        let image = drawn(&circle);
        for off in [[0.0, 0.0, 0.0], [0.3, -0.2, 0.4], [-0.4, 0.1, -0.5]] {
            let mut found = circle;
            found.center.u += off[0];
            found.center.v += off[1];
            found.radius += off[2];
            let view = BallView::new(&Camera::Orthographic, found).expect("a value");
            let fit = fitted(&image, &view).expect("a rim");
            let left = fit.change + Vec3::from(off);
            assert!(left.xy().amax() < 0.03, "{off:?}: {left}");
            assert!(left.z.abs() < 0.1, "{off:?}: {left}");
        }
    }

    #[test]
    fn an_even_image_has_no_rim() {
        let circle = BallCircle::new(Pixel { u: 40.2, v: 38.7 }, 30.0);
        let view = BallView::new(&Camera::Orthographic, circle).expect("a value");
        let image = GrayImage::from_fn(SIDE, SIDE, |u, v| {
            0.5 + 0.001 * ((7 * u + 13 * v) % 5) as f32
        });
        let found = fitted(&image, &view);
        assert!(found.is_none(), "{found:?}");
    }
}
