//! Settings: what a study varies, and the flags' list does not show.
//!
//! A setting is an argument like any other, with the same bounds and the same help, that is hidden and has no flag of its
//! own: `--config FILE.toml` or `--config KEY=VALUE` sets it, and `--print-config` lists it with its value. A file may
//! set the flags too, by their names with underscores; what stands on the command line comes before it.

use std::ffi::OsString;
use std::fmt::Write as _;
use std::path::Path;

use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Command};

use crate::error::{Error, Result};
use crate::files;

/// Ids of the two flags, which commands with settings have.
pub(super) const CONFIG: &str = "config";
pub(super) const PRINT: &str = "print_config";
/// Arguments that say where and how a run's results go, and not what they are: `--print-config` leaves them out.
const UNLISTED: [&str; 10] = [
    CONFIG,
    PRINT,
    "quiet",
    "json",
    "help",
    "output",
    "overwrite",
    "resume",
    "shard",
    "budget",
];

/// Whether an argument is a setting.
pub(super) fn is_setting(argument: &Arg) -> bool {
    argument.is_hide_set() && argument.get_long().is_some()
}

/// Gives `--config` and `--print-config` to each command that has settings.
pub(super) fn with_config(cli: Command) -> Command {
    cli.mut_subcommands(|command| {
        if !command.get_arguments().any(is_setting) {
            return command;
        }
        let config = Arg::new(CONFIG)
            .long(CONFIG)
            .value_name("FILE.toml|KEY=VALUE")
            .action(ArgAction::Append)
            .help("Settings that have no flag, from a file or one by one; flags come before them");
        let print = Arg::new(PRINT)
            .long("print-config")
            .action(ArgAction::SetTrue)
            .help(
                "Print all settings with their values and what they mean, as a file for --config",
            );
        command.args([config, print])
    })
}

/// The arguments with those of `--config` as flags of the command that they name.
///
/// # Errors
/// A setting that stands among the flags; a file that cannot be read; a key that the command does not have.
pub(super) fn expanded(
    cli: &Command,
    arguments: &[OsString],
    given: &ArgMatches,
) -> Result<Option<Vec<OsString>>> {
    let Some((name, given)) = given.subcommand() else {
        return Ok(None);
    };
    let Some(command) = cli.find_subcommand(name) else {
        return Ok(None);
    };
    let is_given =
        |a: &Arg| given.value_source(a.get_id().as_str()) == Some(ValueSource::CommandLine);
    if let Some(setting) = command
        .get_arguments()
        .find(|a| is_setting(a) && is_given(a))
    {
        let flag = setting.get_long().unwrap_or_default();
        let key = key(setting);
        let problem =
            format!("is no flag; expected --config {key}=VALUE, or {key} in a file for --config");
        return Err(Error::argument(format!("--{flag}"), problem));
    }
    let Ok(Some(sources)) = given.try_get_many::<String>(CONFIG) else {
        return Ok(None);
    };
    let mut found = Vec::new();
    for source in sources {
        let (table, place) = read(source)?;
        for (key, value) in table {
            let argument = command.get_arguments().find(|a| self::key(a) == key);
            let argument = argument
                .filter(|a| !UNLISTED.contains(&a.get_id().as_str()) || a.get_id() == "output");
            let Some(argument) = argument else {
                let problem = format!(
                    "expected a setting of `spindoe {name}`, found {key} (--print-config lists them)"
                );
                return Err(place.error(&key, problem));
            };
            if !is_given(argument) {
                let words = words(argument, &value).ok_or_else(|| {
                    place.error(
                        &key,
                        "expected a number, a text, true, false, or a list of them",
                    )
                })?;
                found.extend(words);
            }
        }
    }
    // Behind the command's name, so that they are its own.
    let at = arguments.iter().position(|a| a.to_str() == Some(name));
    let (before, after) = arguments.split_at(at.map_or(arguments.len(), |at| at + 1));
    Ok(Some([before, &found, after].concat()))
}

/// Where settings came from.
enum SettingPlace<'a> {
    File(&'a Path),
    Flag,
}

impl SettingPlace<'_> {
    fn error(&self, key: &str, problem: impl Into<String>) -> Error {
        match self {
            Self::File(path) => Error::input(path, key, problem),
            Self::Flag => Error::argument("--config", problem),
        }
    }
}

/// The settings of a file, or of `KEY=VALUE`.
fn read(source: &str) -> Result<(toml::Table, SettingPlace<'_>)> {
    if let Some((key, value)) = source.split_once('=').filter(|(key, _)| is_key(key)) {
        // What is no TOML is a text without quotes.
        let parsed = toml::from_str(source);
        let text =
            || toml::Table::from_iter([(key.to_owned(), toml::Value::String(value.to_owned()))]);
        return Ok((parsed.unwrap_or_else(|_| text()), SettingPlace::Flag));
    }
    let path = Path::new(source);
    read_toml(path).map(|table| (table, SettingPlace::File(path)))
}

