//! From an Allan deviation to the keys of the platform file, and back: the picture and the numbers of
//! docs/allan.md.
//!
//! ```sh
//! cargo run --release --example 12_allan_deviation -- docs/figures
//! ```

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use std::path::PathBuf;

use scheme_opt::internals::platform::{Platform, PlatformConfig};
use scheme_opt::internals::report::figure::{
    Color, Curve, Dash, Figure, Mark, Panel, Scale, Shape, Style,
};
use scheme_opt::internals::units::ARCSEC_PER_RAD;

/// The gyros whose Allan deviation the page shows.
const GYRO: &str = "[gyro]\n\
    angle_random_walk_deg_per_sqrt_h = 5e-4\n\
    rate_random_walk_deg_per_h_per_sqrt_h = 0.001\n\
    bias_instability_deg_per_h = 0.003\n\
    bias_correlation_time_s = 600.0\n";

/// Height of a Gauss–Markov process's hump in its 1σ, and where it is in its time constants.
const HUMP: [f64; 2] = [0.6174, 1.8926];

/// The three parts of the Allan variance over `tau_s`, (°/h)²: white, Gauss–Markov, random walk.
fn parts(platform: &Platform, tau_s: f64) -> [f64; 3] {
    // 1 rad/s is 206 265 °/h.
    let drift = platform.drift_colour().times(ARCSEC_PER_RAD);
    let white = platform.drift_psd_rad2_per_s() * ARCSEC_PER_RAD.powi(2) / tau_s;
    let walk = drift.random_walk.map_or(0.0, |k2| k2 * tau_s / 3.0);
    [white, drift.allan_variance(tau_s) - walk, walk]
}

fn deviation(platform: &Platform, tau_s: f64) -> f64 {
    parts(platform, tau_s).iter().sum::<f64>().sqrt()
}

/// What is read from a curve.
struct Reading {
    /// N, °/√h.
    white: f64,
    /// K, °/h/√h.
    walk: f64,
    /// Where the floor is, s, and how high, °/h, and what of that is no white noise and no walk.
    floor: [f64; 3],
    /// 1σ, °/h, and time constant, s, of the process that stands for the floor.
    markov: [f64; 2],
}

impl Reading {
    /// From `curve`, °/h over s, as the page does it.
    fn of(curve: impl Fn(f64) -> f64) -> Self {
        // The line of slope −1/2 at 1 s, that of +1/2 far to the right.
        let white = curve(1.0) / 60.0;
        let far_s: f64 = 1e6;
        let walk = curve(far_s) * (3.0 / (far_s / 3600.0)).sqrt();
        let rest = |tau_s: f64| {
            let hours = tau_s / 3600.0;
            (curve(tau_s).powi(2) - white.powi(2) / hours - walk.powi(2) * hours / 3.0)
                .max(0.0)
                .sqrt()
        };
        let steps = (0..400).map(|i| 10.0_f64.powf(1.0 + f64::from(i) / 100.0));
        let at = steps.fold(10.0, |best, tau_s| match rest(tau_s) > rest(best) {
            true => tau_s,
            false => best,
        });
        Self {
            white,
            walk,
            floor: [at, curve(at), rest(at)],
            markov: [rest(at) / HUMP[0], at / HUMP[1]],
        }
    }
}

/// Where the picture begins, °/h.
const LEAST: f64 = 1e-4;

/// Over x = 1 + lg τ: the axis has names for whole numbers.
fn picture(platform: &Platform, reading: &Reading) -> Figure {
    let taus = (0..=520).map(|i| 10.0_f64.powf(f64::from(i) / 100.0));
    let taus: Vec<f64> = taus.collect();
    let place = |tau_s: f64| 1.0 + tau_s.log10();
    // A line that is below the picture begins where it enters it.
    let line = |value: &dyn Fn(f64) -> f64| -> Vec<[f64; 2]> {
        let points = taus.iter().map(|t| [place(*t), value(*t)]);
        points.filter(|[_, y]| *y >= LEAST).collect()
    };
    let style = |color, dash| Style {
        color,
        dash,
        width: 1.4,
    };
    let part = |k: usize| line(&|tau_s| parts(platform, tau_s)[k].sqrt());
    let whole = Style {
        width: 2.2,
        ..style(Color::Black, Dash::Solid)
    };
    let [floor_s, height, rest] = reading.floor;
    let three_hours = 3.0 * 3600.0;
    let marks = [
        ([1.0, 60.0 * reading.white], "at 1 s: 60 N"),
        ([floor_s, height], "the floor"),
        ([floor_s, rest], "the floor without its neighbours: 0.617 σ"),
        ([three_hours, reading.walk], "at 3 h: K"),
    ];
    let names = ["1", "10", "100", "1000", "10 000", "100 000"];
    let mut panel = Panel::new("", "averaging time τ, s", "Allan deviation, °/h")
        .with_x_names(names.map(str::to_owned).to_vec())
        .with_x_range(1.0, 6.2)
        .with_y_range(LEAST, 0.1)
        .with_y_scale(Scale::Log)
        .with_curve(Curve::new(
            "angle random walk N, slope −1/2",
            style(Color::Blue, Dash::Dashed),
            part(0),
        ))
        .with_curve(Curve::new(
            "Gauss–Markov, hump of 0.617 σ at 1.89 T",
            style(Color::Green, Dash::Dotted),
            part(1),
        ))
        .with_curve(Curve::new(
            "rate random walk K, slope +1/2",
            style(Color::Vermillion, Dash::DashDotted),
            part(2),
        ))
        .with_curve(Curve::new(
            "all together: what is measured",
            whole,
            line(&|tau_s| deviation(platform, tau_s)),
        ));
    for ([tau_s, value], said) in marks {
        let mark = Mark::new([place(tau_s), value], Shape::Dot, Color::Black, said);
        panel = panel.with_mark(mark);
    }
    Figure::new(1)
        .with_panel_size(720.0, 420.0)
        .with_id("allan")
        .with_label("Allan deviation of a gyro and its three parts; the table has the numbers")
        .with_panel(panel)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let config: PlatformConfig = toml::from_str(GYRO)?;
    let platform = config.check()?;
    println!("tau, s      whole     white     Gauss-Markov  random walk  (deg/h)");
    for tau_s in [1.0, 10.0, 100.0, 300.0, 1000.0, 3000.0, 1e4, 3e4, 1e5] {
        let [white, markov, walk] = parts(&platform, tau_s).map(f64::sqrt);
        let whole = deviation(&platform, tau_s);
        println!("{tau_s:<10} {whole:>9.5} {white:>9.5} {markov:>13.5} {walk:>12.5}");
    }
    let reading = Reading::of(|tau_s| deviation(&platform, tau_s));
    let [at, height, rest] = reading.floor;
    let [sigma, time_s] = reading.markov;
    println!("\nread at 1 s: N = {:.2e} deg/sqrt(h)", reading.white);
    println!(
        "read at 3 h on the line of slope 1/2: K = {:.5} deg/h/sqrt(h)",
        reading.walk
    );
    println!("floor of {height:.5} deg/h at {at:.0} s, without its neighbours {rest:.5} deg/h");
    println!("hence sigma = {sigma:.5} deg/h, T = {time_s:.0} s");
    if let Some(directory) = std::env::args().nth(1) {
        let file = PathBuf::from(directory).join("allan-deviation.svg");
        std::fs::write(&file, picture(&platform, &reading).to_svg())?;
        println!("\nwritten: {}", file.display());
    }
    Ok(())
}
