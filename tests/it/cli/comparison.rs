//! `compare` as a user runs it.

use serde_json::Value;

use super::{Desk, SCHEDULE};

const STAND: &str = "[motion]\nslew_rate_deg_per_s = 1.0\nsettle_s = 20\n\
                     [objective]\ntotal_time_s = 9000\n\
                     [objective.spec_deg_per_h]\ndefault = 0.02\n";

#[test]
fn schedules_are_compared_in_the_same_time() {
    let desk = Desk::new();
    desk.write("stand.toml", STAND);
    desk.write("mine.csv", SCHEDULE);
    let args = [
        "compare",
        "mine.csv",
        "standard:edges-12",
        "standard:faces-12",
        "--best-order",
        "--order-steps",
        "1000",
        "--platform",
        "stand.toml",
    ];
    let shown = desk.done(&args);
    for part in [
        "mine.csv +",
        "edges-12 +",
        "with their dwells in the best order found",
        "faces-12 +",
        "the best order found: a better one may exist",
        "in spec",
        "D_SZ",
        "9000 s",
    ] {
        assert!(shown.contains(part), "{part} in:\n{shown}");
    }
    assert!(shown.lines().all(|l| l.chars().count() <= 80), "{shown}");

    let json = desk.done(&[args.as_slice(), &["--json"]].concat());
    let document: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(document["schema"], "scheme-opt/comparison/1");
    assert_eq!(document["total_time_s"], 9000.0);
    let schedules = document["schedules"].as_array().unwrap();
    let names: Vec<_> = schedules
        .iter()
        .map(|s| (s["name"].as_str().unwrap(), s["order"].as_str().unwrap()))
        .collect();
    assert_eq!(
        names,
        [
            ("mine.csv", "as-given"),
            ("mine.csv", "best-found"),
            ("standard:edges-12", "as-given"),
            ("standard:edges-12", "best-found"),
            ("standard:faces-12", "as-given"),
            ("standard:faces-12", "best-found"),
        ]
    );
    // Cut short, nothing is called the best.
    assert!(!shown.contains("best order:"), "{shown}");
    assert_eq!(schedules[1]["order_proof"], "own-dwells");
    for k in [3, 5] {
        assert_eq!(schedules[k]["order_proof"], "step-limit");
        assert!(schedules[k]["order_steps"].as_u64().unwrap() >= 1000);
    }
    assert_eq!(schedules[2]["order_proof"], Value::Null);
    let rms = |k: usize| schedules[k]["rms_sigma_deg_per_h"].as_f64().unwrap();
    assert!(rms(1) < rms(0) && rms(3) < rms(2) && rms(5) < rms(4));
    // The dwells went with their positions.
    let held = |k: usize| -> Vec<(f64, f64)> {
        let positions = schedules[k]["schedule"]["positions"].as_array().unwrap();
        let number = |p: &Value, key: &str| p[key].as_f64().unwrap();
        let mut held: Vec<(f64, f64)> = (positions.iter())
            .map(|p| (number(p, "dwell_s"), number(p, "alpha_deg")))
            .collect();
        held.sort_by(|a, b| a.partial_cmp(b).unwrap());
        held
    };
    let alphas = |k: usize| held(k).into_iter().map(|(_, alpha)| alpha);
    assert!(alphas(0).eq(alphas(1)), "{:?} {:?}", held(0), held(1));
    for s in schedules {
        let total = s["total_time_s"].as_f64().unwrap();
        assert!(total <= 9000.0 + 1e-6 && total > 8990.0, "{total}");
        assert_eq!(s["coefficients"].as_array().unwrap().len(), 12);
        let ratio = s["ratio"].as_f64().unwrap();
        assert!((ratio - s["rms_sigma_deg_per_h"].as_f64().unwrap() / rms(0)).abs() < 1e-12);
    }
    assert!(schedules[3]["time_to_spec_s"].as_f64().unwrap() < 9000.0);
    // The schedule in the document gives the same number again.
    desk.write("again.json", schedules[3]["schedule"].to_string());
    let again = desk.done(&["evaluate", "-s", "again.json", "-p", "stand.toml", "--json"]);
    let again: Value = serde_json::from_str(&again).unwrap();
    assert_eq!(
        again["rms_sigma_deg_per_h"],
        schedules[3]["rms_sigma_deg_per_h"]
    );
}

#[test]
fn a_best_order_is_proven_or_not_called_so() {
    let desk = Desk::new();
    let args = ["compare", "standard:faces-6", "--best-order"];
    let shown = desk.done(&args);
    for part in [
        "faces-6 *",
        "in their best order: all orders were gone through",
    ] {
        assert!(shown.contains(part), "{part} in:\n{shown}");
    }
    let json = desk.done(&[&args[..], &["--json", "--report", "report.html"]].concat());
    let document: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(document["schedules"][1]["order"], "best");
    assert_eq!(document["schedules"][1]["order_proof"], "complete");
    let page = desk.text("report.html");
    assert!(page.contains("faces-6, best order (proven)"));

    let many = ["compare", "standard:cube-18", "--best-order"];
    let shown = desk.done(&many);
    assert!(
        shown.contains("cube-18 +") && shown.contains("a better one may exist"),
        "{shown}"
    );
    let json = desk.done(&[&many[..], &["--json", "--report", "many.html"]].concat());
    let document: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(document["schedules"][1]["order"], "best-found");
    assert_eq!(
        document["schedules"][1]["order_proof"],
        "too-many-positions"
    );
    let page = desk.text("many.html");
    assert!(page.contains("cube-18, best order found") && !page.contains("(proven)"));
}

#[test]
fn schedules_may_keep_their_own_time() {
    let desk = Desk::new();
    desk.done(&[
        "standard",
        "faces-6",
        "--total-time-s",
        "3000",
        "-o",
        "short.json",
    ]);
    let json = desk.done(&["compare", "short.json", "--as-given", "--json"]);
    let document: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(document["total_time_s"], Value::Null);
    assert_eq!(document["schedules"][0]["total_time_s"], 3000.0);
    assert_eq!(document["schedules"][0]["order"], "as-given");
}

#[test]
fn what_cannot_be_compared_is_said() {
    let desk = Desk::new();
    desk.write("stand.toml", "[gimbals]\nbeta_deg = [-60, 60]\n");
    let shown = desk.done(&["compare", "--standard", "-p", "stand.toml"]);
    assert!(shown.contains("axis-24: not run"), "{shown}");
    assert!(shown.contains("icosahedron-12"), "{shown}");
    let alone = desk.run(&["compare", "standard:axis-24", "-p", "stand.toml"]);
    assert_eq!(alone.code, Some(1));
    assert!(alone.stdout.contains("not run"), "{}", alone.stdout);
    for (args, parts) in [
        (vec!["compare"], vec!["SCHEDULE"]),
        (
            vec!["compare", "standard:faces-7"],
            vec!["did you mean `faces-6`?"],
        ),
        (vec!["compare", "missing.json"], vec!["missing.json"]),
    ] {
        let run = desk.run(&args);
        assert_eq!(run.code, Some(2), "{args:?}");
        for part in parts {
            assert!(run.stderr.contains(part), "{part} in {}", run.stderr);
        }
    }
}
