//! Continuous tumbling: positions that turn slowly while they are held.
//!
//! Each dwell of a finished plan becomes a measured move from a start to an end attitude, the
//! same one to begin with, so that the plan without turning is where the refinement starts and
//! can only be improved. Between such segments the platform jumps as before, unmeasured. This is
//! how the best free schedules look: slow turning inside the dwells, the big jumps stay.
//!
//! A segment turns no faster than the gimbals can; its two ends lie within the gimbal ranges, and
//! with them all in between. In the schedule a turning segment is two entries, the second
//! reached by a measured move with no dwell of its own; one that hardly turns is a plain dwell.

use super::context::Context;
use super::finish::{round_angles, whole_periods};
use super::plan::Plan;
use super::refine::minimise;
use super::variables::{AngleMap, Coordinates, add_move_times, add_return, shares};
use super::ways::{in_deg, straight_ways, tidied};
use crate::attitude::Position;
use crate::covariance::gradient::LegGradient;
use crate::criterion::Smoothing;
use crate::motion::{Test, Timeline};
use crate::platform::Platform;
use crate::schedule::{Schedule, ScheduledPosition};

/// Free variables of a segment: three angles at each end, and its share of the time.
const PER_SEGMENT: usize = 7;
/// L-BFGS iterations; each visits every filter period of the test.
const ITERATIONS: u64 = 150;
/// A segment that turns less than this is a plain dwell, rad (0.005°).
const STILL_RAD: f64 = 1e-4;
/// First turn of each segment, rad: not zero, where some slopes vanish by symmetry.
const FIRST_TURN_RAD: f64 = 0.02;

/// A test of turning segments.
#[derive(Debug, Clone, PartialEq)]
struct TurningPlan {
    /// Start and end angles of each segment, rad, not wrapped: every way is the difference of two.
    ends: Vec<[[f64; 3]; 2]>,
    duration_s: Vec<f64>,
}

impl TurningPlan {
    fn timeline(&self, test: &Test) -> Timeline {
        Timeline::unchecked(test, self.entries(test).into_iter())
    }

    /// Two entries per segment, turning or not.
    fn entries(&self, test: &Test) -> Vec<ScheduledPosition> {
        let angles = self.ends.as_flattened();
        let ways = straight_ways(test, angles);
        let places = angles.iter().zip(ways).enumerate();
        let entries = places.map(|(i, (angles, way))| {
            let turns = (i % 2 == 1).then_some(self.duration_s[i / 2]);
            ScheduledPosition {
                move_s: turns,
                move_measured: turns.map(|_| true),
                change_deg: way.map(in_deg),
                ..ScheduledPosition::new(Position::from_array(*angles), 0.0)
            }
        });
        entries.collect()
    }

    /// How far segment `k` turns, rad, by the axis that turns most.
    fn turn(&self, k: usize) -> f64 {
        let change = change_of(&self.ends[k]);
        change.iter().fold(0.0, |max, c| c.abs().max(max))
    }

    /// Whether every segment keeps to the rates and accelerations of the gimbals.
    fn is_slow_enough(&self, platform: &Platform) -> bool {
        let Some(slew) = platform.motion().slew else {
            return true;
        };
        let segments = self.ends.iter().zip(&self.duration_s);
        segments
            .map(|(ends, duration_s)| (slew.shortest_s(&change_of(ends)), duration_s))
            .all(|(shortest_s, duration_s)| shortest_s <= *duration_s)
    }

    /// As a schedule; segments that hardly turn are plain dwells.
    fn to_schedule(&self, test: &Test) -> Option<Schedule> {
        let mut positions = Vec::new();
        for (k, pair) in self.entries(test).chunks_exact(2).enumerate() {
            if self.turn(k) < STILL_RAD {
                let dwell_s = self.duration_s[k];
                positions.push(ScheduledPosition { dwell_s, ..pair[0] });
            } else {
                positions.extend_from_slice(pair);
            }
        }
        Schedule::new(tidied(test, positions.into_iter(), &|_| false)).ok()
    }
}

/// How far each gimbal turns from a start to an end, rad.
fn change_of([start, end]: &[[f64; 3]; 2]) -> [f64; 3] {
    std::array::from_fn(|axis| end[axis] - start[axis])
}

