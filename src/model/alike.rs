//! What errors do as functions of gravity: which of them are the same function, and which drift is
//! vertical at every attitude.
//!
//! With u the vertical in the platform, the drift of an error is a function ε(u) of it. The platform
//! sees ε^n = C_c^n ε(u), and where ε(u) = λ(u) u that is (0, λ, 0): a drift along the vertical. It shows
//! in no horizontal channel, so that its order is 2 under every schedule. The trace theorem,
//! D_IX + D_IY + D_IZ with λ constant, is the linear case.

use nalgebra::{DMatrix, Vector3};

use super::{Effect, ErrorModel, Feature, Instrument};

/// Directions of gravity that tell polynomials of degree three from each other, and then some.
const DIRECTIONS: usize = 48;
/// Relative size of what is left of functions that are the same.
const SAME: f64 = 1e-9;

/// How far errors look alike that the sum of some of them is nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Alike {
    /// At any specific force: they are one thing.
    Always,
    /// At 1 g, but not at another specific force.
    AtOneG,
    /// At some attitudes only.
    No,
}

/// Directions spread over the sphere: a spiral of equal areas.
fn directions() -> impl Iterator<Item = Vector3<f64>> {
    const GOLDEN: f64 = 2.399_963_229_728_653;
    (0..DIRECTIONS).map(|k| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / DIRECTIONS as f64;
        let (sin, cos) = libm::sincos(GOLDEN * k as f64 + 0.5);
        let r = (1.0 - z * z).sqrt();
        Vector3::new(r * cos, r * sin, z)
    })
}

/// A feature of gravity `a`; of the rate none.
fn value(feature: Feature, a: &Vector3<f64>) -> f64 {
    match feature {
        Feature::One => 1.0,
        Feature::Linear(i) => a[i],
        Feature::Product(i, j) => a[i] * a[j],
        Feature::Cube(i) => a[i] * a[i] * a[i],
        Feature::Rate(_) => 0.0,
    }
}

/// What an error does by gravity `a`: drift of the three gyros, then what the accelerometers show.
fn output(effects: &[Effect], a: &Vector3<f64>) -> [f64; 6] {
    let mut output = [0.0; 6];
    for e in effects {
        match e.on {
            Instrument::Gyro(k) => output[k] += e.factor * value(e.feature, a),
            Instrument::Accelerometer(k) => output[3 + k] += e.factor * value(e.feature, &-a),
        }
    }
    output
}

impl ErrorModel {
    /// Whether the sum of these parameters, by index, each this many units, is nothing at all.
    pub(crate) fn alike(&self, terms: &[(usize, f64)]) -> Alike {
        let effects = self.effects();
        let turns = |(j, _): &(usize, f64)| effects[*j].iter().any(|e| e.feature.is_rate());
        if terms.iter().any(turns) {
            return Alike::No;
        }
        let vanishes = |size: f64| {
            directions().all(|u| {
                let (mut sum, mut whole) = ([0.0; 6], 0.0_f64);
                for (j, weight) in terms {
                    for (sum, part) in sum.iter_mut().zip(output(&effects[*j], &(u * size))) {
                        *sum += weight * part;
                        whole += (weight * part).abs();
                    }
                }
                sum.iter().all(|s| s.abs() <= SAME * whole)
            })
        };
        match (vanishes(1.0), vanishes(2.0)) {
            (true, true) => Alike::Always,
            (true, false) => Alike::AtOneG,
            (false, _) => Alike::No,
        }
    }

    /// Of each parameter whether it is drift by gravity.
    pub(crate) fn drifts_by_gravity(&self) -> Vec<bool> {
        let by_gravity = |e: &Effect| matches!(e.on, Instrument::Gyro(_)) && !e.feature.is_rate();
        let effects = self.effects();
        effects.iter().map(|of| of.iter().all(by_gravity)).collect()
    }

    /// What the parameters `of` do at 1 g at many attitudes, a column each: those of one null vector are
    /// alike at 1 g. What follows the commanded rate has none.
    pub(crate) fn at_one_g(&self, of: &[usize]) -> DMatrix<f64> {
        let effects = self.effects();
        let mut all = DMatrix::zeros(6 * DIRECTIONS, of.len());
        for (k, u) in directions().enumerate() {
            for (column, &j) in of.iter().enumerate() {
                let output = output(&effects[j], &u);
                all.view_mut((6 * k, column), (6, 1))
                    .copy_from_slice(&output);
            }
        }
        all
    }

    /// The horizontal parts and the whole of the drift of the parameters `of` at many attitudes: where
    /// the former vanishes and the latter does not, a sum of them is a drift along the vertical.
    pub(crate) fn horizontal_and_whole(&self, of: &[usize]) -> [DMatrix<f64>; 2] {
        let effects = self.effects();
        let mut horizontal = DMatrix::zeros(3 * DIRECTIONS, of.len());
        let mut whole = DMatrix::zeros(3 * DIRECTIONS, of.len());
        for (k, u) in directions().enumerate() {
            for (column, &j) in of.iter().enumerate() {
                let [x, y, z, ..] = output(&effects[j], &u);
                let drift = Vector3::new(x, y, z);
                let across = drift - u * u.dot(&drift);
                for i in 0..3 {
                    horizontal[(3 * k + i, column)] = across[i];
                    whole[(3 * k + i, column)] = drift[i];
                }
            }
        }
        [horizontal, whole]
    }
}
