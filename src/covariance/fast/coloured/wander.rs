//! What wanders, as the chain reads it: blocks, kernels of dwells, and time at a position.

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

use nalgebra::{DMatrix, Matrix3};

use super::algebra::{Matrix, zeros};
use crate::covariance::CovarianceModel;
use crate::covariance::coloured::Layout;
use crate::covariance::coloured::kernel::{ColouredDoublings, ColouredKernel};
use crate::covariance::coloured::passage::Process;
use crate::covariance::fast::arithmetic::{Number, three};
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::moves::product as times;
use crate::covariance::fast::square::{Entries, transpose};
use crate::dynamics::ErrorDynamics;
use crate::motion::Move;

/// How many durations (in periods) are remembered.
const REMEMBERED: usize = 4096;

/// How many states and inputs there are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Size {
    /// ψ and one process of the drift.
    Six,
    /// Two processes of the drift.
    Nine,
    /// Biases that wander too: two processes of each.
    Fifteen,
}

/// A block of x after that of ψ^n.
#[derive(Debug)]
pub(super) struct Slot {
    /// λ, 1/s.
    pub decay: f64,
    /// g², the PSD of the noise that drives it.
    pub psd: f64,
    /// σ before the test.
    pub start_sigma: f64,
    /// Whether it is of the drift.
    pub drives: bool,
    held: Series,
}

/// What wanders.
#[derive(Debug)]
pub(crate) struct Wander {
    pub(super) size: Size,
    /// Every three states after the first.
    pub(super) slots: Vec<Slot>,
    kernels: Kernels,
    /// For what length [`Slot::held`] is, s.
    part_s: f64,
    /// By how many halves the rest of a dwell and a settle come to that.
    pub(super) rest_halves: u32,
    pub(super) settle_halves: u32,
}

impl Wander {
    /// Of a model; a stand settles for `settle_s`.
    pub fn new(model: &CovarianceModel, settle_s: f64) -> Self {
        /// Longest part that a series is for, s.
        const LONGEST_S: f64 = 1000.0;
        let layout = Layout::of(model);
        let (drift, biases) = layout.blocks();
        let size = match (drift.len(), biases.is_empty()) {
            (_, false) => Size::Fifteen,
            (2, true) => Size::Nine,
            _ => Size::Six,
        };
        // Where more states are than there are processes, some stay 0.
        let padded = |of: &[Process], count: usize| -> Vec<Option<Process>> {
            let more = count.saturating_sub(of.len());
            of.iter()
                .copied()
                .map(Some)
                .chain(std::iter::repeat_n(None, more))
                .collect()
        };
        let (of_drift, of_biases) = match size {
            Size::Six => (padded(drift, 1), Vec::new()),
            Size::Nine => (padded(drift, 2), Vec::new()),
            Size::Fifteen => (padded(drift, 2), padded(biases, 2)),
        };
        let fastest = layout
            .processes()
            .map(|p| p.decay::<f64>())
            .fold(0.0, f64::max);
        let most_s = model.period_s.max(settle_s).min(LONGEST_S);
        let part_s = match fastest * most_s > 1.0 {
            true => 1.0 / fastest,
            false => most_s,
        };
        let halves = |length_s: f64| libm::log2(length_s / part_s).ceil().max(0.0) as u32;
        let slot = |process: &Option<Process>, drives: bool| Slot {
            decay: process.map_or(0.0, |p| p.decay()),
            psd: process.map_or(0.0, |p| p.psd()),
            start_sigma: process.map_or(0.0, |p| p.start_sigma()),
            drives,
            held: Series::new(*process, &model.dynamics, part_s),
        };
        let slots: Vec<Slot> = (of_drift.iter().map(|p| slot(p, true)))
            .chain(of_biases.iter().map(|p| slot(p, false)))
            .collect();
        let taken = of_drift.iter().chain(&of_biases).zip(1..);
        let blocks = taken
            .filter(|(process, _)| process.is_some())
            .map(|(_, block)| block);
        let blocks: Vec<usize> = std::iter::once(0).chain(blocks).collect();
        Self {
            size,
            kernels: Kernels::new(model, &blocks, 3 + 3 * slots.len()),
            slots,
            part_s,
            rest_halves: halves(model.period_s),
            settle_halves: halves(settle_s),
        }
    }

