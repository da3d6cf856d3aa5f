//! The full error model against an independent dense filter in 400 bits.

use scheme_opt::internals::covariance::CovarianceModel;
use scheme_opt::internals::covariance::filter::full_step_by_step;
use scheme_opt::internals::covariance::full::FullCovariance;
use scheme_opt::internals::model::{Parameter, Role};
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::Platform;

use crate::support::{FullCase, full_cases};

/// Largest relative difference of a number from the reference, and of which.
struct Worst {
    of: String,
    difference: f64,
}

impl Worst {
    fn none() -> Self {
        Self {
            of: String::new(),
            difference: 0.0,
        }
    }

    fn take(&mut self, of: &str, found: f64, expected: f64) {
        let difference = (found / expected - 1.0).abs();
        if difference.is_nan() || difference > self.difference {
            self.difference = difference;
            self.of = format!("{of}: {found} for {expected}");
        }
    }
}

fn of_route(case: &FullCase, platform: &Platform, found: &FullCovariance) -> Worst {
    let mut worst = Worst::none();
    let estimated = |p: &&Parameter| p.role == Role::Estimated;
    let parameters: Vec<_> = platform
        .errors()
        .parameters()
        .iter()
        .filter(estimated)
        .collect();
    assert_eq!(parameters.len(), case.sigma.len(), "{}", case.name);
    let claimed = match case.claimed_sigma.is_empty() {
        true => &case.sigma,
        false => &case.claimed_sigma,
    };
    let (truth, claim) = (found.sigma(), found.claimed_sigma());
    for (k, p) in parameters.iter().enumerate() {
        worst.take(p.name, truth[k], case.sigma[p.name]);
        worst.take(p.name, claim[k], claimed[p.name]);
    }
    let psi = found.end.misalignment_sigma_arcsec();
    for (axis, expected) in case.misalignment_arcsec.iter().flatten().enumerate() {
        worst.take(["psi_nx", "psi_ny", "psi_nz"][axis], psi[axis], *expected);
    }
    let rms = (found.end.coefficients.trace() / 12.0).sqrt();
    worst.take("rms", rms, case.rms_sigma_deg_per_h);
    for (group, expected) in &case.ignored {
        let of_group = found.budget.iter().find(|g| g.group == group);
        let error = of_group.unwrap().rms_error_deg_per_h();
        if (error - expected).abs() > 1e-9 {
            worst.take(group, error, *expected);
        }
    }
    worst
}

fn check(case: &FullCase, route: &str, platform: &Platform, found: &FullCovariance) {
    let worst = of_route(case, platform, found);
    println!(
        "{} by {route}: {:.1e} {}",
        case.name, worst.difference, worst.of
    );
    assert!(
        worst.difference <= 1e-6,
        "{} by {route}: {}",
        case.name,
        worst.of
    );
}

#[test]
fn the_step_by_step_filter_agrees_to_1e_6() {
    let cases = full_cases();
    assert_eq!(cases.len(), 11);
    for case in cases {
        let platform = case.config.check().unwrap();
        let timeline = Timeline::new(&platform, &case.schedule).unwrap();
        assert!((timeline.total_time_s() - case.total_time_s).abs() < 1e-3);
        let found = full_step_by_step(&platform, &timeline).unwrap();
        check(&case, "the filter", &platform, &found);
    }
}

#[test]
fn the_chain_agrees_to_1e_6() {
    for case in full_cases() {
        let platform = case.config.check().unwrap();
        let timeline = Timeline::new(&platform, &case.schedule).unwrap();
        let model = CovarianceModel::new(&platform);
        let found = model.full_covariance(&timeline).unwrap();
        check(&case, "the chain", &platform, &found);
    }
}
