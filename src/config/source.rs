//! Reading a platform file, and knowing where each of its values came from.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

use super::keys::{self, Absent};
use super::{CheckedConfig, StudyConfig};
use crate::error::{Error, Result};
use crate::schedule::text;

/// The commented platform file with the default of every key.
pub const DEFAULT_TOML: &str = include_str!("default.toml");

/// A study together with where its values came from: the file and line of those given, and
/// which were not given.
#[derive(Debug, Clone, PartialEq)]
pub struct StudySource {
    /// The values, defaults filled in. Change them freely before [`StudySource::check`], and say
    /// so with [`StudySource::override_key`].
    pub config: StudyConfig,
    file: Option<PathBuf>,
    lines: BTreeMap<String, usize>,
    defaulted: Vec<String>,
    overridden: Vec<String>,
}

impl StudySource {
    /// Reads a platform file.
    ///
    /// # Errors
    ///
    /// [`Error::is_io`] when the file cannot be read, otherwise as [`StudySource::parse`].
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(
            &text::read_text(path, text::MAX_PLATFORM_BYTES)?,
            Some(path),
        )
    }

    /// Takes the `text` of a platform file; `file` is what errors name.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] with line, key, value and what is allowed: for text that is not TOML,
    /// unknown keys (with a suggestion), keys given twice, and values of a wrong type. Ranges are
    /// for [`StudySource::check`].
    ///
    /// ```
    /// use scheme_opt::internals::config::StudySource;
    /// let error = StudySource::parse("[site]\nlatitude = 28.2\n", None).unwrap_err();
    /// assert_eq!(error.line(), Some(2));
    /// assert!(error.to_string().contains("did you mean `latitude_deg`?"));
    /// ```
    pub fn parse(text: &str, file: Option<&Path>) -> Result<Self> {
        let document = Document::parse(text::without_bom(text));
        let (mut config, document) =
            document
                .and_then(Document::into_config)
                .map_err(|e| match file {
                    Some(file) => e.with_file(file),
                    None => e,
                })?;
        let lines: BTreeMap<_, _> = document.into_iter().map(|(k, p)| (k, p.line)).collect();
        if let Some(folder) = file.and_then(Path::parent) {
            // As a person writes it: beside the file that names it.
            let named = [
                &mut config.objective.use_profile,
                &mut config.platform.gimbals.allowed,
            ];
            for path in named.into_iter().flatten() {
                *path = folder.join(&*path);
            }
        }
        Ok(Self {
            config,
            file: file.map(Path::to_owned),
            defaulted: defaulted(|key| lines.contains_key(key)),
            lines,
            overridden: Vec::new(),
        })
    }

    /// The embedded default platform, [`DEFAULT_TOML`], with every key defaulted.
    pub fn embedded_default() -> Self {
        Self {
            config: StudyConfig::default(),
            file: None,
            lines: BTreeMap::new(),
            defaulted: defaulted(|_| false),
            overridden: Vec::new(),
        }
    }

    /// The source of values that a program has put together. What differs from the default has been
    /// given; nobody can tell of the rest.
    pub fn of_config(config: StudyConfig) -> Self {
        // A configuration that JSON cannot hold has a number that is not finite: its check refuses it.
        let json = |config: &StudyConfig| serde_json::to_value(config).unwrap_or_default();
        let [given, default] = [&config, &StudyConfig::default()].map(json);
        let pointer = |key: &str| format!("/{}", key.replace('.', "/"));
        let differs = |key: &str| given.pointer(&pointer(key)) != default.pointer(&pointer(key));
        Self {
            file: None,
            lines: BTreeMap::new(),
            defaulted: defaulted(differs),
            overridden: Vec::new(),
            config,
        }
    }

    /// The file it was read from, if any.
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// The keys that were not given, in dotted form and in the order of the file. Keys that
    /// have no value unless given are not among them, except where leaving them out is an
    /// assumption (gimbal ranges, slew rate).
    pub fn defaulted(&self) -> &[String] {
        &self.defaulted
    }

    /// Notes that `config` now holds something else at `key`, in dotted form: the value is not
    /// a default any more, and errors about it do not point into the file. A table
    /// (`objective.spec_deg_per_h`) stands for all keys inside it.
    pub fn override_key(&mut self, key: &str) {
        self.lines.retain(|known, _| !covers(key, known));
        self.defaulted.retain(|known| !covers(key, known));
        self.overridden.push(key.to_owned());
    }

    /// Checks every value, and the values against each other.
    ///
    /// # Errors
    ///
    /// As [`StudyConfig::check`], with file and line of the value that is not acceptable.
    pub fn check(&self) -> Result<CheckedConfig> {
        self.config.check().map_err(|e| self.located(e))
    }

    /// The study checked, for evaluating a schedule that is given.
    ///
    /// # Errors
    ///
    /// As [`StudyConfig::check_for_evaluation`], with file and line.
    pub fn check_for_evaluation(&self) -> Result<CheckedConfig> {
        self.config
            .check_for_evaluation()
            .map_err(|e| self.located(e))
    }

    /// Adds where the value that `error` is about was given, unless it is about another file.
    pub(crate) fn located(&self, error: Error) -> Error {
        if error.file().is_some() {
            return error;
        }
        let (Some(key), Some(file)) = (error.key(), &self.file) else {
            return match error.key().and_then(|key| self.line(key)) {
                Some(line) => error.with_line(line),
                None => error,
            };
        };
        if self.overridden.iter().any(|o| covers(o, key)) {
            return error;
        }
        match self.line(key) {
            Some(line) => error.with_line(line).with_file(file),
            None => error.with_file(file),
        }
    }

    /// The line on which `key` is given, if it is.
    fn line(&self, key: &str) -> Option<usize> {
        self.lines.get(key).copied()
    }
}

