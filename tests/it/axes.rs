//! Stands whose gimbals are hung in another order or sense than the paper's, and whose base is turned and
//! tilted: the same attitudes are the same schedule, by every computation.

use scheme_opt::internals::attitude::{Attitude, Position};
use scheme_opt::internals::certificate::Certifier;
use scheme_opt::internals::covariance::filter::full_step_by_step;
use scheme_opt::internals::covariance::{CoefficientCovariance, CovarianceModel, TickRule};
use scheme_opt::internals::criterion::{Criterion, Smoothing};
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::motion::{Test, Timeline, equivalent_positions};
use scheme_opt::internals::platform::{Platform, PlatformConfig, Repositioning};
use scheme_opt::internals::schedule::standard::StandardScheme;
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
use scheme_opt::internals::search::{Control, SearchProblem, search};

use crate::coloured::wandering;
use crate::commands::{attitude, replay};
use crate::full_model::random_platform;
use crate::support::{Random, random_positions, slewing};

/// Orders with senses; two of them proper Euler sequences.
const ORDERS: [[&str; 3]; 6] = [
    ["+x", "+y", "+z"],
    ["-z", "+x", "-y"],
    ["+y", "-z", "+x"],
    ["+y", "+x", "-z"],
    ["+z", "-x", "+z"],
    ["-x", "+z", "+x"],
];

/// Hangs the gimbals so, on a base of random heading and tilt.
fn hang(config: &mut PlatformConfig, axes: [&str; 3], random: &mut Random) {
    config.gimbals.axes = Some(axes.map(str::to_owned));
    config.stand.heading_deg = Some(random.between(-180.0, 180.0));
    config.stand.tilt_deg = Some([random.between(-40.0, 40.0), random.between(-40.0, 40.0)]);
}

fn of_array([a, b, g]: [f64; 3]) -> Position {
    Position::from_deg(a, b, g)
}

/// What the torquers have is the way, and the ways differ.
fn without_torquers(config: &mut PlatformConfig) {
    let errors = &mut config.errors;
    for table in [&mut errors.estimated, &mut errors.considered] {
        let mut value = serde_json::to_value(&*table).unwrap();
        let map = value.as_object_mut().unwrap();
        map.retain(|key, _| !key.starts_with("torquer"));
        *table = serde_json::from_value(value).unwrap();
    }
}

#[test]
fn the_same_attitudes_have_the_same_sigma_by_both_computations() {
    let mut worst = 0.0_f64;
    for case in 0..12 {
        let random = &mut Random::of_case(4400 + case);
        // The paper's errors, or more of them; and in every third case what wanders.
        let mut config = match case % 2 {
            0 => PlatformConfig::default(),
            _ => random_platform(random),
        };
        without_torquers(&mut config);
        if case % 3 == 2 {
            wandering(&mut config, random, 5);
        }
        config.motion = PlatformConfig::default().motion;
        if case % 4 == 3 {
            config.motion.repositioning = Repositioning::FrameHold;
        }
        let papers = config.check().unwrap();
        hang(&mut config, ORDERS[case as usize % 6], random);
        let platform = config.check().unwrap();
        let dwells: Vec<(Position, f64)> = random_positions(random, 9)
            .into_iter()
            .map(|p| (p, 10.0 * random.between(20.0, 120.0).round()))
            .collect();
        let timeline = |platform: &Platform| {
            let there = |p: Position| platform.stand().position(&p.attitude());
            let held = dwells.iter().map(|(p, s)| {
                let p = if platform.stand().is_of_the_paper() {
                    *p
                } else {
                    there(*p)
                };
                ScheduledPosition::new(p, *s)
            });
            let schedule = Schedule::new(held.collect()).unwrap();
            Timeline::new(&platform.clone().into(), &schedule).unwrap()
        };
        let [ours, theirs] = [&platform, &papers].map(|platform| {
            let timeline = timeline(platform);
            let chain = CovarianceModel::new(platform).full_covariance(&timeline);
            let filter = full_step_by_step(platform, &timeline);
            [chain.unwrap().sigma(), filter.unwrap().sigma()]
        });
        for (ours, theirs) in ours.iter().zip(&theirs) {
            for (a, b) in ours.iter().zip(theirs.iter()) {
                let error = if a == b { 0.0 } else { (a / b - 1.0).abs() };
                worst = worst.max(error);
                assert!(error < 1e-9, "case {case}: {a} {b}");
            }
        }
    }
    println!("largest relative difference of a sigma: {worst:.1e}");
}

