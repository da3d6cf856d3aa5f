//! The operator's sheet as a user gets it.

use super::{Desk, SCHEDULE};

const STAND: &str = "[motion]\nslew_rate_deg_per_s = 0.5\nsettle_s = 30\n";

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write("stand.toml", STAND);
    desk
}

const GIVEN: [&str; 5] = ["commands", "-s", "s.csv", "-p", "stand.toml"];

#[test]
fn commands_writes_sheets_in_both_forms() {
    let desk = desk();
    let sheets = ["--sheet", "a.html", "--sheet", "A.CSV"];
    let run = desk.run(&[&GIVEN[..], &sheets].concat());
    assert_eq!(
        (run.code, run.stdout.as_str()),
        (Some(0), ""),
        "{}",
        run.stderr
    );
    assert!(run.stderr.contains("written: a.html") && run.stderr.contains("whole turns"));
    let page = desk.text("a.html");
    assert!(page.starts_with("<!DOCTYPE html>") && page.contains("6 positions"));
    assert!(!page.contains("<script") && !page.contains("http"));
    // Six positions, each in a row with a box.
    assert_eq!(page.matches("class=\"box\"").count(), 6);
    assert_eq!(desk.text("A.CSV").lines().count(), 7);
    // The table is where it was asked for, and the same as without a sheet.
    let table = desk.done(&GIVEN);
    assert!(table.starts_with("clock,"));
    desk.done(&[&GIVEN[..], &sheets, &["-o", "table.csv"]].concat());
    assert_eq!(desk.text("table.csv"), table);
    let json = desk.done(&[&GIVEN[..], &sheets, &["--json"]].concat());
    let document: serde_json::Value = serde_json::from_str(&json).unwrap();
    let evaluate = ["evaluate", "-s", "s.csv", "-p", "stand.toml", "--json"];
    let evaluation: serde_json::Value = serde_json::from_str(&desk.done(&evaluate)).unwrap();
    assert_eq!(document["winding_deg"], evaluation["winding_deg"]);
    assert!(document["winding_deg"][0].as_f64().unwrap() > 90.0);
    let told = desk.done(&evaluate[..5]);
    assert!(told.contains("Farthest from the start"), "{told}");
}

#[test]
fn a_search_writes_the_sheet_that_commands_writes_of_its_schedule() {
    let desk = desk();
    let search = [
        "search",
        "stand.toml",
        "--starts",
        "1",
        "--max-positions",
        "5",
        "-q",
    ];
    desk.done(&[&search[..], &["-o", "out"]].concat());
    let given = ["commands", "-s", "out/schedule.csv", "-p", "stand.toml"];
    desk.done(
        &[
            &given[..],
            &["--sheet", "again.html", "--sheet", "again.csv"],
        ]
        .concat(),
    );
    assert_eq!(desk.text("again.html"), desk.text("out/sheet.html"));
    assert_eq!(desk.text("again.csv"), desk.text("out/sheet.csv"));
}

#[test]
fn a_sheet_of_no_known_form_is_refused_before_anything_is_written() {
    let desk = desk();
    for name in ["sheet", "sheet.pdf", "sheet.xlsx"] {
        let args = [
            &GIVEN[..],
            &["--sheet", "ok.csv", "--sheet", name, "-o", "t.csv"],
        ]
        .concat();
        desk.run(&args).refused(&["--sheet", name, ".html"]);
    }
    assert_eq!(desk.files(), ["s.csv", "stand.toml"]);
}
