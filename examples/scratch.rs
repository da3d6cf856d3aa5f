use scheme_opt::{evaluate::*, platform::*, search::*};
use std::sync::atomic::AtomicBool;
fn main() {
    let starts: usize = std::env::args().nth(1).and_then(|s| s.parse().ok()).unwrap_or(64);
    let tol: f64 = std::env::args().nth(2).and_then(|s| s.parse().ok()).unwrap_or(2e-4);
    for seed in 1..=5 {
        let e = Evaluator::new(PlatformConfig::default().check().unwrap(), Objective::default());
        let cancel = AtomicBool::new(false);
        let t = std::time::Instant::now();
        let o = search(&e, &SearchProblem { seed, starts, position_tolerance: tol, ..Default::default() }, &Control::new(&cancel, &|_| {})).unwrap();
        println!("seed {seed}: {:.6} K={} {:?} agree {:.1e} sepmin {:.4} {:.2?}", o.evaluation.rms_sigma_deg_per_h(), o.schedule.positions().len(), o.counters, o.evaluation.agreement, o.evaluation.score.least_separability, t.elapsed());
        let gap: Vec<String> = o.schedule.positions().iter().map(|p| format!("{:.0}", p.dwell_s)).collect();
        println!("   {}", gap.join(" "));
    }
}
