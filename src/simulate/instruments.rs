//! The instruments of the true platform, each term as it stands in the equations of
//! [`model`](crate::model).
//!
//! The linear filter and the covariance have a table of features and factors; here gyros and
//! accelerometers are put together by the names of the parameters, so that a slip in one is found by
//! the other.

use nalgebra::{Matrix3, Vector3};

use crate::drift::COEFFICIENTS;
use crate::error::{Error, Result};
use crate::model::{ErrorModel, GyroAxes, Role, Unit};
use crate::units::{Angle, AngularRate};

const AXES: [&str; 3] = ["X", "Y", "Z"];
/// Input, output, spin.
const I: usize = 0;
const O: usize = 1;
const S: usize = 2;
/// The products of gravity that a gyro's drift may follow.
const PRODUCTS: [(&str, usize, usize); 6] = [
    ("D_II", I, I),
    ("D_SS", S, S),
    ("D_IO", I, O),
    ("D_IS", I, S),
    ("D_OS", O, S),
    ("D_OO", O, O),
];
/// The terms of an accelerometer's output along its own axes, in the order of [`Accelerometer`].
const POWERS: [&str; 6] = ["K_0", "K_1", "K_2", "K_3", "K_IP", "K_IO"];

/// A number of a parameter in a list of all of them; none: the platform has no such error.
type Place = Option<usize>;

/// Which parameter is which term of which instrument.
#[derive(Debug, Clone)]
pub(super) struct Layout {
    axes: [GyroAxes; 3],
    units: Vec<Unit>,
    products: [[Place; PRODUCTS.len()]; 3],
    torquers: [[Place; 3]; 3],
    powers: [[Place; POWERS.len()]; 3],
    leans: [[Place; 3]; 3],
    gravity: Place,
}

impl Layout {
    /// Of the parameters of `errors`; values come in their order.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`] for a parameter that is no term of these instruments.
    pub fn new(errors: &ErrorModel) -> Result<Self> {
        let parameters = errors.parameters();
        let mut found = COEFFICIENTS;
        let mut place = |name: String| {
            let place = parameters.iter().position(|p| p.name == name);
            found += usize::from(place.is_some());
            place
        };
        let layout = Self {
            axes: *errors.mounting().axes(),
            units: parameters.iter().map(|p| p.unit).collect(),
            products: AXES.map(|k| PRODUCTS.map(|(what, ..)| place(format!("{what}{k}")))),
            torquers: AXES.map(|k| AXES.map(|axis| place(format!("T_{k}{axis}")))),
            powers: AXES.map(|i| POWERS.map(|what| place(format!("{what}{i}")))),
            leans: AXES.map(|i| AXES.map(|j| place(format!("M_{i}{j}")))),
            gravity: place("G".to_owned()),
        };
        match found == parameters.len() {
            true => Ok(layout),
            false => Err(Error::numerical(
                "the simulated platform does not know every parameter",
            )),
        }
    }

    fn of_accelerometers(&self) -> impl Iterator<Item = usize> {
        let all = self
            .powers
            .iter()
            .flatten()
            .chain(self.leans.iter().flatten());
        all.chain([&self.gravity]).filter_map(|place| *place)
    }

    /// Whether the accelerometers have errors.
    pub fn has_accelerometers(&self) -> bool {
        self.of_accelerometers().next().is_some()
    }

    /// Whether they have errors of that role among the parameters of `errors`.
    pub fn has_accelerometers_of(&self, errors: &ErrorModel, role: Role) -> bool {
        self.of_accelerometers()
            .any(|k| errors.parameters()[k].role == role)
    }

    /// Whether the torquers have errors.
    pub fn has_torquers(&self) -> bool {
        self.torquers.iter().flatten().any(Option::is_some)
    }

    fn has_products(&self) -> bool {
        self.products.iter().flatten().any(Option::is_some)
    }