    /// The numbers of the kernel of a dwell of `periods` filter periods, see [`Kernel::read`].
    pub fn kernel(&self, periods: usize) -> Cow<'_, [f64]> {
        self.kernels.numbers(periods)
    }

    /// In how many panels a part of a move is gone through.
    pub fn panels(&self, m: &Move, (start_s, length_s): (f64, f64)) -> usize {
        /// Turn of the gimbals (rad), time constants and seconds in a panel: eight nodes then leave
        /// less than 1e-9 of what is integrated.
        const TURN: f64 = 1.6;
        const DECAYS: f64 = 1.0;
        const LONGEST_S: f64 = 5000.0;
        let part = [start_s, length_s].map(|s| s / m.duration_s);
        let turn = m.change.iter().map(|c| c.abs()).sum::<f64>() * part[1];
        let turn = turn * m.greatest_speed(part.into());
        let fastest = self.slots.iter().map(|s| s.decay).fold(0.0, f64::max);
        let panels = (turn / TURN)
            .max(fastest * length_s / DECAYS)
            .max(length_s / LONGEST_S);
        panels.ceil().max(1.0) as usize
    }

    /// Time at a position, no longer than `halves` of [`Wander::part_s`] say.
    #[inline(always)]
    pub fn held<N: Number>(&self, earth: &Earth<N>, length_s: N, halves: u32) -> Vec<Share<N>> {
        let by_halves = length_s.constant(libm::pow(0.5, f64::from(halves)));
        let part_s = length_s * by_halves;
        let place = part_s * length_s.constant(1.0 / self.part_s);
        let mut shares = Vec::with_capacity(self.slots.len());
        for slot in &self.slots {
            shares.push(slot.held.at(earth, place));
        }
        for k in 0..halves {
            let phi = earth.transition(part_s * length_s.constant(libm::pow(2.0, f64::from(k))));
            for share in &mut shares {
                *share = share.twice(&phi);
            }
        }
        shares
    }
}

/// What a process does in an interval at a position, see [`crate::covariance::coloured::passage`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Share<N> {
    /// M.
    pub carried: Entries<N>,
    /// e^{−λt}.
    pub kept: N,
    /// Q_ψd.
    pub crossed: Entries<N>,
    /// Q_ψψ.
    pub psi: Entries<N>,
    /// Q_dd.
    pub own: N,
}

#[inline(always)]
fn scaled<N: Number>(a: &Entries<N>, by: N) -> Entries<N> {
    three!(|i| three!(|j| a[i][j] * by))
}

#[inline(always)]
fn plus<N: Number>(a: &Entries<N>, b: &Entries<N>) -> Entries<N> {
    three!(|i| three!(|j| a[i][j] + b[i][j]))
}

impl<N: Number> Share<N> {
    /// This interval, and another like it, Φ of each.
    #[inline(always)]
    fn twice(&self, phi: &Entries<N>) -> Self {
        let to_end = transpose(&self.carried);
        let mixed = times(&times(phi, &self.crossed), &to_end);
        let driven = scaled(&self.carried, self.own);
        let turned = times(&times(phi, &self.psi), &transpose(phi));
        let psi = plus(
            &plus(&turned, &plus(&mixed, &transpose(&mixed))),
            &times(&driven, &to_end),
        );
        let crossed = scaled(&plus(&times(phi, &self.crossed), &driven), self.kept);
        Self {
            carried: plus(
                &times(phi, &self.carried),
                &scaled(&self.carried, self.kept),
            ),
            kept: self.kept * self.kept,
            crossed: plus(&crossed, &self.crossed),
            psi: plus(&psi, &self.psi),
            own: self.own.mul_add(self.kept * self.kept, self.own),
        }
    }
}

/// What becomes of x in an interval without a measurement, its noise apart: ψ ← `top` x, and of every other
/// component what is kept.
#[derive(Debug, Clone, Copy)]
pub(super) struct Transition<N, const S: usize> {
    pub top: Matrix<N, 3, S>,
    pub kept: [N; S],
}

impl<N: Number, const S: usize> Transition<N, S> {
    /// Φ of ψ, and the blocks after it those of `shares`.
    #[inline(always)]
    pub fn new(slots: &[Slot], phi: &Entries<N>, shares: &[Share<N>]) -> Self {
        let zero = phi[0][0].constant(0.0);
        let mut to = Self {
            top: zeros(zero),
            kept: [zero; S],
        };
        for i in 0..3 {
            to.top[i][..3].copy_from_slice(&phi[i]);
        }
        for (at, (slot, share)) in slots.iter().zip(shares).enumerate() {
            let at = 3 + 3 * at;
            for i in 0..3 {
                to.kept[at + i] = share.kept;
                if slot.drives {
                    to.top[i][at..at + 3].copy_from_slice(&share.carried[i]);
                }
            }
        }
        to
    }
}

