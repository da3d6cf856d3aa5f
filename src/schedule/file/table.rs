//! A table of cells as somebody's program wrote it: text with any usual separator, or a worksheet.

use super::columns::{Column, column_of};
use crate::error::{Error, Result};
use crate::schedule::{MAX_POSITIONS, text};

/// Separators that are tried; of equally good ones the first.
const SEPARATORS: [char; 4] = [',', ';', '\t', '|'];
/// Rows among which the names of the columns are looked for: a title may come first.
const HEADER_WITHIN: usize = 30;
/// Columns of a table that are read.
pub(super) const MOST_COLUMNS: usize = 256;
/// As many known names make a row the header.
const ENOUGH_NAMES: usize = 2;

/// A cell.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Cell {
    /// As it is written; empty where there is none.
    pub text: String,
    /// Whether it was kept as a number, which no decimal comma can be in.
    pub is_number: bool,
}

impl Cell {
    /// As text has it: without blanks around it.
    pub fn written(text: &str) -> Self {
        Self {
            text: text.trim().to_owned(),
            is_number: false,
        }
    }

    /// Of a worksheet's number.
    pub fn number(value: f64) -> Self {
        Self {
            text: format!("{value:?}"),
            is_number: true,
        }
    }

    pub fn is_empty(&self) -> bool {
        self.text.is_empty()
    }
}

/// A row that is not empty.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Row {
    /// Where it stands, from 1.
    pub line: usize,
    /// Its cells; of a comment without the sign that makes it one.
    pub cells: Vec<Cell>,
    pub is_comment: bool,
}

impl Row {
    /// None for an empty one, or the row of nothing but separators that spreadsheets add.
    pub fn new(line: usize, mut cells: Vec<Cell>) -> Option<Self> {
        let is_comment = cells.first().is_some_and(|c| c.text.starts_with('#'));
        if is_comment {
            cells[0] = Cell::written(cells[0].text.trim_start_matches('#'));
        }
        cells.iter().any(|c| !c.is_empty()).then_some(Self {
            line,
            cells,
            is_comment,
        })
    }

    /// How many columns it names, with their unit or without.
    fn names(&self) -> usize {
        let known = |cell: &&Cell| column_of(&cell.text) != Column::Other;
        self.cells.iter().filter(known).count()
    }
}

/// The rows of a schedule.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    /// Where the columns are named.
    pub header: Row,
    pub rows: Vec<Row>,
    /// Whether a comma separates cells, and so hardly stands in numbers.
    pub commas_separate: bool,
    /// The worksheet that it is from.
    pub sheet: Option<String>,
}

impl Table {
    /// From its rows; none where no row names columns.
    pub fn new(rows: Vec<Row>, commas_separate: bool, sheet: Option<String>) -> Option<Self> {
        let first = rows.iter().take(HEADER_WITHIN);
        let at = first.enumerate().find_map(|(i, row)| {
            // The names may stand in a comment; but a comment that mentions two of them is none
            // where the names themselves follow.
            let after = rows[i + 1..].iter().take(HEADER_WITHIN);
            let named_again = row.is_comment
                && after
                    .into_iter()
                    .any(|r| !r.is_comment && r.names() >= ENOUGH_NAMES);
            (row.names() >= ENOUGH_NAMES && !named_again).then_some(i)
        })?;
        let mut rows = rows.into_iter().skip(at);
        let header = rows.next()?;
        Some(Self {
            header,
            rows: rows.filter(|row| !row.is_comment).collect(),
            commas_separate,
            sheet,
        })
    }

    /// The table of a text.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] where no row names the columns.
    pub fn of_text(document: &str) -> Result<Self> {
        let lines = logical_lines(document);
        let tables = SEPARATORS
            .map(|separator| Self::new(kept_rows(&lines, separator), separator == ',', None));
        let mut best: Option<Self> = None;
        for table in tables.into_iter().flatten() {
            if best
                .as_ref()
                .is_none_or(|b| table.header.names() > b.header.names())
            {
                best = Some(table);
            }
        }
        best.ok_or_else(|| no_header(&lines))
    }
}

/// The rows of a text, as many as a schedule may have and a few more; of comments those before it.
fn kept_rows(lines: &[(usize, String)], separator: char) -> Vec<Row> {
    const ENOUGH: usize = MAX_POSITIONS + 2 * HEADER_WITHIN;
    let mut kept: Vec<Row> = Vec::new();
    for (line, content) in lines {
        let cells = cells(content, separator).into_iter();
        let row = Row::new(*line, cells.map(|c| Cell::written(&c)).collect());
        kept.extend(row.filter(|r| !r.is_comment || kept.len() < HEADER_WITHIN));
        if kept.len() > ENOUGH {
            break;
        }
    }
    kept
}

/// The lines of a text with their numbers; one in which a quote stays open goes on in the next.
fn logical_lines(document: &str) -> Vec<(usize, String)> {
    // Files of some spreadsheets end their lines with a carriage return alone.
    let end = if document.contains('\n') { '\n' } else { '\r' };
    let mut lines: Vec<(usize, String)> = Vec::new();
    let mut open: Option<(usize, String)> = None;
    for (i, line) in document.split(end).enumerate() {
        let line = line.strip_suffix('\r').unwrap_or(line);
        let is_closed = line.matches('"').count() % 2 == 0;
        open = match (open, is_closed) {
            (None, true) => {
                lines.push((i + 1, line.to_owned()));
                None
            }
            (None, false) => Some((i + 1, line.to_owned())),
            (Some((from, mut before)), is_closed) => {
                before.push('\n');
                before.push_str(line);
                match is_closed {
                    true => Some((from, before)),
                    false => {
                        lines.push((from, before));
                        None
                    }
                }
            }
        };
    }
    // A quote that is never closed is a cell's text, not the rest of the file.
    if let Some((from, rest)) = open {
        lines.extend(
            rest.split('\n')
                .enumerate()
                .map(|(i, l)| (from + i, l.to_owned())),
        );
    }
    // What a spreadsheet is told about the separator is none of the table.
    lines.retain(|(_, line)| !line.trim().to_ascii_lowercase().starts_with("sep="));
    lines
}

/// A line, cut at its separators.
fn cells(line: &str, separator: char) -> Vec<String> {
    let pieces = || line.split(separator).take(MOST_COLUMNS);
    let by_hand = || pieces().map(str::to_owned).collect();
    if !line.contains('"') {
        return by_hand();
    }
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .delimiter(separator as u8)
        .trim(csv::Trim::All)
        .from_reader(line.as_bytes());
    let mut records = reader.records();
    match records.next() {
        Some(Ok(record)) => record
            .iter()
            .take(MOST_COLUMNS)
            .map(str::to_owned)
            .collect(),
        _ => by_hand(),
    }
}

/// Why a text is no table of a schedule.
fn no_header(lines: &[(usize, String)]) -> Error {
    let content = |(_, line): &&(usize, String)| {
        let line = line.trim();
        !line.is_empty() && !line.starts_with('#')
    };
    let allowed = "a line that names the columns: alpha_deg, beta_deg, gamma_deg, dwell_s";
    let Some((line, first)) = lines.iter().find(content) else {
        return Error::input("the file holds no schedule")
            .with_line(1)
            .with_allowed(allowed);
    };
    let error = Error::input("no line names the columns of a schedule")
        .with_line(*line)
        .with_value(text::shown(first))
        .with_allowed(allowed);
    error.with_hint(
        "from a spreadsheet: save it as .xlsx, or as CSV with a first line of these names",
    )
}
