//! How far a move is at a time: the trapezoid of its rate.
//!
//! With x the share of the duration and ρ the share of it that speeding up takes, and again slowing
//! down, the share s of the way is
//!
//! ```text
//! x²/(2ρ(1 − ρ)) up to ρ,   (x − ρ/2)/(1 − ρ) up to 1 − ρ,   1 − (1 − x)²/(2ρ(1 − ρ)) after it,
//! ```
//!
//! and ds/dx rises from 0 to 1/(1 − ρ) and falls to 0 again. Where ρ = 0, s = x.

use super::Move;

/// The share of the way at the share `x` of the duration.
fn done(ramp: f64, x: f64) -> f64 {
    // Without it a time that rounding has put before the start or after the end would be on a ramp.
    if ramp == 0.0 {
        x
    } else if x < ramp {
        x * x / (2.0 * ramp * (1.0 - ramp))
    } else if x > 1.0 - ramp {
        1.0 - (1.0 - x) * (1.0 - x) / (2.0 * ramp * (1.0 - ramp))
    } else {
        (x - 0.5 * ramp) / (1.0 - ramp)
    }
}

/// ds/dx there.
fn speed(ramp: f64, x: f64) -> f64 {
    if ramp == 0.0 {
        1.0
    } else if x < ramp {
        x / (ramp * (1.0 - ramp))
    } else if x > 1.0 - ramp {
        (1.0 - x) / (ramp * (1.0 - ramp))
    } else {
        1.0 / (1.0 - ramp)
    }
}

impl Move {
    /// The share of the way that is done at the share `fraction` 0..1 of the duration.
    pub fn done_at(&self, fraction: f64) -> f64 {
        done(self.ramp, fraction)
    }

    /// Its derivative there: 1 where the gimbals turn at one rate all the time.
    pub fn speed_at(&self, fraction: f64) -> f64 {
        speed(self.ramp, fraction)
    }

    /// The share of the duration in which the gimbals speed up, and again that in which they slow
    /// down; 0: they turn at one rate.
    pub fn ramp(&self) -> f64 {
        self.ramp
    }

    /// Where the rate has its corners inside the move, shares of its duration.
    fn corners(&self) -> impl Iterator<Item = f64> {
        let second = (self.ramp < 0.5).then_some(1.0 - self.ramp);
        let both = [Some(self.ramp).filter(|x| *x > 0.0), second];
        both.into_iter().flatten().filter(|x| *x < 1.0)
    }

    /// The same, s from its start.
    pub(crate) fn corners_s(&self) -> [f64; 2] {
        [self.ramp, 1.0 - self.ramp].map(|x| x * self.duration_s)
    }

    /// Cuts the interval from `start` of `length` where the rate has a corner, in the unit in which the
    /// move is `whole` long: what is integrated over each part is smooth.
    pub(crate) fn smooth_parts(
        &self,
        (start, length): (f64, f64),
        whole: f64,
    ) -> impl Iterator<Item = (f64, f64)> {
        let end = start + length;
        let inside = self.corners().map(move |x| x * whole);
        let inside = inside.filter(move |at| *at > start && *at < end);
        let mut from = start;
        inside.chain([end]).map(move |to| {
            let part = (
                from,
                if from == start && to == end {
                    length
                } else {
                    to - from
                },
            );
            from = to;
            part
        })
    }

    /// The greatest speed in an interval, in shares of the duration.
    pub(crate) fn greatest_speed(&self, (start, length): (f64, f64)) -> f64 {
        if self.ramp == 0.0 {
            return 1.0;
        }
        let nearest_to_half = 0.5_f64.clamp(start, start + length);
        self.speed_at(nearest_to_half)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_is_the_area_under_the_rate() {
        for ramp in [0.0, 0.02, 0.1, 0.3, 0.5] {
            assert_eq!(done(ramp, 0.0), 0.0);
            assert!((done(ramp, 1.0) - 1.0).abs() < 1e-15);
            // But for rounding.
            assert!(done(ramp, -1e-14).abs() < 1e-13 && speed(ramp, -1e-14).is_finite());
            assert!((done(ramp, 1.0 + 1e-14) - 1.0).abs() < 1e-13);
            assert!(speed(ramp, 1.0 + 1e-14).is_finite());
            const STEPS: usize = 20_000;
            let mut area = 0.0;
            for k in 0..STEPS {
                let x = k as f64 / STEPS as f64;
                assert!((done(ramp, x) - area).abs() < 1e-7, "{ramp}, {x}");
                let next = (k + 1) as f64 / STEPS as f64;
                area += 0.5 * (speed(ramp, x) + speed(ramp, next)) / STEPS as f64;
            }
        }
    }

    #[test]
    fn parts_end_at_the_corners() {
        let mut m = Move::new([0.0; 3], [1.0, 0.0, 0.0], 100.0, false);
        let parts = |m: &Move, start: f64, length: f64| -> Vec<(f64, f64)> {
            m.smooth_parts((start, length), 100.0).collect()
        };
        assert_eq!(parts(&m, 3.0, 50.0), [(3.0, 50.0)]);
        m.ramp = 0.25;
        assert_eq!(
            parts(&m, 0.0, 100.0),
            [(0.0, 25.0), (25.0, 50.0), (75.0, 25.0)]
        );
        assert_eq!(parts(&m, 10.0, 20.0), [(10.0, 15.0), (25.0, 5.0)]);
        assert_eq!(parts(&m, 25.0, 50.0), [(25.0, 50.0)]);
        m.ramp = 0.5;
        assert_eq!(parts(&m, 0.0, 100.0), [(0.0, 50.0), (50.0, 50.0)]);
        assert!((m.greatest_speed((0.0, 0.2)) - 0.8).abs() < 1e-12);
        assert!((m.greatest_speed((0.2, 0.8)) - 2.0).abs() < 1e-12);
    }
}
