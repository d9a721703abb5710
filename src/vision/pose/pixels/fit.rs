//! The fit of orientation, outline, distance, dots and light to a small ball's pixels.
//!
//! Gauss-Newton with the weights of Student's distribution, whose scale is that of the residuals. What else is known is Gaussian:
//! the outline as it was found, the camera's distance, the dots' size, blur and ink.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2, Vector3};

use super::field::{BLUR, BallSample, BlurredDot, INK, Pixels, PlacedDot, RHO, SHADES};
use crate::fit::{Normal, Student, Sums};
use crate::geometry::{Rotation, Vec3};
use crate::pattern::MAX_DOTS;
use crate::vision::frame::config::CameraModel;
use crate::vision::optics::camera::{BallCircle, BallView, Camera, Pixel};

/// Turn, outline, inverse distance, radius and blur of the dots, ink: then the light.
const OWN: usize = 10;
const UNKNOWNS: usize = OWN + SHADES;
/// The pixels' loss: there is print and glare.
const LOSS: Student = Student::new(4, 1);
/// Deviations of inverse distance, of the logarithms of radius and blur, and of the ink.
const SPREAD: [f64; 4] = [0.05, 0.25, 0.3, 0.2];
/// What is known.
const FIXED: f64 = 1e-5;
/// The residuals' deviation that the fit starts from, and the least, of the ball's light.
const FIRST_SCALE: f64 = 0.1;
const MIN_SCALE: f64 = 0.01;
/// About so many unknowns are free.
const FREE: f64 = 12.0;
/// The longest turn of a step, radians.
const MAX_TURN: f64 = 0.15;
/// Rounds in which dots are placed beside each other, and the deviation that they have about where the match has them, ball radii.
const ROUNDS: usize = 3;
const PLACED: f64 = 0.06;
/// Of a dot whose pixels say less than this part of what is known, its place says nothing.
const SEEN: f64 = 0.5;

/// The ball's dots, and the ball as its outline has it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FitStart<'a> {
    /// The pattern's dots.
    pub dots: &'a [Vec3],
    pub view: BallView,
    /// Standard deviations of the outline's center per axis and of its radius, pixels.
    pub outline_sigma_px: [f64; 2],
    /// Whether the camera's distance is fitted.
    pub is_unknown: bool,
}

impl FitStart<'_> {
    fn seen(&self, fit: &PixelFit) -> Option<BallView> {
        match self.is_unknown {
            true => BallView::new(
                &Camera::Near {
                    inverse_distance: fit.inverse_distance,
                },
                fit.circle,
            ),
            false => self.view.at(fit.circle),
        }
        .ok()
    }
}

/// What a fit is made to: a ball's pixels, or those of the mirrored ball.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelProblem<'a> {
    pub pixels: &'a Pixels,
    pub start: &'a FitStart<'a>,
    pub is_mirrored: bool,
}

/// What is fitted.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelFit {
    /// Pattern to view frame.
    pub rotation: Rotation,
    pub circle: BallCircle,
    /// Ball radii over the camera's distance.
    pub inverse_distance: f64,
    ln_radius: f64,
    ln_blur: f64,
    ink: f64,
    light: [f64; SHADES],
    /// The residuals' deviation.
    pub scale: f64,
}

impl PixelFit {
    pub fn new(rotation: Rotation, start: &FitStart<'_>) -> Self {
        let mut light = [0.0; SHADES];
        light[0] = 1.0;
        Self {
            rotation,
            circle: *start.view.circle(),
            inverse_distance: start.view.horizon(),
            ln_radius: RHO.ln(),
            ln_blur: BLUR.ln(),
            ink: INK,
            light,
            scale: FIRST_SCALE,
        }
    }

    /// What is known of the unknowns from the fourth on: how far they are off, and the deviation.
    fn known(&self, start: &FitStart<'_>) -> [(f64, f64); OWN - 3] {
        let (a, b) = (start.view.circle(), &self.circle);
        let [center, radius] = start.outline_sigma_px;
        let distance = match start.is_unknown {
            true => SPREAD[0],
            false => FIXED,
        };
        [
            (a.center.u - b.center.u, center),
            (a.center.v - b.center.v, center),
            (a.radius - b.radius, radius),
            (start.view.horizon() - self.inverse_distance, distance),
            (RHO.ln() - self.ln_radius, SPREAD[1]),
            (BLUR.ln() - self.ln_blur, SPREAD[2]),
            (INK - self.ink, SPREAD[3]),
        ]
    }

