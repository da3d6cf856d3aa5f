//! The square root of the filter's covariance: P = Uᵀ U with U upper triangular, states in the
//! order (D, ψ^n).
//!
//! With the constants D first, a time update touches the last three columns only, and its
//! retriangularisation is one of 6 × 3; a scalar measurement is one sweep of Givens rotations.
//! Nothing is subtracted, so P is positive semi-definite whatever the rounding does; a
//! coefficient with prior σ = 0 keeps an exact zero row.

use nalgebra::{Matrix3, SMatrix, Vector3};

use crate::drift::{COEFFICIENTS, DriftMatrix};

/// D and ψ^n.
pub(super) const STATES: usize = COEFFICIENTS + 3;
/// Index of ψ^n's first component.
pub(super) const PSI: usize = COEFFICIENTS;

/// One number per state: D in °/h, then ψ^n in arcsec.
pub(super) type StateVector = [f64; STATES];

/// The gain of one scalar measurement and the 1σ of its innovation.
#[derive(Debug, Clone, Copy)]
pub(super) struct ScalarGain {
    pub gain: StateVector,
    pub innovation_sigma: f64,
}

/// NEES of a state error: e_Dᵀ P_D⁻¹ e_D and eᵀ P⁻¹ e, with their degrees of freedom (fewer than
/// the states when something is known exactly).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Nees {
    pub coefficients: f64,
    pub coefficient_dof: usize,
    pub states: f64,
    pub state_dof: usize,
}

/// U of P = Uᵀ U.
#[derive(Debug, Clone)]
pub(super) struct SquareRoot([[f64; STATES]; STATES]);

impl SquareRoot {
    /// A diagonal covariance of these 1σ.
    pub fn diagonal(sigma: &StateVector) -> Self {
        let mut u = [[0.0; STATES]; STATES];
        for (i, s) in sigma.iter().enumerate() {
            u[i][i] = *s;
        }
        Self(u)
    }

    /// ψ ← Φ ψ + B D + noise of `variance` per axis.
    pub fn predict(&mut self, phi: &Matrix3<f64>, b: &DriftMatrix, variance: f64) {
        for k in 0..COEFFICIENTS {
            let row = &self.0[k];
            let mut psi = phi * Vector3::new(row[PSI], row[PSI + 1], row[PSI + 2]);
            for (j, value) in row.iter().enumerate().take(COEFFICIENTS).skip(k) {
                psi += b.column(j) * *value;
            }
            self.0[k][PSI..].copy_from_slice(psi.as_slice());
        }
        let mut stacked = SMatrix::<f64, 6, 3>::zeros();
        for k in 0..3 {
            let row = &self.0[PSI + k];
            let psi = phi * Vector3::new(row[PSI], row[PSI + 1], row[PSI + 2]);
            stacked.set_row(k, &psi.transpose());
            stacked[(3 + k, k)] = variance.sqrt();
        }
        let r = stacked.qr().r();
        for k in 0..3 {
            for j in 0..3 {
                self.0[PSI + k][PSI + j] = r[(k, j)];
            }
        }
    }

    /// ψ ← X ψ: a change of the frame or of the point of linearisation.
    pub fn turn(&mut self, x: &Matrix3<f64>) {
        self.predict(x, &DriftMatrix::zeros(), 0.0);
    }

    /// Takes a measurement `sign` · ψ_axis + noise of 1σ `noise`.
    pub fn update(&mut self, axis: usize, sign: f64, noise: f64) -> ScalarGain {
        // Rows [s mᵀ] and [f_k U_k]: rotating f_k to zero from the last row upwards keeps U
        // triangular, for m is then zero before column k.
        let mut m = [0.0; STATES];
        let mut s = noise;
        for k in (0..STATES).rev() {
            let row = &mut self.0[k];
            let f = sign * row[PSI + axis];
            if f == 0.0 {
                continue;
            }
            let rho = libm::hypot(s, f);
            let (cos, sin) = (s / rho, f / rho);
            for j in k..STATES {
                let (a, b) = (m[j], row[j]);
                m[j] = cos * a + sin * b;
                row[j] = cos * b - sin * a;
            }
            s = rho;
        }
        ScalarGain {
            gain: m.map(|v| v / s),
            innovation_sigma: s,
        }
    }

