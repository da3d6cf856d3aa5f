//! What the commands do with good input, and how they end.

use std::process::{Command, Stdio};

use scheme_opt::internals::schedule::file;
use serde_json::Value;

use super::documents::{has_evaluation_fields, has_result_fields, sigmas, strings, text};
use super::{Desk, RESULTS, Run, SCHEDULE, names};

#[test]
fn help_and_version_are_data() {
    let desk = Desk::new();
    let help = desk.done(&["--help"]);
    for part in ["search", "evaluate", "init", "standard", "130"] {
        assert!(help.contains(part), "{part}");
    }
    assert!(desk.done(&["--version"]).starts_with("scheme-opt "));
    for command in ["search", "evaluate", "init", "standard"] {
        assert!(
            desk.done(&[command, "--help"])
                .contains("Usage: scheme-opt")
        );
    }
}

#[test]
fn init_writes_a_platform_file_that_search_takes() {
    let desk = Desk::new();
    assert_eq!(desk.done(&["init"]), "");
    let written = desk.text("platform.toml");
    assert_eq!(desk.done(&["init", "-"]), written);
    desk.write("platform.toml", "mine");
    let run = desk.run(&["init"]);
    run.refused(&["platform.toml", "exists", "--force"]);
    assert_eq!(desk.text("platform.toml"), "mine");
    desk.done(&["init", "--force", "--quiet"]);
    assert_eq!(desk.text("platform.toml"), written);
    desk.done(&["search", "platform.toml", "--starts", "1", "-o", "out"]);
    assert_eq!(desk.files(), ["out", "platform.toml"]);
    let defaulted = desk.json("out/result.json")["defaulted"].clone();
    let defaulted: Vec<&str> = defaulted.as_array().unwrap().iter().map(text).collect();
    assert!(!defaulted.contains(&"site.latitude_deg"), "{defaulted:?}");
}

#[test]
fn standard_lists_and_writes_the_schemes() {
    let desk = Desk::new();
    let list = desk.done(&["standard"]);
    assert!(list.contains("icosahedron-12") && list.lines().all(|l| l.chars().count() <= 80));
    let list: Value = serde_json::from_str(&desk.done(&["standard", "--json"])).unwrap();
    assert_eq!(list["schema"], "scheme-opt/standard/1");
    assert_eq!(list["schemes"][0]["name"], "faces-6");

    let json = desk.done(&["standard", "edges-12", "--total-time-s", "6000"]);
    let csv = desk.done(&[
        "standard",
        "edges-12",
        "--total-time-s",
        "6000",
        "--format",
        "csv",
    ]);
    let schedule = file::from_json(&json).unwrap();
    assert_eq!(schedule, file::from_csv(&csv).unwrap());
    assert_eq!(schedule.positions().len(), 12);
    assert!((schedule.dwell_sum_s() - 6000.0).abs() < 1e-6);
    for name in ["e.csv", "e.json"] {
        let args = ["standard", "edges-12", "--total-time-s", "6000", "-o", name];
        assert_eq!(desk.done(&args), "");
    }
    assert_eq!((desk.text("e.csv"), desk.text("e.json")), (csv, json));
}

#[test]
fn a_scheme_the_platform_cannot_take_is_infeasible() {
    let desk = Desk::new();
    desk.write("p.toml", "[gimbals]\nalpha_deg = [-10, 10]\n");
    let run = desk.run(&["standard", "faces-6", "--platform", "p.toml"]);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert!(run.stderr.contains("faces-6") && run.stdout.is_empty());
}

