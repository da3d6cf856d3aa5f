//! Positions (α, β, γ), the attitude matrix C_c^n, Earth rate and gravity in the n frame.
//!
//! # Frames
//!
//! - **n**: local geographic, North – Up – East (x, y, z).
//! - **c**: the computed platform frame; **p**: the true platform.
//!
//! A position is a triple of gimbal angles. What attitude it is depends on the [`Stand`]. On the paper's
//! it is the Euler triple of (19), `C_c^n = Mx(α) My(β) Mz(γ)`: it takes components in
//! c to components in n. `Mx, My, Mz` are frame (passive) rotations,
//!
//! ```text
//! Mx(α) = |1  0   0 |   My(β) = |cβ 0 -sβ|   Mz(γ) = | cγ sγ 0|
//!         |0  cα  sα|           |0  1  0 |           |-sγ cγ 0|
//!         |0 -sα  cα|           |sβ 0  cβ|           | 0  0  1|
//! ```
//!
//! so that the *outermost* rotation, the one nearest the n frame, is α.
//!
//! # Derivatives
//!
//! A small change of the angles turns the matrix on the left: `dC = −[φ×] C` with
//! `φ = e_x dα + Mx(α) e_y dβ + C e_z dγ` ([`Attitude::rotation_axes`]). From
//! `dMx/dα = −[e_x×] Mx`, and `M [v×] = [(M v)×] M` for a rotation M.

mod degrees;
mod stand;

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

pub(crate) use degrees::{Degrees, NanoDegrees, decimal, deg_of_rad};
pub(crate) use stand::StandFrame;
pub use stand::{SignedAxis, Stand};

use crate::units::{EARTH_RATE_RAD_PER_S, RAD_PER_DEG};

/// Index of the North component.
pub const NORTH: usize = 0;
/// Index of the Up component.
pub const UP: usize = 1;
/// Index of the East component.
pub const EAST: usize = 2;

/// The gravity vector in n in units of 1 g, (0, −1, 0): North – Up – East.
pub const GRAVITY_N: Vector3<f64> = Vector3::new(0.0, -1.0, 0.0);

/// Earth rate in n, ω_ie^n = (ω_N, ω_U, 0) = ω_ie (cos L, sin L, 0), rad/s.
///
/// At the poles ω_N is set to exactly zero: cos(π/2) is 6e-17 in floating point, and a spurious
/// ω_N would pass for an azimuth reference that is not there.
pub fn earth_rate_n(latitude_rad: f64) -> Vector3<f64> {
    let (sin_l, cos_l) = libm::sincos(latitude_rad);
    let cos_l = if cos_l.abs() < 1e-15 { 0.0 } else { cos_l };
    EARTH_RATE_RAD_PER_S * Vector3::new(cos_l, sin_l, 0.0)
}

/// A position of the platform: the angles (α, β, γ) of the outer, middle and inner gimbal; on the paper's
/// stand those of (19), α about x of n, γ about z of the platform.
///
/// The angles are held in degrees as they were given, because what is a half turn, or the same
/// angle, is only exact there; two positions are equal when their angles are.
///
/// ```
/// use scheme_opt::internals::attitude::Position;
/// let p = Position::from_deg(180.0, 0.0, 0.0);
/// // Upside down: gravity along +y of the platform.
/// assert_eq!(p.attitude().gravity_c().y, 1.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Position {
    deg: [f64; 3],
}

impl Position {
    /// From (α, β, γ) in radians. What was a decimal of up to nine places in degrees before it
    /// became radians is that decimal again.
    pub fn from_rad(alpha: f64, beta: f64, gamma: f64) -> Self {
        Self::from_array([alpha, beta, gamma])
    }

    /// From (α, β, γ) in degrees.
    pub const fn from_deg(alpha_deg: f64, beta_deg: f64, gamma_deg: f64) -> Self {
        Self {
            deg: [alpha_deg, beta_deg, gamma_deg],
        }
    }

    /// From the array `[α, β, γ]`, rad, as [`Position::from_rad`].
    pub fn from_array(angles: [f64; 3]) -> Self {
        let [alpha, beta, gamma] = angles;
        Self {
            deg: [deg_of_rad(alpha), deg_of_rad(beta), deg_of_rad(gamma)],
        }
    }

    /// The same with its angles taken apart.
    #[inline]
    pub(crate) fn exact_of_array(angles: [f64; 3]) -> (Self, [Degrees; 3]) {
        let apart = angles.map(Degrees::of_rad);
        let deg = apart.map(|(deg, _)| deg);
        (Self { deg }, apart.map(|(_, exact)| exact))
    }

