//! A picture of what the gimbals' angles mean on a stand: which gimbal carries which, about which axis of
//! the platform each turns and in which sense, how the base stands, and what the accelerometers read.

use nalgebra::{Matrix3, Vector3};
use plotters::element::{Circle, PathElement, Polygon, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color as _, RGBColor};

use super::figure::canvas::{Canvas, Ink, document};
use super::figure::draw::{Area, Drawn, line, text, units};
use super::figure::{Color, Dash};
use crate::attitude::{Position, SignedAxis};
use crate::platform::{CheckPosition, Platform};
use crate::wording::fixed;

/// Names of the gimbals, outer to inner.
pub(crate) const GIMBALS: [&str; 3] = ["outer", "middle", "inner"];
/// Names of their angles.
pub(crate) const ANGLES: [&str; 3] = ["α", "β", "γ"];

/// Size of a panel, pixels, and of a unit of length in it.
const WIDTH: f64 = 350.0;
const HEIGHT: f64 = 310.0;
const SCALE: f64 = 98.0;
/// Height of a line of text.
const LINE: f64 = 17.0;

const THIN: RGBColor = RGBColor(0xAA, 0xAA, 0xAA);
const DARK: RGBColor = RGBColor(0x33, 0x33, 0x33);
const MIDDLE: Pos = Pos {
    h_pos: HPos::Center,
    v_pos: VPos::Center,
};

/// Colours of the platform's axes.
const OF_AXIS: [Color; 3] = [Color::Blue, Color::Green, Color::Vermillion];
/// Names of its axes.
const AXES: [&str; 3] = ["x", "y", "z"];

/// Radii of the rings: what carries the outer gimbal, the outer, and the middle one.
const RINGS: [f64; 3] = [1.12, 0.94, 0.72];

/// The picture of `platform`'s stand as an SVG document: the gimbals where the angles are zero, or as near
/// to it as their ranges let them, and the check position of each gimbal
/// ([`Platform::check_positions`]).
///
/// ```
/// use scheme_opt::internals::platform::PlatformConfig;
/// use scheme_opt::internals::report::angles;
/// let svg = angles::picture(&PlatformConfig::default().check()?);
/// assert!(svg.starts_with("<svg") && svg.contains("α turns about −x"));
/// # Ok::<(), scheme_opt::Error>(())
/// ```
pub fn picture(platform: &Platform) -> String {
    let [width, height] = [2.0 * WIDTH, 2.0 * HEIGHT];
    let (area, ink) = Canvas::area(width, height);
    let drawn = draw(&area, &ink, platform);
    // Text cannot refuse to be written, and the layout is our own.
    debug_assert!(drawn.is_ok(), "{drawn:?}");
    let label = "The gimbals at zero angles, and for each of them the platform before and after a turn of \
                 its angle, with what the accelerometers then read; the table has the numbers";
    document(&ink, width, height, label)
}

/// What the angles mean on the stand of `platform`, sentence by sentence.
pub fn convention(platform: &Platform) -> Vec<String> {
    let stand = platform.stand();
    let axes = stand.axes().map(signed);
    let turns = GIMBALS.iter().zip(ANGLES).zip(&axes);
    let turns = turns.map(|((gimbal, angle), axis)| {
        format!("a positive {angle} turns the {gimbal} gimbal and all that it carries about {axis}")
    });
    let turns: Vec<String> = turns.collect();
    let base = match (stand.heading_deg() == 0.0, stand.tilt_deg() == [0.0; 2]) {
        (true, true) => {
            "The base stands level and faces north: at zero angles the platform's x axis \
                         points north, y up and z east."
                .to_owned()
        }
        _ => {
            let [heading, x, z] = [
                stand.heading_deg(),
                stand.tilt_deg()[0],
                stand.tilt_deg()[1],
            ]
            .map(|deg| format!("{deg}°").replace('-', "−"));
            format!(
                "The base's x axis heads {heading} from North towards East; then the base is tilted by \
                 {x} about its x axis and by {z} about its z axis, right-handed. At zero angles the \
                 platform's axes are the base's, which without heading and tilt point north, up and east."
            )
        }
    };
    vec![
        "n is North, Up, East. x, y and z are the platform's axes, along which its accelerometers measure \
         and about which its gyros do."
            .to_owned(),
        base,
        format!(
            "Right-handed, about the platform's axes as they stand at zero angles: {}.",
            turns.join("; ")
        ),
        format!(
            "C_c^n = C_b^n Rot({}, α) Rot({}, β) Rot({}, γ), Rot(a, θ) the right-handed rotation by θ \
             about a.",
            axes[0], axes[1], axes[2]
        ),
    ]
}

