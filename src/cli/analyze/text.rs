//! The analysis for people: tables and sentences, at most 80 columns wide.

use crate::analysis::remark::Remark;
use crate::cli::named;
use crate::cli::report::wrap;
use crate::cli::table::Align::{Left, Right};
use crate::cli::table::{self, render};
use crate::drift::DriftCoefficient;
use crate::observability::solution::NoSolution;
use crate::observability::{Channel, Order};
use crate::report::words;
use crate::results::{
    AnalysedPosition, AnalysisDocument, CorrelationRecord, ReconstructionRecord, RemarkRecord,
    Standing, SuggestionRecord,
};
use crate::wording::{number, optional, seconds, separability};

/// Positions whose excitations fit into a line.
const COLUMNS: usize = 22;
/// Positions whose combinations are written out, if each has few terms.
const WRITTEN_OUT: usize = 8;
/// Longest combination that is written out, characters.
const SHORT: usize = 40;
/// Terms of a reconstruction that are written out: more are seldom needed.
const TERMS: usize = 13;
/// Weak combinations that are listed.
const WEAKEST: usize = 4;

/// The whole report.
pub(super) fn analysis(document: &AnalysisDocument) -> String {
    [
        of_what(document),
        "States: highest derivative of Z in their solution (- : not observable)\n\n".to_owned(),
        states(document),
        "\nCoefficients\n\n".to_owned(),
        coefficients(document),
        "\nLowest order at which each position excites a coefficient\n\n".to_owned(),
        excitation(&document.positions),
        seen(&document.positions),
        "\nReconstructions: x@k is eps_nx at position k, z@k eps_nz - omega_N psi_ny,\n\
         y@k eps_ny; sigma by these terms alone, deg/h\n\n"
            .to_owned(),
        reconstructions(document),
        "\nStrongest correlations\n\n".to_owned(),
        correlations(document),
        "\nWhat is told worst (sigma of each combination scaled to length one)\n\n".to_owned(),
        weak(document),
        "\nClassical measures\n\n".to_owned(),
        classical(document),
        "\nWhat to add\n\n".to_owned(),
        advice(document),
        of_all_parameters(document),
    ]
    .concat()
}

/// Whether there is more than the twelve coefficients in the paper's mounting.
fn has_more(document: &AnalysisDocument) -> bool {
    document.parameters.len() > document.coefficients.len()
        || !document.remarks.is_empty()
        || document.additions.is_some()
}

/// What the tables are of, where that is not all.
fn of_what(document: &AnalysisDocument) -> String {
    match document.parameters.len() > document.coefficients.len() {
        true => {
            wrap(
                "First the twelve drift coefficients by themselves, everything else known (but in \
                 sigma); all parameters of the platform are at the end.",
            ) + "\n"
        }
        false => String::new(),
    }
}

/// What there is beyond the twelve coefficients in the paper's mounting; empty where nothing is.
fn of_all_parameters(document: &AnalysisDocument) -> String {
    if !has_more(document) {
        return String::new();
    }
    let others = &document.parameters[document.coefficients.len()..];
    let mut text = "\nAll parameters of the platform\n".to_owned();
    if !others.is_empty() {
        text.push_str(&table::parameters(others));
    }
    if let Some(named) = &document.observability.parameters {
        text.push('\n');
        text.push_str(&named::unobservable(named));
        text.push_str(&named::weak(named));
    }
    for remark in document.remarks.iter().filter(|r| !is_of_noise(r)) {
        text.push('\n');
        text.push_str(&wrap(&remark.words));
    }
    if let Some(additions) = &document.additions {
        text.push('\n');
        text.push_str(&named::additions(additions));
    }
    text
}

fn order(order: Option<Order>) -> String {
    order.map_or_else(|| "-".to_owned(), |o| o.number().to_string())
}

fn states(document: &AnalysisDocument) -> String {
    let rows = document.states.iter().map(|s| {
        [
            s.name.clone(),
            order(s.order_one_position),
            order(s.order_schedule),
        ]
    });
    let columns = [
        ("state", Left),
        ("one position", Right),
        ("schedule", Right),
    ];
    render(columns, rows.collect())
}

