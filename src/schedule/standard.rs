//! Built-in schemes: the customary multi-position tests, and well-spread sets of directions.
//!
//! A scheme says along which directions of the platform gravity points, in what order, and with
//! what heading. The directions come from the cube (its 6 faces, 12 edges, 8 vertices and their
//! unions) and from the icosahedron (its 12 vertices). For the levelling problem y = (I − uuᵀ)
//! (d + G u) with gravity along u, d the constant and G the g-sensitive drift, the quality of
//! such sets is known: the 12 icosahedron vertices attain the optimum of the uniform sphere, 26
//! directions reach a D-efficiency of 0.9988, 18 of 0.9956, the 12 edges 0.9909, the 8 vertices
//! 0.9348, and 6 faces alone leave the three D_I unobserved.
//!
//! Schemes that only prescribe directions leave the heading free; it is chosen so that β = 0
//! and a stand with a limited middle gimbal can run them.

mod rotations;

use nalgebra::{Matrix3, Rotation3, Vector3};
use std::f64::consts::FRAC_PI_2;

use super::{MAX_DURATION_S, Schedule, ScheduledPosition, text};
use crate::attitude::{Attitude, Degrees, EAST, NORTH, Position};
use crate::error::{Error, Result};
use crate::motion::{Test, Timeline, clear_ways, equivalent_positions, quickest_positions};
use crate::platform::Platform;

/// A built-in scheme.
///
/// ```
/// use scheme_opt::internals::motion::Test;
/// use scheme_opt::internals::platform::PlatformConfig;
/// use scheme_opt::internals::schedule::standard::StandardScheme;
/// let test = Test::from(PlatformConfig::default().check()?);
/// let scheme = StandardScheme::from_name("faces-12")?;
/// let schedule = scheme.schedule(12_000.0, &test)?;
/// assert_eq!(schedule.positions().len(), 12);
/// assert_eq!(schedule.positions()[0].dwell_s, 1000.0);
/// # Ok::<(), scheme_opt::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum StandardScheme {
    /// Gravity along each platform axis, both ways: the customary six-position test. Its
    /// directions are the face normals of the cube.
    Faces6,
    /// The six-position test run at two opposite headings, so that the Earth rate reverses in
    /// the horizontal axes.
    Faces12,
    /// Every orientation with the platform axes along North, Up and East: each face at four
    /// headings, the 24 rotations of the cube.
    Axis24,
    /// Gravity midway between two platform axes: the 12 edge directions of the cube.
    Edges12,
    /// Gravity equally inclined to all platform axes: the 8 vertex directions of the cube.
    Vertices8,
    /// Faces and edges of the cube.
    Cube18,
    /// Faces, edges and vertices of the cube.
    Cube26,
    /// The 12 vertex directions of the regular icosahedron, (0, ±1, ±φ) and its cyclic
    /// permutations with φ = (1 + √5)/2: the most even spread of 12 directions.
    Icosahedron12,
    /// The 19 positions of Xie Bo et al. (JCIT 2011): quarter turns about the platform's own
    /// axes from the level position, y+90 ×3, y−90 ×3, z+90, x+90 ×3, x−90 ×3, z+90 ×2, z−90 ×3.
    Rotation19,
    /// The 9 positions of Jia et al. (JCIT 2014), in the same manner: x+90, z+90, y−90, x−90,
    /// z−90, y+90, x+90, z−90.
    Rotation9,
    /// The two-axis sequence of nine steps: y540, z90, x540, z180, x−90, z540, z−90, z180, y90.
    /// What is held are the ten positions between the turns; a turn of 540° is driven as the
    /// half turn that ends at the same place.
    TwoAxis9,
}

impl StandardScheme {
    /// All schemes, as they are listed.
    pub const ALL: [Self; 11] = [
        Self::Faces6,
        Self::Faces12,
        Self::Axis24,
        Self::Edges12,
        Self::Vertices8,
        Self::Cube18,
        Self::Cube26,
        Self::Icosahedron12,
        Self::Rotation19,
        Self::Rotation9,
        Self::TwoAxis9,
    ];

