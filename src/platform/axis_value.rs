//! Prior values that may be given as one number for all axes, or axis by axis.

use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Serialize};
use std::fmt;

use super::in_range;
use crate::error::Result;

/// The three ways in which a file's number can arrive at a serde visitor.
macro_rules! number_visits {
    ($wrap:expr) => {
        fn visit_f64<E: serde::de::Error>(self, v: f64) -> std::result::Result<Self::Value, E> {
            Ok(($wrap)(v))
        }
        fn visit_i64<E: serde::de::Error>(self, v: i64) -> std::result::Result<Self::Value, E> {
            Ok(($wrap)(v as f64))
        }
        fn visit_u64<E: serde::de::Error>(self, v: u64) -> std::result::Result<Self::Value, E> {
            Ok(($wrap)(v as f64))
        }
    };
}

/// A number for all three axes, or `[x, y, z]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
pub enum AxisValue {
    /// The same for x, y, z.
    All(f64),
    /// One number per axis.
    PerAxis([f64; 3]),
}

impl From<f64> for AxisValue {
    fn from(value: f64) -> Self {
        Self::All(value)
    }
}

impl AxisValue {
    /// The same for values that are each changed.
    pub fn map(self, change: impl Fn(f64) -> f64) -> Self {
        match self {
            Self::All(v) => Self::All(change(v)),
            Self::PerAxis(v) => Self::PerAxis(v.map(change)),
        }
    }

    /// As `[x, y, z]`.
    pub const fn to_array(self) -> [f64; 3] {
        match self {
            Self::All(v) => [v; 3],
            Self::PerAxis(v) => v,
        }
    }

    pub(super) fn check(self, key: &str, high: f64, allowed: &str) -> Result<[f64; 3]> {
        let values = self.to_array();
        for v in values {
            in_range(key, v, 0.0, high, allowed)?;
        }
        Ok(values)
    }
}

impl<'de> Deserialize<'de> for AxisValue {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct AxisVisitor;
        impl<'de> Visitor<'de> for AxisVisitor {
            type Value = AxisValue;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "one number for all axes, or a list of three numbers")
            }
            number_visits!(AxisValue::All);
            fn visit_seq<A: SeqAccess<'de>>(
                self,
                seq: A,
            ) -> std::result::Result<AxisValue, A::Error> {
                <[f64; 3]>::deserialize(SeqAccessDeserializer::new(seq))
                    .map(AxisValue::PerAxis)
                    .map_err(|_| {
                        A::Error::custom(
                            "expected one number for all axes, or a list of three numbers",
                        )
                    })
            }
        }
        deserializer.deserialize_any(AxisVisitor)
    }
}

/// Prior of the g-sensitive drifts: one value for all, or by the gyro's axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(untagged)]
pub enum GSensitivePrior {
    /// The same for D_I, D_O and D_S.
    All(AxisValue),
    /// Separately for each axis of the gyros.
    PerAxis {
        /// D_I of the X, Y, Z gyro.
        input: AxisValue,
        /// D_O of the X, Y, Z gyro.
        output: AxisValue,
        /// D_S of the X, Y, Z gyro.
        spin: AxisValue,
    },
}

/// The table form on its own, so that a wrong key inside it is reported as such.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    input: AxisValue,
    output: AxisValue,
    spin: AxisValue,
}

impl<'de> Deserialize<'de> for GSensitivePrior {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        struct PriorVisitor;
        impl<'de> Visitor<'de> for PriorVisitor {
            type Value = GSensitivePrior;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(
                    f,
                    "a number, [x, y, z], or a table {{ input, output, spin }}"
                )
            }
            number_visits!(|v| GSensitivePrior::All(AxisValue::All(v)));
            fn visit_seq<A: SeqAccess<'de>>(
                self,
                seq: A,
            ) -> std::result::Result<Self::Value, A::Error> {
                AxisValue::deserialize(SeqAccessDeserializer::new(seq)).map(GSensitivePrior::All)
            }
            fn visit_map<A: MapAccess<'de>>(
                self,
                map: A,
            ) -> std::result::Result<Self::Value, A::Error> {
                let t = Table::deserialize(MapAccessDeserializer::new(map))?;
                Ok(GSensitivePrior::PerAxis {
                    input: t.input,
                    output: t.output,
                    spin: t.spin,
                })
            }
        }
        deserializer.deserialize_any(PriorVisitor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_triples_and_tables_are_read() {
        let one: AxisValue = serde_json::from_str("3").unwrap();
        assert_eq!(one.to_array(), [3.0; 3]);
        let three: AxisValue = serde_json::from_str("[1, 2.5, 3]").unwrap();
        assert_eq!(three.to_array(), [1.0, 2.5, 3.0]);
        let all: GSensitivePrior = serde_json::from_str("8.0").unwrap();
        assert_eq!(all, GSensitivePrior::All(AxisValue::All(8.0)));
        let table: GSensitivePrior =
            serde_json::from_str(r#"{"input": 1, "output": [1, 2, 3], "spin": 4}"#).unwrap();
        assert!(matches!(table, GSensitivePrior::PerAxis { .. }));
    }

    #[test]
    fn what_is_expected_is_said() {
        let error = serde_json::from_str::<AxisValue>("\"big\"").unwrap_err();
        assert!(error.to_string().contains("one number for all axes"));
        let error = serde_json::from_str::<AxisValue>("[1, 2]").unwrap_err();
        assert!(error.to_string().contains("three numbers"));
        let error = serde_json::from_str::<GSensitivePrior>(r#"{"inputs": 1}"#).unwrap_err();
        assert!(error.to_string().contains("unknown field `inputs`"));
    }
}
