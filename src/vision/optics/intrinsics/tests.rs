//! Cameras' files and the projection, against what other tools write.

use super::*;

const EXPECTED: [f64; 4] = [650.0, 640.0, 320.5, 240.25];

fn read(text: &str) -> Result<Intrinsics> {
    Intrinsics::from_text("camera.yaml".as_ref(), text)
}

#[test]
fn files_of_opencv_ros_and_json_are_read() {
    let data = "[ 6.5e+02, 0., 3.205e+02, 0., 640., 2.4025e+02, 0., 0., 1. ]";
    let opencv = format!(
        "%YAML:1.0\n---\ncalibration_time: \"Wed\"\nnframes: 3\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   \
         data: {data}\ndistortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.28, 0.09,\n       \
         1.2e-03, -1e-4, 0. ]\navg_reprojection_error: 0.3\n"
    );
    let ros = format!(
        "image_width: 640\ncamera_name: cam\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: {data}\ndistortion_model: plumb_bob\n\
         distortion_coefficients: {{rows: 1, cols: 5, data: [-0.28, 0.09, 0.0012, -0.0001, 0.0]}}\nprojection_matrix:\n  rows: 3\n  \
         cols: 4\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]\n"
    );
    let json = r#"{"K": [[650, 0, 320.5], [0, 640, 240.25], [0, 0, 1]], "dist": [[-0.28, 0.09, 0.0012, -0.0001, 0]]}"#;
    let flat = opencv.replace("rows: 1\n   cols: 5\n   dt: d", "sizes: [ 5 ]\n   dt: d");
    let lens = Lens::polynomial(&[-0.28, 0.09, 0.0012, -1e-4, 0.0]).expect("a lens");
    for text in [&*opencv, &*flat, &*ros, json] {
        let k = read(text).expect(text);
        assert_eq!([k.fx, k.fy, k.cx, k.cy], EXPECTED);
        assert_eq!((k.skew, k.lens), (0.0, lens));
    }
    let fisheye = ros
        .replace("plumb_bob", "equidistant")
        .replace(", 0.0]}", "]}");
    assert!(matches!(
        read(&fisheye).expect("a camera").lens,
        Lens::Fisheye { .. }
    ));
}

#[test]
fn other_files_are_refused_with_the_field() {
    let deep = "- ".repeat(100_000);
    let nested = format!("{{\"K\": {}", "[".repeat(2_000));
    for (text, word) in [
        ("", "camera_matrix"),
        ("a: [1, 2", "YAML or JSON"),
        (&*deep, "camera_matrix"),
        (&*nested, "YAML or JSON"),
        ("K: [1, 2, 3]", "camera_matrix"),
        ("K: [650, 0, 0, 0, 640, 0, 320, 240, 1]", "transposed"),
        ("K: [-650, 0, 320, 0, 640, 240, 0, 0, 1]", "positive focal"),
        (
            "K: [650, 0, 320, 0, 640, 240, 0, 0, 1]\ndist: [1, 2, 3]",
            "found 3",
        ),
        ("K: [650, 0, 320, 0, 640, 240, 0, 0, 1]\ndist: none", "dist"),
        (
            "K: [650, 0, 320, 0, 640, 240, 0, 0, 1]\ndistortion_model: ftheta",
            "ftheta",
        ),
    ] {
        let error = read(text).expect_err("no camera").to_string();
        assert!(
            error.contains(word) && error.lines().count() == 1,
            "{text:.60}: {error}"
        );
    }
}

/// A matrix, and the coefficients of [`lens`], as files have them.
const MATRIX: &str = "camera_matrix: [650, 0, 320.5, 0, 640, 240.25, 0, 0, 1]";
const NUMBERS: &str = "-0.28, 0.09, 0.0012, -0.0001, 0";

/// The lens of most of these files.
fn lens() -> Lens {
    Lens::polynomial(&[-0.28, 0.09, 0.0012, -1e-4, 0.0]).expect("a lens")
}

fn calibration(text: &str, name: Option<&str>) -> Result<CameraCalibration> {
    CameraCalibration::from_text("camera.yaml".as_ref(), name, text)
}

