//! The steps of `docs/certificate.md`, each against dense matrices or brute force.

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::conditions::{Cells, Conditions};
use super::criteria::Problem;
use super::design::{ROUNDS, Space, prior_part};
use super::directions::{Allowed, Directions};
use super::largest::Attitudes;
use super::majorant::{Bounded, Choice, Emphasis, Majorant, majorants};
use super::profile::profile;
use super::recursion::{Recursion, isotropic_holds};
use super::*;
use crate::attitude::{Attitude, EAST, NORTH, Position};
use crate::covariance::{CovarianceModel, TickRule};
use crate::drift::{DriftMatrix, drift_matrix};
use crate::motion::Timeline;
use crate::platform::{PlatformConfig, Repositioning};
use crate::schedule::{Schedule, ScheduledPosition};

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
    fn position(&mut self) -> Position {
        Position::from_rad(
            self.between(-3.1, 3.1),
            self.between(-3.1, 3.1),
            self.between(-3.1, 3.1),
        )
    }
}

fn platform(change: impl FnOnce(&mut PlatformConfig)) -> Platform {
    let mut config = PlatformConfig::default();
    change(&mut config);
    config.check().unwrap()
}

fn recursion(platform: &Platform, total_time_s: f64) -> Recursion {
    let conditions = Conditions::new(platform);
    let cells = Cells::new(&conditions, total_time_s).unwrap();
    let profile = profile(&conditions, &cells);
    Recursion::new(conditions, cells, profile)
}

/// Measurement times at least a period apart, the first a period after the start or later.
fn admissible_times(numbers: &mut Numbers, period: f64, total: f64) -> Vec<f64> {
    let slack = numbers.between(0.0, 0.6);
    let mut times = Vec::new();
    let mut t = 0.0;
    loop {
        // Mostly one period after the other, as within a dwell; sometimes later.
        let late = if numbers.unit() < 0.3 {
            numbers.between(0.0, 2.0 * slack)
        } else {
            0.0
        };
        t += period * (1.0 + late);
        if t > total {
            return times;
        }
        times.push(t);
    }
}

/// The covariance of the measurements at `times` with process noise PSD `noise(cell)` (diagonal),
/// the prior of ψ and a drift of the trace of variance `trace`: dense, by quadrature.
fn dense(
    r: &Recursion,
    times: &[f64],
    trace: f64,
    noise: impl Fn(usize) -> Vector3<f64>,
) -> DMatrix<f64> {
    const POINTS: usize = 40;
    let (c, length) = (&r.conditions, r.cells.length_s);
    let phi = |t: f64| c.dynamics.transition(t);
    let down = Vector3::new(0.0, -1.0 / 3.0_f64.sqrt(), 0.0);
    let prior = Matrix3::from_diagonal(&c.prior_psi);
    let mut out = DMatrix::zeros(2 * times.len(), 2 * times.len());
    for (k, &tk) in times.iter().enumerate() {
        for (l, &tl) in times.iter().enumerate() {
            let end = tk.min(tl);
            let mut block = phi(tk) * prior * phi(tl).transpose();
            let (gk, gl) = (
                c.dynamics.integral(tk) * down,
                c.dynamics.integral(tl) * down,
            );
            block += gk * gl.transpose() * trace;
            for cell in 0..r.cells.count {
                let (from, to) = (cell as f64 * length, ((cell + 1) as f64 * length).min(end));
                if to <= from {
                    continue;
                }
                let q = Matrix3::from_diagonal(&noise(cell));
                let width = (to - from) / POINTS as f64;
                for i in 0..POINTS {
                    let s = from + (i as f64 + 0.5) * width;
                    block += phi(tk - s) * q * phi(tl - s).transpose() * width;
                }
            }
            for (i, &a) in [NORTH, EAST].iter().enumerate() {
                for (j, &b) in [NORTH, EAST].iter().enumerate() {
                    out[(2 * k + i, 2 * l + j)] = block[(a, b)];
                }
            }
        }
        out[(2 * k, 2 * k)] += c.noise_variance;
        out[(2 * k + 1, 2 * k + 1)] += c.noise_variance;
    }
    out
}

fn least_eigenvalue(matrix: &DMatrix<f64>) -> f64 {
    (0.5 * (matrix + matrix.transpose()))
        .symmetric_eigenvalues()
        .min()
}

fn rms_majorant(platform: &Platform, total_time_s: f64) -> Bounded {
    let conditions = Conditions::new(platform);
    let emphasis = Emphasis::new(&conditions, &CoefficientVector::repeat(1.0), Choice::Free);
    majorants(&conditions, total_time_s, &emphasis)[0]
}

