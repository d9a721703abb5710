//! Images, videos and tables of times as people have them.

use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::Command;

use image::{DynamicImage, ImageFormat, Rgb, RgbImage as Buffer};
use spindoe::clip::frame_table::{FrameCircles, read_circles, read_times};
use spindoe::image::{DEFAULT_MAX_PIXELS, Picture, RgbImage};
use spindoe::source::files::{Source, frame_count, open, sources};
use spindoe::source::{Frame, FrameSource, SourceEnd};

/// The times of `frames` by the table `text`, or what is said of it.
fn times(text: &str, frames: &[&str]) -> Result<Vec<f64>, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("times.csv");
    std::fs::write(&path, text).unwrap();
    let frames: Vec<PathBuf> = frames.iter().map(PathBuf::from).collect();
    read_times(&path)
        .and_then(|t| t.of_frames(&frames))
        .map_err(|e| e.to_string())
}

fn refused(text: &str, frames: &[&str], expected: &str) {
    let problem = times(text, frames).unwrap_err();
    assert!(problem.contains(expected), "{problem}");
    assert_eq!(problem.lines().count(), 1);
}

#[test]
fn frames_of_two_folders_keep_their_times() {
    let text = "frame,time_s\nleft/7.png,0.5\nright/7.png,0.25\n8,1\n";
    let frames = ["run/left/7.png", "run/right/7.png", "run/right/8.png"];
    assert_eq!(times(text, &frames).unwrap(), [0.5, 0.25, 1.0]);
    // What gives more folders goes before what gives fewer, in any order.
    let text = "time_s,frame\n1,7\n2,./b/7\n3,film_000002\n";
    let frames = ["a/7.png", "b/7.png", "clips/film_000002"];
    assert_eq!(times(text, &frames).unwrap(), [1.0, 2.0, 3.0]);
}

/// What `synth` writes has a sheet beside the frames, which is none.
#[test]
fn the_folder_of_a_rendered_clip_is_its_frames() {
    let dir = tempfile::tempdir().unwrap();
    let clip = dir.path().join("clip");
    std::fs::create_dir_all(clip.join("images")).unwrap();
    for name in ["images/20.png", "images/3.png", "contact_sheet.png"] {
        RgbImage::new(8, 8, vec![[0.5; 3]; 64])
            .and_then(|image| image.write_png(&clip.join(name)))
            .unwrap();
    }
    let sheet = sources(std::slice::from_ref(&clip)).unwrap();
    assert_eq!(sheet, [Source::Image(clip.join("contact_sheet.png"))]);
    std::fs::write(clip.join("index.csv"), "images/3.png,3,1\n").unwrap();
    let frames = ["3.png", "20.png"].map(|name| Source::Image(clip.join("images").join(name)));
    assert_eq!(sources(&[clip]).unwrap(), frames);
    // The folder around it has no frames of its own.
    assert!(sources(&[dir.path().to_path_buf()]).is_err());
}

#[cfg(feature = "cli")]
#[test]
fn a_sample_is_estimated_by_its_folder() {
    let dir = tempfile::tempdir().unwrap();
    crate::common::done(dir.path(), &["synth", "--frames", "3"]);
    for folder in ["sample", "sample/images"] {
        let run = ["estimate", "--table", "sample", folder, "--json"];
        let json: serde_json::Value =
            serde_json::from_str(&crate::common::done(dir.path(), &run)).unwrap();
        let (frames, identified) = (json["frames"].as_array().unwrap(), &json["identified"]);
        assert_eq!((frames.len(), identified), (3, &3.into()), "{folder}");
    }
}