/// The variables of a turning plan; always takes the total time.
struct TurningVariables<'a> {
    test: &'a Test,
    maps: [AngleMap; 3],
    total_time_s: f64,
}

impl TurningVariables<'_> {
    fn encode(&self, plan: &TurningPlan) -> Vec<f64> {
        let shortest_s = self.test.platform().shortest_dwell_s();
        let mut x = Vec::with_capacity(PER_SEGMENT * plan.ends.len());
        for (ends, duration) in plan.ends.iter().zip(&plan.duration_s) {
            for angles in ends {
                x.extend((0..3).map(|axis| self.maps[axis].variable(angles[axis])));
            }
            x.push(libm::log(
                (duration - shortest_s).max(0.1 * self.test.platform().period_s),
            ));
        }
        x
    }

    fn decode(&self, x: &[f64]) -> Option<TurningPlan> {
        let angles = |c: &[f64]| std::array::from_fn(|axis| self.maps[axis].angle(c[axis]));
        let ends: Vec<[[f64; 3]; 2]> = x
            .chunks_exact(PER_SEGMENT)
            .map(|c| [angles(c), angles(&c[3..])])
            .collect();
        let mut plan = TurningPlan {
            duration_s: vec![0.0; ends.len()],
            ends,
        };
        let spare = self.spare(&plan)?;
        let shortest_s = self.test.platform().shortest_dwell_s();
        for (duration, share) in plan.duration_s.iter_mut().zip(shares(x, PER_SEGMENT)) {
            *duration = shortest_s + spare * share;
        }
        plan.is_slow_enough(self.test.platform()).then_some(plan)
    }

    /// What jumps, settles and shortest segments leave of the total time.
    fn spare(&self, plan: &TurningPlan) -> Option<f64> {
        let turning: f64 = plan.duration_s.iter().sum();
        let jumps = plan.timeline(self.test).total_time_s() - turning;
        let shortest = plan.ends.len() as f64 * self.test.platform().shortest_dwell_s();
        let spare = self.total_time_s - jumps - shortest;
        (spare > 0.0).then_some(spare)
    }
}

impl Coordinates for TurningVariables<'_> {
    fn timeline(&self, x: &[f64]) -> Option<Timeline> {
        let timeline = self.decode(x)?.timeline(self.test);
        timeline.is_clear(self.test.platform()).then_some(timeline)
    }

    fn pull_back(&self, x: &[f64], timeline: &Timeline, legs: &[LegGradient]) -> Vec<f64> {
        let shares: Vec<f64> = shares(x, PER_SEGMENT).collect();
        let held = timeline.positions();
        // The duration of a segment is the move to its second entry.
        let segments = || {
            legs[held.clone()]
                .chunks_exact(2)
                .map(|pair| pair[1].move_s)
        };
        let mean: f64 = shares.iter().zip(segments()).map(|(s, g)| s * g).sum();
        let mut angles: Vec<[f64; 3]> = legs.iter().map(|l| l.angles).collect();
        // Jumps, start and return take their time from the segments.
        let is_segment = |k: &usize| held.contains(k) && (k - held.start) % 2 == 1;
        let jumps = (1..timeline.legs().len()).filter(|k| !is_segment(k));
        add_move_times(
            self.test.platform(),
            timeline,
            legs,
            jumps,
            mean,
            &mut angles,
        );
        add_return(timeline, &mut angles);
        let shortest_s = self.test.platform().shortest_dwell_s();
        let ends = timeline.position_legs().iter().skip(1).step_by(2);
        let spare: f64 = ends.map(|leg| leg.duration_s() - shortest_s).sum();
        let mut gradient = Vec::with_capacity(x.len());
        for (k, c) in x.chunks_exact(PER_SEGMENT).enumerate() {
            for end in 0..2 {
                for axis in 0..3 {
                    let slope = self.maps[axis].slope(c[3 * end + axis]);
                    gradient.push(angles[held.start + 2 * k + end][axis] * slope);
                }
            }
            let turned = legs[held.start + 2 * k + 1].move_s;
            gradient.push(spare * shares[k] * (turned - mean));
        }
        gradient
    }
}

