//! The bound document, and the certificate that a search's result carries.

use std::collections::BTreeMap;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::common::{Inputs, TOOL_VERSION, finite, warnings};
use super::evaluation::criterion_unit;
use crate::certificate::{Bound, Certifier, CriterionBound, Majorant, MinimumTime, Remark};
use crate::config::{Mode, StudyConfig, TestConfig};
use crate::criterion::Criterion;
use crate::drift::{CoefficientVector, DriftCoefficient};
use crate::evaluate::Objective;
use crate::search::SearchOutcome;
use crate::suspicion::WarningRecord;

/// Name and major version of the [`BoundDocument`].
pub const BOUND_SCHEMA: &str = "scheme-opt/bound/1";

/// What no schedule can beat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct BoundDocument {
    /// [`BOUND_SCHEMA`].
    pub schema: String,
    /// Version of the program that wrote it.
    pub tool_version: String,
    /// Whose test it is; left out where nobody said.
    #[serde(default, skip_serializing_if = "TestConfig::is_empty")]
    pub test: TestConfig,
    /// Duration that the bound is for, s: no schedule of this length or shorter beats it.
    pub total_time_s: f64,
    /// `a`, `d`, `e` or `max-ratio`.
    pub criterion: String,
    /// `deg/h`, or `1` for `max-ratio`.
    pub criterion_unit: String,
    /// No schedule reaches a smaller value of the criterion than this, in `criterion_unit`.
    pub lower_bound: f64,
    /// Nor a smaller RMS σ than this, °/h.
    pub rms_sigma_lower_bound_deg_per_h: f64,
    /// Nor a smaller σ of this coefficient, whatever becomes of the others, °/h (per g).
    pub sigma_lower_bound_deg_per_h: BTreeMap<DriftCoefficient, f64>,
    /// With a specification: no schedule of this duration, s, or shorter meets it. Absent: no
    /// specification, or nothing can be said; `minimum_time` has it in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub minimum_time_s: Option<f64>,
    /// With a specification, what the bound says of the time it needs, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub minimum_time: Option<String>,
    /// How much of the relaxed problem's own optimum the bound misses, relatively: the gap of the
    /// Kiefer–Wolfowitz equivalence theorem, with the maximum over all attitudes from above.
    pub equivalence_gap: f64,
    /// How information is majorised; null: nothing is measured.
    pub majorant: Option<Majorant>,
    /// Time mean of the majorant for North (x), Up (y) and East (z): no more information per second
    /// comes from the drift rate in that channel, (°/h)⁻² s⁻¹; null: nothing is measured.
    pub delta: Option<DeltaRecord>,
    /// Bound on the information on (D_IX + D_IY + D_IZ)/√3, (°/h)⁻²; null: not treated apart.
    pub trace_information_h2_per_deg2: Option<f64>,
    /// Groups of `[errors]` that the platform has and that the bound takes as known; left out when
    /// there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub taken_as_known: Vec<String>,
    /// Keys of noise that wanders, which the platform has and the bound on the criterion leaves out: with
    /// criterion `use` all, otherwise those of the accelerometers; left out when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub noise_left_out: Vec<String>,
    /// What the bound does not cover, or why it is weak.
    pub remarks: Vec<String>,
    /// The study as resolved.
    pub inputs: StudyConfig,
    /// Keys of `inputs` that nobody gave.
    pub defaulted: Vec<String>,
    /// Values of the inputs that are allowed but hard to believe; left out when there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<WarningRecord>,
}

/// One number for each channel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct DeltaRecord {
    /// North.
    pub x: f64,
    /// Up.
    pub y: f64,
    /// East.
    pub z: f64,
}

impl BoundDocument {
    /// The document of `bound` by `objective`; `minimum_time` where there is a specification.
    pub fn new(
        bound: &Bound,
        minimum_time: Option<MinimumTime>,
        objective: &Objective,
        inputs: &Inputs,
    ) -> Self {
        let sigma = &bound.sigma_deg_per_h;
        let majorant = bound.criterion.majorant;
        Self {
            schema: BOUND_SCHEMA.to_owned(),
            tool_version: TOOL_VERSION.to_owned(),
            test: inputs.config.test.clone(),
            total_time_s: bound.total_time_s,
            criterion: objective.criterion.name().to_owned(),
            criterion_unit: criterion_unit(&objective.criterion).to_owned(),
            lower_bound: bound.lower_bound,
            rms_sigma_lower_bound_deg_per_h: bound.rms_sigma_deg_per_h,
            sigma_lower_bound_deg_per_h: DriftCoefficient::ALL
                .into_iter()
                .map(|c| (c, sigma[c.index()]))
                .collect(),
            minimum_time_s: minimum_time.and_then(seconds),
            minimum_time: minimum_time.map(|time| time.to_string()),
            equivalence_gap: bound.criterion.equivalence_gap,
            majorant: majorant.map(|m| m.kind),
            delta: majorant.map(|m| DeltaRecord {
                x: m.delta[0],
                y: m.delta[1],
                z: m.delta[2],
            }),
            trace_information_h2_per_deg2: majorant.and_then(|m| m.trace_information),
            taken_as_known: bound
                .taken_as_known
                .iter()
                .map(ToString::to_string)
                .collect(),
            noise_left_out: bound
                .noise_left_out
                .iter()
                .map(ToString::to_string)
                .collect(),
            remarks: in_words(&bound.remarks),
            inputs: inputs.config.clone(),
            defaulted: inputs.defaulted.clone(),
            warnings: warnings(inputs, None),
        }
    }
}

