//! `[test]`, `--no-clobber`, and several runs into one directory.

use super::{Desk, RESULTS, Run, SCHEDULE, names};

const PLATFORM: &str = "[test]\ntitle = \"Acceptance test\"\nserial = \"0012\"\nstand = \"B\"\n\
    operator = \"N. N.\"\nnote = \"after repair\"\n[objective]\ntotal_time_s = 3000\n\
    [search]\nstarts = 1\nmax_positions = 4\n";
const SAID: &str = "Acceptance test; serial 0012; stand B; operator N. N.; after repair";

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("p.toml", PLATFORM);
    desk.write(
        "plain.toml",
        PLATFORM
            .split_once("[objective]")
            .unwrap()
            .1
            .replacen('\n', "[objective]\n", 1),
    );
    desk.write("s.csv", SCHEDULE);
    desk
}

const SEARCH: [&str; 4] = ["search", "p.toml", "-o", "out"];

#[test]
fn every_document_and_report_says_whose_test_it_is() {
    let desk = desk();
    let shown = desk.done(&SEARCH);
    assert!(shown.starts_with(SAID), "{shown}");
    assert!(
        desk.text("out/report.html")
            .contains(&format!("<p>{SAID}</p>"))
    );
    let result = desk.json("out/result.json");
    let test = &result["test"];
    assert_eq!(test["title"], "Acceptance test");
    assert_eq!(&result["inputs"]["test"], test);
    assert_eq!(&result["evaluation"]["test"], test);
    let given = ["-s", "s.csv", "-p", "p.toml"];
    for (command, more) in [
        ("evaluate", &given[..]),
        ("analyze", &given),
        ("commands", &given),
        ("simulate", &["-s", "s.csv", "-p", "p.toml", "--runs", "10"]),
        ("compare", &["s.csv", "-p", "p.toml"]),
        ("bound", &["p.toml"]),
    ] {
        let args = [&[command][..], more, &["--json"]].concat();
        let document: serde_json::Value = serde_json::from_str(&desk.done(&args)).unwrap();
        assert_eq!(&document["test"], test, "{command}");
        if command != "commands" {
            let shown = desk.done(&args[..args.len() - 1]);
            assert!(shown.starts_with(SAID), "{command}: {shown}");
        }
    }
    // Nobody said anything: no document does.
    desk.done(&["search", "plain.toml", "-o", "plain"]);
    assert!(desk.json("plain/result.json").get("test").is_none());
    assert!(!desk.text("plain/report.html").contains("<p></p>"));
}

#[test]
fn results_are_replaced_aloud_or_not_at_all() {
    let desk = desk();
    let run = desk.run(&SEARCH);
    assert!(!run.stderr.contains("replaced"), "{}", run.stderr);
    let sheet = desk.text("out/sheet.html");
    assert!(sheet.contains("<dd>Acceptance test</dd>") && sheet.contains("<dd>0012</dd>"));
    let before = desk.text("out/result.json");
    let kept = desk.run(&[&SEARCH[..], &["--no-clobber", "--seed", "2"]].concat());
    kept.refused(&["out/schedule.json", "--no-clobber"]);
    assert_eq!(desk.text("out/result.json"), before);
    let run = desk.run(&SEARCH);
    assert_eq!(run.code, Some(0));
    let said = run.stderr.lines().find(|l| l.starts_with("replaced: "));
    let said = said.unwrap_or_else(|| panic!("{}", run.stderr));
    for part in [
        "out/result.json and 6 more",
        "Acceptance test; serial 0012",
        " GMT",
    ] {
        assert!(said.contains(part), "{said}");
    }
    let quiet = desk.run(&[&SEARCH[..], &["--quiet"]].concat());
    assert_eq!(quiet.stderr, "");
    // Into another directory there is nothing to keep.
    desk.done(&["search", "p.toml", "-o", "new", "--no-clobber"]);
    let simulate = ["simulate", "-s", "s.csv", "-p", "p.toml", "--runs", "10"];
    let into = |more: &[&'static str]| [&simulate[..], more].concat();
    desk.done(&into(&["-o", "sim", "--report", "sim.html"]));
    desk.run(&into(&["-o", "sim", "--no-clobber"]))
        .refused(&["sim/simulation.json", "--no-clobber"]);
    desk.run(&into(&["--report", "sim.html", "--no-clobber"]))
        .refused(&["sim.html", "--no-clobber"]);
    let run = desk.run(&into(&["-o", "sim", "--report", "sim.html"]));
    assert_eq!(
        run.stderr.matches("replaced: ").count(),
        2,
        "{}",
        run.stderr
    );
    let compare = ["compare", "s.csv", "-p", "plain.toml", "--report", "c.html"];
    desk.done(&compare);
    desk.run(&[&compare[..], &["--no-clobber"]].concat())
        .refused(&["c.html", "--no-clobber"]);
    let run = desk.run(&compare);
    assert!(
        run.stderr.contains("replaced: c.html, of Torquing"),
        "{}",
        run.stderr
    );
    desk.run(&[&SEARCH[..], &["--resume", "--no-clobber"]].concat())
        .refused(&["--no-clobber", "--resume"]);
}

#[test]
fn runs_into_one_directory_leave_whole_files_of_one_of_them() {
    let desk = desk();
    let seeds = ["1", "2", "3"];
    let args = |seed: &'static str, out: &'static str| {
        [
            "search",
            "p.toml",
            "-q",
            "--reproducible",
            "--seed",
            seed,
            "-o",
            out,
        ]
    };
    for (seed, out) in seeds.into_iter().zip(["one", "two", "three"]) {
        desk.done(&args(seed, out));
    }
    let started = seeds.map(|seed| {
        let mut command = desk.command(&args(seed, "both"));
        command.stdout(std::process::Stdio::null());
        command
            .stderr(std::process::Stdio::piped())
            .spawn()
            .unwrap()
    });
    for child in started {
        let run = Run::of(child.wait_with_output().unwrap());
        assert_eq!(run.code, Some(0), "{}", run.stderr);
    }
    assert_eq!(names(&desk.path("both")), RESULTS);
    for name in RESULTS {
        let found = desk.text(&format!("both/{name}"));
        let whole = ["one", "two", "three"].map(|out| desk.text(&format!("{out}/{name}")));
        assert!(whole.contains(&found), "{name}");
    }
}

#[test]
fn what_is_no_text_of_one_line_is_refused() {
    let desk = desk();
    let long = format!("title = \"{}\"", "x".repeat(201));
    for (line, parts) in [
        ("title = 12", &["test.title", "12", "a string"][..]),
        ("serial = \"\"", &["test.serial", "1 to 200 characters"]),
        ("note = \"a\\nb\"", &["test.note", "line break"]),
        (
            "operator = \"\\u001b[2J\"",
            &["test.operator", "control character"],
        ),
        (&long, &["test.title", "1 to 200 characters"]),
        ("titel = \"x\"", &["test.titel", "did you mean `title`?"]),
    ] {
        desk.write("bad.toml", format!("[test]\n{line}\n"));
        let run = desk.run(&["bound", "bad.toml"]);
        run.refused(parts);
        assert!(run.stderr.contains("bad.toml:2"), "{}", run.stderr);
        assert!(!run.stderr.contains('\u{1b}'), "{}", run.stderr);
    }
}
