//! The names by which calibration files call what they hold, as [`plain`] has them, and what is known of them.

use super::super::tree::plain;

/// The keys of the matrix: OpenCV's samples, ROS, NumPy's users, stereo rigs.
pub(super) const MATRIX: [&str; 12] = [
    "cameramatrix",
    "k",
    "mtx",
    "intrinsicmatrix",
    "cameraintrinsics",
    "intrinsics",
    "intrinsic",
    "kmatrix",
    "kk",
    "matrix",
    "cammatrix",
    "m",
];
/// Those of the distortion.
pub(super) const DISTORTION: [&str; 18] = [
    "distortioncoefficients",
    "distortioncoeffs",
    "distortioncoeff",
    "distortioncoefs",
    "distortioncoef",
    "distortioncoefficient",
    "distcoeffs",
    "distcoeff",
    "distcoefs",
    "distcoef",
    "distcoefficients",
    "dist",
    "d",
    "kc",
    "coeffs",
    "distortion",
    "distortionparameters",
    "distortionvector",
];
/// Those of the focal lengths and the principal point, in the order of a file's four numbers.
pub(super) const FOCAL: [&[&str]; 4] = [
    &["fx", "mu", "flx"],
    &["fy", "mv", "fly"],
    &["cx", "u0", "ppx"],
    &["cy", "v0", "ppy"],
];
/// Mappings that hold them, or the coefficients, one by one.
pub(super) const PARAMETERS: [&str; 3] =
    ["projectionparameters", "intrinsics", "distortionparameters"];
/// Coefficients one by one, in OpenCV's order.
pub(super) const COEFFICIENTS: [&str; 12] = [
    "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4",
];
/// The keys under which a file names its model.
pub(super) const MODEL: [&str; 12] = [
    "distortionmodel",
    "cameramodel",
    "model",
    "fisheyemodel",
    "fisheye",
    "modeltype",
    "type",
    "distmodel",
    "cameratype",
    "camtype",
    "isfisheye",
    // librealsense prints the model under this name.
    "distortion",
];
/// Images: a width and a height, or both in one.
pub(super) const SIDES: [[&[&str]; 2]; 2] = [
    [
        &["imagewidth", "width", "imgwidth", "w"],
        &["imageheight", "height", "imgheight", "h"],
    ],
    [&["newwidth"], &["newheight"]],
];
pub(super) const SIZES: [&str; 6] = [
    "resolution",
    "imagesize",
    "imgsize",
    "calibdimension",
    "imgshape",
    "shape",
];
/// Keys that change nothing of where a point is seen.
pub(super) const HARMLESS: &[&str] = &[
    "imagewidth",
    "imageheight",
    "newwidth",
    "newheight",
    "binningx",
    "binningy",
    "roi",
    "cameraname",
    "name",
    "rectificationmatrix",
    "projectionmatrix",
    "r",
    "p",
    "calibrationtime",
    "nframes",
    "nrofframes",
    "boardwidth",
    "boardheight",
    "boardsize",
    "squaresize",
    "markersize",
    "flags",
    "flagvalue",
    "avgreprojectionerror",
    "reprojectionerror",
    "rms",
    "error",
    "errors",
    "perviewreprojectionerrors",
    "extrinsicparameters",
    "imagepoints",
    "gridpoints",
    "fixaspectratio",
    "aspectratio",
    "header",
    "camoverlaps",
    "rostopic",
    "timeshiftcamimu",
    "tcnimu",
    "tcncnm1",
    "tbs",
    "sensortype",
    "comment",
    "ratehz",
    "fps",
    "rgb",
    "ret",
    "rvecs",
    "tvecs",
    "rotation",
    "translation",
    "transform",
    "clockoffsets",
    "units",
    "rvec",
    "tvec",
    "t",
    "e",
    "f",
    "q",
    "r1",
    "r2",
    "date",
    "cameraid",
    "id",
    "seed",
    "frameid",
    "serial",
    "serialnumber",
    "bf",
    "thdepth",
    "lefttorightbaseline",
    "fixprincipalpoint",
    "zerotangentdist",
    "calibrationflags",
    "newcameramatrix",
    "fovdeg",
    "optimalcameramatrix",
];

/// What the keys of a lens have in their names: beside a distortion that is found, only such are named.
pub(super) const OF_LENS: [&str; 12] = [
    "dist",
    "coef",
    "lens",
    "skew",
    "fov",
    "model",
    "radial",
    "tangential",
    "fish",
    "mirror",
    "xi",
    "alpha",
];
/// Without a size, keys with these in their names are named too.
pub(super) const OF_SIZE: [&str; 7] = ["width", "height", "resol", "size", "dim", "cols", "rows"];
/// Models that are none of [`Lens`](crate::vision::optics::lens::Lens)', unless all coefficients are zero.
pub(super) const NEAR_MODELS: [&str; 2] = ["inversebrownconrady", "modifiedbrownconrady"];
/// Models that are none of [`Lens`](crate::vision::optics::lens::Lens)'.
pub(super) const OTHER_MODELS: [&str; 12] = [
    "fov",
    "omni",
    "omnidirectional",
    "mei",
    "ds",
    "doublesphere",
    "eucm",
    "ucm",
    "ftheta",
    "scaramuzza",
    "division",
    "unified",
];

/// A key as [`plain`] has it, without the `Camera.` that ORB-SLAM puts before each.
pub(super) fn bare(key: &str) -> String {
    let key = key.strip_prefix("Camera.").unwrap_or(key);
    plain(key)
}