/// What a TOML file states.
///
/// # Errors
/// Those of reading it; the line that is not understood.
pub(super) fn read_toml<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    let bytes = files::read_at_most(path, files::MAX_TEXT_BYTES)?;
    let text = String::from_utf8(bytes)
        .map_err(|_| Error::input(path, "file", "expected text in UTF-8"))?;
    toml::from_str(&text).map_err(|error| {
        let line = error
            .span()
            .map_or(1, |s| 1 + text[..s.start].matches('\n').count());
        Error::input(path, format!("line {line}"), error.message())
    })
}

fn is_key(text: &str) -> bool {
    !text.is_empty()
        && text
            .chars()
            .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

/// An argument's key in a file: its flag with underscores, or the name of what stands without a flag.
fn key(argument: &Arg) -> String {
    let name = argument.get_long().unwrap_or(argument.get_id().as_str());
    name.replace('-', "_")
}

/// The words that give an argument this value; `None` for a value that no argument takes.
fn words(argument: &Arg, value: &toml::Value) -> Option<Vec<OsString>> {
    let flag = argument.get_long().map(|flag| format!("--{flag}"));
    let is_switch = matches!(argument.get_action(), ArgAction::SetTrue);
    if let (true, Some(flag), toml::Value::Boolean(on)) = (is_switch, &flag, value) {
        return Some(on.then(|| flag.into()).into_iter().collect());
    }
    let texts = match value {
        toml::Value::Array(values) => values.iter().map(text).collect::<Option<Vec<_>>>()?,
        value => vec![text(value)?],
    };
    let texts = match argument.get_value_delimiter() {
        Some(delimiter) => vec![texts.join(&delimiter.to_string())],
        None => texts,
    };
    let word = |text: String| match &flag {
        Some(flag) => format!("{flag}={text}").into(),
        None => text.into(),
    };
    Some(texts.into_iter().map(word).collect())
}

fn text(value: &toml::Value) -> Option<String> {
    match value {
        toml::Value::String(text) => Some(text.clone()),
        toml::Value::Integer(number) => Some(number.to_string()),
        // As short as it was written.
        toml::Value::Float(number) => Some(format!("{number:?}")),
        toml::Value::Boolean(truth) => Some(truth.to_string()),
        _ => None,
    }
}

/// Whether the command is to print its settings.
pub(super) fn prints(given: &ArgMatches) -> bool {
    let own = given.subcommand().map(|(_, own)| own);
    own.is_some_and(|own| {
        own.try_get_one::<bool>(PRINT)
            .is_ok_and(|on| on == Some(&true))
    })
}

/// The command's settings with their values, as a file for `--config`.
pub(super) fn printed(command: &Command, given: &ArgMatches) -> String {
    let mut text = format!("# spindoe {}\n", command.get_name());
    for argument in command.get_arguments() {
        let id = argument.get_id().as_str();
        if argument.get_long().is_none() || UNLISTED.contains(&id) {
            continue;
        }
        let help = argument
            .get_help()
            .map(ToString::to_string)
            .unwrap_or_default();
        for line in wrapped(&help, 98) {
            let _ = write!(text, "\n# {line}");
        }
        let value = value_of(argument, given);
        let is_set = value.is_some();
        let _ = writeln!(
            text,
            "\n{}{} = {}",
            if is_set { "" } else { "# " },
            key(argument),
            value.unwrap_or_default()
        );
    }
    text
}

/// An argument's value in TOML; `None` where it has none.
fn value_of(argument: &Arg, given: &ArgMatches) -> Option<String> {
    let id = argument.get_id().as_str();
    if matches!(argument.get_action(), ArgAction::SetTrue) {
        return Some(given.get_flag(id).to_string());
    }
    let raw: Vec<String> = given
        .get_raw(id)?
        .flat_map(|value| {
            let value = value.to_string_lossy().into_owned();
            match argument.get_value_delimiter() {
                Some(delimiter) => value.split(delimiter).map(str::to_owned).collect(),
                None => vec![value],
            }
        })
        .map(|value| match value.parse::<f64>() {
            Ok(_) if toml::from_str::<toml::Table>(&format!("x = {value}")).is_ok() => value,
            _ => serde_json::Value::String(value).to_string(),
        })
        .collect();
    let is_list = argument.get_value_delimiter().is_some()
        || matches!(argument.get_action(), ArgAction::Append);
    match raw.as_slice() {
        [one] if !is_list => Some(one.clone()),
        _ => Some(format!("[{}]", raw.join(", "))),
    }
}

/// A text in lines of at most `width` characters, where no word is longer.
pub(super) fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        let line = lines.len() - 1;
        let taken = lines[line].chars().count() + usize::from(!lines[line].is_empty());
        if taken > 0 && taken + word.chars().count() > width {
            lines.push(word.to_owned());
        } else {
            if !lines[line].is_empty() {
                lines[line].push(' ');
            }
            lines[line].push_str(word);
        }
    }
    lines
}