    /// The name used on the command line and in documents.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Faces6 => "faces-6",
            Self::Faces12 => "faces-12",
            Self::Axis24 => "axis-24",
            Self::Edges12 => "edges-12",
            Self::Vertices8 => "vertices-8",
            Self::Cube18 => "cube-18",
            Self::Cube26 => "cube-26",
            Self::Icosahedron12 => "icosahedron-12",
            Self::Rotation19 => "rotation-19",
            Self::Rotation9 => "rotation-9",
            Self::TwoAxis9 => "two-axis-9",
        }
    }

    /// What the scheme is, in one line.
    pub const fn description(self) -> &'static str {
        match self {
            Self::Faces6 => "gravity along each platform axis, both ways (six-position test)",
            Self::Faces12 => "the six-position test at headings 0 and 180 deg",
            Self::Axis24 => "all 24 axis-aligned orientations: each face at four headings",
            Self::Edges12 => "gravity midway between two platform axes (edges of the cube)",
            Self::Vertices8 => "gravity equally inclined to all axes (vertices of the cube)",
            Self::Cube18 => "faces and edges of the cube",
            Self::Cube26 => "faces, edges and vertices of the cube",
            Self::Icosahedron12 => "vertices of the icosahedron, the most even 12 directions",
            Self::Rotation19 => "quarter turns about y, x, z (Xie Bo et al., JCIT 2011)",
            Self::Rotation9 => "quarter turns about x, z, y in turn (Jia et al., JCIT 2014)",
            Self::TwoAxis9 => "two-axis sequence of nine turns, held in between",
        }
    }

    /// The scheme of that name.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] listing the names, with the nearest one as a hint.
    pub fn from_name(name: &str) -> Result<Self> {
        if let Some(scheme) = Self::ALL.into_iter().find(|s| s.name() == name) {
            return Ok(scheme);
        }
        let names = Self::ALL.map(Self::name);
        let error = Error::input("no such standard scheme")
            .with_value(text::shown(name))
            .with_allowed(names.join(", "));
        Err(text::with_nearest(error, name, names))
    }

    /// The positions in order, in the angles of the seed paper's stand.
    ///
    /// Angles are rounded to the 1e-9° of files; those of the axis-aligned schemes are exact
    /// multiples of 90°.
    pub fn positions(self) -> Vec<Position> {
        match self {
            Self::Faces6 => faces(&[0]),
            Self::Faces12 => faces(&[0, 2]),
            Self::Axis24 => faces(&[0, 1, 2, 3]),
            Self::Edges12 => edges(),
            Self::Vertices8 => vertices(),
            Self::Cube18 => [faces(&[0]), edges()].concat(),
            Self::Cube26 => [faces(&[0]), edges(), vertices()].concat(),
            Self::Icosahedron12 => icosahedron(),
            Self::Rotation19 => rotations::nineteen(),
            Self::Rotation9 => rotations::nine(),
            Self::TwoAxis9 => rotations::two_axis(),
        }
    }

    /// The positions in order, in the angles of `platform`: the same attitudes in n as on the paper's
    /// stand. Where the gimbals cannot take one of them and the base is turned or tilted, all are the
    /// same attitudes towards the base: a scheme of an index table stays one wherever the table faces.
    pub fn positions_on(self, platform: &Platform) -> Vec<Position> {
        let (papers, stand) = (self.positions(), platform.stand());
        if stand.is_of_the_paper() {
            return papers;
        }
        let towards = |frame: Matrix3<f64>| -> Vec<Position> {
            let turned = papers.iter().map(|p| p.attitude().turned(&frame));
            turned.map(|a| as_written(stand.position(&a))).collect()
        };
        let in_n = towards(Matrix3::identity());
        let reachable = |p: &Position| !equivalent_positions(platform, *p).is_empty();
        if in_n.iter().all(reachable) {
            return in_n;
        }
        let on_base = towards(stand.base());
        match on_base.iter().all(reachable) {
            true => on_base,
            false => in_n,
        }
    }

    /// The scheme as a schedule of `total_time_s` in `test`: equal dwells that, together
    /// with the moves and settles between them, add up to the total. Of the Euler triples of each
    /// attitude those within the gimbals' ranges that are reached quickest are taken.
    ///
    /// # Errors
    ///
    /// [`Error::is_input`] when `total_time_s` is not in 0 to 1e7;
    /// [`Error::is_infeasible`] when the platform cannot take one of the positions, or when moves
    /// and settles leave no time to dwell.
    pub fn schedule(self, total_time_s: f64, test: &Test) -> Result<Schedule> {
        if !(0.0..=MAX_DURATION_S).contains(&total_time_s) {
            return Err(Error::out_of_range(
                "total_time_s",
                total_time_s,
                "0 to 1e7",
            ));
        }
        let positions = quickest_positions(test, &self.positions_on(test.platform()));
        // Where there is no way past what stands in the gimbals' way, the usual one is refused.
        let ways = match test.platform().obstacles().stop_moves() {
            true => clear_ways(test, positions.iter().map(|p| (*p, None))),
            false => None,
        };
        let ways = ways.unwrap_or_else(|| vec![None; positions.len()]);
        let held_for = |dwell_s: f64| {
            let held = positions.iter().zip(&ways);
            let held = held.map(|(p, way)| ScheduledPosition {
                change_deg: way.map(|way| way.map(Degrees::deg)),
                ..ScheduledPosition::new(*p, dwell_s)
            });
            Schedule::new(held.collect())
        };
        let overhead_s = Timeline::new(test, &held_for(0.0)?)
            .map_err(|e| self.unreachable(e))?
            .overhead_s();
        let dwell_s = (total_time_s - overhead_s) / positions.len() as f64;
        if dwell_s > 0.0 {
            held_for(dwell_s)
        } else {
            Err(Error::infeasible(format!(
                "the moves and settles of {} take {overhead_s:.0} s and leave no time to dwell",
                self.name()
            ))
            .with_key("total_time_s")
            .with_value(total_time_s)
            .with_allowed(format!("more than {overhead_s:.3}")))
        }
    }

    /// What the timeline says about a position, as a matter of this scheme on that platform: the
    /// inputs are acceptable, they only do not fit together.
    fn unreachable(self, error: Error) -> Error {
        let Some(key) = error.key().filter(|key| key.starts_with("positions")) else {
            return error;
        };
        let infeasible = Error::infeasible(format!(
            "the platform cannot take this position of {}",
            self.name()
        ));
        infeasible
            .with_key(key)
            .with_value(error.value().unwrap_or_default())
            .with_allowed(error.allowed().unwrap_or_default())
            .with_source(error)
    }
}

