//! The covariance of the drift coefficients among other parameters, and its adjoint.
//!
//! E is the information on all parameters in units of their prior σ: n estimated besides, c only
//! considered, f the coefficients. With the prior of n and f, I, but none of c, the n are
//! eliminated; what is left is S over (c, f), and then
//!
//! ```text
//! N = S_ff⁻¹,   K = N S_fc,   P = N + K Kᵀ:
//! ```
//!
//! N is what a filter that does not know of c claims, P the truth (K with the opposite sign is what
//! an error of 1σ of c does to the estimate). Back, from G = ∂f/∂P:
//!
//! ```text
//! K̄ = 2 G K,   N̄ = G + sym(K̄ S_cf),   S̄_cf = K̄ᵀ N,   S̄_ff = −N N̄ N,
//! Ē = W S̄ Wᵀ,   W = (−E_nn⁻¹ E_nb; I),   b = (c, f).
//! ```

use super::arithmetic::Number;
use super::information::keeps_digits;
use super::mixing::Mixing;
use crate::covariance::CovarianceRoot;
use crate::drift::{COEFFICIENTS, CoefficientMatrix, CoefficientVector};

/// A matrix over the coefficients.
type Block<N> = [[N; COEFFICIENTS]; COEFFICIENTS];

/// What the information on all parameters leaves of the coefficients, in units of their prior σ.
#[derive(Debug)]
pub(crate) struct Posterior<N> {
    /// How many n, and how many n and c.
    eliminated: usize,
    first: usize,
    size: usize,
    /// Rows of D Lᵀ of the n, then S.
    rows: Vec<N>,
    /// D⁻¹ of the n.
    inverses: Vec<N>,
    /// Rows of L⁻¹ and D⁻¹ of S_ff.
    w: Block<N>,
    d: [N; COEFFICIENTS],
    claimed: Block<N>,
    /// Columns of K.
    k: Vec<[N; COEFFICIENTS]>,
    covariance: Block<N>,
    /// The smallest pivot, and the largest ratio of a diagonal entry to its pivot.
    pub least: N,
    pub cancelled: N,
}

/// The derivative of a figure of merit, in units of the prior σ.
#[derive(Debug, Clone)]
pub(crate) enum Pulled<N> {
    /// With respect to the variances of P.
    Variances([N; COEFFICIENTS]),
    /// With respect to P.
    Covariance(Box<Block<N>>),
    /// With respect to S_ff, of a platform without considered parameters.
    Information(Box<Block<N>>),
}

impl<N: Number> Posterior<N> {
    /// From the entries of the tiles.
    #[inline(always)]
    pub fn new(zero: N, mixing: &Mixing, tiles: &[N]) -> Self {
        let size = mixing.size();
        let (eliminated, first) = (mixing.estimated, mixing.estimated + mixing.considered);
        let one = zero.constant(1.0);
        let mut rows = mixing.information(zero, tiles);
        for i in (0..eliminated).chain(first..size) {
            rows[i * size + i] = rows[i * size + i] + one;
        }
        let mut posterior = Self {
            eliminated,
            first,
            size,
            rows,
            inverses: Vec::with_capacity(eliminated),
            w: [[zero; COEFFICIENTS]; COEFFICIENTS],
            d: [one; COEFFICIENTS],
            claimed: [[zero; COEFFICIENTS]; COEFFICIENTS],
            k: Vec::new(),
            covariance: [[zero; COEFFICIENTS]; COEFFICIENTS],
            least: one,
            cancelled: one,
        };
        let mut diagonal = [zero; COEFFICIENTS];
        for i in 0..COEFFICIENTS {
            diagonal[i] = posterior.rows[(first + i) * (size + 1)];
        }
        posterior.eliminate(one);
        posterior.factor(zero, &diagonal);
        posterior.consider();
        posterior
    }

    #[inline(always)]
    fn note_pivot(&mut self, pivot: N, diagonal: N, inverse: N) {
        self.least = pivot.where_greater(self.least, pivot, self.least);
        let ratio = diagonal * inverse;
        // A ratio that is not a number is taken for the larger one.
        self.cancelled = self.cancelled.where_greater(self.cancelled, ratio, ratio);
    }

