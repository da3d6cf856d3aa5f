use super::*;
use crate::attitude::Position;
use crate::criterion::Smoothing;
use crate::drift::DriftCoefficient;
use crate::error::Error;
use crate::motion::Test;
use crate::observability::Order;
use crate::platform::{AxisValue, GSensitivePrior, OutputAxis, PlatformConfig};
use crate::schedule::ScheduledPosition;

fn schedule() -> Schedule {
    let positions = [
        ([10.0, 20.0, 30.0], 604.0),
        ([-80.0, 65.0, 140.0], 1300.0),
        ([150.0, -40.0, -75.0], 955.0),
        ([35.0, 110.0, 5.0], 777.0),
    ];
    let held = positions
        .map(|([a, b, c], dwell_s)| ScheduledPosition::new(Position::from_deg(a, b, c), dwell_s));
    Schedule::new(held.into()).unwrap()
}

fn evaluator(slews: bool) -> Evaluator {
    let mut config = PlatformConfig::default();
    if slews {
        config.motion.slew_rate_deg_per_s = Some(0.7.into());
        config.motion.measure_moves = true;
    }
    Evaluator::new(config.check().unwrap(), Objective::default())
}

fn refused(instrument: Instrument) -> Error {
    let found = evaluator(false).judged_on(instrument).evaluate(&schedule());
    let error = found.unwrap_err();
    assert!(error.is_disagreement(), "{error}");
    assert!(
        evaluator(true)
            .judged_on(instrument)
            .evaluate(&schedule())
            .unwrap_err()
            .is_disagreement()
    );
    error
}

#[test]
fn a_fault_planted_in_the_filter_is_refused_by_name() {
    let named = |error: &Error| {
        let all = DriftCoefficient::ALL.map(DriftCoefficient::name);
        let psi = MISALIGNMENT_NAMES;
        let mut names = all.iter().chain(&psi);
        assert!(names.any(|n| error.to_string().contains(n)), "{error}");
    };
    for gyro in 0..3 {
        // A wrong axis: input and output exchanged, or the spin axis along the input axis.
        let mut wrong = Instrument::PAPER;
        wrong.axes[gyro].swap(0, 1);
        named(&refused(wrong));
        let mut wrong = Instrument::PAPER;
        wrong.axes[gyro][2] = wrong.axes[gyro][0];
        named(&refused(wrong));
        // The sign of one coefficient: σ does not know it, correlations do.
        for kind in 0..3 {
            let mut wrong = Instrument::PAPER;
            wrong.axes[gyro][kind] = wrong.axes[gyro][kind].map(|v| -v);
            let error = refused(wrong).to_string();
            let coefficient = DriftCoefficient::ALL[3 * (1 + kind) + gyro].name();
            assert!(error.contains(coefficient), "{coefficient}: {error}");
        }
    }
    // The order of the turns.
    named(&refused(Instrument {
        gimbals: [[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]],
        ..Instrument::PAPER
    }));
    // The sense of an angle.
    for axis in 0..3 {
        let mut wrong = Instrument::PAPER;
        wrong.gimbals[axis] = wrong.gimbals[axis].map(|v| -v);
        named(&refused(wrong));
    }
    // A measurement at the end of a rest that is shorter than a period.
    named(&refused(Instrument {
        split: |duration_s, period_s| ((duration_s / period_s).ceil() as usize, 0.0),
        ..Instrument::PAPER
    }));
    // A period too few.
    named(&refused(Instrument {
        split: |duration_s, period_s| {
            let periods = ((duration_s / period_s) as usize).saturating_sub(1);
            (periods, duration_s - periods as f64 * period_s)
        },
        ..Instrument::PAPER
    }));
}

#[test]
fn a_fault_is_not_taken_for_lost_digits_nor_hidden_by_them() {
    for sigma in [1e2, 1e6, 1e10] {
        let mut config = PlatformConfig::default();
        config.prior.constant_drift_deg_per_h = AxisValue::All(sigma);
        config.prior.g_sensitive_drift_deg_per_h_per_g =
            GSensitivePrior::All(AxisValue::All(sigma));
        let evaluator = || Evaluator::new(config.check().unwrap(), Objective::default());
        let right = evaluator().evaluate(&schedule()).unwrap();
        assert_eq!(
            right.precision == Precision::Extended,
            sigma > 1e5,
            "{sigma:e}"
        );
        let mut wrong = Instrument::PAPER;
        wrong.axes[1].swap(0, 1);
        let found = evaluator().judged_on(wrong).evaluate(&schedule());
        assert!(found.unwrap_err().is_disagreement(), "{sigma:e}");
    }
}

