//! The reverse-mode gradient against dual numbers and finite differences.
//!
//! The dual-number oracle is a second implementation of the model: it steps tick by tick with
//! scalar measurement updates instead of kernels, and integrates moves by its own quadrature.

use num_dual::{Dual64 as T, DualNum};
use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::covariance::gradient::LegGradient;
use scheme_opt::internals::covariance::{CoefficientCovariance, CovarianceModel, TickRule};
use scheme_opt::internals::criterion::{Criterion, Smoothing};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{Platform, PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use scheme_opt::internals::units::ARCSEC_PER_RAD;

use crate::support::Random;

type V3 = [T; 3];
type M3 = [[T; 3]; 3];
/// Column of C_c^n, and the g-component with its sign, of each coefficient: the corrected (21).
const TERMS: [(usize, Option<(usize, f64)>); 12] = [
    (0, None),
    (1, None),
    (2, None),
    (0, Some((0, 1.0))),
    (1, Some((1, 1.0))),
    (2, Some((2, 1.0))),
    (0, Some((2, -1.0))),
    (1, Some((2, -1.0))),
    (2, Some((0, 1.0))),
    (0, Some((1, 1.0))),
    (1, Some((0, -1.0))),
    (2, Some((1, 1.0))),
];

/// One leg with every continuous quantity a `T`.
#[derive(Clone, Copy)]
struct DualLeg {
    angles: V3,
    dwell_s: T,
    move_s: T,
    measured: bool,
}

struct Oracle<'a> {
    platform: &'a Platform,
    v: [[T; 12]; 3],
    p: M3,
    e: [[T; 12]; 12],
}

fn zero() -> T {
    T::from_re(0.0)
}

fn matrix(f: impl Fn(usize, usize) -> T) -> M3 {
    std::array::from_fn(|i| std::array::from_fn(|j| f(i, j)))
}

fn product(a: &M3, b: &M3) -> M3 {
    matrix(|i, j| a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j])
}

fn transpose(a: &M3) -> M3 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

fn attitude(angles: V3) -> M3 {
    let [(sa, ca), (sb, cb), (sg, cg)] = angles.map(|a| a.sin_cos());
    let (o, z) = (T::from_re(1.0), zero());
    let mx = [[o, z, z], [z, ca, sa], [z, -sa, ca]];
    let my = [[cb, z, -sb], [z, o, z], [sb, z, cb]];
    let mz = [[cg, sg, z], [-sg, cg, z], [z, z, o]];
    product(&mx, &product(&my, &mz))
}

fn drift_matrix(c: &M3) -> [[T; 12]; 3] {
    std::array::from_fn(|i| {
        std::array::from_fn(|a| {
            let (column, excitation) = TERMS[a];
            match excitation {
                None => c[i][column],
                Some((axis, sign)) => c[i][column] * -c[1][axis] * sign,
            }
        })
    })
}

impl<'a> Oracle<'a> {
    fn new(platform: &'a Platform) -> Self {
        let prior = platform.prior_misalignment_rad();
        Self {
            platform,
            v: [[zero(); 12]; 3],
            p: matrix(|i, j| match i == j {
                true => T::from_re((prior[i] * ARCSEC_PER_RAD).powi(2)),
                false => zero(),
            }),
            e: [[zero(); 12]; 12],
        }
    }

    /// Φ(t), Γ(t) by their Taylor series.
    fn transition(&self, t: T) -> (M3, M3) {
        let w = self.platform.earth_rate_n();
        let f = -w.cross_matrix();
        let f: M3 = matrix(|i, j| T::from_re(f[(i, j)]));
        let identity: M3 = matrix(|i, j| T::from_re(if i == j { 1.0 } else { 0.0 }));
        let (mut phi, mut gamma, mut term) =
            (matrix(|_, _| zero()), matrix(|_, _| zero()), identity);
        for k in 1..16 {
            let step = t / f64::from(k);
            phi = matrix(|i, j| phi[i][j] + term[i][j]);
            gamma = matrix(|i, j| gamma[i][j] + term[i][j] * step);
            let next = product(&f, &term);
            term = matrix(|i, j| next[i][j] * step);
        }
        (phi, gamma)
    }

    fn advance(&mut self, phi: &M3, b: &[[T; 12]; 3], t: T) {
        let v = self.v;
        self.v = std::array::from_fn(|i| {
            std::array::from_fn(|a| {
                phi[i][0] * v[0][a] + phi[i][1] * v[1][a] + phi[i][2] * v[2][a] + b[i][a]
            })
        });
        let p = product(phi, &product(&self.p, &transpose(phi)));
        let q = t * (self.platform.drift_psd_rad2_per_s() * ARCSEC_PER_RAD.powi(2));
        self.p = matrix(|i, j| if i == j { p[i][j] + q } else { p[i][j] });
    }

