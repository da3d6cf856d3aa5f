//! What the bound knows of a test: the platform in arcsec and °/h, and its division into cells.

use nalgebra::Vector3;

use crate::attitude::{NORTH, UP};
use crate::drift::{
    COEFFICIENTS, CoefficientMatrix, CoefficientVector, DriftCoefficient, DriftKind,
};
use crate::dynamics::ErrorDynamics;
use crate::model::{Colour, Mounting};
use crate::platform::{Platform, Repositioning};
use crate::units::{ARCSEC_PER_RAD, Angle, AngularRate};

/// Most cells of a test: longer tests get longer cells.
const MAX_CELLS: usize = 1500;
/// Largest prior variance of ψ relative to the noise that the recursion can follow. A smaller
/// prior only adds information, so the cut keeps every bound valid.
const LARGEST_PRIOR: f64 = 1e8;

/// The platform in the units of the computation: arcsec, °/h = arcsec/s, s.
#[derive(Debug, Clone)]
pub(super) struct Conditions {
    pub dynamics: ErrorDynamics,
    /// ω_N, ω_U and their norm, rad/s; not negative.
    pub omega_north: f64,
    pub omega_up: f64,
    pub omega: f64,
    /// PSD q of the random drift, arcsec²/s.
    pub drift_psd: f64,
    /// Variance r² of a measurement of a level component of ψ^n, arcsec².
    pub noise_variance: f64,
    /// Variance of a measurement of its vertical component, the azimuth, arcsec²; none: it is not
    /// measured.
    pub azimuth_variance: Option<f64>,
    pub period_s: f64,
    /// Prior variances of ψ^n, arcsec².
    pub prior_psi: Vector3<f64>,
    /// Prior 1σ of the coefficients, °/h.
    pub prior_sigma: CoefficientVector,
    /// Whether a change of position turns ψ^n.
    pub frame_hold: bool,
    /// What turns A of the paper's mounting into that of the platform; none: it is the paper's.
    pub mixing: Option<CoefficientMatrix>,
    /// Groups of errors that the platform has besides ψ and the twelve coefficients. The bound is
    /// that of a platform on which they are known: knowing more never raises a σ.
    pub taken_as_known: Vec<&'static str>,
    /// How the drift of the gyros wanders, in °/h.
    pub drift_colour: Colour,
    /// Its keys.
    pub drift_that_wanders: Vec<&'static str>,
    /// Keys of biases that wander, which are left out: they are taken as known too.
    pub biases_that_wander: Vec<&'static str>,
}

impl Conditions {
    pub fn new(platform: &Platform) -> Self {
        let rate = platform.earth_rate_n();
        let noise_variance = Angle::from_rad(platform.noise_g()).arcsec().powi(2);
        let azimuth_variance = platform
            .azimuth_noise_rad()
            .map(|rad| Angle::from_rad(rad).arcsec().powi(2));
        let mut prior_psi = platform.prior_misalignment_rad().map(|rad| {
            let variance = Angle::from_rad(rad).arcsec().powi(2);
            variance.min(LARGEST_PRIOR * noise_variance)
        });
        if let Some(azimuth) = azimuth_variance {
            prior_psi[UP] = prior_psi[UP].min(LARGEST_PRIOR * azimuth);
        }
        Self {
            dynamics: ErrorDynamics::new(rate),
            omega_north: rate[NORTH].abs(),
            omega_up: rate[UP].abs(),
            omega: rate.norm(),
            drift_psd: platform.drift_psd_rad2_per_s() * ARCSEC_PER_RAD.powi(2),
            noise_variance,
            azimuth_variance,
            period_s: platform.period_s(),
            prior_psi,
            prior_sigma: platform
                .prior_drift_rad_per_s()
                .map(|v| AngularRate::from_rad_per_s(v).deg_per_h()),
            frame_hold: platform.motion().repositioning == Repositioning::FrameHold,
            mixing: (*platform.errors().mounting() != Mounting::PAPER)
                .then(|| platform.errors().mounting().mixing_of_the_papers()),
            taken_as_known: others(platform),
            drift_colour: platform.drift_colour().times(ARCSEC_PER_RAD),
            drift_that_wanders: platform.keys_of_wandering_drift(),
            biases_that_wander: platform.keys_of_wandering_biases(),
        }
    }

