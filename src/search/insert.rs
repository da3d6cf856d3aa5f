//! Where one more position would pay: the exact directional derivative over the attitude set.
//!
//! At every gap between positions the derivative of the merit with respect to time spent there
//! is linear in the drift matrix A(C) of the attitude ([`Insertion`]), so the whole attitude set
//! is searched for the price of 36 products an attitude. What counts is the gain over the time a
//! dwell takes, less what that time, the additional moves and the settle are worth elsewhere.

use std::f64::consts::{SQRT_2, TAU};

use nalgebra::{Quaternion, UnitQuaternion};

use super::context::Context;
use super::cost::{detour_s, price_of_time};
use super::index_table::IndexTable;
use super::plan::Plan;
use super::rated::{Refined, rate};
use super::reordering::with_quickest_positions;
use crate::attitude::{Attitude, Position};
use crate::covariance::fast::cuts::{Cuts, Insertion};
use crate::covariance::{CoefficientCovariance, TickRule};
use crate::criterion::Smoothing;
use crate::drift::drift_matrix;
use crate::motion::equivalent_positions;
use crate::platform::Platform;

/// Attitudes tried at every gap.
const ATTITUDES: usize = 600;
/// The best attitudes of a gap that are rated in full.
const PER_GAP: usize = 2;
/// A new position's first dwell, as a share of the mean one.
const SHARE: f64 = 0.5;

/// The `most` best plans with one more position than `plan`, best first; where no more are
/// allowed, with another position instead of the one that pays least.
pub(super) fn insertions(
    context: Context<'_>,
    smoothing: Smoothing,
    plan: &Plan,
    most: usize,
) -> Vec<Plan> {
    let base = match plan.angles.len() < context.problem.max_positions {
        true => Some(plan.clone()),
        false => without_least(context, smoothing, plan),
    };
    let Some((base, gaps)) = base.and_then(|base| {
        let gaps = Gaps::of(context, smoothing, &base)?;
        Some((base, gaps))
    }) else {
        return Vec::new();
    };
    let attitudes = attitudes(context.evaluator.test().platform());
    let mut rated: Vec<Refined> = gaps
        .promising(context, &base, &attitudes)
        .into_iter()
        .map(|(gap, position)| {
            let mut longer = base.clone();
            longer.insert(gap, position.to_array(), gaps.dwell_s);
            longer
        })
        .filter(|longer| context.problem.admits(longer))
        .take(4 * most)
        .filter_map(|longer| {
            rate(
                context,
                &with_quickest_positions(context, longer),
                smoothing,
            )
        })
        .collect();
    rated.sort_by(|a, b| a.merit.total_cmp(&b.merit));
    rated.into_iter().take(most).map(|r| r.plan).collect()
}

/// The plan without the position that is missed least.
fn without_least(context: Context<'_>, smoothing: Smoothing, plan: &Plan) -> Option<Plan> {
    if plan.angles.len() < 2 {
        return None;
    }
    (0..plan.angles.len())
        .filter(|k| !plan.is_held(*k))
        .filter_map(|k| rate(context, &plan.without(k), smoothing))
        .reduce(Refined::better)
        .map(|r| r.plan)
}

/// The gaps of a plan, and what time is worth.
struct Gaps {
    insertions: Vec<Insertion>,
    /// What a second more for the whole test changes the merit by; negative.
    price: f64,
    /// First dwell of a new position, s.
    dwell_s: f64,
}

impl Gaps {
    fn of(context: Context<'_>, smoothing: Smoothing, plan: &Plan) -> Option<Self> {
        let evaluator = context.evaluator;
        let (test, model) = (evaluator.test(), evaluator.model());
        let timeline = plan.timeline(test);
        let cuts = Cuts::new(model, &timeline, TickRule::Relaxed);
        let merit = |p: &dyn CoefficientCovariance| evaluator.estimate_and_slope(p, smoothing);
        context.work.count_evaluations(2);
        let held = timeline.positions();
        Some(Self {
            insertions: (held.start..=held.end)
                .map(|leg| cuts.insertion(leg, merit).ok())
                .collect::<Option<_>>()?,
            price: price_of_time(context, smoothing, plan)?,
            dwell_s: (SHARE * timeline.total_time_s() / plan.angles.len() as f64)
                .max(test.platform().shortest_dwell_s()),
        })
    }

