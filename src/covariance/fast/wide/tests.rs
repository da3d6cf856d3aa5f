use nalgebra::DMatrix;

use super::super::mixing::{Kind, Mixing, Parameter, Parameters};
use super::{How, Wanted};
use crate::attitude::Position;
use crate::covariance::gradient::LegGradient;
use crate::covariance::{CovarianceModel, TickRule, WideCovariance, WideSlope};
use crate::criterion::{Criterion, Smoothing};
use crate::drift::{COEFFICIENTS, DriftCoefficient};
use crate::error::Result;
use crate::motion::Timeline;
use crate::platform::{AxisValue, GSensitivePrior, Platform, PlatformConfig, Repositioning};
use crate::schedule::ScheduledPosition;

mod dense;
mod names;
mod reference;
mod weights;

use dense::Dense;
use names::{PAPER, group, parameter};

/// A small generator of its own: the same cases for ever.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
}

const TORQUERS: [(&str, f64); 2] = [
    ("torquer_scale_factor_ppm", 1000.0),
    ("torquer_misalignment_arcsec", 60.0),
];
const ACCELEROMETERS: [(&str, f64); 4] = [
    ("accelerometer_bias_ug", 100.0),
    ("accelerometer_scale_factor_ppm", 200.0),
    ("accelerometer_misalignment_arcsec", 60.0),
    ("accelerometer_second_order_ug_per_g2", 20.0),
];
const OTHERS: [(&str, f64); 4] = [
    ("quadratic_drift_deg_per_h_per_g2", 0.1),
    ("accelerometer_third_order_ug_per_g3", 5.0),
    ("accelerometer_cross_coupling_ug_per_g2", 20.0),
    ("local_gravity_ug", 10.0),
];

/// The output axes of another mounting, one of them between the axes.
const OBLIQUE: [[f64; 3]; 3] = [[0.0, 0.6, -0.8], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]];

