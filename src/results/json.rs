//! How documents are written.

use serde::Serialize;

use super::analysis::AnalysisDocument;
use super::batch::BatchDocument;
use super::bound::BoundDocument;
use super::comparison::ComparisonDocument;
use super::evaluation::EvaluationDocument;
use super::layout::Layout;
use super::result::ResultDocument;
use super::schemes::SchemeListDocument;
use super::simulation::SimulationDocument;
use crate::error::{Error, Result};

pub(super) fn to_json(document: &impl Serialize) -> Result<String> {
    let failed = |e: Box<dyn std::error::Error + Send + Sync>| {
        Error::numerical(format!("the document cannot be written as JSON: {e}")).with_source(e)
    };
    let mut bytes = Vec::new();
    let mut serializer = serde_json::Serializer::with_formatter(&mut bytes, Layout::default());
    document
        .serialize(&mut serializer)
        .map_err(|e| failed(e.into()))?;
    bytes.push(b'\n');
    String::from_utf8(bytes).map_err(|e| failed(e.into()))
}

/// Gives documents their text.
macro_rules! written_as_json {
    ($($document:ty),+ $(,)?) => {
        $(
            impl $document {
                /// The document as JSON text.
                ///
                /// # Errors
                ///
                /// [`Error::is_numerical`] when it cannot be written as JSON.
                pub fn to_json(&self) -> Result<String> {
                    to_json(self)
                }
            }
        )+
    };
}

written_as_json!(
    AnalysisDocument,
    BatchDocument,
    BoundDocument,
    ComparisonDocument,
    EvaluationDocument,
    ResultDocument,
    SchemeListDocument,
    SimulationDocument,
);
