//! Tables for people: as wide as the terminal allows, 80 columns where there is none.

use comfy_table::presets::ASCII_MARKDOWN;
use comfy_table::{CellAlignment, ColumnConstraint, ContentArrangement, Table, Width};

use super::report::wrap;
use super::screen::Screen;

use crate::attitude::Position;
use crate::motion::{Leg, Timeline, gimbal_change};
use crate::platform::{Platform, Repositioning};
use crate::report::words;
use crate::results::schema::DocumentKind;
use crate::results::{
    BaselineRecord, BatchRecord, BoundDocument, EvaluationDocument, ParameterRecord, ParetoRecord,
    RoleRecord,
};
use crate::schedule::standard::StandardScheme;
use crate::units::Angle;
use crate::wording::{fixed, number, optional, seconds, separability};

/// How a column is aligned.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Align {
    Left,
    Right,
}
use Align::{Left, Right};

/// A table of these columns; ends with a line break.
pub(super) fn render<const N: usize>(
    columns: [(&str, Align); N],
    rows: Vec<[String; N]>,
) -> String {
    render_rows(&columns, rows.into_iter().map(Vec::from).collect())
}

/// The same for a number of columns that depends on what there is to show.
pub(super) fn render_rows(columns: &[(&str, Align)], rows: Vec<Vec<String>>) -> String {
    let screen = Screen::of_stdout();
    let (rows, widths) = with_whole_words(columns, rows, usize::from(screen.width));
    let mut table = Table::new();
    table
        .load_style(ASCII_MARKDOWN)
        .set_content_arrangement(ContentArrangement::Dynamic)
        .set_width(screen.width);
    if screen.color {
        table.enforce_styling();
    } else {
        table.force_no_tty();
    }
    table.set_header(columns.iter().map(|(name, _)| screen.heading(name)));
    table.add_rows(
        rows.into_iter()
            .map(|row| row.into_iter().map(|cell| screen.cell(cell))),
    );
    for (i, (_, align)) in columns.iter().enumerate() {
        let Some(column) = table.column_mut(i) else {
            continue;
        };
        if *align == Right {
            column.set_cell_alignment(CellAlignment::Right);
        }
        let least = u16::try_from(widths[i] + PADDING).unwrap_or(u16::MAX);
        column.set_constraint(ColumnConstraint::LowerBoundary(Width::Fixed(least)));
    }
    let mut text = table.trim_fmt();
    text.push('\n');
    text
}

/// Columns that a cell takes besides its text: a space on either side.
const PADDING: usize = 2;

/// The rows and the longest word of each column, which a column is at least as wide as: a line ends
/// between words. Where `screen` columns are too few for that, the longest words, which are keys, are
/// broken after a dot or an underscore.
fn with_whole_words(
    columns: &[(&str, Align)],
    mut rows: Vec<Vec<String>>,
    screen: usize,
) -> (Vec<Vec<String>>, Vec<usize>) {
    let longest = |text: &str| {
        let words = text.split_whitespace().map(|w| w.chars().count());
        words.max().unwrap_or(0)
    };
    let width = |i: usize, rows: &[Vec<String>]| {
        let cells = rows.iter().map(|row| longest(&row[i]));
        cells.max().unwrap_or(0).max(longest(columns[i].0))
    };
    let mut widths: Vec<usize> = (0..columns.len()).map(|i| width(i, &rows)).collect();
    // A border before each column and one after the last.
    let needed = widths.iter().map(|w| w + PADDING + 1).sum::<usize>() + 1;
    let Some(widest) = (0..widths.len()).max_by_key(|&i| widths[i]) else {
        return (rows, widths);
    };
    if needed > screen {
        let allowed = widths[widest].saturating_sub(needed - screen);
        for row in &mut rows {
            row[widest] = broken(&row[widest], allowed);
        }
        widths[widest] = width(widest, &rows);
    }
    (rows, widths)
}

/// `text` with words of more than `width` characters broken after dots and underscores, where they have
/// some, into parts of at most so many.
fn broken(text: &str, width: usize) -> String {
    let whole = |word: &str| word.chars().count() <= width;
    let words = text.split(' ').map(|word| {
        let mut lines = Vec::new();
        let mut line = String::new();
        for part in word.split_inclusive(['.', '_']) {
            if !line.is_empty() && !whole(&format!("{line}{part}")) {
                lines.push(std::mem::take(&mut line));
            }
            line.push_str(part);
        }
        lines.push(line);
        lines.join("\n")
    });
    words.collect::<Vec<_>>().join(" ")
}

