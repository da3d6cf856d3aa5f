//! Sections 5 and 6: the maximum over attitudes, the design, the criteria, the extremes.

use super::*;
use crate::certificate::criteria::Problem;
use crate::certificate::design::prior_part;
use crate::certificate::directions::Allowed;
use crate::certificate::largest::Attitudes;
use crate::drift::CoefficientMatrix;

fn random_square(numbers: &mut Numbers) -> CoefficientMatrix {
    let root = CoefficientMatrix::from_fn(|_, _| numbers.between(-1.0, 1.0));
    root * root.transpose()
}

/// φ at one attitude, by its definition.
fn value(attitude: &Attitude, delta: &[f64; 3], b: &CoefficientMatrix) -> f64 {
    let a = drift_matrix(attitude);
    let weights = Matrix3::from_diagonal(&Vector3::from(*delta));
    (a.transpose() * weights * a * b).trace()
}

/// Section 5: the bound on φ holds between the grid's points and is close.
#[test]
fn phi_is_nowhere_above_its_bound() {
    let mut numbers = Numbers(5);
    let delta = [1.0, 0.2, 1.3];
    let free = platform(|_| {});
    let small = platform(|c| {
        c.gimbals.alpha_deg = Some([10.0, 40.0]);
        c.gimbals.beta_deg = Some([-20.0, 20.0]);
        c.gimbals.gamma_deg = Some([0.0, 35.0]);
    });
    for limited in [false, true] {
        let stand = if limited { &small } else { &free };
        let directions = Directions::new(stand);
        assert_eq!(matches!(directions.allowed, Allowed::Everything), !limited);
        let attitudes = Attitudes::new(&directions, delta);
        for _ in 0..4 {
            let b = random_square(&mut numbers);
            let peak = attitudes.peak(&b, true);
            let at_place = value(&peak.places[0], &delta, &b);
            assert!(at_place <= peak.value && at_place > 0.9 * peak.value);
            for _ in 0..3000 {
                let [alpha, beta, gamma] = match limited {
                    true => [
                        numbers.between(10.0, 40.0),
                        numbers.between(-20.0, 20.0),
                        numbers.between(0.0, 35.0),
                    ],
                    false => [(); 3].map(|()| numbers.between(-180.0, 180.0)),
                };
                let attitude = Position::from_deg(alpha, beta, gamma).attitude();
                assert!(value(&attitude, &delta, &b) <= peak.value);
            }
        }
    }
}

/// Section 5: along any rotation φ has degree 4, so its fifth differences on nine equal steps of
/// the turn, the discrete Fourier coefficients above 4, vanish.
#[test]
fn phi_has_degree_four_along_a_rotation() {
    let mut numbers = Numbers(6);
    let b = random_square(&mut numbers);
    let start = numbers.position().attitude();
    let axis = nalgebra::Unit::new_normalize(Vector3::new(0.3, -0.5, 0.8));
    let count = 16;
    let values: Vec<f64> = (0..count)
        .map(|i| {
            let angle = std::f64::consts::TAU * f64::from(i) / f64::from(count);
            let turn = nalgebra::Rotation3::from_axis_angle(&axis, angle);
            let turned = nalgebra::Rotation3::from_matrix_unchecked(start.matrix() * turn.matrix());
            value(&Attitude::from_rotation(turned), &[1.0, 0.2, 1.3], &b)
        })
        .collect();
    for degree in 5..=8 {
        let (mut re, mut im) = (0.0, 0.0);
        for (i, v) in values.iter().enumerate() {
            let phase = std::f64::consts::TAU * f64::from(degree) * i as f64 / f64::from(count);
            re += v * phase.cos();
            im += v * phase.sin();
        }
        assert!(re.hypot(im) < 1e-10 * values[0].abs() * f64::from(count));
    }
}

