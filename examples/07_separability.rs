//! What a schedule can tell apart, and what to add to it.
//!
//! Six axis-aligned positions see every gyro up and down, and still do not tell the input-axis
//! coefficients apart at order 1; the analysis says so in words and names the position to add.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use scheme_opt::internals::drift::DriftCoefficient;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::observability::analysis::Analysis;
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::schedule::standard::StandardScheme;

fn main() -> scheme_opt::Result<()> {
    let evaluator = Evaluator::new(PlatformConfig::default().check()?, Objective::default());
    let schedule = StandardScheme::Faces6.schedule(12_000.0, evaluator.platform())?;
    let evaluation = evaluator.evaluate(&schedule)?;
    let analysis = Analysis::new(&evaluator, &schedule, &evaluation)?;

    println!("coefficient  order  separability by order 1, by all");
    let o = &evaluation.observability;
    for c in DriftCoefficient::ALL {
        let i = c.index();
        let order = o.orders[i].map_or_else(|| "none".to_owned(), |o| o.number().to_string());
        println!(
            "{:<12} {order:>5} {:>15.4} {:>15.4}",
            c.name(),
            o.separability_first_order[i],
            o.separability[i]
        );
    }
    for advice in &analysis.advice {
        println!("{advice}");
    }
    if let Ok(s) = &analysis.suggestion {
        let [alpha, beta, gamma] = s.position.to_deg();
        println!("Add ({alpha:.1}, {beta:.1}, {gamma:.1}) deg.");
        println!(
            "RMS sigma {:.6} becomes {:.6} deg/h.",
            s.before.rms_sigma_deg_per_h, s.after.rms_sigma_deg_per_h
        );
    }
    Ok(())
}
