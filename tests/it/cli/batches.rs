//! Many platforms by one command: errors stay with their platform, a batch goes on where it stopped, and
//! its bytes do not depend on what runs at the same time.

use std::path::Path;

use serde_json::Value;

use super::{Desk, RESULTS, names};

const QUICK: &str = "[search]\nstarts = 2\nmax_positions = 5\n";

/// Two platforms that are in order and one that is not, in the middle.
fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("north.toml", format!("[site]\nlatitude_deg = 60\n{QUICK}"));
    desk.write("wrong.toml", "[site]\nlatitude_deg = 95\n");
    std::fs::create_dir(desk.path("other")).unwrap();
    let limited = format!(
        "[gimbals]\nbeta_deg = [-60, 60]\n[objective.spec_deg_per_h]\ndefault = 0.05\n{QUICK}"
    );
    desk.write("other/north.toml", limited);
    desk
}

const PLATFORMS: [&str; 4] = ["batch", "north.toml", "wrong.toml", "other/north.toml"];

/// Every file below, with its text.
fn all_files(directory: &Path) -> Vec<(String, String)> {
    let mut all = Vec::new();
    for name in names(directory) {
        let path = directory.join(&name);
        match path.is_dir() {
            true => {
                let inner = all_files(&path).into_iter();
                all.extend(inner.map(|(file, text)| (format!("{name}/{file}"), text)));
            }
            false => all.push((name, std::fs::read_to_string(path).unwrap())),
        }
    }
    all
}

#[test]
fn a_wrong_platform_does_not_keep_the_others_and_jobs_do_not_change_a_byte() {
    let desk = desk();
    let run = desk.run(&[&PLATFORMS[..], &["-o", "one", "--jobs", "1"]].concat());
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    assert!(
        run.stderr
            .contains("error: wrong.toml:2: site.latitude_deg"),
        "{}",
        run.stderr
    );
    let said = "3 platforms: 2 with the schedule asked for, 1 failed.";
    assert!(run.stdout.starts_with(said), "{}", run.stdout);
    assert!(run.stdout.contains("| north-2 ") && run.stdout.contains("wrong.toml:2"));
    assert!(
        run.stdout.lines().all(|line| line.chars().count() <= 80),
        "{}",
        run.stdout
    );

    let summary = desk.json("one/batch.json");
    assert_eq!(summary["schema"], "scheme-opt/batch/1");
    let [north, wrong, other] = &summary["platforms"].as_array().unwrap()[..] else {
        panic!("{summary}")
    };
    for (record, directory) in [(north, "north"), (other, "north-2")] {
        let result = desk.json(&format!("one/{directory}/result.json"));
        let certificate = &result["certificate"];
        assert_eq!(record["directory"], directory);
        assert_eq!(record["status"], "converged");
        assert_eq!(record["criterion"], certificate["achieved"]);
        assert_eq!(record["lower_bound"], certificate["lower_bound"]);
        assert_eq!(record["gap_percent"], certificate["gap_percent"]);
        assert_eq!(record["total_time_s"], result["evaluation"]["total_time_s"]);
        let positions = result["schedule"]["positions"].as_array().unwrap().len();
        assert_eq!(record["positions"], positions);
        let written = names(&desk.path("one").join(directory));
        let mut expected = RESULTS.to_vec();
        expected.push("finished.json");
        expected.sort_unstable();
        assert_eq!(written, expected);
    }
    assert_eq!(
        (&north["met"], &other["met"]),
        (&Value::Null, &Value::Bool(true))
    );
    assert_eq!(
        (&wrong["status"], &wrong["criterion"]),
        (&"failed".into(), &Value::Null)
    );
    assert!(
        wrong["error"]
            .as_str()
            .unwrap()
            .contains("latitude_deg = 95")
    );
    assert_eq!(
        names(&desk.path("one")),
        ["batch.csv", "batch.html", "batch.json", "north", "north-2"]
    );
    let page = desk.text("one/batch.html");
    assert!(page.contains("href=\"north-2/report.html\"") && page.contains("wrong.toml"));
    assert_eq!(desk.text("one/batch.csv").lines().count(), 4);
    // The page again, from the document alone.
    desk.done(&["report", "one/batch.json", "-o", "again.html"]);
    assert_eq!(desk.text("again.html"), page);

    let args = [
        &PLATFORMS[..],
        &["-o", "two", "--jobs", "2", "--json", "-q"],
    ]
    .concat();
    let run = desk.run(&args);
    assert_eq!(
        (run.code, &run.stdout),
        (Some(2), &desk.text("one/batch.json"))
    );
    assert_eq!(all_files(&desk.path("two")), all_files(&desk.path("one")));
}

