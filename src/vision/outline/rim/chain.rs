//! The normal equations of a limb's light and of what all of it shares.
//!
//! The light is known at knots around the rim and linear between them, so that each knot meets its two neighbors and the shared
//! unknowns alone: a closed chain. It is solved knot by knot; the last one stays with the shared unknowns.

use nalgebra::{Matrix3, SMatrix, SVector};

use super::limb::TERMS;
use crate::fit::Sums;

/// Knots around the rim.
pub(super) const KNOTS: usize = 16;
/// Unknowns of a knot: the light behind the ball, and the limb's terms.
pub(super) const LIGHTS: usize = 1 + TERMS;
/// Shared unknowns: the outline's center and radius, blur, the oval's two, darkening; the tone curve's bend.
pub(super) const SHARED: usize = 8;
/// Places of these.
pub(super) const BLUR: usize = 3;
pub(super) const OVAL: usize = 4;
pub(super) const DARKNESS: usize = 6;
/// Of these, all but the bend are fitted.
pub(super) const FITTED: usize = 7;
/// Unknowns that a pixel between two knots depends on.
pub(super) const BY_PIXEL: usize = 2 * LIGHTS + SHARED;
/// The last knot.
const LAST: usize = KNOTS - 1;
/// That and the shared unknowns, and the darkening's place there.
const ENDS: usize = LIGHTS + SHARED;
const DARK: usize = LIGHTS + DARKNESS;

type Knot = SMatrix<f64, LIGHTS, LIGHTS>;
type ToEnds = SMatrix<f64, LIGHTS, ENDS>;

/// The equations of all pixels.
#[derive(Debug)]
pub(super) struct LimbChain {
    own: [Knot; KNOTS],
    /// Each with the next.
    next: [Knot; KNOTS],
    shared: [SMatrix<f64, LIGHTS, SHARED>; KNOTS],
    gradient: [SVector<f64, LIGHTS>; KNOTS],
    of_shared: SMatrix<f64, SHARED, SHARED>,
    gradient_of_shared: SVector<f64, SHARED>,
}

impl Default for LimbChain {
    fn default() -> Self {
        Self {
            own: [Knot::zeros(); KNOTS],
            next: [Knot::zeros(); KNOTS],
            shared: [SMatrix::zeros(); KNOTS],
            gradient: [SVector::zeros(); KNOTS],
            of_shared: SMatrix::zeros(),
            gradient_of_shared: SVector::zeros(),
        }
    }
}

/// A step of Gauss and Newton.
pub(super) struct LimbStep {
    pub lights: [SVector<f64, LIGHTS>; KNOTS],
    pub shared: SVector<f64, SHARED>,
    /// The inverse information of the outline, where it is fitted.
    pub of_outline: Matrix3<f64>,
}

/// A knot that was eliminated: its step for no others, and what it loses by the ends' steps and the next knot's.
#[derive(Debug, Clone, Copy, Default)]
struct GoneKnot {
    by_rest: SVector<f64, LIGHTS>,
    by_ends: ToEnds,
    by_next: Knot,
}

/// What is left of the equations where all knots but the last are eliminated.
#[derive(Clone)]
pub(super) struct LimbEnds {
    gone: [GoneKnot; KNOTS],
    information: SMatrix<f64, ENDS, ENDS>,
    gradient: SVector<f64, ENDS>,
}

impl LimbChain {
    /// Adds the pixels between a knot and the next.
    pub fn add(&mut self, knot: usize, sums: &Sums<BY_PIXEL>) {
        let all = sums.symmetric();
        let gradient = SVector::from(sums.gradient);
        let after = (knot + 1) % KNOTS;
        for (place, at) in [(knot, 0), (after, LIGHTS)] {
            self.own[place] += all.fixed_view::<LIGHTS, LIGHTS>(at, at);
            self.shared[place] += all.fixed_view::<LIGHTS, SHARED>(at, 2 * LIGHTS);
            self.gradient[place] += gradient.fixed_rows::<LIGHTS>(at);
        }
        self.next[knot] += all.fixed_view::<LIGHTS, LIGHTS>(0, LIGHTS);
        self.of_shared += all.fixed_view::<SHARED, SHARED>(2 * LIGHTS, 2 * LIGHTS);
        self.gradient_of_shared += gradient.fixed_rows::<SHARED>(2 * LIGHTS);
    }

