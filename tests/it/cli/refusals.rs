//! Bad input of every kind: exit code 2, a message that helps, nothing written.

use super::{Desk, SCHEDULE, names};

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
            "[objective]\naccept_unobservable = [\"D_IZ\", \"D_IQ\"]\n",
            &[
                "bad.toml:2",
                "objective.accept_unobservable",
                "\"D_IQ\"",
                "\"D_FX\", \"D_FY\"",
                "did you mean `D_I",
            ],
        ),
        (
            "[objective]\naccept_unobservable = \"D_IZ\"\n",
            &[
                "bad.toml:2",
                "objective.accept_unobservable = \"D_IZ\"",
                "a list of names",
            ],
        ),
        (
            "[objective]\naccept_unobservable = [3]\n",
            &["bad.toml:2", "objective.accept_unobservable"],
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
            "[objective]\nmode = \"time\"\n",
            &["bad.toml", "objective.mode", "spec_deg_per_h"],
        ),
        (
            "[gimbals]\nbeta_deg = [60, -60]\n",
            &["bad.toml:2", "gimbals.beta_deg", "[60, -60]", "low <= high"],
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
            &["bad.csv:1", "dwell", "does not say its unit", "dwell_s"],
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
fn what_limits_a_search_does_not_stop_an_evaluation() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write(
        "p.toml",
        "[motion]\nmin_dwell_s = 500\n[objective]\ntotal_time_s = 400\n",
    );
    for command in ["evaluate", "analyze", "simulate"] {
        desk.done(&[command, "-s", "s.csv", "--platform", "p.toml", "--json"]);
    }
    desk.run(&["search", "p.toml"]).refused(&["p.toml:4"]);
    desk.write("p.toml", "[objective]\ntotal_time_s = -1\n");
    desk.run(&["evaluate", "-s", "s.csv", "--platform", "p.toml"])
        .refused(&["p.toml:2", "objective.total_time_s = -1"]);
}

/// Whatever is wrong in a profile is said of the profile, not of the platform file that names it.
#[test]
fn faults_of_a_profile_name_the_profile() {
    let desk = Desk::new();
    let header = "time_s,f_x,f_y,f_z";
    let cases: &[(String, &[&str])] = &[
        (
            format!("{header}\n0,0,1,0\n0,0,1,0\n"),
            &["flight.csv:3", "time_s = 0", "greater than"],
        ),
        (
            format!("{header}\n0,0,nan,0\n1,0,1,0\n"),
            &["flight.csv:2", "f_y = nan"],
        ),
        (
            format!("{header},w_x\n0,0,1,0,1\n1,0,1,0,1\n"),
            &["flight.csv:1", "w_y", "w_x, w_y, w_z or none"],
        ),
        (
            format!("{header}\n0,0,1,0\n"),
            &["flight.csv", "two or more"],
        ),
        (
            format!("{header},w_x,w_y,w_z\n0,0,1,0,9e3,0,0\n1e9,0,1,0,0,0,0\n"),
            &["flight.csv:3", "w_x = 9000", "deg in all"],
        ),
    ];
    desk.write(
        "p.toml",
        "[objective]\ncriterion = \"use\"\nuse = \"flight.csv\"\n",
    );
    for (profile, parts) in cases {
        desk.write("flight.csv", profile);
        let run = desk.run(&["bound", "p.toml"]);
        run.refused(parts);
        assert!(!run.stderr.contains("p.toml"), "{}", run.stderr);
    }
}

#[test]
fn unreadable_files_are_refused() {
    let desk = Desk::new();
    desk.write("latin.toml", b"[site]\n# \xb0\nlatitude_deg = 1\n");
    desk.write("latin.csv", b"alpha_deg\xb0\n");
    desk.run(&["search", "latin.toml"])
        .refused(&["latin.toml:2", "UTF-8"]);
    desk.run(&["evaluate", "-s", "latin.csv"])
        .refused(&["latin.csv:1", "names the columns"]);
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
            &["search", "--mode", "time"],
            &["objective.mode", "spec_deg_per_h"],
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
