//! The filter: linear with gains computed beforehand, or extended. Derivation: see
//! [`crate::simulate`].

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::attitude::{Attitude, EAST, GRAVITY_N, NORTH};
use crate::drift::{COEFFICIENTS, CoefficientVector, DriftMatrix, drift_matrix};
use crate::platform::Platform;
use crate::units::{ARCSEC_PER_RAD, Angle, AngularRate};

use super::options::ToldNoise;
use super::program::{DriftInterval, Program};
use super::square_root::{PSI, ScalarGain, SquareRoot, StateVector};
use super::truth::{Direction, Disturbance, GyroDrift, Misalignment, turned};

/// The measured channels of Z^n (9): z_1 = ψ_z and z_3 = −ψ_x. The vertical one carries only
/// noise to first order, and the filter leaves it out.
const CHANNELS: [MeasurementRow; 2] = [
    MeasurementRow {
        row: NORTH,
        axis: EAST,
        sign: 1.0,
    },
    MeasurementRow {
        row: EAST,
        axis: NORTH,
        sign: -1.0,
    },
];

/// Row `row` of Z^n is `sign` · ψ_axis.
struct MeasurementRow {
    row: usize,
    axis: usize,
    sign: f64,
}

/// What a filter believes before the test, in arcsec and °/h.
#[derive(Debug, Clone)]
pub(super) struct Belief {
    pub prior_sigma: StateVector,
    /// q, arcsec²/s.
    pub drift_psd: f64,
    /// r, arcsec.
    pub noise: f64,
    pub earth_rate_n: Vector3<f64>,
}

impl Belief {
    /// What `platform` says, with the noises it is told.
    pub fn new(platform: &Platform, told: &ToldNoise) -> Self {
        let psi = platform.prior_misalignment_rad();
        let d = platform.prior_drift_rad_per_s();
        Self {
            prior_sigma: std::array::from_fn(|i| match i < COEFFICIENTS {
                true => AngularRate::from_rad_per_s(d[i]).deg_per_h(),
                false => Angle::from_rad(psi[i - PSI]).arcsec(),
            }),
            drift_psd: platform.drift_psd_rad2_per_s()
                * (ARCSEC_PER_RAD * told.random_drift_factor).powi(2),
            noise: Angle::from_rad(platform.noise_g()).arcsec() * told.accelerometer_factor,
            earth_rate_n: platform.earth_rate_n(),
        }
    }
}

/// Two scalar measurements of one tick.
type TickGain = [ScalarGain; 2];

fn update(root: &mut SquareRoot, noise: f64) -> TickGain {
    CHANNELS.map(|c| root.update(c.axis, c.sign, noise))
}

/// The gains of the linear filter: the same for every run of a test.
#[derive(Debug)]
pub(super) struct LinearGains {
    ticks: Vec<TickGain>,
    /// The covariance at the end of every position.
    pub leg_ends: Vec<SquareRoot>,
}

impl LinearGains {
    /// Runs the covariance through `program`, showing it to `observe` after every interval.
    pub fn new(program: &Program, belief: &Belief, observe: &mut dyn FnMut(&SquareRoot)) -> Self {
        let mut root = SquareRoot::diagonal(&belief.prior_sigma);
        let mut gains = Self {
            ticks: Vec::with_capacity(program.ticks),
            leg_ends: Vec::with_capacity(program.leg_ends.len()),
        };
        for (index, interval) in program.intervals.iter().enumerate() {
            if let Some(q) = &interval.turn {
                root.turn(q);
            }
            let t = &program.transitions[interval.transition];
            root.predict(&t.phi, &t.b, belief.drift_psd * interval.length_s);
            if interval.measured {
                gains.ticks.push(update(&mut root, belief.noise));
            }
            observe(&root);
            if program.leg_ends[gains.leg_ends.len()] == index {
                gains.leg_ends.push(root.clone());
            }
        }
        gains
    }
}

