//! What cannot be told apart over all parameters, by name, and what to add, as data.

use serde::{Deserialize, Serialize};

use crate::analysis::additions::{Addition, Additions, Aim, Helped, Turn};
use crate::analysis::remark::Remark;
use crate::evaluate::Evaluation;
use crate::observability::named::{
    NamedCombination, NamedTerm, PrincipalDrift, Remedy, Unobserved, WeakNamed,
};
use crate::schedule::file::PositionRecord;

/// Observability over all estimated parameters and the misalignment at the start, none of them known
/// before: what a prior tells does not count.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct NamedObservabilityRecord {
    /// Rank over the unknowns.
    pub rank: usize,
    /// The estimated parameters and the three misalignments at the start, without those known exactly.
    pub unknowns: usize,
    /// What the test does not tell, whatever is known before.
    pub unobservable: Vec<UnobservedRecord>,
    /// What it hardly tells, the worst first.
    pub weak: Vec<WeakNamedRecord>,
    /// Sums of drift parameters that are drift along the vertical at every attitude: of order 2 under
    /// every schedule.
    pub vertical_drift: Vec<CombinationRecord>,
    /// With quadratic terms: the principal directions of what is not known of the drift after the test,
    /// the worst first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub worst_drift: Vec<WorstDriftRecord>,
}

/// A combination of parameters of different units.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct CombinationRecord {
    /// Its name, small parts left out.
    pub name: String,
    /// Its parts.
    pub terms: Vec<CombinationTermRecord>,
}

/// A part of a combination.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct CombinationTermRecord {
    /// A parameter, or `psi_nx(0)`, `psi_ny(0)`, `psi_nz(0)`.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// How much of it, in its unit; 1 of the leading one.
    pub weight: f64,
    /// Length of its signature in the combination beside the longest, 0 to 1.
    pub share: f64,
}

/// Something that the test does not tell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct UnobservedRecord {
    /// What: `K_1X + K_1Y + K_1Z against G`. Changed together like this, the parameters leave every
    /// measurement as it is.
    pub name: String,
    /// Its parts.
    pub terms: Vec<CombinationTermRecord>,
    /// What would tell it.
    pub remedy: Remedy,
    /// Name and remedy in words.
    pub words: String,
    /// What rests on the priors alone.
    pub rests_on_priors: Vec<PriorFloorRecord>,
    /// The same in words, what is little left out.
    pub rests_on: String,
}

/// The least σ that priors alone leave of a parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct PriorFloorRecord {
    /// The parameter, or `psi_nx(0)` ….
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// What no length of this test takes its σ below.
    pub least_sigma: f64,
    /// The same beside the σ before the test, 0 to 1.
    pub share_of_prior: f64,
}

/// Something that the test hardly tells.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct WeakNamedRecord {
    /// Its name, small parts left out.
    pub name: String,
    /// Its parts.
    pub terms: Vec<CombinationTermRecord>,
    /// What its parts show together beside what each would show alone, 0 to 1.
    pub share: f64,
    /// 1σ of the leading part in it by the test alone, in its unit.
    pub sigma: f64,
}

/// A principal direction of what is not known of the drift after the test.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct WorstDriftRecord {
    /// Its name, small parts left out.
    pub name: String,
    /// 1σ of the combination scaled to length one, °/h at 1 g.
    pub sigma_deg_per_h: f64,
    /// Its part along the drift that is vertical at every attitude, 0 to 1.
    pub vertical: f64,
}

/// Something worth saying of the platform and the schedule.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct RemarkRecord {
    /// `azimuth-measured`, `noise-wanders` or `vertical-drift`.
    pub kind: String,
    /// The sentence.
    pub words: String,
}

/// The position and the move that help most.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct AdditionsRecord {
    /// What they are rated by.
    pub aim: Aim,
    /// Whether the move is the better one.
    pub move_is_better: bool,
    /// The best position; null: no attitude can be taken.
    pub position: Option<AdditionRecord>,
    /// The best move; null: no gimbal can turn, or moves turn no torquer.
    #[serde(rename = "move")]
    pub turn: Option<AdditionRecord>,
    /// How many were tried.
    pub examined: usize,
}

