//! Calibrations as other tools write them, each by its own documents: read right, or refused with a line that says what is missing.

use std::path::Path;

use spindoe::vision::{CameraCalibration, Lens};

/// What a file is read as: fx, fy, cx, cy, skew; the lens; columns and rows.
struct Right {
    numbers: [f64; 5],
    lens: Lens,
    size: Option<[f64; 2]>,
}

fn right(numbers: [f64; 5], lens: spindoe::Result<Lens>, size: Option<[f64; 2]>) -> Right {
    let lens = lens.expect("a lens");
    Right {
        numbers,
        lens,
        size,
    }
}

fn read(name: Option<&str>, text: &str) -> spindoe::Result<CameraCalibration> {
    CameraCalibration::from_text(Path::new("camera"), name, text)
}

#[test]
fn cameras_of_other_programs_are_read() {
    let vga = Some([640.0, 480.0]);
    let full = Some([1920.0, 1080.0]);
    let cases: [(&str, Option<&str>, &str, Right); 12] = [
        (
            "nerfstudio: COLMAP's pixels, whose centers lie at halves",
            None,
            r#"{"camera_model": "OPENCV", "w": 1920, "h": 1080, "fl_x": 1400.5, "fl_y": 1401.5, "cx": 960.0, "cy": 540.0,
                "k1": 0.03, "k2": -0.05, "p1": 0.001, "p2": -0.002, "k3": 0.0, "k4": 0.0, "frames": [{"file_path": "a.png"}]}"#,
            right(
                [1400.5, 1401.5, 959.5, 539.5, 0.0],
                Lens::polynomial(&[0.03, -0.05, 0.001, -0.002, 0.0, 0.0, 0.0, 0.0]),
                full,
            ),
        ),
        (
            "instant-ngp, with its flag of a fisheye",
            None,
            r#"{"camera_angle_x": 1.2, "fl_x": 1400.5, "fl_y": 1401.5, "k1": 0.03, "k2": -0.05, "k3": 0.01, "k4": 0.0,
                "is_fisheye": true, "cx": 960.0, "cy": 540.0, "w": 1920.0, "h": 1080.0, "aabb_scale": 16, "frames": []}"#,
            right(
                [1400.5, 1401.5, 959.5, 539.5, 0.0],
                Lens::fisheye(&[0.03, -0.05, 0.01, 0.0]),
                full,
            ),
        ),
        (
            "OpenSfM's brown: over the longer side, from the middle",
            None,
            r#"{"v2 unknown unknown 1920 1080 brown 0.85": {"projection_type": "brown", "width": 1920, "height": 1080,
                "focal_x": 0.75, "focal_y": 0.5, "c_x": 0.01, "c_y": -0.005, "k1": -0.1, "k2": 0.02, "p1": 0.001, "p2": 0.002, "k3": 0.003}}"#,
            right(
                [1440.0, 960.0, 978.7, 529.9, 0.0],
                Lens::polynomial(&[-0.1, 0.02, 0.001, 0.002, 0.003]),
                full,
            ),
        ),
        (
            "OpenSfM's fisheye",
            None,
            r#"{"v2 gopro 640 480 fisheye 0.5": {"projection_type": "fisheye", "width": 640, "height": 480, "focal": 0.5, "k1": -0.02, "k2": 0.01}}"#,
            right(
                [320.0, 320.0, 319.5, 239.5, 0.0],
                Lens::fisheye(&[-0.02, 0.01, 0.0, 0.0]),
                vga,
            ),
        ),
        (
            "pyrealsense2's intrinsics as a dictionary",
            None,
            r#"{"width": 640, "height": 480, "ppx": 321.5, "ppy": 238.25, "fx": 615.5, "fy": 616.5, "model": "distortion.brown_conrady",
                "coeffs": [0.1, -0.2, 0.001, -0.002, 0.05]}"#,
            right(
                [615.5, 616.5, 321.5, 238.25, 0.0],
                Lens::polynomial(&[0.1, -0.2, 0.001, -0.002, 0.05]),
                vga,
            ),
        ),
        (
            "rs-enumerate-devices -c, one stream",
            None,
            "Width: 640\nHeight: 480\nPPX: 321.5\nPPY: 238.25\nFx: 615.5\nFy: 616.5\nDistortion: Inverse Brown Conrady\nCoeffs: 0  0  0  0  0\n\
             FOV (deg): 54.9 x 42.6\n",
            right([615.5, 616.5, 321.5, 238.25, 0.0], Ok(Lens::Ideal), vga),
        ),
        (
            "ZED, SN1234.conf",
            Some("LEFT_CAM_HD"),
            "[LEFT_CAM_HD]\nfx=700.5\nfy=701.5\ncx=640.25\ncy=360.75\nk1=-0.17\nk2=0.02\np1=0.001\np2=-0.002\nk3=0.003\n\n[RIGHT_CAM_HD]\n\
             fx=1\nfy=1\ncx=10\ncy=10\n\n[STEREO]\nBaseline=120\nTY=0.1\n",
            right(
                [700.5, 701.5, 640.25, 360.75, 0.0],
                Lens::polynomial(&[-0.17, 0.02, 0.001, -0.002, 0.003]),
                None,
            ),
        ),
        (
            "ZED, the lens in a section of its own",
            Some("RIGHT_CAM_FHD1200"),
            "[LEFT_CAM_FHD1200]\nfx=1\nfy=1\ncx=10\ncy=10\n\n[RIGHT_CAM_FHD1200]\nfx=700.5\nfy=701.5\ncx=640.25\ncy=360.75\n\n\
             [LEFT_DISTO]\nk1=1\n\n[RIGHT_DISTO]\nk1=-0.17\nk2=0.02\np1=0.001\np2=-0.002\nk3=0.003\n",
            right(
                [700.5, 701.5, 640.25, 360.75, 0.0],
                Lens::polynomial(&[-0.17, 0.02, 0.001, -0.002, 0.003]),
                None,
            ),
        ),
        (
            "MATLAB, jsonencode(toStruct(cameraParams)): from pixel 1, rows first, the matrix transposed",
            None,
            r#"{"RadialDistortion": [-0.28, 0.09], "TangentialDistortion": [0.001, -0.002], "ImageSize": [480, 640],
                "IntrinsicMatrix": [[650.0, 0, 0], [1.5, 640.0, 0], [321.5, 241.25, 1]], "WorldUnits": "mm", "NumRadialDistortionCoefficients": 2}"#,
            right(
                [650.0, 640.0, 320.5, 240.25, 1.5],
                Lens::polynomial(&[-0.28, 0.09, 0.001, -0.002, 0.0]),
                vga,
            ),
        ),
        (
            "MATLAB's cameraIntrinsics",
            None,
            r#"{"FocalLength": [650, 640], "PrincipalPoint": [321.5, 241.25], "ImageSize": [480, 640], "RadialDistortion": [-0.28, 0.09, 0.01],
                "TangentialDistortion": [0, 0], "Skew": 1.5}"#,
            right(
                [650.0, 640.0, 320.5, 240.25, 1.5],
                Lens::polynomial(&[-0.28, 0.09, 0.0, 0.0, 0.01]),
                vga,
            ),
        ),
        (
            "Gyroflow's lens profile: the model is in the key's name, the size beside it",
            None,
            r#"{"name": "GoPro", "calib_dimension": {"w": 640, "h": 480}, "orig_dimension": {"w": 1280, "h": 960},
                "fisheye_params": {"RMS_error": 0.4, "camera_matrix": [[650, 0, 320.5], [0, 640, 240.25], [0, 0, 1]], "distortion_coeffs": [0.1, 0.02, -0.03, 0.01]}}"#,
            right(
                [650.0, 640.0, 320.5, 240.25, 0.0],
                Lens::fisheye(&[0.1, 0.02, -0.03, 0.01]),
                vga,
            ),
        ),
        (
            "Basalt's kb4, one camera of it",
            None,
            r#"{"camera_type": "kb4", "intrinsics": {"fx": 650, "fy": 640, "cx": 320.5, "cy": 240.25, "k1": 0.1, "k2": 0.02, "k3": -0.03, "k4": 0.01}}"#,
            right(
                [650.0, 640.0, 320.5, 240.25, 0.0],
                Lens::fisheye(&[0.1, 0.02, -0.03, 0.01]),
                None,
            ),
        ),
    ];
    for (kind, name, text, right) in cases {
        let found = read(name, text).unwrap_or_else(|e| panic!("{kind}: {e}"));
        let k = found.intrinsics;
        for (own, right) in [k.fx, k.fy, k.cx, k.cy, k.skew].iter().zip(right.numbers) {
            assert!((own - right).abs() < 1e-9, "{kind}: {k:?}");
        }
        assert_eq!((k.lens, found.size), (right.lens, right.size), "{kind}");
        assert!(found.notes.is_empty(), "{kind}: {:?}", found.notes);
    }
}

