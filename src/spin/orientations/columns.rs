//! The columns of an orientations file.

use crate::files::csv::Columns;

/// Number of columns.
pub(super) const COUNT: usize = 42;
/// The columns, in the order in which they are written.
pub(super) static COLUMNS: Columns<COUNT> = Columns {
    names: [
        "frame",
        "time_s",
        "qw",
        "qx",
        "qy",
        "qz",
        "dots",
        "matched",
        "residual_deg",
        "confidence",
        "camera_frame",
        "cov_xx",
        "cov_xy",
        "cov_xz",
        "cov_yy",
        "cov_yz",
        "cov_zz",
        "x_m",
        "y_m",
        "z_m",
        "cov_m2_xx",
        "cov_m2_xy",
        "cov_m2_xz",
        "cov_m2_yy",
        "cov_m2_yz",
        "cov_m2_zz",
        "turn_x",
        "turn_y",
        "turn_z",
        "sd1_x",
        "sd1_y",
        "sd1_z",
        "sd2_x",
        "sd2_y",
        "sd2_z",
        "sd3_x",
        "sd3_y",
        "sd3_z",
        "ball",
        "table",
        "flash",
        "cameras",
    ],
    // The time and the quaternion.
    required: 1..6,
};
/// The frame of the quaternions, from which column on what only files with it have.
pub(super) const CAMERA_FRAME: usize = 10;
/// The first columns of the covariance, of the center and its covariance, and of the turns.
pub(super) const COVARIANCE: usize = 11;
pub(super) const CENTER: usize = 17;
pub(super) const CENTER_COVARIANCE: usize = 20;
pub(super) const TURN: usize = 26;
/// The name of the frame; the number of the ball, its table and the number of the flash, of files with several balls.
pub(super) const FRAME: usize = 0;
pub(super) const BALL: usize = 38;
pub(super) const TABLE: usize = 39;
pub(super) const FLASH: usize = 40;
/// How many cameras a row is of, of files with several.
pub(super) const CAMERAS: usize = 41;
/// The same where the times come from elsewhere: only the quaternion is needed.
pub(super) static UNTIMED: Columns<COUNT> = Columns {
    names: COLUMNS.names,
    required: 2..6,
};
/// The places of a covariance's six numbers.
pub(super) const UPPER: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// The columns of a file with several balls, or several images of one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BallColumns {
    /// The numbers of the balls.
    pub ball: bool,
    /// Their tables.
    pub table: bool,
    /// The numbers of the flashes.
    pub flash: bool,
    /// How many cameras a row is of.
    pub cameras: bool,
}

impl BallColumns {
    /// Those that are written, by their places among all columns.
    pub(super) fn written(self) -> impl Iterator<Item = usize> {
        let all = [
            (self.ball, BALL),
            (self.table, TABLE),
            (self.flash, FLASH),
            (self.cameras, CAMERAS),
        ];
        all.into_iter()
            .filter_map(|(is_written, at)| is_written.then_some(at))
    }
}