    /// As the array `[α, β, γ]`, rad.
    pub fn to_array(self) -> [f64; 3] {
        self.deg.map(|deg| deg * RAD_PER_DEG)
    }

    /// `[α, β, γ]` in degrees, as given.
    pub const fn degrees(self) -> [f64; 3] {
        self.deg
    }

    /// As `[α, β, γ]` in degrees, rounded to the 1e-9° that files carry.
    pub fn to_deg(self) -> [f64; 3] {
        self.deg.map(crate::units::round_deg)
    }

    /// The angles in whole 1e-9° and the rest.
    #[inline]
    pub(crate) fn exact(self) -> [Degrees; 3] {
        let [alpha, beta, gamma] = self.deg;
        [Degrees::new(alpha), Degrees::new(beta), Degrees::new(gamma)]
    }

    /// The angles in whole 1e-9°: what decides whether two positions are the same.
    pub(crate) fn nano(self) -> [NanoDegrees; 3] {
        self.deg.map(NanoDegrees::nearest)
    }

    /// (sin, cos) of α, β, γ.
    #[inline]
    pub(crate) fn sines(self) -> [(f64, f64); 3] {
        sines(self.exact())
    }

    /// (sin α, cos α).
    #[inline]
    pub(crate) fn sines_of_alpha(self) -> (f64, f64) {
        Degrees::new(self.deg[0]).sine_cosine()
    }

    /// What tells the attitudes of positions on the paper's stand apart, to the 1e-9° that files carry:
    /// the angles of the triple with β in ±90°, without whole turns; at β = ±90°, where only α ∓ γ
    /// counts, the one with γ = 0.
    pub(crate) fn attitude_key(self) -> [i64; 3] {
        key_of(self.nano())
    }

    /// The attitude C_c^n of this position on the paper's stand, (19); on any other see
    /// [`Stand::attitude`].
    pub fn attitude(self) -> Attitude {
        Attitude::of_angles(self.exact())
    }
}

/// [`Position::attitude_key`] of the angles (α, β, γ).
fn key_of(angles: [NanoDegrees; 3]) -> [i64; 3] {
    let [mut a, mut b, mut g] = angles.map(NanoDegrees::wrapped);
    let (quarter, half) = (NanoDegrees::QUARTER_TURN, NanoDegrees::HALF_TURN);
    if b.abs() > quarter {
        (a, b, g) = (a + half, half - b, g + half);
    }
    if b.abs() == quarter {
        let lost = if b > NanoDegrees::default() { -g } else { g };
        (a, g) = (a + lost, NanoDegrees::default());
    }
    [a, b, g].map(|angle| angle.wrapped().count())
}

/// (sin, cos) of three angles.
#[inline]
fn sines([alpha, beta, gamma]: [Degrees; 3]) -> [(f64, f64); 3] {
    [alpha.sine_cosine(), beta.sine_cosine(), gamma.sine_cosine()]
}

/// The attitude matrix C_c^n: takes components in c to components in n. A rotation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attitude(Matrix3<f64>);

impl Attitude {
    /// C_c^n of the angles (α, β, γ), (19).
    #[inline]
    pub(crate) fn of_angles(angles: [Degrees; 3]) -> Self {
        let [(sa, ca), (sb, cb), (sg, cg)] = sines(angles);
        Self(Matrix3::new(
            cb * cg,
            cb * sg,
            -sb,
            sa * sb * cg - ca * sg,
            sa * sb * sg + ca * cg,
            sa * cb,
            ca * sb * cg + sa * sg,
            ca * sb * sg - sa * cg,
            ca * cb,
        ))
    }

    /// From a rotation.
    pub fn from_rotation(rotation: Rotation3<f64>) -> Self {
        Self(rotation.into_inner())
    }

