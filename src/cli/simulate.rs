//! `simulate`: plays a given schedule through with a true platform and a filter.

mod text;

use crate::error::{Error, Result};
use crate::motion::Timeline;
use crate::report::{curves, html};
use crate::results::SimulationDocument;
use crate::simulate::{
    PriorSize, Simulation, SimulationOptions, SweepPoint, ToldNoise, Trajectory, sweep,
};
use crate::config::Study;

use super::Exit;
use super::args::SimulateArgs;
use super::files::{OutputFiles, remove_on_signal};
use super::inputs::{self, GivenSchedule};
use super::output::Output;
use super::page;

/// What is written into the output directory.
const FILES: [&str; 4] = ["simulation.json", "curves.csv", "curves.svg", "errors.svg"];

/// Misalignments of a sweep, degrees.
const SWEPT_DEG: [f64; 8] = [0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0];
/// Factors on the prior of the drift in a sweep.
const SWEPT_FACTORS: [f64; 7] = [0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0];

/// Runs the command.
pub(super) fn run(args: &SimulateArgs, output: Output) -> Result<Exit> {
    let GivenSchedule {
        study,
        inputs,
        schedule,
        timeline,
    } = inputs::given_schedule(&args.given, &args.common)?;
    let options = SimulationOptions {
        truth: args.truth,
        filter: args.filter,
        told: ToldNoise::both(args.told_noise_factor),
        ..SimulationOptions::default()
    };
    let simulation = Simulation::new(study.platform(), &timeline, options).map_err(name_option)?;
    let files = args
        .output
        .as_ref()
        .map(|directory| OutputFiles::prepare(directory, &FILES))
        .transpose()?;
    if let Some(files) = &files {
        remove_on_signal(files.litter());
    }
    let seed = study.search().seed;
    let pool = inputs::thread_pool(&study)?;
    let (found, swept) = pool.install(|| {
        let found = simulation
            .monte_carlo(args.runs, seed)
            .map_err(name_option)?;
        let swept = match args.sweep {
            true => run_sweep(args, &study, &timeline, options)?,
            false => Vec::new(),
        };
        Ok::<_, Error>((found, swept))
    })?;
    let document = SimulationDocument::new(&found, &options, &swept, &schedule, &inputs);
    let json = document.to_json()?;
    if let Some(files) = files {
        let trajectory = simulation.trajectory(&simulation.draw(seed, 0), seed, 0);
        let written = files.commit(&contents(&json, &trajectory))?;
        let names: Vec<String> = written.iter().map(|p| p.display().to_string()).collect();
        output.message(&format!("written: {}", names.join(", ")));
    }
    page::write(args.report.as_deref(), output, || {
        html::simulation(&document)
    })?;
    output.data(&match args.common.json {
        true => json,
        false => text::simulation(&document, &swept),
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

/// First the misalignment with the drift as it is, then the drift with the misalignment of the
/// platform's worst axis.
fn run_sweep(
    args: &SimulateArgs,
    study: &Study,
    timeline: &Timeline,
    options: SimulationOptions,
) -> Result<Vec<SweepPoint>> {
    let platform = study.platform();
    let own = platform.prior_misalignment_rad().max();
    let own_deg = crate::units::Angle::from_rad(own).deg();
    let by_misalignment = SWEPT_DEG.map(|misalignment_deg| PriorSize {
        misalignment_deg,
        drift_factor: 1.0,
    });
    let by_drift = SWEPT_FACTORS.map(|drift_factor| PriorSize {
        misalignment_deg: own_deg,
        drift_factor,
    });
    let sizes: Vec<PriorSize> = by_misalignment.into_iter().chain(by_drift).collect();
    let seed = study.search().seed;
    sweep(platform, timeline, options, &sizes, args.runs, seed)
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
