//! The kernels and the step-by-step filter against a dense Kalman filter in 320-bit arithmetic,
//! where double precision is no judge of itself: weak priors, near-unobservable corners.

use dashu_float::FBig;
use dashu_float::round::mode::HalfEven;
use nalgebra::SMatrix;
use scheme_opt::attitude::{Position, earth_rate_n};
use scheme_opt::covariance::reference::step_by_step;
use scheme_opt::covariance::{CovarianceModel, TickRule};
use scheme_opt::drift::{CoefficientVector, drift_c};
use scheme_opt::motion::Timeline;
use scheme_opt::platform::{AxisValue, GSensitivePrior, PlatformConfig};
use scheme_opt::schedule::{Schedule, ScheduledPosition};
use scheme_opt::units::ARCSEC_PER_RAD;

use crate::support::Random;

type Float = FBig<HalfEven, 2>;

const BITS: usize = 320;
const STATES: usize = 15;

fn float(v: f64) -> Float {
    Float::try_from(v).unwrap().with_precision(BITS).value()
}

/// A (3×12) at `position`, each column from the drift equations of the platform.
fn drift_matrix(position: Position) -> SMatrix<f64, 3, 12> {
    let attitude = position.attitude();
    let gravity = attitude.gravity_c();
    SMatrix::from_columns(&std::array::from_fn::<_, 12, _>(|i| {
        let mut unit = CoefficientVector::zeros();
        unit[i] = 1.0;
        attitude.matrix() * drift_c(&unit, &gravity)
    }))
}

/// Φ and Γ of a period by their Taylor series.
fn transition(earth_rate: [f64; 3], period_s: f64) -> [[[Float; 3]; 3]; 2] {
    let [x, y, z] = earth_rate;
    // F = −[ω ×].
    let f = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]].map(|row| row.map(float));
    let zero = || [(); 3].map(|()| [(); 3].map(|()| float(0.0)));
    let (mut phi, mut gamma) = (zero(), zero());
    let mut term = zero();
    for i in 0..3 {
        term[i][i] = float(1.0);
    }
    let t = float(period_s);
    for k in 1..60 {
        let step = &t / float(f64::from(k));
        let mut next = zero();
        for i in 0..3 {
            for j in 0..3 {
                phi[i][j] += &term[i][j];
                gamma[i][j] += &term[i][j] * &step;
                for l in 0..3 {
                    next[i][j] += &f[i][l] * &term[l][j] * &step;
                }
            }
        }
        term = next;
    }
    [phi, gamma]
}

/// 1σ of the coefficients, °/h, at the end of dwells of whole periods, moves taking no time.
fn dense_filter(config: &PlatformConfig, dwells: &[(Position, usize)]) -> Vec<f64> {
    let period_s = config.filter.period_s;
    let earth_rate = earth_rate_n(config.site.latitude_deg.to_radians());
    let [phi, gamma] = transition([earth_rate.x, earth_rate.y, earth_rate.z], period_s);
    let random = float(config.gyro.random_drift_deg_per_h.unwrap()) * float(period_s);
    let process = &random * &random;
    let noise = float(config.accelerometer.noise_g) * float(ARCSEC_PER_RAD);
    let noise = &noise * &noise;
    let mut p = vec![vec![float(0.0); STATES]; STATES];
    let prior = CovarianceModel::new(&config.check().unwrap());
    let AxisValue::All(misalignment_deg) = config.prior.misalignment_deg else {
        panic!("one misalignment for all axes");
    };
    for i in 0..STATES {
        let sigma = match i {
            0..3 => float(misalignment_deg) * float(3600.0),
            _ => float(prior.prior_sigma_deg_per_h()[i - 3]),
        };
        p[i][i] = &sigma * &sigma;
    }
    for &(position, periods) in dwells {
        let a = drift_matrix(position);
        // [Φ B], B = Γ A.
        let mut m = vec![vec![float(0.0); STATES]; 3];
        for i in 0..3 {
            for j in 0..3 {
                m[i][j] = phi[i][j].clone();
                for c in 0..12 {
                    m[i][3 + c] += &gamma[i][j] * float(a[(j, c)]);
                }
            }
        }
        for _ in 0..periods {
            let mut driven = vec![vec![float(0.0); STATES]; 3];
            for i in 0..3 {
                for j in 0..STATES {
                    for l in 0..STATES {
                        driven[i][j] += &m[i][l] * &p[l][j];
                    }
                }
            }
            for i in 0..3 {
                for j in 3..STATES {
                    p[i][j] = driven[i][j].clone();
                    p[j][i] = driven[i][j].clone();
                }
                for j in 0..3 {
                    let mut sum = float(0.0);
                    for l in 0..STATES {
                        sum += &driven[i][l] * &m[j][l];
                    }
                    p[i][j] = sum;
                }
                p[i][i] += &process;
            }
            // ψ_x (North) and ψ_z (East) are measured, one after the other.
            for axis in [0, 2] {
                let row = p[axis].clone();
                let innovation = &row[axis] + &noise;
                for i in 0..STATES {
                    let gain = &row[i] / &innovation;
                    for j in 0..STATES {
                        p[i][j] -= &gain * &row[j];
                    }
                }
            }
        }
    }
    (3..STATES)
        .map(|i| p[i][i].to_f64().value().sqrt())
        .collect()
}

