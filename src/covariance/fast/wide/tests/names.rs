//! The parameters of the error model by name, as terms.

use super::super::super::mixing::{Instrument, Parameter, Term};
use super::super::super::shape::Feature;
use crate::units::ARCSEC_PER_RAD;

/// The unit of a µg, ppm or 1e-6 in arcsec.
pub const MICRO: f64 = 1e-6 * ARCSEC_PER_RAD;

const LINEAR: [Feature; 3] = [Feature::X, Feature::Y, Feature::Z];
const RATES: [Feature; 3] = [Feature::RateX, Feature::RateY, Feature::RateZ];
const CUBES: [Feature; 3] = [Feature::XXX, Feature::YYY, Feature::ZZZ];

fn product(a: usize, b: usize) -> Feature {
    [
        [Feature::XX, Feature::XY, Feature::XZ],
        [Feature::XY, Feature::YY, Feature::YZ],
        [Feature::XZ, Feature::YZ, Feature::ZZ],
    ][a][b]
}

/// Output axes of the gyros; the paper's mounting.
pub const PAPER: [[f64; 3]; 3] = [[0.0, 0.0, -1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]];

/// (I, O, S) of a gyro.
fn axes(k: usize, output: &[f64; 3]) -> [[f64; 3]; 3] {
    let mut i = [0.0; 3];
    i[k] = 1.0;
    let o = *output;
    let s = [
        i[1] * o[2] - i[2] * o[1],
        i[2] * o[0] - i[0] * o[2],
        i[0] * o[1] - i[1] * o[0],
    ];
    [i, o, s]
}

fn axis(name: char) -> usize {
    "XYZ".find(name).unwrap()
}

/// The terms of the parameter of that name, per its unit: °/h(/g, /g²), ppm, arcsec, µg(/g², /g³).
pub fn terms(name: &str, output: &[[f64; 3]; 3]) -> Vec<Term> {
    if name == "G" {
        // The same as equal scale factors of all accelerometers.
        return (0..3)
            .flat_map(|i| terms(["K_1X", "K_1Y", "K_1Z"][i], output))
            .collect();
    }
    let (letter, rest) = name.split_once('_').unwrap();
    let last = axis(rest.chars().last().unwrap());
    let kind = &rest[..rest.len() - 1];
    let of = |instrument, feature, factor| Term {
        instrument,
        feature,
        factor,
    };
    let gyro = |feature, factor| of(Instrument::Gyro(last), feature, factor);
    let meter = |feature, factor| of(Instrument::Accelerometer(last), feature, factor);
    let which = |c: char| "IOS".find(c).unwrap();
    let letters: Vec<char> = kind.chars().collect();
    match (letter, letters.as_slice()) {
        ("D", ['F']) => vec![gyro(Feature::One, 1.0)],
        ("D", [a]) => {
            let u = axes(last, &output[last])[which(*a)];
            (0..3).map(|e| gyro(LINEAR[e], u[e])).collect()
        }
        ("D", [a, b]) => {
            let all = axes(last, &output[last]);
            let (u, v) = (all[which(*a)], all[which(*b)]);
            let pairs = (0..3).flat_map(|e| (0..3).map(move |f| (e, f)));
            pairs
                .map(|(e, f)| gyro(product(e, f), u[e] * v[f]))
                .collect()
        }
        ("T", [k]) => {
            let k = axis(*k);
            let unit = if k == last { MICRO } else { 1.0 };
            vec![of(Instrument::Gyro(k), RATES[last], unit)]
        }
        // f = −g.
        ("K", ['0']) => vec![meter(Feature::One, MICRO)],
        ("K", ['1']) => vec![meter(LINEAR[last], -MICRO)],
        ("K", ['2']) => vec![meter(product(last, last), MICRO)],
        ("K", ['3']) => vec![meter(CUBES[last], -MICRO)],
        ("K", ['I', 'P']) => vec![meter(product(last, (last + 1) % 3), MICRO)],
        ("K", ['I', 'O']) => vec![meter(product(last, (last + 2) % 3), MICRO)],
        ("M", [i]) => vec![of(Instrument::Accelerometer(axis(*i)), LINEAR[last], -1.0)],
        _ => panic!("{name}"),
    }
}

/// The parameter of that name.
pub fn parameter(name: &str, output: &[[f64; 3]; 3], prior_sigma: f64) -> Parameter {
    Parameter {
        terms: terms(name, output),
        prior_sigma,
    }
}

/// The names of a group of parameters, by its key.
pub fn group(key: &str) -> Vec<String> {
    let each = |prefix: &str| ["X", "Y", "Z"].map(|a| format!("{prefix}{a}")).to_vec();
    let all = |prefixes: &[&str]| prefixes.iter().flat_map(|p| each(p)).collect();
    let list = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect();
    match key {
        "torquer_scale_factor_ppm" => list(&["T_XX", "T_YY", "T_ZZ"]),
        "torquer_misalignment_arcsec" => list(&["T_XY", "T_XZ", "T_YX", "T_YZ", "T_ZX", "T_ZY"]),
        "accelerometer_bias_ug" => each("K_0"),
        "accelerometer_scale_factor_ppm" => each("K_1"),
        "accelerometer_misalignment_arcsec" => list(&["M_YX", "M_ZX", "M_ZY"]),
        "accelerometer_second_order_ug_per_g2" => each("K_2"),
        "quadratic_drift_deg_per_h_per_g2" => all(&["D_II", "D_SS", "D_IO", "D_IS", "D_OS"]),
        "accelerometer_third_order_ug_per_g3" => each("K_3"),
        "accelerometer_cross_coupling_ug_per_g2" => all(&["K_IP", "K_IO"]),
        "local_gravity_ug" => list(&["G"]),
        _ => panic!("{key}"),
    }
}
