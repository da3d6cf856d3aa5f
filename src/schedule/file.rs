//! Schedules as files: JSON and CSV, read and written.
//!
//! JSON, schema [`SCHEMA`]:
//!
//! ```json
//! {
//!   "schema": "scheme-opt/schedule/1",
//!   "positions": [
//!     {"alpha_deg": 0.0, "beta_deg": 0.0, "gamma_deg": 0.0, "dwell_s": 600.0},
//!     {"alpha_deg": 90.0, "beta_deg": 0.0, "gamma_deg": 0.0, "dwell_s": 600.0, "move_s": 180.0, "move_measured": true}
//!   ]
//! }
//! ```
//!
//! A position that is not reached the short way round has `"change_deg": [Δα, Δβ, Δγ]`, the way
//! taken from the position before. `"pinned": true` marks one that a search which begins with the
//! schedule keeps; in tables `pinned` is true, yes, 1 or x.
//!
//! CSV: the same columns with a header line, in any order, `change_deg` as `alpha_change_deg`,
//! `beta_change_deg`, `gamma_change_deg`; what is optional may be left out, as columns or as single
//! empty cells. Lines that start with `#` and empty lines are
//! skipped.
//!
//! Tables that people have are read too: Excel workbooks (.xlsx), semicolons with decimal commas,
//! tabs, UTF-16, headings such as "Alpha [°]" or "dwell (min)" in any order after a title or behind a
//! `#`; what other columns say is kept as notes. A number that may be read in two ways is refused.
//!
//! Angles are written rounded to 1e-9°, so that reading a written schedule and writing it again
//! gives the same file, and reading that gives the same schedule bit for bit. Times are written
//! exactly.

mod columns;
mod decimal;
mod json;
mod rows;
mod table;
mod workbook;

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{Notes, Schedule, ScheduledPosition, text};
use crate::attitude::Position;
use crate::error::{Error, Result};
use crate::units::round_deg;

/// Name and major version of the JSON schedule document.
pub const SCHEMA: &str = "scheme-opt/schedule/1";

/// The columns of a CSV schedule, in the order they are written.
const COLUMNS: [&str; 10] = [
    "alpha_deg",
    "beta_deg",
    "gamma_deg",
    "dwell_s",
    "move_s",
    "move_measured",
    "pinned",
    "alpha_change_deg",
    "beta_change_deg",
    "gamma_change_deg",
];
/// How many of [`COLUMNS`] every position needs.
const REQUIRED_COLUMNS: usize = 4;
/// How many of [`COLUMNS`] hold one value of a position; the rest are the three of
/// [`CHANGE_KEY`].
const SINGLE_COLUMNS: usize = 7;
/// What JSON calls the way to a position.
const CHANGE_KEY: &str = "change_deg";
/// What JSON calls the other columns of a table.
const NOTES_KEY: &str = "notes";

/// The keys of a position in JSON, in the order they are written.
fn json_keys() -> impl Iterator<Item = &'static str> {
    let single = COLUMNS.into_iter().take(SINGLE_COLUMNS);
    single.chain([CHANGE_KEY, NOTES_KEY])
}

/// A schedule as a JSON document, for use inside other documents.
///
/// [`from_json`] reads the same with errors that show line and key; this type is for what a
/// program wrote.
///
/// ```
/// use scheme_opt::internals::attitude::Position;
/// use scheme_opt::internals::schedule::file::ScheduleDocument;
/// use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
/// let position = Position::from_deg(90.0, 0.0, -45.0);
/// let schedule = Schedule::new(vec![ScheduledPosition::new(position, 600.0)])?;
/// let document = ScheduleDocument::from(&schedule);
/// assert_eq!(document.positions[0].gamma_deg, -45.0);
/// assert_eq!(Schedule::try_from(&document)?, schedule);
/// # Ok::<(), scheme_opt::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct ScheduleDocument {
    /// Name and major version of the document, [`SCHEMA`].
    #[serde(default = "current_schema")]
    pub schema: String,
    /// Version of the program that wrote it; not looked at when reading.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tool_version: Option<String>,
    /// The positions in order.
    pub positions: Vec<PositionRecord>,
}

fn current_schema() -> String {
    SCHEMA.to_owned()
}