#[test]
fn attitudes_of_a_timeline_are_those_of_the_definition() {
    for (k, axes) in ORDERS.into_iter().enumerate() {
        let random = &mut Random::of_case(4500 + k as u64);
        let mut config = PlatformConfig::default();
        hang(&mut config, axes, random);
        config.motion.slew_rate_deg_per_s = Some(0.5.into());
        let platform = config.check().unwrap();
        let positions = random_positions(random, 6);
        let held = positions.iter().map(|p| ScheduledPosition::new(*p, 100.0));
        let schedule = Schedule::new(held.collect()).unwrap();
        let evaluator = Evaluator::new(platform.clone(), Objective::default());
        let evaluation = evaluator.evaluate(&schedule).unwrap();
        let timeline = Timeline::new(evaluator.test(), &schedule).unwrap();
        for (leg, found) in timeline.legs().iter().zip(&evaluation.positions) {
            let c = attitude(&platform, leg.position.degrees());
            assert!((leg.attitude.matrix() - c).amax() < 1e-14);
            for i in 0..3 {
                assert!((found.specific_force_g[i] - c[(1, i)]).abs() < 1e-14);
            }
            for other in equivalent_positions(&platform, leg.position) {
                let apart = attitude(&platform, other.degrees()) - c;
                assert!(apart.amax() < 1e-13, "{axes:?} {other:?}");
            }
            assert!(equivalent_positions(&platform, leg.position).len() >= 2);
        }
        for step_deg in [5.0, 45.0] {
            replay(&platform, &timeline, step_deg);
        }
    }
}

/// The step-by-step filter, which has attitudes of its own, and the chain: with slews, torquers, and what
/// wanders.
#[test]
fn judge_and_chain_agree_on_any_stand() {
    let mut worst = 0.0_f64;
    for case in 0..18 {
        let random = &mut Random::of_case(4600 + case);
        let mut config = random_platform(random);
        if case % 3 == 1 {
            wandering(&mut config, random, 1 + case as u32 % 15);
        }
        config.motion.start_deg = None;
        hang(&mut config, ORDERS[case as usize % 6], random);
        config.motion.repositioning = Repositioning::Slew;
        slewing(&mut config, random, 0.3, 3.0);
        let held = random_positions(random, 4)
            .into_iter()
            .map(|p| ScheduledPosition::new(p, random.between(50.0, 500.0)));
        let schedule = Schedule::new(held.collect()).unwrap();
        let evaluator = Evaluator::new(config.check().unwrap(), Objective::default());
        let found = evaluator
            .evaluate(&schedule)
            .unwrap_or_else(|e| panic!("case {case}: {e}\n{config:?}"));
        worst = worst.max(found.agreement);
        assert!(found.agreement < 1e-7, "case {case}: {:e}", found.agreement);
    }
    println!("largest difference of the two computations: {worst:.1e}");
}

/// With the paper's errors, with torquers and accelerometers, and with what wanders.
fn of_three_shapes(random: &mut Random) -> [PlatformConfig; 3] {
    let paper = PlatformConfig::default();
    let mut wide: PlatformConfig = serde_json::from_value(serde_json::json!({ "errors": {
        "torquer_scale_factor_ppm": 1000.0, "torquer_misalignment_arcsec": 60.0,
        "quadratic_drift_deg_per_h_per_g2": 0.1, "accelerometer_scale_factor_ppm": 200.0,
        "accelerometer_bias_ug": 100.0 } }))
    .unwrap();
    wide.motion.settle_s = 20.0;
    let mut coloured = wide.clone();
    wandering(&mut coloured, random, 7);
    [paper, wide, coloured]
}

/// A schedule with moves of given duration, measured or not.
fn moving(test: &Test, positions: &[ScheduledPosition]) -> Timeline {
    Timeline::new(test, &Schedule::new(positions.to_vec()).unwrap()).unwrap()
}

