//! Where a frame's ball may be: the places that are tried one after the other, the likeliest first.
//!
//! What is known of the frame ([`Prior`]) and the search that its budget allows make a plan of steps; each is carried out when those
//! before have given no answer:
//!
//! - the outline that is given, or the surroundings of the one that is expected, then what lies farther around it;
//! - in a large image, rough circles from a [coarse search](crate::vision::outline::circle::coarse): those whose rim is nearly whole, and
//!   moving ones; then what they outshone, and all others (beside a lamp or a white disc most of the others are made of its
//!   edges, and to refuse one of these takes as long as to find the ball); then the circles of the image without nets, cords and other
//!   thin things; last the surroundings of the circle whose dots came nearest to an answer, by all edges;
//! - in an image beyond [`ALL_EDGES`] pixels the same at a finer scale, but for thin things;
//! - the whole image by all its edges; a larger one at a smaller scale, where the circle that is found is tried in its surroundings.
//!
//! Not promised: at 3840 x 2160 faint balls of less than 64 pixels.

use std::time::Instant;

use super::{Estimator, EstimatorWorkspace};
use crate::image::{ImageView, Roi};
use crate::vision::frame::estimate::{FrameEstimate, Standing};
use crate::vision::frame::prior::{Budget, Follows, OutlinePrior, Prior, SearchDepth};
use crate::vision::optics::camera::BallCircle;
use crate::vision::optics::grid::Grid;
use crate::vision::outline::circle::WHOLE;
use crate::vision::outline::circle::coarse::{self, CoarseSearch, MAX_CIRCLES};
use crate::vision::outline::place::{Place, SURROUNDINGS, level_of_part};
use crate::vision::pose::identify::PROMISING;

/// A ball that is not where it is expected is looked for within so many radii, if it may be so far off.
pub(crate) const NEARBY: f64 = 4.5;
/// Images with a longer side beyond this, pixels, are searched at a coarse scale first.
pub(crate) const LARGE: usize = 240;
/// Images of more pixels are very large.
pub(crate) const VERY_LARGE: usize = 4_000_000;
/// Images of more pixels are halved until they have no more before they are searched by all edges, which takes 0.2 ms for every thousand. Of 480 of
/// 1280 x 1024 in all conditions, with balls of 20 to 140 px, so and by the finer coarse search 325 are answered rightly and one wrongly; by all edges of the
/// image itself 285 and one, in 1.6 times the time.
const ALL_EDGES: f64 = 300_000.0;
/// How much finer a very large image is searched: for balls of 40 pixels in one of 3840 x 2160.
const HALVINGS: u32 = 2;
/// Largest radius of the coarse search, as a part of the longer side.
const MAX_COARSE: f64 = 0.4;
/// Smallest radius that the coarse search is sure to see, values of the first size that it searches.
const MIN_COARSE: f64 = 5.0;
/// A strip that is thinner than this at the first size shows no arc of a ball.
const MIN_STRIP: usize = 4;
/// Steps of the longest plan: the expected place, and four steps for each of four hunts.
const MAX_STEPS: usize = 24;

/// A place, and what an outline there is worth before its dots are seen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Proposal {
    pub place: Place,
    pub standing: Standing,
}

impl Proposal {
    fn likely(place: Place) -> Self {
        let standing = Standing::Likely;
        Self { place, standing }
    }
}

/// A part of a frame and the sizes of balls that are looked for in it at a coarse scale.
#[derive(Debug, Clone, Copy)]
struct Hunt {
    part: Roi,
    /// The first size that is searched: so often halved.
    level: u32,
    /// Radii, pixels.
    radii: (f64, f64),
    /// Whether it goes on where a coarser one has found nothing.
    is_fine: bool,
    /// Whether the image before was hunted in the same way.
    is_continued: bool,
}

/// The circles of a hunt that are tried one after the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum CircleStage {
    /// Those that stand out.
    First,
    /// What these outshone, and the others.
    Beyond,
    /// Those of the image without what is thin.
    Plain,
}

#[derive(Debug, Clone, Copy)]
enum PlanStep {
    At(Proposal),
    /// A ball whose rim was seen where it is expected is not elsewhere.
    EndIfSeen,
    Coarse(Hunt, CircleStage),
    /// Other outlines about the circle whose dots came nearest to an answer.
    Closer,
    /// All edges of a part at a smaller scale.
    Shrunk(Roi),
}

impl Hunt {
    /// For balls of any size from 5 pixels of radius at the coarse scale on.
    fn everywhere(part: Roi, is_continued: bool) -> Self {
        let level = coarse::level(part.width, part.height);
        let longer = part.width.max(part.height) as f64;
        Self {
            part,
            level,
            radii: (smallest(level), MAX_COARSE * longer),
            is_fine: false,
            is_continued,
        }
    }