/// `+x` with the minus of print.
pub(crate) fn signed(axis: SignedAxis) -> String {
    axis.name().replace('-', "−")
}

/// Three numbers with a comma between, three decimals.
pub(crate) fn reading(f: [f64; 3]) -> String {
    let numbers = f.map(|v| fixed(v, 3).replace('-', "−"));
    format!("({})", numbers.join(", "))
}

/// The angles of a position in words.
pub(crate) fn angles(position: Position) -> String {
    let parts = ANGLES.iter().zip(position.to_deg());
    let parts: Vec<String> = parts
        .map(|(name, deg)| format!("{name} = {}", format!("{deg}°").replace('-', "−")))
        .collect();
    parts.join(", ")
}

/// A panel: its middle in pixels.
#[derive(Clone, Copy)]
struct View<'a> {
    area: &'a Area,
    ink: &'a Ink,
    middle: [f64; 2],
}

/// Where a panel's text stands, in lines from its top.
const HEAD: [f64; 2] = [0.8, 1.8];

impl View<'_> {
    /// A point of n (North, Up, East), seen from the south-west and above.
    fn at(&self, p: &Vector3<f64>) -> (i32, i32) {
        let from = Vector3::new(-0.78, 0.42, -0.46).normalize();
        let right = Vector3::y().cross(&from).normalize();
        let up = from.cross(&right);
        let [x, y] = self.middle;
        (
            units(x + SCALE * right.dot(p)),
            units(y - SCALE * up.dot(p)),
        )
    }

    fn path(&self, points: &[Vector3<f64>], color: RGBColor, width: f64, dash: Dash) -> Drawn {
        self.ink.set_dash(dash);
        let points: Vec<(i32, i32)> = points.iter().map(|p| self.at(p)).collect();
        self.area
            .draw(&PathElement::new(points, line(color, width)))?;
        self.ink.set_dash(Dash::Solid);
        Ok(())
    }

    /// A head at the end of the way from one point to another.
    fn head(&self, from: &Vector3<f64>, to: &Vector3<f64>, color: RGBColor) -> Drawn {
        let [(x0, y0), (x1, y1)] = [self.at(from), self.at(to)];
        let [dx, dy] = [f64::from(x1 - x0), f64::from(y1 - y0)];
        let length = libm::hypot(dx, dy);
        if length < 1.0 {
            return Ok(());
        }
        let [ux, uy] = [dx / length, dy / length];
        let (long, wide) = (f64::from(units(9.0)), f64::from(units(3.4)));
        let side = |s: f64| {
            (
                (f64::from(x1) - long * ux - s * wide * uy) as i32,
                (f64::from(y1) - long * uy + s * wide * ux) as i32,
            )
        };
        let corners = vec![(x1, y1), side(1.0), side(-1.0)];
        self.area.draw(&Polygon::new(corners, color.filled()))
    }

    fn arrow(&self, to: &Vector3<f64>, color: RGBColor, width: f64, dash: Dash) -> Drawn {
        self.path(&[Vector3::zeros(), *to], color, width, dash)?;
        self.head(&Vector3::zeros(), to, color)
    }

    fn name(&self, at: &Vector3<f64>, name: &str, color: RGBColor, size: f64) -> Drawn {
        let style = text(size, MIDDLE).color(&color);
        self.area.draw(&Text::new(name, self.at(at), style))
    }

    /// A line of text under the panel's top.
    fn words(&self, words: &str, down: f64, size: f64, bold: bool) -> Drawn {
        let [x, y] = self.middle;
        let at = (units(x), units(y - 0.5 * HEIGHT + down * LINE));
        let style = match bold {
            true => {
                let bold = plotters::style::FontStyle::Bold;
                let font = ("sans-serif", size * super::figure::canvas::UNITS, bold);
                plotters::style::TextStyle::from(font).pos(MIDDLE)
            }
            false => text(size, MIDDLE),
        };
        self.area.draw(&Text::new(words, at, style))
    }

    /// North, Up and East.
    fn frame(&self) -> Drawn {
        for (axis, name) in [(0, "North"), (1, "Up"), (2, "East")] {
            let mut direction = Vector3::zeros();
            direction[axis] = 1.28;
            self.arrow(&direction, THIN, 1.0, Dash::Dashed)?;
            self.name(&(direction * 1.1), name, DARK, 11.0)?;
        }
        Ok(())
    }

    /// The platform's axes, the columns of C_c^n.
    fn platform(&self, c: &Matrix3<f64>, length: f64, dash: Dash) -> Drawn {
        let width = if dash == Dash::Solid { 2.2 } else { 1.2 };
        for (axis, color) in OF_AXIS.into_iter().enumerate() {
            let tip = c.column(axis) * length;
            self.arrow(&tip, color.rgb(), width, dash)?;
        }
        Ok(())
    }

    fn names(&self, c: &Matrix3<f64>, length: f64) -> Drawn {
        for axis in 0..3 {
            let at = c.column(axis) * (length + 0.12);
            self.name(&at, AXES[axis], OF_AXIS[axis].rgb(), 13.0)?;
        }
        Ok(())
    }

    /// The way of a point that turns about an axis by `deg`, with a head at its end.
    fn turn(&self, from: &Vector3<f64>, axis: &Vector3<f64>, deg: f64, color: RGBColor) -> Drawn {
        const STEPS: usize = 24;
        let point = |k: usize| {
            let angle = deg.to_radians() * k as f64 / STEPS as f64;
            let (sin, cos) = libm::sincos(angle);
            let along = axis * axis.dot(from);
            along + (from - along) * cos + axis.cross(from) * sin
        };
        let points: Vec<Vector3<f64>> = (0..=STEPS).map(point).collect();
        self.path(&points, color, 1.2, Dash::Solid)?;
        self.head(&points[STEPS - 3], &points[STEPS], color)
    }
}