    fn go(&mut self, mut step: SVector<f64, UNKNOWNS>) {
        let turn = step.fixed_rows::<3>(0).norm();
        step *= MAX_TURN / turn.max(MAX_TURN);
        let turn = Rotation::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
        self.rotation = Rotation::new_normalize((turn * self.rotation).into_inner());
        self.circle.center.u += step[3];
        self.circle.center.v += step[4];
        self.circle.radius += step[5].clamp(-0.3, 0.3);
        self.inverse_distance =
            (self.inverse_distance + step[6]).clamp(0.0, CameraModel::MAX_INVERSE_DISTANCE);
        self.ln_radius += step[7].clamp(-0.3, 0.3);
        self.ln_blur += step[8].clamp(-0.3, 0.3);
        self.ink = (self.ink + step[9]).clamp(0.05, 1.5);
        for (light, by) in self.light.iter_mut().zip(step.iter().skip(OWN)) {
            *light += by;
        }
    }
}

/// A visible dot.
#[derive(Debug, Clone, Copy)]
struct SeenPixels {
    name: u16,
    at: Pixel,
    blob: BlurredDot,
    /// Its place by turn, outline and inverse distance.
    by: SMatrix<f64, 2, 7>,
    /// How far it lies off that, and what the pixels say of that.
    moved: Vector2<f64>,
    information: Matrix2<f64>,
}

/// Fits; keeps its memory.
#[derive(Debug, Clone)]
pub(crate) struct Fitter {
    seen: Vec<SeenPixels>,
}

impl Default for Fitter {
    fn default() -> Self {
        Self {
            seen: Vec::with_capacity(MAX_DOTS),
        }
    }
}

impl Fitter {
    /// Fits for so many steps; `None` where that leads nowhere.
    pub fn fit(
        &mut self,
        problem: &PixelProblem<'_>,
        mut fit: PixelFit,
        steps: usize,
    ) -> Option<PixelFit> {
        let PixelProblem {
            pixels,
            start,
            is_mirrored,
        } = *problem;
        for _ in 0..steps {
            self.look(problem, &fit)?;
            let blur2 = (2.0 * fit.ln_blur).exp();
            let mut sums = Sums::<UNKNOWNS>::default();
            let variance = fit.scale * fit.scale;
            for sample in &pixels.samples {
                let (covered, mut by) = self.covered(pixels.at(sample, is_mirrored), blur2);
                by.iter_mut().for_each(|b| *b *= -fit.ink * sample.weight);
                let shades = pixels.shades(sample, is_mirrored);
                let light: f64 = shades.iter().zip(&fit.light).map(|(s, l)| s * l).sum();
                let residual = sample.weight * (sample.light - light + fit.ink * covered);
                let mut all = [0.0; UNKNOWNS];
                all[..9].copy_from_slice(&by);
                all[9] = -covered * sample.weight;
                for (to, shade) in all[OWN..].iter_mut().zip(&shades) {
                    *to = shade * sample.weight;
                }
                sums.add(&all, residual, LOSS.weight(residual * residual / variance));
            }
            // At the weights' fixed point the mean of their squares is the scale's.
            let count = pixels.samples.len() as f64;
            let next = sums.squares / (count - FREE).max(1.0);
            let mut normal = Normal {
                information: sums.symmetric() / variance,
                gradient: SVector::from(sums.gradient) / variance,
                cost: 0.0,
            };
            for (k, (off, sigma)) in fit.known(start).into_iter().enumerate() {
                normal.hold(3 + k, off, sigma);
            }
            // Held back: what is not seen, and long turns.
            (0..UNKNOWNS).for_each(|k| normal.hold(k, 0.0, if k < 3 { 1.0 } else { 100.0 }));
            fit.go(normal.step()?);
            fit.scale = next.sqrt().max(MIN_SCALE);
        }
        Some(fit)
    }

    /// Minus the logarithm of the likelihood, for residuals of a deviation.
    pub fn cost(&mut self, problem: &PixelProblem<'_>, fit: &PixelFit, scale: f64) -> Option<f64> {
        self.look(problem, fit)?;
        let term = |sample| {
            let residual = self.residual(problem, sample, fit) / scale;
            0.5 * LOSS.cost(residual * residual)
        };
        let known = fit
            .known(problem.start)
            .map(|(off, sigma)| (off / sigma).powi(2));
        let sum: f64 = problem.pixels.samples.iter().map(term).sum();
        Some(sum + 0.5 * known.iter().sum::<f64>())
    }

    /// The squares that a match leaves.
    pub fn squares(&mut self, problem: &PixelProblem<'_>, fit: &PixelFit) -> Option<f64> {
        self.look(problem, fit)?;
        let square = |sample| self.residual(problem, sample, fit).powi(2);
        Some(problem.pixels.samples.iter().map(square).sum())
    }

    fn residual(&self, problem: &PixelProblem<'_>, sample: &BallSample, fit: &PixelFit) -> f64 {
        let PixelProblem {
            pixels,
            is_mirrored,
            ..
        } = *problem;
        let at = pixels.at(sample, is_mirrored);
        let covered = |dot: &SeenPixels| dot.blob.at(&off(at, dot)).map_or(0.0, |(c, _)| c);
        let covered: f64 = self.seen.iter().map(covered).sum();
        let shades = pixels.shades(sample, is_mirrored);
        let light: f64 = shades.iter().zip(&fit.light).map(|(s, l)| s * l).sum();
        sample.weight * (sample.light - light + fit.ink * covered)
    }

