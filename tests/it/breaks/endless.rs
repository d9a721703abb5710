//! Input without an end: each format has a size that it cannot exceed, and no more is read.

use std::io::{Read, Write};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Instant;

/// Most address space of the command, KiB: what any command asks for on two threads before it reads, and less than what
/// it would read without a bound.
const MAX_MEMORY_KIB: u32 = 620_000;

/// How an endless input begins, and its piece number `k`.
struct Endless {
    begin: &'static [u8],
    piece: fn(u64) -> Vec<u8>,
}

const fn repeated(begin: &'static [u8], piece: fn(u64) -> Vec<u8>) -> Endless {
    Endless { begin, piece }
}

fn zeros(_: u64) -> Vec<u8> {
    vec![0; 1 << 16]
}

/// Rows of a table, the number in place of `#`.
fn rows(row: &str, from: u64) -> Vec<u8> {
    let rows = (from * 1000..(from + 1) * 1000).map(|k| row.replace('#', &k.to_string()));
    rows.collect::<String>().into_bytes()
}

const ZEROS: Endless = repeated(b"", zeros);
const TIMES: Endless = repeated(b"frame,time_s\n", |k| rows("f#,#\n", k));
const CIRCLES: Endless = repeated(b"frame,u,v,radius,sigma\n", |k| rows("f#,20,20,9,1\n", k));
const DOTS: Endless = repeated(b"x,y,z\n", |k| rows("0,0,1\n", k));
const ONE_FRAME: Endless = repeated(b"frame,x,y,z\n", |k| rows("a,0,0,1\n", k));
const JSON: Endless = repeated(b"{\"format_version\":1", |_| vec![b' '; 1 << 16]);
const TEXT: Endless = repeated(b"# ", |_| vec![b'x'; 1 << 16]);
/// Image files of which only the first bytes make sense.
const IMAGES: [Endless; 8] = [
    repeated(b"\x89PNG\r\n\x1a\n", zeros),
    // 40 x 40 pixels, then data without an end.
    repeated(
        b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0\0\0\x28\0\0\0\x28\x08\x02\0\0\0\xfe\xa4\x0f\xdb",
        |_| [&b"\0\0\xff\xf4IDAT"[..], &[7; 0xfff8]].concat(),
    ),
    repeated(b"\xff\xd8", zeros),
    repeated(b"\xff\xd8", |_| {
        [&b"\xff\xfe\xff\xff"[..], &[7; 0xfffd]].concat()
    }),
    repeated(b"BM", zeros),
    repeated(b"II*\0", zeros),
    repeated(b"P5 #", |_| vec![b'x'; 1 << 16]),
    repeated(b"P6 ", |_| vec![b' '; 1 << 16]),
];

