//! The levelling problem: what directions of gravity tell at order 1.
//!
//! At each position the order-1 channels show the two horizontal components of ε^n,
//!
//! ```text
//! y = (I − u uᵀ)(d + G u),
//! ```
//!
//! u the gravity direction in the platform, d the 3 constant and G the 9 g-sensitive
//! coefficients: ε^c = d + G u of (3) without its vertical part. With equal noise and ψ_y known the
//! information of a set of directions is M = mean(Jᵀ J), J = ∂y/∂D. Heading does not matter.
//!
//! Under rotations G splits into its trace, which y never shows ((I − uuᵀ) u = 0: the paper's
//! Conclusion 2), three antisymmetric and five symmetric traceless parts. The uniform sphere is
//! optimal in every sense that is invariant under rotation; its eigenvalues are 2/3 (d), 1/3
//! (antisymmetric), 1/5 (symmetric traceless) and 0 (trace).

use nalgebra::{Matrix3, Vector3};

use super::row_space::counts;
use super::singular::Singular;
use crate::drift::{COEFFICIENTS, CoefficientMatrix, DriftCoefficient, DriftMatrix};
use crate::error::{Error, Result};
use crate::schedule::standard::StandardScheme;

/// How many combinations of coefficients the horizontal components can show: all but
/// D_IX + D_IY + D_IZ.
pub const SEEN: usize = 11;

/// ln det of the uniform sphere's information without the trace: 3 ln ⅔ + 3 ln ⅓ + 5 ln ⅕.
pub const SPHERE_LOG_DET: f64 = -12.559_421_752_499_324;

/// The information of a set of gravity directions in the levelling problem, per direction.
///
/// ```
/// use scheme_opt::internals::observability::levelling::Levelling;
/// use scheme_opt::internals::schedule::standard::StandardScheme;
/// let faces = Levelling::of_scheme(StandardScheme::Faces6)?;
/// // The six-position test: none of the three D_I is of order 1.
/// assert_eq!(faces.rank(), 9);
/// # Ok::<(), scheme_opt::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Levelling {
    information: CoefficientMatrix,
    /// Singular values of the stacked J, per direction: the roots of its eigenvalues, with all
    /// their digits.
    singular_values: Vec<f64>,
}

impl Levelling {
    /// Of `directions` of gravity in the platform, of any length but zero.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] when there is none, or one is zero or not finite.
    pub fn new(directions: &[Vector3<f64>]) -> Result<Self> {
        let refused = |what: String| {
            Error::input("not a set of gravity directions")
                .with_key("directions")
                .with_value(what)
                .with_allowed("at least one finite vector other than zero")
        };
        if directions.is_empty() {
            return Err(refused("none".to_owned()));
        }
        let mut information = CoefficientMatrix::zeros();
        let mut rows = Vec::with_capacity(3 * directions.len());
        for direction in directions {
            let unit = direction
                .try_normalize(1e-12)
                .filter(|u| u.iter().all(|v| v.is_finite()))
                .ok_or_else(|| refused(format!("{:?}", direction.as_slice())))?;
            let sensitivity = sensitivity(&unit);
            information += sensitivity.transpose() * sensitivity;
            rows.extend(sensitivity.row_iter().map(|row| row.into_owned()));
        }
        let count = directions.len() as f64;
        let svd = Singular::of(rows.len(), COEFFICIENTS, |i, j| rows[i][j]);
        Ok(Self {
            information: information / count,
            singular_values: svd.values.iter().map(|v| v / count.sqrt()).collect(),
        })
    }

    /// Of the gravity directions of a built-in scheme, each position once.
    ///
    /// # Errors
    ///
    /// None in fact: a scheme has positions, and gravity a direction.
    pub fn of_scheme(scheme: StandardScheme) -> Result<Self> {
        let positions = scheme.positions();
        let directions: Vec<Vector3<f64>> =
            positions.iter().map(|p| p.attitude().gravity_c()).collect();
        Self::new(&directions)
    }

