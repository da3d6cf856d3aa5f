//! A schedule from a table: which column is what, row by row.

use super::columns::{Column, column_of, misspelt};
use super::decimal::{Decimals, number};
use super::table::{Cell, Row, Table};
use super::{
    CHANGE_KEY, COLUMNS, Check, PositionRecord, REQUIRED_COLUMNS, SINGLE_COLUMNS, checked,
    position_key,
};
use crate::error::{Error, Result};
use crate::schedule::{MAX_POSITIONS, Notes, Schedule, text};

/// A schedule from CSV text, and what `check` makes of it; what that refuses gets its line too.
pub(super) fn parse_and<T>(document: &str, check: Check<'_, T>) -> Result<(Schedule, T)> {
    of_table(&Table::of_text(document)?, check)
}

/// A schedule from a table, and what `check` makes of it.
pub(super) fn of_table<T>(table: &Table, check: Check<'_, T>) -> Result<(Schedule, T)> {
    let header = Header::new(table)?;
    let mut records = Vec::new();
    let mut notes = Vec::new();
    for row in &table.rows {
        if records.len() == MAX_POSITIONS {
            return Err(Error::input("too many positions")
                .with_key("positions")
                .with_line(row.line)
                .with_allowed(format!("1 to {MAX_POSITIONS} positions")));
        }
        records.push(header.record(records.len(), row)?);
        notes.push(header.notes(row));
    }
    let schedule = Schedule::new(records.iter().map(Into::into).collect());
    let schedule = schedule.map(|s| s.with_notes(notes));
    checked(schedule, check).map_err(|e| located(&header, &table.rows, e))
}

/// Adds the line, and the value as it is written, to an error about a position.
fn located(header: &Header, rows: &[Row], error: Error) -> Error {
    let Some((index, field)) = error.key().and_then(position_key) else {
        return match error.key() {
            Some("positions") => error.with_line(header.line),
            _ => error,
        };
    };
    let Some(row) = rows.get(index) else {
        return error.with_line(header.line);
    };
    let cells = match field {
        Some(CHANGE_KEY) => (SINGLE_COLUMNS..COLUMNS.len())
            .map(|column| header.cell(row, column).map_or("", |c| &c.text))
            .collect::<Vec<_>>()
            .join(","),
        _ => {
            let column = COLUMNS.iter().position(|c| Some(*c) == field);
            let cell = column.and_then(|column| header.cell(row, column));
            cell.map_or("", |c| &c.text).to_owned()
        }
    };
    let is_change = field == Some(CHANGE_KEY);
    let error = error.with_line(row.line);
    let error = match cells.is_empty() {
        true => error,
        false => error.with_value(text::shown(&cells)),
    };
    match is_change {
        true => error.with_hint(format!(
            "the columns are {}",
            COLUMNS[SINGLE_COLUMNS..].join(", ")
        )),
        false => error,
    }
}

/// How a table is written that leaves no doubt.
const EXPORT: &str = "save the table as .xlsx, or as CSV with decimal points and commas between the cells, or with \
     decimal commas and semicolons";

/// Where in a row each of [`COLUMNS`] is found, and in what unit.
struct Header {
    line: usize,
    /// Cells up to the last that has a name. Some programs write separators after it, under which a
    /// row must not hold anything: it would be the end of a row with decimal commas.
    width: usize,
    place: [Option<(usize, f64)>; COLUMNS.len()],
    /// Other columns, kept as notes.
    others: Vec<(usize, String)>,
    decimals: Decimals,
}

impl Header {
    fn new(table: &Table) -> Result<Self> {
        let row = &table.header;
        let last = row.cells.iter().rposition(|name| !name.is_empty());
        let mut header = Self {
            line: row.line,
            width: last.map_or(0, |i| i + 1),
            place: [None; COLUMNS.len()],
            others: Vec::new(),
            decimals: Decimals::Point,
        };
        for (i, name) in row.cells.iter().enumerate().take(header.width) {
            header.add(i, &name.text)?;
        }
        header.check_complete(row)?;
        // Marks are no numbers, whatever they look like.
        let columns = || (0..COLUMNS.len()).filter(|c| ![5, 6].contains(c));
        let rows = table.rows.iter();
        let numbers = rows.flat_map(|row| columns().filter_map(|c| header.cell(row, c)));
        header.decimals = Decimals::of(table, numbers);
        Ok(header)
    }

