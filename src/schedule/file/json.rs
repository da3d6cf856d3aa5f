//! Reading the JSON form. Objects are taken apart key by key, each value still as its own piece
//! of the text, because where it starts in the text gives the line of whatever is wrong with it.

use std::fmt;

use serde::Deserialize;
use serde::de::{Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json::value::RawValue;

use super::{
    CHANGE_KEY, COLUMNS, Check, NOTES_KEY, PositionRecord, REQUIRED_COLUMNS, check_schema, checked,
    json_keys, position_key,
};
use crate::error::{Error, Result};
use crate::schedule::{MAX_POSITIONS, Notes, Schedule, text};

const TOP_KEYS: [&str; 3] = ["schema", "tool_version", "positions"];

/// A schedule from JSON text, and what `check` makes of it; what that refuses gets its line too.
pub(super) fn parse_and<T>(document: &str, check: Check<'_, T>) -> Result<(Schedule, T)> {
    let top = Record::parse(document, document, "")?;
    // The schema first: of some other document, its name says more than its unknown keys do.
    if let Some(schema) = top.string("schema")? {
        check_schema(&schema).map_err(|e| top.at("schema", e))?;
    }
    top.check_keys(&TOP_KEYS)?;
    top.string("tool_version")?;
    let Some(positions) = top.get("positions") else {
        return Err(top.missing("positions").with_line(1));
    };
    let items = items(document, positions)?;
    let mut records = Vec::with_capacity(items.len());
    for (i, item) in items.iter().enumerate() {
        records.push(position(document, i, item)?);
    }
    let schedule = Schedule::new(records.iter().map(Into::into).collect());
    let notes = records.into_iter().map(|r| r.notes).collect();
    let schedule = schedule.map(|s| s.with_notes(notes));
    checked(schedule, check).map_err(|e| located(document, positions, &items, e))
}

/// One element of `positions`.
fn position(document: &str, index: usize, item: &RawValue) -> Result<PositionRecord> {
    let record = Record::parse(document, item.get(), &format!("positions[{index}]"))?;
    let known: Vec<&str> = json_keys().collect();
    record.check_keys(&known)?;
    let required: &[&str] = &COLUMNS[..REQUIRED_COLUMNS];
    if let Some(name) = required.iter().find(|name| record.get(name).is_none()) {
        return Err(record.missing(name));
    }
    Ok(PositionRecord {
        alpha_deg: record.required_number("alpha_deg")?,
        beta_deg: record.required_number("beta_deg")?,
        gamma_deg: record.required_number("gamma_deg")?,
        dwell_s: record.required_number("dwell_s")?,
        move_s: record.number("move_s")?,
        move_measured: record.boolean("move_measured")?,
        pinned: record.boolean("pinned")?.unwrap_or(false),
        change_deg: record.numbers(CHANGE_KEY)?,
        notes: record.notes()?,
    })
}

/// The elements of the array `positions`.
fn items<'a>(document: &str, positions: &'a RawValue) -> Result<Vec<&'a RawValue>> {
    let fail = |e: Error| {
        e.with_key("positions")
            .with_line(text::line_of(document, positions.get()))
    };
    let Ok(items) = serde_json::from_str::<Items<'a>>(positions.get()) else {
        return Err(fail(
            Error::input("wrong type")
                .with_value(text::shown(positions.get()))
                .with_allowed("an array of positions, [{…}, {…}]"),
        ));
    };
    if items.count > MAX_POSITIONS {
        return Err(fail(
            Error::input("too many positions")
                .with_value(format!("{} positions", items.count))
                .with_allowed(format!("1 to {MAX_POSITIONS} positions")),
        ));
    }
    Ok(items.first)
}

