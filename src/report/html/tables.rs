//! The tables of a page.

use crate::attitude::Position;
use crate::commands::{Segment, clock};
use crate::compare::PositionOrder;
use crate::motion::{Leg, gimbal_change};
use crate::platform::{Platform, Repositioning};
use crate::report::{angles, words};
use crate::results::{
    BaselineRecord, BatchRecord, ComparisonDocument, ParetoRecord, RoleRecord, ScoreRecord,
    SimulatedParameter, SimulationDocument,
};
use crate::simulate::consistency::Consistency;
use crate::simulate::specification::SpecificationCheck;
use crate::units::{Angle, AngularRate};
use crate::wording::{fixed, number, optional, seconds, separability};

use super::blocks::HtmlTable;
use super::pictures::gravity;
use super::subject::{Sense, Subject};

/// A missing entry.
const NONE: &str = "–";

fn order(value: Option<u8>) -> String {
    value.map_or_else(|| "none".to_owned(), |o| o.to_string())
}

fn ratio(value: Option<f64>) -> String {
    optional(value, |r| format!("{r:.2}"))
}

/// Positions to check the angles by, with what the accelerometers should read.
pub(super) fn check_positions(platform: &Platform) -> HtmlTable {
    let rows = platform.check_positions().into_iter().map(|check| {
        let shows = check.gimbal.map_or_else(
            || "where the others start from".to_owned(),
            |gimbal| {
                format!(
                    "{}, the {} gimbal",
                    angles::ANGLES[gimbal],
                    angles::GIMBALS[gimbal]
                )
            },
        );
        let angles = check.position.to_deg().map(|deg| (deg + 0.0).to_string());
        let force = check.specific_force_g.map(|f| fixed(f, 5));
        let cells = [vec![shows], angles.to_vec(), force.to_vec()];
        cells.concat()
    });
    HtmlTable::new(
        "What the accelerometers should read",
        &[
            "shows", "α, °", "β, °", "γ, °", "f_x, g", "f_y, g", "f_z, g",
        ],
        rows.collect(),
    )
}

/// The positions, how each is reached and how gravity lies there.
pub(super) fn positions(subject: &Subject) -> HtmlTable {
    let held = subject.timeline.positions();
    let times = subject.leg_times_s();
    let frame_hold =
        subject.study.test().platform().motion().repositioning == Repositioning::FrameHold;
    let has_start = subject.study.test().platform().motion().start.is_some();
    let rows = subject.timeline.legs().iter().enumerate().map(|(i, leg)| {
        let name = match i {
            _ if held.contains(&i) => (i - held.start + 1).to_string(),
            0 if has_start => "start".to_owned(),
            _ if i < held.start => "done".to_owned(),
            _ => "return".to_owned(),
        };
        let [alpha, beta, gamma] = leg.position.to_deg().map(|deg| format!("{:.3}", deg + 0.0));
        let g = gravity(&leg.attitude);
        let move_s = leg.arrival.map_or_else(
            || NONE.to_owned(),
            |m| match (frame_hold, m.measured) {
                (true, _) => "frame-hold".to_owned(),
                (false, true) => format!("{}, measured", seconds(m.duration_s)),
                (false, false) => seconds(m.duration_s),
            },
        ) + &unusual_way(subject, leg);
        vec![
            name,
            alpha,
            beta,
            gamma,
            clock(times[i]),
            move_s,
            seconds(leg.settle_s),
            seconds(leg.dwell_s),
            format!("{:.3}, {:.3}, {:.3}", g[0] + 0.0, g[1] + 0.0, g[2] + 0.0),
            Sense::of(g).name().to_owned(),
        ]
    });
    HtmlTable::new(
        "Positions in order",
        &[
            "#",
            "α, °",
            "β, °",
            "γ, °",
            "begins",
            "move, s",
            "settle, s",
            "dwell, s",
            "gravity in x, y, z, g",
            "which is",
        ],
        rows.collect(),
    )
}

/// Which way round a gimbal goes where it is not the usual one: the angles do not tell.
fn unusual_way(subject: &Subject, leg: &Leg) -> String {
    let Some(arrival) = &leg.arrival else {
        return String::new();
    };
    let from = Position::from_array(arrival.from);
    let usual = gimbal_change(subject.study.test().platform(), from, leg.position);
    let turns = ["α", "β", "γ"].into_iter().enumerate();
    let unusual = turns.filter(|(axis, _)| (arrival.change[*axis] - usual[*axis]).abs() > 1e-6);
    let said = unusual.map(|(axis, name)| {
        let deg = Angle::from_rad(arrival.change[axis]).deg();
        format!("; {name} by {deg:+.3}°")
    });
    said.collect()
}