/// True when `key` is `outer` or inside it.
fn covers(outer: &str, key: &str) -> bool {
    key.strip_prefix(outer)
        .is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

/// The keys for which a value is assumed, when those are given of which `given` is true.
fn defaulted(given: impl Fn(&str) -> bool) -> Vec<String> {
    keys::KNOWN
        .iter()
        .filter(|(key, absent)| {
            let is_replaced = (key == keys::RANDOM_DRIFT && given(keys::RANDOM_WALK))
                || (key == keys::NOISE && given(keys::NOISE_DENSITY));
            *absent == Absent::Assumed && !given(key) && !is_replaced
        })
        .map(|(key, _)| key.clone())
        .collect()
}

/// Where in the text a key is given.
struct Place {
    line: usize,
    value: Range<usize>,
}

/// A TOML document all of whose keys are known.
struct Document<'a> {
    text: &'a str,
    root: DeTable<'a>,
    places: BTreeMap<String, Place>,
}

impl<'a> Document<'a> {
    fn parse(text: &'a str) -> Result<Self> {
        let root = DeTable::parse(text).map_err(|e| syntax_error(text, &e).with_source(e))?;
        let root = root.into_inner();
        let mut places = BTreeMap::new();
        visit(text, "", &root, &mut places)?;
        Ok(Self { text, root, places })
    }

    /// The configuration, and where each key is given.
    fn into_config(mut self) -> Result<(StudyConfig, BTreeMap<String, Place>)> {
        let mut config = StudyConfig::default();
        // Table by table and not as a whole, because the flattened StudyConfig would lose the
        // places of wrong values.
        self.table("test", &mut config.test)?;
        self.table("site", &mut config.platform.site)?;
        self.table("accelerometer", &mut config.platform.accelerometer)?;
        self.table("gyro", &mut config.platform.gyro)?;
        self.table("filter", &mut config.platform.filter)?;
        self.table("prior", &mut config.platform.prior)?;
        self.table("gimbals", &mut config.platform.gimbals)?;
        self.table("stand", &mut config.platform.stand)?;
        self.table("motion", &mut config.platform.motion)?;
        self.table("azimuth", &mut config.platform.azimuth)?;
        // What is flattened would lose the places too.
        let errors = &mut config.platform.errors;
        self.table_in("errors", "considered", &mut errors.considered)?;
        self.table("errors", &mut errors.estimated)?;
        self.table("objective", &mut config.objective)?;
        self.table("search", &mut config.search)?;
        config.resolve();
        Ok((config, self.places))
    }

