//! The space spanned by some rows: its rank, what it contains, what it misses.

use super::singular::Singular;
use crate::error::Result;

/// Relative size below which a singular value counts as zero.
const RANK_TOLERANCE: f64 = 1e-9;
/// Length, of a combination of length one, below which a rest counts as none.
const REST_TOLERANCE: f64 = 1e-7;

/// An orthonormal basis of the row space of some rows in `N` unknowns.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RowSpace<const N: usize> {
    basis: Vec<[f64; N]>,
}

impl<const N: usize> RowSpace<N> {
    /// The space of `rows`, by singular value decomposition.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when it does not converge.
    pub fn of(rows: &[[f64; N]]) -> Result<Self> {
        if rows.is_empty() {
            return Ok(Self { basis: Vec::new() });
        }
        let svd = Singular::of(rows.len(), N, |i, j| rows[i][j])?;
        let values = &svd.values;
        let largest = values[0];
        let basis = (0..values.len())
            .filter(|&k| values[k] > RANK_TOLERANCE * largest)
            .map(|k| std::array::from_fn(|j| svd.vector(k, j)))
            .collect();
        Ok(Self { basis })
    }

    /// Its dimension.
    pub fn rank(&self) -> usize {
        self.basis.len()
    }

    /// What is left of `vector` outside the space.
    pub fn residual(&self, vector: &[f64; N]) -> [f64; N] {
        let mut rest = *vector;
        for b in &self.basis {
            let along: f64 = b.iter().zip(vector).map(|(b, v)| b * v).sum();
            for (r, b) in rest.iter_mut().zip(b) {
                *r -= along * b;
            }
        }
        rest
    }

    /// Whether `vector`, of any length but zero, lies in the space.
    pub fn contains(&self, vector: &[f64; N]) -> bool {
        let size = length(vector);
        size > 0.0 && length(&self.residual(vector)) <= REST_TOLERANCE * size
    }

    /// The orthogonal complement within the first `used` unknowns, reduced to echelon form: each
    /// vector starts with a one, and no other has an entry there.
    pub fn missing(&self, used: usize) -> Vec<[f64; N]> {
        let mut rows: Vec<[f64; N]> = (0..used).map(|i| self.residual(&unit(i))).collect();
        let mut echelon: Vec<[f64; N]> = Vec::new();
        for column in 0..used {
            let pivot = (0..rows.len())
                .max_by(|&a, &b| rows[a][column].abs().total_cmp(&rows[b][column].abs()));
            let Some(pivot) = pivot else { break };
            if rows[pivot][column].abs() < REST_TOLERANCE {
                continue;
            }
            let mut row = rows.swap_remove(pivot);
            let scale = row[column];
            row.iter_mut().for_each(|v| *v /= scale);
            for other in rows.iter_mut().chain(echelon.iter_mut()) {
                let factor = other[column];
                for (o, r) in other.iter_mut().zip(&row) {
                    *o -= factor * r;
                }
            }
            echelon.push(row);
        }
        echelon
    }
}

/// Unit vector `i`.
pub(crate) fn unit<const N: usize>(i: usize) -> [f64; N] {
    std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 })
}

fn length(vector: &[f64]) -> f64 {
    vector.iter().map(|v| v * v).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_contains_its_vectors_and_misses_its_normal() {
        let space = RowSpace::of(&[[1.0, 1.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 3.0]]).unwrap();
        assert_eq!(space.rank(), 2);
        assert!(space.contains(&[2.0, 2.0, -5.0]));
        assert!(!space.contains(&[1.0, 0.0, 0.0]));
        assert!(!space.contains(&[0.0; 3]));
        let missing = space.missing(3);
        assert_eq!(missing.len(), 1);
        let expected = [1.0, -1.0, 0.0];
        assert!(
            missing[0]
                .iter()
                .zip(expected)
                .all(|(a, b)| (a - b).abs() < 1e-15)
        );
    }

    #[test]
    fn no_rows_span_nothing() {
        let space = RowSpace::<3>::of(&[]).unwrap();
        assert_eq!((space.rank(), space.missing(2).len()), (0, 2));
    }
}
