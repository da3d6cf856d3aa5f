//! Figures as SVG: panels with curves and bands over a common legend.
//!
//! Made for print and for everybody's eyes: dark lines on white, the colours of Okabe and Ito
//! (*Color Universal Design*, 2008), and a dash pattern for every colour, so that nothing depends
//! on telling colours apart. Lines are thinned to what a tenth of a pixel shows, which keeps a
//! picture of nine panels within some 50 kB.
//!
//! ```
//! use scheme_opt::report::figure::{Curve, Figure, Panel, Style};
//! let panel = Panel::new("Falling", "time, s", "height, m")
//!     .with_curve(Curve::new("truth", Style::TRUTH, vec![[0.0, 5.0], [0.5, 3.8], [1.0, 0.1]]));
//! let svg = Figure::new(1).with_panel(panel).to_svg();
//! assert!(svg.starts_with("<svg") && svg.contains("height, m"));
//! ```

mod axis;
mod thin;

use std::fmt::Write;

use axis::Axis;
use thin::thinned;

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
}

impl Color {
    const fn hex(self) -> &'static str {
        match self {
            Self::Black => "#000000",
            Self::Blue => "#0072B2",
            Self::Vermillion => "#D55E00",
            Self::Green => "#009E73",
            Self::Purple => "#CC79A7",
            Self::Orange => "#E69F00",
            Self::SkyBlue => "#56B4E9",
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

/// One diagram.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    title: String,
    x_label: String,
    y_label: String,
    curves: Vec<Curve>,
    bands: Vec<Band>,
    x_range: Option<[f64; 2]>,
    y_range: Option<[f64; 2]>,
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
            x_range: None,
            y_range: None,
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

    /// Shows x from `low` to `high`; without it, the range of the curves.
    #[must_use]
    pub fn with_x_range(mut self, low: f64, high: f64) -> Self {
        self.x_range = Some([low, high]);
        self
    }

    /// Shows y from `low` to `high`; without it, the range of the curves (bands are cut off).
    #[must_use]
    pub fn with_y_range(mut self, low: f64, high: f64) -> Self {
        self.y_range = Some([low, high]);
        self
    }

    fn axes(&self) -> (Axis, Axis) {
        let points = || self.curves.iter().flat_map(|c| &c.points);
        let x = match self.x_range {
            Some([low, high]) => Axis::tight([low, high].into_iter()),
            None => Axis::tight(points().map(|p| p[0])),
        };
        let y = match self.y_range {
            Some([low, high]) => Axis::tight([low, high].into_iter()),
            None => Axis::loose(points().map(|p| p[1])),
        };
        (x, y)
    }
}

/// Panels in rows, with one legend for all.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    columns: usize,
    title: Option<String>,
    panels: Vec<Panel>,
}

/// Sizes, pixels.
const CELL: [f64; 2] = [300.0, 205.0];
const LEFT: f64 = 62.0;
const RIGHT: f64 = 18.0;
const TOP: f64 = 26.0;
const BOTTOM: f64 = 38.0;
const TITLE: f64 = 26.0;
const LEGEND: f64 = 26.0;
const FONT: f64 = 11.0;

