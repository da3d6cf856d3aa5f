//! What cannot be told apart, over all estimated parameters and the misalignment at the start, by name.
//!
//! The unknowns are the estimated parameters and ψ^n(0), none of them known before: a prior must not hide
//! what the test cannot tell. Their columns of the information, see
//! `signatures`, are scaled to length one, so that units do not matter. A
//! singular value at or below [`UNSEEN`] of the largest is a direction that does not show. Householder
//! triangles and Jacobi rotations keep columns apart, so that true zeros come out below 1e-15 whatever
//! the sizes of others; the least that was seen of what does show is 1e-9. The tolerance stands in the
//! gap (`nothing_lies_in_the_gap` in the tests), and what shows that little is named as weak.
//!
//! A direction that does not show is named by a least set of unknowns that are dependent, see `sparse`.
//! What to do about it follows from the model, not from a list of names: whether its sum is nothing at
//! any specific force, or only at 1 g; whether torquers alone are in it; whether positions that the
//! stand allows would show it.
//!
//! **What then rests on the priors.** Along a direction w that does not show, only the priors hold the
//! parameters: σ_i ≥ |w_i|/√(Σ w_j²/σ_j²), σ_j the σ before the test, however long it is.

mod alike;
mod judge;
mod unknowns;

use std::fmt;

use serde::{Deserialize, Serialize};

use super::sparse::sparse_basis;
use crate::covariance::CovarianceModel;
use crate::motion::{Test, Timeline};
use crate::wording::{listed, number};
pub use alike::PrincipalDrift;
use alike::alike_at_one_g;
pub(crate) use alike::{principal_drift, vertical};
use judge::{Judge, positions_all_over};
use unknowns::{Names, Split};

/// Relative size at and below which a singular value is rounding, see the module text.
pub const UNSEEN: f64 = 1e-12;
/// Singular values below this are those of weak combinations: what their parts have in common is thirty
/// times what tells them apart.
pub const WEAK: f64 = 0.03;
/// Parts of a combination below this share of its largest are not written out in its name.
const WRITTEN: f64 = 0.02;
/// Parts of a weak combination that are written out.
const WRITTEN_OF_WEAK: f64 = 0.25;
/// Most parts that are written out.
const MOST_WRITTEN: usize = 8;
/// Most weak combinations.
const MOST_WEAK: usize = 6;
/// The misalignment at the start, as an unknown.
const PSI: [&str; 3] = ["psi_nx(0)", "psi_ny(0)", "psi_nz(0)"];

/// A part of a combination.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NamedTerm {
    /// `D_FX`, `T_XY` … or `psi_nx(0)` ….
    pub name: &'static str,
    /// Its unit, `arcsec` for ψ.
    pub unit: &'static str,
    /// How much of it, in its unit; 1 of the term that leads.
    pub weight: f64,
    /// Length of its signature in the combination beside the longest, 0 to 1.
    pub share: f64,
}

/// A combination of parameters of different units: changed together by these weights.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedCombination {
    /// In the order of the parameters.
    pub terms: Vec<NamedTerm>,
    /// Terms of a smaller share are not in its name.
    written: f64,
}

impl NamedCombination {
    /// As a sum: "D_IIX - D_ISY + D_IOZ".
    pub fn sum(&self) -> String {
        let mut text = String::new();
        for t in self.named_terms() {
            text.push_str(match (text.is_empty(), t.weight < 0.0) {
                (true, false) => "",
                (true, true) => "-",
                (false, false) => " + ",
                (false, true) => " - ",
            });
            text.push_str(&t.written());
        }
        text
    }

    /// The terms in its name: the largest, in the order of the parameters.
    fn named_terms(&self) -> Vec<&NamedTerm> {
        let mut large: Vec<(usize, &NamedTerm)> = self
            .terms
            .iter()
            .enumerate()
            .filter(|(_, t)| t.share >= self.written)
            .collect();
        large.sort_by(|a, b| b.1.share.total_cmp(&a.1.share));
        large.truncate(MOST_WRITTEN);
        large.sort_by_key(|(k, _)| *k);
        large.into_iter().map(|(_, t)| t).collect()
    }
}

impl NamedTerm {
    /// Its size and name; a size of one is not written.
    fn written(&self) -> String {
        match self.weight.abs() {
            size if (size - 1.0).abs() < 5e-4 => self.name.to_owned(),
            size => format!("{} {}", three_digits(size), self.name),
        }
    }
}

impl fmt::Display for NamedCombination {
    /// "K_1X + K_1Y + K_1Z against G": what has the other sign stands behind "against".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let written = self.named_terms();
        let side = |positive: bool| {
            let of_side = written.iter().filter(|t| (t.weight > 0.0) == positive);
            of_side
                .map(|t| t.written())
                .collect::<Vec<String>>()
                .join(" + ")
        };
        let (one, other) = (side(true), side(false));
        match (one.is_empty(), other.is_empty()) {
            (true, _) => f.write_str(&other)?,
            (_, true) => f.write_str(&one)?,
            _ => write!(f, "{one} against {other}")?,
        }
        match self.terms.len() - written.len() {
            0 => Ok(()),
            1 => f.write_str(" and one part more"),
            more => write!(f, " and {more} parts more"),
        }
    }
}

/// A positive number as short as three digits allow.
fn three_digits(value: f64) -> String {
    match value {
        v if !(1e-3..1e4).contains(&v) => format!("{v:.1e}"),
        v if v >= 99.95 => format!("{v:.0}"),
        v if v >= 9.995 => format!("{v:.1}"),
        v if v >= 0.9995 => format!("{v:.2}"),
        v => format!("{v:.3}"),
    }
}