    /// The smallest variance of a measurement of a component of ψ^n, arcsec².
    pub fn least_variance(&self) -> f64 {
        let azimuth = self.azimuth_variance.unwrap_or(f64::INFINITY);
        azimuth.min(self.noise_variance)
    }

    /// Information of the prior on each coefficient; infinite for a known one.
    pub fn prior_information(&self) -> CoefficientVector {
        self.prior_sigma.map(|s| (s * s).recip())
    }

    /// t = (D_IX + D_IY + D_IZ)/√3, the direction that drifts alike at every attitude, when it
    /// can be treated apart: ψ^n is not turned by moves and none of the three is known.
    pub fn trace_direction(&self) -> Option<CoefficientVector> {
        let mut t = CoefficientVector::zeros();
        for c in DriftCoefficient::ALL {
            if c.kind() == DriftKind::Input {
                if self.prior_sigma[c.index()] == 0.0 {
                    return None;
                }
                t[c.index()] = 1.0;
            }
        }
        (!self.frame_hold).then(|| t.normalize())
    }

    /// The prior information on the three D_I made equal, to the largest of them: a majorant of
    /// the prior in which t has no cross term.
    pub fn decoupled_prior_information(&self) -> CoefficientVector {
        let mut information = self.prior_information();
        let is_input = |i: usize| DriftCoefficient::ALL[i].kind() == DriftKind::Input;
        let largest = (0..COEFFICIENTS)
            .filter(|&i| is_input(i))
            .map(|i| information[i])
            .fold(0.0, f64::max);
        for i in (0..COEFFICIENTS).filter(|&i| is_input(i)) {
            information[i] = largest;
        }
        information
    }
}

/// The groups of errors that are not known exactly, beyond the twelve coefficients.
fn others(platform: &Platform) -> Vec<&'static str> {
    let mut groups = Vec::new();
    for parameter in &platform.errors().parameters()[COEFFICIENTS..] {
        if parameter.prior_sigma > 0.0 && !groups.contains(&parameter.group) {
            groups.push(parameter.group);
        }
    }
    groups
}

/// The test divided into equal cells of `per_cell` filter periods; the last may reach beyond it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cells {
    pub count: usize,
    pub length_s: f64,
    /// Most measurements in a cell, as a number.
    pub per_cell: f64,
    /// Most measurements of the whole test.
    pub measurements: f64,
    pub total_time_s: f64,
}

impl Cells {
    /// The cells of a test; none when it is too short for a measurement.
    pub fn new(conditions: &Conditions, total_time_s: f64) -> Option<Self> {
        let measurements = (total_time_s / conditions.period_s + 1e-9).floor();
        if measurements.is_nan() || measurements < 1.0 {
            return None;
        }
        let per_cell = (measurements / MAX_CELLS as f64).ceil();
        let length_s = per_cell * conditions.period_s;
        Some(Self {
            count: (total_time_s / length_s - 1e-9).ceil().max(1.0) as usize,
            length_s,
            per_cell,
            measurements,
            total_time_s,
        })
    }

    /// The part of cell `j` that belongs to the test, s.
    pub fn inside_s(&self, j: usize) -> f64 {
        (self.total_time_s - j as f64 * self.length_s).clamp(0.0, self.length_s)
    }

    /// Whether a measurement may be shared out to the start of the test: a measurement comes one
    /// period after the start or later, so not when the cells are single periods.
    pub fn measures_at_start(&self) -> bool {
        self.per_cell > 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::{AxisValue, GSensitivePrior, PlatformConfig};

    #[test]
    fn the_prior_with_equal_inputs_is_a_majorant_of_the_prior() {
        let mut config = PlatformConfig::default();
        config.prior.g_sensitive_drift_deg_per_h_per_g =
            GSensitivePrior::All(AxisValue::PerAxis([8.0, 2.0, 5.0]));
        let conditions = Conditions::new(&config.check().unwrap());
        let prior = conditions.prior_information();
        let equal = conditions.decoupled_prior_information();
        for c in DriftCoefficient::ALL {
            let i = c.index();
            let sigma = conditions.prior_sigma[i];
            assert!((prior[i] * sigma * sigma - 1.0).abs() < 1e-12);
            // The best of the three is σ = 2 °/h/g.
            let expected = match c.kind() {
                DriftKind::Input => 0.25,
                _ => prior[i],
            };
            assert!((equal[i] / expected - 1.0).abs() < 1e-9, "{}", c.name());
            assert!(equal[i] >= prior[i] * (1.0 - 1e-9));
        }
    }
}
