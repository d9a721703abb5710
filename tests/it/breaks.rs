//! A break test: what a person, a disk or a network does to files, done at random to every reader.
//!
//! Whatever comes, a reader returns a value or an error of one line; it does not panic, hang or ask
//! for memory without bound. What a reader accepts is used once.
//!
//! A few hundred mutations run with the other tests; `SPINDOE_BREAKS=100000 cargo test --release
//! --test it breaks` runs as many for each reader. `SPINDOE_BREAKS_SEED` chooses others.
//! `SPINDOE_SIGNALS=200` sends as many signals to each command that writes a folder; `SPINDOE_LONG=1000000`
//! takes long files of as many rows.

#[cfg(feature = "vision")]
mod changed;
#[cfg(all(feature = "cli", target_os = "linux"))]
mod endless;
#[cfg(feature = "cli")]
mod extremes;
#[cfg(feature = "cli")]
mod long;
#[cfg(all(feature = "cli", target_os = "linux"))]
mod memory;
#[cfg(feature = "cli")]
mod nonsense;
#[cfg(feature = "cli")]
mod signals;

use std::path::Path;
use std::time::{Duration, Instant};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::ball::Ball;
use spindoe::recognize::Recognizer;
use spindoe::recognize::observed::{self, ObservedReader, observed_frames};
use spindoe::recognize::paper::FeatureTree;
use spindoe::recognize::robust::RobustRecognizer;
use spindoe::spin::orientations::Orientations;
use spindoe::spin::simulate::Scenario;
use spindoe::{Error, Pattern, ProtocolName, RobustConfig, SpinConfig, SpinEstimator};

/// Mutations for each reader among the other tests.
const DEFAULT_RUNS: u64 = 300;
/// Longest that one mutation may take, on a busy machine and without optimization.
const PATIENCE: Duration = Duration::from_secs(20);
/// What people and programs write where a number is expected.
const STRANGE: [&str; 18] = [
    "",
    "0",
    "-0",
    "1",
    "-1",
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e308",
    "1e-320",
    "4294967296",
    "18446744073709551615",
    "9e99999",
    "0x10",
    "1,5",
    "\"",
    "\u{feff}",
];

fn setting(name: &str, default: u64) -> u64 {
    let text = std::env::var(name).ok();
    text.map_or(default, |t| t.parse().expect("a whole number"))
}

/// A damaged copy: bytes changed, removed, repeated, or a number replaced.
fn mutated(bytes: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..rng.random_range(1..4) {
        if out.is_empty() {
            return out;
        }
        let at = rng.random_range(0..out.len());
        let end = (at + rng.random_range(1..40)).min(out.len());
        match rng.random_range(0..7) {
            0 => out[at] ^= 1 << rng.random_range(0..8),
            1 => out[at] = rng.random(),
            2 => out.truncate(at),
            3 => drop(out.drain(at..end)),
            4 => {
                let piece = out[at..end].to_vec();
                out.splice(at..at, piece);
            }
            5 => out[at..end].fill(*[0, 0xff, b'\n', b','].get(at % 4).unwrap_or(&0)),
            _ => {
                // A field of text, as far as the bytes are text.
                let is_field = |b: &u8| b.is_ascii_alphanumeric() || b"+-.".contains(b);
                let from = out[..at]
                    .iter()
                    .rposition(|b| !is_field(b))
                    .map_or(0, |i| i + 1);
                let to = out[at..]
                    .iter()
                    .position(|b| !is_field(b))
                    .map_or(out.len(), |i| at + i);
                let value = STRANGE[rng.random_range(0..STRANGE.len())];
                out.splice(from..to.max(from), value.bytes());
            }
        }
    }
    out
}

/// Reads mutations of `good`, which itself must be read.
fn break_reader(name: &str, good: &[u8], read: impl Fn(&[u8]) -> Result<(), Error>) {
    read(good).unwrap_or_else(|e| panic!("{name}: {e}"));
    let (runs, seed) = (
        setting("SPINDOE_BREAKS", DEFAULT_RUNS),
        setting("SPINDOE_BREAKS_SEED", 1),
    );
    let mut accepted = 0u64;
    for run in 0..runs {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(run);
        let bytes = mutated(good, &mut rng);
        let begun = Instant::now();
        match read(&bytes) {
            Ok(()) => accepted += 1,
            Err(error) => {
                let words = error.to_string();
                let is_line = !words.chars().any(char::is_control);
                assert!(is_line, "{name}, run {run} of seed {seed}: {words:?}");
            }
        }
        let took = begun.elapsed();
        assert!(
            took < PATIENCE,
            "{name}, run {run} of seed {seed}: {took:?}"
        );
    }
    println!("{name}: {accepted} of {runs} mutations are still valid");
}

fn pattern() -> Pattern {
    crate::common::random_pattern(12, 5)
}

#[test]
fn patterns() {
    let path = Path::new("p.csv");
    break_reader("pattern", pattern().to_csv().as_bytes(), |bytes| {
        let read = Pattern::from_csv(path, bytes)?;
        FeatureTree::new(&Ball::new(read)).map(drop)
    });
}

