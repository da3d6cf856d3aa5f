//! The shortest test in which every coefficient meets its specification, and how short a test
//! could conceivably be.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use std::sync::atomic::AtomicBool;

use scheme_opt::internals::certificate::Certifier;
use scheme_opt::internals::drift::CoefficientVector;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::search::shortest::shortest;
use scheme_opt::internals::search::{Control, SearchProblem};

fn main() -> scheme_opt::Result<()> {
    let platform = PlatformConfig::default().check()?;
    let spec_deg_per_h = CoefficientVector::repeat(0.005);
    let problem = SearchProblem {
        // The longest acceptable.
        total_time_s: 6000.0,
        max_positions: 11,
        starts: 2,
        ..SearchProblem::default()
    };
    let certifier = Certifier::new(&platform);
    let least = certifier.minimum_time(&spec_deg_per_h, problem.total_time_s)?;
    let objective = Objective {
        spec_deg_per_h: Some(spec_deg_per_h),
        ..Objective::default()
    };
    let evaluator = Evaluator::new(platform, objective);
    let found = shortest(&evaluator, &problem, &Control::default())?;

    println!("{}: {}", found.status.name(), found.reason);
    println!(
        "{:.0} s with {} positions; what no schedule can beat: {least:?}",
        found.evaluation.total_time_s,
        found.schedule.positions().len()
    );
    Ok(())
}
