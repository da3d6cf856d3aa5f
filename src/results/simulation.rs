//! The document of a simulation.

use serde::{Deserialize, Serialize};

use crate::config::{StudyConfig, TestConfig};
use crate::drift::DriftCoefficient;
use crate::evaluate::MISALIGNMENT_NAMES;
use crate::schedule::Schedule;
use crate::schedule::file::ScheduleDocument;
use crate::simulate::consistency::{Consistency, Verdict};
use crate::simulate::divergence::Divergence;
use crate::simulate::judgement::Judgement;
use crate::simulate::specification::SpecificationCheck;
use crate::simulate::{
    FilterModel, MonteCarlo, ParameterCheck, PositionCheck, SimulationOptions, StateCheck,
    SweepPoint, TruthModel,
};
use crate::suspicion::WarningRecord;

use super::common::{Inputs, TOOL_VERSION, finite, warnings};
use super::parameters::RoleRecord;

/// Name and major version of the [`SimulationDocument`].
pub const SIMULATION_SCHEMA: &str = "scheme-opt/simulation/1";

/// Whose covariance the errors of the runs are compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum ComparedWith {
    /// That of the filter, which knows of everything that the platform has.
    #[default]
    Filter,
    /// The true one of a filter that does not know of the considered parameters: what it claims, and
    /// what they do to its errors.
    FilterAndConsidered,
}

/// What many simulated runs of a test show.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SimulationDocument {
    /// [`SIMULATION_SCHEMA`].
    pub schema: String,
    /// Version of the program that wrote it.
    pub tool_version: String,
    /// Whose test it is; left out where nobody said.
    #[serde(default, skip_serializing_if = "TestConfig::is_empty")]
    pub test: TestConfig,
    /// Duration of the test, moves and settles included, s.
    pub total_time_s: f64,
    /// How many runs.
    pub runs: usize,
    /// Seed of the random streams.
    pub seed: u64,
    /// Equations of the true platform.
    pub truth: TruthModel,
    /// What the filter linearises about.
    pub filter: FilterModel,
    /// Accelerometer noise told to the filter, as a factor of the true one.
    pub told_accelerometer_factor: f64,
    /// Random drift told to the filter, as a factor of the true one.
    pub told_random_drift_factor: f64,
    /// Noise of the azimuth told to the filter, as a factor of the true one; absent: it is not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub told_azimuth_factor: Option<f64>,
    /// Whose covariance `sigma_…`, `ratio` and `nees…` are of.
    #[serde(default)]
    pub compared_with: ComparedWith,
    /// What is to be thought of the filter: the verdict of `judgement`.
    pub verdict: Verdict,
    /// The verdict with its numbers and in sentences; absent in documents of versions that did
    /// not look for runs that diverged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub judgement: Option<JudgementRecord>,
    /// √(mean over the coefficients of the squared RMS errors), °/h.
    pub rms_error_deg_per_h: f64,
    /// √(mean over the coefficients of the variances), °/h; whose they are says `compared_with`.
    pub rms_sigma_deg_per_h: f64,
    /// The same as the filter claims it, °/h; absent: nothing is considered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rms_claimed_sigma_deg_per_h: Option<f64>,
    /// The same of the linear model, known before any test, °/h.
    pub rms_planned_sigma_deg_per_h: f64,
    /// The drift coefficients, D_FX to D_SZ.
    pub coefficients: Vec<SimulatedCoefficient>,
    /// All parameters of the platform, the coefficients first, those that are considered last; empty in
    /// documents of versions that did not know of others.
    #[serde(default)]
    pub parameters: Vec<SimulatedParameter>,
    /// The misalignment at the end.
    pub misalignment: Vec<SimulatedMisalignment>,
    /// Where 95 of 100 ratios of a consistent filter lie.
    pub ratio_bounds: [f64; 2],
    /// NEES over all states at the end; null when everything is known exactly. The bounds of this
    /// and of what follows up to `nis` are such that all of a consistent filter are within in 95 of 100
    /// simulations.
    pub nees: Option<Consistency>,
    /// NEES over all estimated parameters at the end; absent where they are the coefficients alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nees_parameters: Option<Consistency>,
    /// NEES over the coefficients at the end.
    pub nees_coefficients: Option<Consistency>,
    /// NIS over the ticks of all runs; null without a measurement. Of a filter that ignores considered
    /// parameters it is of what the innovations are without their share.
    pub nis: Option<Consistency>,
    /// NEES over all states by what the filter claims; absent: nothing is considered. It is no part of
    /// the verdict.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nees_claimed: Option<Consistency>,
    /// NIS by what the filter claims, which is what the stand sees; absent: nothing is considered. It
    /// is no part of the verdict.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nis_claimed: Option<Consistency>,
    /// NEES at the end of every position.
    pub positions: Vec<SimulatedPosition>,
    /// RMS over the runs of the largest angle the platform was off the computed frame, degrees.
    pub rms_largest_misalignment_deg: f64,
    /// NEES against the size of the prior, if asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sweep: Vec<SweepRecord>,
    /// The schedule simulated.
    pub schedule: ScheduleDocument,
    /// The study as resolved.
    pub inputs: StudyConfig,
    /// Keys of `inputs` that nobody gave.
    pub defaulted: Vec<String>,
    /// Values of the inputs that are allowed but hard to believe; left out when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<WarningRecord>,
}

