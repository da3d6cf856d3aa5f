//! The command line's grammar.

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};

use super::files::Existing;
use crate::commands::CommandTable;
use crate::config::{CriterionKind, Grade, Mode};
use crate::results::schema::DocumentKind;
use crate::simulate::{FilterModel, TruthModel};

const ABOUT: &str =
    "Finds the torquing scheme that calibrates an inertially stabilised platform's gyros best";

const EXIT_CODES: &str = "\
Exit codes:
  0    done
   1    search, batch, bound, compare: no acceptable schedule, since the specification or the limits cannot
        be met or a coefficient that counts stays unobservable; simulate --check: not passed.
        evaluate and analyze tell of a given schedule, whatever it is worth, and end with 0
  2    usage or input error
  130  interrupted; the best schedule so far is written
       batch: 130 before 2 before 1, if any of its platforms has it; the summary says which";

/// The whole command line.
#[derive(Debug, Parser)]
#[command(name = "scheme-opt", version, about = ABOUT, after_help = EXIT_CODES)]
pub(super) struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Invocation,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(super) enum Invocation {
    /// Find and write the recommended schedule
    Search(SearchArgs),
    /// Score a given schedule
    Evaluate(EvaluateArgs),
    /// Say what a given schedule makes observable, why, and what to add
    Analyze(AnalyzeArgs),
    /// Play a given schedule through: true platform, filter, consistency over many runs
    Simulate(SimulateArgs),
    /// Compare schedules, given and built-in, in the same total time
    Compare(CompareArgs),
    /// Say what no schedule can beat, without searching for one
    Bound(BoundArgs),
    /// Search for each of many platforms, with one summary over all
    Batch(BatchArgs),
    /// Write a commented platform file
    Init(InitArgs),
    /// List the built-in schemes, or write one
    Standard(StandardArgs),
    /// Turn a schedule as one has it (Excel, CSV of any kind) into a schedule file
    Convert(ConvertArgs),
    /// Write what the stand is told to do, second by second, as CSV, and the operator's sheet
    Commands(CommandsArgs),
    /// Write the report of a document, HTML
    Report(ReportArgs),
    /// List the documents, or write the JSON Schema of one
    Schema(SchemaArgs),
    /// Write completions for a shell to stdout
    Completions(CompletionsArgs),
    /// Write the manual
    Man(ManArgs),
}

impl Invocation {
    /// Whether messages are to be dropped.
    pub(super) const fn is_quiet(&self) -> bool {
        match self {
            Self::Search(a) => a.common.messages.quiet,
            Self::Evaluate(a) => a.common.messages.quiet,
            Self::Analyze(a) => a.common.messages.quiet,
            Self::Simulate(a) => a.common.messages.quiet,
            Self::Compare(a) => a.common.messages.quiet,
            Self::Bound(a) => a.common.messages.quiet,
            Self::Batch(a) => a.common.messages.quiet,
            Self::Init(a) => a.messages.quiet,
            Self::Standard(a) => a.messages.quiet,
            Self::Convert(a) => a.messages.quiet,
            Self::Commands(a) => a.common.messages.quiet,
            Self::Report(a) => a.messages.quiet,
            Self::Schema(a) => a.messages.quiet,
            Self::Completions(_) | Self::Man(_) => false,
        }
    }
}

/// What goes to stderr.
#[derive(Debug, Args)]
pub(super) struct Messages {
    /// No messages and no progress on stderr
    #[arg(short, long)]
    pub quiet: bool,
}

/// Options that override the platform file.
#[derive(Debug, Args)]
pub(super) struct Common {
    /// The JSON document on stdout, nothing else there
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub messages: Messages,
    /// Seed of the search's random streams
    #[arg(
        long,
        value_name = "N",
        help_heading = "Override the platform file",
        allow_negative_numbers = true
    )]
    pub seed: Option<u64>,
    /// What is asked for
    #[arg(long, value_name = "MODE", help_heading = "Override the platform file",
          value_parser = modes())]
    pub mode: Option<Mode>,
    /// What makes one schedule better than another
    #[arg(long, value_name = "NAME", help_heading = "Override the platform file",
          value_parser = criteria())]
    pub criterion: Option<CriterionKind>,
    /// Duration of the test, moves and settles included, for a search
    #[arg(
        long,
        value_name = "S",
        help_heading = "Override the platform file",
        allow_negative_numbers = true
    )]
    pub total_time_s: Option<f64>,
    /// Most positions of a schedule
    #[arg(
        long,
        value_name = "N",
        help_heading = "Override the platform file",
        allow_negative_numbers = true
    )]
    pub max_positions: Option<usize>,
    /// Threads to compute with [default: all cores]
    #[arg(
        long,
        value_name = "N",
        help_heading = "Override the platform file",
        allow_negative_numbers = true
    )]
    pub threads: Option<usize>,
    /// Stop a search after this time; the best schedule so far is the result. Confirming it by
    /// the step-by-step filter comes on top: about 10 µs a filter period
    #[arg(
        long,
        value_name = "S",
        help_heading = "Override the platform file",
        allow_negative_numbers = true
    )]
    pub time_limit_s: Option<f64>,
}

