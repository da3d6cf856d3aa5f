//! The order of the steps: a timeline, or one per lane, through the chain and back.
//!
//! What happens on a leg, each part only where some lane has it: the change of position in
//! frame-hold repositioning, an unmeasured move, the ticks of a measured one, the settling, the
//! dwell's whole periods, its remainder with the relaxed measurement. A lane that lacks a part
//! that another has takes it with length and weight zero, which changes nothing.

use super::adjoint::{DWELL_ROWS, InformationAdjoint, MEASURED_ROWS, Sweep};
use super::arithmetic::{Arithmetic, Work, three};
use super::earth::{Earth, Passed};
use super::gains::{DwellKernel, Gains, Seen};
use super::moves::{Interval, Turn, drift_integral, drift_integral_adjoint};
use super::square::{Entries, Square, entries, product, rows, transpose};
use super::{Carried, DwellStep, MeasureStep, Place, Wide};
use crate::covariance::gradient::LegGradient;

/// An interval of a move without a measurement in it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stretch<N, P> {
    pub turn: Turn<N>,
    pub interval: Interval<N>,
    pub panels: P,
    /// Of lanes whose move ends here 1, else 0.
    pub last: N,
    /// The weight of the measurement after it, 1/arcsec², and 1 where it follows the length, else
    /// 0.
    pub measured: Option<(N, N)>,
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
    fn stretch(&self, leg: usize, index: usize) -> Stretch<A::Number, A::Panels>;
    /// Whether it settles after the move.
    fn settles(&self, leg: usize) -> bool;
    /// How long, s.
    fn settle_s(&self, leg: usize) -> A::Number;
    /// The kernel of the whole periods of the dwell; none where no lane has any.
    fn dwell(&self, leg: usize) -> Option<DwellKernel<A>>;
    /// Whether the dwell has a rest.
    fn remains(&self, leg: usize) -> bool;
    /// The rest, s, and the weight of the measurement that ends it, 1/arcsec².
    fn remainder(&self, leg: usize) -> (A::Number, Option<A::Number>);
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
    /// A measurement with V after it, and what its weight grows with.
    Measure(MeasureStep<A>, Wide<A::Quad>, Grows<A::Number>),
}

impl<A: Arithmetic> Step<A> {
    /// How many rows it tells.
    fn rows(&self) -> usize {
        match self {
            Self::Dwell(_) => DWELL_ROWS,
            Self::Measure(..) => MEASURED_ROWS,
            _ => 0,
        }
    }
}

/// What the weight of a measurement grows with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Grows<N> {
    /// With the move's duration where this is 1.
    WithMove(N),
    /// With the dwell.
    WithDwell,
}

/// What the forward run leaves behind: nothing, unless it is asked to. Switched while it runs,
/// so that value and gradient share their code.
#[derive(Debug)]
pub(crate) struct Tape<A: Arithmetic> {
    /// Whether anything is kept.
    pub on: bool,
    /// Leg and step, in order.
    pub steps: Vec<(usize, Step<A>)>,
}

impl<A: Arithmetic> Tape<A> {
    #[inline(always)]
    fn push(&mut self, leg: usize, step: Step<A>) {
        if self.on {
            self.steps.push((leg, step));
        }
    }
}

/// The chain on its way through the legs.
struct Forward<'a, A: Arithmetic, L, G> {
    ar: A,
    legs: &'a L,
    earth: &'a Earth<A::Number>,
    gains: &'a mut G,
    tape: &'a mut Tape<A>,
    chain: Carried<A>,
}

/// Parts of a leg.
const STRETCH: u8 = 0;
const SETTLE: u8 = 1;
const DWELL: u8 = 2;
const REMAINDER: u8 = 3;

/// One part of a leg, compiled apart in lanes.
struct Part<'b, 'a, A: Arithmetic, L, G, const PART: u8> {
    forward: &'b mut Forward<'a, A, L, G>,
    at: &'b Place<A>,
    leg: usize,
    index: usize,
}

impl<A: Arithmetic, L: Legs<A>, G: Gains<A>, const PART: u8> Work for Part<'_, '_, A, L, G, PART> {
    type Output = ();
    #[inline(always)]
    fn run(self) {
        match PART {
            STRETCH => self.forward.stretch(self.leg, self.index),
            SETTLE => self.forward.settle(self.leg, self.at),
            DWELL => self.forward.dwell(self.leg, self.at),
            _ => self.forward.remainder(self.leg, self.at),
        }
    }
}