#[test]
fn evaluate_prints_tables_that_fit_and_the_documented_json() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write(
        "p.toml",
        "[motion]\nslew_rate_deg_per_s = 0.5\nsettle_s = 30\n\
         [objective.spec_deg_per_h]\ndefault = 0.005\nD_IX = 1e-6\n",
    );
    let report = desk.done(&["evaluate", "-s", "s.csv", "-p", "p.toml"]);
    for part in [
        "RMS sigma",
        "deg/h",
        "arcsec",
        "D_IZ",
        "psi_ny",
        "unknowns",
        "missed",
        "+ 30 s",
    ] {
        assert!(report.contains(part), "{part} in:\n{report}");
    }
    assert!(report.lines().all(|l| l.chars().count() <= 80), "{report}");

    let args = [
        "evaluate",
        "--schedule",
        "s.csv",
        "--platform",
        "p.toml",
        "--json",
    ];
    let document: Value = serde_json::from_str(&desk.done(&args)).unwrap();
    has_evaluation_fields(&document);
    let coefficients = document["coefficients"].as_array().unwrap();
    assert_eq!(coefficients[3]["spec_deg_per_h"], 1e-6);
    assert!(coefficients[3].get("time_to_spec_s").is_none());
    assert!(coefficients[0]["time_to_spec_s"].as_f64().unwrap() > 0.0);
    assert!(document["overhead_s"].as_f64().unwrap() > 150.0);
    assert_eq!(document["inputs"]["motion"]["settle_s"], 30.0);
    assert_eq!(document["inputs"]["site"]["latitude_deg"], 28.2);
    assert!(strings(&document["defaulted"]).contains(&"site.latitude_deg"));
    assert!(!strings(&document["defaulted"]).contains(&"motion.settle_s"));
}

/// A platform with errors that the filter estimates and some that it does not know of.
const FULL: &str = "[motion]\nslew_rate_deg_per_s = 0.5\nsettle_s = 30\n\
     [errors]\ntorquer_scale_factor_ppm = 1000\ntorquer_misalignment_arcsec = [60, 60, 30]\n\
     quadratic_drift_deg_per_h_per_g2 = 0.1\nlocal_gravity_ug = 10\n\
     [errors.parameter]\nK_1X = 100\n\
     [errors.considered]\naccelerometer_cross_coupling_ug_per_g2 = 20\n\
     [gyro.output_axis]\nX = \"+y\"\n[azimuth]\nnoise_arcsec = 20\n";

