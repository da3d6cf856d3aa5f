//! The seed paper's §3: its simulation, its figures, and what lies behind them.
//!
//! Two positions, p1 = (0°, 0°, 0°) and p2 = (180°, 0°, 0°), 1000 s each, 10 s steps; initial
//! misalignment 0.1 on every axis, D_F = 11, 12, 13 °/h, all first-order coefficients 5 °/h/g,
//! random drift 0.01 °/h, accelerometers 1e-5 g, the filter starting at zero. The paper does not
//! print the unit of the 0.1, nor the latitude: degrees, arc minutes and radians are run, at
//! 28.2°.
//!
//! Shown, in both repositioning modes:
//!
//! 1. the paper's own model, (8) and (9), as truth: Figures 2–10 and its numbers. In `frame-hold`
//!    mode D_FZ comes out wrong by about ω_N ψ_y(0) and D_SZ clean; with ψ^n continuous, as (2)
//!    integrated through the slew has it, the two are exchanged;
//! 2. the nonlinear platform under the paper's filter: with drifts of this size left to run, the
//!    platform turns by degrees, and the filter is wrong by °/h;
//! 3. the nonlinear platform with a hundredth of the drifts, as after a factory calibration: the
//!    paper's conclusions hold.
//!
//! Writes the figures into the directory given as argument (default: target/paper).

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use scheme_opt::internals::attitude::NORTH;
use scheme_opt::internals::drift::CoefficientVector;
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::Platform;
use scheme_opt::internals::report::figure::{Band, Color, Curve, Dash, Figure, Panel, Style};
use scheme_opt::internals::simulate::{InitialTruth, Sample, Simulation, Trajectory};
use scheme_opt::internals::units::{ARCSEC_PER_RAD, Angle};
use scheme_opt::settings::{AxisValue, GSensitivePrior, PlatformConfig, Repositioning};
use scheme_opt::{
    DriftCoefficient as D, Error, FilterModel, Position, Result, Schedule, ScheduledPosition,
    SimulationOptions, TruthModel,
};

/// The coefficients that the two positions excite and the paper plots, with their figures.
const PLOTTED: [(D, u8); 6] = [
    (D::FX, 5),
    (D::FY, 6),
    (D::FZ, 7),
    (D::SX, 8),
    (D::IY, 9),
    (D::SZ, 10),
];

/// A reading of "initial misalignment 0.1".
struct Reading {
    name: &'static str,
    arcsec: f64,
}

const READINGS: [Reading; 3] = [
    Reading {
        name: "degrees",
        arcsec: 360.0,
    },
    Reading {
        name: "arc minutes",
        arcsec: 6.0,
    },
    Reading {
        name: "radians",
        arcsec: 0.1 * ARCSEC_PER_RAD,
    },
];

fn main() -> Result<()> {
    let directory = std::env::args_os()
        .nth(1)
        .map_or_else(|| PathBuf::from("target/paper"), PathBuf::from);
    std::fs::create_dir_all(&directory)
        .map_err(|e| Error::io("create the directory", &directory, e))?;
    for reading in &READINGS {
        for mode in [Repositioning::FrameHold, Repositioning::Slew] {
            let platform = platform(mode, 1.0)?;
            println!(
                "\nMisalignment 0.1 {}, {mode:?}: omega_N psi_y(0) = {:.5} deg/h",
                reading.name,
                omega_north(mode)? * reading.arcsec
            );
            let paper = SimulationOptions::default()
                .with_truth(TruthModel::FirstOrder)
                .with_filter(FilterModel::Linear);
            let run = simulate(&platform, reading, 1.0, paper)?;
            report("the paper's model", &run);
            if reading.arcsec == READINGS[0].arcsec {
                write_figure(&directory, mode, &run)?;
            }
            let nonlinear = SimulationOptions::default().with_filter(FilterModel::Linear);
            let run = simulate(&platform, reading, 1.0, nonlinear)?;
            report("nonlinear platform, the paper's filter", &run);
            let calibrated = self::platform(mode, 0.01)?;
            let run = simulate(&calibrated, reading, 0.01, SimulationOptions::default())?;
            report("nonlinear platform, a hundredth of the drift", &run);
        }
    }
    println!("\nfigures written to {}", directory.display());
    Ok(())
}

/// The paper's platform, with the prior of the drift times `drift`.
fn platform(mode: Repositioning, drift: f64) -> Result<Platform> {
    let mut config = PlatformConfig::default();
    config.motion.repositioning = mode;
    config.prior.constant_drift_deg_per_h = AxisValue::All(15.0 * drift);
    config.prior.g_sensitive_drift_deg_per_h_per_g =
        GSensitivePrior::All(AxisValue::All(8.0 * drift));
    config.check()
}

/// The paper's test with its drift coefficients times `drift`.
fn simulate(
    platform: &Platform,
    reading: &Reading,
    drift: f64,
    options: SimulationOptions,
) -> Result<Trajectory> {
    let schedule = Schedule::new(vec![
        ScheduledPosition::new(Position::from_deg(0.0, 0.0, 0.0), 1000.0),
        ScheduledPosition::new(Position::from_deg(180.0, 0.0, 0.0), 1000.0),
    ])?;
    let timeline = Timeline::new(&platform.clone().into(), &schedule)?;
    let mut coefficients = CoefficientVector::repeat(5.0);
    for (constant, value) in [(D::FX, 11.0), (D::FY, 12.0), (D::FZ, 13.0)] {
        coefficients[constant.index()] = value;
    }
    // At p1 the platform's axes are those of n.
    let initial = InitialTruth {
        misalignment_n_arcsec: Vector3::repeat(reading.arcsec),
        drift_deg_per_h: coefficients * drift,
        others: Vec::new(),
    };
    Ok(Simulation::new(platform, &timeline, options)?.trajectory(&initial, 1, 0))
}

