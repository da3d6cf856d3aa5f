//! Why oblique positions: the same time on axis-aligned and on oblique attitudes.
//!
//! The trace D_IX + D_IY + D_IZ gives the same ε^n at every position and is seen only through
//! the second derivative of the measurement, whatever the scheme. The differences of the input
//! coefficients are of order 1, but only at oblique positions: there ε_x^n separates them.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use scheme_opt::{DriftKind, StandardScheme, Study};

fn main() -> scheme_opt::Result<()> {
    let study = Study::embedded_default()?;
    println!("scheme            RMS sigma   input axes   others   (deg/h, 12000 s in all)");
    for name in ["faces-12", "axis-24", "cube-18", "icosahedron-12"] {
        let schedule = study.standard(StandardScheme::from_name(name)?)?;
        let evaluated = study.evaluate(&schedule)?;
        let rms_of = |input: bool| {
            let coefficients = evaluated.document().coefficients.iter();
            let chosen = coefficients.filter(|c| (c.name.kind() == DriftKind::Input) == input);
            let variances: Vec<f64> = chosen.map(|c| c.sigma_deg_per_h.powi(2)).collect();
            (variances.iter().sum::<f64>() / variances.len() as f64).sqrt()
        };
        println!(
            "{name:<15} {:>11.5} {:>12.5} {:>8.5}",
            evaluated.rms_sigma_deg_per_h(),
            rms_of(true),
            rms_of(false),
        );
    }
    Ok(())
}
