//! What the columns of a table are called: our names, and what people write instead.

use super::{COLUMNS, SINGLE_COLUMNS};
use crate::units::RAD_PER_DEG;

/// What a heading stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Column {
    /// One of [`COLUMNS`], and what turns its numbers into that column's unit.
    Known { index: usize, factor: f64 },
    /// One of [`COLUMNS`] without a unit, or with none of its units.
    WithoutUnit { index: usize },
    /// None of them.
    Other,
}

/// What a word in a heading says.
#[derive(Clone, Copy, PartialEq)]
enum Word {
    /// The gimbal angle of that number.
    Angle(usize),
    /// Of the way to the position.
    Change,
    Dwell,
    Move,
    Measured,
    Pinned,
    /// Of an angle, in degrees.
    AngleUnit(f64),
    /// Of a time, in seconds.
    TimeUnit(f64),
    /// Says nothing that the others do not.
    Filler,
}

fn word(text: &str) -> Option<Word> {
    Some(match text {
        "alpha" => Word::Angle(0),
        "beta" => Word::Angle(1),
        "gamma" => Word::Angle(2),
        "change" => Word::Change,
        "dwell" => Word::Dwell,
        "move" | "slew" => Word::Move,
        "measured" => Word::Measured,
        "pinned" => Word::Pinned,
        "deg" | "degree" | "degrees" => Word::AngleUnit(1.0),
        "rad" | "radian" | "radians" => Word::AngleUnit(1.0 / RAD_PER_DEG),
        "arcmin" => Word::AngleUnit(1.0 / 60.0),
        "s" | "sec" | "second" | "seconds" => Word::TimeUnit(1.0),
        "min" | "minute" | "minutes" => Word::TimeUnit(60.0),
        "h" | "hour" | "hours" => Word::TimeUnit(3600.0),
        "angle" | "time" | "duration" | "in" => Word::Filler,
        _ => return None,
    })
}

/// Letters of other alphabets and signs, as words.
fn spelt(heading: &str) -> String {
    let mut out = String::new();
    for c in heading.chars() {
        match c {
            'α' | 'Α' => out.push_str("alpha"),
            'β' | 'Β' => out.push_str("beta"),
            'γ' | 'Γ' => out.push_str("gamma"),
            '°' | 'º' => out.push_str(" deg "),
            c if c.is_alphanumeric() => out.extend(c.to_lowercase()),
            _ => out.push(' '),
        }
    }
    out
}

/// What a heading stands for: the quantity and the unit, in any order, spelling and brackets.
pub(super) fn column_of(heading: &str) -> Column {
    let spelt = spelt(heading);
    let words: Option<Vec<Word>> = spelt.split_whitespace().map(word).collect();
    let Some(words) = words else {
        return Column::Other;
    };
    let meant: Vec<Word> = words.into_iter().filter(|w| *w != Word::Filler).collect();
    let of_unit = |w: &Word| matches!(w, Word::AngleUnit(_) | Word::TimeUnit(_));
    let (units, what): (Vec<Word>, Vec<Word>) = meant.into_iter().partition(of_unit);
    let (index, is_angle) = match what[..] {
        [Word::Angle(axis)] => (axis, true),
        [Word::Angle(axis), Word::Change] | [Word::Change, Word::Angle(axis)] => {
            (SINGLE_COLUMNS + axis, true)
        }
        [Word::Dwell] => (3, false),
        [Word::Move] => (4, false),
        [Word::Move, Word::Measured] if units.is_empty() => {
            return Column::Known {
                index: 5,
                factor: 1.0,
            };
        }
        [Word::Pinned] if units.is_empty() => {
            return Column::Known {
                index: 6,
                factor: 1.0,
            };
        }
        _ => return Column::Other,
    };
    match (&units[..], is_angle) {
        ([Word::AngleUnit(factor)], true) | ([Word::TimeUnit(factor)], false) => Column::Known {
            index,
            factor: *factor,
        },
        _ => Column::WithoutUnit { index },
    }
}

/// The column that a heading was probably meant for: a slip of one or two letters.
pub(super) fn misspelt(heading: &str) -> Option<&'static str> {
    const SLIPS: usize = 2;
    let heading = heading.trim().to_lowercase();
    let distance = |name: &&&str| strsim::osa_distance(&heading, name);
    let nearest = COLUMNS.iter().min_by_key(distance)?;
    (strsim::osa_distance(&heading, nearest) <= SLIPS).then_some(*nearest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_as_people_write_them() {
        for (heading, name, factor) in [
            ("alpha_deg", "alpha_deg", 1.0),
            ("Alpha [deg]", "alpha_deg", 1.0),
            ("α (°)", "alpha_deg", 1.0),
            ("β/°", "beta_deg", 1.0),
            ("Gamma angle in degrees", "gamma_deg", 1.0),
            ("gamma_rad", "gamma_deg", 180.0 / std::f64::consts::PI),
            ("Dwell time (s)", "dwell_s", 1.0),
            ("dwell [min]", "dwell_s", 60.0),
            ("DWELL_H", "dwell_s", 3600.0),
            ("slew duration, s", "move_s", 1.0),
            ("Move measured", "move_measured", 1.0),
            ("Pinned", "pinned", 1.0),
            ("beta_change_deg", "beta_change_deg", 1.0),
        ] {
            let index = COLUMNS.iter().position(|c| *c == name).unwrap();
            let Column::Known {
                index: found,
                factor: by,
            } = column_of(heading)
            else {
                panic!("{heading} is not known");
            };
            assert_eq!(found, index, "{heading}");
            assert!((by / factor - 1.0).abs() < 1e-15, "{heading}: {by}");
        }
        for (column, name) in COLUMNS.iter().enumerate() {
            let known = Column::Known {
                index: column,
                factor: 1.0,
            };
            assert_eq!(column_of(name), known, "{name}");
        }
        for (heading, index) in [("alpha", 0), ("dwell", 3), ("alpha_s", 0), ("dwell deg", 3)] {
            assert_eq!(
                column_of(heading),
                Column::WithoutUnit { index },
                "{heading}"
            );
        }
        for heading in [
            "",
            "remark",
            "alpha of the day",
            "deg",
            "move alpha deg",
            "pinned s",
            "alpha deg rad",
        ] {
            assert!(
                !matches!(column_of(heading), Column::Known { .. }),
                "{heading}"
            );
        }
        assert_eq!(misspelt("dwel_s"), Some("dwell_s"));
        assert_eq!(misspelt("Move_S "), Some("move_s"));
        assert_eq!(misspelt("remark"), None);
    }
}