impl<A: Arithmetic, L: Legs<A>, G: Gains<A>> Forward<'_, A, L, G> {
    #[inline(always)]
    fn part<const PART: u8>(&mut self, leg: usize, index: usize, at: &Place<A>) {
        self.ar.apart(Part::<A, L, G, PART> {
            at,
            leg,
            index,
            forward: self,
        });
    }

    #[inline(always)]
    fn rotate(&mut self, leg: usize, from: &Place<A>, at: &Place<A>) {
        let q = entries(&product(&at.c, &rows(self.ar, &transpose(&from.c))));
        self.tape
            .push(leg, Step::Rotate(q, self.chain.v, self.gains.p()));
        self.chain.rotate(&q);
        self.gains.rotate(&q);
    }

    #[inline(always)]
    fn stretch(&mut self, leg: usize, index: usize) {
        let s = self.legs.stretch(leg, index);
        let (passed, p, seen) = self.gains.stretch(leg, index);
        let b = drift_integral(self.ar, self.earth, &s.turn, &s.interval, &s.panels);
        self.chain.pass(&passed, &b);
        self.tape
            .push(leg, Step::Stretch(index, passed, self.chain.v, p));
        if let Some((_, grows)) = s.measured
            && let Some(seen) = seen
        {
            self.measure(leg, &seen, Grows::WithMove(grows));
        }
    }

    #[inline(always)]
    fn measure(&mut self, leg: usize, seen: &Seen<A>, grows: Grows<A::Number>) {
        let step = self.chain.measure(seen);
        self.tape
            .push(leg, Step::Measure(step, self.chain.v, grows));
    }

    #[inline(always)]
    fn settle(&mut self, leg: usize, at: &Place<A>) {
        let passed = self.gains.settle(leg);
        let gamma_c = self.chain.pass_at(&passed, at);
        self.tape.push(leg, Step::Settle(passed, gamma_c));
    }

    #[inline(always)]
    fn dwell(&mut self, leg: usize, at: &Place<A>) {
        if let Some(gain) = self.gains.dwell(leg) {
            let step = self.chain.dwell(&gain, at);
            self.tape.push(leg, Step::Dwell(step));
        }
    }

    #[inline(always)]
    fn remainder(&mut self, leg: usize, at: &Place<A>) {
        let (passed, p, seen) = self.gains.remainder(leg);
        let gamma_c = self.chain.pass_at(&passed, at);
        self.tape
            .push(leg, Step::Remainder(passed, gamma_c, self.chain.v, p));
        if let Some(seen) = seen {
            self.measure(leg, &seen, Grows::WithDwell);
        }
    }
}

/// Runs the chain over the legs from its start on.
#[inline(always)]
pub(crate) fn forward<A: Arithmetic>(
    ar: A,
    legs: &impl Legs<A>,
    earth: &Earth<A::Number>,
    gains: &mut impl Gains<A>,
    tape: &mut Tape<A>,
) -> Carried<A> {
    forward_from(ar, legs, earth, gains, tape, (Carried::new(ar), None))
}

/// Runs the chain on over the legs, `from` where it is and the place it is at.
#[inline(always)]
pub(crate) fn forward_from<A: Arithmetic>(
    ar: A,
    legs: &impl Legs<A>,
    earth: &Earth<A::Number>,
    gains: &mut impl Gains<A>,
    tape: &mut Tape<A>,
    from: (Carried<A>, Option<Place<A>>),
) -> Carried<A> {
    let (chain, mut previous) = from;
    let mut forward = Forward {
        ar,
        legs,
        earth,
        gains,
        tape,
        chain,
    };
    for leg in 0..legs.count() {
        let at = legs.place(leg);
        if let Some(from) = previous
            && legs.rotates(leg)
        {
            forward.rotate(leg, &from, &at);
        }
        for index in 0..legs.stretches(leg) {
            forward.part::<STRETCH>(leg, index, &at);
        }
        if legs.settles(leg) {
            forward.part::<SETTLE>(leg, 0, &at);
        }
        forward.part::<DWELL>(leg, 0, &at);
        if legs.remains(leg) {
            forward.part::<REMAINDER>(leg, 0, &at);
        }
        previous = Some(at);
    }
    forward.chain
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

/// The sweep on its way back through the legs.
struct Backward<'a, A: Arithmetic, L, I, O> {
    ar: A,
    legs: &'a L,
    earth: &'a Earth<A::Number>,
    information: &'a I,
    /// Rows that the chain has told before the step at hand.
    row: usize,
    per_weight: A::Number,
    out: &'a mut [O],
    sweep: Sweep<A>,
    /// C̄ of the place before, from a change of position in frame-hold repositioning.
    before: Option<Square<A::Triple>>,
}

const ROTATE: u8 = 4;
const MEASURE: u8 = 5;

