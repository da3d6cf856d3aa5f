//! A move in the chain's numbers: where it is at a time, and the way back from there to its ends, its
//! duration and how its gimbals speed up.
//!
//! A stretch of a move lies where the gimbals speed up, turn at their rate or slow down
//! ([`crate::motion`] has the trapezoid that the rate is), so that the share s of the way that is done a
//! time τ after its start is a polynomial, s = w₀ + w₁ τ + w₂ τ². What its coefficients are, and how they
//! depend on the move, is worked out once for a stretch, in plain numbers ([`Turn::of_a_move`]).

use super::arithmetic::{Number, three};
use super::moves::attitude;
use super::square::{Entries, dot};
use crate::attitude::StandFrame;
use crate::motion::Move;
use crate::platform::SlewLimits;

/// A stretch of a move in the chain's numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Turn<N> {
    /// (α, β, γ) at the start of the move, rad.
    pub from: [N; 3],
    /// The change of the angles, rad.
    pub change: [N; 3],
    /// The move's duration, s; 1 where it takes none.
    pub duration_s: N,
    /// 1; where it takes no time, 0: only torquers see it.
    pub time: N,
    /// Whether none takes any time, in all lanes: then rates are all that counts.
    pub instant: bool,
    /// w₀, w₁ in 1/s, w₂ in 1/s².
    pub way: [N; 3],
    /// How they depend on the move; none: in all lanes the gimbals turn at one rate, s = t/T.
    pub ramp: Option<Ramp<N>>,
}

/// How w depends on a move whose gimbals speed up for a share ρ of its duration T, all times in it held.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ramp<N> {
    /// dw/dT, ρ(T) included.
    pub by_duration: [N; 3],
    /// ∂w/∂ρ.
    pub by_ramp: [N; 3],
    /// ∂ρ by the change of the angles, 1/rad.
    pub ramp_by_change: [N; 3],
}

impl Ramp<f64> {
    /// In a lane whose move has none, beside others.
    pub const NONE: Self = Self {
        by_duration: [0.0; 3],
        by_ramp: [0.0; 3],
        ramp_by_change: [0.0; 3],
    };
}

/// A time in a stretch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OnTheWay<N> {
    /// τ, s after its start.
    time_s: N,
    /// s.
    pub done: N,
    /// ds/dt, 1/s.
    pub rate: N,
}

impl<N: Number> OnTheWay<N> {
    /// A time τ after the start of a stretch of that `way`; w₂ = 0 where it has no ramp.
    #[inline(always)]
    pub fn new((way, has_ramp): (&[N; 3], bool), time_s: N) -> Self {
        if !has_ramp {
            return Self {
                time_s,
                done: time_s.mul_add(way[1], way[0]),
                rate: way[1],
            };
        }
        let bent = time_s * way[2];
        Self {
            time_s,
            done: time_s.mul_add(bent + way[1], way[0]),
            rate: bent + bent + way[1],
        }
    }
}

/// Adjoints of a move.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TurnAdjoint<N> {
    /// With respect to the angles at its start.
    pub from: [N; 3],
    /// With respect to the change of the angles.
    pub change: [N; 3],
    /// With respect to its duration, all times in it held.
    pub duration: N,
    /// With respect to w.
    way: [N; 3],
}

impl<N: Number> TurnAdjoint<N> {
    /// None.
    #[inline(always)]
    pub fn nothing(zero: N) -> Self {
        Self {
            from: [zero; 3],
            change: [zero; 3],
            duration: zero,
            way: [zero; 3],
        }
    }

    /// Adds those of a time in it: of the angles there and, where the rates count, of them. `change` is the
    /// move's; w counts where it `has_ramp`.
    #[inline(always)]
    pub fn add(
        &mut self,
        (change, has_ramp): (&[N; 3], bool),
        at: &OnTheWay<N>,
        angles: &[N; 3],
        rates: Option<&[N; 3]>,
    ) {
        for i in 0..3 {
            self.from[i] = self.from[i] + angles[i];
            self.change[i] = at.done.mul_add(angles[i], self.change[i]);
            if let Some(rates) = rates {
                self.change[i] = rates[i].mul_add(at.rate, self.change[i]);
            }
        }
        if !has_ramp {
            return;
        }
        let mut by_time = dot(change, angles);
        self.way[0] = self.way[0] + by_time;
        by_time = by_time * at.time_s;
        if let Some(rates) = rates {
            let of_rate = dot(change, rates);
            self.way[1] = self.way[1] + of_rate;
            self.way[2] = (of_rate + of_rate).mul_add(at.time_s, self.way[2]);
        }
        self.way[1] = self.way[1] + by_time;
        self.way[2] = by_time.mul_add(at.time_s, self.way[2]);
    }

    /// This and what `of` makes of `other`, before the duration is known; w where it `has_ramp`.
    #[inline(always)]
    pub fn plus<M: Number>(
        &self,
        other: &TurnAdjoint<M>,
        has_ramp: bool,
        of: impl Fn(M) -> N,
    ) -> Self {
        Self {
            from: three!(|i| self.from[i] + of(other.from[i])),
            change: three!(|i| self.change[i] + of(other.change[i])),
            duration: self.duration,
            way: match has_ramp {
                true => three!(|k| self.way[k] + of(other.way[k])),
                false => self.way,
            },
        }
    }