#[test]
fn outlines_may_say_how_well_they_are_known() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("circles.csv");
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        let of_frame = |t: FrameCircles| t.of_frame("7.png".as_ref());
        read_circles(&path).and_then(of_frame)
    };
    let sigma = |text: &str| read(text).unwrap().expect("a row").sigma_px;
    assert_eq!(sigma("frame,u,v,radius,sigma\n7,10,20,30,0.02\n"), 0.02);
    assert!((sigma("frame,u,v,radius\n7,10,20,30\n") - 0.3).abs() < 1e-12);
    for bad in ["0", "-1", "31", "x"] {
        let text = format!("frame,u,v,radius,sigma\n7,10,20,30,{bad}\n");
        let problem = read(&text).unwrap_err().to_string();
        assert!(
            problem.contains("line 2") && problem.contains("sigma"),
            "{problem}"
        );
    }
}

#[test]
fn times_that_are_not_clear_are_refused() {
    let one = ["a/7.png"];
    refused(
        "frame,time_s\n7.png,1\n",
        &["a/7.png", "b/7.png"],
        "line 2: frame: names both a/7.png and b/7.png",
    );
    refused(
        "frame,time_s\n7,1\n\n7,1\n",
        &one,
        "line 4: frame: \"7\" occurs on line 2 already",
    );
    refused(
        "frame,time_s\n7,1\n./7,2\n",
        &one,
        "line 3: frame: \"7\" occurs on line 2",
    );
    refused(
        "frame,time_s\n7,1\n7.png,2\n",
        &one,
        "line 3: frame: names a/7.png, as does line 2",
    );
    refused(
        "frame,time_s\n8,1\n",
        &one,
        "file: expected a row for frame a/7.png",
    );
    refused(
        "frame,time_s\n7,soon\n",
        &one,
        "line 2: time_s: expected a finite number, found \"soon\"",
    );
    refused(
        "frame,time_s\n7,\n",
        &one,
        "line 2: time_s: expected seconds",
    );
    refused("frame,time_s\n,1\n", &one, "line 2: frame: expected a name");
    refused(
        "frame,seconds\n",
        &one,
        "line 1: expected a header with time_s",
    );
}

/// A wide image, red on the left, as a JPEG that asks to be turned by `orientation` (EXIF).
fn turned_jpeg(orientation: u8) -> Vec<u8> {
    let color = |x, _| {
        if x < 16 {
            Rgb([255, 0, 0])
        } else {
            Rgb([0, 0, 255])
        }
    };
    let mut jpeg = Cursor::new(Vec::new());
    DynamicImage::from(Buffer::from_fn(32, 16, color))
        .write_to(&mut jpeg, ImageFormat::Jpeg)
        .unwrap();
    // One entry of TIFF, big-endian: tag 0x0112, one number of 16 bits.
    let tiff = [
        b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".as_slice(),
        &[orientation, 0, 0, 0, 0, 0, 0],
    ]
    .concat();
    let length = (2 + 6 + tiff.len()) as u16;
    let jpeg = jpeg.into_inner();
    [
        &jpeg[..2],
        b"\xff\xe1",
        &length.to_be_bytes(),
        b"Exif\0\0",
        &tiff,
        &jpeg[2..],
    ]
    .concat()
}

#[test]
fn images_are_turned_as_the_camera_says() {
    let path = Path::new("photo.jpg");
    let at = |image: &RgbImage, u: f64, v: f64| image.sample(u, v);
    let plain = RgbImage::decode(path, &turned_jpeg(1)).unwrap();
    assert_eq!((plain.width(), plain.height()), (32, 16));
    assert!(at(&plain, 3.0, 8.0)[0] > 0.9);
    // 6: the camera was turned, and the left side of what is stored is the top.
    let upright = RgbImage::decode(path, &turned_jpeg(6)).unwrap();
    assert_eq!((upright.width(), upright.height()), (16, 32));
    assert!(at(&upright, 8.0, 3.0)[0] > 0.9 && at(&upright, 8.0, 28.0)[2] > 0.9);
}

