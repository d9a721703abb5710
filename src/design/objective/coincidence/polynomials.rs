//! How many of the dots in view coincide under a false pose: elementary symmetric polynomials.
//!
//! Of the `k` dots that are detected all coincide with `e_k(s g) / e_k(s)`, the share of the sets of
//! `k` dots, weighed by their visibilities `s`.

use super::rivals::{Rival, Rivals};
use super::views::Views;
use super::{COUNTS, MAX_COUNT, MIN_COUNT, Sums, VIEWS};

/// The polynomials of one rival, by direction.
pub(super) struct Polynomials {
    /// Of each dot that coincides: its number, and how well.
    pub dots: Vec<(usize, f64)>,
    /// The visibilities of these, times how well they coincide.
    terms: Vec<[f64; VIEWS]>,
    /// `e_0` to `e_MAX_COUNT`.
    values: [[f64; VIEWS]; MAX_COUNT + 1],
    /// The derivatives by the terms.
    pub slopes: Vec<[f64; VIEWS]>,
}

impl Default for Polynomials {
    fn default() -> Self {
        Self {
            dots: Vec::new(),
            terms: Vec::new(),
            values: [[0.0; VIEWS]; MAX_COUNT + 1],
            slopes: Vec::new(),
        }
    }
}

/// `a += b * c` in every direction.
fn add_product(a: &mut [f64; VIEWS], b: &[f64; VIEWS], c: &[f64; VIEWS]) {
    for v in 0..VIEWS {
        a[v] += b[v] * c[v];
    }
}

impl Polynomials {
    /// The polynomials of a rival.
    pub fn fill(&mut self, found: &Rivals, rival: &Rival, views: &Views) {
        self.dots.clear();
        // Matches come in the order of the seen dots.
        for m in found.matches_of(rival) {
            let seen = usize::from(m.seen);
            match self.dots.last_mut() {
                Some((dot, g)) if *dot == seen => *g = 1.0 - (1.0 - *g) * (1.0 - m.value),
                _ => self.dots.push((seen, m.value)),
            }
        }
        self.terms.clear();
        self.values[0] = [1.0; VIEWS];
        for values in self.values.iter_mut().skip(1).take(self.dots.len()) {
            *values = [0.0; VIEWS];
        }
        for (done, &(dot, g)) in self.dots.iter().enumerate() {
            let seen = views.of(dot);
            let term: [f64; VIEWS] = std::array::from_fn(|v| g * seen[v]);
            for k in (1..=MAX_COUNT.min(done + 1)).rev() {
                let (below, at) = self.values.split_at_mut(k);
                add_product(&mut at[0], &term, &below[k - 1]);
            }
            self.terms.push(term);
        }
    }

    /// The largest degree that is not zero.
    fn degree(&self) -> usize {
        self.dots.len().min(MAX_COUNT)
    }

    /// Adds the rival's shares with a weight.
    pub fn add_to(&self, sums: &mut Sums, weight: f64, views: &Views) {
        for k in MIN_COUNT..=self.degree() {
            let (sums, values) = (&mut sums.of[k - MIN_COUNT], &self.values[k]);
            let inverse = &views.inverse_subsets[k - MIN_COUNT];
            for v in 0..VIEWS {
                sums[v] += weight * values[v] * inverse[v];
            }
        }
    }

    /// The derivative of the value by the rival's weight; those by the terms, for a weight of one,
    /// are left in `slopes`. Afterwards the polynomials are used up.
    pub fn back(&mut self, by_sums: &Sums, views: &Views) -> f64 {
        let degree = self.degree();
        let mut by_values = [[0.0; VIEWS]; COUNTS + MIN_COUNT];
        let mut total = 0.0;
        let counted = by_values.iter_mut().zip(&self.values).take(degree + 1);
        for (k, (by_value, values)) in counted.enumerate().skip(MIN_COUNT) {
            let c = k - MIN_COUNT;
            for (v, by_value) in by_value.iter_mut().enumerate() {
                *by_value = by_sums.of[c][v] * views.inverse_subsets[c][v];
                total += *by_value * values[v];
            }
        }
        self.slopes.resize(self.dots.len(), [0.0; VIEWS]);
        for i in (0..self.dots.len()).rev() {
            let term = &self.terms[i];
            let mut slope = [0.0; VIEWS];
            for k in 1..=degree.min(i + 1) {
                // Takes the dot out of the polynomial again, in ascending order.
                let (below, at) = self.values.split_at_mut(k);
                let (below, at) = (&below[k - 1], &mut at[0]);
                for v in 0..VIEWS {
                    at[v] -= term[v] * below[v];
                    slope[v] += by_values[k][v] * below[v];
                }
            }
            for k in 1..=degree {
                let (below, at) = by_values.split_at_mut(k);
                add_product(&mut below[k - 1], term, &at[0]);
            }
            self.slopes[i] = slope;
        }
        total
    }
}
