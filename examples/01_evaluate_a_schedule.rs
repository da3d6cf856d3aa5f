//! What a given schedule will teach the filter, before any test.
//!
//! The seed paper's two positions (§3.2), evaluated with ψ^n continuous across the move. Shows
//! the σ of every coefficient before and after, and when each got there.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::drift::DriftCoefficient;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};

fn main() -> scheme_opt::Result<()> {
    let evaluator = Evaluator::new(PlatformConfig::default().check()?, Objective::default());
    let schedule = Schedule::new(vec![
        ScheduledPosition::new(Position::from_deg(0.0, 0.0, 0.0), 1000.0),
        ScheduledPosition::new(Position::from_deg(180.0, 0.0, 0.0), 1000.0),
    ])?;
    let evaluation = evaluator.evaluate(&schedule)?;

    let sigma = evaluation.end.sigma_deg_per_h();
    println!("coefficient   prior, deg/h   sigma, deg/h   separability");
    for c in DriftCoefficient::ALL {
        println!(
            "{:<11} {:>14.5} {:>14.5} {:>14.3}",
            c.name(),
            evaluation.prior_sigma_deg_per_h[c.index()],
            sigma[c.index()],
            evaluation.observability.separability[c.index()],
        );
    }
    println!("two positions leave these unobservable:");
    for combination in &evaluation.observability.unobservable {
        println!("  {combination}");
    }
    Ok(())
}
