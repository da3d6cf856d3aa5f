//! The kernel evaluator and the square-root filter against an independent dense Kalman filter.

use scheme_opt::covariance::reference::step_by_step;
use scheme_opt::covariance::{CovarianceModel, EndCovariance, TickRule};
use scheme_opt::drift::CoefficientVector;
use scheme_opt::motion::Timeline;

use crate::support::{ReferenceCase, reference_cases};

fn assert_close(what: &str, value: f64, expected: f64, tolerance: f64) {
    let error = (value / expected - 1.0).abs();
    assert!(
        error <= tolerance,
        "{what}: {value} instead of {expected}, off by {error:e}"
    );
}

/// Largest relative difference of a σ from the reference.
fn worst_sigma(case: &ReferenceCase, end: &EndCovariance) -> f64 {
    let sigma = end.sigma_deg_per_h();
    let psi = end.misalignment_sigma_arcsec();
    let drift = sigma.iter().zip(&case.sigma_deg_per_h);
    let misalignment = psi.iter().zip(&case.misalignment_arcsec);
    drift
        .chain(misalignment)
        .map(|(value, expected)| (value / expected - 1.0).abs())
        .fold(0.0, f64::max)
}

fn check(case: &ReferenceCase, end: &EndCovariance, tolerance: f64) {
    let worst = worst_sigma(case, end);
    println!("{}: worst relative error of a sigma {worst:.1e}", case.name);
    assert!(worst <= tolerance, "{}: {worst:e}", case.name);
    let sigma = end.sigma_deg_per_h();
    let rms = (sigma.norm_squared() / 12.0).sqrt();
    assert_close("rms", rms, case.rms, tolerance);
    assert_close("max", sigma.max(), case.max, tolerance);
    let eigenvalues = end.coefficients.symmetric_eigenvalues();
    assert_close("max_eig", eigenvalues.max().sqrt(), case.max_eig, tolerance);
    let logdet: f64 = eigenvalues.iter().map(|v| v.ln()).sum();
    assert!((logdet - case.logdet).abs() < 1e-5, "logdet {logdet}");
}

#[test]
fn nine_cases_are_there() {
    assert_eq!(reference_cases().len(), 9);
}

#[test]
fn kernel_evaluator_agrees_to_1e_6() {
    for case in reference_cases() {
        let platform = case.config.check().unwrap();
        let timeline = Timeline::new(&platform, &case.schedule).unwrap();
        assert!((timeline.total_time_s() - case.total_time_s).abs() < 1e-3);
        let end = CovarianceModel::new(&platform)
            .end_covariance(&timeline, TickRule::Filter)
            .unwrap();
        check(&case, &end, 1e-6);
    }
}

#[test]
fn square_root_filter_agrees_to_1e_6() {
    for case in reference_cases() {
        let platform = case.config.check().unwrap();
        let timeline = Timeline::new(&platform, &case.schedule).unwrap();
        let end = step_by_step(&platform, &timeline, &mut |_| {}).unwrap();
        check(&case, &end, 1e-6);
    }
}

#[test]
fn kernels_and_filter_agree_from_strong_to_weak_priors() {
    use scheme_opt::platform::{AxisValue, GSensitivePrior, PlatformConfig};
    let case = reference_cases()
        .into_iter()
        .find(|c| c.name == "weak-prior-oblique-nine")
        .unwrap();
    for sigma in [1e-6, 1e-3, 1.0, 1e2, 1e4, 1e6] {
        let mut config = PlatformConfig::default();
        config.prior.misalignment_deg = AxisValue::All(1.0);
        config.prior.constant_drift_deg_per_h = AxisValue::All(sigma);
        config.prior.g_sensitive_drift_deg_per_h_per_g =
            GSensitivePrior::All(AxisValue::All(sigma));
        let platform = config.check().unwrap();
        let timeline = Timeline::new(&platform, &case.schedule).unwrap();
        let kernels = CovarianceModel::new(&platform)
            .end_covariance(&timeline, TickRule::Filter)
            .unwrap();
        let filter = step_by_step(&platform, &timeline, &mut |_| {}).unwrap();
        let ratio = kernels
            .sigma_deg_per_h()
            .component_div(&filter.sigma_deg_per_h());
        let worst = ratio.map(|r| (r - 1.0).abs()).max();
        println!("prior {sigma:e}: {worst:.1e}");
        assert!(worst < 1e-6, "prior {sigma:e}: {worst:e}");
    }
}

#[test]
fn the_history_says_what_each_position_did() {
    use scheme_opt::covariance::history::HistoryRecorder;
    let mut improved = Vec::new();
    for case in reference_cases() {
        let platform = case.config.check().unwrap();
        let timeline = Timeline::new(&platform, &case.schedule).unwrap();
        let mut recorder = HistoryRecorder::new(&timeline, None);
        let mut moments = Vec::new();
        step_by_step(&platform, &timeline, &mut |moment| {
            recorder.observe(moment);
            moments.push(*moment);
        })
        .unwrap();
        let first = timeline.positions().start;
        for p in recorder.finish().positions {
            let at = |time_s: f64| moments.iter().rfind(|m| m.time_s <= time_s).unwrap();
            let end = moments.iter().rfind(|m| m.leg == first + p.position);
            let (start, end) = (at(p.start_s).sigma_deg_per_h, end.unwrap());
            assert_eq!(p.end_s, end.time_s);
            let ratios = end.sigma_deg_per_h.component_div(&start);
            assert_eq!(ratios[p.most_improved], ratios.min());
            let rms = |sigma: &CoefficientVector| (sigma.norm_squared() / 12.0).sqrt();
            assert_close(
                "rms",
                p.rms_sigma_deg_per_h,
                rms(&end.sigma_deg_per_h),
                1e-12,
            );
            let decades = (rms(&start) / rms(&end.sigma_deg_per_h)).log10();
            let hours = (p.end_s - p.start_s) / 3600.0;
            assert!((p.decades_per_h * hours - decades).abs() < 1e-9);
            improved.push(p.most_improved);
        }
    }
    assert!(improved.len() > 9 && improved.iter().any(|i| *i != improved[0]));
}
