//! The file of observed dots: what a dot detector writes and `identify` reads.
//!
//! CSV with a header, one dot per row, the rows of one frame together:
//!
//! ```text
//! frame,x,y,z[,time_s][,sigma_deg][,var_radial_deg2,cov_deg2,var_across_deg2]
//! ```
//!
//! `frame` is any text, `x,y,z` the unit vector from the ball's center to the dot in the camera
//! frame (x right, y up, z towards the camera). The other columns are optional: the frame's time in
//! seconds, and a dot's uncertainty. The uncertainty is either `sigma_deg`, the standard deviation
//! along any one tangent axis, or a covariance in degrees squared. The covariance's first axis
//! points radially outward in the image (towards the limb, along growing angle from z). Its second
//! axis is `direction x first`, counter-clockwise as the camera sees it. For a dot exactly on the z
//! axis the first axis is x. An empty field means that the value is unknown.
//!
//! [`ObservedReader`] yields frame after frame from any input, in memory that does not grow with
//! the file. A frame is complete, and yielded, when a row of the next one or the end is read.
//!
//! Guarantees: directions are finite and of unit length, covariances positive definite, at most
//! [`MAX_FRAME_DOTS`] dots in a frame, and no name among the [`REMEMBERED_FRAMES`] frames before
//! it. All other input is rejected with the line and the field. Beyond that many frames, names are
//! remembered at random: a recording given twice is still rejected within its first frames, but a
//! single misplaced row may pass as a frame of its own.

use std::collections::HashSet;
use std::fmt::Write as _;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::BufRead;
use std::path::Path;

use nalgebra::Matrix2;

use crate::error::{Error, Result};
use crate::files;
use crate::files::csv::{Columns, Field, Table, TableRow, quoted, shown};
use crate::geometry::{Spherical, Vec3, tangent_frame};
use crate::pattern::{LENGTH_ROUNDING, LENGTH_TOLERANCE, Pattern};
use crate::view::{DotUncertainty, ObservedDot, Trial, TrialGenerator, ViewModel};

/// Maximum number of dots of a frame; far more than any pattern and its false dots show. The
/// recognizers compare all pairs of them, and the robust one's memory grows with their square.
pub const MAX_FRAME_DOTS: usize = 256;
/// Frames whose names are remembered, to detect rows separated from their frame: 6 minutes at 350
/// frames per second, in 4 MB.
pub const REMEMBERED_FRAMES: usize = 1 << 17;

static COLUMNS: Columns<9> = Columns {
    names: [
        "frame",
        "x",
        "y",
        "z",
        "time_s",
        "sigma_deg",
        "var_radial_deg2",
        "cov_deg2",
        "var_across_deg2",
    ],
    required: 0..4,
};
/// Steps between names that decide whether these are times.
const COUNTED_STEPS: usize = 256;
/// Those of [`COLUMNS`] that make up a covariance.
const COVARIANCE: std::ops::Range<usize> = 6..9;
/// Dots nearer to the z axis than this (sine) have no outward direction.
const CENTER: f64 = 1e-12;

/// The dots observed in one image.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservedFrame {
    /// The frame's name.
    pub name: String,
    /// Time of the image in seconds, where the file has it, or the name is a whole number of nanoseconds.
    pub time_s: Option<f64>,
    /// Whether the name is a whole number, but those of the file number the frames.
    pub is_numbered: bool,
    /// The dots, camera frame.
    pub dots: Vec<ObservedDot>,
}

/// The first `samples` trials of a seed as a detector would report them, named `trial-0`,
/// `trial-1`, ...; views with too few real dots for the model are left out.
pub fn observed_frames(
    pattern: &Pattern,
    view: &ViewModel,
    seed: u64,
    samples: u64,
) -> Vec<ObservedFrame> {
    let mut generator = TrialGenerator::new(pattern.dots(), *view, seed);
    let mut trial = Trial::default();
    let mut frame = |index: u64| {
        generator.generate(index, &mut trial);
        (trial.real_dots() >= view.min_dots).then(|| ObservedFrame {
            name: format!("trial-{index}"),
            time_s: None,
            is_numbered: false,
            dots: trial.dots.clone(),
        })
    };
    (0..samples).filter_map(&mut frame).collect()
}

/// Unit tangent vectors at a direction: outward in the image, and counter-clockwise across.
pub fn image_axes(direction: &Vec3) -> [Vec3; 2] {
    if direction.xy().norm() < CENTER {
        return [Vec3::x(), direction.cross(&Vec3::x())];
    }
    let outward = Spherical::from_direction(direction).jacobian().d_theta;
    [outward, direction.cross(&outward)]
}

