//! Drawing a [`Figure`] with the plotting crate.

use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::Shift;
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::ranged1d::{Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::element::{Circle, PathElement, Polygon, Rectangle, Text};
use plotters::prelude::IntoLogRange;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{
    BLACK, Color as _, FontStyle, FontTransform, IntoFont, RGBColor, ShapeStyle, TextStyle,
};

use super::canvas::{Canvas, Ink, UNITS, document};
use super::thin::needed;
use super::{Band, Color, Curve, Dash, Figure, Mark, Panel, Scale, Shape, Style};

/// Sizes, pixels.
const LEFT: f64 = 62.0;
const RIGHT: f64 = 18.0;
const TOP: f64 = 26.0;
const BOTTOM: f64 = 38.0;
const TITLE: f64 = 26.0;
const LEGEND: f64 = 22.0;
const FONT: f64 = 11.0;
/// About how many ticks an axis has.
const TICKS: usize = 5;
const GRID: RGBColor = RGBColor(0xDD, 0xDD, 0xDD);
const FRAME: RGBColor = RGBColor(0x33, 0x33, 0x33);

/// What is drawn on.
pub(crate) type Area = DrawingArea<Canvas, Shift>;
type Chart<'a, Y> = ChartContext<'a, Canvas, Cartesian2d<RangedCoordf64, Y>>;
/// That something has been drawn.
pub(crate) type Drawn = Result<(), DrawingAreaErrorKind<std::convert::Infallible>>;

/// Units of the plotting crate.
pub(crate) fn units(px: f64) -> i32 {
    (px * UNITS).round() as i32
}

/// A text style of so many pixels.
pub(crate) fn text(size: f64, pos: Pos) -> TextStyle<'static> {
    let font = ("sans-serif", size * UNITS).into_font();
    TextStyle::from(font).pos(pos).color(&BLACK)
}

/// A line of so many pixels.
pub(crate) fn line(color: RGBColor, width: f64) -> ShapeStyle {
    ShapeStyle::from(&color).stroke_width((width * UNITS).round() as u32)
}

impl Figure {
    /// The figure as an SVG document.
    pub fn to_svg(&self) -> String {
        let [width, height] = self.panel_size;
        let columns = self.columns.min(self.panels.len().max(1));
        let rows = self.panels.len().div_ceil(columns);
        let title = self.title.as_ref().map_or(0.0, |_| TITLE);
        let full_width = width * columns as f64;
        let legend = Legend::new(self, full_width);
        let head = title + legend.height();
        let full_height = head + height * rows as f64;
        let (area, ink) = Canvas::area(full_width, full_height);
        let drawn = || -> Drawn {
            if let Some(title) = &self.title {
                let style = text(14.0, Pos::new(HPos::Center, VPos::Center));
                let at = (units(0.5 * full_width), units(0.5 * TITLE));
                area.draw(&Text::new(title.as_str(), at, style))?;
            }
            legend.draw(&area, &ink, title)?;
            for (i, panel) in self.panels.iter().enumerate() {
                let x = width * (i % columns) as f64;
                let y = head + height * (i / columns) as f64;
                let cell = area.clone().shrink(
                    (units(x), units(y)),
                    (units(width) as u32, units(height) as u32),
                );
                draw_panel(&cell, &ink, panel, &format!("{}c{i}", self.id))?;
            }
            Ok(())
        };
        let drawn = drawn();
        // Text cannot refuse to be written, and the layout is our own.
        debug_assert!(drawn.is_ok(), "{drawn:?}");
        document(&ink, full_width, full_height, &self.label)
    }
}

/// Every label once, in the order of appearance, in as many lines as it takes.
struct Legend<'a> {
    entries: Vec<(&'a str, LegendSample, [f64; 2])>,
    lines: usize,
}

/// What stands before a label of the legend.
#[derive(Clone, Copy)]
enum LegendSample {
    Line(Style),
    Area(Color),
}

