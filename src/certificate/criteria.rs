//! From the design problem to the criteria: lower bounds on functions of P_D.
//!
//! With t treated apart, E = Λ + M, κ = tᵀEt and S the Schur complement of κ in E,
//!
//! ```text
//! tr(W P) ≥ ‖W^{1/2} t‖²/κ + tr(Yᵀ S⁻¹ Y),   Y = Uᵀ W^{1/2} (I − c cᵀ),  c = W^{1/2} t/‖W^{1/2} t‖,
//! ln det P = −ln κ − ln det S,   λ_max(P) ≥ max(1/κ, λ_max(S⁻¹)),
//! max_i P_ii/s_i² ≥ Σ_i w_i P_ii/s_i² for any weights w ≥ 0 with sum 1.
//! ```

use nalgebra::{DMatrix, DVector};

use super::design::{Designed, Goal, ROUNDS, Space, prior_part};

use crate::drift::{COEFFICIENTS, CoefficientVector};
use crate::error::{Error, Result};

/// A design problem with what is known of the trace.
#[derive(Debug)]
pub(super) struct Problem<'a> {
    pub space: Space<'a>,
    /// t and the bound on κ, when it is treated apart.
    pub trace: Option<(CoefficientVector, f64)>,
}

/// A lower bound, and the value that the best design found has in the same relaxation: no bound
/// of this majorant can be above it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bracket {
    pub lower: f64,
    pub design: f64,
}

impl Bracket {
    fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Self {
            lower: f(self.lower),
            design: f(self.design),
        }
    }
}

