//! A dot pattern: between 4 and 64 distinct unit vectors, and the values that describe it.
//!
//! On disk a pattern is a CSV file, one dot per row, `x,y,z`. It is written without a header, as
//! the published pattern is; a header `x,y,z` is accepted. The row order is the dots' numbering.
//! Lengths that differ from 1 by more than [`LENGTH_TOLERANCE`] are rejected; smaller deviations
//! are normalized.

pub(crate) mod crowding;
mod keep_out;
mod shipped;
mod sidecar;
mod visible;

use std::fmt::Write as _;
use std::path::Path;

use rand::Rng;
use sha2::{Digest, Sha256};

use crate::error::{Error, Result};
#[cfg(feature = "native")]
use crate::files;
use crate::files::csv::{CsvFormat, CsvRow, Rows};
use crate::geometry::{Vec3, angle_between, pair_rotation, random_direction};

pub use keep_out::KeepOut;
#[cfg(feature = "native")]
pub(crate) use shipped::shipped_design;
pub use shipped::{NamedPattern, shipped_designs};
pub use sidecar::{DesignRecord, sidecar_path};

/// Minimum number of dots of a pattern.
pub const MIN_DOTS: usize = 4;
/// Maximum number of dots of a pattern.
pub const MAX_DOTS: usize = 64;
/// Maximum deviation of a vector's length from 1 that is normalized instead of rejected.
pub const LENGTH_TOLERANCE: f64 = 1e-3;
/// Lengths this close to 1 differ by rounding and stay as they are: normalizing twice would change
/// bits.
pub const LENGTH_ROUNDING: f64 = 4.0 * f64::EPSILON;
/// Dots nearer than this (radians) count as the same dot.
pub const MIN_SEPARATION: f64 = 1e-3;
/// Maximum angle between dots of two patterns that are one, radians.
const SAME_DOT_RAD: f64 = 1e-3;

/// `n` distinct dots on the unit sphere, in the pattern's own frame, and the zones they stay out of.
#[derive(Debug, Clone, PartialEq)]
pub struct Pattern {
    dots: Vec<Vec3>,
    keep_out: Vec<KeepOut>,
}

/// Values that describe a pattern.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct PatternSummary {
    /// Number of dots.
    pub dots: usize,
    /// Minimum angle between two dots, radians.
    pub min_separation_rad: f64,
    /// Mean over dots of the angle to the nearest other dot, radians.
    pub mean_nearest_separation_rad: f64,
    /// Minimum number of dots with z > 0 over all viewing directions.
    pub min_visible: usize,
    /// Mean number of dots with z > 0 over all viewing directions (exactly n / 2).
    pub mean_visible: f64,
}

impl Pattern {
    /// Checks and normalizes `dots`.
    ///
    /// # Errors
    /// [`Error::Argument`] naming the dot (counted from 0) that is wrong.
    pub fn new(dots: Vec<Vec3>) -> Result<Self> {
        Self::checked(dots).map_err(|(dot, problem)| match dot {
            Some(i) => Error::argument(format!("pattern dot {i}"), problem),
            None => Error::argument("pattern", problem),
        })
    }

    /// As [`Pattern::new`], with the index of the offending dot.
    fn checked(mut dots: Vec<Vec3>) -> std::result::Result<Self, (Option<usize>, String)> {
        if !(MIN_DOTS..=MAX_DOTS).contains(&dots.len()) {
            let problem = format!(
                "expected {MIN_DOTS} to {MAX_DOTS} dots, found {}",
                dots.len()
            );
            return Err((None, problem));
        }
        for (i, dot) in dots.iter_mut().enumerate() {
            let length = dot.norm();
            if !length.is_finite() {
                return Err((Some(i), "expected three finite numbers".into()));
            }
            if (length - 1.0).abs() > LENGTH_TOLERANCE {
                let problem = format!("expected a unit vector, found length {length:.6}");
                return Err((Some(i), problem));
            }
            if (length - 1.0).abs() > LENGTH_ROUNDING {
                *dot /= length;
            }
        }
        for i in 0..dots.len() {
            for j in 0..i {
                if angle_between(&dots[i], &dots[j]) < MIN_SEPARATION {
                    return Err((Some(i), format!("coincides with dot {j}")));
                }
            }
        }
        Ok(Self {
            dots,
            keep_out: Vec::new(),
        })
    }