/// Adds the noise of an interval to P, `white` that of the drift without colour.
#[inline(always)]
pub(super) fn add_noise<N: Number, const S: usize>(
    slots: &[Slot],
    p: &mut Matrix<N, S, S>,
    shares: &[Share<N>],
    white: N,
) {
    for i in 0..3 {
        p[i][i] = p[i][i] + white;
    }
    for (at, (slot, share)) in slots.iter().zip(shares).enumerate() {
        let at = 3 + 3 * at;
        for i in 0..3 {
            p[at + i][at + i] = p[at + i][at + i] + share.own;
            if !slot.drives {
                continue;
            }
            for j in 0..3 {
                p[i][j] = p[i][j] + share.psi[i][j];
                p[i][at + j] = p[i][at + j] + share.crossed[i][j];
                p[at + j][i] = p[at + j][i] + share.crossed[i][j];
            }
        }
    }
}

/// A function of time by its powers, on [0, 1] of [`Wander::part_s`].
type Powers = Vec<f64>;

/// Horner's rule.
#[inline(always)]
fn power_sum<N: Number>(powers: &[f64], place: N) -> N {
    let mut sum = place.constant(0.0);
    for power in powers.iter().rev() {
        sum = sum.mul_add(place, place.constant(*power));
    }
    sum
}

/// [`Share`] as a function of time. At a position everything is a function of K, the cross matrix of the
/// Earth's axis: a I + b K + c K².
#[derive(Debug)]
struct Series {
    carried: [Powers; 3],
    kept: Powers,
    crossed: [Powers; 3],
    /// a and c: symmetric.
    psi: [Powers; 2],
    own: Powers,
}

impl Series {
    /// M(s), with time in units of `part_s`, is t Σ m_k s^k, (k + 1) m_{k+1} = F t m_k + e_k, and
    /// e^{−λts} = Σ e_k s^k; the rest are integrals of their products.
    fn new(process: Option<Process>, dynamics: &ErrorDynamics, part_s: f64) -> Self {
        let decay = process.map_or(0.0, |p| p.decay::<f64>()) * part_s;
        let psd = process.map_or(0.0, |p| p.psd::<f64>());
        let f = dynamics.system_matrix() * part_s;
        let (mut faded, mut carried) = (vec![1.0], vec![Matrix3::<f64>::zeros()]);
        let (mut size, mut k) = (1.0_f64, 0);
        while size > 1e-18 || k < 4 {
            let (e, m) = (faded[k], carried[k]);
            k += 1;
            carried.push((f * m + Matrix3::identity() * e) / k as f64);
            faded.push(-e * decay / k as f64);
            size *= (decay + dynamics.rate() * part_s) / k as f64;
        }
        let terms = carried.len();
        let mut crossed = vec![Matrix3::zeros(); 2 * terms];
        let (mut psi, mut own) = (crossed.clone(), vec![0.0; 2 * terms]);
        let g2 = psd * part_s;
        for i in 0..terms {
            for j in 0..terms {
                let (at, by) = (i + j + 1, g2 / (i + j + 1) as f64);
                crossed[at] += carried[i] * (faded[j] * by * part_s);
                psi[at] += carried[i] * carried[j].transpose() * (by * part_s * part_s);
                own[at] += faded[i] * faded[j] * by;
            }
        }
        // What is beyond the last term of one factor is beyond the digits.
        let enough = terms + 4;
        let in_k = |of: &[Matrix3<f64>], by: f64| -> [Powers; 3] {
            let all: Vec<[f64; 3]> = (of.iter().take(enough))
                .map(|m| of_axis(dynamics, &(m * by)))
                .collect();
            [0, 1, 2].map(|k| all.iter().map(|of| of[k]).collect())
        };
        own.truncate(enough);
        let [a, _, c] = in_k(&psi, 1.0);
        Self {
            carried: in_k(&carried, part_s),
            kept: faded,
            crossed: in_k(&crossed, 1.0),
            psi: [a, c],
            own,
        }
    }

    #[inline(always)]
    fn at<N: Number>(&self, earth: &Earth<N>, place: N) -> Share<N> {
        let zero = place.constant(0.0);
        Share {
            carried: earth.function(three!(|k| power_sum(&self.carried[k], place))),
            kept: power_sum(&self.kept, place),
            crossed: earth.function(three!(|k| power_sum(&self.crossed[k], place))),
            psi: earth.function([
                power_sum(&self.psi[0], place),
                zero,
                power_sum(&self.psi[1], place),
            ]),
            own: power_sum(&self.own, place),
        }
    }
}