/// Something to add at the end of the schedule.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[non_exhaustive]
pub struct AdditionRecord {
    /// The positions to add.
    pub positions: Vec<PositionRecord>,
    /// The turn to the last of them; null: the position matters.
    pub turn: Option<Turn>,
    /// Duration of the test with it, s.
    pub total_time_s: f64,
    /// Value of the criterion with it.
    pub criterion: f64,
    /// The same with the same time in longer dwells.
    pub criterion_same_time: f64,
    /// How many times smaller than with the same time in longer dwells what it is rated by becomes.
    pub factor: f64,
    /// The parameters whose σ shrink most, most first.
    pub helps: Vec<Helped>,
    /// All of it in a sentence.
    pub words: String,
}

impl NamedObservabilityRecord {
    /// Of an evaluation.
    pub(super) fn of(evaluation: &Evaluation) -> Option<Self> {
        let named = evaluation.named.as_ref()?;
        Some(Self {
            rank: named.rank,
            unknowns: named.unknowns,
            unobservable: named.unobserved.iter().map(Into::into).collect(),
            weak: named.weak.iter().map(Into::into).collect(),
            vertical_drift: named
                .vertical
                .iter()
                .map(|c| CombinationRecord {
                    name: c.sum(),
                    terms: terms(c),
                })
                .collect(),
            worst_drift: evaluation.principal_drift.iter().map(Into::into).collect(),
        })
    }
}

fn terms(combination: &NamedCombination) -> Vec<CombinationTermRecord> {
    let record = |t: &NamedTerm| CombinationTermRecord {
        name: t.name.to_owned(),
        unit: t.unit.to_owned(),
        weight: t.weight,
        share: t.share,
    };
    combination.terms.iter().map(record).collect()
}

impl From<&Unobserved> for UnobservedRecord {
    fn from(u: &Unobserved) -> Self {
        let floors = u.rests_on_priors.iter().map(|p| PriorFloorRecord {
            name: p.name.to_owned(),
            unit: p.unit.to_owned(),
            least_sigma: p.least_sigma,
            share_of_prior: p.share_of_prior,
        });
        Self {
            name: u.combination.to_string(),
            terms: terms(&u.combination),
            remedy: u.remedy.clone(),
            words: u.to_string(),
            rests_on_priors: floors.collect(),
            rests_on: u.rests_on(),
        }
    }
}

impl From<&WeakNamed> for WeakNamedRecord {
    fn from(w: &WeakNamed) -> Self {
        Self {
            name: w.combination.to_string(),
            terms: terms(&w.combination),
            share: w.share,
            sigma: w.sigma,
        }
    }
}

impl From<&PrincipalDrift> for WorstDriftRecord {
    fn from(p: &PrincipalDrift) -> Self {
        Self {
            name: p.combination.sum(),
            sigma_deg_per_h: p.sigma,
            vertical: p.vertical,
        }
    }
}

impl From<&Remark> for RemarkRecord {
    fn from(remark: &Remark) -> Self {
        Self {
            kind: remark.name().to_owned(),
            words: remark.to_string(),
        }
    }
}

impl From<&Additions> for AdditionsRecord {
    fn from(a: &Additions) -> Self {
        Self {
            aim: a.aim.clone(),
            move_is_better: a.best().is_some_and(|best| best.turn.is_some()),
            position: a.position.as_ref().map(Into::into),
            turn: a.turn.as_ref().map(Into::into),
            examined: a.examined,
        }
    }
}

impl From<&Addition> for AdditionRecord {
    fn from(a: &Addition) -> Self {
        Self {
            positions: a.positions.iter().map(Into::into).collect(),
            turn: a.turn,
            total_time_s: a.total_time_s,
            criterion: a.criterion,
            criterion_same_time: a.criterion_same_time,
            factor: a.factor,
            helps: a.helps.clone(),
            words: a.to_string(),
        }
    }
}