/// A platform with every group, D_OO among them, half of a quadratic group known only in part.
fn full() -> PlatformConfig {
    let mut config = PlatformConfig::default();
    let errors = &mut config.errors.estimated;
    let all = |sigma: f64| Some(AxisValue::All(sigma));
    errors.torquer_scale_factor_ppm = all(1000.0);
    errors.torquer_misalignment_arcsec = all(60.0);
    errors.quadratic_drift_deg_per_h_per_g2 = all(0.1);
    errors.quadratic_output_drift_deg_per_h_per_g2 = all(0.1);
    errors.accelerometer_bias_ug = all(100.0);
    errors.accelerometer_scale_factor_ppm = all(200.0);
    errors.local_gravity_ug = Some(10.0);
    config
}

#[test]
fn what_cannot_be_told_apart_has_no_order_and_is_computed_all_the_same() {
    // Enough positions for all but what no schedule can tell.
    let mut random = 0.37_f64;
    let mut angle = || {
        random = (random * 997.0 + 0.123).fract();
        360.0 * random - 180.0
    };
    let held = (0..24)
        .map(|_| ScheduledPosition::new(Position::from_deg(angle(), angle(), angle()), 600.0));
    let schedule = Schedule::new(held.collect()).unwrap();
    let evaluator = Evaluator::new(full().check().unwrap(), Objective::default());
    let evaluation = evaluator.evaluate(&schedule).unwrap();
    let of = |name: &str| {
        let mut all = evaluation.parameters.iter();
        all.find(|p| p.parameter.name == name).unwrap()
    };
    // K_1X + K_1Y + K_1Z against G; D_F against D_II + D_OO + D_SS.
    for name in ["K_1X", "K_1Z", "G", "D_FX", "D_IIY", "D_SSZ", "D_OOX"] {
        assert_eq!(of(name).separability, Some(0.0), "{name}");
        assert!(of(name).sigma > 0.0 && of(name).sigma.is_finite());
    }
    for name in ["K_1Y", "G", "D_OOX"] {
        assert_eq!(of(name).order, None, "{name}");
    }
    for (name, order) in [
        ("K_0Y", Order::Zero),
        ("T_XX", Order::Zero),
        ("T_ZY", Order::Zero),
        ("D_OSX", Order::First),
        ("D_IX", Order::Second),
        // The larger trace theorem: D_IIX − D_ISY + D_IOZ is vertical at every attitude.
        ("D_IOZ", Order::Second),
    ] {
        assert_eq!(of(name).order, Some(order), "{name}");
        let separability = of(name).separability.unwrap();
        assert!(separability > 0.0 && separability <= 1.0, "{name}");
    }
    assert!(evaluation.agreement < 1e-9);
    assert_eq!(evaluation.budget.len(), 7);
}

#[test]
fn an_interrupted_test_of_a_full_platform_is_the_whole() {
    let mut config = full();
    config.motion.slew_rate_deg_per_s = Some(0.8.into());
    config.motion.settle_s = 20.0;
    config
        .errors
        .considered
        .parameter
        .insert("M_ZX".to_owned(), 40.0);
    let platform = config.check().unwrap();
    let all = schedule();
    let (done, rest) = all.positions().split_at(2);
    let part = |positions: &[ScheduledPosition]| Schedule::new(positions.to_vec()).unwrap();
    let whole = Evaluator::new(platform.clone(), Objective::default());
    let whole = whole.evaluate(&all).unwrap();
    let interrupted = Test::from(platform).interrupted_after(part(done)).unwrap();
    let found = Evaluator::new(interrupted, Objective::default());
    let found = found.evaluate(&part(rest)).unwrap();
    assert_eq!(found.end, whole.end);
    assert_eq!(found.parameters, whole.parameters);
    assert_eq!(found.budget, whole.budget);
    assert!(
        whole
            .parameters
            .iter()
            .all(|p| p.claimed_sigma.is_some_and(|c| c <= p.sigma) || p.parameter.name == "M_ZX")
    );
}

#[test]
fn a_fault_planted_in_the_filter_is_found_in_a_full_model_too() {
    let evaluator = || {
        let mut config = full();
        config.gyro.output_axis.x = Some(OutputAxis::Named("+y".to_owned()));
        config.motion.slew_rate_deg_per_s = Some(0.8.into());
        Evaluator::new(config.check().unwrap(), Objective::default())
    };
    assert!(evaluator().evaluate(&schedule()).unwrap().agreement < 1e-7);
    // The paper's mounting, and the turns of the gimbals in another order.
    let wrong = Instrument {
        gimbals: [[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]],
        ..Instrument::of(evaluator().test().platform())
    };
    for wrong in [Instrument::PAPER, wrong] {
        let found = evaluator().judged_on(wrong).evaluate(&schedule());
        assert!(found.unwrap_err().is_disagreement());
    }
}

