//! What each fuzz target does with its input, and what must hold whatever the input is.
//!
//! A reader returns a value or an error of one line; it does not panic, hang or ask for memory
//! without bound. What it accepts is used once. Archives are given as their arrays one after another:
//! mutations then reach the numbers instead of breaking the archive's checksums.

use std::io::{Cursor, Write};
use std::path::Path;

use nalgebra::Matrix2;
use spindoe::image::{Picture, RawPixel};
use spindoe::design::DesignConfig;
use spindoe::design::state::Checkpoint;
use spindoe::recognize::observed::ObservedReader;
use spindoe::recognize::paper::FeatureTree;
use spindoe::report::page::DesignPage;
use spindoe::spin::orientations::Orientations;
use spindoe::spin::trajectories::TrajectorySet;
use spindoe::synth::SynthConfig;
use spindoe::clip::frame_table;
use spindoe::vision::net::Weights;
use spindoe::source::FrameSource;
use spindoe::source::pipe::{PipeFormat, PipeReader};
use spindoe::source::video::{DecoderLog, VideoClock};
use spindoe::vision::{BallCircle, BallView, Camera, Intrinsics, Pixel};
use spindoe::{Ball, Error, Pattern, Result};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// Reads bytes and uses what they hold.
pub type Reader = fn(&[u8]) -> Result<()>;

/// All readers, by the names of their targets.
pub const READERS: [(&str, Reader); 17] = [
    ("table", table),
    ("pattern", pattern),
    ("zones", zones),
    ("observed", observed),
    ("orientations", orientations),
    ("times", times),
    ("circles", circles),
    ("trajectories", trajectories),
    ("camera", camera),
    ("intrinsics", intrinsics),
    ("weights", weights),
    ("checkpoint", checkpoint),
    ("picture", picture),
    ("pipe", pipe),
    ("video", video),
    ("synth", synth),
    ("report", report),
];

/// The dots beside which zones are read.
pub const ZONED_PATTERN: &str = "0,0,1\n1,0,0\n0,1,0\n0.6,-0.8,0\n";
/// Between the parts of an input that stands for several files.
pub const SEPARATOR: u8 = 0;

const MAX_PIXELS: u64 = 1 << 14;
/// The first bytes of an array in an archive.
const NUMPY: &[u8] = b"\x93NUMPY";
const TABLE_ARRAYS: [&str; 6] = [
    "dots",
    "features",
    "bases",
    "feature_dots",
    "meta",
    "dot_covariances",
];

/// Runs a reader; whether it accepts the bytes.
///
/// # Panics
/// Where an error has more than one line.
pub fn check(read: Reader, bytes: &[u8]) -> bool {
    match read(bytes) {
        Ok(()) => true,
        Err(error) => {
            let words = error.to_string();
            assert!(!words.chars().any(char::is_control), "{words:?}");
            false
        }
    }
}

fn table(bytes: &[u8]) -> Result<()> {
    let read = Ball::from_npz(Path::new("t.npz"), &archive(bytes, &TABLE_ARRAYS, &[]))?;
    let again = Ball::from_npz(Path::new("t.npz"), &read.to_npz()?)?;
    assert_eq!(again.pattern().sha256(), read.pattern().sha256());
    Ok(())
}

fn pattern(bytes: &[u8]) -> Result<()> {
    let read = Pattern::from_csv(Path::new("p.csv"), bytes)?;
    let again = Pattern::from_csv(Path::new("p.csv"), read.to_csv().as_bytes())?;
    assert_eq!(again.dots(), read.dots());
    if read.len() > 12 {
        return Ok(());
    }
    FeatureTree::new(&Ball::new(read)).map(drop)
}

fn zones(bytes: &[u8]) -> Result<()> {
    in_folder(
        &[("p.csv", ZONED_PATTERN.as_bytes()), ("p.ball.json", bytes)],
        |folder| Pattern::read_csv(&folder.join("p.csv")).map(drop),
    )
}

fn observed(bytes: &[u8]) -> Result<()> {
    for frame in ObservedReader::new(Path::new("d.csv"), bytes, 0.03)? {
        let frame = frame?;
        assert!(frame.dots.iter().all(|d| d.direction.norm() > 0.9));
        assert!(frame.time_s.is_none_or(f64::is_finite));
    }
    Ok(())
}

fn orientations(bytes: &[u8]) -> Result<()> {
    let read = Orientations::read(Path::new("o.csv"), bytes)?;
    let measurements = read.measurements();
    assert!(measurements.iter().all(|m| m.time_s.is_finite()));
    let _ = read.shared_error();
    let again = Orientations::read(Path::new("o.csv"), read.to_csv().as_bytes())?;
    assert_eq!(again.rows.len(), read.rows.len());
    Ok(())
}