/// What the stand is told, one row for each move, settle and dwell.
pub(super) fn commands(subject: &Subject) -> HtmlTable {
    let all = subject.commands.commands();
    let mut rows = Vec::new();
    let same = |a: &&[crate::commands::Command]| a.len();
    let groups = all.chunk_by(|a, b| a.segment == b.segment && a.position == b.position);
    for group in groups.filter(|g| same(g) > 0) {
        let (first, last) = (&group[0], &group[group.len() - 1]);
        let duration: f64 = group.iter().map(|c| c.duration_s).sum();
        let angles = |a: [f64; 3]| {
            let deg = a.map(|rad| format!("{:.3}", Angle::from_rad(rad).deg() + 0.0));
            deg.join(", ")
        };
        let rates = first.gimbal_rates_rad_per_s.map_or_else(
            || NONE.to_owned(),
            |r| {
                let deg = r.map(|v| format!("{:.4}", Angle::from_rad(v).deg() + 0.0));
                match r == [0.0; 3] {
                    true => "0".to_owned(),
                    false => deg.join(", "),
                }
            },
        );
        rows.push(vec![
            clock(first.start_s),
            first.segment.name().to_owned(),
            first
                .position
                .map_or_else(|| NONE.to_owned(), |p| p.to_string()),
            seconds(duration),
            angles(first.from_rad),
            match first.from_rad == last.to_rad {
                true => "held".to_owned(),
                false => angles(last.to_rad),
            },
            rates,
            platform_rate(first),
            group.len().to_string(),
            if first.measured { "yes" } else { "no" }.to_owned(),
        ]);
    }
    HtmlTable::new(
        "Commands, a row for each move, settle and dwell",
        &[
            "clock",
            "segment",
            "position",
            "for, s",
            "from α, β, γ, °",
            "to α, β, γ, °",
            "gimbal rates, °/s",
            "ω_c in x, y, z",
            "steps",
            "measured",
        ],
        rows,
    )
}

/// In °/h while tracking, in °/s while turning.
fn platform_rate(command: &crate::commands::Command) -> String {
    let Some(omega) = command.platform_rate_rad_per_s else {
        return NONE.to_owned();
    };
    let turning = matches!(command.segment, Segment::Move | Segment::Return);
    let parts = omega.map(|v| match turning {
        true => format!("{:.4}", Angle::from_rad(v).deg() + 0.0),
        false => format!("{:.4}", AngularRate::from_rad_per_s(v).deg_per_h() + 0.0),
    });
    let unit = if turning { "°/s" } else { "°/h" };
    format!("{} {unit}", parts.join(", "))
}

/// The platforms of a batch.
pub(super) fn batch(platforms: &[BatchRecord]) -> HtmlTable {
    let none = || NONE.to_owned();
    let rows = platforms.iter().map(|p| {
        let value = |v: Option<f64>| v.map_or_else(none, number);
        vec![
            p.directory.clone(),
            p.file.clone(),
            p.status.name().to_owned(),
            match &p.criterion_name {
                Some(name) => {
                    let unit = p.criterion_unit.as_deref().unwrap_or("1");
                    format!("{name}, {}", unit.replace("deg/h", "°/h"))
                }
                None => none(),
            },
            value(p.criterion),
            value(p.lower_bound),
            p.gap_percent.map_or_else(none, |gap| format!("{gap:.1}")),
            value(p.rms_sigma_deg_per_h),
            p.total_time_s.map_or_else(none, seconds),
            p.positions.map_or_else(none, |n| n.to_string()),
            p.met.map_or_else(none, |met| words::met(met).to_owned()),
        ]
    });
    HtmlTable::new(
        "Platforms, in the order given",
        &[
            "directory",
            "file",
            "status",
            "criterion",
            "reached",
            "no schedule below",
            "above that, %",
            "RMS σ, °/h",
            "time, s",
            "positions",
            "specification",
        ],
        rows.collect(),
    )
}