#[test]
fn every_spelling_is_read_or_named() {
    for key in [
        "dist_coeff",
        "dist_coeffs",
        "dist_coefs",
        "distortion_coeffs",
        "distCoeffs",
        "Distortion_Coefficients",
        "kc",
        "D",
        "dist",
        "distortion_coefficients",
        "distortion-coefficients",
    ] {
        for value in [
            format!("[{NUMBERS}]"),
            format!("[[{NUMBERS}]]"),
            format!("{{rows: 1, cols: 5, data: [{NUMBERS}]}}"),
        ] {
            let text = format!("{MATRIX}\n{key}: {value}\n");
            let read = calibration(&text, None).expect(&text);
            assert_eq!(
                (read.intrinsics.lens, read.notes.len()),
                (lens(), 0),
                "{text}"
            );
        }
    }
}

#[test]
fn what_is_not_understood_is_named() {
    let text = format!("{MATRIX}\nlens_parameters: [{NUMBERS}]\ncamera_name: c\n");
    let read = calibration(&text, None).expect(&text);
    assert_eq!(read.intrinsics.lens, Lens::Ideal);
    assert_eq!(
        read.notes,
        ["no distortion found; unread keys: lens_parameters"]
    );
    let text = format!("{MATRIX}\ndist: [{NUMBERS}]\nxi: 1.2\nnote: x\n");
    assert_eq!(
        calibration(&text, None).expect(&text).notes,
        ["unread keys: xi"]
    );
}

#[test]
fn the_lens_model_is_read_in_every_spelling() {
    for key in [
        "fisheye_model: 1",
        "camera_model: fisheye",
        "distortion_model: equidistant",
        "fisheye: true",
        "model: KANNALA_BRANDT",
    ] {
        let text = format!("{MATRIX}\ndist: [-0.02, 0.01, -0.003, 0.001]\n{key}\n");
        let fisheye = Lens::fisheye(&[-0.02, 0.01, -0.003, 0.001]).expect("a lens");
        assert_eq!(
            calibration(&text, None).expect(&text).intrinsics.lens,
            fisheye,
            "{key}"
        );
    }
    for key in [
        "camera_model: omni",
        "distortion_model: fov",
        "model_type: MEI",
    ] {
        let refused = calibration(&format!("{MATRIX}\n{key}\n"), None)
            .expect_err(key)
            .to_string();
        assert!(refused.contains("expected plumb_bob"), "{refused}");
    }
    for value in ["1e308", "1e8", "-1", "nan"] {
        let text = format!("fx: {value}\nfy: 640\ncx: 320\ncy: 240\n");
        let refused = calibration(&text, None).expect_err(value).to_string();
        assert!(refused.contains("positive focal lengths"), "{refused}");
    }
}

#[test]
fn files_of_other_tools_are_read() {
    let radtan = "[-0.28, 0.09, 0.0012, -0.0001]";
    // kalibr_calibrate_cameras, camchain.yaml.
    let kalibr = format!(
        "cam0:\n  cam_overlaps: [1]\n  camera_model: pinhole\n  distortion_coeffs: {radtan}\n  distortion_model: radtan\n  \
         intrinsics: [650.0, 640.0, 320.5, 240.25]\n  resolution: [640, 480]\n  rostopic: /cam0/image_raw\n"
    );
    // EuRoC, cam0/sensor.yaml.
    let euroc = format!(
        "sensor_type: camera\ncomment: VI-Sensor cam0 (MT9M034)\nT_BS:\n  cols: 4\n  rows: 4\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, \
         1]\nrate_hz: 20\nresolution: [640, 480]\ncamera_model: pinhole\nintrinsics: [650, 640, 320.5, 240.25] #fu, fv, cu, cv\ndistortion_model: \
         radial-tangential\ndistortion_coefficients: {radtan}\n"
    );
    // VINS-Mono, camodocal's pinhole.
    let vins = "%YAML:1.0\n---\nmodel_type: PINHOLE\ncamera_name: camera\nimage_width: 640\nimage_height: 480\ndistortion_parameters:\n   k1: \
                -0.28\n   k2: 0.09\n   p1: 0.0012\n   p2: -0.0001\nprojection_parameters:\n   fx: 650\n   fy: 640\n   cx: 320.5\n   cy: 240.25\n";
    // ORB-SLAM2, Examples/Monocular.
    let orb = "%YAML:1.0\n\nCamera.fx: 650\nCamera.fy: 640\nCamera.cx: 320.5\nCamera.cy: 240.25\n\nCamera.k1: -0.28\nCamera.k2: \
               0.09\nCamera.p1: 0.0012\nCamera.p2: -0.0001\nCamera.fps: 30.0\nCamera.RGB: 1\nORBextractor.nFeatures: 1000\nCamera.width: \
               640\nCamera.height: 480\n";
    // COLMAP, whose pixels' centers lie at halves.
    let colmap = "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n1 OPENCV 640 480 650 640 321 240.75 \
                  -0.28 0.09 0.0012 -0.0001\n";
    for text in [&*kalibr, &euroc, vins, orb, colmap] {
        let read = calibration(text, None).expect(text);
        let k = read.intrinsics;
        assert_eq!([k.fx, k.fy, k.cx, k.cy], EXPECTED, "{text}");
        assert_eq!(
            (k.lens, read.size),
            (lens(), Some([640.0, 480.0])),
            "{text}"
        );
        assert!(read.notes.is_empty(), "{:?}", read.notes);
    }
}

