//! Frames from a pipe: every format, ends and broken ends, and the command that reads them.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::Value;
use spindoe::image::{DEFAULT_MAX_PIXELS, GrayImage, ImageView, Picture, RawPixel, RgbImage};
use spindoe::source::grab::{Grabber, QUEUE, WhenFull, queue};
use spindoe::source::pipe::{PipeFormat, PipeReader};
use spindoe::source::{Frame, FrameSource};
use spindoe::synth::SynthConfig;
use spindoe::synth::dataset::{ClipConfig, SynthSequence};

fn images() -> Vec<RgbImage> {
    let pattern = crate::common::random_pattern(20, 5);
    let config = SynthConfig {
        ball_px: Some([80.0; 2]),
        ..SynthConfig::good()
    };
    let sequence = ClipConfig {
        fps: 350.0,
        spin: Some([40.0, 150.0, -60.0]),
        ..ClipConfig::default()
    };
    let sequence = SynthSequence::random(&pattern, &config, &sequence, 3, 8).unwrap();
    (0..8).map(|k| sequence.frame(k).unwrap().image).collect()
}

/// The image as a file holds it: rounded to eight bits.
fn rounded(image: &RgbImage) -> RgbImage {
    let values = image.to_bytes();
    let colors = values
        .chunks_exact(3)
        .map(|c| [c[0], c[1], c[2]].map(|x| f32::from(x) / 255.0));
    RgbImage::new(image.width(), image.height(), colors.collect()).unwrap()
}

