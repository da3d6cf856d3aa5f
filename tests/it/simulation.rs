//! Truth, filter and their consistency.

mod coloured;
#[cfg(feature = "cli")]
mod command;
mod filter;
mod full;
mod monte_carlo;
mod paper;
mod truth;

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{AxisValue, GSensitivePrior, Platform, PlatformConfig};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use scheme_opt::internals::simulate::{
    FilterModel, MonteCarlo, Simulation, SimulationOptions, TruthModel,
};

/// What the default search finds: 10 positions in 12 000 s, RMS σ 0.000905 °/h.
const OPTIMISED: [[f64; 4]; 10] = [
    [-97.392, -3.098, -82.877, 1200.0],
    [-143.246, -54.823, 68.916, 840.0],
    [-102.267, -42.570, 76.857, 860.0],
    [-4.287, -44.257, 15.458, 920.0],
    [-34.313, 43.231, -173.216, 1250.0],
    [-80.254, 95.790, 67.690, 1350.0],
    [106.962, -42.619, 109.447, 1370.0],
    [-89.617, 77.008, -12.720, 1430.0],
    [96.299, -47.824, -137.111, 1480.0],
    [76.705, -33.997, 12.268, 1300.0],
];

/// Twelve oblique positions that a search finds: RMS σ 0.000905 °/h in 12 000 s.
const TWELVE: [[f64; 4]; 12] = [
    [61.525, 52.849, 52.47, 1110.0],
    [-91.26, -28.592, -113.52, 1320.0],
    [112.563, -135.004, -114.714, 1400.0],
    [-3.559, 29.156, -154.064, 980.0],
    [15.391, 58.355, -177.46, 480.0],
    [29.792, 75.189, 165.819, 810.0],
    [-9.084, 56.785, 86.579, 470.0],
    [-179.145, 147.29, -116.873, 1040.0],
    [61.792, -38.713, -155.569, 1120.0],
    [150.49, -70.756, 152.28, 780.0],
    [83.706, -16.487, 32.895, 1210.0],
    [-54.468, 41.354, -128.71, 1280.0],
];

fn twelve() -> Schedule {
    let position =
        |[a, b, g, dwell]: [f64; 4]| ScheduledPosition::new(Position::from_deg(a, b, g), dwell);
    Schedule::new(TWELVE.map(position).to_vec()).unwrap()
}

fn optimised() -> Schedule {
    let position =
        |[a, b, g, dwell]: [f64; 4]| ScheduledPosition::new(Position::from_deg(a, b, g), dwell);
    Schedule::new(OPTIMISED.map(position).to_vec()).unwrap()
}

/// The default platform with its drift prior times `drift`.
fn platform_config(drift: f64) -> PlatformConfig {
    let mut config = PlatformConfig::default();
    config.prior.constant_drift_deg_per_h = AxisValue::All(15.0 * drift);
    config.prior.g_sensitive_drift_deg_per_h_per_g =
        GSensitivePrior::All(AxisValue::All(8.0 * drift));
    config
}

/// The same, changed.
fn platform(drift: f64, change: impl FnOnce(&mut PlatformConfig)) -> Platform {
    let mut config = platform_config(drift);
    change(&mut config);
    config.check().unwrap()
}

fn simulation(platform: &Platform, schedule: &Schedule, options: SimulationOptions) -> Simulation {
    let timeline = Timeline::new(&platform.clone().into(), schedule).unwrap();
    Simulation::new(platform, &timeline, options).unwrap()
}

fn monte_carlo(drift: f64, runs: usize, options: SimulationOptions) -> MonteCarlo {
    let platform = platform(drift, |_| {});
    simulation(&platform, &optimised(), options)
        .monte_carlo(runs, 1)
        .unwrap()
}

fn with(truth: TruthModel, filter: FilterModel) -> SimulationOptions {
    SimulationOptions::default()
        .with_truth(truth)
        .with_filter(filter)
}

/// Slews, a measured one among them, settles, and a remainder of a period.
fn moving() -> (Platform, Schedule) {
    let platform = platform(1.0, |c| {
        c.motion.slew_rate_deg_per_s = Some(0.5.into());
        c.motion.settle_s = 25.0;
    });
    let mut positions = optimised().positions()[..5].to_vec();
    positions[2].move_measured = Some(true);
    positions[3].dwell_s = 0.0;
    positions[4].dwell_s = 333.0;
    (platform, Schedule::new(positions).unwrap())
}
