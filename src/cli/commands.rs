//! `commands`: what the stand is told to do, as CSV, and what its operator does.

use std::path::Path;

use crate::error::{Error, Result};
use crate::report::words;
use crate::sheet::OperatorSheet;
use crate::suspicion;

use super::args::CommandsArgs;
use super::exit::Exit;
use super::files::write_file;
use super::output::Output;
use super::{inputs, report};

/// The forms of a sheet.
#[derive(Debug, Clone, Copy)]
enum SheetForm {
    Html,
    Csv,
}

/// Runs the command.
pub(super) fn run(args: &CommandsArgs, output: Output) -> Result<Exit> {
    let forms = args.sheet.iter().map(|path| sheet_form(path));
    let forms = forms.collect::<Result<Vec<_>>>()?;
    let given = inputs::given_schedule(&args.given, &args.common)?;
    let table = given.study.commands(&given.schedule, args.step_deg);
    let table = table.map_err(name_option)?;
    let sheet = given.study.operator_sheet(&given.schedule)?;
    for (path, form) in args.sheet.iter().zip(forms) {
        write_file(path, &written(&sheet, form)?, true)?;
        output.message(&format!("written: {}", path.display()));
    }
    let text = match args.common.json {
        true => {
            let (config, defaulted) = (given.study.config(), given.study.defaulted());
            let warnings = suspicion::of(config, defaulted, Some(&given.schedule));
            let mut document = table.document();
            document.test = config.test.clone();
            document.warnings = warnings.iter().map(Into::into).collect();
            document.to_json()?
        }
        false => table.to_csv(),
    };
    output.message(report::wrap(&words::winding(table.winding_deg())).trim_end());
    match &args.output {
        Some(path) => {
            write_file(path, &text, true)?;
            output.message(&format!("written: {}", path.display()));
        }
        None if args.sheet.is_empty() || args.common.json => output.data(&text)?,
        // The sheet is what was asked for.
        None => {}
    }
    Ok(Exit::Done)
}

/// The form that the name of a sheet's file asks for.
fn sheet_form(path: &Path) -> Result<SheetForm> {
    let extension = path.extension().map(|e| e.to_ascii_lowercase());
    match extension.as_ref().and_then(|e| e.to_str()) {
        Some("html" | "htm") => Ok(SheetForm::Html),
        Some("csv") => Ok(SheetForm::Csv),
        _ => Err(
            Error::input("the name does not say what form the sheet is to have")
                .with_key("--sheet")
                .with_value(path.display())
                .with_allowed("a name that ends in .html (a page to print) or .csv"),
        ),
    }
}

fn written(sheet: &OperatorSheet, form: SheetForm) -> Result<String> {
    match form {
        SheetForm::Html => sheet.to_html(),
        SheetForm::Csv => Ok(sheet.to_csv()),
    }
}

/// Says which option a refused number came from.
fn name_option(error: Error) -> Error {
    match error.key() {
        Some("step_deg") => error.with_key("--step-deg"),
        _ => error,
    }
}