fn times(bytes: &[u8]) -> Result<()> {
    in_folder(&[("t.csv", bytes)], |folder| {
        let read = frame_table::read_times(&folder.join("t.csv"))?;
        let frames = ["a/left/7.png", "a/right/7.png", "8.png"].map(Into::into);
        read.of_frames(&frames).map(drop)
    })
}

fn circles(bytes: &[u8]) -> Result<()> {
    in_folder(&[("c.csv", bytes)], |folder| {
        let read = frame_table::read_circles(&folder.join("c.csv"))?;
        let frames = ["a/left/7.png", "a/right/7.png", "8.png"].map(std::path::PathBuf::from);
        for frame in &frames {
            if let Some(outline) = read.of_frame(frame)? {
                assert!(outline.sigma_px > 0.0 && outline.sigma_px.is_finite());
            }
        }
        read.unused_lines(&frames).map(drop)
    })
}

fn report(bytes: &[u8]) -> Result<()> {
    in_folder(&[("report.json", bytes)], |folder| {
        DesignPage::read(folder).map(drop)
    })
}

fn trajectories(bytes: &[u8]) -> Result<()> {
    let (index, points) = parted(bytes);
    in_folder(&[("index.csv", index), ("001.csv", points)], |folder| {
        let _ = TrajectorySet::read_dir(folder)?.summary();
        Ok(())
    })
}