/// The schedule as it is executed on `platform`.
pub(super) fn schedule(platform: &Platform, timeline: &Timeline) -> String {
    let rows = timeline
        .legs()
        .iter()
        .enumerate()
        .map(|(i, leg)| {
            let held = timeline.positions();
            let number = match i {
                _ if held.contains(&i) => (i - held.start + 1).to_string(),
                0 if platform.motion().start.is_some() => "start".to_owned(),
                _ if i < held.start => "done".to_owned(),
                _ => "return".to_owned(),
            };
            let [alpha, beta, gamma] = leg.position.to_deg().map(|deg| format!("{:.3}", deg + 0.0));
            let dwell = seconds(leg.dwell_s);
            [number, alpha, beta, gamma, dwell, reached_by(platform, leg)]
        })
        .collect();
    let columns = [
        ("#", Right),
        ("alpha, deg", Right),
        ("beta, deg", Right),
        ("gamma, deg", Right),
        ("dwell, s", Right),
        ("reached by", Left),
    ];
    let winding = words::winding(timeline.winding_deg());
    render(columns, rows) + &wrap(&winding)
}

/// The platforms of a batch.
pub(super) fn batch(platforms: &[BatchRecord]) -> String {
    let none = || "-".to_owned();
    let rows = platforms.iter().map(|p| {
        [
            p.directory.clone(),
            p.status.name().to_owned(),
            p.criterion_name.clone().unwrap_or_else(none),
            optional(p.criterion, number),
            optional(p.gap_percent, |gap| format!("{gap:.1}")),
            optional(p.total_time_s, seconds),
            optional(p.positions, |n| n.to_string()),
            optional(p.met, |met| words::met(met).to_owned()),
        ]
    });
    let columns = [
        ("platform", Left),
        ("status", Left),
        ("by", Left),
        ("reached", Right),
        ("gap, %", Right),
        ("time, s", Right),
        ("pos.", Right),
        ("spec", Left),
    ];
    render(columns, rows.collect())
}

/// What the accelerometers read at each position if they are perfect and the platform is level: what
/// an engineer holds against the stand to see that angles are meant the same way.
pub(super) fn specific_force(timeline: &Timeline) -> String {
    let held = timeline.position_legs().iter().enumerate();
    let rows = held.map(|(i, leg)| {
        let [x, y, z] = leg.attitude.specific_force_c().map(|f| fixed(f, 5));
        [(i + 1).to_string(), x, y, z]
    });
    let columns = [
        ("#", Right),
        ("f_x, g", Right),
        ("f_y, g", Right),
        ("f_z, g", Right),
    ];
    render(columns, rows.collect())
}

/// How a position is reached, in a few words.
fn reached_by(platform: &Platform, leg: &Leg) -> String {
    let Some(arrival) = &leg.arrival else {
        return "start".to_owned();
    };
    let mut text = match platform.motion().repositioning {
        Repositioning::FrameHold => "frame-hold".to_owned(),
        Repositioning::Slew => format!("slew {} s", seconds(arrival.duration_s)),
    };
    if arrival.measured {
        text.push_str(" measured");
    }
    if leg.settle_s > 0.0 {
        text.push_str(&format!(" + {} s", seconds(leg.settle_s)));
    }
    // The way round where it is not the usual one: the angles of the table do not tell.
    let usual = gimbal_change(platform, Position::from_array(arrival.from), leg.position);
    for (axis, name) in ["alpha", "beta", "gamma"].into_iter().enumerate() {
        let change = arrival.change[axis];
        if (change - usual[axis]).abs() > 1e-6 {
            let degrees = Angle::from_rad(change).deg();
            text.push_str(&format!(", {name} by {degrees:+.3}"));
        }
    }
    text
}

/// What the test tells about each coefficient.
pub(super) fn coefficients(document: &EvaluationDocument) -> String {
    let has_spec = document
        .coefficients
        .iter()
        .any(|c| c.spec_deg_per_h.is_some());
    let table = if has_spec {
        coefficients_with_specification(document)
    } else {
        coefficients_alone(document)
    };
    format!("{table}D_I, D_O and D_S: deg/h per g.\n")
}

/// The parameters beside the coefficients, a table for each group.
pub(super) fn parameters(others: &[ParameterRecord]) -> String {
    let columns = ParameterColumns {
        claims: others.iter().any(|p| p.claimed_sigma.is_some()),
        specified: others.iter().any(|p| p.spec.is_some()),
    };
    let mut text = String::new();
    for group in others.chunk_by(|a, b| (&a.group, a.role) == (&b.group, b.role)) {
        let ignored = match group[0].role {
            RoleRecord::Estimated => "",
            RoleRecord::Considered => ", not known to the filter",
        };
        text.push_str(&format!("\n{}{ignored}\n\n", group[0].group));
        text.push_str(&parameters_of_group(group, columns));
    }
    text
}

