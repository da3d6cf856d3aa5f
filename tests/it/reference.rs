//! The kernel evaluator and the square-root filter against an independent dense Kalman filter.

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::covariance::filter::{Moment, step_by_step};
use scheme_opt::internals::covariance::{CovarianceModel, EndCovariance, TickRule};
use scheme_opt::internals::drift::CoefficientVector;
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{Platform, PlatformConfig};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

use crate::battery::reference::{ReferenceCase, reference_cases};

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
        let timeline = Timeline::new(&platform.clone().into(), &case.schedule).unwrap();
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
        let timeline = Timeline::new(&platform.clone().into(), &case.schedule).unwrap();
        let end = step_by_step(&platform, &timeline, &mut |_| {}).unwrap();
        check(&case, &end, 1e-6);
    }
}

#[test]
fn kernels_and_filter_agree_from_strong_to_weak_priors() {
    use scheme_opt::internals::platform::{AxisValue, GSensitivePrior, PlatformConfig};
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
        let timeline = Timeline::new(&platform.clone().into(), &case.schedule).unwrap();
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
    use scheme_opt::internals::covariance::history::HistoryRecorder;
    let mut improved = Vec::new();
    for case in reference_cases() {
        let platform = case.config.check().unwrap();
        let timeline = Timeline::new(&platform.clone().into(), &case.schedule).unwrap();
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

/// A test with a start attitude, moves that take time and end between two ticks, settles where
/// nothing is measured, and a return.
fn moving_test(measured: bool) -> (Platform, Timeline) {
    let mut config = PlatformConfig::default();
    config.motion.slew_rate_deg_per_s = Some(0.43.into());
    config.motion.settle_s = 24.0;
    config.motion.measure_moves = measured;
    config.motion.start_deg = Some([0.0, 10.0, -20.0]);
    config.motion.return_to_start = true;
    let platform = config.check().unwrap();
    let positions = [
        ([0.0, 0.0, 0.0], 730.0),
        ([95.0, 30.0, -60.0], 1245.0),
        ([-170.0, -45.0, 80.0], 600.0),
        ([60.0, 75.0, 10.0], 902.0),
    ]
    .map(|(a, dwell_s)| ScheduledPosition::new(Position::from_deg(a[0], a[1], a[2]), dwell_s));
    let schedule = Schedule::new(positions.into()).unwrap();
    let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
    (platform, timeline)
}

#[test]
fn moves_are_followed_alike_by_kernels_and_filter() {
    let sigmas = [false, true].map(|measured| {
        let (platform, timeline) = moving_test(measured);
        let model = CovarianceModel::new(&platform);
        let kernels = model.end_covariance(&timeline, TickRule::Filter).unwrap();
        let filter = step_by_step(&platform, &timeline, &mut |_| {}).unwrap();
        let (a, b) = (kernels.sigma_deg_per_h(), filter.sigma_deg_per_h());
        for (a, b) in a.iter().zip(b.iter()) {
            assert_close("sigma", *a, *b, 1e-8);
        }
        let (a, b) = (
            kernels.misalignment_sigma_arcsec(),
            filter.misalignment_sigma_arcsec(),
        );
        for (a, b) in a.iter().zip(b.iter()) {
            assert_close("misalignment", *a, *b, 1e-8);
        }
        kernels.sigma_deg_per_h()
    });
    // Measured moves tell something of every coefficient.
    assert!(sigmas[1].iter().zip(sigmas[0].iter()).all(|(m, u)| m < u));
}

#[test]
fn the_history_follows_the_test_from_start_to_end() {
    use scheme_opt::internals::covariance::history::HistoryRecorder;
    let (platform, timeline) = moving_test(true);
    let mut moments = Vec::new();
    step_by_step(&platform, &timeline, &mut |m| moments.push(*m)).unwrap();
    let end = moments.last().unwrap();
    // What each coefficient has at some time is its specification; two have none, and one asks
    // for more than the test gives.
    let mut spec =
        CoefficientVector::from_fn(|i, _| moments[(i + 4) * moments.len() / 20].sigma_deg_per_h[i]);
    spec[3] = f64::INFINITY;
    spec[8] = f64::INFINITY;
    spec[5] = 0.5 * end.sigma_deg_per_h[5];
    let mut recorder = HistoryRecorder::new(&timeline, Some(spec));
    moments.iter().for_each(|m| recorder.observe(m));
    let history = recorder.finish();

    for (i, reached) in history.time_to_spec_s.iter().enumerate() {
        if spec[i].is_infinite() || i == 5 {
            assert_eq!(*reached, None);
            continue;
        }
        // From then on within the specification, and not the moment before.
        let reached = reached.unwrap();
        let within = |m: &Moment| m.sigma_deg_per_h[i] <= spec[i];
        let (before, after): (Vec<&Moment>, _) = moments.iter().partition(|m| m.time_s < reached);
        assert!(after.iter().all(|m| within(m)) && !within(before.last().unwrap()));
        assert_eq!(after[0].time_s, reached);
    }

    // Samples as they were, spread evenly, the last one the end.
    let spacing_s = timeline.total_time_s() / 240.0;
    let times = &history.times_s;
    assert_eq!(times.len(), history.sigma_deg_per_h.len());
    assert_eq!(
        (times[0], times[times.len() - 1]),
        (moments[0].time_s, end.time_s)
    );
    for (time, sigma) in times.iter().zip(&history.sigma_deg_per_h) {
        let mut at = moments.iter().filter(|m| m.time_s == *time);
        assert!(at.any(|m| m.sigma_deg_per_h == *sigma));
    }
    let period_s = 10.0;
    for pair in times[..times.len() - 1].windows(2) {
        let step = pair[1] - pair[0];
        assert!(step >= spacing_s && step <= spacing_s + period_s + 1e-9);
    }
    assert!(times[times.len() - 1] > times[times.len() - 2]);

    // One entry for each position, from the end of the one before it; the start attitude and the
    // return are none.
    let legs = timeline.position_legs();
    assert_eq!(history.positions.len(), legs.len());
    let mut clock = 0.0;
    for (k, (p, leg)) in history.positions.iter().zip(legs).enumerate() {
        assert_eq!(p.position, k);
        // The first moment of a test is the first tick of its first move.
        let late = if k == 0 { period_s } else { 1e-6 };
        assert!((p.start_s - clock).abs() <= late, "{k}: {}", p.start_s);
        clock += leg.duration_s();
        assert!((p.end_s - clock).abs() < 1e-6, "{k}: {}", p.end_s);
    }
}
