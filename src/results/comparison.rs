//! The document of a comparison.

use serde::{Deserialize, Serialize};

use super::common::{Inputs, TOOL_VERSION, finite, warnings};
use super::evaluation::criterion_unit;
use crate::compare::{ComparedSchedule, PositionOrder, Proof, Terms};
use crate::config::{StudyConfig, TestConfig};
use crate::drift::DriftCoefficient;
use crate::evaluate::{Evaluation, Objective};
use crate::schedule::Schedule;
use crate::schedule::file::ScheduleDocument;
use crate::suspicion::{self, WarningRecord};

/// Name and major version of the [`ComparisonDocument`].
pub const COMPARISON_SCHEMA: &str = "scheme-opt/comparison/1";

/// Schedules side by side.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ComparisonDocument {
    /// [`COMPARISON_SCHEMA`].
    pub schema: String,
    /// Version of the program that wrote it.
    pub tool_version: String,
    /// Whose test it is; left out where nobody said.
    #[serde(default, skip_serializing_if = "TestConfig::is_empty")]
    pub test: TestConfig,
    /// Total time of every schedule, moves and settles included, s, but for less than a filter
    /// period; null: given schedules have their own.
    pub total_time_s: Option<f64>,
    /// `a`, `d`, `e` or `max-ratio`.
    pub criterion_name: String,
    /// `deg/h`, or `1` for `max-ratio`.
    pub criterion_unit: String,
    /// The schedules. Ratios are to the first.
    pub schedules: Vec<ComparedRecord>,
    /// Those that cannot be run on this platform in this time.
    pub skipped: Vec<SkippedContender>,
    /// The study as resolved.
    pub inputs: StudyConfig,
    /// Keys of `inputs` that nobody gave.
    pub defaulted: Vec<String>,
    /// Values of the inputs that are allowed but hard to believe; left out when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<WarningRecord>,
}

/// What one schedule reaches.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ComparedRecord {
    /// File, or `standard:` and the name of a built-in scheme.
    pub name: String,
    /// In which order its positions are visited.
    pub order: PositionOrder,
    /// Whether the order is proven to be the best; absent for an order as given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub order_proof: Option<Proof>,
    /// Steps made towards that proof: positions added to beginnings of orders.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub order_steps: Option<u64>,
    /// How many positions it has.
    pub positions: usize,
    /// Duration of the test, moves and settles included, s.
    pub total_time_s: f64,
    /// Of which moves and settles, s.
    pub overhead_s: f64,
    /// √(mean of the coefficient variances), °/h.
    pub rms_sigma_deg_per_h: f64,
    /// The same divided by that of the first schedule; null when the latter is zero.
    pub ratio: Option<f64>,
    /// Largest σ of a coefficient, °/h.
    pub max_sigma_deg_per_h: f64,
    /// σ of the worst combination of coefficients, √λ_max(P_D), °/h.
    pub max_eig_sigma_deg_per_h: f64,
    /// ln det P_D, P_D in (°/h)²; null when a coefficient is known exactly.
    pub logdet_deg_per_h: Option<f64>,
    /// Value of the criterion, in `criterion_unit`.
    pub criterion: f64,
    /// The same divided by that of the first schedule.
    pub criterion_ratio: Option<f64>,
    /// Smallest separability of a coefficient, 0 to 1.
    pub least_separability: f64,
    /// When every coefficient with a specification was within it for good, s; where other parameters
    /// have one too, the end of the test; absent: never, or no specification.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_to_spec_s: Option<f64>,
    /// The drift coefficients, D_FX to D_SZ.
    pub coefficients: Vec<ComparedCoefficient>,
    /// The schedule as it was run.
    pub schedule: ScheduleDocument,
}

/// What one schedule tells about one coefficient. g-sensitive coefficients: per g.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ComparedCoefficient {
    /// The coefficient.
    pub name: DriftCoefficient,
    /// 1σ after the test, °/h.
    pub sigma_deg_per_h: f64,
    /// The same divided by that of the first schedule; null when the latter is zero.
    pub ratio: Option<f64>,
    /// Highest derivative of the measurement that a solution needs; null: not observable.
    pub observability_order: Option<u8>,
    /// Separability by all channels, 0 to 1.
    pub separability: f64,
    /// When σ was within the specification for good, s; absent: never, or no specification.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_to_spec_s: Option<f64>,
}

/// A schedule that could not be compared.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SkippedContender {
    /// File, or `standard:` and the name of a built-in scheme.
    pub name: String,
    /// In which order its positions are visited.
    pub order: PositionOrder,
    /// Why it cannot be run.
    pub reason: String,
}

