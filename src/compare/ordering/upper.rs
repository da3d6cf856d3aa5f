//! Bounds on what the rest of an order can tell.
//!
//! What any order of some positions tells about (ψ^n, D) when they are set out for from a given
//! position is an information matrix; above all of them lies one made by dynamic programming over
//! the sets: for each position that may come next, the bound of what follows it taken back through
//! its dwell and move ([`Link::back`]), which keeps the order of information matrices, and above
//! the two of Λ and Λ' lies
//!
//! ```text
//! Λ + F⁻ᵀ (Fᵀ (Λ' − Λ) F)₊ F⁻¹,
//! ```
//!
//! (·)₊ the part of the positive eigenvalues. Any F gives a bound; near the least is that with
//! F Fᵀ the covariance of (ψ^n, D) after the test where the bound is used, in the best order known.

use std::collections::HashMap;

use nalgebra::{Cholesky, SMatrix, SVector};
use rayon::prelude::*;

use super::roads::{Hops, Roads};
use crate::covariance::fast::cuts::Rest;
use crate::covariance::link::{Link, Reached};
use crate::drift::{COEFFICIENTS, CoefficientVector, DriftMatrix};

/// States: ψ^n and D.
const STATES: usize = 3 + COEFFICIENTS;
type Matrix15 = SMatrix<f64, STATES, STATES>;

/// Positions to go that bounds are made for.
const MOST_TO_GO: usize = 4;

/// With fewer positions it is quicker to go through all orders.
const FEWEST: usize = 8;
/// Steps that take as long as one bound taken together with another.
const STEPS_OF_ONE: u64 = 30;

/// Bounds by the positions left and the one they are set out for from.
#[derive(Debug)]
pub(super) struct Upper {
    rest: HashMap<(u32, usize), Rest>,
    /// What making them took, in steps of the tree.
    pub steps: u64,
}

impl Upper {
    /// For dwells of these periods, sharpest where `best` leads; as many as `most_steps` make.
    pub fn new(roads: &Roads<'_>, hops: &Hops, best: &[usize], most_steps: u64) -> Option<Self> {
        let count = roads.count();
        if count < FEWEST {
            return None;
        }
        let mut steps = 0;
        let mut level: HashMap<(u32, usize), Rest> = (0..count)
            .map(|last| ((0, last), Rest::nothing()))
            .collect();
        let mut rest = HashMap::new();
        let mut made = 0;
        let typical = Typical::new(hops, best);
        for to_go in 1..=MOST_TO_GO.min(count.saturating_sub(2)) {
            let sets = (0..=roads.everywhere()).filter(|s| s.count_ones() as usize == to_go);
            let keys: Vec<(u32, usize)> = sets
                .flat_map(|set| {
                    let from = (0..count).filter(move |from| set >> from & 1 == 0);
                    from.map(move |from| (set, from))
                })
                .collect();
            steps += (keys.len() * to_go) as u64 * STEPS_OF_ONE;
            if steps > most_steps {
                break;
            }
            let Some(metric) = typical.metric(roads, count - to_go) else {
                break;
            };
            let depth = count - to_go;
            let bound = |&(set, from): &(u32, usize)| {
                let mut bound: Option<Rest> = None;
                for next in (0..count).filter(|next| set >> next & 1 == 1) {
                    let after = level.get(&(set & !(1 << next), next))?;
                    let told = hops.hop(depth, from, next).back(after);
                    bound = Some(match bound {
                        None => told,
                        Some(bound) => metric.above(bound, &told)?,
                    });
                }
                Some(((set, from), bound?))
            };
            let bounds: Option<HashMap<_, _>> = keys.par_iter().map(bound).collect();
            level = bounds?;
            made = steps;
            rest.extend(level.iter().map(|(key, rest)| (*key, *rest)));
        }
        (!rest.is_empty()).then_some(Self { rest, steps: made })
    }

    /// The bound, if there is one.
    pub fn rest(&self, left: u32, from: usize) -> Option<&Rest> {
        self.rest.get(&(left, from))
    }
}

/// The best order known: what it knows at each cut, and what is told after.
struct Typical {
    reached: Vec<Reached>,
    rest: Vec<Rest>,
}

impl Typical {
    fn new(hops: &Hops, best: &[usize]) -> Self {
        let hop = |depth: usize| -> &Link { hops.hop(depth, best[depth - 1], best[depth]) };
        let mut reached = vec![hops.begin(best[0])];
        for depth in 1..best.len() {
            let next = reached[depth - 1].after(hop(depth));
            reached.push(next);
        }
        let mut rest = vec![Rest::nothing(); best.len()];
        for depth in (1..best.len()).rev() {
            rest[depth - 1] = hop(depth).back(&rest[depth]);
        }
        Self { reached, rest }
    }