    /// All of them in the angles and the duration.
    #[inline(always)]
    pub fn gathered(mut self, turn: &Turn<N>) -> Self {
        match &turn.ramp {
            // s = t/T.
            None => self.duration = -(dot(&turn.change, &self.change) / turn.duration_s),
            Some(ramp) => {
                let of_ramp = dot(&self.way, &ramp.by_ramp);
                for i in 0..3 {
                    self.change[i] = of_ramp.mul_add(ramp.ramp_by_change[i], self.change[i]);
                }
                self.duration = dot(&self.way, &ramp.by_duration);
            }
        }
        self
    }
}

impl<N: Number> Turn<N> {
    /// How far it is a time τ after the start of the stretch.
    #[inline(always)]
    pub fn at(&self, time_s: N) -> OnTheWay<N> {
        OnTheWay::new((&self.way, self.ramp.is_some()), time_s)
    }

    /// C_c^n there, and (sin α, cos α).
    #[inline(always)]
    pub fn attitude_at(
        &self,
        stand: Option<&StandFrame>,
        at: &OnTheWay<N>,
    ) -> (Entries<N>, (N, N)) {
        let angles = three!(|i| at.done.mul_add(self.change[i], self.from[i]));
        attitude(stand, angles)
    }

    /// The angles' rates at the end of the move, rad/s.
    #[inline(always)]
    pub fn rates_at_end(&self) -> [N; 3] {
        match self.ramp.is_some() {
            false => three!(|i| self.change[i] / self.duration_s),
            // It has come to rest.
            true => [self.duration_s.constant(0.0); 3],
        }
    }

    /// Adjoints of the move from those of the angles at a place on the way.
    #[inline(always)]
    pub fn pull(&self, at: &OnTheWay<N>, angles: &[N; 3]) -> TurnAdjoint<N> {
        let mut adjoint = TurnAdjoint::nothing(self.duration_s.constant(0.0));
        adjoint.add((&self.change, self.ramp.is_some()), at, angles, None);
        adjoint.gathered(self)
    }
}

impl Turn<f64> {
    /// The stretch of a move that takes time which lies between two times, s from its start.
    pub fn of_a_move(m: &Move, slew: Option<&SlewLimits>, between_s: [f64; 2]) -> Self {
        let (way, ramp) = way_of_a_move(m, slew, between_s);
        Self {
            from: m.reduced_from(),
            change: m.change,
            duration_s: m.duration_s,
            time: 1.0,
            instant: false,
            way,
            ramp,
        }
    }
}