    /// An attitude with gravity along `direction` of the platform (any length but zero), turned
    /// by `heading_rad` about the vertical from an arbitrary but fixed start; `None` when the
    /// direction is zero or not finite.
    pub fn with_gravity_along(direction: Vector3<f64>, heading_rad: f64) -> Option<Self> {
        let unit = Unit::try_new(direction, 1e-12)?;
        if !unit.iter().all(|v| v.is_finite()) {
            return None;
        }
        // The Up row of C_c^n is −g^c. The North row is any unit vector at right angles to it;
        // starting from the platform axis least aligned with gravity keeps that well defined.
        let up = -unit.into_inner();
        let smallest = up.iamin();
        let mut axis = Vector3::zeros();
        axis[smallest] = 1.0;
        let north = (axis - up * up.dot(&axis)).normalize();
        let east = north.cross(&up);
        let start = Matrix3::from_rows(&[north.transpose(), up.transpose(), east.transpose()]);
        let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), heading_rad);
        Some(Self(turn.matrix() * start))
    }

    /// The same turned by a rotation in n: `frame` C_c^n.
    pub(crate) fn turned(&self, frame: &Matrix3<f64>) -> Self {
        Self(frame * self.0)
    }

    /// The matrix C_c^n.
    pub const fn matrix(&self) -> &Matrix3<f64> {
        &self.0
    }

    /// Gravity in the platform, g^c = C_n^c g^n (20): minus the Up row of C_c^n, in g.
    pub fn gravity_c(&self) -> Vector3<f64> {
        -self.0.row(UP).transpose()
    }

    /// The specific force in the platform at rest, f^c = −g^c, in g: what perfect accelerometers along
    /// its axes read, the Up row of C_c^n.
    pub(crate) fn specific_force_c(&self) -> [f64; 3] {
        std::array::from_fn(|axis| self.0[(UP, axis)])
    }

    /// One Euler triple of this attitude on the paper's stand, β in [−90°, 90°], half turns positive. At β = ±90° only
    /// α ∓ γ is determined; γ is then set to zero.
    pub fn position(&self) -> Position {
        let c = &self.0;
        let sin_beta = (-c[(0, 2)]).clamp(-1.0, 1.0);
        let cos_beta = libm::hypot(c[(0, 0)], c[(0, 1)]);
        // Adding zero makes −0 a plain zero, for the arc tangent takes its sign for a half turn.
        let angle = |sin: f64, cos: f64| {
            let deg = Degrees::new(deg_of_rad(libm::atan2(sin + 0.0, cos)));
            deg.wrapped().deg()
        };
        let beta = angle(sin_beta, cos_beta);
        if NanoDegrees::nearest(beta).abs() == NanoDegrees::QUARTER_TURN {
            // Gimbal lock: the remaining angle is read off the rows that stay determined.
            let alpha = angle(-c[(2, 1)], c[(1, 1)]);
            return Position::from_deg(alpha, 90.0_f64.copysign(sin_beta), 0.0);
        }
        Position::from_deg(
            angle(c[(1, 2)], c[(2, 2)]),
            beta,
            angle(c[(0, 1)], c[(0, 0)]),
        )
    }

    /// Reverse mode of [`Position::attitude`]: given ∂f/∂C at `position`, ∂f/∂(α, β, γ).
    /// From `dC = −[φ×] C`: ∂f/∂φ = −Σ_j C_j × C̄_j over the columns.
    pub fn angle_adjoint(&self, position: Position, c_adjoint: &Matrix3<f64>) -> [f64; 3] {
        self.pull(self.rotation_axes(position), c_adjoint)
    }

    /// ∂f/∂C to the angles that turn about `axes`, against them.
    fn pull(&self, axes: [Vector3<f64>; 3], c_adjoint: &Matrix3<f64>) -> [f64; 3] {
        let mut torque = Vector3::zeros();
        for j in 0..3 {
            torque += self.0.column(j).cross(&c_adjoint.column(j));
        }
        axes.map(|axis| -axis.dot(&torque))
    }

    /// The axes φ_α, φ_β, φ_γ (in n) of `dC = −[φ×] C` at this `position` on the paper's stand, see
    /// the module text.
    pub fn rotation_axes(&self, position: Position) -> [Vector3<f64>; 3] {
        let (sa, ca) = position.sines_of_alpha();
        [
            Vector3::x(),
            // Mx(α) e_y is the second column of Mx(α).
            Vector3::new(0.0, ca, -sa),
            self.0.column(2).into_owned(),
        ]
    }
}

