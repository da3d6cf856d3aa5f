//! What several subjects share: reference cases, random schedules.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use scheme_opt::internals::attitude::Position;
use scheme_opt::internals::drift::DriftCoefficient;
use scheme_opt::internals::platform::PlatformConfig;
use scheme_opt::internals::schedule::Schedule;
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

pub fn reference_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference")
}

/// All cases of tests/reference (see SOURCES.md there), by name.
pub fn reference_cases() -> Vec<ReferenceCase> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(reference_dir())
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
        schedule: scheme_opt::internals::schedule::file::from_json(&case["schedule"].to_string())
            .unwrap(),
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
}

/// Keys of noise that is not white.
const COLOURED: [&str; 3] = [
    "random_walk_deg_per_h_per",
    "bias_instability",
    "acceleration_random",
];

/// The cases of tests/reference/full under white noise, by name.
pub fn full_cases() -> Vec<FullCase> {
    let entries = std::fs::read_dir(reference_dir().join("full")).unwrap();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let texts = files
        .iter()
        .map(|path| std::fs::read_to_string(path).unwrap());
    let is_white = |text: &String| !COLOURED.iter().any(|key| text.contains(key));
    texts
        .filter(is_white)
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
        schedule: scheme_opt::internals::schedule::file::from_json(&case["schedule"].to_string())
            .unwrap(),
        total_time_s: case["total_time_s"].as_f64().unwrap(),
        sigma: numbers("sigma"),
        claimed_sigma: numbers("claimed_sigma"),
        misalignment_arcsec: misalignment.map(|v| serde_json::from_value(v).unwrap()),
        rms_sigma_deg_per_h: case["rms_sigma_deg_per_h"].as_f64().unwrap(),
        ignored: numbers("ignored"),
    }
}

/// A small deterministic generator for test data (SplitMix64).
pub struct Random(pub u64);

impl Random {
    /// Of the case of a number.
    pub fn of_case(case: u64) -> Self {
        Self(case.wrapping_mul(0x2545_f491_4f6c_dd1d))
    }

    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub fn position(&mut self) -> Position {
        let mut angle = || self.between(-180.0, 180.0);
        Position::from_deg(angle(), angle(), angle())
    }
}
