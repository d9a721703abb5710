//! All balls of a frame: several balls, or several images of one by the flashes of one exposure.
//!
//! The first ball is what [`Estimator::estimate`] finds in the frame, as where only one is looked for, of several tables with a
//! shorter search by each. Then all circles of a like size
//! ([`BallFinder`]) are handed to the same entry as outlines that were found, the best first, so that a further ball costs what a
//! crop does. Where the balls may carry one of several patterns, each outline's dots are identified by all of them, and the pattern
//! that explains them best is the ball's:
//!
//! ```text
//! p(table) = exp L(table) / sum exp L,   L as in `verdict`
//! ```
//!
//! which is a factor of the pose's confidence.
//!
//! Guarantees: with one table the first ball is exactly that of [`Estimator::estimate`]. Each ball is a pose or a [`FrameRejection`];
//! no two are at one place. Not guaranteed: that a circle without a pose is a ball. It is listed where its rim is whole, or is seen for the
//! greater part and has five likely dots.

mod found;
mod tables;

use self::found::FoundBalls;
use super::strobe::Strobe;
use super::verdict::Scorer;
use crate::error::{Result, require};
use crate::image::{ImageView, Roi};
use crate::vision::dots::detector::LIKELY_DOT;
use crate::vision::estimator::propose::VERY_LARGE;
use crate::vision::estimator::search::is_evident;
use crate::vision::estimator::{Estimator, EstimatorWorkspace};
use crate::vision::frame::estimate::{FrameEstimate, FrameRejection, Standing};
use crate::vision::frame::prior::{Budget, OutlinePrior};
use crate::vision::optics::camera::BallCircle;
use crate::vision::outline::circle::{BallFinder, BallFit, Polarity, WHOLE};
use crate::vision::outline::place::level_of_part;

/// Very large pictures are halved until they have no more pixels than this: all their edges would take too much memory.
const MAX_SHRUNK: f64 = 1_100_000.0;
/// Balls of a frame, at most, and circles that are tried.
const MAX_BALLS: usize = 16;
const MAX_TRIED: usize = 24;
/// Radii of further balls over that of the first: balls at two thirds and one and a half times its distance.
const SIZES: (f64, f64) = (0.65, 1.55);
/// Circles are searched where the smallest radius is at least so many pixels, at a smaller scale.
const SMALLEST: f64 = 10.0;
/// Rims of this support and visible part may be balls without a pose, where they have so many likely dots or a number is asked for.
const RIM: f64 = 0.7;
const MIN_LIKELY_DOTS: usize = 5;
/// Likely dots of a whole rim from which on each of several tables is tried by all means.
const WORTHWHILE: usize = 3;
/// Radius and center of a circle of the edges are known to a part of the radius that is believed.
const MAX_SIGMA: f64 = 0.04;
/// Outlines over one that are taken out, at most: a strobed ball's neighbors.
const MAX_COVERS: usize = 4;
/// An expected outline is looked for within so many radii.
const EXPECTED_SIGMA: f64 = 0.1;

/// One of the balls of a frame.
#[derive(Debug, Clone)]
pub struct BallEstimate {
    /// Its outline, dots and orientation, or why it has none.
    pub frame: FrameEstimate,
    /// The table that fits it best.
    pub table: usize,
    /// Probability of each table, by the dots of this frame; where there is one table, 1.
    pub tables: Vec<f64>,
}

impl BallEstimate {
    /// A ball of which one table is known.
    pub fn of(frame: FrameEstimate, table: usize) -> Self {
        Self {
            frame,
            table,
            tables: vec![1.0],
        }
    }

    /// Takes back a pose, by what all frames say.
    pub(super) fn reject(&mut self, why: FrameRejection) {
        self.frame.take_back(why);
    }

    /// The outline, corrected by the dots where the ball has a pose.
    pub fn circle(&self) -> Option<BallCircle> {
        self.frame.circle.or(self.frame.outline.map(|o| o.circle))
    }

    fn likely_dots(&self) -> usize {
        let dots = self.frame.dots.iter();
        dots.filter(|d| d.probability >= LIKELY_DOT).count()
    }
}

/// Sorts balls from left to right; what has no outline comes last.
pub fn sort_from_left(balls: &mut [BallEstimate]) {
    let left = |ball: &BallEstimate| ball.circle().map_or(f64::INFINITY, |c| c.center.u);
    balls.sort_by(|a, b| left(a).total_cmp(&left(b)));
}

/// Estimates all balls of a frame: one estimator for each table that they may carry.
#[derive(Debug, Clone)]
pub struct BallsEstimator {
    estimators: Vec<Estimator>,
    count: Option<usize>,
}