#[test]
fn tables() {
    let path = Path::new("t.npz");
    let bytes = Ball::new(pattern()).to_npz().unwrap();
    break_reader("table", &bytes, |bytes| {
        Ball::from_npz(path, bytes).map(drop)
    });
}

#[test]
fn observed_dots() {
    let pattern = pattern();
    let frames = observed_frames(&pattern, &ProtocolName::Image.view(), 3, 4);
    let recognizer = RobustRecognizer::new(&pattern, RobustConfig::default()).unwrap();
    let text = observed::to_csv(&frames);
    break_reader("observed dots", text.as_bytes(), |bytes| {
        let mut workspace = recognizer.workspace();
        for frame in ObservedReader::new(Path::new("d.csv"), bytes, 0.03)? {
            if let Ok(found) = recognizer.identify(&frame?.dots, &mut workspace) {
                assert!(found.dots_confidence >= 0.0 && found.confidence <= 1.0 + 1e-9);
                assert!(found.rotation.coords.iter().all(|x| x.is_finite()));
            }
        }
        Ok(())
    });
}

#[test]
fn orientations() {
    let sequence = Scenario::default().sequence((40.0, 60.0), 3, 0);
    let text = Orientations::from_measurements(&sequence.measurements).to_csv();
    let mut estimator = SpinEstimator::new(SpinConfig::default());
    let estimator = std::cell::RefCell::new(&mut estimator);
    break_reader("orientations", text.as_bytes(), |bytes| {
        let read = Orientations::read(Path::new("o.csv"), bytes)?;
        if let Ok(fit) = estimator.borrow_mut().fit(&read.measurements()) {
            assert!(fit.motion.spin.iter().all(|x| x.is_finite()));
        }
        Ok(())
    });
}

#[test]
fn checkpoints() {
    use spindoe::design::state::Checkpoint;
    use spindoe::design::{DesignCandidate, DesignConfig, SearchState};
    let pattern = crate::common::random_pattern(8, 5);
    let mut config = DesignConfig {
        dots: 8,
        ..DesignConfig::default()
    };
    config.constraints.min_separation_rad = 0.2;
    let candidate = DesignCandidate {
        start: 0,
        value_before: 2.0,
        value: 1.0,
        cost: 1.0,
        missed: None,
        short_of_goal: false,
        answered: None,
        dots: pattern.dots().iter().map(|d| [d.x, d.y, d.z]).collect(),
    };
    let state = SearchState {
        round: 1,
        pool: vec![candidate],
        ..SearchState::default()
    };
    let bytes = Checkpoint::new(config.clone(), state, None);
    let bytes = bytes.to_json().unwrap();
    break_reader("checkpoint", &bytes, |bytes| {
        let path = Path::new("s.json");
        let read = Checkpoint::from_json(path, bytes)?.resume(path, &config, None)?;
        for candidate in &read.pool {
            candidate.pattern()?;
        }
        Ok(())
    });
}

#[cfg(feature = "vision")]
#[test]
fn pictures() {
    use spindoe::image::Picture;
    let image = image::RgbImage::from_fn(24, 16, |u, v| image::Rgb([u as u8 * 9, v as u8 * 9, 80]));
    for format in [
        image::ImageFormat::Png,
        image::ImageFormat::Jpeg,
        image::ImageFormat::Bmp,
        image::ImageFormat::Tiff,
        image::ImageFormat::Pnm,
    ] {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        break_reader(&format!("{format:?}"), bytes.get_ref(), |bytes| {
            let picture = Picture::decode(Path::new("i"), bytes, 1 << 16)?;
            let image = picture.view()?;
            assert!(image.width() * image.height() <= 1 << 16);
            picture.to_rgb().map(drop)
        });
    }
}

#[cfg(feature = "vision")]
#[test]
fn weights() {
    use spindoe::vision::net::Weights;
    let bytes = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/models/dots.npz")).unwrap();
    break_reader("weights", &bytes, |bytes| {
        Weights::from_npz(Path::new("w.npz"), bytes).map(drop)
    });
}

#[cfg(feature = "vision")]
#[test]
fn times() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("t.csv");
    let text = "frame,time_s\nleft/7.png,0.5\nright/7.png,0.25\n\"8, 9\",1\n";
    break_reader("times", text.as_bytes(), |bytes| {
        std::fs::write(&path, bytes).unwrap();
        spindoe::clip::frame_table::read_times(&path).map(drop)
    });
}