/// Sections 2 and 3: what the recursion accepts majorises every admissible set of times, seen on
/// dense covariances; and it does not accept much less than the dense test does.
#[test]
fn the_recursion_majorises_every_admissible_set_of_times() {
    let mut numbers = Numbers(1);
    let cases = [
        (50.0, 28.2, 0.01, 1000.0),
        (100.0, -70.0, 0.003, 1450.0),
        (60.0, 0.0, 0.0, 700.0),
    ];
    for (period, latitude, drift, total) in cases {
        let platform = platform(|c| {
            c.filter.period_s = period;
            c.site.latitude_deg = latitude;
            c.gyro.random_drift_deg_per_h = Some(drift);
        });
        let r = recursion(&platform, total);
        let bounded = rms_majorant(&platform, total);
        assert_eq!(bounded.kind, Majorant::Separated);
        let prior = r.conditions.decoupled_prior_information()[3].recip();
        // The test grants itself no more than this of the trace's prior variance.
        let trace = r
            .sharing
            .trace_variance(&r.conditions, &r.cells, prior, 0.05);
        let psd = r.conditions.drift_psd;
        let noise = |scale: f64| {
            let delta = bounded.delta;
            let f = r.profile.clone();
            move |cell: usize| Vector3::from(delta.map(|d| psd - 1.0 / (scale * d * f[cell])))
        };
        for _ in 0..25 {
            let times = admissible_times(&mut numbers, period, total);
            let least = least_eigenvalue(&dense(&r, &times, trace, noise(1.0)));
            assert!(least > 0.0, "{period} {latitude}: {least}");
        }
        let uniform: Vec<f64> = (1..=r.cells.measurements as usize)
            .map(|i| i as f64 * period)
            .collect();
        let trace = 0.5
            * r.sharing
                .trace_variance(&r.conditions, &r.cells, prior, 1e-3);
        let short = least_eigenvalue(&dense(&r, &uniform, trace, noise(0.6)));
        assert!(short < 0.0, "{period} {latitude}: {short}");
    }
}

/// Section 4: no admissible set of times gives more information on the trace than the bound.
#[test]
fn the_trace_is_never_known_better_than_its_bound() {
    let mut numbers = Numbers(2);
    let platform = platform(|c| c.filter.period_s = 50.0);
    let r = recursion(&platform, 2000.0);
    let bound = r.trace_information();
    let psd = r.conditions.drift_psd;
    let down = Vector3::new(0.0, -1.0 / 3.0_f64.sqrt(), 0.0);
    let information = |times: &[f64]| {
        let covariance = dense(&r, times, 0.0, |_| Vector3::repeat(psd));
        let seen = nalgebra::DVector::from_fn(2 * times.len(), |i, _| {
            let drifted = r.conditions.dynamics.integral(times[i / 2]) * down;
            drifted[[NORTH, EAST][i % 2]]
        });
        seen.dot(&covariance.cholesky().unwrap().solve(&seen))
    };
    let uniform: Vec<f64> = (1..=40).map(|i| f64::from(i) * 50.0).collect();
    let full = information(&uniform);
    assert!(full <= bound && full > 0.97 * bound, "{full} {bound}");
    for _ in 0..10 {
        let times = admissible_times(&mut numbers, 50.0, 2000.0);
        assert!(information(&times) <= bound);
    }
}

/// Section 7: the isotropic majorant, ψ^n turned at will between measurements of all three axes.
#[test]
fn the_isotropic_recursion_majorises_one_channel() {
    let mut numbers = Numbers(3);
    let platform = platform(|c| {
        c.filter.period_s = 20.0;
        c.motion.repositioning = Repositioning::FrameHold;
    });
    let r = recursion(&platform, 1500.0);
    let bounded = rms_majorant(&platform, 1500.0);
    assert_eq!(bounded.kind, Majorant::Isotropic);
    let delta = bounded.delta[0];
    assert!(isotropic_holds(&r, delta) && !isotropic_holds(&r, 0.99 * delta));
    for _ in 0..25 {
        let times = admissible_times(&mut numbers, 20.0, 1500.0);
        let integral = |end: f64| {
            (0..r.cells.count)
                .map(|j| {
                    let inside = (end - j as f64 * 20.0).clamp(0.0, 20.0);
                    inside * (r.conditions.drift_psd - 1.0 / (delta * r.profile[j]))
                })
                .sum::<f64>()
        };
        let covariance = DMatrix::from_fn(times.len(), times.len(), |k, l| {
            let noise = if k == l {
                r.conditions.noise_variance
            } else {
                0.0
            };
            r.conditions.prior_psi.min() + integral(times[k].min(times[l])) + noise
        });
        assert!(least_eigenvalue(&covariance) > 0.0);
    }
}

