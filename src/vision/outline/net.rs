//! The ball's outline from a net: where it lies although hands, shadows or a background of the same
//! brightness hide a part of it.
//!
//! The net sees the surroundings of a rough circle. For every cell it gives the signed distance to
//! the outline, `d`, and its standard deviation. The circle `(c, r)` minimizes
//! `sum rho((|p - c| - r - d) / s)` over the cells `p` near the outline, with Student's `rho` for
//! `nu` degrees of freedom (K. Lange et al., "Robust statistical modeling using the t distribution",
//! JASA 84, 1989), by Gauss-Newton. The patch is then cut anew around it: a net sees best what it
//! sees at the size that it was trained for.
//!
//! Neighboring cells err together. The covariance is calibrated by one factor on frames that were
//! not trained on.

use nalgebra::{Matrix3, Vector3};

use crate::error::{Error, Result};
use crate::fit::{Student, Sums};
use crate::image::GrayImage;
use crate::vision::dots::net::cell_center;
use crate::vision::dots::patch::{Framing, MIDDLE, Patch};
use crate::vision::frame::outline::{Outline, OutlineSource};
use crate::vision::net::graph::{CELLS, Head, OutlineChannel};
use crate::vision::net::network::{Activations, Network};
use crate::vision::net::weights::Weights;
use crate::vision::optics::camera::{BallCircle, Pixel};

/// The unit of distances, in the patch's values.
pub const UNIT: f64 = 4.0;
/// Cells farther from the outline than this, in the patch's values, have no say.
pub const REACH: f64 = 10.0;
/// Bounds of the logarithm of the inverse deviation.
pub const LN_RANGE: [f32; 2] = [-2.5, 4.0];
/// The loss of the residuals.
const LOSS: Student = Student::new(4, 1);
/// Gauss-Newton steps.
const STEPS: usize = 6;
/// Maximum number of patches cut for one outline.
const PATCHES: usize = 4;
/// A change of the circle below this part of its radius ends the search.
const CONVERGED: f64 = 0.02;
/// Cells that must be near the outline.
const MIN_CELLS: usize = 24;

/// The net for outlines.
#[derive(Debug, Clone)]
pub struct OutlineNet {
    network: Network,
    covariance_factor: f64,
}

/// Working memory of an [`OutlineNet`], one a thread.
#[derive(Debug, Clone)]
pub struct OutlineWorkspace {
    activations: Activations,
    patch: Patch,
}

impl Default for OutlineWorkspace {
    fn default() -> Self {
        Self {
            activations: Activations::new(Head::Outline),
            patch: Patch::new(Framing::OUTLINE),
        }
    }
}

impl OutlineNet {
    /// The net that comes with this crate.
    ///
    /// # Errors
    /// [`Error::Internal`] where this crate was built with damaged weights.
    pub fn built_in() -> Result<Self> {
        Self::new(&Weights::built_in(Head::Outline)?)
    }

    /// A net with the given weights.
    ///
    /// # Errors
    /// [`Error::Argument`] where the weights do not fit.
    pub fn new(weights: &Weights) -> Result<Self> {
        if weights.meta.head != Head::Outline {
            let problem = "expected those of a net for the outline, found those of one for dots";
            return Err(Error::argument("weights", problem));
        }
        Ok(Self {
            network: Network::new(Head::Outline, &weights.layers)?,
            covariance_factor: weights.meta.calibration.covariance_factor,
        })
    }

    /// The outline of a ball near a rough circle: up to a third of the radius off. `None` where the
    /// net sees none.
    pub fn find_near(
        &self,
        image: &GrayImage,
        rough: &BallCircle,
        ws: &mut OutlineWorkspace,
    ) -> Option<Outline> {
        let mut circle = *rough;
        let mut found = None;
        for _ in 0..PATCHES {
            ws.patch.cut_into(image, &circle);
            let cells = self.network.forward(&ws.patch, &mut ws.activations);
            let fit = fit_cells(cells)?;
            let step = ws.patch.step();
            let next = BallCircle::new(
                ws.patch
                    .to_image(MIDDLE + fit.circle.x, MIDDLE + fit.circle.y),
                fit.circle.z * step,
            );
            let moved = (next.center.u - circle.center.u)
                .hypot(next.center.v - circle.center.v)
                .max((next.radius - circle.radius).abs());
            found = Some(Outline {
                circle: next,
                covariance: fit.covariance * (step * step * self.covariance_factor),
                source: OutlineSource::Detected,
            });
            circle = next;
            if moved < CONVERGED * circle.radius {
                break;
            }
        }
        found
    }
}

/// A circle in a patch: center relative to the patch's middle and radius, values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellFit {
    /// Center (columns, rows) and radius.
    pub circle: Vector3<f64>,
    /// Their covariance, as if cells were independent.
    pub covariance: Matrix3<f64>,
}

/// A cell that is near the outline, in the patch's values; its place is relative to the patch's middle.
#[derive(Debug, Clone, Copy, Default)]
struct NearCell {
    column: f64,
    row: f64,
    /// Signed distance to the outline.
    distance: f64,
    precision: f64,
}

/// The circle that fits a net's cells best; `None` where too few are near it.
pub fn fit_cells(cells: &[f32]) -> Option<CellFit> {
    let area = CELLS * CELLS;
    let (distances, precisions) = cells.split_at(OutlineChannel::LnPrecision as usize * area);
    let mut near = [NearCell::default(); CELLS * CELLS];
    let mut count = 0;
    for (cell, (d, ln)) in distances.iter().zip(precisions).enumerate() {
        let distance = UNIT * f64::from(*d);
        if distance.abs() <= REACH {
            let precision = (2.0 * f64::from(ln.clamp(LN_RANGE[0], LN_RANGE[1]))).exp();
            near[count] = NearCell {
                column: cell_center(cell % CELLS) - MIDDLE,
                row: cell_center(cell / CELLS) - MIDDLE,
                distance,
                precision: precision / (UNIT * UNIT),
            };
            count += 1;
        }
    }
    let mut circle = Vector3::new(0.0, 0.0, Framing::OUTLINE.radius);
    let mut covariance = None;
    for _ in 0..STEPS {
        let mut sums = Sums::<3>::default();
        let mut used = 0;
        for cell in &near[..count] {
            let (column, row) = (cell.column - circle.x, cell.row - circle.y);
            let out = (column * column + row * row).sqrt();
            if out < 1.0 {
                continue;
            }
            used += 1;
            let residual = out - circle.z - cell.distance;
            let precision = cell.precision;
            let weight = precision * LOSS.weight(precision * residual * residual);
            sums.add(&[column / out, row / out, 1.0], residual, weight);
        }
        if used < MIN_CELLS {
            return None;
        }
        let information = sums.symmetric();
        circle += information.cholesky()?.solve(&Vector3::from(sums.gradient));
        let is_sane =
            circle.xy().norm() < Framing::OUTLINE.radius && (5.0..60.0).contains(&circle.z);
        if !is_sane {
            return None;
        }
        covariance = information.try_inverse();
    }
    Some(CellFit {
        circle,
        covariance: covariance?,
    })
}

/// Where a circle lies in a patch of the given framing circle: center relative to the middle, and
/// radius, values.
pub fn in_patch(patch: &Patch, circle: &BallCircle) -> Vector3<f64> {
    let Pixel { u, v } = patch.from_image(circle.center);
    Vector3::new(u - MIDDLE, v - MIDDLE, circle.radius / patch.step())
}
