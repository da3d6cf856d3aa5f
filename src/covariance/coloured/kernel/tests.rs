use super::*;
use crate::covariance::real::Extended;
use crate::platform::PlatformConfig;

/// All that can wander, or a part of it.
fn model(drift: bool, biases: bool, azimuth: bool) -> CovarianceModel {
    let mut config = PlatformConfig::default();
    if drift {
        config.gyro.rate_random_walk_deg_per_h_per_sqrt_h = Some(0.002);
        config.gyro.bias_instability_deg_per_h = Some(0.003);
        config.gyro.bias_correlation_time_s = Some(500.0);
    }
    if biases {
        config.accelerometer.acceleration_random_walk_ug_per_sqrt_h = Some(2.0);
        config.accelerometer.bias_instability_ug = Some(3.0);
        config.accelerometer.bias_correlation_time_s = Some(800.0);
    }
    if azimuth {
        config.azimuth.noise_arcsec = Some(7.0);
    }
    CovarianceModel::new(&config.check().unwrap())
}

const CASES: [(bool, bool, bool); 4] = [
    (true, false, false),
    (false, true, false),
    (true, true, true),
    (true, true, false),
];

/// The element by composing one period at a time with the textbook formulas on (Φ̃, C̃, J).
fn textbook(model: &CovarianceModel, periods: usize) -> [DMatrix<f64>; 3] {
    let layout = Layout::of(model);
    let (states, inputs) = (layout.states(), layout.inputs());
    let size = states + inputs;
    let one = DMatrix::<f64>::identity(size, size);
    let passed = Passed::<f64>::held(&layout, &model.dynamics, model.drift_psd, model.period_s);
    let mut phi1 = one.clone();
    phi1.view_mut((0, 0), (states, states))
        .copy_from(&passed.transition);
    phi1.view_mut((0, states), (3, 3))
        .copy_from(&model.dynamics.integral(model.period_s));
    let mut process = DMatrix::zeros(size, size);
    process
        .view_mut((0, 0), (states, states))
        .copy_from(&(&passed.u * passed.u.transpose()));
    let seen = Seen::<f64>::new(&layout, model.measured_variance(), &Matrix3::identity());
    let mut h = DMatrix::zeros(seen.of_bias.len(), size);
    h.columns_mut(0, states).copy_from(&seen.of_x);
    if layout.has_biases() {
        for (row, of) in seen.of_bias.iter().enumerate() {
            h[(row, size - 1)] = *of;
        }
    }
    let unit = DMatrix::identity(h.nrows(), h.nrows());
    let s = (&h * &process * h.transpose() + unit)
        .try_inverse()
        .unwrap();
    let gain = &process * h.transpose() * &s;
    let step_phi = (&one - &gain * &h) * &phi1;
    let step_c = (&one - &gain * &h) * &process;
    let step_j = phi1.transpose() * h.transpose() * &s * &h * &phi1;
    let (mut phi, mut c, mut j) = (
        one.clone(),
        DMatrix::zeros(size, size),
        DMatrix::zeros(size, size),
    );
    for _ in 0..periods {
        let m = (&one + &c * &step_j).try_inverse().unwrap();
        j += phi.transpose() * &step_j * &m * &phi;
        c = &step_phi * &m * &c * step_phi.transpose() + &step_c;
        phi = &step_phi * &m * &phi;
    }
    [phi, c, j]
}

/// W.
fn rows(k: &ColouredKernel) -> DMatrix<f64> {
    let (states, inputs) = k.r12.shape();
    let mut w = DMatrix::zeros(states + inputs, states + inputs);
    w.view_mut((0, 0), (states, states)).copy_from(&k.r11);
    w.view_mut((0, states), (states, inputs)).copy_from(&k.r12);
    w.view_mut((states, states), (inputs, inputs))
        .copy_from(&k.r22);
    w
}

