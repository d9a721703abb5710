//! What hides a ball in one picture: what is dark and too large for a mark, like a finger or its shadow.
//!
//! The dark places within which a disc fits that is larger than the marks, dark all over (a morphological opening; P. Soille, Morphological Image
//! Analysis, 2004, chapter 4). What lies outside the ball may be anything: a finger comes over the limb.

/// The cells of a picture of `side` a row that a disc of `radius` cells covers, which lies wholly in what is not `light`.
pub(crate) fn opened(light: &[bool], side: usize, radius: f64) -> Vec<bool> {
    let middles: Vec<bool> = near(light, side, radius).iter().map(|is| !is).collect();
    near(&middles, side, radius)
}

/// Which cells have a marked one within so many cells.
fn near(marked: &[bool], side: usize, radius: f64) -> Vec<bool> {
    let reach = radius as usize;
    let half_widths: Vec<usize> = (0..=reach)
        .map(|off| (radius * radius - (off * off) as f64).sqrt() as usize)
        .collect();
    let mut found = vec![false; marked.len()];
    let mut before = vec![0usize; side + 1];
    for (row, cells) in marked.chunks_exact(side).enumerate() {
        for (column, is_marked) in cells.iter().enumerate() {
            before[column + 1] = before[column] + usize::from(*is_marked);
        }
        if before[side] == 0 {
            continue;
        }
        for other in row.saturating_sub(reach)..(row + reach + 1).min(side) {
            let half = half_widths[row.abs_diff(other)];
            for column in 0..side {
                let (from, to) = (column.saturating_sub(half), (column + half + 1).min(side));
                found[other * side + column] |= before[to] > before[from];
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: usize = 40;

    /// What is not light: a dot of radius 3 in the middle, a bar 8 wide from the left to column 12.
    fn light() -> Vec<bool> {
        let is_light = |k: usize| {
            let (row, column) = (k / SIDE, k % SIDE);
            let off = (row as f64 - 20.0).hypot(column as f64 - 25.0);
            off > 3.0 && !((4..12).contains(&row) && column < 12)
        };
        (0..SIDE * SIDE).map(is_light).collect()
    }

    #[test]
    fn a_finger_hides_and_a_dot_does_not() {
        let covered = opened(&light(), SIDE, 3.8);
        let at = |row: usize, column: usize| covered[row * SIDE + column];
        assert!(at(8, 0) && at(8, 9));
        assert!((0..SIDE * SIDE).all(|k| !covered[k] || !light()[k]));
        assert!((15..26).all(|row| (20..31).all(|column| !at(row, column))));
    }

    #[test]
    fn a_smaller_disc_fits_into_the_dot() {
        let covered = opened(&light(), SIDE, 2.5);
        assert!(covered[20 * SIDE + 25]);
    }
}
