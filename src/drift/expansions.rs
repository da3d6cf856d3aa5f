//! The closed-form expansions of ε^n: (22), (23), and the third row the paper does not print.
//!
//! They show which *combination* of coefficients a position excites, which is what a person
//! reads off them: in (22) the input-axis coefficients occur only as differences
//! D_IX − D_IZ and D_IX − D_IY, so ε_x^n alone can never separate them. The computation itself
//! uses the matrix form [`super::drift_matrix`]; tests prove the two equal.
//!
//! # Misprints of the paper
//!
//! 1. (21), first line: the D_SX term must be negative (as in (22), (27), (28)).
//! 2. (23), second term: printed D_FZ, must be **D_FY** (cosα cosγ + sinα sinβ sinγ).
//! 3. (23), the term (D_OX sinγ − D_OY cosγ) sinα cosβ sinβ: the last factor must be **cosα**.
//! 4. (4) prints −g^n; with it the input axes would point backwards. The specific force in (3)
//!    is g^c with the axes of the `drift` module.
//!
//! [`printed`] keeps the formulas as printed, so that tests can show that they do not hold.

use nalgebra::Vector3;

use super::{CoefficientVector, DriftCoefficient as D};
use crate::attitude::Position;

/// ε_x^n by (22). Rate unit of `d`.
pub fn epsilon_x(p: Position, d: &CoefficientVector) -> f64 {
    let d = |c: D| d[c.index()];
    let [(sa, ca), (sb, cb), (sg, cg)] = p.sines();
    d(D::FX) * cb * cg + d(D::FY) * cb * sg - d(D::FZ) * sb
        + (d(D::SZ) * cg - d(D::OZ) * sg) * ca * sb
        + (d(D::OZ) * cg + d(D::SZ) * sg) * sa * sb * sb
        + (d(D::OX) * cg + d(D::OY) * sg) * sa * cb * cb
        - (d(D::SX) * cg * cg + d(D::SY) * sg * sg) * ca * cb
        - (d(D::SX) - d(D::SY)) * sa * sb * sg * cb * cg
        - (d(D::IX) - d(D::IZ)) * sa * sb * cb
        + (d(D::IX) - d(D::IY)) * (ca * cg + sa * sb * sg) * cb * sg
}

/// ε_y^n by (23), its misprints corrected. Rate unit of `d`.
pub fn epsilon_y(p: Position, d: &CoefficientVector) -> f64 {
    let c = |c: D| d[c.index()];
    let [(sa, ca), (sb, cb), (sg, cg)] = p.sines();
    c(D::FX) * (cg * sa * sb - ca * sg)
        + c(D::FY) * (ca * cg + sa * sb * sg)
        + c(D::FZ) * cb * sa
        + epsilon_y_g_sensitive(p, d, ca)
}

/// The g-sensitive terms of (23); `last_factor` is the factor that the paper misprints in the
/// (D_OX sinγ − D_OY cosγ) term, cosα when right.
fn epsilon_y_g_sensitive(p: Position, d: &CoefficientVector, last_factor: f64) -> f64 {
    let d = |c: D| d[c.index()];
    let [(sa, ca), (sb, cb), (sg, cg)] = p.sines();
    (d(D::OX) * cg + d(D::OY) * sg) * sa * sa * sb * cb
        - (d(D::OX) * sg - d(D::OY) * cg) * sa * cb * last_factor
        - (d(D::SZ) * sg + d(D::OZ) * cg) * cb * sa * sa * sb
        - (d(D::SZ) * cg - d(D::OZ) * sg) * sa * cb * ca
        - (d(D::IX) * sg * sg + d(D::IY) * cg * cg) * ca * ca
        - (d(D::IX) * cg * cg + d(D::IY) * sg * sg) * sa * sa * sb * sb
        - d(D::IZ) * sa * sa * cb * cb
        + (d(D::SX) - d(D::SY)) * (ca * cg + sa * sb * sg) * (ca * sg - sa * sb * cg)
        + 2.0 * (d(D::IX) - d(D::IY)) * sa * sb * sg * ca * cg
}

/// ε_z^n, the row the paper does not print, derived the same way: ε^n = C_c^n ε^c with the third
/// row (cα sβ cγ + sα sγ, cα sβ sγ − sα cγ, cα cβ) of (19) and the corrected (21), collected by
/// the combinations of (22). Like ε_x^n it holds the input-axis coefficients as differences only.
/// Rate unit of `d`.
pub fn epsilon_z(p: Position, d: &CoefficientVector) -> f64 {
    let d = |c: D| d[c.index()];
    let [(sa, ca), (sb, cb), (sg, cg)] = p.sines();
    d(D::FX) * (ca * sb * cg + sa * sg)
        + d(D::FY) * (ca * sb * sg - sa * cg)
        + d(D::FZ) * ca * cb
        + (d(D::OX) * cg + d(D::OY) * sg) * ca * sb * sa * cb
        + (d(D::OX) * sg - d(D::OY) * cg) * sa * sa * cb
        - (d(D::SZ) * cg - d(D::OZ) * sg) * ca * ca * cb
        - (d(D::OZ) * cg + d(D::SZ) * sg) * sa * sb * ca * cb
        - (d(D::SX) * cg * cg + d(D::SY) * sg * sg) * ca * ca * sb
        - (d(D::SX) * sg * sg + d(D::SY) * cg * cg) * sa * sa * sb
        - (d(D::SX) - d(D::SY)) * (1.0 + sb * sb) * sa * ca * sg * cg
        + (d(D::IX) - d(D::IY)) * sg * cg * sb * (ca * ca - sa * sa)
        + (d(D::IX) * sg * sg + d(D::IY) * cg * cg) * sa * ca
        - (d(D::IX) * cg * cg + d(D::IY) * sg * sg) * sa * ca * sb * sb
        - d(D::IZ) * sa * ca * cb * cb
}

