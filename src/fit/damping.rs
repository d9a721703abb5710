//! Steps that go downhill only (K. Levenberg, 1944; D. Marquardt, 1963).

/// A state from which damped steps lead on.
pub(crate) trait DampedDescent: Sized {
    /// What is to be least.
    fn cost(&self) -> f64;

    /// The state after a step under a damping; `None` where there is none.
    fn stepped(&self, damping: f64) -> Option<Self>;

    /// Prepares the next step, with the memory of the state before, than which this one is no higher; whether there is to be one.
    fn follow(&mut self, before: Self) -> bool;
}

/// How the damping changes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Damping {
    /// That of the first step.
    pub first: f64,
    /// Its factor after a step downhill.
    pub down: f64,
    /// And after one uphill, which is not taken.
    pub up: f64,
    /// Where the search is given up.
    pub most: f64,
    /// Maximum number of steps.
    pub steps: usize,
}

impl Damping {
    /// The lowest state that steps from one lead to.
    pub fn descend<S: DampedDescent>(&self, mut state: S) -> S {
        let mut damping = self.first;
        for _ in 0..self.steps {
            let next = state.stepped(damping);
            if let Some(next) = next.filter(|next| next.cost() <= state.cost()) {
                damping *= self.down;
                let before = std::mem::replace(&mut state, next);
                if !state.follow(before) {
                    break;
                }
            } else {
                damping *= self.up;
                if damping > self.most {
                    break;
                }
            }
        }
        state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rosenbrock's valley, by the Gauss-Newton steps of its two residuals: whole ones overshoot.
    struct Valley {
        x: f64,
        y: f64,
    }

    impl DampedDescent for Valley {
        fn cost(&self) -> f64 {
            100.0 * (self.y - self.x * self.x).powi(2) + (1.0 - self.x).powi(2)
        }

        fn stepped(&self, damping: f64) -> Option<Self> {
            let by = nalgebra::Matrix2::new(-20.0 * self.x, 10.0, -1.0, 0.0);
            let residual = nalgebra::Vector2::new(10.0 * (self.y - self.x * self.x), 1.0 - self.x);
            let mut information = by.transpose() * by;
            (0..2).for_each(|k| information[(k, k)] *= 1.0 + damping);
            let step = information.cholesky()?.solve(&(by.transpose() * -residual));
            Some(Self {
                x: self.x + step.x,
                y: self.y + step.y,
            })
        }

        fn follow(&mut self, before: Self) -> bool {
            assert!(self.cost() <= before.cost());
            self.cost() > 1e-20
        }
    }

    #[test]
    fn every_step_goes_downhill_to_the_minimum() {
        let damping = Damping {
            first: 1e-3,
            down: 0.2,
            up: 8.0,
            most: 1e6,
            steps: 100,
        };
        let found = damping.descend(Valley { x: -1.2, y: 1.0 });
        assert!((found.x - 1.0).hypot(found.y - 1.0) < 1e-8);
    }
}