/// Errors at the end beside the filter's σ.
fn report(what: &str, run: &Trajectory) {
    let Some(end) = run.samples.last() else {
        return;
    };
    let turned = run
        .samples
        .iter()
        .map(|s| Angle::from_arcsec(s.misalignment_n_arcsec.norm()).deg())
        .fold(0.0, f64::max);
    println!("  {what} (it turns by {turned:.2} deg):");
    for (c, _) in PLOTTED {
        let i = c.index();
        println!(
            "    {:<5} error {:>9.5}   sigma {:>8.5} deg/h",
            c.name(),
            end.drift_estimate_deg_per_h[i] - run.drift_deg_per_h[i],
            end.drift_sigma_deg_per_h[i],
        );
    }
}

/// Component `i` of ψ in the platform frame c, which the paper plots: the truth, the estimate and
/// the filter's σ, arcsec.
fn in_platform(s: &Sample, i: usize) -> [f64; 3] {
    let c_to_n = s.attitude.matrix();
    let covariance = c_to_n.transpose() * s.misalignment_n_covariance_arcsec2 * c_to_n;
    [
        c_to_n.tr_mul(&s.misalignment_n_arcsec)[i],
        c_to_n.tr_mul(&s.misalignment_n_estimate_arcsec)[i],
        covariance[(i, i)].sqrt(),
    ]
}

/// Figures 2–10 as one picture.
fn write_figure(directory: &Path, mode: Repositioning, run: &Trajectory) -> Result<()> {
    let (name, words) = match mode {
        Repositioning::FrameHold => ("frame-hold", "ψ kept in the platform frame (frame-hold)"),
        Repositioning::Slew => ("slew", "ψ continuous in the local frame (slew)"),
    };
    let mut figure = Figure::new(3).with_title(format!("Figures 2–10 with {words}"));
    for (i, axis) in ["x", "y", "z"].into_iter().enumerate() {
        let deg = |arcsec: f64| Angle::from_arcsec(arcsec).deg();
        let title = format!("Fig. {}: ψ{axis}", i + 2);
        figure = figure.with_panel(panel(title, format!("ψ{axis}, °"), run, |s| {
            in_platform(s, i).map(deg)
        }));
    }
    for (c, number) in PLOTTED {
        let i = c.index();
        let title = format!("Fig. {number}: {}", c.name());
        figure = figure.with_panel(panel(title, format!("{}, °/h", c.name()), run, |s| {
            [
                run.drift_deg_per_h[i],
                s.drift_estimate_deg_per_h[i],
                s.drift_sigma_deg_per_h[i],
            ]
        }));
    }
    let offset = omega_north(mode)? * READINGS[0].arcsec;
    for c in [D::FZ, D::SZ] {
        figure = figure.with_panel(error_panel(c, offset, run));
    }
    let path = directory.join(format!("paper-figures-2-10-{name}.svg"));
    std::fs::write(&path, figure.to_svg()).map_err(|e| Error::io("write the figure", &path, e))
}

/// ω_N, rad/s: also what ψ_y(0) in arcsec becomes in °/h.
fn omega_north(mode: Repositioning) -> Result<f64> {
    Ok(platform(mode, 1.0)?.earth_rate_n()[NORTH])
}

/// The error of a coefficient in the second position, beside ±ω_N ψ_y(0).
fn error_panel(c: D, offset: f64, run: &Trajectory) -> Panel {
    let i = c.index();
    let late = || run.samples.iter().filter(|s| s.time_s >= 1000.0);
    let error = |s: &Sample| s.drift_estimate_deg_per_h[i] - run.drift_deg_per_h[i];
    let line = |value: &dyn Fn(&Sample) -> f64| late().map(|s| [s.time_s, value(s)]).collect();
    let band = |s: &Sample| {
        let limit = 3.0 * s.drift_sigma_deg_per_h[i];
        [s.time_s, error(s) - limit, error(s) + limit]
    };
    let mark = Style {
        color: Color::Blue,
        dash: Dash::DashDotted,
        width: 1.2,
    };
    Panel::new(
        format!("Error of {}", c.name()),
        "time, s",
        format!("estimate − {}, °/h", c.name()),
    )
    .with_band(Band::new(
        "estimate ± 3σ",
        Color::SkyBlue,
        late().map(band).collect(),
    ))
    .with_curve(Curve::new("truth", Style::TRUTH, line(&|_| 0.0)))
    .with_curve(Curve::new("estimate", Style::ESTIMATE, line(&error)))
    .with_curve(Curve::new("±ω_N ψy(0)", mark, line(&|_| offset)))
    .with_curve(Curve::new("±ω_N ψy(0)", mark, line(&|_| -offset)))
    .with_x_range(1000.0, 2000.0)
    .with_y_range(-0.08, 0.08)
}

/// Truth, estimate and ±3σ of one state.
fn panel(
    title: String,
    y_label: String,
    run: &Trajectory,
    values: impl Fn(&Sample) -> [f64; 3],
) -> Panel {
    let (mut truth, mut estimate, mut band) = (Vec::new(), Vec::new(), Vec::new());
    for s in &run.samples {
        let [t, e, sigma] = values(s);
        truth.push([s.time_s, t]);
        estimate.push([s.time_s, e]);
        band.push([s.time_s, e - 3.0 * sigma, e + 3.0 * sigma]);
    }
    Panel::new(title, "time, s", y_label)
        .with_band(Band::new("estimate ± 3σ", Color::SkyBlue, band))
        .with_curve(Curve::new("truth", Style::TRUTH, truth))
        .with_curve(Curve::new("estimate", Style::ESTIMATE, estimate))
        .with_x_range(0.0, 2000.0)
}