    /// The visible dots.
    fn look(&mut self, problem: &PixelProblem<'_>, fit: &PixelFit) -> Option<()> {
        let view = problem.start.seen(fit)?;
        let turn = fit.rotation.to_rotation_matrix();
        let (circle, horizon) = (&fit.circle, view.horizon());
        let (radius, blur) = (fit.ln_radius.exp() * circle.radius, fit.ln_blur.exp());
        self.seen.clear();
        for (name, dot) in (0u16..).zip(problem.start.dots) {
            let direction = turn * dot;
            if direction.z < horizon + 0.02 {
                continue;
            }
            let at = view.project(&direction);
            let place = [
                (at.u - circle.center.u) / circle.radius,
                (at.v - circle.center.v) / circle.radius,
            ];
            let mut by = SMatrix::<f64, 2, 7>::zeros();
            let by_turn = view.jacobian(&direction) * -direction.cross_matrix();
            by.fixed_view_mut::<2, 3>(0, 0).copy_from(&by_turn);
            by.fixed_view_mut::<2, 3>(0, 3)
                .copy_from(&view.by_outline(&direction));
            if let Some(rate) = view.by_inverse_distance(&direction) {
                by.fixed_view_mut::<2, 1>(0, 6).copy_from(&rate);
            }
            self.seen.push(SeenPixels {
                name,
                at,
                blob: BlurredDot::new(place, direction.z - horizon, radius, blur)?,
                by,
                moved: Vector2::zeros(),
                information: Matrix2::zeros(),
            });
        }
        Some(())
    }

    /// The part of a pixel that the dots cover, and its derivatives by all but the ink and the light.
    fn covered(&self, at: Pixel, blur2: f64) -> (f64, [f64; 9]) {
        let (mut sum, mut by) = (0.0, SVector::<f64, 9>::zeros());
        for dot in &self.seen {
            let Some((covered, slope)) = dot.blob.at(&off(at, dot)) else {
                continue;
            };
            sum += covered;
            let by_place = dot.by.transpose() * (slope * covered);
            for k in 0..7 {
                by[k] += by_place[k];
            }
            let BlurredDot {
                inverse, by_radius, ..
            } = &dot.blob;
            let by_shape = |change: &Matrix2<f64>| {
                0.5 * (slope.dot(&(change * slope)) - (inverse * change).trace())
            };
            by[7] += covered * (2.0 + by_shape(by_radius));
            by[8] += covered * by_shape(&Matrix2::from_diagonal_element(2.0 * blur2));
        }
        (sum, by.into())
    }

    /// The visible dots where the pixels have them: each is moved in turn, the others where they are, with the light of the match.
    pub fn place(
        &mut self,
        problem: &PixelProblem<'_>,
        fit: &PixelFit,
        min_depth: f64,
        out: &mut Vec<PlacedDot>,
    ) {
        out.clear();
        if self.look(problem, fit).is_none() {
            return;
        }
        let sigma = PLACED * fit.circle.radius;
        let known = Matrix2::from_diagonal_element(1.0 / (sigma * sigma));
        let variance = fit.scale * fit.scale;
        for _ in 0..ROUNDS {
            for k in 0..self.seen.len() {
                let mut sums = Sums::<2>::default();
                for sample in &problem.pixels.samples {
                    let dot = &self.seen[k];
                    let Some((covered, slope)) = dot.blob.at(&off(sample.at, dot)) else {
                        continue;
                    };
                    let by = slope * (-fit.ink * covered * sample.weight);
                    let residual = self.residual(problem, sample, fit);
                    let weight = LOSS.weight(residual * residual / variance) / variance;
                    sums.add(by.as_ref(), residual, weight);
                }
                let dot = &mut self.seen[k];
                let information = sums.symmetric();
                let gradient = Vector2::from(sums.gradient) - known * dot.moved;
                if let Some(inverse) = (information + known).try_inverse() {
                    dot.moved += inverse * gradient;
                    dot.information = information;
                }
            }
        }
        let turn = fit.rotation.to_rotation_matrix();
        for dot in &self.seen {
            let is_seen = dot.information.determinant() > (SEEN * known).determinant();
            if (turn * problem.start.dots[usize::from(dot.name)]).z < min_depth || !is_seen {
                continue;
            }
            // Where the pixels alone have it.
            let Some(covariance) = dot.information.try_inverse() else {
                continue;
            };
            let moved = covariance * ((dot.information + known) * dot.moved);
            out.push(PlacedDot {
                name: dot.name,
                pixel: Pixel {
                    u: dot.at.u + moved.x,
                    v: dot.at.v + moved.y,
                },
                covariance,
            });
        }
    }
}

/// From a dot to a pixel.
fn off(at: Pixel, dot: &SeenPixels) -> Vector2<f64> {
    Vector2::new(at.u - dot.at.u - dot.moved.x, at.v - dot.at.v - dot.moved.y)
}
