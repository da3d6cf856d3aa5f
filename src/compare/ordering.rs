//! The order in which given positions are visited.
//!
//! The problem: visit each of the positions once, as they are given, and hold each for the same
//! time (or where a schedule has dwells of its own, in their proportion): equal dwells that fill the total time, in whole filter periods, the first positions one
//! period longer where they do not divide, none shorter than the shortest dwell. Orders that save
//! time on the way so get longer dwells. The best order is the one with the least score.
//!
//! [`found`] looks for it by local search; [`tree`] goes through all orders, prefix by prefix, and
//! proves that there is no better one, as long as there are few enough of them.
//!
//! On a stand whose moves take time an attitude can be had by several Euler triples, and which one
//! is taken decides the way. The positions are those that are quickest in the order given; local
//! search also looks for orders by the triples that are quickest in *them*
//! ([`quickest_positions`]). Where one of those is better, it is what is found, and no proof is
//! claimed for it.

mod found;
mod orders;
mod roads;
mod tree;
mod upper;

use serde::{Deserialize, Serialize};

use crate::attitude::Position;
use crate::evaluate::{Evaluator, Objective};
use crate::platform::Repositioning;
use crate::schedule::Schedule;
use orders::{Orders, Rated, SAME};

/// Most positions whose orders are gone through.
pub const MOST_PROVEN: usize = 12;

/// What is known of an order that was looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Proof {
    /// All orders were gone through: none is better by more than a part in 10⁹.
    Complete,
    /// Going through all orders would have taken more steps than are made: a better one may exist.
    StepLimit,
    /// There are too many positions to go through their orders: a better one may exist.
    TooManyPositions,
    /// What is known of the orders that are not gone through holds for the twelve coefficients alone,
    /// and the platform has other errors: a better one may exist.
    OtherErrors,
    /// The positions are held for different times, which go with them: orders of those are not gone
    /// through, and a better one may exist.
    OwnDwells,
    /// All orders of the positions as given were gone through, and one that takes some attitudes
    /// by other Euler triples was found to be better: a better one may exist.
    OtherTriples,
}

/// An order that was looked for.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct BestOrder {
    pub schedule: Schedule,
    pub proof: Proof,
    /// Steps made towards the proof.
    pub steps: u64,
}

/// The evaluator that orders are rated by, where it is another one: without the separability.
fn by_accuracy(evaluator: &Evaluator) -> Option<Evaluator> {
    (!evaluator.objective().is_led_by_separability()).then(|| {
        let objective = Objective {
            separability_weight: 0.0,
            ..evaluator.objective().clone()
        };
        Evaluator::new(evaluator.test().clone(), objective)
    })
}

/// Schedules whose positions may come in any order.
pub(crate) struct Reorderer<'a> {
    by_accuracy: Option<Evaluator>,
    evaluator: &'a Evaluator,
}

impl<'a> Reorderer<'a> {
    /// By the evaluator's objective.
    pub fn new(evaluator: &'a Evaluator) -> Self {
        Self {
            by_accuracy: by_accuracy(evaluator),
            evaluator,
        }
    }

    /// The positions in a good order, held equally long, by rating about `most_rated` orders; none when
    /// none of them fits into the time.
    pub fn good_order(
        &self,
        positions: Vec<Position>,
        total_time_s: f64,
        most_rated: usize,
    ) -> Option<Schedule> {
        let orders = Orders {
            evaluator: self.by_accuracy.as_ref().unwrap_or(self.evaluator),
            positions,
            quickest: false,
            total_time_s,
            proportions: None,
        };
        let found = found::quick(&orders, 1, most_rated)?;
        orders.schedule(&found.order)
    }
}

