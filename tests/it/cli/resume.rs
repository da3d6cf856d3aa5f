//! `--resume`: wherever a search was stopped, it goes on and ends with the same bytes.
#![cfg(unix)]

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::{Desk, RESULTS, Run, names};
use crate::support::Random;

/// A problem that exercises what the arguments ask for, in a second or two.
struct Problem {
    name: &'static str,
    platform: &'static str,
    starts: &'static str,
}

const PROBLEMS: [Problem; 3] = [
    Problem {
        name: "accuracy",
        platform: "[motion]\nslew_rate_deg_per_s = 1\n[search]\nmax_positions = 8\n",
        starts: "12",
    },
    Problem {
        name: "front",
        platform: "[objective]\nmode = \"pareto\"\n[search]\nmax_positions = 4\nfront_points = 3\n",
        starts: "8",
    },
    Problem {
        name: "shortest",
        platform: "[objective]\nmode = \"time\"\n[objective.spec_deg_per_h]\ndefault = 0.02\n\
                   [search]\nmax_positions = 6\n",
        starts: "8",
    },
];

fn search<'a>(problem: &'a Problem, out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let fixed = [
        "search",
        "p.toml",
        "--reproducible",
        "--starts",
        problem.starts,
    ];
    let often = ["--checkpoint-interval-s", "0.02", "-o", out];
    [&fixed[..], &often, more].concat()
}

/// Stops a search again and again at random moments and resumes it until it is done.
fn stopped_and_resumed(problem: &Problem, signal: &str, seed: u64) -> (Desk, u32) {
    let desk = Desk::new();
    desk.write("p.toml", problem.platform);
    let began = Instant::now();
    desk.done(&search(problem, "whole", &[]));
    let whole = began.elapsed();
    assert_eq!(
        names(&desk.path("whole")),
        RESULTS,
        "a checkpoint is left behind"
    );
    let mut random = Random(seed);
    let mut stops = 0;
    loop {
        let resume: &[&str] = if stops == 0 { &[] } else { &["--resume"] };
        let mut command = desk.command(&search(problem, "out", resume));
        let mut child = command
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // The last runs are left alone.
        if stops < 4 {
            let patience = whole.mul_f64(random.between(0.1, 0.5)) + Duration::from_millis(20);
            std::thread::sleep(patience);
            let pid = child.id().to_string();
            let _ = Command::new("kill").args([signal, &pid]).status().unwrap();
        }
        let status = child.wait().unwrap();
        match status.code() {
            // Too late for the first signal: once more from the beginning.
            Some(0) if stops == 0 => std::fs::remove_dir_all(desk.path("out")).unwrap(),
            Some(0) => return (desk, stops),
            Some(130) | None => stops += 1,
            code => panic!(
                "{code:?}: {}",
                Run::of(child.wait_with_output().unwrap()).stderr
            ),
        }
    }
}

/// A search into `out` whose time was up after some of its work was done, however fast or busy the
/// machine is.
fn leave_unfinished(desk: &Desk, problem: &Problem) {
    let mut limit_s = 0.1;
    while !desk.path("out/checkpoint.json").exists() {
        let limit = limit_s.to_string();
        desk.done(&search(problem, "out", &["--time-limit-s", &limit]));
        limit_s *= 1.5;
        assert!(limit_s < 100.0, "nothing was done, or all of it");
    }
}

fn same_bytes(problem: &Problem, signal: &str, seed: u64) {
    let (desk, stops) = stopped_and_resumed(problem, signal, seed);
    println!("{}, {signal}: stopped {stops} times", problem.name);
    assert!(stops > 0);
    assert_eq!(names(&desk.path("out")), RESULTS);
    assert_same_results(&desk, &format!("{}, {signal}", problem.name));
}

fn assert_same_results(desk: &Desk, what: &str) {
    for name in RESULTS {
        let [out, whole] = ["out", "whole"].map(|d| desk.text(&format!("{d}/{name}")));
        assert!(out == whole, "{what}: {name} differs");
    }
}

