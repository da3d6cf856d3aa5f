//! The pictures of a page, as SVG.

use crate::attitude::{Attitude, wrap_half_turn};
use crate::drift::DriftCoefficient;
use crate::motion::{Leg, Move};
use crate::report::figure::{
    Band, Color, Curve, Dash, Figure, Mark, Panel, Scale, Shape, Span, Style,
};
use crate::report::words;
use crate::results::{ParetoRecord, RoleRecord, ScoreRecord, SimulationDocument};
use crate::units::Angle;
use crate::wording::{number, seconds};

use super::subject::Subject;

/// Styles of the first, second and third of something: told apart by pattern, not only colour.
const THREE: [Style; 3] = [
    Style {
        color: Color::Blue,
        dash: Dash::Solid,
        width: 1.6,
    },
    Style {
        color: Color::Vermillion,
        dash: Dash::Dashed,
        width: 1.6,
    },
    Style {
        color: Color::Green,
        dash: Dash::DashDotted,
        width: 1.6,
    },
];
/// A requirement or a bound.
const LIMIT: Style = Style {
    color: Color::Black,
    dash: Dash::Dotted,
    width: 1.4,
};
/// Points of a curve through one move.
const STEPS: usize = 24;
const TIME: &str = "time, s";

/// The gimbal angles against time: dwells flat, moves sloping and shaded.
pub(super) fn gimbals(subject: &Subject) -> String {
    let legs = subject.timeline.legs();
    let held = subject.timeline.positions();
    let mut panel =
        Panel::new("", TIME, "angle, °").with_x_range(0.0, subject.timeline.total_time_s());
    let times = subject.leg_times_s();
    let mut curves: [Vec<[f64; 2]>; 3] = Default::default();
    for (i, leg) in legs.iter().enumerate() {
        let start = times[i];
        let arrived = start + leg.arrival.map_or(0.0, |m| m.duration_s);
        let settled = arrived + leg.settle_s;
        let number = held.contains(&i).then(|| i - held.start + 1);
        panel = with_spans(panel, leg, [start, settled, times[i + 1]], number);
        for (axis, curve) in curves.iter_mut().enumerate() {
            let unlimited = subject.study.test().platform().gimbals().ranges[axis].is_none();
            let shown = |rad: f64| match unlimited {
                true => Angle::from_rad(wrap_half_turn(rad)).deg(),
                false => Angle::from_rad(rad).deg(),
            };
            if let Some(m) = &leg.arrival {
                move_curve(curve, m, axis, start, shown);
            }
            let here = shown(leg.position.to_array()[axis]);
            push(curve, [arrived, here]);
            push(curve, [times[i + 1], here]);
        }
    }
    for ((curve, style), name) in curves.into_iter().zip(THREE).zip(["α", "β", "γ"]) {
        panel = panel.with_curve(Curve::new(name, style, curve));
    }
    Figure::new(1)
        .with_panel_size(900.0, 320.0)
        .with_id("gimbals")
        .with_label(format!(
            "Gimbal angles alpha, beta and gamma against time: {} positions in {} s, moves shaded; \
             the table of positions has the numbers",
            held.len(),
            seconds(subject.timeline.total_time_s())
        ))
        .with_panel(panel)
        .to_svg()
}

/// Moving and settling shaded, the dwell with the position's number.
fn with_spans(
    panel: Panel,
    leg: &Leg,
    [start, settled, end]: [f64; 3],
    number: Option<usize>,
) -> Panel {
    let name = number.map_or_else(|| "the start".to_owned(), |n| format!("position {n}"));
    let times = |from: f64, to: f64| format!("{} s to {} s", seconds(from), seconds(to));
    let mut panel = panel;
    if settled > start {
        let measured = leg.arrival.is_some_and(|m| m.measured);
        let title = format!(
            "Move to {name}, {}{}",
            times(start, settled),
            if measured { ", measured" } else { "" }
        );
        panel = panel.with_span(Span::new([start, settled], Some(Color::Grey), title));
    }
    if end > settled {
        let [alpha, beta, gamma] = leg.position.to_deg();
        let title = format!(
            "Dwell at {name} ({alpha:.3}°, {beta:.3}°, {gamma:.3}°), {}",
            times(settled, end)
        );
        let text = number.map_or_else(String::new, |n| n.to_string());
        panel = panel.with_span(Span::new([settled, end], None, title).with_text(text));
    }
    panel
}

