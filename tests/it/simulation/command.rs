//! `simulate` on the command line.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

const SCHEDULE: &str = "alpha_deg,beta_deg,gamma_deg,dwell_s\n\
                        10,20,30,1000\n50,-40,100,1500\n-120,30,0,1200\n\
                        170,10,-80,900\n-60,-50,200,1100\n95,55,-145,1300\n";

fn simulate(directory: &Path, args: &[&str]) -> Output {
    std::fs::write(directory.join("s.csv"), SCHEDULE).unwrap();
    Command::new(assert_cmd::cargo::cargo_bin!("scheme-opt"))
        .args(["simulate", "--schedule", "s.csv"])
        .args(args)
        .current_dir(directory)
        .output()
        .unwrap()
}

#[test]
fn simulate_tells_writes_and_draws() {
    let desk = tempfile::tempdir().unwrap();
    let run = simulate(desk.path(), &["--runs", "40", "-o", "out"]);
    assert_eq!(run.status.code(), Some(0));
    let text = String::from_utf8(run.stdout).unwrap();
    for part in [
        "The filter is ",
        "NEES, all states",
        "NIS",
        "D_SZ",
        "psi_ny",
        "planned",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
    assert!(
        text.lines().all(|line| line.chars().count() <= 80),
        "{text}"
    );
    let read = |name: &str| std::fs::read_to_string(desk.path().join("out").join(name)).unwrap();
    let csv = read("curves.csv");
    let widths: Vec<usize> = csv.lines().map(|line| line.split(',').count()).collect();
    assert!(widths.iter().all(|w| *w == 2 + 15 * 4 + 2));
    assert_eq!(widths.len(), 701);
    for name in ["curves.svg", "errors.svg"] {
        let svg = read(name);
        assert!(svg.starts_with("<svg") && !svg.contains("NaN"), "{name}");
    }
    let document: Value = serde_json::from_str(&read("simulation.json")).unwrap();
    assert_eq!(document["schema"], "scheme-opt/simulation/1");
}

/// Terminal, document and report say the same, and the exit code agrees.
#[test]
fn simulate_has_one_verdict_everywhere() {
    let desk = tempfile::tempdir().unwrap();
    let with = |name: &str, spec: &str| {
        let text = format!("[objective.spec_deg_per_h]\ndefault = {spec}\n");
        std::fs::write(desk.path().join(name), text).unwrap();
    };
    with("loose.toml", "0.1");
    with("strict.toml", "0.0001");
    for (platform, factor, code, says, never) in [
        ("loose.toml", "1", 0, "The specification is met", "not met"),
        (
            "strict.toml",
            "1",
            1,
            "The specification is not met",
            "is met",
        ),
        (
            "loose.toml",
            "0.3",
            1,
            "The filter is optimistic",
            "consistent:",
        ),
    ] {
        let args = [
            "-p",
            platform,
            "--told-noise-factor",
            factor,
            "--runs",
            "40",
            "--check",
        ];
        let flat = |run: &Output| {
            let text = String::from_utf8(run.stdout.clone()).unwrap();
            text.split_whitespace().collect::<Vec<_>>().join(" ")
        };
        let run = simulate(desk.path(), &[&args[..], &["--report", "r.html"]].concat());
        assert_eq!(run.status.code(), Some(code), "{platform} {factor}");
        let terminal = flat(&run);
        let page = std::fs::read_to_string(desk.path().join("r.html")).unwrap();
        let run = simulate(desk.path(), &[&args[..], &["--json"]].concat());
        assert_eq!(run.status.code(), Some(code));
        let document: Value = serde_json::from_slice(&run.stdout).unwrap();
        assert_eq!(document["verdict"], document["judgement"]["verdict"]);
        assert_eq!(document["judgement"]["passed"], code == 0);
        let sentences = document["judgement"]["sentences"].as_array().unwrap();
        let mut all = String::new();
        for sentence in sentences {
            let sentence = sentence.as_str().unwrap();
            assert!(terminal.contains(sentence), "{sentence}\n{terminal}");
            assert!(
                page.contains(&sentence.replace("deg/h", "°/h")),
                "{sentence}"
            );
            all += sentence;
        }
        assert!(all.contains(says) && !all.contains(never), "{all}");
        // What the plan says of the specification is told from what the runs show.
        assert!(page.contains("By the plan alone the specification would"));
        let without = simulate(desk.path(), &args[..6]);
        assert_eq!(without.status.code(), Some(0));
    }
}

#[test]
fn simulate_gives_the_same_document_at_any_number_of_threads() {
    let desk = tempfile::tempdir().unwrap();
    let document = |threads: &str| -> Value {
        let args = [
            "--json",
            "--runs",
            "10",
            "--seed",
            "5",
            "--threads",
            threads,
        ];
        let run = simulate(desk.path(), &args);
        assert_eq!(run.status.code(), Some(0));
        assert!(run.stderr.is_empty());
        let mut document: Value = serde_json::from_slice(&run.stdout).unwrap();
        document["inputs"]["search"]["threads"] = Value::Null;
        document
    };
    let one = document("1");
    assert_eq!(one, document("3"));
    assert_eq!(one["seed"], 5);
    assert_eq!(one["coefficients"].as_array().unwrap().len(), 12);
    assert!(one["tool_version"].is_string() && one["defaulted"].is_array());
}

#[test]
fn simulate_refuses_what_makes_no_sense() {
    let desk = tempfile::tempdir().unwrap();
    for (args, part) in [
        (["--runs", "1"], "--runs"),
        (["--told-noise-factor", "-1"], "--told-noise-factor"),
        (["--filter", "magic"], "iterated"),
        (["--truth", "magic"], "nonlinear"),
    ] {
        let run = simulate(desk.path(), &args);
        assert_eq!(run.status.code(), Some(2), "{args:?}");
        assert!(run.stdout.is_empty());
        let text = String::from_utf8(run.stderr).unwrap();
        assert!(text.contains(part), "{text}");
    }
}

/// 33 parameters, of which the filter estimates 30.
const FULL: &str = "[prior]\nconstant_drift_deg_per_h = 0.15\n\
                    g_sensitive_drift_deg_per_h_per_g = 0.08\n\
                    [errors]\ntorquer_scale_factor_ppm = 1000\ntorquer_misalignment_arcsec = 60\n\
                    accelerometer_scale_factor_ppm = 200\naccelerometer_misalignment_arcsec = 60\n\
                    accelerometer_second_order_ug_per_g2 = 20\n\
                    [errors.considered]\naccelerometer_bias_ug = 100\n\
                    [azimuth]\nnoise_arcsec = 20\n";

#[test]
fn simulate_tells_of_every_parameter_in_its_unit() {
    let desk = tempfile::tempdir().unwrap();
    std::fs::write(desk.path().join("full.toml"), FULL).unwrap();
    let args = [
        "-p",
        "full.toml",
        "--runs",
        "10",
        "--report",
        "r.html",
        "-o",
        "out",
    ];
    let run = simulate(desk.path(), &args);
    assert_eq!(
        run.status.code(),
        Some(0),
        "{:?}",
        String::from_utf8(run.stderr)
    );
    let text = String::from_utf8(run.stdout).unwrap();
    for part in [
        "torquer_scale_factor_ppm\n",
        "accelerometer_bias_ug, not known to the filter",
        "RMS error, ppm",
        "ug/g2",
        "claimed",
        "T_ZY",
        "NEES, parameters",
        "NIS as claimed",
        "compared with the",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
    assert!(
        text.lines().all(|line| line.chars().count() <= 80),
        "{text}"
    );
    let read = |name: &str| std::fs::read_to_string(desk.path().join(name)).unwrap();
    let page = read("r.html");
    for part in [
        "K_2Z, ug/g2",
        "T_XY, arcsec",
        "true σ",
        "(not known to the filter)",
    ] {
        assert!(page.contains(part), "{part}");
    }
    let document: Value = serde_json::from_str(&read("out/simulation.json")).unwrap();
    assert_eq!(document["compared_with"], "filter-and-considered");
    assert_eq!(document["told_azimuth_factor"], 1.0);
    let parameters = document["parameters"].as_array().unwrap();
    assert_eq!(parameters.len(), 33);
    let claims = |p: &&Value| p["claimed_sigma"].is_number();
    assert_eq!(parameters.iter().filter(claims).count(), 30);
    assert_eq!(document["nees_parameters"]["degrees_of_freedom"], 30);
    assert_eq!(document["nis"]["degrees_of_freedom"], 4);
    for name in ["out/curves.svg", "out/errors.svg"] {
        let svg = read(name);
        assert!(svg.contains("K_2Z") && !svg.contains("NaN"), "{name}");
    }
    assert!(read("out/errors.svg").contains("what the filter ignores included"));
    // What is planned is what `evaluate` says.
    let evaluated = Command::new(assert_cmd::cargo::cargo_bin!("scheme-opt"))
        .args(["evaluate", "-s", "s.csv", "-p", "full.toml", "--json"])
        .current_dir(desk.path())
        .output()
        .unwrap();
    let evaluated: Value = serde_json::from_slice(&evaluated.stdout).unwrap();
    for (simulated, known) in parameters
        .iter()
        .zip(evaluated["parameters"].as_array().unwrap())
    {
        assert_eq!(simulated["name"], known["name"]);
        let planned = simulated["planned_sigma"].as_f64().unwrap();
        let sigma = known["sigma"].as_f64().unwrap();
        assert!((planned / sigma - 1.0).abs() < 1e-6, "{simulated} {known}");
    }
}

#[test]
fn a_full_platform_is_swept_by_its_drift_alone() {
    let desk = tempfile::tempdir().unwrap();
    std::fs::write(desk.path().join("full.toml"), FULL).unwrap();
    let args = [
        "-p",
        "full.toml",
        "--runs",
        "4",
        "--sweep",
        "--filter",
        "linear",
        "--truth",
        "first-order",
    ];
    let run = simulate(desk.path(), &args);
    assert_eq!(run.status.code(), Some(0));
    let text = String::from_utf8(run.stdout).unwrap();
    let flat = text.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(
        flat.contains("the other parameters are drawn from their own priors"),
        "{text}"
    );
}