/// Numbers as the command's arguments give them: intrinsics, a circle, a pixel.
fn camera(bytes: &[u8]) -> Result<()> {
    let numbers = bytes
        .chunks_exact(4)
        .map(|b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    let numbers: Vec<f64> = numbers.collect();
    let &[fx, fy, cx, cy, u, v, radius, at_u, at_v, ..] = numbers.as_slice() else {
        return Ok(());
    };
    let center = Pixel { u, v };
    let circle = BallCircle::new(center, radius);
    for camera in [
        Camera::Perspective(Intrinsics::pinhole(fx, fy, cx, cy)),
        Camera::Near {
            inverse_distance: fx,
        },
        Camera::Orthographic,
    ] {
        let view = BallView::new(&camera, circle)?;
        let pixel = Pixel { u: at_u, v: at_v };
        if let Some(direction) = view.direction(pixel) {
            assert!(
                (direction.norm() - 1.0).abs() < 1e-6,
                "{camera:?} {direction:?}"
            );
            let _ = view.project(&direction);
            let _ = view.back_project(pixel, &Matrix2::identity());
        }
    }
    Ok(())
}

/// A camera's file, and a pixel through its lens.
fn intrinsics(bytes: &[u8]) -> Result<()> {
    let text = String::from_utf8_lossy(bytes);
    let read = Intrinsics::from_text(Path::new("c.yaml"), &text)?;
    let pixel = Pixel { u: 20.0, v: 30.0 };
    if let Some(ray) = read.ray(pixel) {
        assert!(ray.z == -1.0, "{ray:?}");
        let _ = (read.project(&ray), read.jacobian(&ray), read.scale_at(&ray));
    }
    Ok(())
}

fn weights(bytes: &[u8]) -> Result<()> {
    thread_local! {
        static BUILT_IN: Vec<Vec<u8>> = built_in_weights();
    }
    BUILT_IN.with(|built_in| {
        let names = weight_names(built_in.len());
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        Weights::from_npz(Path::new("w.npz"), &archive(bytes, &names, built_in)).map(drop)
    })
}

/// The arrays of the built-in weights: their metadata, then all others.
pub fn built_in_weights() -> Vec<Vec<u8>> {
    let read = || -> Result<Vec<Vec<u8>>> {
        let built_in = Weights::built_in(spindoe::vision::net::graph::Head::Dots)?;
        let bytes = built_in.to_npz()?;
        let names = weight_names(1 + 2 * built_in.layers.len());
        Ok(arrays(&bytes, &names))
    };
    read().unwrap_or_default()
}

/// The bytes of the named arrays in an archive; empty where there is none.
pub fn arrays(archive: &[u8], names: &[String]) -> Vec<Vec<u8>> {
    let mut zip = zip::ZipArchive::new(Cursor::new(archive)).expect("an archive of ours");
    let mut array = |name: &String| {
        let mut bytes = Vec::new();
        if let Ok(mut entry) = zip.by_name(&format!("{name}.npy")) {
            std::io::copy(&mut entry, &mut bytes).expect("an array");
        }
        bytes
    };
    names.iter().map(&mut array).collect()
}

/// The names of a table's arrays, in the order of an input.
pub fn table_names() -> Vec<String> {
    TABLE_ARRAYS.map(str::to_owned).into()
}

fn weight_names(count: usize) -> Vec<String> {
    let layers = count.saturating_sub(1) / 2;
    let layer = |i| {
        [
            format!("convolution_{i:02}_weight"),
            format!("convolution_{i:02}_bias"),
        ]
    };
    let meta = std::iter::once("meta".to_owned());
    meta.chain((0..layers).flat_map(layer)).collect()
}

fn checkpoint(bytes: &[u8]) -> Result<()> {
    let path = Path::new("s.json");
    let file = Checkpoint::from_json(path, bytes)?;
    let shard = file.shard.as_ref().map(|record| record.shard);
    let state = file.resume(path, &search_config(), shard)?;
    for candidate in state
        .scouted
        .iter()
        .chain(&state.climbed)
        .chain(&state.pool)
    {
        candidate.pattern()?;
    }
    Ok(())
}

/// The search that a checkpoint is continued with.
pub fn search_config() -> DesignConfig {
    let mut config = DesignConfig {
        dots: 4,
        ..DesignConfig::default()
    };
    config.constraints.min_separation_rad = 0.2;
    config
}

fn picture(bytes: &[u8]) -> Result<()> {
    let picture = Picture::decode(Path::new("i"), bytes, MAX_PIXELS)?;
    let image = picture.view()?;
    assert!((image.width() * image.height()) as u64 <= MAX_PIXELS);
    picture.to_rgb().map(drop)
}

fn pipe(bytes: &[u8]) -> Result<()> {
    let [kind, width, height, rest @ ..] = bytes else {
        return Ok(());
    };
    let raw = |pixel| PipeFormat::Raw {
        width: usize::from(*width),
        height: usize::from(*height),
        pixel,
    };
    let format = match kind % 4 {
        0 => PipeFormat::Images,
        1 => raw(RawPixel::Gray),
        2 => raw(RawPixel::Rgb),
        _ => raw(RawPixel::Bgr),
    };
    let mut reader = PipeReader::new(rest, "pipe", format, MAX_PIXELS)?;
    reader.frames().try_for_each(|frame| frame?.picture.map(drop))
}

fn video(bytes: &[u8]) -> Result<()> {
    // The pictures come last: they hold the separator too.
    let (log, pictures) = parted(bytes);
    let log = DecoderLog::read(log);
    assert!(log.times.iter().flatten().all(|t| t.is_finite()));
    if let Some(clock) = VideoClock::new(&log.times, log.capture_fps) {
        assert!(
            clock.time_scale() > 0.0 && clock.stored_fps > 0.0,
            "{clock:?}"
        );
    }
    let mut stream = PipeReader::new(pictures, "v", PipeFormat::Images, MAX_PIXELS)?;
    for frame in stream.frames() {
        frame?.picture?.to_rgb()?;
    }
    // As a reader says that ffmpeg gives up.
    Err(Error::input("v", "video", log.last))
}

fn synth(bytes: &[u8]) -> Result<()> {
    let read: SynthConfig = serde_json::from_slice(bytes)
        .map_err(|e| Error::input("s.json", "configuration", e.to_string()))?;
    read.check()
}

/// The parts before and after the first separator.
fn parted(bytes: &[u8]) -> (&[u8], &[u8]) {
    let at = bytes.iter().position(|b| *b == SEPARATOR);
    at.map_or((bytes, &[]), |at| (&bytes[..at], &bytes[at + 1..]))
}

/// An archive: the input itself where it is one, else its arrays under these names; those that it
/// lacks are taken from `others`.
fn archive(bytes: &[u8], names: &[&str], others: &[Vec<u8>]) -> Vec<u8> {
    if bytes.starts_with(b"PK") {
        return bytes.to_vec();
    }
    let mut starts: Vec<usize> = bytes
        .windows(NUMPY.len())
        .enumerate()
        .filter(|(_, window)| *window == NUMPY)
        .map(|(i, _)| i)
        .collect();
    starts.push(bytes.len());
    let given = starts.windows(2).map(|w| &bytes[w[0]..w[1]]);
    let others = others.iter().map(Vec::as_slice).skip(starts.len() - 1);
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, array) in names.iter().zip(given.chain(others)) {
        let written = zip.start_file(format!("{name}.npy"), options);
        written.expect("an entry in memory");
        zip.write_all(array).expect("an entry in memory");
    }
    zip.finish().expect("an archive in memory").into_inner()
}

/// Runs `read` on a folder with these files, in memory where the system has such a place.
fn in_folder(files: &[(&str, &[u8])], read: impl Fn(&Path) -> Result<()>) -> Result<()> {
    thread_local! {
        static FOLDER: tempfile::TempDir = folder();
    }
    FOLDER.with(|folder| {
        for (name, bytes) in files {
            std::fs::write(folder.path().join(name), bytes).expect("a writable folder");
        }
        let result = read(folder.path());
        for (name, _) in files {
            std::fs::remove_file(folder.path().join(name)).expect("a file of ours");
        }
        result
    })
}

fn folder() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    let made = match memory.is_dir() {
        true => tempfile::tempdir_in(memory),
        false => tempfile::tempdir(),
    };
    made.expect("a folder for files")
}
