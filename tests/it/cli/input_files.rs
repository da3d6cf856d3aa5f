//! Whatever stands in the place of an input file: a clear refusal or a correct reading, at once.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::{Desk, Run};

/// Runs a command that must end by itself soon, whatever it is given.
fn soon(mut command: Command) -> Run {
    let child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    let mut child = child.spawn().unwrap();
    let patience = Instant::now() + Duration::from_secs(30);
    while child.try_wait().unwrap().is_none() {
        if Instant::now() > patience {
            child.kill().unwrap();
            panic!("{command:?} hangs");
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    Run::of(child.wait_with_output().unwrap())
}

#[cfg(unix)]
#[test]
fn what_is_no_file_is_refused_and_not_waited_for() {
    let desk = Desk::new();
    let fifo = desk.path("fifo.csv");
    assert!(
        Command::new("mkfifo")
            .arg(&fifo)
            .status()
            .unwrap()
            .success()
    );
    std::os::unix::fs::symlink(&fifo, desk.path("link.csv")).unwrap();
    std::os::unix::fs::symlink("loop.csv", desk.path("loop.csv")).unwrap();
    std::os::unix::fs::symlink("nowhere.csv", desk.path("dangling.csv")).unwrap();
    for (name, says) in [
        ("fifo.csv", "pipe"),
        ("link.csv", "pipe"),
        ("/dev/zero", "device"),
        ("/dev/null", "device"),
        ("loop.csv", "cannot read the file"),
        ("dangling.csv", "cannot read the file"),
        (".", "a directory"),
    ] {
        soon(desk.command(&["evaluate", "-s", name])).refused(&[name, says]);
        soon(desk.command(&["bound", name])).refused(&[name, says]);
        soon(desk.command(&["report", name])).refused(&[name, says]);
    }
}

#[cfg(unix)]
#[test]
fn a_link_to_a_file_is_read_and_the_output_of_a_link_leaves_its_target_alone() {
    let desk = Desk::new();
    desk.write("real.csv", super::SCHEDULE);
    std::os::unix::fs::symlink("real.csv", desk.path("link.csv")).unwrap();
    let by_name = desk.done(&["evaluate", "-s", "real.csv"]);
    assert_eq!(desk.done(&["evaluate", "-s", "link.csv"]), by_name);
    desk.done(&["standard", "faces-6", "-o", "link.csv"]);
    assert_eq!(desk.text("real.csv"), super::SCHEDULE);
    assert!(desk.text("link.csv").contains("dwell_s"));
}

#[test]
fn what_spreadsheets_and_editors_write_is_read_or_explained() {
    let desk = Desk::new();
    desk.write("plain.csv", super::SCHEDULE);
    let expected = desk.done(&["evaluate", "-s", "plain.csv", "--json"]);
    let crlf = super::SCHEDULE.replace('\n', "\r\n");
    let quoted = super::SCHEDULE.replace("alpha_deg,", "\"alpha_deg\",");
    for content in [
        crlf.clone(),
        format!("\u{feff}{crlf}"),
        super::SCHEDULE.replace('\n', "\r"),
        format!("{}\n\n,,,\n", super::SCHEDULE),
        quoted,
    ] {
        desk.write("s.csv", &content);
        let found = desk.done(&["evaluate", "-s", "s.csv", "--json"]);
        assert_eq!(found, expected, "{content:?}");
    }
    let semicolons = super::SCHEDULE.replace(',', ";");
    let utf16 = |text: &str| -> Vec<u8> {
        let units = text.encode_utf16().flat_map(u16::to_le_bytes);
        [0xff, 0xfe].into_iter().chain(units).collect()
    };
    // As Excel exports it in countries that write decimal commas, and what Windows wrote before.
    let german = format!("sep=;\r\n{}", semicolons.replace('.', ","));
    let titled = format!("Pr\u{fc}fplan;;\n{semicolons}");
    let windows: Vec<u8> = titled.chars().map(|c| u8::try_from(c).unwrap()).collect();
    for content in [
        semicolons.clone().into_bytes(),
        utf16(&super::SCHEDULE.replace(',', "\t")),
        utf16(&format!("{titled}\n")),
        windows,
        german.into_bytes(),
        format!("# {}", super::SCHEDULE).into_bytes(),
    ] {
        desk.write("s.csv", &content);
        let found = desk.done(&["evaluate", "-s", "s.csv", "--json"]);
        assert_eq!(found, expected, "{:?}", String::from_utf8_lossy(&content));
    }
    let head = "alpha_deg,beta_deg,gamma_deg,dwell_s\n";
    for (content, parts) in [
        (
            format!("{head}0,0,0,600,5\n"),
            &["s.csv:2", "positions[0]", "point"][..],
        ),
        (
            format!("{}1.200;0;0;600\n1,5;0;0;600\n", head.replace(',', ";")),
            &["s.csv:2", "positions[0].alpha_deg", "1.200 or 1200"],
        ),
        (
            format!("{head}0,0,0,6\00\n"),
            &["s.csv:2", "positions[0].dwell_s"],
        ),
        (
            format!("{head}0,0,0,60\n\u{1b}[2J,0,0,60\n"),
            &["s.csv:3", "positions[1].alpha_deg = \u{fffd}[2J"],
        ),
    ] {
        desk.write("s.csv", &content);
        desk.run(&["evaluate", "-s", "s.csv"]).refused(parts);
    }
    desk.write("p.toml", "\u{feff}[site]\r\nlatitude_deg = 28,2\r\n");
    desk.run(&["bound", "p.toml"])
        .refused(&["p.toml:2", "point"]);
    desk.write("p.toml", "[site]\nlatitude_deg = 1\nlatitude_deg = 2\n");
    desk.run(&["bound", "p.toml"])
        .refused(&["p.toml:3", "latitude_deg", "duplicate"]);
    desk.write("p.toml", b"[site]\nlatitude_deg = 1 # \xc3\x28\n");
    desk.run(&["bound", "p.toml"])
        .refused(&["p.toml:2", "UTF-8"]);
}

/// The command with its memory limited, where the shell can do that.
fn frugal(desk: &Desk, args: &[&str]) -> Command {
    let mut command = Command::new("sh");
    let program = assert_cmd::cargo::cargo_bin!("scheme-opt");
    command
        .args(["-c", "ulimit -v 1000000 2>/dev/null; exec \"$0\" \"$@\""])
        .arg(program)
        .args(args)
        .current_dir(desk.path("."));
    command
}

#[cfg(unix)]
#[test]
fn hostile_sizes_and_depths_are_refused_in_little_memory() {
    let desk = Desk::new();
    let deep = |open: &str, close: &str, n: usize| open.repeat(n) + &close.repeat(n);
    for content in [
        format!("x = {}", deep("[", "]", 200_000)),
        format!("{} = 1", vec!["a"; 200_000].join(".")),
        format!("[{}]", vec!["site"; 200_000].join(".")),
        format!("a = {}", deep("{a=", "}", 150_000)),
        format!("[site]\nlatitude_deg = [{}]", "1,".repeat(500_000)),
        format!("{} = 1", "k".repeat(1_000_000)),
        "#".repeat((1 << 20) + 1),
    ] {
        desk.write("p.toml", &content);
        soon(frugal(&desk, &["bound", "p.toml"])).refused(&["p.toml"]);
    }
    for (name, content) in [
        ("s.json", "[".repeat(4_000_000)),
        (
            "s.json",
            format!("{{\"positions\": {}}}", deep("[", "]", 2_000_000)),
        ),
        ("s.json", "{\"positions\":[{\"alpha_deg\":".repeat(100_000)),
        ("s.json", format!("{{\"{}\": 1}}", "k".repeat(8_000_000))),
        (
            "s.json",
            format!("{{\"positions\": [{}1]}}", "{},".repeat(2_000_000)),
        ),
        ("s.csv", ",".repeat(8_000_000)),
        (
            "s.csv",
            format!(
                "alpha_deg,beta_deg,gamma_deg,dwell_s\n{}",
                "0,0,0,1\n".repeat(1_000_000)
            ),
        ),
        ("s.csv", "x".repeat((8 << 20) + 1)),
    ] {
        desk.write(name, &content);
        soon(frugal(&desk, &["evaluate", "-s", name])).refused(&[name]);
    }
}

#[test]
fn a_truncated_file_is_refused_or_still_a_schedule() {
    let desk = Desk::new();
    desk.write("s.csv", super::SCHEDULE);
    let whole = desk.done(&["standard", "faces-6", "--format", "json"]);
    // A JSON document is whole or not at all. The last characters are a line end and a bracket.
    for length in (0..whole.len() - 2).step_by(101) {
        desk.write("cut.json", &whole[..length]);
        desk.run(&["evaluate", "-s", "cut.json"])
            .refused(&["cut.json"]);
    }
}
