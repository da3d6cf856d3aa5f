//! The report: one HTML page that says what a document found, for people.
//!
//! Everything on a page comes from the document it is about and from what this library computes
//! of the schedule and the inputs that every document carries; the same document gives the same
//! bytes. A page needs nothing but itself: style, pictures (SVG) and a small script for sorting
//! and hovering are in it, and without the script it says the same.
//!
//! ```
//! use scheme_opt::internals::attitude::Position;
//! use scheme_opt::internals::report::html;
//! use scheme_opt::internals::results::{EvaluationDocument, Inputs};
//! use scheme_opt::internals::schedule::{Schedule, ScheduledPosition};
//! use scheme_opt::internals::config::StudyConfig;
//!
//! let config = StudyConfig::default();
//! let evaluator = config.check()?.evaluator();
//! let schedule = Schedule::new(vec![
//!     ScheduledPosition::new(Position::from_deg(0.0, 0.0, 0.0), 1000.0),
//!     ScheduledPosition::new(Position::from_deg(180.0, 0.0, 0.0), 1000.0),
//! ])?;
//! let evaluation = evaluator.evaluate(&schedule)?;
//! let inputs = Inputs { config, defaulted: Vec::new(), done: None };
//! let document = EvaluationDocument::new(&evaluation, &schedule, evaluator.objective(), &inputs);
//! let page = html::evaluation(&document)?;
//! assert!(page.starts_with("<!DOCTYPE html>") && page.contains("What the measurements cannot tell"));
//! # Ok::<(), scheme_opt::Error>(())
//! ```

mod basis;
mod blocks;
mod errors;
mod maps;
mod pictures;
pub mod sheet;
mod subject;
mod tables;
mod verdict;

use askama::Template;

use crate::baseline::baselines;
use crate::certificate::Certifier;
use crate::config::TestConfig;
use crate::error::{Error, Result};
use crate::observability::solution::NoSolution;
use crate::report::{angles, words};
use crate::results::{
    AnalysisDocument, BATCH_SCHEMA, BatchDocument, COMPARISON_SCHEMA, CertificateRecord,
    ComparedWith, ComparisonDocument, EVALUATION_SCHEMA, EvaluationDocument, RESULT_SCHEMA,
    ResultDocument, SIMULATION_SCHEMA, SimulationDocument, TOOL_VERSION, WarningRecord,
};
use crate::wording::seconds;
use basis::{Given, basis};
use blocks::{Block, Page, Section};
use subject::Subject;
use verdict::{OnSpecification, accuracy_words, gain, search_words, side_by_side, weakness};

/// The page of a search.
///
/// # Errors
///
/// As [`Evaluator::evaluate`](crate::evaluate::Evaluator::evaluate), for a document that does not
/// fit this version; [`Error::is_input`] when its inputs are not acceptable.
pub fn result(document: &ResultDocument) -> Result<String> {
    let subject = Subject::new(
        &document.schedule,
        &document.inputs,
        &document.defaulted,
        document.done.as_ref(),
    )?;
    let mut verdict = words::preface(document);
    let known = document.evaluation.score.known_before.is_some();
    verdict.extend(accuracy_words(&subject, words::specification));
    let certificate = document.certificate.as_ref().filter(|_| !known);
    verdict.extend(certificate.map(words::within));
    if !known && document.unobservable.is_acceptable() {
        verdict.extend(gain(&document.baselines));
    }
    verdict.extend(
        document
            .from
            .as_ref()
            .map(|from| words::from(document, from)),
    );
    verdict.extend(words::claims(&document.evaluation));
    verdict.extend(weakness(&subject));
    verdict.push(search_words(document));
    verdict.push(words::perfect(&document.inputs));
    let mut standing = vec![Block::Table(tables::baselines(
        &subject,
        &document.baselines,
    ))];
    let skipped = document.baselines_skipped.iter();
    let skipped = skipped.map(|s| format!("{}: not run, {}", s.name, s.reason));
    standing.extend(list(skipped.collect()));
    let mut sections = vec![Section::new(
        "verdict",
        "Verdict",
        vec![verdict_block(verdict)],
    )];
    sections.extend(body(&subject));
    sections.extend(errors::sections(&subject, &document.evaluation.limits));
    if !document.pareto.is_empty() {
        let score = &document.evaluation.score;
        let blocks = vec![
            Block::Wide {
                caption: "Total time against accuracy. Only schedules that the stand can run are \
                          shown; the dotted line is what no schedule can beat."
                    .to_owned(),
                svg: pictures::front(&document.pareto, score),
            },
            Block::Table(tables::front(&document.pareto, score)),
        ];
        sections.push(Section::new("front", "Time against accuracy", blocks));
    }
    sections.push(Section::new(
        "standard",
        "Beside the standard schemes",
        standing,
    ));
    let given = Given::of(document)?;
    let command = given.command();
    sections.push(basis(&subject, &command, Some(document.seed), &given)?);
    let total = seconds(document.evaluation.total_time_s);
    let title = format!("Torquing scheme found: {total} s");
    page(
        &title,
        Some(&document.inputs.test),
        with_warnings(&subject.document.warnings, sections),
    )
}

