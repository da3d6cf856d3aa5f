//! That what is said of a result is true of it: exit codes, comparisons, reasons, and what is left out.

use serde_json::Value;

use super::{Desk, SCHEDULE};

/// A table that no time is enough for, and starts that no time limit waits for.
const HOPELESS: &str = "[objective.spec_deg_per_h]\ndefault = 1e-5\n\
                        [search]\nstarts = 20000\ntime_limit_s = 2\n";

#[test]
fn a_specification_missed_is_exit_code_1_however_the_search_ended() {
    let desk = Desk::new();
    desk.write("hopeless.toml", HOPELESS);
    desk.write(
        "of_others.toml",
        HOPELESS
            .replace("default = 1e-5", "default = 1")
            .replace("spec_deg_per_h]", "spec]\nT_XX = 1e-3")
            + "[errors]\ntorquer_scale_factor_ppm = 1000\n",
    );
    for (file, args, missed) in [
        ("hopeless.toml", ["--mode", "time"], "D_FX (1"),
        ("hopeless.toml", ["--criterion", "max-ratio"], "D_FX ("),
        ("of_others.toml", ["--criterion", "max-ratio"], "T_XX ("),
    ] {
        let missed = missed.trim_end_matches('1');
        let run = desk.run(&[&["search", file][..], &args].concat());
        let said = run.stdout.replace('\n', " ");
        assert_eq!(run.code, Some(1), "{args:?}: {said}{}", run.stderr);
        let result = desk.json("scheme-opt-out/result.json");
        assert_eq!(result["status"], "time-limit", "{args:?}");
        let reason = result["reason"].as_str().unwrap();
        for part in ["the time limit was reached", "missed by", missed] {
            assert!(reason.contains(part), "{part}: {reason}");
            assert!(said.contains(part), "{part}: {said}");
        }
        assert!(!said.contains("Within -"), "{said}");
        if args[0] == "--mode" {
            assert_eq!(result["certificate"]["gap_percent"], Value::Null);
        }
    }
    // Where the specification is not the criterion, it need not be met.
    let run = desk.run(&["search", "hopeless.toml"]);
    assert_eq!(run.code, Some(0), "{}", run.stdout);
    assert_eq!(
        desk.json("scheme-opt-out/result.json")["status"],
        "time-limit"
    );
}