/// The schedule that turns during the dwells of `plan`, with the criterion it reaches by the
/// filter's own tick rule; none when it comes to nothing.
pub(super) fn tumble(context: Context<'_>, plan: &Plan) -> Option<(f64, Schedule)> {
    let test = context.evaluator.test();
    let variables = TurningVariables {
        test,
        maps: test.platform().gimbals().ranges.map(AngleMap::new),
        total_time_s: context.problem.total_time_s,
    };
    let unwound = plan.unwound(test);
    let turns = unwound.iter().enumerate().map(|(k, start)| {
        let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
        let step = sign * FIRST_TURN_RAD;
        [start.map(|a| a - 0.5 * step), start.map(|a| a + 0.5 * step)]
    });
    let start = TurningPlan {
        ends: turns.collect(),
        duration_s: plan.dwell_s.clone(),
    };
    let smoothing = match context.evaluator.objective().criterion.has_kinks() {
        true => Smoothing::PowerMean(super::finish::SHARPEST),
        false => Smoothing::Exact,
    };
    let (_, x) = minimise(
        context,
        &variables,
        variables.encode(&start),
        smoothing,
        ITERATIONS,
    )?;
    let rounded = round(test, context.problem.total_time_s, &variables.decode(&x)?)?;
    let schedule = rounded.to_schedule(test)?;
    // A programme that the platform refuses, or that cannot be evaluated, is no candidate.
    let timeline = Timeline::new(test, &schedule).ok()?;
    context.work.count_evaluations(1);
    let (_, criterion) = context.evaluator.end_with_criterion(&timeline).ok()?;
    Some((criterion, schedule))
}

/// Angles to the stand's resolution, durations to whole periods within the total time.
fn round(test: &Test, total_time_s: f64, plan: &TurningPlan) -> Option<TurningPlan> {
    let platform = test.platform();
    let mut rounded = plan.clone();
    for angles in rounded.ends.iter_mut().flatten() {
        *angles = round_angles(platform, *angles);
    }
    let turning: f64 = rounded.duration_s.iter().sum();
    let jumps = rounded.timeline(test).total_time_s() - turning;
    rounded.duration_s = whole_periods(platform, &rounded.duration_s, total_time_s - jumps)?;
    rounded.is_slow_enough(platform).then_some(rounded)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::{Evaluator, Objective};
    use crate::platform::PlatformConfig;
    use crate::testing::assert_gradient;

    #[test]
    fn pulled_back_gradient_is_the_derivative() {
        let mut config = PlatformConfig::default();
        config.motion.slew_rate_deg_per_s = Some(0.5.into());
        config.motion.settle_s = 20.0;
        config.gimbals.beta_deg = Some([-60.0, 60.0]);
        config.motion.start_deg = Some([10.0, -20.0, 30.0]);
        config.motion.return_to_start = true;
        let evaluator = Evaluator::new(config.check().unwrap(), Objective::default());
        let test = evaluator.test();
        let variables = TurningVariables {
            test,
            maps: test.platform().gimbals().ranges.map(AngleMap::new),
            total_time_s: 5000.0,
        };
        let start = |k: f64| [1.3 * k - 4.0, (0.9 * k).sin() * 0.8, 2.0 - 0.7 * k];
        let plan = TurningPlan {
            ends: (0..6)
                .map(|k| [start(f64::from(k)), start(f64::from(k)).map(|a| a + 0.1)])
                .collect(),
            duration_s: (0..6).map(|k| 400.0 + 60.0 * f64::from(k)).collect(),
        };
        let x = variables.encode(&plan);
        let timeline = variables.timeline(&x).unwrap();
        assert!((timeline.total_time_s() - 5000.0).abs() < 1e-6);
        let (_, legs) = evaluator
            .merit_gradient(&timeline, Smoothing::Exact)
            .unwrap();
        let gradient = variables.pull_back(&x, &timeline, &legs);
        let f = |x: &[f64]| {
            let timeline = variables.timeline(x).unwrap();
            evaluator.merit(&timeline, Smoothing::Exact).unwrap()
        };
        assert_gradient(f, &x, &gradient, 5e-6);
    }
}
