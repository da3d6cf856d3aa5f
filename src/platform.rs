//! The platform: site, noises, prior knowledge, gimbals and motion.
//!
//! [`PlatformConfig`] is what a person writes, with units in the names; [`PlatformConfig::check`]
//! tests every value and gives the [`Platform`] the computation takes: valid by construction and
//! in SI.

use std::path::PathBuf;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::attitude::{Stand, earth_rate_n};
use crate::drift::{CoefficientVector, DriftCoefficient, DriftKind};
use crate::error::{Error, Result};
use crate::model::{Colour, ErrorModel};
use crate::units::{Angle, AngularRate};

mod allowed;
mod axis_value;
mod check;
mod colour;
mod errors;
mod gimbals;
mod motion;
mod obstacles;
mod slew;
mod stand;
pub use axis_value::{AxisValue, GSensitivePrior};
pub use check::CheckPosition;
pub use errors::{AzimuthConfig, ErrorTable, ErrorsConfig, OutputAxes, OutputAxis};
pub(crate) use gimbals::multiples;
pub use gimbals::{GimbalRange, Gimbals};
pub use motion::{Motion, MotionConfig, Repositioning};
pub use obstacles::ForbiddenConfig;
pub(crate) use obstacles::Obstacles;
pub use slew::SlewLimits;
pub use stand::StandConfig;

/// Where the test stands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct SiteConfig {
    /// Geographic latitude, degrees, −90 to 90.
    pub latitude_deg: f64,
}

/// The accelerometers.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct AccelerometerConfig {
    /// White noise, 1σ per sample and axis, g, greater than zero; neither form given: 1e-5 g.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise_g: Option<f64>,
    /// The same as a two-sided density, µg/√Hz: `noise_g` = density · 1e-6 / √`period_s`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise_density_ug_per_sqrt_hz: Option<f64>,
    /// Acceleration random walk K, µg/√h: the bias wanders by K √t; none: it does not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub acceleration_random_walk_ug_per_sqrt_h: Option<f64>,
    /// Bias instability, 1σ of a first-order Gauss–Markov process, µg; none: there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bias_instability_ug: Option<f64>,
    /// Its time constant, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bias_correlation_time_s: Option<f64>,
}

/// The gyros' random drift; of white noise give one of the two forms, or none for the default of
/// 0.01 °/h.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct GyroConfig {
    /// 1σ of the drift averaged over one filter period, °/h: PSD q = σ² · period.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub random_drift_deg_per_h: Option<f64>,
    /// Angular random walk N, °/√h: PSD q = N².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub angle_random_walk_deg_per_sqrt_h: Option<f64>,
    /// Rate random walk K, °/h/√h: the drift wanders by K √t; none: it does not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_random_walk_deg_per_h_per_sqrt_h: Option<f64>,
    /// Bias instability, 1σ of a first-order Gauss–Markov process, °/h; none: there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bias_instability_deg_per_h: Option<f64>,
    /// Its time constant, s.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bias_correlation_time_s: Option<f64>,
    /// Output axes of the gyros X, Y, Z; input axes are +x, +y, +z, spin axes input × output.
    #[serde(skip_serializing_if = "OutputAxes::is_empty")]
    pub output_axis: OutputAxes,
}

/// The Kalman filter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct FilterConfig {
    /// Filter period, s: one measurement per period.
    pub period_s: f64,
}

/// What is known before the test, 1σ.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct PriorConfig {
    /// Misalignment ψ^n about North, Up, East, degrees.
    pub misalignment_deg: AxisValue,
    /// Constant drift D_F of the X, Y, Z gyro, °/h.
    pub constant_drift_deg_per_h: AxisValue,
    /// g-sensitive drift, °/h/g.
    pub g_sensitive_drift_deg_per_h_per_g: GSensitivePrior,
}