    /// Eliminates the n.
    #[inline(always)]
    fn eliminate(&mut self, one: N) {
        let (size, first) = (self.size, self.first);
        let diagonal: Vec<N> = (0..self.eliminated)
            .map(|k| self.rows[k * (size + 1)])
            .collect();
        for k in 0..self.eliminated {
            let pivot = self.rows[k * (size + 1)];
            let inverse = one / pivot;
            self.note_pivot(pivot, diagonal[k], inverse);
            self.inverses.push(inverse);
            let (done, rest) = self.rows.split_at_mut((k + 1) * size);
            let row = &done[k * size..];
            for (i, to) in (k + 1..size).zip(rest.chunks_exact_mut(size)) {
                let factor = -(row[i] * inverse);
                // Of a considered parameter only what it has to do with the coefficients.
                let from = if i < self.eliminated { i } else { i.max(first) };
                for (to, of) in to[from..].iter_mut().zip(&row[from..]) {
                    *to = of.mul_add(factor, *to);
                }
            }
        }
    }

    /// L⁻¹ and D⁻¹ of S_ff, and N.
    #[inline(always)]
    fn factor(&mut self, zero: N, diagonal: &[N; COEFFICIENTS]) {
        let one = zero.constant(1.0);
        let mut s = [[zero; COEFFICIENTS]; COEFFICIENTS];
        for i in 0..COEFFICIENTS {
            let row = &self.rows[(self.first + i) * self.size + self.first..];
            for j in i..COEFFICIENTS {
                s[i][j] = row[j];
            }
            self.w[i][i] = one;
        }
        for k in 0..COEFFICIENTS {
            let pivot = s[k][k];
            let inverse = one / pivot;
            self.note_pivot(pivot, diagonal[k], inverse);
            self.d[k] = inverse;
            let (s_k, w_k) = (s[k], self.w[k]);
            for i in k + 1..COEFFICIENTS {
                let factor = -(s_k[i] * inverse);
                for j in i..COEFFICIENTS {
                    s[i][j] = s_k[j].mul_add(factor, s[i][j]);
                }
                for j in 0..=k {
                    self.w[i][j] = w_k[j].mul_add(factor, self.w[i][j]);
                }
            }
        }
        for k in 0..COEFFICIENTS {
            let w = self.w[k];
            for i in 0..=k {
                let factor = w[i] * self.d[k];
                for j in i..=k {
                    self.claimed[i][j] = w[j].mul_add(factor, self.claimed[i][j]);
                }
            }
        }
        mirror(&mut self.claimed);
    }

    /// K and P.
    #[inline(always)]
    fn consider(&mut self) {
        self.covariance = self.claimed;
        for c in self.eliminated..self.first {
            let told = self.told(c);
            let k = times(&self.claimed, &told);
            for i in 0..COEFFICIENTS {
                for j in 0..COEFFICIENTS {
                    self.covariance[i][j] = k[i].mul_add(k[j], self.covariance[i][j]);
                }
            }
            self.k.push(k);
        }
    }

    /// The row of S_cf of a considered parameter.
    #[inline(always)]
    fn told(&self, c: usize) -> [N; COEFFICIENTS] {
        let row = &self.rows[c * self.size + self.first..];
        let mut told = [row[0]; COEFFICIENTS];
        told.copy_from_slice(&row[..COEFFICIENTS]);
        told
    }

    /// Ē over all parameters, full, row by row.
    #[inline(always)]
    pub fn adjoint(&self, slope: &Pulled<N>) -> Vec<N> {
        let (size, eliminated, first) = (self.size, self.eliminated, self.first);
        let zero = self.least.constant(0.0);
        let (of_told, of_block) = self.remaining_adjoint(slope);
        let x = self.solved(zero);
        let (b, c) = (size - eliminated, first - eliminated);
        let mut out = vec![zero; size * size];
        // S̄, then X S̄ and X S̄ Xᵀ.
        for (i, told) in of_told.iter().enumerate() {
            for j in 0..COEFFICIENTS {
                out[(eliminated + i) * size + first + j] = told[j];
                out[(first + j) * size + eliminated + i] = told[j];
            }
        }
        for i in 0..COEFFICIENTS {
            let row = (first + i) * size + first;
            out[row..row + COEFFICIENTS].copy_from_slice(&of_block[i]);
        }
        let (of_n, of_b) = out.split_at_mut(eliminated * size);
        for (x, out) in x.chunks_exact(b).zip(of_n.chunks_exact_mut(size)) {
            let to = &mut out[eliminated..];
            for (j, (factor, of)) in x.iter().zip(of_b.chunks_exact(size)).enumerate() {
                // A considered parameter has to do with the coefficients only.
                let from = if j < c { c } else { 0 };
                let factor = -*factor;
                for (to, of) in to[from..].iter_mut().zip(&of[eliminated + from..]) {
                    *to = of.mul_add(factor, *to);
                }
            }
        }
        for i in 0..eliminated {
            for j in 0..=i {
                let left = &out[i * size + eliminated..(i + 1) * size];
                let mut sum = zero;
                for (left, right) in left.iter().zip(&x[j * b..(j + 1) * b]) {
                    sum = left.mul_add(*right, sum);
                }
                out[i * size + j] = -sum;
                out[j * size + i] = -sum;
            }
            for j in eliminated..size {
                out[j * size + i] = out[i * size + j];
            }
        }
        out
    }

