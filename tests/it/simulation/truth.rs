//! The true platform.

use nalgebra::Vector3;
use scheme_opt::internals::drift::{COEFFICIENTS, CoefficientVector};
use scheme_opt::internals::platform::Repositioning;
use scheme_opt::internals::simulate::{FilterModel, InitialTruth, TruthModel, TruthNoise};

use super::{moving, platform, simulation, with};
use crate::support::Random;

#[test]
fn nonlinear_truth_agrees_with_the_linear_model_to_second_order() {
    let mut random = Random(3);
    let direction = InitialTruth {
        misalignment_n_arcsec: Vector3::from_fn(|_, _| random.between(-360.0, 360.0)),
        drift_deg_per_h: CoefficientVector::from_fn(|_, _| random.between(-10.0, 10.0)),
        others: Vec::new(),
    };
    for mode in [Repositioning::Slew, Repositioning::FrameHold] {
        let (mut test_platform, schedule) = moving();
        if mode == Repositioning::FrameHold {
            test_platform = platform(1.0, |c| c.motion.repositioning = mode);
        }
        let path = |truth, scale: f64| -> Vec<Vector3<f64>> {
            let options = with(truth, FilterModel::Linear).with_noise(TruthNoise::None);
            let initial = InitialTruth {
                misalignment_n_arcsec: direction.misalignment_n_arcsec * scale,
                drift_deg_per_h: direction.drift_deg_per_h * scale,
                others: Vec::new(),
            };
            let run = simulation(&test_platform, &schedule, options).trajectory(&initial, 1, 0);
            run.samples
                .iter()
                .map(|s| s.misalignment_n_arcsec)
                .collect()
        };
        let difference = |scale: f64| -> f64 {
            let (exact, first) = (
                path(TruthModel::Nonlinear, scale),
                path(TruthModel::FirstOrder, scale),
            );
            let pairs = exact.iter().zip(&first);
            pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
        };
        let (large, small) = (difference(1e-2), difference(1e-3));
        println!("{mode:?}: {large:e} arcsec at 1/100, {small:e} at 1/1000");
        assert!(large > 0.01, "the products are there");
        let order = (large / small).log10();
        assert!((order - 2.0).abs() < 0.02, "{mode:?}: order {order}");
    }
}

#[test]
fn without_noise_and_products_the_filter_finds_the_truth() {
    let (platform, schedule) = moving();
    let options = with(TruthModel::FirstOrder, FilterModel::Linear).with_noise(TruthNoise::None);
    let simulation = simulation(&platform, &schedule, options);
    let initial = simulation.draw(1, 0);
    let run = simulation.trajectory(&initial, 1, 0);
    let end = run.samples.last().unwrap();
    // Only the prior pulls: by a small part of a sigma in what the test determines.
    for i in 0..COEFFICIENTS {
        let error = end.drift_estimate_deg_per_h[i] - initial.drift_deg_per_h[i];
        assert!(
            error.abs() < 0.6 * end.drift_sigma_deg_per_h[i],
            "{i}: {error}"
        );
    }
    assert_eq!(end.leg, 4);
    let times: Vec<f64> = run.samples.iter().map(|s| s.time_s).collect();
    assert!(times.is_sorted());
}
