//! The program as a user runs it: every command, every kind of bad input, every exit code.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use scheme_opt::drift::DriftCoefficient;
use scheme_opt::schedule::file;
use serde_json::Value;
use tempfile::TempDir;

/// A directory of its own to run the program in.
struct Desk(TempDir);

impl Desk {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), content).unwrap();
    }

    fn text(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.text(name)).unwrap()
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin!("scheme-opt"));
        command.args(args).current_dir(self.0.path());
        command.env_remove("RUST_BACKTRACE");
        command
    }

    fn run(&self, args: &[&str]) -> Run {
        Run::of(self.command(args).output().unwrap())
    }

    /// Runs what must succeed; gives its stdout.
    fn done(&self, args: &[&str]) -> String {
        let run = self.run(args);
        assert_eq!(run.code, Some(0), "{args:?}: {}", run.stderr);
        run.stdout
    }

    /// Names of the files here, sorted.
    fn files(&self) -> Vec<String> {
        names(self.0.path())
    }
}

fn names(directory: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(directory).unwrap();
    let mut names: Vec<String> = entries
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

/// What a run left behind.
struct Run {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

impl Run {
    fn of(output: Output) -> Self {
        Self {
            code: output.status.code(),
            stdout: String::from_utf8(output.stdout).unwrap(),
            stderr: String::from_utf8(output.stderr).unwrap(),
        }
    }

    /// Refused as bad input, with a message that contains all of `parts`.
    fn refused(&self, parts: &[&str]) {
        assert_eq!(self.code, Some(2), "{}", self.stderr);
        assert_eq!(self.stdout, "");
        assert!(self.stderr.starts_with("error: "), "{}", self.stderr);
        assert!(!self.stderr.contains("panicked"), "{}", self.stderr);
        for part in parts {
            assert!(self.stderr.contains(part), "`{part}` in: {}", self.stderr);
        }
    }
}

const SCHEDULE: &str = "alpha_deg,beta_deg,gamma_deg,dwell_s\n\
                        10,20,30,1000\n50,-40,100,1500\n-120,30,0,1200\n\
                        170,10,-80,900\n-60,-50,200,1100\n95,55,-145,1300\n";

// ---------------------------------------------------------------- bad input

#[test]
fn bad_platform_files_are_refused_by_line_key_and_value() {
    let cases: &[(&str, &[&str])] = &[
        (
            "[site]\nlatitude = 28.2\n",
            &[
                "bad.toml:2",
                "site.latitude",
                "unknown key",
                "did you mean `latitude_deg`?",
            ],
        ),
        (
            "[sight]\nlatitude_deg = 1\n",
            &["bad.toml:1", "sight", "site"],
        ),
        (
            "[site]\nlatitude_deg = \"north\"\n",
            &["bad.toml:2", "site.latitude_deg", "\"north\"", "a number"],
        ),
        (
            "[motion]\n\nmeasure_moves = 1\n",
            &["bad.toml:3", "motion.measure_moves", "true or false"],
        ),
        (
            "[site]\nlatitude_deg = nan\n",
            &["bad.toml:2", "site.latitude_deg", "NaN", "-90 to 90"],
        ),
        (
            "[filter]\nperiod_s = inf\n",
            &["bad.toml:2", "filter.period_s", "inf", "0.001 to 100000"],
        ),
        (
            "[site]\nlatitude_deg = 95\n",
            &["bad.toml:2", "site.latitude_deg = 95", "-90 to 90"],
        ),
        (
            "[accelerometer]\nnoise_g = 0.0\n",
            &["bad.toml:2", "accelerometer.noise_g = 0", "1e-12 to 1"],
        ),
        (
            "[motion]\nslew_rate_deg_per_s = 0\n",
            &[
                "bad.toml:2",
                "motion.slew_rate_deg_per_s = 0",
                "1e-6 to 1e6",
            ],
        ),
        (
            "[motion]\nmin_dwell_s = 500\n[objective]\ntotal_time_s = 400\n",
            &[
                "bad.toml:4",
                "objective.total_time_s = 400",
                "motion.min_dwell_s = 500",
            ],
        ),
        (
            "[objective]\ncriterion = \"b\"\n",
            &["bad.toml:2", "objective.criterion", "max-ratio"],
        ),
        (
            "[objective]\nmode = \"pareto\"\n",
            &["bad.toml", "objective.mode = \"pareto\"", "\"accuracy\""],
        ),
        (
            "[gimbals]\nbeta_deg = [60, -60]\n",
            &["bad.toml:2", "gimbals.beta_deg", "[60, -60]", "low <= high"],
        ),
        (
            "[gimbals]\nstep_deg = 15\n",
            &["bad.toml", "gimbals.step_deg", "index table"],
        ),
        ("[site\n", &["bad.toml:1"]),
    ];
    for (content, parts) in cases {
        let desk = Desk::new();
        desk.write("bad.toml", content);
        desk.run(&["search", "bad.toml"]).refused(parts);
        assert_eq!(desk.files(), ["bad.toml"], "{content}");
    }
}

#[test]
fn bad_schedules_are_refused_by_line_key_and_value() {
    let head = "alpha_deg,beta_deg,gamma_deg,dwell_s\n";
    let position = r#"{"alpha_deg": 0, "beta_deg": 0, "gamma_deg": 0, "dwell_s": 10}"#;
    let table: &[(&str, String, &[&str])] = &[
        (
            "bad.csv",
            format!("{head}0,0,0,60\n0,0,0,-5\n"),
            &["bad.csv:3", "positions[1].dwell_s = -5", "0 to 1e7"],
        ),
        (
            "bad.csv",
            format!("{head}0,NaN,0,60\n"),
            &["bad.csv:2", "positions[0].beta_deg", "NaN"],
        ),
        ("bad.csv", head.to_owned(), &["bad.csv", "positions"]),
        ("bad.csv", String::new(), &["bad.csv"]),
        (
            "bad.csv",
            "alpha_deg,beta_deg,gamma_deg,dwell\n0,0,0,1\n".to_owned(),
            &["bad.csv:1", "dwell", "did you mean `dwell_s`?"],
        ),
        (
            "bad.json",
            r#"{"schema": "scheme-opt/schedule/1", "positions": []}"#.to_owned(),
            &["bad.json", "positions", "1 to 10000"],
        ),
        (
            "bad.json",
            format!(
                "{{\"positions\": [\n{position},\n{}]}}",
                position.replace("10", "-10")
            ),
            &["bad.json:3", "positions[1].dwell_s = -10", "0 to 1e7"],
        ),
        (
            "bad.json",
            format!("{{\"positions\": [{}]}}", position.replace("10", "\"x\"")),
            &["bad.json:1", "positions[0].dwell_s", "a number"],
        ),
        (
            "bad.json",
            format!(
                "{{\"positions\": [{}]}}",
                position.replace("beta_deg", "betta_deg")
            ),
            &["bad.json:1", "betta_deg", "did you mean `beta_deg`?"],
        ),
    ];
    for (name, content, parts) in table {
        let desk = Desk::new();
        desk.write(name, content);
        desk.run(&["evaluate", "--schedule", name]).refused(parts);
        assert_eq!(desk.files(), [*name]);
    }
}

#[test]
fn what_the_platform_cannot_do_names_the_schedule_file() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write("p.toml", "[gimbals]\nbeta_deg = [-45, 45]\n");
    let run = desk.run(&["evaluate", "--schedule", "s.csv", "--platform", "p.toml"]);
    run.refused(&["s.csv", "positions[4].beta_deg = -50", "-45 to 45"]);
}

#[test]
fn unreadable_files_are_refused() {
    let desk = Desk::new();
    desk.write("latin.toml", b"[site]\n# \xb0\nlatitude_deg = 1\n");
    desk.write("latin.csv", b"alpha_deg\xb0\n");
    desk.run(&["search", "latin.toml"])
        .refused(&["latin.toml:2", "UTF-8"]);
    desk.run(&["evaluate", "-s", "latin.csv"])
        .refused(&["latin.csv:1", "UTF-8"]);
    desk.run(&["search", "none.toml"])
        .refused(&["none.toml", "cannot read the file"]);
    desk.run(&["evaluate", "-s", "none.csv"])
        .refused(&["none.csv", "cannot read the file"]);
    desk.run(&["evaluate", "-s", "."]).refused(&["directory"]);
    assert_eq!(desk.files(), ["latin.csv", "latin.toml"]);
}

#[test]
fn unwritable_outputs_are_reported_before_the_search() {
    let desk = Desk::new();
    desk.write("file", "kept");
    // The search alone would take far longer than a test.
    let long = ["search", "--starts", "100000", "-o"];
    for (target, part) in [("file", "file"), ("file/below", "file/below")] {
        let args: Vec<&str> = long.iter().copied().chain([target]).collect();
        desk.run(&args).refused(&[part, "output directory"]);
    }
    std::fs::create_dir_all(desk.path("out/result.json")).unwrap();
    let args: Vec<&str> = long.iter().copied().chain(["out"]).collect();
    desk.run(&args).refused(&["result.json", "directory"]);
    assert_eq!(names(&desk.path("out")), ["result.json"]);
    assert_eq!(desk.text("file"), "kept");

    desk.run(&["standard", "faces-6", "-o", "file/below.json"])
        .refused(&["below.json"]);
    desk.run(&["init", "file/below.toml"])
        .refused(&["below.toml"]);
    assert_eq!(desk.files(), ["file", "out"]);
}

#[test]
fn bad_usage_is_refused() {
    let desk = Desk::new();
    let table: &[(&[&str], &[&str])] = &[
        (&["search", "--frobnicate"], &["--frobnicate"]),
        (
            &["search", "--mode", "tme"],
            &["'tme'", "accuracy", "pareto", "'time'"],
        ),
        (&["search", "--criterion", "z"], &["'z'", "max-ratio"]),
        (&["search", "--seed", "-1"], &["--seed"]),
        (
            &["search", "--total-time-s", "long"],
            &["'long'", "--total-time-s"],
        ),
        (
            &["search", "--total-time-s", "nan"],
            &["objective.total_time_s = NaN", "--total-time-s"],
        ),
        (
            &["search", "--total-time-s", "-3"],
            &["objective.total_time_s = -3", "--total-time-s"],
        ),
        (
            &["search", "--total-time-s", "5"],
            &["objective.total_time_s = 5", "60"],
        ),
        (
            &["search", "--time-limit-s", "0"],
            &["search.time_limit_s = 0", "--time-limit-s"],
        ),
        (
            &["search", "--time-limit-s", "inf"],
            &["search.time_limit_s = inf"],
        ),
        (
            &["search", "--threads", "0"],
            &["search.threads = 0", "--threads"],
        ),
        (
            &["search", "--starts", "0"],
            &["search.starts = 0", "--starts"],
        ),
        (
            &["search", "--max-positions", "0"],
            &["search.max_positions = 0"],
        ),
        (
            &["search", "--mode", "pareto"],
            &["objective.mode = \"pareto\"", "accuracy"],
        ),
        (
            &["search", "--criterion", "max-ratio"],
            &["objective.criterion", "spec_deg_per_h"],
        ),
        (&["evaluate"], &["--schedule"]),
        (
            &["standard", "faces6"],
            &["faces6", "icosahedron-12", "did you mean `faces-6`?"],
        ),
        (
            &["standard", "faces-6", "--format", "xml"],
            &["'xml'", "csv"],
        ),
        (
            &["standard", "faces-6", "--total-time-s", "0"],
            &["objective.total_time_s = 0"],
        ),
        (&["serch"], &["'serch'", "search"]),
    ];
    for (args, parts) in table {
        desk.run(args).refused(parts);
    }
    assert_eq!(desk.run(&[]).code, Some(2));
    assert!(desk.files().is_empty(), "{:?}", desk.files());
}

// ---------------------------------------------------------------- the commands

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
    assert_eq!(written, ["result.json", "schedule.csv", "schedule.json"]);
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
    assert_eq!(compared + skipped.len(), 8);
    assert_eq!(skipped[0]["name"], "axis-24");
    assert!(text(&skipped[0]["reason"]).contains("beta_deg"));

    let quiet: Vec<&str> = args.into_iter().chain(["--quiet"]).collect();
    assert_eq!(desk.run(&quiet).stderr, "");
}

