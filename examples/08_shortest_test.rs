//! The shortest test in which every coefficient meets its specification, and how short a test
//! could conceivably be.

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use scheme_opt::{Control, Study};

/// 6000 s are the longest acceptable.
const TASK: &str = "
[objective]
mode = \"time\"
total_time_s = 6000

[objective.spec_deg_per_h]
default = 0.005

[search]
max_positions = 11
starts = 2
";

fn main() -> scheme_opt::Result<()> {
    let study = Study::from_toml(TASK)?;
    let bound = study.bound()?;
    let found = study.search(&Control::default())?;

    let document = found.document();
    println!("{}: {}", document.status, document.reason);
    println!(
        "{:.0} s with {} positions; what no schedule can beat: {:.0?} s",
        document.evaluation.total_time_s,
        found.schedule().positions().len(),
        bound.document().minimum_time_s,
    );
    Ok(())
}
