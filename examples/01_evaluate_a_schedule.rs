//! What a given schedule will teach the filter, before any test.
//!
//! The seed paper's two positions (§3.2), evaluated with ψ^n continuous across the move. Shows
//! the σ of every coefficient before and after, and when each got there.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use scheme_opt::{Position, Schedule, ScheduledPosition, Study};

fn main() -> scheme_opt::Result<()> {
    let study = Study::embedded_default()?;
    let schedule = Schedule::new(vec![
        ScheduledPosition::new(Position::from_deg(0.0, 0.0, 0.0), 1000.0),
        ScheduledPosition::new(Position::from_deg(180.0, 0.0, 0.0), 1000.0),
    ])?;
    let evaluated = study.evaluate(&schedule)?;

    println!("coefficient   prior, deg/h   sigma, deg/h   separability");
    for c in &evaluated.document().coefficients {
        println!(
            "{:<11} {:>14.5} {:>14.5} {:>14.3}",
            c.name.name(),
            c.prior_sigma_deg_per_h,
            c.sigma_deg_per_h,
            c.separability,
        );
    }
    println!("two positions leave these unobservable:");
    for combination in &evaluated.document().observability.unobservable {
        println!("  {combination}");
    }
    Ok(())
}
