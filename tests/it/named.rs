//! What cannot be told apart, over all parameters, by name.

use scheme_opt::internals::evaluate::{Evaluation, Evaluator, Objective};
use scheme_opt::internals::observability::named::NamedObservability;

use crate::battery::full::full_cases;

#[test]
fn explore() {
    for case in full_cases() {
        let evaluator = Evaluator::new(case.config.check().unwrap(), Objective::default());
        let at = std::time::Instant::now();
        let e: Evaluation = evaluator.evaluate(&case.schedule).unwrap();
        let named: &NamedObservability = e.named.as_ref().unwrap();
        println!(
            "== {} {:?}: rank {} of {} gap {:?}",
            case.name, at.elapsed(), named.rank, named.unknowns, named.gap
        );
        for u in &named.unobserved {
            println!("   {u}   [{}]", u.rests_on());
        }
        for w in &named.weak {
            println!("   weak {:.2e} {:.3}: {}", w.share, w.sigma, w.combination);
        }
        for v in &named.vertical {
            println!("   vertical {v}");
        }
        for p in &e.principal_drift {
            println!("   principal {:.4} {:.3} {}", p.sigma, p.vertical, p.combination);
        }
    }
}
