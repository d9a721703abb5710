//! What a lens does to the image of a pinhole: OpenCV's models of distortion.
//!
//! A ray through `(x, y)` at unit depth (`x` right, `y` down) is seen at `(x', y')` times the focal lengths. With
//! `r^2 = x^2 + y^2`, the polynomial model (D. C. Brown, "Decentering distortion of lenses", Photogrammetric Engineering 32,
//! 1966; its rational and thin-prism terms as in OpenCV's `calib3d`) is
//!
//! ```text
//! g  = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
//! x' = g x + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + s2 r^4
//! y' = g y + p1 (r^2 + 2 y^2) + 2 p2 x y + s3 r^2 + s4 r^4
//! ```
//!
//! and the fisheye model (J. Kannala, S. Brandt, "A generic camera model and calibration method", TPAMI 28, 2006), with
//! `t = atan r`, is `x' = x t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8) / r`, and alike for `y'`.
//!
//! The inverse is found by Newton's method. Both models fold back far from the axis; what lies beyond the fold is no ray.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Newton steps of the inverse: from the seen point it converges from one side, two digits and more a step.
const STEPS: usize = 50;
/// Where the inverse ends, at unit depth: a millionth of a pixel of any camera.
const EXACT: f64 = 1e-13;
/// Below this radius the fisheye's ratio is its limit, to the last digit.
const MIDDLE: f64 = 1e-8;

/// A lens. The parameters are those of OpenCV, by its names.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Lens {
    /// No distortion.
    #[default]
    Ideal,
    /// Radial (k1 to k3, over k4 to k6), tangential (p1, p2), of a thin prism (s1 to s4).
    Polynomial {
        /// k1 to k6.
        k: [f64; 6],
        /// p1, p2.
        p: [f64; 2],
        /// s1 to s4.
        s: [f64; 4],
    },
    /// Equidistant, with k1 to k4.
    Fisheye {
        /// k1 to k4.
        k: [f64; 4],
    },
}

impl Lens {
    /// The polynomial lens of OpenCV's `distCoeffs`: k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, 0, 0]]]].
    ///
    /// # Errors
    /// [`Error::Argument`] for another number of coefficients, one that is not finite, or a tilted sensor (the last two
    /// of 14 not zero).
    pub fn polynomial(coefficients: &[f64]) -> Result<Self> {
        let expected = |what: &str| Err(Error::argument("distortion", format!("expected {what}")));
        if coefficients.iter().any(|c| !c.is_finite()) {
            return expected("finite coefficients");
        }
        let at = |i: usize| coefficients.get(i).copied().unwrap_or(0.0);
        if ![0, 4, 5, 8, 12, 14].contains(&coefficients.len()) {
            let count = coefficients.len();
            return expected(&format!("0, 4, 5, 8 or 12 coefficients, found {count}"));
        }
        if at(12) != 0.0 || at(13) != 0.0 {
            return expected("a sensor that is not tilted: the last two of 14 coefficients 0");
        }
        if coefficients.iter().all(|c| *c == 0.0) {
            return Ok(Self::Ideal);
        }
        Ok(Self::Polynomial {
            k: [at(0), at(1), at(4), at(5), at(6), at(7)],
            p: [at(2), at(3)],
            s: [at(8), at(9), at(10), at(11)],
        })
    }

    /// The fisheye lens of OpenCV's `fisheye` module: k1 to k4. All zero is an equidistant lens, not an ideal one.
    ///
    /// # Errors
    /// [`Error::Argument`] for another number of coefficients, or one that is not finite.
    pub fn fisheye(coefficients: &[f64]) -> Result<Self> {
        match coefficients.try_into() {
            Ok(k) if coefficients.iter().all(|c| c.is_finite()) => Ok(Self::Fisheye { k }),
            _ => {
                let problem =
                    format!("expected 4 finite coefficients of a fisheye, found {coefficients:?}");
                Err(Error::argument("distortion", problem))
            }
        }
    }

    /// Where the ray through a point at unit depth is seen, and the derivative of that.
    pub fn distort(&self, at: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        match self {
            Self::Ideal => (*at, Matrix2::identity()),
            Self::Polynomial { k, p, s } => polynomial(k, p, s, at),
            Self::Fisheye { k } => fisheye(k, at),
        }
    }

    /// The point at unit depth that is seen at `seen`; `None` where the model shows none there.
    pub fn undistort(&self, seen: &Vector2<f64>) -> Option<Vector2<f64>> {
        if *self == Self::Ideal {
            return Some(*seen);
        }
        let mut at = *seen;
        for _ in 0..STEPS {
            let (shown, jacobian) = self.distort(&at);
            let off = seen - shown;
            // Beyond a fold the image runs backwards.
            if !(jacobian.determinant() > 0.0 && jacobian.trace() > 0.0) {
                return None;
            }
            if off.norm() <= EXACT * (1.0 + seen.norm()) {
                return Some(at);
            }
            at += jacobian.try_inverse()? * off;
        }
        None
    }
}

