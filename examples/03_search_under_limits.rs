//! The recommended schedule of a stand with limits: a middle gimbal of ±60°, slews at 0.5 °/s,
//! 30 s of settling, four hours in all. Shows progress as the search reports it.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use scheme_opt::{Control, Study};

const STAND: &str = "
[gimbals]
beta_deg = [-60, 60]

[motion]
slew_rate_deg_per_s = 0.5
settle_s = 30

[objective]
total_time_s = 14400

[search]
starts = 16
";

fn main() -> scheme_opt::Result<()> {
    let study = Study::from_toml(STAND)?;
    let control =
        Control::default().with_progress(|p| println!("{:?}: {} of {}", p.phase, p.done, p.total));
    let found = study.search(&control)?;

    let document = found.document();
    println!("{}: {}", document.status, document.reason);
    println!("  alpha      beta     gamma   dwell, s");
    for p in found.schedule().positions() {
        let [alpha, beta, gamma] = p.position.to_deg();
        println!("{alpha:>9.3} {beta:>9.3} {gamma:>9.3} {:>9.0}", p.dwell_s);
    }
    println!(
        "RMS sigma {:.6} deg/h in {:.0} s, of which {:.0} s moving and settling",
        document.evaluation.rms_sigma_deg_per_h,
        document.evaluation.total_time_s,
        document.evaluation.overhead_s,
    );
    Ok(())
}
