//! The mission after the calibration: what the remaining errors of the gyros do to the attitude.
//!
//! Over a profile of specific force f(t), in g in platform axes, and of the platform's rate ω(t)
//! against inertial space, the platform drifts by ε^p = B(a = −f, ω) D. Its attitude error obeys
//! φ̇ = −[ω ×] φ + ε^p and is, at the end,
//!
//! ```text
//! φ(T) = L_u D,   L_u = ∫ Φ(T, t) B(−f(t), ω(t)) dt,   Φ̇ = −[ω ×] Φ.
//! ```
//!
//! Criterion [`use`](crate::criterion::Criterion::Use) is √tr(L_u P L_uᵀ): I- or V-optimality, `a` with
//! the weight matrix L_uᵀ L_u. Errors of the accelerometers do not turn the platform.

use std::path::Path;

use nalgebra::{DMatrix, Matrix3, Matrix3xX, Rotation3, Vector3};

use crate::error::{Error, Result};
use crate::model::{Effect, ErrorModel, Feature, Instrument};
use crate::schedule::text;

/// Columns that every profile has.
const REQUIRED: [&str; 4] = ["time_s", "f_x", "f_y", "f_z"];
/// Columns of one whose platform turns.
const RATES: [&str; 3] = ["w_x", "w_y", "w_z"];
/// Most rows of a profile.
const MOST_ROWS: usize = 1_000_000;
/// Most steps of the integration, which is some seconds: one for every row and every half degree turned.
const MOST_STEPS: usize = 4_000_000;

/// An instant of a profile.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Instant {
    time_s: f64,
    /// f, g.
    force: Vector3<f64>,
    /// ω, rad/s.
    rate: Vector3<f64>,
}

impl Instant {
    /// Between this one and another, `share` of the way.
    fn towards(&self, other: &Self, share: f64) -> Self {
        Self {
            time_s: self.time_s + (other.time_s - self.time_s) * share,
            force: self.force.lerp(&other.force, share),
            rate: self.rate.lerp(&other.rate, share),
        }
    }
}

/// A profile of specific force and rate, linear between its rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Mission {
    instants: Vec<Instant>,
}

impl Mission {
    /// Reads a CSV file: `time_s`, `f_x`, `f_y`, `f_z` (g, platform axes), and `w_x`, `w_y`, `w_z` (°/s,
    /// platform axes) where it turns, in any order; lines that start with `#` are skipped.
    ///
    /// # Errors
    ///
    /// [`Error::is_io`] when it cannot be read; [`Error::is_input`] with file, line, column and what is
    /// allowed.
    pub fn read(path: &Path) -> Result<Self> {
        let text = text::read_text(path, text::MAX_SCHEDULE_BYTES)?;
        Self::from_csv(&text).map_err(|e| e.with_file(path))
    }

    /// The same from the text of such a file.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] with line, column and what is allowed.
    ///
    /// ```
    /// use scheme_opt::internals::mission::Mission;
    /// let mission = Mission::from_csv("time_s,f_x,f_y,f_z\n0,0,1.3,0\n120,0,4.5,0.1\n")?;
    /// assert_eq!(mission.duration_s(), 120.0);
    /// let error = Mission::from_csv("time_s,f_x,f_y,f_z\n0,0,1,0\n0,0,1,0\n").unwrap_err();
    /// assert_eq!((error.line(), error.key()), (Some(3), Some("time_s")));
    /// # Ok::<(), scheme_opt::Error>(())
    /// ```
    pub fn from_csv(text: &str) -> Result<Self> {
        let mut reader = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .trim(csv::Trim::All)
            .from_reader(text::without_bom(text).as_bytes());
        let columns = Columns::of(reader.headers().map_err(text::unreadable_csv)?)?;
        let mut instants: Vec<Instant> = Vec::new();
        let mut all_steps = 0_usize;
        for record in reader.records() {
            let record = record.map_err(text::unreadable_csv)?;
            let line = record.position().map_or(0, |p| p.line() as usize);
            let instant = columns.instant(&record).map_err(|e| e.with_line(line))?;
            if let Some(last) = instants.last()
                && instant.time_s <= last.time_s
            {
                return Err(Error::input("the times of a profile increase")
                    .with_key("time_s")
                    .with_value(instant.time_s)
                    .with_allowed(format!(
                        "greater than that of the row before, {}",
                        last.time_s
                    ))
                    .with_line(line));
            }
            if let Some(last) = instants.last() {
                all_steps = all_steps.saturating_add(steps(last, &instant));
                if all_steps > MOST_STEPS {
                    return Err(turns_too_far(last, &instant).with_line(line));
                }
            }
            instants.push(instant);
            if instants.len() > MOST_ROWS {
                return Err(Error::input(format!("more than {MOST_ROWS} rows")));
            }
        }
        if instants.len() < 2 {
            return Err(Error::input("a profile has at least two rows")
                .with_key("rows")
                .with_value(instants.len())
                .with_allowed("two or more rows after the header"));
        }
        Ok(Self { instants })
    }