/// One position of a schedule file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct PositionRecord {
    /// Outer angle α, degrees, −36000 to 36000.
    pub alpha_deg: f64,
    /// Middle angle β, degrees, −36000 to 36000.
    pub beta_deg: f64,
    /// Inner angle γ, degrees, −36000 to 36000.
    pub gamma_deg: f64,
    /// How long the position is held, s, 0 to 1e7.
    pub dwell_s: f64,
    /// Duration of the move to it, s, 0 to 1e7; none: as the platform moves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub move_s: Option<f64>,
    /// Whether the filter measures during that move; none: as the platform has it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub move_measured: Option<bool>,
    /// Whether a search that begins with the schedule (`search --from`) keeps the position.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub pinned: bool,
    /// The way taken from the position before (the first: from the start attitude), changes of
    /// (α, β, γ), degrees, congruent to the target modulo 360; none: the short way on unlimited
    /// axes, half turns positive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub change_deg: Option<[f64; 3]>,
    /// What else a table says of it: heading and text. Nothing is made of them.
    #[serde(default, skip_serializing_if = "Notes::is_empty")]
    pub notes: Notes,
}

impl From<&ScheduledPosition> for PositionRecord {
    fn from(p: &ScheduledPosition) -> Self {
        // Adding zero turns a negative zero, which would look odd in a file, into a plain one.
        let [alpha_deg, beta_deg, gamma_deg] = p.position.to_deg().map(|deg| deg + 0.0);
        Self {
            alpha_deg,
            beta_deg,
            gamma_deg,
            dwell_s: p.dwell_s,
            move_s: p.move_s,
            move_measured: p.move_measured,
            pinned: p.pinned,
            change_deg: p.change_deg.map(|c| c.map(|deg| round_deg(deg) + 0.0)),
            notes: Notes::new(),
        }
    }
}

impl From<&PositionRecord> for ScheduledPosition {
    fn from(r: &PositionRecord) -> Self {
        Self {
            position: Position::from_deg(r.alpha_deg, r.beta_deg, r.gamma_deg),
            dwell_s: r.dwell_s,
            move_s: r.move_s,
            move_measured: r.move_measured,
            change_deg: r.change_deg,
            pinned: r.pinned,
        }
    }
}

impl From<&Schedule> for ScheduleDocument {
    fn from(schedule: &Schedule) -> Self {
        Self {
            schema: current_schema(),
            tool_version: None,
            positions: records(schedule).collect(),
        }
    }
}

impl TryFrom<&ScheduleDocument> for Schedule {
    type Error = Error;

    /// # Errors
    ///
    /// [`Error::is_input`] for another schema, and as [`Schedule::new`].
    fn try_from(document: &ScheduleDocument) -> Result<Self> {
        check_schema(&document.schema)?;
        let positions = document.positions.iter();
        let schedule = Self::new(positions.clone().map(Into::into).collect())?;
        Ok(schedule.with_notes(positions.map(|p| p.notes.clone()).collect()))
    }
}

/// The positions of a schedule with their notes.
fn records(schedule: &Schedule) -> impl Iterator<Item = PositionRecord> {
    let positions = schedule.positions().iter().enumerate();
    positions.map(|(i, p)| PositionRecord {
        notes: schedule.notes(i).clone(),
        ..p.into()
    })
}

/// Refuses a document that is not a schedule of this version.
fn check_schema(schema: &str) -> Result<()> {
    if schema == SCHEMA {
        return Ok(());
    }
    let error = Error::input("not a schedule document of a version known here")
        .with_key("schema")
        .with_value(text::shown(schema))
        .with_allowed(format!("\"{SCHEMA}\""));
    Err(match schema.strip_prefix("scheme-opt/") {
        Some(rest) if rest.starts_with("schedule/") => {
            error.with_hint("the file was written by another version of the program")
        }
        Some(rest) if rest.starts_with("result/") => {
            error.with_hint("a search writes its schedule to schedule.json beside result.json")
        }
        _ => error,
    })
}

/// Reads a schedule file: `.json` or `.csv` by its extension, otherwise JSON when the text
/// starts with `{` and CSV when not.
///
/// # Errors
///
/// [`Error::is_io`] when the file cannot be read; [`Error::is_input`] naming file, line, key,
/// value and what is allowed when its content is not acceptable.
pub fn read(path: &Path) -> Result<Schedule> {
    Ok(read_and(path, &|_| Ok(()))?.0)
}

/// What is made of a schedule that was read, or why it is refused.
pub(crate) type Check<'a, T> = &'a dyn Fn(&Schedule) -> Result<T>;

