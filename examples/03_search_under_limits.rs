//! The recommended schedule of a stand with limits: a middle gimbal of ±60°, slews at 0.5 °/s,
//! 30 s of settling, four hours in all. Shows progress as the search reports it.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use std::sync::atomic::AtomicBool;

use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::search::{Control, SearchProblem, search};

fn main() -> scheme_opt::Result<()> {
    let mut config = PlatformConfig::default();
    config.gimbals.beta_deg = Some([-60.0, 60.0]);
    config.motion.slew_rate_deg_per_s = Some(0.5);
    config.motion.settle_s = 30.0;
    let evaluator = Evaluator::new(config.check()?, Objective::default());

    let problem = SearchProblem {
        total_time_s: 14_400.0,
        starts: 16,
        ..SearchProblem::default()
    };
    let cancel = AtomicBool::new(false);
    let progress = |p: &scheme_opt::internals::search::Progress| {
        println!("{:?}: {} of {}", p.phase, p.done, p.total);
    };
    let found = search(&evaluator, &problem, &Control::new(&cancel, &progress))?;

    println!("{}: {}", found.status.name(), found.reason);
    println!("  alpha      beta     gamma   dwell, s");
    for p in found.schedule.positions() {
        let [alpha, beta, gamma] = p.position.to_deg();
        println!("{alpha:>9.3} {beta:>9.3} {gamma:>9.3} {:>9.0}", p.dwell_s);
    }
    println!(
        "RMS sigma {:.6} deg/h in {:.0} s, of which {:.0} s moving and settling",
        found.evaluation.rms_sigma_deg_per_h(),
        found.evaluation.total_time_s,
        found.evaluation.overhead_s,
    );
    Ok(())
}
