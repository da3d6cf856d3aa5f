//! What counts as rank, in one place; and the space spanned by some rows.
//!
//! Orders, strict orders, separability, ranks, the condition number, the names of what is
//! unobservable or weak, and the reconstructions all ask the same question: is there anything in
//! this direction, or nothing but rounding? All of them ask [`counts`].

use super::singular::Singular;
use nalgebra::{DMatrix, DVector};

/// Relative size at and below which a part counts as none: of a singular value beside the largest,
/// of what is left of a combination beside its length, of what is new in a row beside the row.
///
/// As an angle it is 1e-7 rad, 0.02 arcsec: less than any stand sets or reads, so nothing that a
/// test could use is lost. And it must not be much smaller: the rows carry rounding of some 1e-15,
/// which turns the vectors that belong to a singular value of relative size s by 1e-15/s. With
/// s above 1e-7 that is 1e-8, a tenth of what the rest of a combination is then held against.
/// With a smaller one, rank says that a combination is seen and its rest says that it is not.
pub const RANK_TOLERANCE: f64 = 1e-7;

/// Whether `part` is anything beside `whole`, see [`RANK_TOLERANCE`].
pub(crate) fn counts(part: f64, whole: f64) -> bool {
    part > RANK_TOLERANCE * whole
}

/// A column whose largest entry is this share of the largest of all may hold a pivot.
const PIVOT: f64 = 0.1;

/// The row space of some rows in `N` unknowns: an orthonormal basis of what counts.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RowSpace<const N: usize> {
    basis: Vec<[f64; N]>,
    /// The singular value that belongs to each basis vector, largest first.
    values: Vec<f64>,
    /// What singular values are held against.
    largest: f64,
}

impl<const N: usize> RowSpace<N> {
    /// The space of `rows`.
    pub fn of(rows: &[[f64; N]]) -> Self {
        Self::beside(rows, 0.0)
    }

    /// The space of `rows`, part of a larger set whose largest singular value is `largest`: what
    /// counts in a part counts in the whole, so that ranks never fall when rows are added to
    /// the part.
    pub fn beside(rows: &[[f64; N]], largest: f64) -> Self {
        let svd = Singular::of(rows.len(), N, |i, j| rows[i][j]);
        let largest = svd.values.first().copied().unwrap_or(0.0).max(largest);
        let seen = svd.values.iter().filter(|v| counts(**v, largest)).count();
        Self {
            basis: (0..seen)
                .map(|k| std::array::from_fn(|j| svd.vector(k, j)))
                .collect(),
            values: svd.values[..seen].to_vec(),
            largest,
        }
    }

    /// Its dimension.
    pub fn rank(&self) -> usize {
        self.basis.len()
    }

    /// The largest singular value, of these rows or of the set they are part of.
    pub const fn largest(&self) -> f64 {
        self.largest
    }

    /// What is left of `vector` outside the space.
    pub fn residual(&self, vector: &[f64; N]) -> [f64; N] {
        let mut rest = *vector;
        for b in &self.basis {
            let along = dot(b, vector);
            for (r, b) in rest.iter_mut().zip(b) {
                *r -= along * b;
            }
        }
        rest
    }

    /// Whether `vector`, of any length but zero, lies in the space.
    pub fn contains(&self, vector: &[f64; N]) -> bool {
        let size = length(vector);
        size > 0.0 && !counts(length(&self.residual(vector)), size)
    }

    /// The orthogonal complement within the first `used` unknowns, in echelon form.
    pub fn missing(&self, used: usize) -> Vec<[f64; N]> {
        let rows = (0..used).map(|i| self.residual(&unit(i))).collect();
        echelon(rows, used.saturating_sub(self.rank()))
    }

    /// What the rows hardly see: the part that belongs to singular values below `share` of the
    /// largest, in echelon form.
    pub fn hardly_seen(&self, share: f64) -> Vec<[f64; N]> {
        let first = self.values.partition_point(|v| *v >= share * self.largest);
        echelon(self.basis[first..].to_vec(), self.rank() - first)
    }

