//! The error model of 33 parameters: the twelve drift coefficients, nine torquer errors, and bias,
//! scale factor, non-orthogonality and second order of the accelerometers.

use nalgebra::{Matrix3, Matrix3xX, SMatrix, Vector3};
use scheme_opt::internals::covariance::{
    CovarianceModel, Feature, Instrument, Mixing, Parameter, Parameters, Term,
};
use scheme_opt::internals::drift::DriftCoefficient;
use scheme_opt::internals::dynamics::ErrorDynamics;
use scheme_opt::internals::motion::{Move, Timeline};
use scheme_opt::internals::platform::Platform;
use scheme_opt::internals::units::ARCSEC_PER_RAD;

const LINEAR: [Feature; 3] = [Feature::X, Feature::Y, Feature::Z];
const SQUARES: [Feature; 3] = [Feature::XX, Feature::YY, Feature::ZZ];
const RATES: [Feature; 3] = [Feature::RateX, Feature::RateY, Feature::RateZ];
const MICRO: f64 = 1e-6 * ARCSEC_PER_RAD;
const PARAMETERS: usize = 33;
const STATES: usize = 3 + PARAMETERS;

fn one(instrument: Instrument, feature: Feature, factor: f64, prior_sigma: f64) -> Parameter {
    Parameter {
        terms: vec![Term {
            instrument,
            feature,
            factor,
        }],
        prior_sigma,
    }
}

/// The parameters of `platform`, everything estimated.
pub fn parameters(platform: &Platform) -> Parameters {
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
    let coefficients = DriftCoefficient::ALL.map(|c| {
        let at = c.index();
        match at.checked_sub(3) {
            None => one(Instrument::Gyro(at), Feature::One, 1.0, sigma[at]),
            Some(k) => {
                let (gyro, axis, sign) = g_sensitive[k];
                one(Instrument::Gyro(gyro), LINEAR[axis], sign, sigma[at])
            }
        }
    });
    let mut estimated = Vec::new();
    for k in 0..3 {
        for (j, rate) in RATES.into_iter().enumerate() {
            let (factor, sigma) = if j == k { (MICRO, 1000.0) } else { (1.0, 60.0) };
            estimated.push(one(Instrument::Gyro(k), rate, factor, sigma));
        }
        let meter = Instrument::Accelerometer(k);
        estimated.push(one(meter, Feature::One, MICRO, 100.0));
        estimated.push(one(meter, LINEAR[k], -MICRO, 200.0));
        estimated.push(one(meter, SQUARES[k], MICRO, 20.0));
        for axis in LINEAR.into_iter().take(k) {
            estimated.push(one(meter, axis, -1.0, 60.0));
        }
    }
    Parameters {
        coefficients,
        weighted: Vec::new(),
        estimated,
        considered: Vec::new(),
    }
}

/// How they are mixed.
pub fn mixing(platform: &Platform) -> Mixing {
    Mixing::new(&parameters(platform)).expect("the catalogue has all of them")
}

fn value(feature: Feature, g: &Vector3<f64>, rate: &Vector3<f64>) -> f64 {
    let find = |all: &[Feature; 3]| all.iter().position(|f| *f == feature);
    match (find(&LINEAR), find(&SQUARES), find(&RATES)) {
        (Some(i), ..) => g[i],
        (_, Some(i), _) => g[i] * g[i],
        (.., Some(i)) => rate[i],
        _ => 1.0,
    }
}

/// What all parameters do to the gyros, or to the accelerometers, in n; without `time` only by rates.
fn columns(
    all: &[&Parameter],
    gyros: bool,
    c: &Matrix3<f64>,
    rate: &Vector3<f64>,
    time: bool,
) -> Matrix3xX<f64> {
    let g = -c.row(1).transpose();
    let mut out = Matrix3xX::zeros(all.len());
    for (j, parameter) in all.iter().enumerate() {
        for term in &parameter.terms {
            let axis = match (term.instrument, gyros) {
                (Instrument::Gyro(k), true) | (Instrument::Accelerometer(k), false) => k,
                _ => continue,
            };
            if time || RATES.contains(&term.feature) {
                let column = c.column(axis) * (term.factor * value(term.feature, &g, rate));
                let mut to = out.column_mut(j);
                to += column;
            }
        }
    }
    out
}

/// ∫ C ⊗ ω ds of a move without duration.
fn jump(all: &[&Parameter], m: &Move) -> Matrix3xX<f64> {
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
pub fn covariance_trace(platform: &Platform, parameters: &Parameters, timeline: &Timeline) -> f64 {
    let all: Vec<&Parameter> = (parameters.estimated.iter())
        .chain(&parameters.coefficients)
        .collect();
    let dynamics = ErrorDynamics::new(platform.earth_rate_n());
    let period = platform.period_s();
    let q = platform.drift_psd_rad2_per_s() * ARCSEC_PER_RAD.powi(2) * period;
    let r = (platform.noise_g() * ARCSEC_PER_RAD).powi(2);
    let mut p = Covariance::zeros();
    for (i, sigma) in platform.prior_misalignment_rad().iter().enumerate() {
        p[(i, i)] = (sigma * ARCSEC_PER_RAD).powi(2);
    }
    for (i, parameter) in all.iter().enumerate() {
        p[(3 + i, 3 + i)] = parameter.prior_sigma.powi(2);
    }
    for leg in timeline.legs() {
        if let Some(arrival) = &leg.arrival {
            let mut phi = Covariance::identity();
            phi.fixed_view_mut::<3, PARAMETERS>(0, 3)
                .copy_from(&jump(&all, arrival));
            p = phi * p * phi.transpose();
        }
        let c = leg.attitude.matrix();
        let rate = c.transpose() * platform.earth_rate_n();
        let mut phi = Covariance::identity();
        phi.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&dynamics.transition(period));
        let drift = dynamics.integral(period) * columns(&all, true, c, &rate, true);
        phi.fixed_view_mut::<3, PARAMETERS>(0, 3).copy_from(&drift);
        let phi_t = phi.transpose();
        let mut h = SMatrix::<f64, 3, STATES>::zeros();
        h.fixed_view_mut::<3, PARAMETERS>(0, 3)
            .copy_from(&columns(&all, false, c, &rate, true));
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
