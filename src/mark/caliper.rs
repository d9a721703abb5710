//! Dots laid off with a caliper: from which three, and how exact it must be.
//!
//! The first of three dots goes anywhere, the second at its distance from the first, the third at its
//! distances from both, and every other dot `d` at its straight distances `s_i` from these three, `p_i`.
//! On a ball of radius `R` (`s_i = R |d - p_i|`, unit vectors), `d . p_i = 1 - s_i^2 / (2 R^2)`: three
//! numbers that determine `d` where the `p_i` are independent, and leave its mirror image where their
//! plane holds the ball's center. So the triple of the largest `|det [p_1 p_2 p_3]|` is taken.
//!
//! A step `x` of `d` on its tangent plane changes `s_i` by `g_i . x`, with `g_i = -R p_i / s_i`
//! projected there (a unit vector along the distance). Distances that are off by `e_i`, from dots that are off by `x_i`, put `d` off by
//!
//! `x = G^+ (e - h)`, `h_i = g'_i . x_i`,
//!
//! `G` the rows `g_i`, `G^+` its pseudoinverse (where three arcs do not meet in one point, the middle is
//! taken), and `g'_i` the same gradient at the end of `p_i`. The first dot, and the direction from it to
//! the second, count as exact: an error of these turns the whole ball. That is linear in the six errors,
//! those of the three dots' own distances and of the three to `d`; the worst case has each at its bound
//! with the sign that hurts.

use nalgebra::{Matrix2, Matrix2x6, Matrix3x2, Vector6};

use crate::geometry::{Vec3, tangent_frame};

/// A place is good where it is off by at most this part of a dot's diameter.
const GOOD: f64 = 0.1;
/// Error that the sheet takes as its example, mm.
const EXAMPLE_MM: f64 = 0.1;

/// How errors of a caliper move the dots that are laid off with it.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Caliper {
    /// The three dots from which all others are laid off.
    pub from: [usize; 3],
    /// The dot that is off most.
    pub worst_dot: usize,
    /// How far it is off where every distance is off by at most one unit, without unit.
    pub worst_ratio: f64,
}

/// Three dots from which all others are laid off: those whose directions are the most independent.
/// `None` for fewer than three.
pub fn references(dots: &[Vec3]) -> Option<[usize; 3]> {
    let n = dots.len();
    let triples = (0..n).flat_map(|i| (0..i).flat_map(move |j| (0..j).map(move |k| [k, j, i])));
    let volume = |t: &[usize; 3]| dots[t[0]].dot(&dots[t[1]].cross(&dots[t[2]])).abs();
    triples.max_by(|a, b| volume(a).total_cmp(&volume(b)))
}

/// A dot's error on its tangent plane as a linear function of the six distances' errors.
#[derive(Clone, Copy)]
struct CaliperError {
    dot: Vec3,
    frame: [Vec3; 2],
    error: Matrix2x6<f64>,
}

impl CaliperError {
    /// A dot that has no error.
    fn exact(dot: Vec3) -> Self {
        Self {
            dot,
            frame: tangent_frame(&dot),
            error: Matrix2x6::zeros(),
        }
    }

    /// Gradient of the distance to `other` by steps on this dot's tangent plane.
    fn gradient(&self, other: &Vec3) -> [f64; 2] {
        let way = (self.dot - other).try_normalize(0.0).unwrap_or_default();
        self.frame.map(|axis| axis.dot(&way))
    }

    /// What an error of this dot, and the error `index`, change of the distance to `other`.
    fn change(&self, other: &Vec3, index: usize) -> Vector6<f64> {
        let [a, b] = self.gradient(other);
        let own = a * self.error.row(0) + b * self.error.row(1);
        let mut change = -own.transpose();
        change[index] += 1.0;
        change
    }

    /// A dot laid off from three others by the errors 3, 4 and 5.
    fn from_three(dot: Vec3, from: &[Self; 3]) -> Option<Self> {
        let mut laid = Self::exact(dot);
        let gradients = [0, 1, 2].map(|i| laid.gradient(&from[i].dot));
        let rows = Matrix3x2::from_fn(|i, k| gradients[i][k]);
        let inverse = rows.pseudo_inverse(1e-12).ok()?;
        for (i, other) in from.iter().enumerate() {
            laid.error += inverse.column(i) * other.change(&dot, 3 + i).transpose();
        }
        Some(laid)
    }

    /// The three: the second from the first by the error 0, the third from both by 1 and 2.
    fn three([a, b, c]: [Vec3; 3]) -> Option<[Self; 3]> {
        let first = Self::exact(a);
        let mut second = Self::exact(b);
        let along = second.gradient(&a);
        let length = along[0].hypot(along[1]);
        for (k, part) in along.iter().enumerate() {
            second.error[(k, 0)] = part / (length * length);
        }
        let mut third = Self::exact(c);
        let (to_a, to_b) = (third.gradient(&a), third.gradient(&b));
        let inverse = Matrix2::new(to_a[0], to_a[1], to_b[0], to_b[1]).try_inverse()?;
        third.error += inverse.column(0) * first.change(&c, 1).transpose();
        third.error += inverse.column(1) * second.change(&c, 2).transpose();
        Some([first, second, third])
    }

    /// The greatest error where each distance is off by at most one.
    fn worst(&self) -> f64 {
        let signs = (0..64u32)
            .map(|bits| Vector6::from_fn(|i, _| if bits >> i & 1 == 0 { 1.0 } else { -1.0 }));
        signs
            .map(|signs| (self.error * signs).norm())
            .fold(0.0, f64::max)
    }
}

impl Caliper {
    /// The errors of `dots` laid off from three of them.
    pub fn new(dots: &[Vec3], from: [usize; 3]) -> Self {
        let others = (0..dots.len()).filter(|i| !from.contains(i));
        let three = CaliperError::three(from.map(|i| dots[i]));
        let ratio = |i: usize| {
            let laid = three.and_then(|three| CaliperError::from_three(dots[i], &three));
            laid.map_or(f64::INFINITY, |laid| laid.worst())
        };
        let own = three.map_or(f64::INFINITY, |three| three[2].worst());
        let all = others.map(|i| (i, ratio(i))).chain([(from[2], own)]);
        let (worst_dot, worst_ratio) = all
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((from[2], own));
        Self {
            from,
            worst_dot,
            worst_ratio,
        }
    }

    /// The greatest error of the caliper, mm, at which every dot is off by at most a tenth of the dots'
    /// diameter.
    pub fn exact_to_mm(&self, dot_diameter_mm: f64) -> f64 {
        GOOD * dot_diameter_mm / self.worst_ratio
    }

    /// The same in lines for a sheet.
    pub(super) fn words(&self, dot_diameter_mm: f64) -> [String; 4] {
        let [a, b, c] = self.from;
        // Rounded down to what a caliper shows.
        let exact = (100.0 * self.exact_to_mm(dot_diameter_mm)).floor() / 100.0;
        [
            format!(
                "Begin with dots {a}, {b} and {c}: the first anywhere, the others at their distances, as the \
                 maps show."
            ),
            "Distances are straight through the ball (chords), as a caliper or dividers measure them."
                .to_owned(),
            format!(
                "A caliper that is off by {EXAMPLE_MM} mm puts a dot off by up to {:.2} mm (dot {}).",
                EXAMPLE_MM * self.worst_ratio,
                self.worst_dot,
            ),
            format!(
                "Measure to {exact:.2} mm to place dots within {:.2} mm, a tenth of a dot.",
                GOOD * dot_diameter_mm,
            ),
        ]
    }
}
