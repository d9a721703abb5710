//! From the net's cells to dots.
//!
//! A cell whose heat is not below that of its eight neighbors is a peak. It says where the dot
//! lies, to a fraction of a pixel, and with which covariance; a second peak for the same dot is
//! dropped.

use nalgebra::Matrix2;

use super::detector::DotDetection;
use super::heat::Heat;
use super::patch::Patch;
use crate::error::{Error, Result};
use crate::vision::net::graph::{CELLS, CHANNELS, Channel, Head};
use crate::vision::net::network::{Activations, Network};
use crate::vision::net::weights::{OutputCalibration, Weights};

/// Peaks nearer to a stronger one than this, in the patch's values, are the same dot's.
const SAME_DOT: f64 = 2.0;
/// No two peaks are neighbors, so that there are no more than this.
const MAX_PEAKS: usize = CELLS.div_ceil(2) * CELLS.div_ceil(2);
/// Bounds of ln a and ln c: standard deviations between 1/50 and 12 of the patch's values.
const LN_RANGE: [f32; 2] = [-2.5, 4.0];
/// Least probability of a dot that is given out: whoever uses the dots decides with which probability.
const MIN_PROBABILITY: f64 = 0.1;

/// The dot detector.
#[derive(Debug, Clone)]
pub struct CnnDetector {
    first: CalibratedNet,
    /// For patches that the first leaves in doubt.
    second: Option<CalibratedNet>,
}

/// A net, and how to read its outputs.
#[derive(Debug, Clone)]
struct CalibratedNet {
    network: Network,
    calibration: OutputCalibration,
}

impl CalibratedNet {
    fn new(weights: &Weights) -> Result<Self> {
        if weights.meta.head == Head::Outline {
            let problem = "expected those of a net for dots, found those of one for the outline";
            return Err(Error::argument("weights", problem));
        }
        Ok(Self {
            network: Network::new(weights.meta.head, &weights.layers)?,
            calibration: weights.meta.calibration,
        })
    }
}

/// Working memory of a [`CnnDetector`], one a thread. It serves any of them.
#[derive(Debug, Clone)]
pub struct CnnWorkspace {
    first: Activations,
    second: Option<Activations>,
    peaks: Vec<Peak>,
}

impl CnnDetector {
    /// The detector that comes with this crate: a small net, and a large one for what that leaves in doubt.
    ///
    /// # Errors
    /// [`Error::Internal`] where this crate was built with damaged weights.
    pub fn built_in() -> Result<Self> {
        let detector = Self::new(&Weights::built_in(Head::Dots)?)?;
        Ok(Self {
            second: Some(CalibratedNet::new(&Weights::built_in(Head::DotsLarge)?)?),
            ..detector
        })
    }

    /// A detector with the given weights, and no other for what they leave in doubt.
    ///
    /// # Errors
    /// [`Error::Argument`] where the weights do not fit the net.
    pub fn new(weights: &Weights) -> Result<Self> {
        Ok(Self {
            first: CalibratedNet::new(weights)?,
            second: None,
        })
    }

    /// The net's raw cells for a patch: [`CHANNELS`] x [`CELLS`] x [`CELLS`].
    pub fn cells<'w>(&self, patch: &Patch, ws: &'w mut CnnWorkspace) -> &'w [f32] {
        self.first.network.forward(patch, &mut ws.first)
    }

    fn read<'w>(
        &self,
        net: &CalibratedNet,
        patch: &Patch,
        activations: &'w mut Activations,
        peaks: &mut Vec<Peak>,
        out: &mut Vec<DotDetection>,
    ) -> &'w [f32] {
        let cells = net.network.forward(patch, activations);
        find_peaks(cells, &net.calibration, MIN_PROBABILITY, peaks);
        let area = patch.step() * patch.step();
        out.clear();
        out.extend(peaks.iter().map(|peak| DotDetection {
            pixel: patch.to_image(peak.column, peak.row),
            covariance: peak.covariance * area,
            probability: peak.probability,
        }));
        cells
    }

    /// A new workspace.
    pub fn workspace(&self) -> CnnWorkspace {
        let of = |net: &CalibratedNet| Activations::new(net.network.head());
        CnnWorkspace {
            first: of(&self.first),
            second: self.second.as_ref().map(of),
            peaks: Vec::with_capacity(MAX_PEAKS),
        }
    }

    /// Finds the dots of a ball and writes them into `out`, the likeliest first.
    pub fn detect_into(&self, patch: &Patch, ws: &mut CnnWorkspace, out: &mut Vec<DotDetection>) {
        self.read(&self.first, patch, &mut ws.first, &mut ws.peaks, out);
    }

    /// Whether there is a second net, for patches that the first leaves in doubt.
    pub fn looks_again(&self) -> bool {
        self.second.is_some()
    }

    /// Finds the dots by the second net, and how likely each cell shows one; without one, all stays as it was.
    pub fn look_again_into(
        &self,
        patch: &Patch,
        ws: &mut CnnWorkspace,
        out: &mut Vec<DotDetection>,
        heat: &mut Heat,
    ) {
        let Some(net) = &self.second else {
            return;
        };
        let head = net.network.head();
        let activations = ws.second.get_or_insert_with(|| Activations::new(head));
        let cells = self.read(net, patch, activations, &mut ws.peaks, out);
        let heats = cells[Channel::Heat as usize * CELLS * CELLS..].iter();
        heat.fill(heats.map(|&h| net.calibration.probability(f64::from(h)) as f32));
    }
}

