//! What a schedule can tell apart, and what to add to it.
//!
//! Six axis-aligned positions see every gyro up and down, and still do not tell the input-axis
//! coefficients apart at order 1; the analysis says so in words and names the position to add.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use scheme_opt::{StandardScheme, Study};

fn main() -> scheme_opt::Result<()> {
    let study = Study::embedded_default()?;
    let schedule = study.standard(StandardScheme::Faces6)?;
    let analysed = study.analyze(&schedule)?;
    let analysis = analysed.document();

    println!("coefficient  order  separability by order 1, by all");
    for c in &analysis.coefficients {
        let order = c
            .observability_order
            .map(|order| order.number().to_string());
        println!(
            "{:<12} {:>5} {:>15.4} {:>15.4}",
            c.name.name(),
            order.as_deref().unwrap_or("none"),
            c.separability_first_order,
            c.separability
        );
    }
    for advice in &analysis.advice {
        println!("{advice}");
    }
    if let Some(s) = &analysis.suggestion {
        println!(
            "Add ({:.1}, {:.1}, {:.1}) deg.",
            s.position.alpha_deg, s.position.beta_deg, s.position.gamma_deg
        );
        println!(
            "RMS sigma {:.6} becomes {:.6} deg/h.",
            s.before.rms_sigma_deg_per_h, s.after.rms_sigma_deg_per_h
        );
    }
    Ok(())
}
