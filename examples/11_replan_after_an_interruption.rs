//! A test was interrupted halfway: what is the best that can be done with the time that is left?
//!
//! What the filter knows so far (misalignment, drift, and how they are correlated) is the prior
//! of the rest: the study is told what has been done, and the search plans from there. Compared
//! with going on by the old plan as far as the time allows.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use scheme_opt::{
    ComparisonOptions, Contender, Control, Schedule, StandardScheme, Study, StudyConfig,
};

fn main() -> scheme_opt::Result<()> {
    let mut config = StudyConfig::default();
    config.platform.motion.slew_rate_deg_per_s = Some(1.0.into());
    config.platform.motion.settle_s = 20.0;
    config.search.max_positions = Some(8);
    config.search.starts = 4;

    // Twelve positions were planned for 12 000 s; after five, and half of the sixth, a fuse went.
    let plan = Study::from_config(config.clone())?.standard(StandardScheme::Faces12)?;
    let mut done = plan.positions()[..6].to_vec();
    done[5].dwell_s = (0.5 * done[5].dwell_s / 10.0).round() * 10.0;

    // Of the time, 9000 s remain to the test in all.
    config.objective.total_time_s = 9000.0;
    let study = Study::from_config(config)?.after(Schedule::new(done)?)?;
    let found = study.search(&Control::default())?;

    let rest = Schedule::new(plan.positions()[6..].to_vec())?;
    let rest = Contender::schedule("the six positions left, dwells scaled", rest);
    let as_planned = study.compare(&[rest], &ComparisonOptions::default())?;
    println!("rest of the test, total 9000 s          RMS sigma, deg/h");
    for record in &as_planned.document().schedules {
        println!("{:<39} {:.6}", record.name, record.rms_sigma_deg_per_h);
    }
    println!(
        "planned anew                            {:.6}",
        found.document().evaluation.rms_sigma_deg_per_h
    );
    for p in found.schedule().positions() {
        let [alpha, beta, gamma] = p.position.to_deg();
        println!("{alpha:>9.3} {beta:>9.3} {gamma:>9.3} {:>7.0} s", p.dwell_s);
    }
    Ok(())
}