    /// Adds that neighbors are alike, by this weight, and that the terms beyond the first are none, by that.
    pub fn smooth(&mut self, light: &[SVector<f64, LIGHTS>; KNOTS], alike: f64, none: f64) {
        let least = SVector::<f64, LIGHTS>::from_fn(|k, _| if k < 2 { 0.0 } else { none });
        for knot in 0..KNOTS {
            let after = (knot + 1) % KNOTS;
            let step = light[after] - light[knot];
            self.gradient[knot] += step * alike - light[knot].component_mul(&least);
            self.gradient[after] -= step * alike;
            self.own[knot] += Knot::identity() * (2.0 * alike) + Knot::from_diagonal(&least);
            self.next[knot] -= Knot::identity() * alike;
        }
    }

    /// Adds that the limb sheds no negative light, its own and what is behind it together: by this weight where it would.
    pub fn lit(&mut self, light: &[SVector<f64, LIGHTS>; KNOTS], weight: f64) {
        let limb = SVector::<f64, LIGHTS>::from([1.0, 1.0, 0.0, 0.0]);
        for (knot, light) in light.iter().enumerate() {
            let lit = limb.dot(light);
            if lit < 0.0 {
                self.own[knot] += limb * limb.transpose() * weight;
                self.gradient[knot] -= limb * (lit * weight);
            }
        }
    }

    /// Adds what is known of a shared unknown.
    pub fn hold(&mut self, at: usize, off: f64, weight: f64) {
        self.of_shared[(at, at)] += weight;
        self.gradient_of_shared[at] += weight * off;
    }

    /// Eliminates all knots but the last. `None` where they are not bound.
    pub fn ends(&self) -> Option<LimbEnds> {
        let mut left = LimbEnds {
            gone: [GoneKnot::default(); KNOTS],
            information: self.of_ends(),
            gradient: SVector::zeros(),
        };
        left.gradient
            .rows_mut(0, LIGHTS)
            .copy_from(&self.gradient[LAST]);
        left.gradient
            .rows_mut(LIGHTS, SHARED)
            .copy_from(&self.gradient_of_shared);
        let (mut own, mut rest) = (self.own[0], self.gradient[0]);
        let mut to_ends = self.to_ends(0);
        for (knot, gone) in left.gone.iter_mut().enumerate().take(LAST) {
            let factor = own.cholesky()?;
            // The one before the last meets it as an end.
            let to_next = match knot + 1 {
                LAST => Knot::zeros(),
                _ => self.next[knot],
            };
            *gone = GoneKnot {
                by_rest: factor.solve(&rest),
                by_ends: factor.solve(&to_ends),
                by_next: factor.solve(&to_next),
            };
            left.information -= to_ends.transpose() * gone.by_ends;
            left.gradient -= to_ends.transpose() * gone.by_rest;
            own = self.own[knot + 1] - to_next.transpose() * gone.by_next;
            rest = self.gradient[knot + 1] - to_next.transpose() * gone.by_rest;
            to_ends = self.to_ends(knot + 1) - to_next.transpose() * gone.by_ends;
        }
        Some(left)
    }

