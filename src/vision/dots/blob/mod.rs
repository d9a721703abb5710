//! A classical detector of dark dots: the baseline for the trained one.
//!
//! 1. A smooth surface is fitted to the ball's shading and subtracted.
//! 2. Differences of Gaussians at three scales find dark blobs (T. Lindeberg, "Feature detection
//!    with automatic scale selection", IJCV 30, 1998); towards the border they are normalized by
//!    the part of the Gaussian on the ball.
//! 3. At each blob the projection of a dot is fitted: a Gaussian foreshortened along the radius and
//!    blurred like the image. The fit gives the center to a fraction of a pixel, its covariance,
//!    and a measure of how dot-like the blob is.
//!
//! Not guaranteed: that a blob is a dot. The detector finds dark spots, so a logo's letters are
//! dots to it, and it assumes that dots are darker than the ball.

pub(crate) mod flatten;
mod shape;

use self::flatten::{Flat, Shading};
use self::shape::Blob;
use super::detector::DotDetection;
use super::patch::{MIDDLE, Patch, RADIUS, SIZE};
use crate::stats::logistic;

/// Standard deviations of the Gaussians, patch values; each difference is of two neighbors.
const SIGMAS: [f32; 4] = [1.2, 1.9, 3.0, 4.8];
/// Blobs fainter than this part of the strongest are not processed.
const FAINT: f32 = 0.12;
/// Maximum number of blobs that are processed.
const MAX_BLOBS: usize = 48;
/// Dots nearer than this, in patch values, are one.
const ONE_DOT: f64 = 2.5;
/// Blur of the image, standard deviation in ball radii: a pixel on a ball of 60 px.
const BLUR: f64 = 0.035;
/// Minimum and maximum radius of a dot, ball radii.
const DOT_RADIUS: (f64, f64) = (0.05, 0.25);
/// Contrast over the noise of a dot's mean at which a blob is as likely a dot as not.
const SIGNAL_TO_NOISE: f64 = 6.0;
/// Part of the strong dots' contrast at which a blob is as likely a dot as not.
const RELATIVE_CONTRAST: f64 = 0.35;
/// Depth (z) below which dots are seen too obliquely to be distinguished from the limb.
const MIN_DEPTH: f64 = 0.16;
/// Detections with less probability are dropped.
const MIN_PROBABILITY: f64 = 0.05;

/// The detector. See the module's documentation.
#[derive(Debug, Clone)]
pub struct BlobDetector {
    shading: Shading,
    kernels: [Vec<f32>; SIGMAS.len()],
    /// The part of each Gaussian that lies on the ball, pixel by pixel.
    shares: [Vec<f32>; SIGMAS.len()],
}

/// Working memory of [`BlobDetector`].
#[derive(Debug, Default)]
pub struct BlobWorkspace {
    flat: Flat,
    half: Vec<f32>,
    blurred: [Vec<f32>; SIGMAS.len()],
    response: Vec<f32>,
    scale: Vec<u8>,
    candidates: Vec<(f32, usize)>,
    blobs: Vec<Blob>,
    contrasts: Vec<f64>,
}

impl Default for BlobDetector {
    fn default() -> Self {
        Self::new()
    }
}

impl BlobDetector {
    /// The detector, with its tables.
    pub fn new() -> Self {
        let shading = Shading::new();
        let kernels = SIGMAS.map(gaussian);
        let mut half = Vec::new();
        let shares = [0, 1, 2, 3].map(|k| {
            let mut share = Vec::new();
            blur(shading.mask(), &kernels[k], &mut half, &mut share);
            share
        });
        Self {
            shading,
            kernels,
            shares,
        }
    }

    /// The largest difference of Gaussians over all scales, and at which.
    fn respond(&self, ws: &mut BlobWorkspace) {
        for k in 0..SIGMAS.len() {
            let flat = ws.flat.values();
            blur(flat, &self.kernels[k], &mut ws.half, &mut ws.blurred[k]);
            for (value, share) in ws.blurred[k].iter_mut().zip(&self.shares[k]) {
                *value /= share.max(0.05);
            }
        }
        ws.response.clear();
        ws.scale.clear();
        for (i, on_ball) in self.shading.mask().iter().enumerate() {
            let (mut best, mut scale) = (0.0, 0);
            if *on_ball > 0.0 {
                for k in 0..SIGMAS.len() - 1 {
                    let response = ws.blurred[k + 1][i] - ws.blurred[k][i];
                    if response > best {
                        (best, scale) = (response, k as u8);
                    }
                }
            }
            ws.response.push(best);
            ws.scale.push(scale);
        }
    }

    /// Peaks of the response, strongest first.
    fn candidates(ws: &mut BlobWorkspace) {
        let strongest = ws.response.iter().copied().fold(0.0, f32::max);
        ws.candidates.clear();
        // No two peaks are neighbors.
        ws.candidates.reserve(SIZE * SIZE / 4);
        for row in 1..SIZE - 1 {
            for column in 1..SIZE - 1 {
                let i = row * SIZE + column;
                let response = ws.response[i];
                if response <= FAINT * strongest || response <= 0.0 {
                    continue;
                }
                let mut is_peak = true;
                for other in [i - SIZE - 1, i - SIZE, i - SIZE + 1, i - 1] {
                    is_peak &= ws.response[other] < response;
                }
                for other in [i + 1, i + SIZE - 1, i + SIZE, i + SIZE + 1] {
                    is_peak &= ws.response[other] <= response;
                }
                if is_peak {
                    ws.candidates.push((response, i));
                }
            }
        }
        ws.candidates
            .sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        ws.candidates.truncate(MAX_BLOBS);
    }
}