    /// Takes the column number `i` of that name.
    fn add(&mut self, i: usize, name: &str) -> Result<()> {
        let refuse = |what: &str| {
            Error::input(what)
                .with_key(text::shown(name))
                .with_line(self.line)
        };
        match column_of(name) {
            Column::Known { index, .. } if self.place[index].is_some() => {
                Err(refuse("the column is there twice"))
            }
            Column::Known { index, factor } => {
                self.place[index] = Some((i, factor));
                Ok(())
            }
            Column::WithoutUnit { index } => {
                let error = refuse("the column does not say its unit");
                Err(error.with_allowed(match COLUMNS[index].ends_with("_deg") {
                    true => format!("{}, or the same in rad or arcmin", COLUMNS[index]),
                    false => format!("{}, or the same in min or h", COLUMNS[index]),
                }))
            }
            Column::Other if name.is_empty() => Err(Error::input("a column without a name")
                .with_key(format!("column {}", i + 1))
                .with_line(self.line)),
            Column::Other => match misspelt(name) {
                Some(meant) => Err(refuse("unknown column")
                    .with_allowed(COLUMNS.join(", "))
                    .with_hint(format!("did you mean `{meant}`?"))),
                None => {
                    self.others.push((i, name.to_owned()));
                    Ok(())
                }
            },
        }
    }

    /// Whether every position has what it needs.
    fn check_complete(&self, row: &Row) -> Result<()> {
        let absent = (0..REQUIRED_COLUMNS).find(|&column| self.place[column].is_none());
        let Some(column) = absent else {
            return Ok(());
        };
        let names: Vec<&str> = row.cells.iter().map(|c| c.text.as_str()).collect();
        Err(Error::input("missing column")
            .with_key(COLUMNS[column])
            .with_line(self.line)
            .with_value(text::shown(&names.join(", ")))
            .with_allowed(format!(
                "the columns {}",
                COLUMNS[..REQUIRED_COLUMNS].join(", ")
            )))
    }

    /// The cell of a row under one of [`COLUMNS`]; `None` when absent or empty.
    fn cell<'a>(&self, row: &'a Row, column: usize) -> Option<&'a Cell> {
        let cell = row.cells.get(self.place[column]?.0)?;
        (!cell.is_empty()).then_some(cell)
    }

    /// What else the row says.
    fn notes(&self, row: &Row) -> Notes {
        let mut notes = Notes::new();
        for (i, name) in &self.others {
            if let Some(cell) = row.cells.get(*i).filter(|c| !c.is_empty()) {
                notes
                    .entry(name.clone())
                    .or_insert_with(|| cell.text.clone());
            }
        }
        notes
    }

    /// The number of a row under one of [`COLUMNS`], in the unit of that.
    fn number(&self, index: usize, row: &Row, column: usize) -> Result<Option<f64>> {
        let Some((cell, (_, factor))) = self.cell(row, column).zip(self.place[column]) else {
            return Ok(None);
        };
        let value = number(cell, self.decimals).map_err(|e| {
            let separated = cell.text.contains([';', '\t', '"']);
            let e = if separated { e.with_hint(EXPORT) } else { e };
            failed(index, row, column, e)
        })?;
        // Without a factor to the bit.
        Ok(Some(if factor == 1.0 { value } else { value * factor }))
    }

    /// The position that a row describes.
    fn record(&self, index: usize, row: &Row) -> Result<PositionRecord> {
        if row.cells.iter().skip(self.width).any(|c| !c.is_empty()) {
            return Err(Error::input("the line has more cells than the header")
                .with_key(format!("positions[{index}]"))
                .with_line(row.line)
                .with_value(format!("{} cells", row.cells.len()))
                .with_allowed(format!("{} cells", self.width))
                .with_hint(EXPORT));
        }
        let optional = |column: usize| self.number(index, row, column);
        let required = |column: usize| {
            let missing = || Error::input("missing").with_allowed("a number");
            optional(column)?.ok_or_else(|| failed(index, row, column, missing()))
        };
        Ok(PositionRecord {
            alpha_deg: required(0)?,
            beta_deg: required(1)?,
            gamma_deg: required(2)?,
            dwell_s: required(3)?,
            move_s: optional(4)?,
            move_measured: match self.cell(row, 5) {
                None => None,
                Some(cell) => {
                    let value = truth_value(&cell.text);
                    Some(value.map_err(|e| failed(index, row, 5, e))?)
                }
            },
            pinned: match self.cell(row, 6) {
                None => false,
                Some(cell) => mark(&cell.text).map_err(|e| failed(index, row, 6, e))?,
            },
            change_deg: match [
                optional(SINGLE_COLUMNS)?,
                optional(SINGLE_COLUMNS + 1)?,
                optional(SINGLE_COLUMNS + 2)?,
            ] {
                [Some(alpha), Some(beta), Some(gamma)] => Some([alpha, beta, gamma]),
                [None, None, None] => None,
                some => {
                    let absent = some.iter().position(Option::is_none).unwrap_or_default();
                    let error = Error::input("missing beside the other changes");
                    let error = error.with_allowed("a number, or all three left empty");
                    return Err(failed(index, row, SINGLE_COLUMNS + absent, error));
                }
            },
            notes: Notes::new(),
        })
    }
}

