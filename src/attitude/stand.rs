//! How the gimbals are hung and how their base stands: C_c^n of the angles of any stand.
//!
//! With a₁, a₂, a₃ the platform axes (with a sense) that the outer, middle and inner gimbal turn about at
//! zero angles, and Rot(a, θ) = exp(θ [a×]) the right-handed rotation by θ about a,
//!
//! ```text
//! C_c^n = C_b^n Rot(a₁, α) Rot(a₂, β) Rot(a₃, γ),
//! C_b^n = Rot(−y, heading) Rot(x, tilt₁) Rot(z, tilt₂)          n = North, Up, East.
//! ```
//!
//! −x, −y, −z on a level base that faces north are the paper's (19), Mx(α) My(β) Mz(γ).
//!
//! # One sequence for all
//!
//! Any other stand is the paper's between two constant rotations,
//!
//! ```text
//! C_c^n = L Mx(α) My(β + β₀) Mz(s γ) R,
//! ```
//!
//! so that what counts as the same attitude, gimbal lock and derivatives are those of the paper's angles,
//! shifted. With P the proper signed permutation that takes −x to a₁ and −y to a₂,
//! `P Rot(−e, θ) Pᵀ = Rot(P(−e), θ)`:
//!
//! - three axes (a₃ = ±P(−z)): L = C_b^n P, R = Pᵀ, β₀ = 0, s the sign;
//! - two axes (a₃ = ±a₁, a proper Euler sequence): from Mx(γ) = My(−90°) Mz(γ) My(90°),
//!   L = C_b^n P, R = My(90°) Pᵀ, β₀ = −90°, s the sign.

use nalgebra::{Matrix3, Vector3};

use super::{Attitude, Degrees, GRAVITY_N, NanoDegrees, Position, key_of};

/// An axis of the platform with a sense.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct SignedAxis {
    /// 0 x, 1 y, 2 z.
    axis: usize,
    negative: bool,
}

impl SignedAxis {
    /// All of them by name.
    pub const NAMES: [&str; 6] = ["+x", "-x", "+y", "-y", "+z", "-z"];

    /// `+x`, `x`, `-x` … `-z`; none for any other word.
    pub fn from_name(name: &str) -> Option<Self> {
        let (negative, letter) = match name.split_at_checked(1) {
            Some(("+", letter)) => (false, letter),
            Some(("-", letter)) => (true, letter),
            _ => (false, name),
        };
        let axis = ["x", "y", "z"].iter().position(|a| *a == letter)?;
        Some(Self { axis, negative })
    }

    /// `+x` … `-z`.
    pub const fn name(self) -> &'static str {
        Self::NAMES[2 * self.axis + self.negative as usize]
    }

    /// 0 x, 1 y, 2 z.
    pub const fn index(self) -> usize {
        self.axis
    }

    /// The unit vector.
    pub fn vector(self) -> Vector3<f64> {
        let mut vector = Vector3::zeros();
        vector[self.axis] = if self.negative { -1.0 } else { 1.0 };
        vector
    }
}

/// The gimbals' axes and the attitude of their base.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stand {
    axes: [SignedAxis; 3],
    heading: Degrees,
    tilt: [Degrees; 2],
    /// What it takes beside the paper's sequence; none: nothing.
    frame: Option<StandFrame>,
}

/// L, R, β₀ and s of the module text.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StandFrame {
    /// P: L of a base that stands level and faces north. Entries 0 and ±1.
    pub hung: Matrix3<f64>,
    /// L.
    pub left: Matrix3<f64>,
    /// R. Entries 0 and ±1.
    pub right: Matrix3<f64>,
    /// β₀.
    pub beta: NanoDegrees,
    /// s.
    pub gamma: f64,
}

impl Default for Stand {
    fn default() -> Self {
        Self::PAPER
    }
}

impl Stand {
    /// The paper's: outer axis north, level, a positive angle turns about −x, −y, −z.
    pub const PAPER: Self = {
        const fn negative(axis: usize) -> SignedAxis {
            SignedAxis {
                axis,
                negative: true,
            }
        }
        const ZERO: Degrees = Degrees {
            nano: NanoDegrees::new(0),
            rest_deg: 0.0,
        };
        Self {
            axes: [negative(0), negative(1), negative(2)],
            heading: ZERO,
            tilt: [ZERO; 2],
            frame: None,
        }
    };