#[test]
fn equal_inputs_give_equal_bytes_whatever_the_number_of_threads() {
    let desk = Desk::new();
    let outputs = ["1", "2"].map(|threads| {
        let run = ["search", "--starts", "4", "--reproducible", "--json"];
        let args = [&run[..], &["--threads", threads, "-o", threads]].concat();
        desk.done(&args)
    });
    assert_eq!(outputs[0], outputs[1]);
    assert!(!outputs[0].contains("wall_time_s"));
    for name in ["schedule.json", "schedule.csv", "result.json"] {
        assert_eq!(
            desk.text(&format!("1/{name}")),
            desk.text(&format!("2/{name}"))
        );
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
    let inputs: scheme_opt::study::StudyConfig =
        serde_json::from_value(document["inputs"].clone()).unwrap();
    assert_eq!(document["evaluation"]["score"]["criterion_name"], "d");
    let study = inputs.check().unwrap();
    let schedule = file::from_json(&document["schedule"].to_string()).unwrap();
    let evaluation = study.evaluator().evaluate(&schedule).unwrap();
    let criterion = document["evaluation"]["score"]["criterion"]
        .as_f64()
        .unwrap();
    assert!((evaluation.score.criterion / criterion - 1.0).abs() < 1e-9);
    let typed: scheme_opt::results::ResultDocument =
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
    assert_eq!(names(&desk.path("out")).len(), 3);
}

#[test]
fn limits_that_cannot_be_met_give_exit_code_1_and_the_nearest() {
    let desk = Desk::new();
    desk.write("p.toml", "[objective.score]\nminimum_separability = 0.9\n");
    let run = desk.run(&["search", "p.toml", "--starts", "1", "-o", "out"]);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert!(run.stdout.contains("infeasible: "), "{}", run.stdout);
    assert_eq!(desk.json("out/result.json")["status"], "infeasible");
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
    assert_eq!(names(&desk.path("out")).len(), 3);
}

// ---------------------------------------------------------------- documents

fn text(value: &Value) -> &str {
    value.as_str().unwrap()
}

fn strings(value: &Value) -> Vec<&str> {
    value.as_array().unwrap().iter().map(text).collect()
}

fn sigmas(evaluation: &Value) -> Vec<f64> {
    let coefficients = evaluation["coefficients"].as_array().unwrap();
    coefficients
        .iter()
        .map(|c| c["sigma_deg_per_h"].as_f64().unwrap())
        .collect()
}

fn has_numbers(value: &Value, keys: &[&str]) {
    for key in keys {
        assert!(value[key].is_number(), "{key}: {}", value[key]);
    }
}

fn has_evaluation_fields(d: &Value) {
    assert_eq!(d["schema"], "scheme-opt/evaluation/1");
    assert_eq!(d["tool_version"], env!("CARGO_PKG_VERSION"));
    has_numbers(
        d,
        &[
            "total_time_s",
            "overhead_s",
            "rms_sigma_deg_per_h",
            "max_sigma_deg_per_h",
            "max_eig_sigma_deg_per_h",
            "logdet_deg_per_h",
            "agreement",
        ],
    );
    let score = &d["score"];
    has_numbers(
        score,
        &[
            "value",
            "criterion",
            "covariance_part",
            "separability_part",
            "least_separability",
        ],
    );
    assert!(score["criterion_name"].is_string() && score["weights"]["covariance"].is_number());
    assert!(score["meets_minimum_separability"].is_boolean());
    let names: Vec<&str> = d["misalignment"]
        .as_array()
        .unwrap()
        .iter()
        .map(|m| text(&m["name"]))
        .collect();
    assert_eq!(names, ["psi_nx", "psi_ny", "psi_nz"]);
    has_numbers(&d["misalignment"][0], &["sigma_arcsec"]);
    let coefficients = d["coefficients"].as_array().unwrap();
    let samples = d["convergence"]["times_s"].as_array().unwrap().len();
    assert_eq!(coefficients.len(), DriftCoefficient::ALL.len());
    for (c, expected) in coefficients.iter().zip(DriftCoefficient::ALL) {
        assert_eq!(c["name"], expected.name());
        has_numbers(
            c,
            &[
                "prior_sigma_deg_per_h",
                "sigma_deg_per_h",
                "observability_order",
                "separability_first_order",
                "separability",
            ],
        );
        let curve = &d["convergence"]["sigma_deg_per_h"][expected.name()];
        assert_eq!(curve.as_array().unwrap().len(), samples);
    }
    has_numbers(
        &d["observability"],
        &["rank", "unknowns", "condition_number"],
    );
    assert!(d["observability"]["unobservable"].is_array());
    has_numbers(
        &d["convergence"]["positions"][1],
        &["start_s", "end_s", "rms_sigma_deg_per_h", "decades_per_h"],
    );
    assert_eq!(d["schedule"]["schema"], "scheme-opt/schedule/1");
    assert!(d["inputs"]["prior"].is_object() && d["defaulted"].is_array());
}

fn has_result_fields(d: &Value) {
    assert_eq!(d["schema"], "scheme-opt/result/1");
    assert_eq!(d["tool_version"], env!("CARGO_PKG_VERSION"));
    assert!(d["status"].is_string() && d["reason"].is_string());
    assert_eq!(d["schedule"]["schema"], "scheme-opt/schedule/1");
    has_evaluation_fields(&d["evaluation"]);
    has_numbers(
        &d["baselines"][0],
        &[
            "positions",
            "rms_sigma_deg_per_h",
            "ratio",
            "criterion",
            "criterion_ratio",
        ],
    );
    assert!(d["baselines"][0]["name"].is_string());
    has_numbers(&d["counters"], &["evaluations", "gradients", "starts"]);
    assert!(d["seed"].is_u64());
    assert!(d["inputs"]["site"].is_object() && d["defaulted"].is_array());
}
