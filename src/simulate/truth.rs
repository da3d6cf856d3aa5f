//! The true platform: equations of motion, integration, measurement. Derivation: see
//! [`crate::simulate`].

use nalgebra::{Matrix3, Quaternion, Unit, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::attitude::{Attitude, EAST, GRAVITY_N, NORTH, UP};
use crate::units::{ARCSEC_PER_RAD, Angle};

use super::instruments::Instruments;
use super::normal::normal3;
use super::options::TruthModel;
use super::program::{DriftInterval, Program};
use super::states::Shape;
use super::wander::{TrueWandering, Wandering};

/// Which way time runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Direction {
    /// From the start of an interval to its end.
    Forward,
    /// From its end to its start.
    Backward,
}

impl Direction {
    /// The signed Runge–Kutta step of `interval`, in the unit of its span.
    fn step(self, interval: &DriftInterval) -> f64 {
        let h = interval.span() / interval.steps() as f64;
        match self {
            Self::Forward => h,
            Self::Backward => -h,
        }
    }

    /// The half step that is the `i`th from where the integration starts.
    fn half_step(self, interval: &DriftInterval, i: usize) -> usize {
        match self {
            Self::Forward => i,
            Self::Backward => 2 * interval.steps() - i,
        }
    }
}

/// What turns the platform away from the computed frame over an interval.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disturbance<'a> {
    /// ω_ie^n, rad/s.
    pub earth_rate_n: &'a Vector3<f64>,
    /// Gyros and torquers.
    pub instruments: &'a Instruments,
    /// Random drift held over the interval, in n, rad/s.
    pub random_n: Vector3<f64>,
    /// What wanders of the drift, its mean in the interval along the axes of the platform, rad/s.
    pub wandering: Vector3<f64>,
}

/// A moment of an interval.
struct Moment<'a> {
    interval: &'a DriftInterval,
    half_step: usize,
}

impl Moment<'_> {
    /// C_c^n.
    fn attitude(&self) -> &Attitude {
        self.interval.attitude(self.half_step)
    }
}

