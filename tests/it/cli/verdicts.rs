//! What a search says first: what fits into the time, what stays unobservable, what is known.

use serde_json::Value;

use super::{Desk, SCHEDULE};

/// The least time with a start attitude, and a little more: nothing is refused that can be done.
#[test]
fn a_start_leaves_time_for_staying_there() {
    let desk = Desk::new();
    for (extra, least_s) in [
        ("", 60.0),
        ("return_to_start = true\n", 60.0),
        ("return_to_start = true\nsettle_s = 25\n", 85.0),
        ("measure_moves = true\nsettle_s = 25\n", 60.0),
        ("min_dwell_s = 0\n", 10.0),
    ] {
        desk.write(
            "start.toml",
            format!(
                "[motion]\nstart_deg = [10, 20, 30]\nslew_rate_deg_per_s = 1\n{extra}\
                 [search]\nstarts = 2\n"
            ),
        );
        for more_s in [0.0, 7.0, 90.0, 170.0, 340.0] {
            let total_s = (least_s + more_s).to_string();
            let search = ["search", "start.toml", "--json", "-q", "--total-time-s"];
            let run = desk.run(&[&search[..], &[&total_s]].concat());
            let found: Value = serde_json::from_str(&run.stdout).unwrap();
            // So short a test observes everything only while the platform turns and measures, or in
            // dwells of a few periods.
            let missed = found["unobservable"]["by_this_schedule"]
                .as_array()
                .unwrap();
            let code = i32::from(!missed.is_empty());
            assert_eq!(run.code, Some(code), "{extra}{total_s}: {}", run.stderr);
            let is_quick = extra.contains("measure_moves") || extra.contains("min_dwell_s = 0");
            assert!(!missed.is_empty() || is_quick);
            let taken_s = found["evaluation"]["total_time_s"].as_f64().unwrap();
            assert!(taken_s <= least_s + more_s + 1e-6, "{extra}{total_s}");
            let start = &found["schedule"]["positions"][0];
            if more_s == 0.0 {
                assert_eq!(start["alpha_deg"], 10.0);
                assert_eq!(found["schedule"]["positions"].as_array().unwrap().len(), 1);
            }
            if more_s >= 170.0 {
                // With time to move, positions it moves to; one that it turns to while it measures
                // may be enough.
                let count = found["schedule"]["positions"].as_array().unwrap().len();
                let turns = extra.contains("measure_moves");
                assert!(count > 1 || turns, "{extra}{total_s}: {count}");
            }
        }
    }
    desk.write(
        "start.toml",
        "[motion]\nstart_deg = [10, 20, 30]\nslew_rate_deg_per_s = 1\nsettle_s = 25\n",
    );
    let run = desk.run(&["search", "start.toml", "--total-time-s", "84"]);
    assert_eq!(run.code, Some(1));
    for part in [
        "at least 85 s",
        "25 s to settle",
        "60 s for the shortest dwell",
    ] {
        assert!(run.stderr.contains(part), "{}", run.stderr);
    }
}

#[test]
fn an_index_table_leaves_time_for_staying_too() {
    let desk = Desk::new();
    for step in [0.5, 7.0, 30.0] {
        for time in [60, 61, 100, 200] {
            desk.write(
                "table.toml",
                format!(
                    "[gimbals]\nstep_deg = {step}\n\
                     [motion]\nstart_deg = [210, 0, -210]\nslew_rate_deg_per_s = 0.3\n\
                     return_to_start = true\n[objective]\ntotal_time_s = {time}\n\
                     [search]\nstarts = 2\n"
                ),
            );
            let run = desk.run(&["search", "table.toml", "-q"]);
            assert_eq!(run.code, Some(1), "{step} {time}: {}", run.stderr);
            assert!(run.stdout.contains("RMS sigma"), "{}", run.stdout);
        }
    }
}

/// The stand whose outer two gimbals do not turn.
const BLIND: &str = "[gimbals]\nalpha_deg = [0, 0]\nbeta_deg = [0, 0]\n\
                     [search]\nstarts = 2\nmax_positions = 6\n[objective]\n";

