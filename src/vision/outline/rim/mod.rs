//! A ball's outline by the image's own pixels.
//!
//! The light at `x` pixels within the outline, in the direction `a` from its middle, is what is behind the ball, and within what the
//! ball's surface shows, blurred as a whole by a Gaussian of `s`:
//!
//! ```text
//! light = l0(a) + E_n [ (l1(a) + l2(a) z + l3(a) z^2) (1 - p (1 - z)^5), x + s n > 0 ],   n ~ N(0, 1),   z = z(x + s n)
//! ```
//!
//! with the facing `z` of the surface at that depth ([`limb`]): a grazing surface mirrors what is behind the ball. No light is negative. The lights `l` are known at knots around the rim, linear between them, and no more
//! uneven than the pixels ask for; the outline's center and radius, `s` and the darkening `p` are one for all of it. So neither the tone curve, which makes a
//! bright ball larger, nor shading, which makes its dark side smaller, moves the outline, and a side that fades into the wall is bound by the others.
//! All are fitted together, Gauss-Newton with the weights of Student's distribution, so that a shadow, print or a hand counts little; dots are left out.
//! Of large balls at first means of squares of pixels are read, so that an outline is found that is off by a twentieth of the radius.
//!
//! Dots are smeared by the ball's turn, its rim is not: its blur is its own. The tone curve `light = (1 - q) I + q I^2` is the dots', and what is not known of it adds
//! to the covariance, and so does what the sectors of the rim contradict each other by: a finger, print or a shadow pulls at its own sector, the others pull
//! back (K.-Y. Liang, S. Zeger, "Longitudinal data analysis using generalized linear models", Biometrika 73, 1986). In the end an [oval](Oval) is fitted besides: what `cos 2a` and `sin 2a` add to the radius.
//!
//! Not promised: an outline where the ball is not within a twentieth of its radius of where it was found.

mod band;
mod chain;
mod limb;
mod state;
#[cfg(test)]
mod tests;

use nalgebra::{Matrix2, Matrix3, SMatrix, Vector2};

use self::band::RimBand;
use self::chain::{FITTED, LimbChain, OVAL};
use self::limb::LimbTable;
pub(crate) use self::state::RimShape;
use self::state::{FoundRim, LEAST_BLUR, LimbState, RimBall};
use crate::geometry::Vec3;
use crate::vision::dots::cap::CapShape;
use crate::vision::frame::outline::Outline;
use crate::vision::optics::ball_pixels::BallPixels;
use crate::vision::optics::camera::{BallCircle, Pixel};
use crate::vision::optics::oval::{Oval, drawn_out, of_circle};

/// Fewer are no rim.
const MIN_PIXELS: usize = 100;
/// Squares of pixels are read as long as the radius has more of them than this.
const COARSE: f64 = 11.0;
const MAX_LEVEL: u32 = 5;
/// A square's own blur, of its side.
const SQUARE_BLUR: f64 = 0.35;
/// The blur that the fit starts from, where that of the dots is not less, pixels.
const SHARP: f64 = 1.0;
/// Standard deviation of the light from a knot to the next, of the ball's light; of what is not even, that over the root of the second.
const UNEVEN: f64 = 0.4;
const NOT_EVEN: f64 = 0.3;
/// Standard deviation of a negative light, of the ball's light: there is none.
const NEGATIVE: f64 = 0.03;
/// The noise that the first step supposes, of the ball's light.
const FIRST_NOISE: f64 = 0.02;
/// The least variance of the values: that of what is rounded to a byte.
const LEAST_VARIANCE: f64 = 1e-6;
/// Steps of a fit; from this one on by half: whole ones go to and fro where the darkening is hardly seen.
const STEPS: usize = 12;
const HALVED: usize = 4;
/// The last may be so many times as long as one that ends a fit.
const CREEPING: f64 = 4.0;
/// Maximum change of the outline: pixels, or this part of the radius where that is more.
const MAX_CHANGE: (f64, f64) = (1.5, 0.06);
/// After a larger one it is fitted again about the changed outline, pixels.
const FAR: f64 = 0.25;
/// An outline whose center is known worse says nothing, radii.
const MAX_ERROR: f64 = 0.03;
/// Standard deviation of what draws an outline out beside the camera, pixels, over the radius where that is more.
const OVAL_ERROR: (f64, f64) = (0.05, 0.0005);
/// An outline that is drawn out by so many deviations is an ellipse.
const CLEAR_OVAL: f64 = 4.0;

