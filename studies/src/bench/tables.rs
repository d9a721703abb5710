//! The tables of docs/: what stands between `<!-- bench ARGUMENTS -->` and `<!-- end -->` is what this program prints with these
//! arguments.

use std::path::{Path, PathBuf};
use std::process::Command;

use spindoe::files;
use spindoe_studies::Outcome;

/// On a line of its own: a text may speak of the mark.
const BEGIN: &str = "\n<!-- bench ";
const END: &str = "<!-- end -->";

#[derive(clap::Args)]
pub struct Args {
    /// Markdown files [default: all of docs/measurements].
    files: Vec<PathBuf>,
    /// Only the tables of this subcommand.
    #[arg(long, value_name = "NAME")]
    only: Option<String>,
    /// List them, make none.
    #[arg(long)]
    list: bool,
}

impl Args {
    pub fn run(&self) -> Outcome {
        let mut files = self.files.clone();
        if files.is_empty() {
            for entry in std::fs::read_dir("docs/measurements")? {
                files.push(entry?.path());
            }
            files.sort();
        }
        for path in &files {
            self.remake(path)?;
        }
        Ok(())
    }

    /// Makes the tables of a file anew; where one fails, the file stays as it was.
    fn remake(&self, path: &Path) -> Outcome {
        let text = String::from_utf8(files::read_bytes(path)?)?;
        let (mut made, mut rest) = (String::new(), text.as_str());
        while let Some(at) = rest.find(BEGIN) {
            let (before, block) = rest.split_at(at);
            let broken = || format!("{}: a table without an end: {:.60}", path.display(), block);
            let (opening, body) = block.split_once("-->").ok_or_else(broken)?;
            let (old, after) = body.split_once(END).ok_or_else(broken)?;
            let words: Vec<&str> = opening[BEGIN.len()..].split_whitespace().collect();
            let is_meant = self
                .only
                .as_deref()
                .is_none_or(|only| words.first() == Some(&only));
            made += before;
            made += opening;
            made += "-->";
            if is_meant {
                eprintln!("{}: bench {}", path.display(), words.join(" "));
            }
            match is_meant && !self.list {
                true => made += &format!("\n\n{}\n\n", printed(&words)?),
                false => made += old,
            }
            made += END;
            rest = after;
        }
        made += rest;
        if made != text {
            files::write_bytes(path, made.as_bytes())?;
        }
        Ok(())
    }
}

/// What this program prints.
fn printed(words: &[&str]) -> Outcome<String> {
    let run = Command::new(std::env::current_exe()?)
        .args(words)
        .stderr(std::process::Stdio::inherit())
        .output()?;
    if !run.status.success() {
        return Err(format!("bench {}: {}", words.join(" "), run.status).into());
    }
    Ok(String::from_utf8(run.stdout)?.trim().to_owned())
}