/// The page of a schedule that was given.
///
/// # Errors
///
/// As [`result`].
pub fn evaluation(document: &EvaluationDocument) -> Result<String> {
    let subject = Subject::new(
        &document.schedule,
        &document.inputs,
        &document.defaulted,
        document.done.as_ref(),
    )?;
    let (verdict, standing) = standing(&subject, words::specification);
    let mut sections = vec![Section::new(
        "verdict",
        "Verdict",
        vec![verdict_block(verdict)],
    )];
    sections.extend(body(&subject));
    sections.extend(errors::sections(&subject, &document.limits));
    sections.push(Section::new(
        "standard",
        "Beside the standard schemes",
        standing,
    ));
    let command = "scheme-opt evaluate --schedule schedule.csv --platform platform.toml \
                   --report report.html";
    sections.push(basis(&subject, command, None, &Given::default())?);
    let total = seconds(document.total_time_s);
    let title = format!("Torquing scheme evaluated: {total} s");
    page(
        &title,
        Some(&document.inputs.test),
        with_warnings(&subject.document.warnings, sections),
    )
}

/// The page of a simulation.
///
/// # Errors
///
/// As [`result`].
pub fn simulation(document: &SimulationDocument) -> Result<String> {
    let subject = Subject::new(
        &document.schedule,
        &document.inputs,
        &document.defaulted,
        None,
    )?;
    let (planned, standing) = standing(&subject, words::planned_specification);
    let mut verdict = words::simulated(document);
    verdict.extend(planned);
    let mut sections = vec![Section::new(
        "verdict",
        "Verdict",
        vec![verdict_block(verdict)],
    )];
    sections.extend(body(&subject));
    let mut blocks = vec![
        Block::Text(format!(
            "{} runs of the test with {} truth and {} filter, each with its own errors of the \
             instruments, misalignment and noise. The drift is not compensated meanwhile: at its farthest the \
             platform is {:.2}° off the computed frame (RMS of the runs).",
            document.runs, document.truth, document.filter, document.rms_largest_misalignment_deg,
        )),
        Block::Wide {
            caption: "Errors of the runs by what the filter says of them. Crosses lie outside the \
                      band in which 95 of 100 lie when the filter is right about itself."
                .to_owned(),
            svg: pictures::consistency(document),
        },
        Block::Table(tables::simulated(document)),
    ];
    let others = words::other_parameters(document);
    if !others.is_empty() {
        blocks.push(Block::Table(tables::simulated_parameters(others)));
    }
    if document.compared_with == ComparedWith::FilterAndConsidered {
        blocks.push(Block::Text(words::columns(document)));
    }
    let judgement = document.judgement.as_ref();
    if let Some(check) = judgement.and_then(|j| j.specification.as_ref()) {
        blocks.push(Block::Table(tables::specification(check)));
        blocks.push(Block::Text(words::intervals(check)));
    }
    blocks.push(Block::Table(tables::consistency(document)));
    blocks.push(Block::Text(words::bounds(document)));
    if !document.sweep.is_empty() {
        blocks.push(Block::Table(tables::sweep(document)));
        if !others.is_empty() {
            blocks.push(Block::Text(words::SWEPT.to_owned()));
        }
    }
    sections.push(Section::new("simulation", "Monte Carlo check", blocks));
    sections.push(Section::new(
        "standard",
        "Beside the standard schemes",
        standing,
    ));
    let mut command = format!(
        "scheme-opt simulate --schedule schedule.csv --platform platform.toml --runs {} \
         --truth {} --filter {} --seed {}",
        document.runs, document.truth, document.filter, document.seed
    );
    if document.told_accelerometer_factor != 1.0 {
        let factor = document.told_accelerometer_factor;
        command.push_str(&format!(" --told-noise-factor {factor}"));
    }
    if !document.sweep.is_empty() {
        command.push_str(" --sweep");
    }
    command.push_str(" --report report.html");
    sections.push(basis(
        &subject,
        &command,
        Some(document.seed),
        &Given::default(),
    )?);
    let total = seconds(document.total_time_s);
    let title = format!("Torquing scheme simulated: {total} s");
    page(
        &title,
        Some(&document.inputs.test),
        with_warnings(&subject.document.warnings, sections),
    )
}

