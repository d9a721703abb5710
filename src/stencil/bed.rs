//! Which printers' beds hold a half.

use super::{Half, Mesh, Stencil};

/// Space around a half on the bed, for skirt or brim, mm per side.
const AROUND_MM: f64 = 2.0;

/// A printer's bed and how high it prints, as its maker states.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Bed {
    /// Printers that have it.
    pub printers: &'static str,
    /// Width, depth and height of the space that it prints, mm.
    pub size_mm: [f64; 3],
}

/// Beds that are common, the smallest first.
pub const COMMON_BEDS: [Bed; 6] = [
    Bed {
        printers: "Prusa MINI, Bambu Lab A1 mini",
        size_mm: [180.0, 180.0, 180.0],
    },
    Bed {
        printers: "Creality Ender-3",
        size_mm: [220.0, 220.0, 250.0],
    },
    Bed {
        printers: "Prusa MK3 and MK4",
        size_mm: [250.0, 210.0, 210.0],
    },
    Bed {
        printers: "Bambu Lab A1, P1 and X1",
        size_mm: [256.0, 256.0, 256.0],
    },
    Bed {
        printers: "Creality CR-10",
        size_mm: [300.0, 300.0, 400.0],
    },
    Bed {
        printers: "Prusa XL",
        size_mm: [360.0, 360.0, 360.0],
    },
];

impl Bed {
    /// Whether a solid of this width, depth and height stands on it, along its sides either way.
    pub fn holds(&self, [width, depth, height]: [f64; 3]) -> bool {
        let [w, d] = [width, depth].map(|mm| mm + 2.0 * AROUND_MM);
        let [x, y, z] = self.size_mm;
        height <= z && ((w <= x && d <= y) || (w <= y && d <= x))
    }
}

impl Stencil {
    /// Width, depth and height of the space that holds each half, or each of their pieces, as it is printed, mm.
    pub fn print_size_mm(&self) -> [f64; 3] {
        let printed = self.halves.iter().flat_map(Half::printed);
        let bounds: Vec<_> = printed.map(Mesh::bounding_box).collect();
        [0, 1, 2].map(|i| {
            let sides = bounds.iter().map(|b| b.max_mm[i] - b.min_mm[i]);
            sides.fold(0.0, f64::max)
        })
    }

    /// The [`COMMON_BEDS`] that hold each half, or each of their pieces.
    pub fn beds(&self) -> impl Iterator<Item = &'static Bed> {
        let size = self.print_size_mm();
        COMMON_BEDS.iter().filter(move |bed| bed.holds(size))
    }
}
