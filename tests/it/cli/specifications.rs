//! Specifications of parameters beside the drift coefficients, wherever one is spoken of.

use super::{Desk, SCHEDULE};

/// Torquers alone are specified, at `spec` ppm.
fn platform(objective: &str, spec: f64) -> String {
    format!(
        "[motion]\nslew_rate_deg_per_s = 2\n[errors]\ntorquer_scale_factor_ppm = 1000\n\
         [objective]\n{objective}[objective.spec]\nT_XX = {spec}\n"
    )
}

fn desk(objective: &str, spec: f64) -> Desk {
    let desk = Desk::new();
    desk.write("s.csv", SCHEDULE);
    desk.write("p.toml", platform(objective, spec));
    desk
}

#[test]
fn a_bound_says_nothing_of_what_it_takes_as_known() {
    for mode in ["accuracy", "time"] {
        let desk = desk(
            &format!("mode = \"{mode}\"\ncriterion = \"max-ratio\"\n"),
            10.0,
        );
        let text = desk.done(&["bound", "p.toml"]).replace('\n', " ");
        assert!(!text.contains("prior already meets the spec"), "{text}");
        assert!(text.contains("of the other parameters this says nothing"));
        assert!(!text.contains("majorants"), "{text}");
        assert!(text.contains("counts only parameters that the bound"));
        let json = desk.done(&["bound", "p.toml", "--json"]);
        let document: serde_json::Value = serde_json::from_str(&json).unwrap();
        assert_eq!(document["minimum_time_s"], serde_json::Value::Null);
        assert_eq!(document["lower_bound"], 0.0);
    }
}

#[test]
fn an_evaluation_says_whether_every_specified_parameter_is_within_it() {
    for (spec, is) in [(1e-3, "missed"), (500.0, "met")] {
        let desk = desk("criterion = \"max-ratio\"\n", spec);
        let args = ["evaluate", "-s", "s.csv", "-p", "p.toml"];
        let text = desk.done(&[&args[..], &["--report", "page.html"]].concat());
        let row = text.lines().find(|l| l.starts_with("| T_XX")).unwrap();
        assert!(row.contains(is), "{row}");
        let first = text.lines().find(|l| l.starts_with("criterion")).unwrap();
        let words: Vec<&str> = first.split_whitespace().collect();
        assert_eq!(words[..2], ["criterion", "max-ratio"]);
        assert_eq!(words.len(), 3, "{first}");
        let page = desk.text("page.html");
        let said = match is {
            "met" => "The specification is met: within it at the end: T_XX.",
            _ => "The specification is not met: T_XX (",
        };
        assert!(page.contains(said));
    }
}

#[test]
fn a_simulation_is_checked_against_every_specification() {
    for (spec, code, decision) in [(1e-3, 1, "not-met"), (1e5, 0, "met")] {
        let desk = desk("", spec);
        let args = "simulate -s s.csv -p p.toml --runs 12 --check";
        let args: Vec<&str> = args.split(' ').collect();
        let run = desk.run(&[&args[..], &["--report", "page.html", "--json"]].concat());
        assert_eq!(run.code, Some(code), "{}", run.stderr);
        let document: serde_json::Value = serde_json::from_str(&run.stdout).unwrap();
        let check = &document["judgement"]["specification"];
        assert_eq!(check["decision"], decision);
        assert_eq!(check["parameters"][0]["name"], "T_XX");
        assert_eq!(check["parameters"][0]["unit"], "ppm");
        assert_eq!(check["parameters"][0]["decision"], decision);
        let text = desk.run(&args).stdout;
        assert!(text.contains("| T_XX | ppm"), "{text}");
        assert!(desk.text("page.html").contains("<td>ppm</td>"));
    }
}

#[test]
fn a_comparison_does_not_call_a_missed_specification_met() {
    for (spec, met) in [(1e-3, false), (500.0, true)] {
        let desk = desk("", spec);
        let json = desk.done(&["compare", "s.csv", "-p", "p.toml", "--json"]);
        let document: serde_json::Value = serde_json::from_str(&json).unwrap();
        let first = &document["schedules"][0];
        let expected = if met {
            &first["total_time_s"]
        } else {
            &serde_json::Value::Null
        };
        assert_eq!(
            first
                .get("time_to_spec_s")
                .unwrap_or(&serde_json::Value::Null),
            expected
        );
    }
}

#[test]
fn a_weighted_criterion_is_said_beside_the_rms() {
    let desk = Desk::new();
    desk.write(
        "p.toml",
        "[motion]\nslew_rate_deg_per_s = 2\n[errors]\ntorquer_scale_factor_ppm = 1000\n\
         [objective]\ntotal_time_s = 2000\n[objective.weights]\ndefault = 0\nT_XX = 1\n\
         [search]\nstarts = 1\nmax_positions = 3\n",
    );
    let text = desk
        .done(&["search", "p.toml", "-o", "out"])
        .replace('\n', " ");
    assert!(text.contains(", criterion a "), "{text}");
    assert!(text.contains("| a, mixed |"), "{text}");
    assert!(
        text.contains("counts only parameters that the bound takes as known"),
        "{text}"
    );
}
