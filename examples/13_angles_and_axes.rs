//! What the gimbals' angles mean on a stand, positions to check it by, and the picture of docs/angles.md.
//!
//! ```sh
//! cargo run --release --example 13_angles_and_axes -- docs/figures
//! ```

#![allow(clippy::print_stdout, reason = "an example shows its result")]

use std::path::Path;

use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::report::angles;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let platform = PlatformConfig::default().check()?;
    for sentence in angles::convention(&platform) {
        println!("{sentence}");
    }
    for check in platform.check_positions() {
        let [alpha, beta, gamma] = check.position.to_deg();
        let [x, y, z] = check.specific_force_g;
        println!("({alpha}, {beta}, {gamma}) deg: f = ({x:.3}, {y:.3}, {z:.3}) g");
    }
    if let Some(directory) = std::env::args().nth(1) {
        let file = Path::new(&directory).join("angles.svg");
        std::fs::write(&file, angles::picture(&platform))?;
        println!("written: {}", file.display());
    }
    Ok(())
}
