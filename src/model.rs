//! The error model: which errors the platform has, and what each does.
//!
//! With a = g^c in g, the specific force f = −a and ω the commanded rate of the platform,
//!
//! ```text
//! ψ̇^n = −ω_ie^n × ψ^n + C_c^n ε^c + w
//! ε_k  = D_F + D_I a_I + D_O a_O + D_S a_S
//!      + D_II a_I² + D_SS a_S² + D_IO a_I a_O + D_IS a_I a_S + D_OS a_O a_S [+ D_OO a_O²]
//!      + T_kX ω_X + T_kY ω_Y + T_kZ ω_Z                                gyro k = X, Y, Z
//! Z^c  = −[g^c ×] ψ + δZ + v
//! δZ_i = K_0 + K_1 f_i + K_2 f_I² + K_3 f_I³ + K_IP f_I f_P + K_IO f_I f_O + M_ij f_j + G f_i
//! ω    = C_n^c ω_ie^n + ω_nc^c
//! ```
//!
//! a_I, a_O, a_S are along the axes of the gyro: input +x, +y, +z; output as it is [`Mounting`];
//! spin = input × output. The axes (I, P, O) of the accelerometers are X (x, y, z), Y (y, z, x) and
//! Z (z, x, y). The frame p is defined by the accelerometers (the paper's §1.1), so that of their six
//! misalignments only M_YX, M_ZX and M_ZY exist.
//!
//! Every parameter does something to one instrument, by factors times one [`Feature`] of a or f or ω:
//! [`ErrorModel::effects`] is this table, the constant mixing of features into parameters. A family
//! of parameters is one file and one line in [`FAMILIES`].

mod accelerometer;
mod alike;
mod colour;
mod constant;
mod g_sensitive;
mod gravity;
mod mounting;
mod quadratic;
mod torquer;

pub(crate) use alike::Alike;
pub use colour::{Colour, Markov};
pub(crate) use mounting::GyroAxes;
pub use mounting::Mounting;

use crate::drift::{COEFFICIENTS, CoefficientVector};
use crate::units::ARCSEC_PER_RAD;

/// Whether the filter knows of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Role {
    /// A state of the filter.
    Estimated,
    /// In the platform, but not in the filter.
    Considered,
}

impl Role {
    /// The name in documents.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Estimated => "estimated",
            Self::Considered => "considered",
        }
    }
}

/// The unit of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Unit {
    /// °/h.
    DegPerH,
    /// °/h/g.
    DegPerHPerG,
    /// °/h/g².
    DegPerHPerG2,
    /// 1e-6.
    Ppm,
    /// Seconds of arc.
    Arcsec,
    /// 1e-6 g.
    MicroG,
    /// 1e-6 /g.
    MicroGPerG2,
    /// 1e-6 /g².
    MicroGPerG3,
}

impl Unit {
    /// The name in documents and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::DegPerH => "deg/h",
            Self::DegPerHPerG => "deg/h/g",
            Self::DegPerHPerG2 => "deg/h/g2",
            Self::Ppm => "ppm",
            Self::Arcsec => "arcsec",
            Self::MicroG => "ug",
            Self::MicroGPerG2 => "ug/g2",
            Self::MicroGPerG3 => "ug/g3",
        }
    }

    /// What one of it is in the filter's units: °/h = arcsec/s for a drift, arcsec for an angle and
    /// for what an accelerometer shows (1 g is one radian of tilt).
    pub(crate) const fn in_filter_units(self) -> f64 {
        match self {
            Self::DegPerH | Self::DegPerHPerG | Self::DegPerHPerG2 | Self::Arcsec => 1.0,
            Self::Ppm | Self::MicroG | Self::MicroGPerG2 | Self::MicroGPerG3 => {
                1e-6 * ARCSEC_PER_RAD
            }
        }
    }
}

/// A parameter of the error model that the platform has.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameter {
    /// `D_FX`, `T_XY`, `K_0Z` …
    pub name: &'static str,
    /// The key of its group in the platform file.
    pub group: &'static str,
    /// Of its values and its σ.
    pub unit: Unit,
    /// Whether the filter knows of it.
    pub role: Role,
    /// 1σ before the test.
    pub prior_sigma: f64,
}