/// What a simulation says of a test and its filter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "schema", schemars(rename = "Judgement"))]
#[non_exhaustive]
pub struct JudgementRecord {
    /// What is to be thought of the filter.
    pub verdict: Verdict,
    /// The runs that diverged.
    pub divergence: Divergence,
    /// The errors against the specification; null: none is given.
    pub specification: Option<SpecificationCheck>,
    /// Whether nothing is left to doubt: the filter is consistent, no run diverged, and the
    /// specification, if there is one, is shown to be met. What `simulate --check` asks.
    pub passed: bool,
    /// The same in sentences, with units in plain letters.
    pub sentences: Vec<String>,
}

impl From<Judgement> for JudgementRecord {
    fn from(judgement: Judgement) -> Self {
        Self {
            verdict: judgement.verdict,
            sentences: judgement.findings.iter().map(ToString::to_string).collect(),
            divergence: judgement.divergence,
            specification: judgement.specification,
            passed: judgement.passed,
        }
    }
}

/// Errors of one drift coefficient at the end. g-sensitive coefficients: per g.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SimulatedCoefficient {
    /// The coefficient.
    pub name: DriftCoefficient,
    /// RMS error, °/h.
    pub rms_error_deg_per_h: f64,
    /// RMS of the 1σ, °/h; whose it is says `compared_with`.
    pub sigma_deg_per_h: f64,
    /// The same as the filter claims it, °/h; absent: nothing is considered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub claimed_sigma_deg_per_h: Option<f64>,
    /// 1σ by the linear model, known before any test, °/h.
    pub planned_sigma_deg_per_h: f64,
    /// RMS of error/σ; null: known exactly.
    pub ratio: Option<f64>,
}

/// Errors of one parameter at the end, in its own unit. The filter leaves a considered parameter as it
/// was: its error is the value it has, its σ the one before the test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SimulatedParameter {
    /// `D_FX`, `T_XY`, `K_0Z` …
    pub name: String,
    /// The key of its group, in `[prior]` for the drift coefficients, in `[errors]` for others.
    pub group: String,
    /// `deg/h`, `deg/h/g`, `deg/h/g2`, `ppm`, `arcsec`, `ug`, `ug/g2` or `ug/g3`.
    pub unit: String,
    /// Whether the filter knows of it.
    pub role: RoleRecord,
    /// 1σ before the test.
    pub prior_sigma: f64,
    /// RMS error.
    pub rms_error: f64,
    /// RMS of the 1σ; whose it is says `compared_with`.
    pub sigma: f64,
    /// The same as the filter claims it; absent: nothing is considered, or this parameter is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub claimed_sigma: Option<f64>,
    /// 1σ by the linear model, known before any test.
    pub planned_sigma: f64,
    /// RMS of error/σ; null: known exactly.
    pub ratio: Option<f64>,
}

impl From<&ParameterCheck> for SimulatedParameter {
    fn from(found: &ParameterCheck) -> Self {
        let (p, c) = (&found.parameter, &found.check);
        Self {
            name: p.name.to_owned(),
            group: p.group.to_owned(),
            unit: p.unit.name().to_owned(),
            role: p.role.into(),
            prior_sigma: p.prior_sigma,
            rms_error: c.rms_error,
            sigma: c.sigma,
            claimed_sigma: c.claimed_sigma,
            planned_sigma: c.planned_sigma,
            ratio: c.ratio.and_then(finite),
        }
    }
}

/// Errors of one misalignment angle at the end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SimulatedMisalignment {
    /// `psi_nx`, `psi_ny` or `psi_nz`: about North, Up, East.
    pub name: String,
    /// RMS error, arcsec.
    pub rms_error_arcsec: f64,
    /// RMS of the 1σ, arcsec; whose it is says `compared_with`.
    pub sigma_arcsec: f64,
    /// The same as the filter claims it, arcsec; absent: nothing is considered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub claimed_sigma_arcsec: Option<f64>,
    /// 1σ by the linear model, known before any test, arcsec.
    pub planned_sigma_arcsec: f64,
    /// RMS of error/σ; null: known exactly.
    pub ratio: Option<f64>,
}

/// Consistency when a position is left.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SimulatedPosition {
    /// Time, s.
    pub end_s: f64,
    /// NEES over all states.
    pub nees: Option<Consistency>,
    /// NEES over all estimated parameters; absent where they are the coefficients alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub nees_parameters: Option<Consistency>,
    /// NEES over the coefficients.
    pub nees_coefficients: Option<Consistency>,
}

