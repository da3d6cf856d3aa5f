//! Index tables: positions only at multiples of a step.
//!
//! A continuous search is of little use on a coarse table, so the table has its own: a start is
//! snapped to the table, then improved by **coordinate exchange**: position by position, every
//! place of the table (on a fine table: its neighbours, and every angle of one axis at a time) is
//! tried in the true merit and the best is kept, until a whole sweep changes nothing. Between sweeps the
//! dwells are allocated and idle positions dropped, as for free angles.

use std::f64::consts::{PI, TAU};

use rayon::prelude::*;

use super::allocate::allocate;
use super::pipeline::{Candidate, Context, rate};
use super::refine::Refined;
use super::variables::Plan;
use crate::criterion::Smoothing;
use crate::platform::Platform;

/// Up to this many places of the table (45° and coarser) an exchange tries them all.
const ALL_PLACES: usize = 1_000;
/// Most angles of one axis that an exchange tries, around the present one.
const AXIS_ANGLES: usize = 720;
/// Sweeps of exchange per round.
const SWEEPS: usize = 12;
/// Rounds of exchange and allocation.
const ROUNDS: usize = 6;
/// An exchange has to gain this much.
const GAIN: f64 = 1e-10;

/// The angles each axis can be set to, rad.
#[derive(Debug, Clone)]
pub(super) struct Table {
    angles: [Vec<f64>; 3],
}

impl Table {
    /// The table of `platform`; none without an index step.
    pub fn new(platform: &Platform) -> Option<Self> {
        let step = platform.gimbals().step_rad?;
        let angles = platform.gimbals().ranges.map(|range| {
            // An unlimited axis counts each angle once, in (−180°, 180°].
            let (low, high) = match range {
                Some(r) => (r.low_rad, r.high_rad),
                None => (-PI + 1e-9, PI),
            };
            let first = (low / step - 1e-9).ceil() as i64;
            let last = (high / step + 1e-9).floor() as i64;
            (first..=last).map(|k| k as f64 * step).collect()
        });
        Some(Self { angles })
    }

    /// Whether any position can be set at all.
    pub fn is_empty(&self) -> bool {
        self.angles.iter().any(Vec::is_empty)
    }

    /// Whether an exchange can try every place.
    pub fn is_coarse(&self) -> bool {
        self.angles
            .iter()
            .try_fold(1_usize, |n, axis| n.checked_mul(axis.len()))
            .is_some_and(|n| n <= ALL_PLACES)
    }

    /// The plan with every angle at its nearest setting.
    fn snapped(&self, context: Context<'_>, plan: &Plan) -> Plan {
        let platform = context.evaluator.platform();
        Plan {
            angles: plan
                .angles
                .iter()
                .map(|a| self.snap(platform, *a))
                .collect(),
            dwell_s: plan.dwell_s.clone(),
        }
    }

    /// The nearest setting of each axis.
    fn snap(&self, platform: &Platform, angles: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let limited = platform.gimbals().ranges[axis].is_some();
            let distance = |a: f64| {
                let d = (a - angles[axis]).abs();
                if limited {
                    d
                } else {
                    (d - TAU * (d / TAU).round()).abs()
                }
            };
            let mut nearest = angles[axis];
            let mut least = f64::INFINITY;
            for &a in &self.angles[axis] {
                if distance(a) < least {
                    (nearest, least) = (a, distance(a));
                }
            }
            nearest
        })
    }

    /// The settings of an axis next to `angle`, itself included.
    fn neighbours(&self, axis: usize, angle: f64) -> Vec<f64> {
        let settings = &self.angles[axis];
        let here = settings.partition_point(|a| *a < angle - 1e-9);
        settings[here.saturating_sub(1)..(here + 2).min(settings.len())].to_vec()
    }

    /// The places that an exchange of `angles` tries.
    fn places(&self, angles: [f64; 3]) -> Vec<[f64; 3]> {
        let mut places = Vec::new();
        if self.is_coarse() {
            for &a in &self.angles[0] {
                for &b in &self.angles[1] {
                    for &g in &self.angles[2] {
                        places.push([a, b, g]);
                    }
                }
            }
            return places;
        }
        // All combinations of neighbouring settings,
        let near = [0, 1, 2].map(|axis| self.neighbours(axis, angles[axis]));
        for &a in &near[0] {
            for &b in &near[1] {
                for &g in &near[2] {
                    places.push([a, b, g]);
                }
            }
        }
        for axis in 0..3 {
            // and, axis by axis, coarse steps over the whole axis and all steps near the present angle.
            let settings = &self.angles[axis];
            let stride = settings.len().div_ceil(AXIS_ANGLES).max(1);
            let here = settings.partition_point(|a| *a < angles[axis] - 1e-9);
            for (k, &a) in settings.iter().enumerate() {
                if k % stride == 0 || k.abs_diff(here) <= 2 * stride {
                    let mut place = angles;
                    place[axis] = a;
                    places.push(place);
                }
            }
        }
        places
    }
}

