//! Signals, full disks, vanished directories: what was there stays, what is written is whole.
#![cfg(unix)]

use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::{Desk, RESULTS, Run, names};
use crate::support::Random;

/// What a search writes.
fn started(mut command: Command) -> Child {
    command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn signal(child: &Child, name: &str) {
    let pid = child.id().to_string();
    let sent = Command::new("kill").args([name, &pid]).status().unwrap();
    assert!(sent.success());
}

/// Waits until the search has prepared its output and is on its way.
fn wait_for_temporaries(directory: &Path) {
    let patience = Instant::now() + Duration::from_secs(30);
    while std::fs::read_dir(directory).map_or(0, Iterator::count) < RESULTS.len() {
        assert!(Instant::now() < patience, "no output is being prepared");
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(Duration::from_millis(200));
}

#[test]
fn terminating_a_search_is_interrupting_it() {
    let desk = Desk::new();
    let child = started(desk.command(&["search", "--starts", "50000", "-o", "out"]));
    wait_for_temporaries(&desk.path("out"));
    signal(&child, "-TERM");
    let run = Run::of(child.wait_with_output().unwrap());
    assert_eq!(run.code, Some(130), "{}", run.stderr);
    assert_eq!(desk.json("out/result.json")["status"], "interrupted");
}

#[test]
fn an_output_directory_that_vanishes_is_made_again() {
    let desk = Desk::new();
    let child = started(desk.command(&["search", "--starts", "50000", "-o", "deep/out"]));
    wait_for_temporaries(&desk.path("deep/out"));
    std::fs::remove_dir_all(desk.path("deep")).unwrap();
    signal(&child, "-INT");
    let run = Run::of(child.wait_with_output().unwrap());
    assert_eq!(run.code, Some(130), "{}", run.stderr);
    let written = names(&desk.path("deep/out"));
    assert!(RESULTS.iter().all(|name| written.iter().any(|w| w == name)));
    assert_eq!(desk.json("deep/out/result.json")["status"], "interrupted");
}

#[test]
fn an_output_directory_replaced_by_a_file_is_an_error_and_the_result_is_shown() {
    let desk = Desk::new();
    let child = started(desk.command(&["search", "--starts", "50000", "-o", "out"]));
    wait_for_temporaries(&desk.path("out"));
    std::fs::remove_dir_all(desk.path("out")).unwrap();
    desk.write("out", "in the way");
    signal(&child, "-INT");
    let run = Run::of(child.wait_with_output().unwrap());
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    assert!(
        run.stderr.contains("cannot write the file"),
        "{}",
        run.stderr
    );
    assert!(run.stdout.contains("RMS sigma") && run.stdout.contains("| alpha, deg |"));
    assert!(!run.stdout.contains("Written"));
    assert_eq!(desk.text("out"), "in the way");
}

/// The command in a shell that lets no file grow beyond `blocks` of 512 bytes, and lets the
/// program see that as a failed write: the nearest to a full disk without being root.
fn on_a_small_disk(desk: &Desk, blocks: u32, args: &[&str]) -> Run {
    let limited = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command
        .args(["-c", &limited])
        .arg(assert_cmd::cargo::cargo_bin!("scheme-opt"))
        .args(args)
        .current_dir(desk.path("."));
    Run::of(command.output().unwrap())
}

#[test]
fn a_full_disk_leaves_the_previous_results_and_shows_the_new() {
    let desk = Desk::new();
    std::fs::create_dir(desk.path("out")).unwrap();
    for name in RESULTS {
        desk.write(&format!("out/{name}"), "previous");
    }
    let search = ["search", "--starts", "1", "-o", "out"];
    let run = on_a_small_disk(&desk, 16, &search);
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    // One of the files that are larger than the disk.
    let large = ["result.json", "report.html", "sheet.html", "commands.csv"];
    assert!(
        large.iter().any(|name| run.stderr.contains(name)),
        "{}",
        run.stderr
    );
    assert!(
        run.stderr.contains("cannot write the file"),
        "{}",
        run.stderr
    );
    assert!(run.stdout.contains("| alpha, deg |"));
    assert_eq!(names(&desk.path("out")), RESULTS);
    for name in RESULTS {
        assert_eq!(desk.text(&format!("out/{name}")), "previous");
    }
    desk.write("s.csv", "previous");
    let run = on_a_small_disk(&desk, 0, &["standard", "faces-6", "-o", "s.csv"]);
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    assert_eq!(
        (desk.text("s.csv"), desk.files()),
        (
            "previous".to_owned(),
            vec!["out".to_owned(), "s.csv".to_owned()]
        )
    );
}

#[cfg(target_os = "linux")]
#[test]
fn full_and_forbidden_places_are_errors() {
    let desk = Desk::new();
    let full = || std::fs::OpenOptions::new().write(true).open("/dev/full");
    let mut command = desk.command(&["standard"]);
    let run = Run::of(command.stdout(full().unwrap()).output().unwrap());
    assert_eq!(run.code, Some(2));
    assert!(run.stderr.contains("standard output"), "{}", run.stderr);
    desk.run(&["standard", "faces-6", "-o", "/dev/full"])
        .refused(&["/dev/full", "cannot write"]);
    // Not even root makes a directory here.
    let long = ["search", "--starts", "100000", "-o", "/proc/scheme-opt-out"];
    desk.run(&long)
        .refused(&["/proc/scheme-opt-out", "output directory"]);
    desk.run(&["init", "/proc/platform.toml"])
        .refused(&["/proc/platform.toml"]);
}

/// Kills runs at random moments; afterwards every file is that of the old run or that of the new.
fn kill_at_random_moments(times: u32, seed: u64) {
    let search = |seed: &'static str, out: &'static str| {
        [
            "search",
            "--starts",
            "1",
            "--max-positions",
            "6",
            "--total-time-s",
            "3000",
            "--reproducible",
            "--seed",
            seed,
            "-o",
            out,
        ]
    };
    let desk = Desk::new();
    desk.done(&search("1", "old"));
    let began = Instant::now();
    desk.done(&search("2", "new"));
    let whole_run = began.elapsed();
    let mut random = Random(seed);
    let (mut kept, mut replaced, mut mixed) = (0, 0, 0);
    for round in 0..times {
        let _ = std::fs::remove_dir_all(desk.path("out"));
        // Every third time nothing was there before.
        let fresh = round % 3 == 0;
        if !fresh {
            std::fs::create_dir(desk.path("out")).unwrap();
            for name in RESULTS {
                std::fs::copy(desk.path("old").join(name), desk.path("out").join(name)).unwrap();
            }
        }
        let mut child = started(desk.command(&search("2", "out")));
        std::thread::sleep(whole_run.mul_f64(random.between(0.0, 1.1)));
        child.kill().unwrap();
        child.wait().unwrap();
        let is = |name: &str, which: &str| {
            let found = std::fs::read(desk.path("out").join(name));
            let wanted = std::fs::read(desk.path(which).join(name)).unwrap();
            match found {
                Ok(found) => found == wanted,
                Err(_) => which == "old" && fresh,
            }
        };
        let old = RESULTS.iter().filter(|name| is(name, "old")).count();
        let new = RESULTS.iter().filter(|name| is(name, "new")).count();
        assert_eq!(
            old + new,
            RESULTS.len(),
            "round {round}: {old} old, {new} new"
        );
        match (old, new) {
            (_, 0) => kept += 1,
            (0, _) => replaced += 1,
            _ => mixed += 1,
        }
    }
    println!("{times} kills: {kept} before, {replaced} after, {mixed} between the renames");
}

#[test]
fn killed_at_random_every_file_is_old_or_whole() {
    kill_at_random_moments(12, 1);
}

/// `cargo test --release --test it killed_a_hundred_times -- --ignored --nocapture`
#[test]
#[ignore = "the long form of the test above"]
fn killed_a_hundred_times_every_file_is_old_or_whole() {
    kill_at_random_moments(100, 2);
}