    /// The information matrix M, dimensionless (g² for the g-sensitive coefficients).
    pub const fn information(&self) -> &CoefficientMatrix {
        &self.information
    }

    /// Its eigenvalues, largest first.
    pub fn eigenvalues(&self) -> Vec<f64> {
        self.singular_values.iter().map(|v| v * v).collect()
    }

    /// How many combinations of coefficients the directions show; 11 at best.
    pub fn rank(&self) -> usize {
        let values = &self.singular_values;
        values.iter().filter(|v| counts(**v, values[0])).count()
    }

    /// The eigenvalues of what can be seen at all; none when some of it is not.
    fn seen(&self) -> Option<Vec<f64>> {
        (self.rank() == SEEN).then(|| self.eigenvalues()[..SEEN].to_vec())
    }

    /// ln det M without the trace; minus infinity when the rank is short.
    pub fn log_det(&self) -> f64 {
        self.seen().map_or(f64::NEG_INFINITY, |values| {
            values.iter().map(|v| libm::log(*v)).sum()
        })
    }

    /// tr M⁻¹ without the trace combination; infinite when the rank is short. 38.5 at best.
    pub fn trace_of_inverse(&self) -> f64 {
        self.seen().map_or(f64::INFINITY, |values| {
            values.iter().map(|v| v.recip()).sum()
        })
    }

    /// D-efficiency (det M / det M of the uniform sphere)^(1/11), 0 to 1: the share of the
    /// measuring time that the sphere would need for the same determinant.
    pub fn d_efficiency(&self) -> f64 {
        libm::exp((self.log_det() - SPHERE_LOG_DET) / SEEN as f64)
    }
}

/// J of one direction: the horizontal part of ε^c by coefficient.
fn sensitivity(gravity_c: &Vector3<f64>) -> DriftMatrix {
    let horizontal = Matrix3::identity() - gravity_c * gravity_c.transpose();
    let mut columns = DriftMatrix::zeros();
    for c in DriftCoefficient::ALL {
        let column = horizontal.column(c.gyro()) * c.factor(gravity_c);
        columns.set_column(c.index(), &column);
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observability::Combination;

    #[test]
    fn the_trace_is_never_seen() {
        let generic = [[1.0, 2.0, 3.0], [-0.3, 0.1, 0.7], [0.5, -2.0, 0.2]];
        let m = Levelling::new(&generic.map(Vector3::from)).unwrap();
        let trace = Combination::input_trace().coefficients();
        assert!((m.information() * trace).amax() < 1e-15);
    }

    #[test]
    fn what_is_no_direction_is_refused() {
        assert!(Levelling::new(&[]).unwrap_err().is_input());
        for bad in [Vector3::zeros(), Vector3::new(f64::NAN, 1.0, 0.0)] {
            let error = Levelling::new(&[Vector3::x(), bad]).unwrap_err();
            assert_eq!(error.key(), Some("directions"));
        }
    }

    #[test]
    fn a_fine_uniform_set_approaches_the_sphere() {
        // A Fibonacci lattice: equal areas, golden-angle steps.
        let n = 20_000;
        let directions: Vec<Vector3<f64>> = (0..n)
            .map(|k| {
                let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(n);
                let angle = f64::from(k) * std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
                let r = (1.0 - z * z).sqrt();
                Vector3::new(r * angle.cos(), r * angle.sin(), z)
            })
            .collect();
        let m = Levelling::new(&directions).unwrap();
        let expected = [2.0 / 3.0, 1.0 / 3.0, 0.2, 0.0];
        for (k, value) in m.eigenvalues().into_iter().enumerate() {
            let block = [0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 3][k];
            assert!((value - expected[block]).abs() < 1e-5, "{k}: {value}");
        }
        assert!((m.d_efficiency() - 1.0).abs() < 1e-6);
    }
}
