//! The convex design: how the time is best spent, if M were mass · ∫ AᵀΔA dμ.
//!
//! Over probability measures μ on the allowed attitudes, with S(μ) = Λ + mass ∫ AᵀΔA dμ on the
//! directions of D that are treated together, the least tr(Yᵀ S⁻¹ Y) (or the largest det S) is
//! wanted, from *below*. By convexity, for any K and any X ≻ 0,
//!
//! ```text
//! tr(YᵀS⁻¹Y) ≥ tr(KᵀY)² / (tr KᵀΛK + mass · max φ),      φ(R) = tr(A(R)ᵀ Δ A(R) K Kᵀ)
//! ln det S   ≤ −ln det X + n ln((tr XΛ + mass · max φ)/n),  φ with X in place of K Kᵀ
//! ```
//!
//! whatever K and X are: an optimum only makes them sharp (the equivalence theorem of Kiefer and
//! Wolfowitz). They come from a multiplicative algorithm on a small set of attitudes, into which
//! the maximum of φ over the whole grid is taken as long as that helps. The maximum over *all*
//! attitudes follows from the grid's by [`largest`](super::largest).

use nalgebra::{DMatrix, Vector3};

use super::directions::{Allowed, Directions, Sphere};
use super::largest::{Attitudes, Peak};
use super::majorant::Bounded;
use crate::attitude::Attitude;
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector, drift_matrix};
use crate::error::{Error, Result};

/// The design's directions of D, its prior information, and the attitudes.
#[derive(Debug)]
pub(super) struct Space<'a> {
    /// Orthonormal columns: what is left when known coefficients and the trace are taken out.
    pub basis: DMatrix<f64>,
    /// The same directions as coefficients of the paper's mounting, in which A is written.
    in_papers_mounting: DMatrix<f64>,
    /// Prior information on them.
    pub prior: DMatrix<f64>,
    pub bounded: Bounded,
    pub attitudes: Attitudes<'a>,
    /// Attitudes a design starts from, each as its scaled rows √(mass δ) A U.
    start: Vec<ScaledRows>,
}

/// Rows of one attitude, so that its information is RᵀR.
type ScaledRows = DMatrix<f64>;

/// Spacing of the directions a design starts from, rad.
const START_SPACING: f64 = 0.26;
/// Most attitudes of a table a design starts from.
const LARGEST_START: usize = 600;
/// Iterations between two looks at the whole grid, and how often that is done.
const ITERATIONS: usize = 60;
pub(super) const ROUNDS: usize = 12;
/// A design is good enough when its bound is this close to its value, relatively.
const GAP: f64 = 5e-4;
/// Attitudes with less of the time than this part of an equal share are dropped.
const NEGLIGIBLE: f64 = 1e-5;

/// What a design is to be good for.
pub(super) trait Goal {
    /// Takes note of S⁻¹ and gives K, the factor of the derivative K Kᵀ.
    fn factor(&mut self, inverse: &DMatrix<f64>) -> DMatrix<f64>;
    /// The exponent of the multiplicative step.
    fn exponent(&self) -> f64;
    /// Whether the goal itself has stopped moving.
    fn is_settled(&self) -> bool {
        true
    }
}

/// The end of a design.
#[derive(Debug, Clone)]
pub(super) struct Designed {
    /// S⁻¹ of the best design.
    pub inverse: DMatrix<f64>,
    /// K for it.
    pub factor: DMatrix<f64>,
    /// mass · max φ over all allowed attitudes, an upper bound.
    pub largest: f64,
}

impl<'a> Space<'a> {
    /// `information`: of the prior; infinite entries are known coefficients and left out, as is
    /// the direction `trace`. `mixing` turns A of the paper's mounting into that of the platform;
    /// none: it is the paper's.
    pub fn new(
        directions: &'a Directions,
        bounded: Bounded,
        information: &CoefficientVector,
        trace: Option<&CoefficientVector>,
        mixing: Option<&CoefficientMatrix>,
    ) -> Self {
        let basis = complement(information, trace);
        let in_papers_mounting = match mixing {
            None => basis.clone(),
            Some(mixing) => {
                DMatrix::from_fn(COEFFICIENTS, COEFFICIENTS, |i, j| mixing[(i, j)]) * &basis
            }
        };
        let finite = information.map(|v| if v.is_finite() { v } else { 0.0 });
        let full = DMatrix::from_diagonal(&nalgebra::DVector::from_column_slice(finite.as_slice()));
        let mut space = Self {
            prior: basis.transpose() * full * &basis,
            basis,
            in_papers_mounting,
            bounded,
            attitudes: Attitudes::new(directions, bounded.delta),
            start: Vec::new(),
        };
        space.start = starting_attitudes(directions)
            .iter()
            .map(|a| space.rows(a))
            .collect();
        space
    }

