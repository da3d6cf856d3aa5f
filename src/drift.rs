//! The gyro drift model and the drift matrix A(position): ε^n = A D.
//!
//! # From (3) to A
//!
//! Each gyro has a constant drift D_F and drifts proportional to the specific force along its
//! input (D_I), output (D_O) and spin (D_S) axis. In the seed paper's mounting the axes (I, O, S)
//! are, in the platform, X gyro (+x, −z, +y), Y gyro (+y, −z, −x), Z gyro (+z, +x, +y), each
//! right-handed (I × O = S), so that with g = g^c of (20)
//!
//! ```text
//! ε_x = D_FX + D_IX g_x + D_SX g_y − D_OX g_z
//! ε_y = D_FY − D_SY g_x + D_IY g_y − D_OY g_z
//! ε_z = D_FZ + D_OZ g_x + D_SZ g_y + D_IZ g_z
//! ```
//!
//! This is (21) with its first line corrected: the paper prints +D_SX where (22), (27) and (28)
//! need −D_SX cosα cosγ − … (its plus sign would make the X gyro left-handed). It also follows
//! from (4) only with the specific force taken as g^c instead of the printed −g^c. See
//! [`expansions`] for (22), (23) and their misprints.
//!
//! Turned into n, ε^n = C_c^n ε^c = A(α, β, γ) D with A of shape 3 × [`COEFFICIENTS`]. Every
//! column of A is one column of C_c^n times 1 or ±g_i: one non-zero entry per column in the
//! body frame. That structure is what [`DriftMatrix`] products below rely on.

pub mod expansions;

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use serde::{Deserialize, Serialize};

use crate::attitude::{Attitude, Position, UP};

/// How many drift coefficients the error model has. The one place that knows.
pub const COEFFICIENTS: usize = 12;

/// A (or any product with it): 3 × [`COEFFICIENTS`].
pub type DriftMatrix = SMatrix<f64, 3, COEFFICIENTS>;
/// A symmetric matrix over the coefficients: information or covariance.
pub type CoefficientMatrix = SMatrix<f64, COEFFICIENTS, COEFFICIENTS>;
/// One number per coefficient.
pub type CoefficientVector = SVector<f64, COEFFICIENTS>;

/// A drift coefficient, in the order of all vectors and matrices of this crate.
#[allow(missing_docs, reason = "the variants are the coefficients' own names")]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub enum DriftCoefficient {
    #[serde(rename = "D_FX")]
    FX,
    #[serde(rename = "D_FY")]
    FY,
    #[serde(rename = "D_FZ")]
    FZ,
    #[serde(rename = "D_IX")]
    IX,
    #[serde(rename = "D_IY")]
    IY,
    #[serde(rename = "D_IZ")]
    IZ,
    #[serde(rename = "D_OX")]
    OX,
    #[serde(rename = "D_OY")]
    OY,
    #[serde(rename = "D_OZ")]
    OZ,
    #[serde(rename = "D_SX")]
    SX,
    #[serde(rename = "D_SY")]
    SY,
    #[serde(rename = "D_SZ")]
    SZ,
}

/// Which drift of a gyro a coefficient describes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum DriftKind {
    /// Constant drift D_F.
    Constant,
    /// Drift per g along the input axis, D_I.
    Input,
    /// Drift per g along the output axis, D_O.
    Output,
    /// Drift per g along the spin axis, D_S.
    Spin,
}

impl DriftCoefficient {
    /// All coefficients in order.
    pub const ALL: [Self; COEFFICIENTS] = [
        Self::FX,
        Self::FY,
        Self::FZ,
        Self::IX,
        Self::IY,
        Self::IZ,
        Self::OX,
        Self::OY,
        Self::OZ,
        Self::SX,
        Self::SY,
        Self::SZ,
    ];

