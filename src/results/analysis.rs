//! The analysis document: what a schedule makes observable, and why.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::common::{Inputs, TOOL_VERSION, finite, warnings};
use super::named::{AdditionsRecord, NamedObservabilityRecord, RemarkRecord};
use super::parameters::{self, ParameterRecord};
pub use crate::analysis::suggest::Standing;
use crate::analysis::suggest::{NoSuggestion, Suggestion};
use crate::analysis::{Analysis, CorrelatedPair, PositionAnalysis, StateOrder};
use crate::config::{StudyConfig, TestConfig};
use crate::drift::DriftCoefficient;
use crate::evaluate::{Evaluation, Objective};
use crate::observability::classical::PiecewiseConstant;
use crate::observability::nearly::{Nearly, ToldQuantity};
use crate::observability::solution::{NoSolution, RowsUsed, SeenDuring, Solution, Term};
use crate::observability::weak::WeakCombination;
use crate::observability::{Channel, Combination, Order};
use crate::schedule::Notes;
use crate::schedule::Schedule;
use crate::schedule::file::{PositionRecord, ScheduleDocument};
use crate::suspicion::WarningRecord;

/// Name and major version of the [`AnalysisDocument`].
pub const ANALYSIS_SCHEMA: &str = "scheme-opt/analysis/1";

/// What a schedule makes observable, and why. Positions are numbered from 1; orders are 0, 1, 2,
/// null for what is not observable.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct AnalysisDocument {
    /// [`ANALYSIS_SCHEMA`].
    pub schema: String,
    /// Version of the program that wrote it.
    pub tool_version: String,
    /// Whose test it is; left out where nobody said.
    #[serde(default, skip_serializing_if = "TestConfig::is_empty")]
    pub test: TestConfig,
    /// Duration of the test, moves and settles included, s.
    pub total_time_s: f64,
    /// Orders of the states of a dwell.
    pub states: Vec<StateRecord>,
    /// Order and reconstruction of each coefficient.
    pub coefficients: Vec<AnalysedCoefficient>,
    /// Every parameter of the platform in its own unit; specifications are in the evaluation.
    #[serde(default)]
    pub parameters: Vec<ParameterRecord>,
    /// What each position shows by itself.
    pub positions: Vec<AnalysedPosition>,
    /// Ranks, condition, what cannot be told.
    pub observability: AnalysedObservability,
    /// What is observable, but only through a tilt of less than a degree.
    #[serde(default)]
    pub nearly: Vec<NearlyRecord>,
    /// The strongest correlations.
    pub correlations: Correlations,
    /// Singular values of the weighted regressor, columns in °/h, ω_N ψ_y(0) eliminated, largest
    /// first, (°/h)⁻¹.
    pub singular_values_h_per_deg: Vec<f64>,
    /// Combinations of length one, the largest σ by the filter first, those not seen at all left out.
    pub weak: Vec<WeakRecord>,
    /// Piecewise-constant (Lie-derivative) observability matrix.
    pub piecewise_constant: PiecewiseConstantRecord,
    /// What to add, in words.
    pub advice: Vec<String>,
    /// The position that separates the worst combination best; null: there is none.
    pub suggestion: Option<SuggestionRecord>,
    /// Why there is none; absent where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub suggestion_absent: Option<NoSuggestion>,
    /// What is worth saying of a platform with more than the twelve coefficients.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<RemarkRecord>,
    /// The position and the move that help such a platform most; absent: there is nothing but the twelve
    /// coefficients, or nothing can be added.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub additions: Option<AdditionsRecord>,
    /// The schedule analysed.
    pub schedule: ScheduleDocument,
    /// The study as resolved.
    pub inputs: StudyConfig,
    /// Keys of `inputs` that nobody gave.
    pub defaulted: Vec<String>,
    /// Values of the inputs that are allowed but hard to believe; left out when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<WarningRecord>,
}

/// Order of a state, or of a combination of states.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct StateRecord {
    /// `psi_nx` … `eps_nz - omega_N psi_ny`.
    pub name: String,
    /// Its order within one dwell.
    pub order_one_position: Option<Order>,
    /// Its order over the schedule, at the position where it is highest.
    pub order_schedule: Option<Order>,
}

