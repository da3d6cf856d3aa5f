//! A thousand searches on odd platforms: each ends with a schedule that the platform can run, or
//! with a refusal that is proven; never with an error of another kind.

use std::ops::Range;

use rayon::prelude::*;
use scheme_opt::internals::analysis::Unobservable;
use scheme_opt::internals::commands::CommandTable;
use scheme_opt::internals::config::{
    CheckedConfig, CriterionKind, Mode, PerCoefficient, StudyConfig,
};
use scheme_opt::internals::drift::DriftCoefficient;
use scheme_opt::internals::evaluate::Evaluator;
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::{AxisValue, GSensitivePrior, Repositioning};
use scheme_opt::internals::schedule::Schedule;
use scheme_opt::internals::search::front::front;
use scheme_opt::internals::search::shortest::shortest;
use scheme_opt::internals::search::{Control, SearchOutcome, Status, search};

use crate::support::Random;

const SEARCHES: u64 = 1000;
/// The first of them, which the gate has time for.
const FIRST: u64 = 250;
/// Those that need no file.
const CRITERIA: [CriterionKind; 4] = [
    CriterionKind::A,
    CriterionKind::D,
    CriterionKind::E,
    CriterionKind::MaxRatio,
];

/// Draws of what a stand can be.
struct Draw(Random);

impl Draw {
    fn chance(&mut self, share: f64) -> bool {
        self.0.unit() < share
    }

    fn one_of<T: Copy>(&mut self, all: &[T]) -> T {
        all[(self.0.unit() * all.len() as f64) as usize]
    }

    fn up_to(&mut self, most: usize) -> usize {
        1 + (self.0.unit() * most as f64) as usize
    }

    /// Between, evenly in the logarithm.
    fn size(&mut self, low: f64, high: f64) -> f64 {
        (self.0.between(low.ln(), high.ln())).exp()
    }

    fn range(&mut self) -> Option<[f64; 2]> {
        let middle = self.0.between(-200.0, 200.0);
        let around = |half: f64| Some([middle - half, middle + half]);
        match self.up_to(9) {
            1 => Some([0.0, 0.0]),
            2 => around(0.0),
            3 => {
                let half = self.size(1e-4, 2.0);
                around(half)
            }
            4 => {
                let half = self.0.between(5.0, 170.0);
                around(half)
            }
            5 => Some([100.0, 900.0]),
            _ => None,
        }
    }

    /// Where the platform stands: within the ranges and on the table, if it has a setting.
    fn start(&mut self, ranges: [Option<[f64; 2]>; 3], step: Option<f64>) -> Option<[f64; 3]> {
        let mut start = [0.0; 3];
        for (angle, range) in start.iter_mut().zip(ranges) {
            let [low, high] = range.unwrap_or([-400.0, 400.0]);
            *angle = match self.up_to(4) {
                1 => low,
                2 => high,
                _ => self.0.between(low, high),
            };
            if let Some(step) = step {
                *angle = (*angle / step).floor() * step;
                if *angle < low {
                    *angle += step;
                }
                if *angle > high {
                    return None;
                }
            }
        }
        Some(start)
    }

    fn prior(&mut self, usual: f64) -> AxisValue {
        match self.up_to(6) {
            1 => AxisValue::All(0.0),
            2 => AxisValue::All(self.size(1e-3 * usual, 1e2 * usual)),
            3 => AxisValue::PerAxis([usual, 0.0, 0.1 * usual]),
            _ => AxisValue::All(usual),
        }
    }

    fn per_coefficient(&mut self, low: f64, high: f64) -> PerCoefficient {
        let mut values = PerCoefficient::default();
        if self.chance(0.5) {
            values.default = Some(self.size(low, high));
        }
        for _ in 0..self.up_to(3) {
            let coefficient = self.one_of(&DriftCoefficient::ALL);
            let value = self.size(low, high);
            values.coefficients.insert(coefficient, value);
        }
        values
    }

