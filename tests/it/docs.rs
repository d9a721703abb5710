//! The documents: every command that they show is understood, and the tutorial and guides print what they show.

use std::path::{Path, PathBuf};

use crate::common::spindoe;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The documents of the repository, but for measurements: what those show are records of runs.
fn documents() -> Vec<PathBuf> {
    let mut found: Vec<PathBuf> = ["README.md", "designs/README.md", "models/README.md"]
        .iter()
        .chain(&["stencils/README.md", "python/README.md"])
        .map(|name| root().join(name))
        .collect();
    for entry in std::fs::read_dir(root().join("docs")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "md") {
            found.push(path);
        }
    }
    found
}

/// A line of a block as a shell splits it; comments and redirections are left out.
fn commands(line: &str) -> Vec<Vec<String>> {
    let line = line.split(" #").next().unwrap_or_default();
    let parts = line.split("&&").flat_map(|part| part.split(" | "));
    let words = parts.map(|part| {
        let part = part.split('>').next().unwrap_or_default();
        part.split_whitespace().map(str::to_owned).collect()
    });
    words
        .map(|words: Vec<String>| {
            // What times a command comes before it.
            let at = words.iter().position(|w| w == "spindoe");
            at.map_or(Vec::new(), |at| words[at + 1..].to_vec())
        })
        .filter(|words| !words.is_empty())
        .collect()
}

#[cfg(feature = "vision")]
#[test]
fn every_command_of_the_documents_is_understood() {
    let dir = tempfile::tempdir().unwrap();
    let mut seen = 0;
    for document in documents() {
        let text = std::fs::read_to_string(&document).unwrap();
        let text = text.replace("\\\n", " ");
        for line in text.lines().filter(|l| l.starts_with("    ")) {
            // Shell variables, and lines of other files.
            if !line.contains("spindoe ") || line.contains(" = ") || line.contains('$') {
                continue;
            }
            for words in commands(line) {
                let words: Vec<&str> = words.iter().map(String::as_str).collect();
                if ["merge", "report", "completions", "man"].contains(&words[0]) {
                    // These have no settings to print; their flags are few.
                    continue;
                }
                let arguments = [&words[..], &["--print-config"]].concat();
                let output = spindoe(dir.path(), &arguments);
                let said = String::from_utf8_lossy(&output.stderr);
                let place = document.display();
                assert!(output.status.success(), "{place}: {line}: {said}");
                seen += 1;
            }
        }
    }
    assert!(seen > 50, "{seen} commands");
}

/// A text without what differs from run to run: seconds and microseconds.
fn without_times(text: &str) -> Vec<String> {
    let lines = text.lines().map(str::trim).filter(|l| !l.is_empty());
    let timed = |line: &str| line.contains(" us an identification");
    lines
        .filter(|line| !timed(line))
        .map(|line| match line.rsplit_once("; ") {
            Some((before, time)) if time.ends_with(" s") => before.to_owned(),
            _ => line.to_owned(),
        })
        .collect()
}

/// The blocks of indented lines of a document; what a command prints is the block behind it.
#[cfg(all(feature = "vision", feature = "plot"))]
fn blocks(text: &str) -> Vec<String> {
    let mut blocks: Vec<String> = Vec::new();
    let (mut is_open, mut is_fenced) = (false, false);
    for line in text.lines() {
        if line.starts_with("```") {
            is_fenced = !is_fenced;
        }
        let indented = line.strip_prefix("    ").filter(|_| !is_fenced);
        match indented {
            Some(line) if is_open => *blocks.last_mut().unwrap() += &format!("\n{line}"),
            Some(line) => blocks.push(line.to_owned()),
            None => {}
        }
        is_open = indented.is_some();
    }
    blocks
}

