//! How far a ball turns while the shutter is open, by how its dots are smeared.
//!
//! A dot at `m` moves along `v = J (w x m) + u` in the image while the ball turns by the rotation vector `w` and moves by `u`
//! pixels, `J` the derivative of the projection. What moves evenly by `v` is blurred by the covariance `v v^T / 12` (a box as long as
//! `v`), beside the lens's and the pixel's `b I`:
//!
//! ```text
//! s = b + |v|^2 / 24,   p = (v_u^2 - v_v^2) / 24,   q = v_u v_v / 12
//! ```
//!
//! as [`DotBlur`] has them. `w` and `b` are fitted to the dots of a frame. Where the ball does not move, `w` and `-w` smear
//! alike: the sign is open. In `w w^T` and `b` the equations are linear, which gives the start.
//!
//! A dot that smears by more than its diameter is no cap any more: it is rarely measured, and what is measured of it is too short.
//! That it is not measured is evidence, too. With the length `x = |v| / 2 a` of a smear over the dot's diameter, a dot's own smear
//! is measured with the probability `d(x)`, an outlier with `o(x)`, and otherwise nothing:
//!
//! ```text
//! ln p = sum_measured ln(d(x) t(square) + o(x) t(25)) + sum_others ln(1 - d(x) - o(x))
//! ```
//!
//! `t` is the density of the blurs' residuals (Student). Turns beyond [`Smear::max_turn`] are as likely as that.

use nalgebra::{Matrix2x3, Matrix3, SMatrix, Vector2, Vector3};

pub use super::cap::DotBlur;
use crate::fit::{DampedDescent, Damping, Normal, Student};
use crate::geometry::Vec3;
use crate::vision::optics::camera::BallView;

/// Fewer dots give no turn.
const MIN_DOTS: usize = 3;
/// Steps to the best turn.
const DAMPING: Damping = Damping {
    first: 1e-3,
    down: 0.1,
    up: 10.0,
    most: f64::INFINITY,
    steps: 30,
};
/// A smaller step, radians, ends the iteration.
const CONVERGED: f64 = 1e-6;
/// Standard deviation of what the model leaves out of a blur's covariance: of it, of the square of the dot's radius (ovals and
/// streaks), and px^2.
const MODEL_ERROR: [f64; 3] = [0.12, 0.003, 0.05];
/// Rounds of weights for the lens's blur.
const REWEIGHTED: usize = 4;
/// The dots' loss: print beside a dot smears it otherwise.
const LOSS: Student = Student::new(4, 3);
/// A turn that moves a dot that faces the camera by so many diameters is the largest that is measured: of longer smears too little
/// is, and too short.
const MAX_LENGTH: f64 = 1.4;
/// The share of named dots whose own smear is measured, by the length of the smear over the dot's diameter.
/// `bench smear --frames 400 --seed 771 --max-turn-deg 40`: the blurs of 65, 60, 59, 58, 54, 45, 21, 9 and 12 % are measured up to
/// 0.25, 0.5, 0.75, 1, 1.25, 1.5, 2, 3 diameters and beyond; 3, 3, 4, 4, 6, 7, 22, 84 and 69 % of these are outliers.
const DETECTED: Logistic = Logistic {
    short: 0.61,
    long: 0.0,
    half: 1.5,
    width: 0.2,
};
/// The share of which an outlier is measured, by the same table.
const OUTLIERS: Logistic = Logistic {
    short: 0.025,
    long: 0.08,
    half: 1.6,
    width: 0.15,
};
/// The squared residual at which an outlier is as likely as a smear of the dot's own: five deviations.
const OUTLIER_SQUARE: f64 = 25.0;

/// A share that goes from one value to another as smears get longer.
struct Logistic {
    short: f64,
    long: f64,
    /// The length between the two, over the dot's diameter, and the width of the change.
    half: f64,
    width: f64,
}

impl Logistic {
    fn at(&self, length: f64) -> f64 {
        let share = 1.0 / (1.0 + ((self.half - length) / self.width).exp());
        self.short + (self.long - self.short) * share
    }
}