    /// An orthonormal basis of those vectors of the space that have no part of unknown `j`.
    pub fn without(&self, j: usize) -> Vec<[f64; N]> {
        let parts: Vec<f64> = self.basis.iter().map(|b| b[j]).collect();
        let size = length(&parts);
        if !counts(size, 1.0) {
            return self.basis.clone();
        }
        // A Householder reflection turns the basis so that its first vector has all of it.
        let mut mirror: Vec<f64> = parts.iter().map(|p| p / size).collect();
        mirror[0] += if mirror[0] < 0.0 { -1.0 } else { 1.0 };
        let scale = 2.0 / dot(&mirror, &mirror);
        let mut turned = self.basis.clone();
        for i in 0..N {
            let along: f64 = mirror.iter().zip(&self.basis).map(|(m, b)| m * b[i]).sum();
            for (vector, m) in turned.iter_mut().zip(&mirror) {
                vector[i] -= scale * m * along;
            }
        }
        turned.remove(0);
        turned.iter_mut().for_each(|vector| vector[j] = 0.0);
        turned
    }
}

/// `count` independent combinations of `rows`, which have that rank, each with a one where no
/// other has an entry: first columns first, if what they hold is not small.
fn echelon<const N: usize>(mut rows: Vec<[f64; N]>, count: usize) -> Vec<[f64; N]> {
    let mut found: Vec<[f64; N]> = Vec::new();
    for _ in 0..count {
        let most = |rows: &[[f64; N]], j: usize| {
            let entries = rows.iter().map(|r| r[j].abs()).enumerate();
            entries
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .unwrap_or((0, 0.0))
        };
        let largest = (0..N).map(|j| most(&rows, j).1).fold(0.0, f64::max);
        let Some(column) = (0..N).find(|&j| most(&rows, j).1 >= PIVOT * largest && largest > 0.0)
        else {
            break;
        };
        let mut row = rows.swap_remove(most(&rows, column).0);
        let scale = row[column];
        row.iter_mut().for_each(|v| *v /= scale);
        for other in rows.iter_mut().chain(found.iter_mut()) {
            let factor = other[column];
            for (o, r) in other.iter_mut().zip(&row) {
                *o -= factor * r;
            }
        }
        found.push(row);
    }
    found
}

/// Least squares over all of some weighted rows, within the space that they span.
///
/// With R the rows and V the basis of their space, R V = Q T has full rank whatever the weights,
/// so that a combination c of the space is Rᵀ u with u = Q T⁻ᵀ Vᵀ c: of all such weights the
/// shortest, and with rows weighted by 1/σ those of least variance.
pub(super) struct AllRows<'a, const N: usize> {
    space: &'a RowSpace<N>,
    q: DMatrix<f64>,
    t: DMatrix<f64>,
}

impl<'a, const N: usize> AllRows<'a, N> {
    /// Of `rows`, whose space is `space` up to their weights.
    pub fn new(space: &'a RowSpace<N>, rows: &[[f64; N]]) -> Self {
        let height = rows.len().max(space.rank());
        let seen = DMatrix::from_fn(height, space.rank(), |i, k| {
            rows.get(i).map_or(0.0, |row| dot(row, &space.basis[k]))
        });
        let qr = seen.qr();
        Self {
            space,
            q: qr.q().rows(0, rows.len()).into_owned(),
            t: qr.r(),
        }
    }

    /// T⁻ᵀ Vᵀ c; none where a weight is too small for its row to be there at all.
    fn solved(&self, combination: &[f64; N]) -> Option<DVector<f64>> {
        let basis = self.space.basis.iter();
        let along: Vec<f64> = basis.map(|b| dot(b, combination)).collect();
        self.t.tr_solve_upper_triangular(&DVector::from_vec(along))
    }

    /// u, one for each row.
    pub fn weights(&self, combination: &[f64; N]) -> Option<DVector<f64>> {
        Some(&self.q * self.solved(combination)?)
    }

    /// uᵀ u: the variance of the combination where the rows are weighted by 1/σ.
    pub fn variance(&self, combination: &[f64; N]) -> Option<f64> {
        Some(self.solved(combination)?.norm_squared())
    }