/// `search`.
#[derive(Debug, Args)]
pub(super) struct SearchArgs {
    /// Platform file; without one, the built-in platform (see `init`)
    #[arg(value_name = "PLATFORM.toml")]
    pub platform: Option<PathBuf>,
    /// Directory to write schedule.json, schedule.csv, commands.csv, the operator's sheet (sheet.html,
    /// sheet.csv), result.json and report.html to
    #[arg(short, long, value_name = "DIR", default_value = "scheme-opt-out")]
    pub output: PathBuf,
    /// How many starts the search makes
    #[arg(
        long,
        value_name = "N",
        help_heading = "Override the platform file",
        allow_negative_numbers = true
    )]
    pub starts: Option<usize>,
    /// Begin with this schedule too: the result is never worse than it. Positions pinned in the file
    /// keep their angles and their order
    #[arg(long, value_name = "SCHEDULE", help_heading = "The scheme one has")]
    pub from: Option<PathBuf>,
    /// Change nothing else of it: its dwells, its order, or `dwells,order`
    #[arg(
        long,
        value_name = "WHAT",
        value_delimiter = ',',
        requires = "from",
        help_heading = "The scheme one has"
    )]
    pub only: Vec<Changeable>,
    /// This has been run already, the last dwell as long as it was: plan the rest of the test
    #[arg(long, value_name = "SCHEDULE", help_heading = "The scheme one has")]
    pub done: Option<PathBuf>,
    /// Continue an interrupted search from the checkpoint in the output directory
    #[arg(long, conflicts_with = "no_clobber")]
    pub resume: bool,
    /// Least time between two checkpoints
    #[arg(
        long,
        value_name = "S",
        default_value_t = 5.0,
        allow_negative_numbers = true
    )]
    pub checkpoint_interval_s: f64,
    /// Leave out wall time and number of threads, so that equal inputs give equal files
    #[arg(long)]
    pub reproducible: bool,
    #[command(flatten)]
    pub existing: ExistingResults,
    #[command(flatten)]
    pub common: Common,
}

/// What becomes of results that are there already.
#[derive(Debug, Args)]
pub(super) struct ExistingResults {
    /// Refuse to write over results that are there already; without it a line says whose were replaced
    #[arg(long)]
    pub no_clobber: bool,
}

impl ExistingResults {
    /// As it is meant for files.
    pub(super) const fn choice(&self) -> Existing {
        match self.no_clobber {
            true => Existing::Keep,
            false => Existing::Replace,
        }
    }
}

/// What alone a search may change of the scheme it begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Changeable {
    /// How long positions are held
    Dwells,
    /// The order of the positions
    Order,
}

/// `batch`.
#[derive(Debug, Args)]
pub(super) struct BatchArgs {
    /// Platform files
    #[arg(value_name = "PLATFORM.toml", required = true)]
    pub platforms: Vec<PathBuf>,
    /// Directory to write batch.json, batch.csv and batch.html to, and for each platform a directory with
    /// what search writes, named after its file. What is finished there by the same inputs is kept, what
    /// was interrupted goes on
    #[arg(short, long, value_name = "DIR", default_value = "scheme-opt-batch")]
    pub output: PathBuf,
    /// Searches at the same time, which share the processors [default: one for each processor]
    #[arg(long, value_name = "N")]
    pub jobs: Option<std::num::NonZeroUsize>,
    /// How many starts each search makes
    #[arg(
        long,
        value_name = "N",
        help_heading = "Override the platform file",
        allow_negative_numbers = true
    )]
    pub starts: Option<usize>,
    #[command(flatten)]
    pub common: Common,
}

/// A schedule, and the platform it is for.
#[derive(Debug, Args)]
pub(super) struct Given {
    /// Schedule, JSON or CSV
    #[arg(short, long, value_name = "FILE")]
    pub schedule: PathBuf,
    /// Platform file; without one, the built-in platform
    #[arg(short, long, value_name = "FILE")]
    pub platform: Option<PathBuf>,
}