impl<'a> Legend<'a> {
    fn new(figure: &'a Figure, width: f64) -> Self {
        let mut all: Vec<(&str, LegendSample)> = Vec::new();
        for panel in &figure.panels {
            let curves = panel.curves.iter();
            let curves = curves.map(|c| (c.label.as_str(), LegendSample::Line(c.style)));
            let bands = panel.bands.iter();
            let bands = bands.map(|b| (b.label.as_str(), LegendSample::Area(b.color)));
            for (label, sample) in curves.chain(bands) {
                if !label.is_empty() && !all.iter().any(|(known, _)| *known == label) {
                    all.push((label, sample));
                }
            }
        }
        // About 6 px a character at this size, 34 px of sample, 16 px of space.
        let length = |label: &str| 50.0 + 6.0 * label.chars().count() as f64;
        let mut lines: Vec<Vec<(&str, LegendSample)>> = Vec::new();
        let mut room = 0.0;
        for (label, sample) in all {
            if length(label) > room {
                lines.push(Vec::new());
                room = width - 10.0;
            }
            room -= length(label);
            if let Some(line) = lines.last_mut() {
                line.push((label, sample));
            }
        }
        let mut entries = Vec::new();
        for (i, line) in lines.iter().enumerate() {
            let total: f64 = line.iter().map(|(label, _)| length(label)).sum();
            let mut x = 0.5 * (width - total).max(0.0) + 8.0;
            for (label, sample) in line {
                entries.push((*label, *sample, [x, LEGEND * (i as f64 + 0.5)]));
                x += length(label);
            }
        }
        let lines = lines.len();
        Self { entries, lines }
    }

    fn height(&self) -> f64 {
        LEGEND * self.lines as f64
    }

    fn draw(&self, area: &Area, ink: &Ink, top: f64) -> Drawn {
        for (label, sample, [x, y]) in &self.entries {
            let y = top + y;
            let (from, to) = ((units(*x), units(y)), (units(x + 28.0), units(y)));
            match sample {
                LegendSample::Line(style) => {
                    ink.set_dash(style.dash);
                    let style = line(style.color.rgb(), style.width);
                    area.draw(&PathElement::new(vec![from, to], style))?;
                    ink.set_dash(Dash::Solid);
                }
                LegendSample::Area(color) => {
                    let corners = [(from.0, units(y - 5.0)), (to.0, units(y + 5.0))];
                    area.draw(&Rectangle::new(corners, color.rgb().mix(0.25).filled()))?;
                }
            }
            let style = text(FONT, Pos::new(HPos::Left, VPos::Center));
            area.draw(&Text::new(*label, (units(x + 34.0), units(y)), style))?;
        }
        Ok(())
    }
}

fn draw_panel(cell: &Area, ink: &Ink, panel: &Panel, clip: &str) -> Drawn {
    let ([x0, x1], [y0, y1]) = panel.ranges();
    let mut builder = ChartBuilder::on(cell);
    builder
        .margin_top(units(TOP))
        .margin_right(units(RIGHT))
        .x_label_area_size(units(BOTTOM))
        .y_label_area_size(units(LEFT));
    let middle = 0.5 * (LEFT + f64::from(cell.dim_in_pixel().0) / UNITS - RIGHT);
    let mut title = text(FONT, Pos::new(HPos::Center, VPos::Bottom));
    title.font = title.font.style(FontStyle::Bold);
    let at = (units(middle), units(TOP - 8.0));
    cell.draw(&Text::new(panel.title.as_str(), at, title))?;
    match panel.y_scale {
        Scale::Linear => {
            let chart = builder.build_cartesian_2d(x0..x1, y0..y1)?;
            draw_chart(chart, ink, panel, clip)?;
        }
        Scale::Log => {
            let chart = builder.build_cartesian_2d(x0..x1, (y0..y1).log_scale())?;
            draw_chart(chart, ink, panel, clip)?;
        }
    }
    draw_y_label(cell, panel)
}

