//! How much the linearisation bears: NEES against the size of what is unknown at the start.

use crate::error::{Error, Result};
use crate::motion::Timeline;
use crate::platform::Platform;
use crate::units::Angle;

use super::consistency::Consistency;
use super::{Simulation, SimulationOptions};

/// How uncertain the start is, for truth and filter alike.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PriorSize {
    /// 1σ of ψ^n(0) about each axis, degrees.
    pub misalignment_deg: f64,
    /// Factor on the platform's prior 1σ of every drift coefficient.
    pub drift_factor: f64,
}

/// What a filter does when the start is that uncertain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweepPoint {
    /// The size.
    pub size: PriorSize,
    /// NEES over all states at the end of the test.
    pub nees: Option<Consistency>,
    /// How many runs diverged.
    pub diverged_runs: usize,
    /// RMS error over the coefficients, °/h.
    pub rms_error_deg_per_h: f64,
    /// RMS over the runs of the largest angle the platform was off the computed frame, degrees.
    pub rms_largest_misalignment_deg: f64,
}

/// Runs a Monte Carlo of `runs` for each of `sizes`, with the same random numbers.
///
/// # Errors
///
/// Those of [`Simulation::new`] and [`Simulation::monte_carlo`], and [`Error::is_input`] for a
/// size that is negative or not finite, or a misalignment of more than 90°.
pub fn sweep(
    platform: &Platform,
    timeline: &Timeline,
    options: SimulationOptions,
    sizes: &[PriorSize],
    runs: usize,
    seed: u64,
) -> Result<Vec<SweepPoint>> {
    let point = |size: &PriorSize| {
        let sized = with_prior(platform, size)?;
        let found = Simulation::new(&sized, timeline, options)?.monte_carlo(runs, seed)?;
        Ok(SweepPoint {
            size: *size,
            nees: found.nees.and_then(|n| n.by_itself()),
            diverged_runs: found.divergence.count,
            rms_error_deg_per_h: found.rms_error_deg_per_h(),
            rms_largest_misalignment_deg: found.rms_largest_misalignment_deg,
        })
    };
    sizes.iter().map(point).collect()
}

/// The last of `points`, in rising order of size, before the first at which the filter claims
/// more than it knows or loses the platform in a run; none when it does from the start.
///
/// The 95 % bounds leave one experiment in twenty outside by luck, and the points share their
/// random numbers. So what counts here is an average above its expected value by more than twice
/// what the upper bound is: one in some ten thousand.
pub fn largest_without_optimism(points: &[SweepPoint]) -> Option<&SweepPoint> {
    let bears = |n: &Consistency| {
        let expected = n.degrees_of_freedom as f64;
        n.average - expected <= 2.0 * (n.bounds[1] - expected)
    };
    points
        .iter()
        .take_while(|p| p.diverged_runs == 0 && p.nees.as_ref().is_none_or(bears))
        .last()
}

fn with_prior(platform: &Platform, size: &PriorSize) -> Result<Platform> {
    let refuse = |key: &str, value: f64, allowed: &str| Error::out_of_range(key, value, allowed);
    if !(0.0..=90.0).contains(&size.misalignment_deg) {
        return Err(refuse("misalignment_deg", size.misalignment_deg, "0 to 90"));
    }
    if !(0.0..=1e6).contains(&size.drift_factor) {
        return Err(refuse("drift_factor", size.drift_factor, "0 to 1e6"));
    }
    let mut sized = platform.clone();
    sized
        .prior_misalignment_rad
        .fill(Angle::from_deg(size.misalignment_deg).rad());
    sized.prior_drift_rad_per_s *= size.drift_factor;
    Ok(sized)
}
