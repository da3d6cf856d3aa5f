//! Reference cases: dense filters of 400 bits, written by other people in another language.

use super::super::super::mixing::{Mixing, Parameters};
use super::names::{PAPER, group, parameter};
use crate::covariance::{CovarianceModel, TickRule};
use crate::criterion::Criterion;
use crate::drift::DriftCoefficient;
use crate::motion::Timeline;
use crate::platform::{Platform, PlatformConfig};
use crate::schedule::Schedule;

/// A reference case with the parameters of its platform.
struct Case {
    name: String,
    platform: Platform,
    schedule: Schedule,
    parameters: Parameters,
    names: Vec<String>,
    document: serde_json::Value,
}

/// The cases without coloured noise and azimuth.
fn cases() -> Vec<Case> {
    let directory = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference/full");
    let mut files: Vec<_> = std::fs::read_dir(directory)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "json"))
        .collect();
    files.sort();
    let documents = files.iter().map(|path| {
        let text = std::fs::read_to_string(path).unwrap();
        serde_json::from_str::<serde_json::Value>(&text).unwrap()
    });
    let coloured = |platform: &serde_json::Value| {
        let has =
            |table: &str, keys: &[&str]| keys.iter().any(|key| platform[table].get(*key).is_some());
        platform.get("azimuth").is_some()
            || has(
                "gyro",
                &[
                    "bias_instability_deg_per_h",
                    "rate_random_walk_deg_per_h_per_sqrt_h",
                ],
            )
            || has("accelerometer", &["bias_instability_ug"])
    };
    documents
        .filter(|document| !coloured(&document["platform"]))
        .map(read)
        .collect()
}

fn read(document: serde_json::Value) -> Case {
    let mut config = document["platform"].clone();
    let errors = config["errors"].clone();
    config.as_object_mut().unwrap().remove("errors");
    let mut output = PAPER;
    if let Some(axes) = config["gyro"]
        .as_object_mut()
        .unwrap()
        .remove("output_axis")
    {
        for (k, name) in ["X", "Y", "Z"].iter().enumerate() {
            for e in 0..3 {
                output[k][e] = axes[name][e].as_f64().unwrap();
            }
        }
    }
    let config: PlatformConfig = serde_json::from_value(config).unwrap();
    let platform = config.check().unwrap();
    let schedule = crate::schedule::file::from_json(&document["schedule"].to_string()).unwrap();
    let (mut names, mut estimated, mut considered) = (Vec::new(), Vec::new(), Vec::new());
    for (key, value) in errors.as_object().unwrap() {
        if key == "considered" {
            for (key, value) in value.as_object().unwrap() {
                for name in group(key) {
                    considered.push(parameter(&name, &output, value.as_f64().unwrap()));
                }
            }
            continue;
        }
        for name in group(key) {
            estimated.push(parameter(&name, &output, value.as_f64().unwrap()));
            names.push(name);
        }
    }
    let sigma = *CovarianceModel::new(&platform).prior_sigma_deg_per_h();
    names.extend(DriftCoefficient::ALL.map(|c| c.name().to_owned()));
    Case {
        name: document["name"].as_str().unwrap().to_owned(),
        parameters: Parameters {
            coefficients: DriftCoefficient::ALL
                .map(|c| parameter(c.name(), &output, sigma[c.index()])),
            weighted: Vec::new(),
            estimated,
            considered,
        },
        platform,
        schedule,
        names,
        document,
    }
}

#[test]
fn reference_cases_are_met_to_1e_6() {
    let cases = cases();
    assert_eq!(cases.len(), 10);
    for case in cases {
        let model = CovarianceModel::new(&case.platform);
        let mixing = Mixing::new(&case.parameters).unwrap();
        let timeline = Timeline::new(&case.platform, &case.schedule).unwrap();
        let end = model
            .wide_end(&mixing, &timeline, TickRule::Filter)
            .unwrap();
        let check = |found: &[f64], key: &str| {
            let mut largest = 0.0_f64;
            for (name, found) in case.names.iter().zip(found) {
                let expected = case.document[key][name].as_f64().unwrap();
                let error = (found / expected - 1.0).abs();
                assert!(error < 1e-6, "{}: {key} of {name} {error:e}", case.name);
                largest = largest.max(error);
            }
            println!("{}: {key} to {largest:.1e}", case.name);
        };
        check(&end.sigma, "sigma");
        let rms = model.wide_value(&mixing, &timeline, TickRule::Filter, |p| {
            Criterion::rms().value(p)
        });
        let expected = case.document["rms_sigma_deg_per_h"].as_f64().unwrap();
        assert!(
            (rms.unwrap() / expected - 1.0).abs() < 1e-6,
            "{}: rms",
            case.name
        );
        if case.parameters.considered.is_empty() {
            let psi = end.misalignment.diagonal().map(f64::sqrt);
            for i in 0..3 {
                let expected = case.document["misalignment_sigma_arcsec"][i]
                    .as_f64()
                    .unwrap();
                assert!((psi[i] / expected - 1.0).abs() < 1e-6, "{}: psi", case.name);
            }
        } else {
            check(&end.claimed_sigma, "claimed_sigma");
        }
    }
}