#[test]
fn evaluate_shows_every_parameter_by_group_and_the_budget() {
    let desk = Desk::new();
    desk.done(&["standard", "icosahedron-12", "-o", "s.json"]);
    desk.write("p.toml", FULL);
    let report = desk.done(&["evaluate", "-s", "s.json", "-p", "p.toml"]);
    for part in [
        "torquer_misalignment_arcsec",
        "accelerometer_cross_coupling_ug_per_g2, not known to the filter",
        "T_ZY",
        "deg/h/g2",
        "ppm",
        "ug/g2",
        "claimed",
        "Ignored already, and part of every sigma:",
    ] {
        assert!(report.contains(part), "{part} in:\n{report}");
    }
    assert!(report.lines().all(|l| l.chars().count() <= 80), "{report}");

    let args = ["evaluate", "-s", "s.json", "-p", "p.toml", "--json"];
    let document: Value = serde_json::from_str(&desk.done(&args)).unwrap();
    has_evaluation_fields(&document);
    let parameters = document["parameters"].as_array().unwrap();
    // Twelve, 15 quadratic, 3 + 6 torquer, K_1X and G; six considered.
    assert_eq!(parameters.len(), 12 + 15 + 9 + 2 + 6);
    let of = |name: &str| parameters.iter().find(|p| p["name"] == name).unwrap();
    for (k, coefficient) in document["coefficients"]
        .as_array()
        .unwrap()
        .iter()
        .enumerate()
    {
        assert_eq!(parameters[k]["name"], coefficient["name"]);
        assert_eq!(parameters[k]["sigma"], coefficient["sigma_deg_per_h"]);
        let order = &coefficient["observability_order"];
        assert_eq!(parameters[k]["observability_order"], *order);
        let claimed = parameters[k]["claimed_sigma"].as_f64().unwrap();
        assert!(claimed < parameters[k]["sigma"].as_f64().unwrap());
    }
    let t = of("T_ZX");
    assert_eq!(
        (&t["unit"], &t["role"]),
        (&"arcsec".into(), &"estimated".into())
    );
    assert_eq!(t["group"], "torquer_misalignment_arcsec");
    assert_eq!(t["prior_sigma"], 30.0);
    assert_eq!(t["observability_order"], 0);
    assert!(t["separability"].as_f64().unwrap() > 0.0);
    let k = of("K_IPZ");
    assert_eq!(
        (&k["role"], &k["sigma"]),
        (&"considered".into(), &k["prior_sigma"])
    );
    assert!(k["separability"].is_null() && k.get("claimed_sigma").is_none());

    let budget = document["budget"].as_array().unwrap();
    assert_eq!(budget.len(), 6);
    let rms_sigma = document["rms_sigma_deg_per_h"].as_f64().unwrap();
    for group in budget {
        let error = group["rms_error_if_ignored_deg_per_h"].as_f64().unwrap();
        let ratio = group["ratio"].as_f64().unwrap();
        assert!((ratio * rms_sigma - error).abs() <= 1e-12 * error);
        let worst = group["worst"]["ratio"].as_f64().unwrap();
        assert!(worst >= 0.0 && group["worst"]["name"].is_string());
    }
    assert_eq!(document["inputs"]["errors"]["parameter"]["K_1X"], 100.0);
    assert_eq!(document["inputs"]["azimuth"]["noise_arcsec"], 20.0);
    // The document is the input of its own repetition.
    let again: Value = serde_json::from_str(&desk.done(&args)).unwrap();
    assert_eq!(again, document);
    super::schemas::validate_evaluation(&document);
}

#[test]
fn analyze_names_what_all_parameters_leave_out_and_what_would_help() {
    let desk = Desk::new();
    desk.write(
        "s.csv",
        "alpha_deg,beta_deg,gamma_deg,dwell_s\n0,0,0,600\n180,0,0,600\n",
    );
    desk.write("p.toml", FULL);
    let report = desk.done(&["analyze", "-s", "s.csv", "-p", "p.toml"]);
    let text = report.split_whitespace().collect::<Vec<_>>().join(" ");
    for part in [
        "All parameters of the platform",
        "By the measurements alone, whatever is known before: rank",
        "needs slews about",
        "need other positions",
        "Sigma stays at least",
        "The azimuth is measured",
        "Drift along the vertical is vertical at every attitude: D_IX + D_IY + D_IZ;",
        "What would help most, rated by sigma of what is not told so far",
        "the best move",
        "the better of both",
    ] {
        assert!(text.contains(part), "{part} in:\n{report}");
    }
    assert!(report.lines().all(|l| l.chars().count() <= 80), "{report}");
    let args = ["analyze", "-s", "s.csv", "-p", "p.toml", "--json"];
    let document: Value = serde_json::from_str(&desk.done(&args)).unwrap();
    super::schemas::validate_analysis(&document);
    assert_eq!(
        document["parameters"].as_array().unwrap().len(),
        12 + 15 + 9 + 2 + 6
    );
    let named = &document["observability"]["parameters"];
    let unobservable = named["unobservable"].as_array().unwrap();
    let missing = named["unknowns"].as_u64().unwrap() - named["rank"].as_u64().unwrap();
    assert_eq!(unobservable.len() as u64, missing);
    let slews = unobservable.iter().find(|u| u["remedy"]["kind"] == "slews");
    assert!(slews.unwrap()["remedy"]["axes"].is_array());
    assert!(named["vertical_drift"].as_array().unwrap().len() >= 4);
    let additions = &document["additions"];
    assert_eq!(additions["aim"]["kind"], "unobserved");
    let best = match additions["move_is_better"].as_bool().unwrap() {
        true => &additions["move"],
        false => &additions["position"],
    };
    // What is suggested can be run, and does what is said.
    let mut schedule = document["schedule"].clone();
    let positions = schedule["positions"].as_array_mut().unwrap();
    positions.extend(best["positions"].as_array().unwrap().iter().cloned());
    desk.write("more.json", schedule.to_string());
    let args = ["evaluate", "-s", "more.json", "-p", "p.toml", "--json"];
    let after: Value = serde_json::from_str(&desk.done(&args)).unwrap();
    let criterion = after["score"]["criterion"].as_f64().unwrap();
    assert!((criterion / best["criterion"].as_f64().unwrap() - 1.0).abs() < 1e-9);
    // Of the default platform the text is what it was, and the document has more.
    let report = desk.done(&["analyze", "-s", "s.csv"]);
    assert!(!report.contains("All parameters"), "{report}");
    let document: Value =
        serde_json::from_str(&desk.done(&["analyze", "-s", "s.csv", "--json"])).unwrap();
    assert!(document["observability"]["parameters"]["unobservable"].is_array());
    assert!(document.get("additions").is_none() && document.get("remarks").is_none());
}

