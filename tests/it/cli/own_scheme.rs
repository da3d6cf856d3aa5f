//! `search --from`, `--only` and `--done`.

use serde_json::Value;

use super::{Desk, SCHEDULE};
use scheme_opt::{Control, Schedule, Study};

const PLATFORM: &str = "[motion]\nslew_rate_deg_per_s = 1\nsettle_s = 10\n\
                        [objective]\ntotal_time_s = 9000\n[search]\nstarts = 1\nmax_positions = 6\n";

/// The six positions of [`SCHEDULE`], the first of them pinned.
fn pinned() -> String {
    let rows = SCHEDULE.replace('\n', ",\n");
    let rows = rows.replacen("dwell_s,", "dwell_s,pinned", 1);
    rows.replacen("10,20,30,1000,", "10,20,30,1000,x", 1)
}

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("p.toml", PLATFORM);
    desk.write("s.csv", pinned());
    desk
}

fn search<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&["search", "p.toml", "-o", "out"][..], more].concat()
}

fn angles(result: &Value) -> Vec<[f64; 3]> {
    let positions = result["schedule"]["positions"].as_array().unwrap().iter();
    let names = ["alpha_deg", "beta_deg", "gamma_deg"];
    positions
        .map(|p| names.map(|n| p[n].as_f64().unwrap()))
        .collect()
}

#[test]
fn a_scheme_is_improved_and_its_pinned_first_position_stays() {
    let desk = desk();
    let shown = desk.done(&search(&["--from", "s.csv"]));
    assert!(shown.contains("s.csv itself reaches"), "{shown}");
    assert!(shown.contains("Its pinned position 1 kept"), "{shown}");
    let result = desk.json("out/result.json");
    assert_eq!(angles(&result)[0], [10.0, 20.0, 30.0]);
    assert_eq!(result["schedule"]["positions"][0]["pinned"], true);
    assert_eq!(result["from"]["name"], "s.csv");
    assert_eq!(result["from"]["pinned"], serde_json::json!([1]));
    assert!(result["from"]["ratio"].as_f64().unwrap() >= 1.0);
    let csv = desk.text("out/schedule.csv");
    assert!(
        csv.starts_with("alpha_deg,beta_deg,gamma_deg,dwell_s,pinned"),
        "{csv}"
    );
    assert!(
        desk.text("out/report.html")
            .contains("s.csv itself reaches")
    );
    // The result is where the next search begins.
    let again = desk.done(&search(&[
        "--from",
        "out/schedule.json",
        "--only",
        "dwells",
    ]));
    assert!(again.contains("only the dwells may change"), "{again}");
}

#[test]
fn dwells_alone_keep_angles_and_order_and_order_alone_keeps_dwells() {
    let desk = desk();
    let given = [
        [10.0, 20.0, 30.0],
        [50.0, -40.0, 100.0],
        [-120.0, 30.0, 0.0],
        [170.0, 10.0, -80.0],
        [-60.0, -50.0, 200.0],
        [95.0, 55.0, -145.0],
    ];
    desk.done(&search(&["--from", "s.csv", "--only", "dwells"]));
    assert_eq!(angles(&desk.json("out/result.json")), given);
    for only in ["order", "dwells,order"] {
        desk.done(&search(&["--from", "s.csv", "--only", only]));
        let result = desk.json("out/result.json");
        let mut found = angles(&result);
        assert_eq!(found[0], given[0], "{only}");
        found.sort_by(|a, b| a.partial_cmp(b).unwrap());
        let mut sorted = given;
        sorted.sort_by(|a, b| a.partial_cmp(b).unwrap());
        assert_eq!(found, sorted, "{only}");
        let positions = result["schedule"]["positions"].as_array().unwrap();
        let mut dwells: Vec<f64> = (positions.iter())
            .map(|p| p["dwell_s"].as_f64().unwrap())
            .collect();
        dwells.sort_by(f64::total_cmp);
        let kept = dwells == [900.0, 1000.0, 1100.0, 1200.0, 1300.0, 1500.0];
        assert_eq!(kept, only == "order", "{dwells:?}");
    }
}

