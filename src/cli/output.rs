//! Shared by the commands: values chosen by name, progress, the command as it was given.

use std::fmt;
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
#[cfg(feature = "mark")]
use std::time::SystemTime;
use std::time::{Duration, Instant};

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::parser::ValueSource;
use clap::{ArgMatches, ValueEnum};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use crate::error::{Error, Result};
use crate::geometry::Vec3;

/// A parser of one of `all` by the name that `name` gives it; the help lists the names.
pub(super) fn one_of<T>(
    all: &'static [T],
    name: fn(T) -> &'static str,
) -> impl TypedValueParser<Value = T>
where
    T: Copy + Send + Sync + FromStr<Err = Error> + 'static,
{
    PossibleValuesParser::new(all.iter().map(|value| name(*value)))
        .try_map(|name| name.parse::<T>())
}

/// Rejects a flag that was given and that only other values of `--as` have; `own` says which have it.
pub(super) fn reject_foreign<T: ValueEnum + PartialEq>(
    given: &ArgMatches,
    own: &[(&'static str, &[T])],
    chosen: T,
) -> Result<()> {
    let is_given = |id: &str| {
        given.try_contains_id(id).is_ok()
            && given.value_source(id) == Some(ValueSource::CommandLine)
    };
    let mut foreign = own.iter().filter(|(_, having)| !having.contains(&chosen));
    match foreign.find(|(id, _)| is_given(id)) {
        None => Ok(()),
        Some((id, having)) => {
            let names = having.iter().filter_map(ValueEnum::to_possible_value);
            let names: Vec<String> = names.map(|name| name.get_name().to_owned()).collect();
            let problem = format!("goes with --as {} only", names.join(" and "));
            Err(Error::argument(*id, problem))
        }
    }
}

/// The direction of a vector of any length; none for 0.
pub(super) fn unit(vector: Vec3) -> Option<Vec3> {
    // Squares of large numbers overflow, those of small ones vanish.
    (vector / vector.amax()).try_normalize(0.0)
}

/// Today's date in UTC, as `2026-11-25`. The environment's `SOURCE_DATE_EPOCH` (seconds since 1970) goes
/// before the clock, so that files can be made again byte for byte (reproducible-builds.org).
#[cfg(feature = "mark")]
pub(super) fn today() -> String {
    let stated = std::env::var("SOURCE_DATE_EPOCH").ok();
    let stated = stated.and_then(|seconds| seconds.trim().parse().ok());
    let time = stated.map_or_else(SystemTime::now, |seconds| {
        SystemTime::UNIX_EPOCH + Duration::from_secs(seconds)
    });
    let mut words = humantime::format_rfc3339_seconds(time).to_string();
    words.truncate("2026-11-25".len());
    words
}

/// Whether progress is shown: set once, from `--quiet`.
static QUIET: AtomicBool = AtomicBool::new(false);

/// Switches progress off.
pub(super) fn set_quiet(quiet: bool) {
    QUIET.store(quiet, Ordering::Relaxed);
}

pub(super) fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Whether a bar stands on the terminal.
static SHOWN: AtomicBool = AtomicBool::new(false);

/// Whether the bar is drawn: not where standard error is no terminal.
fn is_shown(bar: &ProgressBar) -> bool {
    let is_shown = !bar.is_hidden();
    SHOWN.store(is_shown, Ordering::Relaxed);
    is_shown
}

/// Removes the bar.
fn remove(bar: &ProgressBar) {
    SHOWN.store(false, Ordering::Relaxed);
    bar.finish_and_clear();
}

/// What clears the bar, so that a line may be written in its place; the bar is drawn anew beneath. A bar fills its
/// row, so that an echoed `^C` stands in the row below.
pub(super) fn clear_bar(is_echoed: bool) -> &'static str {
    match (SHOWN.load(Ordering::Relaxed), is_echoed) {
        (false, _) => "",
        (true, false) => "\r\x1b[K",
        (true, true) => "\r\x1b[K\x1b[A\x1b[K",
    }
}

/// `template` with the keys `gone` and `left`: minutes and seconds, the latter with words and only where they are known.
fn style(template: &str) -> Option<ProgressStyle> {
    // Templates are constants; with a wrong one the default style is used.
    let style = ProgressStyle::with_template(template).ok()?;
    let gone = |state: &ProgressState, to: &mut dyn fmt::Write| {
        // A bar is no place to report that it cannot be written.
        let _ = write!(to, "{} gone", minutes(state.elapsed()));
    };
    let left = |state: &ProgressState, to: &mut dyn fmt::Write| {
        let left = state.eta();
        if left.as_secs() > 0 {
            let _ = write!(to, ", {} left", minutes(left));
        }
    };
    Some(style.with_key("gone", gone).with_key("left", left))
}

/// Minutes and seconds.
fn minutes(time: Duration) -> String {
    let seconds = time.as_secs();
    format!("{}:{:02}", seconds / 60, seconds % 60)
}

/// Minimum time between plain lines of a [`Counter`] whose end is not known.
const COUNTER_SILENCE: Duration = Duration::from_secs(5);
/// Work that is over so soon needs no line.
const BRIEF: Duration = Duration::from_secs(2);

/// When the tenths of some work are said in plain lines.
struct Tenths {
    began: Instant,
    /// The last that was said or passed over.
    said: u64,
}

impl Tenths {
    fn new() -> Self {
        Self {
            began: Instant::now(),
            said: 0,
        }
    }

    /// What is to be said of the time left when so much is done; `None` within a tenth, and of brief work.
    fn left(&mut self, done: u64, total: u64) -> Option<String> {
        let tenth = done.saturating_mul(10) / total.max(1);
        if tenth <= self.said || tenth >= 10 {
            return None;
        }
        self.said = tenth;
        let share = done as f64 / total.max(1) as f64;
        (self.began.elapsed() > BRIEF).then(|| left((self.began, 0.0), share))
    }
}

/// Counts work that is done on several threads: a bar on a terminal, plain lines elsewhere.
pub(super) struct Counter {
    bar: ProgressBar,
    what: &'static str,
    /// What is said beside the count.
    note: Mutex<String>,
    said: Mutex<(Instant, Tenths)>,
}

impl Counter {
    /// Work of `total` pieces, which `what` names in the plural, or of 100 percent; 0 where their number is not known.
    pub fn new(total: u64, what: &'static str) -> Self {
        let (bar, template) = match total {
            0 => (ProgressBar::new_spinner(), "{spinner} {pos} {msg}"),
            _ if what.starts_with('%') => {
                (ProgressBar::new(total), "{bar:25} {pos} {wide_msg}{left}")
            }
            _ => (
                ProgressBar::new(total),
                "{bar:25} {pos} of {len} {wide_msg}{left}",
            ),
        };
        if is_quiet() {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        if let Some(style) = style(template) {
            bar.set_style(style);
        }
        bar.set_message(what);
        Self {
            bar,
            what,
            note: Mutex::default(),
            said: Mutex::new((Instant::now(), Tenths::new())),
        }
    }

    /// `more` pieces are done.
    pub fn add(&self, more: u64) {
        self.bar.inc(more);
        self.speak();
    }

    /// `done` pieces are done.
    #[cfg(feature = "vision")]
    pub fn set(&self, done: u64) {
        self.bar.set_position(done);
        self.speak();
    }

    /// Sets what is said beside the count, from the next one on.
    #[cfg(feature = "vision")]
    pub fn note(&self, words: &str) {
        self.bar.set_message(format!("{}{words}", self.what));
        let mut note = self.note.lock().unwrap_or_else(PoisonError::into_inner);
        note.clear();
        note.push_str(words);
    }

    /// A plain line where there is no bar: at each tenth, or every so often where the end is not known.
    fn speak(&self) {
        if is_quiet() || is_shown(&self.bar) {
            return;
        }
        // A thread that finds another one speaking has nothing to add.
        let Ok(mut said) = self.said.try_lock() else {
            return;
        };
        let (done, what) = (self.bar.position(), self.what);
        let note = self.note.lock().unwrap_or_else(PoisonError::into_inner);
        let (last, tenths) = &mut *said;
        match self.bar.length().filter(|total| *total > 0) {
            Some(total) => {
                if let Some(left) = tenths.left(done, total) {
                    let of = match what.starts_with('%') {
                        true => String::new(),
                        false => format!(" of {total}"),
                    };
                    errln!("{done}{of} {what}{note}{left}");
                }
            }
            None if last.elapsed() > COUNTER_SILENCE => {
                errln!("{done} {what}{note}");
                *last = Instant::now();
            }
            None => {}
        }
    }

    /// A line above the bar, or a plain one.
    pub fn line(&self, words: &str) {
        if is_quiet() {
            return;
        }
        if is_shown(&self.bar) {
            self.bar.println(super::shown(words.to_owned()));
        } else {
            errln!("{words}");
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        remove(&self.bar);
    }
}

/// Steps of the bar of a design, and the minimum time between its plain lines.
pub(super) const STEPS: u64 = 1000;
const SILENCE: Duration = Duration::from_secs(2);

/// Estimated time left from the share done, and that when work began, in words; empty while there is no estimate.
pub(super) fn left((began, before): (Instant, f64), share: f64) -> String {
    if share - before < 0.02 {
        return String::new();
    }
    let left = began.elapsed().as_secs_f64() * (1.0 - share) / (share - before);
    format!("; {left:.0} s left")
}

/// The progress of long work: a bar on a terminal, plain lines elsewhere.
pub(super) struct Progress {
    bar: ProgressBar,
    said: Instant,
    silence: Duration,
}

impl Progress {
    /// Work of `length` steps. `template` is indicatif's; plain lines are at least `silence` apart.
    pub fn new(length: u64, template: &str, silence: Duration) -> Self {
        let bar = ProgressBar::new(length);
        if is_quiet() {
            bar.set_draw_target(ProgressDrawTarget::hidden());
        }
        if let Some(style) = style(template) {
            bar.set_style(style);
        }
        Self {
            bar,
            said: Instant::now(),
            silence,
        }
    }

    /// The progress of a design.
    pub fn of_design() -> Self {
        Self::new(STEPS, "{bar:12} {gone}{left}  {wide_msg}", SILENCE)
    }

    /// Shows the current work and the share of all that is done, begun at `began`.
    #[cfg(feature = "vision")]
    pub fn show_share(&mut self, share: f64, what: &str, began: Instant) {
        let done = (STEPS as f64 * share) as u64;
        self.show(done, what, || left((began, 0.0), share));
    }

    /// Counts `total` pieces of work that is done on several threads and takes the bar from one share of all work
    /// to another: what it returns learns how many more are done.
    pub fn count(
        &self,
        total: u64,
        [from, to]: [f64; 2],
        what: &'static str,
    ) -> impl Fn(u64) + Send + Sync + use<> {
        let (bar, done) = (self.bar.clone(), AtomicU64::new(0));
        let began = Instant::now();
        let said = Mutex::new(began);
        self.say((STEPS as f64 * from) as u64, what);
        move |more| {
            let done = done.fetch_add(more, Ordering::Relaxed) + more;
            let share = done as f64 / total.max(1) as f64;
            let share = from + (to - from) * share.min(1.0);
            bar.set_position((STEPS as f64 * share) as u64);
            if is_quiet() || is_shown(&bar) {
                return;
            }
            // A thread that finds another one speaking has nothing to add.
            let Ok(mut said) = said.try_lock() else {
                return;
            };
            if said.elapsed() > COUNTER_SILENCE {
                errln!(
                    "{what}: {done} of {total} frames{}",
                    left((began, from), share)
                );
                *said = Instant::now();
            }
        }
    }

    /// Work begins that is as fast as none before: the time left is estimated from here on.
    pub fn begin(&self, done: u64) {
        self.bar.set_position(done);
        self.bar.reset_eta();
    }

    /// Sets the steps done and the message; a plain line adds what `more` returns.
    pub fn show(&mut self, done: u64, what: &str, more: impl FnOnce() -> String) {
        self.bar.set_position(done);
        if is_shown(&self.bar) {
            self.bar.set_message(super::shown(what.to_owned()));
        } else if !is_quiet() && self.said.elapsed() > self.silence {
            errln!("{what}{}", more());
            self.said = Instant::now();
        }
    }

    /// Sets the steps done and shows the current work at once.
    pub fn say(&self, done: u64, what: &str) {
        self.bar.set_position(done);
        if is_quiet() {
            return;
        }
        if is_shown(&self.bar) {
            self.bar.set_message(super::shown(what.to_owned()));
        } else {
            errln!("{what}");
        }
    }

    /// Removes the bar.
    pub fn finish(&self) {
        remove(&self.bar);
    }
}

/// The command as it was given, for files that say how they were made.
static COMMAND: Mutex<String> = Mutex::new(String::new());

/// Notes the command's arguments, the program's name first.
pub(super) fn set_command_line(arguments: &[std::ffi::OsString]) {
    let words = arguments
        .iter()
        .skip(1)
        .map(|a| quoted(&a.to_string_lossy()));
    let words: Vec<String> = std::iter::once("spindoe".to_owned()).chain(words).collect();
    // What a panicking thread leaves is still a command.
    *COMMAND
        .lock()
        .unwrap_or_else(|poisoned| poisoned.into_inner()) = words.join(" ");
}

/// The command as a shell takes it.
pub(super) fn command_line() -> String {
    let command = COMMAND.lock();
    command
        .unwrap_or_else(|poisoned| poisoned.into_inner())
        .clone()
}

/// A word as a POSIX shell needs it: as it is where every character is harmless, else in single
/// quotes.
pub(super) fn quoted(word: &str) -> String {
    let harmless = |c: char| c.is_ascii_alphanumeric() || "_-./,:=+@%".contains(c);
    if !word.is_empty() && word.chars().all(harmless) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// An angle in degrees with so many digits, or a dash where there is none.
pub(super) fn degrees_or_dash(angle_deg: f64, digits: usize) -> String {
    match angle_deg.is_finite() {
        true => format!("{angle_deg:.digits$} deg"),
        false => "-".to_owned(),
    }
}