#[test]
fn deep_videos_and_names_with_a_colon_are_read() {
    if !crate::common::has_ffmpeg() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    for (format, name) in [("gray16le", "deep.mkv"), ("yuv420p10le", "ten:bits.mkv")] {
        let path = dir.path().join(name);
        let made = generated("color=red:size=32x16:rate=100:duration=0.03")
            .args(["-pix_fmt", format, "-c:v", "ffv1"])
            .arg(format!("file:{}", path.display()))
            .output()
            .unwrap();
        assert!(made.status.success(), "{made:?}");
        let (frames, end) = read(&path);
        assert_eq!(frames.len(), 3, "{name}");
        let clock = end.clock.unwrap();
        assert!((clock.stored_fps - 100.0).abs() < 1.0 && clock.capture_fps.is_none());
        let stem = name.strip_suffix(".mkv").unwrap();
        assert_eq!(frames[1].path, dir.path().join(format!("{stem}_000002")));
        let image = frames[1].picture.as_ref().unwrap().view().unwrap();
        assert_eq!((image.width(), image.height()), (32, 16));
    }
}

/// What phones, camcorders and boards write: MPEG-TS in packets of 188 bytes and, as AVCHD cards have it, of 192, and 3GP.
#[test]
fn containers_of_cameras_are_read_whole() {
    if !crate::common::has_ffmpeg() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    for (name, codec, flags) in [
        (
            "00001.mts",
            "libx264",
            &["-f", "mpegts", "-mpegts_m2ts_mode", "1"][..],
        ),
        (
            "00002.MTS",
            "mpeg2video",
            &["-f", "mpegts", "-mpegts_m2ts_mode", "1"],
        ),
        (
            "bluray.m2ts",
            "libx264",
            &["-f", "mpegts", "-mpegts_m2ts_mode", "1"],
        ),
        ("plain.ts", "libx264", &["-f", "mpegts"]),
        ("phone.3gp", "mpeg4", &["-f", "3gp"]),
    ] {
        let path = dir.path().join(name);
        let made = generated("testsrc=size=64x48:rate=50:duration=0.4")
            .args(["-pix_fmt", "yuv420p", "-c:v", codec, "-bf", "0"])
            .args(flags)
            .arg(&path)
            .output()
            .unwrap();
        if !made.status.success() {
            crate::common::skipped(&format!("ffmpeg writes no {name}: {made:?}"));
            continue;
        }
        // Static builds of ffmpeg 4.2 and 7.0 crash where they read a transport stream's name.
        let looked = Command::new("ffmpeg")
            .args(["-v", "error", "-i"])
            .arg(&path)
            .args(["-f", "null", "-"])
            .output();
        if looked.unwrap().status.code().is_none() {
            crate::common::skipped(&format!("this ffmpeg crashes over {name}"));
            continue;
        }
        if flags.contains(&"-mpegts_m2ts_mode") {
            // Each packet begins with four bytes of a time stamp, then the sync byte.
            let bytes = std::fs::read(&path).unwrap();
            let synced = bytes.chunks_exact(192).all(|packet| packet[4] == 0x47);
            assert!(bytes.len().is_multiple_of(192) && synced, "{name}");
        }
        let listed = sources(std::slice::from_ref(&path)).unwrap();
        assert!(matches!(listed[..], [Source::Video(_)]), "{listed:?}");
        let (frames, end) = read(&path);
        assert_eq!((frames.len(), end.cut_short), (20, None), "{name}");
        let times: Vec<f64> = frames.iter().map(|f| f.time_s.unwrap()).collect();
        let steps = times.windows(2).map(|w| w[1] - w[0]);
        assert!(
            steps.into_iter().all(|s| (s - 0.02).abs() < 1e-3),
            "{times:?}"
        );
    }
}

/// An ffmpeg that writes pictures of a source of its own.
fn generated(source: &str) -> Command {
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-f", "lavfi", "-i", source]);
    ffmpeg
}

/// The frames of a video, and what is known at its end.
fn read(path: &Path) -> (Vec<Frame>, SourceEnd) {
    let mut source = open(&Source::Video(path.to_path_buf()), DEFAULT_MAX_PIXELS).unwrap();
    let frames: spindoe::Result<Vec<Frame>> = source.frames().collect();
    (frames.unwrap(), source.end())
}

