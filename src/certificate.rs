//! The certificate: how accurate *any* schedule can be, without searching for one.
//!
//! The drift reaches the measurements only through u(t) = A(R(t)) D, so that the information a
//! schedule gives on D is M = ∫∫ A(s)ᵀ 𝓖(s, s') A(s') ds ds' with an operator 𝓖 that does not know
//! the attitudes. A diagonal majorant 𝓖 ⪯ Δ(t) = f(t) diag(δ_x, δ_y, δ_z) makes that
//!
//! ```text
//! M ⪯ ∫ A(R(t))ᵀ Δ(t) A(R(t)) dt,
//! ```
//!
//! which is linear in the share of time at each attitude: what is left is a convex design problem,
//! and its dual gives a number that no sequence of positions, no order, no turning motion and no
//! choice of measurement times can beat. `docs/certificate.md` has the proof of every step.
//!
//! 1. `majorant`: Δ, tested in O(N) by a Kalman filter with negative process noise
//!    (`recursion`), for every admissible set of measurement times at once (`sampling`).
//! 2. `design`: the convex design over the allowed attitudes (`directions`) and its dual, with
//!    a rigorous maximum over all of them (`largest`).
//! 3. `criteria`: what that says of `a`, `d`, `e`, `max-ratio`, and of each σ.
//!
//! ```
//! use scheme_opt::internals::certificate::Certifier;
//! use scheme_opt::internals::criterion::Criterion;
//! use scheme_opt::internals::platform::PlatformConfig;
//!
//! let certifier = Certifier::new(&PlatformConfig::default().check()?);
//! let bound = certifier.bound(&Criterion::rms(), 12_000.0)?;
//! // The best schedules known reach 0.000903 deg/h.
//! assert!(bound.lower_bound > 0.000855 && bound.lower_bound < 0.000903);
//! # Ok::<(), scheme_opt::Error>(())
//! ```

mod conditions;
mod criteria;
mod design;
mod directions;
mod largest;
mod majorant;
mod minimum_time;
mod profile;
#[cfg(test)]
mod proofs;
mod recursion;
mod remark;
mod riccati;
mod sampling;
mod wandering;

use nalgebra::DMatrix;
use rayon::prelude::*;

use crate::covariance::{CovarianceRoot, Rooted};
use crate::criterion::Criterion;
use crate::drift::{COEFFICIENTS, CoefficientVector, DriftCoefficient, DriftKind};
use crate::error::{Error, Result};
use crate::motion::MAX_FILTER_PERIODS;
use crate::observability::stand::Unseen;
use crate::platform::Platform;
use conditions::Conditions;
use criteria::{Bracket, Problem};
use design::Space;
use directions::{Allowed, Directions};
pub use majorant::Majorant;
use majorant::{Bounded, Choice, Emphasis, majorants};
pub use minimum_time::MinimumTime;
pub use remark::Remark;

/// Relative margin on every bound: rounding, and filter periods counted as whole when they are
/// so within 1e-9 of a period.
const MARGIN: f64 = 1e-6;
/// Prior information is raised to this part of what the test could give: a majorant that keeps
/// the design regular in double precision when a prior is next to nothing.
const LEAST_PRIOR: f64 = 1e-13;

/// Lower bounds for one platform. Cheap to share between threads.
#[derive(Debug)]
pub struct Certifier {
    conditions: Conditions,
    directions: Directions,
    /// Every attitude, where the gimbals are limited.
    unlimited: Option<Directions>,
    /// What no schedule on the stand can tell.
    unseen: Option<Unseen>,
}

/// What no schedule of a given duration can beat by one criterion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CriterionBound {
    /// Lower bound on the criterion's value, °/h (`max-ratio`: 1).
    pub lower_bound: f64,
    /// How much of the relaxed problem's own optimum is missing from the bound, relatively: the
    /// gap of the Kiefer–Wolfowitz equivalence theorem with the rigorous maximum over attitudes.
    pub equivalence_gap: f64,
    /// How information was majorised; none: nothing is measured in so short a test, and the
    /// bound is the prior itself.
    pub majorant: Option<MajorantInUse>,
    /// Whether it consists of what was known before the test of that which no schedule on this stand can
    /// tell.
    pub rests_on_priors: bool,
}

/// The majorant that a bound rests on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MajorantInUse {
    /// How it was found.
    pub kind: Majorant,
    /// Time mean of Δ for North, Up, East: no more information than this per second of the test
    /// comes from each channel's drift rate, (°/h)⁻² s⁻¹.
    pub delta: [f64; 3],
    /// Bound on the information on (D_IX + D_IY + D_IZ)/√3, the prior's included, (°/h)⁻²; none
    /// when that direction is not treated apart.
    pub trace_information: Option<f64>,
}