impl Figure {
    /// An empty figure with that many panels in a row (at least one).
    pub fn new(columns: usize) -> Self {
        Self {
            columns: columns.max(1),
            title: None,
            panels: Vec::new(),
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

    /// The figure as an SVG document.
    pub fn to_svg(&self) -> String {
        let columns = self.columns.min(self.panels.len().max(1));
        let rows = self.panels.len().div_ceil(columns);
        let head = LEGEND + self.title.as_ref().map_or(0.0, |_| TITLE);
        let width = CELL[0] * columns as f64;
        let height = head + CELL[1] * rows as f64;
        let mut svg = Svg(String::new());
        svg.line(format_args!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
             width=\"{width}\" height=\"{height}\" font-family=\"Helvetica, Arial, sans-serif\" \
             font-size=\"{FONT}\">"
        ));
        svg.line(format_args!(
            "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>"
        ));
        if let Some(title) = &self.title {
            svg.line(format_args!(
                "<text x=\"{}\" y=\"18\" text-anchor=\"middle\" font-size=\"14\">{}</text>",
                0.5 * width,
                escaped(title)
            ));
        }
        self.legend(&mut svg, head - LEGEND, width);
        for (i, panel) in self.panels.iter().enumerate() {
            let x = CELL[0] * (i % columns) as f64;
            let y = head + CELL[1] * (i / columns) as f64;
            svg.line(format_args!("<g transform=\"translate({x} {y})\">"));
            draw_panel(&mut svg, panel, i);
            svg.line(format_args!("</g>"));
        }
        svg.line(format_args!("</svg>"));
        svg.0
    }

    /// Every label once, in the order of appearance.
    fn legend(&self, svg: &mut Svg, y: f64, width: f64) {
        let mut entries: Vec<(&str, Sample)> = Vec::new();
        for panel in &self.panels {
            let curves = panel
                .curves
                .iter()
                .map(|c| (c.label.as_str(), Sample::Line(c.style)));
            let bands = panel
                .bands
                .iter()
                .map(|b| (b.label.as_str(), Sample::Area(b.color)));
            for (label, sample) in curves.chain(bands) {
                if !entries.iter().any(|(known, _)| *known == label) {
                    entries.push((label, sample));
                }
            }
        }
        // About 6 px a character at this size, 34 px of sample, 20 px of space.
        let length = |label: &str| 54.0 + 6.0 * label.chars().count() as f64;
        let total: f64 = entries.iter().map(|(label, _)| length(label)).sum();
        let mut x = 0.5 * (width - total).max(0.0) + 10.0;
        let middle = y + 0.5 * LEGEND;
        for (label, sample) in entries {
            sample.draw(svg, x, middle);
            svg.line(format_args!(
                "<text x=\"{}\" y=\"{}\">{}</text>",
                x + 34.0,
                middle + 4.0,
                escaped(label)
            ));
            x += length(label);
        }
    }
}

/// What stands before a label of the legend.
#[derive(Clone, Copy)]
enum Sample {
    Line(Style),
    Area(Color),
}

impl Sample {
    fn draw(self, svg: &mut Svg, x: f64, y: f64) {
        match self {
            Self::Line(style) => {
                svg.line(format_args!("<path d=\"M{x} {y}h28\"{}/>", stroke(&style)))
            }
            Self::Area(color) => svg.line(format_args!(
                "<rect x=\"{x}\" y=\"{}\" width=\"28\" height=\"10\" fill=\"{}\" \
                 fill-opacity=\"0.25\"/>",
                y - 5.0,
                color.hex()
            )),
        }
    }
}

fn stroke(style: &Style) -> String {
    format!(
        " fill=\"none\" stroke=\"{}\" stroke-width=\"{}\" stroke-linejoin=\"round\"{}",
        style.color.hex(),
        style.width,
        style.dash.array()
    )
}

/// The text of the document.
struct Svg(String);

impl Svg {
    fn line(&mut self, text: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = self.0.write_fmt(text);
        self.0.push('\n');
    }
}

fn draw_panel(svg: &mut Svg, panel: &Panel, index: usize) {
    let (width, height) = (CELL[0] - LEFT - RIGHT, CELL[1] - TOP - BOTTOM);
    let (x_axis, y_axis) = panel.axes();
    let x = |v: f64| LEFT + width * x_axis.fraction(v);
    let y = |v: f64| TOP + height * (1.0 - y_axis.fraction(v));
    draw_grid(svg, &x_axis, &y_axis);
    svg.line(format_args!(
        "<clipPath id=\"c{index}\"><rect x=\"{LEFT}\" y=\"{TOP}\" width=\"{width}\" \
         height=\"{height}\"/></clipPath><g clip-path=\"url(#c{index})\">"
    ));
    // Far outside the frame nothing can be seen, and huge coordinates confuse viewers.
    let clipped = |v: f64| y(v).clamp(TOP - height, TOP + 2.0 * height);
    for band in &panel.bands {
        let finite = || {
            band.points
                .iter()
                .filter(|p| p.iter().all(|v| v.is_finite()))
        };
        let low: Vec<[f64; 2]> = finite().map(|p| [x(p[0]), clipped(p[1])]).collect();
        let high: Vec<[f64; 2]> = finite().map(|p| [x(p[0]), clipped(p[2])]).collect();
        let mut outline = thinned(&low);
        outline.extend(thinned(&high).into_iter().rev());
        svg.line(format_args!(
            "<path d=\"{}Z\" fill=\"{}\" fill-opacity=\"0.25\"/>",
            path(&outline),
            band.color.hex()
        ));
    }
    for curve in &panel.curves {
        let pieces = curve.points.split(|p| p.iter().any(|v| !v.is_finite()));
        let data: String = pieces
            .map(|piece| {
                let line: Vec<[f64; 2]> = piece.iter().map(|p| [x(p[0]), clipped(p[1])]).collect();
                path(&thinned(&line))
            })
            .collect();
        svg.line(format_args!("<path d=\"{data}\"{}/>", stroke(&curve.style)));
    }
    svg.line(format_args!("</g>"));
    svg.line(format_args!(
        "<rect x=\"{LEFT}\" y=\"{TOP}\" width=\"{width}\" height=\"{height}\" fill=\"none\" \
         stroke=\"#333\"/>"
    ));
    draw_labels(svg, panel);
}

fn draw_grid(svg: &mut Svg, x_axis: &Axis, y_axis: &Axis) {
    let (width, height) = (CELL[0] - LEFT - RIGHT, CELL[1] - TOP - BOTTOM);
    let bottom = TOP + height;
    for (value, text) in x_axis.ticks() {
        let x = LEFT + width * x_axis.fraction(value);
        svg.line(format_args!(
            "<path d=\"M{x:.1} {TOP}v{height}\" stroke=\"#ddd\"/>\
             <text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{text}</text>",
            bottom + 14.0
        ));
    }
    for (value, text) in y_axis.ticks() {
        let y = TOP + height * (1.0 - y_axis.fraction(value));
        svg.line(format_args!(
            "<path d=\"M{LEFT} {y:.1}h{width}\" stroke=\"#ddd\"/>\
             <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{text}</text>",
            LEFT - 5.0,
            y + 4.0
        ));
    }
}

fn draw_labels(svg: &mut Svg, panel: &Panel) {
    let middle = LEFT + 0.5 * (CELL[0] - LEFT - RIGHT);
    let centre = TOP + 0.5 * (CELL[1] - TOP - BOTTOM);
    svg.line(format_args!(
        "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\" font-weight=\"bold\">{}</text>",
        TOP - 8.0,
        escaped(&panel.title)
    ));
    svg.line(format_args!(
        "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
        CELL[1] - 8.0,
        escaped(&panel.x_label)
    ));
    svg.line(format_args!(
        "<text transform=\"translate(12 {centre}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
        escaped(&panel.y_label)
    ));
}

/// `M x y L x y …`, to the tenth of a pixel.
fn path(points: &[[f64; 2]]) -> String {
    let mut data = String::new();
    for (i, [x, y]) in points.iter().enumerate() {
        let command = if i == 0 { 'M' } else { 'L' };
        // Writing to a string cannot fail.
        let _ = write!(data, "{command}{x:.1} {y:.1}");
    }
    data
}

/// Text with the characters that mean something in XML replaced.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
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
