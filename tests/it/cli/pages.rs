//! The HTML reports.

use super::{Desk, SCHEDULE};

/// The limit that the report has to keep, bytes.
const LARGEST: usize = 1_000_000;

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write(
        "stand.toml",
        "[motion]\nslew_rate_deg_per_s = 1\nsettle_s = 20\n[objective]\ntotal_time_s = 8000\n\
         [objective.spec_deg_per_h]\ndefault = 0.02\nD_IX = 0.01\n[search]\nstarts = 2\n\
         max_positions = 8\nfront_points = 3\n",
    );
    desk
}

/// Self-contained, well-formed as far as counting goes, with these parts in this order.
fn is_page(page: &str, parts: &[&str]) {
    assert!(page.len() < LARGEST, "{} bytes", page.len());
    assert!(page.starts_with("<!DOCTYPE html>\n<html lang=\"en\">"));
    assert!(page.trim_end().ends_with("</html>"));
    // Nothing is fetched: the only addresses are names of namespaces and places on the page.
    for (at, _) in page.match_indices("http") {
        assert!(
            page[at..].starts_with("http://www.w3.org/2000/svg"),
            "{}",
            &page[at..at + 60]
        );
    }
    for attribute in ["src=", "url(h", "@import", "<link rel=\"stylesheet"] {
        assert!(!page.contains(attribute), "{attribute}");
    }
    for (at, _) in page.match_indices("href=\"") {
        let target = &page[at + 6..];
        assert!(target.starts_with('#') || target.starts_with("data:,"));
    }
    for bad in ["NaN", ">inf<", ">-inf<", "{{", "{%"] {
        assert!(!page.contains(bad), "{bad}");
    }
    for element in ["svg", "table", "section", "figure", "g", "text", "div"] {
        let opened = page.matches(&format!("<{element}>")).count()
            + page.matches(&format!("<{element} ")).count();
        assert_eq!(
            opened,
            page.matches(&format!("</{element}>")).count(),
            "{element}"
        );
    }
    // Every picture has words, every identifier is its own.
    assert_eq!(
        page.matches("<svg ").count(),
        page.matches("role=\"img\" aria-label=\"").count()
    );
    let mut ids: Vec<&str> = page
        .match_indices(" id=\"")
        .map(|(at, _)| page[at + 5..].split('"').next().unwrap())
        .collect();
    let count = ids.len();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), count);
    let mut from = 0;
    for part in parts {
        let heading = format!("-title\">{part}</h2>");
        let found = page[from..].find(&heading);
        assert!(found.is_some(), "{part}");
        from += found.unwrap();
    }
}

#[test]
fn a_search_writes_its_report_and_the_commands() {
    let desk = desk();
    let args = [
        "search",
        "stand.toml",
        "--mode",
        "pareto",
        "--reproducible",
        "-q",
    ];
    desk.done(&[&args[..], &["-o", "a"]].concat());
    desk.done(&[&args[..], &["-o", "b", "--threads", "1"]].concat());
    let page = desk.text("a/report.html");
    is_page(
        &page,
        &[
            "Verdict",
            "Schedule",
            "Angles and axes",
            "Commands for the stand",
            "Accuracy against time",
            "Observability",
            "Correlations",
            "Time against accuracy",
            "Beside the standard schemes",
            "Formulas, inputs, reproduction",
        ],
    );
    assert!(page.contains("the best standard scheme") && page.contains("specification D_IX"));
    for file in ["report.html", "commands.csv"] {
        assert_eq!(
            desk.text(&format!("a/{file}")),
            desk.text(&format!("b/{file}")),
            "{file}"
        );
    }
    // The same page again, from the document alone.
    desk.done(&["report", "a/result.json", "-o", "again.html"]);
    assert_eq!(desk.text("again.html"), page);
    // The same commands again, from the schedule.
    let again = desk.done(&["commands", "-s", "a/schedule.csv", "-p", "stand.toml"]);
    assert_eq!(again, desk.text("a/commands.csv"));
}

#[test]
fn given_schedules_have_reports_too() {
    let desk = desk();
    let given = ["-s", "s.csv", "-p", "stand.toml", "--report"];
    let body = [
        "Verdict",
        "Schedule",
        "Commands for the stand",
        "Accuracy against time",
    ];

    let json = desk.done(&[&["evaluate", "--json"], &given[..], &["e.html"]].concat());
    is_page(
        &desk.text("e.html"),
        &[&body[..], &["Observability", "Correlations"]].concat(),
    );
    desk.write("e.json", json);
    assert_eq!(
        desk.done(&["report", "e.json", "-o", "-"]),
        desk.text("e.html")
    );

    let simulate = ["simulate", "--runs", "20", "--json"];
    let json = desk.done(&[&simulate[..], &given[..], &["m.html"]].concat());
    is_page(
        &desk.text("m.html"),
        &[&body[..], &["Monte Carlo check"]].concat(),
    );
    desk.write("m.json", json);
    assert_eq!(
        desk.done(&["report", "m.json", "-o", "-"]),
        desk.text("m.html")
    );

    let json = desk.done(&[
        "compare",
        "s.csv",
        "standard:edges-12",
        "standard:faces-6",
        "-p",
        "stand.toml",
        "--report",
        "c.html",
        "--json",
    ]);
    is_page(
        &desk.text("c.html"),
        &["Verdict", "Side by side", "Schedule", "Observability"],
    );
    desk.write("c.json", json);
    assert_eq!(
        desk.done(&["report", "c.json", "-o", "-"]),
        desk.text("c.html")
    );
}

#[test]
fn a_report_is_made_of_what_it_can_be_made_of() {
    let desk = desk();
    // Unobservable combinations, a start, a return, measured moves, an index table.
    desk.write(
        "two.csv",
        "alpha_deg,beta_deg,gamma_deg,dwell_s\n0,0,0,1000\n180,0,0,1000\n",
    );
    desk.write(
        "odd.toml",
        "[gimbals]\nstep_deg = 15\n[motion]\nslew_rate_deg_per_s = 1\nmeasure_moves = true\n\
         start_deg = [30, 0, 0]\nreturn_to_start = true\n",
    );
    let args = [
        "evaluate", "-s", "two.csv", "-p", "odd.toml", "--report", "two.html",
    ];
    desk.done(&args);
    let page = desk.text("two.html");
    is_page(&page, &["Verdict", "Schedule"]);
    assert!(page.contains("What the measurements cannot tell"));
    desk.write("b.json", desk.done(&["bound", "--json"]));
    desk.run(&["report", "b.json"])
        .refused(&["b.json", "scheme-opt/bound/1"]);
    desk.write("no.json", "{");
    desk.run(&["report", "no.json"]).refused(&["no.json"]);
    desk.run(&["report", "none.json"]).refused(&["none.json"]);
    desk.run(&["commands", "-s", "s.csv", "--step-deg", "90"])
        .refused(&["--step-deg", "0.01 to 45"]);
}
