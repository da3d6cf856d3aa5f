//! The order of the steps: a timeline, or one per lane, through the chain and back.
//!
//! What happens on a leg, each part only where some lane has it: the change of position in
//! frame-hold repositioning, an unmeasured move, the ticks of a measured one, the settling, the
//! dwell's whole periods, its remainder with the relaxed measurement. A lane that lacks a part
//! that another has takes it with length and weight zero, which changes nothing.

use super::adjoint::Sweep;
use super::earth::{Earth, Passed};
use super::information::Rows;
use super::moves::{Interval, Turn, drift_integral, drift_integral_adjoint};
use super::numbers::{Arithmetic, three};
use super::square::{Entries, entries, product, rows, transpose};
use super::{Chain, DwellKernel, DwellStep, Gain, MeasureStep, Place, Wide};
use crate::covariance::gradient::LegGradient;
use crate::motion::integral::Panels;

/// An interval of a move without a measurement in it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stretch<N> {
    pub turn: Turn<N>,
    pub interval: Interval<N>,
    pub panels: Panels,
    /// Of lanes whose move ends here 1, else 0.
    pub last: N,
    /// The weight of the measurement after it, 1/arcsec², and whether it follows the length.
    pub measured: Option<(N, bool)>,
}

/// The legs of a timeline, or of one per lane.
pub(crate) trait Legs<A: Arithmetic> {
    /// How many there are.
    fn count(&self) -> usize;
    /// The position.
    fn place(&self, leg: usize) -> Place<A>;
    /// (sin α, cos α) of the position.
    fn alpha(&self, leg: usize) -> (A::Number, A::Number);
    /// Whether changes of position keep ψ in the platform (frame-hold).
    fn rotates(&self, leg: usize) -> bool;
    /// How many stretches the move to the position has.
    fn stretches(&self, leg: usize) -> usize;
    /// One of them.
    fn stretch(&self, leg: usize, index: usize) -> Stretch<A::Number>;
    /// Settling, s.
    fn settle_s(&self, leg: usize) -> Option<A::Number>;
    /// The kernel of the whole periods of the dwell.
    fn dwell(&self, leg: usize) -> Option<DwellKernel<A>>;
    /// The rest of the dwell, s, and the weight of the measurement that ends it, 1/arcsec².
    fn remainder(&self, leg: usize) -> Option<(A::Number, Option<A::Number>)>;
}

/// What the reverse mode has to remember of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Step<A: Arithmetic> {
    /// A change of position: q, V and P before it.
    Rotate(Entries<A::Number>, Wide<A::Quad>, Entries<A::Number>),
    /// A stretch of a move: its index, V and P after it.
    Stretch(usize, Passed<A>, Wide<A::Quad>, Entries<A::Number>),
    /// Settling, with Γ C.
    Settle(Passed<A>, Entries<A::Number>),
    /// Whole periods of a dwell.
    Dwell(DwellStep<A>),
    /// The rest of a dwell: Γ C, V and P after it.
    Remainder(
        Passed<A>,
        Entries<A::Number>,
        Wide<A::Quad>,
        Entries<A::Number>,
    ),
    /// A measurement with V and P after it, and what its weight grows with.
    Measure(MeasureStep<A>, Wide<A::Quad>, Entries<A::Number>, Grows),
}

/// What the weight of a measurement grows with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Grows {
    Not,
    WithMove,
    WithDwell,
}

/// What the forward run leaves behind.
pub(crate) trait Tape<A: Arithmetic> {
    /// A step of a leg.
    fn push(&mut self, leg: usize, step: Step<A>);
}

/// Leaves nothing.
pub(crate) struct NoTape;

impl<A: Arithmetic> Tape<A> for NoTape {
    #[inline(always)]
    fn push(&mut self, _: usize, _: Step<A>) {}
}

impl<A: Arithmetic> Tape<A> for Vec<(usize, Step<A>)> {
    #[inline(always)]
    fn push(&mut self, leg: usize, step: Step<A>) {
        Vec::push(self, (leg, step));
    }
}