    /// Of the gimbals' axes, outer to inner, and heading and tilts of the base, degrees; none where two
    /// neighbouring axes are parallel, and the stand cannot take every attitude.
    pub fn new(axes: [SignedAxis; 3], heading_deg: f64, tilt_deg: [f64; 2]) -> Option<Self> {
        let [outer, middle, inner] = axes;
        if outer.axis == middle.axis || middle.axis == inner.axis {
            return None;
        }
        let heading = Degrees::new(heading_deg);
        let tilt = tilt_deg.map(Degrees::new);
        let stand = Self {
            axes,
            heading,
            tilt,
            frame: None,
        };
        let [x, y] = [-outer.vector(), -middle.vector()];
        let z = x.cross(&y);
        let hung = Matrix3::from_columns(&[x, y, z]);
        // P(−z), or P(−x).
        let (third, right, beta) = if inner.axis == outer.axis {
            // My(90°) Pᵀ.
            let quarter = Matrix3::new(0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0);
            (-x, quarter * hung.transpose(), -NanoDegrees::QUARTER_TURN)
        } else {
            (-z, hung.transpose(), NanoDegrees::default())
        };
        let frame = StandFrame {
            hung,
            left: stand.base() * hung,
            right,
            beta,
            gamma: third.dot(&inner.vector()),
        };
        let plain = stand.axes == Self::PAPER.axes && frame.left == Matrix3::identity();
        Some(Self {
            frame: (!plain).then_some(frame),
            ..stand
        })
    }

    /// The gimbals' axes, outer to inner.
    pub const fn axes(&self) -> [SignedAxis; 3] {
        self.axes
    }

    /// Heading of the base's x axis, degrees from North towards East.
    pub fn heading_deg(&self) -> f64 {
        self.heading.deg()
    }

    /// Tilts of the base about its x and z axis, degrees.
    pub fn tilt_deg(&self) -> [f64; 2] {
        self.tilt.map(Degrees::deg)
    }

    /// The same as they were given: heading, and tilts.
    pub(crate) const fn base_angles(&self) -> [Degrees; 3] {
        [self.heading, self.tilt[0], self.tilt[1]]
    }

    /// Whether angles mean what they do in the paper, (19).
    pub const fn is_of_the_paper(&self) -> bool {
        self.frame.is_none()
    }

    /// Whether the inner axis is the outer one at zero angles: a proper Euler sequence, as of a table
    /// whose inner axis stands along the outer one.
    pub const fn is_proper_euler(&self) -> bool {
        self.axes[0].axis == self.axes[2].axis
    }

    /// What it takes beside the paper's sequence.
    #[inline]
    pub(crate) const fn frame(&self) -> Option<&StandFrame> {
        self.frame.as_ref()
    }

    /// C_b^n.
    pub fn base(&self) -> Matrix3<f64> {
        let [(sh, ch), (sx, cx), (sz, cz)] = self.base_angles().map(Degrees::sine_cosine);
        let heading = Matrix3::new(ch, 0.0, -sh, 0.0, 1.0, 0.0, sh, 0.0, ch);
        let about_x = Matrix3::new(1.0, 0.0, 0.0, 0.0, cx, -sx, 0.0, sx, cx);
        let about_z = Matrix3::new(cz, -sz, 0.0, sz, cz, 0.0, 0.0, 0.0, 1.0);
        heading * about_x * about_z
    }

    /// The angles (α, β + β₀, s γ) of the paper's sequence.
    #[inline]
    pub(crate) fn papers(&self, [alpha, beta, gamma]: [Degrees; 3]) -> [Degrees; 3] {
        match &self.frame {
            None => [alpha, beta, gamma],
            Some(frame) => [
                alpha,
                beta + Degrees::from(frame.beta),
                if frame.gamma < 0.0 { -gamma } else { gamma },
            ],
        }
    }

    /// C_c^n of a position.
    ///
    /// ```
    /// use scheme_opt::internals::attitude::{Position, SignedAxis, Stand};
    /// let axes = ["+y", "+x", "+z"].map(|name| SignedAxis::from_name(name).unwrap());
    /// let stand = Stand::new(axes, 0.0, [0.0, 0.0]).unwrap();
    /// // Pitched by 90° about +x: y, which was up, now points east, and f is along −z.
    /// let attitude = stand.attitude(Position::from_deg(0.0, 90.0, 0.0));
    /// assert_eq!(attitude.gravity_c().z, 1.0);
    /// ```
    #[inline]
    pub fn attitude(&self, position: Position) -> Attitude {
        self.attitude_of(position.exact())
    }