/// Its w, and how that depends on the move.
fn way_of_a_move(
    m: &Move,
    slew: Option<&SlewLimits>,
    [start_s, end_s]: [f64; 2],
) -> ([f64; 3], Option<Ramp<f64>>) {
    let (t, ramp) = (m.duration_s, m.ramp());
    let Some(slew) = slew.filter(|_| ramp > 0.0) else {
        return ([start_s / t, 1.0 / t, 0.0], None);
    };
    let [up_s, down_s] = m.corners_s();
    let middle_s = 0.5 * (start_s + end_s);
    // s̈ = ± k where the gimbals speed up or slow down, and its derivatives by T and ρ.
    let k = 1.0 / (ramp * (1.0 - ramp) * t * t);
    let (k_by_duration, k_by_ramp) = (
        -2.0 * k / t,
        -k * (1.0 - 2.0 * ramp) / (ramp * (1.0 - ramp)),
    );
    let (way, by_duration, by_ramp);
    if middle_s < up_s {
        // s = k t²/2.
        let of = |k: f64| [0.5 * start_s * start_s * k, start_s * k, 0.5 * k];
        (way, by_duration, by_ramp) = (of(k), of(k_by_duration), of(k_by_ramp));
    } else if middle_s > down_s {
        // s = 1 − k (T − t)²/2.
        let left_s = t - start_s;
        let of = |k: f64| [-0.5 * left_s * left_s * k, left_s * k, -0.5 * k];
        let [square, rate, bend] = of(k);
        way = [1.0 + square, rate, bend];
        let through_k = of(k_by_duration);
        by_duration = [through_k[0] - left_s * k, through_k[1] + k, through_k[2]];
        by_ramp = of(k_by_ramp);
    } else {
        // s = (t − ρT/2)/(T (1 − ρ)).
        let rate = 1.0 / (t * (1.0 - ramp));
        let since_s = start_s - 0.5 * ramp * t;
        way = [since_s * rate, rate, 0.0];
        by_duration = [-(0.5 * ramp + since_s / t) * rate, -rate / t, 0.0];
        let steeper = rate / (1.0 - ramp);
        by_ramp = [since_s * steeper - 0.5 * t * rate, steeper, 0.0];
    }
    let slopes = slew.ramp_slopes(&m.change, t);
    let ramp = Ramp {
        by_duration: three!(|i| by_ramp[i].mul_add(slopes.by_duration, by_duration[i])),
        by_ramp,
        ramp_by_change: slopes.by_change,
    };
    (way, Some(ramp))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::platform::PlatformConfig;

    fn slew() -> SlewLimits {
        let mut config = PlatformConfig::default();
        config.motion.slew_rate_deg_per_s = Some(1.0.into());
        config.motion.acceleration_deg_per_s2 = Some(0.02.into());
        config.check().unwrap().motion().slew.unwrap()
    }

    /// A move of these angles that takes `longer` times as long as it must.
    fn turning(from: [f64; 3], change: [f64; 3], duration_s: f64) -> Move {
        let m = Move::new(from, change, duration_s, false);
        m.with_ramp(slew().ramp(&change, duration_s))
    }

    fn turn(m: &Move, between_s: [f64; 2]) -> Turn<f64> {
        Turn::of_a_move(m, Some(&slew()), between_s)
    }

    /// Where a time of a move lies between its corners.
    fn part_of(m: &Move, at_s: f64) -> [f64; 2] {
        let [up_s, down_s] = m.corners_s();
        let ends = [0.0, up_s, down_s, m.duration_s];
        let k = (0..2).rfind(|k| at_s >= ends[*k + 1]).map_or(0, |k| k + 1);
        [ends[k], ends[k + 1]]
    }

    #[test]
    fn a_way_is_that_of_the_move() {
        let change = [1.1, -0.7, 0.5];
        let shortest_s = slew().shortest_s(&change);
        for longer in [1.0, 1.2, 5.0] {
            let m = turning([0.3, -0.4, 0.9], change, longer * shortest_s);
            for k in 0..=200 {
                let x = f64::from(k) / 200.0;
                let at_s = x * m.duration_s;
                let between = part_of(&m, at_s);
                let at = turn(&m, between).at(at_s - between[0]);
                assert!((at.done - m.done_at(x)).abs() < 1e-14, "{longer}, {x}");
                let speed = m.speed_at(x) / m.duration_s;
                assert!((at.rate / speed - 1.0).abs() < 1e-9 || x == 0.0 || x == 1.0);
            }
        }
    }

    #[test]
    fn adjoints_are_derivatives() {
        let change = [1.1, -0.7, 0.5];
        let shortest_s = slew().shortest_s(&change);
        // Shares of the duration, none of them at a corner of the rate.
        let times = [0.01, 0.07, 0.31, 0.52, 0.93, 0.99];
        for longer in [1.0, 1.07, 3.0] {
            let duration_s = longer * shortest_s;
            let times_s = times.map(|x| x * duration_s);
            let at = |m: &Move, at_s: f64| {
                let between = part_of(m, at_s);
                let turn = turn(m, between);
                let at = turn.at(at_s - between[0]);
                let angles = three!(|i| turn.from[i] + at.done * turn.change[i]);
                (turn, at, angles, three!(|i| turn.change[i] * at.rate))
            };
            let value = |m: &Move| {
                let of = times_s.iter().map(|at_s| {
                    let (_, _, angles, rates) = at(m, *at_s);
                    angles[0].sin() * angles[1] + angles[2].cos() + 30.0 * rates[0] * rates[2]
                });
                of.sum::<f64>()
            };
            // The quickest way is as quick as it can be; of another the duration is given.
            let quickest = longer == 1.0;
            let of = |v: &[f64; 7]| {
                let change = [v[3], v[4], v[5]];
                let duration_s = match quickest {
                    true => slew().shortest_s(&change),
                    false => v[6],
                };
                turning([v[0], v[1], v[2]], change, duration_s)
            };
            let x = [0.3, -0.4, 0.9, change[0], change[1], change[2], duration_s];
            let m = of(&x);
            let mut sum = TurnAdjoint::nothing(0.0);
            for at_s in times_s {
                let (turn, at, angles, rates) = at(&m, at_s);
                let of_angles = [
                    angles[0].cos() * angles[1],
                    angles[0].sin(),
                    -angles[2].sin(),
                ];
                let of_rates = [30.0 * rates[2], 0.0, 30.0 * rates[0]];
                let mut adjoint = TurnAdjoint::nothing(0.0);
                adjoint.add((&turn.change, true), &at, &of_angles, Some(&of_rates));
                let adjoint = adjoint.gathered(&turn);
                sum = sum.plus(&adjoint, false, |v| v);
                sum.duration += adjoint.duration;
            }
            let mut found = [sum.from, sum.change].concat();
            if quickest {
                let slope = slew().shortest_slope(&change);
                for (found, slope) in found[3..].iter_mut().zip(slope) {
                    *found += slope * sum.duration;
                }
            }
            found.push(sum.duration);
            for (k, found) in found.iter().enumerate().take(7 - usize::from(quickest)) {
                let step = if k == 6 { 1e-4 } else { 1e-6 };
                let shifted = |by: f64| {
                    let mut y = x;
                    y[k] += by;
                    value(&of(&y))
                };
                let slope = (shifted(step) - shifted(-step)) / (2.0 * step);
                assert!(
                    (slope - found).abs() < 1e-7,
                    "{longer}, {k}: {slope} {found}"
                );
            }
        }
    }
}
