//! The attitudes a schedule may take, covered by finitely many directions of gravity.
//!
//! Turning the platform about the vertical only mixes North and East, which the bound maximises
//! over in closed form, so what is left of an attitude is the direction g of gravity in the
//! platform: a point of the sphere. A grid of rings about the platform's z axis covers it within
//! an angle that is computed, not assumed.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Vector3;

use crate::attitude::{Attitude, NanoDegrees, Position, Stand, decimal};
use crate::platform::{GimbalRange, Gimbals, Platform, multiples};

/// Spacing of the rings, rad: about 18 000 directions.
const SPACING: f64 = 1.5 * PI / 180.0;
/// Smallest spacing for a small cover, rad.
const FINEST: f64 = 0.3 * PI / 180.0;
/// Step at which ranges of α and β are sampled, relative to the spacing, and most samples.
const SAMPLE: f64 = 0.6;
const MOST_SAMPLES: f64 = 100_000.0;
/// Most attitudes of an index table that are visited one by one.
const LARGEST_TABLE: usize = 60_000;

/// Rings of directions about the platform's z axis.
#[derive(Debug, Clone)]
pub(super) struct Sphere {
    pub directions: Vec<Vector3<f64>>,
    rings: Vec<Ring>,
    /// Width of a ring's band, rad.
    band: f64,
    /// Every direction lies within this angle of one of the grid, rad.
    pub radius: f64,
}

#[derive(Debug, Clone)]
struct Ring {
    colatitude: f64,
    first: usize,
    count: usize,
}

impl Sphere {
    pub fn new(spacing: f64) -> Self {
        let ring_count = (PI / spacing).ceil() as usize;
        let band = PI / ring_count as f64;
        let mut sphere = Self {
            directions: Vec::new(),
            rings: Vec::new(),
            band,
            radius: 0.0,
        };
        for k in 0..ring_count {
            let colatitude = (k as f64 + 0.5) * band;
            let count = (TAU * libm::sin(colatitude) / spacing).ceil().max(3.0) as usize;
            let first = sphere.directions.len();
            for i in 0..count {
                let azimuth = TAU * i as f64 / count as f64;
                sphere.directions.push(direction(colatitude, azimuth));
            }
            // Haversines, with the widest parallel of the band.
            let nearest = (colatitude - FRAC_PI_2).abs() - 0.5 * band;
            let widest = libm::cos(nearest.max(0.0));
            let across = libm::sin(FRAC_PI_2 / count as f64).powi(2);
            let hav = libm::sin(0.25 * band).powi(2) + libm::sin(colatitude) * widest * across;
            sphere.radius = sphere.radius.max(2.0 * libm::asin(hav.sqrt().min(1.0)));
            sphere.rings.push(Ring {
                colatitude,
                first,
                count,
            });
        }
        sphere
    }

    /// Marks the grid directions within `reach` of the arc at `colatitude` from azimuth `from`
    /// over `length`.
    fn mark(&self, marks: &mut [bool], colatitude: f64, from: f64, length: f64, reach: f64) {
        let ring_at = |angle: f64| ((angle / self.band).floor().max(0.0)) as usize;
        let last = ring_at(colatitude + reach).min(self.rings.len() - 1);
        for ring in &self.rings[ring_at(colatitude - reach)..=last] {
            if marks[ring.first] && length >= TAU {
                continue;
            }
            let sines = libm::sin(ring.colatitude) * libm::sin(colatitude);
            let cosine = libm::cos(reach) - libm::cos(ring.colatitude) * libm::cos(colatitude);
            let pad = if cosine <= -sines {
                PI
            } else {
                libm::acos((cosine / sines).min(1.0))
            };
            let step = TAU / ring.count as f64;
            let low = ((from - pad) / step).floor() as i64;
            let wide = ((length + 2.0 * pad) / step).ceil() as i64 + 1;
            let count = ring.count as i64;
            for i in low..=low + wide.min(count) {
                marks[ring.first + i.rem_euclid(count) as usize] = true;
            }
        }
    }
}

fn direction(colatitude: f64, azimuth: f64) -> Vector3<f64> {
    let (s, c) = libm::sincos(colatitude);
    Vector3::new(s * libm::cos(azimuth), s * libm::sin(azimuth), c)
}

