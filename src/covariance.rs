//! What the filter will know: the covariance of a schedule, before any test.
//!
//! Everything is linear and Gaussian, so the covariance does not depend on the data. In n the
//! six states (ψ^n, ε^n) of a dwell obey the same equations at every position; the position
//! enters only through ε^n = A D. So one [`kernel`] per dwell duration serves all positions, and
//! a schedule is a short [`chain`] of them, at a cost independent of how long the dwells are:
//!
//! - [`kernel`]: n filter periods of a dwell composed into one element, in square-root form;
//! - [`chain`]: value of a schedule through the elements (Friedland's separated bias), in doubles
//!   and, where those are lost, in numbers of 32 digits;
//! - `coloured`: both where drift or biases wander, with more states beside ψ^n;
//! - [`gradient`]: its reverse mode;
//! - `fast`: value and gradient in straight-line code, for one schedule or several at once;
//! - [`mod@filter`]: a step-by-step square-root filter on faer with an attitude and gyro axes of its
//!   own, for the convergence history and to check every winner; it says what the two share.
//!
//! States are in arcsec, drift in °/h = arcsec/s, time in s; see [`crate::units`].

pub mod chain;
pub(crate) mod coloured;
pub(crate) mod fast;
pub mod filter;
pub mod full;
pub mod gradient;
pub mod history;
pub mod kernel;
mod kernel_table;
pub(crate) mod link;
pub(crate) mod real;
mod root;
mod rows;
pub(crate) mod selection;
pub(crate) mod signatures;
mod small;
mod triangle;
mod twelve;

use std::borrow::Cow;

use nalgebra::{Matrix3, Vector3};

use crate::attitude::{Attitude, EAST, NORTH, Stand, UP};
use crate::drift::{CoefficientMatrix, CoefficientVector, DriftMatrix};
use crate::dynamics::ErrorDynamics;
use crate::error::Error;
use crate::model::{Colour, ErrorModel, Mounting};
use crate::platform::{Platform, SlewLimits};
use crate::units::{ARCSEC_PER_RAD, Angle, AngularRate};
use coloured::kernel::KeptKernels;
use fast::arithmetic::MOST_LANES;
use fast::coloured::Coloured;
use fast::information::PriorScale;
use fast::mixing::Mixing;
use kernel_table::KernelTable;
pub(crate) use root::Rooted;
pub use root::{CoefficientCovariance, CovarianceRoot, Slope};

/// When the filter measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TickRule {
    /// As the filter runs: the first measurement one period after a dwell starts; a remainder
    /// shorter than a period propagates without a measurement. Discontinuous in the duration.
    #[default]
    Filter,
    /// For optimisation: a remainder of a fraction f of a period ends with a measurement of
    /// information f/r². Continuous in the duration, and equal to [`TickRule::Filter`] at whole
    /// periods, where a search's schedules end up.
    Relaxed,
}

/// The numbers that a covariance was worked out in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// Doubles: sixteen digits.
    #[default]
    Double,
    /// 32 digits, where measurements tell so much more than the prior that sixteen are too few.
    Extended,
}

/// Splits a duration into whole filter periods and a remainder, s. A duration within 1e-9
/// periods of a whole number counts as whole.
pub fn split_periods(duration_s: f64, period_s: f64) -> (usize, f64) {
    let periods = (duration_s / period_s + 1e-9).floor();
    let remainder = duration_s - periods * period_s;
    let remainder = if remainder < 1e-9 * period_s {
        0.0
    } else {
        remainder
    };
    (periods as usize, remainder)
}

