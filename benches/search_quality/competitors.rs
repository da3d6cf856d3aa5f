//! General-purpose optimisers on the same evaluator: CMA-ES with restarts, particle swarm,
//! simulated annealing, random search.
//!
//! Each moves the search's own free variables (four per position, limits and total time met by
//! construction) and is told how many positions the search ended with, which it could not find
//! out by itself; where moves are so slow that no random order of as many fits into the time, as
//! many as fit. Angles are rounded to the index table where there is one.

use std::cell::{Cell, RefCell};
use std::time::{Duration, Instant};

use argmin::core::{CostFunction, Error, Executor};
use argmin::solver::particleswarm::ParticleSwarm;
use argmin::solver::simulatedannealing::{Anneal, SATempFunc, SimulatedAnnealing};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use scheme_opt::internals::covariance::TickRule;
use scheme_opt::internals::evaluate::Evaluator;
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::schedule::Schedule;
use scheme_opt::internals::search::plan::Plan;
use scheme_opt::internals::search::variables::Variables;

use crate::problems::Problem;

#[derive(Clone, Copy)]
pub enum Competitor {
    CmaEs,
    Swarm,
    Annealing,
    Random,
}

pub struct Found {
    pub value: f64,
    pub evaluations: u64,
}

impl Competitor {
    pub const ALL: [Self; 4] = [Self::CmaEs, Self::Swarm, Self::Annealing, Self::Random];

    pub const fn name(self) -> &'static str {
        match self {
            Self::CmaEs => "CMA-ES (BIPOP restarts)",
            Self::Swarm => "particle swarm",
            Self::Annealing => "simulated annealing",
            Self::Random => "random search",
        }
    }

    /// The best value found in `time_s`, seed 1.
    pub fn run(self, problem: &Problem, reference: &Schedule, time_s: f64) -> Found {
        let evaluator = problem.evaluator();
        let black_box = BlackBox::new(&evaluator, problem.search_problem(1).total_time_s, time_s);
        let count = black_box.most_that_fit(reference.positions().len());
        // A method that ends before its time starts again with another seed.
        let mut seed = 1;
        while !black_box.is_over() {
            match self {
                Self::CmaEs => cma_es(&black_box, count, seed),
                Self::Swarm => swarm(&black_box, count, seed),
                Self::Annealing => annealing(&black_box, count, seed),
                Self::Random => random(&black_box, count, seed),
            }
            seed += 1;
        }
        Found {
            value: black_box.in_whole_periods().unwrap_or(f64::INFINITY),
            evaluations: black_box.evaluations.get(),
        }
    }
}

/// Value of a point that is no plan, times how far it is from one.
const NO_PLAN: f64 = 1e6;
/// Random points that are tried for one that is a plan.
const TRIED: usize = 500;

struct BlackBox<'a> {
    evaluator: &'a Evaluator,
    variables: Variables<'a>,
    deadline: Instant,
    best: RefCell<(f64, Vec<f64>)>,
    evaluations: Cell<u64>,
}

impl<'a> BlackBox<'a> {
    fn new(evaluator: &'a Evaluator, total_time_s: f64, time_s: f64) -> Self {
        Self {
            evaluator,
            variables: Variables::angles_and_dwells(evaluator.test(), total_time_s),
            deadline: Instant::now() + Duration::from_secs_f64(time_s),
            best: RefCell::new((f64::INFINITY, Vec::new())),
            evaluations: Cell::new(0),
        }
    }

    fn is_over(&self) -> bool {
        Instant::now() >= self.deadline
    }

    fn left(&self) -> Duration {
        self.deadline.saturating_duration_since(Instant::now())
    }

    /// The most positions, up to `count`, of which a few hundred random points hold a plan.
    fn most_that_fit(&self, count: usize) -> usize {
        let fits = |count: &usize| {
            let mut random = ChaCha8Rng::seed_from_u64(0);
            (0..TRIED).any(|_| self.plan(&random_point(*count, &mut random)).is_some())
        };
        (1..=count).rev().find(fits).unwrap_or(count)
    }

    /// How many times the total time the moves of a point take that is no plan.
    fn excess(&self, x: &[f64]) -> f64 {
        let test = self.evaluator.test();
        let total_time_s = self.variables.total_time_s();
        let plan = Variables::angles_and_dwells(test, 1e3 * total_time_s).decode(x);
        plan.map_or(1e3, |plan| plan.overhead_s(test) / total_time_s)
    }

    /// ln of the criterion, by the fast evaluation that the search uses too.
    fn value(&self, x: &[f64]) -> f64 {
        self.evaluations.set(self.evaluations.get() + 1);
        let value = self.criterion(x);
        let value = value.unwrap_or_else(|| NO_PLAN * (1.0 + self.excess(x)));
        let mut best = self.best.borrow_mut();
        if value < best.0 {
            *best = (value, x.to_vec());
        }
        value.ln()
    }

