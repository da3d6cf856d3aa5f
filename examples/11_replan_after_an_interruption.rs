//! A test was interrupted halfway: what is the best that can be done with the time that is left?
//!
//! What the filter knows so far (misalignment, drift, and how they are correlated) is the prior
//! of the rest: the platform is told what has been done, and the search plans from there. Compared
//! with going on by the old plan as far as the time allows.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use std::sync::atomic::AtomicBool;

use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::schedule::Schedule;
use scheme_opt::internals::schedule::standard::StandardScheme;
use scheme_opt::internals::search::{Control, SearchProblem, search};

fn main() -> scheme_opt::Result<()> {
    let mut config = PlatformConfig::default();
    config.motion.slew_rate_deg_per_s = Some(1.0);
    config.motion.settle_s = 20.0;
    let platform = config.check()?;

    // Twelve positions were planned for 12 000 s; after five, and half of the sixth, a fuse went.
    let plan = StandardScheme::Faces12.schedule(12_000.0, &platform)?;
    let mut done = plan.positions()[..6].to_vec();
    done[5].dwell_s = (0.5 * done[5].dwell_s / 10.0).round() * 10.0;
    let done = Schedule::new(done)?;

    // Of the time, 9000 s remain to the test in all.
    let interrupted = platform.clone().interrupted_after(done)?;
    let evaluator = Evaluator::new(interrupted, Objective::default());
    let problem = SearchProblem {
        total_time_s: 9000.0,
        max_positions: 8,
        starts: 4,
        ..SearchProblem::default()
    };
    let found = search(&evaluator, &problem, &Control::default())?;

    let rest = Schedule::new(plan.positions()[6..].to_vec())?;
    let rest = rest.scaled_to(evaluator.platform(), 9000.0)?;
    let as_planned = evaluator.evaluate(&rest)?;
    println!("rest of the test, total 9000 s          RMS sigma, deg/h");
    println!(
        "the six positions left, dwells scaled   {:.6}",
        as_planned.rms_sigma_deg_per_h()
    );
    println!(
        "planned anew                            {:.6}",
        found.evaluation.rms_sigma_deg_per_h()
    );
    for p in found.schedule.positions() {
        let [alpha, beta, gamma] = p.position.to_deg();
        println!("{alpha:>9.3} {beta:>9.3} {gamma:>9.3} {:>7.0} s", p.dwell_s);
    }
    Ok(())
}