fn encoded(image: &RgbImage, format: image::ImageFormat) -> Vec<u8> {
    let (width, height) = (image.width() as u32, image.height() as u32);
    let buffer = image::RgbImage::from_raw(width, height, image.to_bytes()).unwrap();
    if format == image::ImageFormat::Pnm {
        // The encoder's own choice is PAM.
        let header = format!("P6\n{width} {height}\n255\n");
        return [header.as_bytes(), &image.to_bytes()].concat();
    }
    let mut bytes = std::io::Cursor::new(Vec::new());
    buffer.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn color(frame: Option<spindoe::Result<Frame>>) -> RgbImage {
    let picture = frame.expect("a frame").unwrap().picture.unwrap();
    match picture.view().unwrap() {
        ImageView::Color(color) => color.clone(),
        ImageView::Raw(raw) if raw.pixel() != RawPixel::Gray => raw.to_rgb(),
        other => panic!("expected a color image, found {other:?}"),
    }
}

fn gray(frame: &Frame) -> GrayImage {
    match frame.picture.as_ref().unwrap().view().unwrap() {
        ImageView::Gray(gray) => gray.clone(),
        ImageView::Raw(raw) if raw.pixel() == RawPixel::Gray => raw.to_gray(),
        other => panic!("expected a gray image, found {other:?}"),
    }
}

#[test]
fn image_files_follow_each_other() {
    use image::ImageFormat::{Jpeg, Png, Pnm};
    let images = images();
    let formats = [Png, Pnm, Jpeg, Png, Jpeg, Jpeg, Pnm, Png];
    let mut bytes = Vec::new();
    for (image, format) in images.iter().zip(formats) {
        bytes.extend(encoded(image, format));
    }
    let mut reader =
        PipeReader::new(&bytes[..], "pipe", PipeFormat::Images, DEFAULT_MAX_PIXELS).unwrap();
    for (image, format) in images.iter().zip(formats) {
        let found = color(reader.frames().next());
        let expected = RgbImage::decode("x".as_ref(), &encoded(image, format)).unwrap();
        assert_eq!(found, expected);
        if format != Jpeg {
            assert_eq!(found, rounded(image));
        }
    }
    assert!(reader.frames().next().is_none());
}

#[test]
fn raw_video_has_its_channels() {
    let image = &images()[0];
    let bytes = image.to_bytes();
    let raw = |pixel| PipeFormat::Raw {
        width: image.width(),
        height: image.height(),
        pixel,
    };
    let mut reader =
        PipeReader::new(&bytes[..], "pipe", raw(RawPixel::Rgb), DEFAULT_MAX_PIXELS).unwrap();
    assert_eq!(color(reader.frames().next()), rounded(image));
    let swapped: Vec<u8> = bytes
        .chunks_exact(3)
        .flat_map(|c| [c[2], c[1], c[0]])
        .collect();
    let mut reader =
        PipeReader::new(&swapped[..], "pipe", raw(RawPixel::Bgr), DEFAULT_MAX_PIXELS).unwrap();
    assert_eq!(color(reader.frames().next()), rounded(image));
    let mut reader =
        PipeReader::new(&bytes[..], "pipe", raw(RawPixel::Gray), DEFAULT_MAX_PIXELS).unwrap();
    // Three times as many gray frames as colored ones.
    for third in bytes.chunks_exact(bytes.len() / 3) {
        let found = gray(&reader.frames().next().expect("a frame").unwrap());
        for (value, byte) in found.values().iter().zip(third) {
            assert!((value - f32::from(*byte) / 255.0).abs() < 1e-6);
        }
    }
    assert!(reader.frames().next().is_none());
}

#[test]
fn pgm_of_both_depths() {
    let bytes = b"P5\n# a comment\n3 2\n255\n\x00\x33\xff\x80\x01\x02P5 2 1 1000\n\x03\xe8\x01\xf4";
    let mut reader =
        PipeReader::new(&bytes[..], "pipe", PipeFormat::Images, DEFAULT_MAX_PIXELS).unwrap();
    let first = gray(&reader.frames().next().expect("a frame").unwrap());
    assert_eq!((first.width(), first.height()), (3, 2));
    assert!((first.values()[1] - 0.2).abs() < 1e-6);
    let second = gray(&reader.frames().next().expect("a frame").unwrap());
    assert!((second.values()[0] - 1.0).abs() < 1e-6 && (second.values()[1] - 0.5).abs() < 1e-6);
    assert!(reader.frames().next().is_none());
}

#[test]
fn broken_streams_are_errors() {
    let image = &images()[0];
    for format in [
        image::ImageFormat::Png,
        image::ImageFormat::Pnm,
        image::ImageFormat::Jpeg,
    ] {
        let whole = encoded(image, format);
        for cut in [1, 5, 12, whole.len() / 2, whole.len() - 1] {
            let mut bytes = whole.clone();
            bytes.extend(&whole[..cut]);
            let mut reader =
                PipeReader::new(&bytes[..], "pipe", PipeFormat::Images, DEFAULT_MAX_PIXELS)
                    .unwrap();
            assert!(reader.frames().next().unwrap().is_ok());
            let error = reader
                .next_frame(&mut Frame::default())
                .unwrap_err()
                .to_string();
            assert!(error.starts_with("pipe: frame 1: "), "{error}");
        }
    }
    let refused: [&[u8]; 6] = [
        b"GIF89a",
        b"P6 0 4 255\n",
        b"P6 100000 100000 255\n",
        b"P5 x",
        b"\xff\xd8hello",
        b"\x89PNG\r\n\x1a\n\xff\xff\xff\xffIHDR",
    ];
    for bytes in refused {
        let mut reader =
            PipeReader::new(bytes, "pipe", PipeFormat::Images, DEFAULT_MAX_PIXELS).unwrap();
        assert!(reader.frames().all(|frame| frame.is_err()), "{bytes:?}");
    }
    let none = PipeFormat::Raw {
        width: 0,
        height: 4,
        pixel: RawPixel::Gray,
    };
    assert!(PipeReader::new(&b""[..], "pipe", none, DEFAULT_MAX_PIXELS).is_err());
}

/// Every frame is answered before the next one is sent.
#[test]
fn the_command_answers_each_frame_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let pattern = crate::common::random_pattern(20, 5);
    pattern.write_csv(&dir.path().join("pattern.csv")).unwrap();
    let images = images();
    let (width, height) = (images[0].width(), images[0].height());
    let raw = format!("{width}x{height},rgb");
    let mut child = Command::new(env!("CARGO_BIN_EXE_spindoe"))
        .args(["live", "--table", "pattern.csv", "-"])
        .args(["--raw", &raw, "--fps", "350"])
        .current_dir(dir.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    let mut output = BufReader::new(child.stdout.take().unwrap());
    let mut last = Value::Null;
    for (k, image) in images.iter().enumerate() {
        input.write_all(&image.to_bytes()).unwrap();
        input.flush().unwrap();
        let mut line = String::new();
        output.read_line(&mut line).unwrap();
        last = serde_json::from_str(&line).unwrap();
        assert_eq!(last["frame"], k);
        assert!((last["time_s"].as_f64().unwrap() - k as f64 / 350.0).abs() < 1e-12);
        assert!(last["orientation_wxyz"].is_array(), "{last}");
    }
    drop(input);
    assert!(child.wait().unwrap().success());
    let spin = last["spin"]["spin_rad_s"].as_array().unwrap();
    for (found, expected) in spin.iter().zip([40.0, 150.0, -60.0]) {
        assert!((found.as_f64().unwrap() - expected).abs() < 10.0, "{last}");
    }
    assert!(last["spin"]["std_rad_s"].is_array());
}

/// A webcam shows people as a mirror does.
#[test]
fn the_command_says_that_frames_are_mirrored() {
    let dir = tempfile::tempdir().unwrap();
    let pattern = crate::common::random_pattern(20, 5);
    pattern.write_csv(&dir.path().join("pattern.csv")).unwrap();
    let (images, mut bytes) = (images(), Vec::new());
    for image in images.iter().chain(&images).chain(&images) {
        let mirrored = Picture::Color(image.clone()).mirrored().unwrap();
        bytes.extend(mirrored.to_rgb().unwrap().to_bytes());
    }
    std::fs::write(dir.path().join("frames"), bytes).unwrap();
    let raw = format!("{}x{},rgb", images[0].width(), images[0].height());
    let live = |more: &[&str]| {
        let all = ["live", "--table", "pattern.csv", "frames", "--raw", &raw];
        let all = [&all[..], &["--fps", "350"], more].concat();
        crate::common::spindoe(dir.path(), &all)
    };
    let output = live(&[]);
    assert_eq!(output.status.code(), Some(3));
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(
        words.matches("the images are mirrored").count(),
        1,
        "{words}"
    );
    assert!(words.contains("--mirrored reads them"), "{words}");
    let output = live(&["--mirrored"]);
    assert_eq!(output.status.code(), Some(0));
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!words.contains("note"), "{words}");
}

