//! The documented fields of the JSON documents.

use scheme_opt::internals::drift::DriftCoefficient;
use serde_json::Value;

pub fn text(value: &Value) -> &str {
    value.as_str().unwrap()
}

pub fn strings(value: &Value) -> Vec<&str> {
    value.as_array().unwrap().iter().map(text).collect()
}

pub fn sigmas(evaluation: &Value) -> Vec<f64> {
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

pub fn has_evaluation_fields(d: &Value) {
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

pub fn has_result_fields(d: &Value) {
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