/// What the gimbals allow.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct GimbalsConfig {
    /// Range of α, degrees; none: unlimited rotation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub alpha_deg: Option<[f64; 2]>,
    /// Range of β, degrees; none: unlimited rotation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub beta_deg: Option<[f64; 2]>,
    /// Range of γ, degrees; none: unlimited rotation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gamma_deg: Option<[f64; 2]>,
    /// Index table: positions only at multiples of this, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_deg: Option<f64>,
    /// Closed boxes of angles that no position and no move may enter.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub forbidden: Vec<ForbiddenConfig>,
    /// Most |net angle − start| of α, β, γ at every instant of a test, degrees; none: no limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_winding_deg: Option<[f64; 3]>,
    /// A file that lists the positions which the stand can hold (CSV: `alpha_deg`, `beta_deg`,
    /// `gamma_deg`); none: any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub allowed: Option<PathBuf>,
    /// Platform axes that the outer, middle and inner gimbal turn about at zero angles, `"+x"` to `"-z"`:
    /// the sign is the sense of a positive angle, right-handed; none: `["-x", "-y", "-z"]`, the seed
    /// paper's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axes: Option<[String; 3]>,
}

/// A platform as a person describes it; the `[site]` … `[motion]` tables of a platform file.
///
/// The default is the seed paper's §3: L = 28.2°, accelerometer 1e-5 g, random drift 0.01 °/h,
/// 10 s filter period, moves that take no time.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct PlatformConfig {
    /// Where the test stands.
    pub site: SiteConfig,
    /// The accelerometers.
    pub accelerometer: AccelerometerConfig,
    /// The gyros' random drift.
    pub gyro: GyroConfig,
    /// The Kalman filter.
    pub filter: FilterConfig,
    /// What is known before the test.
    pub prior: PriorConfig,
    /// What the gimbals allow.
    pub gimbals: GimbalsConfig,
    /// How the base of the stand is set up.
    #[serde(skip_serializing_if = "StandConfig::is_empty")]
    pub stand: StandConfig,
    /// How the platform moves.
    pub motion: MotionConfig,
    /// An azimuth reference.
    #[serde(skip_serializing_if = "AzimuthConfig::is_empty")]
    pub azimuth: AzimuthConfig,
    /// Errors beyond the twelve coefficients.
    #[serde(skip_serializing_if = "ErrorsConfig::is_empty")]
    pub errors: ErrorsConfig,
}

/// 1σ noise of the accelerometers when the file gives neither form, g: the seed paper's §3.1.
pub(crate) const DEFAULT_NOISE_G: f64 = 1e-5;

/// 1σ random drift when the file gives neither form, °/h: the seed paper's §3.1.
pub(crate) const DEFAULT_RANDOM_DRIFT_DEG_PER_H: f64 = 0.01;

impl Default for SiteConfig {
    fn default() -> Self {
        Self { latitude_deg: 28.2 }
    }
}
impl Default for FilterConfig {
    fn default() -> Self {
        Self { period_s: 10.0 }
    }
}
impl Default for PriorConfig {
    fn default() -> Self {
        Self {
            misalignment_deg: AxisValue::All(0.1),
            constant_drift_deg_per_h: AxisValue::All(15.0),
            g_sensitive_drift_deg_per_h_per_g: GSensitivePrior::All(AxisValue::All(8.0)),
        }
    }
}
/// A platform with every value checked, in SI. Made by [`PlatformConfig::check`].
#[derive(Debug, Clone, PartialEq)]
pub struct Platform {
    pub(crate) earth_rate_n: Vector3<f64>,
    pub(crate) noise_g: f64,
    pub(crate) drift_psd: f64,
    /// Of the gyros, rad/s.
    pub(crate) drift_colour: Colour,
    /// Of the accelerometers, g.
    pub(crate) accelerometer_colour: Colour,
    pub(crate) period_s: f64,
    pub(crate) prior_misalignment_rad: Vector3<f64>,
    pub(crate) prior_drift_rad_per_s: CoefficientVector,
    pub(crate) errors: ErrorModel,
    pub(crate) azimuth_noise_rad: Option<f64>,
    pub(crate) gimbals: Gimbals,
    pub(crate) obstacles: Obstacles,
    pub(crate) stand: Stand,
    pub(crate) motion: Motion,
}

