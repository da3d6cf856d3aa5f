//! The majorant Δ(t) = f(t) diag(δ): the best of its family for a platform and a duration.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::MajorantInUse;
use super::conditions::{Cells, Conditions};
use super::profile::{profile_of_the_best, profiles};
use super::recursion::{Recursion, isotropic_holds};
use crate::drift::{CoefficientVector, DriftCoefficient, DriftKind};

/// How Δ was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Majorant {
    /// The vertical channel apart and the trace of the D_I marginalised.
    Separated,
    /// One number for the three channels, as if all of ψ^n were measured: for frame-hold
    /// repositioning, whose moves turn ψ^n, and where the former finds nothing.
    Isotropic,
}

impl Majorant {
    /// The name used in documents.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Separated => "separated",
            Self::Isotropic => "isotropic",
        }
    }
}

impl fmt::Display for Majorant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// M(schedule) ⪯ mass · ∫ Aᵀ diag(δ) A dμ for every schedule of the duration, μ the share of f(t)
/// spent at each attitude; on the complement of the trace when that is treated apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounded {
    pub kind: Majorant,
    /// δ for North, Up, East, relative to f.
    pub delta: [f64; 3],
    /// ∫ f dt, (°/h)⁻².
    pub mass: f64,
    /// Bound on tᵀMt, (°/h)⁻², when the trace is treated apart.
    pub trace_information: Option<f64>,
}

/// What the choice of δ is made for: the weights of the criterion on the parts of D that turn
/// into themselves under rotation, and the prior information on them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Emphasis {
    /// Constant drifts; antisymmetric and symmetric traceless part of the g-sensitive ones.
    weights: [f64; 3],
    prior: [f64; 3],
    choice: Choice,
}

/// Which majorants are looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Choice {
    /// The best one when every attitude is allowed.
    Free,
    /// The best one with δ_x = δ_z.
    Level,
    /// The best one when every attitude is allowed, and some with less δ_y: where only axis-aligned
    /// attitudes are allowed the vertical channel is all that tells the D_I apart.
    Lean,
}

impl Emphasis {
    /// For a criterion Σ w_i σ_i².
    pub fn new(conditions: &Conditions, weights: &CoefficientVector, choice: Choice) -> Self {
        let mut out = Self {
            weights: [0.0; 3],
            prior: [0.0; 3],
            choice,
        };
        let prior = conditions.prior_information();
        for c in DriftCoefficient::ALL {
            // Of each off-diagonal coefficient half is antisymmetric and half symmetric, of D_I
            // two thirds are traceless.
            let share = match c.kind() {
                DriftKind::Constant => [1.0, 0.0, 0.0],
                DriftKind::Input => [0.0, 0.0, 2.0 / 3.0],
                DriftKind::Output | DriftKind::Spin => [0.0, 0.5, 0.5],
            };
            if prior[c.index()].is_infinite() {
                continue;
            }
            for part in 0..3 {
                out.weights[part] += share[part] * weights[c.index()];
                out.prior[part] += share[part] * prior[c.index()] / [3.0, 3.0, 5.0][part];
            }
        }
        out
    }

    /// For the constant drifts alone, whatever is known of them before.
    pub fn on_constant_drift(choice: Choice) -> Self {
        Self {
            weights: [1.0, 0.0, 0.0],
            prior: [0.0; 3],
            choice,
        }
    }

    /// What the best design reaches by δ when every attitude is allowed: each part of D then
    /// gets the same information in all its directions.
    fn value(&self, delta: &[f64; 3], mass: f64) -> f64 {
        let [x, y, z] = *delta;
        let shares = [
            (x + y + z) / 3.0,
            (x + z) / 6.0,
            ((x + z) / 2.0 + 2.0 * y / 3.0) / 5.0,
        ];
        (0..3)
            .map(|part| self.weights[part] / (self.prior[part] + mass * shares[part]))
            .sum()
    }
}

/// Relative accuracy of the scale of δ.
const SCALE_ACCURACY: f64 = 2e-5;
/// The same while ratios are compared.
const COARSE_ACCURACY: f64 = 5e-4;
/// Splits of what sharing out the measurements costs that are tried.
const KAPPAS: [f64; 6] = [1e-5, 1e-4, 3e-4, 1e-3, 1e-2, 0.05];
/// Most factors of four that a scale is searched over.
const LONGEST_BRACKET: usize = 60;