    /// Reads one table, if it is there.
    fn table<T: DeserializeOwned>(&mut self, name: &str, into: &mut T) -> Result<()> {
        let value = self.root.remove(name);
        self.value(value, into)
    }

    /// Takes a table out of another one and reads it, if it is there.
    fn table_in<T: DeserializeOwned>(
        &mut self,
        outer: &str,
        name: &str,
        into: &mut T,
    ) -> Result<()> {
        let value = match self.root.get_mut(outer).map(Spanned::get_mut) {
            Some(DeValue::Table(table)) => table.remove(name),
            _ => None,
        };
        self.value(value, into)
    }

    fn value<T: DeserializeOwned>(
        &self,
        value: Option<Spanned<DeValue<'a>>>,
        into: &mut T,
    ) -> Result<()> {
        if let Some(value) = value {
            *into = T::deserialize(ValueDeserializer::from(value))
                .map_err(|e| self.type_error(&e).with_source(e))?;
        }
        Ok(())
    }

    /// A value that does not have the type of its key.
    fn type_error(&self, e: &toml::de::Error) -> Error {
        let (what, expected) = explained(e.message());
        let error = Error::input(what.clone());
        let Some((key, place)) = e.span().and_then(|span| self.innermost(span.start)) else {
            return error;
        };
        let mut raw = self.text.get(place.value.clone()).unwrap_or_default();
        let is_in_list = keys::is_list(key) && raw.starts_with('[');
        if is_in_list && let Some(element) = e.span().and_then(|span| self.text.get(span)) {
            // Of a list of names, the one that is wrong.
            raw = element;
        }
        let bare = raw.trim_matches(['"', '\'']).trim();
        let mut error = error.with_key(key).with_line(place.line);
        // The span of a table is its header, which is no value to show.
        if !raw.starts_with('[') || raw.contains(',') {
            error = error.with_value(text::shown(raw));
        }
        if keys::is_list(key) && !is_in_list {
            return error.with_allowed("a list of names, such as [\"D_IX\", \"D_IZ\"]");
        }
        if let Some(choices) = keys::choices(key) {
            let names: Vec<_> = choices.iter().map(|c| format!("\"{c}\"")).collect();
            let error = error.with_allowed(names.join(", "));
            return text::with_nearest(error, bare, choices);
        }
        if let Some(example) = keys::example(key).filter(|_| !what.contains("unknown field")) {
            error = error.with_allowed(example);
        } else if let Some((_, allowed)) = keys::array_shape(key) {
            error = error.with_allowed(allowed);
        } else if let Some(expected) = expected {
            error = error.with_allowed(expected);
        }
        if bare != raw && bare.parse::<f64>().is_ok() {
            error = error.with_hint("write the number without quotes");
        }
        error
    }

    /// The key whose value holds the byte at `offset`, the innermost of them.
    fn innermost(&self, offset: usize) -> Option<(&str, &Place)> {
        self.places
            .iter()
            .filter(|(_, place)| place.value.contains(&offset))
            .min_by_key(|(_, place)| place.value.len())
            .map(|(key, place)| (key.as_str(), place))
    }
}