#[test]
fn slow_motion_and_uneven_frames_keep_their_times() {
    if !crate::common::has_ffmpeg() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let make = |name: &str, flags: &[&str]| {
        let path = dir.path().join(name);
        let made = generated("color=red:size=32x16:rate=30:duration=0.5")
            .args(flags)
            .arg(&path)
            .output()
            .unwrap();
        assert!(made.status.success(), "{made:?}");
        let (frames, end) = read(&path);
        let times: Vec<f64> = frames.iter().map(|f| f.time_s.unwrap()).collect();
        (times, end.clock.unwrap())
    };
    // As phones write it: 240 frames a second, stored at 30.
    let android = [
        "-movflags",
        "use_metadata_tags",
        "-metadata",
        "com.android.capture.fps=240",
    ];
    let (times, clock) = make("slow.mp4", &[&android[..], &["-c:v", "mpeg4"]].concat());
    assert_eq!(clock.capture_fps, Some(240.0));
    assert!(
        !clock.is_variable && (clock.stored_fps - 30.0).abs() < 0.1,
        "{clock:?}"
    );
    let step = clock.time_scale() * (times[1] - times[0]);
    assert!((step - 1.0 / 240.0).abs() < 1e-4, "{step}");
    // Every third frame is missing.
    let (times, clock) = make("uneven.mkv", &["-vf", "select=mod(n\\,3)", "-c:v", "ffv1"]);
    assert!(
        clock.is_variable && clock.capture_fps.is_none(),
        "{clock:?}"
    );
    let steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    assert!(
        steps.iter().any(|s| (s - 1.0 / 30.0).abs() < 2e-3),
        "{steps:?}"
    );
    assert!(
        steps.iter().any(|s| (s - 2.0 / 30.0).abs() < 2e-3),
        "{steps:?}"
    );
}

/// A TIFF file of gray pages of 4 x 3 pixels, the values of each page one more than those of the page before; the second page is a
/// reduced copy where `copy` says so.
pub(crate) fn tiff_stack(pages: u32, is_little: bool, copy: bool) -> Vec<u8> {
    let two = |n: u16| {
        if is_little {
            n.to_le_bytes()
        } else {
            n.to_be_bytes()
        }
    };
    let four = |n: u32| {
        if is_little {
            n.to_le_bytes()
        } else {
            n.to_be_bytes()
        }
    };
    let mut bytes: Vec<u8> = if is_little {
        b"II*\0".to_vec()
    } else {
        b"MM\0*".to_vec()
    };
    bytes.extend(four(8));
    let length = 2 + 10 * 12 + 4 + 12;
    for page in 0..pages {
        let at = 8 + page * length;
        let is_copy = u32::from(copy && page == 1);
        let tags = [
            (254, is_copy),
            (256, 4),
            (257, 3),
            (258, 8),
            (259, 1),
            (262, 1),
            (273, at + 2 + 120 + 4),
            (277, 1),
            (278, 3),
            (279, 12),
        ];
        bytes.extend(two(tags.len() as u16));
        for (tag, value) in tags {
            bytes.extend(two(tag));
            bytes.extend(two(4));
            bytes.extend(four(1));
            bytes.extend(four(value));
        }
        bytes.extend(four(if page + 1 < pages { at + length } else { 0 }));
        bytes.extend((0..12).map(|k| (k + page) as u8));
    }
    bytes
}