/// The best order of `positions` by the evaluator's objective; none when no order fits into the
/// time or has a merit. The same at any number of threads.
///
/// Separability is left out where it is no more than the usual hundredth of the score: between
/// orders of the same positions it hardly differs, and the bounds of the proof know nothing of it.
pub(super) fn best_order(
    evaluator: &Evaluator,
    positions: &[Position],
    proportions: Option<&[f64]>,
    total_time_s: f64,
    seed: u64,
    most_steps: u64,
) -> Option<BestOrder> {
    let by_accuracy = by_accuracy(evaluator);
    let evaluator = by_accuracy.as_ref().unwrap_or(evaluator);
    let orders = |quickest: bool| Orders {
        evaluator,
        positions: positions.to_vec(),
        quickest,
        total_time_s,
        proportions: proportions.map(<[f64]>::to_vec),
    };
    let given = orders(false);
    let found = found::search(&given, seed);
    let is_of_the_paper = evaluator.model().is_of_the_paper();
    let (best, proof, steps) = match (positions.len() <= MOST_PROVEN, is_of_the_paper) {
        _ if proportions.is_some() => (found, Proof::OwnDwells, 0),
        (false, _) => (found, Proof::TooManyPositions, 0),
        (_, false) => (found, Proof::OtherErrors, 0),
        (true, true) => {
            let gone = tree::go_through(&given, found, most_steps);
            let proof = match gone.complete {
                true => Proof::Complete,
                false => Proof::StepLimit,
            };
            (gone.best, proof, gone.steps)
        }
    };
    let platform = evaluator.test().platform();
    let motion = platform.motion();
    let ways_count = motion.slew.is_some() || platform.errors().feels_rates();
    let triples_matter = ways_count && motion.repositioning == Repositioning::Slew;
    let by_others = orders(true);
    let other = match triples_matter {
        true => found::search(&by_others, seed),
        false => None,
    };
    let better = |other: &Rated| best.as_ref().is_none_or(|b| other.merit < b.merit - SAME);
    match other.filter(better) {
        Some(other) => Some(BestOrder {
            schedule: by_others.schedule(&other.order)?,
            proof: match proof {
                Proof::Complete => Proof::OtherTriples,
                left_open => left_open,
            },
            steps,
        }),
        None => Some(BestOrder {
            schedule: given.schedule(&best?.order)?,
            proof,
            steps,
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::MOST_STEPS;
    use crate::criterion::Criterion;

    use crate::platform::{PlatformConfig, Repositioning};
    use crate::schedule::standard::StandardScheme;

    /// As orders are rated: by the criterion alone.
    fn by_accuracy() -> Objective {
        Objective {
            separability_weight: 0.0,
            ..Objective::default()
        }
    }

    fn permutations(count: usize) -> Vec<Vec<usize>> {
        (0..count).fold(vec![Vec::new()], |shorter, next| {
            let longer = shorter.iter().flat_map(|order: &Vec<usize>| {
                (0..=order.len()).map(move |at| {
                    let mut longer = order.clone();
                    longer.insert(at, next);
                    longer
                })
            });
            longer.collect()
        })
    }

    fn platforms() -> Vec<PlatformConfig> {
        let changes: [fn(&mut PlatformConfig); 9] = [
            |_| {},
            |c| c.motion.settle_s = 20.0,
            |c| {
                c.motion.slew_rate_deg_per_s = Some(0.5.into());
                c.motion.settle_s = 30.0;
            },
            |c| {
                c.motion.slew_rate_deg_per_s = Some(0.3.into());
                c.motion.return_to_start = true;
            },
            |c| {
                c.motion.slew_rate_deg_per_s = Some(0.7.into());
                c.motion.start_deg = Some([20.0, 30.0, -40.0]);
                c.motion.return_to_start = true;
                c.motion.settle_s = 7.0;
            },
            |c| {
                c.motion.slew_rate_deg_per_s = Some(0.5.into());
                c.gimbals.alpha_deg = Some([-200.0, 270.0]);
                c.gimbals.beta_deg = Some([-100.0, 100.0]);
            },
            |c| {
                c.motion.slew_rate_deg_per_s = Some(1.0.into());
                c.motion.measure_moves = true;
            },
            |c| {
                c.motion.repositioning = Repositioning::FrameHold;
                c.motion.settle_s = 10.0;
            },
            |c| {
                c.motion.slew_rate_deg_per_s = Some(0.5.into());
                c.filter.period_s = 30.0;
                c.prior.misalignment_deg = crate::platform::AxisValue::All(0.0);
                c.site.latitude_deg = 80.0;
            },
        ];
        changes
            .map(|change| {
                let mut config = PlatformConfig::default();
                change(&mut config);
                config
            })
            .to_vec()
    }

    /// Oblique attitudes, axis-aligned ones (some twice, some in gimbal lock) and mixed ones.
    fn sets() -> Vec<Vec<Position>> {
        let of = |angles: &[[f64; 3]]| {
            let positions = angles.iter().map(|a| Position::from_deg(a[0], a[1], a[2]));
            positions.collect()
        };
        vec![
            of(&[
                [10.0, 20.0, 30.0],
                [-70.0, 65.0, 110.0],
                [150.0, -33.0, -80.0],
                [35.0, 80.0, 175.0],
                [-120.0, -50.0, 60.0],
            ]),
            of(&[
                [0.0, 0.0, 0.0],
                [0.0, 90.0, 0.0],
                [90.0, 0.0, 90.0],
                [0.0, 0.0, 0.0],
                [180.0, 0.0, 0.0],
                [0.0, -90.0, 90.0],
            ]),
            of(&[
                [0.0, 0.0, 0.0],
                [45.0, 10.0, 0.0],
                [90.0, 0.0, 90.0],
                [180.0, 35.0, 60.0],
                [0.0, 0.0, 180.0],
                [-45.0, -60.0, 90.0],
            ]),
        ]
    }

    fn check(orders: &Orders<'_>, what: &str) -> u64 {
        let all = permutations(orders.positions.len());
        let exact = orders.rated(&all).into_iter().reduce(Rated::better);
        let gone = tree::go_through(orders, None, u64::MAX);
        assert!(gone.complete);
        match (&exact, &gone.best) {
            (Some(exact), Some(best)) => {
                assert!(
                    (best.merit - exact.merit).abs() < 3.0 * SAME,
                    "{what}: {best:?} {exact:?}"
                );
            }
            (None, None) => {}
            _ => panic!("{what}: {exact:?} {:?}", gone.best),
        }
        // With a good order known much is left out, and the same comes of it.
        let known = tree::go_through(orders, exact.clone(), u64::MAX);
        let merit = |best: &Option<Rated>| best.as_ref().map(|b| b.merit);
        match (merit(&known.best), merit(&exact)) {
            (Some(a), Some(b)) => assert!((a - b).abs() < 3.0 * SAME, "{what}: {a} {b}"),
            (a, b) => assert_eq!(a, b, "{what}"),
        }
        known.steps
    }

    #[test]
    fn the_best_order_is_that_of_trying_all() {
        for (k, config) in platforms().into_iter().enumerate() {
            let evaluator = Evaluator::new(config.check().unwrap(), by_accuracy());
            for (set, positions) in sets().into_iter().enumerate() {
                for total_time_s in [2600.0, 6000.0] {
                    let orders = Orders {
                        evaluator: &evaluator,
                        positions: positions.clone(),
                        quickest: false,
                        total_time_s,
                        proportions: None,
                    };
                    check(
                        &orders,
                        &format!("platform {k}, set {set}, {total_time_s} s"),
                    );
                }
            }
        }
    }

    #[test]
    fn it_is_the_best_by_every_objective() {
        let objectives = [
            Objective {
                criterion: Criterion::D,
                ..by_accuracy()
            },
            Objective {
                criterion: Criterion::E,
                ..by_accuracy()
            },
            Objective {
                separability_weight: 0.5,
                minimum_separability: 0.1,
                ..by_accuracy()
            },
        ];
        for objective in objectives {
            let config = platforms().swap_remove(2);
            let evaluator = Evaluator::new(config.check().unwrap(), objective.clone());
            for positions in sets() {
                let orders = Orders {
                    evaluator: &evaluator,
                    positions,
                    quickest: false,
                    total_time_s: 5000.0,
                    proportions: None,
                };
                check(&orders, &format!("{objective:?}"));
            }
        }
    }

    #[test]
    fn eight_positions_and_few_steps() {
        let config = platforms().swap_remove(1);
        let evaluator = Evaluator::new(config.check().unwrap(), by_accuracy());
        let mut positions = StandardScheme::Icosahedron12.positions();
        positions.truncate(8);
        let orders = Orders {
            evaluator: &evaluator,
            positions,
            quickest: false,
            total_time_s: 7000.0,
            proportions: None,
        };
        let steps = check(&orders, "eight");
        // Without bounds every beginning of an order is made: 8 + 8·7 + … + 8! of them, and more.
        assert!(steps < 109_600, "{steps}");
    }

    fn two_axis(evaluator: &Evaluator) -> Vec<Position> {
        let scheme = StandardScheme::TwoAxis9;
        let given = scheme.schedule(12_000.0, evaluator.test()).unwrap();
        given.positions().iter().map(|p| p.position).collect()
    }

    #[test]
    fn two_axis_9_is_found_from_every_seed() {
        let config = platforms().swap_remove(2);
        let evaluator = Evaluator::new(config.check().unwrap(), by_accuracy());
        let orders = Orders {
            evaluator: &evaluator,
            positions: two_axis(&evaluator),
            quickest: false,
            total_time_s: 12_000.0,
            proportions: None,
        };
        let known = orders.rated(&[vec![6, 0, 7, 4, 1, 8, 2, 5, 9, 3]]);
        let value = |rated: &Rated| rated.merit.exp();
        assert!((value(&known[0]) - 0.002_273_1).abs() < 5e-8);
        for seed in 1..=3 {
            let found = found::search(&orders, seed).unwrap();
            assert!(value(&found) < 0.002_273_1, "{seed}: {found:?}");
        }
    }

    #[test]
    fn what_is_cut_short_claims_no_proof() {
        let config = platforms().swap_remove(2);
        let evaluator = Evaluator::new(config.check().unwrap(), by_accuracy());
        let positions = sets().swap_remove(0);
        let of =
            |most_steps| best_order(&evaluator, &positions, None, 6000.0, 1, most_steps).unwrap();
        let (cut, whole) = (of(10), of(MOST_STEPS));
        assert_eq!(cut.proof, Proof::StepLimit);
        assert!(matches!(whole.proof, Proof::Complete | Proof::OtherTriples));
        assert!(cut.steps < whole.steps);
        let many = StandardScheme::Cube18.positions();
        let many = best_order(&evaluator, &many, None, 12_000.0, 1, MOST_STEPS).unwrap();
        assert_eq!((many.proof, many.steps), (Proof::TooManyPositions, 0));
    }

    #[test]
    fn any_number_of_threads_makes_the_same_steps() {
        let config = platforms().swap_remove(2);
        let evaluator = Evaluator::new(config.check().unwrap(), by_accuracy());
        let positions = sets().swap_remove(2);
        for most_steps in [200, MOST_STEPS] {
            let [one, three] = [1, 3].map(|threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                let find = || best_order(&evaluator, &positions, None, 6000.0, 7, most_steps);
                pool.unwrap().install(find).unwrap()
            });
            assert_eq!(one, three);
        }
    }
}