    /// Position in all vectors and matrices.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The name used in files and tables, `D_FX` … `D_SZ`.
    pub const fn name(self) -> &'static str {
        [
            "D_FX", "D_FY", "D_FZ", "D_IX", "D_IY", "D_IZ", "D_OX", "D_OY", "D_OZ", "D_SX", "D_SY",
            "D_SZ",
        ][self.index()]
    }

    /// The coefficient of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|c| c.name() == name)
    }

    /// Which drift it describes.
    pub const fn kind(self) -> DriftKind {
        match self {
            Self::FX | Self::FY | Self::FZ => DriftKind::Constant,
            Self::IX | Self::IY | Self::IZ => DriftKind::Input,
            Self::OX | Self::OY | Self::OZ => DriftKind::Output,
            Self::SX | Self::SY | Self::SZ => DriftKind::Spin,
        }
    }

    /// The gyro it belongs to: 0, 1, 2 for X, Y, Z. Also the column of C_c^n it drives.
    pub const fn gyro(self) -> usize {
        self.index() % 3
    }

    /// What g-component, with what sign, multiplies it in ε^c; `None` for the constant drifts.
    /// The rows of the corrected (21) in the module text, read column by column.
    pub(crate) const fn excitation(self) -> Option<(usize, f64)> {
        match self {
            Self::FX | Self::FY | Self::FZ => None,
            Self::IX => Some((0, 1.0)),
            Self::IY => Some((1, 1.0)),
            Self::IZ => Some((2, 1.0)),
            Self::OX => Some((2, -1.0)),
            Self::OY => Some((2, -1.0)),
            Self::OZ => Some((0, 1.0)),
            Self::SX => Some((1, 1.0)),
            Self::SY => Some((0, -1.0)),
            Self::SZ => Some((1, 1.0)),
        }
    }

    /// The factor of this coefficient in ε^c of its gyro, for gravity g^c: 1 or ±g_i.
    pub fn factor(self, gravity_c: &Vector3<f64>) -> f64 {
        self.excitation()
            .map_or(1.0, |(axis, sign)| sign * gravity_c[axis])
    }
}

/// The drift rates of the three gyros in the platform frame for the specific force
/// `gravity_c` (g): ε^c, the corrected (21). `coefficients` in any rate unit.
pub fn drift_c(coefficients: &CoefficientVector, gravity_c: &Vector3<f64>) -> Vector3<f64> {
    let mut drift = Vector3::zeros();
    for c in DriftCoefficient::ALL {
        drift[c.gyro()] += c.factor(gravity_c) * coefficients[c.index()];
    }
    drift
}

/// The drift matrix A of an attitude: ε^n = A D. Shape 3 × [`COEFFICIENTS`]; dimensionless for
/// D_F, g for the others.
///
/// ```
/// use scheme_opt::internals::attitude::Position;
/// use scheme_opt::internals::drift::{drift_matrix, DriftCoefficient};
/// // (27): at p1 = (0, 0, 0), ε_x^n = D_FX − D_SX.
/// let a = drift_matrix(&Position::from_deg(0.0, 0.0, 0.0).attitude());
/// assert_eq!(a[(0, DriftCoefficient::FX.index())], 1.0);
/// assert_eq!(a[(0, DriftCoefficient::SX.index())], -1.0);
/// ```
pub fn drift_matrix(attitude: &Attitude) -> DriftMatrix {
    times_drift_matrix(&Matrix3::identity(), attitude)
}

/// X A for a 3×3 matrix X, through the structure of A: one 3×3 product and one scaling per
/// column instead of a 3×3×12 product.
pub fn times_drift_matrix(x: &Matrix3<f64>, attitude: &Attitude) -> DriftMatrix {
    let xc = x * attitude.matrix();
    let gravity_c = attitude.gravity_c();
    let mut out = DriftMatrix::zeros();
    for c in DriftCoefficient::ALL {
        let factor = c.factor(&gravity_c);
        out.set_column(c.index(), &(xc.column(c.gyro()) * factor));
    }
    out
}