#[test]
fn all_pages_of_a_file_are_frames() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("clip.tif");
    for (pages, is_little, copy) in [
        (1, true, false),
        (5, true, false),
        (5, false, false),
        (5, true, true),
    ] {
        std::fs::write(&path, tiff_stack(pages, is_little, copy)).unwrap();
        let sources = sources(std::slice::from_ref(&path)).unwrap();
        let mut source = open(&sources[0], DEFAULT_MAX_PIXELS).unwrap();
        let frames: Vec<_> = source.frames().map(|frame| frame.unwrap()).collect();
        assert_eq!(frames.len() as u32, pages - u32::from(copy));
        let own = (0..pages).filter(|page| !(copy && *page == 1));
        for (frame, page) in frames.iter().zip(own) {
            let picture = frame.picture.as_ref().unwrap();
            let gray = picture.to_rgb().unwrap().to_gray();
            assert_eq!((gray.width(), gray.height()), (4, 3));
            assert!(
                (gray.at(2, 1) - (6 + page) as f32 / 255.0).abs() < 1e-6,
                "{page}"
            );
        }
        let names: Vec<&str> = frames.iter().map(|f| f.name.as_str()).collect();
        assert_eq!(names[0], if pages > 1 { "clip_000001" } else { "clip" });
    }
    // A chain that leads back ends, as one does that leads nowhere.
    let mut looped = tiff_stack(2, true, false);
    let last = 8 + 138 + 2 + 120;
    looped[last..last + 4].copy_from_slice(&8u32.to_le_bytes());
    std::fs::write(&path, &looped).unwrap();
    let mut source = open(
        &sources(std::slice::from_ref(&path)).unwrap()[0],
        DEFAULT_MAX_PIXELS,
    )
    .unwrap();
    assert!(source.frames().take(10).count() <= 10);
}

#[test]
fn an_animation_is_no_picture() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("one.png");
    let image = RgbImage::new(2, 2, vec![[0.5; 3]; 4]).unwrap();
    image.write_png(&path).unwrap();
    let mut bytes = std::fs::read(&path).unwrap();
    assert!(Picture::decode(&path, &bytes, DEFAULT_MAX_PIXELS).is_ok());
    // acTL behind IHDR: 24 pictures, played for ever.
    let mut chunk = vec![0, 0, 0, 8];
    chunk.extend(*b"acTL\0\0\0\x18\0\0\0\0\0\0\0\0");
    bytes.splice(33..33, chunk);
    let refused = Picture::decode(&path, &bytes, DEFAULT_MAX_PIXELS)
        .unwrap_err()
        .to_string();
    assert!(refused.contains("an animation"), "{refused}");
}

/// What a camera or a pipe writes one behind the other. Only the first picture of such a file was read, without a word.
#[test]
fn pictures_one_behind_the_other_are_no_single_picture() {
    let values: Vec<u8> = (0..18).map(|k| 10 * k).collect();
    let encoded = |format| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let written = image::write_buffer_with_format(
            &mut bytes,
            &values,
            3,
            2,
            image::ExtendedColorType::Rgb8,
            format,
        );
        written.unwrap();
        bytes.into_inner()
    };
    let with_header = |header: &str, bytes: &[u8]| [header.as_bytes(), bytes].concat();
    let jpeg = encoded(image::ImageFormat::Jpeg);
    for one in [
        jpeg.clone(),
        encoded(image::ImageFormat::Png),
        encoded(image::ImageFormat::Bmp),
        with_header("P6 # colors\n3 2\n255\n", &values),
        with_header("P5\n9 1 65535\n", &values),
        with_header("P4 17 2\n", &values[..6]),
        with_header(
            "P7\nWIDTH 3\nHEIGHT 2\nDEPTH 3\nMAXVAL 255\nTUPLTYPE RGB\nENDHDR\n",
            &values,
        ),
    ] {
        let path = Path::new("a.picture");
        let start = String::from_utf8_lossy(&one[..2]).into_owned();
        let alone = Picture::decode(path, &one, DEFAULT_MAX_PIXELS);
        assert!(alone.is_ok(), "{start}: {alone:?}");
        // Bytes behind a picture that begin none are a camera's own.
        let noted = [&one[..], b"\0\0 notes"].concat();
        assert!(
            Picture::decode(path, &noted, DEFAULT_MAX_PIXELS).is_ok(),
            "{start}"
        );
        let two = [&one[..], &one[..]].concat();
        let refused = Picture::decode(path, &two, DEFAULT_MAX_PIXELS).unwrap_err();
        let words = refused.to_string();
        assert!(
            words.contains("found several") && words.len() < 200,
            "{start}: {words}"
        );
    }
    // A phone's picture with its gain map behind it says so in a segment of its own.
    let segment = b"\xff\xe2\0\x0aMPF\0MM\0*";
    let phone = [&jpeg[..2], segment, &jpeg[2..], &jpeg].concat();
    assert!(Picture::decode(Path::new("a.jpg"), &phone, DEFAULT_MAX_PIXELS).is_ok());
}