    /// The same of angles.
    #[inline]
    pub(crate) fn attitude_of(&self, angles: [Degrees; 3]) -> Attitude {
        match &self.frame {
            None => Attitude::of_angles(angles),
            Some(frame) => {
                let Attitude(c) = Attitude::of_angles(self.papers(angles));
                Attitude(frame.left * (c * frame.right))
            }
        }
    }

    /// Gravity in the axes of the paper's sequence at (α, β) and γ = 0: R g^c, g.
    pub(crate) fn gravity_before_gamma(&self, alpha_rad: f64, beta_rad: f64) -> Vector3<f64> {
        let position = Position::from_rad(alpha_rad, beta_rad, 0.0);
        match &self.frame {
            None => position.attitude().gravity_c(),
            Some(frame) => {
                let Attitude(c) = Attitude::of_angles(self.papers(position.exact()));
                c.transpose() * (frame.left.transpose() * GRAVITY_N)
            }
        }
    }

    /// One triple of an attitude: of the two that there are the one with β in [−90°, 90°], of a proper
    /// Euler sequence in [0°, 180°]; half turns positive. In gimbal lock γ is zero.
    pub fn position(&self, attitude: &Attitude) -> Position {
        let Some(frame) = &self.frame else {
            return attitude.position();
        };
        let papers = frame.left.transpose() * attitude.0 * frame.right.transpose();
        let [alpha, beta, gamma] = Attitude(papers).position().exact();
        let beta = (beta - Degrees::from(frame.beta)).wrapped();
        let gamma = if frame.gamma < 0.0 { -gamma } else { gamma };
        Position::from_deg(alpha.deg(), beta.deg(), gamma.wrapped().deg())
    }

    /// What tells the attitudes of positions apart, to the 1e-9° that files carry.
    pub(crate) fn attitude_key(&self, position: Position) -> [i64; 3] {
        match self.frame {
            None => position.attitude_key(),
            Some(_) => key_of(self.papers(position.exact()).map(|angle| angle.nano)),
        }
    }

    /// The other triple of the same attitude: a half turn of the outer and the inner gimbal, and of the
    /// middle one 180° − 2β₀ − β.
    pub(crate) fn partner(&self, [alpha, beta, gamma]: [Degrees; 3]) -> [Degrees; 3] {
        let half = Degrees::from(NanoDegrees::HALF_TURN);
        let beta = match &self.frame {
            None => half - beta,
            Some(frame) => half - Degrees::from(frame.beta + frame.beta) - beta,
        };
        [alpha + half, beta, gamma + half]
    }

    /// In gimbal lock, where only α ∓ γ counts, by how much γ turns with α for the same attitude: 1 or −1;
    /// none elsewhere.
    pub(crate) fn lock(&self, beta: Degrees) -> Option<f64> {
        let frame = self.frame.as_ref();
        let shift = frame.map_or_else(NanoDegrees::default, |frame| frame.beta);
        let papers = (beta.nano + shift).wrapped();
        if papers.abs() != NanoDegrees::QUARTER_TURN {
            return None;
        }
        let sense = frame.map_or(1.0, |frame| frame.gamma);
        Some(if papers > NanoDegrees::default() {
            sense
        } else {
            -sense
        })
    }

    /// The axes φ_α, φ_β, φ_γ (in n) of `dC = −[φ×] C` at a position: against the axes that the gimbals
    /// turn about.
    pub fn rotation_axes(&self, attitude: &Attitude, position: Position) -> [Vector3<f64>; 3] {
        match &self.frame {
            None => attitude.rotation_axes(position),
            Some(frame) => {
                let (sa, ca) = position.sines_of_alpha();
                let inner = attitude.0 * frame.right.row(2).transpose();
                [
                    frame.left.column(0).into_owned(),
                    frame.left * Vector3::new(0.0, ca, -sa),
                    inner * frame.gamma,
                ]
            }
        }
    }

    /// Reverse mode of [`Stand::attitude`]: given ∂f/∂C at a position, ∂f/∂(α, β, γ).
    pub fn angle_adjoint(
        &self,
        attitude: &Attitude,
        position: Position,
        c_adjoint: &Matrix3<f64>,
    ) -> [f64; 3] {
        attitude.pull(self.rotation_axes(attitude, position), c_adjoint)
    }

