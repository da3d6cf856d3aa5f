//! What a filter that takes wandering for white noise errs by: its gains on the true covariance of its
//! errors and of what wanders, in plain matrices, against runs.

use nalgebra::{DMatrix, DVector};

use super::*;
use crate::attitude::Position;
use crate::drift::COEFFICIENTS;
use crate::motion::Timeline;
use crate::platform::PlatformConfig;
use crate::schedule::{Schedule, ScheduledPosition};
use crate::simulate::belief::Belief;
use crate::simulate::channels::{Channel, SEEN_OF_PSI};
use crate::simulate::linear::LinearGains;
use crate::simulate::program::Program;
use crate::simulate::square_root::Knowledge;
use crate::simulate::{FilterModel, Simulation, SimulationOptions, ToldNoise, TruthModel};

/// Gyros and accelerometers that wander in both ways, and a test of five positions.
fn test() -> (Platform, Timeline) {
    let config: PlatformConfig = toml::from_str(
        "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 0.01\nbias_instability_deg_per_h = 0.02\n\
         bias_correlation_time_s = 300\n[accelerometer]\n\
         acceleration_random_walk_ug_per_sqrt_h = 20\nbias_instability_ug = 20\n\
         bias_correlation_time_s = 200\n[motion]\nslew_rate_deg_per_s = 1.0\n",
    )
    .unwrap();
    let platform = config.check().unwrap();
    let at = |[a, b, g]: [f64; 3]| ScheduledPosition::new(Position::from_deg(a, b, g), 600.0);
    let positions = [
        [10.0, 20.0, 30.0],
        [-80.0, 65.0, 170.0],
        [120.0, -50.0, 75.0],
        [-30.0, -140.0, -100.0],
        [60.0, 100.0, -20.0],
    ];
    let schedule = Schedule::new(positions.map(at).to_vec()).unwrap();
    let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
    (platform, timeline)
}

/// The covariance of (D, what wanders, ψ^n) as a filter has it that knows of white noise alone: of what
/// wanders it estimates nothing.
fn predicted(platform: &Platform, timeline: &Timeline) -> DMatrix<f64> {
    let white = Belief::new(platform, &ToldNoise::only_white()).unwrap();
    let full = Belief::new(platform, &ToldNoise::default()).unwrap();
    let ignorant = Program::new(platform, timeline, None).unwrap();
    let knowing = Program::new(platform, timeline, full.wandering.as_ref()).unwrap();
    let gains = LinearGains::new(&ignorant, &white, false);
    let mut knowledge: Knowledge = white.knowledge();
    let (first, psi, all) = (COEFFICIENTS, full.shape.psi(), full.shape.states());
    let sigma = DVector::from(full.prior_sigma.clone());
    let mut p = DMatrix::from_diagonal(&sigma.component_mul(&sigma));
    for (known, true_one) in ignorant.intervals.iter().zip(&knowing.intervals) {
        let step = &knowing.transitions[true_one.transition];
        let mut f = DMatrix::identity(all, all);
        f.view_mut((psi, psi), (3, 3)).copy_from(&step.phi);
        f.view_mut((psi, 0), (3, psi))
            .copy_from(&step.b.columns(0, psi));
        p = {
            let fading = step.fading.as_ref().unwrap();
            for (i, kept) in fading.kept.iter().enumerate() {
                f[(first + i, first + i)] = *kept;
            }
            let mut noise = DMatrix::zeros(all, all);
            noise
                .view_mut((first, first), (all - first, all - first))
                .copy_from(&(fading.noise.transpose() * &fading.noise));
            for i in psi..all {
                noise[(i, i)] += white.drift_psd * true_one.length_s;
            }
            &f * p * f.transpose() + noise
        };
        let gains = gains.follow(&mut knowledge, &ignorant, &white, known);
        let output = &knowing.outputs[true_one.output];
        let channels: Vec<Channel> = white.sensors.channels(&SEEN_OF_PSI, output);
        for (channel, gain) in channels.iter().zip(&gains) {
            let mut h = DVector::zeros(all);
            h.rows_mut(psi, 3).copy_from_slice(&channel.psi);
            (0..psi).for_each(|k| h[k] = channel.of_parameter(k));
            let mut k = DVector::zeros(all);
            k.rows_mut(0, first).copy_from_slice(&gain.gain[..first]);
            k.rows_mut(psi, 3).copy_from_slice(&gain.gain[first..]);
            let update = DMatrix::identity(all, all) - &k * h.transpose();
            let noise = channel.noise * channel.noise;
            p = &update * p * update.transpose() + &k * k.transpose() * noise;
        }
    }
    p
}

#[test]
fn a_filter_that_takes_wandering_for_white_errs_as_predicted() {
    let (platform, timeline) = test();
    let p = predicted(&platform, &timeline);
    let shape = Belief::new(&platform, &ToldNoise::default()).unwrap().shape;
    // D_F with what has walked.
    let reported = DMatrix::from_fn(COEFFICIENTS, shape.states(), |i, j| {
        let walked = i < 3 && j == COEFFICIENTS + i;
        f64::from(u8::from(i == j || walked))
    });
    let predicted = (&reported * &p * reported.transpose()).diagonal();
    let options = SimulationOptions::default()
        .with_truth(TruthModel::FirstOrder)
        .with_filter(FilterModel::Linear)
        .with_told(ToldNoise::only_white());
    let simulation = Simulation::new(&platform, &timeline, options).unwrap();
    let found = simulation.monte_carlo(400, 5).unwrap();
    // 400 runs know a variance to 7 %, 1σ.
    let mut worst = 0.0_f64;
    for (check, predicted) in found.coefficients.iter().zip(predicted.iter()) {
        let ratio = check.rms_error.powi(2) / predicted;
        worst = worst.max((ratio - 1.0).abs());
        assert!((ratio - 1.0).abs() < 0.25, "{ratio}");
    }
    let total = found.rms_error_deg_per_h() / (predicted.sum() / 12.0).sqrt();
    let claimed = found.rms_sigma_deg_per_h() / found.rms_error_deg_per_h();
    println!("variances within {worst:.3}, RMS {total:.3} of the predicted; claims {claimed:.3}");
    assert!((total - 1.0).abs() < 0.05 && claimed < 0.7);
}