#[test]
fn one_of_the_cameras_of_kalibr_is_named() {
    let camera = "cam0:\n  camera_model: pinhole\n  intrinsics: [650.0, 640.0, 320.5, 240.25]\n  resolution: [640, 480]\n";
    let two = camera.to_owned() + &camera.replace("cam0", "cam1").replace("650.0", "651.0");
    let refused = calibration(&two, None)
        .expect_err("two cameras")
        .to_string();
    assert!(
        refused.contains("found cam0, cam1: FILE:cam0 names one"),
        "{refused}"
    );
    assert_eq!(
        calibration(&two, Some("cam1"))
            .expect("the second")
            .intrinsics
            .fx,
        651.0
    );
    let refused = calibration(&two, Some("cam2"))
        .expect_err("no third")
        .to_string();
    assert!(refused.contains("expected cam0 or cam1"), "{refused}");
}

/// The same camera as a fisheye: VINS counts its coefficients from 2 on.
#[test]
fn fisheyes_of_other_tools_are_read() {
    let fisheye = Lens::fisheye(&[-0.02, 0.01, -0.003, 0.001]).expect("a lens");
    let vins = "model_type: KANNALA_BRANDT\nimage_width: 640\nimage_height: 480\nprojection_parameters:\n   k2: -0.02\n   k3: 0.01\n   k4: -0.003\n   k5: \
                0.001\n   mu: 650\n   mv: 640\n   u0: 320.5\n   v0: 240.25\n";
    let orb = "Camera.type: \"KannalaBrandt8\"\nCamera.fx: 650\nCamera.fy: 640\nCamera.cx: 320.5\nCamera.cy: 240.25\nCamera.k1: -0.02\nCamera.k2: \
               0.01\nCamera.k3: -0.003\nCamera.k4: 0.001\n";
    let colmap = "7 OPENCV_FISHEYE 640 480 650 640 321 240.75 -0.02 0.01 -0.003 0.001\n";
    for text in [vins, orb, colmap] {
        let k = calibration(text, None).expect(text).intrinsics;
        assert_eq!(
            ([k.fx, k.fy, k.cx, k.cy], k.lens),
            (EXPECTED, fisheye),
            "{text}"
        );
    }
}

