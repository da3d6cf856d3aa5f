//! No schedule is below the bound where drift wanders, and each step of the argument.

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::*;
use crate::attitude::Position;
use crate::covariance::CovarianceModel;
use crate::criterion::Criterion;
use crate::motion::Timeline;
use crate::platform::{AxisValue, Platform, Repositioning};
use crate::schedule::{Schedule, ScheduledPosition};
use crate::testing::platform;

/// Numbers in 0..1, the same in every run.
struct Numbers(u64);

impl Numbers {
    fn unit(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
    /// Over decades.
    fn log_between(&mut self, low: f64, high: f64) -> f64 {
        (self.between(low.ln(), high.ln())).exp()
    }
    fn is(&mut self, share: f64) -> bool {
        self.unit() < share
    }
}

fn schedule(numbers: &mut Numbers, total_time_s: f64) -> Vec<(Position, f64)> {
    let count = 3 + (numbers.unit() * 22.0) as usize;
    let dwells: Vec<f64> = (0..count).map(|_| numbers.between(0.3, 1.0)).collect();
    let sum: f64 = dwells.iter().sum();
    dwells
        .into_iter()
        .map(|dwell| {
            let [a, b, c] = [(); 3].map(|()| numbers.between(-3.1, 3.1));
            (Position::from_rad(a, b, c), dwell * total_time_s / sum)
        })
        .collect()
}

/// One position anew, or one dwell at the cost of another.
fn changed(numbers: &mut Numbers, of: &[(Position, f64)]) -> Vec<(Position, f64)> {
    let mut all = of.to_vec();
    let mut any = || (numbers.unit() * of.len() as f64) as usize;
    let (i, j) = (any(), any());
    if numbers.is(0.7) {
        let [a, b, c] = [(); 3].map(|()| numbers.between(-3.1, 3.1));
        all[i].0 = Position::from_rad(a, b, c);
    } else {
        let moved = numbers.between(0.0, 0.5) * all[i].1;
        all[i].1 -= moved;
        all[j].1 += moved;
    }
    all
}

fn timeline(platform: &Platform, positions: &[(Position, f64)]) -> Timeline {
    let positions = positions
        .iter()
        .map(|(p, d)| ScheduledPosition::new(*p, *d));
    let schedule = Schedule::new(positions.collect()).unwrap();
    Timeline::new(&platform.clone().into(), &schedule).unwrap()
}

/// Drift that wanders, slowly and fast, weakly and strongly; on stands of many kinds.
fn any_platform(numbers: &mut Numbers, case: usize) -> Platform {
    let walk = (case % 3 != 1).then(|| numbers.log_between(1e-4, 0.03));
    let markov = (!case.is_multiple_of(3)).then(|| {
        (
            numbers.log_between(3e-4, 0.03),
            numbers.log_between(10.0, 1e5),
        )
    });
    platform(|c| {
        c.gyro.rate_random_walk_deg_per_h_per_sqrt_h = walk;
        c.gyro.bias_instability_deg_per_h = markov.map(|m| m.0);
        c.gyro.bias_correlation_time_s = markov.map(|m| m.1);
        c.gyro.random_drift_deg_per_h = Some(numbers.log_between(1e-3, 0.03));
        c.site.latitude_deg = numbers.between(-85.0, 85.0);
        c.filter.period_s = numbers.log_between(5.0, 40.0);
        if numbers.is(0.3) {
            c.motion.repositioning = Repositioning::FrameHold;
        }
        if numbers.is(0.3) {
            c.azimuth.noise_arcsec = Some(numbers.log_between(0.5, 500.0));
        }
        if numbers.is(0.4) {
            let each = [(); 3].map(|()| numbers.log_between(3e-4, 10.0));
            c.prior.constant_drift_deg_per_h = AxisValue::PerAxis(each);
        }
        if numbers.is(0.15) {
            c.prior.constant_drift_deg_per_h = AxisValue::PerAxis([1.0, 0.0, 2.0]);
        }
        if numbers.is(0.2) {
            c.errors.estimated.torquer_scale_factor_ppm = Some(AxisValue::All(1000.0));
            c.errors.estimated.accelerometer_bias_ug = Some(AxisValue::All(100.0));
        }
        if numbers.is(0.2) {
            c.accelerometer.bias_instability_ug = Some(3.0);
            c.accelerometer.bias_correlation_time_s = Some(900.0);
        }
    })
}

fn criteria(numbers: &mut Numbers) -> Vec<Criterion> {
    let mut spec = CoefficientVector::repeat(f64::INFINITY);
    for c in constant_drifts() {
        spec[c.index()] = numbers.between(0.001, 0.004);
    }
    spec[5] = 0.01;
    vec![
        Criterion::weighted(CoefficientVector::from_fn(|_, _| numbers.unit())),
        Criterion::D,
        Criterion::E,
        Criterion::max_ratio(spec),
    ]
}

/// By the exact chain; a third of the schedules random, the others better and better. Every schedule is
/// held against the bounds of its own duration and, if it is shorter, of a longer one.
#[test]
fn no_schedule_is_below_its_bound_where_drift_wanders() {
    let mut numbers = Numbers(11);
    let (mut compared, mut raised) = (0, 0);
    for case in 0..18 {
        let platform = any_platform(&mut numbers, case);
        let total = numbers.log_between(600.0, 15_000.0);
        let certifier = Certifier::new(&platform);
        let bound = certifier.bound(&Criterion::rms(), total).unwrap();
        let bounds: Vec<(Criterion, f64)> = criteria(&mut numbers)
            .into_iter()
            .skip(case % 4)
            .take(1)
            .map(|c| {
                let found = certifier.criterion_bound(&c, total).unwrap();
                (c, found.lower_bound)
            })
            .collect();
        if case < 6 {
            let white = certifier.of_white_noise(&Criterion::rms(), total);
            let white = white.unwrap().lower_bound;
            assert!(bound.lower_bound >= white);
            raised += usize::from(bound.lower_bound > 1.001 * white);
        }
        let model = CovarianceModel::new(&platform);
        let mut best: Option<(f64, Vec<(Position, f64)>)> = None;
        for i in 0..40 {
            let length = if i % 10 == 9 { numbers.unit() } else { 1.0 };
            let positions = match &best {
                Some((_, positions)) if i >= 13 && length == 1.0 => {
                    changed(&mut numbers, positions)
                }
                _ => schedule(&mut numbers, total * length),
            };
            let end = model
                .full_covariance(&timeline(&platform, &positions))
                .unwrap()
                .end;
            let rms = (end.coefficients.trace() / 12.0).sqrt();
            assert!(rms >= bound.lower_bound, "{case} {i}: {rms} {bound:?}");
            for k in 0..12 {
                let (sigma, least) = (end.coefficients[(k, k)].sqrt(), bound.sigma_deg_per_h[k]);
                assert!(sigma >= least, "{case} {i} {k}: {sigma} {least}");
            }
            for (criterion, least) in &bounds {
                let value = criterion.value(&end).unwrap();
                assert!(value >= *least, "{case} {i}: {value} {least} {criterion:?}");
            }
            compared += 1;
            if best.as_ref().is_none_or(|b| rms < b.0) && length == 1.0 {
                best = Some((rms, positions));
            }
        }
    }
    assert!(compared == 720 && raised > 3, "{raised}");
}

/// Sums of variances, and determinants, of any gyros at attitudes that change at will: never below as many
/// times the one gyro that has the mean of the largest parts of Δ.
#[test]
fn equal_gyros_do_best_with_equal_parts() {
    let mut numbers = Numbers(12);
    let count = 30;
    for case in 0..40 {
        let walk = numbers.log_between(1e-3, 1.0);
        let (sigma, kept) = (numbers.between(0.0, 2.0), numbers.unit());
        let prior = numbers.log_between(1e-2, 1e2);
        let mut delta = [(); 3].map(|()| numbers.log_between(1e-2, 10.0));
        let covariance = DMatrix::from_fn(count, count, |i, j| {
            let apart = i.abs_diff(j) as i32;
            prior + walk * (1 + i.min(j)) as f64 + sigma * sigma * kept.powi(apart)
        });
        let all = DMatrix::from_fn(3 * count, 3 * count, |i, j| match i % 3 == j % 3 {
            true => covariance[(i / 3, j / 3)],
            false => 0.0,
        });
        // The level of the walk and the mean at the end against what is measured.
        let at_end = |i: usize| prior + walk * (1 + i) as f64;
        let end_variance = at_end(count - 1);
        let attitude = |numbers: &mut Numbers| {
            let [a, b, c] = [(); 3].map(|()| numbers.between(-3.1, 3.1));
            *Position::from_rad(a, b, c).attitude().matrix()
        };
        let mut noise = DMatrix::zeros(3 * count, 3 * count);
        let mut at = attitude(&mut numbers);
        for k in 0..count {
            if case % 4 != 0 || k % 10 == 0 {
                at = attitude(&mut numbers);
            }
            let inverse = Vector3::from(delta.map(|d: f64| d.recip()));
            let block = at.transpose() * Matrix3::from_diagonal(&inverse) * at;
            noise.view_mut((3 * k, 3 * k), (3, 3)).copy_from(&block);
        }
        let factor = (all + noise).cholesky().unwrap();
        let c = DMatrix::from_fn(3 * count, 3, |i, j| match i % 3 == j {
            true => at_end(i / 3),
            false => 0.0,
        });
        let told = c.transpose() * factor.solve(&c);
        let left = DMatrix::identity(3, 3) * end_variance - told;
        delta.sort_by(|a, b| b.total_cmp(a));
        for m in 1..=3 {
            let share = delta[..m].iter().sum::<f64>() / m as f64;
            let one = &covariance + DMatrix::identity(count, count) / share;
            let c = DMatrix::from_fn(count, 1, |i, _| at_end(i));
            let variance = end_variance - c.dot(&one.cholesky().unwrap().solve(&c));
            for first in 0..=3 - m {
                let part = left.view((first, first), (m, m)).into_owned();
                let least = m as f64 * variance * (1.0 - 1e-9);
                assert!(part.trace() >= least, "{case} {m}");
                let log = part.determinant().ln();
                assert!(log >= m as f64 * variance.ln() - 1e-9, "{case} {m}");
            }
        }
    }
}

fn wandering(variances: [[f64; 3]; 3], prior: [f64; 3]) -> Wandering {
    Wandering {
        places: [0, 1, 2],
        counts: [true; 3],
        prior,
        variances,
        majorant: None,
    }
}

/// Layers of equal weight, and sets of gyros against what is allowed of them together.
#[test]
fn weights_and_specifications_are_of_the_right_gyros() {
    // V of one, two, three: 1, 2, 4, whatever was known.
    let equal = wandering([[1.0; 3], [2.0; 3], [4.0; 3]], [9.0; 3]);
    let mut weights = CoefficientVector::zeros();
    for (w, value) in weights.iter_mut().zip([2.0, 5.0, 1.0]) {
        *w = value;
    }
    // 3 of one, 1 more of two, 1 of all.
    assert_eq!(equal.weighted(&weights), 3.0 + 2.0 * 2.0 + 3.0 * 4.0);
    let mut spec = CoefficientVector::repeat(f64::INFINITY);
    (spec[0], spec[1]) = (1.0, 2.0);
    // One: 1/1, 1/4; both: 4/5.
    assert_eq!(equal.worst(&spec), 1.0);
    spec[0] = 2.0;
    assert_eq!(equal.worst(&spec), 0.5);
    let (log, count) = equal.log_determinant();
    assert!((log - 3.0 * 4.0_f64.ln()).abs() < 1e-15 && count == 3);
    // The second is known far better: each by itself tells more than all as well known as it.
    let table = [[3.0, 0.1, 3.0], [4.0, 0.2, 4.0], [5.0, 0.3, 5.0]];
    let unequal = wandering(table, [9.0, 0.1, 9.0]);
    let ones = CoefficientVector::repeat(1.0);
    assert_eq!(unequal.weighted(&ones), 3.0 + 0.1 + 3.0);
}

fn coloured(walk: Option<f64>, markov: Option<(f64, f64)>) -> Platform {
    platform(|c| {
        c.gyro.rate_random_walk_deg_per_h_per_sqrt_h = walk;
        c.gyro.bias_instability_deg_per_h = markov.map(|m| m.0);
        c.gyro.bias_correlation_time_s = markov.map(|m| m.1);
    })
}

/// Section 11 of `docs/certificate.md`: the figures.
#[test]
fn the_bounds_with_wandering_are_the_figures_of_the_documentation() {
    for (walk, markov, figure) in FIGURES {
        let certifier = Certifier::new(&coloured(walk, markov));
        let bound = certifier.criterion_bound(&Criterion::rms(), 12_000.0);
        let found = bound.unwrap().lower_bound;
        println!("{walk:?} {markov:?}: {found:.7}");
        assert!((found / figure - 1.0).abs() < 3e-4, "{walk:?} {markov:?}");
    }
}

type Figure = (Option<f64>, Option<(f64, f64)>, f64);
const FIGURES: [Figure; 4] = [
    (Some(0.001), None, 0.000_930_3),
    (Some(0.003), None, 0.001_082_4),
    (None, Some((0.003, 600.0)), 0.000_977_3),
    (Some(0.001), Some((0.003, 600.0)), 0.001_081_7),
];

/// A specification below what the walk allows at any time is out of reach in any time; a little above, it takes
/// far longer than without.
#[test]
fn what_a_walk_never_allows_takes_for_ever() {
    use crate::certificate::MinimumTime;
    let with = |walk: Option<f64>| {
        Certifier::new(&platform(|c| {
            c.gyro.rate_random_walk_deg_per_h_per_sqrt_h = walk;
            c.filter.period_s = 40.0;
        }))
    };
    let (certifier, white) = (with(Some(0.003)), with(None));
    // √(K² q) is the steady variance of a drift that is seen in its own white noise alone.
    let conditions = &certifier.conditions;
    let walk = conditions.drift_colour.random_walk.unwrap();
    let steady = (walk * conditions.drift_psd).powf(0.25);
    let time = |certifier: &Certifier, sigma: f64| {
        let mut spec = CoefficientVector::repeat(f64::INFINITY);
        for c in constant_drifts() {
            spec[c.index()] = sigma;
        }
        certifier.minimum_time(&spec, 9000.0).unwrap()
    };
    let never = time(&certifier, 0.99 * steady);
    assert!(matches!(never, MinimumTime::NotWithin(_)), "{never:?}");
    let [late, soon] = [&certifier, &white].map(|c| time(c, 1.15 * steady));
    let (MinimumTime::MoreThan(late), MinimumTime::MoreThan(soon)) = (late, soon) else {
        panic!("{late:?} {soon:?}");
    };
    assert!(late > 1.2 * soon, "{late} {soon}");
}

/// Known drift that walks counts at the end, but not after no time at all; without a walk it is known.
#[test]
fn known_drift_that_wanders_is_not_forgotten() {
    use crate::certificate::Remark;
    let known = |walk: Option<f64>| {
        Certifier::new(&platform(|c| {
            c.gyro.rate_random_walk_deg_per_h_per_sqrt_h = walk;
            c.gyro.bias_instability_deg_per_h = Some(0.003);
            c.gyro.bias_correlation_time_s = Some(600.0);
            c.prior.constant_drift_deg_per_h = AxisValue::All(0.0);
        }))
    };
    let mut weights = CoefficientVector::zeros();
    for c in constant_drifts() {
        weights[c.index()] = 1.0;
    }
    let of_drift = Criterion::weighted(weights);
    for (walk, remark) in [(None, false), (Some(0.003), true)] {
        let bound = known(walk).bound(&of_drift, 12_000.0).unwrap();
        assert_eq!(bound.lower_bound, 0.0);
        assert_eq!(bound.remarks.contains(&Remark::KnownAndWanders), remark);
        let said = bound
            .remarks
            .iter()
            .any(|r| matches!(r, Remark::KnownBefore(_)));
        assert_eq!(said, !remark);
        // D-optimality counts what walks: twelve then, nine otherwise.
        let d = known(walk)
            .criterion_bound(&Criterion::D, 12_000.0)
            .unwrap();
        assert_eq!(d.lower_bound == 0.0, remark, "{d:?}");
    }
}
