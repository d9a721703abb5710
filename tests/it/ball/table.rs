//! The table's file: what is written reads back, NumPy reads it, and nothing tampered with loads.

use std::collections::BTreeMap;
use std::io::{Cursor, Read, Write};
use std::path::Path;
use std::process::Command;

use npyz::{AutoSerialize, Order, WriterBuilder};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;
use spindoe::Error;
use spindoe::ball::{Ball, CalibrationRecord, DesignRecord, Feature, ObjectiveRecord, PairRule};
use spindoe::geometry::tangent_frame;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Array name -> `.npy` bytes.
type Entries = BTreeMap<String, Vec<u8>>;

fn table() -> Ball {
    let pattern = crate::common::random_pattern(7, 4);
    let mut table = Ball::new(pattern);
    table.set_objective(Some(ObjectiveRecord {
        name: "mean nearest distance".into(),
        value: 0.1 + 0.2,
    }));
    table.set_validation(Some(json!({"identity": {"rate": 0.987}, "seed": 7})));
    table
}

fn unpack(bytes: &[u8]) -> Entries {
    let mut archive = ZipArchive::new(Cursor::new(bytes)).expect("a zip");
    let mut entries = Entries::new();
    for i in 0..archive.len() {
        let mut entry = archive.by_index(i).expect("an entry");
        let name = entry
            .name()
            .expect("a name")
            .trim_end_matches(".npy")
            .to_owned();
        let mut npy = Vec::new();
        entry.read_to_end(&mut npy).expect("unpacks");
        entries.insert(name, npy);
    }
    entries
}

fn pack(entries: &Entries, method: CompressionMethod) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, npy) in entries {
        let options = SimpleFileOptions::default().compression_method(method);
        zip.start_file(format!("{name}.npy"), options)
            .expect("starts");
        zip.write_all(npy).expect("writes");
    }
    zip.finish().expect("finishes").into_inner()
}

fn npy<T: AutoSerialize + Copy>(shape: &[u64], order: Order, items: &[T]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = npyz::WriteOptions::new()
        .default_dtype()
        .order(order)
        .shape(shape)
        .writer(&mut bytes)
        .begin_nd()
        .expect("starts");
    writer.extend(items.iter().copied()).expect("writes");
    writer.finish().expect("finishes");
    bytes
}

/// An `.npy` with a header text of one's own.
fn raw_npy(header: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

fn load(bytes: &[u8]) -> spindoe::Result<Ball> {
    Ball::from_npz(Path::new("t.npz"), bytes)
}

/// Loads `table()` with one array replaced, and checks that the error names `place`.
fn refused(array: &str, npy: Vec<u8>, place: &str, problem: &str) {
    let mut entries = unpack(&table().to_npz().expect("packs"));
    entries.insert(array.to_owned(), npy);
    refused_entries(&entries, place, problem);
}

fn refused_entries(entries: &Entries, place: &str, problem: &str) {
    let error = load(&pack(entries, CompressionMethod::Stored)).expect_err("refused");
    check_error(&error, place, problem);
}

fn check_error(error: &Error, place: &str, problem: &str) {
    let text = error.to_string();
    assert!(matches!(error, Error::Input { .. }), "{error:?}");
    assert!(text.starts_with(&format!("t.npz: {place}: ")), "{text}");
    assert!(text.contains(problem), "{text}");
    assert!(!text.contains('\n'), "{text}");
}

/// The features that the ball's file holds.
fn features(ball: &Ball) -> Vec<Feature> {
    let dots = ball.pattern().dots();
    ball.pair_rule().features(dots).collect()
}

fn values(ball: &Ball) -> Vec<[f64; 3]> {
    features(ball).iter().map(|f| f.value).collect()
}

fn flat<const N: usize>(rows: &[[f64; N]]) -> Vec<f64> {
    rows.iter().flatten().copied().collect()
}

/// Bit for bit the same.
fn same(a: &Ball, b: &Ball) {
    assert_eq!(a, b);
    let bits = |ball: &Ball| -> Vec<u64> {
        let coordinates = ball.pattern().dots().iter().flatten();
        coordinates.map(|x| x.to_bits()).collect()
    };
    assert_eq!(bits(a), bits(b));
}

#[test]
fn what_is_written_reads_back_bit_for_bit() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("table.npz");
    let tables = [
        table(),
        Ball::new(crate::common::random_pattern(20, 9))
            .with_pair_rule(PairRule::ALL)
            .expect("a rule"),
    ];
    for table in tables {
        table.write_npz(&path).expect("writes");
        let read = Ball::read_npz(&path).expect("reads");
        same(&table, &read);
        assert_eq!(
            table.to_npz().expect("packs"),
            read.to_npz().expect("packs")
        );
    }
}