/// Working memory of a [`BallsEstimator`], one a thread.
pub struct BallsWorkspace<'a> {
    finder: BallFinder,
    circles: Vec<BallFit>,
    workspaces: Vec<EstimatorWorkspace>,
    /// One for each table; none where there is one.
    scorers: Vec<Scorer<&'a Estimator>>,
}

impl BallsEstimator {
    /// For balls that carry one of these estimators' patterns: so many in a frame, or as many as there are.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] without an estimator, or for a number out of its domain.
    pub fn new(estimators: Vec<Estimator>, count: Option<usize>) -> Result<Self> {
        require(!estimators.is_empty(), "table", "at least one", 0)?;
        let found = count.unwrap_or(1);
        let inside = (1..=MAX_BALLS).contains(&found);
        require(inside, "balls", "1 to 16, or auto", found)?;
        Ok(Self { estimators, count })
    }

    /// One for each table.
    pub fn estimators(&self) -> &[Estimator] {
        &self.estimators
    }

    /// A new workspace.
    ///
    /// # Errors
    /// [`crate::Error::Argument`] for a setting outside its domain.
    pub fn workspace(&self) -> Result<BallsWorkspace<'_>> {
        let scorers = match &self.estimators[..] {
            [_] => Vec::new(),
            several => several.iter().map(Scorer::new).collect::<Result<_>>()?,
        };
        Ok(BallsWorkspace {
            finder: BallFinder::new(self.estimators[0].config().circle),
            circles: Vec::with_capacity(MAX_TRIED),
            workspaces: self.estimators.iter().map(Estimator::workspace).collect(),
            scorers,
        })
    }

    /// Estimates the balls of a frame, those with a pose first, within a region or everywhere. `expected` are outlines where balls
    /// are expected; they are looked for where no circle was found.
    pub fn estimate<'a>(
        &self,
        image: impl Into<ImageView<'a>>,
        region: Option<Roi>,
        expected: &[BallCircle],
        budget: &Budget,
        ws: &mut BallsWorkspace<'_>,
    ) -> Vec<BallEstimate> {
        let image = image.into();
        let mut found = FoundBalls {
            balls: vec![self.first(image, region, budget, ws)],
            rejected: Vec::new(),
            limit: self.count.unwrap_or(MAX_BALLS),
        };
        if found.balls[0].frame.pose().is_none() {
            found.rejected.append(&mut found.balls);
        }
        if found.is_full() {
            return found.balls;
        }
        self.find_circles(image, region, &found, ws);
        for k in 0..ws.circles.len() {
            let fit = ws.circles[k];
            if found.is_full() {
                break;
            }
            if found.is_free(&fit.circle) {
                let sigma_px = fit.covariance.diagonal().max().sqrt();
                let sigma_px = sigma_px.min(MAX_SIGMA * fit.circle.radius);
                let outline = OutlinePrior::found(fit.circle, sigma_px);
                // What has no whole rim may be anything: no second look at its dots where the first shows none.
                let standing = match fit.support.min(fit.visible) >= WHOLE {
                    true => Standing::Likely,
                    false => Standing::Doubtful,
                };
                let ball = self.at(image, outline, standing, budget, ws);
                found.add(ball, Some(&fit), self.count.is_some());
            }
        }
        self.look_at(image, expected, budget, &mut found, ws);
        self.uncover(image, budget, &mut found, ws);
        found.all()
    }

    /// Estimates all images of one ball in an exposure with several flashes: where one is missing, it is looked for where the others lead;
    /// of several tables all images have the one that explains them best together.
    pub fn estimate_strobed<'a>(
        &self,
        image: impl Into<ImageView<'a>>,
        region: Option<Roi>,
        strobe: &Strobe,
        budget: &Budget,
        ws: &mut BallsWorkspace<'_>,
    ) -> Vec<BallEstimate> {
        let image = image.into();
        let balls = self.estimate(image, region, &[], budget, ws);
        let expected = strobe.expected(&balls);
        let mut balls = self.look_again(image, balls, &expected, budget, ws);
        if !ws.scorers.is_empty() {
            self.agree(image, &mut balls, budget, ws);
        }
        balls
    }

    /// The balls of a frame, and those that are found besides where they are expected.
    pub fn look_again<'a>(
        &self,
        image: impl Into<ImageView<'a>>,
        balls: Vec<BallEstimate>,
        expected: &[BallCircle],
        budget: &Budget,
        ws: &mut BallsWorkspace<'_>,
    ) -> Vec<BallEstimate> {
        let (balls, rejected) = balls.into_iter().partition(|b| b.frame.pose().is_some());
        let mut found = FoundBalls {
            balls,
            rejected,
            limit: self.count.unwrap_or(MAX_BALLS),
        };
        self.look_at(image.into(), expected, budget, &mut found, ws);
        found.all()
    }

    /// Looks for balls where they are expected and none is known.
    fn look_at(
        &self,
        image: ImageView<'_>,
        expected: &[BallCircle],
        budget: &Budget,
        found: &mut FoundBalls,
        ws: &mut BallsWorkspace<'_>,
    ) {
        for circle in expected {
            if !found.is_full() && found.is_free(circle) {
                let outline = OutlinePrior::found(*circle, EXPECTED_SIGMA * circle.radius);
                let ball = self.at(image, outline, Standing::Doubtful, budget, ws);
                found.add(ball, None, false);
            }
        }
    }

    /// Circles without a pose that others with one cover in part, once more without what these show.
    fn uncover(
        &self,
        image: ImageView<'_>,
        budget: &Budget,
        found: &mut FoundBalls,
        ws: &mut BallsWorkspace<'_>,
    ) {
        for ball in found.rejected.clone() {
            if found.is_full() {
                break;
            }
            let Some(rejected) = ball.frame.outline else {
                continue;
            };
            let circle = rejected.circle;
            let others = found.balls.iter().filter_map(BallEstimate::circle);
            let covers: Vec<BallCircle> = others
                .filter(|c| {
                    let apart = (c.center.u - circle.center.u).hypot(c.center.v - circle.center.v);
                    apart < c.radius + circle.radius
                })
                .take(MAX_COVERS)
                .collect();
            if covers.is_empty() || !found.is_free(&circle) {
                continue;
            }
            for is_added in [true, false] {
                let outline = (self.known_as(&rejected), Standing::Likely);
                let workspace = &mut ws.workspaces[ball.table];
                workspace.covers.clone_from(&covers);
                workspace.covers_add = is_added;
                let budget = Budget {
                    spent: ball.frame.attempts(),
                    ..*budget
                };
                let again = self.estimate_at(image, ball.table, outline, &budget, ws);
                ws.workspaces[ball.table].covers.clear();
                if again.pose().is_some() && is_evident(&again) {
                    let mut ball = BallEstimate {
                        frame: again,
                        ..ball.clone()
                    };
                    self.weigh(&mut ball);
                    found.add(ball, None, false);
                    break;
                }
            }
        }
    }

    /// Fills the workspace's circles with those that further balls may have.
    fn find_circles(
        &self,
        image: ImageView<'_>,
        region: Option<Roi>,
        found: &FoundBalls,
        ws: &mut BallsWorkspace<'_>,
    ) {
        let (width, height) = (image.width(), image.height());
        let whole = Roi::whole(width, height);
        ws.circles.clear();
        let Some(part) = region.unwrap_or(whole).cut(width, height) else {
            return;
        };
        let first = found.balls.first().and_then(BallEstimate::circle);
        let config = self.estimators[0].config().circle;
        let longer = part.width.max(part.height) as f64;
        let radii = match first {
            Some(circle) => (SIZES.0 * circle.radius, SIZES.1 * circle.radius),
            None => (config.min_radius_px, 0.5 * longer),
        };
        let fit = found.balls.first().and_then(|b| b.frame.fit);
        let polarity = fit.map_or(Polarity::Brighter, |f| f.polarity);
        let mut level = 0;
        while radii.0 / f64::from(2u32 << level) >= SMALLEST {
            level += 1;
        }
        if part.width * part.height > VERY_LARGE {
            level = level.max(level_of_part(&part, MAX_SHRUNK));
        }
        let side = f64::from(1u32 << level);
        let BallsWorkspace {
            finder,
            circles,
            workspaces,
            ..
        } = ws;
        let workspace = &mut workspaces[0];
        self.estimators[0].viewed(image, &part, level, workspace, |crop, _| {
            let known: Vec<BallCircle> = first
                .iter()
                .map(|circle| crop.grid.circle_to_part(circle))
                .collect();
            let radii = (radii.0 / side, radii.1 / side);
            let all = finder.find_all(crop.gray, radii, polarity, &known);
            circles.extend(all.iter().take(MAX_TRIED).map(|fit| BallFit {
                circle: crop.grid.circle_to_image(&fit.circle),
                covariance: fit.covariance * (side * side),
                edge_width: fit.edge_width * side,
                ..*fit
            }));
        });
        if let Some(first) = first {
            // Images of one ball have nearly one size.
            let unlike = |f: &BallFit| (f.circle.radius / first.radius).ln().abs() > 0.2;
            circles.sort_by_key(unlike);
        }
    }
}
