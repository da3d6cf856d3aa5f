//! `simulate`: plays a given schedule through with a true platform and a filter.

mod text;

use crate::error::{Error, Result};
use crate::report::curves;
use crate::simulate::{SimulationOptions, ToldNoise, Trajectory};
use crate::study::SimulationRequest;

use super::args::SimulateArgs;
use super::exit::Exit;
use super::files::{OutputFiles, remove_on_signal};
use super::inputs::{self, GivenSchedule};
use super::output::Output;
use super::page;
use super::report::headed;

/// What is written into the output directory.
const FILES: [&str; 4] = ["simulation.json", "curves.csv", "curves.svg", "errors.svg"];

/// Runs the command.
pub(super) fn run(args: &SimulateArgs, output: Output) -> Result<Exit> {
    let GivenSchedule {
        study, schedule, ..
    } = inputs::given_schedule(&args.given, &args.common)?;
    let request = SimulationRequest {
        runs: args.runs,
        options: SimulationOptions {
            truth: args.truth,
            filter: args.filter,
            told: ToldNoise::both(args.told_noise_factor),
            ..SimulationOptions::default()
        },
        sweep: args.sweep,
    };
    request.options.check().map_err(name_option)?;
    let existing = args.existing.choice();
    page::check(args.report.as_deref(), existing)?;
    let files = args
        .output
        .as_ref()
        .map(|directory| OutputFiles::prepare(directory, &FILES, existing))
        .transpose()?;
    if let Some(files) = &files {
        remove_on_signal(files.litter());
    }
    let simulated = study.simulate(&schedule, &request).map_err(name_option)?;
    let document = simulated.document();
    let json = document.to_json()?;
    if let Some(files) = files {
        let written = files.commit(&contents(&json, simulated.trajectory()), output)?;
        let names: Vec<String> = written.iter().map(|p| p.display().to_string()).collect();
        output.message(&format!("written: {}", names.join(", ")));
    }
    page::write(args.report.as_deref(), existing, output, || {
        simulated.report_html()
    })?;
    output.data(&match args.common.json {
        true => json,
        false => headed(
            &document.test,
            text::simulation(document, simulated.swept()),
        ),
    })?;
    let passed = document.judgement.as_ref().is_some_and(|j| j.passed);
    Ok(match args.check && !passed {
        true => {
            output.message("check: not passed, see the first sentences");
            Exit::Doubtful
        }
        false => Exit::Done,
    })
}

/// The files' contents, in the order of [`FILES`].
fn contents(json: &str, trajectory: &Trajectory) -> [String; 4] {
    [
        json.to_owned(),
        trajectory.to_csv(),
        curves::states(trajectory).to_svg(),
        curves::errors(trajectory).to_svg(),
    ]
}

/// Says which option a refused number came from.
fn name_option(error: Error) -> Error {
    let option = match error.key() {
        Some("runs") => "--runs",
        Some(key) if key.starts_with("told.") => "--told-noise-factor",
        _ => return error,
    };
    error.with_key(option)
}
