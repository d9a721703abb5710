//! The designs that the crate ships.

use super::Pattern;
use crate::error::{Error, Result};

/// The designs that the crate ships, by name.
const SHIPPED: [(&str, &str); 8] = [
    ("dots12", include_str!("../../designs/dots12/pattern.csv")),
    ("dots16", include_str!("../../designs/dots16/pattern.csv")),
    ("dots20", include_str!("../../designs/dots20/pattern.csv")),
    (
        "dots20-paper",
        include_str!("../../designs/dots20-paper/pattern.csv"),
    ),
    ("dots24", include_str!("../../designs/dots24/pattern.csv")),
    ("dots28", include_str!("../../designs/dots28/pattern.csv")),
    ("dots32", include_str!("../../designs/dots32/pattern.csv")),
    ("dots40", include_str!("../../designs/dots40/pattern.csv")),
];

/// A pattern and its name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPattern {
    /// The name in the table.
    pub name: String,
    /// The pattern.
    pub pattern: Pattern,
}

/// The designs that the crate ships.
///
/// # Errors
/// [`Error::Internal`] where one cannot be read.
pub fn shipped_designs() -> Result<Vec<NamedPattern>> {
    let named = |(name, csv): &(&str, &str)| {
        Ok(NamedPattern {
            name: (*name).to_owned(),
            pattern: read(name, csv)?,
        })
    };
    SHIPPED.iter().map(named).collect()
}

/// The design that the crate ships under this name, if there is one.
#[cfg(feature = "native")]
pub(crate) fn shipped_design(name: &str) -> Option<Result<Pattern>> {
    let found = SHIPPED.iter().find(|(shipped, _)| *shipped == name);
    found.map(|(name, csv)| read(name, csv))
}

fn read(name: &str, csv: &str) -> Result<Pattern> {
    Pattern::from_csv(name.as_ref(), csv.as_bytes()).map_err(|e| Error::Internal(e.to_string()))
}
