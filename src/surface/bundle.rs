//! All frames of a clip, the surface and what the views share, fitted to the pixels at once.
//!
//! With `f_k` a face, `R_k exp(-w_k)` its true rotation, `m` the surface and `d_k` how directions of the view frame move with what the views
//! share, `t` (outlines off by the same part of their radii, and the camera's distance),
//!
//! ```text
//! f_k(R_k p) - m(p) = w_k . (p x grad m) - t . (grad m . R_k^-1 d_k(R_k p)) + noise
//! ```
//!
//! The best `m(p)` is the mean over the views that show `p`, given all else, so that it leaves the equations: each row less its place's mean. An
//! outline that is too small makes every turn too long, and surface and poses follow: only all at once they come back. (Photometric bundle
//! adjustment: J. Engel, V. Koltun, D. Cremers, "Direct sparse odometry", PAMI 2018.) Rows are weighted by Tukey's biweight about the median
//! surface.

use nalgebra::{DMatrix, DVector, Vector4};

use super::clip::{Clip, FIXED, SharedOffset};
use super::fit::{LEAST_SIGMA, MAX_STEP, REACH};
use super::laid::{ALIGNED, Laid};
use super::surface_map::{PLACES, PlaceGrid, SurfaceMap};
use crate::concurrency;
use crate::fit::{biweight, weighted_sigma};
use crate::geometry::{Rotation, Vec3};

/// Standard deviation of a frame's turn in one step, radians: what nothing fixes stays.
const DAMPING: f64 = 0.2;

/// A visible place of a frame.
#[derive(Debug, Clone, Copy, Default)]
struct PixelRow {
    place: u32,
    frame: u32,
    weight: f64,
    residual: f64,
    by: Vector4<f64>,
}

/// Which surface the frames are fitted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Paint {
    /// The one that they show: it is fitted with them.
    Own,
    /// A known one.
    Known,
}

/// One step: the rotations of the frames `asked` are moved; how what the views share is to be moved is returned.
pub(crate) fn step(
    grid: &PlaceGrid,
    surface: &SurfaceMap,
    paint: Paint,
    clip: &Clip<'_>,
    asked: &[usize],
    laid: &mut [Option<Laid>],
) -> Option<Vector4<f64>> {
    let rows = rows(grid, surface, clip, asked, laid);
    let mut equations = BundleEquations::new(asked.len());
    for rows in rows.chunk_by(|a, b| a.place == b.place) {
        let turn = Vec3::from(surface.turns[rows[0].place as usize].map(f64::from));
        match paint {
            Paint::Own => equations.add(rows, &turn),
            Paint::Known => rows.iter().for_each(|row| equations.add_row(row, &turn)),
        }
    }
    // On a surface of its own, the first frame's rotation is a choice.
    equations.hold(paint == Paint::Own, &clip.shared());
    let (turns, shared) = equations.solve()?;
    let most = turns.iter().map(|t| t.norm()).fold(0.0, f64::max);
    let scale = MAX_STEP / most.max(MAX_STEP);
    for (k, turn) in asked.iter().zip(turns) {
        if let Some(laid) = &mut laid[*k] {
            laid.rotation *= Rotation::from_scaled_axis(-turn * scale);
            laid.rotation.renormalize();
        }
    }
    Some(shared * scale)
}

/// What the frames show of the places, by places.
fn rows(
    grid: &PlaceGrid,
    surface: &SurfaceMap,
    clip: &Clip<'_>,
    asked: &[usize],
    laid: &[Option<Laid>],
) -> Vec<PixelRow> {
    let numbers: Vec<usize> = (0..asked.len()).collect();
    let of_frame = |&number: &usize| -> Option<Vec<PixelRow>> {
        let k = asked[number];
        let (face, laid, moved) = (clip.faces[k].as_ref()?, laid[k].as_ref()?, clip.moved(k)?);
        let turn = laid.rotation.to_rotation_matrix();
        let back = turn.inverse();
        let towards = back * Vec3::z();
        let least = face.least_z(ALIGNED) - 1e-9;
        let mut rows = Vec::new();
        let mut sizes = Vec::new();
        for &place in &surface.steep {
            let direction = &grid.directions[place as usize];
            if direction.dot(&towards) < least {
                continue;
            }
            let at = turn * direction;
            let depth = face.depth(&at);
            if depth < ALIGNED {
                continue;
            }
            let Some(by) = moved.by(&at) else { continue };
            let slope = Vec3::from(surface.turns[place as usize].map(f64::from)).cross(direction);
            let residual = face.at(&at) - f64::from(surface.values[place as usize]);
            sizes.push([residual.abs(), slope.norm_squared()]);
            rows.push(PixelRow {
                place,
                frame: number as u32,
                weight: depth,
                residual,
                by: Vector4::from_fn(|j, _| -slope.dot(&(back * by[j]))),
            });
        }
        let sigma = weighted_sigma(&mut sizes).max(LEAST_SIGMA);
        let scale = 1.0 / (face.places_a_value(PLACES) * sigma * sigma);
        for row in &mut rows {
            row.weight *= scale * biweight(row.residual / (REACH * sigma));
        }
        rows.retain(|r| r.weight > 0.0);
        Some(rows)
    };
    let found = concurrency::map(&numbers, of_frame);
    by_places(found.into_iter().flatten().flatten().collect())
}