fn draw(area: &Area, ink: &Ink, platform: &Platform) -> Drawn {
    let checks = platform.check_positions();
    // Arrows mostly point upwards; the rings do not.
    let down = |panel: usize| if panel == 0 { LINE } else { 2.0 * LINE };
    let view = |panel: usize| View {
        area,
        ink,
        middle: [
            WIDTH * ((panel % 2) as f64 + 0.5),
            HEIGHT * ((panel / 2) as f64 + 0.5) + down(panel),
        ],
    };
    let Some((start, turned)) = checks.split_first() else {
        return Ok(());
    };
    let top = |panel: usize| View {
        middle: [view(panel).middle[0], view(panel).middle[1] - down(panel)],
        ..view(panel)
    };
    gimbals(&view(0), platform, start)?;
    top(0).words("The gimbals", HEAD[0], 13.0, true)?;
    top(0).words(&angles(start.position), HEAD[1], 11.5, false)?;
    read(&top(0), start)?;
    for (gimbal, name) in GIMBALS.into_iter().enumerate() {
        let panel = gimbal + 1;
        let axis = signed(platform.stand().axes()[gimbal]);
        let head = format!("{name} gimbal: {} turns about {axis}", ANGLES[gimbal]);
        let mut head = head;
        head[..1].make_ascii_uppercase();
        top(panel).words(&head, HEAD[0], 13.0, true)?;
        match turned.iter().find(|c| c.gimbal == Some(gimbal)) {
            Some(check) => {
                top(panel).words(&angles(check.position), HEAD[1], 11.5, false)?;
                moved(&view(panel), platform, (start.position, check), gimbal)?;
                read(&top(panel), check)?;
            }
            None => {
                let why = "its range is too small to show its sense by gravity";
                top(panel).words(why, HEAD[1], 11.5, false)?;
            }
        }
    }
    Ok(())
}