#[test]
fn what_is_unobservable_is_said_in_words_and_null_in_json() {
    let desk = Desk::new();
    desk.write(
        "s.csv",
        "alpha_deg,beta_deg,gamma_deg,dwell_s\n0,0,0,1000\n",
    );
    let report = desk.done(&["evaluate", "-s", "s.csv"]);
    assert!(report.contains("D_FX + D_SX"), "{report}");
    let document: Value =
        serde_json::from_str(&desk.done(&["evaluate", "-s", "s.csv", "--json"])).unwrap();
    let observability = &document["observability"];
    assert_eq!(observability["rank"], 3);
    assert_eq!(observability["unknowns"], 13);
    assert!(observability["condition_number"].is_null());
    assert!(strings(&observability["unobservable"]).contains(&"D_FX + D_SX"));
    assert!(document["coefficients"][0]["observability_order"].is_null());
}

#[test]
fn search_writes_what_it_reports() {
    let desk = Desk::new();
    let report = desk.done(&["search", "--starts", "4"]);
    let written = names(&desk.path("scheme-opt-out"));
    assert_eq!(written, RESULTS);
    assert!(report.starts_with("RMS sigma 0.0009"), "{report}");
    let tables = report.lines().filter(|l| l.starts_with('|'));
    assert!(tables.clone().count() > 30 && tables.into_iter().all(|l| l.chars().count() <= 80));
    assert!(report.contains("better than the best standard scheme"));

    let json = file::read(&desk.path("scheme-opt-out/schedule.json")).unwrap();
    let csv = file::read(&desk.path("scheme-opt-out/schedule.csv")).unwrap();
    assert_eq!(json, csv);
    let result = desk.json("scheme-opt-out/result.json");
    has_result_fields(&result);
    assert!(result["wall_time_s"].as_f64().unwrap() > 0.0);
    assert_eq!(result["status"], "converged");
    assert_eq!(result["seed"], 1);

    for name in ["schedule.json", "schedule.csv"] {
        let path = format!("scheme-opt-out/{name}");
        let again = desk.done(&["evaluate", "--schedule", &path, "--json"]);
        let again: Value = serde_json::from_str(&again).unwrap();
        for (a, b) in sigmas(&again)
            .into_iter()
            .zip(sigmas(&result["evaluation"]))
        {
            assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
        }
    }
}