impl Platform {
    /// Earth rate in n, (ω_N, ω_U, 0), rad/s.
    pub fn earth_rate_n(&self) -> Vector3<f64> {
        self.earth_rate_n
    }
    /// Accelerometer noise, 1σ per sample and axis, g (for the measurement (6): rad).
    pub fn noise_g(&self) -> f64 {
        self.noise_g
    }
    /// PSD q of the random drift w, rad²/s.
    pub fn drift_psd_rad2_per_s(&self) -> f64 {
        self.drift_psd
    }
    /// How the drift of the gyros wanders, rad/s.
    pub fn drift_colour(&self) -> &Colour {
        &self.drift_colour
    }
    /// How the bias of the accelerometers wanders, g.
    pub fn accelerometer_colour(&self) -> &Colour {
        &self.accelerometer_colour
    }
    /// Whether neither wanders.
    pub fn is_white(&self) -> bool {
        self.drift_colour.is_white() && self.accelerometer_colour.is_white()
    }
    /// Filter period, s.
    pub fn period_s(&self) -> f64 {
        self.period_s
    }
    /// Prior 1σ of ψ^n about North, Up, East, rad.
    pub fn prior_misalignment_rad(&self) -> Vector3<f64> {
        self.prior_misalignment_rad
    }
    /// Prior 1σ of each drift coefficient, rad/s (per g).
    pub fn prior_drift_rad_per_s(&self) -> &CoefficientVector {
        &self.prior_drift_rad_per_s
    }
    /// The error model: the twelve coefficients and what else the platform has.
    pub fn errors(&self) -> &ErrorModel {
        &self.errors
    }
    /// The same with a filter that estimates a group of errors that it only had to suffer.
    pub(crate) fn estimating(&self, group: &str) -> Self {
        Self {
            errors: self.errors.estimating(group),
            ..self.clone()
        }
    }

    /// Noise of the azimuth measured in each filter period, 1σ, rad; none: it is not measured.
    pub fn azimuth_noise_rad(&self) -> Option<f64> {
        self.azimuth_noise_rad
    }
    /// Whether it is the seed paper's platform: nothing but ψ and the twelve coefficients, in its
    /// mounting, white noise, and two channels of measurement.
    pub fn is_of_the_paper(&self) -> bool {
        self.errors.is_of_the_paper() && self.azimuth_noise_rad.is_none() && self.is_white()
    }
    /// The shortest dwell that a search proposes, s: the minimum dwell in whole filter periods,
    /// one at least.
    pub fn shortest_dwell_s(&self) -> f64 {
        let periods = (self.motion.min_dwell_s / self.period_s - 1e-9).ceil();
        periods.max(1.0) * self.period_s
    }
    /// The gimbals.
    pub fn gimbals(&self) -> &Gimbals {
        &self.gimbals
    }
    /// What the gimbals have in their way.
    pub(crate) fn obstacles(&self) -> &Obstacles {
        &self.obstacles
    }
    /// How the gimbals are hung and the base stands: what attitude their angles are.
    pub fn stand(&self) -> &Stand {
        &self.stand
    }
    /// The motion between positions.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }
}

/// Refuses `value` unless it lies in `low..=high`; NaN never does.
pub(crate) fn in_range(key: &str, value: f64, low: f64, high: f64, allowed: &str) -> Result<f64> {
    if (low..=high).contains(&value) {
        Ok(value)
    } else {
        Err(Error::out_of_range(key, value, allowed))
    }
}

impl PlatformConfig {
    /// Checks every value and converts to SI.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] naming the key, the value and what is allowed.
    pub fn check(&self) -> Result<Platform> {
        let latitude_deg = in_range(
            "site.latitude_deg",
            self.site.latitude_deg,
            -90.0,
            90.0,
            "-90 to 90",
        )?;
        let period_s = in_range(
            "filter.period_s",
            self.filter.period_s,
            1e-3,
            1e5,
            "0.001 to 100000",
        )?;
        let (gimbals, obstacles) = self.gimbals.check()?;
        let prior_drift_rad_per_s = self.prior.drift_rad_per_s()?;
        let errors = ErrorModel::new(
            &prior_drift_rad_per_s.map(|v| AngularRate::from_rad_per_s(v).deg_per_h()),
            self.errors.check()?,
            self.gyro.output_axis.check()?,
        );
        Ok(Platform {
            earth_rate_n: earth_rate_n(Angle::from_deg(latitude_deg).rad()),
            noise_g: self.accelerometer.noise(period_s)?,
            drift_psd: self.gyro.drift_psd(period_s)?,
            drift_colour: self.gyro.colour()?,
            accelerometer_colour: self.accelerometer.colour()?,
            period_s,
            prior_misalignment_rad: self.prior.misalignment_rad()?,
            prior_drift_rad_per_s,
            errors,
            azimuth_noise_rad: self.azimuth.check()?,
            motion: self.motion.check(&gimbals, &obstacles)?,
            gimbals,
            obstacles,
            stand: self.stand.check(self.gimbals.axes.as_ref())?,
        })
    }
}