    /// How long it lasts, s.
    pub fn duration_s(&self) -> f64 {
        let [first, .., last] = &self.instants[..] else {
            return 0.0;
        };
        last.time_s - first.time_s
    }

    /// The largest specific force, g.
    pub fn largest_force_g(&self) -> f64 {
        let forces = self.instants.iter().map(|i| i.force.norm());
        forces.fold(0.0, f64::max)
    }

    /// L_u: the attitude error about x, y, z at the end, arcsec, per unit of each parameter.
    pub fn sensitivity(&self, errors: &ErrorModel) -> Matrix3xX<f64> {
        // Gauss's rule of three nodes: exact for powers of f up to the fifth where nothing turns.
        const NODES: [(f64, f64); 3] = [
            (0.112_701_665_379_258_3, 5.0 / 18.0),
            (0.5, 8.0 / 18.0),
            (0.887_298_334_620_741_7, 5.0 / 18.0),
        ];
        let effects = errors.effects();
        let mut sum = Matrix3xX::zeros(effects.len());
        // Backwards, so that what follows a step is known: Φ(T, t).
        let mut to_end: Matrix3<f64> = Matrix3::identity();
        for pair in self.instants.windows(2).rev() {
            let (from, to) = (pair[0], pair[1]);
            let steps = steps(&from, &to);
            for step in (0..steps).rev() {
                let at = |k: usize| from.towards(&to, k as f64 / steps as f64);
                let (start, end) = (at(step), at(step + 1));
                let length_s = end.time_s - start.time_s;
                for (share, weight) in NODES {
                    let node = start.towards(&end, share);
                    let rest = turned(&node, &end);
                    sum += to_end * rest * drift(&effects, &node) * (weight * length_s);
                }
                to_end *= turned(&start, &end);
            }
        }
        sum
    }

    /// L_uᵀ L_u over the parameters at `seen`, arcsec² per product of their units.
    pub fn weight(&self, errors: &ErrorModel, seen: &[usize]) -> DMatrix<f64> {
        let all = self.sensitivity(errors);
        let of_seen = all.select_columns(seen);
        of_seen.transpose() * of_seen
    }
}

/// Most that the platform turns in a step of the integration.
const MOST_RAD: f64 = 0.01;

/// Into how many steps an interval is cut: in none the platform turns by more than half a degree.
fn steps(from: &Instant, to: &Instant) -> usize {
    let turn = from.rate.norm().max(to.rate.norm()) * (to.time_s - from.time_s);
    (turn / MOST_RAD).ceil().max(1.0) as usize
}

/// A rate that would take hours to follow; the interval ends at `to`.
fn turns_too_far(from: &Instant, to: &Instant) -> Error {
    let most_deg = (MOST_STEPS as f64 * MOST_RAD).to_degrees();
    let rate = match to.rate.norm() > from.rate.norm() {
        true => to.rate,
        false => from.rate,
    };
    let axis = rate.iamax();
    Error::input("the platform turns too far in all up to this row")
        .with_key(RATES[axis])
        .with_value(rate[axis].to_degrees())
        .with_allowed(format!("about {most_deg:.0} deg in all"))
}

/// Φ from one instant to a later one, ω being linear between: minus the rotation vector
/// ∫ω dt + h²/12 ω₀ × ω₁, the two-sample coning term (Miller 1983), right to h⁴.
fn turned(from: &Instant, to: &Instant) -> Matrix3<f64> {
    let h = to.time_s - from.time_s;
    let angle = (from.rate + to.rate) * (0.5 * h) + from.rate.cross(&to.rate) * (h * h / 12.0);
    Rotation3::new(-angle).into_inner()
}

