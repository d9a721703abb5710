//! Files of others, changed at random, each kind as often: nothing panics, and what is refused is refused in one short line.

use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::clip::frame_table::read_clock;
use spindoe::source::FrameSource;
use spindoe::source::files::{open, sources};
use spindoe::vision::CameraCalibration;

/// Changed files of each kind; `SPINDOE_CHANGED=10000` tries more.
fn count() -> u64 {
    super::setting(
        "SPINDOE_CHANGED",
        crate::common::few_or_all(200, 1000) as u64,
    )
}

/// A few bytes changed, left out, put in, or the end cut off.
fn changed(original: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = original.to_vec();
    for _ in 0..rng.random_range(1..6) {
        if bytes.is_empty() {
            bytes.push(0);
        }
        let at = rng.random_range(0..bytes.len());
        match rng.random_range(0..5) {
            0 => bytes[at] = rng.random(),
            1 => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => drop(bytes.remove(at)),
            3 => bytes.truncate(at.max(1)),
            _ => bytes.insert(at, rng.random()),
        }
    }
    bytes
}

fn is_short(error: &spindoe::Error, path: &Path) {
    let said = error.to_string();
    let own = said.replace(&path.display().to_string(), "f");
    assert!(said.lines().count() == 1 && own.len() < 200, "{own}");
}

/// A calibration as each tool writes it.
const CALIBRATIONS: [&str; 11] = [
    // OpenCV's YAML, XML and JSON.
    "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 650., 0., \
     320.5, 0., 640., 240.25, 0., 0., 1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.28, 0.09, \
     1.2e-03, -1e-4, 0. ]\n",
    "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_Width>640</image_Width>\n<Camera_Matrix type_id=\"opencv-matrix\">\n  <rows>3</rows>\n  \
     <cols>3</cols>\n  <dt>d</dt>\n  <data>\n    650. 0. 320.5 0. 640. 240.25 0. 0. 1.</data></Camera_Matrix>\n<Distortion_Coefficients \
     type_id=\"opencv-matrix\">\n  <rows>5</rows>\n  <cols>1</cols>\n  <dt>d</dt>\n  <data>-0.28 0.09 0.0012 -1e-4 0.</data>\
     </Distortion_Coefficients>\n</opencv_storage>\n",
    r#"{"K": [[650, 0, 320.5], [0, 640, 240.25], [0, 0, 1]], "dist": [[-0.28, 0.09, 0.0012, -0.0001, 0]], "img_shape": [640, 480]}"#,
    // ROS' camera_info with binning and a region; its stereo rig by OpenCV.
    "image_width: 1280\nimage_height: 960\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [650, 0, 320.5, 0, 640, 240.25, 0, 0, 1]\ndistortion_model: \
     equidistant\ndistortion_coefficients: {rows: 1, cols: 4, data: [-0.02, 0.01, -0.003, 0.001]}\nbinning_x: 2\nbinning_y: 2\nroi: {x_offset: \
     8, y_offset: 4, width: 640, height: 480, do_rectify: false}\n",
    "M1: {rows: 3, cols: 3, data: [650, 0, 320.5, 0, 640, 240.25, 0, 0, 1]}\nD1: [-0.28, 0.09, 0.0012, -0.0001]\nM2: {rows: 3, cols: 3, data: \
     [651, 0, 320.5, 0, 640, 240.25, 0, 0, 1]}\nD2: [-0.28, 0.09, 0.0012, -0.0001]\n",
    // Kalibr, EuRoC, VINS, ORB-SLAM, COLMAP.
    "cam0:\n  camera_model: pinhole\n  distortion_coeffs: [-0.28, 0.09, 0.0012, -0.0001]\n  distortion_model: radtan\n  intrinsics: [650.0, \
     640.0, 320.5, 240.25]\n  resolution: [640, 480]\n  rostopic: /cam0/image_raw\n",
    "sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\nresolution: [640, \
     480]\ncamera_model: pinhole\nintrinsics: [650, 640, 320.5, 240.25] #fu, fv, cu, cv\ndistortion_model: radial-tangential\n\
     distortion_coefficients: [-0.28, 0.09, 0.0012, -0.0001]\n",
    "%YAML:1.0\n---\nmodel_type: PINHOLE\nimage_width: 640\nimage_height: 480\ndistortion_parameters:\n   k1: -0.28\n   k2: 0.09\n   p1: \
     0.0012\n   p2: -0.0001\nprojection_parameters:\n   fx: 650\n   fy: 640\n   cx: 320.5\n   cy: 240.25\n",
    "%YAML:1.0\nCamera.type: \"KannalaBrandt8\"\nCamera.fx: 650\nCamera.fy: 640\nCamera.cx: 320.5\nCamera.cy: 240.25\nCamera.k1: -0.02\n\
     Camera.k2: 0.01\nCamera.k3: -0.003\nCamera.k4: 0.001\nCamera.width: 640\nCamera.height: 480\n",
    "# Camera list\n1 OPENCV 640 480 650 640 321 240.75 -0.28 0.09 0.0012 -0.0001\n",
    "7 SIMPLE_RADIAL 640 480 650 321 240.75 -0.28\n8 PINHOLE 640 480 650 640 321 240.75\n",
];

