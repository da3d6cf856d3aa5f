//! `convert`: a schedule as somebody has it, into one of ours.

use crate::config::StudyConfig;
use crate::error::Result;
use crate::schedule::{Schedule, file};
use crate::suspicion;

use super::args::ConvertArgs;
use super::exit::Exit;
use super::files::write_file;
use super::inputs;
use super::output::Output;
use super::standard;

/// Runs the command.
pub(super) fn run(args: &ConvertArgs, output: Output) -> Result<Exit> {
    let schedule = file::read(&args.file)?;
    let warnings = suspicion::of_schedule(&schedule, &StudyConfig::default());
    inputs::warn(&warnings, Some(&args.file), output);
    let text = standard::written(&schedule, args.format, args.output.as_deref());
    match &args.output {
        Some(path) => {
            write_file(path, &text, true)?;
            output.message(&format!("written: {}", path.display()));
        }
        None => output.data(&text)?,
    }
    output.message(&summary(&schedule));
    Ok(Exit::Done)
}

/// What was understood, to compare with what was meant.
fn summary(schedule: &Schedule) -> String {
    let positions = schedule.positions();
    let dwells: f64 = positions.iter().map(|p| p.dwell_s).sum();
    let moves = positions.iter().filter(|p| p.move_s.is_some()).count();
    let mut text = format!("{} positions, {dwells} s of dwells", positions.len());
    if moves > 0 {
        text += &format!(", {moves} moves with a duration of their own");
    }
    let names: std::collections::BTreeSet<&String> = (0..positions.len())
        .flat_map(|i| schedule.notes(i).keys())
        .collect();
    if !names.is_empty() {
        let names: Vec<&str> = names.into_iter().map(String::as_str).collect();
        text += &format!("; kept as notes: {}", names.join(", "));
    }
    text
}