/// Runs the chain over the legs.
#[inline(always)]
pub(crate) fn forward<A: Arithmetic>(
    chain: &mut Chain<A>,
    legs: &impl Legs<A>,
    earth: &Earth<A::Number>,
    tape: &mut impl Tape<A>,
) {
    let ar = chain.ar;
    let mut previous: Option<Place<A>> = None;
    for leg in 0..legs.count() {
        let at = legs.place(leg);
        if let Some(from) = previous
            && legs.rotates(leg)
        {
            let q = entries(&product(&at.c, &rows(ar, &transpose(&from.c))));
            tape.push(leg, Step::Rotate(q, chain.v, chain.p));
            chain.rotate(&q);
        }
        for index in 0..legs.stretches(leg) {
            let s = legs.stretch(leg, index);
            let passed = earth.pass(s.interval.length_s);
            let b = drift_integral(ar, earth, &s.turn, &s.interval, s.panels);
            chain.pass(&passed, &b);
            tape.push(leg, Step::Stretch(index, passed, chain.v, chain.p));
            if let Some((weight, grows)) = s.measured {
                let step = chain.measure(weight);
                let grows = if grows { Grows::WithMove } else { Grows::Not };
                tape.push(leg, Step::Measure(step, chain.v, chain.p, grows));
            }
        }
        if let Some(settle_s) = legs.settle_s(leg) {
            let passed = earth.pass(settle_s);
            let gamma_c = chain.pass_at(&passed, &at);
            tape.push(leg, Step::Settle(passed, gamma_c));
        }
        if let Some(kernel) = legs.dwell(leg) {
            let gain = Gain::new(ar, &kernel, &chain.p);
            let step = chain.dwell(&kernel, &gain, &at);
            tape.push(leg, Step::Dwell(step));
        }
        if let Some((length_s, weight)) = legs.remainder(leg) {
            let passed = earth.pass(length_s);
            let gamma_c = chain.pass_at(&passed, &at);
            tape.push(leg, Step::Remainder(passed, gamma_c, chain.v, chain.p));
            if let Some(weight) = weight {
                let step = chain.measure(weight);
                tape.push(leg, Step::Measure(step, chain.v, chain.p, Grows::WithDwell));
            }
        }
        previous = Some(at);
    }
}

/// Where the derivatives with respect to a leg are summed up.
pub(crate) trait LegAdjoint<N> {
    /// Adds ∂f/∂(α, β, γ).
    fn add_angles(&mut self, angles: &[N; 3]);
    /// Adds the derivative with respect to the dwell.
    fn add_dwell(&mut self, slope: N);
    /// Adds the derivative with respect to the move's duration.
    fn add_move(&mut self, slope: N);
}

impl LegAdjoint<f64> for LegGradient {
    #[inline(always)]
    fn add_angles(&mut self, angles: &[f64; 3]) {
        for i in 0..3 {
            self.angles[i] += angles[i];
        }
    }
    #[inline(always)]
    fn add_dwell(&mut self, slope: f64) {
        self.dwell_s += slope;
    }
    #[inline(always)]
    fn add_move(&mut self, slope: f64) {
        self.move_s += slope;
    }
}

/// The way back: adds the derivatives of every leg to `out`, one entry per leg, zero at first.
/// `per_weight` is the derivative of a relaxed measurement's weight with respect to its length.
#[inline(always)]
pub(crate) fn backward<A: Arithmetic>(
    ar: A,
    legs: &impl Legs<A>,
    earth: &Earth<A::Number>,
    tape: &[(usize, Step<A>)],
    information: &Rows<A::Quad>,
    per_weight: f64,
    out: &mut [impl LegAdjoint<A::Number>],
) {
    let per_weight = ar.number(per_weight);
    let mut sweep = Sweep::new(ar);
    let mut rest = tape;
    for leg in (0..legs.count()).rev() {
        let at = legs.place(leg);
        let mut before = None;
        while let Some(((of, step), earlier)) = rest.split_last() {
            if *of != leg {
                break;
            }
            rest = earlier;
            match step {
                Step::Dwell(dwell) => sweep.dwell(dwell, &at, information),
                Step::Settle(passed, gamma_c) => sweep.pass_at(passed, gamma_c, &at),
                Step::Remainder(passed, gamma_c, v, p) => {
                    let adjoint = sweep.length_adjoint(earth, v, p, &at);
                    out[leg].add_dwell(adjoint);
                    sweep.pass_at(passed, gamma_c, &at);
                }
                Step::Measure(measure, v, p, grows) => {
                    let adjoint = sweep.measure(measure, v, p, information);
                    let slope = adjoint * per_weight;
                    match grows {
                        Grows::Not => {}
                        Grows::WithMove => out[leg].add_move(slope),
                        Grows::WithDwell => out[leg].add_dwell(slope),
                    }
                }
                Step::Stretch(index, passed, v, p) => {
                    let s = legs.stretch(leg, *index);
                    let length = sweep.length_adjoint(earth, v, p, &at) * s.last;
                    let b =
                        drift_integral_adjoint(ar, earth, &s.turn, &s.interval, s.panels, &sweep.v);
                    out[leg].add_move(b.duration + length);
                    out[leg].add_angles(&b.change);
                    out[leg - 1].add_angles(&three!(|i| b.from[i] - b.change[i]));
                    sweep.pass(passed);
                }
                Step::Rotate(q, v, p) => {
                    let from = legs.place(leg - 1);
                    let q_bar = sweep.rotate(q, v, p);
                    sweep.add_to_place(&product(&q_bar, &from.rows));
                    before = Some(product(&transpose(&q_bar), &at.rows));
                }
            }
        }
        let angles = sweep.leave_place(&at, legs.alpha(leg));
        out[leg].add_angles(&angles);
        if let Some(c) = before {
            sweep.add_to_place(&c);
        }
    }
}