/// The majorants found, the best for every attitude first; none when nothing is measured or
/// nothing holds.
pub(super) fn majorants(
    conditions: &Conditions,
    total_time_s: f64,
    emphasis: &Emphasis,
) -> Vec<Bounded> {
    let Some(cells) = Cells::new(conditions, total_time_s) else {
        return Vec::new();
    };
    let with = |profile| Recursion::new(conditions.clone(), cells, profile);
    let of_the_best = || with(profile_of_the_best(conditions, &cells));
    if conditions.frame_hold {
        return isotropic(&of_the_best(), None).into_iter().collect();
    }
    let recursions: Vec<Recursion> = profiles(conditions, &cells).into_iter().map(with).collect();
    let trace_apart = conditions.trace_direction().is_some();
    // It depends on no profile.
    let trace_information = trace_apart
        .then(|| recursions[0].trace_information())
        .filter(|i| i.is_finite());
    let mut best: Vec<Bounded> = Vec::new();
    for recursion in &recursions {
        let found = separated(recursion, emphasis, trace_information);
        let value = |all: &[Bounded]| {
            let first = all.first()?;
            Some((first.delta, emphasis.value(&first.delta, first.mass)))
        };
        if better(value(&found), value(&best)) {
            best = found;
        }
    }
    if best.is_empty() {
        // S is no more than the information with the trace known, which this majorises too.
        return isotropic(&of_the_best(), trace_information)
            .into_iter()
            .collect();
    }
    best
}

/// A majorant with its course in time: f(t) diag(δ), f constant in each cell.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shaped {
    kind: Majorant,
    /// δ for North, Up, East, relative to f.
    pub delta: [f64; 3],
    /// f of each cell, (°/h)⁻² s⁻¹.
    pub profile: Vec<f64>,
    pub cells: Cells,
}

impl Shaped {
    fn new(kind: Majorant, delta: [f64; 3], recursion: &Recursion) -> Self {
        Self {
            kind,
            delta,
            profile: recursion.profile.clone(),
            cells: recursion.cells,
        }
    }

    pub fn in_use(&self, total_time_s: f64) -> MajorantInUse {
        let inside = self.profile.iter().enumerate();
        let mass: f64 = inside.map(|(j, f)| f * self.cells.inside_s(j)).sum();
        MajorantInUse {
            kind: self.kind,
            delta: self.delta.map(|d| d * mass / total_time_s),
            trace_information: None,
        }
    }
}

/// Majorants of the information on the whole of u, each of which holds, those of the separated form
/// first: for what is not of twelve coefficients alone.
pub(super) fn shaped(
    conditions: &Conditions,
    total_time_s: f64,
    emphasis: &Emphasis,
) -> Vec<Shaped> {
    let Some(cells) = Cells::new(conditions, total_time_s) else {
        return Vec::new();
    };
    let with = |profile| Recursion::new(conditions.clone(), cells, profile);
    let mut found = Vec::new();
    if !conditions.frame_hold {
        // The trace stays unknown; what is known of it afterwards has no part in this.
        let unknown = conditions.trace_direction().map(|_| 0.0);
        for recursion in profiles(conditions, &cells).into_iter().map(with) {
            if let Some(bounded) = separated(&recursion, emphasis, unknown).first() {
                found.push(Shaped::new(bounded.kind, bounded.delta, &recursion));
            }
        }
    }
    let recursion = with(profile_of_the_best(conditions, &cells));
    let holds = |s: f64| isotropic_holds(&recursion, s);
    if let Some(scale) = smallest(1.0, SCALE_ACCURACY, holds) {
        found.push(Shaped::new(Majorant::Isotropic, [scale; 3], &recursion));
    }
    if conditions.drift_psd > 0.0 {
        // 𝓖 ⪯ 1/q, as below.
        found.push(Shaped {
            kind: Majorant::Isotropic,
            delta: [conditions.drift_psd.recip(); 3],
            profile: vec![1.0; cells.count],
            cells,
        });
    }
    found
}

fn separated(
    recursion: &Recursion,
    emphasis: &Emphasis,
    trace_information: Option<f64>,
) -> Vec<Bounded> {
    /// How much smaller than the best for every attitude δ_y is tried, as a logarithm.
    const LEANER: [f64; 5] = [-0.7, -1.4, -2.1, -2.8, -3.5];
    let prior = recursion.conditions.decoupled_prior_information();
    let known = prior[DriftCoefficient::IX.index()];
    let mut search = RatioSearch {
        recursion,
        emphasis,
        trace_variance: trace_information.map_or(0.0, |_| known.recip()),
        kappa: 1e-3,
        scale: 1.0,
    };
    let best = search.best();
    let mut found: Vec<[f64; 3]> = search.sharpest(best).into_iter().collect();
    if emphasis.choice == Choice::Lean {
        let leaner = LEANER.map(|by| search.sharpest([best[0] + by, best[1]]));
        found.extend(leaner.into_iter().flatten());
    }
    found
        .into_iter()
        .map(|delta| Bounded {
            kind: Majorant::Separated,
            delta,
            mass: recursion.mass,
            trace_information,
        })
        .collect()
}

