//! What a page is made of, and its template.

use askama::Template;

/// The whole page.
#[derive(Template)]
#[template(path = "report.html")]
pub(super) struct Page {
    /// What it is about: headline and title of the window.
    pub title: String,
    /// Whose test it is.
    pub test: Option<String>,
    pub tool_version: &'static str,
    pub sections: Vec<Section>,
}

/// A part with a headline.
pub(super) struct Section {
    pub id: &'static str,
    pub title: &'static str,
    pub blocks: Vec<Block>,
}

impl Section {
    pub fn new(id: &'static str, title: &'static str, blocks: Vec<Block>) -> Self {
        Self { id, title, blocks }
    }
}

/// A piece of a part.
#[derive(Template)]
#[template(path = "block.html")]
pub(super) enum Block {
    /// A paragraph.
    Text(String),
    /// Sentences that stand by themselves.
    List(Vec<String>),
    Table(HtmlTable),
    /// Ways to other pages: address and text.
    Links(Vec<(String, String)>),
    /// Pictures side by side where there is room: caption and SVG.
    Pictures(Vec<(String, String)>),
    /// One wide picture.
    Wide {
        caption: String,
        svg: String,
    },
    /// A file or a command, as it is.
    Verbatim {
        caption: String,
        text: String,
    },
    /// The formulas that the numbers come from.
    Formulas,
}

/// A table: the first column names the rows.
pub(super) struct HtmlTable {
    pub caption: String,
    pub columns: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

impl HtmlTable {
    pub fn new(caption: &str, columns: &[&str], rows: Vec<Vec<String>>) -> Self {
        Self {
            caption: caption.to_owned(),
            columns: columns.iter().map(|c| (*c).to_owned()).collect(),
            rows,
        }
    }
}
