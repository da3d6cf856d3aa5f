//! The chain in dual numbers: derivatives without a reverse mode and without differences.
//!
//! A dual number is a value with its slope along one variable, so that the forward chain gives the
//! derivative along it exactly; always on the largest shape, whatever the platform's own.

use std::ops::{Add, Div, Mul, Neg, Sub};

use serde_json::{Value, json};

use super::{Random, merged, motions, positions, timeline};
use crate::covariance::fast::arithmetic::{Arithmetic, InArray, Number, Plain, Work, three};
use crate::covariance::fast::course::{self, Legs, Stretch, Tape};
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::gains::{DwellKernel, Own};
use crate::covariance::fast::mixing::Mixing;
use crate::covariance::fast::moves::Interval;
use crate::covariance::fast::posterior::Posterior;
use crate::covariance::fast::shape::{Catalogue, Facts};
use crate::covariance::fast::single::OneTimeline;
use crate::covariance::fast::square::Entries;
use crate::covariance::fast::turn::{Ramp, Turn};
use crate::covariance::{CovarianceModel, TickRule};
use crate::criterion::{Criterion, Smoothing};
use crate::drift::COEFFICIENTS;
use crate::motion::Timeline;
use crate::motion::integral::Panels;
use crate::platform::{Platform, PlatformConfig};

/// A value and its slope.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Dual(f64, f64);

impl Add for Dual {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self(self.0 + o.0, self.1 + o.1)
    }
}
impl Sub for Dual {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self(self.0 - o.0, self.1 - o.1)
    }
}
impl Mul for Dual {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self(self.0 * o.0, self.1 * o.0 + self.0 * o.1)
    }
}
impl Div for Dual {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let ratio = self.0 / o.0;
        Self(ratio, (self.1 - ratio * o.1) / o.0)
    }
}
impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }
}
impl Number for Dual {
    fn constant(self, value: f64) -> Self {
        Self(value, 0.0)
    }
    fn mul_add(self, factor: Self, term: Self) -> Self {
        let sum = self * factor + term;
        // Sines round their argument to whole quarter turns by adding 1.5·2⁵²: no slope in that.
        match (sum.0 - 1.5 * (1u64 << 52) as f64).abs() < 1e9 {
            true => known(sum.0),
            false => sum,
        }
    }
    fn sqrt(self) -> Self {
        let root = self.0.sqrt();
        Self(root, self.1 / (2.0 * root))
    }
    fn where_greater(self, left: Self, right: Self, otherwise: Self) -> Self {
        // A weight of nothing that grows is more than none: what it does has a slope.
        let greater = (left.0, left.1) > (right.0, right.1);
        if greater { self } else { otherwise }
    }
}

fn known(value: f64) -> Dual {
    Dual(value, 0.0)
}

#[derive(Debug, Clone, Copy)]
struct Dually;

impl Arithmetic for Dually {
    type Number = Dual;
    type Triple = InArray<Dual, 3>;
    type Quad = InArray<Dual, 4>;
    type Node = Dual;
    type Panels = Panels;
    const PASSES: usize = 4;

    fn always_apart<W: Work>(self, work: W) -> W::Output {
        Plain.always_apart(work)
    }
    fn number(self, value: f64) -> Dual {
        known(value)
    }
    fn triple(self, entries: [Dual; 3]) -> Self::Triple {
        InArray(entries)
    }
    fn constants(self, padded: &[f64; 4]) -> Self::Triple {
        InArray([0, 1, 2].map(|i| known(padded[i])))
    }
    fn quad(self, entries: [Dual; 4]) -> Self::Quad {
        InArray(entries)
    }
    fn at_nodes(self, value: Dual) -> Dual {
        value
    }
    fn steps(self, panels: &Panels) -> usize {
        panels.steps()
    }
    fn panel_share(self, panels: &Panels) -> Dual {
        known(panels.share())
    }
    fn nodes(self, panels: &Panels, pass: usize, step: usize) -> [Dual; 2] {
        let (panel, group) = panels.group(step);
        [group.places[pass] + panel, group.weights[pass]].map(known)
    }
    fn sum_nodes(self, values: Dual) -> Dual {
        values
    }
}

/// What the derivative is along.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Along {
    Angle(usize),
    Dwell,
    Move,
}

/// A timeline with the slopes along something of one leg.
struct DualLegs<'a> {
    plain: OneTimeline<'a, Plain>,
    leg: usize,
    along: Along,
}