#[test]
fn what_a_stand_cannot_show_is_said_first() {
    let desk = Desk::new();
    desk.write("blind.toml", BLIND);
    let run = desk.run(&["search", "blind.toml", "-q"]);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert!(
        run.stdout
            .starts_with("NOT OBSERVABLE on this stand, whatever the schedule: D_"),
        "{}",
        run.stdout
    );
    assert!(!run.stdout.contains("as good as"), "{}", run.stdout);
    let result = desk.json("scheme-opt-out/result.json");
    assert_eq!(result["status"], "infeasible");
    let reason = result["reason"].as_str().unwrap();
    assert!(reason.starts_with("no schedule on this stand can observe D_"));
    let names: Vec<&str> = result["unobservable"]["on_this_stand"]
        .as_array()
        .unwrap()
        .iter()
        .map(|n| n.as_str().unwrap())
        .collect();
    assert!(!names.is_empty());
    // Their sigma says the same.
    for c in result["evaluation"]["coefficients"].as_array().unwrap() {
        let (sigma, prior) = (&c["sigma_deg_per_h"], &c["prior_sigma_deg_per_h"]);
        let stays = sigma.as_f64().unwrap() > 0.1 * prior.as_f64().unwrap();
        let name = c["name"].as_str().unwrap();
        assert_eq!(stays, names.contains(&name), "{name}: {sigma} of {prior}");
    }
    let page = desk.text("scheme-opt-out/report.html");
    assert!(page.contains("NOT OBSERVABLE on this stand"));

    // Accepted, all of them or all but one.
    let accept = |names: &[&str]| format!("{BLIND}accept_unobservable = {names:?}\n");
    desk.write("accepted.toml", accept(&names));
    let run = desk.run(&["search", "accepted.toml", "-q"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(
        run.stdout
            .contains("accepted by objective.accept_unobservable"),
        "{}",
        run.stdout
    );
    assert_eq!(
        desk.json("scheme-opt-out/result.json")["status"],
        "converged"
    );
    desk.write("accepted.toml", accept(&names[1..]));
    let run = desk.run(&["search", "accepted.toml", "-q"]);
    assert_eq!(run.code, Some(1), "{}", run.stdout);
    assert!(run.stdout.contains(names[0]));

    // A weight of zero asks for nothing.
    let weights: Vec<String> = names.iter().map(|n| format!("{n} = 0\n")).collect();
    let weighted = format!("{BLIND}[objective.weights]\n{}", weights.concat());
    desk.write("weighted.toml", weighted);
    let run = desk.run(&["search", "weighted.toml", "-q"]);
    assert_eq!(run.code, Some(0), "{}", run.stdout);
}

#[test]
fn at_a_pole_the_sum_of_the_input_drifts_is_named() {
    let desk = Desk::new();
    desk.write(
        "pole.toml",
        "[site]\nlatitude_deg = 90\n[search]\nstarts = 2\n",
    );
    for mode in ["accuracy", "pareto"] {
        let run = desk.run(&["search", "pole.toml", "-q", "--mode", mode]);
        assert_eq!(run.code, Some(1), "{}", run.stderr);
        assert!(run.stdout.contains("D_IX + D_IY + D_IZ"), "{}", run.stdout);
        let result = desk.json("scheme-opt-out/result.json");
        assert_eq!(result["status"], "infeasible");
        assert_eq!(
            result["unobservable"]["on_this_stand"],
            serde_json::json!(["D_IX", "D_IY", "D_IZ"])
        );
    }
}

/// Where only exactly known coefficients count, the criterion is 0 before any test: the same answer
/// by every command.
#[test]
fn a_criterion_that_is_known_before_any_test_is_said_to_be() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    let known = "[prior]\nconstant_drift_deg_per_h = 0\n";
    let all_known = "[prior]\nconstant_drift_deg_per_h = 0\n\
                     g_sensitive_drift_deg_per_h_per_g = 0\n";
    let weights = "[objective.weights]\ndefault = 0\nD_FX = 1\nD_FY = 2\n";
    let spec = "[objective.spec_deg_per_h]\nD_FX = 0.01\n";
    for (platform, criterion, modes) in [
        (
            format!("{known}{weights}"),
            "a",
            &["accuracy", "pareto"][..],
        ),
        (
            format!("{known}{spec}"),
            "max-ratio",
            &["accuracy", "time", "pareto"],
        ),
        (all_known.to_owned(), "a", &["accuracy", "pareto"]),
        (all_known.to_owned(), "d", &["accuracy"]),
        (all_known.to_owned(), "e", &["accuracy"]),
        (
            format!("{known}[objective.score]\nseparability_weight = 0.1\n{weights}"),
            "a",
            &["accuracy", "pareto"],
        ),
    ] {
        desk.write("known.toml", format!("{platform}[search]\nstarts = 2\n"));
        let criterion = ["--criterion", criterion];
        for mode in modes {
            let search = ["search", "known.toml", "-q", "--mode", mode];
            let run = desk.run(&[&search[..], &criterion].concat());
            assert_eq!(
                run.code,
                Some(0),
                "{platform}{mode}: {}{}",
                run.stdout,
                run.stderr
            );
            assert!(
                run.stdout.starts_with("No test is needed: criterion "),
                "{}",
                run.stdout
            );
            assert!(!run.stdout.contains("inf"), "{}", run.stdout);
            let result = desk.json("scheme-opt-out/result.json");
            assert_eq!(result["evaluation"]["score"]["criterion"], 0.0);
            assert_eq!(result["status"], "converged");
        }
        let bound = desk.done(&[&["bound", "known.toml"], &criterion[..]].concat());
        assert!(bound.contains("is 0 before any test"), "{bound}");
        let given = ["evaluate", "-s", "s.csv", "-p", "known.toml"];
        let evaluated = desk.done(&[&given[..], &criterion].concat());
        assert!(evaluated.contains("is 0 before any"), "{evaluated}");
    }
}
