//! The SVG text that the plotting crate draws on.
//!
//! A backend of our own instead of the crate's: it writes tenths of a pixel, dash patterns, groups
//! with titles and clips, none of which `plotters-svg` can, and every colour as an attribute that
//! a style sheet may replace (dark mode).

use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::fmt::Write;
use std::rc::Rc;

use plotters::coord::Shift;
use plotters::prelude::{DrawingArea, IntoDrawingArea};
use plotters::style::FontTransform;
use plotters_backend::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind,
};

use super::Dash;

/// Units of the plotting crate per pixel: its coordinates are whole numbers.
pub(crate) const UNITS: f64 = 10.0;

type Written = Result<(), DrawingErrorKind<Infallible>>;

/// The pen that is shared between the canvas and whoever draws on it: markup that the plotting
/// crate does not know, and the pattern of the next lines.
#[derive(Clone, Default)]
pub(crate) struct Ink {
    text: Rc<RefCell<String>>,
    dash: Rc<Cell<Option<Dash>>>,
}

impl Ink {
    /// Adds markup as it is.
    pub fn raw(&self, markup: &str) {
        self.text.borrow_mut().push_str(markup);
    }

    /// Draws inside a group with a title, which browsers show on hover and readers speak.
    pub fn titled(&self, title: &str, draw: impl FnOnce()) {
        self.raw(&format!("<g><title>{}</title>", escaped(title)));
        draw();
        self.raw("</g>\n");
    }

    /// Sets the pattern of the lines that follow.
    pub fn set_dash(&self, dash: Dash) {
        self.dash.set(Some(dash));
    }
}

/// What is drawn on.
pub(crate) struct Canvas {
    size: (u32, u32),
    ink: Ink,
}

impl Canvas {
    /// A drawing area of so many pixels, and the pen for it.
    pub fn area(width: f64, height: f64) -> (DrawingArea<Self, Shift>, Ink) {
        let ink = Ink::default();
        let units = |v: f64| (v * UNITS).round() as u32;
        let canvas = Self {
            size: (units(width), units(height)),
            ink: ink.clone(),
        };
        (canvas.into_drawing_area(), ink)
    }

    fn element(&self, text: std::fmt::Arguments<'_>) -> Written {
        // Writing to a string cannot fail.
        let _ = self.ink.text.borrow_mut().write_fmt(text);
        Ok(())
    }

    fn dash(&self) -> &'static str {
        self.ink.dash.get().map_or("", Dash::array)
    }
}

/// A whole document: what was drawn, between its head and its end. The label is what a reader
/// who does not see the picture gets.
pub(crate) fn document(ink: &Ink, width: f64, height: f64, label: &str) -> String {
    let label = match label {
        "" => String::new(),
        label => format!(" role=\"img\" aria-label=\"{}\"", escaped(label)),
    };
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         width=\"{width}\" height=\"{height}\"{label} \
         font-family=\"Helvetica, Arial, sans-serif\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#FFFFFF\"/>\n{}</svg>\n",
        ink.text.borrow()
    )
}

/// Text with the characters that mean something in XML replaced.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// In pixels, to the tenth.
struct Px(i32);

impl std::fmt::Display for Px {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", f64::from(self.0) / UNITS)
    }
}

fn hex(color: BackendColor) -> String {
    let (r, g, b) = color.rgb;
    format!("#{r:02X}{g:02X}{b:02X}")
}

fn opacity(name: &str, color: BackendColor) -> String {
    match color.alpha {
        alpha if alpha < 1.0 => format!(" {name}-opacity=\"{alpha}\""),
        _ => String::new(),
    }
}

fn stroke(style: &impl BackendStyle, dash: &str) -> String {
    format!(
        " fill=\"none\" stroke=\"{}\"{} stroke-width=\"{}\"{dash}",
        hex(style.color()),
        opacity("stroke", style.color()),
        f64::from(style.stroke_width()) / UNITS
    )
}