/// A start snapped to a coarse table and improved by exchange, its dwells as they come.
pub(super) fn screen_on_table(context: Context<'_>, table: &Table, plan: &Plan) -> Option<Refined> {
    let smoothing = context.first_smoothing();
    let snapped = rate(context, &table.snapped(context, plan), smoothing)?;
    Some(exchange(context, table, smoothing, snapped))
}

/// Works a start out to the end on the table; none when it comes to nothing.
pub(super) fn finish_on_table(
    context: Context<'_>,
    table: &Table,
    plan: &Plan,
) -> Option<Candidate> {
    let smoothing = context.first_smoothing();
    let snapped = table.snapped(context, plan);
    let mut current = rate(context, &snapped, smoothing)?;
    for _ in 0..ROUNDS {
        let before = current.merit;
        current = exchange(context, table, smoothing, current);
        current = allocate(context, current, smoothing);
        current = drop_idle(context, smoothing, current);
        if context.must_stop() || before - current.merit < 1e-6 {
            break;
        }
    }
    if context.evaluator.objective().criterion.has_kinks() {
        current = rate(
            context,
            &current.plan,
            Smoothing::PowerMean(super::finish::SHARPEST),
        )?;
        let sharp = Smoothing::PowerMean(super::finish::SHARPEST);
        current = exchange(context, table, sharp, current);
        current = allocate(context, current, sharp);
    }
    super::finish::settle_times(context, &current.plan)
}

/// Sweeps of exchanges until one changes nothing.
fn exchange(
    context: Context<'_>,
    table: &Table,
    smoothing: Smoothing,
    mut current: Refined,
) -> Refined {
    for _ in 0..SWEEPS {
        let before = current.merit;
        for k in 0..current.plan.angles.len() {
            if context.must_stop() {
                return current;
            }
            let places = table.places(current.plan.angles[k]);
            let rated: Vec<Option<Refined>> = places
                .into_par_iter()
                .map(|place| {
                    let mut plan = current.plan.clone();
                    plan.angles[k] = place;
                    rate(context, &plan, smoothing)
                })
                .collect();
            // In the order of the table, so that ties do not depend on the threads.
            for candidate in rated.into_iter().flatten() {
                if candidate.merit < current.merit - GAIN {
                    current = candidate;
                }
            }
        }
        if before - current.merit < 1e-7 {
            break;
        }
    }
    current
}

/// Removes positions one by one, the most idle first, as long as the merit loses less than the
/// tolerance by it.
fn drop_idle(context: Context<'_>, smoothing: Smoothing, mut current: Refined) -> Refined {
    while current.plan.angles.len() > 1 && !context.must_stop() {
        let fewer = (0..current.plan.angles.len())
            .filter_map(|k| rate(context, &current.plan.without(k), smoothing))
            .map(|refined| allocate(context, refined, smoothing))
            .reduce(|best, c| if c.merit < best.merit { c } else { best });
        match fewer {
            Some(fewer) if fewer.merit - current.merit <= context.problem.position_tolerance => {
                current = fewer;
            }
            _ => break,
        }
    }
    current
}
