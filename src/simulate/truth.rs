//! The true platform: equations of motion, integration, measurement. Derivation: see
//! [`crate::simulate`].

use nalgebra::{Matrix3, Quaternion, Unit, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::attitude::{Attitude, GRAVITY_N};
use crate::drift::{CoefficientVector, drift_c};
use crate::units::{Angle, AngularRate};

use super::options::{InitialTruth, TruthModel};
use super::program::{DriftInterval, Program};

/// The drift of the three gyros as D_F + M g (3), rad/s.
#[derive(Debug, Clone, Copy)]
pub(super) struct GyroDrift {
    constant: Vector3<f64>,
    /// M: per g.
    pub sensitivity: Matrix3<f64>,
}

impl GyroDrift {
    /// From coefficients in °/h.
    pub fn from_deg_per_h(coefficients: &CoefficientVector) -> Self {
        let si = coefficients.map(|d| AngularRate::from_deg_per_h(d).rad_per_s());
        let constant = drift_c(&si, &Vector3::zeros());
        let column = |axis: Vector3<f64>| drift_c(&si, &axis) - constant;
        Self {
            constant,
            sensitivity: Matrix3::from_columns(&[
                column(Vector3::x()),
                column(Vector3::y()),
                column(Vector3::z()),
            ]),
        }
    }

    /// ε^p for gravity `gravity_p` (g), rad/s.
    pub fn rate(&self, gravity_p: &Vector3<f64>) -> Vector3<f64> {
        self.constant + self.sensitivity * gravity_p
    }
}

/// Which way time runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Direction {
    /// From the start of an interval to its end.
    Forward,
    /// From its end to its start.
    Backward,
}

impl Direction {
    /// The signed Runge–Kutta step of `interval`, s.
    fn step_s(self, interval: &DriftInterval) -> f64 {
        let h = interval.length_s / interval.steps() as f64;
        match self {
            Self::Forward => h,
            Self::Backward => -h,
        }
    }

    /// C_c^n at half step `i`, counted from where the integration starts.
    fn attitude(self, interval: &DriftInterval, i: usize) -> &Attitude {
        interval.attitude(match self {
            Self::Forward => i,
            Self::Backward => 2 * interval.steps() - i,
        })
    }
}

/// What turns the platform away from the computed frame over an interval.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disturbance<'a> {
    /// ω_ie^n, rad/s.
    pub earth_rate_n: &'a Vector3<f64>,
    /// The gyros.
    pub drift: &'a GyroDrift,
    /// Random drift held over the interval, in n, rad/s.
    pub random_n: Vector3<f64>,
}

impl Disturbance<'_> {
    /// ε^n with the platform at `attitude` (C_p^n), rad/s.
    fn drift_n(&self, attitude: &Matrix3<f64>) -> Vector3<f64> {
        let gravity_p = attitude.tr_mul(&GRAVITY_N);
        attitude * self.drift.rate(&gravity_p) + self.random_n
    }

    /// E at the other end of `interval` (its turn apart), by Runge–Kutta on the exact equation
    /// Ė = [ε^n×] E + E [ω_ie×] − [ω_ie×] E.
    pub fn integrate(
        &self,
        e: &UnitQuaternion<f64>,
        interval: &DriftInterval,
        direction: Direction,
    ) -> UnitQuaternion<f64> {
        let mut e = *e;
        let h = direction.step_s(interval);
        for step in 0..interval.steps() {
            let slope = |q: &Quaternion<f64>, half: usize| {
                let rotation = Unit::new_unchecked(*q).to_rotation_matrix();
                let c_to_n = direction.attitude(interval, 2 * step + half);
                let attitude = rotation.matrix() * c_to_n.matrix();
                self.quaternion_rate(q, &self.drift_n(&attitude))
            };
            let q = *e.quaternion();
            let k1 = slope(&q, 0);
            let k2 = slope(&(q + k1 * (0.5 * h)), 1);
            let k3 = slope(&(q + k2 * (0.5 * h)), 1);
            let k4 = slope(&(q + k3 * h), 2);
            e = UnitQuaternion::new_normalize(q + (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0));
        }
        e
    }

    /// q̇ = ½ ((ε − ω) q + q ω), with ε and ω as pure quaternions.
    fn quaternion_rate(&self, q: &Quaternion<f64>, drift_n: &Vector3<f64>) -> Quaternion<f64> {
        let v = q.imag();
        let difference = drift_n - 2.0 * self.earth_rate_n;
        Quaternion::from_parts(
            -0.5 * drift_n.dot(&v),
            0.5 * (q.w * drift_n + difference.cross(&v)),
        )
    }

    /// ψ^n at the end of `interval` (its turn apart) in the first-order model (8), by
    /// Runge–Kutta.
    fn integrate_first_order(&self, psi: &Vector3<f64>, interval: &DriftInterval) -> Vector3<f64> {
        let mut psi = *psi;
        let h = Direction::Forward.step_s(interval);
        for step in 0..interval.steps() {
            let slope = |psi: &Vector3<f64>, half: usize| {
                let attitude = interval.attitude(2 * step + half).matrix();
                psi.cross(self.earth_rate_n) + self.drift_n(attitude)
            };
            let k1 = slope(&psi, 0);
            let k2 = slope(&(psi + k1 * (0.5 * h)), 1);
            let k3 = slope(&(psi + k2 * (0.5 * h)), 1);
            let k4 = slope(&(psi + k3 * h), 2);
            psi += (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
        }
        psi
    }
}

