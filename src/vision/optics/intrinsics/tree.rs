//! What a calibration's file holds, whatever its syntax: a tree of keys, lists and words.
//!
//! YAML and JSON (OpenCV's first line is not YAML's), and OpenCV's XML. What lies deeper than [`DEEPEST`] is left out:
//! no calibration is as deep, and however deep a file goes, nothing here recurses into it.

use saphyr_parser::{Event, Parser};

/// Levels that are kept.
const DEEPEST: usize = 8;

/// A value.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    /// A word, or a number as it is written.
    Text(String),
    /// A list.
    List(Vec<Value>),
    /// Keys with their values, in their order.
    Map(Vec<(String, Value)>),
}

/// A key without what people spell differently: case, underscores, dashes.
pub(super) fn plain(key: &str) -> String {
    let letters = key.chars().filter(|c| c.is_ascii_alphanumeric());
    letters.map(|c| c.to_ascii_lowercase()).collect()
}

impl Value {
    /// The numbers of a list, of lists in a list, of words between blanks, or of a matrix' `data`; `None` where one is no number, or there
    /// are none.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        let mut numbers = Vec::new();
        self.collect(&mut numbers)?;
        (!numbers.is_empty()).then_some(numbers)
    }

    fn collect(&self, to: &mut Vec<f64>) -> Option<()> {
        match self {
            Self::Text(text) => {
                let words = text.split(|c: char| c.is_whitespace() || c == ',');
                for word in words.filter(|word| !word.is_empty()) {
                    to.push(word.parse().ok()?);
                }
                Some(())
            }
            Self::List(values) => values.iter().try_for_each(|value| value.collect(to)),
            Self::Map(_) => self.get(&["data"])?.collect(to),
        }
    }

    /// The number of a word.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Text(text) => text.trim().parse().ok(),
            _ => None,
        }
    }

    /// The keys of a mapping.
    pub fn entries(&self) -> &[(String, Value)] {
        match self {
            Self::Map(entries) => entries,
            _ => &[],
        }
    }

    /// The value of the first key of one of these plain names.
    pub fn get(&self, names: &[&str]) -> Option<&Value> {
        let mut entries = self.entries().iter();
        let found = entries.find(|(key, _)| names.contains(&plain(key).as_str()));
        found.map(|(_, value)| value)
    }
}

/// A list or a mapping that is being read.
enum Open {
    List(Vec<Value>),
    Map(Vec<(String, Value)>, Option<String>),
}

/// The tree that is being read, from its root.
#[derive(Default)]
struct Builder {
    open: Vec<Open>,
    /// Levels beyond the deepest that are open.
    beyond: usize,
    root: Option<Value>,
}

impl Builder {
    fn begin(&mut self, level: Open) {
        if self.open.len() == DEEPEST {
            self.beyond += 1;
        } else {
            self.open.push(level);
        }
    }

    fn end(&mut self) {
        if self.beyond > 0 {
            self.beyond -= 1;
            if self.beyond == 0 {
                self.put(Value::List(Vec::new()));
            }
            return;
        }
        match self.open.pop() {
            Some(Open::List(values)) => self.put(Value::List(values)),
            Some(Open::Map(entries, _)) => self.put(Value::Map(entries)),
            None => {}
        }
    }

    fn put(&mut self, value: Value) {
        match self.open.last_mut() {
            None => self.root = self.root.take().or(Some(value)),
            Some(Open::List(values)) => values.push(value),
            Some(Open::Map(entries, key)) => match (key.take(), value) {
                (Some(key), value) => entries.push((key, value)),
                (None, Value::Text(word)) => *key = Some(word),
                // A key that is a list is none of a calibration.
                (None, _) => *key = Some(String::new()),
            },
        }
    }

    fn scalar(&mut self, text: String) {
        if self.beyond == 0 {
            self.put(Value::Text(text));
        }
    }
}

