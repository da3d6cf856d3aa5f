//! Pictures without axes: gravity on the sphere, correlations as a map of colours.

use plotters::element::{Circle, PathElement, Rectangle, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color as _, RGBColor};

use crate::attitude::Stand;
use crate::drift::{COEFFICIENTS, CoefficientMatrix, DriftCoefficient};
use crate::motion::Move;
use crate::report::figure::canvas::{Canvas, Ink, document};
use crate::report::figure::draw::{Area, Drawn, line, shape, text, units};
use crate::report::figure::{Color, Dash, Shape};

use super::pictures::gravity;
use super::subject::{Sense, Subject};

const GRID: RGBColor = RGBColor(0xDD, 0xDD, 0xDD);
const FRAME: RGBColor = RGBColor(0x33, 0x33, 0x33);
const MIDDLE: Pos = Pos {
    h_pos: HPos::Center,
    v_pos: VPos::Center,
};

/// Size of one half of the sphere with its labels, and its radius, pixels.
const SIZE: f64 = 380.0;
const RADIUS: f64 = 158.0;

/// One half of the sphere, seen from outside along the platform's z axis.
#[derive(Clone, Copy)]
struct Half {
    /// +1: gravity towards +z, −1: towards −z.
    side: f64,
}

impl Half {
    /// Lambert's azimuthal projection: equal areas of the sphere are equal areas of the map, so
    /// that how evenly the directions are spread can be seen. None: on the other half.
    fn project(self, [x, y, z]: [f64; 3]) -> Option<(i32, i32)> {
        let depth = self.side * z;
        if depth < -1e-9 {
            return None;
        }
        let across = libm::hypot(x, y);
        let radius = RADIUS * (1.0 - depth).max(0.0).sqrt();
        let unit = match across > 1e-12 {
            true => [x / across, y / across],
            false => [0.0, 0.0],
        };
        // Seen from outside, x points right on the one half and left on the other.
        let px = 0.5 * SIZE + radius * self.side * unit[0];
        let py = 0.5 * SIZE - radius * unit[1];
        Some((units(px), units(py)))
    }
}

/// The direction of gravity in the platform at every position, on both halves of the sphere.
pub(super) fn sphere(subject: &Subject) -> [(String, String); 2] {
    [(1.0, "+z"), (-1.0, "−z")].map(|(side, name)| {
        let (area, ink) = Canvas::area(SIZE, SIZE);
        let half = Half { side };
        let drawn = draw_half(&area, &ink, half, subject);
        // Text cannot refuse to be written, and the layout is our own.
        debug_assert!(drawn.is_ok(), "{drawn:?}");
        let label = format!(
            "Directions of gravity in the platform on the half of the sphere around {name}; the \
             table of positions has the numbers"
        );
        (
            format!("Half around {name} of the platform"),
            document(&ink, SIZE, SIZE, &label),
        )
    })
}

fn draw_half(area: &Area, ink: &Ink, half: Half, subject: &Subject) -> Drawn {
    let centre = (units(0.5 * SIZE), units(0.5 * SIZE));
    let circle = |r: f64, color| Circle::new(centre, units(r), line(color, 1.0));
    // 30° and 60° from the middle.
    for deg in [30.0_f64, 60.0] {
        let r = RADIUS * (1.0 - libm::cos(deg.to_radians())).sqrt();
        area.draw(&circle(r, GRID))?;
    }
    for axis in [[1.0, 0.0], [0.0, 1.0]] {
        let [dx, dy] = axis.map(|v| units(RADIUS * v));
        let ends = vec![
            (centre.0 - dx, centre.1 - dy),
            (centre.0 + dx, centre.1 + dy),
        ];
        area.draw(&PathElement::new(ends, line(GRID, 1.0)))?;
    }
    area.draw(&circle(RADIUS, FRAME))?;
    draw_axes(area, half)?;
    let stand = subject.study.test().platform().stand();
    for leg in subject.timeline.legs() {
        if let Some(m) = leg.arrival.filter(|m| m.measured && m.duration_s > 0.0) {
            draw_turn(area, ink, half, (stand, &m))?;
        }
    }
    let mut taken: Vec<(i32, i32)> = Vec::new();
    for (i, leg) in subject.timeline.position_legs().iter().enumerate() {
        let g = gravity(&leg.attitude);
        let Some(at) = half.project(g) else { continue };
        let sense = Sense::of(g);
        let title = format!(
            "Position {}: gravity ({:.3}, {:.3}, {:.3}) g, {}",
            i + 1,
            g[0] + 0.0,
            g[1] + 0.0,
            g[2] + 0.0,
            sense.name()
        );
        let mut drawn = Ok(());
        let (kind, color) = look(sense);
        ink.titled(&title, || drawn = shape(area, at, kind, color, 4.5));
        drawn?;
        draw_number(area, i + 1, at, &mut taken)?;
    }
    Ok(())
}

/// How a position is shown.
pub(super) const fn look(sense: Sense) -> (Shape, Color) {
    match sense {
        Sense::Axis => (Shape::Dot, Color::Blue),
        Sense::Plane => (Shape::Diamond, Color::Green),
        Sense::Space => (Shape::Cross, Color::Vermillion),
    }
}

