//! Whole clips: the table that is chosen, mirrors, and that every mode writes the same rows.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use serde_json::Value;
use spindoe::clip::{
    self, BallEstimate, Batch, BatchConfig, BatchFrame, BatchObserver, SequenceOutcome, Work,
};
use spindoe::geometry::CameraFrame;
use spindoe::image::{DEFAULT_MAX_PIXELS, Picture, RgbImage};
use spindoe::source::held::HeldFrames;
use spindoe::spin::orientations::{OrientationReader, Orientations};
use spindoe::vision::{DetectorName, Estimator, EstimatorConfig};

use crate::common::{done, random_pattern, spindoe};

/// Counts how often a frame is estimated.
#[derive(Default)]
struct Counted(AtomicUsize);

impl BatchObserver for Counted {
    type Kept = ();

    fn keep(&self, _: &RgbImage, _: &[BallEstimate]) -> spindoe::Result<()> {
        Ok(())
    }

    fn progress(&self, _: &[BatchFrame]) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

/// What is known of each frame's ball.
fn poses<K>(batch: &Batch<K>) -> Vec<String> {
    let frames = batch.frames.iter().map(|f| f.estimate());
    frames
        .map(|f| format!("{:?} {:?}", f.circle, f.outcome))
        .collect()
}

#[test]
fn the_first_frames_that_show_the_ball_choose_its_table() {
    let dir = tempfile::tempdir().unwrap();
    let shown = 8;
    let make = ["synth", "dots20", "--frames", "8", "--seed", "3", "-o", "c"];
    done(dir.path(), &make);
    // A ball that comes late: more frames without it than are looked at before steps grow.
    let folder = dir.path().join("late");
    std::fs::create_dir(&folder).unwrap();
    let blank = 20;
    for k in 0..blank {
        let image = RgbImage::new(80, 80, vec![[0.4; 3]; 6_400]).unwrap();
        image.write_png(&folder.join(format!("{k}.png"))).unwrap();
    }
    let images = std::fs::read_dir(dir.path().join("c/images")).unwrap();
    let mut images: Vec<PathBuf> = images.map(|entry| entry.unwrap().path()).collect();
    images.sort();
    for (k, image) in images.iter().enumerate() {
        std::fs::copy(image, folder.join(format!("{}.png", blank + k))).unwrap();
    }
    let right = spindoe::pattern::Pattern::read_csv(&dir.path().join("c/pattern.csv")).unwrap();
    let estimator = |pattern: &spindoe::pattern::Pattern| {
        let detector = DetectorName::Cnn.build().unwrap();
        Estimator::new(pattern, EstimatorConfig::default(), detector).unwrap()
    };
    let tables = [random_pattern(20, 5), random_pattern(16, 6), right].map(|p| estimator(&p));
    let config = BatchConfig {
        verdict: true,
        ..BatchConfig::default()
    };
    let inputs = [folder];
    let alone = clip::run(&tables[2], &inputs, &config, &()).unwrap();
    assert!(alone.identified() >= shown - 1, "{:?}", poses(&alone));
    for turn in 0..3 {
        let mut tables = tables.to_vec();
        tables.rotate_left(turn);
        let counted = Counted::default();
        let found = clip::run(Work::Poses(&tables), &inputs, &config, &counted).unwrap();
        assert_eq!(found.judgment.table, 2 - turn);
        assert_eq!(poses(&found), poses(&alone), "{turn}");
        // With the right table from the first frame on, none is estimated twice.
        assert_eq!(counted.0.into_inner(), blank + shown, "{turn}");
    }
}

/// The answers do not depend on where the frames lie: the table, the mirror image, times, poses and spin are those of the files.
#[test]
fn frames_in_memory_are_a_clip_as_files_are() {
    let dir = tempfile::tempdir().unwrap();
    let make = [
        "synth", "dots20", "--frames", "8", "--seed", "3", "--fps", "200", "--rps", "9", "-o", "c",
    ];
    done(dir.path(), &make);
    let images = dir.path().join("c/images");
    let right = spindoe::pattern::Pattern::read_csv(&dir.path().join("c/pattern.csv")).unwrap();
    let tables = [random_pattern(20, 5), right].map(|pattern| {
        let detector = DetectorName::Cnn.build().unwrap();
        Estimator::new(&pattern, EstimatorConfig::default(), detector).unwrap()
    });
    let config = BatchConfig {
        verdict: true,
        ..BatchConfig::default()
    };
    let filed = clip::run(Work::Poses(&tables), &[images], &config, &()).unwrap();
    let times_s: Vec<f64> = filed.frames.iter().filter_map(|f| f.time_s).collect();
    let read = |frame: &BatchFrame<()>| Picture::read(&frame.path, DEFAULT_MAX_PIXELS).unwrap();
    let pictures: Vec<Picture> = filed.frames.iter().map(read).collect();
    let estimate = |pictures: Vec<Picture>, config: &BatchConfig| {
        let held = HeldFrames::new(pictures).at(&times_s).unwrap();
        clip::run_sources(Work::Poses(&tables), &held.into(), config, &()).unwrap()
    };
    let held = estimate(pictures.clone(), &config);
    assert_eq!((filed.judgment.table, held.judgment.table), (1, 1));
    assert_eq!(poses(&held), poses(&filed));
    assert!(held.identified() >= 7 && held.times_s() == filed.times_s());
    let spin = |batch: &Batch<()>| match &batch.sequence {
        SequenceOutcome::Estimated { spin, .. } => spin.as_ref().unwrap().motion.spin,
        other => panic!("{other:?}"),
    };
    assert_eq!(spin(&held), spin(&filed));
    let flipped: Vec<Picture> = pictures
        .into_iter()
        .map(|p| p.mirrored().unwrap())
        .collect();
    let judged = estimate(flipped.clone(), &config);
    assert_eq!(
        (judged.judgment.as_str(), judged.identified()),
        ("mirrored", 0)
    );
    let mirrored = BatchConfig {
        mirrored: true,
        ..config
    };
    assert_eq!(poses(&estimate(flipped, &mirrored)), poses(&filed));
    let few = HeldFrames::new(Vec::<Picture>::new())
        .at(&[0.0])
        .unwrap_err();
    assert!(
        few.is_usage() && few.to_string().contains("times_s"),
        "{few}"
    );
}

/// Two balls, as a camera and as a mirror shows them.
fn two_balls(dir: &Path) {
    let make = [
        "synth",
        "dots20",
        "--also",
        "dots32",
        "--frames",
        "8",
        "--seed",
        "6",
        "--image-size",
        "640x480",
        "--ball-px",
        "60",
        "--rps",
        "20",
    ];
    done(dir, &[&make[..], &["-o", "two"]].concat());
    done(
        dir,
        &[&make[..], &["--config=mirrored=true", "-o", "flipped"]].concat(),
    );
}

const TABLES: [&str; 7] = [
    "estimate",
    "--table",
    "two/table.npz",
    "--table",
    "two/table2.npz",
    "--balls",
    "2",
];

#[test]
fn a_mirrored_clip_of_several_balls_is_named_and_read() {
    let dir = tempfile::tempdir().unwrap();
    two_balls(dir.path());
    let output = spindoe(dir.path(), &[&TABLES[..], &["flipped", "--json"]].concat());
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{words}");
    assert!(words.contains("the images are mirrored (odds "), "{words}");
    let json: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        (&json["verdict"]["verdict"], &json["identified"]),
        (&"mirrored".into(), &0.into())
    );
    let flipped = done(
        dir.path(),
        &[&TABLES[..], &["flipped", "--mirrored"]].concat(),
    );
    let direct = done(dir.path(), &[&TABLES[..], &["two"]].concat());
    // The same pixels, flipped twice.
    assert_eq!(flipped, direct);
    // A ball that carries none of the tables has no pose by accident, and does not spoil the other's.
    let one = [
        "estimate",
        "--table",
        "two/table.npz",
        "--balls",
        "2",
        "two",
        "--json",
    ];
    let json: Value = serde_json::from_str(&done(dir.path(), &one)).unwrap();
    assert_eq!(json["verdict"]["verdict"], "fits");
    let identified = json["balls"].as_array().unwrap().iter();
    let mut identified: Vec<u64> = identified
        .map(|b| b["identified"].as_u64().unwrap())
        .collect();
    identified.sort_unstable();
    assert!(identified.pop() >= Some(7), "{json}");
    assert!(identified.iter().all(|count| *count == 0), "{json}");
}

