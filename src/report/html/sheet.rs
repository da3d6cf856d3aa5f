//! The operator's sheet as a page to print.

use askama::Template;

use super::typeset_angles;
use crate::config::TestConfig;
use crate::error::{Error, Result};
use crate::report::words;
use crate::sheet::{FORCE_DECIMALS, OperatorSheet, SheetRow, Stop};
use crate::wording::h_mm_ss;

/// The whole page.
#[derive(Template)]
#[template(path = "sheet.html")]
struct SheetPage {
    title: String,
    /// With what is known of them; the others are filled in by hand. The first is wide.
    fields: [(&'static str, String); 6],
    planned_for: String,
    notes: Vec<String>,
    rows: Vec<Row>,
    tool_version: &'static str,
}

/// Whose test it is; what nobody said is left for the pen.
fn fields(test: &TestConfig) -> [(&'static str, String); 6] {
    let said = |text: &Option<String>| text.clone().unwrap_or_default();
    [
        ("Title", said(&test.title)),
        ("Date", String::new()),
        ("Platform, serial number", said(&test.serial)),
        ("Stand", said(&test.stand)),
        ("Operator", said(&test.operator)),
        ("Test started at", String::new()),
    ]
}

/// A row as it is printed.
struct Row {
    done: bool,
    name: String,
    move_starts: String,
    dwell_starts: String,
    wait_until: String,
    /// With the same within ±180° where that is another one.
    angles: [(String, Option<String>); 3],
    force: [String; 3],
    words: String,
}

/// The page of a sheet.
///
/// # Errors
///
/// [`Error::is_numerical`] when the template cannot be written.
pub fn page(sheet: &OperatorSheet) -> Result<String> {
    let rows = sheet.rows();
    let places = decimals_needed(rows);
    let is_position = |row: &&SheetRow| matches!(row.stop, Stop::Position(_));
    let positions = rows.iter().filter(is_position).count();
    let total = h_mm_ss(rows.last().map_or(0.0, |row| row.ends_s));
    let page = SheetPage {
        title: match positions {
            1 => format!("Operator's sheet: 1 position, {total}"),
            _ => format!("Operator's sheet: {positions} positions, {total}"),
        },
        fields: fields(sheet.test()),
        planned_for: minus(&typeset_angles(sheet.planned_for())),
        notes: notes(sheet, places),
        rows: rows.iter().map(|row| printed(row, places)).collect(),
        tool_version: sheet.tool_version(),
    };
    page.render()
        .map_err(|e| Error::numerical(format!("the sheet cannot be written: {e}")).with_source(e))
}

/// What to know before the first row.
fn notes(sheet: &OperatorSheet, places: usize) -> Vec<String> {
    let rows = sheet.rows();
    let mut notes = vec![
        "Clocks are h:mm:ss from the start of the test, to the nearest second.".to_owned(),
        "Tick a position when it is left, not when it is reached.".to_owned(),
        "Nothing is measured while the platform moves and settles, except where the row says MEASURED MOVE."
            .to_owned(),
        "The accelerometers should read so if they are perfect and the base is as planned. A reading with \
         another sign or on another axis: stop, the angles are meant otherwise."
            .to_owned(),
    ];
    if rows.iter().any(SheetRow::is_wound) {
        notes.push(
            "Angles count on through the test, so that the gimbals go round the right way; in brackets \
             the same within ±180°."
                .to_owned(),
        );
    }
    if places == MOST_DECIMALS {
        notes.push(format!(
            "Angles are rounded to {places} decimals; sheet.csv has them in full."
        ));
    }
    notes.push(typeset_angles(&words::winding(sheet.winding_deg())));
    notes
}

fn printed(row: &SheetRow, places: usize) -> Row {
    let shown = |deg: f64| minus(&format!("{deg:.places$}"));
    let angle = |axis: usize| {
        let (net, within) = (row.angles_deg[axis], row.wrapped_deg[axis]);
        (shown(net), (net != within).then(|| shown(within)))
    };
    Row {
        done: row.stop == Stop::Done,
        name: row.stop.to_string(),
        move_starts: h_mm_ss(row.move_starts_s),
        dwell_starts: h_mm_ss(row.dwell_starts_s),
        wait_until: h_mm_ss(row.ends_s),
        angles: std::array::from_fn(angle),
        force: row
            .specific_force_g
            .map(|f| minus(&format!("{f:.FORCE_DECIMALS$}"))),
        words: together(&minus(&typeset_angles(&row.words()))),
    }
}

/// With signs that are as wide as digits; a zero has none.
fn minus(text: &str) -> String {
    let is_zero = |digits: &str| digits.chars().all(|c| matches!(c, '0' | '.'));
    if let Some(digits) = text.strip_prefix('-').filter(|digits| is_zero(digits)) {
        return digits.to_owned();
    }
    let mut shown = String::with_capacity(text.len());
    let mut rest = text.chars().peekable();
    while let Some(c) = rest.next() {
        let is_sign = c == '-' && rest.peek().is_some_and(char::is_ascii_digit);
        shown.push(if is_sign { '−' } else { c });
    }
    shown
}

/// Angles on one line with their names.
fn together(text: &str) -> String {
    ["α", "β", "γ"]
        .into_iter()
        .fold(text.to_owned(), |text, name| {
            text.replace(&format!("{name} "), &format!("{name}\u{a0}"))
        })
}

/// Most decimals of an angle on paper.
const MOST_DECIMALS: usize = 4;

/// The fewest decimals that show every angle as it is, [`MOST_DECIMALS`] at most.
fn decimals_needed(rows: &[SheetRow]) -> usize {
    let all = || rows.iter().flat_map(|row| row.angles_deg);
    let shows = |places: &usize| {
        let scale = 10_f64.powi(i32::try_from(*places).unwrap_or(0));
        all().all(|deg| ((deg * scale).round() / scale - deg).abs() < 0.5e-9)
    };
    (0..MOST_DECIMALS).find(shows).unwrap_or(MOST_DECIMALS)
}
