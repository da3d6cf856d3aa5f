//! Schedules as people have them: Excel workbooks and exports, through `convert` and elsewhere.

use rust_xlsxwriter::{ExcelDateTime, Format, Workbook, Worksheet};

use super::Desk;

/// A sheet with a title, German headings beside ours, an empty row, a formula and remarks.
fn plan(sheet: &mut Worksheet) {
    sheet.write(0, 0, "Self-calibration, stand 3").unwrap();
    let heads = [
        "Nr.",
        "Alpha [\u{b0}]",
        "Beta [\u{b0}]",
        "Gamma [\u{b0}]",
        "Dwell (min)",
        "Bemerkung",
    ];
    for (column, head) in (0..).zip(heads) {
        sheet.write(2, column, head).unwrap();
    }
    let rows = [
        [0.0, 0.0, 0.0, 10.0],
        [90.0, 0.0, -22.5, 12.5],
        [180.0, 45.0, 0.0, 10.0],
    ];
    for (k, (row, at)) in rows.iter().zip([3, 5, 6]).enumerate() {
        sheet.write(at, 0, k as f64 + 1.0).unwrap();
        for (column, value) in (1..).zip(row) {
            sheet.write(at, column, *value).unwrap();
        }
    }
    sheet.write(3, 5, "warm up, then wait").unwrap();
    // As text with a decimal comma, which Excel does when it does not take a cell for a number.
    sheet.write(5, 3, "-22,5").unwrap();
}

fn workbook(desk: &Desk, name: &str, fill: impl Fn(&mut Workbook)) {
    let mut workbook = Workbook::new();
    fill(&mut workbook);
    desk.write(name, workbook.save_to_buffer().unwrap());
}

#[test]
fn a_workbook_is_converted_and_read_wherever_a_schedule_is() {
    let desk = Desk::new();
    workbook(&desk, "plan.xlsx", |w| {
        w.add_worksheet()
            .write(0, 0, "Notes of the meeting")
            .unwrap();
        plan(w.add_worksheet().set_name("Plan").unwrap());
    });
    let run = desk.run(&["convert", "plan.xlsx", "-o", "plan.json"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    for part in [
        "3 positions",
        "1950 s of dwells",
        "kept as notes: Bemerkung, Nr.",
    ] {
        assert!(run.stderr.contains(part), "{part}: {}", run.stderr);
    }
    let json = desk.text("plan.json");
    assert!(
        json.contains("\"Bemerkung\": \"warm up, then wait\""),
        "{json}"
    );
    assert!(
        json.contains("\"gamma_deg\": -22.5, \"dwell_s\": 750.0"),
        "{json}"
    );
    desk.done(&["convert", "plan.json", "-o", "plan.csv"]);
    assert_eq!(desk.done(&["convert", "plan.csv"]), json);
    let by_json = desk.done(&["evaluate", "-s", "plan.json", "--json"]);
    for name in ["plan.xlsx", "plan.csv"] {
        assert_eq!(
            desk.done(&["evaluate", "-s", name, "--json"]),
            by_json,
            "{name}"
        );
    }
}

/// What tells an engineer on the stand whether angles are meant the same way: a positive alpha turns the
/// platform about −x, and so brings gravity's reaction towards +z.
#[test]
fn an_evaluation_says_when_a_position_is_held_and_what_the_accelerometers_read() {
    let desk = Desk::new();
    let csv =
        "alpha_deg,beta_deg,gamma_deg,dwell_s\n0,0,0,600\n30,0,0,600\n0,0,90,600\n20,30,-50,900\n";
    desk.write("s.csv", csv);
    desk.write(
        "p.toml",
        "[motion]\nslew_rate_deg_per_s = 1.0\nsettle_s = 30.0\n",
    );
    let text = desk.done(&["evaluate", "-s", "s.csv", "--platform", "p.toml"]);
    assert!(
        text.contains("What the accelerometers read there"),
        "{text}"
    );
    let json = desk.done(&["evaluate", "-s", "s.csv", "--platform", "p.toml", "--json"]);
    let document: serde_json::Value = serde_json::from_str(&json).unwrap();
    let positions = document["positions"].as_array().unwrap();
    let starts: Vec<f64> = positions
        .iter()
        .map(|p| p["starts_s"].as_f64().unwrap())
        .collect();
    // 30° and 90° at 1 °/s, then 140°, each with 30 s of settling.
    let expected = [0.0, 660.0, 660.0 + 600.0 + 120.0, 1380.0 + 600.0 + 170.0];
    for (found, expected) in starts.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9, "{starts:?}");
    }
    let (sa, ca) = 20f64.to_radians().sin_cos();
    let (sb, cb) = 30f64.to_radians().sin_cos();
    let (sg, cg) = (-50f64).to_radians().sin_cos();
    let half = 0.75f64.sqrt();
    // The Up row of Mx(α) My(β) Mz(γ).
    let general = [sa * sb * cg - ca * sg, sa * sb * sg + ca * cg, sa * cb];
    let expected = [[0.0, 1.0, 0.0], [0.0, half, 0.5], [-1.0, 0.0, 0.0], general];
    for (position, expected) in positions.iter().zip(expected) {
        for (axis, expected) in expected.into_iter().enumerate() {
            let found = position["specific_force_g"][axis].as_f64().unwrap();
            assert!((found - expected).abs() < 1e-12, "{position}");
        }
    }
}

