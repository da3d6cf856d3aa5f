//! The list of positions that a stand can hold, read from a file.

use std::path::Path;

use crate::error::{Error, Result};
use crate::schedule::text;

/// The columns that a list has; others are left alone.
const COLUMNS: [&str; 3] = ["alpha_deg", "beta_deg", "gamma_deg"];
/// Most positions of a list: a search tries every one of them at every place of a schedule.
const MOST_POSITIONS: usize = 10_000;

/// Reads a list of positions: `alpha_deg`, `beta_deg`, `gamma_deg` in any order, separated by commas,
/// semicolons or tabs (beside the last two decimal commas are understood); other columns are left
/// alone, lines that start with `#` skipped.
///
/// # Errors
///
/// [`Error::is_io`] when it cannot be read; [`Error::is_input`] with file, line, column and what is
/// allowed.
pub(super) fn read(path: &Path) -> Result<Vec<[f64; 3]>> {
    let text = text::read_text(path, text::MAX_SCHEDULE_BYTES)
        .map_err(|e| e.with_key("gimbals.allowed"))?;
    of_text(text::without_bom(&text)).map_err(|e| e.with_file(path))
}

fn of_text(text: &str) -> Result<Vec<[f64; 3]>> {
    let header = text
        .lines()
        .find(|line| !line.trim_start().starts_with('#'));
    let is_in_header = |c: char| header.is_some_and(|line| line.contains(c));
    let delimiter = [b';', b'\t']
        .into_iter()
        .find(|c| is_in_header(char::from(*c)));
    let mut reader = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .delimiter(delimiter.unwrap_or(b','))
        .from_reader(text.as_bytes());
    let header = reader.headers().map_err(text::unreadable_csv)?.clone();
    let place = |name: &&str| {
        header.iter().position(|h| h == *name).ok_or_else(|| {
            Error::input("a column of the list of positions is missing")
                .with_key(*name)
                .with_value(text::shown(&header.iter().collect::<Vec<_>>().join(",")))
                .with_allowed(COLUMNS.join(", "))
        })
    };
    let places = COLUMNS.iter().map(place).collect::<Result<Vec<_>>>()?;
    let mut positions = Vec::new();
    for record in reader.records() {
        let record = record.map_err(text::unreadable_csv)?;
        let line = record.position().map_or(0, |p| p.line() as usize);
        let mut deg = [0.0; 3];
        for ((angle, place), name) in deg.iter_mut().zip(&places).zip(COLUMNS) {
            let cell = record.get(*place).unwrap_or_default();
            let decimal = match delimiter {
                Some(_) => cell.replace(',', "."),
                None => cell.to_owned(),
            };
            *angle = decimal.parse().unwrap_or(f64::NAN);
            if angle.is_nan() || angle.abs() > 36_000.0 {
                return Err(Error::input("is no angle")
                    .with_key(name)
                    .with_value(text::shown(cell))
                    .with_allowed("degrees, -36000 to 36000")
                    .with_line(line));
            }
        }
        positions.push(deg);
    }
    match positions.len() {
        1..=MOST_POSITIONS => Ok(positions),
        count => Err(
            Error::input("a list of positions has some, and not too many")
                .with_key("rows")
                .with_value(count)
                .with_allowed(format!("1 to {MOST_POSITIONS} rows after the header")),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_read_as_people_write_them() {
        let expected = vec![[0.0, 10.5, -90.0], [180.0, 0.0, 0.0]];
        for text in [
            "alpha_deg,beta_deg,gamma_deg\n0,10.5,-90\n180,0,0\n",
            "# stops\nname;gamma_deg;alpha_deg;beta_deg\na;-90;0;10,5\n# none\nb;0;180;0\n",
            "beta_deg\talpha_deg\tgamma_deg\r\n10,5\t0\t-90\r\n0\t180\t0\r\n",
        ] {
            assert_eq!(of_text(text).unwrap(), expected, "{text}");
        }
    }

    #[test]
    fn what_is_no_list_is_refused() {
        for (text, key, line) in [
            ("alpha_deg,beta_deg\n0,0\n", "gamma_deg", None),
            ("alpha_deg,beta_deg,gamma_deg\n", "rows", None),
            (
                "alpha_deg,beta_deg,gamma_deg\n0,0,0\n0,x,0\n",
                "beta_deg",
                Some(3),
            ),
            (
                "alpha_deg,beta_deg,gamma_deg\n0,0,nan\n",
                "gamma_deg",
                Some(2),
            ),
            ("", "alpha_deg", None),
        ] {
            let error = of_text(text).unwrap_err();
            assert_eq!((error.key(), error.line()), (Some(key), line), "{text}");
        }
        assert!(read(Path::new("no-such-list.csv")).unwrap_err().is_io());
    }
}