/// The covariance model of a platform: dynamics, noises and prior in arcsec and °/h, and the
/// table of dwell kernels. Shared freely between threads.
#[derive(Debug)]
pub struct CovarianceModel {
    pub(crate) dynamics: ErrorDynamics,
    /// What attitude the gimbals' angles are.
    pub(crate) stand: Stand,
    /// PSD q of the random drift, arcsec²/s.
    pub(crate) drift_psd: f64,
    /// How the drift of the gyros wanders, °/h.
    pub(crate) drift_colour: Colour,
    /// How the bias of the accelerometers wanders, arcsec.
    pub(crate) accelerometer_colour: Colour,
    /// Variance r² of a measurement, arcsec².
    pub(crate) noise_variance: f64,
    pub(crate) period_s: f64,
    /// Prior covariance of ψ^n, arcsec².
    pub(crate) prior_psi: Matrix3<f64>,
    /// Prior 1σ of the coefficients, °/h.
    pub(crate) prior_sigma: CoefficientVector,
    /// The same gyro by gyro.
    prior_scale: PriorScale,
    /// All parameters, for the route of [`CovarianceModel::full_covariance`].
    pub(crate) errors: ErrorModel,
    /// The same for the fast route, where there are more than the paper has.
    mixing: Option<Mixing>,
    /// The same where drift or biases wander.
    coloured: Option<Box<Coloured>>,
    /// The kernels of dwells there.
    pub(crate) coloured_kernels: KeptKernels,
    /// Variance of the azimuth measured in a period, arcsec².
    pub(crate) azimuth_variance: Option<f64>,
    /// ω_ie^n, rad/s.
    pub(crate) earth_rate_n: Vector3<f64>,
    /// Whether a change of position keeps ψ in the platform frame instead of in n.
    pub(crate) frame_hold: bool,
    /// How fast the gimbals turn.
    slew: Option<SlewLimits>,
    /// Of what ψ_x and ψ_z tell.
    pub(crate) kernels: KernelTable,
    /// Of what the azimuth tells too, where it is measured.
    with_azimuth: Option<KernelTable>,
    /// Most lanes that schedules are worked out in.
    most_lanes: usize,
}

impl CovarianceModel {
    /// The model of `platform`.
    pub fn new(platform: &Platform) -> Self {
        let dynamics = ErrorDynamics::new(platform.earth_rate_n);
        let drift_psd = platform.drift_psd * ARCSEC_PER_RAD.powi(2);
        let noise_variance = Angle::from_rad(platform.noise_g).arcsec().powi(2);
        let prior: Vector3<f64> = platform
            .prior_misalignment_rad
            .map(|rad| Angle::from_rad(rad).arcsec().powi(2));
        let prior_sigma: CoefficientVector = platform
            .prior_drift_rad_per_s
            .map(|v| AngularRate::from_rad_per_s(v).deg_per_h());
        let azimuth_variance = platform
            .azimuth_noise_rad
            .map(|v| Angle::from_rad(v).arcsec().powi(2));
        let mut model = Self {
            dynamics,
            stand: platform.stand,
            drift_psd,
            // rad/s to °/h = arcsec/s, and g = rad of tilt to arcsec.
            drift_colour: platform.drift_colour.times(ARCSEC_PER_RAD),
            accelerometer_colour: platform.accelerometer_colour.times(ARCSEC_PER_RAD),
            noise_variance,
            period_s: platform.period_s,
            prior_psi: Matrix3::from_diagonal(&prior),
            prior_sigma,
            prior_scale: PriorScale::new(&prior_sigma),
            mixing: (!platform.is_of_the_paper()).then(|| Mixing::new(&platform.errors, &[])),
            errors: platform.errors.clone(),
            with_azimuth: azimuth_variance.map(|azimuth| {
                let measured = measured(noise_variance, Some(azimuth));
                KernelTable::measuring(dynamics, platform.period_s, drift_psd, measured)
            }),
            azimuth_variance,
            earth_rate_n: platform.earth_rate_n,
            frame_hold: platform.motion.repositioning == crate::platform::Repositioning::FrameHold,
            slew: platform.motion.slew,
            kernels: KernelTable::new(dynamics, platform.period_s, drift_psd, noise_variance),
            most_lanes: MOST_LANES,
            coloured: None,
            coloured_kernels: KeptKernels::default(),
        };
        let settle_s = platform.motion.settle_s;
        model.coloured = Coloured::of(&model, &[], settle_s).map(Box::new);
        model
    }

    /// The same, working out several schedules in at most `most` lanes: 4 keeps to AVX2 where
    /// AVX-512 is there, 1 to plain numbers. For tests and benchmarks; results agree to rounding.
    pub fn with_most_lanes(mut self, most: usize) -> Self {
        self.most_lanes = most;
        self
    }

