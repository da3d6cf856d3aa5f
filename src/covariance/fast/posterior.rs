//! The covariance of what a figure of merit sees among other parameters, and its adjoint.
//!
//! E is the information on all parameters in units of their prior σ: n estimated besides, c only
//! considered, f what is seen: parameters with a weight and the coefficients. With the prior of n and
//! f, I, but none of c, the n are eliminated; what is left is S over (c, f), and then
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

use nalgebra::DMatrix;

use super::arithmetic::Number;
use super::information::keeps_digits;
use crate::drift::COEFFICIENTS;
use crate::model::{ErrorModel, Role};

/// The parameters of a platform in the order of the chain: others that are estimated, those that are only
/// considered, those that a figure of merit sees besides, the twelve drift coefficients.
#[derive(Debug, Clone)]
pub(crate) struct Order {
    /// Places in [`ErrorModel::parameters`].
    pub places: Vec<usize>,
    /// How many are estimated beside those that are seen.
    pub estimated: usize,
    /// How many are considered.
    pub considered: usize,
    /// What they are in units of: 1σ of each before the test.
    pub scale: Vec<f64>,
    /// What is known of each before the test in those units, 1, or 0 where that is told otherwise.
    pub prior: Vec<f64>,
}

impl Order {
    /// Of all parameters of `errors`, those at `seen` seen by figures of merit besides the twelve
    /// coefficients. Parameters that are known exactly are left out, but for those that are seen.
    pub fn new(errors: &ErrorModel, seen: &[usize]) -> Self {
        let all = errors.parameters();
        let of_role = |role: Role| {
            (COEFFICIENTS..all.len()).filter(move |&i| {
                all[i].prior_sigma != 0.0 && !seen.contains(&i) && all[i].role == role
            })
        };
        let others: Vec<usize> = of_role(Role::Estimated).collect();
        let considered: Vec<usize> = of_role(Role::Considered).collect();
        let (estimated, ignored) = (others.len(), considered.len());
        // The coefficients come first among the platform's parameters.
        let rest = seen.iter().copied().chain(0..COEFFICIENTS);
        let places: Vec<usize> = others.into_iter().chain(considered).chain(rest).collect();
        Self {
            estimated,
            considered: ignored,
            scale: places.iter().map(|&i| all[i].prior_sigma).collect(),
            prior: vec![1.0; places.len()],
            places,
        }
    }

    /// How many parameters there are.
    pub fn size(&self) -> usize {
        self.places.len()
    }

    /// How many come before those that are seen.
    pub fn first_seen(&self) -> usize {
        self.estimated + self.considered
    }

    /// The units of what is seen.
    pub fn seen_scale(&self) -> &[f64] {
        &self.scale[self.first_seen()..]
    }
}

/// What the information on all parameters leaves of those that are seen, in units of their prior σ.
/// Matrices are full and row by row.
#[derive(Debug)]
pub(crate) struct Posterior<N> {
    /// How many n, n and c, and all parameters there are.
    eliminated: usize,
    first: usize,
    size: usize,
    /// Rows of D Lᵀ of the n, then S.
    rows: Vec<N>,
    /// D⁻¹ of the n.
    inverses: Vec<N>,
    /// Rows of L⁻¹ and D⁻¹ of S_ff.
    w: Vec<N>,
    d: Vec<N>,
    claimed: Vec<N>,
    /// Columns of K.
    k: Vec<Vec<N>>,
    covariance: Vec<N>,
    /// The smallest pivot, and the largest ratio of a diagonal entry to its pivot.
    pub least: N,
    pub cancelled: N,
}

/// The derivative of a figure of merit, in units of the prior σ.
#[derive(Debug, Clone)]
pub(crate) enum Pulled<N> {
    /// With respect to the variances of P.
    Variances(Vec<N>),
    /// With respect to P, row by row.
    Covariance(Vec<N>),
    /// With respect to S_ff, of a platform without considered parameters, row by row.
    Information(Vec<N>),
}

impl<N: Number> Posterior<N> {
    /// From the information E that measurements give, over all parameters, row by row, its upper triangle.
    #[inline(always)]
    pub fn new(zero: N, order: &Order, mut rows: Vec<N>) -> Self {
        let (size, eliminated, first) = (order.size(), order.estimated, order.first_seen());
        let seen = size - first;
        let one = zero.constant(1.0);
        for i in (0..eliminated).chain(first..size) {
            rows[i * size + i] = rows[i * size + i] + zero.constant(order.prior[i]);
        }
        let mut posterior = Self {
            eliminated,
            first,
            size,
            rows,
            inverses: Vec::with_capacity(eliminated),
            w: vec![zero; seen * seen],
            d: Vec::with_capacity(seen),
            claimed: vec![zero; seen * seen],
            k: Vec::new(),
            covariance: Vec::new(),
            least: one,
            cancelled: one,
        };
        let diagonal: Vec<N> = (0..size).map(|i| posterior.rows[i * (size + 1)]).collect();
        posterior.eliminate(one, &diagonal);
        posterior.factor(one, &diagonal[first..]);
        posterior.consider();
        posterior
    }

