//! Units at the boundary: everything inside is SI (rad, rad/s, s, g), and this is where the
//! degrees, degrees per hour and arc seconds of people and files are converted.
//!
//! The covariance works in a third set, arcsec for ψ and °/h for drift, because then the
//! equations of motion need no factor: 1 °/h = 3600 arcsec / 3600 s = 1 arcsec/s **exactly**,
//! and a state is of the order of 1 to 1000 instead of 1e-9.

use std::f64::consts::PI;

/// Arc seconds per radian, 180·3600/π.
pub const ARCSEC_PER_RAD: f64 = 648_000.0 / PI;

/// Radians per degree.
pub const RAD_PER_DEG: f64 = PI / 180.0;

/// Earth rotation rate, rad/s: the WGS 84 nominal mean angular velocity (NIMA TR8350.2,
/// table 3.1), 7 292 115 × 10⁻¹¹ rad/s.
pub const EARTH_RATE_RAD_PER_S: f64 = 7.292_115e-5;

/// An angle, held in radians.
///
/// ```
/// use scheme_opt::internals::units::Angle;
/// assert_eq!(Angle::from_deg(180.0).rad(), std::f64::consts::PI);
/// assert!((Angle::from_deg(0.1).arcsec() - 360.0).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default)]
pub struct Angle(f64);

impl Angle {
    /// From radians.
    pub const fn from_rad(rad: f64) -> Self {
        Self(rad)
    }
    /// From degrees.
    pub fn from_deg(deg: f64) -> Self {
        Self(deg * RAD_PER_DEG)
    }
    /// From arc seconds.
    pub fn from_arcsec(arcsec: f64) -> Self {
        Self(arcsec / ARCSEC_PER_RAD)
    }
    /// In radians.
    pub const fn rad(self) -> f64 {
        self.0
    }
    /// In degrees.
    pub fn deg(self) -> f64 {
        self.0 / RAD_PER_DEG
    }
    /// In arc seconds.
    pub fn arcsec(self) -> f64 {
        self.0 * ARCSEC_PER_RAD
    }
}

/// An angular rate (gyro drift, slew rate), held in rad/s.
///
/// ```
/// use scheme_opt::internals::units::AngularRate;
/// let earth = AngularRate::from_rad_per_s(7.292115e-5);
/// assert!((earth.deg_per_h() - 15.041).abs() < 1e-3);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default)]
pub struct AngularRate(f64);

impl AngularRate {
    /// From rad/s.
    pub const fn from_rad_per_s(rad_per_s: f64) -> Self {
        Self(rad_per_s)
    }
    /// From degrees per hour.
    pub fn from_deg_per_h(deg_per_h: f64) -> Self {
        // 1 °/h is 1 arcsec/s.
        Self(deg_per_h / ARCSEC_PER_RAD)
    }
    /// From degrees per second.
    pub fn from_deg_per_s(deg_per_s: f64) -> Self {
        Self(deg_per_s * RAD_PER_DEG)
    }
    /// In rad/s.
    pub const fn rad_per_s(self) -> f64 {
        self.0
    }
    /// In degrees per hour.
    pub fn deg_per_h(self) -> f64 {
        self.0 * ARCSEC_PER_RAD
    }
    /// In degrees per second.
    pub fn deg_per_s(self) -> f64 {
        self.0 / RAD_PER_DEG
    }
}

/// Rounds an angle in degrees to the 1e-9° that files carry, so that an angle given with up to
/// nine decimals comes back from radians as the same number.
pub fn round_deg(deg: f64) -> f64 {
    let scaled = (deg * 1e9).round();
    if scaled.abs() < 9.0e15 {
        scaled / 1e9
    } else {
        deg
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_survive_the_way_through_radians() {
        for deg in [59.577, -25.03, 0.1, 179.999_999_999, -180.0, 1.0 / 3.0] {
            let written = round_deg(deg);
            assert_eq!(round_deg(Angle::from_deg(written).deg()), written);
        }
    }

    #[test]
    fn one_degree_per_hour_is_one_arcsec_per_second() {
        let rate = AngularRate::from_deg_per_h(1.0).rad_per_s();
        assert_eq!(Angle::from_rad(rate).arcsec(), 1.0);
    }
}
