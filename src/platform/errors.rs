//! Errors of the platform beyond the twelve coefficients: the tables `[errors]`,
//! `[errors.considered]`, `[gyro] output_axis` and `[azimuth]`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{AxisValue, in_range};
use crate::error::{Error, Result};
use crate::model::{self, Mounting, Parameter, Role};
use crate::units::Angle;

/// Errors of one role, 1σ before the test: a number, or [x, y, z] by instrument. What is left out is
/// perfect.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct ErrorTable {
    /// Scale factor of the torquers T_XX, T_YY, T_ZZ, ppm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torquer_scale_factor_ppm: Option<AxisValue>,
    /// Lean of the gyros' input axes T_XY, T_XZ, T_YX, T_YZ, T_ZX, T_ZY, arcsec.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torquer_misalignment_arcsec: Option<AxisValue>,
    /// Drift by products of gravity D_II, D_SS, D_IO, D_IS, D_OS, °/h/g².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quadratic_drift_deg_per_h_per_g2: Option<AxisValue>,
    /// Of them D_OO, which at 1 g cannot be told from D_F, °/h/g².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quadratic_output_drift_deg_per_h_per_g2: Option<AxisValue>,
    /// Accelerometer bias K_0, µg.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accelerometer_bias_ug: Option<AxisValue>,
    /// Accelerometer scale factor K_1, ppm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accelerometer_scale_factor_ppm: Option<AxisValue>,
    /// Accelerometer misalignment M_YX, M_ZX, M_ZY, arcsec.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accelerometer_misalignment_arcsec: Option<AxisValue>,
    /// Second order K_2, µg/g².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accelerometer_second_order_ug_per_g2: Option<AxisValue>,
    /// Third order K_3, µg/g³.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accelerometer_third_order_ug_per_g3: Option<AxisValue>,
    /// Cross coupling K_IP, K_IO, µg/g².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub accelerometer_cross_coupling_ug_per_g2: Option<AxisValue>,
    /// Error of the local gravity that is used, G, µg.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub local_gravity_ug: Option<f64>,
    /// Single parameters by name, each in its own unit, whatever their group has.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub parameter: BTreeMap<String, f64>,
}

/// Errors of the platform beyond the twelve coefficients; the `[errors]` table.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct ErrorsConfig {
    /// Those that the filter estimates.
    #[serde(flatten)]
    pub estimated: ErrorTable,
    /// Those that the platform has and the filter does not know of.
    #[serde(skip_serializing_if = "ErrorTable::is_empty")]
    pub considered: ErrorTable,
}

/// An azimuth reference; the `[azimuth]` table.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
#[non_exhaustive]
pub struct AzimuthConfig {
    /// Noise of the measurement of ψ_y in each filter period, 1σ, arcsec, 1e-3 to 1e6; none: there is
    /// no such measurement.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise_arcsec: Option<f64>,
}

/// The output axis of a gyro.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
pub enum OutputAxis {
    /// `"+x"`, `"-x"` … `"-z"`.
    Named(String),
    /// A unit vector in the platform.
    Vector([f64; 3]),
}

/// The output axes of the gyros; none: that of the seed paper.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct OutputAxes {
    /// Of the X gyro.
    #[serde(rename = "X", skip_serializing_if = "Option::is_none")]
    pub x: Option<OutputAxis>,
    /// Of the Y gyro.
    #[serde(rename = "Y", skip_serializing_if = "Option::is_none")]
    pub y: Option<OutputAxis>,
    /// Of the Z gyro.
    #[serde(rename = "Z", skip_serializing_if = "Option::is_none")]
    pub z: Option<OutputAxis>,
}

impl OutputAxes {
    pub(super) fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    pub(super) fn check(&self) -> Result<Mounting> {
        let mut axes = Mounting::PAPER.axes().map(|[_, output, _]| output);
        for (gyro, (name, given)) in [("X", &self.x), ("Y", &self.y), ("Z", &self.z)]
            .into_iter()
            .enumerate()
        {
            if let Some(given) = given {
                axes[gyro] = given.check(&format!("gyro.output_axis.{name}"), gyro)?;
            }
        }
        Ok(Mounting::of_output_axes(axes))
    }
}