#[test]
fn an_interrupted_search_resumed_ends_with_the_same_bytes() {
    same_bytes(&PROBLEMS[0], "-INT", 1);
    same_bytes(&PROBLEMS[1], "-TERM", 2);
    same_bytes(&PROBLEMS[2], "-INT", 3);
}

#[test]
fn a_killed_search_resumed_ends_with_the_same_bytes() {
    // What a kill leaves is what was there before, temporary files included.
    let (desk, stops) = stopped_and_resumed(&PROBLEMS[0], "-KILL", 4);
    assert!(stops > 0);
    assert_same_results(&desk, &format!("{stops} kills"));
}

#[test]
fn a_search_stopped_by_its_time_limit_can_be_resumed_without() {
    let desk = Desk::new();
    let problem = &PROBLEMS[0];
    desk.write("p.toml", problem.platform);
    desk.done(&search(problem, "whole", &[]));
    leave_unfinished(&desk, problem);
    assert_eq!(desk.json("out/result.json")["status"], "time-limit");
    desk.done(&search(problem, "out", &["--resume", "--threads", "1"]));
    assert_eq!(desk.text("out/result.json"), desk.text("whole/result.json"));
}

#[test]
fn a_checkpoint_of_something_else_is_refused() {
    let desk = Desk::new();
    let problem = &PROBLEMS[0];
    desk.write("p.toml", problem.platform);
    leave_unfinished(&desk, problem);
    let kept = desk.text("out/checkpoint.json");
    let other = search(problem, "out", &["--resume", "--seed", "2"]);
    desk.run(&other)
        .refused(&["out/checkpoint.json", "search.seed", "--resume"]);
    assert_eq!(desk.text("out/checkpoint.json"), kept);
    let resume = search(problem, "out", &["--resume"]);
    desk.write(
        "out/checkpoint.json",
        kept.replace("checkpoint/2", "checkpoint/3"),
    );
    desk.run(&resume).refused(&["another version"]);
    desk.write("out/checkpoint.json", &kept[..kept.len() / 2]);
    desk.run(&resume)
        .refused(&["out/checkpoint.json", "not a checkpoint"]);
    let bad = ["search", "--checkpoint-interval-s", "-1"];
    desk.run(&bad[..]).refused(&["--checkpoint-interval-s"]);
}

#[test]
fn a_checkpoint_for_other_contents_of_a_named_file_is_refused() {
    let desk = Desk::new();
    let problem = Problem {
        name: "use",
        platform: "[objective]\ncriterion = \"use\"\nuse = \"flight.csv\"\n[search]\nmax_positions = 8\n",
        starts: "12",
    };
    let flight = |f: f64| format!("time_s,f_x,f_y,f_z\n0,0.2,1,-0.3\n60,{f},1,0.5\n");
    desk.write("p.toml", problem.platform);
    desk.write("flight.csv", flight(0.5));
    leave_unfinished(&desk, &problem);
    desk.write("flight.csv", flight(0.7));
    let resume = search(&problem, "out", &["--resume"]);
    desk.run(&resume)
        .refused(&["out/checkpoint.json", "a file that it names has changed"]);
}

#[test]
fn a_new_search_says_what_it_will_replace_and_resuming_nothing_starts() {
    let desk = Desk::new();
    let problem = &PROBLEMS[0];
    desk.write("p.toml", problem.platform);
    leave_unfinished(&desk, problem);
    let run = desk.run(&search(problem, "out", &["--time-limit-s", "0.3"]));
    assert!(
        run.stderr.contains("--resume continues it"),
        "{}",
        run.stderr
    );
    let run = desk.run(&search(problem, "new", &["--resume"]));
    assert_eq!(run.code, Some(0));
    assert!(
        run.stderr.contains("starting from the beginning"),
        "{}",
        run.stderr
    );
}