/// Reads a whole file of observed dots. Dots without a stated uncertainty get `sigma_rad`
/// (radians, along one tangent axis).
///
/// # Errors
/// [`Error::Read`], or [`Error::Input`] naming the line and what was expected there.
#[cfg(feature = "native")]
pub fn read_csv(path: &Path, sigma_rad: f64) -> Result<Vec<ObservedFrame>> {
    ObservedReader::new(path, files::open(path)?, sigma_rad)?.collect()
}

/// The frames of a file of observed dots, one by one. After an error there are no more.
pub struct ObservedReader<R> {
    table: Table<R, 9>,
    sigma_rad: f64,
    /// The frame whose rows are being read.
    pending: Option<ObservedFrame>,
    names: RecentNames,
    /// The steps of names that are whole numbers, of the first frames.
    steps_ns: Vec<u64>,
    ended: bool,
}

impl<R: BufRead> ObservedReader<R> {
    /// Reads the header of `input`; `path` names it in errors. Dots without a stated uncertainty
    /// get `sigma_rad` (radians, along one tangent axis).
    ///
    /// # Errors
    /// [`Error::Read`], or [`Error::Input`] where a column is missing or occurs twice.
    pub fn new(path: &Path, input: R, sigma_rad: f64) -> Result<Self> {
        let table = Table::new(path, input, &COLUMNS)?;
        let missing = COVARIANCE.clone().find(|&i| !table.has(i));
        if let Some(i) = missing.filter(|_| COVARIANCE.clone().any(|i| table.has(i))) {
            let missing = COLUMNS.names[i];
            let problem = format!("{ALL_OR_NONE}, {missing} is missing");
            return Err(table.header_error(problem));
        }
        Ok(Self {
            table,
            sigma_rad,
            pending: None,
            names: RecentNames::default(),
            steps_ns: Vec::new(),
            ended: false,
        })
    }

    /// A frame with its time, now that the name of the next one is known.
    fn timed(&mut self, mut frame: ObservedFrame, next: Option<&str>) -> ObservedFrame {
        let Some(ns) = files::nanoseconds(&frame.name).filter(|_| frame.time_s.is_none()) else {
            return frame;
        };
        if let Some(next) = next.and_then(files::nanoseconds)
            && self.steps_ns.len() < COUNTED_STEPS
        {
            self.steps_ns.push(next.abs_diff(ns));
        }
        match files::frame_number_step(self.steps_ns.clone()) {
            Some(_) => frame.is_numbered = true,
            None => frame.time_s = Some(ns as f64 * 1e-9),
        }
        frame
    }

    /// Reads on until a frame is complete.
    fn read_frame(&mut self) -> Result<Option<ObservedFrame>> {
        while let Some(row) = self.table.next_row()? {
            let name = row.text(0).unwrap_or_default();
            let time_s = row.number(4).map_err(|p| row.error(p))?;
            let dot = dot(&row, self.sigma_rad).map_err(|p| row.error(p))?;
            if let Some(frame) = self.pending.as_mut().filter(|f| f.name == name) {
                if frame.time_s != time_s {
                    return Err(row.error("time_s: expected one time for all dots of a frame"));
                }
                if frame.dots.len() == MAX_FRAME_DOTS {
                    let problem = format!("expected at most {MAX_FRAME_DOTS} dots in a frame");
                    return Err(row.error(problem));
                }
                frame.dots.push(dot);
                continue;
            }
            if !self.names.insert(name) {
                let name = shown(name);
                let problem = format!("frame: expected the rows of \"{name}\" to stand together");
                return Err(row.error(problem));
            }
            let begun = ObservedFrame {
                name: name.to_owned(),
                time_s,
                is_numbered: false,
                dots: vec![dot],
            };
            let next = begun.name.clone();
            if let Some(complete) = self.pending.replace(begun) {
                return Ok(Some(self.timed(complete, Some(&next))));
            }
        }
        self.ended = true;
        if self.pending.is_none() && self.names.is_empty() {
            let problem = "expected at least one dot";
            return Err(Error::input(self.table.path(), "file", problem));
        }
        let last = self.pending.take();
        Ok(last.map(|frame| self.timed(frame, None)))
    }
}

