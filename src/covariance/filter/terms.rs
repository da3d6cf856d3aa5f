//! What each parameter is, read from its name: for the filter alone.
//!
//! The chain has a table of features and factors ([`crate::model`]). Here every term of the error
//! model is written as it stands in the equations, so that a slip in one is found by the other.

use crate::covariance::real::Real;
use crate::model::GyroAxes;

/// A term of the error model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Term {
    /// D: drift of a gyro, constant or along its axes, 0 I, 1 O, 2 S.
    Drift(usize, [Option<usize>; 2]),
    /// T: what a gyro's torquer adds for the rate about an axis.
    Torquer(usize, usize),
    /// K_0 to K_3: a power of the force along the axis of an accelerometer.
    Power(usize, i32),
    /// K_IP, K_IO: the product with the force along the next axis but so many.
    Cross(usize, usize),
    /// M: an accelerometer's lean towards an axis.
    Lean(usize, usize),
    /// G.
    Gravity,
}

impl Term {
    /// The term of a parameter's name.
    pub fn of(name: &str) -> Option<Self> {
        let (kind, rest) = match name.split_once('_') {
            None => return (name == "G").then_some(Self::Gravity),
            Some(parts) => parts,
        };
        let (what, of) = rest.split_at_checked(rest.len().checked_sub(1)?)?;
        let of = axis(of)?;
        match (kind, what) {
            ("D", "F") => Some(Self::Drift(of, [None, None])),
            ("D", _) => {
                let mut axes = what.chars().map(|c| "IOS".find(c));
                let axes = [axes.next()??, axes.next().unwrap_or(Some(usize::MAX))?];
                Some(Self::Drift(of, axes.map(|a| (a < 3).then_some(a))))
            }
            ("T", _) => Some(Self::Torquer(axis(what)?, of)),
            ("M", _) => Some(Self::Lean(axis(what)?, of)),
            ("K", "IP") => Some(Self::Cross(of, 1)),
            ("K", "IO") => Some(Self::Cross(of, 2)),
            ("K", _) => Some(Self::Power(of, what.parse().ok()?)),
            _ => None,
        }
    }

    /// Whether it shows in what an accelerometer reads.
    pub fn is_of_accelerometers(self) -> bool {
        !matches!(self, Self::Drift(..) | Self::Torquer(..))
    }

    /// Whether the commanded rate drives it.
    pub fn is_of_torquers(self) -> bool {
        matches!(self, Self::Torquer(..))
    }

    /// ε^c of one unit of it, where gravity is `a` in the platform and the commanded rate `rate`,
    /// each of them counted `times`.
    pub fn drift<T: Real>(
        self,
        axes: &[GyroAxes; 3],
        a: &[T; 3],
        rate: &[T; 3],
        times: T,
    ) -> [T; 3] {
        let mut epsilon = [T::from(0.0); 3];
        match self {
            Self::Drift(gyro, along) => {
                let along = along.into_iter().flatten();
                epsilon[gyro] =
                    along.fold(times, |product, axis| product * dot(&axes[gyro][axis], a));
            }
            Self::Torquer(gyro, axis) => epsilon[gyro] = rate[axis],
            _ => {}
        }
        epsilon
    }

    /// δZ^c of one unit of it, where the specific force is `f`.
    pub fn output<T: Real>(self, f: &[T; 3]) -> [T; 3] {
        let mut output = [T::from(0.0); 3];
        match self {
            Self::Power(of, power) => {
                output[of] = (0..power).fold(T::from(1.0), |product, _| product * f[of]);
            }
            Self::Cross(of, next) => output[of] = f[of] * f[(of + next) % 3],
            Self::Lean(of, towards) => output[of] = f[towards],
            Self::Gravity => output = *f,
            Self::Drift(..) | Self::Torquer(..) => {}
        }
        output
    }
}

fn axis(name: &str) -> Option<usize> {
    ["X", "Y", "Z"].iter().position(|a| *a == name)
}

fn dot<T: Real>(axis: &[f64; 3], v: &[T; 3]) -> T {
    let along = axis.iter().zip(v);
    along.fold(T::from(0.0), |sum, (a, v)| sum + T::from(*a) * *v)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::FAMILIES;

    #[test]
    fn every_name_has_its_term() {
        let groups = FAMILIES.iter().flat_map(|f| f.groups());
        let names: Vec<&str> = groups.flat_map(|g| g.names).copied().collect();
        let terms: Vec<Term> = names.iter().filter_map(|n| Term::of(n)).collect();
        assert_eq!(terms.len(), names.len());
        for (k, term) in terms.iter().enumerate() {
            assert!(!terms[..k].contains(term), "{}", names[k]);
        }
        for (name, term) in [
            ("D_FZ", Term::Drift(2, [None, None])),
            ("D_SX", Term::Drift(0, [Some(2), None])),
            ("D_IOY", Term::Drift(1, [Some(0), Some(1)])),
            ("T_XZ", Term::Torquer(0, 2)),
            ("K_0X", Term::Power(0, 0)),
            ("K_3Z", Term::Power(2, 3)),
            ("K_IPZ", Term::Cross(2, 1)),
            ("M_ZY", Term::Lean(2, 1)),
        ] {
            assert_eq!(Term::of(name), Some(term), "{name}");
        }
        for name in ["", "D", "D_", "D_QX", "K_4q", "T_XW", "psi_nx", "D_IXQ"] {
            assert_eq!(Term::of(name), None, "{name}");
        }
    }
}
