//! Every command of the guides is run, and the platform file's reference is that of the program.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use scheme_opt::internals::config::DEFAULT_TOML;

use super::{Desk, Run, SCHEDULE};

fn guides() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let entries = std::fs::read_dir(root.join("docs")).unwrap();
    let mut all: Vec<PathBuf> = entries
        .map(|e| e.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "md"))
        .collect();
    all.push(root.join("README.md"));
    all.sort();
    all
}

/// The fenced blocks of a text: language and content.
fn blocks(text: &str) -> Vec<(String, String)> {
    let mut blocks = Vec::new();
    let mut open: Option<(String, String)> = None;
    for line in text.lines() {
        match (line.strip_prefix("```"), &mut open) {
            (Some(language), None) => open = Some((language.trim().to_owned(), String::new())),
            (Some(_), Some(_)) => blocks.extend(open.take()),
            (None, Some((_, content))) => *content += &format!("{line}\n"),
            (None, None) => {}
        }
    }
    assert!(open.is_none(), "a block is not closed");
    blocks
}

/// What is only worth running by hand, or is run by the gate itself.
fn is_for_cargo(line: &str) -> bool {
    [
        "cargo test",
        "cargo bench",
        "cargo doc",
        "cargo run --release --example",
        "cargo install",
        "cargo +nightly fuzz",
    ]
    .iter()
    .any(|c| line.starts_with(c))
}

/// A command as the test runs it: the program for `cargo run`, and with few starts and runs, which
/// show the same in a fraction of the time.
fn as_run(line: &str) -> String {
    let line = line.replace("cargo run --release --", "scheme-opt");
    let line = line.replace("scheme-opt search", "scheme-opt search --starts 2");
    let line = line.replace("scheme-opt batch", "scheme-opt batch --starts 2");
    let line = line.replace("--best-order", "--best-order --order-steps 1000");
    match line.contains("--runs") {
        true => line,
        false => line.replace("scheme-opt simulate", "scheme-opt simulate --runs 10"),
    }
}

/// The workbook that a guide shows as a table: every cell as text, with its decimal commas.
fn workbook(guide: &str) -> Vec<u8> {
    let mut workbook = rust_xlsxwriter::Workbook::new();
    let sheet = workbook.add_worksheet();
    let table = guide.lines().skip_while(|l| !l.starts_with("| Nr. |"));
    let rows = table.take_while(|l| l.starts_with('|'));
    let rows = rows.filter(|l| !l.starts_with("|--"));
    for (row, line) in rows.enumerate() {
        let cells = line.trim_matches('|').split('|').map(str::trim);
        for (column, cell) in cells.enumerate() {
            let (row, column) = (row as u32, column as u16);
            sheet.write(row, column, cell).unwrap();
        }
    }
    workbook.save_to_buffer().unwrap()
}

/// Runs a guide from its beginning to its end in one directory, as a reader would. Blocks of TOML
/// and CSV that begin with the name of a file are that file. Gives how many commands were run.
fn follow(guide: &Path) -> usize {
    let text = std::fs::read_to_string(guide).unwrap();
    let desk = Desk::new();
    desk.write("mine.csv", SCHEDULE);
    desk.write("labor.xlsx", workbook(&text));
    let program = assert_cmd::cargo::cargo_bin!("scheme-opt");
    let path = std::env::var("PATH").unwrap();
    let path = format!("{}:{path}", program.parent().unwrap().display());
    let mut count = 0;
    for (language, content) in blocks(&text) {
        if language == "csv" {
            let first = content.lines().next().unwrap_or_default();
            desk.write(first.trim_start_matches("# "), &content);
        }
        if language == "toml" {
            let first = content.lines().next().unwrap_or_default();
            let name = first
                .trim_start_matches("# ")
                .split([':', ' '])
                .next()
                .unwrap();
            if name.ends_with(".toml") && name != "Cargo.toml" {
                desk.write(name, &content);
            }
        }
        if language != "sh" {
            continue;
        }
        for line in content.replace("\\\n", " ").lines().map(str::trim) {
            if line.is_empty() || line.starts_with('#') || is_for_cargo(line) {
                continue;
            }
            let command = as_run(line);
            assert!(
                command.starts_with("scheme-opt "),
                "{}: {line}",
                guide.display()
            );
            // A command that shows a refusal says so.
            let expected = match line.rsplit_once("# exit code ") {
                Some((_, code)) => code.trim().parse().unwrap(),
                None => 0,
            };
            let mut shell = std::process::Command::new("sh");
            shell.arg("-c").arg(&command).env("PATH", &path);
            let run = Run::of(shell.current_dir(desk.path("")).output().unwrap());
            let guide = guide.display();
            assert_eq!(run.code, Some(expected), "{guide}: {line}\n{}", run.stderr);
            count += 1;
        }
    }
    count
}

#[test]
fn every_command_of_the_guides_works() {
    let total: usize = guides().par_iter().map(|guide| follow(guide)).sum();
    assert!(total >= 20, "{total} commands");
}

/// Keys of the commented default file, in dotted form; those without a default have none.
fn keys_of_the_default_file() -> BTreeMap<String, Option<String>> {
    let mut section = String::new();
    let mut keys = BTreeMap::new();
    for line in DEFAULT_TOML.lines() {
        let bare = line.trim_start_matches("# ");
        if let Some(name) = bare.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
            section = name.to_owned();
        } else if let Some((key, value)) = bare.split_once(" = ")
            && key.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
        {
            let default = (!line.starts_with('#')).then(|| value.to_owned());
            keys.insert(format!("{section}.{key}"), default);
        }
    }
    keys
}

#[test]
fn the_reference_of_the_platform_file_is_complete_and_right() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/platform-file.md");
    let text = std::fs::read_to_string(path).unwrap();
    let mut documented = BTreeMap::new();
    for line in text.lines().filter(|l| l.starts_with("| `")) {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let code = |cell: &str| cell.trim_matches('`').to_owned();
        let default = match cells[2] {
            "none" => None,
            value => Some(code(value)),
        };
        assert!(!cells[3].is_empty() && !cells[4].is_empty(), "{line}");
        documented.insert(code(cells[1]), default);
    }
    assert_eq!(documented, keys_of_the_default_file());
}

/// Every relative link of the guides leads to a file.
#[test]
fn links_lead_somewhere() {
    for guide in guides() {
        let text = std::fs::read_to_string(&guide).unwrap();
        for (at, _) in text.match_indices("](") {
            let target = text[at + 2..].split(')').next().unwrap();
            let file = target.split('#').next().unwrap();
            if file.is_empty() || file.contains("://") {
                continue;
            }
            let found = guide.parent().unwrap().join(file);
            assert!(found.exists(), "{}: {target}", guide.display());
        }
    }
}