/// Files that Pillow wrote (13.0); where frames of WebP lie over each other, the reader is up to a level off: pictures of 6 x 4 pixels, 200 everywhere but at column 2 of row 1, which has 40, 80 and 120 in turn.
#[test]
fn all_pictures_of_an_animation_are_frames() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/it/vision/data");
    for (name, values) in [
        ("three.gif", &[40.0, 80.0, 120.0][..]),
        ("three.webp", &[40.0, 80.0, 120.0]),
        ("three.png", &[40.0, 80.0, 120.0]),
        ("still.gif", &[80.0]),
        ("still.webp", &[80.0]),
    ] {
        let path = data.join(name);
        let sources = sources(std::slice::from_ref(&path)).unwrap();
        let mut source = open(&sources[0], DEFAULT_MAX_PIXELS).unwrap();
        let frames: Vec<_> = source.frames().map(|frame| frame.unwrap()).collect();
        assert_eq!(frames.len(), values.len(), "{name}");
        assert_eq!(frame_count(&sources[0]), Some(values.len()), "{name}");
        for (frame, value) in frames.iter().zip(values) {
            assert_eq!(frame.time_s, None);
            let picture = frame.picture.as_ref().unwrap();
            let gray = picture.to_rgb().unwrap().to_gray();
            assert_eq!((gray.width(), gray.height()), (6, 4), "{name}");
            for (at, expected) in [((2, 1), *value), ((0, 0), 200.0), ((5, 3), 200.0)] {
                let found = 255.0 * gray.at(at.0, at.1);
                let most = if name.ends_with("webp") { 1.01 } else { 0.01 };
                assert!((found - expected).abs() < most, "{name}: {found} at {at:?}");
            }
        }
        let mut small = open(&sources[0], 23).unwrap();
        let refused = small.frames().next().unwrap().unwrap().picture;
        let refused = refused.unwrap_err().to_string();
        assert!(
            refused.contains("at most 23 pixels, found 6 x 4"),
            "{refused}"
        );
    }
}

#[test]
fn hidden_files_are_no_frames() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["1.png", "._1.png", ".DS_Store", "notes.txt"] {
        std::fs::write(dir.path().join(name), "x").unwrap();
    }
    let listed = spindoe::source::files::list_sources(&[dir.path().to_path_buf()]).unwrap();
    assert_eq!(listed.sources, [Source::Image(dir.path().join("1.png"))]);
    assert_eq!(listed.skipped[0].names, ["notes.txt"]);
}

/// What `rpicam-vid --save-pts` writes: milliseconds, in the order of the frames.
#[test]
fn times_in_the_frames_order_are_read() {
    use spindoe::clip::FrameClock;
    use spindoe::clip::frame_table::read_clock;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("pts.txt");
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        read_clock(&path)
    };
    match read("# timecode format v2\n0.000\n8.333\n16.667\n").unwrap() {
        FrameClock::Ordered(_, times) => {
            assert_eq!(times.len(), 3);
            assert!((times[2] - 0.016667).abs() < 1e-12);
        }
        other => panic!("{other:?}"),
    }
    let refused = read("# timecode format v2\n0.000\nx\n")
        .unwrap_err()
        .to_string();
    assert!(
        refused.contains("line 3: expected milliseconds, found \"x\""),
        "{refused}"
    );
    assert!(matches!(
        read("frame,time_s\na,1\n"),
        Ok(FrameClock::Table(_))
    ));
}