/// σ before and after, and the specification.
pub(super) fn accuracy(subject: &Subject) -> HtmlTable {
    let rows = subject.document.coefficients.iter().map(|c| {
        let met = match (c.spec_deg_per_h, c.time_to_spec_s) {
            (None, _) => NONE.to_owned(),
            (Some(_), None) => "missed".to_owned(),
            (Some(_), Some(t)) => seconds(t),
        };
        vec![
            c.name.name().to_owned(),
            number(c.prior_sigma_deg_per_h),
            number(c.sigma_deg_per_h),
            number(c.prior_sigma_deg_per_h / c.sigma_deg_per_h),
            c.spec_deg_per_h.map_or_else(|| NONE.to_owned(), number),
            met,
        ]
    });
    HtmlTable::new(
        "Coefficients after the test, 1σ, °/h (D_I, D_O, D_S: °/h per g)",
        &[
            "coefficient",
            "before",
            "after",
            "times better",
            "specification",
            "met at, s",
        ],
        rows.collect(),
    )
}

/// The misalignment at the end.
pub(super) fn misalignment(subject: &Subject) -> HtmlTable {
    let names = ["North", "Up", "East"];
    let rows = subject.document.misalignment.iter().zip(names);
    let rows = rows.map(|(m, axis)| vec![format!("{} ({axis})", m.name), number(m.sigma_arcsec)]);
    HtmlTable::new(
        "Misalignment at the end of the test, 1σ",
        &["about", "arcsec"],
        rows.collect(),
    )
}

/// Orders and separability.
pub(super) fn observability(subject: &Subject) -> HtmlTable {
    let analysed = &subject.analysis.coefficients;
    let rows = subject
        .document
        .coefficients
        .iter()
        .zip(analysed)
        .map(|(c, a)| {
            vec![
                c.name.name().to_owned(),
                order(c.observability_order),
                order(a.observability_order_strict.map(|o| o.number())),
                separability(c.separability_first_order),
                separability(c.separability),
            ]
        });
    HtmlTable::new(
        "Observability of the coefficients",
        &[
            "coefficient",
            "order",
            "order, ψ_y counted strictly",
            "separability by order 1",
            "separability by all",
        ],
        rows.collect(),
    )
}

/// The combinations that are known worst.
pub(super) fn weak(subject: &Subject) -> HtmlTable {
    let rows = subject.analysis.weak.iter().take(4).map(|w| {
        let [x, z, y] = w.shares.map(|s| format!("{:.0} %", 100.0 * s));
        vec![
            w.name.clone(),
            number(w.sigma_deg_per_h),
            format!("{x}, {z}, {y}"),
        ]
    });
    HtmlTable::new(
        "Combinations known worst, of length one",
        &[
            "combination",
            "σ, °/h",
            "information by x, z (order 1) and y (order 2)",
        ],
        rows.collect(),
    )
}

/// The strongest correlations.
pub(super) fn correlations(subject: &Subject) -> HtmlTable {
    let rows = subject.analysis.correlations.estimates.iter().map(|c| {
        vec![
            format!("{} and {}", c.a.name(), c.b.name()),
            format!("{:.4}", c.correlation).replace('-', "−"),
        ]
    });
    HtmlTable::new(
        "Strongest correlations of the estimates",
        &["pair", "correlation"],
        rows.collect(),
    )
}

/// The standard schemes beside this schedule.
pub(super) fn baselines(subject: &Subject, baselines: &[BaselineRecord]) -> HtmlTable {
    let d = &subject.document;
    let with_criterion = d.score.criterion_name != "a";
    let this = BaselineRecord {
        name: "this schedule".to_owned(),
        positions: d.schedule.positions.len(),
        rms_sigma_deg_per_h: d.rms_sigma_deg_per_h,
        ratio: Some(1.0),
        criterion: d.score.criterion,
        criterion_ratio: Some(1.0),
        best_order: None,
    };
    let with_orders = baselines.iter().any(|b| b.best_order.is_some());
    let rows = std::iter::once(&this).chain(baselines).map(|b| {
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
            row.push(best.map_or_else(|| NONE.to_owned(), |best| ratio(best.criterion_ratio)));
        }
        row
    });
    let criterion = format!("criterion {}", d.score.criterion_name);
    let mut columns = vec!["scheme", "positions", "RMS σ, °/h", "ratio"];
    if with_criterion {
        columns.extend([criterion.as_str(), "its ratio"]);
    }
    if with_orders {
        columns.push("ratio in best order");
    }
    HtmlTable::new(
        "Standard schemes in the same time",
        &columns,
        rows.collect(),
    )
}

