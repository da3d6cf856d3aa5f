//! Figures of merit of more than the twelve coefficients.

use nalgebra::{DMatrix, DVector};

use super::super::super::mixing::{Mixing, Parameters};
use super::{
    ACCELEROMETERS, OTHERS, Random, Selection, TORQUERS, named, parameters, platforms, positions,
    timeline,
};
use crate::attitude::Position;
use crate::covariance::fast::mixing::Kind;
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CovarianceModel, TickRule, WideCovariance, WideSlope};
use crate::error::Result;
use crate::motion::Timeline;
use crate::platform::Platform;

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

fn merit(p: &dyn WideCovariance, form: Form, sigma: &[f64]) -> Result<(f64, WideSlope)> {
    let (p, w) = (p.seen(), weight(sigma));
    Ok(match form {
        Form::Variances => {
            let sum = p.diagonal().dot(&w.diagonal());
            (sum.ln(), WideSlope::Variances(w.diagonal() / sum))
        }
        Form::Covariance => {
            let sum = p.dot(&w);
            (sum.ln(), WideSlope::Covariance(w / sum))
        }
    })
}

fn cases(platform: &Platform) -> Vec<Parameters> {
    let selection =
        |estimated: &[(&'static str, f64)], considered: &[(&'static str, f64)]| Selection {
            kind: Kind::Instruments,
            estimated: estimated.to_vec(),
            considered: considered.to_vec(),
            output: super::PAPER,
        };
    [
        selection(&ACCELEROMETERS, &[]),
        selection(&OTHERS[..1], &ACCELEROMETERS),
    ]
    .map(|selection| Parameters {
        weighted: named(&TORQUERS, &super::PAPER),
        ..parameters(&selection, platform)
    })
    .into()
}

#[test]
fn weights_of_all_parameters_have_values_and_gradients() {
    let mut random = Random(53);
    let rule = TickRule::Relaxed;
    for platform in &platforms()[..2] {
        let model = CovarianceModel::new(platform);
        for parameters in cases(platform) {
            let mixing = Mixing::new(&parameters).unwrap();
            let all: Vec<f64> = (parameters.weighted.iter())
                .chain(&parameters.coefficients)
                .map(|p| p.prior_sigma)
                .collect();
            let timelines: Vec<_> = (0..6)
                .map(|_| positions(&mut random, platform, 6))
                .collect();
            for form in [Form::Variances, Form::Covariance] {
                let of = |p: &dyn WideCovariance| merit(p, form, &all);
                let value = |t: &Timeline| {
                    let found = model.wide_value(&mixing, t, rule, |p| Ok(of(p)?.0));
                    found.unwrap()
                };
                // Variances are those of the end.
                let first = timeline(platform, &timelines[0]);
                let mut seen = DVector::zeros(0);
                let _ = model.wide_value(&mixing, &first, rule, |p| {
                    seen = p.seen().diagonal();
                    Ok(0.0)
                });
                let end = model.wide_end(&mixing, &first, rule).unwrap();
                let end = &end.sigma[end.sigma.len() - all.len()..];
                for (a, b) in seen.iter().zip(end) {
                    assert!((a.sqrt() / b - 1.0).abs() < 1e-10);
                }

                let (_, exact) = model.wide_gradient(&mixing, &first, rule, of).unwrap();
                let by_rows = model.wide_gradient_by_rows(&mixing, &first, rule, of);
                let (_, by_rows) = by_rows.unwrap();
                let size = exact
                    .iter()
                    .flat_map(|leg| leg.angles)
                    .fold(0.0_f64, |m, a| m.max(a.abs()));
                for (k, leg) in exact.iter().enumerate() {
                    for axis in 0..3 {
                        let f = |by: f64| {
                            let mut changed = timelines[0].clone();
                            let mut deg = changed[k].position.degrees();
                            deg[axis] += by;
                            changed[k].position = Position::from_deg(deg[0], deg[1], deg[2]);
                            value(&timeline(platform, &changed))
                        };
                        let h = 0.05;
                        let numeric = (45.0 * (f(h) - f(-h)) - 9.0 * (f(2.0 * h) - f(-2.0 * h))
                            + (f(3.0 * h) - f(-3.0 * h)))
                            / (60.0 * h);
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
                    timelines.iter().map(|p| timeline(platform, p)).collect();
                let together = model.wide_gradients(&mixing, &timelines, rule, of);
                for (timeline, found) in timelines.iter().zip(together) {
                    let alone: (f64, Vec<LegGradient>) =
                        model.wide_gradient(&mixing, timeline, rule, of).unwrap();
                    assert_eq!(found.unwrap(), alone);
                }
            }
        }
    }
}
