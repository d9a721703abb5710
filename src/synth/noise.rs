//! Smooth random fields over the plane, from a hash of the lattice: no table, the same on every
//! machine.

/// A number in [0, 1) for a lattice point.
pub(super) fn hash(x: i32, y: i32, seed: u32) -> f32 {
    let mut h = seed ^ (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77);
    // The finalizer of MurmurHash3.
    h ^= h >> 16;
    h = h.wrapping_mul(0x85EB_CA6B);
    h ^= h >> 13;
    h = h.wrapping_mul(0xC2B2_AE35);
    h ^= h >> 16;
    (h >> 8) as f32 / (1 << 24) as f32
}

/// Value noise in [0, 1]: the hash at the lattice, smooth between.
pub(super) fn value(x: f32, y: f32, seed: u32) -> f32 {
    let (i, j) = (x.floor(), y.floor());
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    let (fx, fy) = (smooth(x - i), smooth(y - j));
    let (i, j) = (i as i32, j as i32);
    let at = |i: i32, j: i32| hash(i, j, seed);
    let (i1, j1) = (i.wrapping_add(1), j.wrapping_add(1));
    let low = at(i, j) + fx * (at(i1, j) - at(i, j));
    let high = at(i, j1) + fx * (at(i1, j1) - at(i, j1));
    low + fy * (high - low)
}

/// Three octaves of value noise, in [0, 1].
pub(super) fn turbulence(x: f32, y: f32, seed: u32) -> f32 {
    (4.0 * value(x, y, seed)
        + 2.0 * value(2.0 * x, 2.0 * y, seed ^ 1)
        + value(4.0 * x, 4.0 * y, seed ^ 2))
        / 7.0
}