fn draw_chart<Y>(mut chart: Chart<'_, Y>, ink: &Ink, panel: &Panel, clip: &str) -> Drawn
where
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let ([x0, x1], [y0, y1]) = panel.ranges();
    let centred = Pos::new(HPos::Center, VPos::Center);
    let x_tick = |v: &f64| match panel.x_names.is_empty() {
        true => tick(*v, x1 - x0),
        false => panel.name_at(*v).to_owned(),
    };
    let y_tick = |v: &f64| match panel.y_scale {
        Scale::Linear => tick(*v, y1 - y0),
        Scale::Log => tick(*v, 10.0 * v),
    };
    chart
        .configure_mesh()
        .bold_line_style(line(GRID, 1.0))
        .light_line_style(GRID.mix(0.0))
        .axis_style(line(FRAME, 1.0))
        .label_style(text(FONT, centred))
        .axis_desc_style(text(FONT, centred))
        .set_all_tick_mark_size(units(5.0))
        .x_labels(TICKS.max(panel.x_names.len() + 2))
        .y_labels(TICKS)
        .x_label_formatter(&x_tick)
        .y_label_formatter(&y_tick)
        .x_desc(panel.x_label.as_str())
        .draw()?;
    let (x, y) = chart.plotting_area().get_pixel_range();
    let root = chart.plotting_area().strip_coord_spec();
    let [width, height] = [x.end - x.start, y.end - y.start].map(|u| f64::from(u) / UNITS);
    let [left, top] = [x.start, y.start].map(|u| f64::from(u) / UNITS);
    ink.raw(&format!(
        "<clipPath id=\"{clip}\"><rect x=\"{left}\" y=\"{top}\" width=\"{width}\" \
         height=\"{height}\"/></clipPath><g clip-path=\"url(#{clip})\">\n"
    ));
    draw_spans(&chart, ink, panel)?;
    for band in &panel.bands {
        draw_band(&chart, panel, band)?;
    }
    for curve in &panel.curves {
        ink.set_dash(curve.style.dash);
        draw_curve(&chart, panel, curve)?;
    }
    ink.set_dash(Dash::Solid);
    for mark in panel.marks.iter().filter(|m| panel.shows(m.at[1])) {
        let mut drawn = Ok(());
        ink.titled(&mark.title, || drawn = draw_mark(&chart, mark));
        drawn?;
    }
    ink.raw("</g>\n");
    root.draw(&Rectangle::new(
        [(0, 0), (x.end - x.start, y.end - y.start)],
        line(FRAME, 1.0),
    ))
}

/// The spans with their titles and texts.
fn draw_spans<Y: Ranged<ValueType = f64>>(chart: &Chart<'_, Y>, ink: &Ink, panel: &Panel) -> Drawn {
    let ([x0, x1], [y0, y1]) = panel.ranges();
    let left = chart.plotting_area().get_pixel_range().0.start;
    let root = chart.plotting_area().strip_coord_spec();
    let centred = Pos::new(HPos::Center, VPos::Center);
    for span in &panel.spans {
        let low = span.range[0].clamp(x0, x1);
        let high = span.range[1].clamp(x0, x1);
        let color = span.color.map_or(BLACK.mix(0.001), |c| c.rgb().mix(0.18));
        let shape = Rectangle::new([(low, y0), (high, y1)], color.filled());
        let mut drawn = Ok(());
        ink.titled(&span.title, || {
            drawn = chart.plotting_area().draw(&shape);
        });
        drawn?;
        if !span.text.is_empty() {
            let (x, _) = chart.backend_coord(&(0.5 * (low + high), y0));
            let at = (x - left, units(9.0));
            root.draw(&Text::new(span.text.as_str(), at, text(FONT, centred)))?;
        }
    }
    Ok(())
}

/// The label of the y axis, upwards at the left edge: the plotting crate would put it on top of
/// long tick labels.
fn draw_y_label(cell: &Area, panel: &Panel) -> Drawn {
    let mut style = text(FONT, Pos::new(HPos::Center, VPos::Center));
    style.font = style.font.transform(FontTransform::Rotate270);
    let height = f64::from(cell.dim_in_pixel().1) / UNITS;
    let at = (units(9.0), units(0.5 * (TOP + height - BOTTOM)));
    cell.draw(&Text::new(panel.y_label.as_str(), at, style))
}