/// The full answer for one platform and duration.
#[derive(Debug, Clone, PartialEq)]
pub struct Bound {
    /// Duration that the bound is for, s: no schedule of this length or shorter beats it.
    pub total_time_s: f64,
    /// By the criterion asked for.
    pub criterion: CriterionBound,
    /// Lower bound on that criterion, °/h (`max-ratio`: 1).
    pub lower_bound: f64,
    /// Lower bound on the RMS σ, °/h.
    pub rms_sigma_deg_per_h: f64,
    /// Lower bound on each σ by itself, °/h: not all at once.
    pub sigma_deg_per_h: CoefficientVector,
    /// Groups of errors that the platform has and that the bound takes as known.
    pub taken_as_known: Vec<&'static str>,
    /// Keys of noise that wanders, which the platform has and the bound on the criterion leaves out.
    pub noise_left_out: Vec<&'static str>,
    /// What the bound does not cover or why it is weak.
    pub remarks: Vec<Remark>,
}

impl Certifier {
    /// For schedules on `platform`.
    pub fn new(platform: &Platform) -> Self {
        let directions = Directions::new(platform);
        let limited = matches!(directions.allowed, Allowed::Cover { .. });
        let conditions = Conditions::new(platform);
        Self {
            unseen: Unseen::new(platform, &conditions.prior_sigma),
            conditions,
            directions,
            unlimited: limited.then(Directions::unlimited),
        }
    }

    /// What no schedule of `total_time_s` or less, moves and settles included, can beat by
    /// `criterion`.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] for a duration that is not positive or has too many filter periods;
    /// [`Error::is_numerical`] where double precision does not suffice.
    pub fn criterion_bound(
        &self,
        criterion: &Criterion,
        total_time_s: f64,
    ) -> Result<CriterionBound> {
        self.check(total_time_s)?;
        // What other parameters add to a criterion is not negative, and is left out.
        let (criterion, factor) = criterion.of_the_coefficients();
        let white = self.of_white_noise(&criterion, total_time_s)?;
        let found = self.with_wandering(&criterion, white, total_time_s)?;
        let found = self.with_priors(&criterion, found);
        Ok(CriterionBound {
            lower_bound: found.lower_bound * factor,
            ..found
        })
    }

    /// No less than what was known before the test of that which no schedule on this stand can tell.
    fn with_priors(&self, criterion: &Criterion, found: CriterionBound) -> CriterionBound {
        let Some(unseen) = &self.unseen else {
            return found;
        };
        let p = &unseen.covariance;
        let variance = match criterion {
            Criterion::A { weights, .. } => weights.dot(&p.diagonal()) / weights.sum(),
            Criterion::E => p.symmetric_eigenvalues().max(),
            Criterion::MaxRatio { spec_deg_per_h, .. } => {
                let ratios = p.diagonal().component_div(&spec_deg_per_h.map(|s| s * s));
                ratios.max()
            }
            Criterion::Use { weight } => (weight * p).trace(),
            // The determinant has to do with the rest as well.
            Criterion::D => return found,
        };
        let lower_bound = variance.max(0.0).sqrt() * (1.0 - MARGIN);
        match lower_bound > found.lower_bound {
            true => CriterionBound {
                lower_bound,
                equivalence_gap: 0.0,
                majorant: found.majorant,
                rests_on_priors: true,
            },
            false => found,
        }
    }

    /// As if nothing wandered. `criterion` is of the twelve coefficients.
    fn of_white_noise(&self, criterion: &Criterion, total_time_s: f64) -> Result<CriterionBound> {
        if criterion.is_known(&self.conditions.prior_sigma) {
            return Ok(CriterionBound {
                lower_bound: 0.0,
                equivalence_gap: 0.0,
                majorant: None,
                rests_on_priors: false,
            });
        }
        let mut best: Option<CriterionBound> = None;
        for (directions, emphasis) in self.relaxations(criterion) {
            for bounded in majorants(&self.conditions, total_time_s, &emphasis) {
                let problem = self.problem(directions, bounded);
                let bracket = self.bracket(&problem, criterion)?;
                let found = finish(bracket, in_use(&problem, &bounded, total_time_s))?;
                match best {
                    // Majorants are in an order of one ratio: once the bound falls, those that follow
                    // go further the same way. (Each of them bounds by itself, so that leaving
                    // some out is never wrong.)
                    Some(b) if found.lower_bound < b.lower_bound => break,
                    // Equal bounds, as on index tables, say nothing about those that follow.
                    Some(b) if found.lower_bound == b.lower_bound => {}
                    _ => best = Some(found),
                }
            }
        }
        match best {
            Some(found) => Ok(found),
            None => self.without_majorant(criterion, total_time_s),
        }
    }

