//! The end of a timeline, of one or of one per lane: what is left of the parameters, and the way back.

use super::back::Backward;
use super::course::{Forward, Wanders};
use super::cuts::{Around, spread};
use super::rows::{add_squares, times_symmetric};
use super::tape::Memory;
use super::{Coloured, Columns};
use crate::covariance::CovarianceModel;
use crate::covariance::fast::arithmetic::{Arithmetic, Row, Work, four};
use crate::covariance::fast::course::LegAdjoint;
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::posterior::{Posterior, Pulled};

/// What the forward run leaves.
#[derive(Debug)]
pub(super) struct Ending<A: Arithmetic, const S: usize, const I: usize> {
    pub posterior: Posterior<A::Number>,
    pub memory: Box<Memory<A, S, I>>,
}

impl<A: Arithmetic, const S: usize, const I: usize> Ending<A, S, I> {
    /// The rows that the chain has told, with their weights.
    pub fn rows(&self, columns: &Columns) -> impl Iterator<Item = (Vec<A::Number>, A::Number)> {
        let rows = self.memory.told.rows.chunks_exact(columns.width);
        let size = columns.order.size();
        let numbers = move |row: &[A::Quad]| (0..size).map(|p| row[p / 4].get(p % 4)).collect();
        rows.map(numbers)
            .zip(self.memory.told.weights.iter().copied())
    }
}

/// The chain from the first leg to the last.
pub(super) struct Run<'a, A, L, const S: usize, const I: usize> {
    pub ar: A,
    pub model: &'a CovarianceModel,
    pub coloured: &'a Coloured,
    pub legs: &'a L,
    pub keeps_tape: bool,
    /// Of a part of a test.
    pub around: Option<&'a Around>,
}

impl<A, L, const S: usize, const I: usize> Work for Run<'_, A, L, S, I>
where
    A: Arithmetic + 'static,
    L: Wanders<A>,
{
    type Output = Ending<A, S, I>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let Self { ar, model, .. } = self;
        let Coloured { columns, wander } = self.coloured;
        let zero = ar.number(0.0);
        let earth = Earth::new(zero, &model.dynamics, &model.stand, model.drift_psd);
        let mut memory = Memory::take(self.keeps_tape);
        let of = (columns, wander);
        Forward::new(ar, of, self.legs, &earth, &mut memory, &model.prior_psi).run(self.around);
        let told = &memory.told;
        let (width, size) = (columns.width, columns.order.size());
        let mut e = match self.around {
            Some(around) => spread(ar, around.gram()),
            None => vec![ar.quad([zero; 4]); 4 * width * width],
        };
        add_squares(&mut e, &told.rows, &told.weights, width);
        let mut rows = Vec::with_capacity(size * 4 * width);
        for row in e.chunks_exact(width).take(size) {
            for of in row {
                rows.extend_from_slice(&four!(|k| of.get(k)));
            }
            rows.truncate(rows.len() + size - 4 * width);
        }
        Ending {
            posterior: Posterior::new(zero, &columns.order, rows),
            memory,
        }
    }
}

/// Every row that was told times Ē.
pub(super) struct Pull<'a, A: Arithmetic, const S: usize, const I: usize> {
    pub ar: A,
    pub columns: &'a Columns,
    pub end: &'a Ending<A, S, I>,
    pub slope: &'a Pulled<A::Number>,
}

impl<A: Arithmetic, const S: usize, const I: usize> Work for Pull<'_, A, S, I> {
    type Output = Vec<A::Quad>;
    #[inline(always)]
    fn run(self) -> Self::Output {
        let (ar, width, size) = (self.ar, self.columns.width, self.columns.order.size());
        let zero = ar.number(0.0);
        let of = self.end.posterior.adjoint(self.slope);
        let mut padded = Vec::with_capacity(4 * width * width);
        for i in 0..4 * width {
            for q in 0..width {
                padded.push(ar.quad(four!(|e| match i < size && 4 * q + e < size {
                    true => of[i * size + 4 * q + e],
                    false => zero,
                })));
            }
        }
        times_symmetric(&self.end.memory.told.rows, &padded, width)
    }
}

/// The derivatives leg by leg.
pub(super) struct Back<'a, A: Arithmetic, L, O, const S: usize, const I: usize> {
    pub ar: A,
    pub model: &'a CovarianceModel,
    pub coloured: &'a Coloured,
    pub legs: &'a L,
    pub end: &'a Ending<A, S, I>,
    /// Every row times Ē.
    pub through: &'a [A::Quad],
    /// One per leg, zero at first.
    pub out: &'a mut [O],
}

impl<A: Arithmetic, L, O, const S: usize, const I: usize> Work for Back<'_, A, L, O, S, I>
where
    L: Wanders<A>,
    O: LegAdjoint<A::Number>,
{
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let Self { ar, model, .. } = self;
        let earth = Earth::new(
            ar.number(0.0),
            &model.dynamics,
            &model.stand,
            model.drift_psd,
        );
        let backward = Backward {
            ar,
            columns: &self.coloured.columns,
            wander: &self.coloured.wander,
            legs: self.legs,
            earth: &earth,
            tape: &self.end.memory.tape,
            told: &self.end.memory.told,
            through: self.through,
            per_weight: ar.number(1.0 / (model.period_s * model.noise_variance)),
            out: self.out,
        };
        backward.run();
    }
}