/// The tree of YAML or JSON; an empty list where there is none.
pub(super) fn of_yaml(text: &str) -> Result<Value, String> {
    let text = text.strip_prefix("%YAML:1.0").unwrap_or(text);
    let mut builder = Builder::default();
    for event in Parser::new_from_str(text) {
        match event.map_err(|e| e.to_string())?.0 {
            Event::MappingStart(..) => builder.begin(Open::Map(Vec::new(), None)),
            Event::SequenceStart(..) => builder.begin(Open::List(Vec::new())),
            Event::MappingEnd | Event::SequenceEnd => builder.end(),
            Event::Scalar(value, ..) => builder.scalar(value.into_owned()),
            Event::Alias(..) => builder.scalar(String::new()),
            Event::DocumentEnd => break,
            _ => {}
        }
    }
    Ok(builder.root.unwrap_or(Value::List(Vec::new())))
}

/// Whether a text begins as an INI file does: `[section]`, then `key=value`.
pub(super) fn is_ini(text: &str) -> bool {
    let mut lines = text.lines().map(str::trim).filter(|line| is_said(line));
    let is_section = |line: &str| line.starts_with('[') && line.ends_with(']');
    lines.next().is_some_and(is_section) && lines.next().is_some_and(|line| line.contains('='))
}

/// Whether a line of an INI file is no comment.
fn is_said(line: &str) -> bool {
    !line.is_empty() && !line.starts_with(['#', ';'])
}

/// The tree of an INI file, as the ZED cameras' are: a mapping for each section.
pub(super) fn of_ini(text: &str) -> Value {
    let mut sections: Vec<(String, Value)> = Vec::new();
    for line in text.lines().map(str::trim).filter(|line| is_said(line)) {
        if let Some(name) = line.strip_prefix('[') {
            let name = name.trim_end_matches(']').to_owned();
            sections.push((name, Value::Map(Vec::new())));
        } else if let (Some((key, value)), Some((_, Value::Map(entries)))) =
            (line.split_once('='), sections.last_mut())
        {
            let value = Value::Text(value.trim().to_owned());
            entries.push((key.trim().to_owned(), value));
        }
    }
    Value::Map(sections)
}

/// An element of XML that is being read: its name, what it holds, and its words.
type Element = (String, Vec<(String, Value)>, String);

/// The tree of OpenCV's XML: what its outermost element holds.
pub(super) fn of_xml(text: &str) -> Result<Value, String> {
    let mut open: Vec<Element> = Vec::new();
    let mut beyond = 0usize;
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('<') {
        if beyond == 0
            && let Some((_, _, words)) = open.last_mut()
        {
            words.push_str(before);
        }
        let end = if after.starts_with("!--") { "-->" } else { ">" };
        let (tag, after) = after.split_once(end).ok_or("a tag without its end")?;
        rest = after;
        if tag.starts_with(['!', '?']) {
            continue;
        }
        if !tag.starts_with('/') {
            let name = tag
                .split([' ', '\t', '\n', '\r', '/'])
                .next()
                .unwrap_or_default();
            let is_empty = tag.ends_with('/');
            match (open.len() == DEEPEST, is_empty) {
                (true, false) => beyond += 1,
                (false, false) => open.push((name.to_owned(), Vec::new(), String::new())),
                (_, true) => {}
            }
            continue;
        }
        if beyond > 0 {
            beyond -= 1;
            continue;
        }
        let Some((name, children, words)) = open.pop() else {
            return Err("an end without its tag".to_owned());
        };
        if name != tag[1..].trim() {
            return Err(format!("the end of another tag than {name:?}"));
        }
        let value = match children.is_empty() {
            true => Value::Text(words.trim().to_owned()),
            // OpenCV names the items of a list so.
            false if children.iter().all(|(key, _)| key == "_") => {
                Value::List(children.into_iter().map(|(_, value)| value).collect())
            }
            false => Value::Map(children),
        };
        match open.last_mut() {
            None => return Ok(value),
            Some((_, siblings, _)) => siblings.push((name, value)),
        }
    }
    Err("no element that ends".to_owned())
}