#[test]
fn files_of_stereo_rigs_and_of_xml_are_read() {
    let matrix = |fx: f64| {
        format!(
            "!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [{fx}, 0., 320.5, 0., 640., 240.25, 0., 0., 1.]\n"
        )
    };
    let dist = "!!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [-0.28, 0.09, 0.0012, -0.0001, 0.]\n";
    // OpenCV's stereo_calib.cpp, intrinsics.yml.
    let stereo = format!(
        "%YAML:1.0\n---\nM1: {}D1: {dist}M2: {}D2: {dist}",
        matrix(650.0),
        matrix(660.0)
    );
    let of = |name| calibration(&stereo, Some(name)).expect(name).intrinsics;
    assert_eq!(
        (of("left").fx, of("right").fx, of("right").lens),
        (650.0, 660.0, lens())
    );
    let refused = calibration(&stereo, None)
        .expect_err("two cameras")
        .to_string();
    assert!(refused.contains("found left, right"), "{refused}");
    let xml = "<?xml version=\"1.0\"?>\n<!-- made by hand -->\n<opencv_storage>\n<image_width>640</image_width>\n<image_height>480</image_height>\n<camera_matrix \
               type_id=\"opencv-matrix\">\n  <rows>3</rows>\n  <cols>3</cols>\n  <dt>d</dt>\n  <data>\n    650. 0. 320.5 0. 640. 240.25 0. 0. \
               1.</data></camera_matrix>\n<distortion_coefficients type_id=\"opencv-matrix\">\n  <rows>5</rows>\n  <cols>1</cols>\n  <dt>d</dt>\n  <data>\n    \
               -2.8e-01 9e-02 1.2e-03 -1e-04 0.</data></distortion_coefficients>\n</opencv_storage>\n";
    let read = calibration(xml, None).expect("XML");
    let k = read.intrinsics;
    assert_eq!(
        ([k.fx, k.fy, k.cx, k.cy], k.lens, read.size),
        (EXPECTED, lens(), Some([640.0, 480.0]))
    );
    for broken in [
        "<a>",
        "<a><b></a>",
        "</a>",
        "<opencv_storage></opencv_storage>",
    ] {
        let refused = calibration(broken, None).expect_err(broken).to_string();
        assert!(
            refused.lines().count() == 1 && refused.len() < 200,
            "{refused}"
        );
    }
}

/// COLMAP's camera models ("Camera Models", `models.h`): parameters in their order, pixels' centers at halves.
#[test]
fn each_model_of_colmap_is_read() {
    for (row, focal, coefficients) in [
        (
            "SIMPLE_PINHOLE 640 480 650 321 240.75",
            [650.0, 650.0],
            None,
        ),
        ("PINHOLE 640 480 650 640 321 240.75", [650.0, 640.0], None),
        (
            "SIMPLE_RADIAL 640 480 650 321 240.75 -0.1",
            [650.0; 2],
            Some((false, vec![-0.1, 0.0, 0.0, 0.0])),
        ),
        (
            "RADIAL 640 480 650 321 240.75 -0.1 0.02",
            [650.0; 2],
            Some((false, vec![-0.1, 0.02, 0.0, 0.0])),
        ),
        (
            "SIMPLE_RADIAL_FISHEYE 640 480 650 321 240.75 -0.1",
            [650.0; 2],
            Some((true, vec![-0.1, 0.0, 0.0, 0.0])),
        ),
        (
            "RADIAL_FISHEYE 640 480 650 321 240.75 -0.1 0.02",
            [650.0; 2],
            Some((true, vec![-0.1, 0.02, 0.0, 0.0])),
        ),
        (
            "FULL_OPENCV 640 480 650 640 321 240.75 -0.1 0.02 0.001 0.002 0.003 0.01 0.02 0.03",
            [650.0, 640.0],
            Some((
                false,
                vec![-0.1, 0.02, 0.001, 0.002, 0.003, 0.01, 0.02, 0.03],
            )),
        ),
    ] {
        let read = calibration(&format!("3 {row}\n"), None).expect(row);
        let lens = match coefficients {
            None => Lens::polynomial(&[]),
            Some((true, k)) => Lens::fisheye(&k),
            Some((false, k)) => Lens::polynomial(&k),
        };
        let k = read.intrinsics;
        assert_eq!(
            [k.fx, k.fy, k.cx, k.cy],
            [focal[0], focal[1], 320.5, 240.25],
            "{row}"
        );
        assert_eq!(
            (k.lens, read.size),
            (lens.expect("a lens"), Some([640.0, 480.0])),
            "{row}"
        );
    }
}

#[test]
fn other_models_of_colmap_are_refused() {
    for row in [
        "FOV 640 480 650 640 321 240.75 0.9",
        "RADIAL 640 480 650 321 240.75 -0.1",
    ] {
        let refused = calibration(&format!("3 {row}\n"), None)
            .expect_err(row)
            .to_string();
        assert!(
            refused.contains("expected") && refused.len() < 200,
            "{refused}"
        );
    }
}