/// Runs the command with this standard input, in bounded memory.
fn bounded(dir: &Path, arguments: &str, input: &Endless, max_kib: u32) -> Output {
    let limit = format!("ulimit -v {max_kib}; exec \"$0\" \"$@\"");
    let mut child = Command::new("sh")
        .args(["-c", &limit, env!("CARGO_BIN_EXE_spindoe")])
        .args(arguments.split(' '))
        .current_dir(dir)
        .env("RAYON_NUM_THREADS", "2")
        // Each heap reserves 64 MiB of address space that it does not use.
        .env("MALLOC_ARENA_MAX", "1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let (begin, piece) = (input.begin, input.piece);
    // Until the command has ended.
    let feeder = std::thread::spawn(move || {
        let mut written = stdin.write_all(begin);
        for k in 0.. {
            if written.is_err() {
                break;
            }
            written = stdin.write_all(&piece(k));
        }
    });
    // What it prints is short.
    let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
    child
        .stderr
        .take()
        .unwrap()
        .read_to_end(&mut stderr)
        .unwrap();
    child
        .stdout
        .take()
        .unwrap()
        .read_to_end(&mut stdout)
        .unwrap();
    let status = child.wait().unwrap();
    feeder.join().unwrap();
    Output {
        status,
        stdout,
        stderr,
    }
}

fn refused(dir: &Path, arguments: &str, input: &Endless, max_kib: u32) {
    let begun = Instant::now();
    let output = bounded(dir, arguments, input, max_kib);
    let said = String::from_utf8_lossy(&output.stderr);
    let begin = String::from_utf8_lossy(input.begin);
    let context = format!("{arguments} < {begin:?}: {said}");
    assert!(matches!(output.status.code(), Some(2 | 3)), "{context}");
    let last = said.trim_end().lines().last().unwrap_or_default();
    assert!(
        last.starts_with("spindoe: ") && last.len() < 400,
        "{context}"
    );
    let took = begun.elapsed();
    assert!(took < super::PATIENCE, "{context}: {took:?}");
}

#[cfg(all(target_os = "linux", feature = "vision"))]
#[test]
fn endless_inputs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    super::pattern().write_csv(&dir.join("p.csv")).unwrap();
    image::RgbImage::new(40, 40)
        .save(dir.join("1.png"))
        .unwrap();
    for (name, file) in [("design", "search.json"), ("report", "report.json")] {
        std::fs::create_dir(dir.join(name)).unwrap();
        symlink("/dev/stdin", dir.join(name).join(file)).unwrap();
    }
    for (arguments, input) in [
        ("table /dev/stdin -o t.npz", &ZEROS),
        ("table /dev/stdin -o t.npz", &DOTS),
        ("validate /dev/stdin", &ZEROS),
        ("validate p.csv --camera /dev/stdin", &TEXT),
        ("advise --camera /dev/stdin", &ZEROS),
        ("simulate --camera /dev/stdin -o s.csv", &TEXT),
        ("compare /dev/stdin p.csv", &DOTS),
        ("sensitivity /dev/stdin -o s", &ZEROS),
        ("mark /dev/stdin --as gores -o m.svg", &DOTS),
        ("identify --table /dev/stdin -", &ZEROS),
        ("identify --table p.csv /dev/stdin", &ZEROS),
        ("identify --table p.csv -", &ONE_FRAME),
        ("estimate --table /dev/stdin 1.png", &ZEROS),
        ("estimate --table p.csv 1.png --times /dev/stdin", &TIMES),
        (
            "estimate --table p.csv 1.png --circles /dev/stdin",
            &CIRCLES,
        ),
        (
            "estimate --table p.csv 1.png --config weights=/dev/stdin",
            &ZEROS,
        ),
        ("export --weights /dev/stdin -o n.onnx", &ZEROS),
        ("calibrate --table p.csv /dev/stdin --output c", &ZEROS),
        ("stencil /dev/stdin --output s", &DOTS),
        ("spin /dev/stdin", &ZEROS),
        ("spin -", &TEXT),
        ("synth /dev/stdin --output s", &ZEROS),
        ("synth p.csv --preset /dev/stdin --output s", &JSON),
        ("merge /dev/stdin --output m", &JSON),
        ("report report", &JSON),
        ("design --from /dev/stdin --output d", &DOTS),
        ("design --camera /dev/stdin --output d", &TEXT),
    ] {
        refused(dir, arguments, input, MAX_MEMORY_KIB);
    }
    let resumed = "design --resume --output design";
    refused(dir, resumed, &JSON, MAX_MEMORY_KIB);
    for image in &IMAGES {
        for arguments in ["estimate --table p.csv /dev/stdin", "live --table p.csv -"] {
            refused(dir, arguments, image, MAX_MEMORY_KIB);
        }
    }
    // Nothing half-written, and no folder for it.
    let mut left: Vec<_> = std::fs::read_dir(dir)
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    left.sort();
    assert_eq!(left, ["1.png", "design", "p.csv", "report"]);
}

/// A table of frames is held whole: it has a most number of rows, whatever their names.
#[cfg(feature = "vision")]
#[test]
fn a_table_of_frames_names_rows_in_any_order() {
    use spindoe::clip::frame_table::read_times;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("t.csv");
    let text = "frame,time_s\nb/7.png,3\n9,1\nb/7,4\na/7.png,2\nc/9.png,5\n";
    std::fs::write(&path, text).unwrap();
    let table = read_times(&path).unwrap();
    let frames = ["x/a/7.png", "9.png"].map(std::path::PathBuf::from);
    assert_eq!(table.of_frames(&frames).unwrap(), [2.0, 1.0]);
    assert_eq!(table.unused_lines(&frames).unwrap(), [2, 4, 6]);
    // Two rows name it alike.
    let error = table.of_frame(Path::new("b/7.png")).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("line 4: frame: names b/7.png, as does line 2"),
        "{error}"
    );
    std::fs::write(&path, format!("{text}a/7.png,8\n9,8\n")).unwrap();
    let error = read_times(&path).unwrap_err().to_string();
    assert!(
        error.contains("line 7: frame: \"a/7.png\" occurs on line 5 already"),
        "{error}"
    );
}