#[test]
fn changed_calibrations_neither_panic_nor_say_much() {
    let path = Path::new("calibration");
    for (kind, text) in CALIBRATIONS.into_iter().enumerate() {
        let whole = CameraCalibration::from_bytes(path, None, text.as_bytes());
        let is_one = !matches!(kind, 4 | 10);
        assert_eq!(whole.is_ok(), is_one, "{whole:?}");
        let mut rng = ChaCha8Rng::seed_from_u64(6000 + kind as u64);
        for k in 0..count() {
            let bytes = changed(text.as_bytes(), &mut rng);
            let name = [None, Some("left"), Some("cam0"), Some("8")][k as usize % 4];
            match CameraCalibration::from_bytes(path, name, &bytes) {
                Err(error) => is_short(&error, path),
                Ok(read) => {
                    let sized = [[640, 480], [320, 240], [480, 640]];
                    for size in sized {
                        drop(read.for_image(size).map_err(|error| is_short(&error, path)));
                        let doubt = read.intrinsics.size_doubt(size).unwrap_or_default();
                        assert!(doubt.lines().count() < 2 && doubt.len() < 200, "{doubt}");
                    }
                    assert!(read.notes.iter().all(|note| note.len() < 200));
                }
            }
        }
    }
}

#[test]
fn changed_pictures_videos_and_times_neither_panic_nor_say_much() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/vision/data");
    let read = |name: &str| std::fs::read(data.join(name)).unwrap();
    let pts: String = (0..20).map(|k| format!("{}.000\n", 5 * k)).collect();
    let pictures = ["three.gif", "three.webp", "three.png", "still.webp"].map(read);
    let stack = crate::vision::input::tiff_stack(5, true, false);
    let archives = ["numpy.npz", "numpy_fisheye.npz"].map(read);
    let times = format!("# timecode format v2\n{pts}").into_bytes();
    let folder = tempfile::tempdir().unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(super::setting("SPINDOE_BREAKS_SEED", 60));
    for k in 0..8 * count() as usize {
        let path = folder.path().join("f");
        let kinds: Vec<&[u8]> = pictures.iter().chain([&stack]).map(Vec::as_slice).collect();
        match k % 8 {
            kind @ 0..5 => {
                std::fs::write(&path, changed(kinds[kind], &mut rng)).unwrap();
                let listed = sources(std::slice::from_ref(&path)).unwrap();
                let mut source = open(&listed[0], 1 << 20).unwrap();
                for frame in source.frames().take(100) {
                    match frame {
                        Err(error) => is_short(&error, &path),
                        Ok(frame) => drop(frame.picture.map_err(|error| is_short(&error, &path))),
                    }
                }
            }
            kind @ 5..7 => {
                let bytes = changed(&archives[kind - 5], &mut rng);
                if let Err(error) = CameraCalibration::from_bytes(&path, None, &bytes) {
                    is_short(&error, &path);
                }
            }
            _ => {
                std::fs::write(&path, changed(&times, &mut rng)).unwrap();
                drop(read_clock(&path).map_err(|error| is_short(&error, &path)));
            }
        }
    }
}
