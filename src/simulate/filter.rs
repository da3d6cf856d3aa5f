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
use super::square_root::{Knowledge, ScalarGain, Shape};
use super::truth::{Measured, Misalignment};
use super::wander::Wandering;

/// What a filter believes before the test, and of the platform: each parameter in its unit, angles in
/// arcsec, times in s.
#[derive(Debug, Clone)]
pub(super) struct Belief {
    /// What the states are: the estimated parameters, what wanders, and ψ^n.
    pub shape: Shape,
    /// Of the states.
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
    /// What wanders, as far as the filter knows of it.
    pub wandering: Option<Wandering>,
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
        let wandering = Wandering::of(platform).filter(|_| told.wandering);
        let wanders = |by: &Wandering| by.has_biases();
        let start_sigma = wandering.as_ref().map(Wandering::start_sigma);
        let of_wandering = start_sigma.unwrap_or_default();
        Ok(Self {
            shape: Wandering::shape(wandering.as_ref(), estimated.len()),
            prior_sigma: of_twelve
                .chain(of_others)
                .chain(of_wandering)
                .chain(of_psi)
                .collect(),
            considered_sigma: considered.iter().map(|p| p.prior_sigma).collect(),
            drift_psd: platform.drift_psd_rad2_per_s()
                * (ARCSEC_PER_RAD * told.random_drift_factor).powi(2),
            sensors: Sensors {
                noise: Angle::from_rad(platform.noise_g()).arcsec() * told.accelerometer_factor,
                azimuth_noise: platform
                    .azimuth_noise_rad()
                    .map(|v| Angle::from_rad(v).arcsec() * told.azimuth_factor),
                has_vertical: layout.has_accelerometers_of(errors, Role::Estimated)
                    || wandering.as_ref().is_some_and(wanders),
            },
            earth_rate_n: platform.earth_rate_n(),
            layout,
            mixing: Mixing::new(&errors.effects()),
            wandering,
        })
    }

    /// How many parameters are estimated.
    pub fn estimated(&self) -> usize {
        self.shape.parameters
    }

    /// What is known before the test.
    pub fn knowledge(&self) -> Knowledge {
        Knowledge::new(&self.prior_sigma, &self.considered_sigma, self.shape)
    }
}

/// Values of the states, or corrections of them.
#[derive(Debug, Clone)]
pub(super) struct State {
    /// The estimated parameters, each in its unit, and behind them what wanders.
    pub parameters: Vec<f64>,
    /// Arcsec.
    pub psi: Vector3<f64>,
}

impl State {
    /// Zero.
    pub fn zero(shape: &Shape) -> Self {
        Self {
            parameters: vec![0.0; shape.psi()],
            psi: Vector3::zeros(),
        }
    }

    /// What is reported of it, without what wanders ([`Shape::reported`]).
    fn reported(&self, shape: &Shape) -> Self {
        let mut parameters = shape.reported(&self.numbers());
        parameters.truncate(shape.parameters);
        Self {
            parameters,
            psi: self.psi,
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

    /// Truth minus estimate of every state: of the `parameters` and of what wanders, given in the
    /// filter's order, and the rotation from the estimated to the true platform, in n, arcsec.
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
                let nominal = f.nominal.parameters.iter().chain(std::iter::repeat(&0.0));
                let known = nominal.zip(&f.correction.parameters);
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

    /// The parameters, and ψ^n as a rotation vector, as estimated and reported.
    pub fn estimate(&self, shape: &Shape) -> State {
        match self {
            Self::Linear(f) => f.state.reported(shape),
            Self::Extended(f) => {
                let mut best = f.best();
                let wandering = &f.correction.parameters[shape.parameters..];
                best.parameters.extend(wandering);
                let best = State {
                    psi: best.rotation.scaled_axis() * ARCSEC_PER_RAD,
                    parameters: best.parameters,
                };
                best.reported(shape)
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