impl BlobDetector {
    /// A new workspace.
    pub fn workspace(&self) -> BlobWorkspace {
        BlobWorkspace::default()
    }

    /// Finds the dots of a ball and writes them into `out`, the likeliest first.
    pub fn detect_into(&self, patch: &Patch, ws: &mut BlobWorkspace, out: &mut Vec<DotDetection>) {
        out.clear();
        self.shading.flatten(patch.values(), &mut ws.flat);
        self.respond(ws);
        Self::candidates(ws);
        ws.blobs.clear();
        ws.blobs.reserve(MAX_BLOBS);
        for &(_, i) in &ws.candidates {
            let start = ((i % SIZE) as f64, (i / SIZE) as f64);
            let sigma = f64::from(SIGMAS[usize::from(ws.scale[i])]);
            let blur = BLUR * RADIUS;
            let Some(blob) = shape::fit(&ws.flat, self.shading.mask(), start, sigma, blur) else {
                continue;
            };
            let near = |b: &Blob| (b.column - blob.column).hypot(b.row - blob.row) < ONE_DOT;
            match ws.blobs.iter_mut().find(|b| near(b)) {
                Some(known) if known.signal_to_noise < blob.signal_to_noise => *known = blob,
                Some(_) => {}
                None => ws.blobs.push(blob),
            }
        }
        ws.contrasts.clear();
        ws.contrasts.reserve(MAX_BLOBS);
        let clear = |b: &&Blob| b.signal_to_noise > SIGNAL_TO_NOISE && b.depth > 0.4;
        ws.contrasts
            .extend(ws.blobs.iter().filter(clear).map(|b| b.contrast));
        ws.contrasts.sort_unstable_by(f64::total_cmp);
        let Some(&strong) = ws.contrasts.get(ws.contrasts.len() * 2 / 3) else {
            return;
        };
        let step = patch.step();
        for blob in &ws.blobs {
            let probability = probability(blob, strong);
            if probability >= MIN_PROBABILITY {
                out.push(DotDetection {
                    pixel: patch.to_image(blob.column, blob.row),
                    // Values of a coarse image are interpolated: their noise is shared by
                    // neighbors.
                    covariance: blob.covariance * (step * step).max(1.0),
                    probability,
                });
            }
        }
        out.sort_unstable_by(|a, b| b.probability.total_cmp(&a.probability));
    }
}

/// How likely a blob is a dot, among such strong ones.
fn probability(blob: &Blob, strong: f64) -> f64 {
    let radius = blob.radius / RADIUS;
    let (low, high) = DOT_RADIUS;
    logistic((blob.signal_to_noise - SIGNAL_TO_NOISE) / 1.2)
        * logistic(12.0 * (blob.contrast / strong - RELATIVE_CONTRAST))
        * logistic(10.0 * (blob.explained - 0.5))
        * logistic((radius - low) / (0.1 * low))
        * logistic((high - radius) / (0.1 * high))
        * logistic((blob.depth - MIN_DEPTH) / 0.03)
}
/// A Gaussian out to three standard deviations, of sum 1.
fn gaussian(sigma: f32) -> Vec<f32> {
    let half = (3.0 * sigma).ceil() as i32;
    let weight = |k: i32| (-0.5 * (k as f32 / sigma).powi(2)).exp();
    let sum: f32 = (-half..=half).map(weight).sum();
    (-half..=half).map(|k| weight(k) / sum).collect()
}

/// Convolves a patch with a kernel along rows and columns; nothing lies outside.
fn blur(values: &[f32], kernel: &[f32], half_done: &mut Vec<f32>, out: &mut Vec<f32>) {
    let half = kernel.len() / 2;
    // Sums of shifted rows run over whole rows at once, which compilers vectorize.
    let shifted = |k: usize| {
        let (from, to) = (k.saturating_sub(half), half.saturating_sub(k));
        (from, to, SIZE - from.max(to))
    };
    half_done.clear();
    half_done.resize(SIZE * SIZE, 0.0);
    for row in 0..SIZE {
        let source = &values[row * SIZE..][..SIZE];
        let target = &mut half_done[row * SIZE..][..SIZE];
        for (k, weight) in kernel.iter().enumerate() {
            let (from, to, count) = shifted(k);
            for (t, s) in target[to..][..count]
                .iter_mut()
                .zip(&source[from..][..count])
            {
                *t += weight * s;
            }
        }
    }
    out.clear();
    out.resize(SIZE * SIZE, 0.0);
    for (k, weight) in kernel.iter().enumerate() {
        let (from, to, count) = shifted(k);
        let source = &half_done[from * SIZE..][..count * SIZE];
        let target = &mut out[to * SIZE..][..count * SIZE];
        for (t, s) in target.iter_mut().zip(source) {
            *t += weight * s;
        }
    }
}

/// Position in a patch in ball radii from the center: x to the right, y downwards.
fn in_radii(column: f64, row: f64) -> (f64, f64) {
    ((column - MIDDLE) / RADIUS, (row - MIDDLE) / RADIUS)
}