/// One gimbal through a move.
fn move_curve(
    curve: &mut Vec<[f64; 2]>,
    m: &Move,
    axis: usize,
    start_s: f64,
    shown: impl Fn(f64) -> f64,
) {
    for k in 0..=STEPS {
        let fraction = k as f64 / STEPS as f64;
        let angle = shown(m.angles_at(fraction)[axis]);
        push(curve, [start_s + fraction * m.duration_s, angle]);
    }
}

/// Adds a point; where the angle passes a half turn the curve is interrupted.
fn push(curve: &mut Vec<[f64; 2]>, point: [f64; 2]) {
    if let Some(last) = curve.last()
        && (last[1] - point[1]).abs() > 180.0
        && last[0] < point[0]
    {
        curve.push([point[0], f64::NAN]);
    }
    curve.push(point);
}

/// The standard deviation of the three coefficients of each kind against time.
pub(super) fn accuracy(subject: &Subject) -> Vec<(String, String)> {
    let kinds = [
        ("constant drift D_F", "D_F", ""),
        ("drift along the input axis D_I", "D_I", "/g"),
        ("drift along the output axis D_O", "D_O", "/g"),
        ("drift along the spin axis D_S", "D_S", "/g"),
    ];
    let figure = |(k, (name, short, per_g)): (usize, (&str, &str, &str))| {
        let three = &DriftCoefficient::ALL[3 * k..3 * k + 3];
        let label =
            format!("1-sigma of the {name} of the X, Y and Z gyro against time, deg/h{per_g}");
        let panel = accuracy_panel(subject, three, &format!("σ, °/h{per_g}"));
        let svg = Figure::new(1)
            .with_panel_size(420.0, 290.0)
            .with_id(format!("sigma{short}"))
            .with_label(label)
            .with_panel(panel)
            .to_svg();
        (format!("{}{}", name[..1].to_uppercase(), &name[1..]), svg)
    };
    kinds.into_iter().enumerate().map(figure).collect()
}

fn accuracy_panel(subject: &Subject, three: &[DriftCoefficient], y_label: &str) -> Panel {
    let d = &subject.document;
    let times = &d.convergence.times_s;
    let end = subject.timeline.total_time_s();
    let mut panel = Panel::new("", TIME, y_label)
        .with_x_range(0.0, end)
        .with_y_scale(Scale::Log);
    for p in &d.convergence.positions {
        let title = format!(
            "Position {}: RMS σ of all coefficients {} °/h when it was left at {} s",
            p.position,
            number(p.rms_sigma_deg_per_h),
            seconds(p.end_s)
        );
        panel = panel.with_span(Span::new([p.start_s, p.end_s], None, title));
    }
    let specs: Vec<Option<f64>> = three
        .iter()
        .map(|c| d.coefficients[c.index()].spec_deg_per_h)
        .collect();
    let common = specs.iter().all(|s| *s == specs[0]);
    for ((c, style), spec) in three.iter().zip(THREE).zip(&specs) {
        let sigma = &d.convergence.sigma_deg_per_h[c];
        let points = times.iter().zip(sigma).map(|(t, s)| [*t, *s]).collect();
        panel = panel.with_curve(Curve::new(c.name(), style, points));
        let Some(spec) = spec else { continue };
        let line = vec![[0.0, *spec], [end, *spec]];
        let (label, color) = match common {
            true => ("specification".to_owned(), Color::Black),
            false => (format!("specification {}", c.name()), style.color),
        };
        panel = panel.with_curve(Curve::new(label, Style { color, ..LIMIT }, line));
        if let Some(t) = d.coefficients[c.index()].time_to_spec_s {
            let title = format!(
                "{} is within its specification from {} s on",
                c.name(),
                seconds(t)
            );
            panel = panel.with_mark(Mark::new([t, *spec], Shape::Dot, style.color, title));
        }
    }
    panel
}