    /// The same where figures of merit see more than the twelve coefficients: the parameters at `others`
    /// too, places in [`ErrorModel::parameters`].
    pub(crate) fn seeing(mut self, others: &[usize]) -> Self {
        if self.mixing.is_some() {
            self.mixing = Some(Mixing::new(&self.errors, others));
        }
        if let Some(coloured) = self.coloured.take() {
            self.coloured = Some(Box::new(coloured.seeing(&self, others)));
        }
        self
    }

    /// A of the twelve coefficients at an attitude, in the platform's own mounting.
    pub(crate) fn drift_matrix(&self, attitude: &Attitude) -> DriftMatrix {
        self.mounting().drift_matrix(attitude)
    }

    /// The axes of the gyros.
    pub(crate) fn mounting(&self) -> &Mounting {
        self.errors.mounting()
    }

    /// Whether there is nothing but ψ and the twelve coefficients in the paper's mounting, under white
    /// noise, seen in two channels.
    pub(crate) fn is_of_the_paper(&self) -> bool {
        self.errors.is_of_the_paper() && self.azimuth_variance.is_none() && self.is_white()
    }

    /// Whether neither drift nor accelerometers wander.
    pub(crate) fn is_white(&self) -> bool {
        self.drift_colour.is_white() && self.accelerometer_colour.is_white()
    }

    /// Variance of the measurement of each component of ψ^n in a period, arcsec².
    pub(crate) fn measured_variance(&self) -> [Option<f64>; 3] {
        measured(self.noise_variance, self.azimuth_variance)
    }

    /// The kernels of dwells with everything that is measured: what searches go by.
    pub(crate) fn searched_kernels(&self) -> &KernelTable {
        self.with_azimuth.as_ref().unwrap_or(&self.kernels)
    }

    /// The components of ψ^n that are measured: North and East by Z, Up where the azimuth is.
    pub(crate) fn measured_axes(&self) -> impl Iterator<Item = usize> {
        let measured = self.measured_variance();
        [NORTH, EAST, UP]
            .into_iter()
            .filter(move |&axis| measured[axis].is_some())
    }

    /// ω_N, rad/s.
    pub(crate) fn omega_north(&self) -> f64 {
        // F_{zy} = −ω_N, from ψ̇_z = ω_U ψ_x − ω_N ψ_y + ε_z (10).
        -self.dynamics.system_matrix()[(EAST, UP)]
    }

    /// Prior 1σ of the coefficients, °/h.
    pub fn prior_sigma_deg_per_h(&self) -> &CoefficientVector {
        &self.prior_sigma
    }
}

/// Variance of the measurement of each component of ψ^n in a period.
fn measured(level: f64, azimuth: Option<f64>) -> [Option<f64>; 3] {
    let mut measured = [Some(level); 3];
    measured[UP] = azimuth;
    measured
}

/// The covariance at the end of a schedule.
#[derive(Debug, Clone, PartialEq)]
pub struct EndCovariance {
    /// Of the coefficients, P_D, (°/h)².
    pub coefficients: CoefficientMatrix,
    /// L with P_D = L Lᵀ, °/h.
    pub root: CovarianceRoot,
    /// Of ψ^n, arcsec², the coefficients' uncertainty included.
    pub misalignment: Matrix3<f64>,
}

impl CoefficientCovariance for EndCovariance {
    fn matrix(&self) -> &CoefficientMatrix {
        &self.coefficients
    }
    fn root(&self) -> Cow<'_, CovarianceRoot> {
        Cow::Borrowed(&self.root)
    }
}

impl EndCovariance {
    /// 1σ of each coefficient, °/h.
    pub fn sigma_deg_per_h(&self) -> CoefficientVector {
        self.coefficients.diagonal().map(f64::sqrt)
    }

    /// 1σ of ψ^n about North, Up, East, arcsec.
    pub fn misalignment_sigma_arcsec(&self) -> Vector3<f64> {
        self.misalignment.diagonal().map(f64::sqrt)
    }
}

fn not_finite() -> Error {
    Error::numerical(
        "the information of the schedule overflows double precision: the noises, the prior and \
         the durations are too far apart to give a trustworthy number",
    )
}