    fn pass_at(&mut self, angles: V3, t: T) {
        let (phi, gamma) = self.transition(t);
        let a = drift_matrix(&attitude(angles));
        let b = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                gamma[i][0] * a[0][j] + gamma[i][1] * a[1][j] + gamma[i][2] * a[2][j]
            })
        });
        self.advance(&phi, &b, t);
    }

    /// Interval of a move by composite Simpson steps.
    fn moving(&mut self, from: V3, change: V3, duration: T, start: T, length: T) {
        // A tick turns by a few degrees, a whole move by up to half a turn.
        let panels = if length.re > 20.0 { 160 } else { 12 };
        let mut b = [[zero(); 12]; 3];
        for node in 0..=2 * panels {
            let weight = match node {
                0 => 1.0,
                n if n == 2 * panels => 1.0,
                n if n % 2 == 1 => 4.0,
                _ => 2.0,
            } / (6.0 * panels as f64);
            let share = node as f64 / (2 * panels) as f64;
            let fraction = (start + length * share) / duration;
            let angles: V3 = std::array::from_fn(|i| from[i] + change[i] * fraction);
            let a = drift_matrix(&attitude(angles));
            let (phi, _) = self.transition(length * (1.0 - share));
            for i in 0..3 {
                for j in 0..12 {
                    let sum = phi[i][0] * a[0][j] + phi[i][1] * a[1][j] + phi[i][2] * a[2][j];
                    b[i][j] += sum * length * weight;
                }
            }
        }
        let (phi, _) = self.transition(length);
        self.advance(&phi, &b, length);
    }

    /// ψ_x and ψ_z, one after the other, with information `share`/r² each.
    fn measure(&mut self, share: T) {
        let w = share / (self.platform.noise_g() * ARCSEC_PER_RAD).powi(2);
        for axis in [0, 2] {
            let t = self.v[axis];
            let column: V3 = std::array::from_fn(|i| self.p[i][axis]);
            let gain = w / (w * column[axis] + 1.0);
            for i in 0..12 {
                for j in 0..12 {
                    self.e[i][j] += gain * t[i] * t[j];
                }
            }
            for i in 0..3 {
                for j in 0..12 {
                    self.v[i][j] -= gain * column[i] * t[j];
                }
                for j in 0..3 {
                    self.p[i][j] -= gain * column[i] * column[j];
                }
            }
        }
    }

    /// Whole periods, and what is left.
    fn ticks(&self, t: T) -> (usize, T) {
        let period = self.platform.period_s();
        let whole = (t.re / period + 1e-9).floor();
        (whole as usize, t - whole * period)
    }

    fn run(mut self, legs: &[DualLeg], rule: TickRule) -> T {
        let period = self.platform.period_s();
        for (k, leg) in legs.iter().enumerate() {
            if k > 0 {
                self.arrive(&legs[k - 1], leg, rule);
            }
            let (ticks, rest) = self.ticks(leg.dwell_s);
            for _ in 0..ticks {
                self.pass_at(leg.angles, T::from_re(period));
                self.measure(T::from_re(1.0));
            }
            self.pass_at(leg.angles, rest);
            if rule == TickRule::Relaxed {
                self.measure(rest / period);
            }
        }
        self.log_rms()
    }

    fn arrive(&mut self, before: &DualLeg, leg: &DualLeg, rule: TickRule) {
        let motion = self.platform.motion();
        if motion.repositioning == Repositioning::FrameHold {
            let q = product(&attitude(leg.angles), &transpose(&attitude(before.angles)));
            let zero_drift = [[zero(); 12]; 3];
            self.advance(&q, &zero_drift, zero());
        } else {
            let change: V3 = std::array::from_fn(|i| {
                let raw = leg.angles[i] - before.angles[i];
                let wrapped = raw.re.sin().atan2(raw.re.cos());
                raw + (wrapped - raw.re)
            });
            let period = T::from_re(self.platform.period_s());
            if leg.measured {
                let (ticks, rest) = self.ticks(leg.move_s);
                for tick in 0..ticks {
                    let start = T::from_re(tick as f64 * period.re);
                    self.moving(before.angles, change, leg.move_s, start, period);
                    self.measure(T::from_re(1.0));
                }
                let start = T::from_re(ticks as f64 * period.re);
                self.moving(before.angles, change, leg.move_s, start, rest);
                if rule == TickRule::Relaxed {
                    self.measure(rest / period);
                }
            } else {
                self.moving(before.angles, change, leg.move_s, zero(), leg.move_s);
            }
        }
        if !leg.measured {
            self.pass_at(leg.angles, T::from_re(motion.settle_s));
        }
    }

    /// ½ ln(mean σ²) through a Cholesky factorisation of I + S E S.
    fn log_rms(&self) -> T {
        let sigma: Vec<f64> = self
            .platform
            .prior_drift_rad_per_s()
            .iter()
            .map(|v| v * ARCSEC_PER_RAD)
            .collect();
        let mut l = [[zero(); 12]; 12];
        for j in 0..12 {
            for i in j..12 {
                let mut sum = self.e[i][j] * (sigma[i] * sigma[j]);
                if i == j {
                    sum += 1.0;
                }
                for k in 0..j {
                    sum -= l[i][k] * l[j][k];
                }
                l[i][j] = if i == j { sum.sqrt() } else { sum / l[j][j] };
            }
        }
        // P_ii is the squared norm of row i of L⁻ᵀ, columns of L⁻¹ by forward substitution.
        let mut mean = zero();
        for i in 0..12 {
            let mut x = [zero(); 12];
            for r in i..12 {
                let mut sum = if r == i { T::from_re(1.0) } else { zero() };
                for k in i..r {
                    sum -= l[r][k] * x[k];
                }
                x[r] = sum / l[r][r];
                mean += x[r] * x[r] * (sigma[i] * sigma[i] / 12.0);
            }
        }
        mean.ln() * 0.5
    }
}

