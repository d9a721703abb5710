//! The derivative through the false poses.

use super::polynomials::Polynomials;
use super::rivals::{Rival, Rivals, frame};
use super::views::Views;
use super::weight::{Weight, squared};
use super::{Kernel, Sums, VIEWS};
use crate::geometry::Vec3;

/// Collects the derivative.
pub(super) struct Backward<'a> {
    pub dots: &'a [Vec3],
    pub found: &'a Rivals,
    pub views: &'a Views,
    pub kernel: &'a Kernel,
    pub slopes: &'a Sums,
    pub scale: f64,
    /// By a dot's mean probability of detection, by dot and direction.
    pub by_seen: Vec<f64>,
    /// By how well the dots of a rival coincide.
    pub by_value: Vec<f64>,
    pub gradient: Vec<Vec3>,
}

impl Backward<'_> {
    /// Adds what a rival adds.
    pub fn rival(&mut self, rival: &Rival, weight: &Weight, polynomials: &mut Polynomials) {
        let by_weight = polynomials.back(self.slopes, self.views);
        let value = self.scale * weight.value;
        let by_ln_weight = by_weight * value;
        // By how well each dot coincides, and by its visibilities.
        self.by_value.clear();
        for (&(dot, g), slope) in polynomials.dots.iter().zip(&polynomials.slopes) {
            let seen = self.views.of(dot);
            let by_seen = &mut self.by_seen[dot * VIEWS..(dot + 1) * VIEWS];
            let mut by_value = 0.0;
            for v in 0..VIEWS {
                let by_term = value * slope[v];
                by_value += by_term * seen[v];
                by_seen[v] += by_term * g;
            }
            self.by_value.push(by_value);
        }
        let mut torque = Vec3::zeros();
        let mut next = 0;
        for m in self.found.matches_of(rival) {
            let (seen, other) = (usize::from(m.seen), usize::from(m.other));
            while polynomials.dots[next].0 != seen {
                next += 1;
            }
            let (_, g) = polynomials.dots[next];
            let by_dot = self.by_value[next];
            // By the dots' squared distance: through what coincides, and through the weight.
            let others = if m.value < 1.0 {
                (1.0 - g) / (1.0 - m.value)
            } else {
                0.0
            };
            let distance = squared(self.dots, rival, m.seen, m.other);
            let (w, w_slope) = self.kernel.pair_weight(distance);
            let mut by_distance = by_dot * others * m.slope;
            if w > 0.0 {
                let p = self.dots[seen];
                let mut by_w = -p.dot(&(weight.invariant * p)) / weight.second;
                for (s, o) in rival.pair.iter().zip(&rival.onto) {
                    if (*s, *o) == (seen, other) {
                        by_w += 1.0 / w;
                    }
                }
                by_distance += by_ln_weight * by_w * w_slope;
                // By where the seen dot is, in the moments.
                self.gradient[seen] -=
                    by_ln_weight / weight.second * 2.0 * w * (weight.invariant * p);
            }
            let (p, q) = (self.dots[seen], rival.rotation * self.dots[other]);
            self.gradient[seen] -= 2.0 * by_distance * q;
            self.gradient[other] -= 2.0 * by_distance * rival.rotation.tr_mul(&p);
            torque -= 2.0 * by_distance * q.cross(&p);
        }
        if weight.window > 0.0 {
            let r = &rival.rotation;
            let by_trace = by_ln_weight * weight.window_slope / weight.window;
            torque += by_trace
                * Vec3::new(
                    r[(1, 2)] - r[(2, 1)],
                    r[(2, 0)] - r[(0, 2)],
                    r[(0, 1)] - r[(1, 0)],
                );
        }
        let [i, k] = rival.pair;
        let (a, b) = (self.dots[i], self.dots[k]);
        let cross = a.cross(&b);
        let by_cross = by_ln_weight * cross / cross.norm_squared();
        self.gradient[i] += b.cross(&by_cross);
        self.gradient[k] += by_cross.cross(&a);
        self.turn(rival.pair, &torque);
        self.turn(rival.onto, &(-rival.rotation.tr_mul(&torque)));
    }

    /// Adds the derivative through the frame of a pair that turns with its dots.
    fn turn(&mut self, [i, k]: [usize; 2], torque: &Vec3) {
        let (a, b) = (self.dots[i], self.dots[k]);
        let Some(frame) = frame(&a, &b) else { return };
        let [mid, normal, third] = [0, 1, 2].map(|c| frame.column(c).into_owned());
        let [t1, t2, t3] = [mid, normal, third].map(|axis| torque.dot(&axis));
        let by_mid = (t3 * normal - t2 * third) / (a + b).norm();
        let by_cross = t1 * third / a.cross(&b).norm();
        self.gradient[i] += by_mid + b.cross(&by_cross);
        self.gradient[k] += by_mid + by_cross.cross(&a);
    }
}