/// Reverse mode of [`drift_matrix`] with respect to the angles: given ∂f/∂A at `position`,
/// returns ∂f/∂(α, β, γ).
///
/// With A's columns a = s_a(g) C_j, the adjoint of C collects s_a Ā_a in column j and, through
/// g = −(Up row of C)ᵀ, the adjoint of s_a in the Up row.
pub fn drift_matrix_adjoint(
    position: Position,
    attitude: &Attitude,
    a_adjoint: &DriftMatrix,
) -> [f64; 3] {
    let c = attitude.matrix();
    let gravity_c = attitude.gravity_c();
    let mut c_adjoint = Matrix3::zeros();
    for coefficient in DriftCoefficient::ALL {
        let j = coefficient.gyro();
        let column = a_adjoint.column(coefficient.index());
        let scaled = column * coefficient.factor(&gravity_c);
        let mut target = c_adjoint.column_mut(j);
        target += scaled;
        if let Some((axis, sign)) = coefficient.excitation() {
            c_adjoint[(UP, axis)] -= sign * c.column(j).dot(&column);
        }
    }
    attitude.angle_adjoint(position, &c_adjoint)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_indices_agree() {
        for (i, c) in DriftCoefficient::ALL.into_iter().enumerate() {
            assert_eq!(c.index(), i);
            assert_eq!(DriftCoefficient::from_name(c.name()), Some(c));
            assert_eq!(
                serde_json::to_string(&c).unwrap(),
                format!("\"{}\"", c.name())
            );
        }
    }

    #[test]
    fn gyro_axes_are_right_handed() {
        // Each gyro's (I, O, S) unit vectors, read off the excitations: I × O = S.
        use DriftCoefficient as D;
        for [i, o, s] in [
            [D::IX, D::OX, D::SX],
            [D::IY, D::OY, D::SY],
            [D::IZ, D::OZ, D::SZ],
        ] {
            let axis = |c: D| {
                let (index, sign) = c.excitation().unwrap();
                let mut v = Vector3::zeros();
                v[index] = sign;
                v
            };
            assert_eq!(axis(i).cross(&axis(o)), axis(s));
        }
    }

    #[test]
    fn drift_matrix_is_the_platform_drift_turned_into_n() {
        let attitude = Position::from_rad(0.3, -1.1, 2.0).attitude();
        let d = CoefficientVector::from_fn(|i, _| 1.0 + i as f64);
        let expected = attitude.matrix() * drift_c(&d, &attitude.gravity_c());
        assert!((drift_matrix(&attitude) * d - expected).amax() < 1e-13);
    }

    #[test]
    fn trace_of_the_input_coefficients_is_the_same_everywhere() {
        // Conclusion 2: D_IX = D_IY = D_IZ = 1 gives ε^n = (0, −1, 0) at every position.
        let mut d = CoefficientVector::zeros();
        for c in [
            DriftCoefficient::IX,
            DriftCoefficient::IY,
            DriftCoefficient::IZ,
        ] {
            d[c.index()] = 1.0;
        }
        for angles in [[0.0, 0.0, 0.0], [0.3, 1.0, -2.0], [2.9, -0.5, 0.4]] {
            let a = drift_matrix(&Position::from_array(angles).attitude());
            assert!((a * d - Vector3::new(0.0, -1.0, 0.0)).amax() < 1e-15);
        }
    }

    #[test]
    fn adjoint_is_the_derivative() {
        let weight = DriftMatrix::from_fn(|i, j| ((3 * i + 5 * j) as f64).sin());
        let f = |p: [f64; 3]| drift_matrix(&Position::from_array(p).attitude()).dot(&weight);
        let angles = [0.7, -0.4, 2.2];
        let position = Position::from_array(angles);
        let gradient = drift_matrix_adjoint(position, &position.attitude(), &weight);
        for i in 0..3 {
            let (mut hi, mut lo) = (angles, angles);
            hi[i] += 1e-6;
            lo[i] -= 1e-6;
            assert!(((f(hi) - f(lo)) / 2e-6 - gradient[i]).abs() < 1e-8);
        }
    }
}
