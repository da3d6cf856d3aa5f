//! Figures as SVG: panels with curves and bands over a common legend.
//!
//! Made for print and for everybody's eyes: dark lines on white, the colours of Okabe and Ito
//! (*Color Universal Design*, 2008), and a dash pattern for every colour, so that nothing depends
//! on telling colours apart. The plotting crate (plotters) lays out axes, ticks, grid and marks;
//! lines are thinned to what a tenth of a pixel shows, which keeps a picture of nine panels within
//! some 50 kB.
//!
//! ```
//! use scheme_opt::internals::report::figure::{Curve, Figure, Panel, Style};
//! let panel = Panel::new("Falling", "time, s", "height, m")
//!     .with_curve(Curve::new("truth", Style::TRUTH, vec![[0.0, 5.0], [0.5, 3.8], [1.0, 0.1]]));
//! let svg = Figure::new(1).with_panel(panel).to_svg();
//! assert!(svg.starts_with("<svg") && svg.contains("height, m"));
//! ```

pub(crate) mod canvas;
pub(crate) mod draw;
mod thin;

use plotters::style::RGBColor;

/// A colour of Okabe and Ito's palette, as far as it is dark enough for a line on white.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Color {
    /// #000000
    Black,
    /// #0072B2
    Blue,
    /// #D55E00
    Vermillion,
    /// #009E73
    Green,
    /// #CC79A7
    Purple,
    /// #E69F00
    Orange,
    /// #56B4E9
    SkyBlue,
    /// #777777
    Grey,
}

impl Color {
    pub(crate) const fn rgb(self) -> RGBColor {
        match self {
            Self::Black => RGBColor(0, 0, 0),
            Self::Blue => RGBColor(0, 0x72, 0xB2),
            Self::Vermillion => RGBColor(0xD5, 0x5E, 0),
            Self::Green => RGBColor(0, 0x9E, 0x73),
            Self::Purple => RGBColor(0xCC, 0x79, 0xA7),
            Self::Orange => RGBColor(0xE6, 0x9F, 0),
            Self::SkyBlue => RGBColor(0x56, 0xB4, 0xE9),
            Self::Grey => RGBColor(0x77, 0x77, 0x77),
        }
    }
}

/// The pattern of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dash {
    /// ————
    Solid,
    /// – – –
    Dashed,
    /// · · ·
    Dotted,
    /// – · –
    DashDotted,
}

impl Dash {
    const fn array(self) -> &'static str {
        match self {
            Self::Solid => "",
            Self::Dashed => " stroke-dasharray=\"6 3\"",
            Self::Dotted => " stroke-dasharray=\"1.5 2.5\"",
            Self::DashDotted => " stroke-dasharray=\"7 2.5 1.5 2.5\"",
        }
    }
}

/// How a line looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Style {
    /// Colour.
    pub color: Color,
    /// Pattern.
    pub dash: Dash,
    /// Width, pixels.
    pub width: f64,
}

impl Style {
    /// True values: black, solid.
    pub const TRUTH: Self = Self {
        color: Color::Black,
        dash: Dash::Solid,
        width: 1.4,
    };
    /// Errors: vermillion, solid and thin.
    pub const ERROR: Self = Self {
        color: Color::Vermillion,
        dash: Dash::Solid,
        width: 1.0,
    };
    /// Estimates: vermillion, dashed.
    pub const ESTIMATE: Self = Self {
        color: Color::Vermillion,
        dash: Dash::Dashed,
        width: 1.4,
    };
}

/// A line through points (x, y); what is not finite interrupts it.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    label: String,
    style: Style,
    points: Vec<[f64; 2]>,
}

impl Curve {
    /// A curve with a label for the legend.
    pub fn new(label: impl Into<String>, style: Style, points: Vec<[f64; 2]>) -> Self {
        Self {
            label: label.into(),
            style,
            points,
        }
    }
}

/// An area between two lines, (x, low, high).
#[derive(Debug, Clone, PartialEq)]
pub struct Band {
    label: String,
    color: Color,
    points: Vec<[f64; 3]>,
}

impl Band {
    /// A band with a label for the legend.
    pub fn new(label: impl Into<String>, color: Color, points: Vec<[f64; 3]>) -> Self {
        Self {
            label: label.into(),
            color,
            points,
        }
    }
}

/// What a mark looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// A filled circle.
    Dot,
    /// A filled diamond.
    Diamond,
    /// A cross.
    Cross,
}

/// A point with a title that shows on hover.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    at: [f64; 2],
    shape: Shape,
    color: Color,
    title: String,
}

impl Mark {
    /// A mark at (x, y).
    pub fn new(at: [f64; 2], shape: Shape, color: Color, title: impl Into<String>) -> Self {
        Self {
            at,
            shape,
            color,
            title: title.into(),
        }
    }
}

/// A stretch of x over the whole height, with a title that shows on hover.
#[derive(Debug, Clone, PartialEq)]
pub struct Span {
    range: [f64; 2],
    color: Option<Color>,
    title: String,
    text: String,
}

impl Span {
    /// From `range[0]` to `range[1]`; without a colour it only has its title.
    pub fn new(range: [f64; 2], color: Option<Color>, title: impl Into<String>) -> Self {
        Self {
            range,
            color,
            title: title.into(),
            text: String::new(),
        }
    }

    /// Writes a word or a number at its top.
    #[must_use]
    pub fn with_text(mut self, text: impl Into<String>) -> Self {
        self.text = text.into();
        self
    }
}

/// How values are spread along an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scale {
    /// Evenly.
    #[default]
    Linear,
    /// By their logarithm; what is not positive is left out.
    Log,
}