/// The tables that ship, of several releases, are what this code writes.
#[test]
fn a_shipped_table_is_written_again_as_it_was() {
    let designs = Path::new(env!("CARGO_MANIFEST_DIR")).join("designs");
    let (mut read, mut same) = (0, 0);
    for entry in std::fs::read_dir(designs).expect("the designs") {
        let path = entry.expect("an entry").path().join("table.npz");
        let Ok(bytes) = std::fs::read(&path) else {
            continue;
        };
        let again = load(&bytes).expect("reads").to_npz().expect("packs");
        let mut entries = unpack(&bytes);
        // Version 0.1 spelled a key of the metadata otherwise.
        let meta = entries.get_mut("meta").expect("metadata");
        let key = b"recogniser";
        match meta.windows(key.len()).position(|w| w == key) {
            Some(at) => meta[at..at + key.len()].copy_from_slice(b"recognizer"),
            None => {
                assert!(bytes == again, "{}", path.display());
                same += 1;
            }
        }
        assert!(entries == unpack(&again), "{}", path.display());
        read += 1;
    }
    assert!(read >= 8 && same >= 2, "{same} of {read}");
}

#[test]
fn a_ball_reads_from_a_table_a_pattern_and_a_folder_with_either() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let error = Ball::read(dir.path()).expect_err("an empty folder");
    assert!(
        error.to_string().contains("table.npz or pattern.csv"),
        "{error}"
    );

    let axis = spindoe::Vec3::z();
    let zone = spindoe::KeepOut {
        axis,
        half_angle_rad: 0.2,
    };
    let dots = crate::common::random_pattern(14, 4).dots().to_vec();
    let clear = dots.into_iter().filter(|d| d.dot(&axis) < 0.9).collect();
    let pattern = spindoe::Pattern::new(clear).expect("some dots are left");
    let pattern = pattern.with_keep_out(vec![zone]).expect("no dot within");
    pattern.write_csv(&at("pattern.csv")).expect("writes");
    let plain = Ball::new(pattern);
    assert_eq!(Ball::read(&at("pattern.csv")).expect("reads"), plain);
    assert_eq!(Ball::read(dir.path()).expect("reads"), plain);

    table().write_npz(&at("table.npz")).expect("writes");
    assert_eq!(Ball::read(&at("table.npz")).expect("reads"), table());
    assert_eq!(Ball::read(dir.path()).expect("reads"), table());
    // An archive by its content, whatever its name.
    std::fs::rename(at("table.npz"), at("ball")).expect("renames");
    assert_eq!(Ball::read(&at("ball")).expect("reads"), table());
}

/// A ball designed for dots of 5.2 mm on 42 mm.
fn designed() -> Ball {
    let record = DesignRecord {
        ball_diameter_mm: 42.0,
        dot_diameter_mm: 5.2,
        camera: Some(json!({"ball_px": 45.5, "fps": 240})),
        criterion: Some("identity, protocol sparse".into()),
    };
    table().with_design(Some(record)).expect("sizes")
}

#[test]
fn what_a_design_knows_comes_back_from_every_form() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let ball = designed();
    ball.write_csv(&at("pattern.csv")).expect("writes");
    ball.write_npz(&at("alone.npz")).expect("writes");
    for form in ["pattern.csv", "alone.npz", "."] {
        let read = Ball::read(&at(form)).expect("reads");
        assert_eq!(read.design(), ball.design(), "{form}");
        assert_eq!(read.pattern(), ball.pattern(), "{form}");
    }
    // As other programs find it.
    let text = std::fs::read_to_string(at("pattern.ball.json")).expect("reads");
    let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(json["design"]["dot_diameter_mm"], 5.2);
    assert_eq!(json["pattern_sha256"], ball.pattern().sha256());
    let shipped = Ball::read("dots12".as_ref()).expect("reads");
    let sizes = shipped
        .design()
        .map(|d| [d.ball_diameter_mm, d.dot_diameter_mm]);
    assert_eq!(sizes, Some([40.0, 6.0]));
    // A pattern by itself takes away what belonged to another.
    ball.pattern()
        .write_csv(&at("pattern.csv"))
        .expect("writes");
    assert_eq!(
        Ball::read(&at("pattern.csv")).expect("reads").design(),
        None
    );
    assert!(!at("pattern.ball.json").exists());
}