#[test]
fn gradients_are_finite_differences_and_lanes_are_single() {
    for (k, axes) in ORDERS.into_iter().enumerate() {
        let random = &mut Random::of_case(4700 + k as u64);
        for mut config in of_three_shapes(random) {
            hang(&mut config, axes, random);
            let platform = config.check().unwrap();
            let test = Test::from(platform.clone());
            let mut model = CovarianceModel::new(&platform);
            // Ways of less than a half turn, which a small change of an angle does not turn round.
            let mut angles = random.position().to_deg();
            let mut batch = Vec::new();
            for _ in 0..5 {
                let positions: Vec<ScheduledPosition> = (0..7)
                    .map(|i| {
                        angles = angles.map(|a| a + random.between(-120.0, 120.0));
                        ScheduledPosition {
                            move_s: (i > 0).then(|| random.between(90.0, 400.0)),
                            move_measured: (i > 0).then_some(i % 2 == 0),
                            ..ScheduledPosition::new(of_array(angles), random.between(100.0, 900.0))
                        }
                    })
                    .collect();
                batch.push(positions);
            }
            let timelines: Vec<Timeline> = batch.iter().map(|p| moving(&test, p)).collect();
            let rule = TickRule::Relaxed;
            let merit = |p: &dyn CoefficientCovariance| {
                Criterion::rms().log_with_gradient(p, Smoothing::Exact)
            };
            let value = |p: &dyn CoefficientCovariance| Criterion::rms().log(p, Smoothing::Exact);
            let alone: Vec<_> = timelines
                .iter()
                .map(|t| model.gradient(t, rule, merit).unwrap())
                .collect();
            for lanes in [1, 4, 8] {
                model = model.with_most_lanes(lanes);
                let values = model.values(&timelines, rule, value);
                let gradients = model.gradients(&timelines, rule, merit);
                for (k, (v, g)) in values.into_iter().zip(gradients).enumerate() {
                    let single = model.value(&timelines[k], rule, value).unwrap();
                    assert_eq!(v.unwrap().to_bits(), single.to_bits(), "{lanes} lanes");
                    assert_eq!(g.unwrap(), alone[k], "{axes:?} {lanes} lanes");
                }
            }
            // The chain's own covariance, by other code and by the filter's rule.
            let chain = model
                .end_covariance(&timelines[0], TickRule::Filter)
                .unwrap();
            let exact = Criterion::rms().log(&chain, Smoothing::Exact).unwrap();
            let fast = model.value(&timelines[0], TickRule::Filter, value).unwrap();
            assert!((exact - fast).abs() < 1e-9, "{axes:?}");
            // Differences of the fourth order: their steps may be wide beside rounding.
            let slope = |at: &dyn Fn(f64) -> f64, h: f64| {
                (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h)
            };
            for leg in 0..7 {
                for axis in 0..3 {
                    let at = |by: f64| {
                        let mut positions = batch[0].clone();
                        let mut angles = positions[leg].position.to_array();
                        angles[axis] += by;
                        positions[leg].position = Position::from_array(angles);
                        model
                            .value(&moving(&test, &positions), rule, value)
                            .unwrap()
                    };
                    let numeric = slope(&at, 1e-3);
                    let exact = alone[0].1[leg].angles[axis];
                    let error = (numeric - exact).abs();
                    assert!(error < 2e-8, "{axes:?} {leg} {axis}: {numeric} {exact}");
                }
                if leg > 0 {
                    let at = |by: f64| {
                        let mut positions = batch[0].clone();
                        positions[leg].move_s = positions[leg].move_s.map(|s| s + by);
                        model
                            .value(&moving(&test, &positions), rule, value)
                            .unwrap()
                    };
                    let numeric = slope(&at, 1e-3);
                    let exact = alone[0].1[leg].move_s;
                    assert!(
                        (numeric - exact).abs() < 1e-8,
                        "{axes:?} {leg}: {numeric} {exact}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_search_in_each_order_is_as_good_as_in_the_papers() {
    let problem = SearchProblem {
        starts: 4,
        max_positions: 10,
        ..SearchProblem::default()
    };
    let rms = |config: &PlatformConfig| {
        let evaluator = Evaluator::new(config.check().unwrap(), Objective::default());
        let found = search(&evaluator, &problem, &Control::default()).unwrap();
        found.evaluation.rms_sigma_deg_per_h()
    };
    let papers = rms(&PlatformConfig::default());
    for (k, axes) in ORDERS.into_iter().enumerate() {
        let mut config = PlatformConfig::default();
        hang(&mut config, axes, &mut Random::of_case(4800 + k as u64));
        let found = rms(&config);
        println!("{axes:?}: {:.3} %", 100.0 * (found / papers - 1.0));
        assert!(found <= 1.005 * papers, "{axes:?}: {found} for {papers}");
    }
}

/// Ranges on a stand that is turned and tilted, with moves that take time and without.
#[test]
fn nothing_is_below_the_bound_on_a_limited_stand() {
    let free = PlatformConfig::default().check().unwrap();
    let of_free = Certifier::new(&free).bound(&Criterion::rms(), 12_000.0);
    let of_free = of_free.unwrap().lower_bound;
    for (k, axes) in ORDERS.into_iter().enumerate().skip(3) {
        let random = &mut Random::of_case(4900 + k as u64);
        let mut config = PlatformConfig::default();
        hang(&mut config, axes, random);
        let low = random.between(-90.0, 40.0);
        config.gimbals.alpha_deg = Some([low, low + 60.0]);
        config.gimbals.beta_deg = Some([low - 20.0, low + 50.0]);
        config.gimbals.gamma_deg = Some([-70.0, 60.0]);
        if k % 2 == 0 {
            config.motion.slew_rate_deg_per_s = Some(0.5.into());
        }
        let platform = config.check().unwrap();
        let bound = Certifier::new(&platform).bound(&Criterion::rms(), 12_000.0);
        let bound = bound.unwrap().lower_bound;
        assert!(bound > of_free);
        let evaluator = Evaluator::new(platform, Objective::default());
        let problem = SearchProblem {
            starts: 2,
            max_positions: 10,
            ..SearchProblem::default()
        };
        let found = search(&evaluator, &problem, &Control::default()).unwrap();
        let rms = found.evaluation.rms_sigma_deg_per_h();
        println!(
            "{axes:?}: {:.1} % above the bound",
            100.0 * (rms / bound - 1.0)
        );
        assert!(rms >= bound, "{axes:?}: {rms} {bound}");
        assert!(Timeline::new(evaluator.test(), &found.schedule).is_ok());
    }
}

#[test]
fn standard_schemes_are_the_same_attitudes_wherever_they_can_be_taken() {
    for (k, axes) in ORDERS.into_iter().enumerate() {
        let random = &mut Random::of_case(5000 + k as u64);
        let mut config = PlatformConfig::default();
        hang(&mut config, axes, random);
        let platform = config.check().unwrap();
        for scheme in StandardScheme::ALL {
            let apart = |a: &Attitude, b: &nalgebra::Matrix3<f64>| (a.matrix() - b).amax();
            let papers = scheme.positions();
            for (p, there) in papers.iter().zip(scheme.positions_on(&platform)) {
                let c = attitude(&platform, there.degrees());
                assert!(
                    apart(&p.attitude(), &c) < 1e-9,
                    "{axes:?} {}",
                    scheme.name()
                );
            }
        }
        // On an index table it is the base that the axis-aligned ones are aligned with.
        config.gimbals.step_deg = Some(15.0);
        let table = config.check().unwrap();
        let test = Test::from(table.clone());
        let base = table.stand().base();
        let scheme = StandardScheme::Axis24;
        let there = scheme.schedule(12_000.0, &test).unwrap();
        assert!(Timeline::new(&test, &there).is_ok());
        for (p, there) in scheme.positions().iter().zip(there.positions()) {
            let c = attitude(&table, there.position.degrees());
            assert!((base * p.attitude().matrix() - c).amax() < 1e-12);
        }
    }
}

/// A search on an index table knows what is one attitude, in gimbal lock too.
#[test]
fn an_index_table_of_another_order_is_searched() {
    let mut config = PlatformConfig::default();
    hang(&mut config, ["+z", "-x", "+z"], &mut Random(5));
    config.gimbals.step_deg = Some(45.0);
    config.motion.slew_rate_deg_per_s = Some(2.0.into());
    let evaluator = Evaluator::new(config.check().unwrap(), Objective::default());
    let problem = SearchProblem {
        starts: 2,
        max_positions: 10,
        ..SearchProblem::default()
    };
    let found = search(&evaluator, &problem, &Control::default()).unwrap();
    assert!(Timeline::new(evaluator.test(), &found.schedule).is_ok());
    let faces = StandardScheme::Faces12.schedule(12_000.0, evaluator.test());
    let faces = evaluator.evaluate(&faces.unwrap()).unwrap();
    let rms = found.evaluation.rms_sigma_deg_per_h();
    assert!(rms < faces.rms_sigma_deg_per_h(), "{rms}");
}

/// docs/angles.md shows what the program draws.
#[cfg(feature = "report")]
#[test]
fn the_picture_of_the_guide_is_fresh() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/figures/angles.svg");
    let drawn =
        scheme_opt::internals::report::angles::picture(&PlatformConfig::default().check().unwrap());
    assert!(
        std::fs::read_to_string(path).unwrap() == drawn,
        "stale: cargo run --release --example 13_angles_and_axes -- docs/figures"
    );
}