/// Search for the ratios of δ, with the smallest scale that holds for each.
struct RatioSearch<'a> {
    recursion: &'a Recursion,
    emphasis: &'a Emphasis,
    /// Prior variance of the trace, or 0 where it counts as known.
    trace_variance: f64,
    kappa: f64,
    /// The last scale found: the next is near.
    scale: f64,
}

impl RatioSearch<'_> {
    /// Pattern search over ln δ_y/δ_x and ln δ_z/δ_x.
    fn best(&mut self) -> [f64; 2] {
        /// Furthest that δ_y may be from δ_x.
        const SPAN: f64 = 14.0;
        let mut at = [-2.0, 0.0];
        self.sharpest(at);
        let mut best = self.value(&at, COARSE_ACCURACY);
        let mut steps = [
            1.0,
            if self.emphasis.choice == Choice::Level {
                0.0
            } else {
                0.1
            },
        ];
        while steps[0] > 0.03 {
            let mut moved = false;
            for axis in 0..2 {
                for sign in [1.0, -1.0] {
                    let mut next = at;
                    next[axis] += sign * steps[axis];
                    if steps[axis] == 0.0 || next[axis].abs() > SPAN {
                        continue;
                    }
                    let value = self.value(&next, COARSE_ACCURACY);
                    if better(value, best) {
                        (at, best, moved) = (next, value, true);
                        break;
                    }
                }
            }
            if !moved {
                steps = steps.map(|s| 0.4 * s);
            }
        }
        at
    }

    /// δ for these ratios, with the split of the sampling's cost that suits it best, which is
    /// kept.
    fn sharpest(&mut self, at: [f64; 2]) -> Option<[f64; 3]> {
        let mut found: Option<([f64; 3], f64)> = None;
        let mut kept = self.kappa;
        for kappa in KAPPAS {
            self.kappa = kappa;
            let value = self.value(&at, SCALE_ACCURACY);
            if better(value, found) {
                (found, kept) = (value, kappa);
            }
        }
        self.kappa = kept;
        found.map(|(delta, _)| delta)
    }

    fn value(&mut self, at: &[f64; 2], accuracy: f64) -> Option<([f64; 3], f64)> {
        let ratios = [1.0, libm::exp(at[0]), libm::exp(at[1])];
        let (recursion, kappa) = (self.recursion, self.kappa);
        let (conditions, cells) = (&recursion.conditions, &recursion.cells);
        let wanted = self.trace_variance;
        let trace = recursion
            .sharing
            .trace_variance(conditions, cells, wanted, kappa);
        let holds = |s: f64| recursion.holds(&ratios.map(|r| r * s), trace, kappa);
        let scale = smallest(self.scale, accuracy, holds)?;
        self.scale = scale;
        let delta = ratios.map(|r| r * scale);
        Some((delta, self.emphasis.value(&delta, recursion.mass)))
    }
}

fn better(a: Option<([f64; 3], f64)>, b: Option<([f64; 3], f64)>) -> bool {
    match (a, b) {
        (Some((_, a)), Some((_, b))) => a > b * (1.0 + 1e-9),
        (Some(_), None) => true,
        _ => false,
    }
}

/// The smallest scale at which `holds` is seen to be true, from a guess, to a relative accuracy.
fn smallest(guess: f64, accuracy: f64, holds: impl Fn(f64) -> bool) -> Option<f64> {
    let mut step = 1.02;
    let (mut low, mut high) = (guess, guess);
    if holds(guess) {
        for _ in 0..LONGEST_BRACKET {
            low = high / step;
            if !holds(low) {
                break;
            }
            high = low;
            step = f64::min(step * step, 4.0);
        }
    } else {
        let mut found = false;
        for _ in 0..LONGEST_BRACKET {
            high = low * step;
            if holds(high) {
                found = true;
                break;
            }
            low = high;
            step = f64::min(step * step, 4.0);
        }
        if !found {
            return None;
        }
    }
    while high / low > 1.0 + accuracy {
        let middle = (high * low).sqrt();
        if holds(middle) {
            high = middle;
        } else {
            low = middle;
        }
    }
    Some(high)
}

fn isotropic(recursion: &Recursion, trace_information: Option<f64>) -> Option<Bounded> {
    let psd = recursion.conditions.drift_psd;
    let shaped = smallest(1.0, SCALE_ACCURACY, |s| isotropic_holds(recursion, s))
        .map(|scale| (scale, recursion.mass));
    // x = 0 in the variational form: 𝓖 ⪯ 1/q, whatever is measured and however ψ^n is turned.
    let flat = (psd > 0.0).then(|| (psd.recip(), recursion.cells.total_time_s));
    let (scale, mass) = [shaped, flat]
        .into_iter()
        .flatten()
        .min_by(|a, b| (a.0 * a.1).total_cmp(&(b.0 * b.1)))?;
    Some(Bounded {
        kind: Majorant::Isotropic,
        delta: [scale; 3],
        mass,
        trace_information,
    })
}