    /// How many directions of D.
    pub fn size(&self) -> usize {
        self.basis.ncols()
    }

    /// Whether every attitude is allowed.
    pub fn every_attitude(&self) -> bool {
        self.attitudes.every_attitude()
    }

    fn rows(&self, attitude: &Attitude) -> ScaledRows {
        let a = drift_matrix(attitude);
        let scaled = DMatrix::from_fn(3, COEFFICIENTS, |i, j| {
            (self.bounded.mass * self.bounded.delta[i]).sqrt() * a[(i, j)]
        });
        scaled * &self.in_papers_mounting
    }

    /// mass · φ's upper bound over all allowed attitudes, and where its largest value was seen.
    pub fn peak(&self, factor: &DMatrix<f64>, rigorous: bool) -> Peak {
        let spread = &self.in_papers_mounting * factor;
        let square = &spread * spread.transpose();
        let b = CoefficientMatrix::from_fn(|i, j| square[(i, j)]);
        let mut peak = self.attitudes.peak(&b, rigorous);
        peak.value *= self.bounded.mass;
        peak
    }

    /// The best design for `goal`, at most `most_rounds` looks at the whole grid.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] when the information is too far from regular for double
    /// precision.
    pub fn optimise(&self, goal: &mut dyn Goal, most_rounds: usize) -> Result<Designed> {
        let mut design = Design {
            space: self,
            rows: self.start.clone(),
            weights: vec![1.0 / self.start.len() as f64; self.start.len()],
        };
        let mut rounds = 0;
        loop {
            let (inverse, factor) = design.iterate(goal)?;
            rounds += 1;
            let peak = self.peak(&factor, false);
            let prior = prior_part(&factor, &self.prior);
            let mean = design.mean(&factor);
            let near = (prior + peak.value) * (1.0 - GAP) <= prior + mean;
            if rounds >= most_rounds || (near && goal.is_settled()) {
                let peak = self.peak(&factor, true);
                return Ok(Designed {
                    inverse,
                    factor,
                    largest: peak.value,
                });
            }
            design.admit(&peak);
        }
    }
}

/// tr KᵀΛK.
pub(super) fn prior_part(factor: &DMatrix<f64>, prior: &DMatrix<f64>) -> f64 {
    factor.dot(&(prior * factor))
}

/// Weights on attitudes.
struct Design<'a> {
    space: &'a Space<'a>,
    rows: Vec<ScaledRows>,
    weights: Vec<f64>,
}

impl Design<'_> {
    /// Multiplicative steps w ← w (φ/φ̄)^γ: S⁻¹ and K of the last.
    fn iterate(&mut self, goal: &mut dyn Goal) -> Result<(DMatrix<f64>, DMatrix<f64>)> {
        let mut state = self.state(goal)?;
        for _ in 0..ITERATIONS {
            let values: Vec<f64> = self.values(&state.1);
            let mean: f64 = values.iter().zip(&self.weights).map(|(v, w)| v * w).sum();
            let top = values.iter().copied().fold(0.0, f64::max);
            let prior = prior_part(&state.1, &self.space.prior);
            let near = (prior + top) * (1.0 - 0.5 * GAP) <= prior + mean;
            if mean <= 0.0 || (near && goal.is_settled()) {
                break;
            }
            for (w, v) in self.weights.iter_mut().zip(&values) {
                *w *= libm::pow(v / mean, goal.exponent());
            }
            self.normalise();
            state = self.state(goal)?;
        }
        Ok(state)
    }

    fn state(&self, goal: &mut dyn Goal) -> Result<(DMatrix<f64>, DMatrix<f64>)> {
        let mut information = self.space.prior.clone();
        for (rows, weight) in self.rows.iter().zip(&self.weights) {
            information.gemm_tr(*weight, rows, rows, 1.0);
        }
        let inverse = invert(&information)?;
        let factor = goal.factor(&inverse);
        Ok((inverse, factor))
    }

    fn values(&self, factor: &DMatrix<f64>) -> Vec<f64> {
        let square = factor * factor.transpose();
        let value = |rows: &ScaledRows| rows.dot(&(rows * &square));
        self.rows.iter().map(value).collect()
    }

    fn mean(&self, factor: &DMatrix<f64>) -> f64 {
        let values = self.values(factor);
        values.iter().zip(&self.weights).map(|(v, w)| v * w).sum()
    }

    fn normalise(&mut self) {
        let sum: f64 = self.weights.iter().sum();
        let count = self.weights.len() as f64;
        let keep: Vec<bool> = self
            .weights
            .iter()
            .map(|w| w / sum > NEGLIGIBLE / count)
            .collect();
        let mut kept = keep.iter();
        self.rows.retain(|_| *kept.next().unwrap_or(&true));
        let mut kept = keep.iter();
        self.weights.retain(|_| *kept.next().unwrap_or(&true));
        let sum: f64 = self.weights.iter().sum();
        for w in &mut self.weights {
            *w /= sum;
        }
    }

    /// Takes the attitudes of the peak in, with a small part of the time each.
    fn admit(&mut self, peak: &Peak) {
        let share = 0.1 / peak.places.len().max(1) as f64;
        for place in &peak.places {
            self.rows.push(self.space.rows(place));
            self.weights.push(share);
        }
        self.normalise();
    }
}

