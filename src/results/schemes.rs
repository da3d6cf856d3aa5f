//! The list of the built-in schemes.

use serde::{Deserialize, Serialize};

use super::common::TOOL_VERSION;
use crate::schedule::standard::StandardScheme;

/// Name and major version of the [`SchemeListDocument`].
pub const SCHEMES_SCHEMA: &str = "scheme-opt/standard/1";

/// The built-in schemes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SchemeListDocument {
    /// [`SCHEMES_SCHEMA`].
    pub schema: String,
    /// Version of the program that wrote it.
    pub tool_version: String,
    /// The schemes.
    pub schemes: Vec<SchemeRecord>,
}

/// A built-in scheme.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SchemeRecord {
    /// Its name.
    pub name: String,
    /// How many positions it has.
    pub positions: usize,
    /// What it is and where it comes from.
    pub description: String,
}

impl Default for SchemeListDocument {
    fn default() -> Self {
        Self::new()
    }
}

impl SchemeListDocument {
    /// All built-in schemes.
    pub fn new() -> Self {
        let record = |scheme: StandardScheme| SchemeRecord {
            name: scheme.name().to_owned(),
            positions: scheme.positions().len(),
            description: scheme.description().to_owned(),
        };
        Self {
            schema: SCHEMES_SCHEMA.to_owned(),
            tool_version: TOOL_VERSION.to_owned(),
            schemes: StandardScheme::ALL.into_iter().map(record).collect(),
        }
    }
}
