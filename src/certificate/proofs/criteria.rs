//! Sections 4 and 6 on an index table of 24 attitudes, where any design can be written down: what
//! the bounds of the criteria say holds for all of them, and some design comes close.

use super::*;
use crate::certificate::criteria::{Bracket, Problem};
use crate::certificate::directions::Allowed;
use crate::drift::CoefficientMatrix;
use crate::platform::{AxisValue, GSensitivePrior};

/// Problems with the trace apart, with a coefficient known, with one of the D_I known (the trace
/// not apart), and in frame-hold.
fn platforms() -> Vec<Platform> {
    let table = |change: fn(&mut PlatformConfig)| {
        platform(|c| {
            c.gimbals.step_deg = Some(90.0);
            c.filter.period_s = 50.0;
            change(c);
        })
    };
    vec![
        table(|_| {}),
        table(|c| c.prior.constant_drift_deg_per_h = AxisValue::PerAxis([15.0, 0.0, 3.0])),
        table(|c| {
            c.prior.g_sensitive_drift_deg_per_h_per_g =
                GSensitivePrior::All(AxisValue::PerAxis([8.0, 0.0, 8.0]));
        }),
        table(|c| c.motion.repositioning = Repositioning::FrameHold),
    ]
}

/// P_D of a design with shares `weights` of the attitudes, and any cross term of the trace.
fn covariance(
    problem: &Problem<'_>,
    attitudes: &[Attitude],
    weights: &[f64],
    numbers: &mut Numbers,
) -> CoefficientMatrix {
    let space = &problem.space;
    let mut s = space.prior.clone();
    for (attitude, weight) in attitudes.iter().zip(weights) {
        let a = drift_matrix(attitude);
        let a = DMatrix::from_fn(3, COEFFICIENTS, |i, j| {
            (weight * space.bounded.mass * space.bounded.delta[i]).sqrt() * a[(i, j)]
        });
        let rows = a * &space.basis;
        s += rows.transpose() * rows;
    }
    let inverse = s.try_inverse().unwrap();
    // E = [κ bᵀ; b S + bbᵀ/κ] has S as its Schur complement whatever b is; x = −b/κ.
    let x = DMatrix::from_fn(1, space.size(), |_, _| numbers.between(-1.0, 1.0));
    let x = x * (0.3 * numbers.unit());
    let mut columns = space.basis.clone();
    let mut p = DMatrix::zeros(COEFFICIENTS, COEFFICIENTS);
    if let Some((t, kappa)) = &problem.trace {
        let t = DMatrix::from_column_slice(COEFFICIENTS, 1, t.as_slice());
        columns += &t * x;
        p += &t * t.transpose() / *kappa;
    }
    p += &columns * inverse * columns.transpose();
    CoefficientMatrix::from_fn(|i, j| p[(i, j)])
}

fn criteria() -> Vec<Criterion> {
    let mut spec = CoefficientVector::from_fn(|i, _| 0.002 * (1.0 + i as f64));
    spec[2] = f64::INFINITY;
    spec[9] = f64::INFINITY;
    vec![
        Criterion::rms(),
        Criterion::weighted(CoefficientVector::from_fn(|i, _| [0.0, 0.3, 2.0][i % 3])),
        Criterion::D,
        Criterion::E,
        Criterion::max_ratio(spec),
        Criterion::max_ratio(CoefficientVector::repeat(0.01)),
        // An attitude error about three axes.
        Criterion::Use {
            weight: {
                let l = DMatrix::from_fn(3, COEFFICIENTS, |i, j| ((5 * i + 3 * j) as f64).sin());
                l.transpose() * l
            },
        },
    ]
}

/// Value of the criterion, from the bracket's own unit.
fn bracket(problem: &Problem<'_>, criterion: &Criterion) -> Bracket {
    match criterion {
        Criterion::A { weights, .. } => problem.weighted_variance(weights).unwrap(),
        Criterion::D => problem.log_determinant().unwrap(),
        Criterion::E => problem.worst_variance().unwrap(),
        Criterion::Use { weight } => problem
            .weighted_by(&super::super::weight_root(weight))
            .unwrap(),
        Criterion::MaxRatio { spec_deg_per_h, .. } => problem.worst_ratio(spec_deg_per_h).unwrap(),
    }
}

