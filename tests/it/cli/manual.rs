//! Completions and the manual, made from the command line's grammar.

use super::{Desk, names};

const COMMANDS: [&str; 15] = [
    "search",
    "evaluate",
    "analyze",
    "simulate",
    "compare",
    "bound",
    "batch",
    "init",
    "standard",
    "commands",
    "convert",
    "report",
    "schema",
    "completions",
    "man",
];

#[test]
fn every_shell_completes_every_command() {
    let desk = Desk::new();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = desk.done(&["completions", shell]);
        for command in COMMANDS {
            assert!(script.contains(command), "{shell}: {command}");
        }
    }
    let run = desk.run(&["completions", "fsh"]);
    assert_eq!(run.code, Some(2));
    assert!(run.stderr.contains("fish"), "{}", run.stderr);
}

#[test]
fn the_manual_has_a_page_for_every_command() {
    let desk = Desk::new();
    let page = desk.done(&["man"]);
    assert!(page.contains(".TH scheme-opt 1") && page.contains("Exit codes"));
    desk.done(&["man", "-o", "man1"]);
    let pages = names(&desk.path("man1"));
    assert_eq!(pages.len(), COMMANDS.len() + 1);
    for command in COMMANDS {
        let page = desk.text(&format!("man1/scheme-opt-{command}.1"));
        assert!(
            page.contains(&format!("scheme\\-opt\\-{command}")),
            "{page}"
        );
    }
}

#[test]
fn a_slip_of_the_pen_is_answered_with_the_nearest_name() {
    let desk = Desk::new();
    for (args, nearest) in [
        (&["serch"][..], "search"),
        (&["search", "--total-time"], "--total-time-s"),
        (&["standard", "edges-21"], "edges-12"),
        (&["compare", "standard:isocahedron-12"], "icosahedron-12"),
        (&["search", "--criterion", "max-ration"], "max-ratio"),
    ] {
        let run = desk.run(args);
        assert_eq!(run.code, Some(2), "{args:?}");
        assert!(run.stderr.contains(nearest), "{args:?}: {}", run.stderr);
    }
}
