//! Positions by which an engineer sees on the stand that angles are meant the same way: what the
//! accelerometers should read in each.

use super::Platform;
use crate::attitude::Position;

/// A position and what perfect accelerometers along the platform's axes read there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CheckPosition {
    /// The position.
    pub position: Position,
    /// Which gimbal's sense it shows (0 outer); none: it is where the others start from.
    pub gimbal: Option<usize>,
    /// Specific force f^c at rest, g.
    pub specific_force_g: [f64; 3],
}

/// A reading that differs by less, in g, could be taken for the other one on the stand.
const SEEN_G: f64 = 0.1;

/// Angles that are tried, degrees, the first that a gimbal allows; and those of a second gimbal.
const ANGLES_DEG: [f64; 15] = [
    30.0, 45.0, 60.0, 20.0, 15.0, 90.0, -30.0, -45.0, -60.0, -20.0, -15.0, -90.0, 10.0, -10.0, 5.0,
];

impl Platform {
    /// A position to start from, and for each gimbal one that shows its sense: the gimbal turned by 30° or
    /// so, and a second one too where the first alone turns about the vertical. A gimbal whose sense
    /// gravity does not show within its range has none.
    pub fn check_positions(&self) -> Vec<CheckPosition> {
        let start = [0, 1, 2].map(|axis| self.start_of_check(axis));
        let mut all = vec![self.checked(start, None)];
        all.extend((0..3).filter_map(|gimbal| self.check_of(start, gimbal)));
        all
    }

    fn checked(&self, [alpha, beta, gamma]: [f64; 3], gimbal: Option<usize>) -> CheckPosition {
        let position = Position::from_deg(alpha, beta, gamma);
        let force = self.stand.attitude(position).specific_force_c();
        CheckPosition {
            position,
            gimbal,
            specific_force_g: force.map(|f| f + 0.0),
        }
    }

    /// Zero, or what of the gimbal's range is nearest to it.
    fn start_of_check(&self, axis: usize) -> f64 {
        if self.gimbals.refusal(axis, 0.0).is_none() {
            return 0.0;
        }
        let ends = self.gimbals.ranges[axis].map(|r| r.ends().into_inner());
        let ends = ends.map_or([0.0; 2], |(low, high)| [low.deg(), high.deg()]);
        let settings = self.gimbals.settings_deg(axis).into_iter().flatten();
        let nearest = |best: f64, deg: f64| if deg.abs() < best.abs() { deg } else { best };
        settings
            .reduce(nearest)
            .unwrap_or(nearest(ends[0], ends[1]))
    }

    /// What a gimbal can be set to beside `start`, degrees, angles that are easily set first; on an index
    /// table that has none of them what is nearest to a turn of 30°.
    fn angles_of_check(&self, axis: usize, start: f64) -> Vec<f64> {
        let allowed = |deg: &f64| self.gimbals.refusal(axis, *deg).is_none();
        let angles = ANGLES_DEG.into_iter().map(|deg| start + deg);
        let mut angles: Vec<f64> = angles.filter(allowed).collect();
        if let (true, Some(settings)) = (angles.is_empty(), self.gimbals.settings_deg(axis)) {
            angles = settings.filter(|deg| *deg != start).collect();
            let off = |deg: &f64| ((deg - start).abs() - ANGLES_DEG[0]).abs();
            angles.sort_by(|a, b| off(a).total_cmp(&off(b)));
        }
        angles
    }