/// Adds the line, and the value as it is written, to an error about a position.
fn located(document: &str, positions: &RawValue, items: &[&RawValue], error: Error) -> Error {
    let Some((index, field)) = error.key().and_then(position_key) else {
        return match error.key() {
            Some("positions") => error.with_line(text::line_of(document, positions.get())),
            _ => error,
        };
    };
    let Some(item) = items.get(index) else {
        return error.with_line(text::line_of(document, positions.get()));
    };
    // It was read before; only where it stands is asked for.
    let record = Record::parse(document, item.get(), "").ok();
    match record.zip(field).and_then(|(r, field)| r.get(field)) {
        Some(value) => error
            .with_line(text::line_of(document, value.get()))
            .with_value(text::shown(value.get())),
        None => error.with_line(text::line_of(document, item.get())),
    }
}

/// A JSON object in the document: its keys, and its values as pieces of the text.
struct Record<'a> {
    document: &'a str,
    /// What its keys are prefixed with in messages; empty for the top.
    path: String,
    /// Its own text. Lines are counted from here only for errors: to count them for every value of
    /// a file would take time with the square of its length.
    part: &'a str,
    entries: Vec<(String, &'a RawValue)>,
}

impl<'a> Record<'a> {
    /// The object that `part` of the document is.
    fn parse(document: &'a str, part: &'a str, path: &str) -> Result<Self> {
        let is_top = path.is_empty();
        if !is_top && !part.starts_with('{') {
            return Err(Error::input("wrong type")
                .with_line(text::line_of(document, part))
                .with_key(path)
                .with_value(text::shown(part))
                .with_allowed("an object {\"alpha_deg\": …, \"dwell_s\": …}"));
        }
        let object: Object<'a> = serde_json::from_str(part).map_err(|e| {
            // Parts were parsed as values before; only the whole document can fail here.
            let message = e.to_string();
            let what = message.split(" at line ").next().unwrap_or(&message);
            Error::input(format!("not a JSON schedule: {what}"))
                .with_line(e.line().max(1))
                .with_source(e)
        })?;
        Ok(Self {
            document,
            path: path.to_owned(),
            part,
            entries: object.0,
        })
    }

    fn get(&self, name: &str) -> Option<&'a RawValue> {
        let entry = self.entries.iter().find(|(key, _)| key == name);
        entry.map(|(_, value)| *value)
    }

    /// The name in full, `positions[3].dwell_s`.
    fn key(&self, name: &str) -> String {
        if self.path.is_empty() {
            name.to_owned()
        } else {
            format!("{}.{name}", self.path)
        }
    }

    /// Adds key and line of the value called `name`.
    fn at(&self, name: &str, error: Error) -> Error {
        let place = self.get(name).map_or(self.part, RawValue::get);
        let line = text::line_of(self.document, place);
        error.with_key(self.key(name)).with_line(line)
    }

    fn missing(&self, name: &str) -> Error {
        self.at(name, Error::input("missing"))
    }

    /// Refuses keys that are not `known`, and keys given twice.
    fn check_keys(&self, known: &[&str]) -> Result<()> {
        for (i, (name, value)) in self.entries.iter().enumerate() {
            let line = || text::line_of(self.document, value.get());
            if !known.contains(&name.as_str()) {
                let error = Error::input("unknown key")
                    .with_key(self.key(&text::shown(name)))
                    .with_line(line())
                    .with_allowed(known.join(", "));
                return Err(text::with_nearest(error, name, known.iter().copied()));
            }
            if self.entries[..i].iter().any(|(earlier, _)| earlier == name) {
                return Err(Error::input("given twice")
                    .with_key(self.key(name))
                    .with_line(line()));
            }
        }
        Ok(())
    }

    fn wrong_type(&self, name: &str, raw: &str, allowed: &str) -> Error {
        let error = Error::input("wrong type")
            .with_value(text::shown(raw))
            .with_allowed(allowed);
        self.at(name, error)
    }

    /// A number; `None` when the key is absent or its value null.
    fn number(&self, name: &str) -> Result<Option<f64>> {
        match self.get(name).map(RawValue::get) {
            None | Some("null") => Ok(None),
            Some(_) => self.required_number(name).map(Some),
        }
    }

    /// A number that must be there.
    fn required_number(&self, name: &str) -> Result<f64> {
        let Some(raw) = self.get(name).map(RawValue::get) else {
            return Err(self.missing(name));
        };
        let is_number = raw.starts_with(|c: char| c == '-' || c.is_ascii_digit());
        match raw.parse::<f64>() {
            Ok(value) if is_number && value.is_finite() => Ok(value),
            Ok(_) if is_number => {
                let error = Error::input("the number is too large").with_value(text::shown(raw));
                Err(self.at(name, error))
            }
            _ => {
                let error = self.wrong_type(name, raw, "a number");
                let quoted = raw.trim_matches('"').trim();
                Err(if quoted.parse::<f64>().is_ok() {
                    error.with_hint("write the number without quotes")
                } else {
                    error
                })
            }
        }
    }

    /// Three numbers; `None` when the key is absent or its value null.
    fn numbers(&self, name: &str) -> Result<Option<[f64; 3]>> {
        match self.get(name).map(RawValue::get) {
            None | Some("null") => Ok(None),
            Some(raw) => serde_json::from_str(raw)
                .map(Some)
                .map_err(|_| self.wrong_type(name, raw, "three numbers, [0.0, -270.0, 90.0]")),
        }
    }

    /// The notes; none when the key is absent.
    fn notes(&self) -> Result<Notes> {
        match self.get(NOTES_KEY).map(RawValue::get) {
            None | Some("null") => Ok(Notes::new()),
            Some(raw) => serde_json::from_str(raw)
                .map_err(|_| self.wrong_type(NOTES_KEY, raw, "texts by name, {\"remark\": \"…\"}")),
        }
    }

    /// A truth value; `None` when the key is absent or its value null.
    fn boolean(&self, name: &str) -> Result<Option<bool>> {
        match self.get(name).map(RawValue::get) {
            None | Some("null") => Ok(None),
            Some("true") => Ok(Some(true)),
            Some("false") => Ok(Some(false)),
            Some(raw) => Err(self.wrong_type(name, raw, "true or false")),
        }
    }

    /// A string; `None` when the key is absent.
    fn string(&self, name: &str) -> Result<Option<String>> {
        match self.get(name).map(RawValue::get) {
            None => Ok(None),
            Some(raw) => serde_json::from_str(raw)
                .map(Some)
                .map_err(|e| self.wrong_type(name, raw, "a string").with_source(e)),
        }
    }
}