/// What fuzzing has found, once more: `fuzz/` in cargo-fuzz's layout says how to find more.
#[cfg(feature = "vision")]
#[test]
fn the_corpus_of_fuzzing() {
    // Seeds and targets use the rest.
    #[allow(dead_code)]
    #[path = "../../fuzz/src/readers.rs"]
    mod readers;

    let fuzz = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz");
    let mut counts = Vec::new();
    for (name, read) in readers::READERS {
        let inputs = [archived(&fuzz, name), named(&fuzz, name)].concat();
        let accepted = inputs.iter().filter(|(file, bytes)| {
            let begun = Instant::now();
            let is_accepted = readers::check(read, bytes);
            let took = begun.elapsed();
            assert!(took < PATIENCE, "{name}/{file}: {took:?}");
            is_accepted
        });
        let accepted = accepted.count();
        println!("{name}: {accepted} of {} inputs are valid", inputs.len());
        counts.push((name, accepted, inputs.len()));
    }
    // A reader that takes more or less than it did says so here.
    assert_eq!(counts, VALID);
}

/// Inputs of the corpus that each reader takes, of so many.
#[cfg(feature = "vision")]
const VALID: &[(&str, usize, usize)] = &[
    ("table", 2, 80),
    ("pattern", 2, 80),
    ("zones", 1, 80),
    ("observed", 4, 80),
    ("orientations", 6, 80),
    ("times", 1, 80),
    ("circles", 1, 1),
    ("trajectories", 1, 80),
    ("camera", 1, 5),
    ("intrinsics", 3, 3),
    ("weights", 4, 80),
    ("checkpoint", 2, 160),
    ("picture", 8, 80),
    ("pipe", 12, 80),
    ("video", 0, 80),
    ("synth", 1, 80),
    ("report", 1, 1),
];

/// The corpus of a target: an archive of what coverage-guided runs kept.
#[cfg(feature = "vision")]
fn archived(fuzz: &Path, target: &str) -> Vec<(String, Vec<u8>)> {
    let Ok(file) = std::fs::File::open(fuzz.join(format!("corpus/{target}.zip"))) else {
        return Vec::new();
    };
    let mut archive = zip::ZipArchive::new(file).unwrap();
    let count = archive.len();
    let read = |i| {
        let mut entry = archive.by_index(i).unwrap();
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut entry, &mut bytes).unwrap();
        (entry.name().unwrap().into_owned(), bytes)
    };
    (0..count).map(read).collect()
}

/// Inputs with a name: seeds, and what was mended.
#[cfg(feature = "vision")]
fn named(fuzz: &Path, target: &str) -> Vec<(String, Vec<u8>)> {
    let Ok(entries) = std::fs::read_dir(fuzz.join("regressions").join(target)) else {
        return Vec::new();
    };
    let mut files: Vec<_> = entries.map(|e| e.unwrap().path()).collect();
    files.sort();
    let read =
        |path: std::path::PathBuf| (path.display().to_string(), std::fs::read(&path).unwrap());
    files.into_iter().map(read).collect()
}

/// Arguments of all kinds: an exit code of its own, one line, nothing hangs.
#[test]
fn arguments() {
    let dir = tempfile::tempdir().unwrap();
    pattern().write_csv(&dir.path().join("p.csv")).unwrap();
    let sequence = Scenario::default().sequence((40.0, 60.0), 3, 0);
    let orientations = Orientations::from_measurements(&sequence.measurements);
    orientations.write_csv(&dir.path().join("o.csv")).unwrap();
    let commands: [(&[&str], &[&str]); 4] = [
        (&["validate", "p.csv"], &["--samples", "--config", "--seed"]),
        (&["spin", "o.csv"], &["--fps", "--max-spin-rps", "--config"]),
        (&["table", "p.csv", "-o", "t.npz"], &[]),
        (
            &["synth", "--as=orientations", "--frames", "20"],
            &["--rps", "--seed", "--fps", "--config"],
        ),
    ];
    let runs = setting("SPINDOE_BREAKS", DEFAULT_RUNS) / 10;
    for run in 0..runs {
        let mut rng = ChaCha8Rng::seed_from_u64(setting("SPINDOE_BREAKS_SEED", 1));
        rng.set_stream(run);
        let (command, flags) = commands[rng.random_range(0..commands.len())];
        let mut arguments = command.to_vec();
        // Small work unless the value is the one that is too large.
        if command[0] == "validate" {
            arguments.extend(["--samples", "20"]);
        }
        let flags = flags.iter().filter(|f| !arguments.contains(f)).copied();
        let flags: Vec<&str> = flags.collect();
        if !flags.is_empty() {
            arguments.push(flags[rng.random_range(0..flags.len())]);
            arguments.push(STRANGE[rng.random_range(0..STRANGE.len())]);
        }
        let begun = Instant::now();
        let output = crate::common::spindoe(dir.path(), &arguments);
        let words = String::from_utf8_lossy(&output.stderr);
        let code = output.status.code();
        assert!(
            matches!(code, Some(0 | 2 | 3)),
            "{arguments:?}: {code:?} {words}"
        );
        if code != Some(0) {
            let last = words.lines().last().unwrap_or_default();
            assert!(last.starts_with("spindoe: "), "{arguments:?}: {words}");
        }
        assert!(begun.elapsed() < PATIENCE, "{arguments:?}");
    }
}
