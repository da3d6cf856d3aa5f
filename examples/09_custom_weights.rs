//! Weights: when some coefficients matter more than others.
//!
//! A vehicle that flies level feels the constant drifts far more than the g-sensitive ones; the
//! schedule that serves it best is another than the one with the best average.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use scheme_opt::{Control, DriftCoefficient, DriftKind, Study, StudyConfig};

fn main() -> scheme_opt::Result<()> {
    let mut equal = StudyConfig::default();
    equal.objective.total_time_s = 6000.0;
    equal.search.max_positions = Some(12);
    equal.search.starts = 4;

    let mut weighted = equal.clone();
    for c in DriftCoefficient::ALL {
        if c.kind() == DriftKind::Constant {
            weighted.objective.weights.coefficients.insert(c, 25.0);
        }
    }

    for (name, config) in [
        ("equal weights", equal),
        ("constant drifts 25 times", weighted),
    ] {
        let found = Study::from_config(config)?.search(&Control::default())?;
        let largest_of = |constant: bool| {
            let coefficients = found.document().evaluation.coefficients.iter();
            coefficients
                .filter(|c| (c.name.kind() == DriftKind::Constant) == constant)
                .fold(0.0_f64, |largest, c| largest.max(c.sigma_deg_per_h))
        };
        println!(
            "{name}: D_F {:.6}, the rest {:.6} deg/h (largest of each)",
            largest_of(true),
            largest_of(false)
        );
    }
    Ok(())
}
