//! A ball that may carry one of several tables: its dots are identified by all of them.

use super::found::{largest, shares};
use super::{BallEstimate, BallsEstimator, BallsWorkspace, WORTHWHILE};
use crate::clip::verdict::MAX_LEAD;
use crate::image::{ImageView, Roi};
use crate::vision::frame::estimate::{FrameEstimate, Standing};
use crate::vision::frame::outline::Outline;
use crate::vision::frame::prior::{Budget, OutlinePrior, Prior};

impl BallsEstimator {
    /// Images of one ball: their tables' probabilities multiply, and all are estimated by the likeliest table.
    pub(super) fn agree(
        &self,
        image: ImageView<'_>,
        balls: &mut [BallEstimate],
        budget: &Budget,
        ws: &mut BallsWorkspace<'_>,
    ) {
        let ln = |ball: &BallEstimate, table: usize| ball.tables[table].ln().max(-MAX_LEAD);
        let all = 0..self.estimators.len();
        let sums: Vec<f64> = all
            .map(|table| balls.iter().map(|ball| ln(ball, table)).sum())
            .collect();
        let tables = shares(&sums);
        let best = largest(&tables);
        for ball in balls.iter_mut() {
            let is_by_best = ball.table == best && ball.frame.pose().is_some();
            if let Some(outline) = self.outline_of(ball).filter(|_| !is_by_best) {
                let likely = (outline, Standing::Likely);
                ball.frame = self.estimate_at(image, best, likely, budget, ws);
            } else if let Ok(pose) = &mut ball.frame.outcome {
                // Its own share of the table is in its confidence.
                pose.confidence /= ball.tables[best];
            }
            (ball.table, ball.tables) = (best, tables.clone());
            self.weigh(ball);
        }
        balls.sort_by_key(|ball| ball.frame.pose().is_none());
    }

    /// The ball that is found where one is looked for; of several tables by the first that fits.
    pub(super) fn first(
        &self,
        image: ImageView<'_>,
        region: Option<Roi>,
        budget: &Budget,
        ws: &mut BallsWorkspace<'_>,
    ) -> BallEstimate {
        let prior = Prior {
            region,
            ..Prior::default()
        };
        let short = budget.short();
        let budget = match self.estimators.len() {
            1 => budget,
            _ => &short,
        };
        let mut best: Option<BallEstimate> = None;
        for table in 0..self.estimators.len() {
            let mut frame = FrameEstimate::default();
            self.estimators[table].estimate(
                image,
                &prior,
                budget,
                &mut ws.workspaces[table],
                &mut frame,
            );
            let has_pose = frame.pose().is_some();
            if has_pose || best.is_none() {
                let ball = self.with_table(image, table, frame, budget, ws);
                best = Some(ball);
            }
            if has_pose {
                break;
            }
        }
        best.unwrap_or_else(|| BallEstimate {
            frame: FrameEstimate::default(),
            table: 0,
            tables: Vec::new(),
        })
    }

    /// A ball at an outline.
    pub(super) fn at(
        &self,
        image: ImageView<'_>,
        outline: OutlinePrior,
        standing: Standing,
        budget: &Budget,
        ws: &mut BallsWorkspace<'_>,
    ) -> BallEstimate {
        if ws.scorers.is_empty() {
            let frame = self.estimate_at(image, 0, (outline, standing), budget, ws);
            return self.with_table(image, 0, frame, budget, ws);
        }
        // The dots are the same for all tables: what is spent on one of them is of no use where the ball carries another.
        let doubtful = (outline, Standing::Doubtful);
        let frame = self.estimate_at(image, 0, doubtful, budget, ws);
        let ball = self.with_table(image, 0, frame, budget, ws);
        let is_open = ball.frame.pose().is_none() && ball.likely_dots() >= WORTHWHILE;
        match standing == Standing::Likely && is_open {
            true => self.by_all_means(image, outline, budget, ws),
            false => ball,
        }
    }