    /// 1σ of every state.
    pub fn sigma(&self) -> StateVector {
        std::array::from_fn(|j| {
            let sum: f64 = (0..=j).map(|k| self.0[k][j].powi(2)).sum();
            sum.sqrt()
        })
    }

    /// Covariance of ψ^n.
    pub fn misalignment_covariance(&self) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| {
            (0..STATES)
                .map(|k| self.0[k][PSI + i] * self.0[k][PSI + j])
                .sum()
        })
    }

    /// The normalised estimation error squared of `error`.
    pub fn nees(&self, error: &StateVector) -> Nees {
        let mut nees = Nees::default();
        // Uᵀ y = e by forward substitution; the first rows are those of D alone.
        let mut y = [0.0; STATES];
        for k in 0..STATES {
            if self.0[k][k] == 0.0 {
                continue;
            }
            let known: f64 = (0..k).map(|i| self.0[i][k] * y[i]).sum();
            y[k] = (error[k] - known) / self.0[k][k];
            nees.states += y[k] * y[k];
            nees.state_dof += 1;
            if k < COEFFICIENTS {
                nees.coefficients += y[k] * y[k];
                nees.coefficient_dof += 1;
            }
        }
        nees
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{SMatrix, SVector};

    type Dense = SMatrix<f64, STATES, STATES>;

    fn dense(root: &SquareRoot) -> Dense {
        let u = Dense::from_fn(|i, j| root.0[i][j]);
        u.transpose() * u
    }

    #[test]
    fn agrees_with_the_textbook_filter() {
        let sigma: StateVector = std::array::from_fn(|i| 1.0 + 0.3 * i as f64);
        let mut root = SquareRoot::diagonal(&sigma);
        let mut p = dense(&root);
        let phi = Matrix3::new(0.9, 0.1, -0.2, 0.05, 1.0, 0.3, 0.1, -0.3, 0.95);
        let b = DriftMatrix::from_fn(|i, j| ((2 * i + 7 * j) as f64).sin());
        for round in 0..20 {
            root.predict(&phi, &b, 0.25);
            let mut f = Dense::identity();
            f.fixed_view_mut::<3, 3>(PSI, PSI).copy_from(&phi);
            f.fixed_view_mut::<3, COEFFICIENTS>(PSI, 0).copy_from(&b);
            p = f * p * f.transpose();
            for i in PSI..STATES {
                p[(i, i)] += 0.25;
            }
            let (axis, sign) = if round % 2 == 0 { (2, 1.0) } else { (0, -1.0) };
            let g = root.update(axis, sign, 0.7);
            let ph = p.column(PSI + axis) * sign;
            let s = ph[PSI + axis] * sign + 0.49;
            assert!((g.innovation_sigma - s.sqrt()).abs() < 1e-10);
            assert!((SVector::from(g.gain) - ph / s).amax() < 1e-10);
            p -= ph * ph.transpose() / s;
        }
        assert!((dense(&root) - p).amax() < 1e-9);
        let e: StateVector = std::array::from_fn(|i| (i as f64).cos());
        let v = SVector::<f64, STATES>::from(e);
        let nees = root.nees(&e);
        let expected = v.dot(&p.try_inverse().unwrap().map(|x| x).transpose().tr_mul(&v));
        assert!((nees.states / expected - 1.0).abs() < 1e-6);
        assert_eq!((nees.state_dof, nees.coefficient_dof), (15, 12));
    }

    #[test]
    fn what_is_known_exactly_stays_known() {
        let mut sigma = [2.0; STATES];
        sigma[3] = 0.0;
        let mut root = SquareRoot::diagonal(&sigma);
        for _ in 0..5 {
            root.predict(&Matrix3::identity(), &DriftMatrix::repeat(0.5), 0.1);
            root.update(2, 1.0, 0.3);
        }
        assert_eq!(root.sigma()[3], 0.0);
        assert_eq!(root.nees(&[0.1; STATES]).state_dof, STATES - 1);
    }
}