fn filled(style: &impl BackendStyle) -> String {
    let color = style.color();
    format!(" fill=\"{}\"{}", hex(color), opacity("fill", color))
}

fn path(points: impl IntoIterator<Item = BackendCoord>) -> String {
    let mut data = String::new();
    for (i, (x, y)) in points.into_iter().enumerate() {
        let command = if i == 0 { 'M' } else { 'L' };
        // Writing to a string cannot fail.
        let _ = write!(data, "{command}{} {}", Px(x), Px(y));
    }
    data
}

impl DrawingBackend for Canvas {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        self.size
    }

    fn ensure_prepared(&mut self) -> Written {
        Ok(())
    }

    fn present(&mut self) -> Written {
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, color: BackendColor) -> Written {
        self.draw_rect((x, y), (x + 1, y + 1), &color, true)
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Written {
        self.draw_path([from, to], style)
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        (x0, y0): BackendCoord,
        (x1, y1): BackendCoord,
        style: &S,
        fill: bool,
    ) -> Written {
        if style.color().alpha == 0.0 {
            return Ok(());
        }
        let look = match fill {
            true => filled(style),
            false => stroke(style, ""),
        };
        self.element(format_args!(
            "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"{look}/>\n",
            Px(x0.min(x1)),
            Px(y0.min(y1)),
            Px((x1 - x0).abs()),
            Px((y1 - y0).abs())
        ))
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        points: I,
        style: &S,
    ) -> Written {
        if style.color().alpha == 0.0 {
            return Ok(());
        }
        self.element(format_args!(
            "<path d=\"{}\"{} stroke-linejoin=\"round\"/>\n",
            path(points),
            stroke(style, self.dash())
        ))
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        (x, y): BackendCoord,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Written {
        let look = match fill {
            true => filled(style),
            false => stroke(style, self.dash()),
        };
        self.element(format_args!(
            "<circle cx=\"{}\" cy=\"{}\" r=\"{}\"{look}/>\n",
            Px(x),
            Px(y),
            f64::from(radius) / UNITS
        ))
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        points: I,
        style: &S,
    ) -> Written {
        self.element(format_args!(
            "<path d=\"{}Z\"{}/>\n",
            path(points),
            filled(style)
        ))
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        at: BackendCoord,
    ) -> Written {
        let anchor = style.anchor();
        let horizontal = match anchor.h_pos {
            HPos::Left => "",
            HPos::Center => " text-anchor=\"middle\"",
            HPos::Right => " text-anchor=\"end\"",
        };
        // As wide as the letters are high: of the line, the letters take about three quarters.
        let down = match anchor.v_pos {
            VPos::Top => " dy=\"0.76em\"",
            VPos::Center => " dy=\"0.35em\"",
            VPos::Bottom => " dy=\"-0.24em\"",
        };
        let (x, y) = (Px(at.0), Px(at.1));
        let turn = match style.transform() {
            FontTransform::None => String::new(),
            FontTransform::Rotate90 => format!(" transform=\"rotate(90 {x} {y})\""),
            FontTransform::Rotate180 => format!(" transform=\"rotate(180 {x} {y})\""),
            FontTransform::Rotate270 => format!(" transform=\"rotate(270 {x} {y})\""),
        };
        let weight = match style.style() {
            plotters_backend::FontStyle::Bold => " font-weight=\"bold\"",
            _ => "",
        };
        self.element(format_args!(
            "<text x=\"{x}\" y=\"{y}\" font-size=\"{}\"{horizontal}{down}{turn}{weight}{}>{}</text>\n",
            style.size() / UNITS,
            filled(&style.color()),
            escaped(text)
        ))
    }

    fn estimate_text_size<S: BackendTextStyle>(
        &self,
        text: &str,
        style: &S,
    ) -> Result<(u32, u32), DrawingErrorKind<Infallible>> {
        // Letters of a sans-serif face are a little wider than half their size.
        let width = 0.55 * style.size() * text.chars().count() as f64;
        Ok((width as u32, style.size() as u32))
    }
}