/// Fits outlines; keeps its memory.
#[derive(Debug, Default)]
pub(crate) struct RimFitter {
    band: RimBand,
    table: LimbTable,
}

/// A covariance of what is fitted.
type Spread = SMatrix<f64, FITTED, FITTED>;

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
                ..moved(circle, &self.change)
            },
            covariance: self.covariance,
            ..*outline
        }
    }

    /// The same where the camera is not known, and how far the outline is drawn out in all: an ellipse where that is beyond doubt.
    pub fn correct_drawn_out(
        &self,
        circle: &BallCircle,
        outline: &Outline,
    ) -> (Outline, Option<Oval>) {
        let now = moved(circle, &self.change);
        let mean = now.radius * of_circle(&now.eccentricity).0;
        let seen = |circle| Outline {
            circle,
            covariance: self.covariance,
            ..*outline
        };
        let round = BallCircle::new(now.center, mean);
        let Some(mut oval) = self.oval else {
            return (seen(now), None);
        };
        oval.stretch_px += drawn_out(&now).0;
        let error = OVAL_ERROR.0.max(OVAL_ERROR.1 * mean);
        oval.covariance += Matrix2::from_diagonal_element(error * error);
        let square = oval.covariance.try_inverse();
        let square = square.map_or(0.0, |inverse| {
            oval.stretch_px.dot(&(inverse * oval.stretch_px))
        });
        let half = oval.stretch_px.norm();
        let ellipse = (square > CLEAR_OVAL * CLEAR_OVAL && half < 0.5 * mean).then(|| {
            let (shorter, longer) = (mean - half, mean + half);
            let angle = 0.5 * oval.stretch_px.y.atan2(oval.stretch_px.x);
            let along = Vector2::new(angle.cos(), angle.sin());
            let side = if along.dot(&now.eccentricity) < 0.0 {
                -1.0
            } else {
                1.0
            };
            BallCircle {
                radius: shorter,
                eccentricity: along * (side * (1.0 - (shorter / longer).powi(2)).sqrt()),
                ..round
            }
        });
        (seen(ellipse.unwrap_or(round)), Some(oval))
    }
}

/// Adds what is known of light, blur, darkening and oval, for pixels with this variance and a ball of so much light.
fn hold(chain: &mut LimbChain, ball: &RimBall, state: &LimbState, (noise, scale): (f64, f64)) {
    let alike = noise / (UNEVEN * scale).powi(2);
    chain.smooth(&state.light, alike, NOT_EVEN * alike);
    chain.lit(&state.light, noise / (NEGATIVE * scale).powi(2));
    ball.hold(state, chain, noise);
}

fn moved(circle: &BallCircle, change: &Vec3) -> BallCircle {
    BallCircle {
        center: Pixel {
            u: circle.center.u + change.x,
            v: circle.center.v + change.y,
        },
        radius: circle.radius + change.z,
        ..*circle
    }
}

/// The blur that a fit to squares of pixels starts from, pixels: `side` is that of the pixels that are halved so often.
fn expected_blur(of_dots: &CapShape, side: f64, level: u32) -> f64 {
    let sharp = of_dots.blur.min(SHARP * side);
    let square = side * f64::from(1u32 << level);
    let blur = match level {
        0 => sharp,
        _ => sharp.hypot(SQUARE_BLUR * square),
    };
    blur.max(LEAST_BLUR * square)
}

impl RimFitter {
    /// Fits the rim about the outline of a view, by the tone curve of the ball's dots. `hidden` are circles of the image that show something else.
    pub fn fit(
        &mut self,
        pixels: &BallPixels<'_>,
        (shape, of_dots): (RimShape, &CapShape),
        hidden: impl Iterator<Item = BallCircle>,
    ) -> Option<RimFit> {
        self.band.hide(hidden);
        let start = *pixels.view.circle();
        let in_squares = start.radius / pixels.grid.side / COARSE;
        let coarsest = (in_squares.max(1.0).log2() as u32).min(MAX_LEVEL);
        let mut change = Vec3::zeros();
        let mut last = None;
        for level in (1..=coarsest).rev() {
            let view = pixels.view.at(moved(&start, &change)).ok()?;
            let about = BallPixels {
                view: &view,
                ..*pixels
            };
            if let Some(found) =
                self.fit_at(&about, (RimShape::AsViewed, of_dots), level, last.as_ref())
            {
                change += found.state.change;
                last = Some(found.state);
            }
        }
        let most = MAX_CHANGE.0.max(MAX_CHANGE.1 * start.radius);
        for round in 0..2 {
            let view = pixels.view.at(moved(&start, &change)).ok()?;
            let about = BallPixels {
                view: &view,
                ..*pixels
            };
            let found = self.fit_at(&about, (shape, of_dots), 0, last.as_ref())?;
            change += found.state.change;
            if round > 0 || found.state.change.amax() < FAR {
                let covariance = found.covariance(&of_dots.tone)?;
                let spread = self.spread(&found)?;
                let covariance = covariance + spread.fixed_view::<3, 3>(0, 0);
                let variance = covariance[(0, 0)].max(covariance[(1, 1)]);
                let is_clear =
                    change.amax() < most && variance < (MAX_ERROR * start.radius).powi(2);
                return is_clear.then(|| RimFit {
                    change,
                    covariance,
                    oval: self.oval(found, spread),
                });
            }
            last = Some(found.state);
        }
        None
    }