/// Columns that a table of parameters has only where they say something.
#[derive(Clone, Copy)]
struct ParameterColumns {
    /// What the filter claims.
    claims: bool,
    /// The specification.
    specified: bool,
}

fn parameters_of_group(group: &[ParameterRecord], columns: ParameterColumns) -> String {
    let ParameterColumns { claims, specified } = columns;
    let is_estimated = group[0].role == RoleRecord::Estimated;
    let rows = group.iter().map(|p| {
        let mut row = vec![p.name.clone(), p.unit.clone(), number(p.prior_sigma)];
        if is_estimated {
            row.push(number(p.sigma));
            if claims {
                row.push(optional(p.claimed_sigma, number));
            }
            row.push(optional(p.observability_order, |o| o.to_string()));
            row.push(optional(p.separability, separability));
            if specified {
                row.push(optional(p.spec, number));
                row.push(optional(p.spec, |spec| {
                    let met = p.sigma <= spec;
                    if met { "met" } else { "missed" }.to_owned()
                }));
            }
        }
        row
    });
    let mut columns = vec![("parameter", Left), ("unit", Left), ("prior", Right)];
    if is_estimated {
        columns.push(("sigma", Right));
        if claims {
            columns.push(("claimed", Right));
        }
        columns.extend([("order", Right), ("separability", Right)]);
        if specified {
            columns.extend([("spec", Right), ("it is", Left)]);
        }
    }
    render_rows(&columns, rows.collect())
}

/// What ignoring each group would do.
pub(super) fn budget(document: &EvaluationDocument) -> String {
    let rows = document.budget.iter().map(|b| {
        let worst = b.worst.as_ref();
        [
            b.group.clone(),
            number(b.rms_error_if_ignored_deg_per_h),
            optional(b.ratio, |r| format!("{r:.2}")),
            optional(worst, |w| format!("{} {:.2}", w.name.name(), w.ratio)),
        ]
    });
    let columns = [
        ("group", Left),
        ("deg/h", Right),
        ("x sigma", Right),
        ("worst", Right),
    ];
    render(columns, rows.collect())
}

/// What would make the criterion better.
pub(super) fn limits(document: &EvaluationDocument) -> String {
    let rows = document.limits.iter().map(|l| {
        [
            l.what.clone(),
            l.change.clone(),
            format!("{:.4}", l.criterion_ratio),
        ]
    });
    let columns = [("what", Left), ("change", Left), ("ratio", Right)];
    render(columns, rows.collect())
}

fn coefficients_alone(document: &EvaluationDocument) -> String {
    let rows = document.coefficients.iter().map(|c| {
        [
            c.name.name().to_owned(),
            number(c.prior_sigma_deg_per_h),
            number(c.sigma_deg_per_h),
            optional(c.observability_order, |o| o.to_string()),
            format!("{:.4}", c.separability),
        ]
    });
    let columns = [
        ("coefficient", Left),
        ("prior, deg/h", Right),
        ("sigma, deg/h", Right),
        ("order", Right),
        ("separability", Right),
    ];
    render(columns, rows.collect())
}

fn coefficients_with_specification(document: &EvaluationDocument) -> String {
    let rows = document.coefficients.iter().map(|c| {
        [
            c.name.name().to_owned(),
            number(c.prior_sigma_deg_per_h),
            number(c.sigma_deg_per_h),
            optional(c.observability_order, |o| o.to_string()),
            format!("{:.4}", c.separability),
            optional(c.spec_deg_per_h, number),
            match (c.spec_deg_per_h, c.time_to_spec_s) {
                (Some(_), None) => "missed".to_owned(),
                (_, time) => optional(time, seconds),
            },
        ]
    });
    let columns = [
        ("name", Left),
        ("prior, deg/h", Right),
        ("sigma, deg/h", Right),
        ("order", Right),
        ("separab.", Right),
        ("spec, deg/h", Right),
        ("met at, s", Right),
    ];
    render(columns, rows.collect())
}

/// How well the platform's alignment is known at the end.
pub(super) fn misalignment(document: &EvaluationDocument) -> String {
    let rows = document
        .misalignment
        .iter()
        .zip(["North", "Up", "East"])
        .map(|(m, axis)| [m.name.clone(), axis.to_owned(), number(m.sigma_arcsec)]);
    let columns = [
        ("misalignment", Left),
        ("about", Left),
        ("sigma, arcsec", Right),
    ];
    render(columns, rows.collect())
}