impl Disturbance<'_> {
    /// ε^n of a unit of the span, the platform at `p_to_n` (C_p^n) and gravity as it is in n, rad.
    fn drift_n(
        &self,
        now: &Moment<'_>,
        p_to_n: &Matrix3<f64>,
        gravity: &Vector3<f64>,
    ) -> Vector3<f64> {
        let pace = now.interval.pace();
        let drift = self.instruments.drift(&p_to_n.tr_mul(gravity)) + self.wandering;
        let mut drift = drift * pace;
        if let Some(torquers) = self.instruments.torquers() {
            // What is commanded is meant for the computed axes and executed about the true ones.
            drift += torquers * now.interval.commanded(now.half_step, self.earth_rate_n);
        }
        p_to_n * drift + self.random_n * pace
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
        let h = direction.step(interval);
        let gravity = GRAVITY_N * (1.0 + self.instruments.gravity_error());
        let earth_rate_n = self.earth_rate_n * interval.pace();
        for step in 0..interval.steps() {
            let slope = |q: &Quaternion<f64>, half: usize| {
                let rotation = Unit::new_unchecked(*q).to_rotation_matrix();
                let half_step = direction.half_step(interval, 2 * step + half);
                let now = Moment {
                    interval,
                    half_step,
                };
                let p_to_n = rotation.matrix() * now.attitude().matrix();
                quaternion_rate(q, &self.drift_n(&now, &p_to_n, &gravity), &earth_rate_n)
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

    /// ψ^n at the end of `interval` (its turn apart) in the first-order model (8), by
    /// Runge–Kutta.
    fn integrate_first_order(&self, psi: &Vector3<f64>, interval: &DriftInterval) -> Vector3<f64> {
        let mut psi = *psi;
        let h = Direction::Forward.step(interval);
        let earth_rate_n = self.earth_rate_n * interval.pace();
        for step in 0..interval.steps() {
            let slope = |psi: &Vector3<f64>, half: usize| {
                let now = Moment {
                    interval,
                    half_step: 2 * step + half,
                };
                let c_to_n = now.attitude().matrix();
                psi.cross(&earth_rate_n) + self.drift_n(&now, c_to_n, &GRAVITY_N)
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

/// q̇ = ½ ((ε − ω) q + q ω), with ε and ω as pure quaternions.
fn quaternion_rate(
    q: &Quaternion<f64>,
    drift_n: &Vector3<f64>,
    earth_rate_n: &Vector3<f64>,
) -> Quaternion<f64> {
    let v = q.imag();
    let difference = drift_n - 2.0 * earth_rate_n;
    Quaternion::from_parts(
        -0.5 * drift_n.dot(&v),
        0.5 * (q.w * drift_n + difference.cross(&v)),
    )
}

/// Q E Qᵀ, the rotation by the same angle about the turned axis: what a frame-hold turn makes
/// of E.
pub(super) fn turned(e: &UnitQuaternion<f64>, q: &Matrix3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::from_parts(e.w, q * e.imag()))
}

/// The angle about Up from North to the horizontal part of what E turns North into, rad.
pub(super) fn azimuth_of(e: &UnitQuaternion<f64>) -> f64 {
    let north = e.transform_vector(&Vector3::x());
    libm::atan2(-north[EAST], north[NORTH])
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
    /// −C_n^p g^n (5) and their errors, plus the g^c that was computed.
    fn measurement(&self, c_to_n: &Matrix3<f64>, instruments: &Instruments) -> Vector3<f64> {
        let gravity_c = c_to_n.tr_mul(&GRAVITY_N);
        match self {
            Self::Rotation(e) => {
                let gravity = GRAVITY_N * (1.0 + instruments.gravity_error());
                let gravity_p = c_to_n.tr_mul(&e.inverse_transform_vector(&gravity));
                gravity_c - gravity_p + instruments.output(&-gravity_p)
            }
            Self::FirstOrder(psi) => {
                let f = -gravity_c;
                let shown = instruments.output(&f) + f * instruments.gravity_error();
                -gravity_c.cross(&c_to_n.tr_mul(psi)) + shown
            }
        }
    }

    /// What an azimuth reference shows without noise, rad: how far what should point North points
    /// off it, about Up; ψ_y in the first order.
    fn azimuth(&self) -> f64 {
        match self {
            Self::Rotation(e) => azimuth_of(e),
            Self::FirstOrder(psi) => psi[UP],
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

    /// The same from a platform of which ψ^n is estimated, `psi` in rad.
    pub fn relative_to_vector(&self, psi: &Vector3<f64>) -> Vector3<f64> {
        match self {
            // To first order ψ is a vector of any length; as a rotation it would be one of half a turn
            // at most.
            Self::FirstOrder(truth) if psi.norm() > std::f64::consts::PI => {
                (truth - psi).map(|rad| Angle::from_rad(rad).arcsec())
            }
            _ => self.relative_to(&UnitQuaternion::from_scaled_axis(*psi)),
        }
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
pub(super) struct TrueNoise<'a> {
    /// PSD of the random drift, rad²/s.
    pub drift_psd: f64,
    /// 1σ of an accelerometer, g.
    pub accelerometer_g: f64,
    /// 1σ of the azimuth, rad; none: it is not measured.
    pub azimuth_rad: Option<f64>,
    /// What wanders; none: nothing does.
    pub wandering: Option<&'a Wandering>,
}

/// What is measured at the end of an interval.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Measured {
    /// Z, platform components, g.
    pub z: Vector3<f64>,
    /// The azimuth, rad; zero: there is none.
    pub azimuth: f64,
}

/// The values that a run starts from.
pub(super) struct Start<'a> {
    /// ψ^n(0), arcsec.
    pub misalignment_n_arcsec: &'a Vector3<f64>,
    /// All parameters, each in its unit.
    pub parameters: Vec<f64>,
    pub instruments: &'a Instruments,
}

/// What happened in one run: the platform at the end of every interval, and the measurement
/// there if there was one.
#[derive(Debug)]
pub(super) struct TruthRecord {
    /// All parameters, each in its unit.
    pub parameters: Vec<f64>,
    pub misalignment: Vec<Misalignment>,
    /// Zero where nothing was measured.
    pub measured: Vec<Measured>,
    /// What wanders, at the end of every interval in turn, in the order of the states; empty: nothing
    /// does.
    wandered: Vec<f64>,
    /// Whether a random walk of the drift is the first of it.
    has_walk: bool,
}

impl TruthRecord {
    /// Runs the test from `start`, noise drawn from `random`.
    pub fn new(
        program: &Program,
        earth_rate_n: &Vector3<f64>,
        model: TruthModel,
        start: Start<'_>,
        noise: TrueNoise<'_>,
        random: &mut ChaCha8Rng,
    ) -> Self {
        let mut now = Misalignment::new(model, start.misalignment_n_arcsec);
        let mut record = Self {
            parameters: start.parameters,
            misalignment: Vec::with_capacity(program.intervals.len()),
            measured: Vec::with_capacity(program.intervals.len()),
            wandered: Vec::new(),
            has_walk: noise.wandering.is_some_and(Wandering::has_walk),
        };
        let mut wandering = noise.wandering.map(|w| TrueWandering::new(w, random));
        for interval in &program.intervals {
            let mut random_n = Vector3::zeros();
            if noise.drift_psd > 0.0 && interval.length_s > 0.0 {
                // The average over an interval of white noise of PSD q has variance q / length.
                random_n = normal3(random) * (noise.drift_psd / interval.length_s).sqrt();
            }
            let mut disturbance = Disturbance {
                earth_rate_n,
                instruments: start.instruments,
                random_n,
                wandering: Vector3::zeros(),
            };
            let mut biases = Vector3::zeros();
            if let Some(wandering) = &mut wandering {
                disturbance.wandering =
                    wandering.advance(interval.length_s, random) / ARCSEC_PER_RAD;
                biases = wandering.biases() / ARCSEC_PER_RAD;
                record.wandered.extend(wandering.states());
            }
            now = now.advanced(&disturbance, interval);
            record.misalignment.push(now);
            record.measured.push(match interval.measured {
                true => now
                    .measured(interval, start.instruments, noise, random)
                    .plus(&biases),
                false => Measured::default(),
            });
        }
        record
    }

    /// The true values of the states but ψ^n of a filter of that `shape` at the end of interval `index`: a
    /// filter that takes drift that walks for constant is compared with the drift of the moment.
    pub fn states(&self, index: usize, shape: &Shape) -> Vec<f64> {
        let each = self.wandered.len() / self.misalignment.len().max(1);
        let wandered = &self.wandered[index * each..(index + 1) * each];
        let mut states = self.parameters[..shape.parameters].to_vec();
        if shape.wandering > 0 {
            states.extend(wandered);
            // Of a truth without noise nothing wanders.
            states.resize(shape.psi(), 0.0);
        } else if self.has_walk {
            let d_f = states.iter_mut().zip(wandered).take(3);
            d_f.for_each(|(d, walked)| *d += walked);
        }
        states
    }
}

impl Measured {
    /// With what biases add, g.
    fn plus(mut self, biases: &Vector3<f64>) -> Self {
        self.z += biases;
        self
    }
}

impl Misalignment {
    /// What is measured at the end of `interval`, with its noise.
    fn measured(
        &self,
        interval: &DriftInterval,
        instruments: &Instruments,
        noise: TrueNoise<'_>,
        random: &mut ChaCha8Rng,
    ) -> Measured {
        let mut measured = Measured {
            z: self.measurement(interval.end_attitude().matrix(), instruments),
            azimuth: 0.0,
        };
        if noise.accelerometer_g > 0.0 {
            measured.z += normal3(random) * noise.accelerometer_g;
        }
        if let Some(sigma) = noise.azimuth_rad {
            measured.azimuth = self.azimuth();
            if sigma > 0.0 {
                let normal: f64 = StandardNormal.sample(random);
                measured.azimuth += normal * sigma;
            }
        }
        measured
    }
}