/// The quantities a gradient is taken for, leg by leg: α, β, γ, dwell, move.
const PER_LEG: usize = 5;

fn flatten(gradient: &[LegGradient]) -> Vec<f64> {
    let mut g = Vec::new();
    for leg in gradient {
        g.extend(leg.angles);
        g.extend([leg.dwell_s, leg.move_s]);
    }
    g
}

struct Problem {
    platform: Platform,
    measured: Vec<bool>,
    x: Vec<f64>,
    rule: TickRule,
}

impl Problem {
    fn timeline(&self, x: &[f64]) -> Timeline {
        let positions =
            x.chunks(PER_LEG)
                .zip(&self.measured)
                .map(|(c, measured)| ScheduledPosition {
                    move_s: Some(c[4]).filter(|_| !self.frame_hold()),
                    move_measured: Some(*measured),
                    ..ScheduledPosition::new(Position::from_rad(c[0], c[1], c[2]), c[3])
                });
        Timeline::new(
            &self.platform.clone().into(),
            &Schedule::new(positions.collect()).unwrap(),
        )
        .unwrap()
    }

    fn frame_hold(&self) -> bool {
        self.platform.motion().repositioning == Repositioning::FrameHold
    }

    fn value(&self, model: &CovarianceModel, x: &[f64]) -> f64 {
        let end = model.end_covariance(&self.timeline(x), self.rule).unwrap();
        Criterion::rms().value(&end).unwrap().ln()
    }

    fn gradient(&self, model: &CovarianceModel) -> (f64, Vec<f64>) {
        let merit =
            |p: &dyn CoefficientCovariance| Criterion::rms().log_with_gradient(p, Smoothing::Exact);
        let (value, gradient) = model
            .gradient(&self.timeline(&self.x), self.rule, merit)
            .unwrap();
        (value, flatten(&gradient))
    }

    fn dual(&self, seed: usize) -> T {
        let x = |i: usize| match i == seed {
            true => T::from_re(self.x[i]).derivative(),
            false => T::from_re(self.x[i]),
        };
        let legs: Vec<DualLeg> = (0..self.measured.len())
            .map(|k| DualLeg {
                angles: std::array::from_fn(|i| x(PER_LEG * k + i)),
                dwell_s: x(PER_LEG * k + 3),
                move_s: x(PER_LEG * k + 4),
                measured: self.measured[k],
            })
            .collect();
        Oracle::new(&self.platform).run(&legs, self.rule)
    }

    /// Which parameters exist: nothing precedes the first position, frame-hold takes no time.
    fn has(&self, i: usize) -> bool {
        i % PER_LEG != 4 || (i / PER_LEG > 0 && !self.frame_hold())
    }
}

