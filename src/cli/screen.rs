//! What stdout is: a terminal with a width and colours, or a file or pipe with neither.

use std::io::IsTerminal;

use comfy_table::{Attribute, Cell, Color, Table};

/// How text for people may look.
#[derive(Debug, Clone, Copy)]
pub(super) struct Screen {
    /// Columns.
    pub width: u16,
    /// Whether colours and bold letters are wanted.
    pub color: bool,
}

impl Screen {
    /// Width of what is not a terminal, and of running text, columns.
    pub const WIDTH: u16 = 80;
    /// The narrowest and the widest table.
    const BOUNDS: [u16; 2] = [40, 120];

    /// The standard output. Colours only on a terminal that has them, and not against `NO_COLOR`
    /// (no-color.org: any value but an empty one).
    pub fn of_stdout() -> Self {
        let terminal = std::io::stdout().is_terminal();
        let set = |name: &str| std::env::var_os(name).is_some_and(|v| !v.is_empty());
        let dumb = std::env::var_os("TERM").is_some_and(|term| term == "dumb");
        let [least, most] = Self::BOUNDS;
        // The table crate asks the terminal.
        let width = Table::new().width().filter(|_| terminal);
        Self {
            width: width.map_or(Self::WIDTH, |w| w.clamp(least, most)),
            color: terminal && !dumb && !set("NO_COLOR"),
        }
    }

    /// The heading of a column.
    pub fn heading(self, name: &str) -> Cell {
        match self.color {
            true => Cell::new(name).add_attribute(Attribute::Bold),
            false => Cell::new(name),
        }
    }

    /// A cell; what misses its aim stands out.
    pub fn cell(self, text: String) -> Cell {
        let bad = matches!(text.as_str(), "missed" | "none" | "optimistic");
        match self.color && bad {
            true => Cell::new(text).fg(Color::Red),
            false => Cell::new(text),
        }
    }
}
