//! Dwell times as a sequence of convex quadratic programs, solved by clarabel.
//!
//! Around the dwells d the information is E(d + Δ) ≈ E + Σ_k Δ_k E'_k with E'_k = ∂E/∂d_k taken
//! through the whole chain. With P = L Lᵀ, M_k = Lᵀ E'_k L and K = Lᵀ G L, G = ∂merit/∂P ⪰ 0, the
//! gradient is −tr(K M_k); the second derivative of the merit's dependence on E,
//! H_jk = 2 tr(G P E'_j P E'_k P) = 2 tr(K M_j M_k), is positive semidefinite (it is a Gram
//! matrix), so
//!
//! ```text
//! minimise gᵀΔ + ½ Δᵀ H Δ   subject to   Σ Δ_k = 0,  d_k + Δ_k ≥ 0,  |Δ_k| ≤ trust
//! ```
//!
//! is convex and may send a dwell to exactly zero: that position does not pay and is dropped. A
//! step is accepted by the true merit, the trust region follows the agreement. With more than the twelve
//! coefficients H is taken from differences of the exact gradient.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT,
};

use nalgebra::DMatrix;

use super::context::{Context, WorkDone};
use super::plan::Plan;
use super::rated::Refined;
use crate::covariance::chain::InformationSink;
use crate::covariance::{CoefficientCovariance, TickRule};
use crate::criterion::Smoothing;
use crate::drift::{CoefficientMatrix, DriftMatrix};
use crate::evaluate::Evaluator;
use crate::motion::Timeline;

/// Steps of the sequence.
const STEPS: usize = 8;
/// First trust region, as a share of the mean dwell.
const FIRST_TRUST: f64 = 0.5;

/// Reallocates the dwells of `plan` and drops positions left with (almost) nothing; the result
/// is never worse than the plan.
pub(crate) fn allocate(context: Context<'_>, plan: Refined, smoothing: Smoothing) -> Refined {
    let (evaluator, work) = (context.evaluator, context.work);
    let total_time_s = context.problem.total_time_s;
    let mut current = plan;
    let mut trust = FIRST_TRUST * total_time_s / current.plan.angles.len() as f64;
    for _ in 0..STEPS {
        let Some(model) = LocalModel::around(evaluator, &current.plan, smoothing, work) else {
            break;
        };
        let Some(step) = model.solve(&to_give(context, &current.plan), trust) else {
            break;
        };
        match apply(context, &current.plan, &step, smoothing) {
            Some(next) if next.merit < current.merit => {
                let gain = current.merit - next.merit;
                let predicted = -model.change(&step);
                current = next;
                trust *= if gain > 0.75 * predicted { 2.0 } else { 1.0 };
                if gain < 1e-8 {
                    break;
                }
            }
            _ => trust *= 0.25,
        }
        if trust < evaluator.test().platform().period_s() {
            break;
        }
    }
    current
}

/// How much of its dwell each position may lose, s: one that is held keeps the shortest dwell.
fn to_give(context: Context<'_>, plan: &Plan) -> Vec<f64> {
    let shortest_s = context.evaluator.test().platform().shortest_dwell_s();
    let dwells = plan.dwell_s.iter().enumerate();
    dwells
        .map(|(k, dwell_s)| match plan.is_held(k) {
            true => (dwell_s - shortest_s).max(0.0),
            false => *dwell_s,
        })
        .collect()
}

/// Applies a step: positions left with less than half the minimum dwell (or half a period) are
/// dropped, and the rest fills the total time.
fn apply(context: Context<'_>, plan: &Plan, step: &[f64], smoothing: Smoothing) -> Option<Refined> {
    let evaluator = context.evaluator;
    let test = evaluator.test();
    let shortest = 0.5 * test.platform().shortest_dwell_s();
    let mut next = plan.clone();
    for (k, change) in step.iter().enumerate().rev() {
        next.dwell_s[k] += change;
        // From the last on, so that removing one does not shift those still to come.
        if next.dwell_s[k] < shortest && !next.is_held(k) {
            next.remove(k);
        }
    }
    let (next, timeline) = next.fitted_timeline(test, context.problem.total_time_s)?;
    context.work.count_evaluations(1);
    // A step to where no merit can be computed is not taken.
    let merit = evaluator.merit(&timeline, smoothing).ok()?;
    Some(Refined { plan: next, merit })
}

/// Lᵀ E L, from rows that are seen through L before they are squared: no row of E is as short, and
/// none as long, as in its own units.
#[derive(Clone)]
struct SeenThrough<'a> {
    root: &'a CoefficientMatrix,
    sum: CoefficientMatrix,
}

impl InformationSink for SeenThrough<'_> {
    fn add(&mut self, rows: &DriftMatrix) {
        let seen = rows * self.root;
        self.sum.gemm_tr(1.0, &seen, &seen, 1.0);
    }
}

/// Gradient and convex curvature of the merit in the dwells.
struct LocalModel {
    gradient: Vec<f64>,
    /// Row-major K×K.
    curvature: Vec<f64>,
}

/// The timeline of a plan with one of its dwells longer.
fn longer(timeline: &Timeline, plan: &Plan, position: usize, by_s: f64) -> Timeline {
    let dwells = plan.dwell_s.iter().enumerate();
    let dwells = dwells.map(|(k, d)| if k == position { d + by_s } else { *d });
    timeline.clone().with_dwells(dwells)
}