impl GyroConfig {
    fn drift_psd(&self, period_s: f64) -> Result<f64> {
        const WALK: &str = "gyro.angle_random_walk_deg_per_sqrt_h";
        const DRIFT: &str = "gyro.random_drift_deg_per_h";
        match (
            self.random_drift_deg_per_h,
            self.angle_random_walk_deg_per_sqrt_h,
        ) {
            (Some(_), Some(walk)) => Err(both_given(WALK, walk, DRIFT)),
            (None, Some(walk)) => {
                let walk = in_range(WALK, walk, 0.0, 1e3, "0 to 1000")?;
                // °/√h: the angle grows by N √t with t in hours.
                Ok(Angle::from_deg(walk).rad().powi(2) / 3600.0)
            }
            (drift, None) => {
                let drift = drift.unwrap_or(DEFAULT_RANDOM_DRIFT_DEG_PER_H);
                let drift = in_range(DRIFT, drift, 0.0, 1e4, "0 to 10000")?;
                Ok(AngularRate::from_deg_per_h(drift).rad_per_s().powi(2) * period_s)
            }
        }
    }
}

/// The two forms of a noise are both given.
fn both_given(key: &str, value: f64, other: &str) -> Error {
    Error::input(format!("given together with {other}"))
        .with_key(key)
        .with_value(value)
        .with_allowed("one of the two")
}

impl PriorConfig {
    fn misalignment_rad(&self) -> Result<Vector3<f64>> {
        let key = "prior.misalignment_deg";
        let values = self.misalignment_deg.check(key, 90.0, "0 to 90")?;
        Ok(Vector3::from(values.map(|v| Angle::from_deg(v).rad())))
    }

    fn drift_rad_per_s(&self) -> Result<CoefficientVector> {
        const ALLOWED: &str = "0 to 1e12 (0: known exactly)";
        let constant =
            self.constant_drift_deg_per_h
                .check("prior.constant_drift_deg_per_h", 1e12, ALLOWED)?;
        let key = "prior.g_sensitive_drift_deg_per_h_per_g";
        let [input, output, spin] = match &self.g_sensitive_drift_deg_per_h_per_g {
            GSensitivePrior::All(v) => [v.check(key, 1e12, ALLOWED)?; 3],
            GSensitivePrior::PerAxis {
                input,
                output,
                spin,
            } => [
                input.check(&format!("{key}.input"), 1e12, ALLOWED)?,
                output.check(&format!("{key}.output"), 1e12, ALLOWED)?,
                spin.check(&format!("{key}.spin"), 1e12, ALLOWED)?,
            ],
        };
        let mut prior = CoefficientVector::zeros();
        for c in DriftCoefficient::ALL {
            let values = match c.kind() {
                DriftKind::Constant => constant,
                DriftKind::Input => input,
                DriftKind::Output => output,
                DriftKind::Spin => spin,
            };
            prior[c.index()] = AngularRate::from_deg_per_h(values[c.gyro()]).rad_per_s();
        }
        Ok(prior)
    }
}

impl GimbalsConfig {
    fn check(&self) -> Result<(Gimbals, Obstacles)> {
        let gimbals = self.ranges()?;
        let list = self.allowed.as_deref().map(allowed::read).transpose()?;
        let in_the_list = |e: Error| match (e.key(), &self.allowed) {
            (Some(key), Some(file)) if key.starts_with("positions[") => e.with_file(file),
            _ => e,
        };
        let obstacles = Obstacles::new(
            &self.forbidden,
            self.max_winding_deg,
            list.as_deref(),
            &gimbals,
        );
        Ok((gimbals, obstacles.map_err(in_the_list)?))
    }

