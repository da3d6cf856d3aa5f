//! A basis of a null space that a person can read: few unknowns in each vector.
//!
//! Chosen rows of a basis of the null space, as many as it has dimensions, can be made a unit matrix;
//! each vector then has one of the unknowns chosen and otherwise only those that determine it: a least
//! set that is dependent. Which these are depends on what is chosen, so several choices are made, and of
//! all vectors found the shortest independent ones are kept.

use nalgebra::{DMatrix, DVector};

/// Entries below this share of a vector's largest are rounding.
const ROUNDING: f64 = 1e-7;
/// What a pivot must have of what there is in a choice, from strict to lenient.
const PIVOTS: [f64; 3] = [0.3, 1e-2, 1e-6];
/// What a vector must have of its own beside those kept before.
const OWN: [f64; 2] = [1e-2, 1e-6];

/// A basis of the space that the columns of `null`, orthonormal, span, of short vectors, but for a part
/// of it that the columns of `known`, orthonormal, span; `families` says which unknowns, next to each
/// other, belong together.
pub(super) fn sparse_basis(
    null: &DMatrix<f64>,
    known: &DMatrix<f64>,
    families: &[usize],
) -> Vec<DVector<f64>> {
    let unknowns = null.nrows();
    let dimension = null.ncols() - known.ncols();
    if dimension == 0 {
        return Vec::new();
    }
    let mut candidates: Vec<(usize, DVector<f64>)> = choices(unknowns, families)
        .iter()
        .flat_map(|order| circuits(null, order))
        .map(|v| (v.iter().filter(|e| **e != 0.0).count(), v))
        .collect();
    // Stable: of vectors of the same length the first found.
    candidates.sort_by_key(|(length, _)| *length);
    let mut kept: Vec<DVector<f64>> = Vec::new();
    let mut directions: Vec<DVector<f64>> = known.column_iter().map(|c| c.into_owned()).collect();
    for own in OWN {
        for (_, candidate) in &candidates {
            if kept.len() == dimension {
                break;
            }
            let mut rest = candidate.normalize();
            // Twice: what rounding leaves of a direction would pass for a new one.
            for _ in 0..2 {
                for d in &directions {
                    rest -= d * d.dot(&rest);
                }
            }
            if rest.norm() > own {
                directions.push(rest.normalize());
                kept.push(candidate.clone());
            }
        }
    }
    let first = |v: &DVector<f64>| v.iter().position(|e| *e != 0.0);
    let length = |v: &DVector<f64>| v.iter().filter(|e| **e != 0.0).count();
    kept.sort_by_key(|v| (length(v), first(v)));
    kept
}

/// Orders in which unknowns are chosen: as they are, the other way round, and each family last or first.
fn choices(unknowns: usize, families: &[usize]) -> Vec<Vec<usize>> {
    let all: Vec<usize> = (0..unknowns).collect();
    let mut orders = vec![all.clone(), all.iter().rev().copied().collect()];
    let mut different = families.to_vec();
    different.dedup();
    for family in different {
        let (of, others): (Vec<usize>, Vec<usize>) =
            all.iter().partition(|&&j| families[j] == family);
        orders.push([&others[..], &of[..]].concat());
        orders.push([&of[..], &others[..]].concat());
    }
    orders
}

/// One vector for each unknown chosen in `order`.
fn circuits(null: &DMatrix<f64>, order: &[usize]) -> Vec<DVector<f64>> {
    let dimension = null.ncols();
    let mut vectors: Vec<DVector<f64>> = null.column_iter().map(|c| c.into_owned()).collect();
    let mut done = 0;
    for share in PIVOTS {
        for &j in order {
            if done == dimension {
                break;
            }
            let most = (done..dimension)
                .max_by(|&a, &b| vectors[a][j].abs().total_cmp(&vectors[b][j].abs()));
            let Some(k) = most else { break };
            let largest = vectors[done..]
                .iter()
                .map(|v| v.amax())
                .fold(0.0_f64, f64::max);
            let pivot = vectors[k][j];
            if pivot.abs() <= share * largest || pivot == 0.0 {
                continue;
            }
            vectors.swap(done, k);
            vectors[done] /= pivot;
            let row = vectors[done].clone();
            for (other, vector) in vectors.iter_mut().enumerate() {
                if other != done {
                    let factor = vector[j];
                    *vector -= &row * factor;
                    vector[j] = 0.0;
                }
            }
            done += 1;
        }
    }
    vectors.truncate(done);
    for vector in &mut vectors {
        let least = ROUNDING * vector.amax();
        vector
            .iter_mut()
            .filter(|e| e.abs() < least)
            .for_each(|e| *e = 0.0);
    }
    vectors
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An orthonormal basis of what these vectors span, turned so that none of them is in it.
    fn mixed(vectors: &[Vec<f64>]) -> DMatrix<f64> {
        let n = vectors[0].len();
        let m = DMatrix::from_fn(n, vectors.len(), |i, k| vectors[k][i]);
        let q = m.qr().q();
        let turn = DMatrix::from_fn(vectors.len(), vectors.len(), |i, j| {
            ((3 * i * i + 5 * j + 2 * i * j + 1) as f64).sin()
        });
        (q * turn).qr().q()
    }

    fn none(unknowns: usize) -> DMatrix<f64> {
        DMatrix::zeros(unknowns, 0)
    }

    #[test]
    fn short_vectors_are_found_in_a_space_that_hides_them() {
        let vectors = [
            vec![0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            vec![1.0, 1.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0],
            vec![0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        ];
        let found = sparse_basis(&mixed(&vectors), &none(8), &[0, 0, 0, 1, 1, 2, 2, 2]);
        assert_eq!(found.len(), 3);
        assert_eq!(found[0].iter().filter(|e| **e != 0.0).count(), 1);
        let second = &found[1] / found[1][5];
        assert!((second[2] - 2.0).abs() < 1e-12, "{second}");
        // Three in the first, or one less through the second: both are shortest.
        assert!(found[2].iter().filter(|e| **e != 0.0).count() <= 4);
    }

    #[test]
    fn what_is_known_is_not_found_again() {
        let vectors = [vec![1.0, -1.0, 0.0, 0.0], vec![0.0, 1.0, 0.0, 1.0]];
        let known = DMatrix::from_fn(4, 1, |i, _| vectors[0][i] / 2.0_f64.sqrt());
        let found = sparse_basis(&mixed(&vectors), &known, &[0, 0, 0, 1]);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].iter().filter(|e| **e != 0.0).count(), 2);
        assert!(found[0][3] != 0.0);
    }

    #[test]
    fn no_space_has_no_basis_and_the_whole_space_has_the_unknowns() {
        assert!(sparse_basis(&none(3), &none(3), &[0, 0, 0]).is_empty());
        let all = sparse_basis(&DMatrix::identity(3, 3), &none(3), &[0, 1, 1]);
        for (k, v) in all.iter().enumerate() {
            assert_eq!(v.iter().filter(|e| **e != 0.0).count(), 1);
            assert_eq!(v[k], 1.0);
        }
    }
}