/// The chain of sections 1 to 4 end to end: S of a schedule, from its computed covariance, lies
/// below Λ + ∫ AᵀΔA dt over the attitudes it takes.
#[test]
fn the_information_of_a_schedule_is_majorised_as_a_matrix() {
    let mut numbers = Numbers(4);
    for (latitude, frame_hold) in [(28.2, false), (-80.0, false), (28.2, true)] {
        let platform = platform(|c| {
            c.site.latitude_deg = latitude;
            if frame_hold {
                c.motion.repositioning = Repositioning::FrameHold;
            }
        });
        let total = 3000.0;
        let conditions = Conditions::new(&platform);
        let r = recursion(&platform, total);
        let bounded = rms_majorant(&platform, total);
        let model = CovarianceModel::new(&platform);
        let everything = Directions::unlimited();
        let trace = bounded.trace_information.and(conditions.trace_direction());
        let prior = conditions.decoupled_prior_information();
        let space = Space::new(&everything, bounded, &prior, trace.as_ref());
        for _ in 0..10 {
            let mut dwells: Vec<f64> = (0..8).map(|_| numbers.between(0.2, 1.0)).collect();
            let sum: f64 = dwells.iter().sum();
            dwells.iter_mut().for_each(|d| *d *= total / sum);
            let positions: Vec<ScheduledPosition> = dwells
                .iter()
                .map(|d| ScheduledPosition::new(numbers.position(), *d))
                .collect();
            let timeline = Timeline::new(&platform, &Schedule::new(positions).unwrap()).unwrap();
            let end = model.end_covariance(&timeline, TickRule::Filter).unwrap();
            let p = DMatrix::from_fn(12, 12, |i, j| end.coefficients[(i, j)]);
            // The block of P off the trace is S⁻¹.
            let inverse = space.basis.transpose() * p * &space.basis;
            let s = inverse.try_inverse().unwrap();
            let mut majorant = space.prior.clone();
            let mut start = 0.0;
            for leg in timeline.legs() {
                let share = mass_between(&r, &bounded, start, start + leg.dwell_s);
                start += leg.dwell_s;
                let a: DriftMatrix = drift_matrix(&leg.attitude);
                let a =
                    DMatrix::from_fn(3, 12, |i, j| (bounded.delta[i] * share).sqrt() * a[(i, j)]);
                let rows = a * &space.basis;
                majorant += rows.transpose() * rows;
            }
            let scale = majorant.diagonal().map(|d| d.sqrt().recip());
            let difference = majorant - s;
            let scaled = DMatrix::from_fn(space.size(), space.size(), |i, j| {
                difference[(i, j)] * scale[i] * scale[j]
            });
            let least = least_eigenvalue(&scaled);
            assert!(least > -1e-6, "{latitude} {frame_hold}: {least}");
        }
    }
}

fn mass_between(r: &Recursion, bounded: &Bounded, from: f64, to: f64) -> f64 {
    if bounded.mass == r.cells.total_time_s {
        return to - from;
    }
    let length = r.cells.length_s;
    (0..r.cells.count)
        .map(|j| {
            let start = j as f64 * length;
            let inside = (to.min(start + length) - from.max(start)).max(0.0);
            r.profile[j] * inside
        })
        .sum()
}

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
        let directions = Directions::new(stand.gimbals(), stand.motion());
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
    assert!(ROUNDS > 1);
}

/// Criteria: relations that hold between their bounds.
#[test]
fn bounds_of_different_criteria_agree_where_they_must() {
    let certifier = Certifier::new(&platform(|c| c.gimbals.step_deg = Some(90.0)));
    let bound = |c: &Criterion| certifier.criterion_bound(c, 8000.0).unwrap().lower_bound;
    let rms = bound(&Criterion::rms());
    let spec = CoefficientVector::from_fn(|i, _| if i == 4 { 0.001 } else { f64::INFINITY });
    let alone = bound(&Criterion::MaxRatio {
        spec_deg_per_h: spec,
    });
    let weights = CoefficientVector::from_fn(|i, _| if i == 4 { 1.0 } else { 0.0 });
    let same = bound(&Criterion::A { weights });
    assert!((alone * 0.001 / same - 1.0).abs() < 2e-3, "{alone} {same}");
    let even = CoefficientVector::repeat(0.001);
    let largest = bound(&Criterion::MaxRatio {
        spec_deg_per_h: even,
    });
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
    assert!(bound.remarks[0].contains("the prior itself"));
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
    let cases: [(&str, fn(&mut PlatformConfig)); 9] = [
        ("", |c| c.gyro.random_drift_deg_per_h = Some(0.0)),
        ("pole", |c| c.site.latitude_deg = 90.0),
        ("", |c| c.site.latitude_deg = -89.999),
        ("", |c| c.accelerometer.noise_g = 1e-12),
        ("", |c| c.accelerometer.noise_g = 1.0),
        ("", |c| c.filter.period_s = 1e-2),
        ("", |c| c.filter.period_s = 3000.0),
        ("weak", |c| {
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
            let said = bound.remarks.join("; ");
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
        let criterion = Criterion::MaxRatio {
            spec_deg_per_h: spec,
        };
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