/// Order, separability and reconstruction of a coefficient. g-sensitive coefficients: per g.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct AnalysedCoefficient {
    /// The coefficient.
    pub name: DriftCoefficient,
    /// Highest derivative of the measurement in its solution.
    pub observability_order: Option<Order>,
    /// The same with the change of ψ_y between dwells counted as order 2.
    pub observability_order_strict: Option<Order>,
    /// Separability by the order-1 channels alone, 0 to 1.
    pub separability_first_order: f64,
    /// Separability by all channels, 0 to 1.
    pub separability: f64,
    /// 1σ after the test by the filter, °/h.
    pub sigma_deg_per_h: f64,
    /// Output sensitivity, (°/h)⁻¹.
    pub output_sensitivity_h_per_deg: f64,
    /// 1σ by observability Gramian and prior, without random drift, °/h; null: doubles do not hold
    /// both.
    pub gramian_sigma_deg_per_h: Option<f64>,
    /// Singular value of the piecewise-constant observability matrix that belongs to it.
    pub piecewise_constant_degree: f64,
    /// The weights that prove the order.
    pub reconstruction: Option<ReconstructionRecord>,
    /// Why there are no such weights; absent where there are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reconstruction_absent: Option<NoSolution>,
}

/// A coefficient as a weighted sum of what the channels tell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct ReconstructionRecord {
    /// Channels that occur: x is eps_nx, z is eps_nz − ω_N psi_ny, y is eps_ny.
    pub channels: Vec<Channel>,
    /// The terms.
    pub terms: Vec<TermRecord>,
    /// Whether these are few of the rows that there are or all of them; absent in documents of
    /// earlier versions: few.
    #[serde(default = "few")]
    pub rows: RowsUsed,
    /// 1σ by these terms alone, °/h.
    pub sigma_deg_per_h: f64,
    /// Largest difference between the weighted sum of the rows and the coefficient.
    pub residual: f64,
    /// Whether z channels of different dwells are compared.
    pub uses_change_of_psi_y: bool,
}

/// One term of a reconstruction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct TermRecord {
    /// Number of the position, from 1.
    pub position: usize,
    /// Where in the measured move to the position, 0 to 1; absent: while it is held.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub move_fraction: Option<f64>,
    /// The channel.
    pub channel: Channel,
    /// Its weight.
    pub weight: f64,
}

/// What one position shows by itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct AnalysedPosition {
    /// Outer angle α, degrees.
    pub alpha_deg: f64,
    /// Middle angle β, degrees.
    pub beta_deg: f64,
    /// Inner angle γ, degrees.
    pub gamma_deg: f64,
    /// The combinations that the channels show.
    pub seen: Vec<SeenRecord>,
    /// Order of each coefficient by this position alone.
    pub observability_order: BTreeMap<DriftCoefficient, Option<Order>>,
    /// Lowest order at which each coefficient is excited, part of what a channel shows.
    pub excited_order: BTreeMap<DriftCoefficient, Option<Order>>,
}

/// What a channel shows at a position.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SeenRecord {
    /// The channel.
    pub channel: Channel,
    /// What it tells: `eps_nx`, `eps_nz - omega_N psi_ny`, `eps_ny`.
    pub quantity: String,
    /// Its order.
    pub order: Order,
    /// The combination of unknowns that this is.
    pub combination: String,
}

/// Ranks, condition, what cannot be told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct AnalysedObservability {
    /// Rank of the rows of all channels.
    pub rank: usize,
    /// Number of unknowns: the coefficients and, except at the poles, ω_N ψ_y(0).
    pub unknowns: usize,
    /// Rank of the channels of order 1 and below; at most one less than `unknowns`.
    pub rank_first_order: usize,
    /// Rank of the x channel alone; 11 at best.
    pub rank_x: usize,
    /// Order of ω_N ψ_y(0).
    pub azimuth_order: Option<Order>,
    /// Condition number of the weighted rows; null: infinite, the rank is short.
    pub condition_number: Option<f64>,
    /// The combinations that stay unobservable, by name.
    pub unobservable: Vec<String>,
    /// The same over all estimated parameters, with what would tell them; absent: it cannot be worked out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parameters: Option<NamedObservabilityRecord>,
}

/// Something that is observable, but only through a small tilt: rows that are wrong by that angle
/// can make up all of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct NearlyRecord {
    /// What is told: a coefficient, or a combination of coefficients.
    pub name: String,
    /// The coefficient; null: a combination.
    pub coefficient: Option<DriftCoefficient>,
    /// What it is told from; nothing: it does not show at all but for the tilt.
    pub from: Vec<String>,
    /// By the channels of this order and below.
    pub order: Order,
    /// The tilt by which it is told, degrees.
    pub tilt_deg: f64,
    /// The same in a sentence.
    pub words: String,
}

/// The strongest correlations between coefficients, by size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct Correlations {
    /// Between the estimates, by the filter's P_D.
    pub estimates: Vec<CorrelationRecord>,
    /// Between the columns of the weighted regressor.
    pub columns: Vec<CorrelationRecord>,
}