fn draw_band<Y: Ranged<ValueType = f64>>(
    chart: &Chart<'_, Y>,
    panel: &Panel,
    band: &Band,
) -> Drawn {
    let near = panel.nearby();
    let finite = || {
        let points = band.points.iter();
        points.filter(|p| p.iter().all(|v| v.is_finite()))
    };
    let low: Vec<(f64, f64)> = finite().map(|p| (p[0], near(p[1]))).collect();
    let high: Vec<(f64, f64)> = finite().map(|p| (p[0], near(p[2]))).collect();
    let mut outline = thinned(chart, &low);
    outline.extend(thinned(chart, &high).into_iter().rev());
    if outline.is_empty() {
        return Ok(());
    }
    let style = band.color.rgb().mix(0.25).filled();
    chart.plotting_area().draw(&Polygon::new(outline, style))
}

fn draw_curve<Y: Ranged<ValueType = f64>>(
    chart: &Chart<'_, Y>,
    panel: &Panel,
    curve: &Curve,
) -> Drawn {
    let near = panel.nearby();
    let drawable = |p: &[f64; 2]| p[0].is_finite() && panel.shows(p[1]);
    for piece in curve.points.split(|p| !drawable(p)) {
        if piece.is_empty() {
            continue;
        }
        let piece: Vec<(f64, f64)> = piece.iter().map(|p| (p[0], near(p[1]))).collect();
        let style = line(curve.style.color.rgb(), curve.style.width);
        let path = PathElement::new(thinned(chart, &piece), style);
        chart.plotting_area().draw(&path)?;
    }
    Ok(())
}

fn draw_mark<Y: Ranged<ValueType = f64>>(chart: &Chart<'_, Y>, mark: &Mark) -> Drawn {
    let (x, y) = chart.backend_coord(&(mark.at[0], mark.at[1]));
    let (left, top) = chart.plotting_area().get_pixel_range();
    let plot = chart.plotting_area().strip_coord_spec();
    shape(
        &plot,
        (x - left.start, y - top.start),
        mark.shape,
        mark.color,
        3.5,
    )
}

/// A mark of so many pixels' radius at a place in units.
pub(crate) fn shape(area: &Area, at: (i32, i32), shape: Shape, color: Color, px: f64) -> Drawn {
    let r = units(px);
    let (x, y) = at;
    match shape {
        Shape::Dot => area.draw(&Circle::new(at, r, color.rgb().filled())),
        Shape::Diamond => {
            let r = units(1.3 * px);
            let corners = vec![(x - r, y), (x, y - r), (x + r, y), (x, y + r)];
            area.draw(&Polygon::new(corners, color.rgb().filled()))
        }
        Shape::Cross => {
            let style = line(color.rgb(), 1.8);
            area.draw(&PathElement::new(
                vec![(x - r, y - r), (x + r, y + r)],
                style,
            ))?;
            area.draw(&PathElement::new(
                vec![(x - r, y + r), (x + r, y - r)],
                style,
            ))
        }
    }
}

/// The points that make a difference of a tenth of a pixel.
fn thinned<Y: Ranged<ValueType = f64>>(
    chart: &Chart<'_, Y>,
    points: &[(f64, f64)],
) -> Vec<(f64, f64)> {
    let pixels: Vec<[f64; 2]> = points
        .iter()
        .map(|p| chart.backend_coord(p))
        .map(|(x, y)| [f64::from(x) / UNITS, f64::from(y) / UNITS])
        .collect();
    let kept = points.iter().zip(needed(&pixels));
    kept.filter(|(_, keep)| *keep).map(|(p, _)| *p).collect()
}

