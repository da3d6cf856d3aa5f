//! What cannot be told apart, over all estimated parameters and the misalignment at the start, by name.
//!
//! The unknowns are the estimated parameters and ψ^n(0), none of them known before: a prior must not hide
//! what the test cannot tell. Their columns of the information, see
//! [`signatures`](crate::covariance::signatures), are scaled to length one, so that units do not matter. A
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

use std::fmt;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::RANK_TOLERANCE;
use super::regressor::at_a_pole;
use super::singular::Singular;
use super::sparse::sparse_basis;
use crate::attitude::Position;
use crate::covariance::CovarianceModel;
use crate::covariance::signatures::Signatures;
use crate::drift::COEFFICIENTS;
use crate::model::{Alike, ErrorModel, Parameter};
use crate::motion::Timeline;
use crate::platform::Platform;
use crate::schedule::{Schedule, ScheduledPosition};
use crate::wording::{listed, number};

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
    pub(crate) fn of(
        platform: &Platform,
        model: &CovarianceModel,
        timeline: &Timeline,
    ) -> Option<Self> {
        let names = Names::new(model);
        let signatures = model.signatures(timeline).ok()?;
        let split = Split::of(&signatures, &names.open());
        let open = split.open.len();
        let mut unobserved = Vec::new();
        if split.null.ncols() > 0 {
            let judge = Judge {
                model,
                names: &names,
                stand: positions_all_over(platform).and_then(|t| model.signatures(&t).ok()),
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

/// The unknowns by name.
struct Names {
    name: Vec<&'static str>,
    unit: Vec<&'static str>,
    /// 1σ before the test.
    prior: Vec<f64>,
    /// Which belong together.
    family: Vec<usize>,
}

impl Names {
    fn new(model: &CovarianceModel) -> Self {
        let parameters = &model.errors.parameters()[..model.errors.estimated()];
        let mut groups: Vec<&str> = parameters.iter().map(|p| p.group).collect();
        groups.dedup();
        let family = |group: &str| groups.iter().position(|g| *g == group).unwrap_or(0);
        let psi = model.prior_psi.diagonal().map(f64::sqrt);
        let of_each = parameters.iter();
        Self {
            name: of_each.clone().map(|p| p.name).chain(PSI).collect(),
            unit: of_each
                .clone()
                .map(|p| p.unit.name())
                .chain(["arcsec"; 3])
                .collect(),
            prior: of_each
                .clone()
                .map(|p| p.prior_sigma)
                .chain(psi.iter().copied())
                .collect(),
            family: of_each
                .map(|p| family(p.group))
                .chain([groups.len(); 3])
                .collect(),
        }
    }

    /// Those not known exactly.
    fn open(&self) -> Vec<usize> {
        (0..self.prior.len())
            .filter(|&j| self.prior[j] > 0.0)
            .collect()
    }

    /// The combination whose signatures, scaled to length one, have these weights.
    fn combination(
        &self,
        open: &[usize],
        lengths: &[f64],
        vector: &DVector<f64>,
        written: f64,
    ) -> NamedCombination {
        let largest = vector.amax();
        // What shows nothing at all stands by itself.
        let length = |j: usize| match lengths[j] > 0.0 {
            true => lengths[j],
            false => 1.0,
        };
        // The first of those that are large leads.
        let lead = vector
            .iter()
            .position(|v| v.abs() >= 0.5 * largest)
            .unwrap_or(0);
        let unit = vector[lead] / length(open[lead]);
        let terms = vector.iter().enumerate().filter(|(_, v)| **v != 0.0);
        NamedCombination {
            terms: terms
                .map(|(k, v)| NamedTerm {
                    name: self.name[open[k]],
                    unit: self.unit[open[k]],
                    weight: v / length(open[k]) / unit,
                    share: v.abs() / largest,
                })
                .collect(),
            written,
        }
    }
}

/// The unknowns that are open, split into what shows and what does not.
struct Split {
    open: Vec<usize>,
    /// Directions that do not show, in signatures of length one.
    null: DMatrix<f64>,
    gap: [f64; 2],
    /// Singular values that count, with their directions, the smallest first.
    seen: Vec<(f64, DVector<f64>)>,
}

impl Split {
    fn of(signatures: &Signatures, open: &[usize]) -> Self {
        let svd = Singular::of(signatures.columns.nrows(), open.len(), |i, k| {
            signatures.columns[(i, open[k])]
        });
        let largest = svd.values.first().copied().unwrap_or(0.0);
        let rank = svd.values.iter().filter(|v| **v > UNSEEN * largest).count();
        let direction = |k: usize| DVector::from_fn(open.len(), |j, _| svd.vector(k, j));
        let relative = |k: Option<usize>| {
            let value = k.and_then(|k| svd.values.get(k)).copied().unwrap_or(0.0);
            if largest > 0.0 { value / largest } else { 0.0 }
        };
        let missing: Vec<DVector<f64>> = (rank..open.len()).map(direction).collect();
        Self {
            open: open.to_vec(),
            null: DMatrix::from_fn(open.len(), missing.len(), |j, k| missing[k][j]),
            gap: [relative(rank.checked_sub(1)), relative(Some(rank))],
            seen: (0..rank)
                .rev()
                .map(|k| (svd.values[k], direction(k)))
                .collect(),
        }
    }

    fn weak(&self, signatures: &Signatures, names: &Names) -> Vec<WeakNamed> {
        let hardly = self.seen.iter().take_while(|(value, _)| *value < WEAK);
        hardly
            .take(MOST_WEAK)
            .map(|(value, direction)| {
                let combination =
                    names.combination(&self.open, &signatures.lengths, direction, WRITTEN_OF_WEAK);
                let leads = |t: &&NamedTerm| t.weight == 1.0;
                let lead = combination.terms.iter().find(leads);
                let at = lead.and_then(|t| names.name.iter().position(|n| *n == t.name));
                let size = lead.map_or(1.0, |t| t.share) * direction.amax();
                WeakNamed {
                    share: *value,
                    sigma: size / (at.map_or(1.0, |j| signatures.lengths[j]) * value),
                    combination,
                }
            })
            .collect()
    }
}

/// Says what would tell a combination.
struct Judge<'a> {
    model: &'a CovarianceModel,
    names: &'a Names,
    /// What positions all over the stand show; none: they cannot be run.
    stand: Option<Signatures>,
}

impl Judge<'_> {
    fn judged(&self, combination: NamedCombination) -> Unobserved {
        let weights = self.weights(&combination);
        Unobserved {
            remedy: self.remedy(&weights),
            rests_on_priors: self.floors(&weights),
            combination,
        }
    }

    /// The unknowns in a combination, by index.
    fn weights(&self, combination: &NamedCombination) -> Vec<(usize, f64)> {
        let at = |t: &NamedTerm| self.names.name.iter().position(|n| *n == t.name);
        let terms = combination.terms.iter();
        terms.filter_map(|t| Some((at(t)?, t.weight))).collect()
    }

    /// An orthonormal basis of combinations in signatures of length one.
    fn in_signatures(
        &self,
        signatures: &Signatures,
        open: &[usize],
        combinations: &[NamedCombination],
    ) -> DMatrix<f64> {
        let mut basis: Vec<DVector<f64>> = Vec::new();
        for combination in combinations {
            let weights = self.weights(combination);
            let longest = weights
                .iter()
                .map(|(j, w)| w.abs() * signatures.lengths[*j])
                .fold(0.0, f64::max);
            let mut vector = DVector::zeros(open.len());
            for (j, weight) in weights {
                // What shows nothing counts as much as the rest.
                let part = match signatures.lengths[j] > 0.0 {
                    true => weight * signatures.lengths[j],
                    false if longest > 0.0 => weight.signum() * longest,
                    false => weight,
                };
                if let Some(k) = open.iter().position(|&o| o == j) {
                    vector[k] = part;
                }
            }
            let rest = basis
                .iter()
                .fold(vector.clone(), |rest, b| rest - b * b.dot(&vector));
            basis.push(rest.normalize());
        }
        DMatrix::from_fn(open.len(), basis.len(), |j, k| basis[k][j])
    }

    fn remedy(&self, weights: &[(usize, f64)]) -> Remedy {
        let errors = &self.model.errors;
        let estimated = errors.estimated();
        let of_parameters = weights.iter().all(|(j, _)| *j < estimated);
        if of_parameters {
            match errors.alike(weights) {
                Alike::Always => return Remedy::GiveOne,
                Alike::AtOneG => return Remedy::Centrifuge,
                Alike::No => {}
            }
        }
        let effects = errors.effects();
        let turned = |j: usize| {
            let of = effects.get(j).into_iter().flatten();
            of.filter_map(|e| e.feature.rate_axis()).next()
        };
        let drifts = errors.drifts_by_gravity();
        let is_drift = |j: usize| drifts.get(j).copied().unwrap_or(false);
        let of_stand = self.shown_on_stand(weights);
        if of_stand == Some(false) {
            let all_drift = weights.iter().all(|(j, _)| is_drift(*j));
            let pole = at_a_pole(self.model) && self.model.azimuth_variance.is_none();
            return match pole && all_drift {
                true => Remedy::OtherLatitude,
                false => Remedy::OtherStand,
            };
        }
        let mut axes: Vec<PlatformAxis> = weights
            .iter()
            .filter_map(|(j, _)| turned(*j))
            .map(|axis| PlatformAxis::ALL[axis])
            .collect();
        let only_turning = weights
            .iter()
            .all(|(j, _)| turned(*j).is_some() || is_drift(*j));
        // Where ψ stays with the platform, no move turns the torquers: they show in tracking alone.
        match only_turning && !axes.is_empty() && !self.model.frame_hold {
            true => {
                axes.sort();
                axes.dedup();
                Remedy::Slews { axes }
            }
            false => Remedy::OtherPositions,
        }
    }

    /// Whether positions all over the stand show the combination.
    fn shown_on_stand(&self, weights: &[(usize, f64)]) -> Option<bool> {
        let stand = self.stand.as_ref()?;
        let mut sum = DVector::zeros(stand.columns.nrows());
        let mut whole = 0.0;
        for (j, weight) in weights {
            let part = stand.columns.column(*j) * (weight * stand.lengths[*j]);
            whole += part.norm();
            sum += part;
        }
        Some(sum.norm() > RANK_TOLERANCE * whole)
    }

    fn floors(&self, weights: &[(usize, f64)]) -> Vec<PriorFloor> {
        let sum: f64 = weights
            .iter()
            .map(|(j, w)| (w / self.names.prior[*j]).powi(2))
            .sum();
        weights
            .iter()
            .map(|(j, w)| PriorFloor {
                name: self.names.name[*j],
                unit: self.names.unit[*j],
                least_sigma: w.abs() / sum.sqrt(),
                share_of_prior: w.abs() / sum.sqrt() / self.names.prior[*j],
            })
            .collect()
    }
}

/// Positions spread over all that the gimbals allow, held long enough, with the moves that the platform
/// makes; none where it cannot run them.
fn positions_all_over(platform: &Platform) -> Option<Timeline> {
    /// More than enough for every parameter.
    const POSITIONS: usize = 24;
    /// Irrational turns that fill a cube evenly (Roberts).
    const TURNS: [f64; 3] = [
        0.819_172_513_396_164_4,
        0.671_043_606_703_789,
        0.549_700_477_901_970,
    ];
    let gimbals = platform.gimbals();
    let angle = |axis: usize, share: f64| match gimbals.settings_deg(axis) {
        Some(settings) => {
            let settings: Vec<f64> = settings.collect();
            let at = (share * settings.len() as f64) as usize;
            settings[at.min(settings.len() - 1)]
        }
        None => match gimbals.ranges[axis] {
            Some(r) => {
                let (low, high) = r.ends().into_inner();
                low.deg() + share * (high.deg() - low.deg())
            }
            None => 360.0 * share - 180.0,
        },
    };
    let dwell_s = (60.0 * platform.period_s()).max(platform.shortest_dwell_s());
    let held = (0..POSITIONS).map(|k| {
        let [a, b, c] = [0, 1, 2].map(|axis| {
            let share = (0.5 + TURNS[axis] * (k + 1) as f64).fract();
            (angle(axis, share) * 1e6).round() / 1e6
        });
        ScheduledPosition::new(Position::from_deg(a, b, c), dwell_s)
    });
    Timeline::new(platform, &Schedule::new(held.collect()).ok()?).ok()
}

/// Sums of open parameters that are nothing at 1 g, whatever the attitude.
fn alike_at_one_g(
    errors: &ErrorModel,
    open: &[usize],
    families: &[usize],
) -> Vec<NamedCombination> {
    let estimated = &errors.parameters()[..errors.estimated()];
    let effects = errors.effects();
    let turns = |j: usize| effects[j].iter().any(|e| e.feature.is_rate());
    let (of, families): (Vec<usize>, Vec<usize>) = open
        .iter()
        .zip(families)
        .filter(|(j, _)| **j < estimated.len() && !turns(**j))
        .map(|(j, family)| (*j, *family))
        .unzip();
    let mut functions = errors.at_one_g(&of);
    let sizes: Vec<f64> = functions.column_iter().map(|c| c.norm()).collect();
    for (mut column, size) in functions.column_iter_mut().zip(&sizes) {
        column /= *size;
    }
    let none = DMatrix::zeros(of.len(), 0);
    sparse_basis(&null_space(&functions), &none, &families)
        .iter()
        .map(|vector| {
            let weights = DVector::from_fn(of.len(), |k, _| vector[k] / sizes[k]);
            of_parameters(estimated, &of, &weights, WRITTEN)
        })
        .collect()
}

/// An orthonormal basis of what a matrix takes to nothing.
fn null_space(m: &DMatrix<f64>) -> DMatrix<f64> {
    let width = m.ncols();
    let svd = Singular::of(m.nrows(), width, |i, j| m[(i, j)]);
    let largest = svd.values.first().copied().unwrap_or(0.0);
    let rank = svd.values.iter().filter(|v| **v > UNSEEN * largest).count();
    DMatrix::from_fn(width, width - rank, |j, k| svd.vector(rank + k, j))
}

/// Sums of drift parameters that are drift along the vertical at every attitude, ε(u) = λ(u) u, and not
/// nothing.
pub(crate) fn vertical(errors: &ErrorModel) -> Vec<NamedCombination> {
    let estimated = &errors.parameters()[..errors.estimated()];
    let by_gravity = errors.drifts_by_gravity();
    let of: Vec<usize> = (0..estimated.len()).filter(|&j| by_gravity[j]).collect();
    let [horizontal, whole] = errors.horizontal_and_whole(&of);
    // What is nothing at 1 g is no drift along the vertical.
    let nothing = null_space(&whole);
    let basis = null_space(&horizontal);
    let group = |j: usize| estimated.iter().position(|p| p.group == estimated[j].group);
    let groups: Vec<usize> = of.iter().filter_map(|&j| group(j)).collect();
    sparse_basis(&basis, &nothing, &groups)
        .iter()
        .map(|vector| of_parameters(estimated, &of, vector, WRITTEN))
        .collect()
}

/// A principal direction of what is not known of the drift after the test.
#[derive(Debug, Clone, PartialEq)]
pub struct PrincipalDrift {
    /// Drift parameters, of length one, small parts not in its name.
    pub combination: NamedCombination,
    /// 1σ of the combination scaled to length one, °/h (g-sensitive ones at 1 g).
    pub sigma: f64,
    /// Its part along the drift that is vertical at every attitude, 0 to 1.
    pub vertical: f64,
}

/// The principal directions of the covariance of the drift parameters, the worst first; none without
/// quadratic terms, where those of the coefficients say it all. `covariance` is of the estimated
/// parameters in their units.
pub(crate) fn principal_drift(
    errors: &ErrorModel,
    covariance: &DMatrix<f64>,
    vertical: &[NamedCombination],
) -> Vec<PrincipalDrift> {
    /// Beyond these there is nothing to tell them by.
    const MOST: usize = 8;
    let estimated = &errors.parameters()[..errors.estimated()];
    let by_gravity = errors.drifts_by_gravity();
    let of: Vec<usize> = (0..estimated.len()).filter(|&j| by_gravity[j]).collect();
    if of.len() == COEFFICIENTS {
        return Vec::new();
    }
    let p = DMatrix::from_fn(of.len(), of.len(), |i, j| covariance[(of[i], of[j])]);
    let eigen = p.symmetric_eigen();
    let mut order: Vec<usize> = (0..of.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let vector_of = |c: &NamedCombination| {
        DVector::from_fn(of.len(), |k, _| {
            let term = c.terms.iter().find(|t| t.name == estimated[of[k]].name);
            term.map_or(0.0, |t| t.weight)
        })
    };
    let mut basis: Vec<DVector<f64>> = Vec::new();
    for v in vertical.iter().map(vector_of) {
        let rest = basis.iter().fold(v.clone(), |rest, b| rest - b * b.dot(&v));
        basis.push(rest.normalize());
    }
    let principal = |&k: &usize| {
        let vector = eigen.eigenvectors.column(k).into_owned();
        let along: f64 = basis.iter().map(|b| b.dot(&vector).powi(2)).sum();
        PrincipalDrift {
            sigma: eigen.eigenvalues[k].max(0.0).sqrt(),
            vertical: along.sqrt().min(1.0),
            combination: of_parameters(estimated, &of, &vector, WRITTEN_OF_WEAK),
        }
    };
    order.iter().take(MOST).map(principal).collect()
}

/// Parameters `of` the estimated ones by these weights, shares in one unit of each.
fn of_parameters(
    estimated: &[Parameter],
    of: &[usize],
    vector: &DVector<f64>,
    written: f64,
) -> NamedCombination {
    let largest = vector.amax();
    let lead = vector
        .iter()
        .position(|v| v.abs() > 0.5 * largest)
        .unwrap_or(0);
    let terms = vector.iter().zip(of).filter(|(v, _)| **v != 0.0);
    NamedCombination {
        terms: terms
            .map(|(v, &j)| NamedTerm {
                name: estimated[j].name,
                unit: estimated[j].unit.name(),
                weight: v / vector[lead],
                share: v.abs() / largest,
            })
            .collect(),
        written,
    }
}