    /// The best point as a schedule that a stand can run, like the search's own: in whole filter
    /// periods, by the filter's tick rule.
    fn in_whole_periods(&self) -> Option<f64> {
        let test = self.evaluator.test();
        let plan = self.plan(&self.best.borrow().1)?;
        let total_time_s = self.variables.total_time_s();
        let schedule = plan.to_schedule(test).ok()?.scaled_to(test, total_time_s);
        let timeline = Timeline::new(test, &schedule.ok()?).ok()?;
        let model = self.evaluator.model();
        let end = model.end_covariance(&timeline, TickRule::Filter).ok()?;
        let criterion = &self.evaluator.objective().criterion;
        criterion.value(&end).ok()
    }

    /// The plan of a point, on the index table if there is one.
    fn plan(&self, x: &[f64]) -> Option<Plan> {
        let test = self.evaluator.test();
        let mut plan = self.variables.decode(x)?;
        if let Some(step) = test.platform().gimbals().step_rad {
            for angle in plan.angles.iter_mut().flatten() {
                *angle = step * (*angle / step).round();
            }
            let total_time_s = self.variables.total_time_s();
            plan = plan.fitted(test, total_time_s)?;
        }
        Some(plan)
    }

    fn criterion(&self, x: &[f64]) -> Option<f64> {
        let timeline = self.plan(x)?.timeline(self.evaluator.test());
        let model = self.evaluator.model();
        let end = model
            .end_covariance_by_gram(&timeline, TickRule::Relaxed)
            .ok()?;
        let value = self.evaluator.objective().criterion.value(&end);
        value.ok().filter(|v| v.is_finite())
    }
}

/// Angles within a turn, dwells within a factor of about three of each other.
fn random_point(count: usize, random: &mut ChaCha8Rng) -> Vec<f64> {
    let pi = std::f64::consts::PI;
    (0..4 * count)
        .map(|i| match i % 4 {
            3 => random.random_range(-0.6..0.6),
            _ => random.random_range(-pi..pi),
        })
        .collect()
}

fn random(black_box: &BlackBox<'_>, count: usize, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    while !black_box.is_over() {
        black_box.value(&random_point(count, &mut random));
    }
}

fn cma_es(black_box: &BlackBox<'_>, count: usize, seed: u64) {
    use cmaes::restart::{BIPOP, RestartOptions, RestartStrategy};
    let pi = std::f64::consts::PI;
    let options = RestartOptions::new(
        4 * count,
        -pi..=pi,
        RestartStrategy::BIPOP(BIPOP::default()),
    )
    .max_time(black_box.left())
    .seed(seed);
    if let Ok(restarter) = options.build() {
        restarter.run(|| |x: &cmaes::DVector<f64>| black_box.value(x.as_slice()));
    }
}

struct Cost<'a>(&'a BlackBox<'a>);

impl CostFunction for Cost<'_> {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, Error> {
        Ok(self.0.value(x))
    }
}

/// argmin's solvers take generators of rand 0.9, which the crate's own rand 0.10 does not make.
fn generator(seed: u64) -> rand_xoshiro::Xoshiro256PlusPlus {
    use rand_xoshiro::rand_core::SeedableRng;
    rand_xoshiro::Xoshiro256PlusPlus::seed_from_u64(seed)
}

fn swarm(black_box: &BlackBox<'_>, count: usize, seed: u64) {
    let pi = std::f64::consts::PI;
    let high: Vec<f64> = (0..4 * count)
        .map(|i| if i % 4 == 3 { 1.5 } else { pi })
        .collect();
    let low = high.iter().map(|h| -h).collect();
    let solver = ParticleSwarm::new((low, high), 60).with_rng_generator(generator(seed));
    let _ended = Executor::new(Cost(black_box), solver)
        .configure(|state| state.max_iters(2_000))
        .timeout(black_box.left())
        .run();
}

struct Annealed<'a> {
    cost: Cost<'a>,
    random: RefCell<ChaCha8Rng>,
}

impl CostFunction for Annealed<'_> {
    type Param = Vec<f64>;
    type Output = f64;
    fn cost(&self, x: &Vec<f64>) -> Result<f64, Error> {
        self.cost.cost(x)
    }
}

impl Anneal for Annealed<'_> {
    type Param = Vec<f64>;
    type Output = Vec<f64>;
    type Float = f64;
    /// Moves one position, by less as it cools.
    fn anneal(&self, x: &Vec<f64>, temperature: f64) -> Result<Vec<f64>, Error> {
        let mut random = self.random.borrow_mut();
        let mut next = x.clone();
        let k = random.random_range(0..x.len() / 4);
        let reach = (3.0 * temperature).clamp(0.003, 1.0);
        for v in &mut next[4 * k..4 * k + 4] {
            *v += reach * random.random_range(-1.0..1.0);
        }
        Ok(next)
    }
}

fn annealing(black_box: &BlackBox<'_>, count: usize, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let start = random_point(count, &mut random);
    let problem = Annealed {
        cost: Cost(black_box),
        random: RefCell::new(random),
    };
    let solver = SimulatedAnnealing::new_with_rng(1.0, generator(seed))
        .map(|s| s.with_temp_func(SATempFunc::Exponential(0.9999)));
    if let Ok(solver) = solver {
        let _ended = Executor::new(problem, solver)
            .configure(|state| state.param(start).max_iters(120_000))
            .timeout(black_box.left())
            .run();
    }
}
