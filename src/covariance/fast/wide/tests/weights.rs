//! Figures of merit of more than the twelve coefficients.

use nalgebra::DMatrix;
use serde_json::json;

use super::{
    Random, accelerometers, largest_angle, merged, motions, others, platform, positions, slope,
    timeline, torquers, turned,
};
use crate::covariance::{CoefficientCovariance, CovarianceModel, Slope, TickRule};
use crate::error::Result;
use crate::motion::Timeline;
use crate::schedule::ScheduledPosition;

/// ln Σ w_i P_ii, or ln tr(W P).
#[derive(Clone, Copy)]
enum Form {
    Variances,
    Covariance,
}

/// Weights that make the parameters comparable: by their prior variances.
fn weight(sigma: &[f64]) -> DMatrix<f64> {
    let root = DMatrix::from_fn(sigma.len(), sigma.len(), |i, j| {
        let mixed = if i == j {
            1.0
        } else {
            0.3 * ((3 * i + 5 * j) as f64).sin()
        };
        mixed / sigma[i]
    });
    &root * root.transpose()
}

fn merit(p: &dyn CoefficientCovariance, form: Form, weight: &DMatrix<f64>) -> Result<(f64, Slope)> {
    let p = p.seen();
    Ok(match form {
        Form::Variances => {
            let sum = p.diagonal().dot(&weight.diagonal());
            (sum.ln(), Slope::SeenVariances(weight.diagonal() / sum))
        }
        Form::Covariance => {
            let sum = p.dot(weight);
            (sum.ln(), Slope::SeenCovariance(weight / sum))
        }
    })
}

#[test]
fn weights_of_all_parameters_have_values_and_gradients() {
    let mut random = Random(53);
    let rule = TickRule::Relaxed;
    let considering = merged(&[
        &torquers(),
        &json!({ "quadratic_drift_deg_per_h_per_g2": 0.1, "considered": accelerometers() }),
    ]);
    let everything = merged(&[&torquers(), &accelerometers(), &others()]);
    for motion in &motions()[..2] {
        for errors in [&everything, &considering] {
            let platform = platform(&json!({ "errors": errors }), motion);
            let names: Vec<usize> = (0..platform.errors().parameters().len())
                .filter(|&i| platform.errors().parameters()[i].name.starts_with("T_"))
                .collect();
            let model = CovarianceModel::new(&platform).seeing(&names);
            let all: Vec<usize> = names.iter().copied().chain(0..12).collect();
            let sigma: Vec<f64> = all
                .iter()
                .map(|&i| platform.errors().parameters()[i].prior_sigma)
                .collect();
            let weight = weight(&sigma);
            let schedules: Vec<_> = (0..6)
                .map(|_| positions(&mut random, &platform, 6))
                .collect();
            // Variances are those of the exact chain.
            let first = timeline(&platform, &schedules[0]);
            let full = model.full_covariance_by::<f64>(&first, rule).unwrap().full;
            let mut seen = DMatrix::zeros(0, 0);
            let _ = model.value(&first, rule, |p| {
                seen = p.seen();
                Ok(0.0)
            });
            let expected = full.sigma();
            for (at, i) in all.iter().enumerate() {
                assert!((seen[(at, at)].sqrt() / expected[*i] - 1.0).abs() < 1e-9);
            }
            for form in [Form::Variances, Form::Covariance] {
                let of = |p: &dyn CoefficientCovariance| merit(p, form, &weight);
                let value = |positions: &[ScheduledPosition]| {
                    let t = timeline(&platform, positions);
                    model.value(&t, rule, |p| Ok(of(p)?.0)).unwrap()
                };
                let (_, exact) = model.gradient(&first, rule, of).unwrap();
                let (_, by_rows) = model.gradient_by_rows(&first, rule, of).unwrap();
                let size = largest_angle(&exact);
                for (k, leg) in exact.iter().enumerate() {
                    for axis in 0..3 {
                        let numeric = slope(0.05, |by| value(&turned(&schedules[0], k, axis, by)));
                        let error = (numeric.to_degrees() - leg.angles[axis]).abs();
                        assert!(error < 1e-7 * size, "{k} {axis}: {error:e} of {size:e}");
                        let error = (by_rows[k].angles[axis] - leg.angles[axis]).abs();
                        assert!(
                            error < 1e-8 * size,
                            "{k} {axis}: rows {error:e} of {size:e}"
                        );
                    }
                }
                let timelines: Vec<Timeline> =
                    schedules.iter().map(|p| timeline(&platform, p)).collect();
                let together = model.gradients(&timelines, rule, of);
                for (timeline, found) in timelines.iter().zip(together) {
                    assert_eq!(found.unwrap(), model.gradient(timeline, rule, of).unwrap());
                }
            }
        }
    }
}