/// The page of a comparison: side by side, and then the best of them in full.
///
/// # Errors
///
/// As [`result`]; [`Error::is_input`] for a comparison of nothing.
pub fn comparison(document: &ComparisonDocument) -> Result<String> {
    let best = document
        .schedules
        .iter()
        .min_by(|a, b| a.criterion.total_cmp(&b.criterion))
        .ok_or_else(|| Error::input("the comparison holds no schedule").with_key("schedules"))?;
    let subject = Subject::new(&best.schedule, &document.inputs, &document.defaulted, None)?;
    let name = tables::name(&best.name, best.order);
    let mut verdict = vec![side_by_side(document, best, &name)];
    verdict.extend(accuracy_words(&subject, words::specification));
    let (within, _) = standing(&subject, words::specification);
    verdict.extend(within.into_iter().skip(verdict.len() - 1));
    let mut blocks = vec![
        Block::Table(tables::compared(document)),
        Block::Table(tables::compared_coefficients(document)),
    ];
    let skipped = document.skipped.iter();
    let skipped =
        skipped.map(|s| format!("{}: not run, {}", tables::name(&s.name, s.order), s.reason));
    blocks.extend(list(skipped.collect()));
    let mut sections = vec![
        Section::new("verdict", "Verdict", vec![verdict_block(verdict)]),
        Section::new("comparison", "Side by side", blocks),
    ];
    sections.extend(body(&subject));
    let names: Vec<&str> = document
        .schedules
        .iter()
        .filter(|s| s.order == crate::compare::PositionOrder::AsGiven)
        .map(|s| s.name.as_str())
        .collect();
    let mut command = format!(
        "scheme-opt compare {} --platform platform.toml",
        names.join(" ")
    );
    if names.len() < document.schedules.len() {
        command.push_str(" --best-order");
    }
    if document.total_time_s.is_none() {
        command.push_str(" --as-given");
    }
    command.push_str(" --report report.html");
    sections.push(basis(&subject, &command, None, &Given::default())?);
    page(
        &format!("Torquing schemes compared; best: {name}"),
        Some(&document.inputs.test),
        with_warnings(&document.warnings, sections),
    )
}

/// The page of a batch.
///
/// # Errors
///
/// [`Error::is_numerical`] when the template cannot be written.
pub fn batch(document: &BatchDocument) -> Result<String> {
    let all = &document.platforms;
    let mut blocks = vec![Block::Table(tables::batch(all))];
    let with_files = all.iter().filter(|p| p.criterion.is_some());
    let links: Vec<(String, String)> = with_files
        .map(|p| {
            let page = format!("{}/report.html", percent_encoded(&p.directory));
            (page, format!("{}: report", p.directory))
        })
        .collect();
    if !links.is_empty() {
        blocks.push(Block::Links(links));
    }
    let reasons = all.iter().filter_map(|p| {
        let why = words::why_not(p)?;
        Some(format!("{}: {why}", p.directory))
    });
    blocks.extend(list(reasons.collect()));
    let verdict = verdict_block(vec![words::batch(document)]);
    let sections = vec![
        Section::new("verdict", "Verdict", vec![verdict]),
        Section::new("platforms", "Platforms", blocks),
    ];
    page(
        &format!("Torquing schemes of {} platforms", all.len()),
        None,
        sections,
    )
}

/// A name as a part of an address.
fn percent_encoded(name: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
    let encoded = name.bytes().map(|byte| match plain(byte) {
        true => char::from(byte).to_string(),
        false => format!("%{byte:02X}"),
    });
    encoded.collect()
}