#[test]
fn a_front_that_was_cut_short_is_compared_in_its_own_time() {
    let desk = Desk::new();
    desk.write(
        "front.toml",
        "[objective]\nmode = \"pareto\"\ntotal_time_s = 6000\n\
         [search]\nstarts = 20000\ntime_limit_s = 1\n",
    );
    let run = desk.run(&["search", "front.toml"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let result = desk.json("scheme-opt-out/result.json");
    assert_eq!(result["status"], "time-limit");
    let time_s = result["evaluation"]["total_time_s"].as_f64().unwrap();
    assert!(time_s < 3000.0, "{time_s}");
    assert_eq!(result["certificate"]["total_time_s"], time_s);
    let time = time_s.to_string();
    for baseline in result["baselines"].as_array().unwrap() {
        let name = baseline["name"].as_str().unwrap();
        let args = [
            "standard",
            name,
            "--total-time-s",
            &time,
            "-o",
            "scheme.csv",
        ];
        desk.done(&args);
        let found = desk.done(&["evaluate", "-s", "scheme.csv", "--json"]);
        let found: Value = serde_json::from_str(&found).unwrap();
        let [a, b] = [&found, baseline].map(|d| d["rms_sigma_deg_per_h"].as_f64().unwrap());
        assert!((a / b - 1.0).abs() < 1e-9, "{name}: {a} {b}");
    }
    assert!(!result["baselines"].as_array().unwrap().is_empty());
}

#[test]
fn a_bound_where_a_known_drift_walks_has_its_own_reason() {
    let desk = Desk::new();
    let walks = "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 0.01\n";
    let spec = "[objective.spec_deg_per_h]\nD_FX = 0.01\n";
    for (prior, criterion) in [
        ("constant_drift_deg_per_h = 0", "d"),
        (
            "constant_drift_deg_per_h = 0\ng_sensitive_drift_deg_per_h_per_g = 0",
            "a",
        ),
        (
            "constant_drift_deg_per_h = 0\ng_sensitive_drift_deg_per_h_per_g = 0",
            "e",
        ),
        ("constant_drift_deg_per_h = [0, 15, 15]", "max-ratio"),
    ] {
        desk.write("known.toml", format!("[prior]\n{prior}\n{walks}{spec}"));
        let args = ["bound", "known.toml", "--criterion", criterion];
        let said = desk.done(&args).replace('\n', " ");
        assert!(
            said.contains("known before the test wanders in it"),
            "{said}"
        );
        assert!(!said.contains("without random drift"), "{said}");
    }
}

#[test]
fn keys_are_not_broken_within_a_word() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write(
        "p.toml",
        "[accelerometer]\nacceleration_random_walk_ug_per_sqrt_h = 20\n\
         [gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 0.01\n\
         [errors]\nquadratic_drift_deg_per_h_per_g2 = 0.1\n\
         [errors.considered]\naccelerometer_cross_coupling_ug_per_g2 = 2\n",
    );
    let said = desk.done(&["evaluate", "-s", "s.csv", "-p", "p.toml"]);
    let table = &said[said.find("What limits this test").unwrap()..];
    for key in [
        "accelerometer.acceleration_random_walk_ug_per_sqrt_h",
        "gyro.rate_random_walk_deg_per_h_per_sqrt_h",
    ] {
        assert!(table.contains(&format!("| {key} ")), "{table}");
    }
    for key in [
        "quadratic_drift_deg_per_h_per_g2",
        "accelerometer_cross_coupling_ug_per_g2",
    ] {
        assert!(said.contains(&format!("| {key} ")), "{said}");
    }
    assert!(
        said.lines().all(|line| line.chars().count() <= 80),
        "{said}"
    );
}

#[test]
fn an_analysis_says_what_it_counts_of_noise_that_wanders() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write(
        "p.toml",
        "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 0.01\n",
    );
    let of = |platform: &[&str]| {
        let args = [&["analyze", "-s", "s.csv"][..], platform].concat();
        let said = desk.done(&args).replace('\n', " ");
        let json = desk.done(&[&args[..], &["--json"]].concat());
        (said, serde_json::from_str::<Value>(&json).unwrap())
    };
    let (said, document) = of(&["-p", "p.toml"]);
    let sentence = "the Gramian and the sensitivity are of the white noise alone.";
    assert_eq!(said.matches(sentence).count(), 1, "{said}");
    assert_eq!(document["remarks"][0]["kind"], "noise-wanders");
    // Beside the columns that it is of.
    let (column, next) = (said.find("Gramian, deg/h"), said.find("What to add"));
    assert!(column < said.find(sentence) && said.find(sentence) < next);
    let (said, document) = of(&[]);
    assert!(!said.contains(sentence) && document["remarks"] == Value::Null);
}

#[test]
fn a_bias_that_wanders_is_not_called_perfect() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    let instability = "bias_instability_ug = 3\nbias_correlation_time_s = 900\n";
    for (accelerometer, constant, said) in [
        ("", "", "accelerometer bias, "),
        (
            instability,
            "",
            "the constant part of the accelerometer bias, ",
        ),
        (
            "acceleration_random_walk_ug_per_sqrt_h = 3\n",
            "",
            "the constant part of the accelerometer bias, ",
        ),
        (instability, "[errors]\naccelerometer_bias_ug = 100\n", ""),
    ] {
        desk.write(
            "p.toml",
            format!("[accelerometer]\n{accelerometer}{constant}"),
        );
        let text = desk.done(&["evaluate", "-s", "s.csv", "-p", "p.toml"]);
        let text = text.replace('\n', " ");
        let perfect = &text[text.find("Perfect in this plan").unwrap()..];
        assert_eq!(
            perfect.contains("the constant part of"),
            said.starts_with("the")
        );
        assert_eq!(perfect.contains("accelerometer bias,"), !said.is_empty());
        assert!(perfect.contains(said), "{perfect}");
    }
}