#[test]
fn search_prints_the_document_and_nothing_else_with_json() {
    let desk = Desk::new();
    desk.write(
        "p.toml",
        "[gimbals]\nbeta_deg = [-60, 60]\n[motion]\nslew_rate_deg_per_s = 1\n",
    );
    let args = [
        "search", "p.toml", "--starts", "2", "--json", "--seed", "7", "-o", "deep/out",
    ];
    let run = desk.run(&args);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stderr.contains("deep/out/schedule.csv"));
    assert_eq!(run.stdout, desk.text("deep/out/result.json"));
    let document: Value = serde_json::from_str(&run.stdout).unwrap();
    has_result_fields(&document);
    assert_eq!(document["seed"], 7);
    assert_eq!(document["inputs"]["search"]["seed"], 7);
    let total_time_s = document["evaluation"]["total_time_s"].as_f64().unwrap();
    assert!(total_time_s > 11_980.0 && total_time_s <= 12_000.0 + 1e-6);
    // axis-24 turns the middle gimbal by 90 degrees.
    let compared = document["baselines"].as_array().unwrap().len();
    let skipped = document["baselines_skipped"].as_array().unwrap();
    assert_eq!(compared + skipped.len(), 11);
    assert_eq!(skipped[0]["name"], "axis-24");
    assert!(text(&skipped[0]["reason"]).contains("beta_deg"));

    let quiet: Vec<&str> = args.into_iter().chain(["--quiet"]).collect();
    assert_eq!(desk.run(&quiet).stderr, "");
}

#[test]
fn equal_inputs_give_equal_bytes_whatever_the_number_of_threads() {
    let desk = Desk::new();
    let threads = ["1", "2", "4", "8"];
    let outputs = threads.map(|threads| {
        let run = ["search", "--starts", "3", "--max-positions", "10"];
        let form = [
            "--reproducible",
            "--json",
            "--threads",
            threads,
            "-o",
            threads,
        ];
        desk.done(&[&run[..], &form].concat())
    });
    assert!(!outputs[0].contains("wall_time_s"));
    for (threads, output) in threads.iter().zip(&outputs) {
        assert_eq!(output, &outputs[0], "{threads} threads");
        for name in RESULTS {
            assert_eq!(
                desk.text(&format!("{threads}/{name}")),
                desk.text(&format!("1/{name}"))
            );
        }
    }
}

#[test]
fn the_result_can_be_made_again_from_itself() {
    let desk = Desk::new();
    let args = [
        "search",
        "--starts",
        "2",
        "--criterion",
        "d",
        "--reproducible",
        "--json",
    ];
    let document: Value = serde_json::from_str(&desk.done(&args)).unwrap();
    let inputs: scheme_opt::internals::config::StudyConfig =
        serde_json::from_value(document["inputs"].clone()).unwrap();
    assert_eq!(document["evaluation"]["score"]["criterion_name"], "d");
    let study = inputs.check().unwrap();
    let schedule = file::from_json(&document["schedule"].to_string()).unwrap();
    let evaluation = study.evaluator().evaluate(&schedule).unwrap();
    let criterion = document["evaluation"]["score"]["criterion"]
        .as_f64()
        .unwrap();
    assert!((evaluation.score.criterion / criterion - 1.0).abs() < 1e-9);
    let typed: scheme_opt::internals::results::ResultDocument =
        serde_json::from_value(document.clone()).unwrap();
    assert_eq!(serde_json::to_value(&typed).unwrap(), document);
}

#[test]
fn a_time_limit_gives_the_best_so_far() {
    let desk = Desk::new();
    let args = [
        "search",
        "--time-limit-s",
        "0.001",
        "--starts",
        "100",
        "-o",
        "out",
    ];
    let report = desk.done(&args);
    assert!(report.contains("time-limit"), "{report}");
    assert_eq!(desk.json("out/result.json")["status"], "time-limit");
    assert!(names(&desk.path("out")).len() >= 5);
}

#[test]
fn limits_that_cannot_be_met_give_exit_code_1_and_the_nearest() {
    let desk = Desk::new();
    // At a pole the sum of the input coefficients is never seen.
    desk.write(
        "p.toml",
        "[site]\nlatitude_deg = 90\n[objective.score]\nminimum_separability = 0.1\n",
    );
    let run = desk.run(&["search", "p.toml", "--starts", "1", "-o", "out"]);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert!(run.stdout.contains("infeasible: "), "{}", run.stdout);
    assert_eq!(desk.json("out/result.json")["status"], "infeasible");
}