/// The page of any of these documents, told by its `schema`.
///
/// # Errors
///
/// [`Error::is_input`] for text that is no such document; as [`result`] otherwise.
pub fn from_json(text: &str) -> Result<String> {
    /// What tells the documents apart.
    #[derive(serde::Deserialize)]
    struct Head {
        schema: String,
    }
    fn read<T: serde::de::DeserializeOwned>(text: &str) -> Result<T> {
        serde_json::from_str(text).map_err(|e| {
            Error::input(format!("not a document of this program: {e}"))
                .with_line(e.line())
                .with_source(e)
        })
    }
    let head: Head = read(text)?;
    match head.schema.as_str() {
        RESULT_SCHEMA => result(&read(text)?),
        EVALUATION_SCHEMA => evaluation(&read(text)?),
        SIMULATION_SCHEMA => simulation(&read(text)?),
        COMPARISON_SCHEMA => comparison(&read(text)?),
        BATCH_SCHEMA => batch(&read(text)?),
        other => Err(Error::input("no report is made of this document")
            .with_key("schema")
            .with_value(other)
            .with_allowed(
                [
                    RESULT_SCHEMA,
                    EVALUATION_SCHEMA,
                    SIMULATION_SCHEMA,
                    COMPARISON_SCHEMA,
                    BATCH_SCHEMA,
                ]
                .join(", "),
            )),
    }
}

/// Before everything else, what is hard to believe of the inputs.
fn with_warnings(warnings: &[WarningRecord], mut sections: Vec<Section>) -> Vec<Section> {
    let sentences = warnings.iter().map(|w| {
        let (key, value, message) = (&w.key, &w.value, &w.message);
        format!("{key} = {value}: {message}.")
    });
    if let Some(block) = list(sentences.collect()) {
        let says = "These inputs are allowed but hard to believe. Nothing that follows is changed \
                    for that: it holds for the values as they are given.";
        let blocks = vec![Block::Text(says.to_owned()), block];
        sections.insert(0, Section::new("warnings", "Check your inputs", blocks));
    }
    sections
}

fn page(title: &str, test: Option<&TestConfig>, sections: Vec<Section>) -> Result<String> {
    let page = Page {
        title: title.to_owned(),
        test: test.and_then(words::test),
        tool_version: TOOL_VERSION,
        sections,
    };
    page.render()
        .map_err(|e| Error::numerical(format!("the report cannot be written: {e}")).with_source(e))
}

/// The page in place of one that could not be made: that and why, for a result that must not be
/// lost to its explanation.
///
/// # Errors
///
/// [`Error::is_numerical`] when the template cannot be written.
pub fn absent(why: &Error) -> Result<String> {
    let text = format!("This report could not be made: {why}. The document has the result.");
    let section = Section::new("verdict", "No report", vec![Block::Text(text)]);
    page("Torquing scheme", None, vec![section])
}

/// The unit as this page writes it: sentences shared with the terminal have it in plain letters.
fn typeset(sentence: &str) -> String {
    sentence.replace("deg/h", "°/h")
}

/// Names of angles and their unit as this page writes them.
fn typeset_angles(sentence: &str) -> String {
    [(" deg", "°"), ("alpha", "α"), ("beta", "β"), ("gamma", "γ")]
        .into_iter()
        .fold(sentence.to_owned(), |text, (plain, letter)| {
            text.replace(plain, letter)
        })
}

fn verdict_block(sentences: Vec<String>) -> Block {
    Block::List(sentences.iter().map(|s| typeset(s)).collect())
}

fn list(sentences: Vec<String>) -> Option<Block> {
    (!sentences.is_empty()).then_some(Block::List(sentences))
}

/// Bound and baselines of a schedule that no search has put beside them.
fn standing(subject: &Subject, on_specification: OnSpecification) -> (Vec<String>, Vec<Block>) {
    let total_time_s = subject.document.total_time_s;
    let achieved = subject.document.score.criterion;
    let certifier = Certifier::new(subject.study.test().platform());
    let objective = subject.evaluator.objective();
    let certificate =
        CertificateRecord::of_criterion(&certifier, objective, total_time_s, achieved);
    let all = baselines(&subject.evaluator, total_time_s);
    let compared = crate::results::compared(&all, &subject.document);
    let mut verdict = accuracy_words(subject, on_specification);
    match words::known_before(&subject.document) {
        Some(known) => verdict.push(known),
        None => {
            verdict.push(words::within(&certificate));
            verdict.extend(gain(&compared));
        }
    }
    verdict.extend(words::claims(&subject.document));
    verdict.extend(weakness(subject));
    verdict.push(words::perfect(&subject.document.inputs));
    let mut blocks = vec![Block::Table(tables::baselines(subject, &compared))];
    let skipped = crate::results::skipped(&all);
    let skipped = skipped
        .iter()
        .map(|s| format!("{}: not run, {}", s.name, s.reason));
    blocks.extend(list(skipped.collect()));
    (verdict, blocks)
}