/// What the accelerometers read, at the foot of a panel.
fn read(view: &View<'_>, check: &CheckPosition) -> Drawn {
    let f = format!("f = {} g", reading(check.specific_force_g));
    view.words(&f, HEIGHT / LINE - 0.7, 12.0, false)
}

/// The rings of the gimbals, outer to inner, and the platform in them.
fn gimbals(view: &View<'_>, platform: &Platform, start: &CheckPosition) -> Drawn {
    let stand = platform.stand();
    let attitude = stand.attitude(start.position);
    let c = attitude.matrix();
    view.frame()?;
    // Against the axes that the gimbals turn about, in n.
    let axes = stand.rotation_axes(&attitude, start.position).map(|v| -v);
    for (gimbal, axis) in axes.iter().enumerate() {
        // The ring that this gimbal is, with the pivots of what carries it, and the next one's.
        if let Some(next) = axes.get(gimbal + 1) {
            let radius = RINGS[gimbal + 1];
            let ring: Vec<Vector3<f64>> = (0..=72)
                .map(|k| {
                    let (sin, cos) = libm::sincos(f64::from(k) * 5.0_f64.to_radians());
                    (axis * cos + next * sin) * radius
                })
                .collect();
            view.path(&ring, DARK, 1.6, Dash::Solid)?;
        }
        let [outside, inside] = match gimbal {
            2 => [RINGS[2], 0.0],
            _ => [RINGS[gimbal], RINGS[gimbal + 1]],
        };
        for side in [1.0, -1.0] {
            let ends = [axis * (side * outside), axis * (side * inside)];
            let width = if gimbal == 2 { 1.0 } else { 3.0 };
            view.path(&ends, DARK, width, Dash::Solid)?;
        }
        let at = axis * (outside + 0.12);
        let radius = units(7.5);
        let spot = view.at(&at);
        view.area.draw(&Circle::new(
            spot,
            radius,
            RGBColor(0xFF, 0xFF, 0xFF).filled(),
        ))?;
        view.area
            .draw(&Circle::new(spot, radius, line(DARK, 0.8)))?;
        view.name(&at, ANGLES[gimbal], DARK, 11.5)?;
    }
    view.platform(c, 0.56, Dash::Solid)?;
    view.names(c, 0.56)
}

/// The platform before and after the turn of a gimbal, and how its axes went.
fn moved(
    view: &View<'_>,
    platform: &Platform,
    (start, check): (Position, &CheckPosition),
    gimbal: usize,
) -> Drawn {
    let stand = platform.stand();
    let mut angles = check.position.degrees();
    let deg = angles[gimbal] - start.degrees()[gimbal];
    angles[gimbal] = start.degrees()[gimbal];
    let before = Position::from_deg(angles[0], angles[1], angles[2]);
    let [from, to] = [before, check.position].map(|p| stand.attitude(p));
    view.frame()?;
    view.platform(from.matrix(), 0.95, Dash::Dashed)?;
    view.platform(to.matrix(), 0.95, Dash::Solid)?;
    let about = -stand.rotation_axes(&from, before)[gimbal];
    for (axis, color) in OF_AXIS.into_iter().enumerate() {
        let tip = from.matrix().column(axis) * 0.86;
        if about.cross(&tip).norm() > 0.1 {
            view.turn(&tip, &about, deg, color.rgb())?;
        }
    }
    view.names(to.matrix(), 0.95)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::platform;

    #[test]
    fn the_picture_says_axes_senses_and_readings() {
        let svg = picture(&platform(|_| {}));
        for words in [
            "Outer gimbal: α turns about −x",
            "Middle gimbal: β turns about −y",
            "Inner gimbal: γ turns about −z",
            "α = 30°, β = 0°, γ = 0°",
            "f = (0.000, 0.866, 0.500) g",
            "North",
        ] {
            assert!(svg.contains(words), "{words}");
        }
        let other = picture(&platform(|c| {
            c.gimbals.axes = Some(["+z", "-x", "+z"].map(str::to_owned));
            c.stand.heading_deg = Some(40.0);
            c.gimbals.gamma_deg = Some([0.0, 1.0]);
        }));
        assert!(other.contains("Outer gimbal: α turns about +z"));
        assert!(other.contains("its range is too small"));
    }
}