#[test]
fn no_instability_needs_no_correlation_time() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write(
        "p.toml",
        "[gyro]\nbias_instability_deg_per_h = 0\n[accelerometer]\nbias_instability_ug = 0\n",
    );
    let sigma = |args: &[&str]| {
        let args = [&["evaluate", "-s", "s.csv", "--json"][..], args].concat();
        let found: Value = serde_json::from_str(&desk.done(&args)).unwrap();
        found["rms_sigma_deg_per_h"].clone()
    };
    assert_eq!(sigma(&["-p", "p.toml"]), sigma(&[]));
}

#[test]
fn weights_without_effect_are_named() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write(
        "p.toml",
        "[objective.weights]\nD_FX = 3\n[objective.spec_deg_per_h]\ndefault = 0.01\n",
    );
    for criterion in ["a", "d", "e", "max-ratio"] {
        let args = ["evaluate", "-s", "s.csv", "-p", "p.toml", "--criterion"];
        let run = desk.run(&[&args[..], &[criterion]].concat());
        assert_eq!(run.code, Some(0));
        let note = format!(
            "objective.weights = {{ D_FX = 3 }}: without effect: criterion `{criterion}` has no weights"
        );
        assert_eq!(
            run.stderr.contains(&note),
            criterion != "a",
            "{}",
            run.stderr
        );
    }
}

#[test]
fn what_would_not_help_is_no_limit() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write(
        "p.toml",
        "[errors.considered]\naccelerometer_bias_ug = 100\n[motion]\nslew_rate_deg_per_s = 1\n",
    );
    let args = ["evaluate", "-s", "s.csv", "-p", "p.toml"];
    let json = desk.done(&[&args[..], &["--json"]].concat());
    let document: Value = serde_json::from_str(&json).unwrap();
    let limits = document["limits"].as_array().unwrap();
    let ratio = |l: &Value| l["criterion_ratio"].as_f64().unwrap();
    assert!(limits.iter().all(|l| ratio(l) <= 1.0 + 1e-9), "{limits:?}");
    // The filter reads the bias for drift: accelerometers that it trusts more make it worse.
    assert!(limits.iter().all(|l| l["what"] != "accelerometer.noise_g"));
    let said = desk.done(&args).replace('\n', " ");
    assert!(said.contains("What would not help is left out"), "{said}");
}

#[test]
fn the_picture_of_a_simulation_has_every_estimated_parameter() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write(
        "p.toml",
        "[motion]\nslew_rate_deg_per_s = 1\n[errors]\ntorquer_scale_factor_ppm = 1000\n\
         accelerometer_bias_ug = 100\naccelerometer_scale_factor_ppm = 200\n\
         accelerometer_misalignment_arcsec = 60\naccelerometer_second_order_ug_per_g2 = 20\n\
         [errors.considered]\naccelerometer_third_order_ug_per_g3 = 5\n",
    );
    let args = [
        "simulate",
        "-s",
        "s.csv",
        "-p",
        "p.toml",
        "--runs",
        "8",
        "-o",
        "out",
        "--report",
        "page.html",
    ];
    desk.done(&args);
    let found = desk.json("out/simulation.json");
    let page = desk.text("page.html");
    for p in found["parameters"].as_array().unwrap() {
        let name = p["name"].as_str().unwrap();
        let ratio = p["ratio"].as_f64().unwrap();
        let mark = format!("<title>{name}: {ratio:.3}</title>");
        let is_shown = p["role"] == "estimated";
        assert_eq!(page.contains(&mark), is_shown, "{mark}");
    }
}