    /// For balls up to `halvings` times half as large as the smallest of [`Hunt::everywhere`], and not those of fewer.
    fn finer(part: Roi, halvings: u32, is_continued: bool) -> Self {
        let level = coarse::level(part.width, part.height).saturating_sub(halvings);
        Self {
            part,
            level,
            radii: (smallest(level), 1.2 * smallest(level + 1)),
            is_fine: true,
            is_continued,
        }
    }

    /// For a ball that is expected with this outline; `None` outside the image.
    fn nearby(expected: &OutlinePrior, image: &ImageView<'_>) -> Option<Self> {
        let circle = &expected.circle;
        let reach = expected.reach().min(NEARBY);
        let part = circle.region(reach, image.width(), image.height())?;
        let mut level = 0;
        while circle.radius / f64::from(2u32 << level) >= 1.4 * MIN_COARSE {
            level += 1;
        }
        Some(Self {
            part,
            level,
            radii: (0.7 * circle.radius, 1.4 * circle.radius),
            is_fine: false,
            is_continued: false,
        })
    }

    fn is_strip(&self) -> bool {
        self.part.width.min(self.part.height) >> self.level < MIN_STRIP
    }
}

/// The smallest radius, pixels, that is seen in an image that was halved so often.
fn smallest(level: u32) -> f64 {
    MIN_COARSE * f64::from(1u32 << level)
}

/// The plan for a frame, and how far it has been carried out. Its memory is reused.
#[derive(Debug, Default)]
pub(crate) struct Places {
    steps: Vec<PlanStep>,
    begun: usize,
    /// Those of the step in hand.
    proposals: Vec<Proposal>,
    tried: usize,
    /// How many circles of the hunt in hand stood out.
    stood_out: usize,
    /// The rough circle whose dots came nearest to an answer, and the probability of its pose.
    nearest: Option<(BallCircle, f64)>,
    /// That probability when it was last looked at closer.
    looked: f64,
}

impl Places {
    /// Makes the plan for a frame. `region` is the part of it where the ball is; the outline of the prior is worth `standing`.
    pub fn plan(
        &mut self,
        image: &ImageView<'_>,
        region: Option<Roi>,
        (prior, standing): (&Prior, Standing),
        budget: &Budget,
    ) {
        self.steps.clear();
        self.steps.reserve(MAX_STEPS);
        self.proposals.clear();
        self.proposals.reserve(2 * MAX_CIRCLES);
        (self.begun, self.tried) = (0, 0);
        (self.nearest, self.looked) = (None, 0.0);
        let is_continued = prior.follows == Follows::LastImage && prior.outline.is_none();
        let Some(expected) = prior.outline else {
            if let Some(region) = region {
                self.plan_region(region, is_continued, budget.search);
            }
            return;
        };
        let place = match expected.believed() {
            Some(known) => Place::Known(known),
            None => Place::Near(expected.circle),
        };
        self.steps.push(PlanStep::At(Proposal { place, standing }));
        if matches!(place, Place::Known(_)) || expected.reach() < SURROUNDINGS {
            return;
        }
        let is_lost = expected.reach() == f64::INFINITY;
        if !is_lost {
            self.steps.push(PlanStep::EndIfSeen);
        }
        if let Some(hunt) = Hunt::nearby(&expected, image) {
            self.plan_hunt(hunt);
        }
        if let Some(region) = region.filter(|_| is_lost) {
            self.plan_region(region, is_continued, budget.search);
        }
    }

    /// A ball anywhere in a part.
    fn plan_region(&mut self, part: Roi, is_continued: bool, search: SearchDepth) {
        let is_very_large = part.width * part.height > VERY_LARGE;
        let is_shrunk = level_of_part(&part, ALL_EDGES) > 0;
        let all = PlanStep::At(Proposal::likely(Place::Within(part)));
        if part.width.max(part.height) <= LARGE {
            return self.steps.push(all);
        }
        self.plan_hunt(Hunt::everywhere(part, is_continued));
        let halvings = match search {
            SearchDepth::Coarse => 1,
            SearchDepth::Thorough if is_very_large => HALVINGS,
            SearchDepth::Thorough => u32::from(is_shrunk),
        };
        for halvings in 1..=halvings {
            self.plan_hunt(Hunt::finer(part, halvings, is_continued));
        }
        if search == SearchDepth::Thorough {
            self.steps.push(match is_shrunk {
                true => PlanStep::Shrunk(part),
                false => all,
            });
        }
    }