/// Says where an error about a cell is.
fn failed(index: usize, row: &Row, column: usize, error: Error) -> Error {
    error
        .with_key(format!("positions[{index}].{}", COLUMNS[column]))
        .with_line(row.line)
}

fn truth_value(cell: &str) -> Result<bool> {
    match cell.to_ascii_lowercase().as_str() {
        "true" | "yes" => Ok(true),
        "false" | "no" => Ok(false),
        _ => Err(Error::input("not a truth value")
            .with_value(text::shown(cell))
            .with_allowed("true or false, or empty: as the platform has it")),
    }
}

/// What people put into a cell to mark a row; worksheets hold 1.0 for 1.
fn mark(cell: &str) -> Result<bool> {
    match cell.to_ascii_lowercase().as_str() {
        "true" | "yes" | "1" | "1.0" | "x" => Ok(true),
        "false" | "no" | "0" | "0.0" => Ok(false),
        _ => Err(Error::input("not a mark")
            .with_value(text::shown(cell))
            .with_allowed("true, yes, 1 or x; false, no, 0 or empty")),
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
        let text = "alpha_deg,beta_deg,gamma_deg,dwell_s,alpha_change_deg,beta_change_deg,\
                    gamma_change_deg\n0,0,0,1,,,\n# next\n10,0,0,1,20,0,0\n";
        for (key, line, value) in [
            ("positions[1].change_deg", Some(4), Some("20,0,0")),
            ("positions[0].alpha_deg", Some(2), Some("0")),
            ("positions[1]", Some(4), None),
            ("motion.start_deg", None, None),
        ] {
            let refuse = |_: &Schedule| -> Result<()> { Err(Error::input("no").with_key(key)) };
            let error = parse_and(text, &refuse).unwrap_err();
            assert_eq!((error.line(), error.value()), (line, value), "{key}");
            let names_columns = error.to_string().contains("alpha_change_deg");
            assert_eq!(names_columns, key.ends_with("change_deg"), "{error}");
        }
    }

    #[test]
    fn the_usual_variations_are_read() {
        let plain = parse("alpha_deg,beta_deg,gamma_deg,dwell_s\n1,2,3,4\n-5,6e0,7.5,8\n").unwrap();
        for text in [
            "alpha_deg,beta_deg,gamma_deg,dwell_s\r\n1,2,3,4\r\n-5,6e0,7.5,8\r\n",
            "alpha_deg,beta_deg,gamma_deg,dwell_s\r1,2,3,4\r-5,6e0,7.5,8\r",
            "# made by hand\n\n dwell_s , alpha_deg, beta_deg,gamma_deg\n4,1,2,3\n  # more\n8,-5,6,7.5",
            "\"alpha_deg\",\"beta_deg\",\"gamma_deg\",\"dwell_s\"\n\"1\",\"2\",\"3\",\"4\"\n-5,6,+7.5,8\n,,,\n",
            "alpha_deg,beta_deg,gamma_deg,dwell_s,move_s,move_measured\n1,2,3,4,,\n-5,6,7.5,8\n",
            "alpha_deg,beta_deg,gamma_deg,dwell_s,\n1,2,3,4,\n-5,6,7.5,8,\n",
            "alpha_deg,beta_deg,gamma_deg,dwell_s,,,\n1,2,3,4,,,\n-5,6,7.5,8,,,\n",
            "alpha_deg;beta_deg;gamma_deg;dwell_s\n1;2;3;4\n-5;6;7,5;8\n",
            "sep=;\nalpha_deg;beta_deg;gamma_deg;dwell_s\n1,0;2,0;3,0;4\n-5;6;7,5;8\n",
            "alpha_deg\tbeta_deg\tgamma_deg\tdwell_s\n1\t2\t3\t4\n-5\t6\t7.5\t8\n",
            "alpha_deg|beta_deg|gamma_deg|dwell_s\n1|2|3|4\n-5|6|7.5|8\n",
            "# alpha_deg, beta_deg, gamma_deg, dwell_s\n1,2,3,4\n-5,6,7.5,8\n",
            "Plan of May\n;;;\nα [°];β [°];γ [°];Dwell (s)\n1°;2;3;4\n\u{2212}5;6;7,5;8\n",
            "alpha_deg,beta_deg,gamma_deg,dwell_s\n1,2,3,4\n-5,6,\"7,5\",8\n",
        ] {
            assert_eq!(parse(text).unwrap(), plain, "{text}");
        }
        let moves = parse(
            "alpha_deg,beta_deg,gamma_deg,dwell_s,move_measured,move_s\n0,0,0,1,,\n0,0,0,0,TRUE,9\n",
        )
        .unwrap();
        let [first, second] = moves.positions() else {
            panic!("two positions expected");
        };
        assert_eq!((first.move_s, first.move_measured), (None, None));
        assert_eq!(
            (second.move_s, second.move_measured),
            (Some(9.0), Some(true))
        );
    }

    #[test]
    fn positions_are_pinned_as_people_mark_rows() {
        let marks = ["true", "TRUE", "yes", "1", "x", "X", "1.0"];
        let none = ["false", "No", "0", "", "0.0"];
        let rows: String = marks
            .iter()
            .chain(&none)
            .map(|mark| format!("0,0,0,{mark},1\n"))
            .collect();
        let text = format!("alpha_deg,beta_deg,gamma_deg,Pinned,dwell_s\n{rows}");
        let schedule = parse(&text).unwrap();
        let pinned = schedule.positions().iter().map(|p| p.pinned);
        let expected = (0..marks.len() + none.len()).map(|k| k < marks.len());
        assert!(pinned.eq(expected));
        for again in [
            super::super::from_csv(&schedule.to_csv()),
            super::super::from_json(&schedule.to_json()),
        ] {
            assert_eq!(again.unwrap(), schedule);
        }
    }

    #[test]
    fn other_units_are_turned_into_ours() {
        let text = "alpha [rad];beta_arcmin;gamma_deg;dwell [min];move_h\n0,5;90;3;10;0,5\n";
        let schedule = parse(text).unwrap();
        let p = schedule.positions()[0];
        let deg = p.position.to_deg();
        assert!((deg[0] - 0.5_f64.to_degrees()).abs() < 1e-9 && (deg[1] - 1.5).abs() < 1e-12);
        assert_eq!((p.dwell_s, p.move_s), (600.0, Some(1800.0)));
    }

    #[test]
    fn other_columns_are_kept_as_notes() {
        let text = "No;alpha_deg;beta_deg;gamma_deg;dwell_s;Remark\n\
                    1;0;0;0;600;\"warm up; then wait\"\n2;90;0;0;600;\n";
        let schedule = parse(text).unwrap();
        let remark = schedule.notes(0).get("Remark").map(String::as_str);
        assert_eq!(remark, Some("warm up; then wait"));
        assert_eq!(schedule.notes(1).keys().collect::<Vec<_>>(), ["No"]);
        // They survive both forms of our own.
        for again in [
            super::super::from_csv(&schedule.to_csv()),
            super::super::from_json(&schedule.to_json()),
        ] {
            assert_eq!(again.unwrap(), schedule);
        }
    }

    #[test]
    fn a_quote_that_stays_open_is_no_end_of_the_file() {
        let text = "alpha_deg,beta_deg,gamma_deg,dwell_s,remark\n0,0,0,1,\"5 in\n1,0,0,1,\n";
        let schedule = parse(text).unwrap();
        assert_eq!(schedule.positions().len(), 2);
    }

    #[test]
    fn bad_rows_are_refused_with_line_key_and_value() {
        for (row, key, value, says) in [
            ("0,0,0,x", "dwell_s", Some("x"), "a number"),
            ("0,0,0,-1", "dwell_s", Some("-1"), "0 to 1e7"),
            ("0,0,0,NaN", "dwell_s", Some("NaN"), "0 to 1e7"),
            ("0,0,0,1e999", "dwell_s", Some("1e999"), "0 to 1e7"),
            ("inf,0,0,1", "alpha_deg", Some("inf"), "-36000 to 36000"),
            ("0,nan,0,1", "beta_deg", Some("nan"), "-36000 to 36000"),
            ("0,36001,0,1", "beta_deg", Some("36001"), "-36000 to 36000"),
            ("0,,0,1", "beta_deg", None, "missing"),
            ("0,0,0", "dwell_s", None, "missing"),
            ("0,0,0,1,-2", "move_s", Some("-2"), "0 to 1e7"),
            (
                "0,0,0,1,,perhaps",
                "move_measured",
                Some("perhaps"),
                "true or false",
            ),
            (
                "0,0,0,1,,,maybe",
                "pinned",
                Some("maybe"),
                "true, yes, 1 or x",
            ),
            ("0,0,0,1,,,2", "pinned", Some("2"), "no, 0 or empty"),
            (
                "0,0,0,1,,,,1,2",
                "gamma_change_deg",
                None,
                "all three left empty",
            ),
            (
                "0,0,0,1,,,,1,far,2",
                "beta_change_deg",
                Some("far"),
                "a number",
            ),
            (
                "0,0,0,1,,,,1,inf,2",
                "change_deg",
                Some("1,inf,2"),
                "-36000 to 36000",
            ),
            (
                "\"1,200\",0,0,1",
                "alpha_deg",
                Some("1,200"),
                "write 1.200 or 1200",
            ),
            ("0;0,0,0,1", "alpha_deg", Some("0;0"), "decimal points"),
        ] {
            let text = format!(
                "alpha_deg,beta_deg,gamma_deg,dwell_s,move_s,move_measured,pinned,\
                 alpha_change_deg,beta_change_deg,gamma_change_deg\n\
                 0,0,0,1\n\n# next\n{row}\n"
            );
            let error = parse(&text).unwrap_err();
            assert!(error.is_input());
            assert_eq!(error.line(), Some(5), "{error}");
            assert_eq!(error.key(), Some(format!("positions[1].{key}").as_str()));
            assert_eq!(error.value(), value, "{error}");
            assert!(error.to_string().contains(says), "{error}");
        }
    }

    #[test]
    fn bad_files_are_refused_with_advice() {
        let many = format!(
            "alpha_deg,beta_deg,gamma_deg,dwell_s\n{}",
            "0,0,0,1\n".repeat(MAX_POSITIONS + 1)
        );
        for (text, key, says) in [
            ("", None, "no schedule"),
            ("# nothing\n\n", None, "no schedule"),
            (
                "alpha_deg,beta_deg,gamma_deg\n",
                Some("dwell_s"),
                "missing column",
            ),
            (
                "alpha_deg,beta_deg,gamma_deg,dwell\n",
                Some("dwell"),
                "does not say its unit",
            ),
            (
                "alpha_deg,beta_deg,gamma_deg,dwel_s\n",
                Some("dwel_s"),
                "did you mean `dwell_s`?",
            ),
            (
                "alpha_deg,beta_deg,gamma_deg,dwell_s,dwell_s\n",
                Some("dwell_s"),
                "twice",
            ),
            ("0,0,0,1\n", None, "a line that names the columns"),
            (
                "alpha;beta;gamma;dwell\n0;0;0;1\n",
                Some("alpha"),
                "does not say its unit",
            ),
            (
                "alpha_deg,beta_deg,gamma_deg,dwell_s\n0,5,0,0,1\n",
                Some("positions[0]"),
                "decimal points",
            ),
            // Once read as (0°, 5°, 0°) for 0 s.
            (
                "alpha_deg,beta_deg,gamma_deg,dwell_s,\n0,5,0,0,1\n",
                Some("positions[0]"),
                "decimal points",
            ),
            (
                "alpha_deg,beta_deg,,gamma_deg,dwell_s\n",
                Some("column 3"),
                "without a name",
            ),
            (
                "alpha_deg,beta_deg,gamma_deg,dwell_s\n",
                Some("positions"),
                "1 to 10000 positions",
            ),
            (&many, Some("positions"), "1 to 10000 positions"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.is_input());
            assert!(error.line().is_some());
            assert_eq!(error.key(), key, "{error}");
            assert!(error.to_string().contains(says), "{error}");
        }
    }
}