/// ε^n from the three expansions.
pub fn epsilon_n(p: Position, d: &CoefficientVector) -> Vector3<f64> {
    Vector3::new(epsilon_x(p, d), epsilon_y(p, d), epsilon_z(p, d))
}

/// The formulas exactly as the paper prints them, misprints included. They do **not** hold;
/// they are here so that the errata are tests and not a claim.
pub mod printed {
    use super::*;

    /// ε_x^c by the first line of (21) as printed: with +D_SX.
    pub fn epsilon_x_c_21(p: Position, d: &CoefficientVector) -> f64 {
        let d = |c: D| d[c.index()];
        let [(sa, ca), (sb, cb), (sg, cg)] = p.sines();
        d(D::FX)
            + d(D::IX) * (sg * ca - sa * sb * cg)
            + d(D::SX) * (ca * cg + sa * sb * sg)
            + d(D::OX) * sa * cb
    }

    /// ε_y^n by (23) as printed: D_FZ for D_FY, and sinβ for cosα.
    pub fn epsilon_y_23(p: Position, d: &CoefficientVector) -> f64 {
        let c = |c: D| d[c.index()];
        let [(sa, ca), (sb, cb), (sg, cg)] = p.sines();
        c(D::FX) * (cg * sa * sb - ca * sg)
            + c(D::FZ) * (ca * cg + sa * sb * sg)
            + c(D::FZ) * cb * sa
            + epsilon_y_g_sensitive(p, d, sb)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drift::{COEFFICIENTS, drift_c, drift_matrix};

    fn positions() -> Vec<Position> {
        let mut all = Vec::new();
        for i in 0..12 {
            for j in 0..12 {
                for k in 0..12 {
                    let angle = |n: i32, shift: f64| f64::from(n) * 0.52 - 3.1 + shift;
                    all.push(Position::from_rad(
                        angle(i, 0.0),
                        angle(j, 0.07),
                        angle(k, 0.13),
                    ));
                }
            }
        }
        all
    }

    fn unit(i: usize) -> CoefficientVector {
        CoefficientVector::from_fn(|r, _| if r == i { 1.0 } else { 0.0 })
    }

    #[test]
    fn expansions_equal_the_matrix_form_to_1e_15() {
        let mut worst = 0.0_f64;
        for p in positions() {
            let a = drift_matrix(&p.attitude());
            for i in 0..COEFFICIENTS {
                worst = worst.max((epsilon_n(p, &unit(i)) - a.column(i)).amax());
            }
        }
        assert!(worst <= 1e-15, "largest difference {worst:e}");
    }

    #[test]
    fn erratum_1_the_printed_21_has_the_wrong_sign_of_d_sx() {
        let p = Position::from_deg(0.0, 0.0, 0.0);
        let d = unit(D::SX.index());
        // (27) has D_FX − D_SX at p1, so the platform drift must be −D_SX there.
        assert_eq!(drift_c(&d, &p.attitude().gravity_c()).x, -1.0);
        assert_eq!(printed::epsilon_x_c_21(p, &d), 1.0);
        // All other terms of the line are right.
        for p in positions() {
            for c in [D::FX, D::IX, D::OX] {
                let d = unit(c.index());
                let right = drift_c(&d, &p.attitude().gravity_c()).x;
                assert!((printed::epsilon_x_c_21(p, &d) - right).abs() < 1e-15);
            }
        }
    }

    #[test]
    fn errata_2_and_3_the_printed_23_fails_for_d_fy_d_fz_d_ox_d_oy_only() {
        let mut wrong = [0.0_f64; COEFFICIENTS];
        for p in positions() {
            let a = drift_matrix(&p.attitude());
            for (i, worst) in wrong.iter_mut().enumerate() {
                let difference = printed::epsilon_y_23(p, &unit(i)) - a[(1, i)];
                *worst = worst.max(difference.abs());
            }
        }
        for c in D::ALL {
            let misprinted = [D::FY, D::FZ, D::OX, D::OY].contains(&c);
            assert_eq!(wrong[c.index()] > 0.5, misprinted, "{}", c.name());
            assert!(misprinted || wrong[c.index()] < 1e-15, "{}", c.name());
        }
    }

    #[test]
    fn drift_at_the_two_positions_is_27_and_28() {
        let d = CoefficientVector::from_fn(|i, _| (i + 1) as f64);
        let c = |c: D| d[c.index()];
        let p1 = epsilon_n(Position::from_deg(0.0, 0.0, 0.0), &d);
        assert_eq!(p1.x, c(D::FX) - c(D::SX));
        assert_eq!(p1.y, c(D::FY) - c(D::IY));
        assert_eq!(p1.z, c(D::FZ) - c(D::SZ));
        let p2 = epsilon_n(Position::from_deg(180.0, 0.0, 0.0), &d);
        assert!((p2.x - (c(D::FX) + c(D::SX))).abs() < 1e-14);
        assert!((p2.y + (c(D::FY) + c(D::IY))).abs() < 1e-14);
        assert!((p2.z + (c(D::FZ) + c(D::SZ))).abs() < 1e-14);
    }
}
