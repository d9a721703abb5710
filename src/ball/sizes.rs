//! How large ball and dots are where nobody says.

use super::Ball;

/// Diameter of a ball of which nothing is known, mm: table tennis.
pub const USUAL_BALL_MM: f64 = 40.0;

/// Diameter of dots of which nothing is known, mm: a tenth of the ball's, to a tenth of a millimeter.
pub fn usual_dot_mm(ball_mm: f64) -> f64 {
    to_tenth(0.1 * ball_mm)
}

fn to_tenth(mm: f64) -> f64 {
    (10.0 * mm).round() / 10.0
}

impl Ball {
    /// Diameters of ball and dots, mm: those stated; else those that the pattern was designed for; else
    /// [`USUAL_BALL_MM`] and [`usual_dot_mm`]. On a ball of another size than designed for dots are as much
    /// larger or smaller, to a tenth of a millimeter.
    pub fn sizes_mm(&self, ball_mm: Option<f64>, dot_mm: Option<f64>) -> [f64; 2] {
        let Some(design) = self.design() else {
            let ball = ball_mm.unwrap_or(USUAL_BALL_MM);
            return [ball, dot_mm.unwrap_or_else(|| usual_dot_mm(ball))];
        };
        let ball = ball_mm.unwrap_or(design.ball_diameter_mm);
        let designed = match ball == design.ball_diameter_mm {
            true => design.dot_diameter_mm,
            false => to_tenth(ball * design.dot_diameter()),
        };
        [ball, dot_mm.unwrap_or(designed)]
    }
}