/// One step back, compiled apart in lanes.
struct Back<'b, 'a, A: Arithmetic, L, I, O, const PART: u8> {
    backward: &'b mut Backward<'a, A, L, I, O>,
    at: &'b Place<A>,
    leg: usize,
    step: &'b Step<A>,
}

impl<A: Arithmetic, L: Legs<A>, I: InformationAdjoint<A>, O: LegAdjoint<A::Number>, const PART: u8>
    Work for Back<'_, '_, A, L, I, O, PART>
{
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let (backward, leg, at) = (self.backward, self.leg, self.at);
        let sweep = &mut backward.sweep;
        match (PART, self.step) {
            (DWELL, Step::Dwell(dwell)) => {
                backward.row -= DWELL_ROWS;
                sweep.dwell(dwell, at, (backward.information, backward.row));
            }
            (SETTLE, Step::Settle(passed, gamma_c)) => sweep.pass_at(passed, gamma_c, at),
            (REMAINDER, Step::Remainder(passed, gamma_c, v, p)) => {
                let adjoint = sweep.length_adjoint(backward.earth, v, p, at);
                backward.out[leg].add_dwell(adjoint);
                sweep.pass_at(passed, gamma_c, at);
            }
            (MEASURE, Step::Measure(measure, v, grows)) => {
                backward.row -= MEASURED_ROWS;
                let adjoint = sweep.measure(measure, v, (backward.information, backward.row));
                let slope = adjoint * backward.per_weight;
                match grows {
                    Grows::WithMove(one) => backward.out[leg].add_move(slope * *one),
                    Grows::WithDwell => backward.out[leg].add_dwell(slope),
                }
            }
            (STRETCH, Step::Stretch(index, passed, v, p)) => {
                backward.stretch(leg, *index, passed, (v, p), at);
            }
            (ROTATE, Step::Rotate(q, v, p)) => {
                let from = backward.legs.place(leg - 1);
                let q_bar = sweep.rotate(q, v, p);
                sweep.add_to_place(&product(&q_bar, &from.rows));
                backward.before = Some(product(&transpose(&q_bar), &at.rows));
            }
            _ => {}
        }
    }
}

impl<A: Arithmetic, L: Legs<A>, I: InformationAdjoint<A>, O: LegAdjoint<A::Number>>
    Backward<'_, A, L, I, O>
{
    #[inline(always)]
    fn part<const PART: u8>(&mut self, leg: usize, step: &Step<A>, at: &Place<A>) {
        self.ar.apart(Back::<A, L, I, O, PART> {
            at,
            leg,
            step,
            backward: self,
        });
    }

    #[inline(always)]
    fn stretch(
        &mut self,
        leg: usize,
        index: usize,
        passed: &Passed<A>,
        (v, p): (&Wide<A::Quad>, &Entries<A::Number>),
        at: &Place<A>,
    ) {
        let s = self.legs.stretch(leg, index);
        let length = self.sweep.length_adjoint(self.earth, v, p, at) * s.last;
        let b = drift_integral_adjoint(
            self.ar,
            self.earth,
            &s.turn,
            &s.interval,
            &s.panels,
            &self.sweep.v,
        );
        self.out[leg].add_move(b.duration + length);
        self.out[leg].add_angles(&b.change);
        self.out[leg - 1].add_angles(&three!(|i| b.from[i] - b.change[i]));
        self.sweep.pass(passed);
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
    information: &impl InformationAdjoint<A>,
    per_weight: f64,
    out: &mut [impl LegAdjoint<A::Number>],
) {
    let mut backward = Backward {
        ar,
        legs,
        earth,
        information,
        row: tape.iter().map(|(_, step)| step.rows()).sum(),
        per_weight: ar.number(per_weight),
        out,
        sweep: Sweep::new(ar),
        before: None,
    };
    let mut rest = tape;
    for leg in (0..legs.count()).rev() {
        let at = legs.place(leg);
        while let Some(((of, step), earlier)) = rest.split_last() {
            if *of != leg {
                break;
            }
            rest = earlier;
            match step {
                Step::Dwell(..) => backward.part::<DWELL>(leg, step, &at),
                Step::Settle(..) => backward.part::<SETTLE>(leg, step, &at),
                Step::Remainder(..) => backward.part::<REMAINDER>(leg, step, &at),
                Step::Measure(..) => backward.part::<MEASURE>(leg, step, &at),
                Step::Stretch(..) => backward.part::<STRETCH>(leg, step, &at),
                Step::Rotate(..) => backward.part::<ROTATE>(leg, step, &at),
            }
        }
        let angles = backward.sweep.leave_place(&at, legs.alpha(leg));
        backward.out[leg].add_angles(&angles);
        if let Some(c) = backward.before.take() {
            backward.sweep.add_to_place(&c);
        }
    }
}