/// Q E Qᵀ, the rotation by the same angle about the turned axis: what a frame-hold turn makes
/// of E.
pub(super) fn turned(e: &UnitQuaternion<f64>, q: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::from_parts(e.w, q * e.imag()))
}

/// How the platform lies off the computed frame.
#[derive(Debug, Clone, Copy)]
pub(super) enum Misalignment {
    /// E = C_p^n C_n^c, a rotation.
    Rotation(UnitQuaternion<f64>),
    /// ψ^n of the first-order model, rad.
    FirstOrder(Vector3<f64>),
}

impl Misalignment {
    fn new(model: TruthModel, psi_arcsec: &Vector3<f64>) -> Self {
        let psi = psi_arcsec.map(|arcsec| Angle::from_arcsec(arcsec).rad());
        match model {
            TruthModel::Nonlinear => Self::Rotation(UnitQuaternion::from_scaled_axis(psi)),
            TruthModel::FirstOrder => Self::FirstOrder(psi),
        }
    }

    fn advanced(&self, disturbance: &Disturbance<'_>, interval: &DriftInterval) -> Self {
        match self {
            Self::Rotation(e) => {
                let e = interval.turn.map_or(*e, |q| turned(e, &q));
                Self::Rotation(disturbance.integrate(&e, interval, Direction::Forward))
            }
            Self::FirstOrder(psi) => {
                let psi = interval.turn.map_or(*psi, |q| q * psi);
                Self::FirstOrder(disturbance.integrate_first_order(&psi, interval))
            }
        }
    }

    /// Z of (6) without noise, in the platform's components, g: what the accelerometers show,
    /// −C_n^p g^n (5), plus the g^c that was computed.
    fn measurement(&self, c_to_n: &Matrix3<f64>) -> Vector3<f64> {
        let gravity_c = c_to_n.tr_mul(&GRAVITY_N);
        match self {
            Self::Rotation(e) => {
                let gravity_p = c_to_n.tr_mul(&e.inverse_transform_vector(&GRAVITY_N));
                gravity_c - gravity_p
            }
            Self::FirstOrder(psi) => -gravity_c.cross(&c_to_n.tr_mul(psi)),
        }
    }

    /// ψ^n: the rotation vector of E, arcsec.
    pub fn psi_n_arcsec(&self) -> Vector3<f64> {
        let psi = match self {
            Self::Rotation(e) => e.scaled_axis(),
            Self::FirstOrder(psi) => *psi,
        };
        psi.map(|rad| Angle::from_rad(rad).arcsec())
    }

    /// The rotation from an estimated platform to this one, in n, arcsec.
    pub fn relative_to(&self, estimate: &UnitQuaternion<f64>) -> Vector3<f64> {
        let eta = match self {
            Self::Rotation(e) => (e * estimate.inverse()).scaled_axis(),
            Self::FirstOrder(psi) => psi - estimate.scaled_axis(),
        };
        eta.map(|rad| Angle::from_rad(rad).arcsec())
    }
}

/// The noises of the truth.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrueNoise {
    /// PSD of the random drift, rad²/s.
    pub drift_psd: f64,
    /// 1σ of an accelerometer, g.
    pub accelerometer_g: f64,
}

/// What happened in one run: the platform at the end of every interval, and the measurement
/// there if there was one.
#[derive(Debug)]
pub(super) struct TruthRecord {
    pub coefficients: CoefficientVector,
    pub misalignment: Vec<Misalignment>,
    /// Z, platform components, g; zero where nothing was measured.
    pub z: Vec<Vector3<f64>>,
}

/// Three independent standard normal numbers.
fn normal3(random: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| StandardNormal.sample(random))
}

impl TruthRecord {
    /// Runs the test from `initial`, noise drawn from `random`.
    pub fn new(
        program: &Program,
        earth_rate_n: &Vector3<f64>,
        model: TruthModel,
        initial: &InitialTruth,
        noise: TrueNoise,
        random: &mut ChaCha8Rng,
    ) -> Self {
        let drift = GyroDrift::from_deg_per_h(&initial.drift_deg_per_h);
        let mut now = Misalignment::new(model, &initial.misalignment_n_arcsec);
        let mut record = Self {
            coefficients: initial.drift_deg_per_h,
            misalignment: Vec::with_capacity(program.intervals.len()),
            z: Vec::with_capacity(program.intervals.len()),
        };
        for interval in &program.intervals {
            let mut random_n = Vector3::zeros();
            if noise.drift_psd > 0.0 && interval.length_s > 0.0 {
                // The average over an interval of white noise of PSD q has variance q / length.
                random_n = normal3(random) * (noise.drift_psd / interval.length_s).sqrt();
            }
            let disturbance = Disturbance {
                earth_rate_n,
                drift: &drift,
                random_n,
            };
            now = now.advanced(&disturbance, interval);
            record.misalignment.push(now);
            let mut z = Vector3::zeros();
            if interval.measured {
                z = now.measurement(interval.end_attitude().matrix());
                if noise.accelerometer_g > 0.0 {
                    z += normal3(random) * noise.accelerometer_g;
                }
            }
            record.z.push(z);
        }
        record
    }
}
