//! A dense Kalman filter over ψ^n and all parameters, one step per filter period: it knows nothing
//! of shapes, shifts, kernels and separated biases.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix3xX, RowDVector, Vector3};

use super::super::super::mixing::{Instrument, Parameter, Term};
use super::super::super::shape::Feature;
use crate::covariance::{TickRule, split_periods};
use crate::dynamics::ErrorDynamics;
use crate::motion::{Leg, Move, Timeline};
use crate::platform::{Platform, Repositioning};
use crate::units::ARCSEC_PER_RAD;

/// Mx(α) My(β) Mz(γ).
fn attitude(angles: [f64; 3]) -> Matrix3<f64> {
    let [(sa, ca), (sb, cb), (sg, cg)] = angles.map(f64::sin_cos);
    let x = Matrix3::new(1.0, 0.0, 0.0, 0.0, ca, sa, 0.0, -sa, ca);
    let y = Matrix3::new(cb, 0.0, -sb, 0.0, 1.0, 0.0, sb, 0.0, cb);
    let z = Matrix3::new(cg, sg, 0.0, -sg, cg, 0.0, 0.0, 0.0, 1.0);
    x * y * z
}

fn value(feature: Feature, g: &Vector3<f64>, rate: &Vector3<f64>) -> f64 {
    match feature {
        Feature::Zero => 0.0,
        Feature::One => 1.0,
        Feature::X => g.x,
        Feature::Y => g.y,
        Feature::Z => g.z,
        Feature::XX => g.x * g.x,
        Feature::YY => g.y * g.y,
        Feature::ZZ => g.z * g.z,
        Feature::XY => g.x * g.y,
        Feature::XZ => g.x * g.z,
        Feature::YZ => g.y * g.z,
        Feature::XXX => g.x.powi(3),
        Feature::YYY => g.y.powi(3),
        Feature::ZZZ => g.z.powi(3),
        Feature::RateX => rate.x,
        Feature::RateY => rate.y,
        Feature::RateZ => rate.z,
    }
}

/// The filter at work.
pub struct Dense<'a> {
    platform: &'a Platform,
    dynamics: ErrorDynamics,
    parameters: &'a [&'a Parameter],
    rule: TickRule,
    /// Of (ψ^n, parameters), arcsec and the parameters' units.
    pub p: DMatrix<f64>,
}