#[test]
fn files_from_before_designs_were_recorded_still_read() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    let zone = |z: f64| {
        json!({
            "format_version": 1,
            "pattern_sha256": table().pattern().sha256(),
            "keep_out": [{"axis": [0.0, 0.0, z], "half_angle_rad": 1e-3}],
        })
        .to_string()
    };
    table().pattern().write_csv(&at("p.csv")).expect("writes");
    std::fs::write(at("p.zones.json"), zone(1.0)).expect("writes");
    let read = Ball::read(&at("p.csv")).expect("reads");
    assert_eq!(read.pattern().keep_out().len(), 1);
    assert_eq!(read.design(), None);
    // Writing leaves one file.
    read.write_csv(&at("p.csv")).expect("writes");
    assert!(at("p.ball.json").exists() && !at("p.zones.json").exists());
    assert_eq!(Ball::read(&at("p.csv")).expect("reads"), read);
    let text = String::from_utf8_lossy(&table().to_npz().expect("packs")).into_owned();
    assert!(
        !text.contains("design"),
        "a table without a record is as before"
    );
}

#[test]
fn sizes_that_cannot_be_are_rejected_with_their_place() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = |name: &str| dir.path().join(name);
    for (ball, dot, place) in [
        (40.0, 41.0, "dot_diameter_mm"),
        (40.0, -1.0, "dot_diameter_mm"),
        (0.0, 4.0, "ball_diameter_mm"),
    ] {
        let record = DesignRecord {
            ball_diameter_mm: ball,
            dot_diameter_mm: dot,
            camera: None,
            criterion: None,
        };
        assert!(table().with_design(Some(record)).is_err());
        table().pattern().write_csv(&at("p.csv")).expect("writes");
        let text = json!({
            "format_version": 2,
            "pattern_sha256": table().pattern().sha256(),
            "design": {"ball_diameter_mm": ball, "dot_diameter_mm": dot},
        });
        std::fs::write(at("p.ball.json"), text.to_string()).expect("writes");
        let error = Ball::read(&at("p.csv"))
            .expect_err("no such sizes")
            .to_string();
        assert!(
            error.contains("p.ball.json") && error.contains(place),
            "{error}"
        );
    }
}

#[test]
fn sizes_follow_the_design_unless_they_are_stated() {
    let (plain, designed) = (table(), designed());
    // Nothing is known: table tennis, and dots of a tenth of the ball.
    assert_eq!(plain.sizes_mm(None, None), [40.0, 4.0]);
    assert_eq!(plain.sizes_mm(Some(220.0), None), [220.0, 22.0]);
    assert_eq!(plain.sizes_mm(Some(220.0), Some(9.5)), [220.0, 9.5]);
    assert_eq!(designed.sizes_mm(None, None), [42.0, 5.2]);
    assert_eq!(designed.sizes_mm(None, Some(3.3)), [42.0, 3.3]);
    // 84 / 42 as large, and 5.2 * 42.3 / 42 = 5.237.
    assert_eq!(designed.sizes_mm(Some(84.0), None), [84.0, 10.4]);
    assert_eq!(designed.sizes_mm(Some(42.3), None), [42.3, 5.2]);
}

#[test]
fn shipped_designs_are_read_by_their_names_unless_there_is_such_a_file() {
    let shipped = spindoe::pattern::shipped_designs().expect("they read");
    assert!(shipped.iter().any(|s| s.name == "dots40"));
    for spindoe::pattern::NamedPattern {
        name,
        pattern,
        design,
    } in shipped
    {
        assert_eq!(
            Ball::read(name.as_ref()).expect("reads"),
            Ball::new(pattern).with_design(design).expect("sizes")
        );
    }
    // A folder of that name that holds no design shadows none; one that holds a pattern does.
    let dir = tempfile::tempdir().expect("a folder");
    std::fs::create_dir(dir.path().join("dots20")).expect("a folder");
    crate::common::done(dir.path(), &["validate", "dots20", "--samples", "1"]);
    std::fs::write(dir.path().join("dots20/pattern.csv"), "1,0,0\n").expect("a file");
    let refused = crate::common::spindoe(dir.path(), &["validate", "dots20", "--samples", "1"]);
    assert_eq!(refused.status.code(), Some(2));
    let error = Ball::read("dots41".as_ref()).expect_err("no such design");
    assert!(error.to_string().contains("dots41"), "{error}");
}

