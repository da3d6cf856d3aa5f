//! The paper's section 3.

use nalgebra::Vector3;
use scheme_opt::internals::attitude::{NORTH, Position};
use scheme_opt::internals::drift::{CoefficientVector, DriftCoefficient};
use scheme_opt::internals::platform::Repositioning;
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use scheme_opt::internals::simulate::{
    FilterModel, InitialTruth, SimulationOptions, Trajectory, TruthModel, TruthNoise,
};

use super::{platform, simulation, with};

/// The paper's test; errors of the coefficients at its end.
fn paper(mode: Repositioning, misalignment_arcsec: f64, options: SimulationOptions) -> Trajectory {
    let platform = platform(1.0, |c| c.motion.repositioning = mode);
    let positions = [0.0, 180.0]
        .map(|alpha| ScheduledPosition::new(Position::from_deg(alpha, 0.0, 0.0), 1000.0));
    let schedule = Schedule::new(positions.to_vec()).unwrap();
    let mut drift_deg_per_h = CoefficientVector::repeat(5.0);
    drift_deg_per_h[0] = 11.0;
    drift_deg_per_h[1] = 12.0;
    drift_deg_per_h[2] = 13.0;
    let initial = InitialTruth {
        misalignment_n_arcsec: Vector3::repeat(misalignment_arcsec),
        drift_deg_per_h,
        others: Vec::new(),
    };
    simulation(&platform, &schedule, options).trajectory(&initial, 1, 0)
}

/// Error and σ of a coefficient at the end.
fn end_of(run: &Trajectory, c: DriftCoefficient) -> (f64, f64) {
    let end = run.samples.last().unwrap();
    let i = c.index();
    (
        end.drift_estimate_deg_per_h[i] - run.drift_deg_per_h[i],
        end.drift_sigma_deg_per_h[i],
    )
}

#[test]
fn the_papers_numbers_come_out_and_are_exchanged_by_the_slew() {
    let options = with(TruthModel::FirstOrder, FilterModel::Linear);
    for (mode, wrong, clean) in [
        (
            Repositioning::FrameHold,
            DriftCoefficient::FZ,
            DriftCoefficient::SZ,
        ),
        (
            Repositioning::Slew,
            DriftCoefficient::SZ,
            DriftCoefficient::FZ,
        ),
    ] {
        let run = paper(mode, 360.0, options);
        let ((error, sigma), (clean_error, clean_sigma)) =
            (end_of(&run, wrong), end_of(&run, clean));
        println!(
            "{mode:?}: {wrong:?} {error:.5} ± {sigma:.5}, {clean:?} {clean_error:.5} ± {clean_sigma:.5}"
        );
        assert!((sigma - 0.02377).abs() < 5e-6, "{sigma}");
        assert!((clean_sigma - 0.00260).abs() < 5e-6, "{clean_sigma}");
        assert!(clean_error.abs() < 3.0 * clean_sigma);
        assert!(error.abs() > 5.0 * clean_sigma);
    }
}

#[test]
fn the_bias_is_omega_north_times_the_initial_misalignment() {
    let omega_north = platform(1.0, |_| {}).earth_rate_n()[NORTH];
    let options = with(TruthModel::FirstOrder, FilterModel::Linear).with_noise(TruthNoise::None);
    // 0.1 degrees, 0.1 arc minutes.
    for arcsec in [360.0, 6.0] {
        // What the same test does without a misalignment is the prior's pull, not its doing.
        let bias = |mode, c| {
            end_of(&paper(mode, arcsec, options), c).0 - end_of(&paper(mode, 0.0, options), c).0
        };
        let expected = omega_north * arcsec;
        let wrong = bias(Repositioning::FrameHold, DriftCoefficient::FZ);
        println!("{arcsec} arcsec: {wrong} against {expected} deg/h");
        assert!((wrong / -expected - 1.0).abs() < 0.05, "{wrong} {expected}");
        assert!(bias(Repositioning::FrameHold, DriftCoefficient::SZ).abs() < 0.02 * expected);
        let wrong = bias(Repositioning::Slew, DriftCoefficient::SZ);
        assert!((wrong / expected - 1.0).abs() < 0.05, "{wrong} {expected}");
        assert!(bias(Repositioning::Slew, DriftCoefficient::FZ).abs() < 0.02 * expected);
    }
}

#[test]
fn psi_x_and_z_are_followed_at_once_and_psi_y_only_in_its_trend() {
    // Figures 2–4: the paper's words on the first position.
    let options = with(TruthModel::FirstOrder, FilterModel::Linear);
    let run = paper(Repositioning::FrameHold, 360.0, options);
    for s in run
        .samples
        .iter()
        .filter(|s| (100.0..=1000.0).contains(&s.time_s))
    {
        let error = s.misalignment_n_error_arcsec;
        assert!(error.x.abs() < 10.0 && error.z.abs() < 10.0, "{error}");
    }
    let end = run.samples.iter().find(|s| s.time_s == 1000.0).unwrap();
    let off = end.misalignment_n_error_arcsec.y;
    assert!(
        (off / 360.0 - 1.0).abs() < 0.5,
        "psi_y is off by psi_y(0) = 360: {off}"
    );
}

#[test]
fn the_papers_filter_does_not_survive_the_papers_drift_on_a_nonlinear_platform() {
    let nonlinear = with(TruthModel::Nonlinear, FilterModel::Linear);
    let run = paper(Repositioning::FrameHold, 360.0, nonlinear);
    let (error, sigma) = end_of(&run, DriftCoefficient::FY);
    assert!(
        error.abs() > 5.0 && error.abs() > 50.0 * sigma,
        "{error} {sigma}"
    );
    // The same measurements suffice for a filter that linearises where the platform is.
    let run = paper(
        Repositioning::FrameHold,
        360.0,
        SimulationOptions::default(),
    );
    let (error, sigma) = end_of(&run, DriftCoefficient::FY);
    assert!(error.abs() < 3.0 * sigma, "{error} {sigma}");
}