impl Problem<'_> {
    /// Σ w_i P_ii.
    pub fn weighted_variance(&self, weights: &CoefficientVector) -> Result<Bracket> {
        let (y, fixed) = self.target(weights);
        let rest = self.linear(y, ROUNDS)?;
        Ok(rest.map(|v| v + fixed))
    }

    /// P_ii for one coefficient. Where every attitude is allowed K ∝ the coefficient itself is as
    /// good as any; elsewhere a design may do better.
    pub fn variance(&self, index: usize) -> Result<f64> {
        let mut weights = CoefficientVector::zeros();
        weights[index] = 1.0;
        let (y, fixed) = self.target(&weights);
        if y.amax() == 0.0 {
            return Ok(fixed);
        }
        let peak = self.space.peak(&y, true);
        let plain = y.dot(&y).powi(2) / (prior_part(&y, &self.space.prior) + peak.value);
        if self.space.every_attitude() {
            return Ok(fixed + plain);
        }
        /// Enough for a bound on one σ, of which there are many.
        const FEW_ROUNDS: usize = 3;
        Ok(fixed + self.linear(y, FEW_ROUNDS)?.lower.max(plain))
    }

    /// Y and ‖W^{1/2} t‖²/κ for W = diag(weights).
    pub fn target(&self, weights: &CoefficientVector) -> (DMatrix<f64>, f64) {
        let root = DVector::from_iterator(COEFFICIENTS, weights.iter().map(|w| w.sqrt()));
        self.target_by(&DMatrix::from_diagonal(&root))
    }

    /// tr(W P) for W = R Rᵀ, `root` = R.
    pub fn weighted_by(&self, root: &DMatrix<f64>) -> Result<Bracket> {
        let (y, fixed) = self.target_by(root);
        let rest = self.linear(y, ROUNDS)?;
        Ok(rest.map(|v| v + fixed))
    }

    /// The same as [`Problem::target`] for W = R Rᵀ: with R in the place of W^{1/2}, c = Rᵀ t, the
    /// direction R c/‖c‖ is bounded by P ⪰ t tᵀ/κ, and the others are none of t's.
    fn target_by(&self, root: &DMatrix<f64>) -> (DMatrix<f64>, f64) {
        let mut projected = root.clone();
        let mut fixed = 0.0;
        if let Some((t, kappa)) = &self.trace {
            let c = root.tr_mul(t);
            let square = c.norm_squared();
            if square > 0.0 {
                // R (I − c cᵀ/‖c‖²).
                projected -= root * &c * c.transpose() / square;
                fixed = square / kappa;
            }
        }
        (self.space.basis.transpose() * projected, fixed)
    }

    /// tr(Yᵀ S⁻¹ Y).
    fn linear(&self, y: DMatrix<f64>, rounds: usize) -> Result<Bracket> {
        if self.space.size() == 0 || y.amax() == 0.0 {
            return Ok(Bracket {
                lower: 0.0,
                design: 0.0,
            });
        }
        let mut goal = Linear { y };
        let designed = self.space.optimise(&mut goal, rounds)?;
        Ok(self.linear_bracket(&designed, &goal.y))
    }

    fn linear_bracket(&self, designed: &Designed, y: &DMatrix<f64>) -> Bracket {
        let square = designed.factor.dot(y).powi(2);
        let spent = prior_part(&designed.factor, &self.space.prior) + designed.largest;
        Bracket {
            lower: square / spent,
            design: y.dot(&(&designed.inverse * y)),
        }
    }

    /// ln det P over the open coefficients.
    pub fn log_determinant(&self) -> Result<Bracket> {
        let fixed = self
            .trace
            .as_ref()
            .map_or(0.0, |(_, kappa)| -libm::log(*kappa));
        if self.space.size() == 0 {
            return Ok(Bracket {
                lower: fixed,
                design: fixed,
            });
        }
        let designed = self.space.optimise(&mut Determinant, ROUNDS)?;
        let count = self.space.size() as f64;
        let log = log_determinant(&designed.inverse)?;
        let spent = prior_part(&designed.factor, &self.space.prior) + designed.largest;
        Ok(Bracket {
            lower: fixed + log - count * libm::log(spent / count),
            design: fixed + log,
        })
    }

    /// λ_max(P).
    pub fn worst_variance(&self) -> Result<Bracket> {
        let alone = self.trace.as_ref().map_or(0.0, |(_, kappa)| kappa.recip());
        if self.space.size() == 0 {
            return Ok(Bracket {
                lower: alone,
                design: alone,
            });
        }
        let size = self.space.size();
        let mut goal = WorstDirection {
            y: DMatrix::identity(size, size),
        };
        let designed = self.space.optimise(&mut goal, ROUNDS)?;
        let rest = self.linear_bracket(&designed, &goal.y);
        let largest = designed.inverse.symmetric_eigenvalues().max();
        Ok(Bracket {
            lower: alone.max(rest.lower),
            design: alone.max(largest),
        })
    }

    /// max P_ii/s_i² over the finite `spec`.
    pub fn worst_ratio(&self, spec: &CoefficientVector) -> Result<Bracket> {
        let asked: Vec<usize> = (0..COEFFICIENTS).filter(|&i| spec[i].is_finite()).collect();
        let nothing = Bracket {
            lower: 0.0,
            design: 0.0,
        };
        if asked.is_empty() {
            return Ok(nothing);
        }
        if self.space.size() == 0 {
            let ratios = self.ratios(spec, None);
            let (lower, design) = (ratios.max(), ratios.max());
            return Ok(Bracket { lower, design });
        }
        let mut weights = CoefficientVector::zeros();
        for i in &asked {
            weights[*i] = 1.0 / asked.len() as f64;
        }
        let mut goal = WorstRatio {
            problem: self,
            spec,
            weights,
            y: DMatrix::zeros(0, 0),
            settled: false,
        };
        let designed = self.space.optimise(&mut goal, ROUNDS)?;
        let (y, fixed) = self.target(&goal.variance_weights());
        let rest = self.linear_bracket(&designed, &y);
        Ok(Bracket {
            lower: rest.lower + fixed,
            design: self
                .ratios(spec, Some((&designed.inverse, &goal.weights)))
                .max(),
        })
    }

    /// P_ii/s_i² for S⁻¹ and the cross terms with t that are best for the weights.
    fn ratios(
        &self,
        spec: &CoefficientVector,
        design: Option<(&DMatrix<f64>, &CoefficientVector)>,
    ) -> CoefficientVector {
        let mut variances = CoefficientVector::zeros();
        let mut spread = self.space.basis.clone();
        if let Some((t, kappa)) = &self.trace {
            for i in 0..COEFFICIENTS {
                variances[i] += t[i] * t[i] / kappa;
            }
            if let Some((_, weights)) = design {
                let scaled = weights.component_div(&spec.component_mul(spec));
                let weighted = t.component_mul(&scaled);
                let square = weighted.dot(t);
                if square > 0.0 {
                    let t = DVector::from_column_slice(t.as_slice());
                    let weighted = DVector::from_column_slice(weighted.as_slice());
                    spread -= t * (weighted.transpose() * &self.space.basis) / square;
                }
            }
        }
        if let Some((inverse, _)) = design {
            let product = &spread * inverse;
            for i in 0..COEFFICIENTS {
                variances[i] += product.row(i).dot(&spread.row(i));
            }
        }
        CoefficientVector::from_fn(|i, _| variances[i] / (spec[i] * spec[i]))
    }
}