#[test]
fn the_paper_s_recognizer_is_recorded_as_it_is() {
    use spindoe::recognize::paper::{PaperConfig, VoteSum};
    let config = PaperConfig {
        k: 7,
        vote_sum: VoteSum::Density,
        ..PaperConfig::default()
    };
    let ball = table().with_recognizer(config).expect("valid");
    let read = load(&ball.to_npz().expect("packs")).expect("reads");
    assert_eq!(*read.recognizer(), config);
    let recorded = |ball: &Ball| serde_json::to_value(ball.meta().recognizer).expect("JSON");
    assert_eq!(recorded(&ball)["k"], 7);
    // What is the paper's own needs no word: older readers know none of it.
    assert_eq!(recorded(&table()).as_object().expect("fields").len(), 5);
}

#[test]
fn packed_and_fortran_ordered_and_big_endian_arrays_load() {
    let table = table();
    let mut entries = unpack(&table.to_npz().expect("packs"));
    same(
        &table,
        &load(&pack(&entries, CompressionMethod::Deflated)).expect("loads"),
    );

    let m = features(&table).len();
    let columns: Vec<f64> = (0..3)
        .flat_map(|c| values(&table).into_iter().map(move |f| f[c]))
        .collect();
    entries.insert(
        "features".into(),
        npy(&[m as u64, 3], Order::Fortran, &columns),
    );
    let dots: Vec<u8> = table
        .pattern()
        .dots()
        .iter()
        .flat_map(|d| [d.x, d.y, d.z])
        .flat_map(f64::to_be_bytes)
        .collect();
    let header = "{'descr': '>f8', 'fortran_order': False, 'shape': (7, 3), }\n";
    entries.insert("dots".into(), raw_npy(header, &dots));
    same(
        &table,
        &load(&pack(&entries, CompressionMethod::Stored)).expect("loads"),
    );
}

#[test]
fn numpy_reads_what_is_written() {
    let probe = Command::new("python3")
        .args(["-c", "import numpy"])
        .output();
    if !probe.is_ok_and(|p| p.status.success()) {
        crate::common::skipped("python3 with numpy is not installed");
        return;
    }
    let table = table();
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("table.npz");
    table.write_npz(&path).expect("writes");
    let script = "
import json, sys, numpy as np
t = np.load(sys.argv[1])
assert sorted(t.files) == ['bases', 'dots', 'feature_dots', 'features', 'meta'], t.files
d, f, b, k = t['dots'], t['features'], t['bases'], t['feature_dots']
assert d.dtype == np.float64 and f.dtype == np.float64
assert b.dtype == np.uint16 and k.dtype == np.uint16 and t['meta'].dtype == np.uint8
x, y, z = d[b[:, 0]], d[b[:, 1]], d[k]
n = np.cross(x, y)
assert np.allclose(f[:, :1] * x + f[:, 1:2] * y + f[:, 2:] * n, z, atol=1e-11)
meta = json.loads(t['meta'].tobytes())
print(len(f), meta['format_version'], meta['objective']['value'])
# And the other way round: what NumPy writes, packed, must load.
np.savez_compressed(sys.argv[2], **{a: t[a] for a in t.files})
";
    let theirs = dir.path().join("numpy.npz");
    let output = Command::new("python3")
        .args(["-c", script])
        .args([&path, &theirs])
        .output()
        .expect("runs");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let expected = format!("{} 1 {}\n", features(&table).len(), 0.1 + 0.2);
    assert_eq!(String::from_utf8_lossy(&output.stdout), expected);
    same(&table, &Ball::read_npz(&theirs).expect("reads"));
}