#[test]
fn what_a_mode_writes_is_one_row_in_every_form() {
    let dir = tempfile::tempdir().unwrap();
    two_balls(dir.path());
    let run = [&TABLES[..], &["two", "--json", "-o", "rows.csv"]].concat();
    let json: Value = serde_json::from_str(&done(dir.path(), &run)).unwrap();
    let path = dir.path().join("rows.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    assert!(header.ends_with(",sd3_z,ball,table"), "{header}");
    let names: Vec<&str> = header.split(',').collect();
    let number = |row: &str, name: &str| {
        let at = names.iter().position(|n| *n == name).unwrap();
        row.split(',').nth(at).unwrap().parse::<f64>().ok()
    };
    let frames = json["frames"].as_array().unwrap().iter();
    let balls: Vec<&Value> = frames
        .flat_map(|f| f["balls"].as_array().unwrap())
        .collect();
    assert_eq!(rows.lines().count(), balls.len());
    for (row, ball) in rows.lines().zip(balls) {
        assert_eq!(number(row, "ball"), ball["ball"].as_f64(), "{row}");
        for (k, name) in ["qw", "qx", "qy", "qz"].into_iter().enumerate() {
            let written = ball["orientation_wxyz"][k].as_f64();
            let is_close = match (number(row, name), written) {
                (Some(a), Some(b)) => (a - b).abs() < 1e-12,
                (a, b) => a == b,
            };
            assert!(is_close, "{name}: {row} {ball}");
        }
    }
    // What is read has what was written, and one ball of it at a time.
    let refused = Orientations::read_csv(&path).unwrap_err().to_string();
    assert!(
        refused.contains("the file holds balls 0 and 1"),
        "{refused}"
    );
    let reader = OrientationReader::new(&path, text.as_bytes()).unwrap();
    let read = Orientations::collect(reader.of_ball(1)).unwrap();
    // Its spin is that of the file, by the same motion.
    let run = [&TABLES[..], &["two", "--motion", "decaying", "--json"]].concat();
    let decaying: Value = serde_json::from_str(&done(dir.path(), &run)).unwrap();
    for (motion, json) in [("auto", &json), ("decaying", &decaying)] {
        let run = [
            "spin", "rows.csv", "--ball", "1", "--motion", motion, "--json",
        ];
        let spin: Value = serde_json::from_str(&done(dir.path(), &run)).unwrap();
        let ball = &json["balls"][1]["spin"];
        assert_eq!(ball["motion"], spin["motion"], "{motion}");
        let [ours, theirs] = [ball, &spin].map(|s| s["rps"].as_f64().unwrap());
        assert!((ours - theirs).abs() < 1e-9, "{motion}: {ours} {theirs}");
    }
    assert!(read.columns.ball && read.columns.table && !read.columns.flash);
    assert_eq!(read.camera_frame, Some(CameraFrame::View));
    assert!(read.rows.iter().all(|row| row.ball == Some(1)));
    let own = read.to_csv();
    let mut lines = own.lines();
    assert_eq!(lines.next(), Some(header));
    let of_ball = rows.lines().filter(|row| number(row, "ball") == Some(1.0));
    for (again, row) in lines.zip(of_ball) {
        // The residual in degrees is stored in radians.
        let rest = |row: &str| row.split(',').skip(9).collect::<Vec<_>>().join(",");
        assert_eq!(rest(again), rest(row));
    }
}

#[test]
fn a_mirrored_stream_is_read_as_its_camera_saw_it() {
    let dir = tempfile::tempdir().unwrap();
    let lines = |name: &str, flags: &[&str]| {
        let make = [
            "synth", "dots20", "--frames", "5", "--seed", "4", "-o", name,
        ];
        let mirror = if flags.is_empty() {
            &[][..]
        } else {
            &["--config=mirrored=true"]
        };
        done(dir.path(), &[&make[..], mirror].concat());
        let images = std::fs::read_dir(dir.path().join(name).join("images")).unwrap();
        let mut images: Vec<PathBuf> = images.map(|entry| entry.unwrap().path()).collect();
        images.sort();
        let bytes = images.iter().map(|image| std::fs::read(image).unwrap());
        let stream = bytes.collect::<Vec<_>>().concat();
        std::fs::write(dir.path().join("stream"), stream).unwrap();
        let table = format!("{name}/table.npz");
        let live = ["live", "--table", &table, "stream", "--fps", "350"];
        let text = done(dir.path(), &[&live[..], flags].concat());
        let frame = |line: &str| {
            let mut json: Value = serde_json::from_str(line).unwrap();
            json["latency_ms"] = Value::Null;
            json
        };
        text.lines().map(frame).collect::<Vec<_>>()
    };
    let direct = lines("c", &[]);
    assert!(
        direct
            .iter()
            .filter(|l| l["confidence"].is_number())
            .count()
            >= 4
    );
    assert_eq!(lines("m", &["--mirrored"]), direct);
}

#[test]
fn dark_balls_with_bright_dots_are_read_as_negatives() {
    let dir = tempfile::tempdir().unwrap();
    let make = ["synth", "dots20", "--frames", "4", "--seed", "4", "-o", "c"];
    done(dir.path(), &make);
    let folder = dir.path().join("dark");
    std::fs::create_dir(&folder).unwrap();
    let mut images: Vec<PathBuf> = std::fs::read_dir(dir.path().join("c/images"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    images.sort();
    let mut stream = Vec::new();
    for path in &images {
        // Made by another library.
        let mut negative = image::open(path).unwrap();
        negative.invert();
        let to = folder.join(path.file_name().unwrap());
        negative.save(&to).unwrap();
        stream.extend(std::fs::read(to).unwrap());
    }
    std::fs::write(dir.path().join("stream"), stream).unwrap();
    let bright = ["--config", "bright_dots=true"];
    let rows = |images: &str, flags: &[&str]| {
        let asked = ["estimate", "--table", "c/table.npz", images];
        done(dir.path(), &[&asked[..], flags].concat())
    };
    let direct = rows("c/images", &[]);
    assert_eq!(direct.lines().count(), 5, "{direct}");
    assert_eq!(rows("dark", &bright), direct);
    // As they are they show no dots, and the reason says what to do.
    let asked = ["estimate", "--table", "c/table.npz", "dark"];
    let output = spindoe(dir.path(), &asked);
    assert_eq!(output.status.code(), Some(3));
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(error.contains("bright_dots=true"), "{error}");
    // Where there is no ball that is no reason.
    let empty = dir.path().join("empty.png");
    let gray = RgbImage::new(80, 80, vec![[0.4; 3]; 6_400]).unwrap();
    gray.write_png(&empty).unwrap();
    let asked = ["estimate", "--table", "c/table.npz", "empty.png"];
    let output = spindoe(dir.path(), &asked);
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(!error.contains("bright_dots"), "{error}");
    // A stream likewise.
    let live = ["live", "--table", "c/table.npz", "stream", "--fps", "350"];
    let lines = done(dir.path(), &[&live[..], &bright].concat());
    let poses = lines.lines().map(|line| {
        let line: Value = serde_json::from_str(line).unwrap();
        usize::from(line["confidence"].is_number())
    });
    assert_eq!(poses.sum::<usize>(), 4, "{lines}");
}
