//! What a detector's second look changes of a frame that the first leaves in doubt.
//!
//! The two looks see the same pixels, so that they miss much the same dots. What the first found of a dot (a likely dot, a
//! doubtful one, nothing) is followed by what the second finds with probabilities of their own for each class of dots: a
//! Markov step, counted on rendered frames in doubt that both have looked at. So are false dots, of which some stay
//! and some are new. A detection that stays keeps its place.

use nalgebra::Vector2;
use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

use super::learn::{FalseRow, Found, NEAR, Observation};
use super::model::{CONFIDENCE, Detected, DetectionModel, Terms, can_be_found};
use crate::synth::observables::SeenBall;
use crate::vision::estimator::FrameEstimate;

/// Weight of the step of all classes together where one has few cases.
const PRIOR: f64 = 20.0;

/// Probabilities that the second look finds a likely dot and a doubtful one.
pub type Step = [f64; 2];

/// See the module.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SecondLook {
    /// By class of dots: where the first look found a likely dot, a doubtful one, and none.
    pub dots: Vec<[Step; 3]>,
    /// Of false dots that the first look found, likely and doubtful ones.
    pub false_dots: [Step; 2],
    /// Number of new false dots, likely and doubtful ones, over that of the first look.
    pub new_false_dots: [f64; 2],
}

impl SecondLook {
    /// Whether all are probabilities, and there are as many classes.
    pub(super) fn is_valid(&self, classes: usize) -> bool {
        let mut steps = self.dots.iter().flatten().chain(&self.false_dots);
        let is_step =
            |step: &Step| step.iter().all(|p| *p >= 0.0) && step[0] + step[1] <= 1.0 + 1e-9;
        let are_rates = self.new_false_dots.iter().all(|r| (0.0..100.0).contains(r));
        steps.all(is_step) && are_rates && self.dots.len() == classes
    }

    /// Counts the steps of both looks at frames in doubt.
    pub(super) fn learn(model: &DetectionModel, looks: &[[Observation; 2]]) -> Self {
        let mut terms = Terms::default();
        let mut counts = vec![[[0.0; 3]; 3]; model.dot_classes.count()];
        let (mut false_counts, mut new, mut expected) = ([[0.0; 3]; 2], [0.0; 2], [1e-9; 2]);
        for [first, second] in looks {
            for ((observables, before), (_, after)) in first.dots().zip(second.dots()) {
                let class = model.dot_class(observables, &mut terms);
                counts[class][before as usize][after as usize] += 1.0;
            }
            let (steps, others) = steps_of_false(first.false_dots(), second.false_dots());
            for (before, after) in steps {
                false_counts[before][after as usize] += 1.0;
            }
            model.outline_chance(first.ball(), &mut terms);
            for kind in 0..2 {
                new[kind] += others[kind];
                expected[kind] += model.false_dots[kind].rate.value(terms.products());
            }
        }
        let all = [0, 1, 2].map(|before| {
            let of_all = counts.iter().map(|class| class[before]);
            let sum = of_all.fold([1e-9; 3], |sum, row| [0, 1, 2].map(|k| sum[k] + row[k]));
            share(&sum, None)
        });
        Self {
            dots: counts
                .iter()
                .map(|class| [0, 1, 2].map(|before| share(&class[before], Some(&all[before]))))
                .collect(),
            false_dots: false_counts.map(|row| share(&row, None)),
            new_false_dots: [new[0] / expected[0], new[1] / expected[1]],
        }
    }

    fn step<R: Rng + ?Sized>(step: &Step, rng: &mut R) -> Found {
        let drawn: f64 = rng.random();
        match drawn {
            p if p < step[0] => Found::Likely,
            p if p < step[0] + step[1] => Found::Doubtful,
            _ => Found::Missed,
        }
    }
}

/// Shares of likely and doubtful cases among all, drawn towards `prior` where there is one.
fn share(row: &[f64; 3], prior: Option<&Step>) -> Step {
    let (weight, prior) = prior.map_or((0.0, [0.0; 2]), |step| (PRIOR, *step));
    let all = (row.iter().sum::<f64>() + weight).max(1e-9);
    [0, 1].map(|k| (row[k] + weight * prior[k]) / all)
}

