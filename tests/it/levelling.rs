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

use nalgebra::{DMatrix, Matrix3, Vector3};
use scheme_opt::internals::drift::{
    COEFFICIENTS, CoefficientMatrix, DriftCoefficient, DriftMatrix,
};
use scheme_opt::internals::observability::{Combination, RANK_TOLERANCE};
use scheme_opt::internals::schedule::standard::StandardScheme;

/// How many combinations of coefficients the horizontal components can show: all but
/// D_IX + D_IY + D_IZ.
const SEEN: usize = 11;

/// ln det of the uniform sphere's information without the trace: 3 ln ⅔ + 3 ln ⅓ + 5 ln ⅕.
const SPHERE_LOG_DET: f64 = -12.559_421_752_499_324;

/// The information of a set of gravity directions in the levelling problem, per direction.
#[derive(Debug, Clone, PartialEq)]
struct Levelling {
    information: CoefficientMatrix,
    /// Singular values of the stacked J, per direction: the roots of its eigenvalues, with all
    /// their digits.
    singular_values: Vec<f64>,
}

impl Levelling {
    /// Of `directions` of gravity in the platform, of any length but zero.
    fn new(directions: &[Vector3<f64>]) -> Self {
        let mut information = CoefficientMatrix::zeros();
        let mut rows = DMatrix::zeros(3 * directions.len(), COEFFICIENTS);
        for (k, direction) in directions.iter().enumerate() {
            let sensitivity = sensitivity(&direction.normalize());
            information += sensitivity.transpose() * sensitivity;
            rows.rows_mut(3 * k, 3).copy_from(&sensitivity);
        }
        let count = directions.len() as f64;
        let values = (rows / count.sqrt()).singular_values();
        Self {
            information: information / count,
            singular_values: values.iter().copied().collect(),
        }
    }

    /// Of the gravity directions of a built-in scheme, each position once.
    fn of_scheme(scheme: StandardScheme) -> Self {
        let positions = scheme.positions();
        let directions: Vec<Vector3<f64>> =
            positions.iter().map(|p| p.attitude().gravity_c()).collect();
        Self::new(&directions)
    }

    /// Its eigenvalues, largest first.
    fn eigenvalues(&self) -> Vec<f64> {
        self.singular_values.iter().map(|v| v * v).collect()
    }

    /// How many combinations of coefficients the directions show; 11 at best.
    fn rank(&self) -> usize {
        let values = &self.singular_values;
        let seen = |v: &&f64| **v > RANK_TOLERANCE * values[0];
        values.iter().filter(seen).count()
    }

    /// The eigenvalues of what can be seen at all; none when some of it is not.
    fn seen(&self) -> Option<Vec<f64>> {
        (self.rank() == SEEN).then(|| self.eigenvalues()[..SEEN].to_vec())
    }

    /// ln det M without the trace; minus infinity when the rank is short.
    fn log_det(&self) -> f64 {
        self.seen().map_or(f64::NEG_INFINITY, |values| {
            values.iter().map(|v| v.ln()).sum()
        })
    }

    /// tr M⁻¹ without the trace combination; infinite when the rank is short. 38.5 at best.
    fn trace_of_inverse(&self) -> f64 {
        self.seen().map_or(f64::INFINITY, |values| {
            values.iter().map(|v| v.recip()).sum()
        })
    }

    /// D-efficiency (det M / det M of the uniform sphere)^(1/11), 0 to 1: the share of the
    /// measuring time that the sphere would need for the same determinant.
    fn d_efficiency(&self) -> f64 {
        ((self.log_det() - SPHERE_LOG_DET) / SEEN as f64).exp()
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

fn near(value: f64, expected: f64, tolerance: f64, what: &str) {
    assert!(
        (value - expected).abs() <= tolerance,
        "{what}: {value}, not {expected}"
    );
}

#[test]
fn the_levelling_problem_has_its_known_optima() {
    use StandardScheme as S;
    near(SPHERE_LOG_DET, -12.559_422, 5e-7, "the sphere");
    let best = Levelling::of_scheme(S::Icosahedron12);
    let sphere = [2.0 / 3.0, 1.0 / 3.0, 0.2, 0.0];
    for (k, value) in best.eigenvalues().into_iter().enumerate() {
        let expected = sphere[[0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 3][k]];
        near(value, expected, 1e-10, "an eigenvalue of the icosahedron");
    }
    near(
        best.log_det(),
        SPHERE_LOG_DET,
        1e-9,
        "ln det of the icosahedron",
    );
    near(best.trace_of_inverse(), 38.5, 1e-8, "tr of its inverse");
    // D-efficiency, tolerance of the last digit given, tr M⁻¹ with the same.
    for (scheme, efficiency, trace, digit) in [
        (S::Cube26, 0.9988, 38.63, 0.005),
        (S::Cube18, 0.9956, 39.0, 0.05),
        (S::Edges12, 0.9909, 39.5, 0.05),
        (S::Vertices8, 0.9348, 46.5, 0.05),
    ] {
        let m = Levelling::of_scheme(scheme);
        let name = scheme.name();
        println!(
            "{name}: {:.6}, {:.4}",
            m.d_efficiency(),
            m.trace_of_inverse()
        );
        near(m.d_efficiency(), efficiency, 5e-5, name);
        near(m.trace_of_inverse(), trace, digit, name);
    }
    let faces = Levelling::of_scheme(S::Faces6);
    assert_eq!(faces.rank(), 9);
    for c in [
        DriftCoefficient::IX,
        DriftCoefficient::IY,
        DriftCoefficient::IZ,
    ] {
        let e = Combination::single(c).coefficients();
        assert!(
            (faces.information * e).amax() < 1e-15,
            "{} is seen",
            c.name()
        );
    }
    assert_eq!(faces.d_efficiency(), 0.0);
    assert_eq!(faces.trace_of_inverse(), f64::INFINITY);
}

#[test]
fn the_trace_is_never_seen() {
    let generic = [[1.0, 2.0, 3.0], [-0.3, 0.1, 0.7], [0.5, -2.0, 0.2]];
    let m = Levelling::new(&generic.map(Vector3::from));
    let trace = Combination::input_trace().coefficients();
    assert!((m.information * trace).amax() < 1e-15);
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
    let m = Levelling::new(&directions);
    let expected = [2.0 / 3.0, 1.0 / 3.0, 0.2, 0.0];
    for (k, value) in m.eigenvalues().into_iter().enumerate() {
        let block = [0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 3][k];
        assert!((value - expected[block]).abs() < 1e-5, "{k}: {value}");
    }
    assert!((m.d_efficiency() - 1.0).abs() < 1e-6);
}