#[test]
fn tampered_dots_are_refused() {
    let dots: Vec<[f64; 3]> = table()
        .pattern()
        .dots()
        .iter()
        .map(|d| [d.x, d.y, d.z])
        .collect();
    let with = |change: fn(&mut Vec<[f64; 3]>)| {
        let mut dots = dots.clone();
        change(&mut dots);
        npy(&[dots.len() as u64, 3], Order::C, &flat(&dots))
    };
    refused("dots", with(|d| d[2][1] = f64::NAN), "dots", "dot 2");
    refused("dots", with(|d| d[2][1] = f64::INFINITY), "dots", "dot 2");
    refused(
        "dots",
        with(|d| d[3] = d[3].map(|x| x * 0.5)),
        "dots",
        "dot 3",
    );
    refused(
        "dots",
        with(|d| d[3] = d[3].map(|x| x * (1.0 + 1e-9))),
        "dots",
        "dot 3",
    );
    refused("dots", with(|d| d[4] = d[0]), "dots", "coincides");
    refused("dots", with(|d| d.truncate(3)), "dots", "4 to 64");
    refused("dots", with(|d| d.swap(0, 1)), "meta", "pattern_sha256");
    refused("dots", with(|d| d.truncate(6)), "meta", "pattern_sha256");
    refused(
        "dots",
        npy(&[21], Order::C, &flat(&dots)),
        "dots",
        "expected shape (rows, 3)",
    );
    refused(
        "dots",
        npy(&[3, 7], Order::C, &flat(&dots)),
        "dots",
        "expected shape",
    );
    refused(
        "dots",
        npy(&[7, 3], Order::C, &[1.0f32; 21]),
        "dots",
        "expected type f64",
    );
}

#[test]
fn tampered_columns_are_refused() {
    let table = table();
    let m = features(&table).len();
    let rows = m as u64;
    let with = |change: fn(&mut Vec<[f64; 3]>)| {
        let mut f = values(&table);
        change(&mut f);
        npy(&[f.len() as u64, 3], Order::C, &flat(&f))
    };
    refused("features", with(|f| f[17][0] += 1e-6), "features", "row 17");
    refused(
        "features",
        with(|f| f[5][2] = f64::NAN),
        "features",
        "row 5",
    );
    refused("features", with(|f| f.swap(0, 1)), "features", "row 0");
    refused(
        "features",
        with(|f| f.truncate(9)),
        "features",
        "rows, found 9",
    );
    refused("features", with(|f| f.clear()), "features", "rows, found 0");

    let pairs: Vec<u16> = features(&table)
        .iter()
        .flat_map(|f| [f.basis.first, f.basis.second])
        .collect();
    let bases = |at: usize, value: u16| {
        let mut pairs = pairs.clone();
        pairs[at] = value;
        npy(&[rows, 2], Order::C, &pairs)
    };
    refused("bases", bases(6, 7), "bases", "row 3: dot 7 does not exist");
    refused("bases", bases(6, 65535), "bases", "row 3");
    refused("bases", bases(6, 5), "bases", "row 3");
    refused(
        "bases",
        npy(&[rows - 1, 2], Order::C, &pairs[2..]),
        "bases",
        "rows, found",
    );
    refused(
        "bases",
        npy(&[rows, 2], Order::C, &vec![0i64; 2 * m]),
        "bases",
        "expected type u16",
    );

    let thirds = features(&table).iter().map(|f| f.dot).collect::<Vec<u16>>();
    let dots = |at: usize, value: u16| {
        let mut thirds = thirds.clone();
        thirds[at] = value;
        npy(&[rows], Order::C, &thirds)
    };
    refused(
        "feature_dots",
        dots(4, 7),
        "feature_dots",
        "row 4: dot 7 does not exist",
    );
    refused("feature_dots", dots(4, 0), "feature_dots", "row 4");
    refused(
        "feature_dots",
        npy(&[rows - 1], Order::C, &thirds[1..]),
        "feature_dots",
        "rows, found",
    );
}

fn calibrated() -> Ball {
    let plain = table();
    let covariances = plain.pattern().dots().iter().map(|d| {
        let [e1, e2] = tangent_frame(d);
        let (a, b) = (e1 * 0.01, (e1 + e2) * 0.003);
        a * a.transpose() + b * b.transpose()
    });
    let covariances = covariances.collect();
    let record = CalibrationRecord {
        nominal_sha256: Some("00".repeat(32)),
        nominal_numbers: vec![Some(0), Some(2), None, Some(3), Some(4), Some(5), Some(6)],
        views: vec![12, 0, 4, 5, 6, 7, 8],
    };
    plain.with_calibration(covariances, record).expect("fits")
}