/// What became of each false dot, likely (0) or doubtful (1), and the numbers of new ones.
fn steps_of_false(first: &[FalseRow], second: &[FalseRow]) -> (Vec<(usize, Found)>, [f64; 2]) {
    let mut is_taken = vec![false; second.len()];
    let kind = |row: &FalseRow| usize::from(!row.is_likely);
    let nearest = |place: &Vector2<f64>, is_taken: &[bool]| {
        let apart = |j: &usize| (second[*j].place - place).norm();
        let free = (0..second.len()).filter(|j| !is_taken[*j]);
        let best = free.min_by(|a, b| apart(a).total_cmp(&apart(b)));
        best.filter(|j| apart(j) < NEAR)
    };
    let mut steps = Vec::with_capacity(first.len());
    for row in first {
        let after = match nearest(&row.place, &is_taken) {
            Some(j) => {
                is_taken[j] = true;
                [Found::Likely, Found::Doubtful][kind(&second[j])]
            }
            None => Found::Missed,
        };
        steps.push((kind(row), after));
    }
    let mut new = [0.0; 2];
    for (row, _) in second.iter().zip(is_taken).filter(|(_, taken)| !taken) {
        new[kind(row)] += 1.0;
    }
    (steps, new)
}

impl DetectionModel {
    /// What the second look finds on a ball that the first one left in doubt.
    pub(super) fn look_again<R: Rng + ?Sized>(
        &self,
        ball: &SeenBall,
        first: Detected,
        terms: &mut Terms,
        rng: &mut R,
    ) -> FrameEstimate {
        let mut found = Vec::with_capacity(first.of_dots.len() + 4);
        let Detected { frame, of_dots } = first;
        let seen = |i: usize| of_dots.iter().position(|dot| *dot == Some(i));
        for (i, dot) in ball
            .dots
            .iter()
            .enumerate()
            .filter(|(_, d)| can_be_found(d))
        {
            let before = seen(i).map(|at| frame.dots[at]);
            let class = self.dot_class(&dot.observables, terms);
            let step = &self.second_look.dots[class][row(before.map(|d| d.confidence))];
            let after = SecondLook::step(step, rng);
            if after == Found::Missed {
                continue;
            }
            let is_likely = after == Found::Likely;
            let mut detection = before.unwrap_or_else(|| {
                self.detection(dot, &ball.circle, is_likely, class, terms.dot(), rng)
            });
            detection.confidence = CONFIDENCE[after as usize];
            found.push((Some(i), detection));
        }
        let of_none = frame
            .dots
            .iter()
            .zip(&of_dots)
            .filter(|(_, dot)| dot.is_none());
        for (before, _) in of_none {
            let step = &self.second_look.false_dots[row(Some(before.confidence))];
            let after = SecondLook::step(step, rng);
            if after != Found::Missed {
                let mut detection = *before;
                detection.confidence = CONFIDENCE[after as usize];
                found.push((None, detection));
            }
        }
        let (_, class) = self.outline_chance(&ball.observables, terms);
        for (kind, false_dots) in self.false_dots.iter().enumerate() {
            let rate =
                false_dots.rate.value(terms.products()) * self.second_look.new_false_dots[kind];
            false_dots.draw(ball, rate, class, CONFIDENCE[kind], rng, &mut found);
        }
        Detected::new(found, |dots| frame.with_dots(dots)).frame
    }
}

/// The row of a detection of this confidence in a table of steps.
fn row(confidence: Option<f64>) -> usize {
    match confidence {
        Some(p) if p >= CONFIDENCE[0] => 0,
        Some(_) => 1,
        None => 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row_at(x: f64, is_likely: bool) -> FalseRow {
        FalseRow::at(Vector2::new(x, 0.0), is_likely)
    }

    #[test]
    fn false_dots_stay_change_vanish_and_appear() {
        let first = [row_at(0.1, true), row_at(0.3, false), row_at(0.6, true)];
        let second = [row_at(0.62, false), row_at(0.11, true), row_at(-0.5, true)];
        let (steps, new) = steps_of_false(&first, &second);
        let expected = [(0, Found::Likely), (1, Found::Missed), (0, Found::Doubtful)];
        assert_eq!(steps, expected);
        assert_eq!(new, [1.0, 0.0]);
    }

    #[test]
    fn a_class_without_cases_follows_all_others() {
        assert_eq!(share(&[0.0; 3], Some(&[0.6, 0.3])), [0.6, 0.3]);
        let [likely, doubtful] = share(&[60.0, 20.0, 20.0], None);
        assert!((likely - 0.6).abs() < 1e-12 && (doubtful - 0.2).abs() < 1e-12);
    }
}