/// Groups that are estimated and groups that are considered, and what shape they take.
struct Selection {
    kind: Kind,
    estimated: Vec<(&'static str, f64)>,
    considered: Vec<(&'static str, f64)>,
    output: [[f64; 3]; 3],
}

fn selections() -> Vec<Selection> {
    let all = |groups: &[&[(&'static str, f64)]]| groups.concat();
    vec![
        Selection {
            kind: Kind::Torquers,
            estimated: TORQUERS.to_vec(),
            considered: vec![],
            output: PAPER,
        },
        Selection {
            kind: Kind::Instruments,
            estimated: all(&[&TORQUERS, &ACCELEROMETERS]),
            considered: vec![],
            output: OBLIQUE,
        },
        Selection {
            kind: Kind::Instruments,
            estimated: TORQUERS.to_vec(),
            considered: ACCELEROMETERS.to_vec(),
            output: PAPER,
        },
        Selection {
            kind: Kind::Catalogue,
            estimated: all(&[&TORQUERS, &ACCELEROMETERS, &OTHERS]),
            considered: vec![],
            output: OBLIQUE,
        },
        Selection {
            kind: Kind::Catalogue,
            estimated: all(&[&ACCELEROMETERS[..2], &OTHERS[..2]]),
            considered: all(&[&TORQUERS, &OTHERS[2..]]),
            output: PAPER,
        },
    ]
}

fn named(groups: &[(&str, f64)], output: &[[f64; 3]; 3]) -> Vec<Parameter> {
    let each = |(key, sigma): &(&str, f64)| {
        let sigma = *sigma;
        let names = group(key).into_iter();
        names.map(move |name| parameter(&name, output, sigma))
    };
    groups.iter().flat_map(each).collect()
}

fn parameters(selection: &Selection, platform: &Platform) -> Parameters {
    let model = CovarianceModel::new(platform);
    let sigma = *model.prior_sigma_deg_per_h();
    Parameters {
        coefficients: DriftCoefficient::ALL
            .map(|c| parameter(c.name(), &selection.output, sigma[c.index()])),
        weighted: Vec::new(),
        estimated: named(&selection.estimated, &selection.output),
        considered: named(&selection.considered, &selection.output),
    }
}

/// Platforms with every kind of step.
fn platforms() -> Vec<Platform> {
    let changes: [fn(&mut PlatformConfig); 5] = [
        |_| {},
        |c| {
            c.motion.slew_rate_deg_per_s = Some(0.5);
            c.motion.settle_s = 13.0;
        },
        |c| {
            c.motion.slew_rate_deg_per_s = Some(1.0);
            c.motion.measure_moves = true;
        },
        |c| {
            c.motion.repositioning = Repositioning::FrameHold;
            c.motion.settle_s = 7.0;
        },
        |c| {
            c.motion.slew_rate_deg_per_s = Some(2.0);
            c.motion.start_deg = Some([5.0, 10.0, -20.0]);
            c.motion.return_to_start = true;
        },
    ];
    changes
        .map(|change| {
            let mut config = PlatformConfig::default();
            // Little more than the tests tell, so that the dense filter keeps its digits.
            config.prior.constant_drift_deg_per_h = AxisValue::All(0.1);
            config.prior.g_sensitive_drift_deg_per_h_per_g =
                GSensitivePrior::All(AxisValue::All(0.1));
            change(&mut config);
            config.check().unwrap()
        })
        .to_vec()
}

/// Uneven dwells, the time of some moves given.
fn positions(random: &mut Random, platform: &Platform, count: usize) -> Vec<ScheduledPosition> {
    let moves = platform.motion().repositioning == Repositioning::Slew;
    let first = usize::from(platform.motion().start.is_none());
    (0..count)
        .map(|k| {
            let position = Position::from_deg(
                random.between(-170.0, 170.0),
                random.between(-80.0, 80.0),
                random.between(-170.0, 170.0),
            );
            let dwell_s = random.between(80.0, 330.0);
            ScheduledPosition {
                // Durations that do not follow the angles, so that derivatives are partial.
                move_s: (moves && k >= first).then(|| random.between(100.0, 400.0)),
                ..ScheduledPosition::new(position, dwell_s)
            }
        })
        .collect()
}

fn timeline(platform: &Platform, positions: &[ScheduledPosition]) -> Timeline {
    Timeline::unchecked(platform, positions.iter().copied())
}

/// 1σ of what is estimated, the filter's and the true one, and the filter's covariance of ψ, by the
/// dense filter. Of one that estimates the considered parameters too, P_ec P_cc⁻¹ is what an error
/// of theirs does to the estimates of the other, whatever their priors.
fn dense_sigma(
    platform: &Platform,
    parameters: &Parameters,
    timeline: &Timeline,
    rule: TickRule,
) -> (Vec<f64>, Vec<f64>, DMatrix<f64>) {
    let known = parameters.estimated.len() + COEFFICIENTS;
    let own: Vec<&Parameter> = (parameters.estimated.iter())
        .chain(&parameters.coefficients)
        .collect();
    let claimed = Dense::run(platform, &own, timeline, rule);
    let variances = claimed.diagonal().rows(3, known).into_owned();
    let mut truth = variances.clone();
    if !parameters.considered.is_empty() {
        let all: Vec<&Parameter> = own.into_iter().chain(&parameters.considered).collect();
        let with = Dense::run(platform, &all, timeline, rule);
        let count = parameters.considered.len();
        let of_considered = with
            .view((3 + known, 3 + known), (count, count))
            .into_owned();
        let cross = with.view((3 + known, 3), (count, known)).into_owned();
        let biased = of_considered.cholesky().unwrap().solve(&cross);
        for (c, p) in parameters.considered.iter().enumerate() {
            for i in 0..known {
                truth[i] += (biased[(c, i)] * p.prior_sigma).powi(2);
            }
        }
    }
    let roots = |v: &nalgebra::DVector<f64>| v.iter().map(|v| v.sqrt()).collect();
    (
        roots(&variances),
        roots(&truth),
        claimed.view((0, 0), (3, 3)).into_owned(),
    )
}

fn worst(found: &[f64], expected: &[f64]) -> f64 {
    assert_eq!(found.len(), expected.len());
    let pairs = found.iter().zip(expected);
    pairs.map(|(f, e)| (f / e - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn selections_take_the_smallest_shape() {
    let platform = &platforms()[0];
    for selection in selections() {
        let mixing = Mixing::new(&parameters(&selection, platform)).unwrap();
        assert_eq!(mixing.kind, selection.kind);
    }
}

#[test]
fn the_end_is_that_of_a_dense_filter() {
    let mut random = Random(7);
    for (p, platform) in platforms().iter().enumerate() {
        let model = CovarianceModel::new(platform);
        for (s, selection) in selections().iter().enumerate() {
            let parameters = parameters(selection, platform);
            let mixing = Mixing::new(&parameters).unwrap();
            let timeline = timeline(platform, &positions(&mut random, platform, 7));
            let rule = [TickRule::Filter, TickRule::Relaxed][(p + s) % 2];
            let end = model.wide_end(&mixing, &timeline, rule).unwrap();
            let (claimed, sigma, psi) = dense_sigma(platform, &parameters, &timeline, rule);
            let error = worst(&end.claimed_sigma, &claimed);
            assert!(
                error < 1e-9,
                "platform {p}, selection {s}: claimed {error:e}"
            );
            let error = worst(&end.sigma, &sigma);
            assert!(error < 1e-9, "platform {p}, selection {s}: {error:e}");
            let error = (end.misalignment - psi.fixed_view::<3, 3>(0, 0)).amax() / psi.amax();
            assert!(error < 1e-9, "platform {p}, selection {s}: psi {error:e}");
            let rms = model
                .wide_value(&mixing, &timeline, rule, |p| Criterion::rms().value(p))
                .unwrap();
            let of = &end.sigma[end.sigma.len() - COEFFICIENTS..];
            let expected = (of.iter().map(|s| s * s).sum::<f64>() / 12.0).sqrt();
            assert!((rms / expected - 1.0).abs() < 1e-11);
        }
    }
}

#[test]
fn gradients_are_finite_differences() {
    let mut random = Random(11);
    for (p, platform) in platforms().iter().enumerate() {
        let model = CovarianceModel::new(platform);
        for (s, selection) in selections().iter().enumerate() {
            let mixing = Mixing::new(&parameters(selection, platform)).unwrap();
            let positions = positions(&mut random, platform, 5);
            let rule = TickRule::Relaxed;
            let criterion = if (p + s) % 2 == 0 {
                Criterion::rms()
            } else {
                Criterion::D
            };
            let at = |positions: &[ScheduledPosition]| {
                let timeline = timeline(platform, positions);
                model
                    .wide_value(&mixing, &timeline, rule, |p| {
                        criterion.log(p, Smoothing::Exact)
                    })
                    .unwrap()
            };
            let before = timeline(platform, &positions);
            let (value, gradient) = model
                .wide_gradient(&mixing, &before, rule, |p| {
                    criterion.log_with_gradient(p, Smoothing::Exact)
                })
                .unwrap();
            assert!((value - at(&positions)).abs() < 1e-11);
            let first = before.positions().start;
            let returns = before.legs().len() > before.positions().end;
            let slope = |h: f64, change: &dyn Fn(&mut [ScheduledPosition], f64)| {
                let f = |by: f64| {
                    let mut changed = positions.clone();
                    change(&mut changed, by);
                    at(&changed)
                };
                (45.0 * (f(h) - f(-h)) - 9.0 * (f(2.0 * h) - f(-2.0 * h))
                    + (f(3.0 * h) - f(-3.0 * h)))
                    / (60.0 * h)
            };
            let mut size = 0.0_f64;
            let mut errors = Vec::new();
            for k in 0..positions.len() {
                let leg = &gradient[first + k];
                // The way back takes as long as its angles say.
                if !(returns && k + 1 == positions.len()) {
                    for axis in 0..3 {
                        let numeric = slope(0.05, &|p, by| {
                            let mut deg = p[k].position.degrees();
                            deg[axis] += by;
                            p[k].position = Position::from_deg(deg[0], deg[1], deg[2]);
                        });
                        let exact = leg.angles[axis].to_radians();
                        size = size.max(exact.abs());
                        errors.push((numeric - exact, format!("{k} axis {axis}")));
                    }
                }
                let rest = positions[k].dwell_s % platform.period_s();
                if (0.5..9.5).contains(&rest) {
                    let numeric = slope(0.1, &|p, by| p[k].dwell_s += by);
                    size = size.max(leg.dwell_s.abs());
                    errors.push((numeric - leg.dwell_s, format!("{k} dwell")));
                }
                if let Some(move_s) = positions[k].move_s
                    && (0.5..9.5).contains(&(move_s % platform.period_s()))
                {
                    let numeric = slope(0.1, &|p, by| p[k].move_s = Some(move_s + by));
                    size = size.max(leg.move_s.abs());
                    errors.push((numeric - leg.move_s, format!("{k} move")));
                }
            }
            for (error, of) in errors {
                assert!(
                    error.abs() < 1e-7 * size,
                    "platform {p}, selection {s}, {of}: {error:e} of {size:e}"
                );
            }
        }
    }
}

/// Moves that take no time: the torquers' errors turn into a jump of ψ.
#[test]
fn moves_without_duration_count_for_torquers() {
    let mut random = Random(23);
    let platform = &platforms()[0];
    let model = CovarianceModel::new(platform);
    for selection in selections() {
        let parameters = parameters(&selection, platform);
        let mixing = Mixing::new(&parameters).unwrap();
        let mut positions = positions(&mut random, platform, 8);
        for p in &mut positions {
            p.move_s = None;
        }
        let before = timeline(platform, &positions);
        let rule = TickRule::Relaxed;
        let end = model.wide_end(&mixing, &before, rule).unwrap();
        let (claimed, ..) = dense_sigma(platform, &parameters, &before, rule);
        assert!(worst(&end.claimed_sigma, &claimed) < 1e-9);
        let log = |p: &dyn WideCovariance| Criterion::rms().log(p, Smoothing::Exact);
        let at = |positions: &[ScheduledPosition]| {
            let timeline = timeline(platform, positions);
            model.wide_value(&mixing, &timeline, rule, log).unwrap()
        };
        let (_, gradient) = model
            .wide_gradient(&mixing, &before, rule, |p| {
                Criterion::rms().log_with_gradient(p, Smoothing::Exact)
            })
            .unwrap();
        let size = gradient
            .iter()
            .flat_map(|leg| leg.angles)
            .fold(0.0_f64, |m, a| m.max(a.abs()));
        for (k, leg) in gradient.iter().enumerate() {
            assert_eq!(leg.move_s, 0.0);
            for axis in 0..3 {
                let f = |by: f64| {
                    let mut changed = positions.clone();
                    let mut deg = changed[k].position.degrees();
                    deg[axis] += by;
                    changed[k].position = Position::from_deg(deg[0], deg[1], deg[2]);
                    at(&changed)
                };
                let h = 0.05;
                let numeric = (45.0 * (f(h) - f(-h)) - 9.0 * (f(2.0 * h) - f(-2.0 * h))
                    + (f(3.0 * h) - f(-3.0 * h)))
                    / (60.0 * h);
                let error = (numeric.to_degrees() - leg.angles[axis]).abs();
                assert!(error < 1e-7 * size, "{k} {axis}: {error:e} of {size:e}");
            }
        }
    }
}

/// The rows that the chain tells, triangularised, are what takes over where sums of squares lose
/// digits: the same numbers where they do not.
#[test]
fn rows_and_sums_of_squares_agree() {
    let mut random = Random(41);
    for (p, platform) in platforms().iter().enumerate() {
        let model = CovarianceModel::new(platform);
        for (s, selection) in selections().iter().enumerate() {
            let mixing = Mixing::new(&parameters(selection, platform)).unwrap();
            let timeline = timeline(platform, &positions(&mut random, platform, 6));
            for criterion in [Criterion::rms(), Criterion::D] {
                let log = |p: &dyn WideCovariance| criterion.log(p, Smoothing::Exact);
                let slope =
                    |p: &dyn WideCovariance| criterion.log_with_gradient(p, Smoothing::Exact);
                let rule = TickRule::Relaxed;
                let value = model.wide_value(&mixing, &timeline, rule, log).unwrap();
                let by_rows = model
                    .wide_value_by_rows(&mixing, &timeline, rule, log)
                    .unwrap();
                assert!(
                    (value - by_rows).abs() < 1e-10,
                    "{p} {s}: {value} {by_rows}"
                );
                let (_, sums) = model
                    .wide_gradient(&mixing, &timeline, rule, slope)
                    .unwrap();
                let (value, rows) = model
                    .wide_gradient_by_rows(&mixing, &timeline, rule, slope)
                    .unwrap();
                assert!((value - by_rows).abs() < 1e-10);
                let all = |leg: &LegGradient| {
                    [&leg.angles[..], &[100.0 * leg.dwell_s, 100.0 * leg.move_s]].concat()
                };
                let (sums, rows): (Vec<f64>, Vec<f64>) = (
                    sums.iter().flat_map(all).collect(),
                    rows.iter().flat_map(all).collect(),
                );
                let size = sums.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
                for (a, b) in sums.iter().zip(&rows) {
                    assert!((a - b).abs() < 1e-8 * size, "{p} {s}: {a} {b} of {size}");
                }
            }
        }
    }
}

/// Whatever shares a group and whatever the lanes: the bits of the schedule alone.
#[test]
fn lanes_have_the_bits_of_single_schedules() {
    let mut random = Random(31);
    for (p, platform) in platforms().iter().enumerate() {
        for (s, selection) in selections().iter().enumerate() {
            let mixing = Mixing::new(&parameters(selection, platform)).unwrap();
            let timelines: Vec<Timeline> = [5, 5, 4, 5, 3, 5, 5, 5, 5, 4, 5]
                .map(|count| timeline(platform, &positions(&mut random, platform, count)))
                .into();
            let criterion = if (p + s) % 2 == 0 {
                Criterion::rms()
            } else {
                Criterion::D
            };
            let slope = |p: &dyn WideCovariance| criterion.log_with_gradient(p, Smoothing::Exact);
            let value = |p: &dyn WideCovariance| criterion.log(p, Smoothing::Exact);
            for rule in [[TickRule::Relaxed, TickRule::Filter][s % 2]] {
                let mut model = CovarianceModel::new(platform);
                let alone = |model: &CovarianceModel, t: &Timeline| {
                    model.wide_gradient(&mixing, t, rule, slope).unwrap()
                };
                let known: Vec<_> = timelines.iter().map(|t| alone(&model, t)).collect();
                let values = |model: &CovarianceModel, of: &[Timeline]| -> Vec<u64> {
                    let all = model.wide_values(&mixing, of, rule, value).into_iter();
                    all.map(|v| v.unwrap().to_bits()).collect()
                };
                let all = values(&model, &timelines);
                for (of, (exact, _)) in all.iter().zip(&known) {
                    assert!((f64::from_bits(*of) - exact).abs() < 1e-10, "{p} {s}");
                }
                for lanes in [1, 4, 8] {
                    model = model.with_most_lanes(lanes);
                    assert_eq!(values(&model, &timelines[2..9]), all[2..9], "{p} {s}");
                    for count in [11, 5] {
                        let of = &timelines[..count];
                        let found = model.wide_gradients(&mixing, of, rule, slope);
                        for (found, known) in found.iter().zip(&known) {
                            assert_eq!(found.as_ref().unwrap(), known, "{p} {s} {lanes} lanes");
                        }
                    }
                }
            }
        }
    }
}

const BY_ROWS: How = How {
    by_rows: true,
    in_step: false,
};

impl CovarianceModel {
    fn wide_value_by_rows(
        &self,
        mixing: &Mixing,
        timeline: &Timeline,
        rule: TickRule,
        mut merit: impl FnMut(&dyn WideCovariance) -> Result<f64>,
    ) -> Result<f64> {
        self.to_wide_end(mixing, timeline, rule, BY_ROWS, Wanted::Value(&mut merit))
    }

    fn wide_gradient_by_rows<T: Into<WideSlope>>(
        &self,
        mixing: &Mixing,
        timeline: &Timeline,
        rule: TickRule,
        mut merit: impl FnMut(&dyn WideCovariance) -> Result<(f64, T)>,
    ) -> Result<(f64, Vec<LegGradient>)> {
        let mut merit = |p: &dyn WideCovariance| {
            let (value, slope) = merit(p)?;
            Ok((value, slope.into()))
        };
        self.wide_gradient_by(mixing, timeline, rule, BY_ROWS, &mut merit)
    }
}