#[test]
fn the_command_refuses_what_does_not_fit() {
    let dir = tempfile::tempdir().unwrap();
    let pattern = crate::common::random_pattern(20, 5);
    pattern.write_csv(&dir.path().join("pattern.csv")).unwrap();
    std::fs::write(dir.path().join("empty"), b"").unwrap();
    std::fs::write(dir.path().join("noise"), b"no image at all").unwrap();
    let base = ["--table", "pattern.csv"];
    for (arguments, code) in [
        (&["live", "empty", "--fps", "9"][..], 3),
        (&["live", "empty"], 2),
        (&["live", "noise", "--fps", "9"], 2),
        (&["live", "none"], 2),
        (&["live", "empty", "empty"], 2),
        (&["live", "empty", "--raw", "64,gray"], 2),
        (&["live", "empty", "--fps", "9", "--json"], 2),
        (&["live", "empty", "--fps", "9", "--times", "t.csv"], 2),
        (&["live", "empty", "--fps", "9", "--table", "dots20"], 2),
        (&["estimate", "empty", "--raw", "64x64,gray"], 2),
    ] {
        let output = crate::common::spindoe(dir.path(), &[arguments, &base[..]].concat());
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
        assert!(output.stdout.is_empty());
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(words.trim_end().lines().count(), 1, "{words}");
    }
}