impl<R: BufRead> Iterator for ObservedReader<R> {
    type Item = Result<ObservedFrame>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let frame = self.read_frame();
        self.ended |= frame.is_err();
        frame.transpose()
    }
}

/// The names of the last frames, as hashes of 64 bits: two of a million names share one with a
/// probability of 3e-8.
#[derive(Default)]
struct RecentNames {
    hashes: HashSet<u64>,
    /// The same hashes, in the order in which they are replaced.
    places: Vec<u64>,
}

impl RecentNames {
    /// Records a name; returns whether it is new.
    fn insert(&mut self, name: &str) -> bool {
        // The same hash key in every process, so the forgotten names do not depend on chance.
        let mut hasher = DefaultHasher::new();
        name.hash(&mut hasher);
        let hash = hasher.finish();
        if !self.hashes.insert(hash) {
            return false;
        }
        if self.places.len() < REMEMBERED_FRAMES {
            self.places.push(hash);
        } else {
            let place = hash as usize % REMEMBERED_FRAMES;
            self.hashes.remove(&self.places[place]);
            self.places[place] = hash;
        }
        true
    }

    fn is_empty(&self) -> bool {
        self.places.is_empty()
    }
}

/// The text of a file of observed dots, digits enough to read the directions back bit by bit.
pub fn to_csv(frames: &[ObservedFrame]) -> String {
    let mut text = COLUMNS.names.join(",");
    text.push('\n');
    for frame in frames {
        let name = quoted(&frame.name);
        let time = frame.time_s.map_or(String::new(), |t| t.to_string());
        for dot in &frame.dots {
            let d = &dot.direction;
            let uncertainty = match dot.uncertainty {
                DotUncertainty::Isotropic { sigma_rad } => format!("{},,,", sigma_rad.to_degrees()),
                DotUncertainty::Tangent { covariance } => {
                    let c = turned(&covariance, &tangent_frame(d), &image_axes(d));
                    let degrees = 1f64.to_degrees().powi(2);
                    let [radial, mixed, across] =
                        [c[(0, 0)], c[(0, 1)], c[(1, 1)]].map(|x| x * degrees);
                    format!(",{radial},{mixed},{across}")
                }
            };
            // Writing to a String cannot fail.
            let _ = writeln!(text, "{name},{},{},{},{time},{uncertainty}", d.x, d.y, d.z);
        }
    }
    text
}

/// The uncertainty of a direction whose covariance, rad^2, is given in [`image_axes`].
pub fn from_image_covariance(direction: &Vec3, covariance: &Matrix2<f64>) -> DotUncertainty {
    DotUncertainty::Tangent {
        covariance: turned(
            covariance,
            &image_axes(direction),
            &tangent_frame(direction),
        ),
    }
}

/// A covariance in the axes `to` instead of `from`, both orthonormal bases of one plane.
fn turned(covariance: &Matrix2<f64>, from: &[Vec3; 2], to: &[Vec3; 2]) -> Matrix2<f64> {
    let turn = Matrix2::from_fn(|i, j| to[i].dot(&from[j]));
    turn * covariance * turn.transpose()
}

const ALL_OR_NONE: &str =
    "expected all of var_radial_deg2,cov_deg2,var_across_deg2 or none of them";

/// The dot of a row.
fn dot(row: &TableRow<'_, 9>, sigma_rad: f64) -> Field<ObservedDot> {
    let mut direction = Vec3::zeros();
    for axis in 0..3 {
        let column = axis + 1;
        let missing = || {
            let name = COLUMNS.names[column];
            format!("{name}: expected a number, found nothing")
        };
        direction[axis] = row.number(column)?.ok_or_else(missing)?;
    }
    let length = direction.norm();
    if (length - 1.0).abs() > LENGTH_TOLERANCE {
        return Err(format!(
            "x,y,z: expected a unit vector, found one of length {length:.6}"
        ));
    }
    if (length - 1.0).abs() > LENGTH_ROUNDING {
        direction /= length;
    }
    let uncertainty = uncertainty(row, &direction, sigma_rad)?;
    Ok(ObservedDot {
        direction,
        uncertainty,
    })
}

