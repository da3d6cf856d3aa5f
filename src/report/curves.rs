//! Pictures of one simulated run: every state with its estimate, and every error with its band.

use crate::drift::{COEFFICIENTS, DriftCoefficient};
use crate::simulate::{Sample, Trajectory};
use crate::units::Angle;

use super::figure::{Band, Color, Curve, Figure, Panel, Style};

/// Most samples of a curve.
const SAMPLES: usize = 400;
/// Columns of panels.
const COLUMNS: usize = 3;
const TIME: &str = "time, s";
const BAND: &str = "estimate ± 3σ";
const ERROR_BAND: &str = "± 3σ of the filter";
/// The same where the filter ignores parameters.
const TRUE_ERROR_BAND: &str = "± 3σ, what the filter ignores included";

/// One state of a run at one moment.
#[derive(Debug, Clone, Copy)]
struct Point {
    time_s: f64,
    truth: f64,
    estimate: f64,
    /// Estimate less truth.
    error: f64,
    sigma: f64,
}

/// One state through a run.
struct StateCurve {
    name: String,
    /// Unit of its value, and of its error; how many of the latter are one of the former.
    units: [&'static str; 2],
    error_scale: f64,
    points: Vec<Point>,
}

/// Truth, estimate and ±3σ of all states against time.
pub fn states(trajectory: &Trajectory) -> Figure {
    let figure = Figure::new(COLUMNS).with_title("One run: truth and estimates");
    all_states(trajectory)
        .iter()
        .fold(figure, |figure, s| figure.with_panel(state_panel(s)))
}

/// Estimate minus truth within ±3σ, of all states against time. The scale is that of the
/// second half of the test; what is larger before is cut off.
pub fn errors(trajectory: &Trajectory) -> Figure {
    let figure = Figure::new(COLUMNS).with_title("One run: errors of the estimates");
    let band = match trajectory.ignores {
        true => TRUE_ERROR_BAND,
        false => ERROR_BAND,
    };
    all_states(trajectory)
        .iter()
        .fold(figure, |figure, s| figure.with_panel(error_panel(s, band)))
}

fn all_states(trajectory: &Trajectory) -> Vec<StateCurve> {
    let samples = &trajectory.samples;
    let every = samples.len().div_ceil(SAMPLES).max(1);
    let last = samples.len().saturating_sub(1);
    let kept: Vec<&Sample> = samples
        .iter()
        .enumerate()
        .filter(|(i, _)| i % every == 0 || *i == last)
        .map(|(_, s)| s)
        .collect();
    let angles = ["ψ North", "ψ Up", "ψ East"].into_iter().enumerate();
    let angles = angles.map(|(i, name)| {
        let deg = |arcsec: f64| Angle::from_arcsec(arcsec).deg();
        StateCurve {
            name: name.to_owned(),
            units: ["°", "arcsec"],
            error_scale: 3600.0,
            points: points(&kept, |s| {
                [
                    deg(s.misalignment_n_arcsec[i]),
                    deg(s.misalignment_n_estimate_arcsec[i]),
                    -deg(s.misalignment_n_error_arcsec[i]),
                    deg(s.misalignment_n_sigma_arcsec()[i]),
                ]
            }),
        }
    });
    let drifts = (0..COEFFICIENTS).map(|i| StateCurve {
        name: DriftCoefficient::ALL[i].name().to_owned(),
        units: ["°/h", "°/h"],
        error_scale: 1.0,
        points: points(&kept, |s| {
            [
                s.drift_deg_per_h[i],
                s.drift_estimate_deg_per_h[i],
                s.drift_estimate_deg_per_h[i] - s.drift_deg_per_h[i],
                s.drift_sigma_deg_per_h[i],
            ]
        }),
    });
    let others = trajectory.others.iter().enumerate();
    let others = others.map(|(i, (parameter, truth))| StateCurve {
        name: parameter.name.to_owned(),
        units: [parameter.unit.name(); 2],
        error_scale: 1.0,
        points: points(&kept, |s| {
            let [estimate, sigma] = s.others[i];
            [*truth, estimate, estimate - truth, sigma]
        }),
    });
    angles.chain(drifts).chain(others).collect()
}

fn points(samples: &[&Sample], values: impl Fn(&Sample) -> [f64; 4]) -> Vec<Point> {
    let point = |s: &&Sample| {
        let [truth, estimate, error, sigma] = values(s);
        Point {
            time_s: s.time_s,
            truth,
            estimate,
            error,
            sigma,
        }
    };
    samples.iter().map(point).collect()
}

fn state_panel(state: &StateCurve) -> Panel {
    let line = |value: &dyn Fn(&Point) -> f64| -> Vec<[f64; 2]> {
        state.points.iter().map(|p| [p.time_s, value(p)]).collect()
    };
    let band = |p: &Point| {
        [
            p.time_s,
            p.estimate - 3.0 * p.sigma,
            p.estimate + 3.0 * p.sigma,
        ]
    };
    let [low, high] = state_range(&state.points);
    Panel::new(
        &state.name,
        TIME,
        format!("{}, {}", state.name, state.units[0]),
    )
    .with_band(Band::new(
        BAND,
        Color::SkyBlue,
        state.points.iter().map(band).collect(),
    ))
    .with_curve(Curve::new("truth", Style::TRUTH, line(&|p| p.truth)))
    .with_curve(Curve::new(
        "estimate",
        Style::ESTIMATE,
        line(&|p| p.estimate),
    ))
    .with_x_range(0.0, end_s(state))
    .with_y_range(low, high)
}

/// When the run ended, s.
fn end_s(state: &StateCurve) -> f64 {
    state.points.last().map_or(0.0, |p| p.time_s)
}

/// All of the truth, and the estimate after the first twentieth of the test, in which it may be
/// anything.
fn state_range(points: &[Point]) -> [f64; 2] {
    let start = points.len() / 20;
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let truths = points.iter().map(|p| p.truth);
    let estimates = points.iter().skip(start).map(|p| p.estimate);
    for v in truths.chain(estimates).filter(|v| v.is_finite()) {
        (low, high) = (low.min(v), high.max(v));
    }
    let space = (0.08 * (high - low)).max(1e-3 * high.abs().max(low.abs()));
    [low - space, high + space]
}

fn error_panel(state: &StateCurve, name_of_band: &str) -> Panel {
    let scale = state.error_scale;
    let error = |p: &Point| scale * p.error;
    let limit = |p: &Point| 3.0 * scale * p.sigma;
    let late = state.points.iter().skip(state.points.len() / 2);
    let range = late
        .map(|p| error(p).abs().max(limit(p)))
        .filter(|v| v.is_finite())
        .fold(0.0, f64::max);
    let band = |p: &Point| [p.time_s, -limit(p), limit(p)];
    let line = state.points.iter().map(|p| [p.time_s, error(p)]).collect();
    let y_label = format!("error, {}", state.units[1]);
    let panel = Panel::new(&state.name, TIME, y_label)
        .with_band(Band::new(
            name_of_band,
            Color::SkyBlue,
            state.points.iter().map(band).collect(),
        ))
        .with_curve(Curve::new("estimate − truth", Style::ERROR, line))
        .with_x_range(0.0, end_s(state));
    match range > 0.0 {
        true => panel.with_y_range(-1.1 * range, 1.1 * range),
        false => panel,
    }
}