    /// The spread of the fitted unknowns by how much the sectors of the rim contradict each other: each pulls at them by its own pixels, whose
    /// gradients these are, and where all pixels are at rest, some pull one way and others another.
    pub fn spread_of_sectors(
        mut self,
        pulls: &[SVector<f64, BY_PIXEL>; KNOTS],
    ) -> Option<SMatrix<f64, FITTED, FITTED>> {
        // The inverse information is symmetric: what all pulls do to an unknown is what a pull at that does to all.
        self.gradient = [SVector::zeros(); KNOTS];
        self.gradient_of_shared = SVector::zeros();
        let ends = self.ends()?;
        let (inverse, mut pulled) = ends.solved::<{ LIGHTS + FITTED }>()?;
        let mut steps = SMatrix::<f64, FITTED, KNOTS>::zeros();
        for unknown in 0..FITTED {
            pulled
                .rows_mut(0, LIGHTS + FITTED)
                .copy_from(&inverse.column(LIGHTS + unknown));
            let LimbStep { lights, shared, .. } = ends.along(&pulled, Matrix3::zeros());
            for (knot, pull) in pulls.iter().enumerate() {
                steps[(unknown, knot)] = lights[knot].dot(&pull.fixed_rows::<LIGHTS>(0))
                    + lights[(knot + 1) % KNOTS].dot(&pull.fixed_rows::<LIGHTS>(LIGHTS))
                    + shared.dot(&pull.fixed_rows::<SHARED>(2 * LIGHTS));
            }
        }
        Some(steps * steps.transpose() * (KNOTS as f64 / (KNOTS - FITTED) as f64))
    }

    /// The information of the last knot and of the shared unknowns.
    fn of_ends(&self) -> SMatrix<f64, ENDS, ENDS> {
        let mut all = SMatrix::<f64, ENDS, ENDS>::zeros();
        let shared = &self.shared[LAST];
        all.fixed_view_mut::<LIGHTS, LIGHTS>(0, 0)
            .copy_from(&self.own[LAST]);
        all.fixed_view_mut::<LIGHTS, SHARED>(0, LIGHTS)
            .copy_from(shared);
        all.fixed_view_mut::<SHARED, LIGHTS>(LIGHTS, 0)
            .copy_from(&shared.transpose());
        all.fixed_view_mut::<SHARED, SHARED>(LIGHTS, LIGHTS)
            .copy_from(&self.of_shared);
        all
    }

    /// How a knot meets the last one, where it is its neighbor, and the shared unknowns.
    fn to_ends(&self, knot: usize) -> ToEnds {
        let mut to_ends = ToEnds::zeros();
        let to_last = match knot {
            0 => self.next[LAST].transpose(),
            _ if knot + 1 == LAST => self.next[knot],
            _ => Knot::zeros(),
        };
        to_ends.fixed_columns_mut::<LIGHTS>(0).copy_from(&to_last);
        to_ends
            .fixed_columns_mut::<SHARED>(LIGHTS)
            .copy_from(&self.shared[knot]);
        to_ends
    }
}

impl LimbEnds {
    /// The inverse information of the first `N` shared unknowns and of the last knot, the others as they are, and the ends' step.
    fn solved<const N: usize>(&self) -> Option<(SMatrix<f64, N, N>, SVector<f64, ENDS>)> {
        const { assert!(N >= LIGHTS && N <= ENDS) };
        let information = self.information.fixed_view::<N, N>(0, 0).into_owned();
        let inverse = information.cholesky()?.inverse();
        let mut step = SVector::<f64, ENDS>::zeros();
        step.rows_mut(0, N)
            .copy_from(&(inverse * self.gradient.rows(0, N)));
        Some((inverse, step))
    }

    /// The step of the lights alone.
    pub fn light_step(&self) -> Option<LimbStep> {
        Some(self.along(&self.solved::<LIGHTS>()?.1, Matrix3::zeros()))
    }

    /// The step of the lights and of the fitted unknowns. The darkening stays within bounds: where its own step, from where it is, would lead beyond,
    /// the others are solved for one that ends there.
    pub fn step(&self, darkening: f64) -> Option<LimbStep> {
        let (inverse, mut ends) = self.solved::<{ LIGHTS + FITTED }>()?;
        let bounded = (darkening + ends[DARK]).clamp(0.0, 1.0) - darkening;
        if bounded != ends[DARK] {
            let mut held = self.clone();
            held.gradient -= self.information.column(DARK) * bounded;
            ends = held.solved::<DARK>()?.1;
            ends[DARK] = bounded;
        }
        let of_outline = inverse.fixed_view::<3, 3>(LIGHTS, LIGHTS);
        Some(self.along(&ends, of_outline.into_owned()))
    }

