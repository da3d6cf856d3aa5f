//! The 3×3 factorisations of the chain: positive-semidefinite square root and whitening.

use nalgebra::Matrix3;

/// A lower-triangular G with G Gᵀ = P for a positive-semidefinite P. A direction without
/// variance (known misalignment, no process noise) gives a zero column.
pub(crate) fn square_root(p: &Matrix3<f64>) -> Matrix3<f64> {
    let mut g = Matrix3::zeros();
    for j in 0..3 {
        let pivot = p[(j, j)] - (0..j).map(|k| g[(j, k)] * g[(j, k)]).sum::<f64>();
        // A pivot of rounding size belongs to a direction that is known already.
        if pivot <= 1e-15 * p[(j, j)] {
            continue;
        }
        let root = pivot.sqrt();
        g[(j, j)] = root;
        for i in j + 1..3 {
            let dot: f64 = (0..j).map(|k| g[(i, k)] * g[(j, k)]).sum();
            g[(i, j)] = (p[(i, j)] - dot) / root;
        }
    }
    g
}

/// L⁻¹ of the Cholesky factor L of I + B Bᵀ: positive definite whatever B is.
pub(crate) fn whitener(b: &Matrix3<f64>) -> Matrix3<f64> {
    let s = b * b.transpose() + Matrix3::identity();
    let l00 = s[(0, 0)].sqrt();
    let l10 = s[(1, 0)] / l00;
    let l20 = s[(2, 0)] / l00;
    let l11 = (s[(1, 1)] - l10 * l10).sqrt();
    let l21 = (s[(2, 1)] - l20 * l10) / l11;
    let l22 = (s[(2, 2)] - l20 * l20 - l21 * l21).sqrt();
    let (i0, i1, i2) = (1.0 / l00, 1.0 / l11, 1.0 / l22);
    let i10 = -l10 * i0 * i1;
    let i21 = -l21 * i1 * i2;
    let i20 = -(l20 * i0 + l21 * i10) * i2;
    Matrix3::new(i0, 0.0, 0.0, i10, i1, 0.0, i20, i21, i2)
}

/// (P⁻¹ + J)⁻¹ for P = G Gᵀ and J = Bᵀ B, as G (I + Gᵀ J G)⁻¹ Gᵀ: symmetric by construction,
/// nothing cancels, and P may be singular.
pub(crate) fn condition(g: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    let bg = b * g;
    let y = whitener(&bg.transpose()) * g.transpose();
    y.transpose() * y
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(seed: f64) -> Matrix3<f64> {
        // Quadratic in the indices, so that the matrix has full rank.
        Matrix3::from_fn(|i, j| {
            ((1.7 * (i * i) as f64 + 2.9 * (i * j + j) as f64 + seed) * 3.1).sin()
        })
    }

    #[test]
    fn square_root_of_full_and_deficient_matrices() {
        let a = sample(0.3);
        let full = a * a.transpose();
        let g = square_root(&full);
        assert!((g * g.transpose() - full).amax() < 1e-15);
        let deficient = Matrix3::new(4.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0);
        let g = square_root(&deficient);
        assert!((g * g.transpose() - deficient).amax() < 1e-15);
    }

    #[test]
    fn whitener_whitens() {
        let b = sample(1.0) * 50.0;
        let w = whitener(&b);
        let s = b * b.transpose() + Matrix3::identity();
        assert!((w * s * w.transpose() - Matrix3::identity()).amax() < 1e-11);
    }

    #[test]
    fn conditioning_adds_information() {
        let g = square_root(&(sample(0.3) * sample(0.3).transpose()));
        let b = sample(2.0);
        let p = g * g.transpose();
        let expected = (p.try_inverse().unwrap() + b.transpose() * b)
            .try_inverse()
            .unwrap();
        assert!((condition(&g, &b) - expected).amax() < 1e-12);
        assert_eq!(condition(&Matrix3::zeros(), &b), Matrix3::zeros());
    }
}
