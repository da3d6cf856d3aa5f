//! Torquing-scheme optimisation.
pub mod attitude;
pub mod covariance;
pub mod criterion;
pub mod drift;
pub mod dynamics;
pub mod error;
pub mod evaluate;
pub mod motion;
pub mod observability;
pub mod platform;
pub mod schedule;
pub mod search;
pub mod units;

pub use error::{Error, Result};