impl Panel {
    /// What the axes show, (x, y).
    fn ranges(&self) -> ([f64; 2], [f64; 2]) {
        let curves = || self.curves.iter().flat_map(|c| &c.points);
        let points = || curves().chain(self.marks.iter().map(|m| &m.at));
        let x = self
            .x_range
            .unwrap_or_else(|| extent(points().map(|p| p[0])));
        let shown = points().map(|p| p[1]).filter(|y| self.shows(*y));
        let y = match (self.y_range, self.y_scale) {
            (Some(range), _) => range,
            (None, Scale::Linear) => loose(extent(shown)),
            (None, Scale::Log) => {
                loose(extent(shown.map(libm::log10))).map(|v| libm::pow(10.0_f64, v))
            }
        };
        (wide(x), wide(y))
    }

    /// The name that stands at this place of the x axis, if one does.
    fn name_at(&self, x: f64) -> &str {
        let place = x.round();
        let named = (x - place).abs() < 1e-6 && place >= 1.0;
        let name = named
            .then(|| self.x_names.get(place as usize - 1))
            .flatten();
        name.map_or("", String::as_str)
    }

    /// Whether a value has a place on the y axis.
    fn shows(&self, y: f64) -> bool {
        y.is_finite() && (self.y_scale == Scale::Linear || y > 0.0)
    }

    /// Brings a value close to the frame: far outside nothing can be seen, and huge coordinates
    /// confuse viewers.
    fn nearby(&self) -> impl Fn(f64) -> f64 {
        let (_, [low, high]) = self.ranges();
        let [from, to] = match self.y_scale {
            Scale::Linear => [low - (high - low), high + (high - low)],
            Scale::Log => [low * low / high, high * high / low],
        };
        move |y| y.clamp(from, to)
    }
}

/// From the smallest of `values` to the largest.
fn extent(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let none = [f64::INFINITY, f64::NEG_INFINITY];
    let found = values
        .filter(|v| v.is_finite())
        .fold(none, |[low, high], v| [low.min(v), high.max(v)]);
    if found[0] > found[1] {
        [0.0, 1.0]
    } else {
        found
    }
}

/// The same with some space on either side.
fn loose([low, high]: [f64; 2]) -> [f64; 2] {
    let space = 0.06 * (high - low);
    [low - space, high + space]
}

/// A constant, up to rounding, still needs some height.
fn wide([low, high]: [f64; 2]) -> [f64; 2] {
    if high - low > 1e-9 * low.abs().max(high.abs()) {
        return [low, high];
    }
    let half = 0.05 * low.abs().max(f64::MIN_POSITIVE.sqrt());
    [low - half, high + half]
}

/// The text of a tick on an axis of that length: as many decimals as neighbours differ in.
fn tick(value: f64, length: f64) -> String {
    let decimals =
        (2.0 - libm::log10(length.abs() / TICKS as f64).ceil()).clamp(0.0, 12.0) as usize;
    let value = if value.abs() < 1e-9 * length.abs() {
        0.0
    } else {
        value
    };
    let text = if value != 0.0 && !(1e-4..1e6).contains(&value.abs()) {
        format!("{value:.1e}")
    } else {
        format!("{value:.decimals$}")
    };
    let text = match text.contains('.') && !text.contains('e') {
        true => text.trim_end_matches('0').trim_end_matches('.'),
        false => &text,
    };
    // A proper minus sign.
    text.replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_have_the_digits_they_need() {
        for (value, length, text) in [
            (500.0, 2000.0, "500"),
            (-0.0002, 0.0007, "−0.0002"),
            (0.25, 1.0, "0.25"),
            (0.001, 0.01, "0.001"),
            (1e-19, 1.0, "0"),
            (3e-5, 3e-4, "3.0e−5"),
        ] {
            assert_eq!(tick(value, length), text);
        }
    }

    #[test]
    fn a_constant_has_a_range_around_it() {
        for v in [0.0, 5.0, -1e-9] {
            let [low, high] = wide(loose(extent([v, v].into_iter())));
            assert!(low < v && v < high);
        }
    }
}
