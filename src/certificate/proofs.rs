//! The steps of `docs/certificate.md`, each against dense matrices or brute force.

mod criteria;
mod design;

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::conditions::{Cells, Conditions};
use super::design::Space;
use super::directions::Directions;
use super::majorant::{Bounded, Choice, Emphasis, Majorant, majorants};
use super::profile::{profile, profile_of_the_best, profiles};
use super::recursion::{Recursion, isotropic_holds};
use super::*;
use crate::attitude::{Attitude, EAST, NORTH, Position, UP};
use crate::covariance::CovarianceModel;
use crate::drift::{DriftMatrix, drift_matrix};
use crate::motion::Timeline;
use crate::platform::{AxisValue, OutputAxes, PlatformConfig, Repositioning};
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
    fn position(&mut self) -> Position {
        Position::from_rad(
            self.between(-3.1, 3.1),
            self.between(-3.1, 3.1),
            self.between(-3.1, 3.1),
        )
    }
}

fn recursion(platform: &Platform, total_time_s: f64) -> Recursion {
    let conditions = Conditions::new(platform);
    let cells = Cells::new(&conditions, total_time_s).unwrap();
    let profile = profile(&conditions, &cells);
    Recursion::new(conditions, cells, profile)
}

/// The recursion that `bounded` was found with.
fn recursion_of(platform: &Platform, total_time_s: f64, bounded: &Bounded) -> Recursion {
    let conditions = Conditions::new(platform);
    let cells = Cells::new(&conditions, total_time_s).unwrap();
    let of_the_best = profile_of_the_best(&conditions, &cells);
    profiles(&conditions, &cells)
        .into_iter()
        .chain([of_the_best])
        .map(|shape| Recursion::new(conditions.clone(), cells, shape))
        .find(|r| r.mass == bounded.mass || bounded.mass == total_time_s)
        .unwrap()
}

/// The components of ψ^n that are measured, each with its variance.
fn measured(conditions: &Conditions) -> Vec<(usize, f64)> {
    let level = [NORTH, EAST].map(|axis| (axis, conditions.noise_variance));
    let azimuth = conditions.azimuth_variance.map(|v| (UP, v));
    level.into_iter().chain(azimuth).collect()
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
    let axes = measured(c);
    let count = axes.len();
    let mut out = DMatrix::zeros(count * times.len(), count * times.len());
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
            for (i, (a, variance)) in axes.iter().enumerate() {
                for (j, (b, _)) in axes.iter().enumerate() {
                    out[(count * k + i, count * l + j)] = block[(*a, *b)];
                }
                if k == l {
                    out[(count * k + i, count * k + i)] += variance;
                }
            }
        }
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
        (50.0, 28.2, 0.01, 1000.0, None),
        (100.0, -70.0, 0.003, 1450.0, None),
        (60.0, 0.0, 0.0, 700.0, None),
        (50.0, 28.2, 0.01, 1000.0, Some(5.0)),
        (50.0, 28.2, 0.003, 1000.0, Some(0.4)),
        (100.0, -70.0, 0.003, 1450.0, Some(30.0)),
        (60.0, 0.0, 0.0, 700.0, Some(1.0)),
        (80.0, 90.0, 0.01, 1000.0, Some(3.0)),
    ];
    for (period, latitude, drift, total, azimuth) in cases {
        let platform = platform(|c| {
            c.filter.period_s = period;
            c.site.latitude_deg = latitude;
            c.gyro.random_drift_deg_per_h = Some(drift);
            c.azimuth.noise_arcsec = azimuth;
        });
        let bounded = rms_majorant(&platform, total);
        let r = recursion_of(&platform, total, &bounded);
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
            assert!(least > 0.0, "{period} {latitude} {azimuth:?}: {least}");
        }
        if period > 50.0 {
            // What sharing out costs grows with the period: close only where it is short.
            continue;
        }
        let uniform: Vec<f64> = (1..=r.cells.measurements as usize)
            .map(|i| i as f64 * period)
            .collect();
        let trace = 0.5
            * r.sharing
                .trace_variance(&r.conditions, &r.cells, prior, 1e-3);
        let short = least_eigenvalue(&dense(&r, &uniform, trace, noise(0.6)));
        assert!(short < 0.0, "{period} {latitude} {azimuth:?}: {short}");
    }
}