/// What would be wrong without a word is refused with one.
#[test]
fn cameras_of_other_models_are_refused_in_words() {
    let opencv =
        |more: &str| format!(r#"{{"fx": 650, "fy": 640, "cx": 320.5, "cy": 240.25, {more}}}"#);
    let cases: [(&str, String, &str); 16] = [
        (
            "Metashape",
            "<?xml version=\"1.0\"?>\n<calibration>\n  <projection>frame</projection>\n  <width>640</width>\n  <height>480</height>\n  <f>650</f>\n\
             \x20 <cx>1.5</cx>\n  <cy>-2</cy>\n  <k1>0.1</k1>\n</calibration>\n"
                .into(),
            "export it there as OpenCV's XML",
        ),
        (
            "PhotoScan, whose tangential coefficients are swapped",
            "<calibration><projection>frame</projection><fx>650</fx><fy>640</fy><cx>320</cx><cy>240</cy><p1>0.1</p1></calibration>".into(),
            "export it there as OpenCV's XML",
        ),
        (
            "librealsense's inverse model",
            r#"{"width": 640, "height": 480, "ppx": 321.5, "ppy": 238.25, "fx": 615.5, "fy": 616.5, "model": "distortion.inverse_brown_conrady", "coeffs": [0.1, 0, 0, 0, 0]}"#.into(),
            "inverse_brown_conrady: undistort",
        ),
        (
            "ARKit's and Open3D's columns",
            r#"{"width": 640, "height": 480, "intrinsic_matrix": [650, 0, 0, 0, 640, 0, 320.5, 240.25, 1]}"#.into(),
            "transposed",
        ),
        (
            "Blender's field of view alone",
            r#"{"camera_angle_x": 0.69, "frames": [{"file_path": "r_0"}]}"#.into(),
            "keys found: camera_angle_x",
        ),
        (
            "Azure Kinect, as its firmware has it",
            r#"{"CalibrationInformation": {"Cameras": [{"Intrinsics": {"ModelParameterCount": 14, "ModelParameters": [0.5, 0.5, 0.6], "ModelType": "CALIBRATION_LensDistortionModelBrownConrady"}, "SensorHeight": 3072}]}}"#.into(),
            "keys found: Intrinsics",
        ),
        (
            "DepthAI, the whole device",
            r#"{"batchName": "", "boardName": "DM9098", "cameraData": [[0, {"cameraType": 0, "width": 1920}]]}"#.into(),
            "keys found: batchName, boardName, cameraData",
        ),
        (
            "Kalibr's omni",
            "cam0:\n  camera_model: omni\n  intrinsics: [1.2, 650, 640, 320.5, 240.25]\n  distortion_model: radtan\n".into(),
            "keys found: camera_model, intrinsics",
        ),
        (
            "Basalt's double sphere",
            r#"{"camera_type": "ds", "intrinsics": {"fx": 650, "fy": 640, "cx": 320.5, "cy": 240.25, "xi": -0.2, "alpha": 0.6}}"#.into(),
            "found ds",
        ),
        (
            "lengths over the images' sides",
            r#"{"fx": 0.53, "fy": 0.67, "cx": 0.49, "cy": 0.5, "width": 640, "height": 480}"#.into(),
            "over the images' sides",
        ),
        (
            "Ceres' bundle adjustment in the large",
            "16 22106 83718\n0 0 -3.859900e+02 3.871200e+02\n".into(),
            "expected the matrix",
        ),
        (
            "KITTI's calib.txt",
            "P0: 7.188e+02 0 6.07e+02 0 0 7.188e+02 1.85e+02 0 0 0 1 0\nTr: 1 0 0 0 0 1 0 0 0 0 1 0\n".into(),
            "keys found: P0, Tr",
        ),
        (
            "a fourth coefficient of the numerator",
            opencv(r#""k1": 0.1, "k2": 0.2, "k3": 0.1, "k4": 0.05"#),
            "expected k5 and k6",
        ),
        (
            "a decimal comma",
            opencv(r#""k1": "-0,3""#),
            "k1: expected a number",
        ),
        (
            "YAML's alias of what stands elsewhere",
            "lens: &d [0.1, 0.2, 0, 0]\nfx: 650\nfy: 640\ncx: 320.5\ncy: 240.25\ndistortion: *d\n".into(),
            "distortion: expected",
        ),
        (
            "OpenSfM's spherical",
            r#"{"v2 a": {"projection_type": "spherical", "width": 640, "height": 320}}"#.into(),
            "found spherical",
        ),
    ];
    for (kind, text, word) in cases {
        let words = match read(None, &text) {
            Ok(found) => panic!("{kind}: {found:?}"),
            Err(error) => error.to_string(),
        };
        let is_line = words.lines().count() == 1 && words.len() < 200;
        assert!(is_line && words.contains(word), "{kind}: {words}");
    }
    // What is read, with a word of what is not.
    for (text, word) in [
        (
            opencv(r#""distortion": [0, 0, 0, 0], "cols": 640, "rows": 480"#),
            "cols, rows",
        ),
        (
            r#"{"intrinsics": {"fx": 650, "fy": 640, "cx": 320.5, "cy": 240.25, "xi": -0.2}}"#
                .into(),
            "unread keys: xi",
        ),
    ] {
        let notes = read(None, &text).expect("a camera").notes.join("; ");
        assert!(notes.contains(word), "{notes}");
    }
    // DepthAI's camera with OpenCV's 14 coefficients, and a skew by its name.
    let read = |text: String| read(None, &text).expect("a camera").intrinsics;
    let depthai = r#"{"cameraType": 0, "distortionCoeff": [0.1, 0.2, 0, 0, 0.3, 0, 0, 0, 0, 0, 0, 0, 0, 0], "width": 640, "height": 480,
        "intrinsicMatrix": [[650, 0, 320.5], [0, 640, 240.25], [0, 0, 1]], "specHfovDeg": 68.8}"#;
    let lens = Lens::polynomial(&[0.1, 0.2, 0.0, 0.0, 0.3]).expect("a lens");
    assert_eq!(read(depthai.to_owned()).lens, lens);
    assert_eq!(read(opencv(r#""skew": 1.5"#)).skew, 1.5);
    // A product's name is no model of a lens.
    let gyroflow = r#"{"camera_brand": "GoPro", "camera_model": "HERO8 Black", "calib_dimension": {"w": 640, "h": 480},
        "fisheye_params": {"camera_matrix": [[650, 0, 320.5], [0, 640, 240.25], [0, 0, 1]], "distortion_coeffs": [0.1, 0.02, -0.03, 0.01]}}"#;
    let lens = Lens::fisheye(&[0.1, 0.02, -0.03, 0.01]).expect("a lens");
    assert_eq!(read(gyroflow.to_owned()).lens, lens);
}
