//! Numbers for people: four significant digits, durations, lists of names.

/// A number with four significant digits.
pub fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if !value.is_finite() {
        return "-".to_owned();
    }
    let exponent = libm::log10(value.abs()).floor();
    if (-5.0..6.0).contains(&exponent) {
        let decimals = (3.0 - exponent).max(0.0) as usize;
        format!("{value:.decimals$}")
    } else {
        format!("{value:.3e}")
    }
}

/// A duration in seconds: whole, or to the tenth.
pub fn seconds(value: f64) -> String {
    if (value - value.round()).abs() < 0.05 {
        format!("{value:.0}")
    } else {
        format!("{value:.1}")
    }
}

/// That many decimals at most; no zero has a sign.
pub fn decimals(value: f64, most: usize) -> String {
    let text = format!("{value:.most$}");
    let short = match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.'),
        false => text.as_str(),
    };
    match short {
        "-0" => "0".to_owned(),
        short => short.to_owned(),
    }
}

/// Time of a test as hours, minutes and seconds, h:mm:ss: to the nearest second.
pub fn h_mm_ss(time_s: f64) -> String {
    let seconds = time_s.round() as u64;
    let (hours, minutes) = (seconds / 3600, seconds / 60 % 60);
    format!("{hours}:{minutes:02}:{:02}", seconds % 60)
}

/// A separability, 0 to 1: four decimals, or two digits where those would be zeros.
pub fn separability(value: f64) -> String {
    match value {
        v if v > 0.0 && v < 5e-5 => format!("{v:.1e}"),
        v => format!("{v:.4}"),
    }
}

#[cfg(feature = "report")]
/// A number with so many decimals; what rounds to zero has no sign.
pub fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(bare) if bare.bytes().all(|b| matches!(b, b'0' | b'.')) => bare.to_owned(),
        _ => text,
    }
}

#[cfg(feature = "report")]
/// A value that may be missing.
pub fn optional<T>(value: Option<T>, show: impl Fn(T) -> String) -> String {
    value.map_or_else(|| "-".to_owned(), show)
}

/// A list as people write it: `a, b and c`.
pub fn listed<S: AsRef<str>>(names: &[S]) -> String {
    match names {
        [] => String::new(),
        [only] => only.as_ref().to_owned(),
        [first @ .., last] => {
            let first: Vec<&str> = first.iter().map(AsRef::as_ref).collect();
            format!("{} and {}", first.join(", "), last.as_ref())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits() {
        for (value, text) in [
            (0.000_905_34, "0.0009053"),
            (15.0, "15.00"),
            (12_000.0, "12000"),
            (1.0e-7, "1.000e-7"),
            (0.0, "0"),
            (f64::INFINITY, "-"),
            (-3.5, "-3.500"),
        ] {
            assert_eq!(number(value), text);
        }
        assert_eq!(separability(0.0), "0.0000");
        assert_eq!(separability(0.000_049), "4.9e-5");
        assert_eq!(separability(0.333_33), "0.3333");
        assert_eq!(seconds(120.0), "120");
        assert_eq!(seconds(119.26), "119.3");
        assert_eq!(decimals(-0.000_000_000_01, 9), "0");
        assert_eq!(decimals(1800.5, 9), "1800.5");
        assert_eq!(decimals(120.0, 6), "120");
        assert_eq!(decimals(120.0, 0), "120");
        assert_eq!(h_mm_ss(0.0), "0:00:00");
        assert_eq!(h_mm_ss(14_399.6), "4:00:00");
        assert_eq!(h_mm_ss(3_725.4), "1:02:05");
    }

    #[test]
    fn lists_read_as_sentences_do() {
        assert_eq!(listed(&["a"]), "a");
        assert_eq!(listed(&["a", "b", "c"]), "a, b and c");
    }
}