    /// What is tried, the largest bound being the answer: with the gimbals' limits, where the
    /// heading is not followed and North and East are taken alike; and as if there were none.
    fn relaxations(&self, criterion: &Criterion) -> Vec<(&Directions, Emphasis)> {
        let of = |directions: &Directions| {
            let choice = match directions.allowed {
                Allowed::Everything => Choice::Free,
                Allowed::Cover { .. } => Choice::Level,
                Allowed::Table(_) => Choice::Lean,
            };
            self.emphasis(criterion, choice)
        };
        let mut all = vec![(&self.directions, of(&self.directions))];
        if let Some(unlimited) = &self.unlimited {
            all.push((unlimited, of(unlimited)));
        }
        all
    }

    /// The same with a bound on the RMS σ and on each σ.
    ///
    /// # Errors
    ///
    /// As [`Certifier::criterion_bound`].
    pub fn bound(&self, criterion: &Criterion, total_time_s: f64) -> Result<Bound> {
        let of_criterion = self.criterion_bound(criterion, total_time_s)?;
        let rms = match criterion {
            c if *c == Criterion::rms() => of_criterion,
            _ => self.criterion_bound(&Criterion::rms(), total_time_s)?,
        };
        Ok(Bound {
            total_time_s,
            criterion: of_criterion,
            lower_bound: of_criterion.lower_bound,
            rms_sigma_deg_per_h: rms.lower_bound,
            sigma_deg_per_h: self.sigma_bounds(total_time_s)?,
            taken_as_known: self.conditions.taken_as_known.clone(),
            noise_left_out: self.noise_left_out(criterion),
            remarks: self.remarks(criterion, &of_criterion),
        })
    }

    /// Lower bound on each σ by itself, °/h.
    ///
    /// # Errors
    ///
    /// As [`Certifier::criterion_bound`].
    pub fn sigma_bounds(&self, total_time_s: f64) -> Result<CoefficientVector> {
        self.check(total_time_s)?;
        let white = self.sigma_of_white_noise(total_time_s)?;
        let found = self.sigma_with_wandering(white, total_time_s);
        let Some(unseen) = &self.unseen else {
            return Ok(found);
        };
        let left = unseen.covariance.diagonal();
        let sigma = |i: usize| left[i].sqrt() * (1.0 - MARGIN);
        Ok(CoefficientVector::from_fn(|i, _| found[i].max(sigma(i))))
    }

    fn sigma_of_white_noise(&self, total_time_s: f64) -> Result<CoefficientVector> {
        if self.conditions.prior_sigma.max() == 0.0 {
            return Ok(CoefficientVector::zeros());
        }
        let (directions, emphasis) = self.relaxations(&Criterion::rms())[0];
        let found = majorants(&self.conditions, total_time_s, &emphasis);
        let Some(bounded) = found.first() else {
            return match self.is_measured(total_time_s) {
                true => Ok(CoefficientVector::zeros()),
                false => Ok(self.conditions.prior_sigma),
            };
        };
        let problem = self.problem(directions, *bounded);
        let sigmas: Result<Vec<f64>> = (0..COEFFICIENTS)
            .into_par_iter()
            .map(|i| {
                let sigma = problem.variance(i)?.max(0.0).sqrt() * (1.0 - MARGIN);
                // The prior's own σ bounds nothing from below; rounding must not show.
                Ok(sigma.min(self.conditions.prior_sigma[i]))
            })
            .collect();
        Ok(CoefficientVector::from_vec(sigmas?))
    }

    fn check(&self, total_time_s: f64) -> Result<()> {
        const KEY: &str = "objective.total_time_s";
        if total_time_s.is_nan() || total_time_s <= 0.0 {
            return Err(Error::out_of_range(KEY, total_time_s, "greater than 0"));
        }
        if total_time_s / self.conditions.period_s > MAX_FILTER_PERIODS {
            return Err(Error::input("the test has too many filter periods")
                .with_key(KEY)
                .with_value(total_time_s)
                .with_allowed(format!("at most {MAX_FILTER_PERIODS:e} filter periods")));
        }
        Ok(())
    }