/// `evaluate`.
#[derive(Debug, Args)]
pub(super) struct EvaluateArgs {
    #[command(flatten)]
    pub given: Given,
    /// Write the report to this file too, HTML
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    #[command(flatten)]
    pub common: Common,
}

/// `analyze`.
#[derive(Debug, Args)]
pub(super) struct AnalyzeArgs {
    #[command(flatten)]
    pub given: Given,
    #[command(flatten)]
    pub common: Common,
}

/// `commands`.
#[derive(Debug, Args)]
pub(super) struct CommandsArgs {
    #[command(flatten)]
    pub given: Given,
    /// Largest turn of a gimbal in one step of a move, degrees
    #[arg(
        long,
        value_name = "DEG",
        default_value_t = CommandTable::DEFAULT_STEP_DEG,
        allow_negative_numbers = true
    )]
    pub step_deg: f64,
    /// File to write the table to, CSV [default: stdout, unless only a sheet is asked for]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// File to write the operator's sheet to, a page to print (.html) or CSV (.csv); may be given twice
    #[arg(long, value_name = "FILE")]
    pub sheet: Vec<PathBuf>,
    #[command(flatten)]
    pub common: Common,
}

/// `report`.
#[derive(Debug, Args)]
pub(super) struct ReportArgs {
    /// Document: result.json, or what evaluate, simulate or compare print with --json
    #[arg(value_name = "DOCUMENT.json")]
    pub document: PathBuf,
    /// File to write; `-` for stdout
    #[arg(short, long, value_name = "FILE", default_value = "report.html")]
    pub output: PathBuf,
    #[command(flatten)]
    pub messages: Messages,
}

/// `schema`.
#[derive(Debug, Args)]
pub(super) struct SchemaArgs {
    /// Document; without one, all are listed
    #[arg(value_name = "WHICH", value_parser = documents())]
    pub which: Option<DocumentKind>,
    /// The list as JSON too
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub messages: Messages,
}

/// `completions`.
#[derive(Debug, Args)]
pub(super) struct CompletionsArgs {
    /// Shell to write completions for
    #[arg(value_name = "SHELL")]
    pub shell: clap_complete::Shell,
}

/// `man`.
#[derive(Debug, Args)]
pub(super) struct ManArgs {
    /// Directory to write a page for every command to [default: one page on stdout]
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
}

/// `simulate`.
#[derive(Debug, Args)]
pub(super) struct SimulateArgs {
    #[command(flatten)]
    pub given: Given,
    /// How many runs, each with its own truth and noise
    #[arg(
        long,
        value_name = "N",
        default_value_t = 500,
        allow_negative_numbers = true
    )]
    pub runs: usize,
    /// Directory to write simulation.json, curves.csv, curves.svg and errors.svg to
    #[arg(short, long, value_name = "DIR")]
    pub output: Option<PathBuf>,
    /// Write the report to this file too, HTML
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Equations of the true platform
    #[arg(long, value_name = "MODEL", default_value = TruthModel::default().name(),
          value_parser = truths())]
    pub truth: TruthModel,
    /// What the filter linearises about: zero, its estimate, or that of the whole test
    #[arg(long, value_name = "MODEL", default_value = FilterModel::default().name(),
          value_parser = filters())]
    pub filter: FilterModel,
    /// Tell the filter this many times the true noise, to see it misjudge itself
    #[arg(
        long,
        value_name = "FACTOR",
        default_value_t = 1.0,
        allow_negative_numbers = true
    )]
    pub told_noise_factor: f64,
    /// Exit code 1 unless the runs show that all is well: no run diverged, the filter is
    /// consistent, and the specification, if there is one, is met
    #[arg(long)]
    pub check: bool,
    /// Also find out how large a prior misalignment and drift the linearisation bears
    #[arg(long)]
    pub sweep: bool,
    #[command(flatten)]
    pub existing: ExistingResults,
    #[command(flatten)]
    pub common: Common,
}