/// A camera of gray frames of 4 x 2 pixels, each filled with its number, one every so often; it notes when each is done.
struct Camera {
    every: Duration,
    frames: u8,
    sent: Vec<u8>,
    done: Arc<Mutex<Vec<Instant>>>,
}

const PIXELS: usize = 8;
const SMALL: PipeFormat = PipeFormat::Raw {
    width: 4,
    height: 2,
    pixel: RawPixel::Gray,
};

impl Read for Camera {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        if self.sent.is_empty() {
            let mut done = self.done.lock().unwrap();
            let number = done.len() as u8;
            if number == self.frames {
                return Ok(0);
            }
            std::thread::sleep(self.every);
            self.sent = vec![number; PIXELS];
            done.push(Instant::now());
        }
        let count = into.len().min(self.sent.len());
        into[..count].copy_from_slice(&self.sent[..count]);
        self.sent.drain(..count);
        Ok(count)
    }
}

/// A grabber before a camera, and when the camera had its frames.
fn grabber(ms: u64, frames: u8, when_full: WhenFull) -> (Grabber, Arc<Mutex<Vec<Instant>>>) {
    let done = Arc::new(Mutex::new(Vec::new()));
    let camera = Camera {
        every: Duration::from_millis(ms),
        frames,
        sent: Vec::new(),
        done: Arc::clone(&done),
    };
    let reader =
        PipeReader::new(BufReader::new(camera), "camera", SMALL, DEFAULT_MAX_PIXELS).unwrap();
    (Grabber::start(reader, when_full).unwrap(), done)
}

fn number_in(frame: &Frame) -> u64 {
    let value = gray(frame).values()[0];
    (255.0 * value).round() as u64
}

#[test]
fn frames_have_the_time_of_their_arrival_however_slowly_they_are_looked_at() {
    let (mut grabber, done) = grabber(4, 60, WhenFull::DropOldest);
    let (mut stamps, mut last) = (Vec::new(), None);
    let mut frame = Frame::default();
    while grabber.next_frame(&mut frame).unwrap() {
        assert_eq!(number_in(&frame), frame.number);
        assert!(last.is_none_or(|last| last < frame.number));
        last = Some(frame.number);
        stamps.push((frame.number, frame.arrived));
        std::thread::sleep(Duration::from_millis(15));
    }
    assert_eq!(last, Some(59));
    assert_eq!(stamps.len() as u64 + grabber.dropped(), 60);
    assert!(grabber.dropped() > 10, "{}", grabber.dropped());
    let done = done.lock().unwrap();
    let mut late: Vec<f64> = stamps
        .iter()
        .map(|(number, arrived)| {
            let sent = done[*number as usize];
            arrived
                .checked_duration_since(sent)
                .expect("later")
                .as_secs_f64()
        })
        .collect();
    late.sort_by(f64::total_cmp);
    // Of a frame every 4 ms; when they are looked at lies up to eight frames of 15 ms later.
    let median = late[late.len() / 2];
    assert!(median < 4e-3, "{median} s");
}

#[test]
fn a_camera_that_waits_loses_no_frame() {
    let (mut grabber, done) = grabber(0, 40, WhenFull::Wait);
    for expected in 0..40 {
        let frame = grabber.frames().next().expect("a frame").unwrap();
        assert_eq!((frame.number, number_in(&frame)), (expected, expected));
        if expected == 20 {
            std::thread::sleep(Duration::from_millis(50));
            // The queue, the frame in hand, one before the queue, and what the reader has in advance.
            let ahead = done.lock().unwrap().len();
            let advance = BufReader::new(std::io::empty()).capacity() / PIXELS;
            assert!(ahead <= 21 + QUEUE + 2 + advance, "{ahead}");
        }
    }
    assert!(grabber.frames().next().is_none());
    assert!(grabber.frames().next().is_none());
    assert_eq!(grabber.dropped(), 0);
}