#[test]
fn doubling_in_square_roots_equals_the_textbook_recursion() {
    for (drift, biases, azimuth) in CASES {
        let model = model(drift, biases, azimuth);
        let kernels = ColouredDoublings::<f64>::new(&model);
        let states = kernels.layout().states();
        for periods in [1, 2, 3, 33, 121] {
            let k = kernels.kernel(periods);
            let [phi, c, j] = textbook(&model, periods);
            let w = rows(&k);
            let found = w.transpose() * &w;
            for a in 0..j.nrows() {
                for b in 0..j.ncols() {
                    let scale = (j[(a, a)] * j[(b, b)]).sqrt().max(1e-30);
                    let error = (found[(a, b)] - j[(a, b)]).abs() / scale;
                    assert!(error < 1e-9, "J after {periods}: {a} {b} {error:e}");
                }
            }
            let own = c.view((0, 0), (states, states));
            let error = (k.c() - own).amax() / own.amax();
            assert!(error < 1e-9, "C after {periods}: {error:e}");
            let a_x = (&k.a_x - phi.view((0, 0), (states, states))).amax();
            let a_u = (&k.a_u - phi.view((0, states), (states, phi.ncols() - states))).amax();
            assert!(
                a_x.max(a_u) < 1e-9 * phi.amax(),
                "{periods}: {a_x:e} {a_u:e}"
            );
        }
    }
}

/// R11 and R22 are upper triangular in the order of elimination.
#[test]
fn rows_are_triangular_block_by_block() {
    let kernels = ColouredDoublings::<f64>::new(&model(true, true, false));
    let k = kernels.kernel(50);
    let order = |j: usize| j / 3 * 3 + [NORTH, EAST, UP][j % 3];
    for j in 0..k.r11.ncols() {
        for i in j + 1..k.r11.nrows() {
            assert_eq!(k.r11[(i, order(j))], 0.0, "{i} {j}");
        }
    }
    for (j, column) in [NORTH, EAST, UP, 3].into_iter().enumerate() {
        for i in j + 1..4 {
            assert_eq!(k.r22[(i, column)], 0.0);
        }
    }
}

#[test]
fn in_32_digits_it_is_the_same() {
    let model = model(true, true, false);
    let doubles = ColouredDoublings::<f64>::new(&model)
        .kernel(77)
        .into_owned();
    let extended = ColouredDoublings::<Extended>::new(&model)
        .kernel(77)
        .into_owned();
    let of = |m: &DMatrix<Extended>| m.map(Real::f64);
    let (c, expected) = (doubles.c(), of(&extended.c()));
    assert!((&c - &expected).amax() < 1e-11 * expected.amax());
    let expected = of(&extended.a_x);
    assert!((&doubles.a_x - &expected).amax() < 1e-10 * expected.amax());
    // Rows may differ by their signs.
    let of_x = |r: &DMatrix<f64>| r.transpose() * r;
    let expected = of_x(&of(&extended.r11));
    assert!((of_x(&doubles.r11) - &expected).amax() < 1e-11 * expected.amax());
}

/// Of a drift that hardly wanders the blocks of ψ^n and ε^n are those of white noise.
#[test]
fn without_wandering_it_is_the_white_kernel() {
    let mut config = PlatformConfig::default();
    config.gyro.bias_instability_deg_per_h = Some(1e-9);
    config.gyro.bias_correlation_time_s = Some(500.0);
    let model = CovarianceModel::new(&config.check().unwrap());
    let k = ColouredDoublings::<f64>::new(&model)
        .kernel(100)
        .into_owned();
    let white = model.kernels.kernel(100);
    let psi = k.a_x.fixed_view::<3, 3>(0, 0) - white.a_psi;
    assert!(psi.amax() < 1e-10);
    let noise = k.c().fixed_view::<3, 3>(0, 0) - white.c;
    assert!(noise.amax() < 1e-10 * white.c.amax());
    let in_r11 = k.r11.columns(0, 3).transpose() * k.r11.columns(0, 3);
    let expected = white.r11.transpose() * white.r11;
    assert!((in_r11 - expected).amax() < 1e-10 * expected.amax());
    let of_epsilon = k.r12.transpose() * &k.r12 + k.r22.transpose() * &k.r22;
    let expected = white.r12.transpose() * white.r12 + white.r22.transpose() * white.r22;
    assert!((of_epsilon - expected).amax() < 1e-10 * expected.amax());
}

#[test]
fn a_dwell_without_a_period_is_nothing() {
    let kernels = ColouredDoublings::<f64>::new(&model(true, true, false));
    let k = kernels.kernel(0);
    assert_eq!(k.a_x, DMatrix::identity(15, 15));
    assert!(k.r11.iter().chain(k.u.iter()).all(|v| *v == 0.0));
}
