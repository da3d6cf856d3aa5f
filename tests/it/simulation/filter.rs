//! What the filters claim, and what their linearisation bears.

use scheme_opt::internals::covariance::filter::step_by_step;
use scheme_opt::internals::motion::Timeline;
use scheme_opt::internals::platform::Repositioning;
use scheme_opt::internals::simulate::{
    FilterModel, PriorSize, Simulation, TruthModel, largest_without_optimism, sweep,
};

use super::{moving, optimised, platform, with};

#[test]
fn the_linear_filters_sigma_is_that_of_the_covariance_chain() {
    let frame_hold = platform(1.0, |c| c.motion.repositioning = Repositioning::FrameHold);
    let cases = [
        moving(),
        (platform(1.0, |_| {}), optimised()),
        (frame_hold, optimised()),
    ];
    for (platform, schedule) in cases {
        let timeline = Timeline::new(&platform.clone().into(), &schedule).unwrap();
        let expected = step_by_step(&platform, &timeline, &mut |_| {}).unwrap();
        let options = with(TruthModel::Nonlinear, FilterModel::Linear);
        let simulation = Simulation::new(&platform, &timeline, options).unwrap();
        let run = simulation.trajectory(&simulation.draw(1, 0), 1, 0);
        let end = run.samples.last().unwrap();
        let drift = end
            .drift_sigma_deg_per_h
            .component_div(&expected.sigma_deg_per_h());
        let psi = end
            .misalignment_n_sigma_arcsec()
            .component_div(&expected.misalignment_sigma_arcsec());
        for ratio in drift.iter().chain(psi.iter()) {
            assert!((ratio - 1.0).abs() < 1e-7, "{ratio}");
        }
    }
}

#[test]
fn each_filter_bears_what_its_linearisation_bears() {
    let platform = platform(0.01, |_| {});
    let timeline = Timeline::new(&platform.clone().into(), &optimised()).unwrap();
    // Drift of 0.15 and 0.08 °/h; larger and larger misalignments.
    let sizes = [0.01, 0.1, 0.3, 1.0, 3.0, 10.0].map(|misalignment_deg| PriorSize {
        misalignment_deg,
        drift_factor: 1.0,
    });
    let bears = FilterModel::ALL.map(|filter| {
        let options = with(TruthModel::Nonlinear, filter);
        let points = sweep(&platform, &timeline, options, &sizes, 60, 1).unwrap();
        for p in &points {
            println!(
                "{filter:?} {:?}: NEES {:.2}",
                p.size,
                p.nees.unwrap().average
            );
        }
        largest_without_optimism(&points).map_or(0.0, |p| p.size.misalignment_deg)
    });
    assert!(bears[0] < bears[1] && bears[1] < bears[2], "{bears:?}");
    assert!(bears[1] >= 0.3 && bears[2] >= 3.0, "{bears:?}");
}