    /// The instruments whose parameters have these values, each in its unit; those that are left out
    /// at the end are zero.
    pub fn instruments(&self, values: &[f64]) -> Instruments {
        let si = |place: Place| match place {
            Some(k) => values.get(k).map_or(0.0, |v| in_si(self.units[k], *v)),
            None => 0.0,
        };
        // D_F, D_I, D_O, D_S of X, Y, Z.
        let along = |gyro: usize, kind: usize| si(Some(3 * kind + gyro));
        let by_gravity = |a: &Vector3<f64>| {
            Vector3::from_fn(|gyro, _| {
                let axes = self.axes[gyro].iter().enumerate();
                axes.fold(along(gyro, 0), |sum, (kind, axis)| {
                    sum + Vector3::from(*axis).dot(a) * along(gyro, 1 + kind)
                })
            })
        };
        let constant = by_gravity(&Vector3::zeros());
        // What 1 g along each axis of the platform adds.
        let per_g = [Vector3::x(), Vector3::y(), Vector3::z()].map(|a| by_gravity(&a) - constant);
        let per_g2 = |gyro: usize| {
            let axes = &self.axes[gyro];
            let terms = PRODUCTS.iter().zip(&self.products[gyro]);
            terms.fold(Matrix3::zeros(), |sum, ((_, u, v), place)| {
                let square = Vector3::from(axes[*u]) * Vector3::from(axes[*v]).transpose();
                sum + (square + square.transpose()) * (0.5 * si(*place))
            })
        };
        let matrix = |places: &[[Place; 3]; 3]| Matrix3::from_fn(|i, j| si(places[i][j]));
        Instruments {
            constant,
            per_g: Matrix3::from_columns(&per_g),
            per_g2: self.has_products().then(|| [0, 1, 2].map(per_g2)),
            torquers: self.has_torquers().then(|| matrix(&self.torquers)),
            accelerometers: self.has_accelerometers().then(|| Accelerometers {
                powers: self.powers.map(|places| places.map(si)),
                leans: matrix(&self.leans),
            }),
            gravity: si(self.gravity),
        }
    }
}

/// A value in rad/s (per g, per g²), rad or 1 (per g, …).
fn in_si(unit: Unit, value: f64) -> f64 {
    match unit {
        Unit::DegPerH | Unit::DegPerHPerG | Unit::DegPerHPerG2 => {
            AngularRate::from_deg_per_h(value).rad_per_s()
        }
        Unit::Arcsec => Angle::from_arcsec(value).rad(),
        Unit::Ppm | Unit::MicroG | Unit::MicroGPerG2 | Unit::MicroGPerG3 => 1e-6 * value,
    }
}

/// Three gyros with their torquers, and three accelerometers.
#[derive(Debug, Clone)]
pub(super) struct Instruments {
    constant: Vector3<f64>,
    per_g: Matrix3<f64>,
    /// Of each gyro a symmetric form.
    per_g2: Option<[Matrix3<f64>; 3]>,
    /// T.
    torquers: Option<Matrix3<f64>>,
    accelerometers: Option<Accelerometers>,
    /// G, a fraction.
    gravity: f64,
}

/// What the accelerometers show in error but for gravity's own.
#[derive(Debug, Clone)]
struct Accelerometers {
    /// K_0, K_1, K_2, K_3, K_IP, K_IO of each.
    powers: [[f64; POWERS.len()]; 3],
    /// M.
    leans: Matrix3<f64>,
}

impl Instruments {
    /// ε^p but for the torquers' part, for gravity `a` (g) in the platform, rad/s.
    pub fn drift(&self, a: &Vector3<f64>) -> Vector3<f64> {
        let linear = self.constant + self.per_g * a;
        match &self.per_g2 {
            None => linear,
            Some(forms) => linear + Vector3::from_fn(|gyro, _| a.dot(&(forms[gyro] * a))),
        }
    }

    /// ∂ε/∂a, rad/s per g.
    pub fn sensitivity(&self, a: &Vector3<f64>) -> Matrix3<f64> {
        match &self.per_g2 {
            None => self.per_g,
            Some(forms) => {
                let rows = forms.map(|form| (form * a * 2.0).transpose());
                self.per_g + Matrix3::from_rows(&rows)
            }
        }
    }

    /// T, if the torquers have errors: what a commanded rate adds to ε.
    pub fn torquers(&self) -> Option<&Matrix3<f64>> {
        self.torquers.as_ref()
    }

    /// How much larger gravity is than the value that is used, a fraction.
    pub fn gravity_error(&self) -> f64 {
        self.gravity
    }

    /// δZ but for G, for the specific force `f` (g) in the platform, g.
    pub fn output(&self, f: &Vector3<f64>) -> Vector3<f64> {
        let Some(Accelerometers { powers, leans }) = &self.accelerometers else {
            return Vector3::zeros();
        };
        let own = Vector3::from_fn(|i, _| {
            let [bias, scale, second, third, pendulous, output] = powers[i];
            let [along, p, o] = [f[i], f[(i + 1) % 3], f[(i + 2) % 3]];
            bias + along * (scale + second * along + third * along * along)
                + along * (pendulous * p + output * o)
        });
        own + leans * f
    }