/// What the bound maximises over.
#[derive(Debug, Clone)]
pub(super) enum Allowed {
    /// Every attitude.
    Everything,
    /// Directions that cover those the gimbal ranges allow, at any heading.
    Cover {
        /// The directions.
        directions: Vec<Vector3<f64>>,
        /// Every allowed direction lies within this angle of one of them, rad.
        radius: f64,
    },
    /// The attitudes of an index table whose moves take no time.
    Table(Vec<Attitude>),
}

/// The sphere's grid and what of it is allowed.
#[derive(Debug, Clone)]
pub(super) struct Directions {
    pub sphere: Sphere,
    pub allowed: Allowed,
}

impl Directions {
    pub fn new(platform: &Platform) -> Self {
        let (gimbals, motion) = (platform.gimbals(), platform.motion());
        let stand = platform.stand();
        let sphere = Sphere::new(SPACING);
        // A move that takes time passes between the table's positions, and the drift integrates
        // meanwhile.
        let table = match (gimbals.step_deg(), motion.slew) {
            (Some(step), None) => table(stand, gimbals, step),
            _ => None,
        };
        let allowed = match table {
            Some(attitudes) => Allowed::Table(attitudes),
            None => cover(&sphere, stand, gimbals),
        };
        Self { sphere, allowed }
    }

    /// Every attitude.
    pub fn unlimited() -> Self {
        Self {
            sphere: Sphere::new(SPACING),
            allowed: Allowed::Everything,
        }
    }
}

/// The sampled values of an angle: all of them within `half` of a sample.
fn samples(range: Option<GimbalRange>, step: f64) -> (Vec<f64>, f64) {
    let (low, width) = turned(range);
    let count = (width / step).ceil().max(1.0);
    let step = width / count;
    let values = (0..count as usize)
        .map(|i| low + (i as f64 + 0.5) * step)
        .collect();
    (values, 0.5 * step)
}

/// Start and width of a range, a whole turn at most.
fn turned(range: Option<GimbalRange>) -> (f64, f64) {
    match range {
        Some(r) if r.high_rad - r.low_rad < TAU => (r.low_rad, r.high_rad - r.low_rad),
        _ => (0.0, TAU),
    }
}

/// The directions within the ranges, covered as finely as their share of the sphere allows.
fn cover(coarse: &Sphere, stand: &Stand, gimbals: &Gimbals) -> Allowed {
    let marks = marked(coarse, SPACING, stand, gimbals);
    let count = marks.iter().filter(|m| **m).count();
    if count == marks.len() {
        return Allowed::Everything;
    }
    let share = count as f64 / marks.len() as f64;
    let spacing = (SPACING * share.sqrt()).max(FINEST);
    let fine = Sphere::new(spacing);
    let marks = marked(&fine, spacing, stand, gimbals);
    let kept = fine.directions.iter().zip(marks).filter(|(_, m)| *m);
    let in_platform = |d: &Vector3<f64>| match stand.frame() {
        None => *d,
        Some(frame) => frame.right.transpose() * d,
    };
    Allowed::Cover {
        directions: kept.map(|(d, _)| in_platform(d)).collect(),
        radius: fine.radius,
    }
}

/// The grid directions within reach of an allowed one, in the axes of the paper's sequence (R g^c of
/// [`Stand`]). On the paper's stand g = −Mz(γ)ᵀ My(β)ᵀ Mx(α)ᵀ e_y: γ turns about the rings' axis, so
/// each (α, β) gives an arc; on any other stand so do α and β of the stand, by its sense of γ.
fn marked(sphere: &Sphere, spacing: f64, stand: &Stand, gimbals: &Gimbals) -> Vec<bool> {
    let [alpha, beta, gamma] = gimbals.ranges;
    let area = turned(alpha).1 * turned(beta).1;
    let step = (SAMPLE * spacing).max((area / MOST_SAMPLES).sqrt());
    let (alphas, half_alpha) = samples(alpha, step);
    let (betas, half_beta) = samples(beta, step);
    let (from, length) = turned(gamma);
    let from = match stand.frame() {
        Some(frame) if frame.gamma < 0.0 => -(from + length),
        _ => from,
    };
    let reach = half_alpha + half_beta + sphere.radius + 1e-9;
    let mut marks = vec![false; sphere.directions.len()];
    for &alpha in &alphas {
        for &beta in &betas {
            let g = stand.gravity_before_gamma(alpha, beta);
            let colatitude = libm::acos(g.z.clamp(-1.0, 1.0));
            let azimuth = libm::atan2(g.y, g.x);
            sphere.mark(&mut marks, colatitude, azimuth + from, length, reach);
        }
        if marks.iter().all(|m| *m) {
            break;
        }
    }
    marks
}