    /// The ranges and the index step.
    fn ranges(&self) -> Result<Gimbals> {
        let axes = [
            ("gimbals.alpha_deg", self.alpha_deg),
            ("gimbals.beta_deg", self.beta_deg),
            ("gimbals.gamma_deg", self.gamma_deg),
        ];
        let mut ranges = [None; 3];
        for (range, (key, value)) in ranges.iter_mut().zip(axes) {
            let Some([low, high]) = value else { continue };
            for v in [low, high] {
                in_range(key, v, -36_000.0, 36_000.0, "angles from -36000 to 36000")?;
            }
            if low > high {
                return Err(Error::input("the range is empty")
                    .with_key(key)
                    .with_value(format!("[{low}, {high}]"))
                    .with_allowed("[low, high] with low <= high"));
            }
            *range = Some(GimbalRange {
                low_rad: Angle::from_deg(low).rad(),
                high_rad: Angle::from_deg(high).rad(),
            });
        }
        let step_rad = self
            .step_deg
            .map(|step| in_range("gimbals.step_deg", step, 0.1, 180.0, "0.1 to 180"))
            .transpose()?
            .map(|step| Angle::from_deg(step).rad());
        Ok(Gimbals { ranges, step_rad })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::assert_refused_by_key;

    #[test]
    fn default_is_the_papers_section_3() {
        let p = PlatformConfig::default().check().unwrap();
        assert!((p.noise_g() - 1e-5).abs() < 1e-20);
        // q = (0.01 arcsec/s)² · 10 s.
        let q_arcsec = p.drift_psd_rad2_per_s() * crate::units::ARCSEC_PER_RAD.powi(2);
        assert!((q_arcsec - 1e-3).abs() < 1e-15);
        assert!((Angle::from_rad(p.prior_misalignment_rad().x).arcsec() - 360.0).abs() < 1e-9);
    }

    #[test]
    fn a_start_out_of_reach_is_refused() {
        let mut config = PlatformConfig::default();
        config.motion.start_deg = Some([0.0, 61.0, 0.0]);
        assert!(config.check().is_ok());
        config.gimbals.beta_deg = Some([-60.0, 60.0]);
        let error = config.check().unwrap_err();
        assert_eq!(error.key(), Some("motion.start_deg"));
        config.motion.start_deg = Some([0.0, 50.0, f64::NAN]);
        assert_eq!(config.check().unwrap_err().key(), Some("motion.start_deg"));
        config.motion.start_deg = Some([0.0, 50.0, 15.0]);
        assert!(config.check().is_ok());
        config.gimbals.step_deg = Some(10.0);
        let error = config.check().unwrap_err();
        assert!(
            error
                .allowed()
                .unwrap_or_default()
                .contains("step_deg = 10")
        );
    }

    #[test]
    fn angle_random_walk_is_another_name_for_the_same_noise() {
        let mut config = PlatformConfig::default();
        let drift = config.check().unwrap().drift_psd_rad2_per_s();
        // σ_d √period as an angle per √s, times √3600 per √h, in degrees.
        let walk = 0.01 / 3600.0 * 10.0_f64.sqrt() * 60.0;
        config.gyro.angle_random_walk_deg_per_sqrt_h = Some(walk);
        let same = config.check().unwrap().drift_psd_rad2_per_s();
        assert!((same / drift - 1.0).abs() < 1e-12);
        config.gyro.random_drift_deg_per_h = Some(0.01);
        assert!(config.check().unwrap_err().is_input());
    }

    #[test]
    fn each_value_out_of_range_is_refused_by_name() {
        type Spoil = fn(&mut PlatformConfig);
        let table: [(&str, Spoil); 12] = [
            ("site.latitude_deg", |c| c.site.latitude_deg = 95.0),
            ("site.latitude_deg", |c| c.site.latitude_deg = f64::NAN),
            ("accelerometer.noise_g", |c| {
                c.accelerometer.noise_g = Some(0.0);
            }),
            ("gyro.random_drift_deg_per_h", |c| {
                c.gyro.random_drift_deg_per_h = Some(-1.0);
            }),
            ("filter.period_s", |c| c.filter.period_s = 0.0),
            ("filter.period_s", |c| c.filter.period_s = f64::INFINITY),
            ("prior.misalignment_deg", |c| {
                c.prior.misalignment_deg = AxisValue::PerAxis([0.1, f64::NAN, 0.1]);
            }),
            ("gimbals.beta_deg", |c| {
                c.gimbals.beta_deg = Some([60.0, -60.0])
            }),
            ("gimbals.step_deg", |c| c.gimbals.step_deg = Some(0.0)),
            ("motion.slew_rate_deg_per_s", |c| {
                c.motion.slew_rate_deg_per_s = Some(0.0.into());
            }),
            ("motion.settle_s", |c| c.motion.settle_s = -1.0),
            ("motion.min_dwell_s", |c| c.motion.min_dwell_s = f64::NAN),
        ];
        for (key, spoil) in table {
            let mut config = PlatformConfig::default();
            spoil(&mut config);
            let error = config.check().unwrap_err();
            assert_refused_by_key(&error, key);
        }
    }
}