fn coefficients(document: &AnalysisDocument) -> String {
    let (mut any_differs, mut any_nearly) = (false, false);
    let rows = document
        .coefficients
        .iter()
        .map(|c| {
            let differs = c.observability_order != c.observability_order_strict;
            any_differs |= differs;
            let nearly = document
                .nearly
                .iter()
                .any(|n| n.coefficient == Some(c.name));
            any_nearly |= nearly;
            [
                c.name.name().to_owned(),
                format!(
                    "{}{}{}",
                    order(c.observability_order),
                    if nearly { "~" } else { "" },
                    if differs { "*" } else { "" }
                ),
                c.reconstruction.as_ref().map_or_else(String::new, channels),
                separability(c.separability_first_order),
                separability(c.separability),
                number(c.sigma_deg_per_h),
            ]
        })
        .collect();
    let columns = [
        ("coefficient", Left),
        ("order", Right),
        ("through", Left),
        ("sep. order 1", Right),
        ("sep. all", Right),
        ("sigma, deg/h", Right),
    ];
    let mut text = render(columns, rows);
    if any_nearly {
        text.push_str("~ only through a small tilt, see below.\n");
    }
    if any_differs {
        text.push_str(
            "* 2 when counted strictly: z channels of different dwells are compared, and the\n  \
             change of psi_y in between comes from the second derivative (25).\n",
        );
    }
    let o = &document.observability;
    let condition = o
        .condition_number
        .map_or_else(|| "infinite".to_owned(), condition);
    text.push('\n');
    text.push_str(&wrap(&format!(
        "Rank {} of {} unknowns; {} by the channels of order 1, {} by x alone. Order of \
         omega_N psi_y(0): {}. Condition number {condition}.",
        o.rank,
        o.unknowns,
        o.rank_first_order,
        o.rank_x,
        order(o.azimuth_order),
    )));
    if !o.unobservable.is_empty() {
        text.push_str(&wrap(&format!(
            "Unobservable: {}.",
            o.unobservable.join("; ")
        )));
    }
    if !document.nearly.is_empty() {
        text.push('\n');
        text.push_str(&wrap(words::NEARLY));
        for nearly in &document.nearly {
            text.push_str(&wrap(&nearly.words));
        }
    }
    text
}

fn condition(value: f64) -> String {
    match value {
        c if c < 1e5 => format!("{c:.1}"),
        c => number(c),
    }
}

/// The size of a weight: three decimals, where those say something.
fn weight(size: f64) -> String {
    match size {
        w if w < 5e-4 => format!("{w:.1e}"),
        w if w < 1e3 => format!("{w:.3}"),
        w if w < 1e7 => format!("{w:.0}"),
        w => format!("{w:.3e}"),
    }
}

fn channels(r: &ReconstructionRecord) -> String {
    let names: Vec<&str> = r.channels.iter().map(|c| c.name()).collect();
    names.join(" ")
}

/// One line per coefficient, one digit per position.
fn excitation(positions: &[AnalysedPosition]) -> String {
    let shown = &positions[..positions.len().min(COLUMNS)];
    let mut text = format!("{:<6}", "");
    for k in 1..=shown.len() {
        text.push_str(&format!("{k:>3}"));
    }
    text.push('\n');
    for c in DriftCoefficient::ALL {
        text.push_str(&format!("{:<6}", c.name()));
        for p in shown {
            let excited = p.excited_order.get(&c).copied().flatten();
            text.push_str(&format!("{:>3}", order(excited)));
        }
        text.push('\n');
    }
    if positions.len() > shown.len() {
        text.push_str(&format!(
            "(and {} more positions: --json has all)\n",
            positions.len() - shown.len()
        ));
    }
    text
}

/// What the channels show, written out where that is short: axis-aligned positions.
fn seen(positions: &[AnalysedPosition]) -> String {
    let short = |p: &&AnalysedPosition| p.seen.iter().all(|s| s.combination.len() <= SHORT);
    let written: Vec<_> = positions.iter().filter(short).collect();
    if written.len() != positions.len() || positions.len() > WRITTEN_OUT {
        return String::new();
    }
    let mut text = "\nWhat the channels show\n\n".to_owned();
    for (k, p) in positions.iter().enumerate() {
        for s in &p.seen {
            text.push_str(&format!(
                "{:>3}  {}  {}\n",
                k + 1,
                s.channel.name(),
                s.combination
            ));
        }
    }
    text
}

fn reconstructions(document: &AnalysisDocument) -> String {
    let mut text = String::new();
    for c in &document.coefficients {
        let name = c.name.name();
        let Some(r) = &c.reconstruction else {
            let why = c.reconstruction_absent.unwrap_or(NoSolution::NotObservable);
            text.push_str(&format!("{name} = nothing: {why}\n"));
            continue;
        };
        let mut sum = String::new();
        for (i, t) in r.terms.iter().take(TERMS).enumerate() {
            let sign = match (i, t.weight < 0.0) {
                (0, false) => "",
                (0, true) => "-",
                (_, false) => "+ ",
                (_, true) => "- ",
            };
            let place = match t.move_fraction {
                Some(f) => format!("{}(move {f:.2})", t.position),
                None => t.position.to_string(),
            };
            // Joined by a character that does not break: a term stays on one line.
            let channel = match t.channel {
                Channel::Azimuth => "azimuth",
                c => c.name(),
            };
            sum.push_str(&format!(
                "{sign}{}\u{a0}{channel}@{place} ",
                weight(t.weight.abs())
            ));
        }
        if r.terms.len() > TERMS {
            let more = r.terms.len() - TERMS;
            sum.push_str(&format!("and {more} more terms, all by --json "));
        }
        let line = format!("{name} = {sum}(sigma\u{a0}{})", number(r.sigma_deg_per_h));
        text.push_str(&wrap(
            &line.replace("+ ", "+\u{a0}").replace("- ", "-\u{a0}"),
        ));
    }
    text.replace('\u{a0}', " ")
}