#[test]
fn the_rest_of_a_test_is_what_the_library_plans() {
    let desk = desk();
    let done = "alpha_deg,beta_deg,gamma_deg,dwell_s\n10,20,30,1000\n50,-40,100,655.5\n";
    desk.write("done.csv", done);
    let shown = desk.done(&search(&["--done", "done.csv", "--reproducible"]));
    assert!(shown.contains("Done already: 2 positions in"), "{shown}");
    let study = Study::from_toml(PLATFORM).unwrap();
    let study = study.after(Schedule::from_csv(done).unwrap()).unwrap();
    let found = study.search(&Control::default()).unwrap();
    let result = desk.json("out/result.json");
    assert_eq!(desk.text("out/schedule.json"), found.schedule().to_json());
    let json = found.reproducible().document().to_json().unwrap();
    assert_eq!(json, desk.text("out/result.json"));
    assert_eq!(result["done"]["schedule"]["positions"][1]["dwell_s"], 655.5);
    assert!(result["evaluation"]["total_time_s"].as_f64().unwrap() <= 9000.0);
    // The stand is told the rest alone, by the clock of the test.
    let commands = desk.text("out/commands.csv");
    let first: Vec<&str> = commands.lines().nth(1).unwrap().split(',').collect();
    let taken_s = result["done"]["total_time_s"].as_f64().unwrap();
    assert!((first[1].parse::<f64>().unwrap() - taken_s).abs() < 1e-6);
    assert!(desk.text("out/report.html").contains("Done already"));
}

#[test]
fn bad_schemes_and_options_are_refused() {
    let desk = desk();
    let csv = |rows: &str| format!("alpha_deg,beta_deg,gamma_deg,dwell_s,pinned,move_s\n{rows}");
    desk.write("bad.csv", csv("0,0,0,600,perhaps,\n"));
    desk.write("moves.csv", csv("0,0,0,600,,\n9,0,0,600,x,90\n"));
    desk.write(
        "json.json",
        "{\"positions\": [{\"alpha_deg\": 0, \"beta_deg\": 0, \
        \"gamma_deg\": 0, \"dwell_s\": 60, \"pinned\": \"x\"}]}",
    );
    desk.write("far.csv", csv("0,70,0,600,x,\n"));
    desk.write("long.csv", csv("0,0,0,9500,,\n"));
    desk.write(
        "limited.toml",
        format!("{PLATFORM}[gimbals]\nbeta_deg = [-60, 60]\n"),
    );
    desk.write(
        "tumbling.toml",
        format!("{PLATFORM}allow_tumbling = true\n"),
    );
    for (args, parts) in [
        (
            &["p.toml", "--from", "none.csv"][..],
            &["none.csv", "cannot read"][..],
        ),
        (
            &["p.toml", "--from", "bad.csv"],
            &["bad.csv", "positions[0].pinned", "perhaps", "or x"],
        ),
        (
            &["p.toml", "--from", "json.json"],
            &["json.json", "pinned", "true or false"],
        ),
        (
            &["p.toml", "--from", "moves.csv"],
            &["moves.csv", "positions[1].move_s", "90"],
        ),
        (
            &["limited.toml", "--from", "far.csv"],
            &["far.csv", "positions[0].beta_deg", "70"],
        ),
        (
            &["tumbling.toml", "--from", "s.csv"],
            &["tumbling.toml", "search.allow_tumbling"],
        ),
        (&["p.toml", "--only", "dwells"], &["--from"]),
        (
            &["p.toml", "--from", "s.csv", "--only", "angles"],
            &["angles", "dwells, order"],
        ),
        (
            &[
                "p.toml", "--from", "s.csv", "--only", "order", "--mode", "pareto",
            ],
            &["objective.mode", "pareto"],
        ),
        (
            &["p.toml", "--done", "bad.csv"],
            &["bad.csv", "positions[0].pinned"],
        ),
        (
            &["limited.toml", "--done", "far.csv"],
            &["far.csv", "positions[0].beta_deg"],
        ),
    ] {
        let args = [&["search"][..], args, &["-o", "new"]].concat();
        desk.run(&args).refused(parts);
        assert!(!desk.path("new").exists(), "{args:?}");
    }
    // All the time is gone.
    let run = desk.run(&search(&["--done", "long.csv"]));
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert!(
        run.stderr.contains("what is done already"),
        "{}",
        run.stderr
    );
}

