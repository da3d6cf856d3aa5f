//! Drift and biases that wander, from the command line.

use serde_json::Value;

use super::{Desk, SCHEDULE};

const WANDERING: &str = "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 0.001\n\
    bias_instability_deg_per_h = 0.003\nbias_correlation_time_s = 600\n\
    [accelerometer]\nnoise_density_ug_per_sqrt_hz = 30\nbias_instability_ug = 2\n\
    bias_correlation_time_s = 900\n[motion]\nslew_rate_deg_per_s = 1\n";

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("wandering.toml", WANDERING);
    desk.write("mine.csv", SCHEDULE);
    desk
}

/// What a command says of the platform, as a document.
fn document(desk: &Desk, args: &[&str]) -> Value {
    let json = [args, &["--platform", "wandering.toml", "--json", "-q"]].concat();
    serde_json::from_str(&desk.done(&json)).unwrap()
}

#[test]
fn an_evaluation_says_what_d_f_is_and_what_wanders() {
    let desk = desk();
    let found = document(&desk, &["evaluate", "--schedule", "mine.csv"]);
    // What the walk comes to, 1σ: at the end and constant parts are known that much apart at most.
    let walk = 0.001 * (found["total_time_s"].as_f64().unwrap() / 3600.0).sqrt();
    for p in found["parameters"].as_array().unwrap() {
        let sigma = p["sigma"].as_f64().unwrap();
        let constant = p["constant_part_sigma"].as_f64();
        assert_eq!(
            constant.is_some(),
            p["name"].as_str().unwrap().starts_with("D_F")
        );
        if let Some(constant) = constant {
            let apart = (constant - sigma).abs();
            assert!(apart > 0.0 && apart < walk, "{p}");
        }
    }
    let limits = found["limits"].as_array().unwrap();
    let of = |key: &str| limits.iter().any(|l| l["what"] == key);
    assert!(of("gyro.bias_instability_deg_per_h") && of("accelerometer.bias_instability_ug"));
    let text = desk.done(&[
        "evaluate",
        "--schedule",
        "mine.csv",
        "--platform",
        "wandering.toml",
        "--report",
        "report.html",
    ]);
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    for part in [
        "D_F is the drift at the end of the test",
        "1 sigma of the constant part alone: D_FX ",
        "modelled: rate random walk, bias instability of the gyros and bias instability of the \
         accelerometers; not modelled: acceleration random walk.",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    let page = desk.text("report.html");
    assert!(page.contains("D_F is the drift at the end of the test") && page.contains("°/h."));
}

#[test]
fn a_simulation_carries_it() {
    let desk = desk();
    let args = ["simulate", "--schedule", "mine.csv", "--runs", "30"];
    let found = document(&desk, &args);
    // 12, six of the drift, three of the biases, ψ.
    assert_eq!(found["nees"]["degrees_of_freedom"], 24);
    assert_eq!(
        found["judgement"]["verdict"], "consistent",
        "{}",
        found["judgement"]
    );
    let evaluated = document(&desk, &["evaluate", "--schedule", "mine.csv"]);
    let planned = found["rms_planned_sigma_deg_per_h"].as_f64().unwrap();
    let sigma = evaluated["rms_sigma_deg_per_h"].as_f64().unwrap();
    assert!((planned / sigma - 1.0).abs() < 1e-9, "{planned} {sigma}");
}

#[test]
fn schedules_are_compared_and_commanded_with_it() {
    let desk = desk();
    let platform = ["--platform", "wandering.toml"];
    let table = ["commands", "--schedule", "mine.csv"];
    assert!(desk.done(&[&table[..], &platform].concat()).lines().count() > 12);
    // Without biases, which take longer.
    desk.write(
        "wandering.toml",
        "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 0.001\n",
    );
    let args = ["compare", "mine.csv", "standard:vertices-8", "--best-order"];
    let found = document(&desk, &args);
    // Both as they are given, and in their best orders too.
    let sigma: Vec<f64> = (found["schedules"].as_array().unwrap().iter())
        .map(|s| s["rms_sigma_deg_per_h"].as_f64().unwrap())
        .collect();
    assert_eq!(sigma.len(), 4, "{found}");
    for pair in sigma.chunks_exact(2) {
        assert!(pair[1] <= pair[0], "{sigma:?}");
    }
}

/// In every mode, of one or two processes of the drift and with biases that wander.
#[test]
fn schedules_are_searched_for_with_it() {
    let desk = desk();
    let short = "[objective]\ntotal_time_s = 2400\n[objective.spec_deg_per_h]\ndefault = 0.2\n\
                 [search]\nstarts = 3\nmax_positions = 5\n[motion]\nslew_rate_deg_per_s = 2\n";
    let walk = "[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 0.01\n";
    let markov = "bias_instability_deg_per_h = 0.01\nbias_correlation_time_s = 600\n";
    let biases = "[accelerometer]\nacceleration_random_walk_ug_per_sqrt_h = 5\n";
    for (wandering, modes) in [
        (walk.to_owned(), &["accuracy", "pareto", "time"][..]),
        ([walk, markov].concat(), &["accuracy"]),
        ([walk, biases].concat(), &["accuracy"]),
    ] {
        desk.write("short.toml", [&wandering, short].concat());
        for mode in modes {
            let text = desk.done(&["search", "short.toml", "--mode", mode]);
            // Wherever lines end.
            let text = text.replace('\n', " ");
            assert!(
                text.contains("modelled: rate random walk"),
                "{mode}: {text}"
            );
        }
    }
}

/// Where nothing else is said a search may have more positions, and says why.
#[test]
fn more_positions_are_tried_where_drift_wanders() {
    let desk = desk();
    let quick = "[search]\nstarts = 1\n[objective]\ntotal_time_s = 700\n";
    let of = |toml: &str| {
        desk.write("quick.toml", [toml, quick].concat());
        let run = desk.run(&["search", "quick.toml"]);
        let most =
            desk.json("scheme-opt-out/result.json")["inputs"]["search"]["max_positions"].as_u64();
        (run.stderr, most)
    };
    let (said, most) = of("[gyro]\nrate_random_walk_deg_per_h_per_sqrt_h = 0.01\n");
    assert!(
        said.contains("up to 48 positions: the drift wanders"),
        "{said}"
    );
    assert_eq!(most, Some(48));
    let (said, most) = of("");
    assert!(!said.contains("positions: the drift wanders"), "{said}");
    assert_eq!(most, Some(24));
}

/// The bound knows drift that wanders, in the D_F, and says what it leaves out.
#[test]
fn the_bound_counts_drift_that_wanders() {
    let desk = desk();
    desk.write(
        "white.toml",
        "[accelerometer]\nnoise_density_ug_per_sqrt_hz = 30\n[motion]\nslew_rate_deg_per_s = 1\n",
    );
    let bound = |file: &str| -> Value {
        serde_json::from_str(&desk.done(&["bound", file, "--json", "-q"])).unwrap()
    };
    let (white, wandering) = (bound("white.toml"), bound("wandering.toml"));
    let number = |of: &Value, field: &str| of[field].as_f64().unwrap();
    for field in ["lower_bound", "rms_sigma_lower_bound_deg_per_h"] {
        assert!(number(&wandering, field) > 1.02 * number(&white, field));
    }
    for (name, least) in white["sigma_lower_bound_deg_per_h"].as_object().unwrap() {
        let with = &wandering["sigma_lower_bound_deg_per_h"][name];
        match name.starts_with("D_F") {
            true => assert!(with.as_f64().unwrap() > 1.5 * least.as_f64().unwrap()),
            false => assert_eq!(with, least),
        }
    }
    assert_eq!(white["noise_left_out"], Value::Null);
    let keys = ["accelerometer.bias_instability_ug"];
    assert_eq!(wandering["noise_left_out"], serde_json::json!(keys));
    let remarks = wandering["remarks"].to_string();
    for said in [
        "drift that wanders counts in the D_F",
        "biases that wander are left out",
    ] {
        assert!(remarks.contains(said), "{remarks}");
    }
    // And no evaluation is below it.
    let found = document(&desk, &["evaluate", "--schedule", "mine.csv"]);
    let time = found["total_time_s"].to_string();
    let args = [
        "bound",
        "wandering.toml",
        "--json",
        "-q",
        "--total-time-s",
        &time,
    ];
    let bound: Value = serde_json::from_str(&desk.done(&args)).unwrap();
    assert!(bound["lower_bound"].as_f64() < found["rms_sigma_deg_per_h"].as_f64());
}

/// Every key of what wanders with values that are none, and forms that exclude each other.
#[test]
fn bad_values_are_refused_where_they_stand() {
    let desk = desk();
    let g = "[gyro]\n";
    let a = "[accelerometer]\n";
    for (file, parts) in [
        (
            format!("{g}bias_instability_deg_per_h = [1, 2, 3]\nbias_correlation_time_s = 100\n"),
            ["bad.toml:2", "wrong type", "a number"],
        ),
        (
            format!("{g}rate_random_walk_deg_per_h_per_sqrt_h = \"0.001\"\n"),
            ["bad.toml:2", "wrong type", "without quotes"],
        ),
        (
            format!("{g}rate_random_walk_deg_per_h_per_sqrt_h = -1\n"),
            ["bad.toml:2", "out of range", "0 (none) to 10000"],
        ),
        (
            format!("{g}bias_instability_deg_per_h = 0.1\n"),
            [
                "bad.toml:2",
                "given without gyro.bias_correlation_time_s",
                "both or neither",
            ],
        ),
        (
            format!("{a}bias_correlation_time_s = 100\n"),
            [
                "bad.toml:2",
                "given without accelerometer.bias_instability_ug",
                "both or neither",
            ],
        ),
        (
            format!("{a}noise_g = 1e-5\nnoise_density_ug_per_sqrt_hz = 30\n"),
            [
                "bad.toml:3",
                "given together with accelerometer.noise_g",
                "one of the two",
            ],
        ),
        (
            format!("{a}noise_density_ug_per_sqrt_hz = 3e-5\n"),
            ["bad.toml:2", "out of range", "0.001 to 30000"],
        ),
        (
            format!("{a}bias_instability_ug = 1\nbias_correlation_time_s = 0.1\n"),
            ["bad.toml:3", "out of range", "1 to 1e9"],
        ),
        (
            format!("{g}rate_random_walk_deg_per_h = 3\n"),
            [
                "bad.toml:2",
                "unknown key",
                "rate_random_walk_deg_per_h_per_sqrt_h",
            ],
        ),
    ] {
        desk.write("bad.toml", &file);
        desk.run(&["bound", "bad.toml"]).refused(&parts);
    }
}

/// The worked example of docs/allan.md is what the program prints.
#[test]
fn the_page_on_the_allan_deviation_has_the_programs_numbers() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/allan.md");
    let page = std::fs::read_to_string(path).unwrap();
    let desk = Desk::new();
    let twelve = ["standard", "icosahedron-12", "-o", "twelve.csv"];
    desk.done(&twelve);
    for name in ["white.toml", "wandering.toml"] {
        let from = page.find(&format!("# {name}")).unwrap();
        let block = page[from..].split("```").next().unwrap();
        desk.write(name, block);
        let run = desk.done(&["evaluate", "--schedule", "twelve.csv", "--platform", name]);
        let printed = |head: &str| {
            let line = run
                .lines()
                .find(|l| l.trim_start_matches("| ").starts_with(head));
            line.unwrap()
                .split_whitespace()
                .map(str::to_owned)
                .collect::<Vec<_>>()
        };
        let rms = printed("RMS sigma").swap_remove(2);
        let d_fx = printed("D_FX").swap_remove(5);
        let row = format!("| `{name}` | {rms} | {d_fx} |");
        assert!(page.contains(&row), "{row}");
    }
}