#[test]
fn a_platform_without_a_position_gives_exit_code_1_and_nothing_else() {
    let desk = Desk::new();
    desk.write("p.toml", "[gimbals]\nstep_deg = 15\nbeta_deg = [16, 29]\n");
    let run = desk.run(&["search", "p.toml", "--starts", "1", "-o", "out"]);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert!(run.stderr.contains("gimbals.step_deg"), "{}", run.stderr);
    assert_eq!(
        (run.stdout.as_str(), desk.files()),
        ("", vec!["p.toml".to_owned()])
    );
}

#[test]
fn a_closed_pipe_is_silent() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    for args in [
        &["evaluate", "-s", "s.csv", "--json"][..],
        &["standard", "axis-24"],
        &["init", "-"],
        &["--help"],
    ] {
        let mut command = desk.command(args);
        let mut child = command
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        drop(child.stdout.take());
        let run = Run::of(child.wait_with_output().unwrap());
        assert_eq!((run.code, run.stderr.as_str()), (Some(0), ""), "{args:?}");
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_search_writes_the_best_so_far() {
    let desk = Desk::new();
    let mut command = desk.command(&["search", "--starts", "50000", "-o", "out"]);
    let child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // The temporary files appear when the signal handler is about to be installed.
    while std::fs::read_dir(desk.path("out")).map_or(0, Iterator::count) < 3 {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    std::thread::sleep(std::time::Duration::from_millis(300));
    let pid = child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &pid])
            .status()
            .unwrap()
            .success()
    );
    let run = Run::of(child.wait_with_output().unwrap());
    assert_eq!(run.code, Some(130), "{}", run.stderr);
    assert!(run.stderr.contains("interrupted"), "{}", run.stderr);
    assert_eq!(desk.json("out/result.json")["status"], "interrupted");
    // And a checkpoint, if any start was finished by then.
    let mut left = names(&desk.path("out"));
    left.retain(|name| name != "checkpoint.json");
    assert_eq!(left, RESULTS);
}

#[test]
fn the_shortest_test_meets_the_specification() {
    let desk = Desk::new();
    desk.write(
        "stand.toml",
        "[objective]\nmode = \"time\"\n[objective.spec_deg_per_h]\ndefault = 0.01\n",
    );
    desk.done(&["search", "stand.toml", "--starts", "4", "-o", "out"]);
    let result = desk.json("out/result.json");
    assert_eq!(result["status"], "converged");
    assert!(result["evaluation"]["total_time_s"].as_f64().unwrap() < 12_000.0);
    assert!(
        result["evaluation"]["max_sigma_deg_per_h"]
            .as_f64()
            .unwrap()
            <= 0.01
    );
    assert_eq!(result["evaluation"]["score"]["criterion_name"], "max-ratio");
    // A specification out of reach: exit code 1, the nearest feasible points said.
    desk.write(
        "strict.toml",
        "[objective]\nmode = \"time\"\ntotal_time_s = 3000\n[objective.spec_deg_per_h]\ndefault = 0.01\n",
    );
    let run = desk.run(&["search", "strict.toml", "--starts", "4", "-o", "strict"]);
    assert_eq!(run.code, Some(1));
    assert!(run.stdout.contains("infeasible"), "{}", run.stdout);
    assert_eq!(desk.json("strict/result.json")["status"], "infeasible");
}