#[test]
fn a_checkpoint_belongs_to_the_scheme_it_began_with() {
    let desk = desk();
    let mut limit_s = 0.1;
    let from = ["--from", "s.csv", "--checkpoint-interval-s", "0.02"];
    while !desk.path("out/checkpoint.json").exists() {
        let limit = limit_s.to_string();
        desk.done(&search(&[&from[..], &["--time-limit-s", &limit]].concat()));
        limit_s *= 1.5;
        assert!(limit_s < 100.0, "nothing was done, or all of it");
    }
    let run = desk.run(&search(&["--resume"]));
    run.refused(&["out/checkpoint.json", "from differs"]);
    desk.done(&search(
        &[&from[..], &["--resume", "--reproducible"]].concat(),
    ));
    let resumed = desk.text("out/result.json");
    desk.done(&search(&["--from", "s.csv", "--reproducible"]));
    assert_eq!(desk.text("out/result.json"), resumed);
}

/// In another order the short way may wind a gimbal up too far: the order is then driven another way, or
/// is none.
#[test]
fn an_order_is_one_that_the_stand_can_drive() {
    let desk = Desk::new();
    let csv = "alpha_deg,beta_deg,gamma_deg,dwell_s,pinned\n\
               0,0,0,1500,x\n50,-40,100,1400,\n-120,30,0,1300,\n170,10,-80,1400,\n";
    desk.write("held.csv", csv);
    for (name, more) in [
        ("wound", ""),
        ("boxed", "forbidden = [{ beta_deg = [80, 100] }]\n"),
    ] {
        let platform = format!(
            "[gimbals]\nmax_winding_deg = [300, 300, 300]\n{more}\
             [motion]\nslew_rate_deg_per_s = 1.0\n[objective]\ntotal_time_s = 9000\n"
        );
        desk.write("p.toml", platform);
        for only in ["order", "dwells,order"] {
            let args = ["search", "p.toml", "--from", "held.csv", "--only", only];
            desk.done(&[&args[..], &["--starts", "2", "-o", name]].concat());
            let result = desk.json(&format!("{name}/result.json"));
            assert!(result["from"]["ratio"].as_f64().unwrap() >= 1.0);
            let winding = result["evaluation"]["winding_deg"].as_array().unwrap();
            assert!(winding.iter().all(|w| w.as_f64().unwrap() <= 300.0));
        }
    }
}

/// A way around a box that the scheme gives is kept with its positions, and the same may be pinned.
#[test]
fn a_way_around_what_stands_in_it_is_kept() {
    let desk = Desk::new();
    let csv = "alpha_deg,beta_deg,gamma_deg,dwell_s,alpha_change_deg,beta_change_deg,gamma_change_deg\n\
               0,-60,0,1500,,,\n45,120,-45,1400,45,-180,-45\n90,140,20,1400,,,\n";
    desk.write("around.csv", csv);
    let platform = "[gimbals]\nforbidden = [{ beta_deg = [80, 100] }]\n\
                    [motion]\nslew_rate_deg_per_s = 1.0\n[objective]\ntotal_time_s = 6000\n";
    desk.write("p.toml", platform);
    let args = ["search", "p.toml", "--from", "around.csv", "--only"];
    let shown = desk.done(&[&args[..], &["dwells", "-o", "out"]].concat());
    assert!(shown.contains("-180.000"), "{shown}");
    // What makes it again is in the report, the scheme included.
    let report = desk.text("out/report.html");
    assert!(report.contains("--from from.csv --only dwells"));
    assert!(report.contains("<code>from.csv</code>") || report.contains("from.csv</"));
    let sheet = desk.text("out/sheet.html");
    assert!(sheet.contains("_deg = [80, 100] }"), "{sheet}");
    for only in ["order", "dwells,order"] {
        desk.done(&[&args[..], &[only, "-o", "order"]].concat());
    }
}