/// Section 6: with equal weights and every attitude the design is the uniform one.
#[test]
fn the_isotropic_case_has_a_closed_form() {
    let platform = platform(|_| {});
    let certifier = Certifier::new(&platform);
    let bounded = rms_majorant(&platform, 12_000.0);
    let problem = certifier.problem(&certifier.directions, bounded);
    let found = problem
        .weighted_variance(&CoefficientVector::repeat(1.0))
        .unwrap();
    let [x, y, z] = bounded.delta.map(|d| d * bounded.mass);
    let (constant, sensitive) = (1.0 / 225.0, 1.0 / 64.0);
    let (_, kappa) = problem.trace.unwrap();
    let exact = 1.0 / kappa
        + 3.0 / (constant + (x + y + z) / 3.0)
        + 3.0 / (sensitive + (x + z) / 6.0)
        + 5.0 / (sensitive + ((x + z) / 2.0 + 2.0 * y / 3.0) / 5.0);
    assert!(
        found.lower <= exact * (1.0 + 1e-9),
        "{} {exact}",
        found.lower
    );
    assert!(
        found.lower >= exact * (1.0 - 2e-4),
        "{} {exact}",
        found.lower
    );
}

/// Section 6: the dual bound against the optimum of the same design by second-order cones.
#[test]
fn the_multiplicative_design_agrees_with_second_order_cones() {
    let platform = platform(|c| c.gimbals.step_deg = Some(90.0));
    let certifier = Certifier::new(&platform);
    let bounded = rms_majorant(&platform, 12_000.0);
    let problem = certifier.problem(&certifier.directions, bounded);
    for index in [0, 3, 8] {
        let mut weights = CoefficientVector::repeat(0.1);
        weights[index] = 1.0;
        let found = problem.weighted_variance(&weights).unwrap();
        let exact = cones(&problem, &certifier.directions, &weights);
        assert!(
            found.lower <= exact * (1.0 + 1e-5),
            "{} {exact}",
            found.lower
        );
        assert!(
            found.lower >= exact * (1.0 - 2e-3),
            "{} {exact}",
            found.lower
        );
    }
}

/// Sagnol's form: minimise tr KᵀΛK + τ² − 2 tr KᵀY with ‖F_p K‖ ≤ τ for every attitude p; minus
/// the optimum is the least tr YᵀS⁻¹Y. τ² and the prior by the quadratic part.
fn cones(problem: &Problem<'_>, directions: &Directions, weights: &CoefficientVector) -> f64 {
    use clarabel::algebra::CscMatrix;
    use clarabel::solver::{
        DefaultSettings, DefaultSolver, IPSolver, SecondOrderConeT, SupportedConeT,
    };
    let Allowed::Table(attitudes) = &directions.allowed else {
        panic!("a table is listed");
    };
    let (y, fixed) = problem.target(weights);
    let space = &problem.space;
    // Units in which Y and the rows are of the order of 1.
    let unit = space.bounded.mass.sqrt();
    let (n, k) = y.shape();
    let variables = n * k + 1;
    let mut quadratic = Vec::new();
    for column in 0..k {
        for i in 0..n {
            quadratic.push((column * n + i, 2.0 * space.prior[(i, i)] / (unit * unit)));
        }
    }
    quadratic.push((n * k, 2.0));
    let p = CscMatrix::new_from_triplets(
        variables,
        variables,
        quadratic.iter().map(|q| q.0).collect(),
        quadratic.iter().map(|q| q.0).collect(),
        quadratic.iter().map(|q| q.1).collect(),
    );
    let mut linear: Vec<f64> = (0..k)
        .flat_map(|c| (0..n).map(move |i| (i, c)))
        .map(|(i, c)| -2.0 * y[(i, c)])
        .collect();
    linear.push(0.0);
    let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    let size = 3 * k + 1;
    for (index, attitude) in attitudes.iter().enumerate() {
        let a = drift_matrix(attitude);
        let scaled = DMatrix::from_fn(3, COEFFICIENTS, |i, j| {
            space.bounded.delta[i].sqrt() * a[(i, j)]
        });
        let f = scaled * &space.basis;
        rows.push(index * size);
        columns.push(n * k);
        values.push(-1.0);
        for column in 0..k {
            for i in 0..3 {
                for j in 0..n {
                    rows.push(index * size + 1 + 3 * column + i);
                    columns.push(column * n + j);
                    values.push(-f[(i, j)]);
                }
            }
        }
    }
    let a = CscMatrix::new_from_triplets(size * attitudes.len(), variables, rows, columns, values);
    let b = vec![0.0; size * attitudes.len()];
    let cones: Vec<SupportedConeT<f64>> =
        attitudes.iter().map(|_| SecondOrderConeT(size)).collect();
    let settings = DefaultSettings {
        verbose: false,
        ..DefaultSettings::default()
    };
    let mut solver = DefaultSolver::new(&p, &linear, &a, &b, &cones, settings).unwrap();
    solver.solve();
    fixed - solver.solution.obj_val / (unit * unit)
}

