//! L-BFGS as a solver that argmin runs.
//!
//! An iteration of argmin's is one line search. The `Executor` runs the iterations and asks after
//! each whether the state has terminated; the state holds the iterate, its value, the number of
//! iterations and, at the end, a reason in argmin's words, of which [`Termination`] is the finer
//! form. What is not used of argmin, and why: an `Observe` or a `Checkpoint` must own all it holds,
//! and cannot say "stop" without losing the state, so the control of a search, which is borrowed and
//! must be heard within a line search, is asked by the solver itself; and what an interrupted search
//! goes on from are whole refinements ([`crate::search::checkpoint`]), each a fraction of a second,
//! not states within one.

use argmin::core::{Error, Executor, IterState, KV, Problem, Solver, State, TerminationReason};

use super::{Advance, Lbfgs, Minimised};
use crate::search::termination::Termination;

/// What argmin knows of a minimisation on its way. The gradient stays in the solver, which needs it
/// beside the pairs.
pub(super) type Iterate = IterState<Vec<f64>, (), (), (), (), f64>;

/// What is minimised.
pub(in crate::search) trait MeritFunction {
    /// Value and gradient at `x`; none where there are none.
    fn with_gradient(&self, x: &[f64]) -> Option<(f64, Vec<f64>)>;
    /// Whether to stop before the next value is computed.
    fn must_stop(&self) -> bool;
}

/// The best point that L-BFGS sees from `start` in at most so many iterations.
pub(in crate::search) fn minimise<M: MeritFunction>(
    merit: &M,
    start: Vec<f64>,
    iterations: u64,
) -> Minimised {
    let mut solver = Lbfgs::new(start, iterations);
    // By reference: what came of it is there even if argmin should give an error for it, which it
    // has no cause for (no observer, no checkpoint, and the solver returns none).
    let ran = Executor::new(merit, &mut solver).ctrlc(false).run();
    debug_assert!(ran.is_ok_and(|done| done.state().terminated()));
    solver.into_minimised()
}

impl<M: MeritFunction> Solver<&M, Iterate> for &mut Lbfgs {
    fn name(&self) -> &str {
        "L-BFGS, Moré–Thuente line search"
    }

    /// The first point, whatever the control says, so that there is a best so far.
    fn init(
        &mut self,
        problem: &mut Problem<&M>,
        state: Iterate,
    ) -> Result<(Iterate, Option<KV>), Error> {
        let progress = self.evaluate(problem)?;
        let state = self.moved(state.max_iters(self.most_iterations));
        Ok((reported(state, progress), None))
    }

    /// A line search.
    fn next_iter(
        &mut self,
        problem: &mut Problem<&M>,
        state: Iterate,
    ) -> Result<(Iterate, Option<KV>), Error> {
        let mut progress = Advance::Tries;
        while progress == Advance::Tries {
            progress = match must_stop(problem) {
                true => self.end(Termination::Stopped),
                false => self.evaluate(problem)?,
            };
        }
        Ok((reported(self.moved(state), progress), None))
    }
}

impl Lbfgs {
    /// Has the point asked for evaluated.
    fn evaluate<M: MeritFunction>(&mut self, problem: &mut Problem<&M>) -> Result<Advance, Error> {
        let found = problem.problem("gradient_count", |merit| {
            Ok(merit.with_gradient(self.point()))
        })?;
        let found = found.as_ref().map(|(value, g)| (*value, g.as_slice()));
        Ok(self.tell(found))
    }

    /// The state at the last point accepted.
    fn moved(&self, state: Iterate) -> Iterate {
        state.param(self.x.clone()).cost(self.value)
    }
}

fn must_stop<M: MeritFunction>(problem: &Problem<&M>) -> bool {
    problem.problem.is_some_and(|merit| merit.must_stop())
}

/// The state with what became of the minimisation, in argmin's words.
fn reported(state: Iterate, progress: Advance) -> Iterate {
    match progress {
        Advance::Tries | Advance::Iterates => state,
        Advance::Ended(termination) => state.terminate_with(termination.into()),
    }
}

impl From<Termination> for TerminationReason {
    fn from(termination: Termination) -> Self {
        match termination {
            Termination::GradientConverged | Termination::CostConverged => Self::SolverConverged,
            Termination::IterationLimit => Self::MaxItersReached,
            Termination::Stopped => Self::Interrupt,
            Termination::LineSearchFailed => Self::SolverExit("line search failed".to_owned()),
            Termination::NoMerit => Self::SolverExit("no value at the first point".to_owned()),
        }
    }
}