/// A correlation of two coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct CorrelationRecord {
    /// One coefficient.
    pub a: DriftCoefficient,
    /// The other.
    pub b: DriftCoefficient,
    /// −1 to 1.
    pub correlation: f64,
}

/// A combination, how well it is known, and through what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct WeakRecord {
    /// Its name, small parts left out.
    pub name: String,
    /// Its weights, of length one.
    pub weights: BTreeMap<DriftCoefficient, f64>,
    /// 1σ by the filter, °/h.
    pub sigma_deg_per_h: f64,
    /// 1σ by the channels, each dwell on its own, °/h.
    pub channel_sigma_deg_per_h: f64,
    /// Shares of the information on it by the channels x, z, y.
    pub shares: [f64; 3],
    /// The order through which it is seen.
    pub seen_through_order: Order,
}

/// Piecewise-constant (Lie-derivative) observability matrix in rad and s.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct PiecewiseConstantRecord {
    /// Its units.
    pub units: String,
    /// Its rank over ψ^n and the coefficients.
    pub rank: usize,
    /// Number of states.
    pub states: usize,
    /// Its singular values, largest first.
    pub singular_values: Vec<f64>,
}

/// The position to add.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SuggestionRecord {
    /// What it is to separate, by name.
    pub target: Vec<String>,
    /// Whether that is unobservable so far.
    pub target_unobservable: bool,
    /// The position and how long to hold it.
    pub position: PositionRecord,
    /// The schedule as it is.
    pub before: Standing,
    /// With the position added.
    pub after: Standing,
    /// As it is, its dwells stretched to the same total time.
    pub same_time: Standing,
    /// How many attitudes were examined.
    pub examined: usize,
}

impl AnalysisDocument {
    /// The document of an `analysis` of `schedule` by `objective`, with the `evaluation` it rests on.
    pub fn new(
        analysis: &Analysis,
        evaluation: &Evaluation,
        schedule: &Schedule,
        objective: &Objective,
        inputs: &Inputs,
    ) -> Self {
        let o = &analysis.observability;
        let weak = analysis.weak.iter();
        let pairs = |pairs: &[CorrelatedPair]| pairs.iter().map(Into::into).collect();
        Self {
            schema: ANALYSIS_SCHEMA.to_owned(),
            tool_version: TOOL_VERSION.to_owned(),
            test: inputs.config.test.clone(),
            total_time_s: evaluation.total_time_s,
            states: analysis.states.iter().map(Into::into).collect(),
            coefficients: coefficients(analysis, evaluation),
            parameters: parameters::of(evaluation, objective),
            positions: analysis.positions.iter().map(Into::into).collect(),
            observability: AnalysedObservability {
                rank: o.rank,
                unknowns: o.unknowns,
                rank_first_order: o.rank_first_order,
                rank_x: o.rank_x,
                azimuth_order: analysis.azimuth_order,
                condition_number: finite(o.condition_number),
                unobservable: o.unobservable.iter().map(ToString::to_string).collect(),
                parameters: NamedObservabilityRecord::of(evaluation),
            },
            nearly: analysis.nearly.iter().map(Into::into).collect(),
            correlations: Correlations {
                estimates: pairs(&analysis.estimate_correlations),
                columns: pairs(&analysis.column_correlations),
            },
            singular_values_h_per_deg: analysis.singular_values.clone(),
            weak: weak.map(|(w, sigma)| WeakRecord::new(w, *sigma)).collect(),
            piecewise_constant: (&analysis.classical.piecewise_constant).into(),
            advice: analysis.advice.iter().map(ToString::to_string).collect(),
            suggestion: analysis.suggestion.as_ref().ok().map(Into::into),
            suggestion_absent: analysis.suggestion.as_ref().err().copied(),
            remarks: analysis.remarks.iter().map(Into::into).collect(),
            additions: match &analysis.additions {
                Some(Ok(additions)) => Some(additions.into()),
                _ => None,
            },
            schedule: ScheduleDocument::from(schedule),
            inputs: inputs.config.clone(),
            defaulted: inputs.defaulted.clone(),
            warnings: warnings(inputs, Some(schedule)),
        }
    }
}

fn coefficients(analysis: &Analysis, evaluation: &Evaluation) -> Vec<AnalysedCoefficient> {
    let o = &analysis.observability;
    let sigma = evaluation.end.sigma_deg_per_h();
    let classical = &analysis.classical;
    let sensitivity = classical.gramian.sensitivity();
    DriftCoefficient::ALL
        .into_iter()
        .zip(&analysis.solutions)
        .map(|(name, solution)| {
            let i = name.index();
            AnalysedCoefficient {
                name,
                observability_order: o.orders[i],
                observability_order_strict: o.strict_orders[i],
                separability_first_order: o.separability_first_order[i],
                separability: o.separability[i],
                sigma_deg_per_h: sigma[i],
                output_sensitivity_h_per_deg: sensitivity[i],
                gramian_sigma_deg_per_h: finite(classical.gramian_sigma_deg_per_h[i]),
                piecewise_constant_degree: classical.piecewise_constant.degrees[i],
                reconstruction: solution.as_ref().ok().map(Into::into),
                reconstruction_absent: solution.as_ref().err().copied(),
            }
        })
        .collect()
}

