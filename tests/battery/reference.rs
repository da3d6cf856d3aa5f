//! Schedules whose covariance other people's filters have found, in 400 bits or more.

use std::path::{Path, PathBuf};

use scheme_opt::internals::drift::DriftCoefficient;
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::schedule::Schedule;
use scheme_opt::internals::schedule::file::from_json;
use serde_json::Value;

/// A schedule with the covariance that an independent dense Kalman filter found.
pub struct ReferenceCase {
    pub name: String,
    pub config: PlatformConfig,
    pub schedule: Schedule,
    pub total_time_s: f64,
    pub sigma_deg_per_h: Vec<f64>,
    pub misalignment_arcsec: [f64; 3],
    pub rms: f64,
    pub max: f64,
    pub logdet: f64,
    pub max_eig: f64,
}

/// All cases of tests/reference (see SOURCES.md there), by name.
pub fn reference_cases() -> Vec<ReferenceCase> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference");
    let mut files: Vec<PathBuf> = std::fs::read_dir(directory)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "json"))
        .collect();
    files.sort();
    files.iter().map(|path| read_case(path)).collect()
}

fn read_case(path: &Path) -> ReferenceCase {
    let text = std::fs::read_to_string(path).unwrap();
    let case: Value = serde_json::from_str(&text).unwrap();
    let number = |v: &Value| v.as_f64().unwrap();
    let sigma = &case["sigma"];
    ReferenceCase {
        name: case["name"].as_str().unwrap().to_owned(),
        config: serde_json::from_value(case["platform"].clone()).unwrap(),
        schedule: from_json(&case["schedule"].to_string()).unwrap(),
        total_time_s: number(&case["total_time_s"]),
        sigma_deg_per_h: DriftCoefficient::ALL
            .iter()
            .map(|c| number(&sigma[c.name()]))
            .collect(),
        misalignment_arcsec: ["psi_nx_arcsec", "psi_ny_arcsec", "psi_nz_arcsec"]
            .map(|key| number(&sigma[key])),
        rms: number(&case["rms_sigma_deg_per_h"]),
        max: number(&case["max_sigma_deg_per_h"]),
        logdet: number(&case["logdet_deg_per_h"]),
        max_eig: number(&case["max_eig_sigma_deg_per_h"]),
    }
}