/// Of the average of ln(criterion) over the test: what it is, and its derivatives.
#[test]
fn early_convergence_has_a_value_and_a_gradient() {
    let mut config = PlatformConfig::default();
    config.motion.slew_rate_deg_per_s = Some(0.7.into());
    config.motion.settle_s = 20.0;
    let platform = config.check().unwrap();
    let with = |convergence_weight| {
        let objective = Objective {
            convergence_weight,
            ..Objective::default()
        };
        Evaluator::new(platform.clone(), objective)
    };
    let (plain, early) = (with(0.0), with(0.5));
    let timeline = Timeline::new(&platform.clone().into(), &schedule()).unwrap();
    let logs: Vec<(f64, f64)> = (1..=timeline.legs().len())
        .map(|end| {
            let prefix = timeline.only(0..end);
            let value = plain.end_with_criterion(&prefix).unwrap().1;
            (prefix.total_time_s(), value.ln())
        })
        .collect();
    // RMS of the priors: 15 °/h for three, 8 °/h for nine.
    let mut before = (0.0, ((3.0 * 225.0 + 9.0 * 64.0) / 12.0_f64).sqrt().ln());
    let mut area = 0.0;
    for end in logs {
        area += (end.0 - before.0) * 0.5 * (before.1 + end.1);
        before = end;
    }
    let expected = 0.5 * area / timeline.total_time_s();
    let score = early.evaluate(&schedule()).unwrap().score;
    assert!((score.convergence_part - expected).abs() < 1e-9);
    let parts = score.covariance_part + score.separability_part + score.convergence_part;
    assert_eq!(score.value, parts);

    let smoothing = Smoothing::Exact;
    let merit = |positions: &[ScheduledPosition]| {
        let timeline = Timeline::unchecked(&platform.clone().into(), positions.iter().copied());
        early.merit(&timeline, smoothing).unwrap()
    };
    // Moves whose time is given, so that it does not follow from the angles.
    let positions: Vec<ScheduledPosition> = (schedule().positions().iter().enumerate())
        .map(|(k, p)| ScheduledPosition {
            move_s: (k > 0).then_some(321.0 + 10.0 * k as f64),
            dwell_s: p.dwell_s + 2.0,
            ..*p
        })
        .collect();
    let timeline = Timeline::unchecked(&platform.clone().into(), positions.iter().copied());
    let (value, gradient) = early.merit_gradient(&timeline, smoothing).unwrap();
    assert!((value - merit(&positions)).abs() < 1e-10);
    let slope = |h: f64, change: &dyn Fn(&mut [ScheduledPosition], f64)| {
        let at = |by: f64| {
            let mut changed = positions.clone();
            change(&mut changed, by);
            merit(&changed)
        };
        (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h)
    };
    for (k, leg) in gradient.iter().enumerate() {
        for axis in 0..3 {
            let numeric = slope(0.02, &|p, by| {
                let mut deg = p[k].position.degrees();
                deg[axis] += by;
                p[k].position = Position::from_deg(deg[0], deg[1], deg[2]);
            });
            let error = numeric.to_degrees() - leg.angles[axis];
            assert!(error.abs() < 1e-6, "{k} {axis}: {error:e}");
        }
        let error = slope(0.2, &|p, by| p[k].dwell_s += by) - leg.dwell_s;
        assert!(error.abs() < 1e-8, "{k} dwell: {error:e}");
        if k > 0 {
            let numeric = slope(0.2, &|p, by| p[k].move_s = p[k].move_s.map(|s| s + by));
            let error = numeric - leg.move_s;
            assert!(error.abs() < 1e-8, "{k} move: {error:e}");
        }
    }
}

/// On a stand with other axes, turned and tilted: what it takes for the axes and the base is its own.
#[test]
fn a_stand_taken_wrongly_by_the_filter_is_refused() {
    let config: PlatformConfig = toml::from_str(
        "[gimbals]\naxes = [\"+z\", \"-x\", \"+z\"]\n\
         [stand]\nheading_deg = 25.0\ntilt_deg = [3.0, -7.0]\n\
         [motion]\nslew_rate_deg_per_s = 0.7\nmeasure_moves = true\n",
    )
    .unwrap();
    let platform = config.check().unwrap();
    let evaluator = || Evaluator::new(platform.clone(), Objective::default());
    let right = Instrument::of(&platform);
    let agreement = evaluator().evaluate(&schedule()).unwrap().agreement;
    assert!(agreement < 1e-9, "{agreement:e}");
    let mut wrong = vec![right; 6];
    for axis in 0..3 {
        wrong[axis].gimbals[axis] = right.gimbals[axis].map(|v| -v);
        wrong[3 + axis].base[axis] = -right.base[axis];
    }
    for instrument in wrong {
        let found = evaluator().judged_on(instrument).evaluate(&schedule());
        assert!(found.unwrap_err().is_disagreement(), "{instrument:?}");
    }
}
