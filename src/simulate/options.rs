//! What is simulated, and with what filter.

use std::fmt;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::drift::CoefficientVector;
use crate::error::{Error, Result};

/// Equations of the true platform.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum TruthModel {
    /// Exact rotations and specific forces, see the module text.
    #[default]
    Nonlinear,
    /// The paper's (8) and (9): what its own simulation integrates.
    FirstOrder,
}

impl TruthModel {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Nonlinear, Self::FirstOrder];

    /// The name in options and documents.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nonlinear => "nonlinear",
            Self::FirstOrder => "first-order",
        }
    }
}

impl fmt::Display for TruthModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What the filter linearises about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum FilterModel {
    /// ψ = 0: the paper's linear model.
    Linear,
    /// The estimate of the moment.
    Extended,
    /// The estimate of the whole test, in several passes.
    #[default]
    Iterated,
}

impl FilterModel {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Linear, Self::Extended, Self::Iterated];

    /// The name in options and documents.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Extended => "extended",
            Self::Iterated => "iterated",
        }
    }
}

impl fmt::Display for FilterModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Whether the truth has noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TruthNoise {
    /// Random drift and accelerometer noise as the platform has them.
    #[default]
    Drawn,
    /// None: for comparing models.
    None,
}

/// What the filter is told of the noises, as factors of the truth's 1σ. One is the truth;
/// anything else makes a filter that misjudges itself.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ToldNoise {
    /// Of the accelerometers.
    pub accelerometer_factor: f64,
    /// Of the random drift.
    pub random_drift_factor: f64,
    /// Of the azimuth, where it is measured.
    pub azimuth_factor: f64,
    /// Whether it is told of drift and biases that wander, as they do; if not it takes all noise for
    /// white.
    pub wandering: bool,
}

impl ToldNoise {
    /// The same factor for all that is white.
    pub const fn both(factor: f64) -> Self {
        Self {
            wandering: true,
            accelerometer_factor: factor,
            random_drift_factor: factor,
            azimuth_factor: factor,
        }
    }
}

impl ToldNoise {
    /// The truth, but for what wanders: of that nothing.
    pub const fn only_white() -> Self {
        Self {
            wandering: false,
            ..Self::both(1.0)
        }
    }
}

impl Default for ToldNoise {
    fn default() -> Self {
        Self::both(1.0)
    }
}

/// What is simulated, and with what filter.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct SimulationOptions {
    /// Equations of the true platform.
    pub truth: TruthModel,
    /// What the filter linearises about.
    pub filter: FilterModel,
    /// Whether the truth has noise.
    pub noise: TruthNoise,
    /// What the filter is told of it.
    pub told: ToldNoise,
}

impl SimulationOptions {
    /// With this model of the truth.
    #[must_use]
    pub const fn with_truth(mut self, truth: TruthModel) -> Self {
        self.truth = truth;
        self
    }

    /// With this filter.
    #[must_use]
    pub const fn with_filter(mut self, filter: FilterModel) -> Self {
        self.filter = filter;
        self
    }

    /// With or without noise in the truth.
    #[must_use]
    pub const fn with_noise(mut self, noise: TruthNoise) -> Self {
        self.noise = noise;
        self
    }

    /// With a filter that is told this of the noise.
    #[must_use]
    pub const fn with_told(mut self, told: ToldNoise) -> Self {
        self.told = told;
        self
    }

    /// Checks what the filter is told.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] for a factor outside 1e-6 to 1e6.
    pub fn check(&self) -> Result<()> {
        for (key, factor) in [
            ("told.accelerometer_factor", self.told.accelerometer_factor),
            ("told.random_drift_factor", self.told.random_drift_factor),
            ("told.azimuth_factor", self.told.azimuth_factor),
        ] {
            if !(1e-6..=1e6).contains(&factor) {
                return Err(Error::out_of_range(key, factor, "1e-6 to 1e6"));
            }
        }
        Ok(())
    }
}

/// The true values a run starts from.
#[derive(Debug, Clone, PartialEq)]
pub struct InitialTruth {
    /// ψ^n(0) about North, Up, East: the rotation vector of E, arcsec.
    pub misalignment_n_arcsec: Vector3<f64>,
    /// The twelve coefficients, °/h (per g).
    pub drift_deg_per_h: CoefficientVector,
    /// The platform's other parameters in its order, estimated and considered, each in its unit; those
    /// that are left out at the end are zero.
    pub others: Vec<f64>,
}