impl From<&StateOrder> for StateRecord {
    fn from(s: &StateOrder) -> Self {
        Self {
            name: s.state.name().to_owned(),
            order_one_position: s.one_position,
            order_schedule: s.schedule,
        }
    }
}

impl From<&Nearly> for NearlyRecord {
    fn from(n: &Nearly) -> Self {
        Self {
            name: n.name(),
            coefficient: match n.told {
                ToldQuantity::Coefficient(c) => Some(c),
                ToldQuantity::Combination(_) => None,
            },
            from: n.from().into_iter().map(str::to_owned).collect(),
            order: n.order,
            tilt_deg: n.tilt_deg(),
            words: n.to_string(),
        }
    }
}

const fn few() -> RowsUsed {
    RowsUsed::Few
}

impl From<&Solution> for ReconstructionRecord {
    fn from(s: &Solution) -> Self {
        Self {
            channels: s.channels(),
            terms: s.terms.iter().map(Into::into).collect(),
            rows: s.rows,
            sigma_deg_per_h: s.sigma_deg_per_h,
            residual: s.residual,
            uses_change_of_psi_y: s.uses_change_of_psi_y,
        }
    }
}

impl From<&Term> for TermRecord {
    fn from(t: &Term) -> Self {
        Self {
            position: t.position + 1,
            move_fraction: match t.moment {
                SeenDuring::Dwell => None,
                SeenDuring::Move { fraction } => Some(fraction),
            },
            channel: t.channel,
            weight: t.weight,
        }
    }
}

impl From<&PositionAnalysis> for AnalysedPosition {
    fn from(p: &PositionAnalysis) -> Self {
        let [alpha_deg, beta_deg, gamma_deg] = p.position.to_deg().map(|deg| deg + 0.0);
        let by_name = |orders: &[Option<Order>]| {
            let orders = orders.iter().copied();
            DriftCoefficient::ALL.into_iter().zip(orders).collect()
        };
        let seen = |(channel, combination): &(Channel, Combination)| SeenRecord {
            channel: *channel,
            quantity: channel.quantity().to_owned(),
            order: channel.order(),
            combination: combination.to_string(),
        };
        Self {
            alpha_deg,
            beta_deg,
            gamma_deg,
            seen: p.seen.iter().map(seen).collect(),
            observability_order: by_name(&p.orders),
            excited_order: by_name(&p.excited),
        }
    }
}

impl From<&CorrelatedPair> for CorrelationRecord {
    fn from(p: &CorrelatedPair) -> Self {
        Self {
            a: p.a,
            b: p.b,
            correlation: p.correlation,
        }
    }
}

impl WeakRecord {
    fn new(weak: &WeakCombination, sigma_deg_per_h: f64) -> Self {
        let weights = weak.combination.coefficients();
        Self {
            name: weak.name().to_string(),
            weights: DriftCoefficient::ALL
                .into_iter()
                .zip(weights.iter().copied())
                .collect(),
            sigma_deg_per_h,
            channel_sigma_deg_per_h: weak.channel_sigma_deg_per_h,
            shares: weak.shares,
            seen_through_order: weak.seen_through(),
        }
    }
}

impl From<&PiecewiseConstant> for PiecewiseConstantRecord {
    fn from(p: &PiecewiseConstant) -> Self {
        Self {
            units: p.units.name().to_owned(),
            rank: p.rank,
            states: p.singular_values.len(),
            singular_values: p.singular_values.clone(),
        }
    }
}

impl From<&Suggestion> for SuggestionRecord {
    fn from(s: &Suggestion) -> Self {
        let [alpha_deg, beta_deg, gamma_deg] = s.position.to_deg().map(|deg| deg + 0.0);
        Self {
            target: s.target.iter().map(ToString::to_string).collect(),
            target_unobservable: s.target_unobservable,
            position: PositionRecord {
                alpha_deg,
                beta_deg,
                gamma_deg,
                dwell_s: s.dwell_s,
                move_s: None,
                move_measured: None,
                change_deg: None,
                pinned: false,
                notes: Notes::new(),
            },
            before: s.before,
            after: s.after,
            same_time: s.same_time,
            examined: s.examined,
        }
    }
}
