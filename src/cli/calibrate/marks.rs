//! The marks of a ball without a table: a picture of them, and which of them are said to be its dots.

use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use crate::calibrate::{MarkKind, MarkedSurface};
use crate::error::{Error, Result};
use crate::files::csv::{Columns, Table};
use crate::files::{self, Replacement};
use crate::geometry::Vec3;
use crate::pattern::{MAX_DOTS, MIN_DOTS};
use crate::plot::surface_views;

/// The picture, and the marks in it.
pub(super) const FILES: [&str; 2] = [PICTURE, MARKS];
pub(super) const PICTURE: &str = "marks.png";
const MARKS: &str = "marks.csv";

static COLUMNS: Columns<5> = Columns {
    names: ["mark", "x", "y", "z", "taken_for"],
    required: 0..5,
};

/// Numbers of marks, in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct MarkNumbers(Vec<usize>);

impl FromStr for MarkNumbers {
    type Err = String;

    /// Numbers and ranges of them, separated by commas.
    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let mut numbers = Vec::new();
        for part in text.split(',') {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let number = |text: &str| text.trim().parse::<u16>().map(usize::from).ok();
            match (number(first), number(last)) {
                (Some(first), Some(last)) if first <= last => numbers.extend(first..=last),
                _ => {
                    return Err(format!(
                        "expected numbers such as 0-17,19, found \"{part}\""
                    ));
                }
            }
        }
        numbers.sort_unstable();
        let count = numbers.len();
        if !(MIN_DOTS..=MAX_DOTS).contains(&count) {
            return Err(format!(
                "expected {MIN_DOTS} to {MAX_DOTS} marks, found {count}"
            ));
        }
        match numbers.windows(2).find(|pair| pair[0] == pair[1]) {
            Some(pair) => Err(format!("mark {} is given twice", pair[0])),
            None => Ok(Self(numbers)),
        }
    }
}

impl MarkNumbers {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// The marks that look like dots, or as many of the likeliest as are said to be dots; `None` where a pattern has no such number.
    pub fn proposed(surface: &MarkedSurface, number: Option<usize>) -> Option<Self> {
        let marks = surface.worth_a_look().enumerate();
        let numbers: Vec<usize> = match number {
            Some(number) => marks.map(|(k, _)| k).take(number).collect(),
            None => marks
                .filter(|(_, mark)| mark.kind == MarkKind::Dot)
                .map(|(k, _)| k)
                .collect(),
        };
        let is_all = number.is_none_or(|number| number == numbers.len());
        let is_pattern = (MIN_DOTS..=MAX_DOTS).contains(&numbers.len());
        (is_all && is_pattern).then_some(Self(numbers))
    }
}

impl fmt::Display for MarkNumbers {
    /// As it is read: ranges of two and more.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (k, range) in self.0.chunk_by(|a, b| a + 1 == *b).enumerate() {
            let comma = if k == 0 { "" } else { "," };
            match range {
                [first, .., last] => write!(f, "{comma}{first}-{last}")?,
                alone => alone.iter().try_for_each(|n| write!(f, "{comma}{n}"))?,
            }
        }
        Ok(())
    }
}

/// Leaves a ball's marks in a folder; the picture.
pub(super) fn leave(folder: &Path, surface: &MarkedSurface) -> Result<PathBuf> {
    // The numbers of one are those of the other.
    let set = Replacement::begin(folder)?;
    write(set.path(), surface)?;
    set.publish(&FILES, PICTURE)?;
    Ok(folder.join(PICTURE))
}

/// Writes a ball's marks into a folder.
pub(super) fn write(folder: &Path, surface: &MarkedSurface) -> Result<()> {
    surface_views(&folder.join(PICTURE), surface)?;
    let mut text = COLUMNS.names.join(",") + "\n";
    for (number, mark) in surface.worth_a_look().enumerate() {
        let [x, y, z] = [mark.direction.x, mark.direction.y, mark.direction.z];
        text += &format!("{number},{x},{y},{z},{}\n", mark.kind.as_str());
    }
    files::write_bytes(&folder.join(MARKS), text.as_bytes())
}

/// Where the marks of these numbers are that an earlier run has left in a folder.
pub(super) fn read(folder: &Path, numbers: &MarkNumbers) -> Result<Vec<Vec3>> {
    let path = folder.join(MARKS);
    if !path.exists() {
        let problem = format!(
            "expected {}, which a run without --marks leaves",
            path.display()
        );
        return Err(Error::argument("--marks", problem));
    }
    let mut table = Table::new(&path, files::open(&path)?, &COLUMNS)?;
    let mut marks = Vec::new();
    while let Some(row) = table.next_row()? {
        let number = row.count(0).map_err(|problem| row.error(problem))?;
        if number != Some(marks.len()) {
            let problem = format!(
                "expected mark {}: the rows as they were written",
                marks.len()
            );
            return Err(row.error(problem));
        }
        let mut place = [0.0; 3];
        for (k, value) in place.iter_mut().enumerate() {
            let number = row.number(1 + k).map_err(|problem| row.error(problem))?;
            *value = number.ok_or_else(|| row.error("expected a direction x,y,z"))?;
        }
        marks.push(Vec3::from(place));
    }
    let missing = numbers.0.iter().find(|n| **n >= marks.len());
    if let Some(number) = missing {
        let problem = format!(
            "expected marks of {}, which has {}, found {number}",
            path.display(),
            marks.len()
        );
        return Err(Error::argument("--marks", problem));
    }
    Ok(numbers.0.iter().map(|n| marks[*n]).collect())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::calibrate::SurfaceMark;

    #[test]
    fn numbers_are_written_as_they_are_read() {
        for text in ["0-17", "0-3,5,7-8", "2,4,6,8"] {
            assert_eq!(text.parse::<MarkNumbers>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn the_likeliest_marks_are_proposed() {
        let kinds = [
            MarkKind::Dot,
            MarkKind::Dot,
            MarkKind::Doubtful,
            MarkKind::Dot,
            MarkKind::Dot,
        ];
        let mark = |kind| SurfaceMark {
            direction: Vec3::z(),
            radius_rad: 0.1,
            kind,
            evidence: None,
        };
        let surface = MarkedSurface {
            places: Vec::new(),
            marks: kinds.map(mark).to_vec(),
        };
        let proposed = |number| Some(MarkNumbers::proposed(&surface, number)?.to_string());
        assert_eq!(proposed(None).as_deref(), Some("0-1,3-4"));
        assert_eq!(proposed(Some(4)).as_deref(), Some("0-3"));
        assert_eq!(proposed(Some(5)).as_deref(), Some("0-4"));
        assert_eq!(proposed(Some(6)), None);
        assert_eq!(proposed(Some(2)), None);
    }
}
