//! Why oblique positions: the same time on axis-aligned and on oblique attitudes.
//!
//! The trace D_IX + D_IY + D_IZ gives the same ε^n at every position and is seen only through
//! the second derivative of the measurement, whatever the scheme. The differences of the input
//! coefficients are of order 1, but only at oblique positions: there ε_x^n separates them.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use scheme_opt::internals::drift::{DriftCoefficient, DriftKind};
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::schedule::standard::StandardScheme;

fn main() -> scheme_opt::Result<()> {
    let evaluator = Evaluator::new(PlatformConfig::default().check()?, Objective::default());
    println!("scheme            RMS sigma   input axes   others   (deg/h, 12000 s in all)");
    for name in ["faces-12", "axis-24", "cube-18", "icosahedron-12"] {
        let schedule = StandardScheme::from_name(name)?.schedule(12_000.0, evaluator.platform())?;
        let evaluation = evaluator.evaluate(&schedule)?;
        let sigma = evaluation.end.sigma_deg_per_h();
        let rms_of = |input: bool| {
            let mut sum = (0.0, 0.0);
            for c in DriftCoefficient::ALL {
                if (c.kind() == DriftKind::Input) == input {
                    sum = (sum.0 + sigma[c.index()].powi(2), sum.1 + 1.0);
                }
            }
            (sum.0 / sum.1).sqrt()
        };
        println!(
            "{name:<15} {:>11.5} {:>12.5} {:>8.5}",
            evaluation.rms_sigma_deg_per_h(),
            rms_of(true),
            rms_of(false),
        );
    }
    Ok(())
}