/// Parameters of one kind: a key of the platform file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Group {
    /// The key, in `[errors]` or, of the twelve coefficients, in `[prior]`.
    pub key: &'static str,
    /// What it is, for people.
    pub title: &'static str,
    /// How its parameters are written, for people.
    pub symbol: &'static str,
    pub unit: Unit,
    /// The parameters in order.
    pub names: &'static [&'static str],
    /// Parameters next to each other that belong to one instrument.
    pub per_instrument: usize,
}

impl Group {
    /// Which of three values given, [x, y, z], is that of a parameter.
    pub fn instrument(&self, index: usize) -> usize {
        (index / self.per_instrument) % 3
    }
}

/// What a parameter is multiplied with: powers of a for a gyro, of f for an accelerometer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Feature {
    One,
    /// A component.
    Linear(usize),
    /// The product of two components.
    Product(usize, usize),
    /// A component cubed.
    Cube(usize),
    /// A component of the commanded rate ω.
    Rate(usize),
}

impl Feature {
    /// Whether it is one of the commanded rate.
    pub const fn is_rate(self) -> bool {
        matches!(self, Self::Rate(_))
    }

    /// The axis of the commanded rate that it is.
    pub const fn rate_axis(self) -> Option<usize> {
        match self {
            Self::Rate(axis) => Some(axis),
            _ => None,
        }
    }
}

/// Where a parameter shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Instrument {
    /// As drift of a gyro: 0, 1, 2 for X, Y, Z.
    Gyro(usize),
    /// In what an accelerometer shows.
    Accelerometer(usize),
}

/// What a parameter does, or a part of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Effect {
    pub on: Instrument,
    pub feature: Feature,
    pub factor: f64,
}

/// Parameters that belong together.
pub(crate) trait Family: Sync {
    /// Its keys.
    fn groups(&self) -> &'static [Group];
    /// What the parameter `index` of the group `group` does, each in its place in the lists.
    fn effects(&self, group: usize, index: usize, mounting: &Mounting) -> Vec<Effect>;
}

/// All families; the first two are the twelve coefficients, which every platform has.
pub(crate) static FAMILIES: [&dyn Family; 6] = [
    &constant::Constant,
    &g_sensitive::GSensitive,
    &quadratic::Quadratic,
    &torquer::Torquer,
    &accelerometer::Accelerometer,
    &gravity::Gravity,
];

/// Families that every platform has.
const OF_EVERY_PLATFORM: usize = 2;

/// The groups that `[errors]` can give, in the order of the file.
pub(crate) fn optional_groups() -> impl Iterator<Item = &'static Group> {
    FAMILIES[OF_EVERY_PLATFORM..]
        .iter()
        .flat_map(|f| f.groups())
}

/// The group of a key; none where there is no such key.
pub(crate) fn group(key: &str) -> Option<&'static Group> {
    let mut all = FAMILIES.iter().flat_map(|f| f.groups());
    all.find(|group| group.key == key)
}

/// The group that a name of `[errors.parameter]` belongs to, and its place in it.
pub(crate) fn optional_parameter(name: &str) -> Option<(&'static Group, usize)> {
    optional_groups().find_map(|group| {
        let index = group.names.iter().position(|n| *n == name)?;
        Some((group, index))
    })
}

/// The parameters that a platform has, and what each does.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorModel {
    parameters: Vec<Parameter>,
    mounting: Mounting,
}

impl ErrorModel {
    /// The twelve coefficients with their priors, °/h, and `others`; those estimated come before
    /// those that are only considered.
    pub(crate) fn new(
        prior_deg_per_h: &CoefficientVector,
        mut others: Vec<Parameter>,
        mounting: Mounting,
    ) -> Self {
        let always = FAMILIES[..OF_EVERY_PLATFORM]
            .iter()
            .flat_map(|f| f.groups());
        let named = always.flat_map(|g| g.names.iter().map(move |name| (g, *name)));
        let twelve = named
            .zip(prior_deg_per_h.iter())
            .map(|((group, name), prior)| Parameter {
                name,
                group: group.key,
                unit: group.unit,
                role: Role::Estimated,
                prior_sigma: *prior,
            });
        // Stable: otherwise in the order of the families.
        others.sort_by_key(|p| p.role == Role::Considered);
        Self {
            parameters: twelve.chain(others).collect(),
            mounting,
        }
    }