/// Directions of gravity along the platform axes: once around z from the level position, where
/// gravity is along −y, then up and down along z.
const FACES: [[f64; 3]; 6] = [
    [0.0, -1.0, 0.0],
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [-1.0, 0.0, 0.0],
    [0.0, 0.0, 1.0],
    [0.0, 0.0, -1.0],
];

/// Both signs.
const SIGNS: [f64; 2] = [-1.0, 1.0];

/// Each face at each heading, given in quarter turns.
fn faces(quarter_turns: &[u8]) -> Vec<Position> {
    let mut positions = Vec::with_capacity(FACES.len() * quarter_turns.len());
    for face in FACES {
        for &turns in quarter_turns {
            let heading_rad = f64::from(turns) * FRAC_PI_2;
            let attitude = Attitude::with_gravity_along(Vector3::from(face), heading_rad);
            positions.extend(attitude.map(axis_aligned));
        }
    }
    positions
}

/// The position of an attitude whose axes coincide with North, Up and East but for rounding.
fn axis_aligned(attitude: Attitude) -> Position {
    // Adding zero makes −0 a plain zero, for atan2 takes its sign for a half turn.
    let exact = attitude.matrix().map(|entry| entry.round() + 0.0);
    let exact = Attitude::from_rotation(Rotation3::from_matrix_unchecked(exact));
    as_written(exact.position())
}

fn edges() -> Vec<Position> {
    let mut directions = Vec::with_capacity(12);
    for across in 0..3 {
        for (a, b) in SIGNS.into_iter().flat_map(|a| SIGNS.map(|b| (a, b))) {
            let mut direction = Vector3::zeros();
            direction[(across + 1) % 3] = a;
            direction[(across + 2) % 3] = b;
            directions.push(direction);
        }
    }
    towards(&directions)
}

fn vertices() -> Vec<Position> {
    let mut directions = Vec::with_capacity(8);
    for x in SIGNS {
        for y in SIGNS {
            directions.extend(SIGNS.map(|z| Vector3::new(x, y, z)));
        }
    }
    towards(&directions)
}

fn icosahedron() -> Vec<Position> {
    let golden = f64::midpoint(1.0, 5.0_f64.sqrt());
    let mut directions = Vec::with_capacity(12);
    for zero in 0..3 {
        for (one, phi) in SIGNS.into_iter().flat_map(|a| SIGNS.map(|b| (a, b))) {
            let mut direction = Vector3::zeros();
            direction[(zero + 1) % 3] = one;
            direction[(zero + 2) % 3] = phi * golden;
            directions.push(direction);
        }
    }
    towards(&directions)
}