/// A filter at work in one run.
#[derive(Debug)]
#[allow(
    clippy::large_enum_variant,
    reason = "one per run, on the stack of its thread; boxing would only add a hop per tick"
)]
pub(super) enum Filter<'a> {
    /// Kalman filter on (8), (9), gains from beforehand.
    Linear(LinearFilter<'a>),
    /// Linearised about estimates.
    Extended(ExtendedFilter<'a>),
}

impl Filter<'_> {
    /// Predicts through `interval`.
    pub fn advance(&mut self, program: &Program, interval: &DriftInterval) {
        match self {
            Self::Linear(f) => f.advance(program, interval),
            Self::Extended(f) => f.advance(interval),
        }
    }

    /// Takes the measurement `z` (platform components, g) at the end of `interval`; gives the
    /// normalised innovation squared.
    pub fn measure(&mut self, interval: &DriftInterval, z: &Vector3<f64>) -> f64 {
        let z_n = interval.end_attitude().matrix() * z * ARCSEC_PER_RAD;
        match self {
            Self::Linear(f) => f.measure(&z_n),
            Self::Extended(f) => f.measure(&z_n),
        }
    }

    /// Truth minus estimate: D in °/h, and the rotation from the estimated to the true platform,
    /// in n, arcsec.
    pub fn error(
        &self,
        misalignment: &Misalignment,
        coefficients: &CoefficientVector,
    ) -> StateVector {
        let (psi, d) = match self {
            Self::Linear(f) => (
                misalignment.relative_to(&f.rotation()),
                coefficients - f.coefficients,
            ),
            Self::Extended(f) => (
                misalignment.relative_to(&f.nominal.rotation) - f.eta,
                coefficients - f.nominal.coefficients - f.correction,
            ),
        };
        std::array::from_fn(|i| match i < COEFFICIENTS {
            true => d[i],
            false => psi[i - PSI],
        })
    }

    /// ψ^n (arcsec) and D (°/h) as estimated.
    pub fn estimate(&self) -> (Vector3<f64>, CoefficientVector) {
        match self {
            Self::Linear(f) => (f.psi, f.coefficients),
            Self::Extended(f) => {
                let best = f.best();
                (
                    best.rotation.scaled_axis() * ARCSEC_PER_RAD,
                    best.coefficients,
                )
            }
        }
    }

    /// The filter's own covariance, where it is computed along with the run.
    pub fn root(&self) -> Option<&SquareRoot> {
        match self {
            Self::Linear(_) => None,
            Self::Extended(f) => Some(&f.root),
        }
    }
}

/// The Kalman filter on the first-order model, with gains from beforehand.
#[derive(Debug)]
pub(super) struct LinearFilter<'a> {
    gains: &'a LinearGains,
    tick: usize,
    /// ψ^n, arcsec.
    psi: Vector3<f64>,
    /// D, °/h.
    coefficients: CoefficientVector,
}

impl<'a> LinearFilter<'a> {
    /// A filter that starts from zero.
    pub fn new(gains: &'a LinearGains) -> Self {
        Self {
            gains,
            tick: 0,
            psi: Vector3::zeros(),
            coefficients: CoefficientVector::zeros(),
        }
    }

    fn rotation(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(self.psi / ARCSEC_PER_RAD)
    }

    fn advance(&mut self, program: &Program, interval: &DriftInterval) {
        if let Some(q) = &interval.turn {
            self.psi = q * self.psi;
        }
        let t = &program.transitions[interval.transition];
        self.psi = t.phi * self.psi + t.b * self.coefficients;
    }

    fn measure(&mut self, z_n: &Vector3<f64>) -> f64 {
        let gains = &self.gains.ticks[self.tick];
        self.tick += 1;
        correct(gains, z_n, &mut self.psi, &mut self.coefficients)
    }
}

/// Adds to (ψ, D) what the two channels of `z_n` say beyond what ψ explains; gives the
/// normalised innovation squared.
fn correct(
    gains: &TickGain,
    z_n: &Vector3<f64>,
    psi: &mut Vector3<f64>,
    coefficients: &mut CoefficientVector,
) -> f64 {
    let mut nis = 0.0;
    for (channel, g) in CHANNELS.iter().zip(gains) {
        let innovation = z_n[channel.row] - channel.sign * psi[channel.axis];
        nis += (innovation / g.innovation_sigma).powi(2);
        for i in 0..COEFFICIENTS {
            coefficients[i] += g.gain[i] * innovation;
        }
        for i in 0..3 {
            psi[i] += g.gain[PSI + i] * innovation;
        }
    }
    nis
}

/// A platform as it is believed to be: what a filter is linearised about.
#[derive(Debug, Clone)]
pub(super) struct Nominal {
    /// Ê = Ĉ_p^n C_n^c.
    rotation: UnitQuaternion<f64>,
    /// D, °/h.
    coefficients: CoefficientVector,
}

impl Nominal {
    /// As before any measurement.
    fn unknown() -> Self {
        Self {
            rotation: UnitQuaternion::identity(),
            coefficients: CoefficientVector::zeros(),
        }
    }

    fn integrate(&mut self, earth_rate_n: &Vector3<f64>, interval: &DriftInterval, way: Direction) {
        let drift = GyroDrift::from_deg_per_h(&self.coefficients);
        let disturbance = Disturbance {
            earth_rate_n,
            drift: &drift,
            random_n: Vector3::zeros(),
        };
        self.rotation = disturbance.integrate(&self.rotation, interval, way);
    }

    /// Moved by a deviation: η in arcsec, D in °/h.
    fn moved(&self, eta: &Vector3<f64>, coefficients: &CoefficientVector) -> Self {
        Self {
            rotation: UnitQuaternion::from_scaled_axis(eta / ARCSEC_PER_RAD) * self.rotation,
            coefficients: self.coefficients + coefficients,
        }
    }
}

/// What an [`ExtendedFilter`] linearises about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum About {
    /// The estimate of the moment: the nominal platform is moved by every update.
    Estimate,
    /// A trajectory of the whole test, from an earlier pass: the nominal platform is left alone.
    Trajectory,
}

/// The extended filter: the nominal platform nonlinearly, the deviation from it linearly.
#[derive(Debug)]
pub(super) struct ExtendedFilter<'a> {
    belief: &'a Belief,
    about: About,
    nominal: Nominal,
    /// η of the estimate: E = exp([η×]) Ê, arcsec.
    eta: Vector3<f64>,
    /// D of the estimate less the nominal one, °/h.
    correction: CoefficientVector,
    root: SquareRoot,
}