fn correlations(document: &AnalysisDocument) -> String {
    let c = &document.correlations;
    let show = |pair: Option<&CorrelationRecord>| match pair {
        Some(p) => [
            format!("{} {}", p.a.name(), p.b.name()),
            format!("{:.4}", p.correlation),
        ],
        None => [String::new(), String::new()],
    };
    let rows = (0..c.estimates.len().max(c.columns.len()))
        .map(|i| {
            let [a, b] = show(c.estimates.get(i));
            let [d, e] = show(c.columns.get(i));
            [a, b, d, e]
        })
        .collect();
    let columns = [
        ("of the estimates", Left),
        ("rho", Right),
        ("of the regressor's columns", Left),
        ("cosine", Right),
    ];
    render(columns, rows)
}

fn weak(document: &AnalysisDocument) -> String {
    if document.weak.is_empty() {
        return "No channel tells anything.\n".to_owned();
    }
    let mut text = String::new();
    for w in document.weak.iter().take(WEAKEST) {
        let [x, z, y] = w.shares.map(|s| 100.0 * s);
        let through = match w.seen_through_order {
            Order::Second => "seen only through eps_y, second derivative".to_owned(),
            Order::Zero | Order::First => {
                format!("information {x:.0} % x, {z:.0} % z, {y:.0} % y")
            }
        };
        text.push_str(&wrap(&format!(
            "{}: sigma {} deg/h, {through}.",
            w.name,
            number(w.sigma_deg_per_h)
        )));
    }
    text
}

fn classical(document: &AnalysisDocument) -> String {
    let rows = document.coefficients.iter().map(|c| {
        [
            c.name.name().to_owned(),
            number(c.sigma_deg_per_h),
            optional(c.gramian_sigma_deg_per_h, number),
            number(c.output_sensitivity_h_per_deg),
            number(c.piecewise_constant_degree),
        ]
    });
    let columns = [
        ("name", Left),
        ("filter, deg/h", Right),
        ("Gramian, deg/h", Right),
        ("sensitivity, h/deg", Right),
        ("Lie SVD, rad s", Right),
    ];
    let p = &document.piecewise_constant;
    let mut text = render(columns, rows.collect());
    let smallest = p.singular_values.last().copied();
    text.push_str(&wrap(&format!(
        "Lie-derivative matrix of the dwells: rank {} of {} states, smallest singular value {}.",
        p.rank,
        p.states,
        smallest.map_or_else(String::new, number),
    )));
    // Where the numbers by the filter and those by the Gramian stand side by side.
    for remark in document.remarks.iter().filter(|r| is_of_noise(r)) {
        text.push_str(&wrap(&remark.words));
    }
    text
}

/// Whether a remark says what is counted of noise that wanders.
fn is_of_noise(remark: &RemarkRecord) -> bool {
    remark.kind == Remark::NOISE_WANDERS
}

fn advice(document: &AnalysisDocument) -> String {
    let mut text: String = document.advice.iter().map(|a| wrap(a)).collect();
    if let Some(s) = &document.suggestion {
        text.push('\n');
        text.push_str(&suggestion(s));
    }
    if let Some(why) = document.suggestion_absent {
        text.push_str(&wrap(&format!("No position is suggested: {why}.")));
    }
    text
}

fn suggestion(s: &SuggestionRecord) -> String {
    let p = &s.position;
    let target = s.target.join("; ");
    let aim = match s.target_unobservable {
        true => format!("what is unobservable ({target})"),
        false => format!("the worst combination that a position can help ({target})"),
    };
    let mut text = wrap(&format!(
        "Of all attitudes the gimbals allow, alpha {:.3}, beta {:.3}, gamma {:.3} deg for {} s \
         separates best {aim}:",
        p.alpha_deg,
        p.beta_deg,
        p.gamma_deg,
        seconds(p.dwell_s),
    ));
    let row = |name: &str, of: &dyn Fn(&Standing) -> String| {
        [
            name.to_owned(),
            of(&s.before),
            of(&s.same_time),
            of(&s.after),
        ]
    };
    let rows = vec![
        row("total time, s", &|s| seconds(s.total_time_s)),
        row("rank / by order 1", &|s| {
            format!("{} / {}", s.rank, s.rank_first_order)
        }),
        row("least separability", &|s| {
            separability(s.least_separability)
        }),
        row("its sigma, deg/h", &|s| number(s.target_sigma_deg_per_h)),
        row("RMS sigma, deg/h", &|s| number(s.rms_sigma_deg_per_h)),
        row("criterion", &|s| number(s.criterion)),
    ];
    let columns = [
        ("", Left),
        ("now", Right),
        ("same time, no position", Right),
        ("with the position", Right),
    ];
    text.push('\n');
    text.push_str(&render(columns, rows));
    text
}