/// How a ball turns during an exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// Rotation vector over the exposure in the frame of the pose, radians. Without a motion of the ball its negative is as
    /// likely.
    pub rotation: Vec3,
    /// Its covariance, rad^2.
    pub covariance: Matrix3<f64>,
    /// Variance of the blur of lens and pixels, px^2.
    pub lens: f64,
    /// Ln likelihood over that of a ball that does not turn. With little of it the angle is too large: noise smears, too.
    pub evidence: f64,
}

impl Turn {
    /// The angle, radians.
    pub fn angle(&self) -> f64 {
        self.rotation.norm()
    }

    /// The angle's standard deviation, radians.
    pub fn sigma(&self) -> f64 {
        match self.rotation.try_normalize(1e-9) {
            Some(axis) => axis.dot(&(self.covariance * axis)).max(0.0).sqrt(),
            None => (self.covariance.trace() / 3.0).sqrt(),
        }
    }
}

/// A dot's blur, and how its middle moves with the ball.
struct Smeared {
    by_turn: Matrix2x3<f64>,
    /// Its diameter in the image, pixels.
    diameter: f64,
    blur: Vector3<f64>,
    information: Matrix3<f64>,
}

/// Named dots whose blur is not measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnmeasuredDots<'a> {
    /// Their middles, unit vectors in the view frame.
    pub middles: &'a [Vec3],
    /// Their angular radius, radians.
    pub radius: f64,
}

/// A dot whose blur is not measured: how its middle moves with the ball, and its diameter.
struct Unmeasured {
    by_turn: Matrix2x3<f64>,
    diameter: f64,
}

/// A dot under a turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmearedDot {
    /// How far it moves, over its diameter.
    pub length: f64,
    /// The squared residual of its blur, three degrees of freedom; `None` where it is not measured.
    pub square: Option<f64>,
}

/// The dots of a frame, ready to be compared with turns.
pub struct Smear {
    dots: Vec<Smeared>,
    others: Vec<Unmeasured>,
    radius: f64,
    shift: Vector2<f64>,
}

impl Smear {
    /// Of the dots of a ball that moves by `shift` pixels while the shutter is open, for turns in the camera frame; `None` of fewer
    /// than three.
    pub fn new(
        view: &BallView,
        blurs: &[DotBlur],
        others: UnmeasuredDots<'_>,
        shift: Vector2<f64>,
    ) -> Option<Self> {
        let to_view = view.to_camera().inverse().to_rotation_matrix();
        let by_turn = |middle: &Vec3| view.jacobian(middle) * -middle.cross_matrix() * to_view;
        let ball = view.circle().radius;
        let smeared = blurs.iter().filter_map(|dot| {
            let radius = dot.radius * ball;
            let [of_blur, of_radius, px2] = MODEL_ERROR;
            let left_out = Vector3::new(of_blur * dot.blur.x, of_radius * radius * radius, px2);
            let covariance =
                dot.covariance + Matrix3::from_diagonal_element(left_out.norm_squared());
            Some(Smeared {
                by_turn: by_turn(&dot.middle),
                diameter: 2.0 * radius,
                blur: dot.blur,
                information: covariance.try_inverse()?,
            })
        });
        let dots: Vec<Smeared> = smeared.collect();
        let unmeasured = others.middles.iter().map(|middle| Unmeasured {
            by_turn: by_turn(middle),
            diameter: 2.0 * others.radius * ball,
        });
        (dots.len() + others.middles.len() >= MIN_DOTS).then(|| Self {
            dots,
            others: unmeasured.collect(),
            radius: others.radius,
            shift,
        })
    }

    /// The likeliest turn, by the dots that are measured; `None` where they do not fix it.
    pub fn turn(&self) -> Option<Turn> {
        if self.dots.len() < MIN_DOTS {
            return None;
        }
        let start = self.start()?;
        let ends = [start, -start].map(|from| self.refined(&from));
        let likelier = |a: Turn, b: Turn| if b.evidence > a.evidence { b } else { a };
        ends.into_iter().flatten().reduce(likelier)
    }