#[test]
fn the_front_is_in_the_document_and_falls() {
    let desk = Desk::new();
    desk.write("front.toml", "[search]\nfront_points = 3\nstarts = 4\n");
    let shown = desk.done(&["search", "front.toml", "--mode", "pareto", "-o", "out"]);
    assert!(shown.contains("Total time against criterion"), "{shown}");
    let result = desk.json("out/result.json");
    let front = result["pareto"].as_array().unwrap();
    assert_eq!(front.len(), 3);
    let value = |p: &Value| p["criterion"].as_f64().unwrap();
    assert!(value(&front[0]) > value(&front[1]) && value(&front[1]) > value(&front[2]));
    assert_eq!(
        front[2]["schedule"]["positions"],
        result["schedule"]["positions"]
    );
}

#[test]
fn bound_says_what_no_schedule_can_beat() {
    let desk = Desk::new();
    let table = desk.done(&["bound"]);
    assert!(table.starts_with("No schedule of 12000 s or less has an RMS sigma below 0.0008"));
    assert!(table.contains("| D_SZ ") && table.lines().all(|l| l.chars().count() <= 80));

    let document: Value = serde_json::from_str(&desk.done(&["bound", "--json"])).unwrap();
    assert_eq!(document["schema"], "scheme-opt/bound/1");
    assert_eq!(text(&document["criterion"]), "a");
    assert_eq!(document["total_time_s"], 12_000.0);
    let bound = document["lower_bound"].as_f64().unwrap();
    assert!(bound > 0.000_855 && bound < 0.000_9);
    assert_eq!(
        document["rms_sigma_lower_bound_deg_per_h"],
        document["lower_bound"]
    );
    assert!(document["equivalence_gap"].as_f64().unwrap() < 1e-3);
    assert_eq!(text(&document["majorant"]), "separated");
    for channel in ["x", "y", "z"] {
        assert!(document["delta"][channel].as_f64().unwrap() > 0.0);
    }
    let each = document["sigma_lower_bound_deg_per_h"].as_object().unwrap();
    assert!(each.len() == 12 && each.values().all(Value::is_number));
    assert!(document.get("minimum_time_s").is_none());
    assert!(document["inputs"].is_object() && document["defaulted"].is_array());

    let args = [
        "bound",
        "--total-time-s",
        "6000",
        "--criterion",
        "d",
        "--json",
    ];
    let short: Value = serde_json::from_str(&desk.done(&args)).unwrap();
    assert_eq!(text(&short["criterion"]), "d");
    assert!(short["rms_sigma_lower_bound_deg_per_h"].as_f64().unwrap() > bound);
    assert_eq!(desk.files(), Vec::<String>::new());
}

#[test]
fn bound_knows_the_shortest_conceivable_test() {
    let desk = Desk::new();
    desk.write("p.toml", "[objective.spec_deg_per_h]\ndefault = 0.002\n");
    let out = desk.done(&["bound", "p.toml", "--json"]);
    let document: Value = serde_json::from_str(&out).unwrap();
    let least = document["minimum_time_s"].as_f64().unwrap();
    assert!(least > 9000.0 && least < 11_000.0, "{least}");
    assert!(text(&document["minimum_time"]).contains("meets the specification"));
    // In mode time a specification that certainly cannot be met is no acceptable schedule.
    let args = ["bound", "p.toml", "--mode", "time", "--total-time-s"];
    let with = |time| desk.run(&[&args[..], &[time]].concat());
    assert_eq!(with("12000").code, Some(0));
    let hopeless = with("9000");
    assert_eq!(hopeless.code, Some(1));
    assert!(hopeless.stdout.contains("or less meets the specification"));
}

#[test]
fn bound_says_what_it_rests_on() {
    let desk = Desk::new();
    desk.write("hold.toml", "[motion]\nrepositioning = \"frame-hold\"\n");
    let text = desk.done(&["bound", "hold.toml"]);
    assert!(text.contains("Note: in frame-hold repositioning"), "{text}");
    desk.write("table.toml", "[gimbals]\nstep_deg = 90\n");
    assert!(desk.done(&["bound", "table.toml"]).contains("index table"));
}