impl OutputAxis {
    /// The unit vector, perpendicular to the input axis of `gyro`.
    fn check(&self, key: &str, gyro: usize) -> Result<[f64; 3]> {
        let across = match gyro {
            0 => "\"+y\", \"-y\", \"+z\", \"-z\"",
            1 => "\"+x\", \"-x\", \"+z\", \"-z\"",
            _ => "\"+x\", \"-x\", \"+y\", \"-y\"",
        };
        let refused = |value: String| {
            Err(Error::input("no output axis of this gyro")
                .with_key(key)
                .with_value(value)
                .with_allowed(format!(
                    "{across}, or a unit vector [x, y, z] perpendicular to the input axis"
                )))
        };
        /// Written with six decimals a unit vector is one to this.
        const WRITTEN: f64 = 1e-6;
        match self {
            Self::Vector(v) => {
                let length = v.iter().fold(0.0, |sum, c| sum + c * c).sqrt();
                if (length - 1.0).abs() <= WRITTEN && v[gyro].abs() <= WRITTEN {
                    let mut across = *v;
                    across[gyro] = 0.0;
                    let length = across.iter().fold(0.0, |sum, c| sum + c * c).sqrt();
                    return Ok(across.map(|c| c / length));
                }
                refused(format!("{v:?}"))
            }
            Self::Named(name) => {
                let (sign, axis) = match name.split_at_checked(1) {
                    Some(("+", axis)) => (1.0, axis),
                    Some(("-", axis)) => (-1.0, axis),
                    _ => (1.0, name.as_str()),
                };
                let axis = ["x", "y", "z"].iter().position(|a| *a == axis);
                match axis.filter(|axis| *axis != gyro) {
                    Some(axis) => {
                        let mut vector = [0.0; 3];
                        vector[axis] = sign;
                        Ok(vector)
                    }
                    None => refused(format!("\"{name}\"")),
                }
            }
        }
    }
}

impl AzimuthConfig {
    pub(super) fn is_empty(&self) -> bool {
        self.noise_arcsec.is_none()
    }

    /// The noise, rad.
    pub(super) fn check(&self) -> Result<Option<f64>> {
        const KEY: &str = "azimuth.noise_arcsec";
        self.noise_arcsec
            .map(|noise| {
                let noise = in_range(
                    KEY,
                    noise,
                    1e-3,
                    1e6,
                    "0.001 to 1e6, or left out: no azimuth is measured",
                )?;
                Ok(Angle::from_arcsec(noise).rad())
            })
            .transpose()
    }
}

/// A σ that is given, and by which key.
type Given = BTreeMap<&'static str, (f64, String)>;

impl ErrorTable {
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// What is given for the group of this key.
    fn of_group(&self, key: &str) -> Option<AxisValue> {
        match key {
            "torquer_scale_factor_ppm" => self.torquer_scale_factor_ppm,
            "torquer_misalignment_arcsec" => self.torquer_misalignment_arcsec,
            "quadratic_drift_deg_per_h_per_g2" => self.quadratic_drift_deg_per_h_per_g2,
            "quadratic_output_drift_deg_per_h_per_g2" => {
                self.quadratic_output_drift_deg_per_h_per_g2
            }
            "accelerometer_bias_ug" => self.accelerometer_bias_ug,
            "accelerometer_scale_factor_ppm" => self.accelerometer_scale_factor_ppm,
            "accelerometer_misalignment_arcsec" => self.accelerometer_misalignment_arcsec,
            "accelerometer_second_order_ug_per_g2" => self.accelerometer_second_order_ug_per_g2,
            "accelerometer_third_order_ug_per_g3" => self.accelerometer_third_order_ug_per_g3,
            "accelerometer_cross_coupling_ug_per_g2" => self.accelerometer_cross_coupling_ug_per_g2,
            "local_gravity_ug" => self.local_gravity_ug.map(AxisValue::All),
            _ => None,
        }
    }