    /// Ln likelihood of a turn, with the blur of lens and pixels that suits it best, up to a constant that all turns share.
    pub fn ln_likelihood(&self, rotation: &Vec3) -> f64 {
        let rotation = rotation.cap_magnitude(self.max_turn());
        let of_dot = |dot: SmearedDot| {
            let (own, outlier) = (DETECTED.at(dot.length), OUTLIERS.at(dot.length));
            match dot.square {
                Some(square) => (own * ln_density(square).exp()
                    + outlier * ln_density(OUTLIER_SQUARE).exp())
                .ln(),
                None => (1.0 - own - outlier).ln(),
            }
        };
        self.dots_under(&rotation).map(of_dot).sum()
    }

    /// The largest turn that is measured, radians; that a larger one is larger is all that the dots show.
    pub fn max_turn(&self) -> f64 {
        MAX_LENGTH * 2.0 * self.radius
    }

    /// Each dot under a turn, with the blur of lens and pixels that suits it best: those that are measured first.
    pub fn dots_under(&self, rotation: &Vec3) -> impl Iterator<Item = SmearedDot> {
        let lens = self.lens(rotation);
        let length = move |by_turn: &Matrix2x3<f64>, diameter: f64| {
            (by_turn * rotation + self.shift).norm() / diameter
        };
        let dots = self.dots.iter().map(move |dot| SmearedDot {
            length: length(&dot.by_turn, dot.diameter),
            square: Some(self.square(dot, rotation, lens)),
        });
        let others = self.others.iter().map(move |dot| SmearedDot {
            length: length(&dot.by_turn, dot.diameter),
            square: None,
        });
        dots.chain(others)
    }

    /// Ln likelihood of the blurs that are measured alone, were all of them a dot's smear.
    fn ln_of_blurs(&self, rotation: &Vec3) -> f64 {
        let lens = self.lens(rotation);
        let of_dot = |dot| ln_density(self.square(dot, rotation, lens));
        self.dots.iter().map(of_dot).sum()
    }

    /// The lens's blur under a turn, px^2.
    fn lens(&self, rotation: &Vec3) -> f64 {
        let mut lens = None;
        for _ in 0..REWEIGHTED {
            let (mut information, mut gradient) = (0.0, 0.0);
            for dot in &self.dots {
                let weight = lens.map_or(1.0, |lens| LOSS.weight(self.square(dot, rotation, lens)));
                let row = dot.information.row(0);
                let rest = dot.blur - self.smeared(dot, rotation).0;
                information += weight * row[0];
                gradient += weight * row.dot(&rest.transpose());
            }
            lens = Some((gradient / information).max(0.0));
        }
        lens.unwrap_or(0.0)
    }

    /// A dot's squared residual.
    fn square(&self, dot: &Smeared, rotation: &Vec3, lens: f64) -> f64 {
        let rest = dot.blur - self.smeared(dot, rotation).0 - Vec3::x() * lens;
        rest.dot(&(dot.information * rest))
    }

    /// What a turn adds to a dot's blur, and its derivative by the turn.
    fn smeared(&self, dot: &Smeared, rotation: &Vec3) -> (Vector3<f64>, Matrix3<f64>) {
        let v = dot.by_turn * rotation + self.shift;
        let blur = Vector3::new(
            v.norm_squared() / 24.0,
            (v.x * v.x - v.y * v.y) / 24.0,
            v.x * v.y / 12.0,
        );
        let by_v = SMatrix::<f64, 3, 2>::new(v.x, v.y, v.x, -v.y, v.y, v.x) / 12.0;
        (blur, by_v * dot.by_turn)
    }