/// Schedule, accuracy, observability, correlations: the same for every document.
fn body(subject: &Subject) -> Vec<Section> {
    vec![
        Section::new("schedule", "Schedule", schedule_blocks(subject)),
        Section::new("angles", "Angles and axes", angle_blocks(subject)),
        Section::new(
            "commands",
            "Commands for the stand",
            command_blocks(subject),
        ),
        Section::new(
            "accuracy",
            "Accuracy against time",
            accuracy_blocks(subject),
        ),
        Section::new(
            "observability",
            "Observability",
            observability_blocks(subject),
        ),
        Section::new("correlation", "Correlations", correlation_blocks(subject)),
    ]
}

fn schedule_blocks(subject: &Subject) -> Vec<Block> {
    vec![
        Block::Wide {
            caption: "Gimbal angles against time. Moves and settling are shaded; the numbers are \
                      those of the positions."
                .to_owned(),
            svg: pictures::gimbals(subject),
        },
        Block::Table(tables::positions(subject)),
        Block::Text(typeset_angles(&words::winding(
            subject.document.winding_deg,
        ))),
        Block::Text(
            "Where gravity points in the platform at each position, in a map of equal areas: dots \
             lie along an axis, diamonds are oblique to two axes, crosses to all three. Positions \
             along the axes cannot tell the input-axis coefficients apart; oblique ones can. \
             Dotted: measured moves."
                .to_owned(),
        ),
        Block::Pictures(maps::sphere(subject).to_vec()),
    ]
}

/// What the angles mean, and how to see on the stand that they mean the same there.
fn angle_blocks(subject: &Subject) -> Vec<Block> {
    let platform = subject.study.test().platform();
    vec![
        Block::List(angles::convention(platform)),
        Block::Wide {
            caption:
                "The gimbals, and for each of them the platform before (dashed) and after a turn \
                      of its angle, seen from the south-west and above."
                    .to_owned(),
            svg: angles::picture(platform),
        },
        Block::Text(
            "To see that the stand means the same: set these angles and hold the accelerometers' \
             readings against them. A gimbal that turns the other way, or another gimbal, reads \
             something else."
                .to_owned(),
        ),
        Block::Table(tables::check_positions(platform)),
    ]
}

fn command_blocks(subject: &Subject) -> Vec<Block> {
    vec![
        Block::Text(
            "ω_c is the rate of the platform relative to inertial space in its own axes: it tracks \
             the Earth while it dwells, and slews on top of that in a move. Through a move ω_c \
             changes; the table has that of the first of its steps, and commands.csv has all of \
             them (scheme-opt commands)."
                .to_owned(),
        ),
        Block::Table(tables::commands(subject)),
    ]
}

fn accuracy_blocks(subject: &Subject) -> Vec<Block> {
    let mut blocks = vec![
        Block::Pictures(pictures::accuracy(subject)),
        Block::Table(tables::accuracy(subject)),
    ];
    let constant_part = words::constant_part(&subject.document);
    blocks.extend(constant_part.map(|said| Block::Text(typeset(&said))));
    blocks.push(Block::Table(tables::misalignment(subject)));
    blocks
}

fn observability_blocks(subject: &Subject) -> Vec<Block> {
    let mut blocks = vec![
        Block::Text(words::observability(&subject.document)),
        Block::Table(tables::observability(subject)),
    ];
    blocks.extend(nearly(&subject.analysis));
    blocks.push(Block::Table(tables::weak(subject)));
    blocks
}

/// What is told only through a small tilt, if anything; and what could not be proven.
fn nearly(analysis: &AnalysisDocument) -> Option<Block> {
    let mut lines: Vec<String> = analysis.nearly.iter().map(|n| n.words.clone()).collect();
    if !lines.is_empty() {
        lines.insert(0, words::NEARLY.to_owned());
    }
    lines.extend(analysis.coefficients.iter().filter_map(|c| {
        let why = c.reconstruction_absent?;
        (why != NoSolution::NotObservable).then(|| format!("{}: {why}.", c.name.name()))
    }));
    list(lines)
}

fn correlation_blocks(subject: &Subject) -> Vec<Block> {
    vec![
        Block::Wide {
            caption: format!(
                "Correlations of the estimates at the end of the test, all {} pairs: vermillion \
                 together, blue against each other.",
                subject::PAIRS
            ),
            svg: maps::correlations(&subject.correlations()),
        },
        Block::Table(tables::correlations(subject)),
    ]
}