/// `compare`.
#[derive(Debug, Args)]
pub(super) struct CompareArgs {
    /// Schedules: files, JSON or CSV, and built-in schemes as standard:NAME; ratios are to the
    /// first
    #[arg(value_name = "SCHEDULE", required_unless_present = "standard")]
    pub schedules: Vec<String>,
    /// Every built-in scheme too
    #[arg(long)]
    pub standard: bool,
    /// Each schedule also in its best order: proven up to 12 positions where dwells are equal and the
    /// steps are enough, else the best found
    #[arg(long)]
    pub best_order: bool,
    /// Steps towards that proof before it is left open, for each scheme
    #[arg(long, value_name = "N", default_value_t = crate::compare::MOST_STEPS)]
    pub order_steps: u64,
    /// Run given schedules as they are, not scaled to the total time
    #[arg(long)]
    pub as_given: bool,
    #[command(flatten)]
    pub existing: ExistingResults,
    /// Platform file; without one, the built-in platform
    #[arg(short, long, value_name = "FILE")]
    pub platform: Option<PathBuf>,
    /// Write the report to this file too, HTML
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    #[command(flatten)]
    pub common: Common,
}

/// `bound`.
#[derive(Debug, Args)]
pub(super) struct BoundArgs {
    /// Platform file; without one, the built-in platform (see `init`)
    #[arg(value_name = "PLATFORM.toml")]
    pub platform: Option<PathBuf>,
    #[command(flatten)]
    pub common: Common,
}

/// `init`.
#[derive(Debug, Args)]
pub(super) struct InitArgs {
    /// File to write; `-` for stdout
    #[arg(value_name = "FILE", default_value = "platform.toml")]
    pub file: PathBuf,
    /// Plausible numbers for instruments of this grade instead of the paper's
    #[arg(long, value_name = "GRADE", value_parser = grades())]
    pub grade: Option<Grade>,
    /// With the full error model: torquers, accelerometers, quadratic drift [grade: navigation, unless
    /// given]
    #[arg(long)]
    pub full: bool,
    /// Overwrite the file if it exists
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub messages: Messages,
}

/// `standard`.
#[derive(Debug, Args)]
pub(super) struct StandardArgs {
    /// Scheme to write; without one, all are listed
    #[arg(value_name = "NAME")]
    pub name: Option<String>,
    /// Platform file; without one, the built-in platform
    #[arg(short, long, value_name = "FILE")]
    pub platform: Option<PathBuf>,
    /// Duration of the test, moves and settles included [default: the platform file's]
    #[arg(long, value_name = "S", allow_negative_numbers = true)]
    pub total_time_s: Option<f64>,
    /// File to write the schedule to [default: stdout]
    #[arg(short, long, value_name = "FILE", requires = "name")]
    pub output: Option<PathBuf>,
    /// Format of the schedule [default: by the extension of the file, else json]
    #[arg(long, value_enum, value_name = "FORMAT", requires = "name")]
    pub format: Option<Format>,
    /// The list as JSON too
    #[arg(long, conflicts_with = "format")]
    pub json: bool,
    #[command(flatten)]
    pub messages: Messages,
}

/// Arguments of `convert`.
#[derive(Debug, Args)]
pub(super) struct ConvertArgs {
    /// Excel workbook (.xlsx), CSV or text with commas, semicolons or tabs, or JSON
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// File to write the schedule to [default: stdout]
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Format of the schedule [default: by the extension of the output file, else json]
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub format: Option<Format>,
    #[command(flatten)]
    pub messages: Messages,
}

/// Formats of a schedule file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Format {
    /// JSON document
    Json,
    /// Comma-separated values
    Csv,
}

fn modes() -> impl TypedValueParser<Value = Mode> {
    PossibleValuesParser::new(Mode::ALL.map(Mode::name)).try_map(|name| Mode::from_name(&name))
}

fn grades() -> impl TypedValueParser<Value = Grade> {
    PossibleValuesParser::new(Grade::ALL.map(Grade::name)).try_map(|name| Grade::from_name(&name))
}

fn criteria() -> impl TypedValueParser<Value = CriterionKind> {
    PossibleValuesParser::new(CriterionKind::ALL.map(CriterionKind::name))
        .try_map(|name| CriterionKind::from_name(&name))
}

fn documents() -> impl TypedValueParser<Value = DocumentKind> {
    PossibleValuesParser::new(DocumentKind::ALL.map(DocumentKind::name))
        .try_map(|name| DocumentKind::from_name(&name))
}

fn truths() -> impl TypedValueParser<Value = TruthModel> {
    PossibleValuesParser::new(TruthModel::ALL.map(TruthModel::name)).map(|name| {
        let known = TruthModel::ALL.into_iter().find(|m| m.name() == name);
        known.unwrap_or_default()
    })
}

fn filters() -> impl TypedValueParser<Value = FilterModel> {
    PossibleValuesParser::new(FilterModel::ALL.map(FilterModel::name)).map(|name| {
        let known = FilterModel::ALL.into_iter().find(|m| m.name() == name);
        known.unwrap_or_default()
    })
}