    /// The metric after `done` positions; none where it is singular.
    fn metric(&self, roads: &Roads<'_>, done: usize) -> Option<Metric> {
        let prior = roads.evaluator().model().prior_sigma_deg_per_h();
        let (reached, rest) = (&self.reached[done - 1], &self.rest[done - 1]);
        // In units of the prior, so that what is known exactly has no part in it.
        let mut information = reached.e;
        for i in 0..COEFFICIENTS {
            for j in 0..COEFFICIENTS {
                information[(i, j)] *= prior[i] * prior[j];
            }
            information[(i, i)] += 1.0;
        }
        let coefficients = Cholesky::new(information)?.inverse();
        let mut v = reached.v;
        for (mut column, sigma) in v.column_iter_mut().zip(prior.iter()) {
            column *= *sigma;
        }
        let cross = v * coefficients;
        let mut covariance = Matrix15::zeros();
        covariance
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(reached.p + cross * v.transpose()));
        covariance
            .fixed_view_mut::<3, COEFFICIENTS>(0, 3)
            .copy_from(&cross);
        covariance
            .fixed_view_mut::<COEFFICIENTS, 3>(3, 0)
            .copy_from(&cross.transpose());
        covariance
            .fixed_view_mut::<COEFFICIENTS, COEFFICIENTS>(3, 3)
            .copy_from(&coefficients);
        let scale = scale(prior);
        let told = scaled(&information_of(rest), &scale);
        let after = Cholesky::new(covariance)?.inverse() + told;
        let root = Cholesky::new(Cholesky::new(after)?.inverse())?.l();
        Some(Metric {
            scaled_root: Matrix15::from_fn(|i, j| scale[i] * root[(i, j)]),
            root_inverse: root.try_inverse()?,
            scale,
        })
    }
}

/// 1 for ψ^n, the prior σ for D.
fn scale(prior: &CoefficientVector) -> SVector<f64, STATES> {
    SVector::from_fn(|i, _| if i < 3 { 1.0 } else { prior[i - 3] })
}

fn scaled(information: &Matrix15, scale: &SVector<f64, STATES>) -> Matrix15 {
    Matrix15::from_fn(|i, j| scale[i] * information[(i, j)] * scale[j])
}

/// The information matrix of (ψ^n, D).
fn information_of(rest: &Rest) -> Matrix15 {
    let (r, s, e) = rest.parts();
    let mut rows = SMatrix::<f64, 3, STATES>::zeros();
    rows.fixed_view_mut::<3, 3>(0, 0).copy_from(r);
    rows.fixed_view_mut::<3, COEFFICIENTS>(0, 3).copy_from(s);
    let mut information = rows.transpose() * rows;
    let mut block = information.fixed_view_mut::<COEFFICIENTS, COEFFICIENTS>(3, 3);
    block += e;
    information
}

/// F, which says in which directions a bound may give most away.
struct Metric {
    scale: SVector<f64, STATES>,
    /// diag(scale) F.
    scaled_root: Matrix15,
    /// F⁻¹.
    root_inverse: Matrix15,
}

impl Metric {
    /// What lies above both; none when the eigenvalues do not converge.
    fn above(&self, mut bound: Rest, told: &Rest) -> Option<Rest> {
        let more = information_of(told) - information_of(&bound);
        let more = self.scaled_root.transpose() * more * self.scaled_root;
        let eigen = more.try_symmetric_eigen(1e-14, 200)?;
        let mut rows = Vec::new();
        for (k, value) in eigen.eigenvalues.iter().enumerate() {
            // In units of what is known anyway: a part this small changes no merit by SAME.
            if *value > 1e-13 {
                let v = eigen.eigenvectors.column(k) * value.sqrt();
                rows.push(self.root_inverse.transpose() * v);
            }
        }
        for three in rows.chunks(3) {
            let mut psi = nalgebra::Matrix3::zeros();
            let mut drift = DriftMatrix::zeros();
            for (i, row) in three.iter().enumerate() {
                for j in 0..STATES {
                    match j {
                        0..3 => psi[(i, j)] = row[j],
                        // Nothing can be told of a coefficient that is known exactly.
                        _ if self.scale[j] == 0.0 => {}
                        _ => drift[(i, j - 3)] = row[j] / self.scale[j],
                    }
                }
            }
            bound.with_rows(&psi, &drift);
        }
        Some(bound)
    }
}
