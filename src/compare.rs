//! Comparison of schedules: what each reaches on the same platform in the same time.

use serde::{Deserialize, Serialize};

use crate::baseline::check_dwells;
use crate::error::{Error, Result};
use crate::evaluate::{Evaluation, Evaluator};
use crate::motion::Timeline;
use crate::schedule::standard::StandardScheme;
use crate::schedule::{Schedule, ScheduledPosition};

mod ordering;

pub(crate) use ordering::Reorderer;
pub use ordering::{MOST_PROVEN, Proof};

/// A schedule to compare.
#[derive(Debug, Clone, PartialEq)]
pub struct ComparisonEntry {
    /// What it is called.
    pub name: String,
    /// Where its positions come from.
    pub source: Source,
}

/// Where the positions of a schedule come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// Given, with its own dwells.
    Given(Schedule),
    /// A built-in scheme, with equal dwells.
    Standard(StandardScheme),
}

/// The order in which the positions of a scheme are visited.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum PositionOrder {
    /// As given.
    AsGiven,
    /// The best of all orders of the positions, proven ([`Proof::Complete`]): the dwells equal as
    /// before and filling the same total time.
    Best,
    /// The best that was found, of the positions as they are or by the Euler triples that are
    /// quickest in the order: local search from the given order and random ones. A better one may
    /// exist.
    BestFound,
}

/// What the search for an order says of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct OrderSearch {
    /// Whether it is proven.
    pub proof: Proof,
    /// Steps made towards the proof: positions added to beginnings of orders.
    pub steps: u64,
}

/// Steps towards the proof of an order after which it is left open. Enough for 10 positions, unless
/// their orders leave dwells of many hundred different lengths.
pub const MOST_STEPS: u64 = 50_000_000;

/// How to compare.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terms {
    /// Total time of every schedule, moves and settles included, s. Standard schemes are made
    /// for it.
    pub total_time_s: f64,
    /// Whether given schedules are scaled to it.
    pub scale: bool,
    /// Whether schedules are tried in their best order too.
    pub best_order: bool,
    /// Seed of the random orders.
    pub seed: u64,
    /// Steps after which the proof that an order is the best is left open ([`MOST_STEPS`]).
    pub most_steps: u64,
}

/// A schedule compared.
#[derive(Debug, Clone, PartialEq)]
pub struct ComparedSchedule {
    /// What it is called.
    pub name: String,
    /// The order of its positions.
    pub order: PositionOrder,
    /// How that order was searched for; none for an order as given.
    pub order_search: Option<OrderSearch>,
    /// The schedule as it was run with its evaluation, or why it cannot be.
    pub outcome: Result<(Schedule, Evaluation)>,
}

/// Every contender on the evaluator's platform, in order; a schedule in its best order comes after the
/// schedule itself. Runs on the rayon pool it is called from.
///
/// ```
/// use scheme_opt::internals::compare::{ComparisonEntry, MOST_STEPS, Source, Terms, compare};
/// use scheme_opt::internals::evaluate::{Evaluator, Objective};
/// use scheme_opt::internals::platform::PlatformConfig;
/// use scheme_opt::internals::schedule::standard::StandardScheme;
///
/// let evaluator = Evaluator::new(PlatformConfig::default().check()?, Objective::default());
/// let contenders = ["faces-6", "icosahedron-12"].map(|name| ComparisonEntry {
///     name: name.to_owned(),
///     source: Source::Standard(StandardScheme::from_name(name).unwrap()),
/// });
/// let terms = Terms {
///     total_time_s: 6000.0,
///     scale: true,
///     best_order: false,
///     seed: 1,
///     most_steps: MOST_STEPS,
/// };
/// let compared = compare(&evaluator, &contenders, &terms);
/// let rms = |k: usize| compared[k].outcome.as_ref().unwrap().1.rms_sigma_deg_per_h();
/// assert!(rms(1) < rms(0));
/// # Ok::<(), scheme_opt::Error>(())
/// ```
pub fn compare(
    evaluator: &Evaluator,
    contenders: &[ComparisonEntry],
    terms: &Terms,
) -> Vec<ComparedSchedule> {
    let mut all = Vec::with_capacity(contenders.len());
    for contender in contenders {
        let as_given = |schedule: Result<Schedule>| ComparedSchedule {
            name: contender.name.clone(),
            order: PositionOrder::AsGiven,
            order_search: None,
            outcome: schedule.and_then(|s| evaluated(evaluator, s)),
        };
        match &contender.source {
            Source::Given(schedule) => {
                let schedule = match terms.scale {
                    true => schedule.scaled_to(evaluator.test(), terms.total_time_s),
                    false => Ok(schedule.clone()),
                };
                all.push(as_given(schedule.clone()));
                if terms.best_order {
                    let total_time_s = match (&schedule, terms.scale) {
                        // As they are, all orders take the time of the given one.
                        (Ok(s), false) => Timeline::new(evaluator.test(), s)
                            .map_or(terms.total_time_s, |t| t.total_time_s()),
                        _ => terms.total_time_s,
                    };
                    let terms = Terms {
                        total_time_s,
                        ..*terms
                    };
                    let schedule = schedule.and_then(without_own_moves);
                    all.push(in_best_order(evaluator, &contender.name, schedule, &terms));
                }
            }
            Source::Standard(scheme) => {
                let schedule = of_scheme(evaluator, *scheme, terms);
                all.push(as_given(schedule.clone()));
                if terms.best_order {
                    all.push(in_best_order(evaluator, &contender.name, schedule, terms));
                }
            }
        }
    }
    all
}