fn log_determinant(matrix: &DMatrix<f64>) -> Result<f64> {
    let cholesky = nalgebra::Cholesky::new(matrix.clone()).ok_or_else(|| {
        Error::numerical("the bound's design matrix is singular in double precision")
    })?;
    Ok(crate::criterion::log_determinant(&cholesky))
}

/// tr(Yᵀ S⁻¹ Y).
struct Linear {
    y: DMatrix<f64>,
}

impl Goal for Linear {
    fn factor(&mut self, inverse: &DMatrix<f64>) -> DMatrix<f64> {
        inverse * &self.y
    }
    fn exponent(&self) -> f64 {
        0.5
    }
}

/// det S.
struct Determinant;

impl Goal for Determinant {
    fn factor(&mut self, inverse: &DMatrix<f64>) -> DMatrix<f64> {
        root(inverse)
    }
    fn exponent(&self) -> f64 {
        1.0
    }
}

/// How strongly the worst directions are preferred.
const WORST_POWER: f64 = 8.0;

/// λ_max(S⁻¹), through tr(Z S⁻¹) with Z ∝ S⁻ᵏ, which tends to the worst directions.
struct WorstDirection {
    y: DMatrix<f64>,
}

impl Goal for WorstDirection {
    fn factor(&mut self, inverse: &DMatrix<f64>) -> DMatrix<f64> {
        let eigen = inverse.clone().symmetric_eigen();
        let top = eigen.eigenvalues.max();
        let shares = eigen
            .eigenvalues
            .map(|v| libm::pow((v / top).max(0.0), WORST_POWER));
        let sum: f64 = shares.iter().sum();
        let scale = DMatrix::from_diagonal(&shares.map(|s| (s / sum).sqrt()));
        self.y = &eigen.eigenvectors * scale;
        inverse * &self.y
    }
    fn exponent(&self) -> f64 {
        (1.0 + WORST_POWER).recip()
    }
}

/// max P_ii/s_i², through weights that follow the larger ratios.
struct WorstRatio<'a, 'b> {
    problem: &'a Problem<'b>,
    spec: &'a CoefficientVector,
    /// On the ratios, sum 1.
    weights: CoefficientVector,
    y: DMatrix<f64>,
    settled: bool,
}

impl WorstRatio<'_, '_> {
    fn variance_weights(&self) -> CoefficientVector {
        self.weights
            .component_div(&self.spec.component_mul(self.spec))
    }
}

impl Goal for WorstRatio<'_, '_> {
    fn factor(&mut self, inverse: &DMatrix<f64>) -> DMatrix<f64> {
        /// How closely the weighted mean has to come to the maximum.
        const SETTLED: f64 = 1e-3;
        let ratios = self
            .problem
            .ratios(self.spec, Some((inverse, &self.weights)));
        let mean = ratios.dot(&self.weights);
        self.settled = ratios.max() <= mean * (1.0 + SETTLED);
        if !self.settled {
            self.weights = self.weights.zip_map(&ratios, |w, r| w * r / mean);
            self.weights /= self.weights.sum();
        }
        self.y = self.problem.target(&self.variance_weights()).0;
        inverse * &self.y
    }
    fn exponent(&self) -> f64 {
        0.5
    }
    fn is_settled(&self) -> bool {
        self.settled
    }
}

/// A factor L with L Lᵀ = the matrix.
fn root(matrix: &DMatrix<f64>) -> DMatrix<f64> {
    match nalgebra::Cholesky::new(matrix.clone()) {
        Some(cholesky) => cholesky.l(),
        None => DMatrix::zeros(matrix.nrows(), matrix.ncols()),
    }
}
