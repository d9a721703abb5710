//! Outputs never destroy inputs: no command writes over a file that it reads, or to one file twice, whatever the names and links by
//! which it is reached. Checked before any work begins, for all commands in one place.

use std::path::{Path, PathBuf};

use clap::{ArgMatches, Command};

use crate::error::{Error, Result};

/// Arguments that name what is written.
const OUTPUTS: [&str; 7] = [
    "output",
    "overlay",
    "report",
    "write_surface",
    "stretches",
    "windows",
    "picture",
];
/// What a folder is read by, and what these commands write to theirs.
const WITHIN: [&str; 2] = ["table.npz", "pattern.csv"];
const WRITE_WITHIN: [&str; 2] = ["calibrate", "synth"];

/// A path with the flag that names it.
struct Named {
    flag: String,
    path: PathBuf,
}

/// Rejects an output that is an input, or another output.
///
/// # Errors
/// [`Error::Argument`] naming the flag and the file.
pub(super) fn check(command: &Command, given: &ArgMatches) -> Result<()> {
    let (mut outputs, mut inputs) = (Vec::new(), Vec::new());
    for argument in command.get_arguments() {
        let id = argument.get_id().as_str();
        let is_output = OUTPUTS.contains(&id);
        // A flag of another command may have the name of an output, but no value.
        let values = given.try_get_raw(id).ok().flatten().into_iter().flatten();
        for value in values.filter(|value| *value != "-") {
            let named = Named {
                flag: format!("--{}", argument.get_long().unwrap_or(id)),
                path: PathBuf::from(value),
            };
            match is_output {
                true => outputs.push(named),
                false if named.path.is_dir() => {
                    inputs.extend(WITHIN.map(|name| named.path.join(name)));
                    inputs.push(named.path);
                }
                false => inputs.push(named.path),
            }
        }
    }
    for (k, output) in outputs.iter().enumerate() {
        let is_folder = output.path.is_dir();
        let written = match WRITE_WITHIN.contains(&command.get_name()) {
            true => WITHIN.map(|name| output.path.join(name)).to_vec(),
            false => Vec::new(),
        };
        if let Some(other) = outputs[..k]
            .iter()
            .find(|other| is_same(&other.path, &output.path))
        {
            let problem = format!(
                "expected another file than {} names, found {}",
                other.flag,
                output.path.display()
            );
            return Err(Error::argument(output.flag.clone(), problem));
        }
        // A folder may hold inputs beside what is written, but pictures are drawn under their frames' names.
        let is_read = |input: &&PathBuf| match is_folder {
            true if output.flag != "--overlay" => written.iter().any(|to| is_same(input, to)),
            _ => is_same(input, &output.path) || is_frame_of(input, &output.path),
        };
        if let Some(input) = inputs.iter().filter(|input| input.exists()).find(is_read) {
            let problem = format!("would write over {}, which is read", input.display());
            return Err(Error::argument(output.flag.clone(), problem));
        }
    }
    Ok(())
}

/// Whether a file is one of a folder's frames.
#[cfg(feature = "vision")]
fn is_frame_of(folder: &Path, file: &Path) -> bool {
    use crate::source::files::sources;
    if !folder.is_dir() || !file.is_file() {
        return false;
    }
    let frames = sources(&[folder.to_path_buf()]).unwrap_or_default();
    let mut paths = frames.iter().filter_map(|frame| frame.path());
    paths.any(|path| is_same(path, file))
}

#[cfg(not(feature = "vision"))]
fn is_frame_of(_: &Path, _: &Path) -> bool {
    false
}

/// Whether two names lead to one file, be it there or not.
fn is_same(one: &Path, other: &Path) -> bool {
    match (std::fs::metadata(one), std::fs::metadata(other)) {
        // A device takes all.
        (Ok(a), Ok(_)) if !a.is_file() && !a.is_dir() => false,
        (Ok(a), Ok(b)) => is_same_file(&a, &b) || resolved(one) == resolved(other),
        (Err(_), Err(_)) => resolved(one) == resolved(other),
        _ => false,
    }
}

#[cfg(unix)]
fn is_same_file(a: &std::fs::Metadata, b: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    a.is_file() && (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn is_same_file(_: &std::fs::Metadata, _: &std::fs::Metadata) -> bool {
    false
}

/// The path without links; of a file that is not there, that of its folder with its name.
fn resolved(path: &Path) -> PathBuf {
    let whole = std::fs::canonicalize(path).ok();
    let beside = || {
        let folder = match path.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        };
        Some(std::fs::canonicalize(folder).ok()?.join(path.file_name()?))
    };
    whole.or_else(beside).unwrap_or_else(|| path.to_path_buf())
}
