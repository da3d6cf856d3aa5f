//! Numbers that are hard to believe are named, and change nothing.

use std::path::Path;

use scheme_opt::internals::config::{StudyConfig, StudySource};
use scheme_opt::internals::suspicion;

use super::{Desk, SCHEDULE};
use crate::battery::reference::reference_cases;

/// [`SCHEDULE`] as somebody with angles in radians and dwells in minutes would write it.
const RADIANS_AND_MINUTES: &str = "alpha_deg,beta_deg,gamma_deg,dwell_s\n\
    0.1745,0.3491,0.5236,16.7\n0.8727,-0.6981,1.7453,25\n-2.0944,0.5236,0,20\n\
    2.9671,0.1745,-1.3963,15\n-1.0472,-0.8727,3.4907,18.3\n1.6581,0.9599,-2.5307,21.7\n";

const DOUBTFUL: &str = "[site]\nlatitude_deg = 0.4922\n[filter]\nperiod_s = 1\n\
    [motion]\nslew_rate_deg_per_s = 0.0087\n[search]\nstarts = 1\nmax_positions = 6\n";

#[test]
fn every_command_that_reads_a_schedule_names_what_is_doubtful_in_it() {
    let desk = Desk::new();
    desk.write("s.csv", RADIANS_AND_MINUTES);
    let commands: [&[&str]; 4] = [
        &["evaluate", "-s", "s.csv"],
        &["simulate", "-s", "s.csv", "--runs", "4"],
        &["commands", "-s", "s.csv"],
        &["compare", "s.csv"],
    ];
    for command in commands {
        let run = desk.run(command);
        assert_eq!(run.code, Some(0), "{command:?}: {}", run.stderr);
        for part in [
            "warning: s.csv: positions = angles up to 3.4907: all angles look like radians",
            "warning: s.csv: positions = dwells up to 25 s: the dwells look like minutes",
        ] {
            assert!(run.stderr.contains(part), "{command:?}: {}", run.stderr);
        }
        let quiet = desk.run(&[command, &["-q", "--json"]].concat());
        assert_eq!((quiet.code, quiet.stderr.as_str()), (Some(0), ""));
        let document: serde_json::Value = serde_json::from_str(&quiet.stdout).unwrap();
        let warnings = document["warnings"].as_array().unwrap();
        assert_eq!(warnings.len(), 2, "{command:?}");
        let key = warnings[0]["key"].as_str().unwrap();
        assert!(key.ends_with("positions"), "{key}");
        assert!(
            warnings[1]["message"]
                .as_str()
                .unwrap()
                .contains("25 min is 1500 s")
        );
    }
}

/// What is nearly one position has little to analyse, so here only the dwells are doubtful.
#[test]
fn an_analysis_names_what_is_doubtful_in_its_schedule() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE.replace("00\n", "\n"));
    let run = desk.run(&["analyze", "-s", "s.csv", "--json"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let part = "warning: s.csv: positions = dwells up to 15 s: the dwells look like minutes";
    assert!(run.stderr.contains(part), "{}", run.stderr);
    let document: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(document["warnings"].as_array().unwrap().len(), 1);
}

#[test]
fn every_command_that_reads_a_platform_names_what_is_doubtful_in_it() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write("p.toml", DOUBTFUL);
    let commands: [&[&str]; 8] = [
        &["search", "p.toml", "-o", "out"],
        &["bound", "p.toml"],
        &[
            "evaluate", "-s", "s.csv", "-p", "p.toml", "--report", "r.html",
        ],
        &["analyze", "-s", "s.csv", "-p", "p.toml"],
        &["simulate", "-s", "s.csv", "-p", "p.toml", "--runs", "2"],
        &["compare", "s.csv", "--as-given", "-p", "p.toml"],
        &["commands", "-s", "s.csv", "-p", "p.toml"],
        &[
            "standard",
            "edges-12",
            "-p",
            "p.toml",
            "--total-time-s",
            "400000",
        ],
    ];
    for command in commands {
        let run = desk.run(command);
        assert_eq!(run.code, Some(0), "{command:?}: {}", run.stderr);
        for part in [
            "warning: p.toml: site.latitude_deg = 0.4922: looks like radians: 0.4922 rad is 28.20",
            "warning: p.toml: filter.period_s = 1: both default noises are per filter period",
            "warning: p.toml: motion.slew_rate_deg_per_s = 0.0087: looks like rad/s",
        ] {
            assert!(run.stderr.contains(part), "{command:?}: {}", run.stderr);
        }
    }
    let page = desk.text("r.html");
    assert!(page.contains("Check your inputs") && page.contains("0.4922 rad is 28.20 deg"));
    assert!(page.find("Check your inputs") < page.find("Verdict"));
    assert_eq!(
        desk.json("out/result.json")["warnings"][0]["value"],
        "0.4922"
    );
}

#[test]
fn options_are_looked_at_as_files_are() {
    let desk = Desk::new();
    let args = ["bound", "--total-time-s", "200"];
    let run = desk.run(&args);
    let part = "warning: objective.total_time_s = 200: looks like minutes: 200 min is 12000 s";
    assert!(run.stderr.starts_with(part), "{}", run.stderr);
    assert_eq!(run.code, Some(0));
    let quiet = desk.run(&[&args[..], &["-q"]].concat());
    assert_eq!((quiet.stderr.as_str(), quiet.stdout), ("", run.stdout));
}

#[test]
fn what_is_believable_is_left_alone() {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    for command in [&["evaluate", "-s", "s.csv"][..], &["bound"]] {
        assert_eq!(desk.run(command).stderr, "");
        let document = desk.done(&[command, &["--json"]].concat());
        assert!(!document.contains("\"warnings\""));
    }
}

/// The files of README and guides, but for those that are meant to be doubtful.
#[test]
fn the_files_of_the_guides_raise_nothing() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut texts = vec![std::fs::read_to_string(root.join("README.md")).unwrap()];
    for entry in std::fs::read_dir(root.join("docs")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "md") {
            texts.push(std::fs::read_to_string(path).unwrap());
        }
    }
    let mut count = 0;
    for text in texts {
        for block in text.split("```toml\n").skip(1) {
            let block = block.split("```").next().unwrap();
            let Ok(source) = StudySource::parse(block, None) else {
                continue;
            };
            if block.starts_with("# doubtful.toml") {
                continue;
            }
            let found = suspicion::of(&source.config, source.defaulted(), None);
            assert_eq!(found, [], "{block}");
            count += 1;
        }
    }
    assert!(count >= 4, "{count}");
}

#[test]
fn the_reference_cases_raise_nothing() {
    for case in reference_cases() {
        let mut config = StudyConfig::default();
        config.platform = case.config.clone();
        let found = suspicion::of(&config, &[], Some(&case.schedule));
        assert_eq!(found, [], "{}", case.name);
    }
}
