//! Reading the CSV form: numbers and truth values only, so that a line is always a row and no
//! cell holds a comma.

use super::{
    CHANGE_KEY, COLUMNS, Check, PositionRecord, REQUIRED_COLUMNS, SINGLE_COLUMNS, checked,
    position_key,
};
use crate::error::{Error, Result};
use crate::schedule::{MAX_POSITIONS, Schedule, text};

/// A schedule from CSV text, and what `check` makes of it; what that refuses gets its line too.
pub(super) fn parse_and<T>(document: &str, check: Check<'_, T>) -> Result<(Schedule, T)> {
    // Files of some spreadsheets end their lines with a carriage return alone.
    let end = if document.contains('\n') { '\n' } else { '\r' };
    let mut rows = document
        .split(end)
        .enumerate()
        .map(|(i, line)| Row::new(i + 1, line))
        .filter(|row| !row.is_blank());
    let Some(header) = rows.next() else {
        return Err(Error::input("the file holds no schedule")
            .with_line(1)
            .with_allowed(format!("a header line {}", COLUMNS.join(","))));
    };
    let header = Header::new(&header)?;
    let mut kept = Vec::new();
    let mut records = Vec::new();
    for row in rows {
        if records.len() == MAX_POSITIONS {
            return Err(Error::input("too many positions")
                .with_key("positions")
                .with_line(row.line)
                .with_allowed(format!("1 to {MAX_POSITIONS} positions")));
        }
        records.push(header.record(records.len(), &row)?);
        kept.push(row);
    }
    let schedule = Schedule::new(records.iter().map(Into::into).collect());
    checked(schedule, check).map_err(|e| located(&header, &kept, e))
}

/// Adds the line, and the value as it is written, to an error about a position.
fn located(header: &Header, rows: &[Row<'_>], error: Error) -> Error {
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
            .map(|column| header.cell(row, column).unwrap_or_default())
            .collect::<Vec<_>>()
            .join(","),
        _ => {
            let column = COLUMNS.iter().position(|c| Some(*c) == field);
            let cell = column.and_then(|column| header.cell(row, column));
            cell.unwrap_or_default().to_owned()
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

/// One line, cut at its commas.
struct Row<'a> {
    line: usize,
    cells: Vec<&'a str>,
}

impl<'a> Row<'a> {
    fn new(line: usize, content: &'a str) -> Self {
        let content = content.trim();
        let cells = if content.starts_with('#') {
            Vec::new()
        } else {
            content.split(',').map(unquoted).collect()
        };
        Self { line, cells }
    }

    /// True for comments, empty lines and the rows of nothing but commas that spreadsheets add.
    fn is_blank(&self) -> bool {
        self.cells.iter().all(|cell| cell.is_empty())
    }
}

/// A cell without the blanks and the quotes around it.
fn unquoted(cell: &str) -> &str {
    let cell = cell.trim();
    let inner = cell.strip_prefix('"').and_then(|c| c.strip_suffix('"'));
    inner.map_or(cell, str::trim)
}

const DECIMAL_POINT: &str = "separate the columns by commas and write decimals with a point, 12.5";

/// The header line: where in a row each of [`COLUMNS`] is found.
struct Header {
    line: usize,
    /// Cells up to the last that has a name. Some programs write commas after it, under which a
    /// row must not hold anything: it would be the end of a row with decimal commas.
    width: usize,
    place: [Option<usize>; COLUMNS.len()],
}

impl Header {
    fn new(row: &Row<'_>) -> Result<Self> {
        let last = row.cells.iter().rposition(|name| !name.is_empty());
        let mut header = Self {
            line: row.line,
            width: last.map_or(0, |i| i + 1),
            place: [None; COLUMNS.len()],
        };
        for (i, name) in row.cells.iter().enumerate().take(header.width) {
            if name.contains([';', '\t', '|']) {
                return Err(Error::input("the columns are not separated by commas")
                    .with_line(row.line)
                    .with_value(text::shown(name))
                    .with_hint(DECIMAL_POINT));
            }
            match COLUMNS.iter().position(|column| column == name) {
                Some(column) if header.place[column].is_none() => header.place[column] = Some(i),
                Some(_) => {
                    return Err(Error::input("the column is there twice")
                        .with_key(*name)
                        .with_line(row.line));
                }
                None if name.is_empty() => {
                    return Err(Error::input("a column without a name")
                        .with_key(format!("column {}", i + 1))
                        .with_line(row.line));
                }
                None => return Err(unknown_column(row.line, name)),
            }
        }
        for (column, place) in header.place.iter().enumerate().take(REQUIRED_COLUMNS) {
            if place.is_none() {
                return Err(Error::input("missing column")
                    .with_key(COLUMNS[column])
                    .with_line(row.line)
                    .with_allowed(format!("a header line {}", COLUMNS.join(","))));
            }
        }
        Ok(header)
    }

    /// The cell of a row under one of [`COLUMNS`]; `None` when absent or empty.
    fn cell<'a>(&self, row: &Row<'a>, column: usize) -> Option<&'a str> {
        let cell = row.cells.get(self.place[column]?)?;
        (!cell.is_empty()).then_some(*cell)
    }

    /// The position that a row describes.
    fn record(&self, index: usize, row: &Row<'_>) -> Result<PositionRecord> {
        if row.cells.iter().skip(self.width).any(|c| !c.is_empty()) {
            return Err(Error::input("the line has more cells than the header")
                .with_key(format!("positions[{index}]"))
                .with_line(row.line)
                .with_value(format!("{} cells", row.cells.len()))
                .with_allowed(format!("{} cells", self.width))
                .with_hint(DECIMAL_POINT));
        }
        let fail = |column: usize, error: Error| {
            error
                .with_key(format!("positions[{index}].{}", COLUMNS[column]))
                .with_line(row.line)
        };
        let optional = |column: usize| match self.cell(row, column) {
            None => Ok(None),
            Some(cell) => number(cell).map(Some).map_err(|e| fail(column, e)),
        };
        let required = |column: usize| {
            optional(column)?
                .ok_or_else(|| fail(column, Error::input("missing").with_allowed("a number")))
        };
        Ok(PositionRecord {
            alpha_deg: required(0)?,
            beta_deg: required(1)?,
            gamma_deg: required(2)?,
            dwell_s: required(3)?,
            move_s: optional(4)?,
            move_measured: match self.cell(row, 5) {
                None => None,
                Some(cell) => Some(truth_value(cell).map_err(|e| fail(5, e))?),
            },
            change_deg: match [optional(6)?, optional(7)?, optional(8)?] {
                [Some(alpha), Some(beta), Some(gamma)] => Some([alpha, beta, gamma]),
                [None, None, None] => None,
                some => {
                    let absent = some.iter().position(Option::is_none).unwrap_or_default();
                    let error = Error::input("missing beside the other changes");
                    let error = error.with_allowed("a number, or all three left empty");
                    return Err(fail(SINGLE_COLUMNS + absent, error));
                }
            },
        })
    }
}