/// Reads a schedule file and puts the schedule to use: what `check` refuses about a position
/// (`positions[3].…`) is said with file, line and the value as it is written.
///
/// # Errors
///
/// As [`read`], and what `check` returns.
pub(crate) fn read_and<T>(path: &Path, check: Check<'_, T>) -> Result<(Schedule, T)> {
    let bytes = text::read_bytes(path, text::MAX_SCHEDULE_BYTES)?;
    let located = |e: Error| match e.line() {
        // What is about the platform names its own file.
        Some(_) if e.file().is_none() => e.with_file(path),
        _ => e,
    };
    if workbook::is_workbook(&bytes) {
        let table = workbook::table(&bytes).map_err(|e| e.with_file(path))?;
        return rows::of_table(&table, check).map_err(located);
    }
    if bytes.starts_with(OLE_MAGIC) {
        return Err(
            Error::input("a workbook of an old kind, or one with a password")
                .with_file(path)
                .with_hint("save it as .xlsx without a password, or as CSV"),
        );
    }
    let extension = path.extension().and_then(|e| e.to_str());
    let extension = extension.map(str::to_ascii_lowercase);
    let is_table = matches!(extension.as_deref(), Some("csv" | "txt" | "tsv"));
    let text = match is_table {
        true => text::decode_table(&bytes),
        false => text::decode(bytes).map_err(|e| e.with_file(path))?,
    };
    let is_json = match extension.as_deref() {
        Some("json") => true,
        _ => !is_table && text.trim_start().starts_with('{'),
    };
    let read = match is_json {
        true => json::parse_and(&text, check),
        false => rows::parse_and(&text, check),
    };
    read.map_err(located)
}

/// How .xls files begin, and workbooks with a password.
const OLE_MAGIC: &[u8] = b"\xd0\xcf\x11\xe0";

/// A schedule and what `check` makes of it.
fn checked<T>(schedule: Result<Schedule>, check: Check<'_, T>) -> Result<(Schedule, T)> {
    let schedule = schedule?;
    let made = check(&schedule)?;
    Ok((schedule, made))
}

/// A schedule from the text of a JSON document.
///
/// # Errors
///
/// [`Error::is_input`] with line, key (`positions[3].dwell_s`), value and what is allowed, for
/// text that is not JSON, unknown, missing and duplicate keys, wrong types, and as
/// [`Schedule::new`].
///
/// ```
/// use scheme_opt::internals::schedule::file::from_json;
/// let error = from_json(
///     r#"{"positions": [
///         {"alpha_deg": 0, "beta_deg": 0, "gamma_deg": 0, "dwell_s": -5}
///     ]}"#,
/// )
/// .unwrap_err();
/// assert_eq!(error.line(), Some(2));
/// assert_eq!(error.key(), Some("positions[0].dwell_s"));
/// ```
pub fn from_json(text: &str) -> Result<Schedule> {
    Ok(json::parse_and(text::without_bom(text), &|_| Ok(()))?.0)
}

/// A schedule from the text of a CSV file.
///
/// # Errors
///
/// [`Error::is_input`] with line, key (`positions[3].dwell_s`, or the column), value and what is
/// allowed, for unknown, missing and duplicate columns, cells that are no numbers, and as
/// [`Schedule::new`].
///
/// ```
/// use scheme_opt::internals::schedule::file::from_csv;
/// let schedule = from_csv("dwell_s,alpha_deg,beta_deg,gamma_deg\n600,0,0,0\n600,90,0,0\n")?;
/// assert_eq!(schedule.positions().len(), 2);
/// # Ok::<(), scheme_opt::Error>(())
/// ```
pub fn from_csv(text: &str) -> Result<Schedule> {
    Ok(rows::parse_and(text::without_bom(text), &|_| Ok(()))?.0)
}

/// The schedule as a JSON document, one position a line.
pub fn to_json(schedule: &Schedule) -> String {
    // Written by hand for one position a line; a schedule holds finite numbers only, and
    // `{:?}` of a finite number is the shortest JSON number that reads back the same.
    let mut out = format!(
        "{{\n  \"schema\": \"{SCHEMA}\",\n  \"tool_version\": \"{}\",\n  \"positions\": [\n",
        env!("CARGO_PKG_VERSION")
    );
    for (i, record) in records(schedule).enumerate() {
        let separator = if i == 0 { "" } else { ",\n" };
        let [cells @ .., alpha, beta, gamma] = cells(&record);
        let change = match alpha.is_empty() {
            true => String::new(),
            false => format!("[{alpha}, {beta}, {gamma}]"),
        };
        let fields = json_keys()
            .zip(cells.into_iter().chain([change, notes(&record.notes)]))
            .filter(|(_, cell)| !cell.is_empty());
        let fields: Vec<_> = fields.map(|(c, cell)| format!("\"{c}\": {cell}")).collect();
        let _ = write!(out, "{separator}    {{{}}}", fields.join(", "));
    }
    out.push_str("\n  ]\n}\n");
    out
}

