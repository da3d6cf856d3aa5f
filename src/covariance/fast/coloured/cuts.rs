//! A schedule cut between its positions where drift or biases wander, so that changing one of them costs one
//! dwell, not K: as [`crate::covariance::fast::cuts`], with x for ψ^n and all parameters for D.
//!
//! Before a cut the chain is in a state (V, P) and has told rows of D. What the rest of the test tells about
//! (x, D) at the cut is, after eliminating its noise, as many rows `R x + S D` of unit noise as x has
//! components, and rows of D alone. Together, with T = R V + S, the rows (I + R P Rᵀ)^{-½} T are added to
//! both.
//!
//! Backwards through x ← A x + B D + ζ, ζ ~ N(0, Q), the rows become N^{-½} (R A x + (R B + S) D) with
//! N = Λ + R Q Rᵀ, Λ their noise; through a measurement they are stacked with its rows and triangularised in
//! x, and what is left without x is of D alone. Λ is I but at the end of a test with a random walk: that the
//! walk is 0 there is known without noise, Λ = 0, until time passes.

mod back;
#[cfg(test)]
mod tests;

use std::ops::Range;

use super::course::{Forward, Wanders};
use super::rows::add_squares;
use super::tape::Memory;
use super::{Coloured, Columns, by_size};
use crate::attitude::Attitude;
use crate::covariance::fast::arithmetic::{Arithmetic, Plain, Row, four};
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::single::OneTimeline;
use crate::covariance::{CoefficientCovariance, CovarianceModel, TickRule};
use crate::error::Result;
use crate::motion::Timeline;
use back::{Backward, Rest};

/// Entries of a row over the parameters, four by four.
pub(super) type Entries4 = [f64; 4];

/// The chain after a leg.
#[derive(Debug, Clone)]
struct State {
    /// V and P, row by row.
    v: Vec<Entries4>,
    p: Vec<f64>,
    /// How many rows it has told.
    told: usize,
    /// Their sum of squares.
    gram: Vec<Entries4>,
}

/// A timeline with the state before and the rest after every leg.
#[derive(Debug)]
pub(crate) struct Cuts<'a> {
    timeline: &'a Timeline,
    width: usize,
    /// After each leg.
    after: Vec<State>,
    /// Everything that was told, with its weights.
    told: Vec<Entries4>,
    weights: Vec<f64>,
    /// From the dwell of each leg on; none: nothing but the end of the test follows.
    rest: Vec<Option<Rest>>,
    /// What the rest tells of the parameters alone, from the end on, with unit weights.
    alone: Vec<Entries4>,
}

/// What comes before and after a part of a test.
#[derive(Debug, Clone)]
pub(crate) struct Around {
    /// V and P where the part begins, and where the platform is; none: it begins the test.
    before: Option<(Vec<Entries4>, Vec<f64>, Attitude)>,
    /// The sum of squares of all rows that do not depend on the part, in full.
    gram: Vec<Entries4>,
    /// R and S at the end of the part; none: it ends the test.
    rest: Option<(Vec<f64>, Vec<Entries4>)>,
    /// The rows that do not depend on the part, with their weights.
    rows: Vec<Entries4>,
    weights: Vec<f64>,
}

/// The states of the chain leg by leg, and what it has told.
fn forward<const S: usize, const I: usize>(
    model: &CovarianceModel,
    coloured: &Coloured,
    legs: &impl Wanders<Plain>,
) -> (Vec<State>, Vec<Entries4>, Vec<f64>) {
    let Coloured { columns, wander } = coloured;
    let width = columns.width;
    let earth = Earth::new(0.0, &model.dynamics, &model.stand, model.drift_psd);
    let mut memory = Memory::<Plain, S, I>::take(false);
    let of = (columns, wander);
    let mut forward = Forward::new(Plain, of, legs, &earth, &mut memory, &model.prior_psi);
    let (mut previous, mut after) = (None, Vec::with_capacity(legs.count()));
    let mut gram = vec![Plain.quad([0.0; 4]); 4 * width * width];
    let mut from = 0;
    for leg in 0..legs.count() {
        previous = Some(forward.leg(leg, previous.as_ref()));
        let told = forward.told.count();
        let new = &forward.told.rows[from * width..];
        add_squares(&mut gram, new, &forward.told.weights[from..], width);
        from = told;
        after.push(State {
            v: entries(&forward.v),
            p: forward.p.iter().flatten().copied().collect(),
            told,
            gram: entries(&gram),
        });
    }
    let rows = entries(&memory.told.rows);
    let weights = memory.told.weights.clone();
    memory.keep();
    (after, rows, weights)
}

/// The numbers of quads.
fn entries<Q: Row<Number = f64>>(of: &[Q]) -> Vec<Entries4> {
    of.iter().map(|q| four!(|e| q.get(e))).collect()
}