    /// ω_nc^c, rad/s, where the angles (rad) change at `rates`: of C = Mx(α) My(β) Mz(γ),
    /// −(α̇ (My Mz)ᵀ e_x + β̇ Mzᵀ e_y + γ̇ e_z).
    pub(crate) fn gimbal_rate(&self, angles: [f64; 3], rates: [f64; 3]) -> Vector3<f64> {
        let of_the_paper = |[_, beta, gamma]: [f64; 3], rates: [f64; 3]| {
            let ((sb, cb), (sg, cg)) = (libm::sincos(beta), libm::sincos(gamma));
            let outer = Vector3::new(cb * cg, cb * sg, -sb);
            let middle = Vector3::new(-sg, cg, 0.0);
            -(outer * rates[0] + middle * rates[1] + Vector3::z() * rates[2])
        };
        match &self.frame {
            None => of_the_paper(angles, rates),
            Some(frame) => {
                let [alpha, beta, gamma] = angles;
                let shifted = beta + Degrees::from(frame.beta).rad();
                let rates = [rates[0], rates[1], frame.gamma * rates[2]];
                let rate = of_the_paper([alpha, shifted, frame.gamma * gamma], rates);
                frame.right.transpose() * rate
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Unit};

    fn stand(axes: [&str; 3], heading_deg: f64, tilt_deg: [f64; 2]) -> Stand {
        let axes = axes.map(|name| SignedAxis::from_name(name).unwrap());
        Stand::new(axes, heading_deg, tilt_deg).unwrap()
    }

    /// Every sequence of signed axes: 48 of three axes, 48 of two.
    fn all() -> Vec<[&'static str; 3]> {
        let mut all = Vec::new();
        for a in SignedAxis::NAMES {
            for b in SignedAxis::NAMES {
                for c in SignedAxis::NAMES {
                    if a[1..] != b[1..] && b[1..] != c[1..] {
                        all.push([a, b, c]);
                    }
                }
            }
        }
        all
    }

    /// The definition, word by word.
    fn defined(
        axes: [&str; 3],
        heading: f64,
        [tilt_x, tilt_z]: [f64; 2],
        deg: [f64; 3],
    ) -> Matrix3<f64> {
        let rot = |axis: Vector3<f64>, deg: f64| {
            *Rotation3::from_axis_angle(&Unit::new_normalize(axis), deg.to_radians()).matrix()
        };
        let mut c = rot(-Vector3::y(), heading) * rot(Vector3::x(), tilt_x);
        c *= rot(Vector3::z(), tilt_z);
        for (name, deg) in axes.into_iter().zip(deg) {
            let axis = SignedAxis::from_name(name).unwrap().vector();
            c *= rot(axis, deg);
        }
        c
    }

    const ANGLES: [[f64; 3]; 6] = [
        [0.0, 0.0, 0.0],
        [17.0, -40.0, 120.0],
        [-166.0, 69.0, -23.0],
        [57.0, 172.0, -172.0],
        [178.0, -86.0, 52.0],
        [10.0, 180.0, 33.0],
    ];

    #[test]
    fn every_sequence_is_the_definition_and_comes_back() {
        let all = all();
        assert_eq!(all.len(), 96);
        for axes in all {
            for (heading, tilt) in [(0.0, [0.0; 2]), (33.0, [0.0; 2]), (-130.0, [4.0, -71.0])] {
                let stand = stand(axes, heading, tilt);
                for deg in ANGLES {
                    let p = Position::from_deg(deg[0], deg[1], deg[2]);
                    let c = stand.attitude(p);
                    let error = (c.matrix() - defined(axes, heading, tilt, deg)).amax();
                    assert!(error < 2e-15, "{axes:?} {deg:?}: {error:e}");
                    let found = stand.position(&c);
                    let error = (stand.attitude(found).matrix() - c.matrix()).amax();
                    assert!(error < 1e-14, "{axes:?} {deg:?} {found:?}: {error:e}");
                    assert_eq!(stand.attitude_key(found), stand.attitude_key(p));
                    let low = if stand.is_proper_euler() { 0.0 } else { -90.0 };
                    let beta = found.degrees()[1];
                    assert!((low - 1e-9..=low + 180.0 + 1e-9).contains(&beta), "{beta}");
                }
            }
        }
    }

    #[test]
    fn only_the_papers_stand_is_the_papers() {
        let paper = ["-x", "-y", "-z"];
        for axes in all() {
            assert_eq!(stand(axes, 0.0, [0.0; 2]).is_of_the_paper(), axes == paper);
        }
        assert_eq!(stand(paper, 0.0, [0.0; 2]), Stand::PAPER);
        assert!(!stand(paper, 1e-9, [0.0; 2]).is_of_the_paper());
        // A whole turn is none, and two half turns of the tilts turn the heading.
        assert!(stand(paper, 360.0, [-360.0, 0.0]).is_of_the_paper());
        let turned = stand(paper, 180.0, [180.0, 180.0]);
        let p = Position::from_deg(10.0, 20.0, 30.0);
        assert_eq!(turned.attitude(p).matrix(), p.attitude().matrix());
    }

    #[test]
    fn right_angles_are_exact() {
        for axes in all() {
            let stand = stand(axes, 90.0, [-180.0, 270.0]);
            let c = *stand
                .attitude(Position::from_deg(90.0, -180.0, 270.0))
                .matrix();
            assert_eq!(c, c.map(f64::round), "{axes:?}");
        }
    }

    #[test]
    fn partner_and_lock_are_the_same_attitude() {
        for axes in all() {
            let stand = stand(axes, 12.0, [3.0, -5.0]);
            for deg in ANGLES {
                let angles = deg.map(Degrees::new);
                let c = *stand.attitude_of(angles).matrix();
                let other = *stand.attitude_of(stand.partner(angles)).matrix();
                assert!((c - other).amax() < 1e-15, "{axes:?}");
            }
            let mut locked = 0;
            for quarters in -4..=4 {
                let beta = Degrees::new(90.0 * f64::from(quarters));
                let at = |alpha: f64, gamma: f64| {
                    *stand
                        .attitude_of([Degrees::new(alpha), beta, Degrees::new(gamma)])
                        .matrix()
                };
                match stand.lock(beta) {
                    Some(by) => {
                        locked += 1;
                        assert!((at(20.0, 10.0) - at(60.0, 10.0 + by * 40.0)).amax() < 1e-15);
                    }
                    None => assert!((at(20.0, 10.0) - at(60.0, 50.0)).amax() > 0.1),
                }
            }
            assert_eq!(locked, if stand.is_proper_euler() { 5 } else { 4 });
            assert_eq!(stand.lock(Degrees::new(45.0)), None);
        }
    }

    #[test]
    fn axes_and_rates_are_the_derivative() {
        let h = 1e-6;
        for axes in all() {
            let stand = stand(axes, -71.0, [13.0, 8.0]);
            for deg in ANGLES {
                let angles = deg.map(f64::to_radians);
                let p = Position::from_array(angles);
                let c = stand.attitude(p);
                let rates = [0.3, -0.7, 1.1];
                let mut along = Matrix3::zeros();
                for (i, axis) in stand.rotation_axes(&c, p).iter().enumerate() {
                    let at = |by: f64| {
                        let mut angles = angles;
                        angles[i] += by;
                        *stand.attitude(Position::from_array(angles)).matrix()
                    };
                    let numeric = (at(h) - at(-h)) / (2.0 * h);
                    let exact = -axis.cross_matrix() * c.matrix();
                    assert!((numeric - exact).amax() < 1e-9, "{axes:?} {i}");
                    along += numeric * rates[i];
                }
                let rate = stand.gimbal_rate(angles, rates);
                let turning = c.matrix() * rate.cross_matrix();
                assert!((turning - along).amax() < 1e-8, "{axes:?}");
            }
        }
    }

    #[test]
    fn gravity_before_gamma_is_turned_by_gamma_about_the_inner_axis() {
        for axes in all() {
            let stand = stand(axes, 40.0, [-9.0, 30.0]);
            for deg in ANGLES {
                let [alpha, beta, _] = deg.map(f64::to_radians);
                let g = stand.gravity_before_gamma(alpha, beta);
                let frame = stand.frame().unwrap();
                let (s, c) = (frame.gamma * deg[2].to_radians()).sin_cos();
                // Mz(γ)ᵀ.
                let turned = Vector3::new(c * g.x - s * g.y, s * g.x + c * g.y, g.z);
                let there = stand.attitude(Position::from_deg(deg[0], deg[1], deg[2]));
                let error = (frame.right.transpose() * turned - there.gravity_c()).amax();
                assert!(error < 1e-15, "{axes:?}");
            }
        }
    }

    #[test]
    fn parallel_neighbours_and_other_words_are_no_stand() {
        let axis = |name| SignedAxis::from_name(name).unwrap();
        for axes in [["+x", "-x", "+y"], ["+x", "-z", "z"], ["y", "+y", "-y"]] {
            assert_eq!(Stand::new(axes.map(axis), 0.0, [0.0; 2]), None);
        }
        for word in ["", "+", "w", "xx", "+ x", "X", "−x", "--x"] {
            assert_eq!(SignedAxis::from_name(word), None, "{word}");
        }
        for name in SignedAxis::NAMES {
            assert_eq!(axis(name).name(), name);
        }
    }
}