    fn is_measured(&self, total_time_s: f64) -> bool {
        conditions::Cells::new(&self.conditions, total_time_s).is_some()
    }

    fn emphasis(&self, criterion: &Criterion, choice: Choice) -> Emphasis {
        let weights = match criterion {
            Criterion::A { weights, .. } => *weights,
            Criterion::MaxRatio { spec_deg_per_h, .. } => spec_deg_per_h.map(|s| (s * s).recip()),
            Criterion::Use { weight } => CoefficientVector::from_fn(|i, _| weight[(i, i)]),
            Criterion::D | Criterion::E => CoefficientVector::repeat(1.0),
        };
        Emphasis::new(&self.conditions, &weights, choice)
    }

    /// The design problem that a majorant leaves.
    fn problem<'a>(&'a self, directions: &'a Directions, bounded: Bounded) -> Problem<'a> {
        let conditions = &self.conditions;
        let (information, trace) = match (bounded.trace_information, conditions.trace_direction()) {
            (Some(measured), Some(t)) => {
                let prior = conditions.decoupled_prior_information();
                // The three D_I have the same, so t has it too.
                (
                    prior,
                    Some((t, prior[DriftCoefficient::IX.index()] + measured)),
                )
            }
            _ => (conditions.prior_information(), None),
        };
        let [x, y, z] = bounded.delta;
        let least = LEAST_PRIOR * bounded.mass * x.max(y).max(z);
        let information = information.map(|v| v.max(least));
        let direction = trace.as_ref().map(|(t, _)| t);
        Problem {
            space: Space::new(
                directions,
                bounded,
                &information,
                direction,
                conditions.mixing.as_ref(),
            ),
            trace,
        }
    }

    /// The bracket on the criterion's value itself.
    fn bracket(
        &self,
        problem: &Problem<'_>,
        criterion: &Criterion,
    ) -> Result<(Bracket, BracketScale)> {
        let open = self.conditions.prior_sigma.iter().filter(|s| **s > 0.0);
        let open = open.count() as f64;
        Ok(match criterion {
            Criterion::A { weights, .. } => {
                let bracket = problem.weighted_variance(weights)?;
                (bracket, BracketScale::Variance(weights.sum()))
            }
            Criterion::D => (
                problem.log_determinant()?,
                BracketScale::LogDeterminant(open),
            ),
            Criterion::E => (problem.worst_variance()?, BracketScale::Variance(1.0)),
            Criterion::Use { weight } => (
                problem.weighted_by(&weight_root(weight))?,
                BracketScale::Variance(1.0),
            ),
            Criterion::MaxRatio { spec_deg_per_h, .. } => (
                problem.worst_ratio(spec_deg_per_h)?,
                BracketScale::Variance(1.0),
            ),
        })
    }

    /// Where nothing is measured the prior is the answer; where no majorant was found, zero.
    fn without_majorant(&self, criterion: &Criterion, total_time_s: f64) -> Result<CriterionBound> {
        let lower_bound = if self.is_measured(total_time_s) {
            0.0
        } else {
            let sigma = &self.conditions.prior_sigma;
            let prior = Rooted::new(CovarianceRoot::independent(sigma));
            criterion.value(&prior)? * (1.0 - MARGIN)
        };
        Ok(CriterionBound {
            lower_bound,
            equivalence_gap: 0.0,
            majorant: None,
            rests_on_priors: false,
        })
    }

    /// Which errors of the platform the bound on `criterion` takes as known, and what it makes of noise
    /// that wanders, if any.
    pub fn taken_as_known(&self, criterion: &Criterion) -> impl Iterator<Item = Remark> + use<> {
        let groups = &self.conditions.taken_as_known;
        let known = (!groups.is_empty()).then(|| Remark::TakenAsKnown(groups.clone()));
        let wandering = match criterion {
            Criterion::Use { .. } => {
                let left_out = !self.noise_left_out(criterion).is_empty();
                [left_out.then_some(Remark::WanderingLeftOut), None]
            }
            _ => {
                let drift = !self.conditions.drift_that_wanders.is_empty();
                let biases = !self.conditions.biases_that_wander.is_empty();
                [
                    drift.then_some(Remark::WanderingInConstantDrift),
                    biases.then_some(Remark::BiasesLeftOut),
                ]
            }
        };
        known.into_iter().chain(wandering.into_iter().flatten())
    }

