//! Numbers as they are written on this side of the sea and the other.

use super::table::{Cell, Table};
use crate::error::{Error, Result};
use crate::schedule::text;

/// What a table says about its decimal sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Decimals {
    /// A point; a comma can only be one where nothing else is possible.
    Point,
    /// Some number can only be read with a decimal comma.
    Comma,
}

impl Decimals {
    /// Of the cells that should be numbers.
    pub fn of<'a>(table: &Table, cells: impl Iterator<Item = &'a Cell>) -> Self {
        let (mut comma, mut point) = (false, false);
        for cell in cells.filter(|c| !c.is_number) {
            let number = plain(&cell.text);
            comma |= has_decimal(&number, ',', '.');
            point |= has_decimal(&number, '.', ',');
        }
        // With other separators than commas a comma is what they were chosen for.
        match comma || (!table.commas_separate && !point) {
            true => Self::Comma,
            false => Self::Point,
        }
    }
}

/// Without what people put around numbers: blanks, a degree sign, the typographer's minus.
fn plain(written: &str) -> String {
    let written = written.trim().trim_end_matches('°').trim();
    written
        .replace(['\u{2212}', '\u{2013}'], "-")
        .replace(['\u{a0}', '\u{202f}', '\u{2009}'], "")
}

/// Whether `decimal` stands in `number` where it can be nothing but the decimal sign.
fn has_decimal(number: &str, decimal: char, other: char) -> bool {
    let Some((whole, fraction)) = number.rsplit_once(decimal) else {
        return false;
    };
    !whole.contains(decimal) && !fraction.contains(other) && !is_grouped(number, decimal)
}

/// Whether `sign` stands in `number` as between thousands.
fn is_grouped(number: &str, sign: char) -> bool {
    let digits = number.trim_start_matches(['-', '+']);
    let mut groups = digits.split(sign);
    let first = groups.next().unwrap_or_default();
    let all_digits = |g: &str| g.bytes().all(|b| b.is_ascii_digit());
    let first_fits = (1..=3).contains(&first.len()) && all_digits(first) && first != "0";
    let rest: Vec<&str> = groups.collect();
    first_fits && !rest.is_empty() && rest.iter().all(|g| g.len() == 3 && all_digits(g))
}

/// The number that a cell holds; NaN and infinity are left to range checks.
///
/// # Errors
///
/// [`Error::is_input`] for what is no number, and for what may be two.
pub(super) fn number(cell: &Cell, decimals: Decimals) -> Result<f64> {
    let number = plain(&cell.text);
    let fail = |error: Error| error.with_value(text::shown(&cell.text));
    let (comma, point) = (number.contains(','), number.contains('.'));
    let two_ways = |sign: char| {
        let joined = number.replace(sign, "");
        let error = Error::input("may be read in two ways");
        let decimal = number.replace(',', ".");
        fail(error)
            .with_allowed("a number without signs between the thousands")
            .with_hint(format!("write {decimal} or {joined}"))
    };
    let text = match (comma, point) {
        _ if cell.is_number => number,
        (false, false) => number,
        (false, true) if decimals == Decimals::Comma && is_grouped(&number, '.') => {
            return Err(two_ways('.'));
        }
        (false, true) => number,
        (true, false) if decimals == Decimals::Point && is_grouped(&number, ',') => {
            return Err(two_ways(','));
        }
        (true, false) => number.replace(',', "."),
        (true, true) => {
            let decimal = if number.rfind(',') > number.rfind('.') {
                ','
            } else {
                '.'
            };
            let thousands = if decimal == ',' { '.' } else { ',' };
            let whole = number.rsplit_once(decimal).map_or("", |(whole, _)| whole);
            match is_grouped(whole, thousands) {
                true => number.replace(thousands, "").replace(decimal, "."),
                false => number,
            }
        }
    };
    text.parse().map_err(|e: std::num::ParseFloatError| {
        fail(Error::input("not a number"))
            .with_allowed("a number")
            .with_source(e)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, decimals: Decimals) -> Option<f64> {
        number(&Cell::written(text), decimals).ok()
    }

    #[test]
    fn numbers_are_read_as_they_are_meant_or_not_at_all() {
        use Decimals::{Comma, Point};
        for (text, comma, point) in [
            ("12", Some(12.0), Some(12.0)),
            ("-12.5", Some(-12.5), Some(-12.5)),
            ("\u{2212}12,5", Some(-12.5), Some(-12.5)),
            ("90°", Some(90.0), Some(90.0)),
            ("1.200", None, Some(1.2)),
            ("1,200", Some(1.2), None),
            ("0,500", Some(0.5), Some(0.5)),
            ("0.500", Some(0.5), Some(0.5)),
            ("1.234,5", Some(1234.5), Some(1234.5)),
            ("1,234.5", Some(1234.5), Some(1234.5)),
            ("12.34,5", None, None),
            ("1,2,3", None, None),
            ("1,5e3", Some(1500.0), Some(1500.0)),
            ("twelve", None, None),
            ("", None, None),
        ] {
            assert_eq!(read(text, Comma), comma, "{text} with decimal commas");
            assert_eq!(read(text, Point), point, "{text} with decimal points");
        }
    }
}