    /// By `w w^T`: the linear equations without the ball's motion.
    fn start(&self) -> Option<Vec3> {
        const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
        let mut normal = Normal::<7>::default();
        normal.information.fill_diagonal(1e-9);
        for dot in &self.dots {
            let [a, b] = [0, 1].map(|k| dot.by_turn.row(k).transpose());
            let mut by = SMatrix::<f64, 3, 7>::zeros();
            for (k, (i, j)) in PAIRS.into_iter().enumerate() {
                let twice = if i == j { 0.5 } else { 1.0 };
                let product = |x: &Vec3, y: &Vec3| twice * (x[i] * y[j] + x[j] * y[i]);
                by[(0, k)] = (product(&a, &a) + product(&b, &b)) / 24.0;
                by[(1, k)] = (product(&a, &a) - product(&b, &b)) / 24.0;
                by[(2, k)] = product(&a, &b) / 12.0;
            }
            by[(0, 6)] = 1.0;
            normal.add(&by, &dot.blur, &dot.information);
        }
        let found = normal.step()?;
        let mut square = Matrix3::zeros();
        for (k, (i, j)) in PAIRS.into_iter().enumerate() {
            square[(i, j)] = found[k];
            square[(j, i)] = found[k];
        }
        let eigen = square.symmetric_eigen();
        let largest = eigen.eigenvalues.imax();
        let length = eigen.eigenvalues[largest].max(1e-6).sqrt();
        Some(eigen.eigenvectors.column(largest) * length)
    }

    /// Damped steps from a turn.
    fn refined(&self, from: &Vec3) -> Option<Turn> {
        let found = DAMPING.descend(Turned::new(self, *from).with_equations());
        Some(Turn {
            rotation: found.rotation,
            covariance: found.equations.0.try_inverse()?,
            lens: self.lens(&found.rotation),
            evidence: found.ln_likelihood - self.ln_of_blurs(&Vec3::zeros()),
        })
    }

    /// Information and gradient of a turn; the lens's blur is eliminated.
    fn equations(&self, rotation: &Vec3) -> (Matrix3<f64>, Vec3) {
        let lens = self.lens(rotation);
        let mut normal = Normal::<4>::default();
        for dot in &self.dots {
            let weight = LOSS.weight(self.square(dot, rotation, lens));
            let (blur, by_turn) = self.smeared(dot, rotation);
            let rest = dot.blur - blur - Vec3::x() * lens;
            let mut by = SMatrix::<f64, 3, 4>::zeros();
            by.fixed_columns_mut::<3>(0).copy_from(&by_turn);
            by[(0, 3)] = 1.0;
            normal.add(&by, &rest, &(dot.information * weight));
        }
        let Normal {
            information,
            gradient,
            ..
        } = normal;
        let cross = information.fixed_view::<3, 1>(0, 3).into_owned();
        let of_lens = information[(3, 3)];
        (
            information.fixed_view::<3, 3>(0, 0) - cross * cross.transpose() / of_lens,
            gradient.fixed_rows::<3>(0) - cross * (gradient[3] / of_lens),
        )
    }
}

/// Ln of the density of a blur, up to a constant.
fn ln_density(square: f64) -> f64 {
    -0.5 * LOSS.cost(square)
}

/// A turn on its way to the blurs' maximum likelihood.
struct Turned<'a> {
    smear: &'a Smear,
    rotation: Vec3,
    ln_likelihood: f64,
    /// Information and gradient there.
    equations: (Matrix3<f64>, Vec3),
}

impl<'a> Turned<'a> {
    fn new(smear: &'a Smear, rotation: Vec3) -> Self {
        Self {
            smear,
            rotation,
            ln_likelihood: smear.ln_of_blurs(&rotation),
            equations: (Matrix3::zeros(), Vec3::zeros()),
        }
    }

    fn with_equations(mut self) -> Self {
        self.equations = self.smear.equations(&self.rotation);
        self
    }
}