impl LocalModel {
    fn around(
        evaluator: &Evaluator,
        plan: &Plan,
        smoothing: Smoothing,
        work: &WorkDone,
    ) -> Option<Self> {
        let model = evaluator.model();
        let test = evaluator.test();
        if !model.is_of_the_paper() {
            return Self::by_gradients(evaluator, plan, smoothing, work);
        }
        let count = plan.angles.len();
        work.count_evaluations(count as u64 + 1);
        let timeline = plan.timeline(test);
        let end = model.end_covariance_in_doubles(&timeline, TickRule::Relaxed);
        // Without a local model the dwells stay as they are.
        let end = end.ok()?;
        let (_, slope) = evaluator.merit_and_slope(&end, smoothing).ok()?;
        let slope = slope.in_root(&end);
        let root = end.root();
        let nothing = SeenThrough {
            root: root.matrix(),
            sum: CoefficientMatrix::zeros(),
        };
        // One period ahead: long against rounding, short against the dwell.
        let ahead = test.platform().period_s();
        let (here, longer) = model.run_lengthened(&timeline, TickRule::Relaxed, ahead, nothing);
        let mut pulled = Vec::with_capacity(count);
        let mut gradient = Vec::with_capacity(count);
        for longer in longer {
            let rate = (longer.sum - here.sum) / ahead;
            gradient.push(-slope.dot(&rate));
            pulled.push((rate, slope * rate));
        }
        let mut curvature = vec![0.0; count * count];
        for j in 0..count {
            for k in 0..count {
                // tr(K M_j M_k) = Σ (K M_j)ᵀ ∘ M_k.
                curvature[j * count + k] = 2.0 * pulled[j].1.transpose().dot(&pulled[k].0);
            }
        }
        Some(Self {
            gradient,
            curvature,
        })
    }

    /// With other parameters beside the twelve coefficients: the curvature by differences of the exact
    /// gradient, without directions in which the merit is not convex.
    fn by_gradients(
        evaluator: &Evaluator,
        plan: &Plan,
        smoothing: Smoothing,
        work: &WorkDone,
    ) -> Option<Self> {
        let test = evaluator.test();
        let count = plan.angles.len();
        // One period ahead: long against rounding, short against the dwell.
        let ahead = test.platform().period_s();
        work.count_evaluations(count as u64 + 1);
        let here = plan.timeline(test);
        let all_longer = (0..count).map(|k| longer(&here, plan, k, ahead));
        let timelines: Vec<Timeline> = std::iter::once(here.clone()).chain(all_longer).collect();
        let held = timelines[0].positions();
        let slopes = evaluator.merit_gradients(&timelines, smoothing);
        let slopes: Option<Vec<Vec<f64>>> = slopes
            .into_iter()
            .map(|found| {
                Some(
                    found.ok()?.1[held.clone()]
                        .iter()
                        .map(|leg| leg.dwell_s)
                        .collect(),
                )
            })
            .collect();
        let slopes = slopes?;
        let (gradient, ahead_of) = slopes.split_first()?;
        let second = DMatrix::from_fn(count, count, |j, k| (ahead_of[k][j] - gradient[j]) / ahead);
        if !second.iter().all(|v| v.is_finite()) {
            return None;
        }
        let mut eigen = ((&second + second.transpose()) * 0.5).symmetric_eigen();
        eigen.eigenvalues.apply(|v| *v = v.max(0.0));
        let convex = eigen.recompose();
        Some(Self {
            gradient: gradient.clone(),
            // Symmetric, so that columns are rows.
            curvature: convex.iter().copied().collect(),
        })
    }

    /// Predicted change of the merit by a step.
    fn change(&self, step: &[f64]) -> f64 {
        let count = step.len();
        let mut change = 0.0;
        for j in 0..count {
            let bend: f64 = (0..count)
                .map(|k| self.curvature[j * count + k] * step[k])
                .sum();
            change += step[j] * (self.gradient[j] + 0.5 * bend);
        }
        change
    }

    /// The step of the quadratic program, in s; none when clarabel does not solve it.
    /// `to_give_s` is what each dwell may lose.
    fn solve(&self, to_give_s: &[f64], trust: f64) -> Option<Vec<f64>> {
        let count = to_give_s.len();
        // In units of the trust region, so that the program is well scaled whatever the times.
        let mut upper = Vec::with_capacity(count * (count + 1) / 2);
        let (mut rows, mut starts) = (Vec::new(), vec![0]);
        for k in 0..count {
            for j in 0..=k {
                let symmetric =
                    0.5 * (self.curvature[j * count + k] + self.curvature[k * count + j]);
                upper.push(symmetric * trust * trust);
                rows.push(j);
            }
            starts.push(rows.len());
        }
        let quadratic = CscMatrix::new(count, count, starts, rows, upper);
        let linear: Vec<f64> = self.gradient.iter().map(|g| g * trust).collect();
        // Rows: the sum, then −Δ_k ≤ min(g_k/trust, 1) and Δ_k ≤ 1, g_k what is to give.
        let (mut rows, mut values, mut starts) = (Vec::new(), Vec::new(), vec![0]);
        for k in 0..count {
            rows.extend([0, 1 + k, 1 + count + k]);
            values.extend([1.0, -1.0, 1.0]);
            starts.push(rows.len());
        }
        let constraints = CscMatrix::new(1 + 2 * count, count, starts, rows, values);
        let mut bounds = vec![0.0];
        bounds.extend(to_give_s.iter().map(|d| (d / trust).min(1.0)));
        bounds.extend(std::iter::repeat_n(1.0, count));
        // A program that cannot be set up or solved gives no step.
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .build()
            .ok()?;
        let cones = [ZeroConeT(1), NonnegativeConeT(2 * count)];
        let mut solver =
            DefaultSolver::new(&quadratic, &linear, &constraints, &bounds, &cones, settings)
                .ok()?;
        solver.solve();
        let solved = matches!(
            solver.solution.status,
            SolverStatus::Solved | SolverStatus::AlmostSolved
        );
        solved.then(|| solver.solution.x.iter().map(|x| x * trust).collect())
    }
}