    fn plan_hunt(&mut self, hunt: Hunt) {
        if !hunt.is_strip() {
            let stages = [CircleStage::First, CircleStage::Beyond, CircleStage::Plain];
            // At a finer scale nothing was ever found without what is thin (none of 249 answers).
            let stages = &stages[..if hunt.is_fine { 2 } else { 3 }];
            self.steps
                .extend(stages.iter().map(|s| PlanStep::Coarse(hunt, *s)));
            self.steps.push(PlanStep::Closer);
        }
    }

    /// What was found at a place.
    pub fn learn(&mut self, place: &Proposal, found: &FrameEstimate) {
        let promise = found.promise();
        let known = self.nearest.map_or(0.0, |n| n.1);
        let is_nearer = place.standing == Standing::Doubtful && promise > known;
        if let Some(outline) = found.outline.filter(|_| is_nearer) {
            self.nearest = Some((outline.circle, promise));
        }
    }

    /// Other outlines about the nearest circle, unless it was looked at so before.
    fn look_closer(&mut self) {
        if let Some((circle, promise)) = self.nearest
            && promise > self.looked
            && promise >= PROMISING
        {
            self.looked = promise;
            self.proposals.push(Proposal {
                place: Place::Near(circle),
                standing: Standing::Promising,
            });
        }
    }

    /// The circles of a stage of a hunt.
    fn hunt(
        &mut self,
        image: &ImageView<'_>,
        hunt: &Hunt,
        stage: CircleStage,
        min_radius: f64,
        search: &mut CoarseSearch,
    ) {
        let Hunt { part, level, .. } = *hunt;
        let radii = (hunt.radii.0.max(min_radius), hunt.radii.1);
        let found = match stage {
            CircleStage::First => {
                if !hunt.is_continued {
                    search.forget();
                }
                let found = search.search(level, radii, |out| image.shrink_into(&part, level, out));
                self.stood_out = coarse::standing_out(found);
                &found[..self.stood_out]
            }
            CircleStage::Beyond => search.search_beyond(self.stood_out, level, radii),
            CircleStage::Plain => search.search_plain(level, radii),
        };
        let grid = Grid::of(&part, 0);
        self.proposals.extend(found.iter().map(|rough| Proposal {
            place: Place::Near(grid.circle_to_image(&rough.circle)),
            standing: Standing::Doubtful,
        }));
    }
}

impl Estimator {
    /// The next place to try; `so_far` is the best of those before.
    pub(crate) fn next_place(
        &self,
        image: &ImageView<'_>,
        so_far: &FrameEstimate,
        places: &mut Places,
        ws: &mut EstimatorWorkspace,
    ) -> Option<Proposal> {
        while !ws.spending.is_over() {
            if let Some(proposal) = places.proposals.get(places.tried) {
                places.tried += 1;
                return Some(*proposal);
            }
            places.proposals.clear();
            places.tried = 0;
            let step = *places.steps.get(places.begun)?;
            places.begun += 1;
            let begun = Instant::now();
            match step {
                PlanStep::At(proposal) => places.proposals.push(proposal),
                PlanStep::EndIfSeen if so_far.fit.is_some_and(|f| f.support >= WHOLE) => {
                    return None;
                }
                PlanStep::EndIfSeen => {}
                PlanStep::Coarse(hunt, stage) => {
                    let search = &mut ws.searches[usize::from(hunt.is_fine)];
                    let min_radius = self.config.circle.min_radius_px;
                    places.hunt(image, &hunt, stage, min_radius, search);
                }
                PlanStep::Closer => places.look_closer(),
                PlanStep::Shrunk(part) => self.outlines_shrunk(image, &part, places, ws),
            }
            ws.spending.timings.locate += begun.elapsed();
        }
        None
    }

    /// The outline of a part by all edges at a smaller scale, and what else may be in its place.
    fn outlines_shrunk(
        &self,
        image: &ImageView<'_>,
        part: &Roi,
        places: &mut Places,
        ws: &mut EstimatorWorkspace,
    ) {
        let net = self.outline_net.as_ref();
        let level = level_of_part(part, ALL_EDGES);
        self.viewed(*image, part, level, ws, |crop, ws| {
            let mut standing = match ws.locator.begin(&crop, &Place::Within(*part), net) {
                Ok(()) => Standing::Likely,
                Err(_) => Standing::Doubtful,
            };
            // Of those beside the likeliest none of 317 was the ball's.
            while let Some(candidate) = ws.locator.next(crop.gray, net, places.proposals.is_empty())
            {
                let circle = crop.grid.circle_to_image(&candidate.outline.circle);
                places.proposals.push(Proposal {
                    place: Place::Near(circle),
                    standing,
                });
                standing = Standing::Doubtful;
            }
        });
    }
}