/// Random schedules with moves, measured moves, uneven dwells, both modes and both tick rules.
fn problems() -> Vec<Problem> {
    let mut random = Random(7);
    (0..12)
        .map(|case| {
            let mut config = PlatformConfig::default();
            config.site.latitude_deg = random.between(-80.0, 80.0);
            config.motion.settle_s = if case % 2 == 0 { 30.0 } else { 0.0 };
            if case % 4 == 3 {
                config.motion.repositioning = Repositioning::FrameHold;
            }
            let legs = 6 + case % 3;
            let mut x = Vec::new();
            let mut measured = Vec::new();
            for k in 0..legs {
                x.extend(random.position().to_array());
                // Some whole numbers of periods, where the derivative is one-sided.
                let dwell = random.between(150.0, 900.0);
                x.push(if case % 3 == 0 { dwell } else { dwell.round() });
                x.push(if k == 0 {
                    0.0
                } else {
                    random.between(60.0, 300.0)
                });
                measured.push(case % 4 == 1 || (case % 4 == 2 && k % 2 == 1));
            }
            Problem {
                platform: config.check().unwrap(),
                measured,
                x,
                rule: if case % 2 == 0 {
                    TickRule::Relaxed
                } else {
                    TickRule::Filter
                },
            }
        })
        .collect()
}

/// Relative to the size of the whole gradient: single components may pass through zero.
fn worst_difference(problem: &Problem, found: &[f64], expected: &[f64]) -> f64 {
    // Angles (per rad) and times (per s) differ in scale; each kind against its own size.
    let kind = |i: usize| usize::from(i % PER_LEG >= 3);
    let mut size = [0.0_f64; 2];
    for (i, e) in expected.iter().enumerate() {
        size[kind(i)] = size[kind(i)].max(e.abs());
    }
    let used = (0..found.len()).filter(|&i| problem.has(i));
    used.map(|i| (found[i] - expected[i]).abs() / size[kind(i)])
        .fold(0.0, f64::max)
}

#[test]
fn the_searches_covariance_is_that_of_square_roots() {
    for (case, problem) in problems().iter().enumerate() {
        let model = CovarianceModel::new(&problem.platform);
        let timeline = problem.timeline(&problem.x);
        let fast = model.end_covariance_by_gram(&timeline, problem.rule);
        let root = model.end_covariance(&timeline, problem.rule);
        let (fast, root) = (fast.unwrap(), root.unwrap());
        let p = (fast.coefficients - root.coefficients).amax() / root.coefficients.amax();
        let m = (fast.misalignment - root.misalignment).amax() / root.misalignment.amax();
        assert!(p < 1e-9 && m < 1e-9, "case {case}: {p:e} {m:e}");
    }
}

#[test]
fn reverse_mode_equals_dual_numbers_to_1e_7() {
    for (case, problem) in problems().iter().enumerate() {
        let model = CovarianceModel::new(&problem.platform);
        let (value, gradient) = problem.gradient(&model);
        let timeline = problem.timeline(&problem.x);
        let end = model
            .end_covariance_by_gram(&timeline, problem.rule)
            .unwrap();
        let plain = Criterion::rms().value(&end).unwrap().ln();
        assert!((value - plain).abs() < 1e-12);
        let duals: Vec<T> = (0..gradient.len()).map(|i| problem.dual(i)).collect();
        assert!(
            (duals[0].re - value).abs() < 1e-8,
            "{case}: {} {value}",
            duals[0].re
        );
        let expected: Vec<f64> = duals.iter().map(|d| d.eps).collect();
        let worst = worst_difference(problem, &gradient, &expected);
        println!("case {case}: against dual numbers {worst:.1e}");
        assert!(worst < 1e-7, "case {case}: {worst:e}");
    }
}

#[test]
fn reverse_mode_equals_finite_differences_to_1e_7() {
    for (case, problem) in problems().iter().enumerate() {
        let model = CovarianceModel::new(&problem.platform);
        let (_, gradient) = problem.gradient(&model);
        let mut expected = gradient.clone();
        for (i, slot) in expected
            .iter_mut()
            .enumerate()
            .filter(|(i, _)| problem.has(*i))
        {
            let is_time = i % PER_LEG >= 3;
            let period = problem.platform.period_s();
            let off_tick = (problem.x[i] / period).fract() * period;
            // Differences of a time must not step across a tick.
            if is_time && !(0.5..period - 0.5).contains(&off_tick) {
                continue;
            }
            let h = if is_time { 0.1 } else { 1e-3 };
            let f = |by: f64| {
                let mut x = problem.x.clone();
                x[i] += by;
                problem.value(&model, &x)
            };
            // Sixth-order central differences.
            *slot = (45.0 * (f(h) - f(-h)) - 9.0 * (f(2.0 * h) - f(-2.0 * h))
                + (f(3.0 * h) - f(-3.0 * h)))
                / (60.0 * h);
        }
        let worst = worst_difference(problem, &gradient, &expected);
        println!("case {case}: against finite differences {worst:.1e}");
        assert!(worst < 1e-7, "case {case}: {worst:e}");
    }
}