#[test]
fn a_calibrated_table_reads_back_and_has_a_version_of_its_own() {
    let calibrated = calibrated();
    let bytes = calibrated.to_npz().expect("packs");
    let back = Ball::from_npz(Path::new("t.npz"), &bytes).expect("reads");
    assert_eq!(back.meta(), calibrated.meta());
    assert_eq!(back.meta().format_version, 2);
    assert_eq!(back.dot_covariances(), calibrated.dot_covariances());
    // A table without a calibration is what older readers know.
    let plain = table();
    let text = String::from_utf8_lossy(&plain.to_npz().expect("packs")).into_owned();
    assert!(text.contains("\"format_version\":1") && !text.contains("calibration"));
}

#[test]
fn tampered_covariances_are_refused() {
    let entries = unpack(&calibrated().to_npz().expect("packs"));
    let refused = |name: &str, array: Option<Vec<u8>>, words: &str| {
        let mut entries = entries.clone();
        match array {
            Some(array) => entries.insert(name.to_owned(), array),
            None => entries.remove(name),
        };
        let bytes = pack(&entries, CompressionMethod::Stored);
        let error = Ball::from_npz(Path::new("t.npz"), &bytes).expect_err("tampered");
        assert!(error.to_string().contains(words), "{error}");
    };
    let flat: Vec<f64> = calibrated()
        .dot_covariances()
        .expect("calibrated")
        .iter()
        .flatten()
        .copied()
        .collect();
    let with = |at: usize, value: f64| {
        let mut flat = flat.clone();
        flat[at] = value;
        Some(npy(&[7, 3, 3], Order::C, &flat))
    };
    refused("dot_covariances", None, "dot_covariances");
    refused("dot_covariances", with(0, f64::NAN), "dot 0");
    refused("dot_covariances", with(9, -1.0), "dot 1");
    refused("dot_covariances", with(10, 0.5), "dot 1");
    let short = Some(npy(&[6, 3, 3], Order::C, &flat[9..]));
    refused("dot_covariances", short, "expected shape (7, 3, 3)");
    // The array in a table of the first version.
    let mut plain = unpack(&table().to_npz().expect("packs"));
    plain.insert("dot_covariances".into(), entries["dot_covariances"].clone());
    let bytes = pack(&plain, CompressionMethod::Stored);
    let error = Ball::from_npz(Path::new("t.npz"), &bytes).expect_err("version 1");
    assert!(
        error.to_string().contains("format_version 2 only"),
        "{error}"
    );
}

#[test]
fn tampered_metadata_is_refused() {
    let meta = serde_json::to_value(table().meta()).expect("JSON");
    let with = |pointer: &str, value: serde_json::Value| {
        let mut meta = meta.clone();
        *meta.pointer_mut(pointer).expect("a field") = value;
        let text = meta.to_string();
        npy(&[text.len() as u64], Order::C, text.as_bytes())
    };
    let text = |text: &str| npy(&[text.len() as u64], Order::C, text.as_bytes());
    refused("meta", with("/format_version", json!(3)), "meta", "found 3");
    let uncalibrated = with("/format_version", json!(2));
    refused("meta", uncalibrated, "meta", "expected a calibration");
    refused(
        "meta",
        with("/format_version", json!("1")),
        "meta",
        "found none",
    );
    refused(
        "meta",
        with("/pattern_sha256", json!("00")),
        "meta",
        "pattern_sha256",
    );
    refused(
        "meta",
        with("/pair_rule/min_cross", json!(0.0)),
        "meta",
        "min_cross",
    );
    refused(
        "meta",
        with("/pair_rule/max_angle_rad", json!(9.0)),
        "meta",
        "max_angle_rad",
    );
    refused(
        "meta",
        with("/pair_rule/max_angle_rad", json!(1.0)),
        "features",
        "pair rule",
    );
    refused(
        "meta",
        with("/recognizer/alpha", json!(-1.0)),
        "meta",
        "alpha",
    );
    refused(
        "meta",
        with("/recognizer/beta", json!(300.0)),
        "meta",
        "beta",
    );
    refused("meta", with("/recognizer", json!({})), "meta", "sigma_rad");
    refused("meta", text("{"), "meta", "not JSON");
    refused("meta", text("[]"), "meta", "format_version");
    refused("meta", text(&"[".repeat(100_000)), "meta", "not JSON");
    refused("meta", npy(&[1], Order::C, &[255u8]), "meta", "not JSON");
}