    /// The parameters: the twelve coefficients, then others that are estimated, then those that are
    /// considered.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// How the gyros are mounted.
    pub fn mounting(&self) -> &Mounting {
        &self.mounting
    }

    /// How many are estimated.
    pub fn estimated(&self) -> usize {
        let estimated = |p: &&Parameter| p.role == Role::Estimated;
        self.parameters.iter().filter(estimated).count()
    }

    /// The same with a group that is considered as states of the filter. Those that are estimated
    /// already keep their places.
    pub(crate) fn estimating(&self, group: &str) -> Self {
        let mut all = self.clone();
        for p in all.parameters.iter_mut().filter(|p| p.group == group) {
            p.role = Role::Estimated;
        }
        // Stable.
        all.parameters.sort_by_key(|p| p.role == Role::Considered);
        all
    }

    /// Whether a rate of the platform shows in the drift: torquers have errors.
    pub fn feels_rates(&self) -> bool {
        let effects = self.parameters.iter().filter(|p| p.prior_sigma > 0.0);
        let mut effects = effects.flat_map(|p| self.effects_of(p));
        effects.any(|e| e.feature.is_rate())
    }

    /// Whether there is nothing but the twelve coefficients in the paper's mounting.
    pub fn is_of_the_paper(&self) -> bool {
        self.parameters.len() == COEFFICIENTS && self.mounting == Mounting::PAPER
    }

    /// What each parameter does, in the filter's units per unit of the parameter.
    pub(crate) fn effects(&self) -> Vec<Vec<Effect>> {
        self.parameters.iter().map(|p| self.effects_of(p)).collect()
    }

    fn effects_of(&self, parameter: &Parameter) -> Vec<Effect> {
        let unit = parameter.unit.in_filter_units();
        for family in FAMILIES {
            for (k, group) in family.groups().iter().enumerate() {
                if let Some(index) = group.names.iter().position(|n| *n == parameter.name) {
                    let mut effects = family.effects(k, index, &self.mounting);
                    effects.iter_mut().for_each(|e| e.factor *= unit);
                    return effects;
                }
            }
        }
        Vec::new()
    }
}

/// The component along `axis`.
fn along(axis: &[f64; 3]) -> Vec<(Feature, f64)> {
    let all = axis.iter().enumerate();
    all.filter(|(_, a)| **a != 0.0)
        .map(|(i, a)| (Feature::Linear(i), *a))
        .collect()
}

/// The product of the components along two axes.
fn product(u: &[f64; 3], v: &[f64; 3]) -> Vec<(Feature, f64)> {
    let mut features = Vec::new();
    for i in 0..3 {
        for j in i..3 {
            let factor = match i == j {
                true => u[i] * v[i],
                false => u[i] * v[j] + u[j] * v[i],
            };
            if factor != 0.0 {
                features.push((Feature::Product(i, j), factor));
            }
        }
    }
    features
}