/// Section 4: no admissible set of times gives more information on the trace than the bound.
#[test]
fn the_trace_is_never_known_better_than_its_bound() {
    let mut numbers = Numbers(2);
    for (latitude, azimuth) in [
        (28.2, None),
        (28.2, Some(0.5)),
        (28.2, Some(5.0)),
        (-60.0, Some(200.0)),
        (90.0, Some(5.0)),
    ] {
        let platform = platform(|c| {
            c.filter.period_s = 50.0;
            c.site.latitude_deg = latitude;
            c.azimuth.noise_arcsec = azimuth;
        });
        let r = recursion(&platform, 2000.0);
        let bound = r.trace_information();
        let information = |times: &[f64]| trace_information(&r, times);
        let uniform: Vec<f64> = (1..=40).map(|i| f64::from(i) * 50.0).collect();
        let full = information(&uniform);
        assert!(
            full <= bound && full > 0.97 * bound,
            "{azimuth:?} {full} {bound}"
        );
        for _ in 0..10 {
            let times = admissible_times(&mut numbers, 50.0, 2000.0);
            assert!(information(&times) <= bound);
        }
    }
}

/// The same with cells of three periods, as very long tests have them, in which sharing out costs
/// much more and the start of the test is a grid point.
#[test]
fn cells_of_several_periods_majorise_too() {
    let mut numbers = Numbers(9);
    let (period, kappa) = (60.0, 0.05);
    for (latitude, total, azimuth) in [
        (28.2, 1440.0, None),
        (-75.0, 1500.0, None),
        (28.2, 1440.0, Some(5.0)),
        (-75.0, 1500.0, Some(2.5)),
    ] {
        let platform = platform(|c| {
            c.filter.period_s = period;
            c.site.latitude_deg = latitude;
            c.azimuth.noise_arcsec = azimuth;
            // A start that is known well makes the first measurements count.
            c.prior.misalignment_deg = crate::platform::AxisValue::All(0.02);
        });
        let conditions = Conditions::new(&platform);
        let cells = Cells {
            count: (total / (3.0 * period)).ceil() as usize,
            length_s: 3.0 * period,
            per_cell: 3.0,
            measurements: (total / period).floor(),
            total_time_s: total,
        };
        assert!(cells.measures_at_start());
        let inside: f64 = (0..cells.count).map(|j| cells.inside_s(j)).sum();
        assert!((inside - total).abs() < 1e-9);
        let shape = profile(&conditions, &cells);
        let r = Recursion::new(conditions, cells, shape);
        let prior = r.conditions.decoupled_prior_information()[3].recip();
        let trace = r
            .sharing
            .trace_variance(&r.conditions, &cells, prior, kappa);
        // An azimuth tells as much of the vertical channel as there is of the others.
        let ratios = match azimuth {
            None => [1.0, 0.3, 1.1],
            Some(_) => [1.0, 1.2, 1.1],
        };
        let scaled = |s: f64| ratios.map(|v| v * s);
        let mut steps = (0..400).map(|k| 1e-3 * 1.03_f64.powi(k) / r.profile[0]);
        let scale = steps
            .clone()
            .find(|s| r.holds(&scaled(*s), trace, kappa))
            .unwrap_or_else(|| panic!("{latitude} {azimuth:?}"));
        let psd = r.conditions.drift_psd;
        let f = r.profile.clone();
        let noise = |cell: usize| Vector3::from(scaled(scale).map(|d| psd - 1.0 / (d * f[cell])));
        let bound = r.trace_information();
        let mut sets: Vec<Vec<f64>> = (0..12)
            .map(|_| admissible_times(&mut numbers, period, total))
            .collect();
        sets.push((1..=24).map(|i| f64::from(i) * period).collect());
        for times in sets {
            let least = least_eigenvalue(&dense(&r, &times, trace, noise));
            assert!(least > 0.0, "{latitude}: {least}");
            assert!(trace_information(&r, &times) <= bound);
        }
        // Each channel alone.
        let one = steps.find(|s| isotropic_holds(&r, *s)).unwrap();
        for _ in 0..12 {
            let times = admissible_times(&mut numbers, period, total);
            assert!(least_eigenvalue(&one_channel(&r, &times, one)) > 0.0);
        }
    }
}

