//! Files of others, changed at random: nothing panics, and what is refused is refused in one short line.

use std::path::Path;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spindoe::clip::frame_table::read_clock;
use spindoe::source::FrameSource;
use spindoe::source::files::{open, sources};
use spindoe::vision::Calibration;

/// Changed files of each run; `SPINDOE_CHANGED=10000` tries more.
fn count() -> u64 {
    super::setting("SPINDOE_CHANGED", 1000)
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
    for k in 0..count() as usize {
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
                if let Err(error) = Calibration::from_bytes(&path, None, &bytes) {
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