/// The standard schemes beside the schedule found; the criterion too where it is not the RMS.
pub(super) fn baselines(found: &EvaluationDocument, baselines: &[BaselineRecord]) -> String {
    let this = BaselineRecord {
        name: "this schedule".to_owned(),
        positions: found.schedule.positions.len(),
        rms_sigma_deg_per_h: found.rms_sigma_deg_per_h,
        ratio: Some(1.0),
        criterion: found.score.criterion,
        criterion_ratio: Some(1.0),
        best_order: None,
    };
    let with_criterion = !words::is_the_rms(found);
    let with_orders = baselines.iter().any(|b| b.best_order.is_some());
    let ratio = |value| optional(value, |r: f64| format!("{r:.2}"));
    let row = |b: &BaselineRecord| {
        let mut row = vec![
            b.name.clone(),
            b.positions.to_string(),
            number(b.rms_sigma_deg_per_h),
            ratio(b.ratio),
        ];
        if with_criterion {
            row.extend([number(b.criterion), ratio(b.criterion_ratio)]);
        }
        if with_orders {
            let best = b.best_order.as_ref();
            row.push(best.map_or_else(String::new, |best| ratio(best.criterion_ratio)));
        }
        row
    };
    let rows = std::iter::once(&this).chain(baselines).map(row);
    let score = &found.score;
    let criterion = words::criterion_column(&score.criterion_name, &score.criterion_unit);
    let mut columns = vec![
        ("scheme", Left),
        ("positions", Right),
        ("RMS sigma, deg/h", Right),
        ("ratio", Right),
    ];
    if with_criterion {
        columns.extend([(criterion.as_str(), Right), ("ratio", Right)]);
    }
    if with_orders {
        columns.push(("in best order", Right));
    }
    render_rows(&columns, rows.collect())
}

/// Lower bounds on each σ.
pub(super) fn sigma_bounds(document: &BoundDocument) -> String {
    let spec = document.inputs.objective.specification();
    let rows = document
        .sigma_lower_bound_deg_per_h
        .iter()
        .map(|(c, bound)| {
            [
                c.name().to_owned(),
                number(*bound),
                optional(spec.of(*c), number),
            ]
        })
        .collect();
    render(
        [
            ("coefficient", Left),
            ("sigma at least, deg/h", Right),
            ("specification", Right),
        ],
        rows,
    )
}

/// The front of total time against criterion.
pub(super) fn front(criterion_name: &str, criterion_unit: &str, front: &[ParetoRecord]) -> String {
    let criterion = words::criterion_column(criterion_name, criterion_unit);
    let columns = [
        ("total time, s", Right),
        (criterion.as_str(), Right),
        ("none below", Right),
        ("RMS sigma, deg/h", Right),
        ("positions", Right),
    ];
    let rows = front.iter().map(|p| {
        [
            number(p.total_time_s),
            number(p.criterion),
            optional(p.lower_bound, number),
            number(p.rms_sigma_deg_per_h),
            p.schedule.positions.len().to_string(),
        ]
    });
    render(columns, rows.collect())
}

/// The built-in schemes.
pub(super) fn schemes() -> String {
    let rows = StandardScheme::ALL.map(|s| {
        [
            s.name().to_owned(),
            s.positions().len().to_string(),
            s.description().to_owned(),
        ]
    });
    let columns = [("name", Left), ("positions", Right), ("description", Left)];
    render(columns, rows.to_vec())
}

/// The documents that have a JSON Schema.
pub(super) fn documents() -> String {
    let rows = DocumentKind::ALL.map(|d| [d.name().to_owned(), d.description().to_owned()]);
    render([("name", Left), ("document", Left)], rows.to_vec())
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: &str = "accelerometer.acceleration_random_walk_ug_per_sqrt_h";

    #[test]
    fn keys_are_whole_or_broken_where_a_reader_would() {
        let rows = || {
            vec![vec![
                KEY.to_owned(),
                "halved, from this to that".to_owned(),
                "0.9876".to_owned(),
            ]]
        };
        let columns = [("what", Left), ("change", Left), ("ratio", Right)];
        // Room for all words: nothing is broken.
        let (whole, widths) = with_whole_words(&columns, rows(), 80);
        assert_eq!((whole, widths), (rows(), vec![KEY.len(), 7, 6]));
        let (narrow, widths) = with_whole_words(&columns, rows(), 50);
        assert_eq!(
            narrow[0][0],
            "accelerometer.acceleration_\nrandom_walk_ug_per_sqrt_h"
        );
        assert_eq!(widths, [27, 7, 6]);
        // A word without a dot or an underscore stays what it is.
        assert_eq!(broken("constantinople or", 5), "constantinople or");
        assert_eq!(broken("a_b_c d", 4), "a_b_\nc d");
    }
}