#[test]
fn hostile_headers_are_refused() {
    let header = |descr: &str, shape: &str| {
        format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n")
    };
    let f8 = "'<f8'";
    let cases = [
        (header(f8, "(4611686018427387904, 3)"), "header"),
        (header(f8, "(0xffffffffffffffff, 3)"), "header"),
        (header(f8, "(99999999999, 3)"), "ends before"),
        (header(f8, "(-7, 3)"), "negative"),
        (header(f8, "(7, 3, 1)"), "expected shape"),
        (header(f8, "()"), "expected shape"),
        (header(f8, "7"), "shape"),
        (header("'|O'", "(7, 3)"), "expected type"),
        (header("'<f99999999'", "(7, 3)"), "not an array"),
        (header("[('a', '<f8')]", "(7, 3)"), "expected type"),
        ("(".repeat(1000), "header"),
        ("[".repeat(60000), "header"),
        ("{}".to_owned(), "missing key"),
        (String::new(), "not an array"),
    ];
    for (header, problem) in cases {
        refused("dots", raw_npy(&header, &[0; 168]), "dots", problem);
    }
    refused("dots", Vec::new(), "dots", "no NumPy header");
    refused(
        "dots",
        b"\x93NUMPY\x01\x00\xff\x00{".to_vec(),
        "dots",
        "ends within",
    );
    refused(
        "dots",
        b"\x93NUMPY\x02\x00\xff\xff\xff\xff{".to_vec(),
        "dots",
        "too long",
    );
    let mut long = unpack(&table().to_npz().expect("packs"))["dots"].clone();
    long.push(0);
    refused("dots", long, "dots", "follow the array's end");
}

#[test]
fn archives_with_other_contents_are_refused() {
    let entries = unpack(&table().to_npz().expect("packs"));
    for name in ["dots", "features", "bases", "feature_dots", "meta"] {
        let mut less = entries.clone();
        less.remove(name);
        refused_entries(&less, name, "cannot be read");
    }
    let mut more = entries.clone();
    more.insert("extra".into(), npy(&[1], Order::C, &[1u8]));
    refused_entries(&more, "archive", "unexpected entry \"extra.npy\"");

    // Unpacks to 40 MiB from a few kilobytes.
    let mut bomb = entries;
    bomb.insert("dots".into(), vec![0; 40 << 20]);
    let error = load(&pack(&bomb, CompressionMethod::Deflated)).expect_err("refused");
    check_error(&error, "dots", "larger than 32 MiB");
}

#[test]
fn truncated_and_corrupt_files_are_refused() {
    let bytes = table().to_npz().expect("packs");
    for text in [&b""[..], b"no zip at all", b"PK\x05\x06"] {
        check_error(
            &load(text).expect_err("refused"),
            "archive",
            "not a complete .npz file",
        );
    }
    for length in (0..bytes.len()).step_by(bytes.len() / 97) {
        let error = load(&bytes[..length]).expect_err("refused");
        assert!(matches!(error, Error::Input { .. }), "{error}");
        assert!(!error.to_string().contains('\n'), "{error}");
    }
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..2000 {
        let mut corrupt = bytes.clone();
        let at = rng.random_range(0..bytes.len());
        corrupt[at] ^= 1 << rng.random_range(0..8);
        // A bit that nobody reads (a date, an attribute) may flip; then the table is the same.
        match load(&corrupt) {
            Ok(read) => same(&read, &table()),
            Err(error) => assert!(!error.to_string().contains('\n'), "{error}"),
        }
    }
    let missing = Ball::read_npz(Path::new("/nowhere/t.npz")).expect_err("refused");
    assert!(matches!(missing, Error::Read { .. }));
}

#[test]
fn a_folder_that_cannot_be_written_is_an_error() {
    let error = table()
        .write_npz(Path::new("/nowhere/t.npz"))
        .expect_err("refused");
    assert!(matches!(error, Error::Write { .. }));
}