    /// All that follows from the ends' step.
    fn along(&self, ends: &SVector<f64, ENDS>, of_outline: Matrix3<f64>) -> LimbStep {
        let mut lights = [SVector::zeros(); KNOTS];
        lights[LAST] = ends.fixed_rows::<LIGHTS>(0).into_owned();
        for knot in (0..LAST).rev() {
            let gone = &self.gone[knot];
            lights[knot] = gone.by_rest - gone.by_ends * *ends - gone.by_next * lights[knot + 1];
        }
        LimbStep {
            lights,
            shared: ends.fixed_rows::<SHARED>(LIGHTS).into_owned(),
            of_outline,
        }
    }

    /// The inverse information of the fitted unknowns, and by how much a unit of the tone curve's bend moves them.
    pub fn fitted(&self) -> Option<(SMatrix<f64, FITTED, FITTED>, SVector<f64, FITTED>)> {
        const N: usize = LIGHTS + FITTED;
        let (inverse, _) = self.solved::<N>()?;
        let by_bend = self.information.fixed_view::<N, 1>(0, ENDS - 1);
        let moved = -(inverse * by_bend);
        Some((
            inverse
                .fixed_view::<FITTED, FITTED>(LIGHTS, LIGHTS)
                .into_owned(),
            moved.fixed_rows::<FITTED>(LIGHTS).into_owned(),
        ))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const ALL: usize = KNOTS * LIGHTS + SHARED;

    /// The knot, the derivatives and the residual of a pixel.
    type RimPixel = (usize, [f64; BY_PIXEL], f64);

    fn random_pixels(rng: &mut ChaCha8Rng) -> Vec<RimPixel> {
        let pixels = (0..40 * KNOTS).map(|k| {
            let by = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
            (k % KNOTS, by, rng.random_range(-1.0..1.0))
        });
        pixels.collect()
    }

    /// The same equations without regard to the chain.
    fn dense(pixels: &[RimPixel]) -> (DMatrix<f64>, DVector<f64>) {
        let (mut information, mut gradient) = (DMatrix::zeros(ALL, ALL), DVector::zeros(ALL));
        for (knot, by, residual) in pixels {
            let mut row = DVector::zeros(ALL);
            for k in 0..LIGHTS {
                row[knot * LIGHTS + k] = by[k];
                row[(knot + 1) % KNOTS * LIGHTS + k] = by[LIGHTS + k];
            }
            for k in 0..SHARED {
                row[KNOTS * LIGHTS + k] = by[2 * LIGHTS + k];
            }
            information += &row * row.transpose();
            gradient += row * *residual;
        }
        (information, gradient)
    }

    #[test]
    fn the_chain_is_solved_as_a_whole() {
        let rng = &mut ChaCha8Rng::seed_from_u64(6_430_001);
        let pixels = random_pixels(rng);
        let mut chain = LimbChain::default();
        for knot in 0..KNOTS {
            let mut sums = Sums::<BY_PIXEL>::default();
            for (_, by, residual) in pixels.iter().filter(|p| p.0 == knot) {
                sums.add(by, *residual, 1.0);
            }
            chain.add(knot, &sums);
        }
        let (information, gradient) = dense(&pixels);
        let ends = chain.ends().expect("bound");
        let kept = KNOTS * LIGHTS + FITTED;
        let part = information.view((0, 0), (kept, kept)).into_owned();
        let inverse = part.try_inverse().expect("regular");
        let expected = &inverse * gradient.rows(0, kept);
        let LimbStep { lights, shared, .. } = ends.step(0.5).expect("a step");
        for (knot, light) in lights.iter().enumerate() {
            let off = light - expected.fixed_rows::<LIGHTS>(knot * LIGHTS);
            assert!(off.norm() < 1e-9, "{knot}: {off}");
        }
        for k in 0..FITTED {
            assert!((shared[k] - expected[KNOTS * LIGHTS + k]).abs() < 1e-9);
        }
        let (of_fitted, by_bend) = ends.fitted().expect("regular");
        let moved = -(&inverse * information.view((0, ALL - 1), (kept, 1)));
        for k in 0..FITTED {
            let at = KNOTS * LIGHTS + k;
            assert!((of_fitted[(k, k)] - inverse[(at, at)]).abs() < 1e-9);
            assert!((by_bend[k] - moved[at]).abs() < 1e-9);
        }
        // Held, the lights alone.
        let kept = KNOTS * LIGHTS;
        let part = information.view((0, 0), (kept, kept)).into_owned();
        let all = part.try_inverse().expect("regular") * gradient.rows(0, kept);
        let LimbStep { lights, shared, .. } = ends.light_step().expect("a step");
        assert!((lights[3][1] - all[3 * LIGHTS + 1]).abs() < 1e-9);
        assert_eq!(shared.norm(), 0.0);
    }

    /// Each sector's step by the inverse of all equations, where the lights of all knots are fitted with it.
    #[test]
    fn sectors_spread_by_their_own_steps() {
        let rng = &mut ChaCha8Rng::seed_from_u64(6_470_002);
        let pixels = random_pixels(rng);
        let kept = KNOTS * LIGHTS + FITTED;
        let (information, _) = dense(&pixels);
        let part = information.view((0, 0), (kept, kept)).into_owned();
        let inverse = part.try_inverse().expect("regular");
        let (mut chain, mut pulls) = (LimbChain::default(), [SVector::zeros(); KNOTS]);
        let mut expected = DMatrix::zeros(FITTED, FITTED);
        for (knot, pull) in pulls.iter_mut().enumerate() {
            let of_sector: Vec<_> = pixels.iter().filter(|p| p.0 == knot).copied().collect();
            let mut sums = Sums::<BY_PIXEL>::default();
            for (_, by, residual) in &of_sector {
                sums.add(by, *residual, 1.0);
            }
            chain.add(knot, &sums);
            *pull = SVector::from(sums.gradient);
            let step = &inverse * dense(&of_sector).1.rows(0, kept);
            let step = step.rows(KNOTS * LIGHTS, FITTED).into_owned();
            expected += &step * step.transpose();
        }
        expected *= 16.0 / 9.0;
        let spread = chain.spread_of_sectors(&pulls).expect("bound");
        for (found, expected) in spread.iter().zip(expected.iter()) {
            assert!((found - expected).abs() < 1e-9, "{spread} {expected}");
        }
    }

    #[test]
    fn no_light_is_negative() {
        // Pixels ask for none; two knots have less, one of them no less than what is behind it.
        let mut light = [SVector::from([0.2, 0.3, 0.0, 0.0]); KNOTS];
        light[3][1] = -0.5;
        light[9][1] = -0.1;
        let mut chain = LimbChain::default();
        chain.smooth(&light, 1e-6, 1e-6);
        for knot in 0..KNOTS {
            chain.own[knot] += Knot::identity();
        }
        (0..SHARED).for_each(|k| chain.hold(k, 0.0, 1.0));
        chain.lit(&light, 1e6);
        let step = chain.ends().and_then(|ends| ends.light_step());
        let lights = step.expect("a step").lights;
        let limb = |knot: usize| (light[knot] + lights[knot]).rows(0, 2).sum();
        assert!(limb(3).abs() < 1e-5, "{}", limb(3));
        for other in [0, 2, 4, 9, 15] {
            assert!(lights[other].amax() < 1e-5, "{other}: {}", lights[other]);
        }
    }
}