/// The attitudes of an index table of `step` degrees within the ranges; none when there are too
/// many, or none.
fn table(stand: &Stand, gimbals: &Gimbals, step: f64) -> Option<Vec<Attitude>> {
    let axes: Vec<Vec<f64>> = gimbals
        .ranges
        .iter()
        .map(|range| settings(*range, step))
        .collect();
    let count = axes
        .iter()
        .map(Vec::len)
        .try_fold(1_usize, usize::checked_mul)?;
    if count == 0 || count > LARGEST_TABLE {
        return None;
    }
    let mut positions = Vec::with_capacity(count);
    for &alpha in &axes[0] {
        for &beta in &axes[1] {
            for &gamma in &axes[2] {
                positions.push(Position::from_deg(alpha, beta, gamma));
            }
        }
    }
    positions.sort_by_cached_key(|p| stand.attitude_key(*p));
    positions.dedup_by_key(|p| stand.attitude_key(*p));
    Some(positions.into_iter().map(|p| stand.attitude(p)).collect())
}

/// Multiples of the step within a range, degrees; on an unlimited axis those of one turn. One
/// whose step does not divide the turn has more of them than a table can list.
fn settings(range: Option<GimbalRange>, step: f64) -> Vec<f64> {
    let ends = match range {
        Some(r) => r.ends(),
        None => {
            let turn = NanoDegrees::nearest((360.0 / step).round() * step);
            if turn != NanoDegrees::TURN {
                return vec![0.0; LARGEST_TABLE + 1];
            }
            NanoDegrees::default()..=turn - NanoDegrees::new(1)
        }
    };
    let within = multiples(step, ends).take(LARGEST_TABLE + 1);
    within.map(|k| decimal(f64::from(k) * step)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::PlatformConfig;
    use nalgebra::Matrix3;

    fn directions(change: impl FnOnce(&mut PlatformConfig)) -> Directions {
        let mut config = PlatformConfig::default();
        change(&mut config);
        let platform = config.check().unwrap();
        Directions::new(&platform)
    }

    fn is_everything(directions: &Directions) -> bool {
        matches!(directions.allowed, Allowed::Everything)
    }

    /// A deterministic spread of numbers in 0..1.
    fn fraction(i: usize, k: f64) -> f64 {
        (0.5 + i as f64 * k).fract()
    }

    #[test]
    fn every_direction_is_near_the_grid() {
        for spacing in [0.3, 0.05] {
            let sphere = Sphere::new(spacing);
            assert!(sphere.radius < spacing);
            for i in 0..2000 {
                let z = 2.0 * fraction(i, 0.618_033_988_7) - 1.0;
                let d = direction(z.acos(), TAU * fraction(i, 0.754_877_666));
                let nearest = sphere.directions.iter().map(|g| g.dot(&d));
                let cosine = nearest.fold(-1.0, f64::max);
                assert!(cosine.min(1.0).acos() <= sphere.radius + 1e-7);
            }
        }
    }

    #[test]
    fn a_cover_holds_every_allowed_direction_and_leaves_the_far_ones_out() {
        let limited = directions(|c| {
            c.gimbals.alpha_deg = Some([-30.0, 50.0]);
            c.gimbals.beta_deg = Some([-20.0, 60.0]);
            c.gimbals.gamma_deg = Some([-40.0, 100.0]);
        });
        let Allowed::Cover { directions, radius } = &limited.allowed else {
            panic!("a limited stand is a cover");
        };
        for i in 0..1000 {
            let g = Position::from_deg(
                -30.0 + 80.0 * fraction(i, 0.819_172_513),
                -20.0 + 80.0 * fraction(i, 0.671_043_607),
                -40.0 + 140.0 * fraction(i, 0.549_700_478),
            )
            .attitude()
            .gravity_c();
            let nearest = directions.iter().map(|d| d.dot(&g)).fold(-1.0, f64::max);
            assert!(nearest.min(1.0).acos() <= radius + 1e-7);
        }
        // The opposite of a level platform's gravity is out of reach.
        assert!(directions.iter().all(|d| d.y < 0.9));
    }

    #[test]
    fn free_gimbals_and_a_limited_middle_one_allow_everything() {
        assert!(is_everything(&directions(|_| {})));
        let middle = directions(|c| c.gimbals.beta_deg = Some([-60.0, 60.0]));
        assert!(is_everything(&middle));
        let outer = directions(|c| c.gimbals.alpha_deg = Some([-60.0, 60.0]));
        assert!(!is_everything(&outer));
    }

    #[test]
    fn a_table_is_listed_only_when_moves_take_no_time() {
        let quarter = directions(|c| c.gimbals.step_deg = Some(90.0));
        assert!(matches!(&quarter.allowed, Allowed::Table(a) if a.len() == 24));
        let slewing = directions(|c| {
            c.gimbals.step_deg = Some(90.0);
            c.motion.slew_rate_deg_per_s = Some(1.0.into());
        });
        assert!(is_everything(&slewing));
        // 7° does not divide the turn: all multiples together fill it.
        let uneven = directions(|c| c.gimbals.step_deg = Some(7.0));
        assert!(is_everything(&uneven));
    }

    /// On a coarse grid, whose gaps and bands are wide: ranges at the rings' poles, across ±180°,
    /// narrow and wide ones, all the way into their corners.
    #[test]
    fn the_marks_hold_every_allowed_direction_of_any_stand() {
        let sphere = Sphere::new(0.2);
        let stands = [
            (["-x", "-y", "-z"], 0.0, [0.0; 2]),
            (["-x", "-y", "-z"], 20.0, [15.0, -40.0]),
            (["+y", "+x", "-z"], -70.0, [0.0; 2]),
            (["+z", "-x", "+z"], 110.0, [-5.0, 8.0]),
            (["+x", "+z", "-x"], 0.0, [0.0, 90.0]),
            (["-z", "+y", "+x"], 0.0, [0.0; 2]),
        ];
        for (at, ranges) in [
            [[-30.0, 50.0], [-20.0, 60.0], [-40.0, 100.0]],
            [[80.0, 100.0], [-10.0, 10.0], [-180.0, -150.0]],
            [[-100.0, -60.0], [70.0, 110.0], [150.0, 210.0]],
            [[0.0, 1.0], [0.0, 1.0], [0.0, 1.0]],
            [[-5.0, 5.0], [-170.0, 170.0], [0.0, 20.0]],
            [[100.0, 300.0], [-3.0, 3.0], [-90.0, -60.0]],
        ]
        .into_iter()
        .flat_map(|ranges| stands.map(|stand| (stand, ranges)))
        {
            let (axes, heading_deg, tilt_deg) = at;
            let mut config = PlatformConfig::default();
            config.gimbals.axes = Some(axes.map(str::to_owned));
            config.stand.heading_deg = Some(heading_deg);
            config.stand.tilt_deg = Some(tilt_deg);
            config.gimbals.alpha_deg = Some(ranges[0]);
            config.gimbals.beta_deg = Some(ranges[1]);
            config.gimbals.gamma_deg = Some(ranges[2]);
            let platform = config.check().unwrap();
            let marks = marked(&sphere, 0.2, platform.stand(), platform.gimbals());
            let stand = platform.stand();
            let right = stand.frame().map_or_else(Matrix3::identity, |f| f.right);
            let grid = sphere.directions.iter().zip(&marks).filter(|(_, m)| **m);
            let kept: Vec<Vector3<f64>> = grid.map(|(d, _)| right.transpose() * d).collect();
            let mut allowed = Vec::new();
            for i in 0..4000 {
                // Beyond both ends and cut: a good part lies in faces, edges and corners.
                let angle = |axis: usize, k: f64| {
                    let [low, high] = ranges[axis];
                    let part = (1.5 * fraction(i, k) - 0.25).clamp(0.0, 1.0);
                    low + (high - low) * part
                };
                let [a, b] = [angle(0, 0.819_172_513), angle(1, 0.671_043_607)];
                let c = angle(2, 0.549_700_478);
                let p = Position::from_deg(a, b, c);
                allowed.push(stand.attitude(p).gravity_c());
            }
            for g in &allowed {
                let nearest = kept.iter().map(|d| d.dot(g)).fold(-1.0, f64::max);
                assert!(
                    nearest.min(1.0).acos() <= sphere.radius + 1e-7,
                    "{at:?} {ranges:?}"
                );
            }
            // What is marked is not far from something allowed: the grid's radius, the samples'
            // spacing and a ring's step at most.
            for d in &kept {
                let nearest = allowed.iter().map(|g| d.dot(g)).fold(-1.0, f64::max);
                assert!(nearest.min(1.0).acos() <= 0.75, "{ranges:?} {d}");
            }
        }
    }

    #[test]
    fn samples_leave_no_angle_of_a_range_uncovered() {
        let deg = f64::to_radians;
        let range = |low: f64, high: f64| {
            let (low_rad, high_rad) = (deg(low), deg(high));
            Some(GimbalRange { low_rad, high_rad })
        };
        for (range, low, width) in [
            (range(-70.0, 35.0), deg(-70.0), deg(105.0)),
            (range(10.0, 10.0), deg(10.0), 0.0),
            (range(-400.0, 400.0), 0.0, TAU),
            (range(-180.0, 180.0), 0.0, TAU),
            (None, 0.0, TAU),
        ] {
            let (values, half) = samples(range, 0.1);
            assert!(half <= 0.05);
            for i in 0..=500 {
                let angle = low + width * f64::from(i) / 500.0;
                let gap = values.iter().map(|v| (v - angle).abs());
                assert!(gap.fold(f64::INFINITY, f64::min) <= half + 1e-12);
            }
            let inside = |v: &f64| *v >= low && *v <= low + width;
            assert!(values.iter().all(inside) && values.len() as f64 <= width / 0.1 + 1.0);
        }
    }

    #[test]
    fn a_table_has_the_multiples_of_its_step_within_the_ranges() {
        let of = |range: Option<[f64; 2]>, step: f64| {
            let range = range.map(|[low, high]| GimbalRange {
                low_rad: low.to_radians(),
                high_rad: high.to_radians(),
            });
            settings(range, step)
        };
        assert_eq!(
            of(Some([-20.0, 55.0]), 15.0),
            [-15.0, 0.0, 15.0, 30.0, 45.0]
        );
        assert_eq!(
            of(Some([-30.0, 45.0]), 15.0),
            [-30.0, -15.0, 0.0, 15.0, 30.0, 45.0]
        );
        assert_eq!(of(Some([170.0, 200.0]), 10.0), [170.0, 180.0, 190.0, 200.0]);
        assert!(of(Some([16.0, 29.0]), 15.0).is_empty());
        assert_eq!(of(None, 90.0), [0.0, 90.0, 180.0, 270.0]);
        assert_eq!(of(None, 50.0).len(), LARGEST_TABLE + 1);
        assert_eq!(of(Some([0.0, 360.0]), 0.001).len(), LARGEST_TABLE + 1);
        // Within limits: 3 · 2 · 2 positions, all of them different attitudes.
        let stand = directions(|c| {
            c.gimbals.step_deg = Some(15.0);
            c.gimbals.alpha_deg = Some([-15.0, 20.0]);
            c.gimbals.beta_deg = Some([0.0, 15.0]);
            c.gimbals.gamma_deg = Some([50.0, 75.0]);
        });
        let Allowed::Table(attitudes) = &stand.allowed else {
            panic!("a table is listed");
        };
        assert_eq!(attitudes.len(), 12);
        for attitude in attitudes {
            let deg = attitude.position().to_deg();
            assert!(
                deg.iter()
                    .all(|v| (v / 15.0 - (v / 15.0).round()).abs() < 1e-9)
            );
            assert!(deg[0] > -16.0 && deg[0] < 16.0 && deg[2] > 59.0 && deg[2] < 76.0);
        }
    }
}
