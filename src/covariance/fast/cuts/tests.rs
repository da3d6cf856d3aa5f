use super::*;
use crate::attitude::Position;
use crate::covariance::CovarianceRoot;
use crate::covariance::chain::{Gram, NoRecord};
use crate::criterion::{Criterion, Smoothing};
use crate::drift::drift_matrix;
use crate::motion::Timeline;
use crate::platform::{AxisValue, GSensitivePrior, Platform, PlatformConfig, Repositioning};
use crate::schedule::ScheduledPosition;

/// Platforms with every kind of step, and a schedule of uneven dwells.
fn platforms() -> Vec<Platform> {
    let changes: [fn(&mut PlatformConfig); 8] = [
        |_| {},
        |c| {
            c.motion.slew_rate_deg_per_s = Some(0.5.into());
            c.motion.settle_s = 13.0;
        },
        |c| {
            c.motion.slew_rate_deg_per_s = Some(1.0.into());
            c.motion.measure_moves = true;
        },
        |c| {
            c.motion.slew_rate_deg_per_s = Some(AxisValue::PerAxis([0.5, 1.0, 2.0]));
            c.motion.acceleration_deg_per_s2 = Some(AxisValue::PerAxis([0.02, 0.1, 0.03]));
        },
        |c| {
            c.motion.slew_rate_deg_per_s = Some(1.0.into());
            c.motion.acceleration_deg_per_s2 = Some(0.04.into());
            c.motion.measure_moves = true;
        },
        |c| c.motion.repositioning = Repositioning::FrameHold,
        |c| {
            c.motion.slew_rate_deg_per_s = Some(2.0.into());
            c.motion.start_deg = Some([0.0; 3]);
            c.motion.return_to_start = true;
        },
        |c| {
            c.site.latitude_deg = 90.0;
            c.gyro.random_drift_deg_per_h = Some(0.0);
        },
    ];
    changes
        .map(|change| {
            let mut config = PlatformConfig::default();
            // Little more than the tests tell, so that differences keep their digits.
            config.prior.constant_drift_deg_per_h = AxisValue::All(0.1);
            config.prior.g_sensitive_drift_deg_per_h_per_g =
                GSensitivePrior::All(AxisValue::All(0.1));
            change(&mut config);
            config.check().unwrap()
        })
        .to_vec()
}

fn positions() -> Vec<ScheduledPosition> {
    (0..7)
        .map(|k| {
            let k = f64::from(k);
            let angles = [1.3 * k - 2.0, (0.9 * k).sin() * 2.0, 1.0 - 0.7 * k * k];
            ScheduledPosition::new(Position::from_array(angles), 130.0 + 37.0 * k)
        })
        .collect()
}

fn timeline(platform: &Platform, positions: &[ScheduledPosition]) -> Timeline {
    Timeline::unchecked(&platform.clone().into(), positions.iter().copied())
}

fn information(model: &CovarianceModel, timeline: &Timeline, rule: TickRule) -> CoefficientMatrix {
    let mut gram = Gram(CoefficientMatrix::zeros());
    model.run(timeline, rule, &mut gram, &mut NoRecord);
    gram.0
}

#[track_caller]
fn assert_same(found: &CoefficientMatrix, expected: &CoefficientMatrix) {
    let error = (found - expected).amax() / expected.amax();
    assert!(error < 1e-11, "{error:e}");
}