/// The entries of a JSON object in order, duplicates included.
struct Object<'a>(Vec<(String, &'a RawValue)>);

impl<'de: 'a, 'a> Deserialize<'de> for Object<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct ObjectVisitor;
        impl<'de> Visitor<'de> for ObjectVisitor {
            type Value = Vec<(String, &'de RawValue)>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "an object {{\"positions\": […]}}")
            }
            fn visit_map<A: MapAccess<'de>>(
                self,
                mut map: A,
            ) -> std::result::Result<Self::Value, A::Error> {
                // An object this long repeats a key or has an unknown one among those kept.
                const ENOUGH: usize = 32;
                let mut entries = Vec::new();
                while entries.len() < ENOUGH {
                    match map.next_entry()? {
                        Some(entry) => entries.push(entry),
                        None => return Ok(entries),
                    }
                }
                while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
                Ok(entries)
            }
        }
        deserializer.deserialize_map(ObjectVisitor).map(Object)
    }
}

/// The elements of a JSON array: how many, and the first of them, one more than a schedule may
/// have at most.
struct Items<'a> {
    count: usize,
    first: Vec<&'a RawValue>,
}

impl<'de: 'a, 'a> Deserialize<'de> for Items<'a> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct ItemsVisitor;
        impl<'de> Visitor<'de> for ItemsVisitor {
            type Value = Items<'de>;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "an array")
            }
            fn visit_seq<A: SeqAccess<'de>>(
                self,
                mut seq: A,
            ) -> std::result::Result<Self::Value, A::Error> {
                let mut first = Vec::new();
                while first.len() <= MAX_POSITIONS {
                    match seq.next_element()? {
                        Some(item) => first.push(item),
                        None => {
                            let count = first.len();
                            return Ok(Items { count, first });
                        }
                    }
                }
                let mut count = first.len();
                while seq.next_element::<IgnoredAny>()?.is_some() {
                    count += 1;
                }
                Ok(Items { count, first })
            }
        }
        deserializer.deserialize_seq(ItemsVisitor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Schedule> {
        Ok(parse_and(text, &|_| Ok(()))?.0)
    }

    #[test]
    fn what_is_refused_afterwards_gets_its_line() {
        let text = "{\"positions\": [\n{\"alpha_deg\": 0, \"beta_deg\": 0, \"gamma_deg\": 0, \
                    \"dwell_s\": 1},\n{\"alpha_deg\": 9, \"beta_deg\": 0, \"gamma_deg\": 0, \
                    \"dwell_s\": 1,\n\"change_deg\": [20, 0, 0]}]}";
        for (key, line, value) in [
            ("positions[1].change_deg", Some(4), Some("[20, 0, 0]")),
            ("positions[0].alpha_deg", Some(2), Some("0")),
            ("positions[1]", Some(3), None),
            ("motion.start_deg", None, None),
        ] {
            let refuse = |_: &Schedule| -> Result<()> { Err(Error::input("no").with_key(key)) };
            let error = parse_and(text, &refuse).unwrap_err();
            assert_eq!((error.line(), error.value()), (line, value), "{key}");
        }
    }

    /// A document with `fields` as its second position, on line 4.
    fn with_position(fields: &str) -> String {
        format!(
            "{{\n\"positions\": [\n{{\"alpha_deg\": 0, \"beta_deg\": 0, \"gamma_deg\": 0, \
             \"dwell_s\": 1}},\n{{{fields}}}\n]}}"
        )
    }

    #[test]
    fn bad_positions_are_refused_with_line_key_and_value() {
        let rest = "\"alpha_deg\": 0, \"beta_deg\": 0, \"gamma_deg\": 0";
        for (field, key, value, says) in [
            ("\"dwell_s\": -1", "dwell_s", Some("-1"), "0 to 1e7"),
            ("\"dwell_s\": 1e8", "dwell_s", Some("1e8"), "0 to 1e7"),
            ("\"dwell_s\": 1e999", "dwell_s", Some("1e999"), "too large"),
            (
                "\"dwell_s\": \"60\"",
                "dwell_s",
                Some("\"60\""),
                "without quotes",
            ),
            (
                "\"dwell_s\": \"long\"",
                "dwell_s",
                Some("\"long\""),
                "a number",
            ),
            ("\"dwell_s\": null", "dwell_s", Some("null"), "a number"),
            ("\"dwell_s\": [60]", "dwell_s", Some("[60]"), "a number"),
            ("\"move_s\": 1", "dwell_s", None, "missing"),
            ("\"dwell\": 60", "dwell", None, "did you mean `dwell_s`?"),
            (
                "\"dwell_min\": 60",
                "dwell_min",
                None,
                "there is `dwell_s`, in another unit",
            ),
            (
                "\"dwell_s\": 1, \"dwell_s\": 2",
                "dwell_s",
                None,
                "given twice",
            ),
            (
                "\"dwell_s\": 1, \"move_s\": -2",
                "move_s",
                Some("-2"),
                "0 to 1e7",
            ),
            (
                "\"dwell_s\": 1, \"move_measured\": \"yes\"",
                "move_measured",
                Some("\"yes\""),
                "true or false",
            ),
            (
                "\"dwell_s\": 1, \"pinned\": 1",
                "pinned",
                Some("1"),
                "true or false",
            ),
            (
                "\"dwell_s\": 1, \"pinned\": true, \"pinned\": true",
                "pinned",
                None,
                "given twice",
            ),
            (
                "\"dwell_s\": 1, \"change_deg\": [1, 2]",
                "change_deg",
                Some("[1, 2]"),
                "three numbers",
            ),
            (
                "\"dwell_s\": 1, \"change_deg\": [1, 2, 40000]",
                "change_deg",
                Some("[1, 2, 40000]"),
                "-36000 to 36000",
            ),
        ] {
            let error = parse(&with_position(&format!("{rest}, {field}"))).unwrap_err();
            assert!(error.is_input());
            assert_eq!(error.line(), Some(4), "{error}");
            assert_eq!(error.key(), Some(format!("positions[1].{key}").as_str()));
            assert_eq!(error.value(), value, "{error}");
            assert!(error.to_string().contains(says), "{error}");
        }
    }

    #[test]
    fn the_line_is_that_of_the_value() {
        let text = with_position(
            "\"alpha_deg\": 0, \"beta_deg\": 0,\n\n \"gamma_deg\": 36001,\n\"dwell_s\": 1",
        );
        let error = parse(&text).unwrap_err();
        assert_eq!(error.line(), Some(6));
        assert_eq!(error.key(), Some("positions[1].gamma_deg"));
        assert_eq!(error.value(), Some("36001"));
    }

    #[test]
    fn bad_documents_are_refused() {
        let position = r#"{"alpha_deg": 0, "beta_deg": 0, "gamma_deg": 0, "dwell_s": 1}"#;
        let many = format!("{{\"positions\": [{}1]}}", "1,".repeat(MAX_POSITIONS));
        for (text, says) in [
            ("", "EOF"),
            ("{", "EOF"),
            ("[]", "invalid type: sequence, expected an object"),
            ("{} x", "trailing characters"),
            ("{}", "positions: missing"),
            (r#"{"positions": []}"#, "0 positions"),
            (r#"{"positions": {}}"#, "an array of positions"),
            (r#"{"positions": 3}"#, "an array of positions"),
            (r#"{"positions": [3]}"#, "positions[0] = 3: wrong type"),
            (r#"{"position": []}"#, "did you mean `positions`?"),
            (r#"{"positions": [], "positions": []}"#, "given twice"),
            (r#"{"schema": 1, "positions": []}"#, "a string"),
            (r#"{"positions": [NaN]}"#, "expected value"),
            (&many, "10001 positions"),
            (
                &format!("{{\"positions\": [{position}], \"name\": 3}}"),
                "name: unknown key",
            ),
            (
                &format!("{{\"positions\": [{position},]}}"),
                "expected value",
            ),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.is_input());
            assert!(error.line().is_some(), "{error}");
            assert!(error.to_string().contains(says), "{error}");
        }
    }

    #[test]
    fn null_and_left_out_mean_the_same_for_what_is_optional() {
        let rest = "\"alpha_deg\": 0, \"beta_deg\": 0, \"gamma_deg\": 0, \"dwell_s\": 1";
        let nulls = parse(&with_position(&format!(
            "{rest}, \"move_s\": null, \"move_measured\": null, \"pinned\": null, \"change_deg\": null"
        )));
        assert_eq!(nulls.unwrap(), parse(&with_position(rest)).unwrap());
    }

    #[test]
    fn the_longest_files_are_read() {
        // Counting lines for every value once took minutes here: its time grew with the square.
        let position = format!(
            "{{\"alpha_deg\": 0, \"beta_deg\": 0, \"gamma_deg\": 0,{} \"dwell_s\": 1}}",
            "\n".repeat(750)
        );
        let positions = vec![position.as_str(); MAX_POSITIONS].join(",");
        let good = format!("{{\"positions\": [{positions}]}}");
        assert!(good.len() > 8_000_000 && good.len() < 8 << 20);
        assert_eq!(parse(&good).unwrap().positions().len(), MAX_POSITIONS);
        let at = good.rfind("1}").unwrap();
        let error = parse(&format!("{}-1}}]}}", &good[..at])).unwrap_err();
        assert_eq!(error.line(), Some(750 * MAX_POSITIONS + 1));
    }
}
