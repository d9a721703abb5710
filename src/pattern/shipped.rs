//! The designs that the crate ships.

use super::{DesignRecord, Pattern};
use crate::error::{Error, Result};

/// A design by its folder's name.
macro_rules! shipped {
    ($name:literal) => {
        (
            $name,
            include_str!(concat!("../../designs/", $name, "/pattern.csv")),
            include_str!(concat!("../../designs/", $name, "/pattern.ball.json")),
        )
    };
}

/// The designs that the crate ships: name, dots, and what stands beside them.
const SHIPPED: [(&str, &str, &str); 8] = [
    shipped!("dots12"),
    shipped!("dots16"),
    shipped!("dots20"),
    shipped!("dots20-paper"),
    shipped!("dots24"),
    shipped!("dots28"),
    shipped!("dots32"),
    shipped!("dots40"),
];

/// A pattern and its name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPattern {
    /// The name in the table.
    pub name: String,
    /// The pattern.
    pub pattern: Pattern,
    /// What it was designed for, where that is known.
    pub design: Option<DesignRecord>,
}

/// The designs that the crate ships.
///
/// # Errors
/// [`Error::Internal`] where one cannot be read.
pub fn shipped_designs() -> Result<Vec<NamedPattern>> {
    SHIPPED.iter().map(read).collect()
}

/// The design that the crate ships under this name, if there is one.
#[cfg(feature = "native")]
pub(crate) fn shipped_design(name: &str) -> Option<Result<NamedPattern>> {
    let found = SHIPPED.iter().find(|(shipped, ..)| *shipped == name);
    found.map(read)
}

fn read((name, csv, beside): &(&str, &str, &str)) -> Result<NamedPattern> {
    let internal = |e: Error| Error::Internal(e.to_string());
    let pattern = Pattern::from_csv(name.as_ref(), csv.as_bytes()).map_err(internal)?;
    let (pattern, design) = pattern
        .with_sidecar(name.as_ref(), beside.as_bytes())
        .map_err(internal)?;
    Ok(NamedPattern {
        name: (*name).to_owned(),
        pattern,
        design,
    })
}