/// A schedule whose positions can be reached from anywhere.
fn without_own_moves(schedule: Schedule) -> Result<Schedule> {
    let own = |p: &ScheduledPosition| p.move_s.is_some() || p.move_measured.is_some();
    match schedule.positions().iter().position(own) {
        None => Ok(schedule),
        Some(k) => Err(
            Error::input("a move of its own belongs to the order as it is")
                .with_key(format!("positions[{k}].move_s")),
        ),
    }
}

/// The scheme in whole filter periods, no dwell shorter than the shortest.
fn of_scheme(evaluator: &Evaluator, scheme: StandardScheme, terms: &Terms) -> Result<Schedule> {
    let test = evaluator.test();
    let schedule = scheme.schedule(terms.total_time_s, test)?;
    check_dwells(evaluator, &schedule)?;
    schedule.scaled_to(test, terms.total_time_s)
}

/// The schedule in the best order that is found, or what is wrong with it as it is `given`.
fn in_best_order(
    evaluator: &Evaluator,
    name: &str,
    given: Result<Schedule>,
    terms: &Terms,
) -> ComparedSchedule {
    let found = given.and_then(|given| {
        let positions: Vec<_> = given.positions().iter().map(|p| p.position).collect();
        let Terms {
            total_time_s,
            seed,
            most_steps,
            ..
        } = *terms;
        let dwell_s: Vec<f64> = given.positions().iter().map(|p| p.dwell_s).collect();
        let [least, most] = dwell_s
            .iter()
            .fold([f64::INFINITY, 0.0], |[a, b]: [f64; 2], d| {
                [a.min(*d), b.max(*d)]
            });
        // What is left over of equal dwells in whole periods makes some of them a period longer.
        let period_s = evaluator.test().platform().period_s();
        let own = (most - least > period_s * (1.0 + 1e-9)).then_some(&dwell_s[..]);
        ordering::best_order(evaluator, &positions, own, total_time_s, seed, most_steps)
            .ok_or_else(|| Error::numerical("no order of it can be rated"))
    });
    ComparedSchedule {
        name: name.to_owned(),
        order: match &found {
            Ok(found) if found.proof == Proof::Complete => PositionOrder::Best,
            _ => PositionOrder::BestFound,
        },
        order_search: found.as_ref().ok().map(|found| OrderSearch {
            proof: found.proof,
            steps: found.steps,
        }),
        outcome: found.and_then(|found| evaluated(evaluator, found.schedule)),
    }
}

fn evaluated(evaluator: &Evaluator, schedule: Schedule) -> Result<(Schedule, Evaluation)> {
    let evaluation = evaluator.evaluate(&schedule)?;
    Ok((schedule, evaluation))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::Objective;
    use crate::platform::PlatformConfig;

    #[test]
    fn a_better_order_is_the_same_positions_in_the_same_time() {
        let mut config = PlatformConfig::default();
        config.motion.slew_rate_deg_per_s = Some(1.0.into());
        config.motion.settle_s = 15.0;
        let evaluator = Evaluator::new(config.check().unwrap(), Objective::default());
        let terms = Terms {
            total_time_s: 9000.0,
            scale: true,
            best_order: true,
            seed: 1,
            most_steps: 10_000,
        };
        let contender = ComparisonEntry {
            name: "faces-12".to_owned(),
            source: Source::Standard(StandardScheme::Faces12),
        };
        let compared = compare(&evaluator, &[contender], &terms);
        let [given, best] = compared.as_slice() else {
            unreachable!("two entries");
        };
        let (given_schedule, given) = given.outcome.as_ref().unwrap();
        let (best_schedule, best) = best.outcome.as_ref().unwrap();
        assert!(best.rms_sigma_deg_per_h() < 0.9 * given.rms_sigma_deg_per_h());
        for evaluation in [given, best] {
            assert!(evaluation.total_time_s <= 9000.0 + 1e-6);
            assert!(evaluation.total_time_s > 9000.0 - 10.0);
        }
        let same = |a: &crate::schedule::ScheduledPosition| {
            let here = *a.position.attitude().matrix();
            let found = best_schedule.positions().iter();
            found
                .filter(|b| (b.position.attitude().matrix() - here).amax() < 1e-9)
                .count()
        };
        assert!(given_schedule.positions().iter().all(|p| same(p) == 1));
    }

    #[test]
    fn given_schedules_are_scaled_or_left_alone() {
        let evaluator = Evaluator::new(
            PlatformConfig::default().check().unwrap(),
            Objective::default(),
        );
        let schedule = StandardScheme::Edges12
            .schedule(3000.0, evaluator.test())
            .unwrap();
        let contender = ComparisonEntry {
            name: "mine".to_owned(),
            source: Source::Given(schedule),
        };
        for (scale, total_s) in [(true, 6000.0), (false, 3000.0)] {
            let terms = Terms {
                total_time_s: 6000.0,
                scale,
                best_order: true,
                seed: 1,
                most_steps: MOST_STEPS,
            };
            let compared = compare(&evaluator, std::slice::from_ref(&contender), &terms);
            // As it is given, and in its best order.
            assert_eq!(compared.len(), 2);
            for entry in &compared {
                let evaluation = &entry.outcome.as_ref().unwrap().1;
                assert!((evaluation.total_time_s - total_s).abs() < 1e-6);
            }
        }
    }
}