/// The uncertainty of a row's dot.
fn uncertainty(row: &TableRow<'_, 9>, direction: &Vec3, sigma_rad: f64) -> Field<DotUncertainty> {
    let sigma = row.number(5)?;
    let covariance = match [row.number(6)?, row.number(7)?, row.number(8)?] {
        [None, None, None] => None,
        [Some(radial), Some(mixed), Some(across)] => Some((radial, mixed, across)),
        _ => return Err(ALL_OR_NONE.into()),
    };
    match (sigma, covariance) {
        (None, None) => Ok(DotUncertainty::Isotropic { sigma_rad }),
        (Some(deg), None) if deg > 0.0 => Ok(DotUncertainty::Isotropic {
            sigma_rad: deg.to_radians(),
        }),
        (Some(deg), None) => Err(format!(
            "sigma_deg: expected a positive number, found {deg}"
        )),
        (None, Some((radial, mixed, across))) => {
            if !(radial > 0.0 && across > 0.0 && radial * across > mixed * mixed) {
                return Err(format!(
                    "var_radial_deg2,cov_deg2,var_across_deg2: expected a positive definite covariance, found {radial},{mixed},{across}"
                ));
            }
            let rad2 = 1f64.to_radians().powi(2);
            let image = Matrix2::new(radial, mixed, mixed, across) * rad2;
            Ok(from_image_covariance(direction, &image))
        }
        (Some(_), Some(_)) => Err("sigma_deg: expected it or a covariance, found both".into()),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn reader(text: &str) -> ObservedReader<&[u8]> {
        ObservedReader::new(Path::new("dots.csv"), text.as_bytes(), 0.1).unwrap()
    }

    #[test]
    fn a_frame_is_handed_out_when_the_next_begins() {
        /// Counts the reads.
        struct CountedLines<'a>(
            std::str::SplitInclusive<'a, char>,
            &'a std::cell::Cell<usize>,
        );
        impl std::io::Read for CountedLines<'_> {
            fn read(&mut self, to: &mut [u8]) -> std::io::Result<usize> {
                self.1.set(self.1.get() + 1);
                let line = self.0.next().unwrap_or_default().as_bytes();
                to[..line.len()].copy_from_slice(line);
                Ok(line.len())
            }
        }
        let text = "frame,x,y,z\na,1,0,0\na,0,1,0\nb,1,0,0\nb,0,1,0\nc,1,0,0\n";
        let lines = std::cell::Cell::new(0);
        let input = std::io::BufReader::new(CountedLines(text.split_inclusive('\n'), &lines));
        let mut frames = ObservedReader::new(Path::new("dots.csv"), input, 0.1).unwrap();
        assert_eq!(frames.next().unwrap().unwrap().dots.len(), 2);
        assert_eq!(
            lines.get(),
            4,
            "the header, two rows, and one of the next frame"
        );
        assert_eq!(frames.next().unwrap().unwrap().name, "b");
        assert_eq!(lines.get(), 6);
        assert_eq!(frames.next().unwrap().unwrap().name, "c");
        assert!(frames.next().is_none() && frames.next().is_none());
    }

    #[test]
    fn after_an_error_there_are_no_frames() {
        let mut frames = reader("frame,x,y,z\na,1,0,0\nb,1,0,0\na,1,0,0\nc,1,0,0\nd,1,0,0\n");
        assert_eq!(frames.next().unwrap().unwrap().name, "a");
        let error = frames.next().unwrap().unwrap_err().to_string();
        assert!(
            error.contains("line 4: frame: expected the rows of \"a\""),
            "{error}"
        );
        assert!(frames.next().is_none());
    }

    #[test]
    fn names_are_remembered_in_bounded_memory() {
        let mut names = RecentNames::default();
        for i in 0..REMEMBERED_FRAMES {
            assert!(names.insert(&i.to_string()));
        }
        // So far all of them.
        for i in (0..REMEMBERED_FRAMES).step_by(101) {
            assert!(!names.insert(&i.to_string()));
        }
        for i in REMEMBERED_FRAMES..4 * REMEMBERED_FRAMES {
            assert!(names.insert(&i.to_string()));
            assert!(names.hashes.len() <= REMEMBERED_FRAMES);
        }
        // A recording given twice is noticed soon.
        let noticed = (0..).position(|i| !names.insert(&i.to_string())).unwrap();
        assert!(noticed < 1000, "{noticed}");
    }

    #[test]
    fn a_frame_without_end_is_rejected() {
        let rows = "a,1,0,0\n".repeat(MAX_FRAME_DOTS + 1);
        let error = reader(&format!("frame,x,y,z\n{rows}"))
            .next()
            .unwrap()
            .unwrap_err();
        assert!(
            error
                .to_string()
                .contains("line 258: expected at most 256 dots"),
            "{error}"
        );
    }
}