/// The number of a position beside its mark, where no other number is.
fn draw_number(area: &Area, number: usize, at: (i32, i32), taken: &mut Vec<(i32, i32)>) -> Drawn {
    let places = [
        [10.0, -8.0],
        [-10.0, -8.0],
        [10.0, 10.0],
        [-10.0, 10.0],
        [0.0, -16.0],
    ];
    let free = |p: &(i32, i32)| {
        let near =
            |t: &&(i32, i32)| (t.0 - p.0).abs() < units(15.0) && (t.1 - p.1).abs() < units(11.0);
        !taken.iter().any(|t| near(&t))
    };
    let places = places.map(|[dx, dy]| (at.0 + units(dx), at.1 + units(dy)));
    let place = places.into_iter().find(|p| free(p)).unwrap_or(places[0]);
    taken.push(place);
    area.draw(&Text::new(number.to_string(), place, text(11.0, MIDDLE)))
}

/// Names of the platform's axes: on the rim, and in the middle.
fn draw_axes(area: &Area, half: Half) -> Drawn {
    let out = RADIUS + 14.0;
    let [right, left] = match half.side > 0.0 {
        true => ["+x", "−x"],
        false => ["−x", "+x"],
    };
    let middle = if half.side > 0.0 { "+z" } else { "−z" };
    for (name, dx, dy) in [
        (right, out, 0.0),
        (left, -out, 0.0),
        ("+y", 0.0, -out),
        ("−y", 0.0, out),
        (middle, 13.0, 9.0),
    ] {
        let at = (units(0.5 * SIZE + dx), units(0.5 * SIZE + dy));
        area.draw(&Text::new(name, at, text(12.0, MIDDLE)))?;
    }
    Ok(())
}

/// The way of gravity through a measured move.
fn draw_turn(area: &Area, ink: &Ink, half: Half, (stand, m): (&Stand, &Move)) -> Drawn {
    const STEPS: usize = 60;
    let attitude = |k: usize| stand.attitude(m.position_at(k as f64 / STEPS as f64));
    let points: Vec<Option<(i32, i32)>> = (0..=STEPS)
        .map(|k| half.project(gravity(&attitude(k))))
        .collect();
    ink.set_dash(Dash::Dotted);
    for piece in points.split(Option::is_none) {
        let piece: Vec<(i32, i32)> = piece.iter().copied().flatten().collect();
        if piece.len() > 1 {
            area.draw(&PathElement::new(piece, line(Color::Black.rgb(), 1.2)))?;
        }
    }
    ink.set_dash(Dash::Solid);
    Ok(())
}

/// Side of a cell of the map of correlations, and room for the names, pixels.
const CELL: f64 = 42.0;
const NAMES: f64 = 48.0;

/// Correlations of the estimates: blue for negative, vermillion for positive, with the numbers.
pub(super) fn correlations(correlations: &CoefficientMatrix) -> String {
    let size = NAMES + CELL * COEFFICIENTS as f64 + 2.0;
    let (area, ink) = Canvas::area(size, size);
    let drawn = draw_correlations(&area, &ink, correlations);
    // Text cannot refuse to be written, and the layout is our own.
    debug_assert!(drawn.is_ok(), "{drawn:?}");
    let label = "Correlations of the estimates at the end of the test, coefficient against \
                 coefficient; the strongest are listed below";
    document(&ink, size, size, label)
}

fn draw_correlations(area: &Area, ink: &Ink, correlations: &CoefficientMatrix) -> Drawn {
    let at = |i: usize| NAMES + CELL * i as f64;
    for (i, a) in DriftCoefficient::ALL.into_iter().enumerate() {
        let middle = at(i) + 0.5 * CELL;
        let along = (units(middle), units(NAMES - 12.0));
        let down = (units(0.5 * NAMES), units(middle));
        area.draw(&Text::new(a.name(), along, text(11.0, MIDDLE)))?;
        area.draw(&Text::new(a.name(), down, text(11.0, MIDDLE)))?;
        for (j, b) in DriftCoefficient::ALL.into_iter().enumerate() {
            let rho = correlations[(i, j)];
            let corner = (units(at(j)), units(at(i)));
            let opposite = (units(at(j) + CELL - 1.0), units(at(i) + CELL - 1.0));
            let style = shade(rho).filled();
            let on_shade = ink_on(rho);
            let mut drawn = Ok(());
            ink.titled(&format!("{} and {}: {rho:.3}", a.name(), b.name()), || {
                drawn = area
                    .draw(&Rectangle::new([corner, opposite], style))
                    .and_then(|()| {
                        let place = (units(at(j) + 0.5 * CELL - 0.5), units(middle));
                        let style = text(11.0, MIDDLE).color(&on_shade);
                        let number = format!("{:.2}", rho + 0.0).replace("-0.00", "0.00");
                        area.draw(&Text::new(number.replace('-', "−"), place, style))
                    });
            });
            drawn?;
        }
    }
    Ok(())
}

/// From white to the colour of the sign.
fn shade(rho: f64) -> RGBColor {
    let RGBColor(r, g, b) = match rho < 0.0 {
        true => RGBColor(0x00, 0x5A, 0x8E),
        false => RGBColor(0xB2, 0x4A, 0x00),
    };
    let mix = |c: u8| (255.0 + (f64::from(c) - 255.0) * rho.abs()).round() as u8;
    // Not pure white, which is the page's own colour and is replaced in the dark.
    RGBColor(mix(r).min(0xFE), mix(g), mix(b))
}

/// A text colour that can be read on it. Not pure black or white: those follow the page.
fn ink_on(rho: f64) -> RGBColor {
    match rho.abs() > 0.6 {
        true => RGBColor(0xFE, 0xFE, 0xFE),
        false => RGBColor(0x11, 0x11, 0x11),
    }
}