    /// Gap and position, by what the derivative promises, best first.
    fn promising(
        &self,
        context: Context<'_>,
        plan: &Plan,
        attitudes: &[Position],
    ) -> Vec<(usize, Position)> {
        let test = context.evaluator.test();
        let stand = test.platform().stand();
        let drift: Vec<_> = attitudes
            .iter()
            .map(|p| drift_matrix(&stand.attitude(*p)))
            .collect();
        let mut promising: Vec<(f64, usize, Position)> = Vec::new();
        for (gap, insertion) in self.insertions.iter().enumerate() {
            let mut here: Vec<(f64, usize, Position)> = attitudes
                .iter()
                .zip(&drift)
                .map(|(position, a)| {
                    let more_s = self.dwell_s + detour_s(test, plan, gap, *position);
                    let gain = insertion.at(a) * self.dwell_s - self.price * more_s;
                    (gain, gap, *position)
                })
                .collect();
            here.sort_by(|a, b| a.0.total_cmp(&b.0));
            promising.extend(here.into_iter().take(PER_GAP));
        }
        promising.sort_by(|a, b| a.0.total_cmp(&b.0));
        promising.into_iter().map(|(_, gap, p)| (gap, p)).collect()
    }
}

/// Positions spread over the attitudes that the platform can take.
fn attitudes(platform: &Platform) -> Vec<Position> {
    if let Some(table) = IndexTable::new(platform) {
        return table.sample(ATTITUDES);
    }
    (0..ATTITUDES)
        .filter_map(|i| {
            let position = platform.stand().position(&spread_rotation(i, ATTITUDES));
            equivalent_positions(platform, position).into_iter().next()
        })
        .collect()
}

/// The i-th of n well-spread attitudes: super-Fibonacci spirals (Alexa, "Super-Fibonacci
/// Spirals: Fast, Low-Discrepancy Sampling of SO(3)", CVPR 2022).
fn spread_rotation(i: usize, n: usize) -> Attitude {
    /// Positive root of ψ⁴ = ψ + 4.
    const PSI: f64 = 1.533_751_168_755_204_3;
    let s = i as f64 + 0.5;
    let t = s / n as f64;
    let (r, big_r) = (t.sqrt(), (1.0 - t).sqrt());
    let (sin_a, cos_a) = libm::sincos(TAU * s / SQRT_2);
    let (sin_b, cos_b) = libm::sincos(TAU * s / PSI);
    let quaternion = Quaternion::new(r * sin_a, r * cos_a, big_r * sin_b, big_r * cos_b);
    Attitude::from_rotation(UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_attitudes_are_spread_evenly() {
        let all: Vec<_> = (0..ATTITUDES)
            .map(|i| *spread_rotation(i, ATTITUDES).matrix())
            .collect();
        // Any attitude has one of them within 30°: SO(3) holds about 600 balls of 15°.
        for angles in [[10.0, 20.0, 30.0], [-120.0, 80.0, 5.0], [90.0, 0.0, 180.0]] {
            let here = *Position::from_deg(angles[0], angles[1], angles[2])
                .attitude()
                .matrix();
            let cosine = all
                .iter()
                .map(|m| 0.5 * ((m.transpose() * here).trace() - 1.0))
                .fold(-1.0, f64::max);
            assert!(cosine > 30.0_f64.to_radians().cos(), "{angles:?}: {cosine}");
        }
        // Their mean is that of the uniform distribution: zero.
        let mean = all.iter().sum::<nalgebra::Matrix3<f64>>() / ATTITUDES as f64;
        assert!(mean.amax() < 0.02, "{mean}");
    }
}