/// The front of total time against criterion, with what no schedule can beat.
pub(super) fn front(front: &[ParetoRecord], score: &ScoreRecord) -> String {
    let label = words::criterion_heading(score);
    let points: Vec<[f64; 2]> = front
        .iter()
        .map(|p| [p.total_time_s, p.criterion])
        .collect();
    let bounds = front
        .iter()
        .filter_map(|p| Some([p.total_time_s, p.lower_bound?]))
        .collect();
    let mut panel = Panel::new("", "total time, s", &label)
        .with_y_scale(Scale::Log)
        .with_curve(Curve::new("schedules found", THREE[0], points))
        .with_curve(Curve::new("no schedule is below", LIMIT, bounds));
    for p in front {
        let title = format!(
            "{} s: {}{}, {} positions",
            seconds(p.total_time_s),
            number(p.criterion),
            words::unit(&score.criterion_unit),
            p.schedule.positions.len()
        );
        let at = [p.total_time_s, p.criterion];
        panel = panel.with_mark(Mark::new(at, Shape::Dot, Color::Blue, title));
    }
    Figure::new(1)
        .with_panel_size(640.0, 340.0)
        .with_id("front")
        .with_label("Total time of the test against the criterion; the table has the numbers")
        .with_panel(panel)
        .to_svg()
}

/// RMS of error over sigma of each parameter that the filter estimates, with the bounds of a consistent
/// filter: the coefficients, and in panels below them the others.
pub(super) fn consistency(document: &SimulationDocument) -> String {
    /// So many names fit side by side; most come in threes.
    const ABREAST: usize = 12;
    let twelve: Vec<_> = document
        .coefficients
        .iter()
        .map(|c| (c.name.name(), c.ratio))
        .collect();
    let others: Vec<_> = words::other_parameters(document)
        .iter()
        .filter(|p| p.role == RoleRecord::Estimated)
        .map(|p| (p.name.as_str(), p.ratio))
        .collect();
    // Panels of about the same length.
    let rows = others.len().div_ceil(ABREAST).max(1);
    let in_a_row = others.len().div_ceil(rows).next_multiple_of(3).max(3);
    let others = others.chunks(in_a_row);
    let ratios = std::iter::once(&twelve[..]).chain(others);
    let mut figure = Figure::new(1)
        .with_panel_size(640.0, 300.0)
        .with_id("ratio")
        .with_label("RMS of error over sigma of every parameter; the tables have the numbers");
    for (row, of_row) in ratios.enumerate() {
        let what = match row {
            0 => "coefficient",
            _ => "parameter",
        };
        figure = figure.with_panel(ratio_panel(what, of_row, document.ratio_bounds));
    }
    figure.to_svg()
}

/// Ratios by name.
fn ratio_panel(what: &str, ratios: &[(&str, Option<f64>)], [low, high]: [f64; 2]) -> Panel {
    let count = ratios.len() as f64;
    let names = ratios.iter().map(|(name, _)| (*name).to_owned()).collect();
    let top = ratios
        .iter()
        .filter_map(|(_, ratio)| *ratio)
        .fold(high.max(1.2), f64::max);
    let mut panel = Panel::new("", what, "RMS of error/σ")
        .with_x_names(names)
        .with_x_range(0.0, count + 1.0)
        .with_y_range(0.0, 1.1 * top)
        .with_band(Band::new(
            "95 of 100, if the filter is right",
            Color::SkyBlue,
            vec![[0.0, low, high], [count + 1.0, low, high]],
        ))
        .with_curve(Curve::new(
            "exactly right",
            LIMIT,
            vec![[0.0, 1.0], [count + 1.0, 1.0]],
        ));
    for (i, (name, ratio)) in ratios.iter().enumerate() {
        let Some(ratio) = *ratio else { continue };
        let inside = (low..=high).contains(&ratio);
        let (shape, color) = match inside {
            true => (Shape::Dot, Color::Blue),
            false => (Shape::Cross, Color::Vermillion),
        };
        let title = format!("{name}: {ratio:.3}");
        panel = panel.with_mark(Mark::new([i as f64 + 1.0, ratio], shape, color, title));
    }
    panel
}

/// Where gravity points in the platform while a position is held, in units of g.
pub(super) fn gravity(attitude: &Attitude) -> [f64; 3] {
    let g = attitude.gravity_c();
    [g.x, g.y, g.z]
}