/// Information that measurements at `times` give on the trace, its drift the only unknown one.
fn trace_information(r: &Recursion, times: &[f64]) -> f64 {
    let down = Vector3::new(0.0, -1.0 / 3.0_f64.sqrt(), 0.0);
    let covariance = dense(r, times, 0.0, |_| Vector3::repeat(r.conditions.drift_psd));
    let axes = measured(&r.conditions);
    let seen = nalgebra::DVector::from_fn(axes.len() * times.len(), |i, _| {
        let drifted = r.conditions.dynamics.integral(times[i / axes.len()]) * down;
        drifted[axes[i % axes.len()].0]
    });
    seen.dot(&covariance.cholesky().unwrap().solve(&seen))
}

/// The covariance of one channel's measurements with the majorant `delta` off its process noise.
fn one_channel(r: &Recursion, times: &[f64], delta: f64) -> DMatrix<f64> {
    let length = r.cells.length_s;
    let integral = |end: f64| {
        (0..r.cells.count)
            .map(|j| {
                let inside = (end - j as f64 * length).clamp(0.0, length);
                inside * (r.conditions.drift_psd - 1.0 / (delta * r.profile[j]))
            })
            .sum::<f64>()
    };
    DMatrix::from_fn(times.len(), times.len(), |k, l| {
        let noise = if k == l {
            r.conditions.least_variance()
        } else {
            0.0
        };
        r.conditions.prior_psi.min() + integral(times[k].min(times[l])) + noise
    })
}

/// Section 7: the isotropic majorant, ψ^n turned at will between measurements of all three axes.
#[test]
fn the_isotropic_recursion_majorises_one_channel() {
    let mut numbers = Numbers(3);
    for azimuth in [None, Some(0.7), Some(30.0)] {
        let platform = platform(|c| {
            c.filter.period_s = 20.0;
            c.motion.repositioning = Repositioning::FrameHold;
            c.azimuth.noise_arcsec = azimuth;
        });
        let bounded = rms_majorant(&platform, 1500.0);
        assert_eq!(bounded.kind, Majorant::Isotropic);
        let r = recursion_of(&platform, 1500.0, &bounded);
        let delta = bounded.delta[0];
        assert!(isotropic_holds(&r, delta) && !isotropic_holds(&r, 0.99 * delta));
        for _ in 0..25 {
            let times = admissible_times(&mut numbers, 20.0, 1500.0);
            let covariance = one_channel(&r, &times, delta);
            assert!(least_eigenvalue(&covariance) > 0.0);
        }
    }
}