#[test]
fn changing_a_position_gives_what_the_whole_run_gives() {
    // Every entry of P_D counts.
    let weights = CoefficientMatrix::from_fn(|i, j| match i == j {
        true => 1.0 + i as f64,
        false => 0.3 * ((i + j) as f64).sin(),
    });
    for platform in platforms() {
        let model = CovarianceModel::new(&platform);
        for rule in [TickRule::Filter, TickRule::Relaxed] {
            let before = timeline(&platform, &positions());
            let cuts = Cuts::new(&model, &before, rule);
            let known = cuts.after_dwell.last().unwrap().1;
            assert_same(&known.gram, &information(&model, &before, rule));
            // The same as rows, in units of the prior σ.
            let sigma = CoefficientMatrix::from_diagonal(&model.prior_sigma);
            let scaled = sigma * known.gram * sigma;
            assert_same(&(known.triangle.transpose() * known.triangle), &scaled);
            let offset = before.positions().start;
            for k in 0..positions().len() {
                let changed = ScheduledPosition::new(Position::from_deg(33.0, -50.0, 120.0), 211.0);
                // Exchanged, removed, inserted.
                let mut exchanged = positions();
                exchanged[k] = changed;
                let mut removed = positions();
                removed.remove(k);
                let mut inserted = positions();
                inserted.insert(k, changed);
                for (after, replaced, new) in [
                    (exchanged, k..k + 1, 1),
                    (removed, k..k + 1, 0),
                    (inserted, k..k, 1),
                ] {
                    let after = timeline(&platform, &after);
                    let first = offset + k;
                    let around = cuts.around(replaced.start + offset..replaced.end + offset);
                    let part = after.part(first..first + new);
                    let figure = |p: &dyn CoefficientCovariance| Ok(p.matrix().dot(&weights));
                    let found = model.values_between(&[part], rule, &around, figure);
                    let found = *found[0].as_ref().unwrap();
                    let part = after.part(first..first + new);
                    let by_rows = Rooted::new(around.root(&model, &part, rule).unwrap());
                    let by_rows = by_rows.matrix().dot(&weights);
                    let expected = model.end_covariance(&after, rule).unwrap();
                    let expected = expected.coefficients.dot(&weights);
                    assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
                    let error = (by_rows / expected - 1.0).abs();
                    assert!(error < 1e-9, "{by_rows} {expected}");
                }
            }
        }
    }
}

/// All information on D with a state and information before the cut.
fn joined(rest: &Rest, state: &State, before: &CoefficientMatrix) -> CoefficientMatrix {
    let mut gram = Gram(before + rest.information);
    let t = rest.psi * state.v + rest.drift;
    gram.add(&(whitener(&(rest.psi * square_root(&state.p))) * t));
    gram.0
}

#[test]
fn insertion_is_the_derivative_with_respect_to_time_spent() {
    for platform in platforms() {
        // A dwell in frame-hold turns ψ about, however short.
        if platform.motion().repositioning == Repositioning::FrameHold {
            continue;
        }
        let model = CovarianceModel::new(&platform);
        let before = timeline(&platform, &positions());
        let rule = TickRule::Relaxed;
        let criterion = Criterion::rms();
        let merit = |e: &CoefficientMatrix| {
            let prior = model.prior_sigma.map(|s| 1.0 / (s * s));
            let p = (e + CoefficientMatrix::from_diagonal(&prior)).cholesky();
            // L Lᵀ = E gives P = L⁻ᵀ L⁻¹, L⁻ᵀ an upper triangle.
            let root = p.unwrap().l().try_inverse().unwrap().transpose();
            let p = Rooted::new(CovarianceRoot::new(root, std::array::from_fn(|i| i)));
            criterion.log(&p, Smoothing::Exact).unwrap()
        };
        let cuts = Cuts::new(&model, &before, rule);
        let offset = before.positions().start;
        for k in 0..=positions().len() {
            let position = Position::from_deg(33.0, -50.0, 120.0);
            let slope =
                |p: &dyn CoefficientCovariance| criterion.log_with_gradient(p, Smoothing::Exact);
            let insertion = cuts.insertion(offset + k, slope).unwrap();
            let exact = insertion.at(&drift_matrix(&position.attitude()));
            // The dwell alone, at the cut, without moves there and back.
            let value = |dwell_s: f64| {
                let state = match cuts.before_dwell.get(offset + k) {
                    Some(before) => *before,
                    None => cuts.after_dwell[offset + k - 1],
                };
                let mut gram = Gram(state.1.gram);
                let held = ScheduledPosition::new(position, dwell_s);
                let legs = timeline(&platform, &[held]);
                let leg = legs.position_legs()[0];
                let after = model.dwell(state.0, &leg, rule, &mut gram);
                let rest = cuts.rest.get(offset + k).copied();
                let rest = rest.unwrap_or_else(Rest::nothing);
                merit(&joined(&rest, &after, &gram.0))
            };
            let h = 0.03;
            let numeric =
                (4.0 * (value(h) - value(0.0)) - (value(2.0 * h) - value(0.0))) / (2.0 * h);
            let scale = exact.abs().max(1e-4);
            assert!(
                (numeric - exact).abs() < 1e-4 * scale,
                "{k}: {numeric:e} {exact:e}"
            );
        }
    }
}
