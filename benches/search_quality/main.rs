//! How good the search is: its result on a fixed set of problems against the best value known,
//! over seeds, and against general-purpose optimisers with ten times the time.
//!
//! ```text
//! cargo bench --bench search_quality                    # the search, five seeds, all problems
//! cargo bench --bench search_quality -- --against       # the other optimisers
//! cargo bench --bench search_quality -- --times         # mode time against mode accuracy
//! cargo bench --bench search_quality -- stand table-45  # some problems only
//! ```
//!
//! Prints the tables of docs/search-quality.md. Values are deterministic, wall times are not.

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    missing_docs,
    reason = "a bench has no callers"
)]

mod competitors;
#[path = "../../tests/battery/problems.rs"]
mod problems;

use std::time::Instant;

use competitors::Competitor;
use problems::Problem;
use scheme_opt::internals::criterion::Criterion;
use scheme_opt::internals::drift::CoefficientVector;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::search::shortest::shortest;
use scheme_opt::internals::search::{Control, Counters, SearchOutcome, SearchProblem, search};

const SEEDS: u64 = 5;
/// How much more time than the search the other optimisers get.
const MORE_TIME: f64 = 10.0;
/// Starts of the search that they are compared with: a quick one, so that they end today.
const QUICK_STARTS: usize = 8;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let against = arguments.iter().any(|a| a == "--against");
    let seeds = arguments
        .iter()
        .find_map(|a| a.strip_prefix("--seeds=")?.parse().ok())
        .unwrap_or(SEEDS);
    let wanted: Vec<&String> = arguments.iter().filter(|a| !a.starts_with('-')).collect();
    let problems: Vec<Problem> = problems::all()
        .into_iter()
        .filter(|p| wanted.is_empty() || wanted.iter().any(|w| *w == p.name))
        .collect();
    if arguments.iter().any(|a| a == "--times") {
        return times_table(&problems);
    }
    if against {
        return against_table(&problems);
    }
    search_table(&problems, seeds);
}

fn run(problem: &Problem, search_problem: &SearchProblem) -> (SearchOutcome, f64) {
    let evaluator = problem.evaluator();
    let control = Control::default();
    let start = Instant::now();
    let outcome = search(&evaluator, search_problem, &control).unwrap();
    (outcome, start.elapsed().as_secs_f64())
}

/// The search over seeds.
fn search_table(problems: &[Problem], seeds: u64) {
    println!(
        "| problem | conditions | best known | best | median | worst | positions | values | \
         gradients | s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    for problem in problems {
        let runs: Vec<_> = (1..=seeds)
            .map(|seed| run(problem, &problem.search_problem(seed)))
            .collect();
        let mut values: Vec<f64> = runs
            .iter()
            .map(|r| r.0.evaluation.score.criterion)
            .collect();
        values.sort_by(f64::total_cmp);
        let known = problem.best_known.min(values[0]);
        let excess = |v: f64| format!("+{:.2} %", 100.0 * (v / known - 1.0));
        let wall: f64 = runs.iter().map(|r| r.1).sum::<f64>() / runs.len() as f64;
        let count = |r: &(SearchOutcome, f64)| r.0.schedule.positions().len();
        let work = |part: fn(&Counters) -> u64| {
            let sum: u64 = runs.iter().map(|r| part(&r.0.counters)).sum();
            format!("{:.0}k", sum as f64 / 1e3 / runs.len() as f64)
        };
        println!(
            "| {} | {} | {known:.4e} | {} | {} | {} | {}–{} | {} | {} | {wall:.1} |",
            problem.name,
            problem.what,
            excess(values[0]),
            excess(values[values.len() / 2]),
            excess(values[values.len() - 1]),
            runs.iter().map(count).min().unwrap(),
            runs.iter().map(count).max().unwrap(),
            work(|c| c.evaluations),
            work(|c| c.gradients),
        );
    }
}

/// Mode `time` asked for the accuracy that mode `accuracy` reached: does it need as long?
fn times_table(problems: &[Problem]) {
    println!(
        "| problem | T, s | largest ratio reached in T | shortest test for it, s | of T | s |"
    );
    println!("|---|---|---|---|---|---|");
    for problem in problems {
        let plain = problem.evaluator();
        let search_problem = problem.search_problem(1);
        let control = Control::default();
        // The specification: 0.001 °/h for all, widened by the ratio that T allows.
        let of = |deg_per_h: f64| Objective {
            criterion: Criterion::max_ratio(CoefficientVector::repeat(deg_per_h)),
            spec_deg_per_h: Some(CoefficientVector::repeat(deg_per_h)),
            ..plain.objective().clone()
        };
        let evaluator = Evaluator::new(plain.test().clone(), of(0.001));
        let accurate = search(&evaluator, &search_problem, &control).unwrap();
        let ratio = accurate.evaluation.score.criterion;
        let evaluator = Evaluator::new(plain.test().clone(), of(0.001 * ratio));
        let longer = SearchProblem {
            total_time_s: 1.25 * search_problem.total_time_s,
            seed: 2,
            ..search_problem.clone()
        };
        let start = Instant::now();
        let shortest = shortest(&evaluator, &longer, &control).unwrap();
        let needed_s = shortest.evaluation.total_time_s;
        println!(
            "| {} | {:.0} | {ratio:.4} | {needed_s:.0} | {:+.2} % | {:.1} |",
            problem.name,
            search_problem.total_time_s,
            100.0 * (needed_s / search_problem.total_time_s - 1.0),
            start.elapsed().as_secs_f64(),
        );
    }
}

/// A quick search with seed 1 against each other optimiser on one thread.
fn against_table(problems: &[Problem]) {
    print!("| problem | search | s |");
    Competitor::ALL
        .iter()
        .for_each(|c| print!(" {} |", c.name()));
    println!(" evaluations, 1e6 |");
    println!("|---|---|---|{}---|", "---|".repeat(Competitor::ALL.len()));
    for problem in problems {
        let quick = SearchProblem {
            starts: QUICK_STARTS,
            ..problem.search_problem(1)
        };
        let (outcome, wall_s) = run(problem, &quick);
        let ours = outcome.evaluation.score.criterion;
        print!("| {} | {ours:.4e} | {wall_s:.1} |", problem.name);
        let mut evaluations = Vec::new();
        for competitor in Competitor::ALL {
            let found = competitor.run(problem, &outcome.schedule, MORE_TIME * wall_s);
            print!(" {:+.2} % |", 100.0 * (found.value / ours - 1.0));
            evaluations.push(format!("{:.1}", found.evaluations as f64 / 1e6));
        }
        println!(" {} |", evaluations.join(", "));
    }
}