/// Effects on one instrument.
fn on(instrument: Instrument, features: Vec<(Feature, f64)>) -> Vec<Effect> {
    let effect = |(feature, factor)| Effect {
        on: instrument,
        feature,
        factor,
    };
    features.into_iter().map(effect).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::drift::DriftCoefficient;

    fn groups() -> impl Iterator<Item = &'static Group> {
        FAMILIES.iter().flat_map(|f| f.groups())
    }

    fn of_names<'a>(names: impl Iterator<Item = &'a str>) -> ErrorModel {
        let parameter = |name: &str| {
            let (group, index) = optional_parameter(name).unwrap();
            Parameter {
                name: group.names[index],
                group: group.key,
                unit: group.unit,
                role: Role::Estimated,
                prior_sigma: 1.0,
            }
        };
        let prior = CoefficientVector::repeat(1.0);
        ErrorModel::new(&prior, names.map(parameter).collect(), Mounting::PAPER)
    }

    #[test]
    fn the_first_twelve_are_the_coefficients_and_no_name_is_given_twice() {
        let names: Vec<&str> = groups().flat_map(|g| g.names).copied().collect();
        for c in DriftCoefficient::ALL {
            assert_eq!(names[c.index()], c.name());
        }
        let different: BTreeSet<&str> = names.iter().copied().collect();
        assert_eq!(different.len(), names.len());
        let keys: BTreeSet<&str> = optional_groups().map(|g| g.key).collect();
        assert_eq!(keys.len(), optional_groups().count());
        // Twelve of drift, 18 quadratic, 9 torquer, 21 accelerometer, and gravity.
        assert_eq!(names.len(), 12 + 18 + 9 + 21 + 1);
        for group in groups() {
            let count = |k| {
                (0..group.names.len())
                    .filter(|i| group.instrument(*i) == k)
                    .count()
            };
            assert!(
                group.names.len() == 1 || count(0) == count(2),
                "{}",
                group.key
            );
        }
    }

    #[test]
    fn the_coefficients_have_the_excitations_of_the_paper() {
        let effects = of_names([].into_iter()).effects();
        for c in DriftCoefficient::ALL {
            let feature = match c.excitation() {
                None => (Feature::One, 1.0),
                Some((axis, sign)) => (Feature::Linear(axis), sign),
            };
            let expected = on(Instrument::Gyro(c.gyro()), vec![feature]);
            assert_eq!(effects[c.index()], expected, "{}", c.name());
        }
    }

    #[test]
    fn what_a_parameter_does_is_the_equations_term() {
        use Feature::{Cube, Linear, Product, Rate};
        use Instrument::{Accelerometer, Gyro};
        let micro = 1e-6 * ARCSEC_PER_RAD;
        // X gyro: I = x, O = −z, S = y; Y gyro: I = y, O = −z, S = −x; Z: z, x, y.
        let table = [
            ("D_IIX", Gyro(0), Product(0, 0), 1.0),
            ("D_SSY", Gyro(1), Product(0, 0), 1.0),
            ("D_IOX", Gyro(0), Product(0, 2), -1.0),
            ("D_ISY", Gyro(1), Product(0, 1), -1.0),
            ("D_OSY", Gyro(1), Product(0, 2), 1.0),
            ("D_OSZ", Gyro(2), Product(0, 1), 1.0),
            ("D_OOZ", Gyro(2), Product(0, 0), 1.0),
            ("T_YY", Gyro(1), Rate(1), micro),
            ("T_XZ", Gyro(0), Rate(2), 1.0),
            ("T_ZY", Gyro(2), Rate(1), 1.0),
            ("K_0Y", Accelerometer(1), Feature::One, micro),
            ("K_1Z", Accelerometer(2), Linear(2), micro),
            ("K_2X", Accelerometer(0), Product(0, 0), micro),
            ("K_3Y", Accelerometer(1), Cube(1), micro),
            ("K_IPX", Accelerometer(0), Product(0, 1), micro),
            ("K_IPZ", Accelerometer(2), Product(0, 2), micro),
            ("K_IOX", Accelerometer(0), Product(0, 2), micro),
            ("K_IOY", Accelerometer(1), Product(0, 1), micro),
            ("M_YX", Accelerometer(1), Linear(0), 1.0),
            ("M_ZY", Accelerometer(2), Linear(1), 1.0),
        ];
        let effects = of_names(table.iter().map(|(name, ..)| *name)).effects();
        for ((name, instrument, feature, factor), found) in table.iter().zip(&effects[12..]) {
            assert_eq!(*found, on(*instrument, vec![(*feature, *factor)]), "{name}");
        }
        let gravity = of_names(["G"].into_iter()).effects();
        let all = (0..3).flat_map(|i| on(Accelerometer(i), vec![(Linear(i), micro)]));
        assert_eq!(gravity[12], all.collect::<Vec<_>>());
    }
}
