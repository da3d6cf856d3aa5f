//! The error model of 33 parameters: the twelve drift coefficients, nine torquer errors, and bias,
//! scale factor, non-orthogonality and second order of the accelerometers.

use nalgebra::{Matrix3, Matrix3xX, SMatrix, Vector3};
use scheme_opt::internals::covariance::CovarianceModel;
use scheme_opt::internals::dynamics::ErrorDynamics;
use scheme_opt::internals::motion::{Move, Timeline};
use scheme_opt::internals::platform::{AxisValue, Platform, PlatformConfig};
use scheme_opt::internals::units::ARCSEC_PER_RAD;

const MICRO: f64 = 1e-6 * ARCSEC_PER_RAD;
const PARAMETERS: usize = 33;
const STATES: usize = 3 + PARAMETERS;

/// What has an error.
#[derive(Clone, Copy)]
enum Of {
    Gyro(usize),
    Accelerometer(usize),
}

/// What an error is proportional to.
#[derive(Clone, Copy)]
enum By {
    One,
    /// A component of g^c.
    Gravity(usize),
    Square(usize),
    Rate(usize),
}

/// A parameter: whose error, by what, in the filter's units per unit, and its 1σ before the test.
#[derive(Clone, Copy)]
pub struct Parameter {
    of: Of,
    by: By,
    factor: f64,
    sigma: f64,
}

fn one(of: Of, by: By, factor: f64, sigma: f64) -> Parameter {
    Parameter {
        of,
        by,
        factor,
        sigma,
    }
}

/// The default platform with everything that is estimated here.
pub fn platform() -> Platform {
    let mut config = PlatformConfig::default();
    let errors = &mut config.errors.estimated;
    let all = |value| Some(AxisValue::All(value));
    errors.torquer_scale_factor_ppm = all(1000.0);
    errors.torquer_misalignment_arcsec = all(60.0);
    errors.accelerometer_bias_ug = all(100.0);
    errors.accelerometer_scale_factor_ppm = all(200.0);
    errors.accelerometer_misalignment_arcsec = all(60.0);
    errors.accelerometer_second_order_ug_per_g2 = all(20.0);
    config.check().unwrap()
}

/// The same as a list: other parameters, then the twelve coefficients.
pub fn parameters(platform: &Platform) -> Vec<Parameter> {
    let sigma = *CovarianceModel::new(platform).prior_sigma_deg_per_h();
    // (gyro, axis of g^c, sign) of the input, output and spin axes, in the coefficients' order.
    let g_sensitive = [
        (0, 0, 1.0),
        (1, 1, 1.0),
        (2, 2, 1.0),
        (0, 2, -1.0),
        (1, 2, -1.0),
        (2, 0, 1.0),
        (0, 1, 1.0),
        (1, 0, -1.0),
        (2, 1, 1.0),
    ];
    let mut all = Vec::new();
    for k in 0..3 {
        for j in 0..3 {
            let (factor, sigma) = if j == k { (MICRO, 1000.0) } else { (1.0, 60.0) };
            all.push(one(Of::Gyro(k), By::Rate(j), factor, sigma));
        }
        let meter = Of::Accelerometer(k);
        all.push(one(meter, By::One, MICRO, 100.0));
        // f = −g^c.
        all.push(one(meter, By::Gravity(k), -MICRO, 200.0));
        all.push(one(meter, By::Square(k), MICRO, 20.0));
        all.extend((0..k).map(|axis| one(meter, By::Gravity(axis), -1.0, 60.0)));
    }
    all.extend((0..3).map(|k| one(Of::Gyro(k), By::One, 1.0, sigma[k])));
    for (k, (gyro, axis, sign)) in g_sensitive.into_iter().enumerate() {
        all.push(one(Of::Gyro(gyro), By::Gravity(axis), sign, sigma[3 + k]));
    }
    all
}