/// Section 6: K and X may be anything; a bad one gives a weak bound, never a wrong one.
#[test]
fn a_bad_factor_only_weakens_the_bound() {
    let mut numbers = Numbers(7);
    let platform = platform(|_| {});
    let certifier = Certifier::new(&platform);
    let bounded = rms_majorant(&platform, 12_000.0);
    let problem = certifier.problem(&certifier.directions, bounded);
    let best = problem
        .weighted_variance(&CoefficientVector::repeat(1.0))
        .unwrap();
    let (y, fixed) = problem.target(&CoefficientVector::repeat(1.0));
    for _ in 0..20 {
        let factor = DMatrix::from_fn(y.nrows(), y.ncols(), |i, j| {
            y[(i, j)] + numbers.between(-0.3, 0.3)
        });
        let peak = problem.space.peak(&factor, true);
        let spent = prior_part(&factor, &problem.space.prior) + peak.value;
        assert!(fixed + factor.dot(&y).powi(2) / spent <= best.design);
    }
}

/// Criteria: relations that hold between their bounds.
#[test]
fn bounds_of_different_criteria_agree_where_they_must() {
    let certifier = Certifier::new(&platform(|c| c.gimbals.step_deg = Some(90.0)));
    let bound = |c: &Criterion| certifier.criterion_bound(c, 8000.0).unwrap().lower_bound;
    let rms = bound(&Criterion::rms());
    let spec = CoefficientVector::from_fn(|i, _| if i == 4 { 0.001 } else { f64::INFINITY });
    let alone = bound(&Criterion::max_ratio(spec));
    let weights = CoefficientVector::from_fn(|i, _| if i == 4 { 1.0 } else { 0.0 });
    let same = bound(&Criterion::weighted(weights));
    assert!((alone * 0.001 / same - 1.0).abs() < 2e-3, "{alone} {same}");
    let even = CoefficientVector::repeat(0.001);
    let largest = bound(&Criterion::max_ratio(even));
    assert!(largest * 0.001 >= rms && largest * 0.001 >= same * 0.999);
    assert!(bound(&Criterion::E) >= rms);
    assert!(bound(&Criterion::D) <= rms);
}

#[test]
fn where_nothing_is_measured_the_prior_is_the_bound() {
    let certifier = Certifier::new(&platform(|_| {}));
    let bound = certifier.bound(&Criterion::rms(), 9.0).unwrap();
    assert!(bound.criterion.majorant.is_none());
    let prior: f64 = (3.0 * 225.0 + 9.0 * 64.0) / 12.0;
    assert!((bound.lower_bound / prior.sqrt() - 1.0).abs() < 1e-5);
    assert_eq!(bound.remarks, [crate::certificate::Remark::PriorItself]);
    let known = Certifier::new(&platform(|c| {
        let zero = crate::platform::AxisValue::All(0.0);
        c.prior.constant_drift_deg_per_h = zero;
        c.prior.g_sensitive_drift_deg_per_h_per_g = crate::platform::GSensitivePrior::All(zero);
    }));
    let nothing = known.bound(&Criterion::D, 1000.0).unwrap();
    assert_eq!(nothing.lower_bound, 0.0);
    assert!(matches!(
        nothing.remarks[..],
        [crate::certificate::Remark::KnownBefore(_)]
    ));
    assert!(
        certifier
            .bound(&Criterion::rms(), 0.0)
            .unwrap_err()
            .is_input()
    );
    assert!(
        certifier
            .bound(&Criterion::rms(), f64::NAN)
            .unwrap_err()
            .is_input()
    );
}