/// Rows in the order of their places, and of the frames where these are one.
fn by_places(rows: Vec<PixelRow>) -> Vec<PixelRow> {
    let mut next = vec![0; PLACES + 1];
    rows.iter().for_each(|r| next[r.place as usize + 1] += 1);
    for place in 0..PLACES {
        next[place + 1] += next[place];
    }
    let mut ordered = vec![PixelRow::default(); rows.len()];
    for row in rows {
        let at = &mut next[row.place as usize];
        ordered[*at] = row;
        *at += 1;
    }
    ordered
}

/// The normal equations, the lower triangle: three unknowns a frame, then what the views share.
struct BundleEquations {
    matrix: DMatrix<f64>,
    vector: DVector<f64>,
    frames: usize,
}

impl BundleEquations {
    fn new(frames: usize) -> Self {
        let size = 3 * frames + 4;
        Self {
            matrix: DMatrix::zeros(size, size),
            vector: DVector::zeros(size),
            frames,
        }
    }

    /// Adds the rows of a place, each less their mean.
    fn add(&mut self, rows: &[PixelRow], turn: &Vec3) {
        let sum: f64 = rows.iter().map(|r| r.weight).sum();
        let mean = rows.iter().map(|r| r.weight * r.residual).sum::<f64>() / sum;
        let by = |all: Vector4<f64>, r: &PixelRow| all + r.by * r.weight;
        let mean_by = rows.iter().fold(Vector4::zeros(), by) / sum;
        let square = turn * turn.transpose();
        for (k, row) in rows.iter().enumerate() {
            let centered = PixelRow {
                residual: row.residual - mean,
                by: row.by - mean_by,
                ..*row
            };
            self.add_row(&centered, turn);
            // Of the matrix the lower triangle: the rows of a place are in the order of the frames.
            for other in &rows[..=k] {
                let at = (3 * row.frame as usize, 3 * other.frame as usize);
                let mut block = self.matrix.fixed_view_mut::<3, 3>(at.0, at.1);
                block -= square * (row.weight * other.weight / sum);
            }
        }
    }

    fn add_row(&mut self, row: &PixelRow, turn: &Vec3) {
        let (own, shared) = (3 * row.frame as usize, 3 * self.frames);
        let (weight, by) = (row.weight, &row.by);
        let matrix = &mut self.matrix;
        let mut part = matrix.fixed_view_mut::<3, 3>(own, own);
        part.ger(weight, turn, turn, 1.0);
        let mut part = matrix.fixed_view_mut::<4, 3>(shared, own);
        part.ger(weight, by, turn, 1.0);
        let mut part = matrix.fixed_view_mut::<4, 4>(shared, shared);
        part.ger(weight, by, by, 1.0);
        let residual = weight * row.residual;
        let mut part = self.vector.fixed_rows_mut::<3>(own);
        part.axpy(residual, turn, 1.0);
        let mut part = self.vector.fixed_rows_mut::<4>(shared);
        part.axpy(residual, by, 1.0);
    }

    /// Adds what is known before any frame is seen; the first frame's rotation stays where it `is_chosen`.
    fn hold(&mut self, is_chosen: bool, shared: &[SharedOffset; 4]) {
        let first = 3 * self.frames;
        for j in 0..first {
            let sigma = if is_chosen && j < 3 { FIXED } else { DAMPING };
            self.matrix[(j, j)] += 1.0 / (sigma * sigma);
        }
        for (j, SharedOffset { off, sigma }) in shared.iter().enumerate() {
            let weight = 1.0 / (sigma * sigma);
            self.matrix[(first + j, first + j)] += weight;
            self.vector[first + j] -= weight * off;
        }
    }

    /// The frames' turns and the step of what the views share.
    fn solve(self) -> Option<(Vec<Vec3>, Vector4<f64>)> {
        let solved = self.matrix.cholesky()?.solve(&self.vector);
        let turns = (0..self.frames).map(|k| solved.fixed_rows::<3>(3 * k).into());
        let shared = solved.fixed_rows::<4>(3 * self.frames).into();
        Some((turns.collect(), shared))
    }
}
