//! `spindoe estimate --rig`: the clips of several cameras as one.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::output::SequenceReport;
use super::{Arguments, Pictures};
use crate::cli::images::{first_size, read_balls};
use crate::cli::inputs::{self, Counting};
use crate::clip::{ClockCheck, Fusion, RigClip, RigDoubt, RigOutcome, SequenceEvidence, run_rig};
use crate::error::{Error, Result, counted};
use crate::files;
use crate::vision::frame::config::CameraModel;
use crate::vision::{Camera, Estimator, Rig, RigCamera};

pub(super) fn run(arguments: &Arguments, path: &Path) -> Result<()> {
    let asked = &arguments.asked;
    asked.check()?;
    let rig = Rig::read(path)?;
    let names = rig.names();
    let [count, found] = [names.len(), arguments.images.len()];
    if found != count {
        let problem = format!(
            "expected one folder or video for each of the {count} cameras of {}, in their order ({}), found {}",
            path.display(),
            names.join(", "),
            counted(found, "input")
        );
        return Err(Error::argument("inputs", problem));
    }
    let tables = estimators(arguments, path, &rig)?;
    let config = arguments.batch()?;
    let file = arguments.output.as_deref().map(files::OutputFile::create);
    let file = file.transpose()?;
    let pictures = Counting::new(&arguments.images, Pictures { wanted: false });
    let inputs: Vec<Vec<PathBuf>> = arguments.images.iter().map(|i| vec![i.clone()]).collect();
    let clip = run_rig(&rig, &tables, &inputs, &config, &pictures)?;
    pictures.finish();
    for (batch, input) in clip.cameras.iter().zip(&inputs) {
        inputs::say_names(batch, &config)?;
        inputs::say_not_increasing(batch, input, "frames go together by their numbers");
        for frame in &batch.frames {
            if let Some(why) = &frame.unreadable {
                errln!("{why}");
            }
        }
    }
    let frame = asked.axes();
    let evidence = SequenceEvidence::default();
    let orientations = clip.outcome.orientations(frame);
    let report = SequenceReport::of_rows(arguments, frame, &clip.together, &evidence, orientations);
    let text = report.rows().text()?;
    let whole = || {
        let mut json = report.to_json();
        add(&mut json, &clip, &names);
        json
    };
    arguments.write(file, &text, whole)?;
    say(&clip, &names);
    report.say();
    asked.say_format()?;
    let contradicted = clip.outcome.doubts.iter().find(|doubt| doubt.is_of_all());
    arguments.answered(match contradicted {
        Some(doubt) => Some(doubt.to_string()),
        None => report.no_answer(),
    })
}

/// For each camera one for each table, with its intrinsics for its images.
fn estimators(arguments: &Arguments, path: &Path, rig: &Rig) -> Result<Vec<Vec<Estimator>>> {
    let asked = &arguments.asked;
    let balls = read_balls(&asked.table)?;
    let of_camera = |(camera, input): (&RigCamera, &PathBuf)| -> Result<Vec<Estimator>> {
        let (name, calibration) = (&camera.name, &camera.calibration);
        for note in &calibration.notes {
            errln!("note: {}: {name}: {note}", path.display());
        }
        let mut intrinsics = calibration.intrinsics;
        let size = first_size(std::slice::from_ref(input), asked.source.max_pixels);
        if let Some(size) = size {
            let (fitted, words) = calibration.for_image(size)?;
            intrinsics = fitted;
            let doubt = calibration.size.is_none().then(|| fitted.size_doubt(size));
            for words in words.into_iter().chain(doubt.flatten()) {
                errln!("note: {}: {name}: {words}", path.display());
            }
        }
        let camera = CameraModel::Known(Camera::Perspective(intrinsics));
        let each = balls
            .iter()
            .map(|ball| asked.estimator_of(ball, camera, false));
        each.collect()
    };
    rig.cameras()
        .iter()
        .zip(&arguments.images)
        .map(of_camera)
        .collect()
}

/// Says how the cameras agree.
fn say<K>(clip: &RigClip<K>, names: &[&str]) {
    let outcome = &clip.outcome;
    for (batch, name) in clip.cameras.iter().zip(names) {
        let (posed, count) = (batch.identified(), batch.frames.len());
        errln!("{name}: {posed} of {count} frames identified");
        if let Some(doubt) = &batch.focal_doubt {
            errln!("note: {name}: {doubt}");
        }
    }
    for doubt in &outcome.doubts {
        errln!("warning: {doubt}");
    }
    if outcome.doubts.iter().any(RigDoubt::is_of_all) {
        return;
    }
    for (agreement, name) in outcome.agreement.iter().zip(&names[1..]) {
        let words = match agreement {
            Some(agreement) => agreement.words(name, names[0]),
            None => vec![format!(
                "{name} and {} have too little in common to be compared",
                names[0]
            )],
        };
        words.iter().for_each(|words| errln!("{words}"));
    }
    if outcome.settled > 0 {
        errln!(
            "{} settled where another camera expected the ball",
            counted(outcome.settled, "frame")
        );
    }
    if outcome.disagreed() > 0 {
        let kept = outcome.frames.iter();
        let kept = kept
            .filter(|f| matches!(f.fusion, Fusion::Chosen { .. }))
            .count();
        errln!(
            "{} in which cameras disagree, {kept} of them answered by the surer one",
            counted(outcome.disagreed(), "time")
        );
    }
}

fn add(json: &mut Value, clip: &RigClip<super::Picture>, names: &[&str]) {
    let outcome: &RigOutcome = &clip.outcome;
    let cameras = clip.cameras.iter().zip(names).map(|(batch, name)| {
        json!({ "name": name, "frames": batch.frames.len(), "identified": batch.identified() })
    });
    let agreement = outcome
        .agreement
        .iter()
        .zip(&names[1..])
        .map(|(found, name)| {
            let Some(found) = found else {
                return json!({ "name": name });
            };
            let (delay_s, std_s, repeats_s) = match found.clock {
                ClockCheck::Agrees { std_s } => (Some(0.0), Some(std_s), None),
                ClockCheck::Off {
                    delay_s,
                    std_s,
                    repeats_s,
                } => (Some(delay_s), Some(std_s), repeats_s),
                ClockCheck::Unknown => (None, None, None),
            };
            json!({
                "name": name,
                "compared": found.compared,
                "turn_deg": found.turn_rad.to_degrees(),
                "turn_std_deg": found.turn_std_rad.to_degrees(),
                "gap_m": found.gap_m,
                "clock_delay_s": delay_s,
                "clock_delay_std_s": std_s,
                "clock_repeats_s": repeats_s,
                "error_factors": found.factors,
            })
        });
    json["rig"] = json!({
        "cameras": cameras.collect::<Vec<_>>(),
        "agreement": agreement.collect::<Vec<_>>(),
        "doubts": outcome.doubts.iter().map(ToString::to_string).collect::<Vec<_>>(),
        "settled": outcome.settled,
        "disagreed": outcome.disagreed(),
    });
    let frames = json["frames"].as_array_mut().into_iter().flatten();
    for (json, frame) in frames.zip(&outcome.frames) {
        json["cameras"] = frame.cameras.into();
        let [seen, named] = frame.dots;
        if frame.cameras > 0 {
            (json["dots"], json["matched"]) = (seen.into(), named.into());
        }
        if let Some(misfit) = frame.fusion.misfit() {
            json["chi2"] = misfit.chi2.into();
            json["chi2_freedom"] = misfit.freedom.into();
        }
    }
}
