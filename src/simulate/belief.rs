//! What a filter knows before the test, and the values of its states.

use nalgebra::Vector3;

use crate::attitude::UP;
use crate::covariance::selection::Mixing;
use crate::drift::COEFFICIENTS;
use crate::error::Result;
use crate::model::Role;
use crate::platform::Platform;
use crate::units::{ARCSEC_PER_RAD, Angle, AngularRate};

use super::channels::Sensors;
use super::instruments::Layout;
use super::options::ToldNoise;
use super::square_root::{Knowledge, ScalarGain};
use super::states::Shape;
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
    pub fn reported(&self, shape: &Shape) -> Self {
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

/// What an azimuth reference sees of ψ^n to first order.
pub(super) const AZIMUTH: [f64; 3] = {
    let mut seen = [0.0; 3];
    seen[UP] = 1.0;
    seen
};