    /// V T⁻¹ T⁻ᵀ Vᵀ c: what the unknowns do where the rows are taken for those of `combination`
    /// by errors. Covariances of all unknowns with it.
    pub fn covariances(&self, combination: &[f64; N]) -> Option<[f64; N]> {
        let z = self.t.solve_upper_triangular(&self.solved(combination)?)?;
        let mut sum = [0.0; N];
        for (b, z) in self.space.basis.iter().zip(z.iter()) {
            for (s, b) in sum.iter_mut().zip(b) {
                *s += b * z;
            }
        }
        Some(sum)
    }
}

/// Unit vector `i`.
pub(crate) fn unit<const N: usize>(i: usize) -> [f64; N] {
    std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 })
}

/// Scalar product.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Euclidean length.
pub(super) fn length(vector: &[f64]) -> f64 {
    dot(vector, vector).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close<const N: usize>(a: &[f64; N], b: &[f64; N]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-15)
    }

    #[test]
    fn a_plane_contains_its_vectors_and_misses_its_normal() {
        let space = RowSpace::of(&[[1.0, 1.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 3.0]]);
        assert_eq!(space.rank(), 2);
        assert!(space.contains(&[2.0, 2.0, -5.0]));
        assert!(!space.contains(&[1.0, 0.0, 0.0]));
        assert!(!space.contains(&[0.0; 3]));
        let missing = space.missing(3);
        assert_eq!(missing.len(), 1);
        assert!(close(&missing[0], &[1.0, -1.0, 0.0]));
        let without = space.without(2);
        assert_eq!(without.len(), 1);
        assert!((without[0][0].abs() - 0.5_f64.sqrt()).abs() < 1e-15 && without[0][2] == 0.0);
    }

    #[test]
    fn no_rows_span_nothing() {
        let space = RowSpace::<3>::of(&[]);
        assert_eq!((space.rank(), space.missing(2).len()), (0, 2));
        assert!(space.without(0).is_empty() && space.hardly_seen(1.0).is_empty());
    }

    #[test]
    fn names_start_with_what_is_large() {
        // Almost only the second unknown is missing: it leads, and nothing is a million times it.
        let tilt = 1e-4;
        let missing = RowSpace::of(&[[1.0, -tilt, 0.0], [0.0, 0.0, 1.0]]).missing(3);
        assert!(close(&missing[0], &[tilt, 1.0, 0.0]), "{missing:?}");
    }

    #[test]
    fn a_tilt_counts_above_the_tolerance_and_what_it_tells_is_hardly_seen() {
        let rows = |tilt: f64| [[1.0, 1.0], [1.0, 1.0 + tilt]];
        assert_eq!(RowSpace::of(&rows(1e-8)).rank(), 1);
        let space = RowSpace::of(&rows(1e-5));
        assert_eq!(space.rank(), 2);
        assert!(space.hardly_seen(1e-6).is_empty());
        let hardly = space.hardly_seen(1e-3);
        assert!((hardly[0][1] + 1.0).abs() < 1e-5 && hardly[0][0] == 1.0);
        // Beside rows a thousand times as large the same tilt is nothing.
        assert_eq!(RowSpace::beside(&rows(1e-5), 2e3).rank(), 1);
    }

    #[test]
    fn all_rows_give_the_shortest_weights() {
        let rows = [[1.0, 0.0], [1.0, 0.0], [0.0, 1e-5]];
        let space = RowSpace::of(&rows);
        let all = AllRows::new(&space, &rows);
        let weights = all.weights(&[1.0, 1.0]).unwrap();
        for (found, expected) in weights.iter().zip([0.5, 0.5, 1e5]) {
            // The basis has the rounding of the large rows, 1e-16: beside the small one, 1e-11.
            assert!((found / expected - 1.0).abs() < 1e-10, "{weights}");
        }
        assert!((all.variance(&[1.0, 0.0]).unwrap() - 0.5).abs() < 1e-15);
        let [other, own] = all.covariances(&[0.0, 1.0]).unwrap();
        assert!(
            (own * 1e-10 - 1.0).abs() < 1e-10 && other.abs() < 1.0,
            "{own} {other}"
        );
    }
}