impl From<&PositionCheck> for SimulatedPosition {
    fn from(p: &PositionCheck) -> Self {
        Self {
            end_s: p.end_s,
            nees: p.nees,
            nees_parameters: p.nees_parameters,
            nees_coefficients: p.nees_coefficients,
        }
    }
}

/// Consistency for one size of the prior.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct SweepRecord {
    /// Prior 1σ of the misalignment about each axis, degrees.
    pub misalignment_deg: f64,
    /// Factor on the prior 1σ of the drift coefficients.
    pub drift_factor: f64,
    /// NEES over all states at the end; null when it is not finite.
    pub nees: Option<Consistency>,
    /// How many runs diverged.
    #[serde(default)]
    pub diverged_runs: usize,
    /// RMS error over the coefficients, °/h; null when it is not finite.
    pub rms_error_deg_per_h: Option<f64>,
    /// RMS over the runs of the largest angle the platform was off the computed frame, degrees.
    pub rms_largest_misalignment_deg: f64,
}

impl From<&SweepPoint> for SweepRecord {
    fn from(point: &SweepPoint) -> Self {
        Self {
            misalignment_deg: point.size.misalignment_deg,
            drift_factor: point.size.drift_factor,
            nees: point.nees.filter(|n| n.average.is_finite()),
            diverged_runs: point.diverged_runs,
            rms_error_deg_per_h: finite(point.rms_error_deg_per_h),
            rms_largest_misalignment_deg: point.rms_largest_misalignment_deg,
        }
    }
}

impl SimulationDocument {
    /// The document of `found`, a simulation of `schedule` with `options`, judged by the
    /// specification in `inputs`.
    pub fn new(
        found: &MonteCarlo,
        options: &SimulationOptions,
        sweep: &[SweepPoint],
        schedule: &Schedule,
        inputs: &Inputs,
    ) -> Self {
        let coefficient = |name: DriftCoefficient| {
            let c: &StateCheck = &found.coefficients[name.index()];
            SimulatedCoefficient {
                name,
                rms_error_deg_per_h: c.rms_error,
                sigma_deg_per_h: c.sigma,
                claimed_sigma_deg_per_h: c.claimed_sigma,
                planned_sigma_deg_per_h: c.planned_sigma,
                ratio: c.ratio.and_then(finite),
            }
        };
        let angle = |(name, c): (&&str, &StateCheck)| SimulatedMisalignment {
            name: (*name).to_owned(),
            rms_error_arcsec: c.rms_error,
            sigma_arcsec: c.sigma,
            claimed_sigma_arcsec: c.claimed_sigma,
            planned_sigma_arcsec: c.planned_sigma,
            ratio: c.ratio.and_then(finite),
        };
        let has_azimuth = inputs.config.platform.azimuth.noise_arcsec.is_some();
        let spec = inputs.config.objective.specification();
        let judgement = Judgement::new(found, spec.as_vector().as_ref(), &spec.others);
        Self {
            schema: SIMULATION_SCHEMA.to_owned(),
            tool_version: TOOL_VERSION.to_owned(),
            test: inputs.config.test.clone(),
            total_time_s: found.total_time_s,
            runs: found.runs,
            seed: found.seed,
            truth: options.truth,
            filter: options.filter,
            told_accelerometer_factor: options.told.accelerometer_factor,
            told_random_drift_factor: options.told.random_drift_factor,
            told_azimuth_factor: has_azimuth.then_some(options.told.azimuth_factor),
            compared_with: match found.claimed.is_some() {
                true => ComparedWith::FilterAndConsidered,
                false => ComparedWith::Filter,
            },
            verdict: judgement.verdict,
            judgement: Some(judgement.into()),
            rms_error_deg_per_h: found.rms_error_deg_per_h(),
            rms_sigma_deg_per_h: found.rms_sigma_deg_per_h(),
            rms_claimed_sigma_deg_per_h: found.rms_claimed_sigma_deg_per_h(),
            rms_planned_sigma_deg_per_h: found.rms_planned_sigma_deg_per_h(),
            coefficients: DriftCoefficient::ALL.map(coefficient).to_vec(),
            parameters: found
                .parameters
                .iter()
                .map(SimulatedParameter::from)
                .collect(),
            misalignment: MISALIGNMENT_NAMES
                .iter()
                .zip(&found.misalignment)
                .map(angle)
                .collect(),
            ratio_bounds: found.ratio_bounds,
            nees: found.nees,
            nees_parameters: found.nees_parameters,
            nees_coefficients: found.nees_coefficients,
            nis: found.nis,
            nees_claimed: found.claimed.and_then(|c| c.nees),
            nis_claimed: found.claimed.and_then(|c| c.nis),
            positions: found
                .positions
                .iter()
                .map(SimulatedPosition::from)
                .collect(),
            rms_largest_misalignment_deg: found.rms_largest_misalignment_deg,
            sweep: sweep.iter().map(SweepRecord::from).collect(),
            schedule: ScheduleDocument::from(schedule),
            inputs: inputs.config.clone(),
            defaulted: inputs.defaulted.clone(),
            warnings: warnings(inputs, Some(schedule)),
        }
    }
}