/// One diagram.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    title: String,
    x_label: String,
    y_label: String,
    curves: Vec<Curve>,
    bands: Vec<Band>,
    marks: Vec<Mark>,
    spans: Vec<Span>,
    x_range: Option<[f64; 2]>,
    y_range: Option<[f64; 2]>,
    y_scale: Scale,
    x_names: Vec<String>,
}

impl Panel {
    /// An empty panel; the labels carry the units.
    pub fn new(
        title: impl Into<String>,
        x_label: impl Into<String>,
        y_label: impl Into<String>,
    ) -> Self {
        Self {
            title: title.into(),
            x_label: x_label.into(),
            y_label: y_label.into(),
            curves: Vec::new(),
            bands: Vec::new(),
            marks: Vec::new(),
            spans: Vec::new(),
            x_range: None,
            y_range: None,
            y_scale: Scale::Linear,
            x_names: Vec::new(),
        }
    }

    /// Adds a curve, on top of those before.
    #[must_use]
    pub fn with_curve(mut self, curve: Curve) -> Self {
        self.curves.push(curve);
        self
    }

    /// Adds a band, behind all curves.
    #[must_use]
    pub fn with_band(mut self, band: Band) -> Self {
        self.bands.push(band);
        self
    }

    /// Adds a mark, on top of all curves.
    #[must_use]
    pub fn with_mark(mut self, mark: Mark) -> Self {
        self.marks.push(mark);
        self
    }

    /// Adds a span, behind everything else.
    #[must_use]
    pub fn with_span(mut self, span: Span) -> Self {
        self.spans.push(span);
        self
    }

    /// Shows x from `low` to `high`; without it, the range of the curves and marks.
    #[must_use]
    pub fn with_x_range(mut self, low: f64, high: f64) -> Self {
        self.x_range = Some([low, high]);
        self
    }

    /// Shows y from `low` to `high`; without it, the range of the curves and marks (bands are cut
    /// off).
    #[must_use]
    pub fn with_y_range(mut self, low: f64, high: f64) -> Self {
        self.y_range = Some([low, high]);
        self
    }

    /// Writes names at x = 1, 2, … instead of numbers.
    #[must_use]
    pub fn with_x_names(mut self, names: Vec<String>) -> Self {
        self.x_names = names;
        self
    }

    /// Spreads y by this scale.
    #[must_use]
    pub fn with_y_scale(mut self, scale: Scale) -> Self {
        self.y_scale = scale;
        self
    }
}

/// Panels in rows, with one legend for all.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    columns: usize,
    title: Option<String>,
    panels: Vec<Panel>,
    panel_size: [f64; 2],
    label: String,
    id: String,
}

impl Figure {
    /// An empty figure with that many panels in a row (at least one).
    pub fn new(columns: usize) -> Self {
        Self {
            columns: columns.max(1),
            title: None,
            panels: Vec::new(),
            panel_size: [300.0, 205.0],
            label: String::new(),
            id: String::new(),
        }
    }

    /// Sets a headline.
    #[must_use]
    pub fn with_title(mut self, title: impl Into<String>) -> Self {
        self.title = Some(title.into());
        self
    }

    /// Adds a panel.
    #[must_use]
    pub fn with_panel(mut self, panel: Panel) -> Self {
        self.panels.push(panel);
        self
    }

    /// Makes every panel this large, pixels, instead of 300 by 205.
    #[must_use]
    pub fn with_panel_size(mut self, width: f64, height: f64) -> Self {
        self.panel_size = [width, height];
        self
    }

    /// Says in words what the figure shows, for those who do not see it.
    #[must_use]
    pub fn with_label(mut self, label: impl Into<String>) -> Self {
        self.label = label.into();
        self
    }

    /// Sets what the identifiers inside begin with: two figures of one page need their own.
    #[must_use]
    pub fn with_id(mut self, id: impl Into<String>) -> Self {
        self.id = id.into();
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure() -> Figure {
        let line = |n: usize| (0..n).map(|i| [i as f64, (i as f64 * 0.1).sin()]).collect();
        let panel = Panel::new("a < b", "time, s", "angle, °")
            .with_curve(Curve::new("truth", Style::TRUTH, line(500)))
            .with_curve(Curve::new("estimate", Style::ESTIMATE, line(500)))
            .with_band(Band::new(
                "±3σ",
                Color::SkyBlue,
                (0..500).map(|i| [f64::from(i), -1e9, 1e9]).collect(),
            ));
        Figure::new(2)
            .with_title("R&D")
            .with_panel(panel.clone())
            .with_panel(panel)
    }

    #[test]
    fn labels_are_escaped_and_legend_entries_appear_once() {
        let svg = figure().to_svg();
        assert!(svg.contains("a &lt; b") && svg.contains("R&amp;D"));
        assert_eq!(svg.matches(">estimate<").count(), 1);
        assert_eq!(svg.matches("<g ").count(), svg.matches("</g>").count());
    }

    #[test]
    fn what_is_not_finite_interrupts_a_curve() {
        let points = vec![
            [0.0, 0.0],
            [1.0, 1.0],
            [2.0, f64::NAN],
            [3.0, 1.0],
            [4.0, 0.0],
        ];
        let panel = Panel::new("", "", "").with_curve(Curve::new("x", Style::TRUTH, points));
        let svg = Figure::new(1).with_panel(panel).to_svg();
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn nothing_at_all_can_be_drawn() {
        let svg = Figure::new(3).with_panel(Panel::new("", "", "")).to_svg();
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert!(Figure::new(0).to_svg().ends_with("</svg>\n"));
    }
}