impl DualLegs<'_> {
    fn slope(&self, leg: usize, along: Along) -> f64 {
        f64::from(u8::from(self.leg == leg && self.along == along))
    }

    /// Slopes of the angles of a leg.
    fn angles(&self, leg: usize) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.slope(leg, Along::Angle(axis)))
    }

    /// Sine and cosine of the angles of a leg.
    fn sines(&self, leg: usize) -> [(Dual, Dual); 3] {
        let angles = self.plain.timeline.legs()[leg].position.to_array();
        let slopes = self.angles(leg);
        three!(|i| {
            let (sin, cos) = angles[i].sin_cos();
            (Dual(sin, cos * slopes[i]), Dual(cos, -sin * slopes[i]))
        })
    }

    /// What a relaxed measurement's weight grows with.
    fn per_s(&self) -> f64 {
        1.0 / (self.plain.model.period_s * self.plain.model.noise_variance)
    }
}

impl Legs<Dually> for DualLegs<'_> {
    fn count(&self) -> usize {
        Legs::count(&self.plain)
    }
    /// Mx(α) My(β) Mz(γ).
    fn attitude(&self, leg: usize) -> Entries<Dual> {
        let [(sa, ca), (sb, cb), (sg, cg)] = self.sines(leg);
        let (zero, one) = (known(0.0), known(1.0));
        let product = |a: [[Dual; 3]; 3], b: [[Dual; 3]; 3]| {
            three!(|i| three!(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j]))
        };
        let x = [[one, zero, zero], [zero, ca, sa], [zero, -sa, ca]];
        let y = [[cb, zero, -sb], [zero, one, zero], [sb, zero, cb]];
        let z = [[cg, sg, zero], [-sg, cg, zero], [zero, zero, one]];
        product(product(x, y), z)
    }
    fn alpha(&self, leg: usize) -> (Dual, Dual) {
        self.sines(leg)[0]
    }
    fn rotates(&self, leg: usize) -> bool {
        self.plain.rotates(leg)
    }
    fn stretches(&self, leg: usize) -> usize {
        self.plain.stretches(leg)
    }
    fn stretch(&self, leg: usize, index: usize) -> Stretch<Dual, Panels> {
        let s = self.plain.stretch(leg, index);
        let (from, to) = (self.angles(leg - 1), self.angles(leg));
        // A move without duration has none to change.
        let longer = self.slope(leg, Along::Move) * s.turn.time;
        Stretch {
            turn: Turn {
                from: three!(|i| Dual(s.turn.from[i], from[i])),
                change: three!(|i| Dual(s.turn.change[i], to[i] - from[i])),
                duration_s: Dual(s.turn.duration_s, longer),
                time: known(s.turn.time),
                instant: s.turn.instant,
                way: three!(|k| {
                    let slope = match &s.turn.ramp {
                        // s = t/T.
                        None => -s.turn.way[k] / s.turn.duration_s * longer,
                        Some(ramp) => {
                            let by_change =
                                (0..3).map(|i| ramp.ramp_by_change[i] * (to[i] - from[i]));
                            ramp.by_duration[k] * longer + ramp.by_ramp[k] * by_change.sum::<f64>()
                        }
                    };
                    Dual(s.turn.way[k], slope)
                }),
                ramp: s.turn.ramp.map(|ramp| Ramp {
                    by_duration: ramp.by_duration.map(known),
                    by_ramp: ramp.by_ramp.map(known),
                    ramp_by_change: ramp.ramp_by_change.map(known),
                }),
            },
            interval: Interval {
                start_s: known(s.interval.start_s),
                length_s: Dual(s.interval.length_s, longer * s.last),
            },
            panels: s.panels,
            elapsed_s: Dual(s.elapsed_s, longer * s.last),
            present: known(s.present),
            last: known(s.last),
            measured: s
                .measured
                .map(|(w, grows)| (Dual(w, longer * grows * self.per_s()), known(grows))),
        }
    }
    fn settles(&self, leg: usize) -> bool {
        self.plain.settles(leg)
    }
    fn settle_s(&self, leg: usize) -> Dual {
        known(self.plain.settle_s(leg))
    }
    fn dwell(&self, leg: usize) -> Option<DwellKernel<Dually>> {
        let periods = self.plain.periods(leg);
        let kernels = self.plain.model.searched_kernels();
        (periods > 0).then(|| DwellKernel::new(Dually, kernels.numbers(periods).get()))
    }
    fn azimuth(&self) -> Option<f64> {
        self.plain.azimuth()
    }
    fn vertical(&self, leg: usize) -> Dual {
        known(self.plain.vertical(leg))
    }
    fn remains(&self, leg: usize) -> bool {
        self.plain.remains(leg)
    }
    fn remainder(&self, leg: usize) -> (Dual, Option<Dual>) {
        let (length, weight) = self.plain.remainder(leg);
        let longer = self.slope(leg, Along::Dwell);
        let weight = weight.map(|w| Dual(w, longer * self.per_s()));
        (Dual(length, longer), weight)
    }
}