    /// The ball at an outline by one table.
    pub(super) fn estimate_at(
        &self,
        image: ImageView<'_>,
        table: usize,
        (outline, standing): (OutlinePrior, Standing),
        budget: &Budget,
        ws: &mut BallsWorkspace<'_>,
    ) -> FrameEstimate {
        let prior = Prior {
            outline: Some(outline),
            ..Prior::default()
        };
        let (estimator, workspace) = (&self.estimators[table], &mut ws.workspaces[table]);
        let mut frame = FrameEstimate::default();
        estimator.estimate_standing(image, &prior, standing, budget, workspace, &mut frame);
        frame
    }

    /// The table that explains a ball's dots best, and its estimate by that table; `frame` is that by `table`.
    pub(super) fn with_table(
        &self,
        image: ImageView<'_>,
        table: usize,
        frame: FrameEstimate,
        budget: &Budget,
        ws: &mut BallsWorkspace<'_>,
    ) -> BallEstimate {
        if ws.scorers.is_empty() {
            return BallEstimate::of(frame, table);
        }
        let by_dots = ws.scorers.iter_mut().map(|scorer| {
            let mut again = frame.clone();
            let weight = scorer.identify(&mut again).weight();
            (weight, again.pose().is_some())
        });
        let (weights, posed): (Vec<f64>, Vec<bool>) = by_dots.unzip();
        let tables = shares(&weights);
        let best = largest(&tables);
        let outline = frame.outline.filter(|_| posed[best]);
        let mut ball = BallEstimate {
            frame,
            table: best,
            tables,
        };
        let is_by_best = best == table && ball.frame.pose().is_some();
        if let Some(outline) = outline.filter(|_| !is_by_best) {
            let likely = (self.known_as(&outline), Standing::Likely);
            ball.frame = self.estimate_at(image, best, likely, budget, ws);
        } else if best != table {
            ball.frame.reject_pose();
        }
        self.weigh(&mut ball);
        ball
    }

    /// A ball whose dots alone no table explains: each table by all means, as a single one.
    pub(super) fn by_all_means(
        &self,
        image: ImageView<'_>,
        outline: OutlinePrior,
        budget: &Budget,
        ws: &mut BallsWorkspace<'_>,
    ) -> BallEstimate {
        let likely = (outline, Standing::Likely);
        let all = 0..self.estimators.len();
        let mut frames: Vec<FrameEstimate> = all
            .map(|table| self.estimate_at(image, table, likely, budget, ws))
            .collect();
        let scored = ws.scorers.iter_mut().zip(&frames);
        let weights: Vec<f64> = scored.map(|(s, f)| s.score(f).weight()).collect();
        let tables = shares(&weights);
        let table = largest(&tables);
        let mut ball = BallEstimate {
            frame: frames.swap_remove(table),
            table,
            tables,
        };
        self.weigh(&mut ball);
        ball
    }

    /// An outline of an estimate, to be estimated once more.
    pub(super) fn known_as(&self, outline: &Outline) -> OutlinePrior {
        let circle = self.estimators[0].shown_circle(&outline.circle);
        OutlinePrior {
            source: outline.source,
            ..OutlinePrior::given(circle)
        }
    }

    /// The same of a ball, as its dots have it.
    fn outline_of(&self, ball: &BallEstimate) -> Option<OutlinePrior> {
        let (circle, outline) = (ball.circle()?, ball.frame.outline?);
        Some(self.known_as(&Outline { circle, ..outline }))
    }

    /// A pose is right where its table is.
    pub(super) fn weigh(&self, ball: &mut BallEstimate) {
        let share = ball.tables[ball.table];
        let least = self.estimators[ball.table].config().min_confidence;
        if let Ok(pose) = &mut ball.frame.outcome {
            pose.confidence *= share;
            if pose.confidence < least {
                ball.frame.reject_pose();
            }
        }
    }
}
