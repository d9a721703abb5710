//! Tables as Markdown, printed row by row as they are measured.
//!
//! A cell holds words, a count, a rate with its Wilson 95 % interval or a figure with its unit; what is not known
//! is a dash.

use spindoe::stats::Proportion;

/// Stands where there is nothing to say.
const NOTHING: &str = "-";

/// A cell of a row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cell(String);

impl std::fmt::Display for Cell {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// Words, counts and settings.
macro_rules! plain {
    ($($kind:ty),*) => {$(
        impl From<$kind> for Cell {
            fn from(value: $kind) -> Self {
                Self(value.to_string())
            }
        }
    )*};
}
plain!(&str, String, &String, usize, u64, u32, f64);

impl From<Proportion> for Cell {
    fn from(rate: Proportion) -> Self {
        match rate.trials {
            0 => Self(NOTHING.into()),
            _ => Self(rate.to_string()),
        }
    }
}

impl<T: Into<Cell>> From<Option<T>> for Cell {
    fn from(value: Option<T>) -> Self {
        value.map_or_else(|| Self(NOTHING.into()), Into::into)
    }
}

/// A figure with some decimals, and its unit where the heading does not name it.
pub fn figure(value: f64, decimals: usize, unit: &str) -> Cell {
    let space = if unit.is_empty() { "" } else { " " };
    let known = value.is_finite();
    known
        .then(|| format!("{}{space}{unit}", rounded(value, decimals)))
        .into()
}

/// A figure with its 95 % interval, and its unit where the heading does not name it.
pub fn interval(value: f64, [low, high]: [f64; 2], decimals: usize, unit: &str) -> Cell {
    let Cell(figure) = figure(value, decimals, unit);
    let known = [value, low, high].iter().all(|x| x.is_finite());
    let [low, high] = [low, high].map(|end| rounded(end, decimals));
    Cell(match known {
        true => format!("{figure} [{low}, {high}]"),
        false => figure,
    })
}

/// The same with signs.
pub fn signed(value: f64, ends: [f64; 2], decimals: usize) -> Cell {
    let [value, low, high] = [value, ends[0], ends[1]].map(|x| format!("{x:+.decimals$}"));
    let known = ends.iter().all(|x| x.is_finite());
    known.then(|| format!("{value} [{low}, {high}]")).into()
}

/// Decimals without a negative zero.
fn rounded(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(zero) if !zero.contains(|c| matches!(c, '1'..='9')) => zero.to_owned(),
        _ => text,
    }
}

/// A table of which the headings are printed.
pub struct Table {
    columns: usize,
}

impl Table {
    /// Prints an empty line and the headings.
    pub fn new<T: AsRef<str>>(headings: impl IntoIterator<Item = T>) -> Self {
        let headings: Vec<Cell> = headings.into_iter().map(|h| h.as_ref().into()).collect();
        println!("\n{}\n|{}", line(&headings), "---|".repeat(headings.len()));
        Self {
            columns: headings.len(),
        }
    }

    /// Prints a row; cells that lack are dashes.
    pub fn row(&self, mut cells: Vec<Cell>) {
        cells.resize(self.columns, None::<&str>.into());
        println!("{}", line(&cells));
    }
}

fn line(cells: &[Cell]) -> String {
    cells
        .iter()
        .fold("|".into(), |line, cell| format!("{line} {cell} |"))
}

/// Prints a row of a table: `row!(table; name, count; more_cells)`.
#[macro_export]
macro_rules! row {
    ($table:expr; $($cell:expr),* $(; $more:expr)*) => {{
        #[allow(unused_mut)]
        let mut cells: Vec<$crate::table::Cell> = vec![$($cell.into()),*];
        $(cells.extend($more.into_iter().map($crate::table::Cell::from));)*
        $table.row(cells)
    }};
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_say_nothing_where_nothing_is_known() {
        let said = |cell: Cell| cell.to_string();
        assert_eq!(said(figure(f64::NAN, 2, "deg")), "-");
        assert_eq!(said(figure(-0.001, 2, "deg")), "0.00 deg");
        assert_eq!(said(figure(-0.5, 1, "")), "-0.5");
        assert_eq!(said(Proportion::new(0, 0).into()), "-");
        assert_eq!(said(interval(1.0, [f64::NAN, 2.0], 1, "")), "1.0");
        assert_eq!(
            said(interval(1.0, [-0.01, 2.0], 1, "ms")),
            "1.0 ms [0.0, 2.0]"
        );
        assert_eq!(said(signed(f64::NAN, [f64::NAN; 2], 1)), "-");
        assert_eq!(line(&["a".into(), 1.5.into()]), "| a | 1.5 |");
    }
}