/// The points of the front.
pub(super) fn front(front: &[ParetoRecord], score: &ScoreRecord) -> HtmlTable {
    let rows = front.iter().map(|p| {
        vec![
            seconds(p.total_time_s),
            number(p.criterion),
            optional(p.lower_bound, number),
            number(p.rms_sigma_deg_per_h),
            p.schedule.positions.len().to_string(),
        ]
    });
    let criterion = words::criterion_heading(score);
    HtmlTable::new(
        "The front: every point is a schedule that the stand can run",
        &[
            "total time, s",
            &criterion,
            "none below",
            "RMS σ, °/h",
            "positions",
        ],
        rows.collect(),
    )
}

/// Errors of the simulated runs.
pub(super) fn simulated(d: &SimulationDocument) -> HtmlTable {
    let claims = d.rms_claimed_sigma_deg_per_h.is_some();
    let row = |name: String, [error, sigma, planned]: [f64; 3], claimed, ratio| {
        let mut row = vec![name, number(error), number(sigma)];
        if claims {
            row.push(optional(claimed, number));
        }
        row.extend([number(planned), optional(ratio, |r| format!("{r:.3}"))]);
        row
    };
    let coefficients = d.coefficients.iter().map(|c| {
        let numbers = [
            c.rms_error_deg_per_h,
            c.sigma_deg_per_h,
            c.planned_sigma_deg_per_h,
        ];
        let name = format!("{}, °/h", c.name.name());
        row(name, numbers, c.claimed_sigma_deg_per_h, c.ratio)
    });
    let misalignment = d.misalignment.iter().map(|m| {
        let numbers = [m.rms_error_arcsec, m.sigma_arcsec, m.planned_sigma_arcsec];
        let name = format!("{}, arcsec", m.name);
        row(name, numbers, m.claimed_sigma_arcsec, m.ratio)
    });
    HtmlTable::new(
        "Errors at the end of the simulated runs",
        &sigma_columns("state", claims),
        coefficients.chain(misalignment).collect(),
    )
}

/// Errors of the parameters beyond the coefficients.
pub(super) fn simulated_parameters(others: &[SimulatedParameter]) -> HtmlTable {
    let claims = others.iter().any(|p| p.claimed_sigma.is_some());
    let rows = others.iter().map(|p| {
        let name = match p.role {
            RoleRecord::Estimated => format!("{}, {}", p.name, p.unit),
            RoleRecord::Considered => format!("{}, {} (not known to the filter)", p.name, p.unit),
        };
        let mut row = vec![name, number(p.rms_error), number(p.sigma)];
        if claims {
            row.push(optional(p.claimed_sigma, number));
        }
        row.extend([
            number(p.planned_sigma),
            optional(p.ratio, |r| format!("{r:.3}")),
        ]);
        row
    });
    HtmlTable::new(
        "Errors of the other parameters at the end of the simulated runs",
        &sigma_columns("parameter", claims),
        rows.collect(),
    )
}

fn sigma_columns(of: &str, claims: bool) -> Vec<&str> {
    match claims {
        false => vec![
            of,
            "RMS error",
            "σ of the filter",
            "σ as planned",
            "RMS of error/σ",
        ],
        true => vec![
            of,
            "RMS error",
            "true σ",
            "σ as claimed",
            "true σ as planned",
            "RMS of error/σ",
        ],
    }
}

/// Errors of the simulated runs against the specification.
pub(super) fn specification(check: &SpecificationCheck) -> HtmlTable {
    let coefficients = check.coefficients.iter().map(|c| {
        vec![
            c.name.name().to_owned(),
            "°/h".to_owned(),
            number(c.spec_deg_per_h),
            optional(c.rms_error_deg_per_h, number),
            optional(c.interval_deg_per_h, |[low, _]| number(low)),
            optional(c.interval_deg_per_h, |[_, high]| number(high)),
            c.decision.to_string(),
        ]
    });
    let parameters = check.parameters.iter().map(|p| {
        vec![
            p.name.clone(),
            p.unit.clone(),
            number(p.spec),
            optional(p.rms_error, number),
            optional(p.interval, |[low, _]| number(low)),
            optional(p.interval, |[_, high]| number(high)),
            p.decision.to_string(),
        ]
    });
    HtmlTable::new(
        "Errors of the simulated runs against the specification",
        &[
            "name",
            "unit",
            "specification",
            "RMS error",
            "1σ from",
            "to",
            "the specification is",
        ],
        coefficients.chain(parameters).collect(),
    )
}

