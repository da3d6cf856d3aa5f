//! What reading any input file has in common: size and encoding checks, line numbers, and
//! suggestions for misspelt names.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};

/// Largest platform file, bytes. The commented one takes a few kilobytes; parsed TOML takes some
/// hundred times its text in memory.
pub(crate) const MAX_PLATFORM_BYTES: u64 = 1 << 20;

/// Largest schedule file, bytes. A schedule of the most positions allowed takes about two million.
pub(crate) const MAX_SCHEDULE_BYTES: u64 = 8 << 20;

/// The text of a file of at most `most_bytes`, without a byte order mark.
///
/// # Errors
///
/// [`Error::is_io`] when the file cannot be opened or read; [`Error::is_input`] for anything that
/// is not a regular file (or a link to one), a file larger than `most_bytes` (of which no more
/// than that is read), and text that is not UTF-8.
pub(crate) fn read_text(path: &Path, most_bytes: u64) -> Result<String> {
    decode(read_bytes(path, most_bytes)?).map_err(|e| e.with_file(path))
}

/// The content of a file of at most `most_bytes`.
///
/// # Errors
///
/// As [`read_text`], whatever the bytes mean.
pub(crate) fn read_bytes(path: &Path, most_bytes: u64) -> Result<Vec<u8>> {
    let cannot_read = |e: std::io::Error| Error::io("read the file", path, e);
    // Asked before opening: to open a pipe nobody writes to would wait for ever.
    let metadata = std::fs::metadata(path).map_err(cannot_read)?;
    if metadata.is_dir() {
        return Err(Error::input("a directory, not a file").with_file(path));
    }
    if !metadata.is_file() {
        return Err(Error::input("a pipe, socket or device, not a file")
            .with_file(path)
            .with_hint("write it to a file first"));
    }
    let too_large = || {
        Error::input("the file is too large")
            .with_file(path)
            .with_allowed(format!("at most {} MiB", most_bytes >> 20))
    };
    if metadata.len() > most_bytes {
        return Err(too_large());
    }
    // The length asked for may be out of date, so the reading is limited as well.
    let file = File::open(path).map_err(cannot_read)?;
    let mut bytes = Vec::new();
    file.take(most_bytes + 1)
        .read_to_end(&mut bytes)
        .map_err(cannot_read)?;
    if bytes.len() as u64 > most_bytes {
        return Err(too_large());
    }
    Ok(bytes)
}

/// The text of a table, as spreadsheets write them: UTF-8, UTF-16, or what Windows had before.
pub(crate) fn decode_table(bytes: &[u8]) -> String {
    // A byte order mark decides.
    let (text, used, wrong) = encoding_rs::UTF_8.decode(bytes);
    match used == encoding_rs::UTF_8 && wrong {
        true => encoding_rs::WINDOWS_1252.decode(bytes).0.into_owned(),
        false => text.into_owned(),
    }
}

/// The text of UTF-8 without a byte order mark.
pub(crate) fn decode(bytes: Vec<u8>) -> Result<String> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(Error::input("the file is in UTF-16").with_hint("save it as UTF-8"));
    }
    match String::from_utf8(bytes) {
        Ok(text) => Ok(match text.strip_prefix(BOM) {
            Some(rest) => rest.to_owned(),
            None => text,
        }),
        Err(e) => {
            let good = e.utf8_error().valid_up_to();
            let line = 1 + e.as_bytes()[..good].iter().filter(|b| **b == b'\n').count();
            Err(Error::input("not UTF-8 text")
                .with_line(line)
                .with_hint("save it as UTF-8")
                .with_source(e.utf8_error()))
        }
    }
}

const BOM: char = '\u{feff}';

/// What the CSV reader did not understand.
pub(crate) fn unreadable_csv(error: csv::Error) -> Error {
    let line = error.position().map(|p| p.line() as usize);
    let found = Error::input(format!("no CSV: {error}")).with_source(error);
    match line {
        Some(line) => found.with_line(line),
        None => found,
    }
}

