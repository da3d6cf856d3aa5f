//! What the objective asks of each parameter, on the platform at hand.

use nalgebra::DMatrix;

use super::{CriterionKind, ObjectiveConfig, PerCoefficient};
use crate::drift::{COEFFICIENTS, CoefficientVector};
use crate::error::{Error, Result};
use crate::mission::Mission;
use crate::model::{ErrorModel, Role};
use crate::platform::Platform;

/// Specifications and weights, checked.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Aims {
    /// Weight of each coefficient's variance in criterion `a`.
    pub weights: CoefficientVector,
    /// 1σ specification of each coefficient, °/h (per g), infinite for those without one; `None` when
    /// nothing is specified.
    pub spec_deg_per_h: Option<CoefficientVector>,
    /// Other parameters with a weight, a specification or a part in the mission, as places in the
    /// platform's.
    pub others: Vec<usize>,
    /// Their weights; 0 where there is none.
    pub weights_of_others: Vec<f64>,
    /// Their specifications in their units; infinite where there is none.
    pub spec_of_others: Vec<f64>,
    /// Of criterion `use`: L_uᵀ L_u over the others and the coefficients.
    pub use_weight: Option<DMatrix<f64>>,
}

const SPEC: &str = "objective.spec";
const SPEC_DEG_PER_H: &str = "objective.spec_deg_per_h";
const WEIGHTS: &str = "objective.weights";
const USE: &str = "objective.use";

impl Aims {
    /// # Errors
    ///
    /// [`Error::is_input`] naming the key, the value and what is allowed; [`Error::is_io`] for a
    /// profile that cannot be read.
    pub fn check(objective: &ObjectiveConfig, platform: &Platform) -> Result<Self> {
        let errors = platform.errors();
        let spec_deg_per_h = specification(objective)?;
        let weights = objective.weights.check_weights()?;
        let weighted = objective.weights.of_others(WEIGHTS, errors)?;
        let specified = objective.spec.of_others(SPEC, errors)?;
        let mission = mission(objective)?;
        let mut others: Vec<usize> = weighted
            .iter()
            .chain(&specified)
            .map(|(at, _)| *at)
            .collect();
        if let Some(mission) = &mission {
            others.extend(felt(mission, errors));
        }
        others.sort_unstable();
        others.dedup();
        let given = |of: &[(usize, f64)], otherwise: f64| -> Vec<f64> {
            let of = |at: &usize| of.iter().find(|(known, _)| known == at);
            let value = |at| of(at).map_or(otherwise, |(_, value)| *value);
            others.iter().map(value).collect()
        };
        let seen: Vec<usize> = others.iter().copied().chain(0..COEFFICIENTS).collect();
        Ok(Self {
            weights,
            spec_deg_per_h,
            weights_of_others: given(&weighted, 0.0),
            spec_of_others: given(&specified, f64::INFINITY),
            use_weight: mission.map(|mission| mission.weight(errors, &seen)),
            others,
        })
    }
}

/// Both tables of specifications in one.
fn specification(objective: &ObjectiveConfig) -> Result<Option<CoefficientVector>> {
    let of_drift = &objective.spec_deg_per_h;
    if let Some((name, value)) = of_drift.others.iter().next() {
        return Err(Error::input(
            "this parameter is no drift coefficient, and has a unit of its own",
        )
        .with_key(format!("{SPEC_DEG_PER_H}.{name}"))
        .with_value(value)
        .with_allowed(format!("{name} in [{SPEC}], in its own unit")));
    }
    let twice = |name: &str, value: f64| {
        Error::input("given in both tables of specifications")
            .with_key(format!("{SPEC_DEG_PER_H}.{name}"))
            .with_value(value)
            .with_allowed(format!("one of [{SPEC}] and [{SPEC_DEG_PER_H}]"))
    };
    if let (Some(value), Some(_)) = (of_drift.default, objective.spec.default) {
        return Err(twice("default", value));
    }
    for (coefficient, value) in &of_drift.coefficients {
        if objective.spec.coefficients.contains_key(coefficient) {
            return Err(twice(coefficient.name(), *value));
        }
    }
    of_drift.check_spec(SPEC_DEG_PER_H)?;
    objective.spec.check_spec(SPEC)?;
    Ok(objective.specification().as_vector())
}

impl ObjectiveConfig {
    /// `spec` and `spec_deg_per_h` in one.
    pub fn specification(&self) -> PerCoefficient {
        let mut all = self.spec.clone();
        all.default = all.default.or(self.spec_deg_per_h.default);
        all.coefficients.extend(&self.spec_deg_per_h.coefficients);
        all
    }
}