fn unknown_column(line: usize, name: &str) -> Error {
    let error = Error::input("unknown column")
        .with_key(text::shown(name))
        .with_line(line)
        .with_allowed(COLUMNS.join(", "));
    if name.parse::<f64>().is_ok() {
        return error.with_hint("the first line must name the columns");
    }
    text::with_nearest(error, name, COLUMNS)
}

/// A number; NaN and infinity are left to the range checks of [`Schedule::new`].
fn number(cell: &str) -> Result<f64> {
    cell.parse().map_err(|e: std::num::ParseFloatError| {
        let error = Error::input("not a number")
            .with_value(text::shown(cell))
            .with_allowed("a number")
            .with_source(e);
        if cell.contains([';', '"']) {
            error.with_hint(DECIMAL_POINT)
        } else {
            error
        }
    })
}

fn truth_value(cell: &str) -> Result<bool> {
    match cell.to_ascii_lowercase().as_str() {
        "true" => Ok(true),
        "false" => Ok(false),
        _ => Err(Error::input("not a truth value")
            .with_value(text::shown(cell))
            .with_allowed("true or false, or empty: as the platform has it")),
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
                "0,0,0,1,,yes",
                "move_measured",
                Some("yes"),
                "true or false",
            ),
            (
                "0,0,0,1,,,1,2",
                "gamma_change_deg",
                None,
                "all three left empty",
            ),
            (
                "0,0,0,1,,,1,far,2",
                "beta_change_deg",
                Some("far"),
                "a number",
            ),
            (
                "0,0,0,1,,,1,inf,2",
                "change_deg",
                Some("1,inf,2"),
                "-36000 to 36000",
            ),
            ("\"0,0\",0,0,1", "alpha_deg", Some("\"0"), "with a point"),
            ("0;0,0,0,1", "alpha_deg", Some("0;0"), "with a point"),
        ] {
            let text = format!(
                "alpha_deg,beta_deg,gamma_deg,dwell_s,move_s,move_measured,\
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
                "did you mean `dwell_s`?",
            ),
            (
                "alpha_deg,beta_deg,gamma_deg,dwell_s,dwell_s\n",
                Some("dwell_s"),
                "twice",
            ),
            ("0,0,0,1\n", Some("0"), "must name the columns"),
            (
                "alpha_deg;beta_deg;gamma_deg;dwell_s\n0,5;0;0;1\n",
                None,
                "with a point",
            ),
            (
                "alpha_deg\tbeta_deg\tgamma_deg\tdwell_s\n",
                None,
                "not separated by commas",
            ),
            (
                "alpha_deg,beta_deg,gamma_deg,dwell_s\n0,5,0,0,1\n",
                Some("positions[0]"),
                "with a point",
            ),
            // Once read as (0°, 5°, 0°) for 0 s.
            (
                "alpha_deg,beta_deg,gamma_deg,dwell_s,\n0,5,0,0,1\n",
                Some("positions[0]"),
                "with a point",
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
