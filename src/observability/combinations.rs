//! Linear combinations of what is to be found: D and ω_N ψ_y^n(0), and their names.

use std::fmt;

use super::regressor::UNKNOWNS;
use super::row_space::unit;
use crate::drift::{COEFFICIENTS, CoefficientVector, DriftCoefficient};

/// A linear combination of the coefficients and of ω_N ψ_y^n(0), all in the same rate unit.
///
/// ```
/// use scheme_opt::internals::drift::DriftCoefficient as D;
/// use scheme_opt::internals::observability::Combination;
/// let difference = Combination::of(&[(D::IX, 1.0), (D::IY, -1.0)]);
/// assert_eq!(difference.to_string(), "D_IX - D_IY");
/// assert_eq!(Combination::input_trace().to_string(), "D_IX + D_IY + D_IZ");
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Combination {
    weights: [f64; UNKNOWNS],
}

impl Combination {
    /// The sum of these terms.
    pub fn of(terms: &[(DriftCoefficient, f64)]) -> Self {
        let mut weights = [0.0; UNKNOWNS];
        for (coefficient, weight) in terms {
            weights[coefficient.index()] += weight;
        }
        Self { weights }
    }

    /// One coefficient alone.
    pub fn single(coefficient: DriftCoefficient) -> Self {
        Self::of(&[(coefficient, 1.0)])
    }

    /// ω_N ψ_y^n(0) alone: the azimuth misalignment, as the drift it is taken for.
    pub fn azimuth() -> Self {
        Self {
            weights: unit(COEFFICIENTS),
        }
    }

    /// D_IX + D_IY + D_IZ, which gives the same ε^n = (0, −1/3, 0) of itself at every position.
    pub fn input_trace() -> Self {
        use DriftCoefficient as D;
        Self::of(&[(D::IX, 1.0), (D::IY, 1.0), (D::IZ, 1.0)])
    }

    /// With these weights of the coefficients and `azimuth` of ω_N ψ_y^n(0).
    pub fn from_weights(coefficients: &CoefficientVector, azimuth: f64) -> Self {
        Self {
            weights: std::array::from_fn(|i| match i {
                COEFFICIENTS => azimuth,
                _ => coefficients[i],
            }),
        }
    }

    pub(crate) const fn from_array(weights: [f64; UNKNOWNS]) -> Self {
        Self { weights }
    }

    pub(crate) const fn as_array(&self) -> &[f64; UNKNOWNS] {
        &self.weights
    }

    /// The weights of the coefficients.
    pub fn coefficients(&self) -> CoefficientVector {
        CoefficientVector::from_fn(|i, _| self.weights[i])
    }

    /// The names of what occurs with a weight of `least` or more.
    pub(super) fn names(&self, least: f64) -> Vec<&'static str> {
        let occurs = self.weights.iter().enumerate();
        occurs
            .filter(|(_, weight)| weight.abs() >= least)
            .map(|(i, _)| name_of(i))
            .collect()
    }

    /// The same with the largest weight one and small ones dropped: what a person calls it.
    /// Weights below `drop` of the largest go. Unchanged when all weights are zero.
    #[must_use]
    pub fn rounded(&self, drop: f64) -> Self {
        let first_of = |a: f64, b: f64| {
            if b.abs() > a.abs() * (1.0 + 1e-9) {
                b
            } else {
                a
            }
        };
        let largest = self.weights.iter().copied().fold(0.0, first_of);
        if largest == 0.0 {
            return *self;
        }
        let weights = self.weights.map(|w| {
            let relative = w / largest;
            if relative.abs() < drop { 0.0 } else { relative }
        });
        Self { weights }
    }
}

/// The name of unknown `i`.
fn name_of(i: usize) -> &'static str {
    match DriftCoefficient::ALL.get(i) {
        Some(c) => c.name(),
        None => "omega_N psi_y(0)",
    }
}

impl fmt::Display for Combination {
    /// "D_IX + D_IY - 0.500 D_IZ"; weights below 1e-6 are left out.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut first = true;
        for (i, &weight) in self.weights.iter().enumerate() {
            if weight.abs() < 1e-6 {
                continue;
            }
            let sign = match (first, weight < 0.0) {
                (true, false) => "",
                (true, true) => "-",
                (false, false) => " + ",
                (false, true) => " - ",
            };
            f.write_str(sign)?;
            // Plain ones are not written, and not 1.000 or 0.000 either.
            match weight.abs() {
                size if size < 5e-4 => write!(f, "{size:.1e} ")?,
                size if (size - 1.0).abs() > 5e-4 => write!(f, "{size:.3} ")?,
                _ => {}
            }
            f.write_str(name_of(i))?;
            first = false;
        }
        if first { f.write_str("0") } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use DriftCoefficient as D;

    #[test]
    fn names_are_what_a_person_writes() {
        let c = Combination::of(&[(D::FX, -1.0), (D::IZ, 0.5), (D::SX, 1e-9)]);
        assert_eq!(c.to_string(), "-D_FX + 0.500 D_IZ");
        assert_eq!(Combination::azimuth().to_string(), "omega_N psi_y(0)");
        assert_eq!(Combination::of(&[]).to_string(), "0");
        let tilted = Combination::of(&[(D::FX, 1.0), (D::OX, -1.745e-4)]);
        assert_eq!(tilted.to_string(), "D_FX - 1.7e-4 D_OX");
    }

    #[test]
    fn rounding_keeps_the_largest_and_drops_the_small() {
        let c = Combination::of(&[(D::IX, -0.5), (D::IY, -0.5), (D::SX, 0.01)]);
        assert_eq!(c.rounded(0.05).to_string(), "D_IX + D_IY");
        assert_eq!(Combination::of(&[]).rounded(0.1), Combination::of(&[]));
    }

    #[test]
    fn weights_come_back() {
        let weights = CoefficientVector::from_fn(|i, _| i as f64);
        let c = Combination::from_weights(&weights, -2.0);
        assert_eq!(c.coefficients(), weights);
        assert_eq!(c.as_array()[COEFFICIENTS], -2.0);
    }
}
