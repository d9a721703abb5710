//! Videos as a full disk, a lost link or a bad card leave them: what is missing is said.

use std::path::Path;
use std::process::Command;

use crate::common::{done, spindoe};

/// A video of the frames of a folder, at 30 a second; what ffmpeg says where it cannot.
fn encode(frames: &Path, codec: &str, to: &Path) -> Result<(), String> {
    let made = Command::new("ffmpeg")
        .args(["-v", "error", "-framerate", "30", "-i"])
        .arg(frames.join("%03d.png"))
        // Some codecs want even sides.
        .args(["-vf", "crop=floor(iw/2)*2:floor(ih/2)*2", "-g", "12"])
        .args(["-pix_fmt", "yuv420p", "-c:v", codec])
        .arg(to)
        .output()
        .map_err(|e| e.to_string())?;
    match made.status.success() {
        true => Ok(()),
        false => Err(String::from_utf8_lossy(&made.stderr).into_owned()),
    }
}

#[test]
fn cut_and_damaged_videos_are_said() {
    if !crate::common::has_ffmpeg() {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    done(dir.path(), &["synth", "--frames", "40"]);
    std::fs::create_dir(at("frames")).unwrap();
    // The names are nanoseconds, all of the same length.
    let mut names: Vec<_> = std::fs::read_dir(at("sample/images"))
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    names.sort();
    for (k, path) in names.iter().enumerate() {
        std::fs::copy(path, at(&format!("frames/{k:03}.png"))).unwrap();
    }
    let words = |name: &str| {
        let run = ["estimate", "--table", "sample", name, "--json"];
        let output = spindoe(dir.path(), &run);
        let words = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{name}: {words}");
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        (words, json["frames"].as_array().unwrap().len())
    };
    for (codec, ending) in [("mpeg4", "mkv"), ("mpeg4", "avi"), ("libx264", "mkv")] {
        let whole = format!("{codec}.{ending}");
        if let Err(why) = encode(&at("frames"), codec, &at(&whole)) {
            crate::common::skipped(&format!("ffmpeg writes no {whole}: {why}"));
            continue;
        }
        let bytes = std::fs::read(at(&whole)).unwrap();
        let (said, frames) = words(&whole);
        assert_eq!(frames, 40, "{whole}: {said}");
        assert!(!said.contains("damaged"), "{whole}: {said}");
        let cut = format!("cut_{whole}");
        std::fs::write(at(&cut), &bytes[..bytes.len() * 3 / 5]).unwrap();
        let mut damaged = bytes;
        let (from, count) = (damaged.len() / 2, damaged.len() / 20);
        for (k, byte) in damaged[from..][..count].iter_mut().enumerate() {
            *byte = (37 * k) as u8;
        }
        let bad = format!("bad_{whole}");
        std::fs::write(at(&bad), damaged).unwrap();
        for name in [&cut, &bad] {
            let (said, frames) = words(name);
            let expected = format!("{name}: damaged, what can be read is used: ");
            assert!(said.contains(&expected), "{name}, {frames} frames: {said}");
        }
    }
}
