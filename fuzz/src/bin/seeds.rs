//! Writes a valid input for each reader to `regressions/TARGET/`: what fuzzing starts from.

// The readers are built with coverage, whose counters libFuzzer holds.
extern crate libfuzzer_sys;

use std::error::Error;
use std::fs;
use std::io::Cursor;
use std::path::Path;

use nalgebra::Matrix3;
use spindoe::ball::CalibrationRecord;
use spindoe::design::state::{Checkpoint, ShardRecord};
use spindoe::design::{Candidate, SearchState, Shard};
use spindoe::recognize::observed::{self, observed_frames};
use spindoe::spin::orientations::Orientations;
use spindoe::spin::simulate::Scenario;
use spindoe::synth::SynthConfig;
use spindoe::view::ProtocolName;
use spindoe::{Ball, Pattern};
use spindoe_fuzz::readers::{
    SEPARATOR, ZONED_PATTERN, arrays, built_in_weights, search_config, table_names,
};

type Done<T = ()> = Result<T, Box<dyn Error>>;

fn seed(target: &str, name: &str, bytes: impl AsRef<[u8]>) -> Done {
    let folder = Path::new("regressions").join(target);
    fs::create_dir_all(&folder)?;
    Ok(fs::write(folder.join(name), bytes)?)
}

fn tables(pattern: &Pattern) -> Done {
    let table = Ball::new(pattern.clone());
    seed(
        "table",
        "plain",
        arrays(&table.to_npz()?, &table_names()).concat(),
    )?;
    seed("table", "archive", table.to_npz()?)?;
    let covariance = |d: &spindoe::Vec3| (Matrix3::identity() - d * d.transpose()) * 1e-4;
    let record = CalibrationRecord {
        nominal_sha256: None,
        nominal_numbers: vec![Some(0), None, Some(2), Some(3)],
        views: vec![3; 4],
    };
    let covariances = pattern.dots().iter().map(covariance).collect();
    let table = table.with_calibration(covariances, record)?;
    seed(
        "table",
        "calibrated",
        arrays(&table.to_npz()?, &table_names()).concat(),
    )
}

fn searches(pattern: &Pattern) -> Done {
    let config = search_config();
    let candidate = Candidate {
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
    let mut file = Checkpoint::new(config, state, None);
    seed("checkpoint", "search", file.to_json()?)?;
    file.shard = Some(ShardRecord {
        shard: Shard::new(1, 2)?,
        command: Some("spindoe design".into()),
    });
    seed("checkpoint", "shard", file.to_json()?)
}

fn pictures() -> Done {
    let picture = image::RgbImage::from_fn(6, 5, |u, v| image::Rgb([u as u8 * 9, v as u8 * 9, 80]));
    for format in [
        image::ImageFormat::Png,
        image::ImageFormat::Jpeg,
        image::ImageFormat::Bmp,
        image::ImageFormat::Tiff,
        image::ImageFormat::Pnm,
    ] {
        let mut bytes = Cursor::new(Vec::new());
        picture.write_to(&mut bytes, format)?;
        seed(
            "picture",
            &format!("{format:?}").to_lowercase(),
            bytes.get_ref(),
        )?;
        let piped = [&[0, 0, 0], bytes.get_ref().as_slice()].concat();
        seed("pipe", &format!("{format:?}").to_lowercase(), piped)?;
    }
    seed("pipe", "raw", [&[2, 3, 2][..], &[7; 36]].concat())?;
    let log = "  Duration: 00:00:01\n    com.android.capture.fps: 240.000000\n\
               [showinfo] n: 0 pts: 0 pts_time:0 pos: 1\n[showinfo] n: 1 pts: 1 pts_time:0.0333 x\n";
    let frames = b"P6\n2 1\n255\n123456P6\n2 1\n255\n123456";
    seed(
        "video",
        "two",
        [log.as_bytes(), &[SEPARATOR], frames].concat(),
    )
}

fn main() -> Done {
    let pattern = Pattern::from_csv(Path::new("p"), ZONED_PATTERN.as_bytes())?;
    seed("pattern", "plain", ZONED_PATTERN)?;
    seed(
        "pattern",
        "header",
        format!("x,y,z\n# {}\r\n{ZONED_PATTERN}", "\u{e9}"),
    )?;
    tables(&pattern)?;
    searches(&pattern)?;
    pictures()?;
    let frames = observed_frames(&pattern, &ProtocolName::Image.view(), 2, 4);
    seed("observed", "image", observed::to_csv(&frames))?;
    seed(
        "observed",
        "plain",
        "frame,x,y,z,time_s\n\"a, b\",0,0.6,0.8,1\n7,1,0,0,\n",
    )?;
    let mut sequence = Scenario::default().sequence((40.0, 60.0), 3, 0);
    sequence.measurements.truncate(3);
    let rows = Orientations::from_measurements(&sequence.measurements);
    seed("orientations", "plain", rows.to_csv())?;
    let row = "frame,time_s,qw,qx,qy,qz,dots,matched,residual_deg,confidence\n";
    let text = format!("{row}a,0,1,0,0,0,9,8,0.5,0.9\nb,1,,,,,3,,,\n");
    seed("orientations", "full", text)?;
    seed(
        "times",
        "plain",
        "frame,time_s\nleft/7.png,0.5\nright/7.png,0.25\n\"8\",1\n",
    )?;
    seed(
        "circles",
        "plain",
        "frame,u,v,radius,sigma\nleft/7.png,20,21.5,9,0.1\nright/7.png,20,21,9,\n\"8\",1,2,3,1\n",
    )?;
    let report = fs::read("../designs/dots12/report.json")?;
    seed("report", "dots12", report)?;
    let set = "traj_file,x_spin,y_spin,z_spin\n1,10,20,30\n";
    seed(
        "trajectories",
        "plain",
        format!("{set}\00.1;1;2;3\n0.2;1.1;2;3\n"),
    )?;
    let numbers: [f32; 9] = [0.5, 900.0, 320.0, 240.0, 300.0, 200.0, 30.0, 310.0, 205.0];
    seed("camera", "near", numbers.map(f32::to_le_bytes).concat())?;
    let ros = "image_width: 640\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [900, 0.5, 320, 0, 901, 240, 0, 0, 1]\n\
               distortion_model: plumb_bob\ndistortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 0.05, 0, 1e-3, 0]}\n";
    seed("intrinsics", "ros", ros)?;
    let opencv = "%YAML:1.0\n---\nK: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 900., 0., 320., 0., 901., 240., 0., 0., 1. ]\n";
    seed("intrinsics", "opencv", opencv)?;
    let json = r#"{"K": [[900, 0, 320], [0, 901, 240], [0, 0, 1]], "D": [0.1, 0, 0, 0], "distortion_model": "equidistant"}"#;
    seed("intrinsics", "json", json)?;
    seed("weights", "meta", &built_in_weights()[0])?;
    let zones = format!(
        "{{\"format_version\":1,\"pattern_sha256\":\"{}\",\"keep_out\":[{{\"axis\":[0,0,-1],\"half_angle_rad\":0.2}}]}}",
        pattern.sha256()
    );
    seed("zones", "plain", zones)?;
    seed(
        "synth",
        "default",
        serde_json::to_vec(&SynthConfig::default())?,
    )
}