impl<'a> Cuts<'a> {
    /// Cuts `timeline` before and after every dwell, at the cost of two runs through it.
    ///
    /// # Errors
    ///
    /// [`Error::is_numerical`](crate::Error::is_numerical) when what the rest tells overflows.
    pub fn new(
        model: &CovarianceModel,
        coloured: &Coloured,
        timeline: &'a Timeline,
        rule: TickRule,
    ) -> Result<Self> {
        let legs = OneTimeline {
            ar: Plain,
            model,
            timeline,
            rule,
            keep_empty: false,
            facts: coloured.columns.facts(),
        };
        macro_rules! run {
            ($states:literal, $inputs:literal) => {
                forward::<$states, $inputs>(model, coloured, &legs)
            };
        }
        let (after, told, weights) = by_size!(coloured.wander.size, run);
        let (rest, alone) = Backward::new(model, coloured, &legs).run()?;
        Ok(Self {
            timeline,
            width: coloured.columns.width,
            after,
            told,
            weights,
            rest,
            alone,
        })
    }

    /// What comes before the legs `replaced`, and after the arrival at the leg that follows them, if
    /// one does. What is put between them are the legs in their place and that arrival: the move
    /// starts at the last of them.
    pub fn around(&self, replaced: Range<usize>) -> Around {
        let legs = self.timeline.legs();
        let before = replaced.start.checked_sub(1);
        let state = before.map(|k| &self.after[k]);
        let rest = self.rest.get(replaced.end).and_then(Option::as_ref);
        let told = state.map_or(0, |s| s.told);
        let alone = rest.map_or(0, |r| r.alone);
        let mut rows = self.told[..told * self.width].to_vec();
        rows.extend_from_slice(&self.alone[..alone * self.width]);
        let mut weights = self.weights[..told].to_vec();
        weights.resize(told + alone, 1.0);
        let mut gram = vec![[0.0; 4]; 4 * self.width * self.width];
        let parts = state.map(|s| &s.gram).into_iter();
        for part in parts.chain(rest.map(|r| &r.gram)) {
            for (sum, of) in gram.iter_mut().flatten().zip(part.iter().flatten()) {
                *sum += of;
            }
        }
        Around {
            before: before.map(|k| {
                let State { v, p, .. } = &self.after[k];
                (v.clone(), p.clone(), legs[k].attitude)
            }),
            gram,
            rest: rest.map(|r| (r.of_x.clone(), r.of_d.clone())),
            rows,
            weights,
        }
    }
}

impl Around {
    /// V and P where the part begins, and where the platform is.
    pub(super) fn before(&self) -> Option<(&[Entries4], &[f64], &Attitude)> {
        self.before.as_ref().map(|(v, p, c)| (&v[..], &p[..], c))
    }

    /// R and S at the end of the part.
    pub(super) fn rest(&self) -> Option<(&[f64], &[Entries4])> {
        self.rest.as_ref().map(|(r, s)| (&r[..], &s[..]))
    }

    /// The sum of squares that does not depend on the part.
    pub(super) fn gram(&self) -> &[Entries4] {
        &self.gram
    }

    /// The rows that do not depend on the part, with their weights.
    pub(super) fn rows(&self, columns: &Columns) -> impl Iterator<Item = (Vec<f64>, f64)> {
        let size = columns.order.size();
        let rows = self.rows.chunks_exact(columns.width);
        let numbers = move |row: &[Entries4]| row.iter().flatten().copied().take(size).collect();
        rows.map(numbers).zip(self.weights.iter().copied())
    }
}

impl CovarianceModel {
    /// `timeline` cut before and after every dwell; none where nothing wanders.
    ///
    /// # Errors
    ///
    /// As [`Cuts::new`].
    pub(crate) fn coloured_cuts<'a>(
        &self,
        timeline: &'a Timeline,
        rule: TickRule,
    ) -> Option<Result<Cuts<'a>>> {
        let coloured = self.coloured.as_deref()?;
        Some(Cuts::new(self, coloured, timeline, rule))
    }

    /// A figure of merit at the end of a test of which `parts` are variants of one part, and the rest is
    /// given; nothing where nothing wanders.
    ///
    /// # Errors
    ///
    /// Of a part: as [`CovarianceModel::values`].
    pub(crate) fn coloured_values_between(
        &self,
        parts: &[Timeline],
        rule: TickRule,
        around: &Around,
        merit: impl Fn(&dyn CoefficientCovariance) -> Result<f64>,
    ) -> Vec<Result<f64>> {
        match self.coloured.as_deref() {
            Some(coloured) => {
                self.coloured_values_around(coloured, parts, rule, Some(around), merit)
            }
            None => Vec::new(),
        }
    }
}

/// The same number in every lane.
#[inline(always)]
pub(super) fn spread<A: Arithmetic>(ar: A, of: &[Entries4]) -> Vec<A::Quad> {
    let mut out = Vec::with_capacity(of.len());
    for of in of {
        out.push(ar.quad(four!(|e| ar.number(of[e]))));
    }
    out
}