/// Averages of the normalised squares, with their bounds.
pub(super) fn consistency(d: &SimulationDocument) -> HtmlTable {
    let row = |name: String, c: &Option<Consistency>| match c {
        None => vec![name, NONE.into(), NONE.into(), NONE.into(), NONE.into()],
        Some(c) => std::iter::once(name).chain(words::consistency(c)).collect(),
    };
    let mut rows: Vec<_> = words::averages(d)
        .into_iter()
        .map(|(name, c)| row(name.to_owned(), c))
        .collect();
    let last = d.positions.len().saturating_sub(1);
    for (i, p) in d.positions.iter().take(last).enumerate() {
        let name = format!(
            "NEES when position {} is left, {} s",
            i + 1,
            seconds(p.end_s)
        );
        rows.push(row(name, &p.nees));
    }
    HtmlTable::new(
        "Consistency of the filter",
        &["average of", "expected", "found", "95 % bounds", "it is"],
        rows,
    )
}

/// Consistency against the size of the prior.
pub(super) fn sweep(d: &SimulationDocument) -> HtmlTable {
    let rows = d.sweep.iter().map(|s| {
        vec![
            number(s.misalignment_deg),
            number(s.drift_factor),
            optional(s.nees, |n| number(n.average)),
            optional(s.rms_error_deg_per_h, number),
            s.diverged_runs.to_string(),
            number(s.rms_largest_misalignment_deg),
        ]
    });
    HtmlTable::new(
        "Prior against linearisation",
        &[
            "misalignment, °",
            "drift, times",
            "NEES",
            "RMS error, °/h",
            "runs diverged",
            "farthest off, °",
        ],
        rows.collect(),
    )
}

/// Schedules side by side.
pub(super) fn compared(d: &ComparisonDocument) -> HtmlTable {
    let has_spec = d.schedules.iter().any(|s| s.time_to_spec_s.is_some());
    let with_criterion = d.criterion_name != "a";
    let rows = d.schedules.iter().map(|s| {
        let mut row = vec![
            name(&s.name, s.order),
            s.positions.to_string(),
            seconds(s.total_time_s),
            seconds(s.overhead_s),
            number(s.rms_sigma_deg_per_h),
            ratio(s.ratio),
            format!("{:.4}", s.least_separability),
        ];
        if with_criterion {
            row.extend([number(s.criterion), ratio(s.criterion_ratio)]);
        }
        if has_spec {
            row.push(
                s.time_to_spec_s
                    .map_or_else(|| "missed".to_owned(), seconds),
            );
        }
        row
    });
    let criterion = format!("criterion {}", d.criterion_name);
    let mut columns = vec![
        "schedule",
        "positions",
        "time, s",
        "moving, s",
        "RMS σ, °/h",
        "ratio",
        "least separability",
    ];
    if with_criterion {
        columns.extend([criterion.as_str(), "its ratio"]);
    }
    if has_spec {
        columns.push("in specification, s");
    }
    HtmlTable::new(
        "Schedules side by side, ratios to the first",
        &columns,
        rows.collect(),
    )
}

/// σ of every coefficient by every schedule.
pub(super) fn compared_coefficients(d: &ComparisonDocument) -> HtmlTable {
    let mut columns = vec!["schedule"];
    if let Some(first) = d.schedules.first() {
        columns.extend(first.coefficients.iter().map(|c| c.name.name()));
    }
    let rows = d.schedules.iter().map(|s| {
        let mut row = vec![name(&s.name, s.order)];
        row.extend(
            s.coefficients
                .iter()
                .map(|c| number(1e3 * c.sigma_deg_per_h)),
        );
        row
    });
    HtmlTable::new(
        "Coefficients after the test, 1σ, 10⁻³ °/h (D_I, D_O, D_S per g)",
        &columns,
        rows.collect(),
    )
}

/// Name of a compared schedule, with the order of its positions where it is not its own.
pub(super) fn name(name: &str, order: PositionOrder) -> String {
    match order {
        PositionOrder::Best => format!("{name}, best order (proven)"),
        PositionOrder::BestFound => format!("{name}, best order found"),
        PositionOrder::AsGiven => name.to_owned(),
    }
}