    fn study(&mut self) -> StudyConfig {
        let mut c = StudyConfig::default();
        let p = &mut c.platform;
        p.site.latitude_deg = match self.up_to(6) {
            1 => self.one_of(&[90.0, -90.0, 0.0, 89.99]),
            2 => self.0.between(-90.0, 90.0),
            _ => 28.2,
        };
        if self.chance(0.2) {
            p.accelerometer.noise_g = Some(self.size(1e-7, 1e-3));
        }
        if self.chance(0.2) {
            p.gyro.random_drift_deg_per_h = Some(self.one_of(&[0.0, 1e-4, 0.001, 0.1, 3.0]));
        }
        p.filter.period_s = self.one_of(&[0.1, 1.0, 7.3, 10.0, 10.0, 10.0, 100.0, 600.0]);
        if self.chance(0.4) {
            p.prior.misalignment_deg = self.prior(0.1);
            p.prior.constant_drift_deg_per_h = self.prior(15.0);
            p.prior.g_sensitive_drift_deg_per_h_per_g = match self.chance(0.5) {
                true => GSensitivePrior::All(self.prior(8.0)),
                false => GSensitivePrior::PerAxis {
                    input: self.prior(8.0),
                    output: self.prior(8.0),
                    spin: self.prior(8.0),
                },
            };
        }
        let ranges = [self.range(), self.range(), self.range()];
        [p.gimbals.alpha_deg, p.gimbals.beta_deg, p.gimbals.gamma_deg] = ranges;
        // Filter periods of measured moves cost most.
        p.motion.measure_moves = self.chance(0.25);
        if self.chance(0.35) {
            let steps = [2.5, 7.0, 7.5, 15.0, 30.0, 45.0, 90.0, 100.0, 120.0, 180.0];
            let all = if p.motion.measure_moves {
                &steps[5..]
            } else {
                &steps[..]
            };
            p.gimbals.step_deg = Some(self.one_of(all));
        }
        if self.chance(0.1) {
            p.motion.repositioning = Repositioning::FrameHold;
        }
        if self.chance(0.75) {
            p.motion.slew_rate_deg_per_s = Some(self.size(1e-3, 20.0).into());
            if self.chance(0.3) {
                p.motion.acceleration_deg_per_s2 = Some(self.size(1e-4, 20.0).into());
            }
        }
        let most = if p.motion.measure_moves { 12.0 } else { 80.0 };
        let periods = match self.up_to(4) {
            1 => self.up_to(4) as f64,
            2 => self.0.between(1.0, 12.0),
            _ => self.0.between(5.0, most),
        };
        let total_time_s = periods * p.filter.period_s;
        p.motion.settle_s = match self.up_to(3) {
            1 => self.0.between(0.0, 0.6) * total_time_s,
            2 => self.0.between(0.0, 0.1) * total_time_s,
            _ => 0.0,
        };
        p.motion.min_dwell_s = match self.up_to(4) {
            1 => 0.0,
            2 => self.0.between(0.0, 0.9) * total_time_s,
            _ => total_time_s.min(60.0),
        };
        if self.chance(0.6) {
            p.motion.start_deg = self.start(ranges, p.gimbals.step_deg);
        }
        p.motion.return_to_start = self.chance(0.4);

        let o = &mut c.objective;
        o.total_time_s = total_time_s;
        o.criterion = self.one_of(&CRITERIA);
        o.mode = match self.up_to(10) {
            1 => Mode::Time,
            2 => Mode::Pareto,
            _ => Mode::Accuracy,
        };
        if o.criterion == CriterionKind::MaxRatio || o.mode == Mode::Time || self.chance(0.2) {
            o.spec_deg_per_h = self.per_coefficient(1e-4, 100.0);
        }
        if self.chance(0.2) {
            o.weights = self.per_coefficient(0.1, 10.0);
            if self.chance(0.7) {
                o.weights.default = Some(0.0);
            }
        }
        if self.chance(0.3) {
            o.accept_unobservable = DriftCoefficient::ALL.to_vec();
        }
        match self.up_to(24) {
            1 => o.score.separability_weight = 0.1,
            2 => o.score.minimum_separability = 0.05,
            3 => (o.score.covariance_weight, o.score.separability_weight) = (0.0, 1.0),
            _ => {}
        }
        let s = &mut c.search;
        s.max_positions = Some(self.up_to(6).min(self.up_to(6)));
        s.starts = self.up_to(2);
        s.seed = self.up_to(1000) as u64;
        s.front_points = 2;
        s.allow_tumbling = self.chance(0.25)
            && periods < 30.0
            && c.platform.gimbals.step_deg.is_none()
            && c.platform.motion.repositioning == Repositioning::Slew;
        c
    }
}

/// The study of a case, with the seed that it came from in messages.
fn study(case: u64) -> CheckedConfig {
    let config = Draw(Random::of_case(case)).study();
    config
        .check()
        .unwrap_or_else(|e| panic!("case {case}: {e}"))
}

fn run(study: &CheckedConfig, evaluator: &Evaluator) -> scheme_opt::Result<SearchOutcome> {
    let control = Control::default();
    let problem = study.search_problem();
    match study.objective().mode {
        Mode::Accuracy => search(evaluator, &problem, &control),
        Mode::Time => shortest(evaluator, &problem, &control),
        Mode::Pareto => front(evaluator, &problem, study.search().front_points, &control),
    }
}