/// The chain of sections 1 to 4 end to end: S of a schedule, from its computed covariance, lies
/// below Λ + ∫ AᵀΔA dt over the attitudes it takes.
#[test]
fn the_information_of_a_schedule_is_majorised_as_a_matrix() {
    let mut numbers = Numbers(4);
    type Change = fn(&mut PlatformConfig);
    let cases: [(&str, Change); 8] = [
        ("default", |_| {}),
        ("-80", |c| c.site.latitude_deg = -80.0),
        ("frame-hold", |c| {
            c.motion.repositioning = Repositioning::FrameHold
        }),
        ("azimuth", |c| c.azimuth.noise_arcsec = Some(5.0)),
        ("good azimuth", |c| {
            c.azimuth.noise_arcsec = Some(0.5);
            c.site.latitude_deg = 55.0;
        }),
        ("azimuth at a pole", |c| {
            c.azimuth.noise_arcsec = Some(20.0);
            c.site.latitude_deg = 90.0;
        }),
        ("mounting and azimuth in frame-hold", |c| {
            c.azimuth.noise_arcsec = Some(1.0);
            c.gyro.output_axis = another_mounting();
            c.motion.repositioning = Repositioning::FrameHold;
        }),
        ("everything", |c| {
            c.azimuth.noise_arcsec = Some(5.0);
            c.gyro.output_axis = another_mounting();
            let errors = &mut c.errors.estimated;
            errors.torquer_scale_factor_ppm = Some(AxisValue::All(1000.0));
            errors.torquer_misalignment_arcsec = Some(AxisValue::All(60.0));
            errors.quadratic_drift_deg_per_h_per_g2 = Some(AxisValue::All(0.1));
            errors.accelerometer_bias_ug = Some(AxisValue::All(100.0));
            c.errors.considered.accelerometer_scale_factor_ppm = Some(AxisValue::All(3.0));
        }),
    ];
    for (name, change) in cases {
        let platform = platform(change);
        let total = 3000.0;
        let conditions = Conditions::new(&platform);
        let bounded = rms_majorant(&platform, total);
        let r = recursion_of(&platform, total, &bounded);
        let model = CovarianceModel::new(&platform);
        let everything = Directions::unlimited();
        let trace = bounded.trace_information.and(conditions.trace_direction());
        let prior = conditions.decoupled_prior_information();
        let space = Space::new(
            &everything,
            bounded,
            &prior,
            trace.as_ref(),
            conditions.mixing.as_ref(),
        );
        for _ in 0..10 {
            let mut dwells: Vec<f64> = (0..8).map(|_| numbers.between(0.2, 1.0)).collect();
            let sum: f64 = dwells.iter().sum();
            dwells.iter_mut().for_each(|d| *d *= total / sum);
            let positions: Vec<ScheduledPosition> = dwells
                .iter()
                .map(|d| ScheduledPosition::new(numbers.position(), *d))
                .collect();
            let timeline =
                Timeline::new(&platform.clone().into(), &Schedule::new(positions).unwrap())
                    .unwrap();
            let end = model.full_covariance(&timeline).unwrap().end;
            let p = DMatrix::from_fn(12, 12, |i, j| end.coefficients[(i, j)]);
            // The block of P off the trace is S⁻¹.
            let inverse = space.basis.transpose() * p * &space.basis;
            let s = inverse.try_inverse().unwrap();
            let mut majorant = space.prior.clone();
            let mut start = 0.0;
            for leg in timeline.legs() {
                let share = mass_between(&r, &bounded, start, start + leg.dwell_s);
                start += leg.dwell_s;
                let a: DriftMatrix = model.drift_matrix(&leg.attitude);
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
            assert!(least > -1e-6, "{name}: {least}");
        }
    }
}

/// Output axes that are none of the paper's, one of them oblique.
fn another_mounting() -> OutputAxes {
    serde_json::from_str(r#"{"X": [0.0, 0.6, 0.8], "Y": "+x", "Z": "-y"}"#).unwrap()
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

/// Section 7 of `docs/certificate.md`: the bounds are as sharp as is said there.
#[test]
fn the_bounds_are_the_figures_of_the_documentation() {
    type Change = fn(&mut PlatformConfig);
    let cases: [(f64, Change); 4] = [
        (0.000_861_2, |_| {}),
        (0.001_730, |c| c.gimbals.step_deg = Some(90.0)),
        (0.000_963_5, |c| {
            c.gimbals.alpha_deg = Some([-45.0, 45.0]);
            c.gimbals.beta_deg = Some([-45.0, 45.0]);
            c.gimbals.gamma_deg = Some([-45.0, 45.0]);
        }),
        (0.000_464_2, |c| {
            c.motion.repositioning = Repositioning::FrameHold;
        }),
    ];
    for (figure, change) in cases {
        let certifier = Certifier::new(&platform(change));
        let bound = certifier.criterion_bound(&Criterion::rms(), 12_000.0);
        let bound = bound.unwrap();
        assert!((bound.lower_bound / figure - 1.0).abs() < 3e-4, "{bound:?}");
    }
    let certifier = Certifier::new(&platform(|_| {}));
    let bound = certifier.criterion_bound(&Criterion::rms(), 12_000.0);
    let psd = certifier.conditions.drift_psd;
    let delta = bound.unwrap().majorant.unwrap().delta.map(|d| d * psd);
    for (delta, figure) in delta.into_iter().zip([0.967, 0.135, 1.047]) {
        assert!((delta - figure).abs() < 1.5e-3, "{delta} {figure}");
    }
}