#[test]
fn what_a_workbook_leaves_open_is_refused_with_advice() {
    let desk = Desk::new();
    workbook(&desk, "two.xlsx", |w| {
        plan(w.add_worksheet().set_name("May").unwrap());
        plan(w.add_worksheet().set_name("June").unwrap());
    });
    workbook(&desk, "none.xlsx", |w| {
        w.add_worksheet().write(0, 0, "alpha").unwrap();
    });
    workbook(&desk, "far.xlsx", |w| {
        let sheet = w.add_worksheet();
        plan(sheet);
        sheet.write(1_048_575, 16_383, "x").unwrap();
    });
    workbook(&desk, "time.xlsx", |w| {
        let sheet = w.add_worksheet();
        plan(sheet);
        let minutes = Format::new().set_num_format("hh:mm:ss");
        let time = ExcelDateTime::from_hms(0, 10, 0).unwrap();
        sheet.write_with_format(3, 4, &time, &minutes).unwrap();
    });
    workbook(&desk, "unit.xlsx", |w| {
        let sheet = w.add_worksheet();
        plan(sheet);
        sheet.write(2, 4, "Dwell").unwrap();
    });
    desk.write("old.xls", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1 and so on");
    desk.write("cut.xlsx", b"PK\x03\x04 and no more");
    for (name, parts) in [
        ("two.xlsx", &["several worksheets", "May, June"][..]),
        ("none.xlsx", &["no worksheet", "alpha_deg"]),
        ("far.xlsx", &["too large", "1048576"]),
        (
            "time.xlsx",
            &["time.xlsx:4", "dwell_s", "date or time of day"],
        ),
        (
            "unit.xlsx",
            &["unit.xlsx:3", "does not say its unit", "dwell_s"],
        ),
        ("old.xls", &["old kind", "save it as .xlsx"]),
        ("cut.xlsx", &["not an Excel workbook", "or as CSV"]),
    ] {
        desk.run(&["convert", name]).refused(parts);
        desk.run(&["evaluate", "-s", name]).refused(parts);
    }
}

/// The reader finds no panic in a damaged archive.
#[test]
fn a_damaged_workbook_is_refused_or_still_a_schedule() {
    let desk = Desk::new();
    workbook(&desk, "plan.xlsx", |w| plan(w.add_worksheet()));
    let whole = std::fs::read(desk.path("plan.xlsx")).unwrap();
    for at in (0..whole.len()).step_by(whole.len() / 40) {
        let mut damaged = whole.clone();
        damaged[at] ^= 0x55;
        desk.write("bad.xlsx", &damaged);
        let run = desk.run(&["convert", "bad.xlsx"]);
        assert!(matches!(run.code, Some(0 | 2)), "byte {at}: {}", run.stderr);
        desk.write("bad.xlsx", &whole[..at]);
        let run = desk.run(&["convert", "bad.xlsx"]);
        assert!(
            matches!(run.code, Some(0 | 2)),
            "cut at {at}: {}",
            run.stderr
        );
    }
}
