//! The JSON Schemas: committed, fresh, and true of every document.

use std::path::{Path, PathBuf};

use scheme_opt::internals::results::schema::DocumentKind;
use serde_json::Value;

use super::{Desk, SCHEDULE};

fn committed(kind: DocumentKind) -> PathBuf {
    let name = format!("docs/schema/{}.schema.json", kind.name());
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

#[test]
fn committed_schemas_are_fresh() {
    for kind in DocumentKind::ALL {
        let path = committed(kind);
        let fresh = kind.schema().unwrap();
        let found = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(
            found == fresh,
            "{} is stale: scheme-opt schema {} > {0}",
            path.display(),
            kind.name()
        );
    }
    let directory = committed(DocumentKind::Result);
    let files = std::fs::read_dir(directory.parent().unwrap()).unwrap();
    assert_eq!(files.count(), DocumentKind::ALL.len());
}

fn validate(kind: DocumentKind, document: &Value) {
    let schema: Value = serde_json::from_str(&kind.schema().unwrap()).unwrap();
    let validator = jsonschema::draft202012::new(&schema).unwrap();
    let errors: Vec<String> = validator
        .iter_errors(document)
        .map(|e| format!("{}: {e}", e.instance_path()))
        .collect();
    assert!(errors.is_empty(), "{}: {errors:?}", kind.name());
    // The schema says something: an empty object is none of these documents.
    let anything = kind == DocumentKind::Platform;
    assert_eq!(
        validator.is_valid(&serde_json::json!({})),
        anything,
        "{}",
        kind.name()
    );
}

/// Of a platform with more than the twelve coefficients.
pub fn validate_analysis(document: &Value) {
    validate(DocumentKind::Analysis, document);
}

/// Of a platform with more than the twelve coefficients.
pub fn validate_evaluation(document: &Value) {
    validate(DocumentKind::Evaluation, document);
    validate(DocumentKind::Platform, &document["inputs"]);
}

#[test]
fn every_document_validates_against_its_schema() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write(
        "stand.toml",
        "[prior]\nmisalignment_deg = [0.1, 0.2, 0.1]\n\
         g_sensitive_drift_deg_per_h_per_g = { input = 4.0, output = 8.0, spin = [8.0, 8.0, 4.0] }\n\
         [gimbals]\nbeta_deg = [-60, 60]\n[motion]\nslew_rate_deg_per_s = 1\nsettle_s = 20\n\
         start_deg = [0, 0, 0]\nreturn_to_start = true\n[objective]\ntotal_time_s = 8000\n\
         [objective.weights]\nD_IX = 4\n[objective.spec_deg_per_h]\ndefault = 0.02\nD_IX = 0.01\n\
         [search]\nstarts = 2\nmax_positions = 8\nfront_points = 3\n",
    );
    let given = ["-s", "s.csv", "-p", "stand.toml", "--json"];
    let document = |args: &[&str]| -> Value { serde_json::from_str(&desk.done(args)).unwrap() };

    desk.done(&[
        "search",
        "stand.toml",
        "--mode",
        "pareto",
        "-q",
        "-o",
        "out",
    ]);
    let result = desk.json("out/result.json");
    validate(DocumentKind::Platform, &result["inputs"]);
    validate(DocumentKind::Schedule, &desk.json("out/schedule.json"));
    validate(DocumentKind::Evaluation, &result["evaluation"]);
    validate(DocumentKind::Result, &result);
    for (kind, command) in [
        (DocumentKind::Evaluation, "evaluate"),
        (DocumentKind::Analysis, "analyze"),
        (DocumentKind::Commands, "commands"),
    ] {
        validate(kind, &document(&[&[command], &given[..]].concat()));
    }
    let simulate = ["simulate", "--runs", "8", "--sweep"];
    validate(
        DocumentKind::Simulation,
        &document(&[&simulate[..], &given[..]].concat()),
    );
    let compare = [
        "compare",
        "s.csv",
        "standard:axis-24",
        "standard:edges-12",
        "--best-order",
        "--order-steps",
        "500",
        "-p",
        "stand.toml",
    ];
    validate(
        DocumentKind::Comparison,
        &document(&[&compare[..], &["--json"]].concat()),
    );
    validate(
        DocumentKind::Bound,
        &document(&["bound", "stand.toml", "--json"]),
    );
    desk.write("wrong.toml", "[site]\nlatitude = 1\n");
    let run = desk.run(&["batch", "stand.toml", "wrong.toml", "--json"]);
    validate(
        DocumentKind::Batch,
        &serde_json::from_str(&run.stdout).unwrap(),
    );
    validate(DocumentKind::Standard, &document(&["standard", "--json"]));
    validate(DocumentKind::Documents, &document(&["schema", "--json"]));
}

#[test]
fn schemas_are_printed_and_listed() {
    let desk = Desk::new();
    for kind in DocumentKind::ALL {
        assert_eq!(desk.done(&["schema", kind.name()]), kind.schema().unwrap());
        assert!(desk.done(&["schema"]).contains(kind.name()));
    }
    let run = desk.run(&["schema", "evaluatoin"]);
    assert_eq!(run.code, Some(2));
    assert!(run.stderr.contains("evaluation"), "{}", run.stderr);
}