impl<'a> Dense<'a> {
    /// P at the end of `timeline` with all `parameters` estimated.
    pub fn run(
        platform: &'a Platform,
        parameters: &'a [&'a Parameter],
        timeline: &Timeline,
        rule: TickRule,
    ) -> DMatrix<f64> {
        let mut sigma: Vec<f64> = platform
            .prior_misalignment_rad()
            .iter()
            .map(|rad| rad * ARCSEC_PER_RAD)
            .collect();
        sigma.extend(parameters.iter().map(|p| p.prior_sigma));
        let variances = DVector::from_vec(sigma).map(|s| s * s);
        let mut filter = Self {
            platform,
            dynamics: ErrorDynamics::new(platform.earth_rate_n()),
            parameters,
            rule,
            p: DMatrix::from_diagonal(&variances),
        };
        let legs = timeline.legs();
        for (k, leg) in legs.iter().enumerate() {
            if let Some(arrival) = &leg.arrival {
                filter.arrive(arrival, &legs[k - 1], leg);
            }
            filter.pass_at(leg, leg.settle_s);
            filter.dwell(leg);
        }
        filter.p
    }

    fn c(leg: &Leg) -> Matrix3<f64> {
        attitude(leg.position.to_array())
    }

    /// What the parameters add to the drift in n, or to the accelerometers' outputs in n.
    fn columns(
        &self,
        gyros: bool,
        c: &Matrix3<f64>,
        value: impl Fn(Feature) -> f64,
    ) -> Matrix3xX<f64> {
        let mut out = Matrix3xX::zeros(self.parameters.len());
        for (j, parameter) in self.parameters.iter().enumerate() {
            for Term {
                instrument,
                feature,
                factor,
            } in &parameter.terms
            {
                let axis = match (instrument, gyros) {
                    (Instrument::Gyro(axis), true) => *axis,
                    (Instrument::Accelerometer(axis), false) => *axis,
                    _ => continue,
                };
                let column = c.column(axis) * (factor * value(*feature));
                for i in 0..3 {
                    out[(i, j)] += column[i];
                }
            }
        }
        out
    }

    fn drift(&self, c: &Matrix3<f64>, rate_nc_c: &Vector3<f64>) -> Matrix3xX<f64> {
        let g = c.transpose() * Vector3::new(0.0, -1.0, 0.0);
        let rate = c.transpose() * self.platform.earth_rate_n() + rate_nc_c;
        self.columns(true, c, |f| value(f, &g, &rate))
    }

    fn propagate(&mut self, length_s: f64, b: &Matrix3xX<f64>, phi_psi: &Matrix3<f64>) {
        let size = self.p.nrows();
        let mut phi = DMatrix::identity(size, size);
        phi.view_mut((0, 0), (3, 3)).copy_from(phi_psi);
        phi.view_mut((0, 3), (3, size - 3)).copy_from(b);
        self.p = &phi * &self.p * phi.transpose();
        let q = self.platform.drift_psd_rad2_per_s() * ARCSEC_PER_RAD.powi(2) * length_s;
        for i in 0..3 {
            self.p[(i, i)] += q;
        }
    }

    fn pass_at(&mut self, leg: &Leg, length_s: f64) {
        if length_s > 0.0 {
            let drift = self.drift(&Self::c(leg), &Vector3::zeros());
            let b = self.dynamics.integral(length_s) * drift;
            self.propagate(length_s, &b, &self.dynamics.transition(length_s));
        }
    }

    /// ω_nc^c per unit of the fraction of a move, from the attitude's own change.
    fn rate(m: &Move, fraction: f64) -> Vector3<f64> {
        let h = 1e-3;
        let at = |f: f64| attitude(m.angles_at(f));
        let slope = (at(fraction + h) - at(fraction - h)) * 8.0
            - (at(fraction + 2.0 * h) - at(fraction - 2.0 * h));
        let cross = at(fraction).transpose() * slope / (12.0 * h);
        Vector3::new(cross[(2, 1)], cross[(0, 2)], cross[(1, 0)])
    }

    /// Over part of a move, from one fraction to another: B = ∫ Φ A dt, and without duration what is
    /// left of it.
    fn moving(&mut self, m: &Move, from: f64, to: f64) {
        const PANELS: usize = 24;
        const NODES: [(f64, f64); 5] = [
            (0.0, 0.568_888_888_888_888_9),
            (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
            (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
            (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
            (0.906_179_845_938_664, 0.236_926_885_056_189_1),
        ];
        let mut b = Matrix3xX::zeros(self.parameters.len());
        let width = (to - from) / PANELS as f64;
        for panel in 0..PANELS {
            for (x, w) in NODES {
                let fraction = from + width * (panel as f64 + 0.5 + 0.5 * x);
                let weight = 0.5 * w * width;
                let c = attitude(m.angles_at(fraction));
                let turning = Self::rate(m, fraction);
                let phi = self.dynamics.transition((to - fraction) * m.duration_s);
                // A dt with dt = T ds; the part of the turning is per ds.
                let g = c.transpose() * Vector3::new(0.0, -1.0, 0.0);
                let earth = c.transpose() * self.platform.earth_rate_n();
                let rate = earth * m.duration_s + turning;
                let per_fraction = self.columns(true, &c, |f| match f.is_rate() {
                    true => value(f, &g, &rate),
                    false => value(f, &g, &rate) * m.duration_s,
                });
                b += phi * per_fraction * weight;
            }
        }
        let length_s = (to - from) * m.duration_s;
        self.propagate(length_s, &b, &self.dynamics.transition(length_s));
    }

    fn arrive(&mut self, m: &Move, before: &Leg, leg: &Leg) {
        if self.platform.motion().repositioning == Repositioning::FrameHold {
            let q = Self::c(leg) * Self::c(before).transpose();
            let none = Matrix3xX::zeros(self.parameters.len());
            self.propagate(0.0, &none, &q);
        } else if m.measured && m.duration_s > 0.0 {
            let period = self.platform.period_s();
            let (ticks, rest) = split_periods(m.duration_s, period);
            let fraction = |s: f64| s / m.duration_s;
            for tick in 0..ticks {
                let start = tick as f64 * period;
                self.moving(m, fraction(start), fraction(start + period));
                self.measure(&attitude(m.angles_at(fraction(start + period))), 1.0);
            }
            if rest > 0.0 {
                self.moving(m, fraction(ticks as f64 * period), 1.0);
                self.measure_rest(&Self::c(leg), rest);
            }
        } else {
            self.moving(m, 0.0, 1.0);
        }
    }

    fn dwell(&mut self, leg: &Leg) {
        let period = self.platform.period_s();
        let (periods, rest) = split_periods(leg.dwell_s, period);
        for _ in 0..periods {
            self.pass_at(leg, period);
            self.measure(&Self::c(leg), 1.0);
        }
        if rest > 0.0 {
            self.pass_at(leg, rest);
            self.measure_rest(&Self::c(leg), rest);
        }
    }

    fn measure_rest(&mut self, c: &Matrix3<f64>, rest_s: f64) {
        if self.rule == TickRule::Relaxed {
            self.measure(c, rest_s / self.platform.period_s());
        }
    }

    /// All three channels, with `weight` times the information of a measurement.
    fn measure(&mut self, c: &Matrix3<f64>, weight: f64) {
        let g = c.transpose() * Vector3::new(0.0, -1.0, 0.0);
        let of = self.columns(false, c, |f| value(f, &g, &Vector3::zeros()));
        let noise = (self.platform.noise_g() * ARCSEC_PER_RAD).powi(2) / weight;
        let size = self.p.nrows();
        // Z^n = −[g^n ×] ψ^n + C δZ: (ψ_z, 0, −ψ_x).
        let psi = [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]];
        for (i, psi) in psi.iter().enumerate() {
            let mut h = RowDVector::zeros(size);
            for j in 0..3 {
                h[j] = psi[j];
            }
            for j in 0..size - 3 {
                h[3 + j] = of[(i, j)];
            }
            let ph = &self.p * h.transpose();
            let s = (&h * &ph)[(0, 0)] + noise;
            let gain = ph / s;
            let keep = DMatrix::identity(size, size) - &gain * &h;
            self.p = &keep * &self.p * keep.transpose() + &gain * gain.transpose() * noise;
            self.p = (&self.p + self.p.transpose()) * 0.5;
        }
    }
}