/// The duration that is certainly not enough, s.
const fn seconds(time: MinimumTime) -> Option<f64> {
    match time {
        MinimumTime::Nothing => Some(0.0),
        MinimumTime::MoreThan(s) | MinimumTime::NotWithin(s) => Some(s),
        MinimumTime::OfOthers | MinimumTime::Unknown => None,
    }
}

fn in_words(remarks: &[Remark]) -> Vec<String> {
    remarks.iter().map(Remark::to_string).collect()
}

/// How far the schedule found is from the best possible.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct CertificateRecord {
    /// `a`, `d`, `e`, `max-ratio`; in mode `time`, `total-time`.
    pub criterion: String,
    /// `deg/h`; `1` for `max-ratio`; `s` for `total-time`.
    pub unit: String,
    /// No schedule is below this, in `unit`; null: nothing can be said, see `remarks`.
    pub lower_bound: Option<f64>,
    /// What the schedule found reaches, in `unit`.
    pub achieved: f64,
    /// 100 (achieved/lower_bound − 1); null when there is no useful bound, or when the schedule
    /// found does not meet the specification in mode `time`.
    pub gap_percent: Option<f64>,
    /// The bound is for tests of this duration or less, s; absent in mode `time`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub total_time_s: Option<f64>,
    /// What the bound does not cover, or why it is weak.
    pub remarks: Vec<String>,
}

impl CertificateRecord {
    /// The certificate of a search's `outcome` by `objective`, whose time was `total_time_s`.
    /// Where a bound cannot be computed the record says so.
    pub fn new(
        certifier: &Certifier,
        mode: Mode,
        objective: &Objective,
        total_time_s: f64,
        outcome: &SearchOutcome,
    ) -> Self {
        match (mode, &objective.spec_deg_per_h) {
            (Mode::Time, Some(spec)) => {
                let meets = !outcome.lacking;
                let others = objective.specifies_others();
                let achieved_s = outcome.evaluation.total_time_s;
                Self::of_time(certifier, (spec, others), achieved_s, meets)
            }
            _ => Self::of_criterion(
                certifier,
                objective,
                total_time_s,
                outcome.evaluation.score.criterion,
            ),
        }
    }

    /// The certificate of a schedule that reached `achieved` by the criterion of `objective`, in
    /// `total_time_s`. Where a bound cannot be computed the record says so.
    pub fn of_criterion(
        certifier: &Certifier,
        objective: &Objective,
        total_time_s: f64,
        achieved: f64,
    ) -> Self {
        let found = certifier.criterion_bound(&objective.criterion, total_time_s);
        let (lower_bound, remarks) = match &found {
            Ok(bound) => (
                useful(bound),
                certifier.remarks(&objective.criterion, bound),
            ),
            Err(e) => (None, vec![Remark::NoBound(e.clone())]),
        };
        Self {
            criterion: objective.criterion.name().to_owned(),
            unit: criterion_unit(&objective.criterion).to_owned(),
            lower_bound,
            achieved,
            gap_percent: gap_percent(achieved, lower_bound),
            total_time_s: Some(total_time_s),
            remarks: in_words(&remarks),
        }
    }

    /// `spec`: of the coefficients, and whether other parameters have one too.
    fn of_time(
        certifier: &Certifier,
        (spec, others): (&CoefficientVector, bool),
        achieved_s: f64,
        meets: bool,
    ) -> Self {
        let (lower_bound, mut remarks) = match certifier
            .minimum_time(spec, achieved_s)
            .map(|time| time.beside(others))
        {
            Ok(MinimumTime::MoreThan(s)) => (Some(s), Vec::new()),
            Ok(other) => (seconds(other), vec![Remark::Time(other)]),
            Err(e) => (None, vec![Remark::NoBound(e)]),
        };
        remarks.extend(certifier.taken_as_known(&Criterion::max_ratio(*spec)));
        if !meets {
            remarks.push(Remark::SpecificationMissed);
        }
        Self {
            criterion: "total-time".to_owned(),
            unit: "s".to_owned(),
            lower_bound,
            achieved: achieved_s,
            gap_percent: gap_percent(achieved_s, lower_bound).filter(|_| meets),
            total_time_s: None,
            remarks: in_words(&remarks),
        }
    }
}

fn useful(bound: &CriterionBound) -> Option<f64> {
    (bound.lower_bound > 0.0).then_some(bound.lower_bound)
}

fn gap_percent(achieved: f64, lower_bound: Option<f64>) -> Option<f64> {
    lower_bound.and_then(|bound| finite(100.0 * (achieved / bound - 1.0)))
}

/// Lower bounds on the criterion along a front, where they can be computed.
pub(super) fn front_bounds(
    certifier: &Certifier,
    objective: &Objective,
    times_s: &[f64],
) -> Vec<Option<f64>> {
    times_s
        .par_iter()
        .map(|&time_s| {
            let bound = certifier.criterion_bound(&objective.criterion, time_s);
            // A point whose bound cannot be computed is shown without it; the command `bound` at its
            // time says why.
            bound.ok().as_ref().and_then(useful)
        })
        .collect()
}
