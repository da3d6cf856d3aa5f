//! Singular values and right singular vectors of rows.

use nalgebra::DMatrix;

/// Rounds of rotations, after which the columns are as orthogonal as they will be; six to ten are
/// usual, and every one of them leaves the decomposition as exact as it was.
const ROUNDS: usize = 40;

/// The singular values of a matrix and its right singular vectors.
pub(super) struct Singular {
    /// Largest first, as many as the matrix has columns.
    pub values: Vec<f64>,
    /// In columns.
    vectors: DMatrix<f64>,
}

impl Singular {
    /// Of the matrix with `height` rows and `width` columns whose entry (i, j) is `entry(i, j)`,
    /// all finite.
    ///
    /// By one-sided Jacobi rotations (Hestenes, *Inversion of matrices by biorthogonalization*,
    /// J. SIAM 6(1), 1958) of the columns of its triangular factor. Iterations on a bidiagonal form
    /// may fail to converge, and an explanation must not be lost to that: here each rotation
    /// makes two columns orthogonal and can always be done. Small singular values come out with
    /// digits of their own (Demmel & Veselić, *Jacobi's method is more accurate than QR*, SIAM J.
    /// Matrix Anal. Appl. 13(4), 1992), and in plain arithmetic the same everywhere, which
    /// documents rely on.
    pub fn of(height: usize, width: usize, entry: impl Fn(usize, usize) -> f64) -> Self {
        let mut columns = DMatrix::from_fn(height, width, entry);
        if height > width {
            columns = columns.qr().r();
        }
        let mut vectors = DMatrix::identity(width, width);
        for _ in 0..ROUNDS {
            let mut rotated = false;
            for p in 0..width {
                for q in p + 1..width {
                    rotated |= rotate(&mut columns, &mut vectors, p, q);
                }
            }
            if !rotated {
                break;
            }
        }
        let lengths: Vec<f64> = columns.column_iter().map(|c| c.norm()).collect();
        let mut order: Vec<usize> = (0..width).collect();
        order.sort_by(|&a, &b| lengths[b].total_cmp(&lengths[a]));
        Self {
            values: order.iter().map(|&k| lengths[k]).collect(),
            vectors: DMatrix::from_fn(width, width, |j, k| vectors[(j, order[k])]),
        }
    }

    /// Component `j` of right singular vector `k`.
    pub fn vector(&self, k: usize, j: usize) -> f64 {
        self.vectors[(j, k)]
    }
}

/// Makes columns `p` and `q` orthogonal; false where they are.
fn rotate(columns: &mut DMatrix<f64>, vectors: &mut DMatrix<f64>, p: usize, q: usize) -> bool {
    let (a, b) = (columns.column(p), columns.column(q));
    let (aa, bb, ab) = (a.norm_squared(), b.norm_squared(), a.dot(&b));
    let rounding = columns.ncols() as f64 * f64::EPSILON;
    let apart = ab.abs() > rounding * aa.sqrt() * bb.sqrt();
    if !apart {
        return false;
    }
    let cotangent_of_twice = (bb - aa) / (2.0 * ab);
    let tangent = cotangent_of_twice.signum()
        / (cotangent_of_twice.abs() + (1.0 + cotangent_of_twice * cotangent_of_twice).sqrt());
    let cosine = (1.0 + tangent * tangent).sqrt().recip();
    let sine = cosine * tangent;
    for matrix in [columns, vectors] {
        for i in 0..matrix.nrows() {
            let (a, b) = (matrix[(i, p)], matrix[(i, q)]);
            matrix[(i, p)] = cosine * a - sine * b;
            matrix[(i, q)] = sine * a + cosine * b;
        }
    }
    tangent != 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DVector;

    #[test]
    fn values_and_vectors_are_those_of_another_decomposition() {
        for (height, width) in [(40, 13), (13, 13), (5, 13), (1, 3), (3, 1)] {
            let entry = |i: usize, j: usize| {
                let k = (7 * i + 3 * j) as f64;
                libm::sin(k * k) * libm::exp(-(j as f64))
            };
            let found = Singular::of(height, width, entry);
            let matrix = DMatrix::from_fn(height, width, entry);
            let other = matrix.clone().svd(false, false);
            for (k, value) in found.values.iter().enumerate() {
                let expected = other.singular_values.get(k).copied().unwrap_or(0.0);
                assert!((value - expected).abs() < 1e-14 * found.values[0], "{k}");
                let vector = DVector::from_fn(width, |j, _| found.vector(k, j));
                assert!((vector.norm() - 1.0).abs() < 1e-14);
                let seen = (&matrix * vector).norm();
                assert!((seen - value).abs() < 1e-14 * found.values[0], "{k}");
            }
        }
    }

    #[test]
    fn small_values_keep_digits_of_their_own() {
        // Columns of lengths 1 and 1e-12, almost parallel: σ₂ = 1e-12 sin(angle).
        let (angle, small) = (0.3, 1e-12);
        let columns = [
            [1.0, 0.0],
            [small * libm::cos(angle), small * libm::sin(angle)],
        ];
        let found = Singular::of(2, 2, |i, j| columns[j][i]);
        let expected = small * libm::sin(angle);
        assert!((found.values[1] / expected - 1.0).abs() < 1e-14);
    }

    #[test]
    fn nothing_is_decomposed_into_nothing() {
        assert!(
            Singular::of(0, 3, |_, _| 1.0)
                .values
                .iter()
                .all(|v| *v == 0.0)
        );
        assert!(Singular::of(3, 0, |_, _| 1.0).values.is_empty());
    }
}