/// Two cameras in one flat file, as people write them with NumPy's names, and as ORB-SLAM3 has them.
#[test]
fn both_cameras_of_a_flat_file_are_read() {
    let k = "[650, 0, 320.5, 0, 640, 240.25, 0, 0, 1]";
    let dist = "[-0.28, 0.09, 0.0012, -0.0001]";
    let named = format!("K_left: {k}\ndist_left: {dist}\nK_right: {k}\ndist_right: [0, 0, 0, 0]\n");
    let orb = "%YAML:1.0\nCamera.type: \"PinHole\"\nCamera1.fx: 650\nCamera1.fy: 640\nCamera1.cx: 320.5\nCamera1.cy: 240.25\nCamera1.k1: \
               -0.28\nCamera1.k2: 0.09\nCamera1.p1: 0.0012\nCamera1.p2: -0.0001\nCamera2.fx: 651\nCamera2.fy: 640\nCamera2.cx: \
               320.5\nCamera2.cy: 240.25\nCamera.width: 640\nCamera.height: 480\n";
    for text in [&*named, orb] {
        let left = calibration(text, Some("left")).expect(text).intrinsics;
        assert_eq!(
            ([left.fx, left.fy, left.cx, left.cy], left.lens),
            (EXPECTED, lens()),
            "{text}"
        );
        assert_eq!(
            calibration(text, Some("right")).expect(text).intrinsics.cx,
            320.5
        );
        let refused = calibration(text, None).expect_err("two").to_string();
        assert!(
            refused.contains("found left, right: FILE:left names one"),
            "{refused}"
        );
    }
}

#[test]
fn intrinsics_follow_the_size_of_the_images() {
    let text = "image_width: 1280\nimage_height: 960\nK: [1300, 0, 640.5, 0, 1280, 480, 0, 0, 1]\n";
    let read = calibration(text, None).expect("a camera");
    let (same, words) = read.for_image([1280, 960]).expect("its own size");
    assert_eq!((same, words), (read.intrinsics, None));
    // A pixel of the small image covers two by two: its center (u, v) is the corner between theirs.
    let (half, words) = read.for_image([640, 480]).expect("half of it");
    assert_eq!(
        words.as_deref(),
        Some("intrinsics of 1280 x 960 scaled to 640 x 480")
    );
    let ray = read
        .intrinsics
        .ray(Pixel { u: 20.5, v: 40.5 })
        .expect("a ray");
    let at = half.project(&ray);
    assert!((at.u - 10.0).hypot(at.v - 20.0) < 1e-9, "{at:?}");
    for other in [[640, 360], [480, 640], [1280, 720]] {
        let refused = read
            .for_image(other)
            .expect_err("another aspect")
            .to_string();
        assert!(
            refused.contains("1280 x 960") && refused.contains("aspect"),
            "{refused}"
        );
    }
    // sensor_msgs/CameraInfo: K is of the whole sensor; image_geometry takes the corner off, then divides.
    let binned =
        calibration(&(text.to_owned() + "binning_x: 2\nbinning_y: 2\n"), None).expect("a camera");
    let (k, words) = binned.for_image([640, 480]).expect("binned");
    assert_eq!(
        ([k.fx, k.fy, k.cx, k.cy], words),
        ([650.0, 640.0, 320.25, 240.0], None)
    );
    assert_eq!(
        binned.for_image([1280, 960]).expect("whole").0,
        read.intrinsics
    );
    let roi = "roi: {x_offset: 320, y_offset: 240, width: 640, height: 480, do_rectify: false}\n";
    let part = calibration(&(text.to_owned() + roi), None).expect("a camera");
    let (k, words) = part.for_image([640, 480]).expect("a part");
    assert_eq!(
        ([k.fx, k.fy, k.cx, k.cy], words),
        ([1300.0, 1280.0, 320.5, 240.0], None)
    );
    assert!(part.for_image([320, 240]).is_err());
}

/// What files call it; a shape of NumPy's has the rows first.
#[test]
fn the_size_of_the_images_is_read_in_every_spelling() {
    for size in [
        "resolution: [1280, 960]",
        "image_size: {width: 1280, height: 960}",
        "img_shape: [960, 1280]",
        "img_shape: [1280, 960]",
    ] {
        let text = format!("K: [1300, 0, 640.5, 0, 1280, 480, 0, 0, 1]\n{size}\n");
        assert_eq!(
            calibration(&text, None).expect(size).size,
            Some([1280.0, 960.0]),
            "{size}"
        );
    }
    for size in [
        "resolution: [1280, x]",
        "resolution: [1280.5, 960]",
        "image_width: 0\nimage_height: 960",
        "resolution: [1e9, 1e9]",
    ] {
        let text = format!("K: [1300, 0, 640.5, 0, 1280, 480, 0, 0, 1]\n{size}\n");
        let refused = calibration(&text, None).expect_err(size).to_string();
        assert!(refused.contains("width and height"), "{refused}");
    }
}