/// Positions with gravity along each of the directions, none of which is zero.
fn towards(directions: &[Vector3<f64>]) -> Vec<Position> {
    directions.iter().filter_map(|d| level_middle(*d)).collect()
}

/// The position with gravity along `direction` and β = 0.
fn level_middle(direction: Vector3<f64>) -> Option<Position> {
    let start = Attitude::with_gravity_along(direction, 0.0)?;
    // sin β is minus the North component of the platform's z axis; a turn by the heading makes
    // it cos(heading) z_N + sin(heading) z_E.
    let (z_north, z_east) = (start.matrix()[(NORTH, 2)], start.matrix()[(EAST, 2)]);
    let heading_rad = if z_north == 0.0 {
        0.0
    } else {
        libm::atan(-z_north / z_east)
    };
    Attitude::with_gravity_along(direction, heading_rad).map(|a| as_written(a.position()))
}

/// The position as a file holds it: 1e-9°, no negative zero, half turns positive.
fn as_written(position: Position) -> Position {
    let [alpha_deg, beta_deg, gamma_deg] = position
        .to_deg()
        .map(|deg| if deg == -180.0 { 180.0 } else { deg + 0.0 });
    Position::from_deg(alpha_deg, beta_deg, gamma_deg)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::PlatformConfig;
    use nalgebra::Matrix3;

    fn gravities(scheme: StandardScheme) -> Vec<Vector3<f64>> {
        let positions = scheme.positions();
        positions.iter().map(|p| p.attitude().gravity_c()).collect()
    }

    fn all_distinct(vectors: &[Vector3<f64>]) -> bool {
        let pairs = (0..vectors.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        pairs
            .into_iter()
            .all(|(i, j)| (vectors[i] - vectors[j]).norm() > 0.1)
    }

    #[test]
    fn each_scheme_has_its_count_and_its_directions() {
        use StandardScheme as S;
        for (scheme, count, directions) in [
            (S::Faces6, 6, 6),
            (S::Faces12, 12, 6),
            (S::Axis24, 24, 6),
            (S::Edges12, 12, 12),
            (S::Vertices8, 8, 8),
            (S::Cube18, 18, 18),
            (S::Cube26, 26, 26),
            (S::Icosahedron12, 12, 12),
        ] {
            let gravity = gravities(scheme);
            assert_eq!(gravity.len(), count);
            let headings = count / directions;
            let one_each: Vec<_> = gravity.into_iter().step_by(headings).collect();
            assert_eq!(one_each.len(), directions);
            assert!(all_distinct(&one_each), "{}", scheme.name());
            // Opposite directions come in pairs.
            for u in &one_each {
                assert!(one_each.iter().any(|v| (u + v).norm() < 1e-9));
            }
        }
    }

    #[test]
    fn directions_are_those_of_the_solids() {
        let sorted = |u: &Vector3<f64>| {
            let mut parts = [u.x.abs(), u.y.abs(), u.z.abs()];
            parts.sort_by(f64::total_cmp);
            parts
        };
        let golden = f64::midpoint(1.0, 5.0_f64.sqrt());
        let norm = golden.hypot(1.0);
        for (scheme, expected) in [
            (StandardScheme::Axis24, [0.0, 0.0, 1.0]),
            (
                StandardScheme::Edges12,
                [0.0, 0.5_f64.sqrt(), 0.5_f64.sqrt()],
            ),
            (StandardScheme::Vertices8, [(1.0_f64 / 3.0).sqrt(); 3]),
            (
                StandardScheme::Icosahedron12,
                [0.0, 1.0 / norm, golden / norm],
            ),
        ] {
            for u in gravities(scheme) {
                let parts = sorted(&u);
                assert!(
                    parts
                        .iter()
                        .zip(expected)
                        .all(|(a, b)| (a - b).abs() < 1e-10)
                );
            }
        }
        // The neighbours of an icosahedron's vertex are at cos = 1/√5.
        let u = gravities(StandardScheme::Icosahedron12);
        let neighbours = u
            .iter()
            .filter(|v| (u[0].dot(v) - 0.2_f64.sqrt()).abs() < 1e-9);
        assert_eq!(neighbours.count(), 5);
    }

    #[test]
    fn the_24_attitudes_are_the_rotation_group_of_the_cube() {
        let positions = StandardScheme::Axis24.positions();
        let as_integers = |p: &Position| {
            let c = p.attitude().matrix().map(f64::round);
            assert!((c - p.attitude().matrix()).amax() < 1e-15);
            c.map(|v| v as i32)
        };
        let mut found: Vec<Matrix3<i32>> = positions.iter().map(as_integers).collect();
        // The group: all signed permutations of the axes with determinant 1.
        let mut group = Vec::new();
        for order in [
            [0, 1, 2],
            [1, 2, 0],
            [2, 0, 1],
            [0, 2, 1],
            [2, 1, 0],
            [1, 0, 2],
        ] {
            for signs in 0..8 {
                let mut m = Matrix3::zeros();
                for (row, column) in order.into_iter().enumerate() {
                    m[(row, column)] = if signs >> row & 1 == 0 { 1 } else { -1 };
                }
                if m.map(f64::from).determinant() > 0.0 {
                    group.push(m);
                }
            }
        }
        let order = |a: &Matrix3<i32>, b: &Matrix3<i32>| a.as_slice().cmp(b.as_slice());
        found.sort_by(order);
        group.sort_by(order);
        assert_eq!(found, group);
    }

    #[test]
    fn axis_aligned_angles_are_exact_multiples_of_90_deg() {
        for scheme in [StandardScheme::Faces12, StandardScheme::Axis24] {
            for position in scheme.positions() {
                for deg in position.to_deg() {
                    assert!([-90.0, 0.0, 90.0, 180.0].contains(&deg), "{position:?}");
                }
            }
        }
        assert_eq!(StandardScheme::Faces6.positions()[0], Position::default());
    }

    #[test]
    fn free_headings_leave_the_middle_gimbal_at_zero() {
        for scheme in StandardScheme::ALL {
            use StandardScheme as S;
            let prescribed = [S::Axis24, S::Rotation19, S::Rotation9, S::TwoAxis9];
            if !prescribed.contains(&scheme) {
                assert!(scheme.positions().iter().all(|p| p.degrees()[1] == 0.0));
            }
        }
    }

    #[test]
    fn every_scheme_takes_the_same_total_time() {
        let mut config = PlatformConfig::default();
        let instant = Test::from(config.check().unwrap());
        config.motion.slew_rate_deg_per_s = Some(1.0.into());
        config.motion.settle_s = 20.0;
        let slow = Test::from(config.check().unwrap());
        for scheme in StandardScheme::ALL {
            for test in [&instant, &slow] {
                let schedule = scheme.schedule(20_000.0, test).unwrap();
                let total = Timeline::new(test, &schedule).unwrap().total_time_s();
                assert!((total - 20_000.0).abs() < 1e-8);
                let first = schedule.positions()[0].dwell_s;
                assert!(schedule.positions().iter().all(|p| p.dwell_s == first));
            }
        }
    }

    #[test]
    fn what_does_not_fit_the_platform_is_infeasible_with_a_reason() {
        let mut config = PlatformConfig::default();
        config.motion.settle_s = 100.0;
        let test = Test::from(config.check().unwrap());
        let error = StandardScheme::Faces6.schedule(500.0, &test).unwrap_err();
        assert!(error.is_infeasible());
        assert!(error.to_string().contains("take 500 s"), "{error}");

        config.gimbals.beta_deg = Some([-60.0, 60.0]);
        let test = Test::from(config.check().unwrap());
        assert!(StandardScheme::Cube26.schedule(5000.0, &test).is_ok());
        let error = StandardScheme::Axis24.schedule(5000.0, &test).unwrap_err();
        assert!(error.is_infeasible());
        assert!(error.key().unwrap().ends_with("beta_deg"));
        assert!(error.to_string().contains("axis-24"), "{error}");

        for bad in [f64::NAN, -1.0, f64::INFINITY, 2e7] {
            let error = StandardScheme::Faces6.schedule(bad, &test).unwrap_err();
            assert!(error.is_input());
        }
        assert!(
            StandardScheme::Faces6
                .schedule(0.0, &test)
                .unwrap_err()
                .is_infeasible()
        );
    }

    #[test]
    fn names_lead_back_to_the_schemes() {
        for scheme in StandardScheme::ALL {
            assert_eq!(StandardScheme::from_name(scheme.name()), Ok(scheme));
            assert!(!scheme.description().is_empty());
        }
        let error = StandardScheme::from_name("face-12").unwrap_err();
        assert!(
            error.to_string().contains("did you mean `faces-12`?"),
            "{error}"
        );
        assert!(StandardScheme::from_name("").unwrap_err().is_input());
    }
}