/// What all parameters do to the gyros, or to the accelerometers, in n; without `time` only by rates.
fn columns(
    all: &[Parameter],
    gyros: bool,
    c: &Matrix3<f64>,
    rate: &Vector3<f64>,
    time: bool,
) -> Matrix3xX<f64> {
    let g = -c.row(1).transpose();
    let mut out = Matrix3xX::zeros(all.len());
    for (j, parameter) in all.iter().enumerate() {
        let axis = match (parameter.of, gyros) {
            (Of::Gyro(k), true) | (Of::Accelerometer(k), false) => k,
            _ => continue,
        };
        let value = match parameter.by {
            By::Rate(i) => rate[i],
            _ if !time => continue,
            By::One => 1.0,
            By::Gravity(i) => g[i],
            By::Square(i) => g[i] * g[i],
        };
        let mut to = out.column_mut(j);
        to += c.column(axis) * (parameter.factor * value);
    }
    out
}

/// ∫ C ⊗ ω ds of a move without duration.
fn jump(all: &[Parameter], m: &Move) -> Matrix3xX<f64> {
    const STEPS: usize = 64;
    let mut sum = Matrix3xX::zeros(all.len());
    for k in 0..STEPS {
        let at = |f: f64| *m.position_at(f).attitude().matrix();
        let f = (k as f64 + 0.5) / STEPS as f64;
        let (c, h) = (at(f), 1e-4);
        let cross = c.transpose() * (at(f + h) - at(f - h)) / (2.0 * h);
        let rate = Vector3::new(cross[(2, 1)], cross[(0, 2)], cross[(1, 0)]);
        sum += columns(all, true, &c, &rate, false) / STEPS as f64;
    }
    sum
}

type Covariance = SMatrix<f64, STATES, STATES>;

/// tr P_D by the Kalman filter on the covariance of ψ^n and all parameters, one step per filter
/// period, as `naive::covariance_trace`; all three channels.
pub fn covariance_trace(platform: &Platform, all: &[Parameter], timeline: &Timeline) -> f64 {
    let dynamics = ErrorDynamics::new(platform.earth_rate_n());
    let period = platform.period_s();
    let q = platform.drift_psd_rad2_per_s() * ARCSEC_PER_RAD.powi(2) * period;
    let r = (platform.noise_g() * ARCSEC_PER_RAD).powi(2);
    let mut p = Covariance::zeros();
    for (i, sigma) in platform.prior_misalignment_rad().iter().enumerate() {
        p[(i, i)] = (sigma * ARCSEC_PER_RAD).powi(2);
    }
    for (i, parameter) in all.iter().enumerate() {
        p[(3 + i, 3 + i)] = parameter.sigma.powi(2);
    }
    for leg in timeline.legs() {
        if let Some(arrival) = &leg.arrival {
            let mut phi = Covariance::identity();
            phi.fixed_view_mut::<3, PARAMETERS>(0, 3)
                .copy_from(&jump(all, arrival));
            p = phi * p * phi.transpose();
        }
        let c = leg.attitude.matrix();
        let rate = c.transpose() * platform.earth_rate_n();
        let mut phi = Covariance::identity();
        phi.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&dynamics.transition(period));
        let drift = dynamics.integral(period) * columns(all, true, c, &rate, true);
        phi.fixed_view_mut::<3, PARAMETERS>(0, 3).copy_from(&drift);
        let phi_t = phi.transpose();
        let mut h = SMatrix::<f64, 3, STATES>::zeros();
        h.fixed_view_mut::<3, PARAMETERS>(0, 3)
            .copy_from(&columns(all, false, c, &rate, true));
        (h[(0, 2)], h[(2, 0)]) = (1.0, -1.0);
        for _ in 0..(leg.dwell_s / period).round() as usize {
            p = phi * p * phi_t;
            for i in 0..3 {
                p[(i, i)] += q;
            }
            for channel in 0..3 {
                let row = h.row(channel);
                let column = p * row.transpose();
                let gain = column / ((row * column)[(0, 0)] + r);
                p -= gain * column.transpose();
            }
        }
    }
    p.diagonal().rows(STATES - 12, 12).sum()
}
