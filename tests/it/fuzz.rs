//! The readers under a hundred thousand damaged files: the short form of the targets in `fuzz/`.

use std::path::Path;
use std::time::{Duration, Instant};

use crate::support::Random;

#[path = "../../fuzz/checks.rs"]
mod checks;

/// What a random change likes to put in.
const WORDS: [&str; 34] = [
    "nan",
    "inf",
    "-0",
    "1e999",
    "-1e-320",
    "1_0",
    "0x7f",
    "9223372036854775808",
    "true",
    "null",
    "\"",
    "'",
    "\"\"\"",
    "[",
    "]",
    "[[",
    "{",
    "}",
    ",",
    ";",
    "=",
    ".",
    "#",
    "\\u0000",
    "\\",
    "\n",
    "\r\n",
    "\r",
    "\t",
    "\0",
    "\u{feff}",
    "°",
    "\u{1f600}",
    "dwell_s",
];

fn files(folder: &str) -> Vec<Vec<u8>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz");
    let mut paths: Vec<_> = std::fs::read_dir(root.join(folder))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    paths.sort();
    let read = |path| std::fs::read(path).unwrap();
    paths.into_iter().map(read).collect()
}

/// One to six changes of a seed.
fn damaged(seeds: &[Vec<u8>], random: &mut Random) -> Vec<u8> {
    let mut pick = |n: usize| (random.unit() * n as f64) as usize;
    let mut bytes = seeds[pick(seeds.len())].clone();
    for _ in 0..=pick(6) {
        let (a, b) = (pick(bytes.len() + 1), pick(bytes.len() + 1));
        let (from, to) = (a.min(b), a.max(b).min(a.min(b) + 40));
        match pick(10) {
            0 if !bytes.is_empty() => {
                let at = pick(bytes.len());
                bytes[at] ^= 1 << pick(8);
            }
            // Other numbers in the same places.
            7..=9 => {
                for _ in 0..=pick(4) {
                    let digits: Vec<usize> = (0..bytes.len())
                        .filter(|i| bytes[*i].is_ascii_digit())
                        .collect();
                    if !digits.is_empty() {
                        bytes[digits[pick(digits.len())]] = b'0' + pick(10) as u8;
                    }
                }
            }
            1 => drop(bytes.drain(from..to)),
            2 => {
                let copy = bytes[from..to].to_vec();
                let at = pick(bytes.len() + 1);
                bytes.splice(at..at, copy);
            }
            3 => bytes.truncate(a),
            4 => {
                let other = &seeds[pick(seeds.len())];
                let (c, d) = (pick(other.len() + 1), pick(other.len() + 1));
                bytes.splice(from..to, other[c.min(d)..c.max(d)].iter().copied());
            }
            5 => {
                let word = WORDS[pick(WORDS.len())].repeat(1 + pick(3) * pick(60));
                bytes.splice(a..a, word.into_bytes());
            }
            _ => {
                let word = WORDS[pick(WORDS.len())];
                bytes.splice(from..to, word.bytes());
            }
        }
        bytes.truncate(20_000);
    }
    bytes
}

fn run(folder: &str, check: fn(&str) -> bool, count: u32) {
    let seeds = files(&format!("corpus/{folder}"));
    assert!(seeds.len() >= 5);
    let mut random = Random(11);
    let (mut accepted, mut slowest) = (0, Duration::ZERO);
    for _ in 0..count {
        let bytes = damaged(&seeds, &mut random);
        // What is not UTF-8 is refused before it comes to the readers.
        let text = String::from_utf8_lossy(&bytes);
        let began = Instant::now();
        accepted += u32::from(check(&text));
        slowest = slowest.max(began.elapsed());
    }
    // What a few million executions of the long form kept, as it is.
    for bytes in files(&format!("found/{folder}")) {
        check(&String::from_utf8_lossy(&bytes));
    }
    println!("{folder}: {count} inputs, {accepted} accepted, the slowest in {slowest:?}");
    assert!(
        accepted > count / 200,
        "hardly any input gets past the grammar"
    );
    assert!(slowest < Duration::from_secs(2));
}

#[test]
fn damaged_platform_files_are_refused_or_read() {
    run("platform_toml", checks::platform_toml, 40_000);
}

#[test]
fn damaged_json_schedules_are_refused_or_read() {
    run("schedule_json", checks::schedule_json, 60_000);
}

#[test]
fn damaged_csv_schedules_are_refused_or_read() {
    run("schedule_csv", checks::schedule_csv, 60_000);
}