/// An axis of the platform.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "lowercase")]
pub enum PlatformAxis {
    /// x.
    X,
    /// y.
    Y,
    /// z.
    Z,
}

impl PlatformAxis {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Z];

    /// The name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
        }
    }
}

/// What would tell something that a schedule does not; its `Display` says so.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(tag = "kind", rename_all = "kebab-case")]
pub enum Remedy {
    /// No test whatever: these are one thing under several names.
    GiveOne,
    /// Specific forces of another size than 1 g.
    Centrifuge,
    /// Turning the platform about these axes of its own.
    Slews {
        /// The axes.
        axes: Vec<PlatformAxis>,
    },
    /// Positions in other attitudes.
    OtherPositions,
    /// Gimbals that allow other attitudes and moves: positions all over the ranges of this stand do not
    /// show it.
    OtherStand,
    /// A latitude where the Earth rate has a North component.
    OtherLatitude,
}

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::GiveOne => f.write_str("give one of them"),
            Self::Centrifuge => f.write_str("needs a centrifuge"),
            Self::Slews { axes } => {
                let names: Vec<&str> = axes.iter().map(|a| a.name()).collect();
                write!(f, "needs slews about {}", listed(&names))
            }
            Self::OtherPositions => f.write_str("needs other positions"),
            Self::OtherStand => {
                f.write_str("needs attitudes or moves that this stand does not allow")
            }
            Self::OtherLatitude => f.write_str("needs another latitude"),
        }
    }
}

/// Shares of a prior σ below which nothing worth telling rests on it.
const RESTS: f64 = 0.1;

/// The least σ that priors alone leave of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PriorFloor {
    /// `D_FX` … or `psi_nx(0)` ….
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// What no length of this test takes its σ below.
    pub least_sigma: f64,
    /// The same beside the σ before the test, 0 to 1.
    pub share_of_prior: f64,
}

/// Something that the test does not tell, whatever is known before; its `Display` says what it is and
/// what would tell it.
#[derive(Debug, Clone, PartialEq)]
pub struct Unobserved {
    /// What: changed together like this, the parameters leave every measurement as it is.
    pub combination: NamedCombination,
    /// What would tell it.
    pub remedy: Remedy,
    /// What rests on the priors alone, and how much.
    pub rests_on_priors: Vec<PriorFloor>,
}

impl fmt::Display for Unobserved {
    /// "T_ZZ: needs slews about z".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.combination, self.remedy)
    }
}

impl Unobserved {
    /// What the priors alone hold, in words: "T_ZZ 1000 ppm". What rests on them but little is left out,
    /// unless it is drift, where little may be much.
    pub fn rests_on(&self) -> String {
        let floors: Vec<String> = self
            .rests_on_priors
            .iter()
            .filter(|p| p.share_of_prior >= RESTS || p.unit.starts_with("deg/h"))
            .map(|p| format!("{} {} {}", p.name, number(p.least_sigma), p.unit))
            .collect();
        listed(&floors)
    }
}

/// Something that the test tells, but hardly.
#[derive(Debug, Clone, PartialEq)]
pub struct WeakNamed {
    /// The combination; its leading term has the weight 1.
    pub combination: NamedCombination,
    /// What its parts show together beside what each would show alone, 0 to 1.
    pub share: f64,
    /// 1σ of the leading term in it by the test alone, in its unit.
    pub sigma: f64,
}

/// Observability of all estimated parameters by name.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedObservability {
    /// Rank over the unknowns.
    pub rank: usize,
    /// Number of unknowns: the estimated parameters and the three of ψ^n(0), without those known exactly.
    pub unknowns: usize,
    /// Smallest singular value of the signatures, scaled to length one, that counts, and the largest that
    /// does not, beside the largest of all; zero where there is none.
    pub gap: [f64; 2],
    /// What does not show at all.
    pub unobserved: Vec<Unobserved>,
    /// What hardly shows, the worst first.
    pub weak: Vec<WeakNamed>,
    /// Drift along the vertical: of order 2 under every schedule.
    pub vertical: Vec<NamedCombination>,
}

impl NamedObservability {
    /// Of `timeline`; none where the information overflows.
    pub(crate) fn of(test: &Test, model: &CovarianceModel, timeline: &Timeline) -> Option<Self> {
        let names = Names::new(model);
        let signatures = model.signatures(timeline).ok()?;
        let split = Split::of(&signatures, &names.open());
        let open = split.open.len();
        let mut unobserved = Vec::new();
        if split.null.ncols() > 0 {
            let judge = Judge {
                model,
                names: &names,
                stand: positions_all_over(test).and_then(|t| model.signatures(&t).ok()),
            };
            let families: Vec<usize> = split.open.iter().map(|&j| names.family[j]).collect();
            // What no schedule at 1 g can tell comes first, so that it is not hidden in what this one
            // leaves out besides.
            let alike = alike_at_one_g(&model.errors, &split.open, &families);
            let known = judge.in_signatures(&signatures, &split.open, &alike);
            for combination in alike {
                unobserved.push(judge.judged(combination));
            }
            for vector in sparse_basis(&split.null, &known, &families) {
                let combination =
                    names.combination(&split.open, &signatures.lengths, &vector, WRITTEN);
                unobserved.push(judge.judged(combination));
            }
        }
        Some(Self {
            rank: open - split.null.ncols(),
            unknowns: open,
            gap: split.gap,
            unobserved,
            weak: split.weak(&signatures, &names),
            vertical: vertical(&model.errors),
        })
    }
}