/// The inverse of a positive definite matrix, scaled to a unit diagonal first.
fn invert(information: &DMatrix<f64>) -> Result<DMatrix<f64>> {
    let scale = information.diagonal().map(|d| d.sqrt().recip());
    let scaled = DMatrix::from_fn(information.nrows(), information.ncols(), |i, j| {
        information[(i, j)] * scale[i] * scale[j]
    });
    let cholesky = nalgebra::Cholesky::new(scaled).ok_or_else(|| {
        Error::numerical(
            "the bound's information matrix is singular in double precision: the prior is too \
             weak for what the allowed attitudes leave open",
        )
    })?;
    let mut inverse = cholesky.inverse();
    for i in 0..inverse.nrows() {
        for j in 0..inverse.ncols() {
            inverse[(i, j)] *= scale[i] * scale[j];
        }
    }
    Ok(inverse)
}

/// Orthonormal columns that span the open coefficients but for `trace`: unit vectors outside the
/// trace, Helmert's contrasts inside.
fn complement(information: &CoefficientVector, trace: Option<&CoefficientVector>) -> DMatrix<f64> {
    let inside = |i: usize| trace.is_some_and(|t| t[i] != 0.0);
    let mut columns: Vec<CoefficientVector> = Vec::new();
    for i in (0..COEFFICIENTS).filter(|&i| information[i].is_finite() && !inside(i)) {
        let mut unit = CoefficientVector::zeros();
        unit[i] = 1.0;
        columns.push(unit);
    }
    let members: Vec<usize> = (0..COEFFICIENTS).filter(|&i| inside(i)).collect();
    for k in 1..members.len() {
        let mut contrast = CoefficientVector::zeros();
        for &i in &members[..k] {
            contrast[i] = 1.0;
        }
        contrast[members[k]] = -(k as f64);
        columns.push(contrast.normalize());
    }
    DMatrix::from_fn(COEFFICIENTS, columns.len(), |i, j| columns[j][i])
}

/// Attitudes that a design starts from: allowed directions, three headings each.
fn starting_attitudes(directions: &Directions) -> Vec<Attitude> {
    let turned = |d: &Vector3<f64>| {
        let third = std::f64::consts::FRAC_PI_3;
        [0.0, third, 2.0 * third].map(|h| Attitude::with_gravity_along(*d, h))
    };
    match &directions.allowed {
        Allowed::Everything => Sphere::new(START_SPACING)
            .directions
            .iter()
            .flat_map(turned)
            .flatten()
            .collect(),
        Allowed::Cover { directions, .. } => {
            let stride = (3 * directions.len()).div_ceil(LARGEST_START).max(1);
            directions
                .iter()
                .step_by(stride)
                .flat_map(turned)
                .flatten()
                .collect()
        }
        Allowed::Table(attitudes) => {
            let stride = attitudes.len().div_ceil(LARGEST_START).max(1);
            attitudes.iter().step_by(stride).copied().collect()
        }
    }
}
