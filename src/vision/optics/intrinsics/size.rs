//! Of images of which size are intrinsics?
//!
//! The principal point lies near the middle of the images that a camera was calibrated on. Over half their sides, those of published
//! calibrations lie at (0.98, 1.04) (EuRoC `cam0`), (1.00, 1.07), (1.02, 1.04), (1.00, 1.03) (TUM RGB-D, `freiburg1` to `3`), (0.98, 0.99),
//! (0.98, 0.92) and (0.98, 1.00) (KITTI odometry 00, 03 and 04), (1.07, 0.98) (`left_intrinsics.yml` of OpenCV's samples), (1.00, 1.01) (TUM
//! VI), (1.00, 1.04) (UZH-FPV) and, with chips of 240 x 180 pixels, (1.10, 1.23) (DAVIS240C of the event camera data set). So a middle is
//! taken for that of images of another size from [`OTHER`] on, and for one where both sides agree within [`ALIKE`].

use super::Intrinsics;

/// Ratios of sizes from which on images are of another size: half and twice, 2/3 and 3/2, 3/4 and 4/3 among them, and no published one.
const OTHER: f64 = 1.25;
/// The ln of the ratios of both sides agrees within this.
const ALIKE: f64 = 0.15;
/// ln of the ratio of sides from which on an image is rather turned than of this aspect: between 5:4 and 4:3.
const OBLONG: f64 = 0.25;
/// How near to an edge of the images a principal point is doubted, as a part of their sides: that of images twice as large lies on the edge.
const NEAR_EDGE: f64 = 0.02;
/// Focal lengths that differ by more are no camera's, or one's whose pixels are not square; those of PAL and NTSC are within.
const SQUARE: f64 = 1.15;

impl Intrinsics {
    /// What speaks against these intrinsics being those of images of this size, in words; `None` where nothing does. Intrinsics of
    /// a part that was cut out of larger images may have such numbers, and the words say so.
    pub fn size_doubt(&self, [width, height]: [usize; 2]) -> Option<String> {
        let middle = [2.0 * self.cx + 1.0, 2.0 * self.cy + 1.0];
        let sides = [width as f64, height as f64];
        let point = format!("the principal point ({:.1}, {:.1})", self.cx, self.cy);
        let part = "right for a part cut out of larger ones, wrong for these whole";
        // ln of the ratios to the sides in this order.
        let ratios = |sides: [f64; 2]| [0, 1].map(|k| (middle[k] / sides[k]).ln());
        let is_alike = |[a, b]: [f64; 2]| (a - b).abs() < ALIKE;
        let [across, down] = ratios(sides);
        let looks = format!("{:.0} x {:.0}", middle[0], middle[1]);
        let aspect = (sides[0] / sides[1]).ln().abs();
        if aspect > OBLONG && is_alike(ratios([sides[1], sides[0]])) {
            return Some(format!(
                "{point} is the middle of images of {looks}, these have {width} x {height}: turned? {part}"
            ));
        }
        if is_alike([across, down]) && (0.5 * (across + down)).abs() > OTHER.ln() {
            return Some(format!(
                "{point} is the middle of images of {looks}, these have {width} x {height}: {part}"
            ));
        }
        let is_inside = |at: f64, side: usize| {
            let part = (at + 0.5) / side as f64;
            (NEAR_EDGE..=1.0 - NEAR_EDGE).contains(&part)
        };
        if !(is_inside(self.cx, width) && is_inside(self.cy, height)) {
            return Some(format!(
                "{point} lies off the images of {width} x {height}: {part}"
            ));
        }
        let ratio = self.fx / self.fy;
        (ratio.max(1.0 / ratio) > SQUARE).then(|| {
            format!(
                "fx is {ratio:.2} of fy: right for pixels that are not square, else numbers in another order than fx, fy, cx, cy"
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_calibrations_are_those_of_their_images() {
        for (k, size) in [
            // EuRoC, MH_01 cam0.
            ([458.654, 457.296, 367.215, 248.375], [752, 480]),
            // TUM RGB-D: fr1, fr2, fr3.
            ([517.3, 516.5, 318.6, 255.3], [640, 480]),
            ([520.9, 521.0, 325.1, 249.7], [640, 480]),
            ([535.4, 539.2, 320.1, 247.6], [640, 480]),
            // KITTI odometry 00, 03, 04.
            ([718.856, 718.856, 607.1928, 185.2157], [1241, 376]),
            ([721.5377, 721.5377, 609.5593, 172.854], [1242, 375]),
            ([707.0912, 707.0912, 601.8873, 183.1104], [1226, 370]),
            // OpenCV, samples/data/left_intrinsics.yml.
            ([535.9157, 535.9157, 342.2832, 235.5708], [640, 480]),
            // TUM VI, cam0; DAVIS240C of the event camera data set.
            ([190.9785, 190.9733, 254.9317, 256.8974], [512, 512]),
            ([199.0924, 198.8288, 132.1921, 110.7127], [240, 180]),
        ] {
            let k = Intrinsics::from_numbers(&k).expect("a camera");
            assert_eq!(k.size_doubt(size), None, "{k:?}");
            // The same of larger and smaller images is named, but for the smallest step.
            for scale in [0.5, 0.66, 1.5, 2.0] {
                let other = k.scaled([scale; 2]);
                let words = other.size_doubt(size).expect("of another size");
                assert!(words.len() < 180, "{words}");
            }
        }
    }

    #[test]
    fn other_sizes_turned_images_and_swapped_numbers_are_named() {
        let k = Intrinsics::pinhole(650.0, 640.0, 319.5, 239.5);
        for (size, word) in [
            (
                [320, 240],
                "middle of images of 640 x 480, these have 320 x 240: right",
            ),
            ([480, 360], "middle of images of 640 x 480"),
            ([960, 720], "middle of images of 640 x 480"),
            ([853, 640], "middle of images of 640 x 480"),
            ([480, 640], "turned?"),
            ([1080, 1440], "turned?"),
            // Cut out of larger ones, and their own principal point beyond.
            ([300, 100], "lies off the images"),
        ] {
            let words = k.size_doubt(size).expect("a doubt");
            assert!(
                words.contains(word) && words.contains("right for"),
                "{words}"
            );
        }
        // A part with its principal point anywhere else.
        for size in [[700, 300], [400, 480], [640, 480], [660, 500]] {
            assert_eq!(k.size_doubt(size), None, "{size:?}");
        }
        let swapped = Intrinsics::pinhole(319.5, 239.5, 300.0, 220.0);
        let words = swapped.size_doubt([640, 480]).expect("a doubt");
        assert!(words.contains("another order"), "{words}");
    }
}