/// Notes as a JSON object; empty where there are none.
fn notes(notes: &Notes) -> String {
    let quoted = |text: &String| serde_json::Value::from(text.as_str()).to_string();
    let entries = notes.iter();
    let entries: Vec<String> = entries
        .map(|(name, text)| format!("{}: {}", quoted(name), quoted(text)))
        .collect();
    match entries.is_empty() {
        true => String::new(),
        false => format!("{{{}}}", entries.join(", ")),
    }
}

/// The schedule as CSV; the optional columns only where some position has them, notes last.
pub fn to_csv(schedule: &Schedule) -> String {
    let records: Vec<PositionRecord> = records(schedule).collect();
    let rows: Vec<_> = records.iter().map(cells).collect();
    let used: Vec<usize> = (0..COLUMNS.len())
        .filter(|&i| rows.iter().any(|row| !row[i].is_empty()))
        .collect();
    let all_notes = records.iter().flat_map(|r| r.notes.keys());
    let named: BTreeSet<&String> = all_notes.collect();
    let header = used.iter().map(|&i| COLUMNS[i]);
    let mut lines = vec![header.chain(named.iter().map(|n| n.as_str())).collect()];
    for (row, record) in rows.iter().zip(&records) {
        let of = |name: &&String| record.notes.get(*name).map_or("", String::as_str);
        let cells = used.iter().map(|&i| row[i].as_str());
        lines.push(cells.chain(named.iter().map(of)).collect());
    }
    delimited(&lines)
}

/// Lines of CSV, with quotes where a text needs them.
fn delimited(lines: &[Vec<&str>]) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for line in lines {
        // Memory takes whatever is written, and all lines are equally long.
        let _ = writer.write_record(line);
    }
    let bytes = writer.into_inner().unwrap_or_default();
    String::from_utf8(bytes).unwrap_or_default()
}

/// The values of a position as text, in the order of [`COLUMNS`]; empty: not given.
fn cells(record: &PositionRecord) -> [String; COLUMNS.len()] {
    let number = |v: f64| format!("{v:?}");
    let change = |axis: usize| {
        let change = record.change_deg.map(|change| change[axis]);
        change.map_or_else(String::new, number)
    };
    [
        number(record.alpha_deg),
        number(record.beta_deg),
        number(record.gamma_deg),
        number(record.dwell_s),
        record.move_s.map_or_else(String::new, number),
        record
            .move_measured
            .map_or_else(String::new, |m| m.to_string()),
        match record.pinned {
            true => "true".to_owned(),
            false => String::new(),
        },
        change(0),
        change(1),
        change(2),
    ]
}