impl DampedDescent for Turned<'_> {
    fn cost(&self) -> f64 {
        -self.ln_likelihood
    }

    fn stepped(&self, damping: f64) -> Option<Self> {
        let (information, gradient) = &self.equations;
        let damped = information + Matrix3::identity() * (damping * information.trace());
        let step = damped.cholesky()?.solve(gradient);
        Some(Self::new(self.smear, self.rotation + step))
    }

    fn follow(&mut self, before: Self) -> bool {
        self.equations = self.smear.equations(&self.rotation);
        (self.rotation - before.rotation).norm() >= CONVERGED
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::optics::camera::{BallCircle, Camera, Pixel};

    const NONE: UnmeasuredDots<'_> = UnmeasuredDots {
        middles: &[],
        radius: 0.09,
    };

    fn view() -> BallView {
        let camera = Camera::Near {
            inverse_distance: 0.08,
        };
        let center = Pixel { u: 50.0, v: 40.0 };
        BallView::new(&camera, BallCircle::new(center, 60.0)).expect("a value")
    }

    /// The blur of points that move evenly, by sums over their places: nothing of the model's formula.
    fn blurs(view: &BallView, turn: &Vec3, shift: Vector2<f64>, lens: f64) -> Vec<DotBlur> {
        const STEPS: usize = 2000;
        let middles = [
            Vec3::new(0.1, 0.2, 1.0),
            Vec3::new(-0.5, 0.1, 0.8),
            Vec3::new(0.3, -0.6, 0.7),
            Vec3::new(0.5, 0.4, 0.6),
        ];
        let blur = |middle: Vec3| {
            let middle = middle.normalize();
            let places: Vec<Vector2<f64>> = (0..STEPS)
                .map(|k| {
                    let time = (k as f64 + 0.5) / STEPS as f64 - 0.5;
                    let turned = crate::geometry::Rotation::from_scaled_axis(turn * time) * middle;
                    let at = view.project(&turned);
                    Vector2::new(at.u, at.v) + shift * time
                })
                .collect();
            let mean = places.iter().sum::<Vector2<f64>>() / STEPS as f64;
            let covariance = places
                .iter()
                .map(|p| (p - mean) * (p - mean).transpose())
                .sum::<nalgebra::Matrix2<f64>>()
                / STEPS as f64;
            DotBlur {
                middle,
                radius: 0.09,
                blur: Vector3::new(
                    lens + covariance.trace() / 2.0,
                    (covariance[(0, 0)] - covariance[(1, 1)]) / 2.0,
                    covariance[(0, 1)],
                ),
                covariance: Matrix3::identity() * 1e-4,
            }
        };
        middles.map(blur).to_vec()
    }

    #[test]
    fn the_turn_is_that_of_points_that_move() {
        let view = view();
        let turn = Vec3::new(0.05, -0.08, 0.06);
        let blurs = blurs(&view, &turn, Vector2::zeros(), 0.5);
        let found = Smear::new(&view, &blurs, NONE, Vector2::zeros()).and_then(|s| s.turn());
        let found = found.expect("a turn");
        let error = (found.rotation - turn)
            .norm()
            .min((found.rotation + turn).norm());
        assert!(error < 0.02 * turn.norm(), "{found:?}");
        assert!((found.lens - 0.5).abs() < 0.02, "{found:?}");
        assert!(found.evidence > 10.0, "{found:?}");
    }

    #[test]
    fn the_motion_of_the_ball_gives_the_sign() {
        let view = view();
        let (turn, shift) = (Vec3::new(0.03, 0.07, -0.05), Vector2::new(3.0, -1.0));
        for turn in [turn, -turn] {
            let blurs = blurs(&view, &turn, shift, 0.4);
            let smear = Smear::new(&view, &blurs, NONE, shift).expect("enough dots");
            let found = smear.turn().expect("a turn");
            assert!(
                (found.rotation - turn).norm() < 0.03 * turn.norm(),
                "{found:?}"
            );
            assert!(smear.ln_likelihood(&turn) > smear.ln_likelihood(&-turn) + 5.0);
        }
    }

    #[test]
    fn sharp_dots_refute_a_fast_spin() {
        let view = view();
        let blurs = blurs(&view, &Vec3::zeros(), Vector2::zeros(), 0.5);
        let smear = Smear::new(&view, &blurs, NONE, Vector2::zeros()).expect("enough dots");
        let fast = Vec3::new(0.0, 0.7, 0.0);
        assert!(smear.ln_likelihood(&Vec3::zeros()) > smear.ln_likelihood(&fast) + 7.0);
        assert!(smear.turn().is_some_and(|t| t.evidence < 0.5));
        assert!(Smear::new(&view, &blurs[..2], NONE, Vector2::zeros()).is_none());
    }
}