/// The mission, where the criterion asks for one.
fn mission(objective: &ObjectiveConfig) -> Result<Option<Mission>> {
    match (objective.criterion, &objective.use_profile) {
        (CriterionKind::Use, Some(path)) => {
            // Which key names a file that cannot be read; a fault inside it has a key of its own.
            let read = Mission::read(path).map_err(|e| match e.is_io() {
                true => e.with_key(USE),
                false => e,
            });
            read.map(Some)
        }
        (CriterionKind::Use, None) => Err(Error::input("needs the profile of a mission")
            .with_key("objective.criterion")
            .with_value("\"use\"")
            .with_allowed(format!("\"use\" together with {USE}"))
            .with_hint(
                "give use = \"flight.csv\", a file with the columns time_s, f_x, f_y, f_z (g)",
            )),
        (_, Some(path)) => Err(Error::input("a profile belongs to criterion `use`")
            .with_key(USE)
            .with_value(format!("\"{}\"", path.display()))
            .with_allowed("left out, or criterion = \"use\"")),
        (_, None) => Ok(None),
    }
}

/// Parameters beside the twelve coefficients that are estimated and turn the platform in the mission.
fn felt(mission: &Mission, errors: &ErrorModel) -> Vec<usize> {
    let sensitivity = mission.sensitivity(errors);
    let all = errors.parameters().iter().enumerate().skip(COEFFICIENTS);
    let estimated = all.filter(|(_, p)| p.role == Role::Estimated);
    let felt = estimated.filter(|(at, _)| sensitivity.column(*at).norm() > 0.0);
    felt.map(|(at, _)| at).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use crate::config::StudyConfig;
    use crate::drift::DriftCoefficient;
    use crate::testing::assert_refused_by_key;

    fn config(errors: serde_json::Value, objective: serde_json::Value) -> StudyConfig {
        serde_json::from_value(json!({ "errors": errors, "objective": objective })).unwrap()
    }

    #[test]
    fn every_parameter_can_have_a_specification_and_a_weight() {
        let config = config(
            json!({ "torquer_misalignment_arcsec": 60.0 }),
            json!({
                "spec": { "default": 0.01, "T_XY": 5.0 },
                "spec_deg_per_h": { "D_IX": 0.02 },
                "weights": { "T_ZY": 0.5, "D_FX": 3.0 },
            }),
        );
        let checked = config.check().unwrap();
        let aims = checked.aims();
        let names: Vec<&str> = aims
            .others
            .iter()
            .map(|at| checked.test().platform().errors().parameters()[*at].name)
            .collect();
        assert_eq!(names, ["T_XY", "T_ZY"]);
        assert_eq!(aims.weights_of_others, [0.0, 0.5]);
        assert_eq!(aims.spec_of_others, [5.0, f64::INFINITY]);
        assert_eq!(aims.weights[DriftCoefficient::FX.index()], 3.0);
        let spec = aims.spec_deg_per_h.unwrap();
        assert_eq!(spec[DriftCoefficient::IX.index()], 0.02);
        assert_eq!(spec[DriftCoefficient::FX.index()], 0.01);
    }

    #[test]
    fn what_makes_no_sense_is_refused_by_key() {
        let torquers = json!({ "torquer_misalignment_arcsec": 60.0 });
        let considered = json!({ "considered": { "torquer_misalignment_arcsec": 60.0 } });
        for (errors, objective, key) in [
            (
                json!({}),
                json!({ "spec": { "T_XY": 5.0 } }),
                "objective.spec.T_XY",
            ),
            (
                considered.clone(),
                json!({ "spec": { "T_XY": 5.0 } }),
                "objective.spec.T_XY",
            ),
            (
                considered,
                json!({ "weights": { "T_XY": 5.0 } }),
                "objective.weights.T_XY",
            ),
            (
                torquers.clone(),
                json!({ "spec_deg_per_h": { "T_XY": 5.0 } }),
                "objective.spec_deg_per_h.T_XY",
            ),
            (
                torquers.clone(),
                json!({ "spec": { "T_XY": 0.0 } }),
                "objective.spec.T_XY",
            ),
            (
                torquers,
                json!({ "weights": { "T_XY": -1.0 } }),
                "objective.weights.T_XY",
            ),
            (
                json!({}),
                json!({ "spec": { "D_FX": 1.0 }, "spec_deg_per_h": { "D_FX": 1.0 } }),
                "objective.spec_deg_per_h.D_FX",
            ),
            (
                json!({}),
                json!({ "spec": { "default": 1.0 }, "spec_deg_per_h": { "default": 1.0 } }),
                "objective.spec_deg_per_h.default",
            ),
            (
                json!({}),
                json!({ "criterion": "use" }),
                "objective.criterion",
            ),
            (json!({}), json!({ "use": "flight.csv" }), "objective.use"),
        ] {
            let error = config(errors, objective).check().unwrap_err();
            assert_refused_by_key(&error, key);
        }
        let missing = config(
            json!({}),
            json!({ "criterion": "use", "use": "no-such-flight.csv" }),
        );
        assert!(missing.check().unwrap_err().is_io());
    }
}