/// B: the drift about x, y, z, °/h = arcsec/s, per unit of each parameter.
fn drift(effects: &[Vec<Effect>], at: &Instant) -> Matrix3xX<f64> {
    let a = -at.force;
    let mut columns = Matrix3xX::zeros(effects.len());
    for (j, effects) in effects.iter().enumerate() {
        for effect in effects {
            let Instrument::Gyro(k) = effect.on else {
                continue;
            };
            let feature = match effect.feature {
                Feature::One => 1.0,
                Feature::Linear(i) => a[i],
                Feature::Product(i, j) => a[i] * a[j],
                Feature::Cube(i) => a[i] * a[i] * a[i],
                Feature::Rate(i) => at.rate[i],
            };
            columns[(k, j)] += effect.factor * feature;
        }
    }
    columns
}

/// Where the columns of a profile stand.
struct Columns {
    required: [usize; 4],
    rates: Option<[usize; 3]>,
}

impl Columns {
    fn of(header: &csv::StringRecord) -> Result<Self> {
        let known = || REQUIRED.into_iter().chain(RATES);
        for name in header {
            if !known().any(|k| k == name) {
                let error = Error::input("no such column of a profile")
                    .with_value(text::shown(name))
                    .with_allowed(known().collect::<Vec<_>>().join(", "))
                    .with_line(1);
                return Err(text::with_nearest(error, name, known()));
            }
            if header.iter().filter(|other| *other == name).count() > 1 {
                return Err(Error::input("a column of the profile is given twice")
                    .with_key(name)
                    .with_value("twice")
                    .with_allowed("once")
                    .with_line(1));
            }
        }
        let place = |name: &&str| {
            header.iter().position(|h| h == *name).ok_or_else(|| {
                let (required, rates) = (REQUIRED.join(", "), RATES.join(", "));
                Error::input("a column of the profile is missing")
                    .with_key(*name)
                    .with_value(text::shown(&header.iter().collect::<Vec<_>>().join(",")))
                    .with_allowed(format!("{required}, and all of {rates} or none"))
                    .with_line(1)
            })
        };
        let places = |names: &[&str]| names.iter().map(place).collect::<Result<Vec<usize>>>();
        let required = places(&REQUIRED)?;
        let turns = header.iter().any(|h| RATES.contains(&h));
        let rates = match turns {
            true => Some(places(&RATES)?),
            false => None,
        };
        Ok(Self {
            required: std::array::from_fn(|i| required[i]),
            rates: rates.map(|of| std::array::from_fn(|i| of[i])),
        })
    }

