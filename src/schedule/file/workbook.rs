//! Worksheets of Excel (.xlsx) as tables.
//!
//! Cells are read one by one and only as many as a schedule can have: a sheet with one cell in its
//! far corner would take gigabytes as a whole.

use std::io::Cursor;

use calamine::{DataRef, Xlsx, XlsxError};

use super::COLUMNS;
use super::table::{Cell, MOST_COLUMNS, Row, Table};
use crate::error::{Error, Result};
use crate::schedule::MAX_POSITIONS;

/// Rows of a sheet that are read.
const MOST_ROWS: usize = 2 * MAX_POSITIONS;

/// Whether the bytes are a zip archive, which .xlsx files are.
pub(super) fn is_workbook(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04")
}

/// The table of the only sheet that holds a schedule.
///
/// # Errors
///
/// [`Error::is_input`] for a file that is no workbook, one without a schedule or with several.
pub(super) fn table(bytes: &[u8]) -> Result<Table> {
    let mut workbook: Xlsx<_> = calamine::Reader::new(Cursor::new(bytes)).map_err(not_readable)?;
    let mut found: Vec<Table> = Vec::new();
    let names = calamine::Reader::sheet_names(&workbook);
    for name in &names {
        let rows = rows(&mut workbook, name)?;
        found.extend(Table::new(rows, false, Some(name.clone())));
    }
    let sheets = |tables: &[Table]| {
        let names = tables.iter().filter_map(|t| t.sheet.clone());
        names.collect::<Vec<_>>().join(", ")
    };
    match found.len() {
        0 => Err(Error::input("no worksheet names the columns of a schedule")
            .with_value(names.join(", "))
            .with_allowed(format!("a row {}, in one of them", COLUMNS[..4].join(", ")))),
        1 => Ok(found.remove(0)),
        _ => Err(Error::input("several worksheets hold schedules")
            .with_value(sheets(&found))
            .with_allowed("one")
            .with_hint("save the one that is meant as a file of its own")),
    }
}

fn not_readable(error: XlsxError) -> Error {
    Error::input("not an Excel workbook that can be read")
        .with_hint("save the sheet as .xlsx without a password, or as CSV")
        .with_source(error)
}

/// The rows of a sheet that are not empty.
fn rows(workbook: &mut Xlsx<Cursor<&[u8]>>, name: &str) -> Result<Vec<Row>> {
    let mut reader = match workbook.worksheet_cells_reader(name) {
        Ok(reader) => reader,
        // A sheet of charts has no cells.
        Err(XlsxError::NotAWorksheet(_)) => return Ok(Vec::new()),
        Err(error) => return Err(not_readable(error)),
    };
    let mut lines: Vec<Vec<Cell>> = Vec::new();
    while let Some(cell) = reader.next_cell().map_err(not_readable)? {
        let (row, column) = cell.get_position();
        let (row, column) = (row as usize, column as usize);
        if *cell.get_value() == DataRef::Empty {
            continue;
        }
        if row >= MOST_ROWS || column >= MOST_COLUMNS {
            return Err(Error::input("the worksheet is too large")
                .with_key(name)
                .with_line(row + 1)
                .with_allowed(format!("{MOST_ROWS} rows, {MOST_COLUMNS} columns"))
                .with_hint("copy the schedule into a sheet of its own"));
        }
        if lines.len() <= row {
            lines.resize(row + 1, Vec::new());
        }
        if lines[row].len() <= column {
            lines[row].resize(column + 1, Cell::default());
        }
        lines[row][column] = cell_of(cell.get_value());
    }
    let numbered = lines.into_iter().enumerate();
    Ok(numbered
        .filter_map(|(i, cells)| Row::new(i + 1, cells))
        .collect())
}

fn cell_of(value: &DataRef<'_>) -> Cell {
    match value {
        DataRef::Int(v) => Cell::number(*v as f64),
        DataRef::Float(v) => Cell::number(*v),
        DataRef::String(text) => Cell::written(text),
        DataRef::SharedString(text) => Cell::written(text),
        DataRef::Bool(v) => Cell::written(if *v { "true" } else { "false" }),
        // A time of day is no duration, and a date is none: said as what it is, and refused where a
        // number is wanted.
        DataRef::DateTime(v) => Cell::written(&format!("a date or time of day ({})", v.as_f64())),
        DataRef::DateTimeIso(v) | DataRef::DurationIso(v) => {
            Cell::written(&format!("a date or time of day ({v})"))
        }
        DataRef::Error(e) => Cell::written(&e.to_string()),
        DataRef::Empty => Cell::default(),
    }
}