#[test]
fn what_came_before_a_broken_frame_is_handed_out() {
    let bytes = std::io::Cursor::new(vec![7u8; 2 * PIXELS + 3]);
    let reader = PipeReader::new(bytes, "camera", SMALL, DEFAULT_MAX_PIXELS).unwrap();
    let mut grabber = Grabber::start(reader, WhenFull::Wait).unwrap();
    for _ in 0..2 {
        let frame = grabber.frames().next().expect("a frame").unwrap();
        assert_eq!(number_in(&frame), 7);
    }
    let error = grabber
        .next_frame(&mut Frame::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("camera: frame 2"), "{error}");
    assert!(grabber.frames().next().is_none());
}

#[test]
fn a_camera_that_calls_back_pushes_its_frames() {
    let (mut pusher, mut grabber) = queue(WhenFull::DropOldest);
    let camera = std::thread::spawn(move || {
        for value in 0..20u8 {
            let heard = pusher.push(|picture| {
                *picture = Picture::Bytes {
                    width: 2,
                    height: 1,
                    pixel: RawPixel::Gray,
                    values: vec![value; 2],
                };
            });
            assert!(heard);
        }
        pusher
    });
    let mut pusher = camera.join().unwrap();
    // Nobody looked: the newest are left.
    let frames: Vec<Frame> = grabber.frames().take(QUEUE).map(Result::unwrap).collect();
    assert_eq!(grabber.dropped(), 20 - QUEUE as u64);
    for (frame, expected) in frames.iter().zip(20 - QUEUE as u64..) {
        assert_eq!((frame.number, number_in(frame)), (expected, expected));
    }
    let times: Vec<f64> = frames.iter().map(|f| f.time_s.unwrap()).collect();
    assert!(times[0] > 0.0 && times.is_sorted());
    // A picture that was not written is one without pixels, and no ball is in it.
    assert!(pusher.push(|picture| *picture = Picture::default()));
    let empty = grabber.frames().next().unwrap().unwrap();
    assert_eq!(gray(&empty).values().len(), 0);
    drop(grabber);
    assert!(!pusher.push(|_| ()));
}

#[test]
fn the_end_of_a_camera_is_the_end_of_its_frames() {
    let (pusher, mut grabber) = queue(WhenFull::Wait);
    drop(pusher);
    assert!(grabber.frames().next().is_none());
}

/// Frames every 20 ms, without a rate: the spin follows from when they came.
#[test]
fn the_command_knows_when_frames_came() {
    let dir = tempfile::tempdir().unwrap();
    let pattern = crate::common::random_pattern(20, 5);
    pattern.write_csv(&dir.path().join("pattern.csv")).unwrap();
    let images = images();
    let (width, height) = (images[0].width(), images[0].height());
    let raw = format!("{width}x{height},rgb");
    let mut child = Command::new(env!("CARGO_BIN_EXE_spindoe"))
        .args(["live", "--table", "pattern.csv", "-", "--raw", &raw])
        .current_dir(dir.path())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    let mut sent = Vec::new();
    for image in &images {
        std::thread::sleep(Duration::from_millis(60));
        input.write_all(&image.to_bytes()).unwrap();
        input.flush().unwrap();
        sent.push(Instant::now());
    }
    drop(input);
    let lines: Vec<Value> = BufReader::new(child.stdout.take().unwrap())
        .lines()
        .map(|line| serde_json::from_str(&line.unwrap()).unwrap())
        .collect();
    assert!(child.wait().unwrap().success());
    assert_eq!(lines.len(), images.len());
    // The first frames may have waited until the command had started: times are compared with the last one's.
    let time_s = |line: &Value| line["time_s"].as_f64().unwrap();
    let last = (time_s(&lines[7]), sent[7]);
    let mut off: Vec<f64> = lines
        .iter()
        .zip(&sent)
        .take(7)
        .map(|(line, at)| {
            let before = last.1.duration_since(*at).as_secs_f64();
            (last.0 - time_s(line) - before).abs()
        })
        .collect();
    off.sort_by(f64::total_cmp);
    // Half a frame.
    assert!(off[off.len() / 2] < 30e-3, "{off:?}");
}