    fn instant(&self, record: &csv::StringRecord) -> Result<Instant> {
        let number = |at: usize, name: &str, most: f64, unit: &str| {
            let cell = record.get(at).unwrap_or_default();
            let value: f64 = cell.parse().unwrap_or(f64::NAN);
            match value.abs() <= most {
                true => Ok(value),
                false => Err(Error::input("not a number that makes sense here")
                    .with_key(name)
                    .with_value(text::shown(cell))
                    .with_allowed(format!("-{most} to {most} {unit}"))),
            }
        };
        let mut force = Vector3::zeros();
        for i in 0..3 {
            force[i] = number(self.required[1 + i], REQUIRED[1 + i], 1e3, "g")?;
        }
        let mut rate = Vector3::zeros();
        for (i, at) in self.rates.into_iter().flatten().enumerate() {
            rate[i] = number(at, RATES[i], 1e4, "deg/s")?.to_radians();
        }
        Ok(Instant {
            time_s: number(self.required[0], REQUIRED[0], 1e9, "s")?,
            force,
            rate,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::PlatformConfig;
    use crate::testing::assert_refused_by_key;

    fn errors() -> ErrorModel {
        let config = serde_json::json!({ "errors": {
            "torquer_scale_factor_ppm": 1000.0,
            "torquer_misalignment_arcsec": 60.0,
            "accelerometer_bias_ug": 100.0,
            "quadratic_drift_deg_per_h_per_g2": 0.1,
        } });
        let config: PlatformConfig = serde_json::from_value(config).unwrap();
        config.check().unwrap().errors().clone()
    }

    fn column(errors: &ErrorModel, name: &str) -> usize {
        errors
            .parameters()
            .iter()
            .position(|p| p.name == name)
            .unwrap()
    }

    #[test]
    fn a_constant_force_for_a_time_is_drift_times_time() {
        let mission = Mission::from_csv("time_s,f_x,f_y,f_z\n5,2,-3,0.5\n65,2,-3,0.5\n").unwrap();
        let errors = errors();
        let l = mission.sensitivity(&errors);
        // a = −f; the paper's mounting: X gyro I x, O −z, S y; Y gyro I y, O −z, S −x.
        for (name, axis, per_s) in [
            ("D_FX", 0, 1.0),
            ("D_IX", 0, -2.0),
            ("D_OX", 0, 0.5),
            ("D_SX", 0, 3.0),
            ("D_SY", 1, 2.0),
            ("D_IIX", 0, 4.0),
            ("D_ISX", 0, -6.0),
            ("K_0X", 0, 0.0),
            ("T_XX", 0, 0.0),
        ] {
            let found = l.column(column(&errors, name));
            assert!(
                (found[axis] - 60.0 * per_s).abs() < 1e-10,
                "{name}: {found}"
            );
            assert!(
                (found.norm() - 60.0 * f64::abs(per_s)).abs() < 1e-10,
                "{name}"
            );
        }
    }

    /// Against Runge–Kutta of φ̇ = −[ω ×] φ + ε with steps of a millisecond.
    #[test]
    fn a_turning_platform_carries_its_errors_along() {
        let text = "time_s,w_x,w_y,w_z,f_x,f_y,f_z\n\
                    0,3,-2,1,0,1,0\n4,-5,6,2,0.5,2,-1\n7,8,0,-9,1,0,0.3\n";
        let mission = Mission::from_csv(text).unwrap();
        let errors = errors();
        let effects = errors.effects();
        let at = |t: f64| {
            let pair = match t < 4.0 {
                true => &mission.instants[..2],
                false => &mission.instants[1..],
            };
            let share = (t - pair[0].time_s) / (pair[1].time_s - pair[0].time_s);
            pair[0].towards(&pair[1], share)
        };
        let slope = |t: f64, phi: &Matrix3xX<f64>| {
            let now = at(t);
            drift(&effects, &now) - now.rate.cross_matrix() * phi
        };
        let h = 1e-3;
        let mut phi = Matrix3xX::zeros(effects.len());
        for k in 0..7000 {
            let t = f64::from(k) * h;
            let k1 = slope(t, &phi);
            let k2 = slope(t + 0.5 * h, &(&phi + &k1 * (0.5 * h)));
            let k3 = slope(t + 0.5 * h, &(&phi + &k2 * (0.5 * h)));
            let k4 = slope(t + h, &(&phi + &k3 * h));
            phi += (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
        }
        let found = mission.sensitivity(&errors);
        for (j, p) in errors.parameters().iter().enumerate() {
            let error = (found.column(j) - phi.column(j)).norm();
            let size = phi.column(j).norm().max(1e-3);
            assert!(error < 1e-7 * size, "{}: {error:e} of {size:e}", p.name);
        }
    }

    #[test]
    fn each_fault_of_a_profile_is_refused_with_its_place() {
        let header = "time_s,f_x,f_y,f_z\n";
        for (text, key, line) in [
            (format!("{header}0,0,1,0\n1,x,1,0\n"), "f_x", 3),
            (format!("{header}0,0,1,0\n1,0,nan,0\n"), "f_y", 3),
            (format!("{header}0,0,1,0\n1,0,2000,0\n"), "f_y", 3),
            (format!("{header}0,0,1,0\n-1,0,1,0\n"), "time_s", 3),
            ("time_s,f_x,f_y\n0,0,1\n1,0,1\n".to_owned(), "f_z", 1),
            (
                "time_s,f_x,f_y,f_z,w_x\n0,0,1,0,1\n1,0,1,0,1\n".to_owned(),
                "w_y",
                1,
            ),
            ("time_s,time_s,f_x,f_y,f_z\n".to_owned(), "time_s", 1),
            (
                "time_s,f_x,f_y,f_z,w_x,w_y,w_z\n0,0,1,0,0,0,0\n1,0,1,0,1,-9000,0\n1e6,0,1,0,0,0,0\n"
                    .to_owned(),
                "w_y",
                4,
            ),
        ] {
            let error = Mission::from_csv(&text).unwrap_err();
            assert_refused_by_key(&error, key);
            assert_eq!(error.line(), Some(line), "{text}");
        }
        for text in [
            "",
            header,
            "time_s,g_x,f_y,f_z\n",
            "time_s,f_x,f_y,f_z\n0,0,1,0\n1,0\n",
        ] {
            let error = Mission::from_csv(text).unwrap_err();
            assert!(error.is_input(), "{text}: {error}");
        }
    }
}