#[test]
fn what_is_finished_is_kept_and_what_has_changed_is_searched_again() {
    let desk = Desk::new();
    desk.write("a.toml", QUICK);
    desk.write(
        "b.toml",
        "[objective]\ncriterion = \"use\"\nuse = \"flight.csv\"\n[search]\nstarts = 2\nmax_positions = 8\n",
    );
    let flight = |f: f64| format!("time_s,f_x,f_y,f_z\n0,0.2,1,-0.3\n60,{f},1,0.5\n");
    desk.write("flight.csv", flight(0.5));
    let args = ["batch", "a.toml", "b.toml", "-o", "out"];
    let again = |expected: [bool; 2]| {
        let run = desk.run(&args);
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        for (name, kept) in ["a", "b"].into_iter().zip(expected) {
            let said = format!("{name} (of 2 platforms): finished already");
            assert_eq!(run.stderr.contains(&said), kept, "{name}: {}", run.stderr);
        }
        all_files(&desk.path("out"))
    };
    let first = again([false, false]);
    assert_eq!(again([true, true]), first);
    // More time to search and other threads are no other question.
    let more = ["--threads", "1", "--time-limit-s", "1000"];
    let run = desk.run(&[&args[..], &more].concat());
    assert_eq!(
        run.stderr.matches("finished already").count(),
        2,
        "{}",
        run.stderr
    );
    // A file that the platform file names has changed.
    desk.write("flight.csv", flight(0.7));
    assert_ne!(again([true, false]), first);
    // A result that somebody has changed is not taken for one of this program's.
    desk.write(
        "out/a/schedule.csv",
        "alpha_deg,beta_deg,gamma_deg,dwell_s\n0,0,0,1\n",
    );
    desk.write("flight.csv", flight(0.5));
    assert_eq!(again([false, false]), first);
    // Nor is another seed the same question.
    let run = desk.run(&["batch", "a.toml", "-o", "out", "--seed", "2"]);
    assert_eq!(
        run.stderr.matches("finished already").count(),
        0,
        "{}",
        run.stderr
    );
}

#[test]
fn exit_codes_are_those_of_the_gravest() {
    let desk = Desk::new();
    desk.write("fine.toml", QUICK);
    desk.write(
        "table.toml",
        "[gimbals]\nstep_deg = 15\nbeta_deg = [16, 29]\n",
    );
    let run = desk.run(&["batch", "fine.toml", "table.toml", "-o", "out", "-q"]);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    let platforms = &desk.json("out/batch.json")["platforms"];
    assert_eq!(platforms[1]["status"], "infeasible");
    assert_eq!(platforms[1]["acceptable"], false);
    assert!(
        platforms[1]["error"]
            .as_str()
            .unwrap()
            .contains("gimbals.step_deg")
    );
    assert_eq!(
        desk.run(&["batch", "fine.toml", "-o", "out", "-q"]).code,
        Some(0)
    );
    let nothing = desk.run(&["batch", "nowhere.toml", "-o", "none"]);
    assert_eq!(nothing.code, Some(2));
    assert_eq!(
        names(&desk.path("none")),
        ["batch.csv", "batch.html", "batch.json"]
    );
    for bad in [&["batch"][..], &["batch", "fine.toml", "--jobs", "0"]] {
        assert_eq!(desk.run(bad).code, Some(2), "{bad:?}");
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_batch_goes_on_and_ends_where_it_would_have() {
    use std::process::{Command, Stdio};
    let desk = Desk::new();
    // The second takes long enough to be interrupted in the middle.
    for (name, starts) in [("a", 2), ("b", 16), ("c", 2)] {
        desk.write(
            &format!("{name}.toml"),
            format!("[search]\nmax_positions = 6\nstarts = {starts}\n"),
        );
    }
    let args = |out: &'static str| {
        [
            "batch", "a.toml", "b.toml", "c.toml", "--jobs", "1", "-o", out,
        ]
    };
    desk.done(&args("whole"));
    let mut command = desk.command(&args("parts"));
    let child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // When the second is on its way.
    let patience = std::time::Instant::now() + std::time::Duration::from_secs(60);
    while !desk.path("parts/b").exists() {
        assert!(
            std::time::Instant::now() < patience,
            "the second search does not begin"
        );
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    std::thread::sleep(std::time::Duration::from_millis(30));
    let pid = child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &pid])
            .status()
            .unwrap()
            .success()
    );
    let run = super::Run::of(child.wait_with_output().unwrap());
    assert_eq!(run.code, Some(130), "{}", run.stderr);
    assert!(run.stderr.contains("interrupted"), "{}", run.stderr);
    let platforms = &desk.json("parts/batch.json")["platforms"];
    let status = |i: usize| platforms[i]["status"].as_str().unwrap();
    assert_eq!(
        (status(0), status(1), status(2)),
        ("converged", "interrupted", "not-started")
    );
    assert!(!desk.path("parts/c").exists());

    let run = desk.run(&args("parts"));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(
        run.stderr.contains("a (of 3 platforms): finished already"),
        "{}",
        run.stderr
    );
    assert_eq!(
        all_files(&desk.path("parts")),
        all_files(&desk.path("whole"))
    );
}