/// (a, b, c) of m = a I + b K + c K²: aᵀm a = a on the axis, tr m = 3a − 2c, and K : m = 2b.
fn of_axis(dynamics: &ErrorDynamics, m: &Matrix3<f64>) -> [f64; 3] {
    let axis = dynamics.axis();
    let k = axis.cross_matrix();
    let a = axis.dot(&(m * axis));
    [a, 0.5 * k.dot(m), 0.5 * (3.0 * a - m.trace())]
}

/// The kernels of dwells by their numbers of periods.
#[derive(Debug)]
struct Kernels {
    doublings: Arc<ColouredDoublings<f64>>,
    remembered: Box<[OnceLock<Box<[f64]>>]>,
    /// Of every component of the layout's x, its place among `states`.
    places: Vec<usize>,
    states: usize,
}

impl Kernels {
    fn new(model: &CovarianceModel, blocks: &[usize], states: usize) -> Self {
        Self {
            doublings: model.coloured_kernels.of(model),
            remembered: (0..REMEMBERED).map(|_| OnceLock::new()).collect(),
            places: blocks.iter().flat_map(|b| 3 * b..3 * b + 3).collect(),
            states,
        }
    }

    fn numbers(&self, periods: usize) -> Cow<'_, [f64]> {
        let made = || self.padded(&self.doublings.kernel(periods));
        match self.remembered.get(periods) {
            Some(cell) => Cow::Borrowed(cell.get_or_init(|| made().into())),
            None => Cow::Owned(made()),
        }
    }

    /// In the order of [`Kernel`], with the states that are not there.
    fn padded(&self, kernel: &ColouredKernel<f64>) -> Vec<f64> {
        let inputs = match self.states {
            15 => 4,
            _ => 3,
        };
        let states = self.states;
        let mut out = Vec::new();
        let mut push = |m: &DMatrix<f64>, is_square: bool, is_transition: bool| {
            let columns = if is_square { states } else { inputs };
            let mut padded = DMatrix::zeros(states, columns);
            if is_transition {
                padded.fill_with_identity();
            }
            for (i, to) in self.places.iter().enumerate() {
                for j in 0..m.ncols() {
                    let at = if is_square { self.places[j] } else { j };
                    padded[(*to, at)] = m[(i, j)];
                }
            }
            out.extend_from_slice(padded.transpose().as_slice());
        };
        push(&kernel.r11, true, false);
        push(&kernel.r12, false, false);
        push(&kernel.a_x, true, true);
        push(&kernel.a_u, false, false);
        let c = &kernel.u * kernel.u.transpose();
        push(&((&c + c.transpose()) * 0.5), true, false);
        push(&(kernel.r11.transpose() * &kernel.r11), true, false);
        push(&(kernel.r11.transpose() * &kernel.r12), false, false);
        out.extend_from_slice(kernel.r22.transpose().as_slice());
        out
    }
}

/// The kernel of a dwell.
pub(super) struct Kernel<N, const S: usize, const I: usize> {
    pub r11: Matrix<N, S, S>,
    pub r12: Matrix<N, S, I>,
    pub a_x: Matrix<N, S, S>,
    pub a_u: Matrix<N, S, I>,
    pub c: Matrix<N, S, S>,
    /// R11ᵀ R11.
    pub j: Matrix<N, S, S>,
    /// R11ᵀ R12.
    pub cross: Matrix<N, S, I>,
    pub r22: Matrix<N, I, I>,
}

#[inline(always)]
fn take<N: Number, const R: usize, const C: usize>(from: &mut &[N]) -> Matrix<N, R, C> {
    let mut to = zeros(from[0]);
    for (row, of) in to.iter_mut().zip(from.chunks_exact(C)) {
        row.copy_from_slice(of);
    }
    *from = &from[R * C..];
    to
}

impl<N: Number, const S: usize, const I: usize> Kernel<N, S, I> {
    /// From its numbers, matrix by matrix, row by row.
    #[inline(always)]
    pub fn read(mut from: &[N]) -> Self {
        let from = &mut from;
        Self {
            r11: take(from),
            r12: take(from),
            a_x: take(from),
            a_u: take(from),
            c: take(from),
            j: take(from),
            cross: take(from),
            r22: take(from),
        }
    }
}