fn polynomial(
    k: &[f64; 6],
    p: &[f64; 2],
    s: &[f64; 4],
    at: &Vector2<f64>,
) -> (Vector2<f64>, Matrix2<f64>) {
    let (x, y, r2) = (at.x, at.y, at.norm_squared());
    let cubic = |a: &[f64]| 1.0 + r2 * (a[0] + r2 * (a[1] + r2 * a[2]));
    let slope = |a: &[f64]| a[0] + r2 * (2.0 * a[1] + r2 * 3.0 * a[2]);
    let (over, under) = (cubic(&k[..3]), cubic(&k[3..]));
    let g = over / under;
    let g_slope = (slope(&k[..3]) - g * slope(&k[3..])) / under;
    let shown = Vector2::new(
        g * x + 2.0 * p[0] * x * y + p[1] * (r2 + 2.0 * x * x) + r2 * (s[0] + s[1] * r2),
        g * y + p[0] * (r2 + 2.0 * y * y) + 2.0 * p[1] * x * y + r2 * (s[2] + s[3] * r2),
    );
    let prism = [s[0] + 2.0 * s[1] * r2, s[2] + 2.0 * s[3] * r2];
    // By r^2, whose derivative is 2 (x, y).
    let by_square = at * g_slope + Vector2::new(prism[0], prism[1]);
    let tangential = Matrix2::new(
        2.0 * p[0] * y + 6.0 * p[1] * x,
        2.0 * (p[0] * x + p[1] * y),
        2.0 * (p[0] * x + p[1] * y),
        6.0 * p[0] * y + 2.0 * p[1] * x,
    );
    let jacobian = Matrix2::identity() * g + by_square * (2.0 * at).transpose() + tangential;
    (shown, jacobian)
}

fn fisheye(k: &[f64; 4], at: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    let r = at.norm();
    if r < MIDDLE {
        return (*at, Matrix2::identity());
    }
    let t = r.atan();
    let t2 = t * t;
    let seen = t * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
    let slope = 1.0 + t2 * (3.0 * k[0] + t2 * (5.0 * k[1] + t2 * (7.0 * k[2] + t2 * 9.0 * k[3])));
    let (ratio, along) = (seen / r, slope / (1.0 + r * r));
    let direction = at / r;
    let jacobian =
        Matrix2::identity() * ratio + direction * direction.transpose() * (along - ratio);
    (at * ratio, jacobian)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lenses() -> [Lens; 5] {
        let of = |c: &[f64]| Lens::polynomial(c).expect("a lens");
        [
            of(&[-0.28, 0.09, 0.0012, -0.0001, 0.0]),
            of(&[0.1, -0.02, 0.003, 0.004]),
            of(&[1.2, 0.4, 1e-3, -2e-3, 0.03, 1.5, 0.6, 0.07]),
            of(&[
                -0.1, 0.02, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2e-3, 1e-3, -1e-3, 5e-4,
            ]),
            Lens::fisheye(&[-0.02, 0.004, -0.002, 0.0004]).expect("a lens"),
        ]
    }

    #[test]
    fn the_derivative_is_that_of_differences_and_the_inverse_leads_back() {
        for lens in lenses() {
            for (x, y) in [
                (0.0, 0.0),
                (0.3, -0.2),
                (-0.45, 0.4),
                (1e-9, 0.0),
                (0.0, 0.6),
            ] {
                let at = Vector2::new(x, y);
                let (seen, jacobian) = lens.distort(&at);
                for (axis, step) in [Vector2::x(), Vector2::y()]
                    .map(|e| 1e-6 * e)
                    .iter()
                    .enumerate()
                {
                    let change = lens.distort(&(at + step)).0 - lens.distort(&(at - step)).0;
                    let off = change / 2e-6 - jacobian.column(axis);
                    assert!(off.norm() < 1e-8, "{lens:?} {at:?}: {off:?}");
                }
                let back = lens.undistort(&seen).expect("a ray");
                assert!((back - at).norm() < 1e-12, "{lens:?} {at:?}: {back:?}");
            }
        }
    }

    #[test]
    fn beyond_the_fold_there_is_no_ray() {
        // r (1 - 0.3 r^2) has its maximum at r = 1.05: 0.70.
        let lens = Lens::polynomial(&[-0.3, 0.0, 0.0, 0.0]).expect("a lens");
        assert!(lens.undistort(&Vector2::new(0.69, 0.0)).is_some());
        assert_eq!(lens.undistort(&Vector2::new(0.72, 0.0)), None);
        assert_eq!(lens.undistort(&Vector2::new(f64::NAN, 0.0)), None);
    }

    #[test]
    fn other_coefficients_are_refused() {
        assert_eq!(Lens::polynomial(&[0.0; 14]).expect("a lens"), Lens::Ideal);
        for (coefficients, word) in [
            (vec![0.1; 3], "found 3"),
            (vec![0.1; 14], "tilted"),
            (vec![f64::NAN; 4], "finite"),
        ] {
            let error = Lens::polynomial(&coefficients)
                .expect_err("no lens")
                .to_string();
            assert!(error.contains(word), "{error}");
        }
        assert!(Lens::fisheye(&[0.1; 5]).is_err());
    }
}