    /// By how much the outline is drawn out, by the pixels that were read last.
    fn oval(&mut self, found: FoundRim, spread: Spread) -> Option<Oval> {
        let (free, spread) = match found.ball.shape {
            RimShape::DrawnOut => (found, spread),
            RimShape::AsViewed => {
                let ball = RimBall {
                    shape: RimShape::DrawnOut,
                    ..found.ball
                };
                let free = self.iterate(ball, found.state, 0)?;
                let spread = self.spread(&free)?;
                (free, spread)
            }
        };
        let (inverse, _) = free.ends.fitted()?;
        Some(Oval {
            stretch_px: free.state.oval,
            covariance: inverse.fixed_view::<2, 2>(OVAL, OVAL) * free.scatter()
                + spread.fixed_view::<2, 2>(OVAL, OVAL),
        })
    }

    /// By how much the sectors of the rim contradict each other.
    fn spread(&mut self, found: &FoundRim) -> Option<Spread> {
        let FoundRim {
            ball, state, noise, ..
        } = found;
        self.table
            .make(ball.radius, state.blur, state.darkening, ball.depths);
        let (mut chain, pulls) = self.band.pulls(&self.table, state, ball.bend);
        let scale = self.band.light_scale(ball.bend);
        hold(&mut chain, ball, state, (*noise, scale));
        chain.spread_of_sectors(&pulls)
    }

    /// Fits means of squares of pixels, of two to the power of `level` a side.
    fn fit_at(
        &mut self,
        pixels: &BallPixels<'_>,
        (shape, of_dots): (RimShape, &CapShape),
        level: u32,
        last: Option<&LimbState>,
    ) -> Option<FoundRim> {
        let blur = expected_blur(of_dots, pixels.grid.side, level);
        let ball = RimBall {
            shape,
            radius: pixels.view.circle().radius,
            blur,
            bend: of_dots.tone.bend,
            depths: self.band.read(pixels, blur, level)?,
        };
        let side = pixels.grid.side * f64::from(1u32 << level);
        let state = LimbState::after(last, blur, side);
        self.iterate(ball, state, usize::from(last.is_none()))
    }

    /// From a state to the best one by the pixels that were read last, the first `begun` steps of the light alone.
    fn iterate(&mut self, ball: RimBall, mut state: LimbState, begun: usize) -> Option<FoundRim> {
        if self.band.count() < MIN_PIXELS {
            return None;
        }
        let scale = self.band.light_scale(ball.bend);
        for round in 0..STEPS {
            self.table
                .make(ball.radius, state.blur, state.darkening, ball.depths);
            let (mut chain, scatter) = self.band.equations(&self.table, &state, ball.bend);
            let noise = match round < begun {
                true => (FIRST_NOISE * scale).powi(2),
                false => scatter.max(LEAST_VARIANCE),
            };
            hold(&mut chain, &ball, &state, (noise, scale));
            let ends = chain.ends()?;
            let step = match round < begun {
                true => ends.light_step()?,
                false => ends.step(state.darkening)?,
            };
            let part = if round < HALVED { 1.0 } else { 0.5 };
            let length = state.go(&step, part, noise);
            state.noise = (round >= begun).then_some(noise);
            let is_last = round + 1 == STEPS;
            if round > begun && length < if is_last { CREEPING } else { 1.0 } {
                return Some(FoundRim {
                    ball,
                    state,
                    ends,
                    noise,
                });
            }
        }
        None
    }
}
