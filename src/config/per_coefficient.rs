//! Tables with one number per drift coefficient, and per other parameter of the error model.

use std::collections::BTreeMap;
use std::fmt;

use serde::de::{Deserialize, Deserializer, Error as _, MapAccess, Visitor};
use serde::ser::{Serialize, SerializeMap, Serializer};

use crate::drift::{CoefficientVector, DriftCoefficient};
use crate::error::{Error, Result};
use crate::model::{ErrorModel, Role, optional_parameter};
use crate::platform::in_range;

/// One number for all drift coefficients, or for single ones, or for other parameters of the error
/// model: the tables `[objective.spec]` (each in its own unit), `[objective.spec_deg_per_h]` (drift
/// coefficients only, °/h, per g) and `[objective.weights]`.
///
/// ```
/// use scheme_opt::internals::drift::DriftCoefficient;
/// use scheme_opt::internals::config::PerCoefficient;
/// let spec = PerCoefficient {
///     default: Some(0.005),
///     coefficients: [(DriftCoefficient::IX, 0.01)].into(),
///     others: Default::default(),
/// };
/// assert_eq!(spec.of(DriftCoefficient::IX), Some(0.01));
/// assert_eq!(spec.of(DriftCoefficient::SZ), Some(0.005));
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PerCoefficient {
    /// For every drift coefficient that is not named.
    pub default: Option<f64>,
    /// For single drift coefficients.
    pub coefficients: BTreeMap<DriftCoefficient, f64>,
    /// For other parameters, by name: `T_XY`, `K_0Z` …
    pub others: BTreeMap<&'static str, f64>,
}

/// How a file has it, for the JSON Schema: `default` and the names of coefficients.
#[cfg(feature = "schema")]
pub(super) type Named = BTreeMap<String, f64>;

impl PerCoefficient {
    /// One number for all coefficients.
    pub const fn all(value: f64) -> Self {
        Self {
            default: Some(value),
            coefficients: BTreeMap::new(),
            others: BTreeMap::new(),
        }
    }

    /// True when no number is given.
    pub fn is_empty(&self) -> bool {
        self.default.is_none() && self.coefficients.is_empty() && self.others.is_empty()
    }

    /// The number of a coefficient, if it has one.
    pub fn of(&self, coefficient: DriftCoefficient) -> Option<f64> {
        self.coefficients
            .get(&coefficient)
            .copied()
            .or(self.default)
    }

    /// Every value given, with its name.
    fn given(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        let default = self.default.map(|value| ("default", value));
        let named = self
            .coefficients
            .iter()
            .map(|(c, value)| (c.name(), *value));
        let others = self.others.iter().map(|(name, value)| (*name, *value));
        default.into_iter().chain(named).chain(others)
    }

    /// One value per coefficient, `otherwise` where there is none.
    fn filled(&self, otherwise: f64) -> CoefficientVector {
        let mut values = CoefficientVector::repeat(otherwise);
        for c in DriftCoefficient::ALL {
            if let Some(value) = self.of(c) {
                values[c.index()] = value;
            }
        }
        values
    }

    /// One value per coefficient, infinite where there is none; `None` when there is none at all.
    pub(crate) fn as_vector(&self) -> Option<CoefficientVector> {
        (!self.is_empty()).then(|| self.filled(f64::INFINITY))
    }

    /// The numbers of other parameters, by their places in `errors`.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] for one that the platform does not have, or that its filter does not
    /// estimate.
    pub(super) fn of_others(&self, table: &str, errors: &ErrorModel) -> Result<Vec<(usize, f64)>> {
        let place = |(name, value): (&&'static str, &f64)| {
            let refused = |message: &str, allowed: String| {
                Err(Error::input(message)
                    .with_key(format!("{table}.{name}"))
                    .with_value(value)
                    .with_allowed(allowed))
            };
            let all = errors.parameters();
            match all.iter().position(|p| p.name == *name) {
                None => {
                    let group = optional_parameter(name).map_or("", |(group, _)| group.key);
                    refused(
                        "the platform has no such parameter",
                        format!("left out, or {name} with a prior sigma: errors.{group}"),
                    )
                }
                Some(at) if all[at].role == Role::Considered => refused(
                    "the filter does not estimate this parameter, so that no test changes its sigma",
                    format!("left out, or {name} in [errors] instead of [errors.considered]"),
                ),
                Some(at) => Ok((at, *value)),
            }
        };
        self.others.iter().map(place).collect()
    }

    /// As specifications: one per coefficient, °/h (per g), infinite where there is none;
    /// `None` when there is none at all. `table` is what they are given in.
    pub(super) fn check_spec(&self, table: &str) -> Result<Option<CoefficientVector>> {
        for (name, value) in self.given() {
            let key = format!("{table}.{name}");
            in_range(
                &key,
                value,
                f64::MIN_POSITIVE,
                1e12,
                "greater than 0, to 1e12",
            )?;
        }
        Ok(self.as_vector())
    }