/// Why no schedule exists, worked out apart from the search; none: one does.
fn impossible(study: &CheckedConfig) -> Option<&'static str> {
    let motion = &study.config().platform.motion;
    let gimbals = &study.config().platform.gimbals;
    if let Some(step) = gimbals.step_deg {
        let ranges = [gimbals.alpha_deg, gimbals.beta_deg, gimbals.gamma_deg];
        let has_none = |[low, high]: [f64; 2]| (low / step).ceil() * step > high;
        if ranges.into_iter().flatten().any(has_none) {
            return Some("step_deg");
        }
    }
    // Staying at the start, or anywhere, for one dwell and its settling.
    let period_s = study.test().platform().period_s();
    let dwell_s = (motion.min_dwell_s / period_s - 1e-9).ceil().max(1.0) * period_s;
    let settles = motion.start_deg.is_some() && !motion.measure_moves;
    let least_s = dwell_s + if settles { motion.settle_s } else { 0.0 };
    (least_s > study.objective().total_time_s * (1.0 + 1e-9)).then_some("no schedule fits")
}

/// That the platform can run the schedule within the limits.
fn check_limits(study: &CheckedConfig, schedule: &Schedule) -> Result<(), String> {
    let timeline = Timeline::new(study.test(), schedule).map_err(|e| e.to_string())?;
    let (total_s, most_s) = (timeline.total_time_s(), study.objective().total_time_s);
    if total_s > most_s * (1.0 + 1e-12) {
        return Err(format!("takes {total_s} s of {most_s}"));
    }
    // A turn has two entries and counts as one position.
    let turns = schedule.positions().iter();
    let turns = turns.filter(|p| p.dwell_s == 0.0 && p.move_s.is_some());
    let count = schedule.positions().len() - turns.count();
    if Some(count) > study.search().max_positions {
        return Err(format!("{count} positions"));
    }
    CommandTable::new(
        study.test().platform(),
        &timeline,
        CommandTable::DEFAULT_STEP_DEG,
    )
    .map_err(|e| e.to_string())?;
    Ok(())
}

/// Whether the case ended as it should; what is wrong otherwise.
fn ends_well(case: u64) -> Result<&'static str, String> {
    let study = study(case);
    let evaluator = study.evaluator();
    let found = match run(&study, &evaluator) {
        Ok(found) => found,
        Err(e) if e.is_infeasible() => {
            let why = impossible(&study).ok_or_else(|| format!("not proven: {e}"))?;
            return match e.to_string().contains(why) {
                true => Ok("proven impossible"),
                false => Err(format!("should say {why}: {e}")),
            };
        }
        Err(e) => return Err(e.to_string()),
    };
    if let Some(why) = impossible(&study) {
        return Err(format!("found what cannot be: {why}"));
    }
    check_limits(&study, &found.schedule)?;
    for point in &found.front {
        check_limits(&study, &point.schedule)?;
    }
    let again = evaluator
        .evaluate(&found.schedule)
        .map_err(|e| e.to_string())?;
    if again.end != found.evaluation.end {
        return Err("the evaluation is not that of the schedule".to_owned());
    }
    let blind = Unobservable::of(&evaluator, &found.schedule, &again).map_err(|e| e.to_string())?;
    if blind != found.unobservable {
        return Err("what is unobservable is not that of the schedule".to_owned());
    }
    if found.status == Status::Converged && !blind.is_acceptable() {
        return Err("converged, with coefficients unobserved".to_owned());
    }
    Ok(found.status.name())
}

#[test]
fn every_search_ends_with_a_schedule_or_a_proof() {
    end_well(0..FIRST);
}

/// `cargo test --release --test it all_the_searches -- --ignored --nocapture`
#[test]
#[ignore = "the long form of the test above"]
fn all_the_searches_end_with_a_schedule_or_a_proof() {
    end_well(0..SEARCHES);
}

fn end_well(cases: Range<u64>) {
    let searches = cases.end - cases.start;
    let ends: Vec<_> = cases
        .into_par_iter()
        .map(|case| (case, ends_well(case)))
        .collect();
    let mut counts = std::collections::BTreeMap::new();
    let mut failures = Vec::new();
    for (case, end) in ends {
        match end {
            Ok(how) => *counts.entry(how).or_insert(0) += 1,
            Err(why) => failures.push(format!("case {case}: {why}")),
        }
    }
    println!("{counts:?}");
    assert!(
        failures.is_empty(),
        "{} of {searches}:\n{}",
        failures.len(),
        failures.join("\n")
    );
    // The draws are no one-sided lot.
    for how in ["converged", "infeasible", "proven impossible"] {
        let count = counts.get(how).copied().unwrap_or(0);
        assert!(count * 20 >= searches, "{how}: {count}");
    }
}