    /// The unit vectors, in order of dot index.
    pub fn dots(&self) -> &[Vec3] {
        &self.dots
    }

    /// Number of dots.
    pub fn len(&self) -> usize {
        self.dots.len()
    }

    /// Never true; present for completeness beside [`Pattern::len`].
    pub fn is_empty(&self) -> bool {
        self.dots.is_empty()
    }

    /// Reads a pattern from a CSV file, with the zones that stand beside it ([`sidecar_path`]).
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Input`] naming the line and what was expected there.
    #[cfg(feature = "native")]
    pub fn read_csv(path: &Path) -> Result<Self> {
        let bytes = files::read_at_most(path, files::MAX_TEXT_BYTES)?;
        let (pattern, _) = Self::from_csv(path, &bytes)?.with_sidecar_of(path)?;
        Ok(pattern)
    }

    /// The dots of a CSV file's bytes, without zones; `path` only names the file in errors.
    ///
    /// # Errors
    /// [`Error::Input`] naming the line and what was expected there.
    pub fn from_csv(path: &Path, bytes: &[u8]) -> Result<Self> {
        let mut rows = Rows::new(path, bytes, CsvFormat::default());
        let mut dots = Vec::new();
        let mut lines = Vec::new();
        let mut is_first = true;
        while let Some(row) = rows.next_row()? {
            let is_header = is_first && is_header(&row);
            is_first = false;
            if is_header {
                continue;
            }
            let mut numbers = row.fields().map(str::parse::<f64>);
            match [(); 4].map(|()| numbers.next()) {
                [Some(Ok(x)), Some(Ok(y)), Some(Ok(z)), None] => {
                    if dots.len() == MAX_DOTS {
                        let expected = format!("expected {MIN_DOTS} to {MAX_DOTS} dots");
                        return Err(row.error(format!("{expected}, found more")));
                    }
                    dots.push(Vec3::new(x, y, z));
                    lines.push(row.line());
                }
                _ => {
                    let found = row.shown();
                    let problem = format!("expected three numbers x,y,z, found \"{found}\"");
                    return Err(row.error(problem));
                }
            }
        }
        Self::checked(dots).map_err(|(dot, problem)| {
            let place = dot.map_or("file".to_owned(), |i| {
                format!("line {} (dot {i})", lines[i])
            });
            Error::input(path, place, problem)
        })
    }

    /// The pattern as CSV text: one dot per row, without a header, because the SpinDOE authors'
    /// reader rejects one; digits enough to read back the same bits.
    pub fn to_csv(&self) -> String {
        let mut text = String::new();
        for d in &self.dots {
            // Writing to a String cannot fail.
            let _ = writeln!(text, "{},{},{}", d.x, d.y, d.z);
        }
        text
    }

    /// Writes the pattern as CSV atomically, and its zones beside it ([`sidecar_path`]).
    ///
    /// # Errors
    /// [`Error::Write`].
    #[cfg(feature = "native")]
    pub fn write_csv(&self, path: &Path) -> Result<()> {
        self.write_with(path, None)
    }

    /// SHA-256 (lower-case hex) of the coordinates as little-endian f64, row by row.
    pub fn sha256(&self) -> String {
        let mut hasher = Sha256::new();
        for dot in &self.dots {
            for c in dot.iter() {
                hasher.update(c.to_le_bytes());
            }
        }
        hasher.finalize().iter().fold(String::new(), |mut s, b| {
            let _ = write!(s, "{b:02x}");
            s
        })
    }

    /// Whether another pattern has the same dots, in any order and turned in any way: images cannot distinguish the two.
    pub fn is_turned(&self, other: &Self) -> bool {
        let (a, b) = (&self.dots, &other.dots);
        let ([from, rest @ ..], true) = (&a[..], a.len() == b.len()) else {
            return false;
        };
        // Two dots determine a rotation, best those that are nearest to a right angle.
        let straightness = |dot: &Vec3| from.dot(dot).abs();
        let to = rest
            .iter()
            .min_by(|x, y| straightness(x).total_cmp(&straightness(y)));
        let Some(to) = to else { return false };
        let pairs = b.iter().flat_map(|x| b.iter().map(move |y| [x, y]));
        pairs
            .filter(|[x, y]| (angle_between(x, y) - angle_between(from, to)).abs() < SAME_DOT_RAD)
            .filter_map(|pair| pair_rotation([from, to], pair))
            .any(|turn| {
                let is_dot = |dot: Vec3| b.iter().any(|o| angle_between(o, &dot) < SAME_DOT_RAD);
                a.iter().all(|dot| is_dot(turn * dot))
            })
    }

    /// Minimum number of dots with `z > limit` over all viewing directions, exactly. Directions from
    /// which a dot is at the limit itself do not count.
    pub fn min_visible(&self, limit: f64) -> usize {
        visible::min_visible(&self.dots, limit)
    }

    /// Nearest-neighbor separations, and the number of dots visible from anywhere.
    pub fn summary(&self) -> PatternSummary {
        let n = self.dots.len();
        let nearest: Vec<f64> = (0..n)
            .map(|i| {
                (0..n)
                    .filter(|&j| j != i)
                    .map(|j| angle_between(&self.dots[i], &self.dots[j]))
                    .fold(f64::INFINITY, f64::min)
            })
            .collect();
        let min_visible = self.min_visible(0.0);
        PatternSummary {
            dots: n,
            min_separation_rad: nearest.iter().copied().fold(f64::INFINITY, f64::min),
            mean_nearest_separation_rad: nearest.iter().sum::<f64>() / n as f64,
            min_visible,
            mean_visible: n as f64 / 2.0,
        }
    }
}

/// Whether a dot's number reads as another dot's upside down, so that it is written with a line
/// beneath: 6 and 9, and from 62 dots on 19 and 61.
pub fn reads_upside_down(dot: usize) -> bool {
    let digits = dot.to_string();
    let turned: Option<String> = digits
        .chars()
        .rev()
        .map(|c| match c {
            '0' | '1' | '8' => Some(c),
            '6' => Some('9'),
            '9' => Some('6'),
            _ => None,
        })
        .collect();
    turned.is_some_and(|turned| {
        let other = turned.parse::<usize>();
        // No number begins with 0.
        !turned.starts_with('0') && other.is_ok_and(|other| other != dot && other < MAX_DOTS)
    })
}

/// Tries to place one dot at random apart from the others before all start afresh.
const PLACEMENT_TRIES: usize = 2_000;
/// Restarts before a separation counts as infeasible at random.
const FRESH_STARTS: usize = 50;

/// Random dots no nearer to each other than the given separation.
///
/// # Errors
/// [`Error::Argument`] where no such set was found: the separation is too large for so many dots.
pub fn random_pattern<R: Rng>(
    dots: usize,
    min_separation_rad: f64,
    rng: &mut R,
) -> Result<Pattern> {
    let bound = min_separation_rad.cos();
    for _ in 0..FRESH_STARTS {
        let mut placed: Vec<Vec3> = Vec::with_capacity(dots);
        for _ in 0..PLACEMENT_TRIES {
            let d = random_direction(rng);
            if placed.iter().all(|p| p.dot(&d) < bound) {
                placed.push(d);
                if placed.len() == dots {
                    return Pattern::new(placed);
                }
            }
        }
    }
    Err(Error::argument(
        "dots",
        format!(
            "{dots} dots at least {:.1} degrees apart do not fit on a ball at random; ask for fewer or nearer dots",
            min_separation_rad.to_degrees()
        ),
    ))
}

/// Whether a row is the header that a pattern may have.
fn is_header(row: &CsvRow<'_>) -> bool {
    row.len() == 3
        && row
            .fields()
            .zip(["x", "y", "z"])
            .all(|(field, name)| field.eq_ignore_ascii_case(name))
}