    /// As weights: one per coefficient, 1 where there is none; not all zero.
    pub(super) fn check_weights(&self) -> Result<CoefficientVector> {
        for (name, value) in self.given() {
            let key = format!("objective.weights.{name}");
            in_range(&key, value, 0.0, 1e6, "0 to 1e6")?;
        }
        let weights = self.filled(1.0);
        if weights.max() == 0.0 && self.others.values().all(|w| *w == 0.0) {
            return Err(Error::input("nothing is left to optimise")
                .with_key("objective.weights")
                .with_value("every weight 0")
                .with_allowed("at least one weight above 0"));
        }
        Ok(weights)
    }
}

impl Serialize for PerCoefficient {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        if let Some(value) = self.default {
            map.serialize_entry("default", &value)?;
        }
        for (coefficient, value) in &self.coefficients {
            map.serialize_entry(coefficient.name(), value)?;
        }
        for (name, value) in &self.others {
            map.serialize_entry(name, value)?;
        }
        map.end()
    }
}

impl<'de> Deserialize<'de> for PerCoefficient {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct TableVisitor;
        impl<'de> Visitor<'de> for TableVisitor {
            type Value = PerCoefficient;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "a table such as {{ default = 0.005, D_IX = 0.01 }}")
            }
            fn visit_map<A: MapAccess<'de>>(
                self,
                mut map: A,
            ) -> std::result::Result<Self::Value, A::Error> {
                let mut spec = PerCoefficient::default();
                while let Some(name) = map.next_key::<String>()? {
                    let earlier = if name == "default" {
                        spec.default.replace(map.next_value()?)
                    } else if let Some(coefficient) = DriftCoefficient::from_name(&name) {
                        spec.coefficients.insert(coefficient, map.next_value()?)
                    } else if let Some((group, at)) = optional_parameter(&name) {
                        spec.others.insert(group.names[at], map.next_value()?)
                    } else {
                        return Err(A::Error::custom(format!(
                            "`{name}` is no parameter of the error model"
                        )));
                    };
                    if earlier.is_some() {
                        return Err(A::Error::custom(format!("`{name}` is given twice")));
                    }
                }
                Ok(spec)
            }
        }
        deserializer.deserialize_map(TableVisitor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn specifications_read_back_and_fill_up() {
        let text = r#"{"D_SZ": 1, "default": 0.5}"#;
        let spec: PerCoefficient = serde_json::from_str(text).unwrap();
        let written = serde_json::to_string(&spec).unwrap();
        assert_eq!(
            serde_json::from_str::<PerCoefficient>(&written).unwrap(),
            spec
        );
        let values = spec.check_spec("objective.spec").unwrap().unwrap();
        assert_eq!(values[DriftCoefficient::SZ.index()], 1.0);
        assert_eq!(values[DriftCoefficient::FX.index()], 0.5);

        let one: PerCoefficient = serde_json::from_str(r#"{"D_FX": 2}"#).unwrap();
        let values = one.check_spec("objective.spec").unwrap().unwrap();
        assert_eq!(values[0], 2.0);
        assert!(values.iter().skip(1).all(|v| *v == f64::INFINITY));

        assert_eq!(
            PerCoefficient::default().check_spec("objective.spec"),
            Ok(None)
        );
        let other: PerCoefficient = serde_json::from_str(r#"{"T_XY": 2}"#).unwrap();
        assert_eq!(other.others["T_XY"], 2.0);
        assert_eq!(serde_json::to_string(&other).unwrap(), r#"{"T_XY":2.0}"#);
        for bad in [r#"{"D_XX": 1}"#, r#"{"D_FX": 1, "D_FX": 2}"#, "3"] {
            assert!(serde_json::from_str::<PerCoefficient>(bad).is_err());
        }
    }

    #[test]
    fn weights_are_one_unless_given_and_not_all_zero() {
        let mut weights = PerCoefficient::default();
        assert_eq!(weights.check_weights(), Ok(CoefficientVector::repeat(1.0)));
        weights.coefficients.insert(DriftCoefficient::IX, 4.0);
        let values = weights.check_weights().unwrap();
        assert_eq!(
            (values[DriftCoefficient::IX.index()], values[0]),
            (4.0, 1.0)
        );
        weights.coefficients.insert(DriftCoefficient::IX, -1.0);
        let error = weights.check_weights().unwrap_err();
        assert_eq!(error.key(), Some("objective.weights.D_IX"));
        assert!(
            PerCoefficient::all(0.0)
                .check_weights()
                .unwrap_err()
                .is_input()
        );
    }
}
