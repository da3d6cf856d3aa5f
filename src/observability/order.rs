//! The observability order.

use serde::{Deserialize, Serialize};

/// Observability order: the highest derivative of the measurement that a solution needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(into = "u8", try_from = "u8")]
pub enum Order {
    /// From the measurement itself.
    Zero,
    /// Needs its first derivative.
    First,
    /// Needs its second derivative.
    Second,
}

impl Order {
    /// As a number: 0, 1, 2.
    pub const fn number(self) -> u8 {
        match self {
            Self::Zero => 0,
            Self::First => 1,
            Self::Second => 2,
        }
    }
}

impl From<Order> for u8 {
    fn from(order: Order) -> Self {
        order.number()
    }
}

impl TryFrom<u8> for Order {
    type Error = String;

    fn try_from(number: u8) -> std::result::Result<Self, String> {
        [Self::Zero, Self::First, Self::Second]
            .into_iter()
            .find(|order| order.number() == number)
            .ok_or_else(|| format!("{number} is not an observability order: 0, 1 or 2"))
    }
}