    /// ½ S̄_cf and S̄_ff.
    #[inline(always)]
    fn remaining_adjoint(&self, slope: &Pulled<N>) -> (Vec<[N; COEFFICIENTS]>, Block<N>) {
        let zero = self.least.constant(0.0);
        let (half, two) = (zero.constant(0.5), zero.constant(2.0));
        let mut of_claimed = [[zero; COEFFICIENTS]; COEFFICIENTS];
        let mut of_told = Vec::with_capacity(self.k.len());
        match slope {
            Pulled::Information(of) => return (of_told, **of),
            Pulled::Variances(g) => {
                for i in 0..COEFFICIENTS {
                    of_claimed[i][i] = g[i];
                }
            }
            Pulled::Covariance(g) => of_claimed = **g,
        }
        for (c, k) in (self.eliminated..).zip(&self.k) {
            let mut k_adjoint = *k;
            match slope {
                Pulled::Variances(g) => {
                    for i in 0..COEFFICIENTS {
                        k_adjoint[i] = k[i] * g[i] * two;
                    }
                }
                Pulled::Covariance(g) => {
                    k_adjoint = times(g, k);
                    for of in &mut k_adjoint {
                        *of = *of * two;
                    }
                }
                Pulled::Information(_) => {}
            }
            let told = self.told(c);
            for i in 0..COEFFICIENTS {
                for j in 0..COEFFICIENTS {
                    let sum = k_adjoint[i] * told[j] + k_adjoint[j] * told[i];
                    of_claimed[i][j] = sum.mul_add(half, of_claimed[i][j]);
                }
            }
            let mut of = times(&self.claimed, &k_adjoint);
            for of in &mut of {
                *of = *of * half;
            }
            of_told.push(of);
        }
        let mut half_way = [[zero; COEFFICIENTS]; COEFFICIENTS];
        let diagonal = self.k.is_empty() && matches!(slope, Pulled::Variances(_));
        for i in 0..COEFFICIENTS {
            for l in 0..COEFFICIENTS {
                if diagonal && l != i {
                    continue;
                }
                let factor = -of_claimed[i][l];
                for j in 0..COEFFICIENTS {
                    half_way[i][j] = self.claimed[l][j].mul_add(factor, half_way[i][j]);
                }
            }
        }
        let mut of_block = [[zero; COEFFICIENTS]; COEFFICIENTS];
        for l in 0..COEFFICIENTS {
            for i in 0..COEFFICIENTS {
                let factor = self.claimed[l][i];
                for j in i..COEFFICIENTS {
                    of_block[i][j] = half_way[l][j].mul_add(factor, of_block[i][j]);
                }
            }
        }
        mirror(&mut of_block);
        (of_told, of_block)
    }

    /// X = E_nn⁻¹ E_nb, row by row.
    #[inline(always)]
    fn solved(&self, zero: N) -> Vec<N> {
        let (size, n) = (self.size, self.eliminated);
        let b = size - n;
        let mut x = vec![zero; n * b];
        for k in (0..n).rev() {
            let row = &self.rows[k * size..(k + 1) * size];
            let inverse = self.inverses[k];
            let (before, after) = x.split_at_mut((k + 1) * b);
            let to = &mut before[k * b..];
            for (to, of) in to.iter_mut().zip(&row[n..]) {
                *to = *of * inverse;
            }
            for (i, of) in (k + 1..n).zip(after.chunks_exact(b)) {
                let factor = -(row[i] * inverse);
                for (to, of) in to.iter_mut().zip(of) {
                    *to = of.mul_add(factor, *to);
                }
            }
        }
        x
    }