/// ln RMS σ with its slope along something of one leg.
fn log_rms(model: &CovarianceModel, timeline: &Timeline, leg: usize, along: Along) -> Dual {
    let legs = DualLegs {
        plain: OneTimeline {
            ar: Plain,
            model,
            timeline,
            rule: TickRule::Relaxed,
            keep_empty: true,
            facts: Facts::of::<Catalogue>(),
        },
        leg,
        along,
    };
    let mixing = Mixing::of_catalogue(&model.errors);
    let earth = Earth::new(known(0.0), &model.dynamics, &model.stand, model.drift_psd);
    let mut tape = Tape::<_, Catalogue> {
        on: false,
        steps: Vec::new(),
    };
    let mut gains = Own::new(Dually, &legs, &earth, &model.prior_psi);
    let chain = course::forward::<_, Catalogue>(Dually, &legs, &earth, &mut gains, &mut tape);
    let rows = mixing.information(known(0.0), &chain.e.numbers());
    let posterior = Posterior::new(known(0.0), &mixing.order, rows);
    // In units of the prior σ, the coefficients last.
    let sigma = mixing.order.seen_scale();
    let variance = |take: fn(Dual) -> f64| {
        let p = posterior.matrix(take);
        let of = (0..COEFFICIENTS).map(|i| p[(i, i)] * sigma[i] * sigma[i]);
        of.sum::<f64>()
    };
    let (value, slope) = (variance(|d| d.0), variance(|d| d.1));
    Dual(
        0.5 * (value / COEFFICIENTS as f64).ln(),
        0.5 * slope / value,
    )
}

/// A platform with some of the errors, each estimated or considered, in some mounting, with an azimuth
/// or not.
fn random_platform(random: &mut Random, motion: &Value) -> Platform {
    let mut errors = json!({ "considered": {} });
    for group in crate::model::optional_groups() {
        let sigma = match group.key {
            "torquer_scale_factor_ppm" => 1000.0,
            "accelerometer_bias_ug" | "accelerometer_scale_factor_ppm" => 100.0,
            "quadratic_drift_deg_per_h_per_g2" | "quadratic_output_drift_deg_per_h_per_g2" => 0.1,
            _ => 20.0,
        };
        match (3.0 * random.unit()) as usize {
            0 => errors[group.key] = sigma.into(),
            1 => errors["considered"][group.key] = sigma.into(),
            _ => {}
        }
    }
    let mut across = |axis: usize| {
        let (sin, cos) = random.between(-3.1, 3.1).sin_cos();
        let mut output = [0.0; 3];
        output[(axis + 1) % 3] = cos;
        output[(axis + 2) % 3] = sin;
        output
    };
    let output = json!({ "X": across(0), "Y": across(1), "Z": across(2) });
    let mut tables = json!({
        "errors": errors,
        "gyro": { "output_axis": output },
        "motion": motion,
        "prior": {
            "constant_drift_deg_per_h": 0.1, "g_sensitive_drift_deg_per_h_per_g": 0.1
        },
    });
    if random.unit() < 0.3 {
        tables = merged(&[&tables, &json!({ "azimuth": { "noise_arcsec": 5.0 } })]);
    }
    let config: PlatformConfig = serde_json::from_value(tables).unwrap();
    config.check().unwrap()
}

#[test]
fn gradients_are_those_of_dual_numbers() {
    let mut random = Random(97);
    for motion in motions().iter().cycle().take(25) {
        let platform = random_platform(&mut random, motion);
        let model = CovarianceModel::new(&platform);
        let timeline = timeline(&platform, &positions(&mut random, &platform, 5));
        let merit = |p: &dyn crate::covariance::CoefficientCovariance| {
            Criterion::rms().log_with_gradient(p, Smoothing::Exact)
        };
        let (value, gradient) = model.gradient(&timeline, TickRule::Relaxed, merit).unwrap();
        let mut found = Vec::new();
        for (leg, slopes) in gradient.iter().enumerate() {
            for axis in 0..3 {
                found.push((leg, Along::Angle(axis), slopes.angles[axis]));
            }
            found.push((leg, Along::Dwell, slopes.dwell_s));
            if timeline.legs()[leg].arrival.is_some() {
                found.push((leg, Along::Move, slopes.move_s));
            }
        }
        let largest = |of: fn(Along) -> bool| {
            let all = found.iter().filter(|(_, along, _)| of(*along));
            all.fold(0.0_f64, |m, (.., slope)| m.max(slope.abs()))
        };
        let angles = largest(|along| matches!(along, Along::Angle(_)));
        let times = largest(|along| !matches!(along, Along::Angle(_)));
        for (leg, along, slope) in &found {
            let dual = log_rms(&model, &timeline, *leg, *along);
            assert!((dual.0 - value).abs() < 1e-10, "{} {value}", dual.0);
            let size = match along {
                Along::Angle(_) => angles,
                _ => times,
            };
            let error = (dual.1 - slope).abs();
            assert!(
                error < 1e-7 * size,
                "{leg} {along:?}: {error:e} of {size:e}"
            );
        }
    }
}