#[test]
fn extreme_conditions_have_a_bound_or_say_why_not() {
    type Change = fn(&mut PlatformConfig);
    let cases: [(&str, Change); 15] = [
        ("as well as the best", |c| {
            c.azimuth.noise_arcsec = Some(1e-3);
        }),
        ("", |c| c.azimuth.noise_arcsec = Some(1e6)),
        ("", |c| {
            c.azimuth.noise_arcsec = Some(1e-3);
            c.gyro.random_drift_deg_per_h = Some(0.0);
        }),
        ("", |c| {
            c.azimuth.noise_arcsec = Some(1e-3);
            c.filter.period_s = 3000.0;
        }),
        ("", |c| {
            c.azimuth.noise_arcsec = Some(1.0);
            c.accelerometer.noise_g = Some(1e-12);
        }),
        ("frame-hold", |c| {
            c.azimuth.noise_arcsec = Some(0.1);
            c.motion.repositioning = Repositioning::FrameHold;
        }),
        ("", |c| c.gyro.random_drift_deg_per_h = Some(0.0)),
        ("pole", |c| c.site.latitude_deg = 90.0),
        ("", |c| c.site.latitude_deg = -89.999),
        ("", |c| c.accelerometer.noise_g = Some(1e-12)),
        ("", |c| c.accelerometer.noise_g = Some(1.0)),
        ("", |c| c.filter.period_s = 1e-2),
        ("", |c| c.filter.period_s = 3000.0),
        ("frame-hold", |c| {
            c.motion.repositioning = Repositioning::FrameHold
        }),
        ("", |c| {
            c.prior.misalignment_deg = crate::platform::AxisValue::All(0.0);
            c.prior.constant_drift_deg_per_h = crate::platform::AxisValue::All(0.0);
        }),
    ];
    for (remark, change) in cases {
        let certifier = Certifier::new(&platform(change));
        for time in [6000.0, 15_000.0] {
            let bound = certifier.bound(&Criterion::rms(), time).unwrap();
            let prior = certifier.conditions.prior_sigma;
            let prior_rms = (prior.norm_squared() / 12.0).sqrt();
            assert!(bound.lower_bound > 0.0 && bound.lower_bound <= prior_rms * (1.0 + 1e-9));
            let said: Vec<String> = bound.remarks.iter().map(ToString::to_string).collect();
            let said = said.join("; ");
            assert!(
                said.contains(remark) && (remark.is_empty() || !said.is_empty()),
                "{said}"
            );
            assert!(certifier.criterion_bound(&Criterion::D, time).is_ok());
        }
    }
}

#[test]
fn very_long_tests_are_bounded_too() {
    let certifier = Certifier::new(&platform(|_| {}));
    let mut last = f64::INFINITY;
    for time in [1e2, 1e3, 1e4, 1e5, 1e6, 1e7] {
        let bound = certifier.criterion_bound(&Criterion::rms(), time).unwrap();
        assert!(bound.lower_bound > 0.0 && bound.lower_bound < last);
        last = bound.lower_bound;
    }
    assert!(
        certifier
            .criterion_bound(&Criterion::rms(), 1e8)
            .unwrap_err()
            .is_input()
    );
}

#[test]
fn the_minimum_time_is_where_the_bound_meets_the_specification() {
    let certifier = Certifier::new(&platform(|_| {}));
    let spec = CoefficientVector::repeat(0.002);
    let MinimumTime::MoreThan(time) = certifier.minimum_time(&spec, 12_000.0).unwrap() else {
        panic!("it takes a while");
    };
    let ratio = |time: f64| {
        let criterion = Criterion::max_ratio(spec);
        certifier
            .criterion_bound(&criterion, time)
            .unwrap()
            .lower_bound
    };
    assert!(ratio(time) > 1.0 && ratio(1.001 * time) < 1.0);
    // From any guess the same, but for the width of the bracket.
    for guess in [50.0, 1e6] {
        let again = certifier.minimum_time(&spec, guess).unwrap();
        let MinimumTime::MoreThan(again) = again else {
            panic!("{again:?}");
        };
        assert!((again / time - 1.0).abs() < 1e-3);
    }
    let weak = CoefficientVector::repeat(20.0);
    assert_eq!(
        certifier.minimum_time(&weak, 100.0).unwrap(),
        MinimumTime::Nothing
    );
    let pole = Certifier::new(&platform(|c| c.site.latitude_deg = 90.0));
    let never = pole.minimum_time(&spec, 100.0).unwrap();
    assert!(matches!(never, MinimumTime::NotWithin(_)), "{never:?}");
}