/// `text` without a byte order mark.
pub(crate) fn without_bom(text: &str) -> &str {
    text.strip_prefix(BOM).unwrap_or(text)
}

/// The line (from 1) that holds the byte `offset` of `text`.
pub(crate) fn line_at(text: &str, offset: usize) -> usize {
    let before = &text.as_bytes()[..offset.min(text.len())];
    1 + before.iter().filter(|b| **b == b'\n').count()
}

/// The line (from 1) of `text` at which `part`, a slice of it, starts.
pub(crate) fn line_of(text: &str, part: &str) -> usize {
    // A part that is no slice of the text would wrap to an offset past its end: the last line.
    let offset = (part.as_ptr() as usize).wrapping_sub(text.as_ptr() as usize);
    line_at(text, offset)
}

/// The candidate that `name` most likely stands for, if any comes near.
pub(crate) fn nearest<'a>(
    name: &str,
    candidates: impl IntoIterator<Item = &'a str>,
) -> Option<&'a str> {
    // Jaro-Winkler rewards a common beginning, so that a name with its unit left out or wrong
    // (`latitude`, `dwell_min`) is still recognised; below this the suggestions turn silly.
    const NEAR: f64 = 0.82;
    let plain = |s: &str| s.trim().to_lowercase().replace(['-', ' '], "_");
    let name = plain(name);
    let mut best: Option<(f64, &str)> = None;
    for candidate in candidates {
        let likeness = strsim::jaro_winkler(&name, &plain(candidate));
        if likeness >= NEAR && best.is_none_or(|(b, _)| likeness > b) {
            best = Some((likeness, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}

/// `error` with the suggestion "did you mean …?" when a candidate comes near `name`.
pub(crate) fn with_nearest<'a>(
    error: Error,
    name: &str,
    candidates: impl IntoIterator<Item = &'a str>,
) -> Error {
    match nearest(name, candidates) {
        // The same quantity in another unit: a number that is only renamed would be wrong.
        Some(near) if other_unit(name, near) => error.with_hint(format!(
            "there is `{near}`, in another unit: convert the value"
        )),
        Some(near) => error.with_hint(format!("did you mean `{near}`?")),
        None => error,
    }
}

/// The units that keys end with, those that end with another of them first.
const UNITS: [&str; 30] = [
    "deg_per_h_per_sqrt_h",
    "deg_per_sqrt_h",
    "deg_per_h_per_g2",
    "deg_per_h_per_g",
    "arcsec_per_h",
    "deg_per_h",
    "deg_per_s2",
    "deg_per_s",
    "rad_per_s",
    "ug_per_sqrt_hz",
    "ug_per_sqrt_h",
    "ug_per_g2",
    "ug_per_g3",
    "arcsec",
    "arcmin",
    "mrad",
    "urad",
    "deg",
    "rad",
    "ppm",
    "percent",
    "min",
    "hz",
    "ms",
    "us",
    "mg",
    "ug",
    "s",
    "h",
    "g",
];

/// What a key says its number is in.
fn unit_of(key: &str) -> Option<&'static str> {
    let key = key.trim().to_lowercase().replace(['-', ' '], "_");
    let ends = |unit: &&&str| {
        let rest = key.strip_suffix(**unit);
        rest.is_some_and(|rest| rest.ends_with('_'))
    };
    UNITS.iter().find(ends).copied()
}

/// Whether two keys are of different units.
fn other_unit(a: &str, b: &str) -> bool {
    matches!((unit_of(a), unit_of(b)), (Some(a), Some(b)) if a != b)
}

/// A value from a file, short enough to be shown in a message, and without control characters,
/// which could do as they please with the reader's terminal.
pub(crate) fn shown(value: &str) -> String {
    const LONGEST: usize = 40;
    let one_line = value.split_whitespace().collect::<Vec<_>>().join(" ");
    let one_line = one_line.replace(char::is_control, "\u{fffd}");
    if one_line.chars().count() <= LONGEST {
        return one_line;
    }
    let start: String = one_line.chars().take(LONGEST).collect();
    format!("{start}…")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_misses_are_recognised_and_far_ones_are_not() {
        let names = ["latitude_deg", "noise_g", "period_s", "min_dwell_s"];
        for (typed, meant) in [
            ("latitude", Some("latitude_deg")),
            ("lattitude_deg", Some("latitude_deg")),
            ("Latitude-deg", Some("latitude_deg")),
            ("noise_mg", Some("noise_g")),
            ("period_ms", Some("period_s")),
            ("min_dwel_s", Some("min_dwell_s")),
            ("colour", None),
            ("", None),
        ] {
            assert_eq!(nearest(typed, names), meant, "{typed}");
        }
    }

    /// A key that is renamed keeps its number.
    #[test]
    fn a_hint_never_makes_another_unit_of_a_number() {
        let names = [
            "latitude_deg",
            "noise_g",
            "period_s",
            "random_drift_deg_per_h",
        ];
        for (typed, says) in [
            ("latitude", "did you mean `latitude_deg`?"),
            (
                "latitude_rad",
                "there is `latitude_deg`, in another unit: convert the value",
            ),
            ("noise_ug", "there is `noise_g`, in another unit"),
            ("period_min", "there is `period_s`, in another unit"),
            ("periods_s", "did you mean `period_s`?"),
            (
                "random_drift_deg_per_s",
                "there is `random_drift_deg_per_h`, in another unit",
            ),
        ] {
            let error = with_nearest(Error::input("unknown key"), typed, names);
            assert!(error.to_string().contains(says), "{typed}: {error}");
        }
    }

    #[test]
    fn values_are_shown_short_and_without_control_characters() {
        assert_eq!(shown("a\n\t b"), "a b");
        assert_eq!(shown("\u{1b}[31mred\u{7}"), "\u{fffd}[31mred\u{fffd}");
        assert_eq!(shown(&"x".repeat(41)).chars().count(), 41);
    }

    #[test]
    fn lines_are_counted_from_one() {
        let text = "a\nb\r\nc";
        for (offset, line) in [(0, 1), (2, 2), (5, 3), (99, 3)] {
            assert_eq!(line_at(text, offset), line);
        }
        assert_eq!(line_of(text, &text[2..3]), 2);
        assert_eq!(line_of(text, &text[5..]), 3);
    }

    #[test]
    fn files_that_are_no_text_are_refused_with_their_name() {
        let dir = tempfile::tempdir().unwrap();
        let error = read_text(dir.path(), 100).unwrap_err();
        assert!(error.is_input() || error.is_io());
        assert_eq!(error.file(), Some(dir.path()));

        let missing = dir.path().join("missing.toml");
        let error = read_text(&missing, 100).unwrap_err();
        assert!(error.is_io());
        assert_eq!(error.file(), Some(missing.as_path()));

        let path = dir.path().join("file");
        std::fs::write(&path, b"one\ntwo \xff\xff").unwrap();
        let error = read_text(&path, 100).unwrap_err();
        assert!(error.is_input());
        assert_eq!(error.line(), Some(2));

        std::fs::write(&path, b"\xff\xfea\0b\0").unwrap();
        assert!(
            read_text(&path, 100)
                .unwrap_err()
                .to_string()
                .contains("UTF-16")
        );

        std::fs::write(&path, "\u{feff}text").unwrap();
        assert_eq!(read_text(&path, 100).unwrap(), "text");
    }

    #[test]
    fn a_huge_file_is_refused_without_reading_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("huge");
        let file = File::create(&path).unwrap();
        file.set_len(1 << 30).unwrap();
        let error = read_text(&path, MAX_SCHEDULE_BYTES).unwrap_err();
        assert!(error.is_input());
        assert_eq!(error.allowed(), Some("at most 8 MiB"));
    }
}