/// A peak of the heat map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// The dot's column in the patch.
    pub column: f64,
    /// The dot's row in the patch.
    pub row: f64,
    /// Covariance of (column, row).
    pub covariance: Matrix2<f64>,
    /// The heat, before calibration.
    pub heat: f64,
    /// Probability of a dot.
    pub probability: f64,
}

/// The center of a cell in the patch, along one axis.
pub fn cell_center(cell: usize) -> f64 {
    2.0 * cell as f64 + 0.5
}

/// All peaks of the cells with at least the given probability, the hottest first.
pub fn find_peaks(
    cells: &[f32],
    calibration: &OutputCalibration,
    min_probability: f64,
    peaks: &mut Vec<Peak>,
) {
    peaks.clear();
    debug_assert_eq!(cells.len(), CHANNELS * CELLS * CELLS);
    for row in 0..CELLS {
        for column in 0..CELLS {
            if !is_peak(cells, row, column) {
                continue;
            }
            let peak = read_peak(cells, row, column, calibration);
            if peak.probability >= min_probability {
                peaks.push(peak);
            }
        }
    }
    // A stable sort would allocate; of equal heats the first cell comes first.
    peaks.sort_unstable_by(|a, b| {
        let heat = b.heat.total_cmp(&a.heat);
        let row = || a.row.total_cmp(&b.row);
        heat.then_with(row)
            .then_with(|| a.column.total_cmp(&b.column))
    });
    let mut kept = 0;
    for i in 0..peaks.len() {
        let peak = peaks[i];
        let again = peaks[..kept]
            .iter()
            .any(|k| (k.column - peak.column).hypot(k.row - peak.row) < SAME_DOT);
        if !again {
            peaks[kept] = peak;
            kept += 1;
        }
    }
    peaks.truncate(kept);
}

/// Of equal neighbors the first counts.
fn is_peak(cells: &[f32], row: usize, column: usize) -> bool {
    let here = cells[row * CELLS + column];
    let rows = row.saturating_sub(1)..(row + 2).min(CELLS);
    rows.flat_map(|r| (column.saturating_sub(1)..(column + 2).min(CELLS)).map(move |c| (r, c)))
        .all(|(r, c)| {
            let there = cells[r * CELLS + c];
            there < here || (there == here && (r, c) >= (row, column))
        })
}

fn read_peak(cells: &[f32], row: usize, column: usize, calibration: &OutputCalibration) -> Peak {
    let value = |channel: Channel| cells[(channel as usize * CELLS + row) * CELLS + column];
    let ln = |channel| f64::from(value(channel).clamp(LN_RANGE[0], LN_RANGE[1]));
    let (a, c) = (ln(Channel::LnA).exp(), ln(Channel::LnC).exp());
    let b = f64::from(value(Channel::B));
    // The inverse of L = [[a, 0], [b, c]].
    let inverse = Matrix2::new(1.0 / a, 0.0, -b / (a * c), 1.0 / c);
    let heat = f64::from(value(Channel::Heat));
    Peak {
        column: cell_center(column) + f64::from(value(Channel::Column)),
        row: cell_center(row) + f64::from(value(Channel::Row)),
        covariance: inverse * inverse.transpose() * calibration.covariance_factor,
        heat,
        probability: calibration.probability(heat),
    }
}