#[test]
fn no_design_is_better_than_the_bound_of_any_criterion() {
    let mut numbers = Numbers(8);
    for platform in platforms() {
        let certifier = Certifier::new(&platform);
        let Allowed::Table(attitudes) = &certifier.directions.allowed else {
            panic!("a table is listed");
        };
        for criterion in criteria() {
            let bound = certifier.criterion_bound(&criterion, 4000.0).unwrap();
            let bounded = majorants(
                &certifier.conditions,
                4000.0,
                &certifier.emphasis(&criterion, Choice::Lean),
            );
            // The bound is the largest that the majorants give, and each bounds all designs.
            let mut largest = 0.0_f64;
            for bounded in bounded {
                let problem = certifier.problem(&certifier.directions, bounded);
                let found = bracket(&problem, &criterion);
                let open = certifier.conditions.prior_sigma.iter();
                let open = open.filter(|s| **s > 0.0).count() as f64;
                let value = |v: f64| match &criterion {
                    Criterion::A { weights, .. } => (v / weights.sum()).sqrt(),
                    Criterion::D => (v / (2.0 * open)).exp(),
                    Criterion::E | Criterion::MaxRatio { .. } | Criterion::Use { .. } => v.sqrt(),
                };
                let (lower, design) = (value(found.lower), value(found.design));
                largest = largest.max(lower);
                assert!(lower <= design * (1.0 + 1e-9), "{criterion:?}");
                assert!(lower >= design * 0.98, "{criterion:?} {lower} {design}");
                for k in 0..40 {
                    let weights: Vec<f64> = (0..attitudes.len())
                        .map(|_| numbers.unit().powi(1 + k % 4))
                        .collect();
                    let sum: f64 = weights.iter().sum();
                    let weights: Vec<f64> = weights.iter().map(|w| w / sum).collect();
                    let p = covariance(&problem, attitudes, &weights, &mut numbers);
                    let reached = criterion.value(&crate::covariance::Rooted::of(&p)).unwrap();
                    assert!(reached >= lower * (1.0 - 1e-9), "{criterion:?}");
                    assert!(reached >= design * 0.98, "{criterion:?}");
                }
            }
            let ratio = bound.lower_bound / largest;
            assert!(ratio < 1.0 && ratio > 1.0 - 1e-5, "{criterion:?} {ratio}");
        }
    }
}

/// The σ of one coefficient is bounded as the criterion that looks at nothing else is.
#[test]
fn each_sigma_has_the_bound_of_the_criterion_that_asks_for_it_alone() {
    for platform in platforms() {
        let certifier = Certifier::new(&platform);
        let sigmas = certifier.sigma_bounds(4000.0).unwrap();
        let (directions, emphasis) = certifier.relaxations(&Criterion::rms())[0];
        let bounded = majorants(&certifier.conditions, 4000.0, &emphasis)[0];
        let problem = certifier.problem(directions, bounded);
        for (i, prior) in certifier.conditions.prior_sigma.iter().enumerate() {
            let mut weights = CoefficientVector::zeros();
            weights[i] = 1.0;
            let alone = problem.weighted_variance(&weights).unwrap();
            assert!(sigmas[i] <= alone.design.sqrt() && sigmas[i] <= *prior);
            assert!(sigmas[i] >= 0.98 * alone.design.sqrt().min(*prior), "{i}");
        }
    }
}

/// The bound falls with the time; where it meets the specification the shortest test begins.
#[test]
fn the_shortest_test_is_where_the_ratio_is_one() {
    let certifier = Certifier::new(&platforms()[0]);
    let ratio = |spec: &CoefficientVector, time: f64| {
        let spec_deg_per_h = *spec;
        let criterion = Criterion::max_ratio(spec_deg_per_h);
        let bound = certifier.criterion_bound(&criterion, time).unwrap();
        bound.lower_bound
    };
    let spec = CoefficientVector::repeat(0.01);
    for guess in [1.0, 900.0, 4000.0, 1e9] {
        let MinimumTime::MoreThan(time) = certifier.minimum_time(&spec, guess).unwrap() else {
            panic!("it takes a while");
        };
        assert!(ratio(&spec, time) > 1.0, "{guess}");
        assert!(ratio(&spec, time * (1.0 + 4e-4)) < 1.0, "{guess}");
    }
    // Within the first period nothing is measured.
    let mild = CoefficientVector::repeat(14.999);
    let first = certifier.minimum_time(&mild, 1e4).unwrap();
    assert!(
        matches!(first, MinimumTime::MoreThan(t) if (50.0..500.0).contains(&t))
            || first == MinimumTime::Unknown,
        "{first:?}"
    );
    let none = CoefficientVector::repeat(15.0);
    assert_eq!(
        certifier.minimum_time(&none, 1e4).unwrap(),
        MinimumTime::Nothing
    );
    let never = CoefficientVector::repeat(1e-9);
    assert_eq!(
        certifier.minimum_time(&never, 1e4).unwrap(),
        MinimumTime::NotWithin(crate::schedule::MAX_DURATION_S)
    );
}
