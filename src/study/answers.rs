//! What a study answers about one schedule, and about all of them.

use crate::certificate::MinimumTime;
use crate::drift::COEFFICIENTS;
use crate::evaluate::Evaluation;
use crate::results::{AnalysisDocument, BoundDocument, EvaluationDocument};

/// What is known of a schedule before the test.
#[derive(Debug, Clone, PartialEq)]
pub struct EvaluationResult {
    document: EvaluationDocument,
    covariance_deg2_per_h2: [[f64; COEFFICIENTS]; COEFFICIENTS],
}

impl EvaluationResult {
    pub(super) fn new(evaluation: &Evaluation, document: EvaluationDocument) -> Self {
        let p = &evaluation.end.coefficients;
        Self {
            document,
            covariance_deg2_per_h2: std::array::from_fn(|i| std::array::from_fn(|j| p[(i, j)])),
        }
    }

    /// The evaluation as data, in the form of `evaluate --json`.
    pub fn document(&self) -> &EvaluationDocument {
        &self.document
    }

    /// P_D at the end of the test in the order D_FX … D_SZ, (°/h)², g-sensitive coefficients per g.
    pub fn covariance_deg2_per_h2(&self) -> &[[f64; COEFFICIENTS]; COEFFICIENTS] {
        &self.covariance_deg2_per_h2
    }

    /// 1σ of each coefficient at the end of the test in the order D_FX … D_SZ, °/h (per g).
    pub fn sigma_deg_per_h(&self) -> [f64; COEFFICIENTS] {
        std::array::from_fn(|i| self.covariance_deg2_per_h2[i][i].sqrt())
    }

    /// √(mean of the coefficient variances), °/h.
    pub fn rms_sigma_deg_per_h(&self) -> f64 {
        self.document.rms_sigma_deg_per_h
    }

    /// The report as one HTML page that needs nothing else.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when the page cannot be made.
    #[cfg(feature = "report")]
    pub fn report_html(&self) -> crate::Result<String> {
        crate::report::html::evaluation(&self.document)
    }
}

/// What a schedule makes observable, and why.
#[derive(Debug, Clone, PartialEq)]
pub struct AnalysisResult {
    document: AnalysisDocument,
}

impl AnalysisResult {
    pub(super) fn new(document: AnalysisDocument) -> Self {
        Self { document }
    }

    /// The analysis as data, in the form of `analyze --json`.
    pub fn document(&self) -> &AnalysisDocument {
        &self.document
    }
}

/// What no schedule can beat.
#[derive(Debug, Clone, PartialEq)]
pub struct BoundResult {
    document: BoundDocument,
    specification_is_hopeless: bool,
}

impl BoundResult {
    pub(super) fn new(
        document: BoundDocument,
        minimum: Option<MinimumTime>,
        total_time_s: f64,
    ) -> Self {
        let specification_is_hopeless = match minimum {
            Some(MinimumTime::MoreThan(s)) => s >= total_time_s,
            Some(MinimumTime::NotWithin(_)) => true,
            Some(MinimumTime::Nothing | MinimumTime::OfOthers | MinimumTime::Unknown) | None => {
                false
            }
        };
        Self {
            document,
            specification_is_hopeless,
        }
    }

    /// The bound as data, in the form of `bound --json`.
    pub fn document(&self) -> &BoundDocument {
        &self.document
    }

    /// Whether it is proven that no schedule of the total time meets the specification.
    pub fn specification_is_hopeless(&self) -> bool {
        self.specification_is_hopeless
    }
}