    /// ∂δZ/∂f but for G; none: the accelerometers have no errors.
    pub fn output_slope(&self, f: &Vector3<f64>) -> Option<Matrix3<f64>> {
        let Accelerometers { powers, leans } = self.accelerometers.as_ref()?;
        let mut slope = *leans;
        for i in 0..3 {
            let [_, scale, second, third, pendulous, output] = powers[i];
            let (next, last) = ((i + 1) % 3, (i + 2) % 3);
            let along = f[i];
            slope[(i, i)] += scale
                + 2.0 * second * along
                + 3.0 * third * along * along
                + pendulous * f[next]
                + output * f[last];
            slope[(i, next)] += pendulous * along;
            slope[(i, last)] += output * along;
        }
        Some(slope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{Position, UP};
    use crate::covariance::selection::Mixing;
    use crate::platform::{Platform, PlatformConfig};
    use crate::units::ARCSEC_PER_RAD;

    /// Every error there is, gyros mounted as nobody does.
    fn everything() -> Platform {
        let mut config: PlatformConfig = toml::from_str(
            "[errors]\ntorquer_scale_factor_ppm = 1\ntorquer_misalignment_arcsec = 1\n\
             quadratic_drift_deg_per_h_per_g2 = 1\nquadratic_output_drift_deg_per_h_per_g2 = 1\n\
             accelerometer_bias_ug = 1\naccelerometer_scale_factor_ppm = 1\n\
             accelerometer_misalignment_arcsec = 1\naccelerometer_second_order_ug_per_g2 = 1\n\
             accelerometer_third_order_ug_per_g3 = 1\n\
             accelerometer_cross_coupling_ug_per_g2 = 1\nlocal_gravity_ug = 1\n\
             [gyro.output_axis]\nX = [0, 0.6, 0.8]\nY = \"+x\"\nZ = [-0.8, 0.6, 0]\n",
        )
        .unwrap();
        config.site.latitude_deg = 40.0;
        config.check().unwrap()
    }

    /// Term by term the instruments are those of the covariance, which knows them by another table.
    #[test]
    fn every_parameter_does_what_the_table_of_effects_says() {
        let platform = everything();
        let errors = platform.errors();
        let layout = Layout::new(errors).unwrap();
        assert!(layout.has_accelerometers() && layout.has_torquers());
        let mixing = Mixing::<f64>::new(&errors.effects());
        let omega = Vector3::new(3e-4, -2e-3, 7e-4);
        for angles in [[10.0, 20.0, 30.0], [-75.0, 140.0, 61.0]] {
            let c = *Position::from_deg(angles[0], angles[1], angles[2])
                .attitude()
                .matrix();
            let f = c.row(UP).transpose();
            let (a, b) = (mixing.drift(&c, &omega, 1.0), mixing.output(&c));
            for (k, parameter) in errors.parameters().iter().enumerate() {
                let mut values = vec![0.0; errors.parameters().len()];
                values[k] = 1.0;
                let one = layout.instruments(&values);
                let torqued = one.torquers().unwrap() * omega;
                let drift = c * (one.drift(&-f) + torqued) * ARCSEC_PER_RAD;
                let shown = one.output(&f) + f * one.gravity_error();
                let shown = c * shown * ARCSEC_PER_RAD;
                let scale = a.column(k).amax() + b.column(k).amax();
                let off = (drift - a.column(k)).amax() + (shown - b.column(k)).amax();
                assert!(
                    scale > 0.0 && off < 1e-12 * scale,
                    "{}: {off}",
                    parameter.name
                );
            }
        }
    }

    #[test]
    fn slopes_are_derivatives() {
        let platform = everything();
        let layout = Layout::new(platform.errors()).unwrap();
        let count = platform.errors().parameters().len();
        let values: Vec<f64> = (0..count).map(|k| ((3 * k + 1) as f64).sin()).collect();
        let instruments = layout.instruments(&values);
        let f = Vector3::new(0.3, -0.8, 0.5);
        let h = 1e-5;
        for j in 0..3 {
            let mut step = Vector3::zeros();
            step[j] = h;
            let slope = |of: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| {
                (of(&(f + step)) - of(&(f - step))) / (2.0 * h)
            };
            let drift = slope(&|a| instruments.drift(a));
            assert!((drift - instruments.sensitivity(&f).column(j)).amax() < 1e-13);
            let shown = slope(&|f| instruments.output(f));
            let expected = instruments.output_slope(&f).unwrap();
            assert!((shown - expected.column(j)).amax() < 1e-14);
        }
    }

    #[test]
    fn a_platform_without_errors_has_perfect_accelerometers_and_torquers() {
        let platform = PlatformConfig::default().check().unwrap();
        let layout = Layout::new(platform.errors()).unwrap();
        let instruments = layout.instruments(&[]);
        assert!(!layout.has_accelerometers() && instruments.torquers().is_none());
        assert_eq!(instruments.output_slope(&Vector3::x()), None);
        assert_eq!(instruments.output(&Vector3::x()), Vector3::zeros());
        assert_eq!(instruments.gravity_error(), 0.0);
    }
}