/// Wraps an angle (rad) to (−π, π], so that a half turn stays positive: what is one is decided
/// in the 1e-9° that files carry.
pub fn wrap_half_turn(angle: f64) -> f64 {
    Degrees::new(deg_of_rad(angle)).wrapped().rad()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn mx(a: f64) -> Matrix3<f64> {
        let (s, c) = a.sin_cos();
        Matrix3::new(1.0, 0.0, 0.0, 0.0, c, s, 0.0, -s, c)
    }
    fn my(b: f64) -> Matrix3<f64> {
        let (s, c) = b.sin_cos();
        Matrix3::new(c, 0.0, -s, 0.0, 1.0, 0.0, s, 0.0, c)
    }
    fn mz(g: f64) -> Matrix3<f64> {
        let (s, c) = g.sin_cos();
        Matrix3::new(c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0)
    }

    const SAMPLES: [[f64; 3]; 5] = [
        [0.0, 0.0, 0.0],
        [0.3, -0.7, 2.1],
        [-2.9, 1.2, -0.4],
        [1.0, 3.0, -3.0],
        [3.1, -1.5, 0.9],
    ];

    #[test]
    fn attitude_is_the_product_of_equation_19() {
        for [a, b, g] in SAMPLES {
            let c = Position::from_rad(a, b, g).attitude();
            assert!((c.matrix() - mx(a) * my(b) * mz(g)).amax() < 1e-15);
        }
    }

    #[test]
    fn gravity_in_the_platform_is_equation_20() {
        for [a, b, g] in SAMPLES {
            let p = Position::from_rad(a, b, g);
            let expected = Vector3::new(
                g.sin() * a.cos() - a.sin() * b.sin() * g.cos(),
                -a.cos() * g.cos() - a.sin() * b.sin() * g.sin(),
                -a.sin() * b.cos(),
            );
            let gravity = p.attitude().gravity_c();
            assert!((gravity - expected).amax() < 1e-15);
            assert!((gravity - p.attitude().matrix().transpose() * GRAVITY_N).amax() < 1e-15);
        }
    }

    #[test]
    fn angles_read_back_give_the_same_attitude() {
        let mut samples = SAMPLES.to_vec();
        samples.extend([
            [0.4, FRAC_PI_2, 0.0],
            [0.4, -FRAC_PI_2, 1.1],
            [-2.0, FRAC_PI_2, 2.5],
        ]);
        for angles in samples {
            let c = Position::from_array(angles).attitude();
            let again = c.position().attitude();
            assert!((c.matrix() - again.matrix()).amax() < 1e-12, "{angles:?}");
        }
    }

    #[test]
    fn rotation_axes_are_the_derivative() {
        let h = 1e-6;
        for angles in SAMPLES {
            let p = Position::from_array(angles);
            let c = p.attitude();
            for (i, axis) in c.rotation_axes(p).iter().enumerate() {
                let (mut hi, mut lo) = (angles, angles);
                hi[i] += h;
                lo[i] -= h;
                let numeric = (Position::from_array(hi).attitude().matrix()
                    - Position::from_array(lo).attitude().matrix())
                    / (2.0 * h);
                let exact = -axis.cross_matrix() * c.matrix();
                assert!((numeric - exact).amax() < 1e-9);
            }
        }
    }

    #[test]
    fn gravity_can_be_put_along_any_direction() {
        for d in [
            [1.0, 0.0, 0.0],
            [0.0, -2.0, 0.0],
            [1.0, 1.0, 1.0],
            [-0.3, 0.2, 0.9],
        ] {
            let d = Vector3::from(d);
            for heading in [0.0, 1.0, PI] {
                let c = Attitude::with_gravity_along(d, heading).unwrap();
                assert!((c.gravity_c() - d.normalize()).amax() < 1e-15);
                assert!((c.matrix() * c.matrix().transpose() - Matrix3::identity()).amax() < 1e-14);
                assert!((c.matrix().determinant() - 1.0).abs() < 1e-14);
            }
        }
        assert!(Attitude::with_gravity_along(Vector3::zeros(), 0.0).is_none());
    }

    #[test]
    fn half_turns_wrap_to_the_positive_side() {
        assert_eq!(wrap_half_turn(PI), PI);
        assert_eq!(wrap_half_turn(-PI), PI);
        assert_eq!(wrap_half_turn(3.0 * PI), PI);
        assert!((wrap_half_turn(-0.1 - 4.0 * PI) + 0.1).abs() < 1e-14);
        // In radians this is a little more than −π.
        assert_eq!(wrap_half_turn((30.0 - 210.0) * RAD_PER_DEG + 1e-15), PI);
    }

    #[test]
    fn no_north_component_of_earth_rate_at_the_poles() {
        assert_eq!(earth_rate_n(FRAC_PI_2)[NORTH], 0.0);
        assert_eq!(earth_rate_n(-FRAC_PI_2)[NORTH], 0.0);
    }
}