#[test]
fn changed_files_neither_panic_nor_say_much() {
    use rand::{RngExt, SeedableRng};
    let files = [
        "%YAML:1.0\n---\nimage_width: 640\nM1: !!opencv-matrix\n   rows: 3\n   data: [650, 0, 320.5, 0, 640, 240.25, 0, 0, 1]\nD1: [0.1, 0, 0, 0]\nroi: {width: 3}\n",
        "<opencv_storage><K><data>650 0 320 0 640 240 0 0 1</data></K><dist><_>1</_></dist></opencv_storage>",
        "1 OPENCV 640 480 650 640 321 240.75 -0.28 0.09 0.0012 -0.0001\n2 PINHOLE 640 480 1 2 3 4\n",
        "cam0:\n  camera_model: pinhole\n  intrinsics: [650.0, 640.0, 320.5, 240.25]\n  resolution: [640, 480]\n  distortion_coeffs: [0, 0, 0, 0]\n",
        "{\"K\": [[650, 0, 320.5], [0, 640, 240.25], [0, 0, 1]], \"dist\": [[-0.28, 0.09, 0.0012, -0.0001, 0]]}",
    ];
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(600_201);
    for k in 0..1000 {
        let mut bytes = files[k % files.len()].as_bytes().to_vec();
        for _ in 0..rng.random_range(1..6) {
            bytes.extend_from_slice(b"\n");
            let at = rng.random_range(0..bytes.len());
            match rng.random_range(0..4) {
                0 => bytes[at] = rng.random(),
                1 => drop(bytes.remove(at)),
                2 => bytes.truncate(at.max(1)),
                _ => bytes.insert(at, b"[]{}<>:,-1e9\n #&*"[rng.random_range(0..17)]),
            }
        }
        if let Err(error) = CameraCalibration::from_bytes("c.yaml".as_ref(), None, &bytes) {
            let error = error.to_string();
            assert!(error.lines().count() == 1 && error.len() < 260, "{error}");
        }
    }
}

#[test]
fn a_pixel_and_its_ray_lead_to_each_other() {
    let k = Intrinsics {
        skew: 3.0,
        lens: Lens::polynomial(&[-0.25, 0.1, 1e-3, 2e-3, -0.02]).expect("a lens"),
        ..Intrinsics::pinhole(420.0, 400.0, 310.0, 250.0)
    };
    for (u, v) in [(310.0, 250.0), (12.0, 400.0), (600.5, 3.0)] {
        let ray = k.ray(Pixel { u, v }).expect("a ray");
        let back = k.project(&(ray * 7.0));
        assert!((back.u - u).hypot(back.v - v) < 1e-9, "{back:?}");
        for axis in 0..3 {
            let mut step = Vec3::zeros();
            step[axis] = 1e-6;
            let (a, b) = (k.project(&(ray + step)), k.project(&(ray - step)));
            let change = Vector2::new(a.u - b.u, a.v - b.v) / 2e-6;
            assert!((change - k.jacobian(&ray).column(axis)).norm() < 1e-5);
        }
    }
}

#[test]
fn points_in_a_row_are_seen_where_each_is() {
    let ideal = Intrinsics {
        skew: 1.5,
        ..Intrinsics::pinhole(650.0, 640.0, 320.5, 240.25)
    };
    let lens = Lens::polynomial(&[-0.28, 0.09, 0.0012, -1e-4, 0.0]).expect("a lens");
    let (from, step) = (Vec3::new(-0.3, 0.2, -1.1), Vec3::new(0.004, -0.001, 0.002));
    for k in [ideal, Intrinsics { lens, ..ideal }] {
        let mut count = 0;
        k.project_along(&from, &step, 200, |i, at| {
            let expected = k.project(&(from + step * i as f64));
            assert!((at.u - expected.u).hypot(at.v - expected.v) < 1e-9);
            assert_eq!(i, count);
            count += 1;
        });
        assert_eq!(count, 200);
    }
}