/// Other errors are taken as known, in words and as data; an azimuth reference counts.
#[test]
fn bound_covers_the_full_error_model() {
    let desk = Desk::new();
    desk.write(
        "full.toml",
        "[errors]\ntorquer_scale_factor_ppm = 1000\n[errors.considered]\nlocal_gravity_ug = 5\n\
         [gyro.output_axis]\nX = \"+y\"\n[azimuth]\nnoise_arcsec = 5\n",
    );
    let told = desk.done(&["bound", "full.toml"]);
    assert!(told.lines().all(|l| l.chars().count() <= 80), "{told}");
    let told = told.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(
        told.contains("known exactly") && told.contains("torquer scale factor"),
        "{told}"
    );
    let out = desk.done(&["bound", "full.toml", "--json"]);
    let document: Value = serde_json::from_str(&out).unwrap();
    let known = &document["taken_as_known"];
    assert_eq!(known[0], "torquer_scale_factor_ppm");
    assert_eq!(known[1], "local_gravity_ug");
    let bound = document["lower_bound"].as_f64().unwrap();
    assert!(bound > 0.000_46 && bound < 0.000_47);
    // Nothing of it on the platform of the paper.
    let plain: Value = serde_json::from_str(&desk.done(&["bound", "--json"])).unwrap();
    assert!(plain.get("taken_as_known").is_none());
    assert_eq!(plain["remarks"].as_array().unwrap().len(), 0);
}

#[test]
fn bound_refuses_bad_input() {
    let desk = Desk::new();
    desk.run(&["bound", "nowhere.toml"])
        .refused(&["nowhere.toml"]);
    desk.run(&["bound", "--total-time-s", "-5"])
        .refused(&["objective.total_time_s", "--total-time-s"]);
    desk.run(&["bound", "--criterion", "max-ratio"])
        .refused(&["objective.criterion", "specification"]);
    desk.write("bad.toml", "[site]\nlatitude_deg = 95\n");
    desk.run(&["bound", "bad.toml"])
        .refused(&["bad.toml:2", "site.latitude_deg"]);
    let usage = desk.run(&["bound", "--frobnicate"]);
    assert_eq!(usage.code, Some(2));
}

#[test]
fn search_certifies_what_it_found() {
    let desk = Desk::new();
    let out = desk.done(&["search", "--starts", "4", "-o", "out"]);
    assert!(
        out.contains("of what any torquing programme could reach"),
        "{out}"
    );
    let certificate = desk.json("out/result.json")["certificate"].clone();
    assert_eq!(text(&certificate["criterion"]), "a");
    let number = |key: &str| certificate[key].as_f64().unwrap();
    assert!(number("lower_bound") < number("achieved"));
    assert!(number("gap_percent") > 0.0 && number("gap_percent") < 6.5);

    desk.write("p.toml", "[objective.spec_deg_per_h]\ndefault = 0.002\n");
    let args = [
        "search",
        "p.toml",
        "--mode",
        "time",
        "--time-limit-s",
        "1",
        "-o",
        "time",
    ];
    let out = desk.done(&args);
    let words: Vec<&str> = out.split_whitespace().collect();
    let out = words.join(" ");
    assert!(out.contains("or less meets the specification"), "{out}");
    let certificate = desk.json("time/result.json")["certificate"].clone();
    assert_eq!(text(&certificate["criterion"]), "total-time");
    assert_eq!(text(&certificate["unit"]), "s");

    desk.write("q.toml", "[search]\nfront_points = 2\n");
    let args = [
        "search", "q.toml", "--mode", "pareto", "--starts", "2", "-o", "front",
    ];
    assert!(desk.done(&args).contains("none below"));
    for point in desk.json("front/result.json")["pareto"].as_array().unwrap() {
        assert!(point["lower_bound"].as_f64().unwrap() <= point["criterion"].as_f64().unwrap());
    }
}