impl ComparisonDocument {
    /// The document of what was `compared` on these `terms`.
    pub fn new(
        compared: &[ComparedSchedule],
        terms: &Terms,
        objective: &Objective,
        inputs: &Inputs,
    ) -> Self {
        let mut found = Vec::new();
        let mut skipped = Vec::new();
        for c in compared {
            match &c.outcome {
                Ok((schedule, evaluation)) => found.push((c, schedule, evaluation)),
                Err(error) => skipped.push(SkippedContender {
                    name: c.name.clone(),
                    order: c.order,
                    reason: error.to_string(),
                }),
            }
        }
        let first = found.first().map(|(_, _, evaluation)| *evaluation);
        Self {
            schema: COMPARISON_SCHEMA.to_owned(),
            tool_version: TOOL_VERSION.to_owned(),
            test: inputs.config.test.clone(),
            total_time_s: terms.scale.then_some(terms.total_time_s),
            criterion_name: objective.criterion.name().to_owned(),
            criterion_unit: criterion_unit(&objective.criterion).to_owned(),
            schedules: found
                .iter()
                .map(|(c, schedule, evaluation)| {
                    record(
                        c,
                        schedule,
                        evaluation,
                        first.unwrap_or(evaluation),
                        objective,
                    )
                })
                .collect(),
            skipped,
            inputs: inputs.config.clone(),
            defaulted: inputs.defaulted.clone(),
            warnings: warnings(inputs, None),
        }
    }

    /// Adds what is hard to believe of `schedule` as it was given under `name`. Scaled to the total
    /// time, dwells in minutes would pass.
    pub fn warn_of(&mut self, name: &str, schedule: &Schedule) {
        let found = suspicion::of_schedule(schedule, &self.inputs);
        self.warnings.extend(found.iter().map(|w| WarningRecord {
            key: format!("{name}: {}", w.key),
            ..w.into()
        }));
    }
}

fn record(
    compared: &ComparedSchedule,
    schedule: &Schedule,
    evaluation: &Evaluation,
    first: &Evaluation,
    objective: &Objective,
) -> ComparedRecord {
    let rms = Evaluation::rms_sigma_deg_per_h;
    ComparedRecord {
        name: compared.name.clone(),
        order: compared.order,
        order_proof: compared.order_search.map(|search| search.proof),
        order_steps: compared.order_search.map(|search| search.steps),
        positions: schedule.positions().len(),
        total_time_s: evaluation.total_time_s,
        overhead_s: evaluation.overhead_s,
        rms_sigma_deg_per_h: rms(evaluation),
        ratio: finite(rms(evaluation) / rms(first)),
        max_sigma_deg_per_h: evaluation.max_sigma_deg_per_h(),
        max_eig_sigma_deg_per_h: evaluation.max_eig_sigma_deg_per_h(),
        logdet_deg_per_h: evaluation.logdet_deg_per_h().and_then(finite),
        criterion: evaluation.score.criterion,
        criterion_ratio: finite(evaluation.score.criterion / first.score.criterion),
        least_separability: evaluation.score.least_separability,
        time_to_spec_s: time_to_spec(evaluation, objective),
        coefficients: coefficients(evaluation, first),
        schedule: ScheduleDocument::from(schedule),
    }
}

/// When the last of the coefficients with a specification met it for good, s; of other parameters with
/// one that is known at the end of the test alone.
fn time_to_spec(evaluation: &Evaluation, objective: &Objective) -> Option<f64> {
    let spec = objective.spec_deg_per_h?;
    let times = &evaluation.convergence.time_to_spec_s;
    let of_twelve = DriftCoefficient::ALL
        .into_iter()
        .filter(|c| spec[c.index()].is_finite())
        .try_fold(0.0_f64, |last, c| Some(last.max(times[c.index()]?)))?;
    let mut others = objective.others.iter().zip(&objective.spec_of_others);
    let all_met = others.all(|(at, spec)| evaluation.parameters[*at].sigma <= *spec);
    match (all_met, objective.specifies_others()) {
        (false, _) => None,
        (true, true) => Some(evaluation.total_time_s),
        (true, false) => Some(of_twelve),
    }
}

fn coefficients(evaluation: &Evaluation, first: &Evaluation) -> Vec<ComparedCoefficient> {
    let (sigma, reference) = (
        evaluation.end.sigma_deg_per_h(),
        first.end.sigma_deg_per_h(),
    );
    let observability = &evaluation.observability;
    DriftCoefficient::ALL
        .map(|c| ComparedCoefficient {
            name: c,
            sigma_deg_per_h: sigma[c.index()],
            ratio: finite(sigma[c.index()] / reference[c.index()]),
            observability_order: observability.orders[c.index()].map(|o| o.number()),
            separability: observability.separability[c.index()],
            time_to_spec_s: evaluation.convergence.time_to_spec_s[c.index()],
        })
        .to_vec()
}