#[cfg(all(feature = "vision", feature = "plot"))]
#[test]
fn the_tutorial_prints_what_it_shows() {
    let dir = tempfile::tempdir().unwrap();
    let text = std::fs::read_to_string(root().join("docs/tutorial.md")).unwrap();
    let blocks = blocks(&text);
    let mut compared = 0;
    for pair in blocks.windows(2) {
        let is_command = |block: &String| block.starts_with("spindoe ");
        if !is_command(&pair[0]) || is_command(&pair[1]) {
            continue;
        }
        let words: Vec<&str> = pair[0].split_whitespace().skip(1).collect();
        let output = spindoe(dir.path(), &[&words[..], &["-q"]].concat());
        let printed = [output.stdout, output.stderr].concat();
        let mut printed = without_times(&String::from_utf8(printed).unwrap());
        let mut shown = without_times(&pair[1]);
        // Words on standard error may come before or after.
        printed.sort();
        shown.sort();
        assert_eq!(printed, shown, "{}", pair[0]);
        compared += 1;
    }
    assert!(compared >= 4, "{compared}");
}

/// A text as one line, however its lines are broken.
#[cfg(all(feature = "vision", feature = "plot"))]
fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Guides show a part of what is printed, in lines that a page has room for.
#[cfg(all(feature = "vision", feature = "plot"))]
#[test]
fn guides_show_what_their_commands_print() {
    let mut compared = 0;
    for name in ["recognizer", "several-balls", "painted"] {
        let dir = tempfile::tempdir().unwrap();
        let path = root().join(format!("docs/{name}.md"));
        let text = std::fs::read_to_string(&path).unwrap();
        let blocks = blocks(&text.replace("\\\n", " "));
        for pair in blocks.windows(2) {
            if pair[0].starts_with('{') {
                std::fs::write(dir.path().join(format!("{name}.json")), &pair[0]).unwrap();
            }
            let run: Vec<Vec<String>> = pair[0].lines().flat_map(commands).collect();
            let is_output = !pair[1].starts_with('{') && commands(&pair[1]).is_empty();
            if run.is_empty() || !is_output {
                continue;
            }
            let mut printed = String::new();
            for words in &run {
                let words: Vec<&str> = words.iter().map(String::as_str).collect();
                let output = spindoe(dir.path(), &[&words[..], &["-q"]].concat());
                for said in [&output.stdout, &output.stderr] {
                    printed += &format!(" {}", one_line(&String::from_utf8_lossy(said)));
                }
            }
            let shown = one_line(&pair[1]);
            assert!(printed.contains(&shown), "{name}: {shown}: {printed}");
            compared += 1;
        }
    }
    assert_eq!(compared, 3);
}

/// The commands of `spindoe help --all`, in its order.
#[cfg(all(feature = "vision", feature = "mark", feature = "plot"))]
fn help_of(arguments: &[&str]) -> String {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_spindoe"))
        .args(arguments)
        // As wide as a terminal, and as a page shows without cutting a line.
        .env("COLUMNS", "80")
        .output()
        .unwrap();
    String::from_utf8(output.stdout)
        .unwrap()
        .replace("\r\n", "\n")
}

/// The reference of the commands is what they say of themselves. SPINDOE_WRITE_DOCS=1 writes it anew.
#[cfg(all(feature = "vision", feature = "mark", feature = "plot"))]
#[test]
fn the_reference_of_the_commands_is_what_they_say() {
    let all = help_of(&["help", "--all"]);
    let mut text = format!(
        "# Commands\n\nWhat `spindoe help --all` prints, and `spindoe help COMMAND` for each.\n\n```text\n{}\n```\n",
        all.trim_end()
    );
    let names = all
        .lines()
        .filter(|l| l.starts_with("  ") && !l.trim_start().starts_with('-'));
    let names = names.filter_map(|l| l.split_whitespace().next());
    let is_command = |name: &&str| name.chars().all(|c| c.is_ascii_lowercase());
    for name in names.filter(is_command) {
        let help = help_of(&["help", name]);
        text += &format!("\n## {name}\n\n```text\n{}\n```\n", help.trim_end());
    }
    let path = root().join("docs/reference/commands.md");
    if std::env::var_os("SPINDOE_WRITE_DOCS").is_some() {
        std::fs::write(&path, &text).unwrap();
    }
    let shown = std::fs::read_to_string(&path).unwrap();
    assert!(
        shown == text,
        "docs/reference/commands.md is not what the command says: run this test with SPINDOE_WRITE_DOCS=1"
    );
}