    /// P of one lane in the coefficients' units.
    pub fn matrix(&self, sigma: &CoefficientVector, lane: impl Fn(N) -> f64) -> CoefficientMatrix {
        CoefficientMatrix::from_fn(|i, j| {
            let (low, high) = if i < j { (i, j) } else { (j, i) };
            sigma[i] * sigma[j] * lane(self.covariance[low][high])
        })
    }

    /// A root of P of one lane in units of the prior σ: an upper triangle.
    pub fn scaled_root(&self, lane: impl Fn(N) -> f64) -> CoefficientMatrix {
        if self.k.is_empty() {
            return CoefficientMatrix::from_fn(|i, k| match i <= k {
                true => lane(self.w[k][i]) * lane(self.d[k]).sqrt(),
                false => 0.0,
            });
        }
        let unit = CoefficientVector::repeat(1.0);
        upper_root(&self.matrix(&unit, lane))
    }

    /// The derivative of one lane's figure of merit, given with respect to `in_root` = Lᵀ G L.
    pub fn pulled_of_root(
        &self,
        in_root: &CoefficientMatrix,
        lane: impl Fn(N) -> f64,
    ) -> Pulled<f64> {
        let root = self.scaled_root(lane);
        let block = |m: &CoefficientMatrix| {
            let entry = |i: usize, j: usize| m[(i, j)];
            Box::new(std::array::from_fn(|i| {
                std::array::from_fn(|j| entry(i, j))
            }))
        };
        if self.k.is_empty() {
            return Pulled::Information(block(&-(root * in_root * root.transpose())));
        }
        // G = L⁻ᵀ K L⁻¹; what is known exactly has no derivative.
        let mut inverse = CoefficientMatrix::identity();
        if !root.solve_upper_triangular_mut(&mut inverse) {
            inverse = CoefficientMatrix::zeros();
        }
        Pulled::Covariance(block(&(inverse.transpose() * in_root * inverse)))
    }

    /// Whether one lane has the digits that a search needs.
    pub fn keeps_digits(&self, lane: impl Fn(N) -> f64) -> bool {
        keeps_digits(lane(self.least), lane(self.cancelled))
    }
}

/// A root of P, of one lane, in the coefficients' units.
pub(crate) fn root_in_units(
    scaled: &CoefficientMatrix,
    sigma: &CoefficientVector,
) -> CovarianceRoot {
    let mut root = *scaled;
    for i in 0..COEFFICIENTS {
        root.row_mut(i).scale_mut(sigma[i]);
    }
    CovarianceRoot::new(root, std::array::from_fn(|i| i))
}

/// The upper triangle U with U Uᵀ = P.
fn upper_root(p: &CoefficientMatrix) -> CoefficientMatrix {
    let mut u = CoefficientMatrix::zeros();
    for k in (0..COEFFICIENTS).rev() {
        for i in (0..=k).rev() {
            let known: f64 = (k + 1..COEFFICIENTS).map(|l| u[(i, l)] * u[(k, l)]).sum();
            let rest = p[(i, k)] - known;
            u[(i, k)] = if i == k {
                rest.max(0.0).sqrt()
            } else if u[(k, k)] > 0.0 {
                rest / u[(k, k)]
            } else {
                0.0
            };
        }
    }
    u
}

/// The lower triangle from the upper one.
#[inline(always)]
fn mirror<N: Copy>(m: &mut Block<N>) {
    for i in 1..COEFFICIENTS {
        for j in 0..i {
            m[i][j] = m[j][i];
        }
    }
}

/// `m v` for a symmetric m.
#[inline(always)]
fn times<N: Number>(m: &Block<N>, v: &[N; COEFFICIENTS]) -> [N; COEFFICIENTS] {
    let mut out = [v[0].constant(0.0); COEFFICIENTS];
    for j in 0..COEFFICIENTS {
        for i in 0..COEFFICIENTS {
            out[i] = m[j][i].mul_add(v[j], out[i]);
        }
    }
    out
}