    /// The σ of every parameter that is given, by name.
    fn check(&self, table: &str) -> Result<Given> {
        const MOST: f64 = 1e9;
        const ALLOWED: &str = "0 to 1e9 (0: known exactly)";
        let mut given = Given::new();
        for group in model::optional_groups() {
            let key = format!("{table}.{}", group.key);
            if let Some(value) = self.of_group(group.key) {
                let sigma = value.check(&key, MOST, ALLOWED)?;
                for (index, name) in group.names.iter().enumerate() {
                    given.insert(name, (sigma[group.instrument(index)], key.clone()));
                }
            }
        }
        for (name, sigma) in &self.parameter {
            let key = format!("{table}.parameter.{name}");
            let Some((group, index)) = model::optional_parameter(name) else {
                return Err(Error::input("no such parameter")
                    .with_key(key)
                    .with_value(sigma)
                    .with_allowed("a name such as T_XY, K_0X, M_YX or D_IIX"));
            };
            let sigma = in_range(&key, *sigma, 0.0, MOST, ALLOWED)?;
            given.insert(group.names[index], (sigma, key));
        }
        Ok(given)
    }
}

impl ErrorsConfig {
    pub(super) fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// The parameters in the order of the families.
    pub(super) fn check(&self) -> Result<Vec<Parameter>> {
        let estimated = self.estimated.check("errors")?;
        let considered = self.considered.check("errors.considered")?;
        let twice = considered
            .iter()
            .find(|(name, _)| estimated.contains_key(*name));
        if let Some((name, (sigma, key))) = twice {
            let other = &estimated[name].1;
            return Err(Error::input(format!("{name} is given by {other} too"))
                .with_key(key)
                .with_value(sigma)
                .with_allowed(
                    "in [errors] what the filter estimates, in [errors.considered] what it ignores",
                ));
        }
        let mut parameters = Vec::new();
        for group in model::optional_groups() {
            for name in group.names {
                let known = estimated.get(name).map(|given| (given, Role::Estimated));
                let ignored = considered.get(name).map(|given| (given, Role::Considered));
                if let Some(((prior_sigma, _), role)) = known.or(ignored) {
                    parameters.push(Parameter {
                        name,
                        group: group.key,
                        unit: group.unit,
                        role,
                        prior_sigma: *prior_sigma,
                    });
                }
            }
        }
        Ok(parameters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::PlatformConfig;

    fn config(toml: &str) -> PlatformConfig {
        toml::from_str(toml).unwrap()
    }

    #[test]
    fn values_reach_their_parameters() {
        let p = config(
            "[errors]\ntorquer_misalignment_arcsec = [10, 20, 30]\n\
             accelerometer_misalignment_arcsec = [1, 2, 3]\nlocal_gravity_ug = 7\n\
             [errors.parameter]\nT_XZ = 11\nK_0Y = 5\n\
             [errors.considered]\nquadratic_drift_deg_per_h_per_g2 = [0.1, 0.2, 0.3]\n",
        )
        .check()
        .unwrap();
        let errors = p.errors();
        let found = |name: &str| {
            let mut all = errors.parameters().iter();
            all.find(|p| p.name == name)
                .map(|p| (p.prior_sigma, p.role))
        };
        use Role::{Considered, Estimated};
        for (name, sigma, role) in [
            ("T_XY", 10.0, Estimated),
            ("T_XZ", 11.0, Estimated),
            ("T_ZY", 30.0, Estimated),
            ("M_ZX", 2.0, Estimated),
            ("G", 7.0, Estimated),
            ("K_0Y", 5.0, Estimated),
            ("D_OSZ", 0.3, Considered),
            ("D_IIX", 0.1, Considered),
        ] {
            assert_eq!(found(name), Some((sigma, role)), "{name}");
        }
        assert_eq!((found("K_0X"), found("D_OOX")), (None, None));
        assert_eq!(errors.estimated(), 12 + 6 + 3 + 1 + 1);
        let roles = errors.parameters().iter().map(|p| p.role);
        assert!(roles.is_sorted_by_key(|role| role == Role::Considered));
    }

    #[test]
    fn bad_values_are_refused_by_key() {
        for (toml, key, allowed) in [
            (
                "[errors]\naccelerometer_bias_ug = -1",
                "errors.accelerometer_bias_ug",
                "0 to 1e9",
            ),
            (
                "[errors]\nlocal_gravity_ug = 1e10",
                "errors.local_gravity_ug",
                "0 to 1e9",
            ),
            (
                "[errors]\ntorquer_scale_factor_ppm = [1, nan, 1]",
                "errors.torquer_scale_factor_ppm",
                "0 to 1e9",
            ),
            (
                "[errors.parameter]\nT_XX = inf",
                "errors.parameter.T_XX",
                "0 to 1e9",
            ),
            (
                "[errors.parameter]\nT_XW = 1",
                "errors.parameter.T_XW",
                "a name such as",
            ),
            (
                "[errors.considered]\naccelerometer_bias_ug = -1",
                "errors.considered.accelerometer_bias_ug",
                "0 to 1e9",
            ),
            (
                "[errors]\naccelerometer_bias_ug = 1\n[errors.considered]\naccelerometer_bias_ug = 2",
                "errors.considered.accelerometer_bias_ug",
                "in [errors]",
            ),
            (
                "[errors.parameter]\nK_0X = 1\n[errors.considered]\naccelerometer_bias_ug = 2",
                "errors.considered.accelerometer_bias_ug",
                "in [errors]",
            ),
            (
                "[errors.parameter]\nK_0X = 1\n[errors.considered.parameter]\nK_0X = 2",
                "errors.considered.parameter.K_0X",
                "in [errors]",
            ),
            (
                "[azimuth]\nnoise_arcsec = 0",
                "azimuth.noise_arcsec",
                "0.001 to 1e6",
            ),
            (
                "[gyro.output_axis]\nX = \"+x\"",
                "gyro.output_axis.X",
                "\"+y\"",
            ),
            (
                "[gyro.output_axis]\nY = \"down\"",
                "gyro.output_axis.Y",
                "\"+x\"",
            ),
            (
                "[gyro.output_axis]\nZ = \"\"",
                "gyro.output_axis.Z",
                "\"+x\"",
            ),
            (
                "[gyro.output_axis]\nZ = [1, 1, 0]",
                "gyro.output_axis.Z",
                "a unit vector",
            ),
            (
                "[gyro.output_axis]\nX = [0.6, 0.8, 0]",
                "gyro.output_axis.X",
                "a unit vector",
            ),
            (
                "[gyro.output_axis]\nX = [nan, 0, 0]",
                "gyro.output_axis.X",
                "a unit vector",
            ),
        ] {
            let error = config(toml).check().unwrap_err();
            assert!(error.is_input(), "{toml}");
            assert_eq!(error.key(), Some(key), "{toml}");
            assert!(error.value().is_some(), "{toml}");
            let found = error.allowed().unwrap_or_default();
            assert!(found.contains(allowed), "{toml}: {found}");
        }
    }

    #[test]
    fn output_axes_are_named_or_given_as_vectors() {
        let named = config("[gyro.output_axis]\nX = \"+y\"\nY = \"x\"\nZ = \"-y\"\n");
        let given = config("[gyro.output_axis]\nX = [0, 1, 0]\nY = [1, 0, 0]\nZ = [0, -1, 0]\n");
        let [named, given] = [named, given].map(|c| c.check().unwrap());
        assert_eq!(named.errors().mounting(), given.errors().mounting());
        assert!(!named.errors().is_of_the_paper());
        let paper = config("[gyro.output_axis]\nX = \"-z\"\nZ = \"+x\"\n");
        assert!(paper.check().unwrap().errors().is_of_the_paper());
    }

    #[test]
    fn without_the_tables_nothing_is_written() {
        let written = serde_json::to_string(&PlatformConfig::default()).unwrap();
        for key in ["errors", "azimuth", "output_axis"] {
            assert!(!written.contains(key), "{written}");
        }
    }
}
