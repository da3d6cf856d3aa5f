//! Weights: when some coefficients matter more than others.
//!
//! A vehicle that flies level feels the constant drifts far more than the g-sensitive ones; the
//! schedule that serves it best is another than the one with the best average.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use std::sync::atomic::AtomicBool;

use scheme_opt::internals::criterion::Criterion;
use scheme_opt::internals::drift::{CoefficientVector, DriftCoefficient, DriftKind};
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::search::{Control, SearchProblem, search};

fn main() -> scheme_opt::Result<()> {
    let mut weights = CoefficientVector::repeat(1.0);
    for c in DriftCoefficient::ALL {
        if c.kind() == DriftKind::Constant {
            weights[c.index()] = 25.0;
        }
    }
    let problem = SearchProblem {
        total_time_s: 6000.0,
        max_positions: 12,
        starts: 4,
        ..SearchProblem::default()
    };
    for (name, criterion) in [
        ("equal weights", Criterion::rms()),
        ("constant drifts 25 times", Criterion::A { weights }),
    ] {
        let objective = Objective {
            criterion,
            ..Objective::default()
        };
        let evaluator = Evaluator::new(PlatformConfig::default().check()?, objective);
        let found = search(&evaluator, &problem, &Control::default())?;
        let sigma = found.evaluation.end.sigma_deg_per_h();
        println!(
            "{name}: D_F {:.6}, the rest {:.6} deg/h (largest of each)",
            sigma.rows(0, 3).max(),
            sigma.rows(3, 9).max()
        );
    }
    Ok(())
}