    /// Keys of noise that wanders which has no part in the bound on `criterion`.
    fn noise_left_out(&self, criterion: &Criterion) -> Vec<&'static str> {
        let (drift, biases) = (
            &self.conditions.drift_that_wanders,
            &self.conditions.biases_that_wander,
        );
        match criterion {
            Criterion::Use { .. } => drift.iter().chain(biases).copied().collect(),
            _ => biases.clone(),
        }
    }

    /// Whether a drift that the criterion counts, and that is known before, is not at the end.
    fn known_wanders(&self, criterion: &Criterion) -> bool {
        let walks = self.conditions.drift_colour.random_walk.is_some();
        let known = |c: &DriftCoefficient| self.conditions.prior_sigma[c.index()] == 0.0;
        let mut counted = DriftCoefficient::ALL
            .into_iter()
            .filter(|c| c.kind() == DriftKind::Constant && criterion.counts(*c));
        walks && counted.any(|c| known(&c))
    }

    /// What a reader of the bound on `criterion` should know: what it does not cover, why it is
    /// weak.
    pub fn remarks(&self, criterion: &Criterion, bound: &CriterionBound) -> Vec<Remark> {
        let known = criterion.known_before(&self.conditions.prior_sigma);
        let known_wanders = self.known_wanders(criterion);
        if let Some(known) = known.filter(|_| !known_wanders) {
            return vec![Remark::KnownBefore(known)];
        }
        if criterion.counts_only_others() {
            let remarks = [Remark::OnlyOthers].into_iter();
            return remarks.chain(self.taken_as_known(criterion)).collect();
        }
        let on_priors = self.unseen.as_ref().filter(|_| bound.rests_on_priors);
        let weak = match bound.majorant.map(|m| m.kind) {
            _ if on_priors.is_some() => on_priors.map(Remark::on_priors),
            _ if bound.lower_bound == 0.0 && known_wanders => Some(Remark::KnownAndWanders),
            None if bound.lower_bound > 0.0 => Some(Remark::PriorItself),
            None => Some(Remark::NoMajorant),
            Some(Majorant::Isotropic) if self.conditions.frame_hold => Some(Remark::FrameHold),
            Some(Majorant::Isotropic) if self.conditions.azimuth_variance.is_some() => {
                Some(Remark::MeasuredLikeTheBest)
            }
            Some(Majorant::Isotropic) => Some(Remark::IsotropicMajorant),
            Some(Majorant::Separated) => None,
        };
        let on_table = matches!(self.directions.allowed, Allowed::Table(_));
        let at_pole =
            self.conditions.omega_north == 0.0 && self.conditions.azimuth_variance.is_none();
        weak.into_iter()
            .chain(self.taken_as_known(criterion))
            .chain(on_table.then_some(Remark::IndexTable))
            .chain((at_pole && on_priors.is_none()).then_some(Remark::Pole))
            .collect()
    }
}

/// How a bracket becomes the criterion's value.
enum BracketScale {
    /// √(v/weight).
    Variance(f64),
    /// exp(v/2n).
    LogDeterminant(f64),
}

/// R with W = R Rᵀ, W positive semidefinite.
fn weight_root(weight: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = weight.clone().symmetric_eigen();
    let mut root = eigen.eigenvectors;
    for (mut column, value) in root.column_iter_mut().zip(eigen.eigenvalues.iter()) {
        column *= value.max(0.0).sqrt();
    }
    root
}

fn finish(
    (bracket, scale): (Bracket, BracketScale),
    majorant: MajorantInUse,
) -> Result<CriterionBound> {
    let value = |v: f64| match scale {
        BracketScale::Variance(weight) => (v.max(0.0) / weight).sqrt(),
        BracketScale::LogDeterminant(count) => libm::exp(v / (2.0 * count)),
    };
    let (lower, design) = (value(bracket.lower), value(bracket.design));
    if !lower.is_finite() {
        return Err(Error::numerical(
            "the bound overflows double precision: the noises, the prior and the duration are \
             too far apart",
        ));
    }
    Ok(CriterionBound {
        lower_bound: lower * (1.0 - MARGIN),
        equivalence_gap: if design > 0.0 {
            (1.0 - lower / design).max(0.0)
        } else {
            0.0
        },
        majorant: Some(majorant),
        rests_on_priors: false,
    })
}

fn in_use(problem: &Problem<'_>, bounded: &Bounded, total_time_s: f64) -> MajorantInUse {
    MajorantInUse {
        kind: bounded.kind,
        delta: bounded.delta.map(|d| d * bounded.mass / total_time_s),
        trace_information: problem.trace.as_ref().map(|(_, kappa)| *kappa),
    }
}