    /// How many parameters are seen.
    fn seen(&self) -> usize {
        self.size - self.first
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
    fn eliminate(&mut self, one: N, diagonal: &[N]) {
        let (size, first) = (self.size, self.first);
        for k in 0..self.eliminated {
            let pivot = self.rows[k * (size + 1)];
            let inverse = one / pivot;
            self.note_pivot(pivot, diagonal[k], inverse);
            self.inverses.push(inverse);
            let (done, rest) = self.rows.split_at_mut((k + 1) * size);
            let row = &done[k * size..];
            for (i, to) in (k + 1..size).zip(rest.chunks_exact_mut(size)) {
                let factor = -(row[i] * inverse);
                // Of a considered parameter only what it has to do with what is seen.
                let from = if i < self.eliminated { i } else { i.max(first) };
                add(&mut to[from..], factor, &row[from..]);
            }
        }
    }

    /// L⁻¹ and D⁻¹ of S_ff, and N.
    #[inline(always)]
    fn factor(&mut self, one: N, diagonal: &[N]) {
        let seen = self.seen();
        let mut s: Vec<N> = Vec::with_capacity(seen * seen);
        for i in 0..seen {
            let row = (self.first + i) * self.size + self.first;
            s.extend_from_slice(&self.rows[row..row + seen]);
            self.w[i * (seen + 1)] = one;
        }
        for k in 0..seen {
            let pivot = s[k * (seen + 1)];
            let inverse = one / pivot;
            self.note_pivot(pivot, diagonal[k], inverse);
            self.d.push(inverse);
            let (done, rest) = s.split_at_mut((k + 1) * seen);
            let (w_done, w_rest) = self.w.split_at_mut((k + 1) * seen);
            let (row, w_row) = (&done[k * seen..], &w_done[k * seen..k * seen + k + 1]);
            let rests = rest
                .chunks_exact_mut(seen)
                .zip(w_rest.chunks_exact_mut(seen));
            for (i, (to, w_to)) in (k + 1..seen).zip(rests) {
                let factor = -(row[i] * inverse);
                add(&mut to[i..], factor, &row[i..]);
                add(&mut w_to[..=k], factor, w_row);
            }
        }
        for (k, w) in self.w.chunks_exact(seen).enumerate() {
            for (i, to) in (0..=k).zip(self.claimed.chunks_exact_mut(seen)) {
                add(&mut to[i..=k], w[i] * self.d[k], &w[i..=k]);
            }
        }
        mirror(&mut self.claimed, seen);
    }

    /// K and P.
    #[inline(always)]
    fn consider(&mut self) {
        let seen = self.seen();
        self.covariance = self.claimed.clone();
        for c in self.eliminated..self.first {
            let k = times(&self.claimed, self.told(c));
            for (i, to) in self.covariance.chunks_exact_mut(seen).enumerate() {
                add(to, k[i], &k);
            }
            self.k.push(k);
        }
    }

    /// The row of S_cf of a considered parameter.
    #[inline(always)]
    fn told(&self, c: usize) -> &[N] {
        &self.rows[c * self.size + self.first..(c + 1) * self.size]
    }

    /// Ē over all parameters, full, row by row.
    #[inline(always)]
    pub fn adjoint(&self, slope: &Pulled<N>) -> Vec<N> {
        let (size, eliminated, first) = (self.size, self.eliminated, self.first);
        let seen = self.seen();
        let zero = self.least.constant(0.0);
        let (of_told, of_block) = self.remaining_adjoint(slope);
        let x = self.solved(zero);
        let (b, c) = (size - eliminated, first - eliminated);
        let mut out = vec![zero; size * size];
        // S̄, then X S̄ and X S̄ Xᵀ.
        for (i, told) in of_told.iter().enumerate() {
            for j in 0..seen {
                out[(eliminated + i) * size + first + j] = told[j];
                out[(first + j) * size + eliminated + i] = told[j];
            }
        }
        for (i, of) in of_block.chunks_exact(seen).enumerate() {
            let row = (first + i) * size + first;
            out[row..row + seen].copy_from_slice(of);
        }
        let (of_n, of_b) = out.split_at_mut(eliminated * size);
        for (x, out) in x.chunks_exact(b).zip(of_n.chunks_exact_mut(size)) {
            let to = &mut out[eliminated..];
            for (j, (factor, of)) in x.iter().zip(of_b.chunks_exact(size)).enumerate() {
                // A considered parameter has to do with what is seen only.
                let from = if j < c { c } else { 0 };
                add(&mut to[from..], -*factor, &of[eliminated + from..]);
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
    fn remaining_adjoint(&self, slope: &Pulled<N>) -> (Vec<Vec<N>>, Vec<N>) {
        let zero = self.least.constant(0.0);
        let (half, two) = (zero.constant(0.5), zero.constant(2.0));
        let seen = self.seen();
        let mut of_told = Vec::with_capacity(self.k.len());
        let mut of_claimed = match slope {
            Pulled::Information(of) => return (of_told, of.clone()),
            Pulled::Covariance(g) => g.clone(),
            Pulled::Variances(g) => {
                let mut of = vec![zero; seen * seen];
                for i in 0..seen {
                    of[i * (seen + 1)] = g[i];
                }
                of
            }
        };
        let of_covariance = of_claimed.clone();
        for (c, k) in (self.eliminated..).zip(&self.k) {
            let mut k_adjoint = times(&of_covariance, k);
            for of in &mut k_adjoint {
                *of = *of * two;
            }
            let told = self.told(c);
            for (i, to) in of_claimed.chunks_exact_mut(seen).enumerate() {
                for (j, to) in to.iter_mut().enumerate() {
                    let sum = k_adjoint[i] * told[j] + k_adjoint[j] * told[i];
                    *to = sum.mul_add(half, *to);
                }
            }
            let mut of = times(&self.claimed, &k_adjoint);
            for of in &mut of {
                *of = *of * half;
            }
            of_told.push(of);
        }
        let mut half_way = vec![zero; seen * seen];
        let diagonal = self.k.is_empty() && matches!(slope, Pulled::Variances(_));
        for (i, to) in half_way.chunks_exact_mut(seen).enumerate() {
            for (l, row) in self.claimed.chunks_exact(seen).enumerate() {
                if !diagonal || l == i {
                    add(to, -of_claimed[i * seen + l], row);
                }
            }
        }
        let mut of_block = vec![zero; seen * seen];
        for (row, of) in self
            .claimed
            .chunks_exact(seen)
            .zip(half_way.chunks_exact(seen))
        {
            for (i, to) in of_block.chunks_exact_mut(seen).enumerate() {
                add(&mut to[i..], row[i], &of[i..]);
            }
        }
        mirror(&mut of_block, seen);
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
                add(to, -(row[i] * inverse), of);
            }
        }
        x
    }

    /// P of one lane, in units of the prior σ.
    pub fn matrix(&self, lane: impl Fn(N) -> f64) -> DMatrix<f64> {
        let seen = self.seen();
        DMatrix::from_fn(seen, seen, |i, j| {
            lane(self.covariance[i.min(j) * seen + i.max(j)])
        })
    }

    /// A root of P of one lane in units of the prior σ: an upper triangle. Its last rows and columns
    /// are a root of P_D.
    pub fn root(&self, lane: impl Fn(N) -> f64) -> DMatrix<f64> {
        let seen = self.seen();
        if !self.k.is_empty() {
            return upper_root(&self.matrix(lane));
        }
        DMatrix::from_fn(seen, seen, |i, k| match i <= k {
            true => lane(self.w[k * seen + i]) * lane(self.d[k]).sqrt(),
            false => 0.0,
        })
    }

    /// The derivative of one lane's figure of merit, given with respect to `in_root` = Lᵀ G L.
    pub fn pulled_of_root(&self, in_root: &DMatrix<f64>, lane: impl Fn(N) -> f64) -> Pulled<f64> {
        let root = self.root(lane);
        let seen = self.seen();
        // Symmetric, so that columns are rows.
        let entries = |m: &DMatrix<f64>| m.iter().copied().collect();
        if self.k.is_empty() {
            return Pulled::Information(entries(&-(&root * in_root * root.transpose())));
        }
        // G = L⁻ᵀ K L⁻¹; what is known exactly has no derivative.
        let mut inverse = DMatrix::identity(seen, seen);
        if !root.solve_upper_triangular_mut(&mut inverse) {
            inverse.fill(0.0);
        }
        Pulled::Covariance(entries(&(inverse.transpose() * in_root * inverse)))
    }

    /// Whether one lane has the digits that a search needs.
    pub fn keeps_digits(&self, lane: impl Fn(N) -> f64) -> bool {
        keeps_digits(lane(self.least), lane(self.cancelled))
    }
}

/// The upper triangle U with U Uᵀ = P.
fn upper_root(p: &DMatrix<f64>) -> DMatrix<f64> {
    let size = p.nrows();
    let mut u = DMatrix::zeros(size, size);
    for k in (0..size).rev() {
        for i in (0..=k).rev() {
            let known: f64 = (k + 1..size).map(|l| u[(i, l)] * u[(k, l)]).sum();
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

/// `to` += `factor` `of`.
#[inline(always)]
fn add<N: Number>(to: &mut [N], factor: N, of: &[N]) {
    for (to, of) in to.iter_mut().zip(of) {
        *to = of.mul_add(factor, *to);
    }
}

/// The lower triangle from the upper one.
#[inline(always)]
fn mirror<N: Copy>(m: &mut [N], size: usize) {
    for i in 1..size {
        for j in 0..i {
            m[i * size + j] = m[j * size + i];
        }
    }
}

/// `m v` for a symmetric m.
#[inline(always)]
fn times<N: Number>(m: &[N], v: &[N]) -> Vec<N> {
    let mut out = vec![v[0].constant(0.0); v.len()];
    for (row, factor) in m.chunks_exact(v.len()).zip(v) {
        add(&mut out, *factor, row);
    }
    out
}
