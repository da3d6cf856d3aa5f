//! Platforms with the full error model, whose covariance other people's filters have found.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::schedule::Schedule;
use scheme_opt::internals::schedule::file::from_json;
use serde_json::Value;

/// A case of the full error model, by the names of parameters and groups.
pub struct FullCase {
    pub name: String,
    pub config: PlatformConfig,
    pub schedule: Schedule,
    pub total_time_s: f64,
    pub sigma: BTreeMap<String, f64>,
    /// Empty where nothing is considered.
    pub claimed_sigma: BTreeMap<String, f64>,
    pub misalignment_arcsec: Option<[f64; 3]>,
    pub rms_sigma_deg_per_h: f64,
    pub ignored: BTreeMap<String, f64>,
    /// Of D_F under a random walk; empty without one.
    pub constant_part_sigma: BTreeMap<String, f64>,
}

/// Keys of noise that is not white.
const COLOURED: [&str; 3] = [
    "random_walk_deg_per_h_per",
    "bias_instability",
    "acceleration_random",
];

/// The cases of tests/reference/full under white noise, by name.
pub fn full_cases() -> Vec<FullCase> {
    cases(false)
}

/// Those where drift or biases wander.
pub fn coloured_cases() -> Vec<FullCase> {
    cases(true)
}

fn cases(coloured: bool) -> Vec<FullCase> {
    let directory = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference/full");
    let entries = std::fs::read_dir(directory).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let texts = files
        .iter()
        .map(|path| std::fs::read_to_string(path).unwrap());
    let wanted = |text: &String| COLOURED.iter().any(|key| text.contains(key)) == coloured;
    texts
        .filter(wanted)
        .map(|text| read_full_case(&text))
        .collect()
}

fn read_full_case(text: &str) -> FullCase {
    let case: Value = serde_json::from_str(text).unwrap();
    let numbers = |key: &str| match case.get(key) {
        Some(map) => serde_json::from_value(map.clone()).unwrap(),
        None => BTreeMap::new(),
    };
    let misalignment = case.get("misalignment_sigma_arcsec").cloned();
    FullCase {
        name: case["name"].as_str().unwrap().to_owned(),
        config: serde_json::from_value(case["platform"].clone()).unwrap(),
        schedule: from_json(&case["schedule"].to_string()).unwrap(),
        total_time_s: case["total_time_s"].as_f64().unwrap(),
        sigma: numbers("sigma"),
        claimed_sigma: numbers("claimed_sigma"),
        misalignment_arcsec: misalignment.map(|v| serde_json::from_value(v).unwrap()),
        rms_sigma_deg_per_h: case["rms_sigma_deg_per_h"].as_f64().unwrap(),
        ignored: numbers("ignored"),
        constant_part_sigma: numbers("constant_part_sigma"),
    }
}
