//! A filter at work in one run: the linear one, or one that linearises about estimates.

use nalgebra::Vector3;

use crate::attitude::UP;
use crate::covariance::selection::Mixing;
use crate::drift::COEFFICIENTS;
use crate::error::Result;
use crate::model::Role;
use crate::platform::Platform;
use crate::units::{ARCSEC_PER_RAD, Angle, AngularRate};

use super::channels::Sensors;
use super::ekf::ExtendedFilter;
use super::instruments::Layout;
use super::linear::LinearFilter;
use super::options::ToldNoise;
use super::program::{DriftInterval, Program};
use super::square_root::{Knowledge, ScalarGain};
use super::truth::{Measured, Misalignment};

/// What a filter believes before the test, and of the platform: each parameter in its unit, angles in
/// arcsec, times in s.
#[derive(Debug, Clone)]
pub(super) struct Belief {
    /// Of the states: the estimated parameters and ψ^n.
    pub prior_sigma: Vec<f64>,
    /// Of the considered parameters, which the filter does not know of.
    pub considered_sigma: Vec<f64>,
    /// q, arcsec²/s.
    pub drift_psd: f64,
    pub sensors: Sensors,
    pub earth_rate_n: Vector3<f64>,
    /// Which parameter is what.
    pub layout: Layout,
    /// What each does to first order.
    pub mixing: Mixing<f64>,
}

impl Belief {
    /// What `platform` says, with the noises it is told.
    ///
    /// # Errors
    ///
    /// Those of [`Layout::new`].
    pub fn new(platform: &Platform, told: &ToldNoise) -> Result<Self> {
        let psi = platform.prior_misalignment_rad();
        let d = platform.prior_drift_rad_per_s();
        let errors = platform.errors();
        let (estimated, considered) = errors.parameters().split_at(errors.estimated());
        let layout = Layout::new(errors)?;
        let of_twelve = d
            .iter()
            .map(|v| AngularRate::from_rad_per_s(*v).deg_per_h());
        let of_others = estimated[COEFFICIENTS..].iter().map(|p| p.prior_sigma);
        let of_psi = psi.iter().map(|v| Angle::from_rad(*v).arcsec());
        Ok(Self {
            prior_sigma: of_twelve.chain(of_others).chain(of_psi).collect(),
            considered_sigma: considered.iter().map(|p| p.prior_sigma).collect(),
            drift_psd: platform.drift_psd_rad2_per_s()
                * (ARCSEC_PER_RAD * told.random_drift_factor).powi(2),
            sensors: Sensors {
                noise: Angle::from_rad(platform.noise_g()).arcsec() * told.accelerometer_factor,
                azimuth_noise: platform
                    .azimuth_noise_rad()
                    .map(|v| Angle::from_rad(v).arcsec() * told.azimuth_factor),
                has_vertical: layout.has_accelerometers_of(errors, Role::Estimated),
            },
            earth_rate_n: platform.earth_rate_n(),
            layout,
            mixing: Mixing::new(&errors.effects()),
        })
    }

    /// How many parameters are estimated.
    pub fn estimated(&self) -> usize {
        self.prior_sigma.len() - 3
    }

    /// What is known before the test.
    pub fn knowledge(&self) -> Knowledge {
        Knowledge::new(&self.prior_sigma, &self.considered_sigma)
    }
}

/// Values of the states, or corrections of them.
#[derive(Debug, Clone)]
pub(super) struct State {
    /// The estimated parameters, each in its unit.
    pub parameters: Vec<f64>,
    /// Arcsec.
    pub psi: Vector3<f64>,
}

impl State {
    /// Zero, of so many parameters.
    pub fn zero(parameters: usize) -> Self {
        Self {
            parameters: vec![0.0; parameters],
            psi: Vector3::zeros(),
        }
    }

    /// All numbers in the order of the covariance.
    pub fn numbers(&self) -> Vec<f64> {
        let parameters = self.parameters.iter();
        parameters.chain(self.psi.iter()).copied().collect()
    }

    /// Adds what an innovation says.
    pub fn correct(&mut self, gain: &ScalarGain, innovation: f64) {
        let states = self.parameters.iter_mut().chain(self.psi.iter_mut());
        for (value, k) in states.zip(&gain.gain) {
            *value += k * innovation;
        }
    }
}

/// Called with an innovation in its 1σ and with its gain.
pub(super) type Taken<'a> = &'a mut dyn FnMut(f64, &ScalarGain);

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

    /// Takes what is measured at the end of `interval`.
    pub fn measure(&mut self, interval: &DriftInterval, measured: &Measured, taken: Taken<'_>) {
        match self {
            Self::Linear(f) => f.measure(interval, measured, taken),
            Self::Extended(f) => f.measure(interval, measured, taken),
        }
    }

    /// Truth minus estimate of every state: the parameters, of which the truth comes first with those
    /// that are estimated, and the rotation from the estimated to the true platform, in n, arcsec.
    pub fn error(&self, misalignment: &Misalignment, parameters: &[f64]) -> Vec<f64> {
        let (psi, error): (_, Vec<f64>) = match self {
            Self::Linear(f) => {
                let known = parameters.iter().zip(&f.state.parameters);
                (
                    misalignment.relative_to_vector(&(f.state.psi / ARCSEC_PER_RAD)),
                    known.map(|(truth, estimate)| truth - estimate).collect(),
                )
            }
            Self::Extended(f) => {
                let known = f.nominal.parameters.iter().zip(&f.correction.parameters);
                let known = parameters.iter().zip(known);
                (
                    misalignment.relative_to(&f.nominal.rotation) - f.correction.psi,
                    known
                        .map(|(truth, (nominal, correction))| truth - nominal - correction)
                        .collect(),
                )
            }
        };
        error.into_iter().chain(psi.iter().copied()).collect()
    }

    /// The parameters, and ψ^n as a rotation vector, as estimated.
    pub fn estimate(&self) -> State {
        match self {
            Self::Linear(f) => f.state.clone(),
            Self::Extended(f) => {
                let best = f.best();
                State {
                    psi: best.rotation.scaled_axis() * ARCSEC_PER_RAD,
                    parameters: best.parameters,
                }
            }
        }
    }

    /// The filter's own covariance, where it is computed along with the run.
    pub fn knowledge(&self) -> Option<&Knowledge> {
        match self {
            Self::Linear(_) => None,
            Self::Extended(f) => Some(&f.knowledge),
        }
    }
}

/// What an azimuth reference sees of ψ^n to first order.
pub(super) const AZIMUTH: [f64; 3] = {
    let mut seen = [0.0; 3];
    seen[UP] = 1.0;
    seen
};
