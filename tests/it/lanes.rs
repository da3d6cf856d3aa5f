//! A whole search by each width of vector instructions ends with the same bytes.

use scheme_opt::internals::config::StudyConfig;
use scheme_opt::internals::evaluate::{Evaluator, Objective};
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::results::{Inputs, ResultDocument};
use scheme_opt::internals::schedule::file::{to_csv, to_json};
use scheme_opt::internals::search::{Control, SearchProblem, search};

/// What a search writes, its evaluator kept to `lanes`.
fn written(platform: &PlatformConfig, problem: &SearchProblem, lanes: usize) -> [String; 3] {
    let evaluator =
        Evaluator::new(platform.check().unwrap(), Objective::default()).with_most_lanes(lanes);
    let outcome = search(&evaluator, problem, &Control::default()).unwrap();
    let inputs = Inputs {
        config: StudyConfig::default(),
        defaulted: Vec::new(),
        done: None,
    };
    let objective = evaluator.objective();
    let document = ResultDocument::new(&outcome, &[], objective, problem.seed, None, &inputs);
    [
        to_json(&outcome.schedule),
        to_csv(&outcome.schedule),
        document.to_json().unwrap(),
    ]
}

/// One, four and eight lanes: plain numbers, AVX2, AVX-512 (as far as the processor has them).
fn assert_same_bytes(problem: &SearchProblem, change: impl FnOnce(&mut PlatformConfig)) {
    let mut platform = PlatformConfig::default();
    change(&mut platform);
    let plain = written(&platform, problem, 1);
    assert!(plain[2].contains("\"status\": \"converged\""));
    for lanes in [4, 8] {
        assert!(written(&platform, problem, lanes) == plain, "{lanes} lanes");
    }
}

fn problem() -> SearchProblem {
    SearchProblem {
        starts: 3,
        max_positions: 12,
        ..SearchProblem::default()
    }
}

#[test]
fn a_default_search_has_the_same_bytes_in_any_number_of_lanes() {
    assert_same_bytes(&problem(), |_| {});
}

#[test]
fn a_search_with_slews_has_the_same_bytes_in_any_number_of_lanes() {
    assert_same_bytes(&problem(), |c| {
        c.motion.slew_rate_deg_per_s = Some(0.5.into());
        c.motion.settle_s = 20.0;
    });
}

#[test]
fn a_search_on_an_index_table_has_the_same_bytes_in_any_number_of_lanes() {
    assert_same_bytes(&problem(), |c| {
        c.gimbals.step_deg = Some(30.0);
        c.motion.slew_rate_deg_per_s = Some(2.0.into());
    });
}