/// Goes through the keys of a table: refuses unknown ones and notes the places of the others.
fn visit(
    text: &str,
    path: &str,
    table: &DeTable<'_>,
    places: &mut BTreeMap<String, Place>,
) -> Result<()> {
    // In the order of the text, so that of several mistakes the first is reported.
    let mut entries: Vec<_> = table.iter().collect();
    entries.sort_by_key(|(name, _)| name.span().start);
    for (name, value) in entries {
        let line = text::line_at(text, name.span().start);
        let name = name.get_ref().as_ref();
        let key = match path {
            "" => name.to_owned(),
            _ => format!("{path}.{name}"),
        };
        let fail = |e: Error| e.with_key(key.clone()).with_line(line);
        // A quoted name could hold dots and pass for a path.
        if name.contains('.') || !(keys::is_value(&key) || keys::is_table(&key)) {
            return Err(unknown_key(path, name).with_line(line));
        }
        let place = Place {
            line,
            value: value.span(),
        };
        places.insert(key.clone(), place);
        match value.get_ref() {
            DeValue::Table(inner) if keys::is_table(&key) => visit(text, &key, inner, places)?,
            _ if !keys::is_value(&key) => return Err(fail(not_a_table(text, &key, value))),
            DeValue::Array(array) => {
                // Reading an array of fixed length stops at its end and would drop the rest.
                if let Some((length, allowed)) = keys::array_shape(&key)
                    && array.len() != length
                {
                    let raw = text.get(value.span()).unwrap_or_default();
                    return Err(fail(
                        Error::input("wrong number of values")
                            .with_value(text::shown(raw))
                            .with_allowed(allowed),
                    ));
                }
            }
            _ => {}
        }
    }
    Ok(())
}

fn not_a_table(text: &str, key: &str, value: &Spanned<DeValue<'_>>) -> Error {
    let error = Error::input("not a table").with_allowed(format!("a table [{key}]"));
    let error = match value.get_ref() {
        // For `[[table]]` the span is no value that could be shown.
        DeValue::Array(_) => error,
        _ => error.with_value(text::shown(text.get(value.span()).unwrap_or_default())),
    };
    if key == "objective.spec_deg_per_h" {
        return error.with_hint("one value for all coefficients is spec_deg_per_h.default = 0.005");
    }
    error
}

fn unknown_key(path: &str, name: &str) -> Error {
    let known = keys::names_in(path);
    let shown_name = text::shown(name);
    let error = Error::input("unknown key")
        .with_key(match path {
            "" => shown_name,
            _ => format!("{path}.{shown_name}"),
        })
        .with_allowed(known.join(", "));
    if let Some(key) = keys::elsewhere(path, name) {
        return error.with_hint(format!("did you mean `{key}`?"));
    }
    text::with_nearest(error, name, known)
}

/// A text that is not TOML.
fn syntax_error(text: &str, e: &toml::de::Error) -> Error {
    let error = Error::input(match e.message() {
        "recursion limit" => "keys or values nested too deeply",
        message => message,
    });
    let Some(span) = e.span() else {
        return error;
    };
    let line = text::line_at(text, span.start);
    let mut error = error.with_line(line);
    let found = text.get(span).unwrap_or_default();
    if e.message().contains("duplicate key") {
        error = error.with_key(text::shown(found));
    }
    let content = text.lines().nth(line - 1).unwrap_or_default();
    if has_decimal_comma(content) {
        error = error.with_hint("write decimals with a point, 28.2");
    }
    error
}

/// True for `key = 28,2`.
fn has_decimal_comma(line: &str) -> bool {
    let value = line.split('#').next().and_then(|l| l.split_once('='));
    value.is_some_and(|(_, value)| {
        let parts: Vec<&str> = value.trim().split(',').collect();
        let is_digits = |s: &&str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
        let whole = |s: &str| is_digits(&s.trim_start_matches(['-', '+']));
        parts.len() == 2 && whole(parts[0]) && is_digits(&parts[1])
    })
}

/// The words of a type error: what is wrong, and what was expected, without the names of Rust
/// types.
fn explained(message: &str) -> (String, Option<String>) {
    let expected = message.split_once("expected ").map(|(_, expected)| {
        let expected = expected.trim();
        match expected {
            "f64" => "a number".to_owned(),
            "usize" | "u64" => "a whole number, 0 or more".to_owned(),
            "a boolean" => "true or false".to_owned(),
            _ => expected.to_owned(),
        }
    });
    let what = if message.starts_with("invalid type") || message.starts_with("wanted string") {
        "wrong type"
    } else if message.starts_with("unknown variant") {
        "no such choice"
    } else if message.starts_with("invalid value") || message.starts_with("invalid length") {
        "value out of range"
    } else {
        message.split(", expected").next().unwrap_or(message)
    };
    (what.to_owned(), expected)
}

#[cfg(test)]
#[path = "source_tests.rs"]
mod tests;