/// Largest relative differences of a σ: kernels, then the step-by-step filter.
fn differences(config: &PlatformConfig, dwells: &[(Position, usize)]) -> [f64; 2] {
    let platform = config.check().unwrap();
    let scheduled = dwells
        .iter()
        .map(|&(position, n)| ScheduledPosition::new(position, n as f64 * config.filter.period_s));
    let schedule = Schedule::new(scheduled.collect()).unwrap();
    let timeline = Timeline::new(&platform, &schedule).unwrap();
    let kernels = CovarianceModel::new(&platform)
        .end_covariance(&timeline, TickRule::Filter)
        .unwrap();
    let filter = step_by_step(&platform, &timeline, &mut |_| {}).unwrap();
    let exact = dense_filter(config, dwells);
    [kernels, filter].map(|end| {
        let sigma = end.sigma_deg_per_h();
        let pairs = sigma.iter().zip(&exact);
        pairs
            .map(|(a, b)| if a == b { 0.0 } else { (a / b - 1.0).abs() })
            .fold(0.0, f64::max)
    })
}

fn config(latitude_deg: f64, noise_g: f64, random: f64, period_s: f64) -> PlatformConfig {
    let mut config = PlatformConfig::default();
    config.site.latitude_deg = latitude_deg;
    config.accelerometer.noise_g = noise_g;
    config.gyro.random_drift_deg_per_h = Some(random);
    config.filter.period_s = period_s;
    config
}

fn with_priors(
    mut config: PlatformConfig,
    misalignment: f64,
    constant: f64,
    g: f64,
) -> PlatformConfig {
    config.prior.misalignment_deg = AxisValue::All(misalignment);
    config.prior.constant_drift_deg_per_h = AxisValue::All(constant);
    config.prior.g_sensitive_drift_deg_per_h_per_g = GSensitivePrior::All(AxisValue::All(g));
    config
}

#[test]
fn weak_priors_up_to_1e12_are_followed_by_both() {
    let mut random = Random(5);
    let dwells: Vec<_> = (0..9).map(|_| (random.position(), 12)).collect();
    for sigma in [1e-6, 1.0, 1e6, 1e9, 1e11, 1e12] {
        let config = with_priors(config(28.2, 1e-5, 0.01, 10.0), 1.0, sigma, sigma);
        let [kernels, filter] = differences(&config, &dwells);
        println!("prior {sigma:e}: kernels {kernels:.1e}, filter {filter:.1e}");
        assert!(
            kernels < 1e-6 && filter < 1e-6,
            "{sigma:e}: {kernels:e} {filter:e}"
        );
    }
}

#[test]
fn corners_of_the_allowed_ranges_are_followed_by_the_kernels() {
    let mut random = Random(6);
    let mut pick = |choices: &[f64]| {
        let index = random.between(0.0, choices.len() as f64) as usize;
        choices[index.min(choices.len() - 1)]
    };
    let (mut worst, mut lost) = ([0.0_f64; 2], 0);
    for case in 0..48 {
        let base = config(
            pick(&[-90.0, -60.0, 0.0, 28.2, 89.999, 90.0]),
            pick(&[1e-9, 1e-7, 1e-5, 1e-3, 1e-1]),
            pick(&[0.0, 1e-6, 1e-2, 1.0, 1e3]),
            pick(&[0.01, 1.0, 10.0, 100.0, 1000.0]),
        );
        let config = with_priors(
            base,
            pick(&[1e-4, 0.1, 10.0]),
            pick(&[0.0, 1e-6, 1.0, 1e6, 1e12]),
            pick(&[0.0, 1e-6, 1.0, 1e6, 1e12]),
        );
        let count = pick(&[1.0, 2.0, 6.0, 9.0]) as usize;
        let periods = pick(&[1.0, 2.0, 5.0, 14.0]) as usize;
        let mut place = Random(100 + case);
        let dwells: Vec<_> = (0..count).map(|_| (place.position(), periods)).collect();
        let found = differences(&config, &dwells);
        for (worst, found) in worst.iter_mut().zip(found) {
            *worst = worst.max(found);
        }
        // Where the filter cannot follow, it differs from the kernels, and an evaluation says so.
        let [kernels, filter] = found;
        assert!(kernels < 1e-6, "case {case}: {found:?}\n{config:?}");
        if filter > 1e-6 {
            println!("case {case}: {count} x {periods}: {found:?}\n{config:?}");
            lost += 1;
        }
    }
    assert!(lost <= 2, "the filter lost {lost} of 48 cases");
    println!(
        "worst of 48 cases: kernels {:.1e}, filter {:.1e}",
        worst[0], worst[1]
    );
}
