//! Several plans refined side by side, one gradient per lane.
//!
//! Every plan has a minimisation of its own ([`super::lbfgs`], where it says why these are stepped
//! here and not run by argmin); in each round all of them say where
//! they want value and gradient, and the points are evaluated together. A plan that is done makes
//! room for the next. A lane has the bits of its schedule alone, so what a plan becomes depends
//! neither on the plans beside it nor on how they were shared out over lanes and threads.

use std::collections::VecDeque;

use rayon::prelude::*;

use super::context::Context;
use super::lbfgs::{Advance, Ended, Lbfgs, Minimised};
use super::plan::Plan;
use super::rated::Refined;
use super::variables::{Coordinates, Variables};
use crate::criterion::Smoothing;

/// Plans on their way at a time: as many as the widest registers have lanes.
const SIDE_BY_SIDE: usize = 8;

/// What became of a plan.
pub(super) struct Outcome {
    /// Which one.
    pub index: usize,
    /// The best that was seen; none when it has no merit at all.
    pub refined: Option<Refined>,
    /// How it ended; none when the search was stopped before it was begun.
    pub ended: Option<Ended>,
}

/// Refines angles and dwells of every plan; results in the order of the plans.
pub(super) fn refine_all(
    context: Context<'_>,
    plans: Vec<Plan>,
    smoothing: Smoothing,
    iterations: u64,
) -> Vec<Option<Refined>> {
    let shared: Vec<Vec<Option<Refined>>> = plans
        .par_chunks(share_of_a_thread(plans.len()))
        .map(|plans| {
            let mut out = vec![None; plans.len()];
            refine_side_by_side(context, plans.to_vec(), smoothing, iterations, |outcome| {
                if let Some(ended) = outcome.ended {
                    context.work.count_refinement(ended);
                }
                out[outcome.index] = outcome.refined;
            });
            out
        })
        .collect();
    shared.into_iter().flatten().collect()
}

/// How many of `count` plans a thread takes at a time.
pub(super) fn share_of_a_thread(count: usize) -> usize {
    count.div_ceil(rayon::current_num_threads()).max(1)
}

/// A plan on its way.
struct Active<'a> {
    index: usize,
    variables: Variables<'a>,
    search: Lbfgs,
}

impl Active<'_> {
    fn outcome(self) -> Outcome {
        let Minimised { best, ended } = self.search.into_minimised();
        let refined = best.and_then(|(merit, x)| {
            let plan = self.variables.decode(&x)?;
            Some(Refined { plan, merit })
        });
        Outcome {
            index: self.index,
            refined,
            ended: Some(ended),
        }
    }
}

/// Refines the plans on this thread and hands each over when it ends. When the search is to stop
/// it ends soon, with at least one evaluation of the first plan.
pub(super) fn refine_side_by_side(
    context: Context<'_>,
    plans: Vec<Plan>,
    smoothing: Smoothing,
    iterations: u64,
    mut hand_over: impl FnMut(Outcome),
) {
    let test = context.evaluator.test();
    let free = Variables::angles_and_dwells(test, context.problem.total_time_s);
    let mut waiting: VecDeque<(usize, Plan)> = plans.into_iter().enumerate().collect();
    let mut active: Vec<Active<'_>> = Vec::with_capacity(SIDE_BY_SIDE);
    loop {
        while active.len() < SIDE_BY_SIDE
            && let Some((index, plan)) = waiting.pop_front()
        {
            let variables = free.of(&plan);
            active.push(Active {
                index,
                search: Lbfgs::new(variables.encode(&plan), iterations),
                variables,
            });
        }
        if active.is_empty() {
            return;
        }
        let progress = advance(context, smoothing, &mut active);
        let stop = context.must_stop();
        // From the last on, so that removing one does not shift those still to come.
        for k in (0..active.len()).rev() {
            if stop || matches!(progress[k], Advance::Ended(_)) {
                hand_over(active.remove(k).outcome());
            }
        }
        if stop {
            for (index, _) in waiting.drain(..) {
                hand_over(Outcome {
                    index,
                    refined: None,
                    ended: None,
                });
            }
        }
    }
}

/// Value and gradient for every minimisation, evaluated together.
fn advance(context: Context<'_>, smoothing: Smoothing, active: &mut [Active<'_>]) -> Vec<Advance> {
    let mut timelines = Vec::with_capacity(active.len());
    let planned: Vec<bool> = active
        .iter()
        .map(|a| {
            let timeline = a.variables.timeline(a.search.point());
            let planned = timeline.is_some();
            timelines.extend(timeline);
            planned
        })
        .collect();
    let found = context.evaluator.merit_gradients(&timelines, smoothing);
    let mut found = timelines.iter().zip(found);
    active
        .iter_mut()
        .zip(planned)
        .map(|(a, planned)| {
            let answer = if planned { found.next() } else { None };
            let Some((timeline, Ok((value, legs)))) = answer else {
                return a.search.tell(None);
            };
            let gradient = a.variables.pull_back(a.search.point(), timeline, &legs);
            a.search.tell(Some((value, &gradient)))
        })
        .collect()
}

#[cfg(test)]
mod tests {

    use super::*;
    use crate::evaluate::{Evaluator, Objective};
    use crate::platform::PlatformConfig;
    use crate::search::context::WorkDone;
    use crate::search::propose::starts;
    use crate::search::refine::refine;
    use crate::search::{Control, SearchProblem};

    #[test]
    fn a_plan_alone_takes_the_way_that_it_takes_in_a_group() {
        for slew_rate_deg_per_s in [None, Some(0.5)] {
            let mut config = PlatformConfig::default();
            config.gimbals.beta_deg = Some([-60.0, 60.0]);
            config.motion.slew_rate_deg_per_s = slew_rate_deg_per_s.map(Into::into);
            let evaluator = Evaluator::new(config.check().unwrap(), Objective::default());
            let problem = SearchProblem {
                starts: 6,
                ..SearchProblem::default()
            };
            let control = Control::default();
            let (alone, together) = (WorkDone::default(), WorkDone::default());
            let context = |work| Context {
                evaluator: &evaluator,
                problem: &problem,
                control: &control,
                work,
            };
            let plans = starts(&evaluator, &problem).unwrap();
            let singly: Vec<_> = plans
                .iter()
                .map(|plan| refine(context(&alone), plan, Smoothing::Exact, 40))
                .map(|refined| refined.map(|r| (r.merit, r.plan)))
                .collect();
            let group = refine_all(context(&together), plans, Smoothing::Exact, 40);
            let group: Vec<_> = group
                .into_iter()
                .map(|refined| refined.map(|r| (r.merit, r.plan)))
                .collect();
            assert_eq!(singly, group);
            assert!(singly.iter().any(Option::is_some));
            let (alone, together) = (alone.counters(), together.counters());
            assert_eq!(alone, together);
            assert_eq!(together.refinements.total(), group.len() as u64);
        }
    }
}
