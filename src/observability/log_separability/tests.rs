use super::*;
use crate::attitude::Position;
use crate::observability::Observability;
use crate::platform::{PlatformConfig, Repositioning};
use crate::schedule::standard::StandardScheme;
use crate::schedule::{Schedule, ScheduledPosition};

#[derive(Clone, Copy)]
enum Moves {
    Unmeasured,
    Measured,
    FrameHold,
}

fn timeline(x: &[f64], moves: Moves) -> (CovarianceModel, Timeline) {
    let mut config = PlatformConfig::default();
    let mut move_s = Some(203.0);
    match moves {
        Moves::Unmeasured => {}
        Moves::Measured => config.motion.measure_moves = true,
        Moves::FrameHold => {
            config.motion.repositioning = Repositioning::FrameHold;
            move_s = None;
        }
    }
    let platform = config.check().unwrap();
    let positions = x.chunks(4).map(|c| ScheduledPosition {
        move_s,
        ..ScheduledPosition::new(Position::from_rad(c[0], c[1], c[2]), c[3])
    });
    let schedule = Schedule::new(positions.collect()).unwrap();
    let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
    (CovarianceModel::new(&platform), timeline)
}

#[test]
fn gram_form_equals_svd_and_its_gradient_is_the_derivative() {
    for measured in [Moves::Unmeasured, Moves::Measured, Moves::FrameHold] {
        let x: Vec<f64> = (0..7)
            .flat_map(|k| {
                let k = f64::from(k);
                [
                    0.3 + 2.1 * k,
                    1.1 * k * k,
                    1.7 * k * k * k,
                    403.0 + 71.0 * k,
                ]
            })
            .collect();
        let slopes = CoefficientVector::from_fn(|i, _| 1.0 - 0.1 * i as f64);
        let value = |x: &[f64]| {
            let (model, timeline) = timeline(x, measured);
            LogSeparability::new(&model, &timeline).log.dot(&slopes)
        };
        let (model, timeline) = timeline(&x, measured);
        let s = LogSeparability::new(&model, &timeline);
        let reported = crate::observability::Observability::analyze(&model, &timeline).unwrap();
        assert!((s.log.map(f64::exp) - reported.separability).amax() < 1e-8);
        let mut gradient = vec![LegGradient::default(); timeline.legs().len()];
        s.add_gradient(&timeline, &slopes, &mut gradient);
        for i in 0..x.len() {
            let h = if i % 4 == 3 { 1e-2 } else { 1e-5 };
            let (mut hi, mut lo) = (x.clone(), x.clone());
            hi[i] += h;
            lo[i] -= h;
            let numeric = (value(&hi) - value(&lo)) / (2.0 * h);
            let leg = &gradient[i / 4];
            let exact = if i % 4 == 3 {
                leg.dwell_s
            } else {
                leg.angles[i % 4]
            };
            assert!((numeric - exact).abs() < 1e-5 * (1.0 + exact.abs()), "{i}");
        }
    }
}

/// Also where some combinations cannot be told: at the poles, in few positions, axis-aligned.
#[test]
fn the_gram_form_is_the_reported_separability_whatever_is_unobservable() {
    let mut compared = 0;
    for latitude_deg in [28.2, 90.0, 0.0] {
        let mut config = PlatformConfig::default();
        config.site.latitude_deg = latitude_deg;
        let platform = config.check().unwrap();
        let model = CovarianceModel::new(&platform);
        let schemes = StandardScheme::ALL.map(|s| s.positions());
        let random = (1..8_usize).map(|count| {
            let at = |k: usize| {
                let k = (k + 5 * count) as f64;
                Position::from_deg(7.3 * k * k, 61.0 * k - 90.0, 13.0 * k)
            };
            (0..count).map(at).collect::<Vec<_>>()
        });
        for positions in schemes.into_iter().chain(random) {
            let held = positions.iter().map(|p| ScheduledPosition::new(*p, 700.0));
            let schedule = Schedule::new(held.collect()).unwrap();
            let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
            let reported = Observability::analyze(&model, &timeline)
                .unwrap()
                .separability;
            let log = LogSeparability::new(&model, &timeline).log;
            for (log, reported) in log.iter().zip(reported.iter()) {
                match *reported > 1e-5 {
                    true => assert!((libm::exp(*log) - reported).abs() < 1e-7),
                    false => assert!(*log < -11.0, "{log} for {reported}"),
                }
                compared += usize::from(*reported > 1e-5);
            }
        }
    }
    assert!(compared > 300, "{compared}");
}