    fn check_of(&self, start: [f64; 3], gimbal: usize) -> Option<CheckPosition> {
        let allowed = |axis: usize| self.angles_of_check(axis, start[axis]).into_iter();
        let shows = |from: [f64; 3], deg: f64| {
            let at = |deg: f64| {
                let mut angles = from;
                angles[gimbal] = deg;
                self.checked(angles, Some(gimbal))
            };
            let [here, before, opposite] = [deg, start[gimbal], 2.0 * start[gimbal] - deg].map(at);
            let differs = |other: &CheckPosition| {
                let pairs = here.specific_force_g.iter().zip(other.specific_force_g);
                pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) > SEEN_G
            };
            (differs(&before) && differs(&opposite)).then_some(here)
        };
        let alone = allowed(gimbal).find_map(|deg| shows(start, deg));
        alone.or_else(|| {
            // The nearest neighbours first.
            let others = [1, 2, 0].map(|step| (gimbal + step) % 3);
            others.into_iter().take(2).find_map(|other| {
                allowed(other).find_map(|second| {
                    let mut from = start;
                    from[other] = second;
                    allowed(gimbal).find_map(|deg| shows(from, deg))
                })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::SignedAxis;
    use crate::platform::PlatformConfig;
    use crate::testing::platform;

    fn shown(platform: &Platform) -> Vec<([f64; 3], [f64; 3])> {
        let all = platform.check_positions().into_iter();
        all.map(|c| (c.position.degrees(), c.specific_force_g))
            .collect()
    }

    #[test]
    fn the_papers_check_positions() {
        let (s, c) = (0.5, 0.75_f64.sqrt());
        let expected = [
            ([0.0; 3], [0.0, 1.0, 0.0]),
            ([30.0, 0.0, 0.0], [0.0, c, s]),
            // β alone turns about the vertical, and beside γ too.
            ([30.0, 30.0, 0.0], [s * s, c, s * c]),
            ([0.0, 0.0, 30.0], [-s, c, 0.0]),
        ];
        let found = shown(&platform(|_| {}));
        assert_eq!(found.len(), 4);
        for ((at, f), (expected_at, expected_f)) in found.iter().zip(expected) {
            assert_eq!(*at, expected_at);
            let apart = f.iter().zip(expected_f).map(|(a, b)| (a - b).abs());
            assert!(apart.fold(0.0, f64::max) < 1e-15, "{f:?}");
        }
    }

    /// On every stand: a position with the sense of one gimbal exchanged reads something else.
    #[test]
    fn a_wrong_sense_is_seen() {
        for axes in [
            ["-x", "-y", "-z"],
            ["+y", "-z", "+x"],
            ["+z", "-x", "+z"],
            ["-y", "+z", "+y"],
        ] {
            let with = |axes: [&str; 3], step: Option<f64>| {
                platform(|c: &mut PlatformConfig| {
                    c.gimbals.axes = Some(axes.map(str::to_owned));
                    c.gimbals.step_deg = step;
                    c.stand.heading_deg = Some(40.0);
                    c.stand.tilt_deg = Some([3.0, -8.0]);
                })
            };
            for step in [None, Some(45.0), Some(7.0)] {
                let right = with(axes, step);
                let checks = right.check_positions();
                assert_eq!(checks.len(), 4, "{axes:?} {step:?}");
                for check in &checks[1..] {
                    let gimbal = check.gimbal.unwrap();
                    let mut other = axes;
                    other[gimbal] = SignedAxis::NAMES
                        .into_iter()
                        .find(|n| n[1..] == axes[gimbal][1..] && n[..1] != axes[gimbal][..1])
                        .unwrap();
                    let wrong = with(other, step).stand.attitude(check.position);
                    let wrong = wrong.specific_force_c();
                    let apart = check.specific_force_g.iter().zip(wrong);
                    let most = apart.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    assert!(most > SEEN_G, "{axes:?} {check:?}");
                }
            }
        }
    }

    #[test]
    fn check_positions_are_within_reach() {
        let limited = platform(|c| {
            c.gimbals.alpha_deg = Some([40.0, 80.0]);
            c.gimbals.beta_deg = Some([-200.0, -170.0]);
            c.gimbals.gamma_deg = Some([12.0, 12.0]);
        });
        let checks = limited.check_positions();
        assert_eq!(checks[0].position.degrees(), [40.0, -170.0, 12.0]);
        assert_eq!(checks.len(), 3);
        for check in checks {
            for (axis, deg) in check.position.degrees().into_iter().enumerate() {
                assert_eq!(limited.gimbals.refusal(axis, deg), None, "{check:?}");
            }
        }
    }
}
