//! What a page rests on: formulas, inputs, versions, and how to get the same again.

use super::blocks::{Block, Section};
use super::subject::Subject;
use crate::error::{Error, Result};
use crate::results::{ResultDocument, TOOL_VERSION};
use crate::schedule::Schedule;
use crate::schedule::file::to_csv;

/// The schedules that a search was given, as files.
#[derive(Debug, Default)]
pub(super) struct Given {
    from: Option<String>,
    only: Vec<String>,
    done: Option<String>,
}

impl Given {
    /// Those of a search.
    pub fn of(document: &ResultDocument) -> Result<Self> {
        let csv = |schedule| Ok::<_, Error>(to_csv(&Schedule::try_from(schedule)?));
        let from = document.from.as_ref();
        let done = document.done.as_ref();
        Ok(Self {
            from: from.map(|from| csv(&from.schedule)).transpose()?,
            only: from.map_or_else(Vec::new, |from| from.only.clone()),
            done: done.map(|done| csv(&done.schedule)).transpose()?,
        })
    }

    /// The search again.
    pub fn command(&self) -> String {
        let mut command = "scheme-opt search platform.toml --reproducible".to_owned();
        if self.from.is_some() {
            command.push_str(" --from from.csv");
        }
        if !self.only.is_empty() {
            command.push_str(&format!(" --only {}", self.only.join(",")));
        }
        if self.done.is_some() {
            command.push_str(" --done done.csv");
        }
        command
    }

    fn files(&self) -> impl Iterator<Item = Block> + '_ {
        let files = [("from.csv", &self.from), ("done.csv", &self.done)];
        files.into_iter().filter_map(|(name, csv)| {
            Some(Block::Verbatim {
                caption: name.to_owned(),
                text: csv.clone()?,
            })
        })
    }
}

/// Formulas, inputs, versions, and how to get the same again.
pub(super) fn basis(
    subject: &Subject,
    command: &str,
    seed: Option<u64>,
    given: &Given,
) -> Result<Section> {
    let d = &subject.document;
    let platform = toml::to_string(&d.inputs).map_err(|e| {
        Error::numerical(format!("the inputs cannot be written as TOML: {e}")).with_source(e)
    })?;
    let defaulted = match d.defaulted.is_empty() {
        true => "Every value was given.".to_owned(),
        false => format!(
            "Nobody gave these; they are defaults: {}.",
            d.defaulted.join(", ")
        ),
    };
    let seed = seed.map_or_else(String::new, |s| format!(", seed {s}"));
    let mut blocks = vec![
        Block::Text(format!(
            "scheme-opt {TOOL_VERSION}{seed}; two computations of every σ agree to {:.0e}. Save \
             the files below, and this makes the same again:",
            d.agreement
        )),
        Block::Verbatim {
            caption: "Command".to_owned(),
            text: command.to_owned(),
        },
        Block::Verbatim {
            caption: "platform.toml".to_owned(),
            text: platform,
        },
        Block::Text(defaulted),
        Block::Verbatim {
            caption: "schedule.csv".to_owned(),
            text: to_csv(&subject.schedule),
        },
    ];
    blocks.extend(given.files());
    blocks.push(Block::Formulas);
    Ok(Section::new(
        "basis",
        "Formulas, inputs, reproduction",
        blocks,
    ))
}