/// The index and the field of a key such as `positions[3].dwell_s` or `positions[3]`.
fn position_key(key: &str) -> Option<(usize, Option<&str>)> {
    let (index, field) = key.strip_prefix("positions[")?.split_once(']')?;
    Some((index.parse().ok()?, field.strip_prefix('.')))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn schedules() -> impl Strategy<Value = Schedule> {
        let angle = || prop_oneof![-180.0..180.0_f64, -36000.0..36000.0_f64, Just(-0.0)];
        let position = (
            [angle(), angle(), angle()],
            0.0..1e7_f64,
            proptest::option::of(0.0..1e7_f64),
            proptest::option::of(any::<bool>()),
            proptest::option::of([angle(), angle(), angle()]),
            any::<bool>(),
        );
        let position =
            position.prop_map(|(a, dwell_s, move_s, move_measured, change_deg, pinned)| {
                ScheduledPosition {
                    position: Position::from_deg(a[0], a[1], a[2]),
                    dwell_s,
                    move_s,
                    move_measured,
                    change_deg,
                    pinned,
                }
            });
        proptest::collection::vec(position, 1..5).prop_map(|p| Schedule::new(p).unwrap())
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back_bit_for_bit(schedule in schedules()) {
            let json = to_json(&schedule);
            let csv = to_csv(&schedule);
            let read = from_json(&json).unwrap();
            prop_assert_eq!(&from_csv(&csv).unwrap(), &read);
            prop_assert_eq!(to_json(&read), json);
            prop_assert_eq!(to_csv(&read), csv);
            // Angles move by the rounding of files, times not at all.
            for (a, b) in schedule.positions().iter().zip(read.positions()) {
                prop_assert_eq!((a.dwell_s, a.move_s), (b.dwell_s, b.move_s));
                for (x, y) in a.position.to_array().into_iter().zip(b.position.to_array()) {
                    prop_assert!((x - y).abs() < 1e-9 * crate::units::RAD_PER_DEG);
                }
            }
        }

        #[test]
        fn the_document_agrees_with_the_file(schedule in schedules()) {
            let written = to_json(&schedule);
            let document: ScheduleDocument = serde_json::from_str(&written).unwrap();
            let read = from_json(&written).unwrap();
            prop_assert_eq!(&Schedule::try_from(&document).unwrap(), &read);
            let serialised = serde_json::to_string(&ScheduleDocument::from(&schedule)).unwrap();
            prop_assert_eq!(from_json(&serialised).unwrap(), read);
        }

        #[test]
        fn no_text_makes_the_readers_panic(text in ".{0,80}") {
            let _ = (from_json(&text), from_csv(&text));
        }
    }

    #[test]
    fn files_look_as_documented() {
        let mut position = ScheduledPosition::new(Position::from_deg(90.0, -0.0, 1e-9), 600.0);
        let one = Schedule::new(vec![position]).unwrap();
        assert_eq!(
            to_csv(&one),
            "alpha_deg,beta_deg,gamma_deg,dwell_s\n90.0,0.0,1e-9,600.0\n"
        );
        position.move_measured = Some(true);
        let two = Schedule::new(vec![one.positions()[0], position]).unwrap();
        assert!(to_csv(&two).ends_with("90.0,0.0,1e-9,600.0,\n90.0,0.0,1e-9,600.0,true\n"));
        assert!(to_json(&two).contains("\"dwell_s\": 600.0, \"move_measured\": true}\n  ]"));
        assert!(to_json(&two).ends_with("}\n"));
        position.change_deg = Some([-270.0, 0.0, 1e-9]);
        let round = Schedule::new(vec![one.positions()[0], position]).unwrap();
        assert!(to_csv(&round).ends_with("90.0,0.0,1e-9,600.0,true,-270.0,0.0,1e-9\n"));
        assert!(to_json(&round).contains("true, \"change_deg\": [-270.0, 0.0, 1e-9]}\n"));
        position = one.positions()[0];
        position.pinned = true;
        let held = Schedule::new(vec![position, one.positions()[0]]).unwrap();
        let rows = "dwell_s,pinned\n90.0,0.0,1e-9,600.0,true\n90.0,0.0,1e-9,600.0,\n";
        assert!(to_csv(&held).ends_with(rows));
        assert!(to_json(&held).contains("\"dwell_s\": 600.0, \"pinned\": true},\n"));
    }

    #[test]
    fn the_format_is_told_by_extension_or_content() {
        let dir = tempfile::tempdir().unwrap();
        let schedule =
            Schedule::new(vec![ScheduledPosition::new(Position::default(), 1.0)]).unwrap();
        for (name, content) in [
            ("a.json", to_json(&schedule)),
            ("a.csv", to_csv(&schedule)),
            ("a.CSV", format!("\u{feff}{}", to_csv(&schedule))),
            ("json", format!("\u{feff} \n{}", to_json(&schedule))),
            ("csv.txt", format!("# a comment\n{}", to_csv(&schedule))),
        ] {
            let path = dir.path().join(name);
            std::fs::write(&path, content).unwrap();
            assert_eq!(read(&path).unwrap(), schedule, "{name}");
        }
        let path = dir.path().join("bad.csv");
        std::fs::write(&path, "alpha_deg,beta_deg,gamma_deg,dwell_s\n0,0,0,x\n").unwrap();
        let error = read(&path).unwrap_err();
        assert_eq!(error.file(), Some(path.as_path()));
        assert_eq!(error.line(), Some(2));
        assert!(read(&dir.path().join("missing.csv")).unwrap_err().is_io());
    }

    #[test]
    fn other_documents_are_refused_with_advice() {
        for (schema, advice) in [
            ("scheme-opt/schedule/2", "another version"),
            ("scheme-opt/result/1", "schedule.json"),
            ("something", "not a schedule document"),
        ] {
            let text = format!("{{\"schema\": \"{schema}\", \"status\": 1}}");
            let error = from_json(&text).unwrap_err();
            assert_eq!(error.key(), Some("schema"));
            assert_eq!(error.allowed(), Some("\"scheme-opt/schedule/1\""));
            assert!(error.to_string().contains(advice), "{error}");
        }
    }
}