impl<'a> ExtendedFilter<'a> {
    /// A filter that starts from zero and linearises about its estimate.
    pub fn new(belief: &'a Belief) -> Self {
        Self {
            belief,
            about: About::Estimate,
            nominal: Nominal::unknown(),
            eta: Vector3::zeros(),
            correction: CoefficientVector::zeros(),
            root: SquareRoot::diagonal(&belief.prior_sigma),
        }
    }

    /// A filter with the same prior that linearises about the trajectory from `start`.
    pub fn about(belief: &'a Belief, start: Nominal) -> Self {
        Self {
            about: About::Trajectory,
            eta: -start.rotation.scaled_axis() * ARCSEC_PER_RAD,
            correction: -start.coefficients,
            nominal: start,
            ..Self::new(belief)
        }
    }

    /// The estimate.
    fn best(&self) -> Nominal {
        self.nominal.moved(&self.eta, &self.correction)
    }

    /// Where the test must have started for the estimate to be right at its end.
    pub fn retraced(&self, program: &Program) -> Nominal {
        let mut nominal = self.best();
        for interval in program.intervals.iter().rev() {
            nominal.integrate(&self.belief.earth_rate_n, interval, Direction::Backward);
            if let Some(q) = &interval.turn {
                nominal.rotation = turned(&nominal.rotation, &q.transpose());
            }
        }
        nominal
    }

    /// How far the estimate lies from the nominal platform, squared, in σ.
    pub fn deviation(&self) -> f64 {
        let deviation = std::array::from_fn(|i| match i < COEFFICIENTS {
            true => self.correction[i],
            false => self.eta[i - PSI],
        });
        self.root.nees(&deviation).states
    }

    fn advance(&mut self, interval: &DriftInterval) {
        if let Some(q) = &interval.turn {
            self.root.turn(q);
            self.nominal.rotation = turned(&self.nominal.rotation, q);
            self.eta = q * self.eta;
        }
        let start = self.nominal.rotation;
        self.nominal
            .integrate(&self.belief.earth_rate_n, interval, Direction::Forward);
        let middle = start.nlerp(&self.nominal.rotation, 0.5);
        let (phi, b) = self.jacobians(interval, &middle);
        self.root
            .predict(&phi, &b, self.belief.drift_psd * interval.length_s);
        self.eta = phi * self.eta + b * self.correction;
    }

    /// Φ and B about the nominal platform: those of (8) with the attitude it is believed to
    /// have, and with the tilt's part in the specific force, F = −[ω_ie×] + M^n [g^n×].
    fn jacobians(
        &self,
        interval: &DriftInterval,
        rotation: &UnitQuaternion<f64>,
    ) -> (Matrix3<f64>, DriftMatrix) {
        let drift = GyroDrift::from_deg_per_h(&self.nominal.coefficients);
        let turn = rotation.to_rotation_matrix();
        let (mut m_n, mut a) = (Matrix3::zeros(), DriftMatrix::zeros());
        for (i, c_to_n) in interval.attitudes.iter().enumerate() {
            let weight = simpson_weight(i, interval.attitudes.len());
            let p_to_n = turn * Rotation3::from_matrix_unchecked(*c_to_n.matrix());
            let m = p_to_n.matrix() * drift.sensitivity * p_to_n.matrix().transpose();
            m_n += m * weight;
            a += drift_matrix(&Attitude::from_rotation(p_to_n)) * weight;
        }
        let f = m_n * GRAVITY_N.cross_matrix() - self.belief.earth_rate_n.cross_matrix();
        let (fh, identity) = (f * interval.length_s, Matrix3::identity());
        let gamma = identity + fh * 0.5;
        (identity + fh * gamma, gamma * a * interval.length_s)
    }

    fn measure(&mut self, z_n: &Vector3<f64>) -> f64 {
        let gravity = GRAVITY_N * ARCSEC_PER_RAD;
        // Z^n = g − Eᵀ g; turned by Ê, what exceeds the nominal one is η × g, the form of (9).
        let rotation = &self.nominal.rotation;
        let nominal_z = gravity - rotation.inverse_transform_vector(&gravity);
        let excess = rotation.transform_vector(&(z_n - nominal_z));
        let gains = update(&mut self.root, self.belief.noise);
        let nis = correct(&gains, &excess, &mut self.eta, &mut self.correction);
        if self.about == About::Estimate {
            self.nominal = self.best();
            self.eta = Vector3::zeros();
            self.correction = CoefficientVector::zeros();
        }
        nis
    }
}

/// Simpson's weight of node `i` of `count` (odd), the whole being 1; a single node has it all.
fn simpson_weight(i: usize, count: usize) -> f64 {
    let last = count - 1;
    let weight = match i {
        _ if last == 0 => return 1.0,
        0 => 1.0,
        i if i == last => 1.0,
        i if i % 2 == 1 => 4.0,
        _ => 2.0,
    };
    weight / (3 * last) as f64
}
