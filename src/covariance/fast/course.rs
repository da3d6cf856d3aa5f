//! The order of the steps: a timeline, or one per lane, through the chain and back.
//!
//! What happens on a leg, each part only where some lane has it: the change of position in
//! frame-hold repositioning, an unmeasured move, the ticks of a measured one, the settling, the
//! dwell's whole periods, its remainder with the relaxed measurement. A lane that lacks a part
//! that another has takes it with length and weight zero, which changes nothing.

mod back;

pub(crate) use back::{LegAdjoint, add_turn, backward};

use super::adjoint::{MEASURED_ROWS, dwell_rows};
use super::arithmetic::{Arithmetic, Work};
use super::earth::{Earth, Passed};
use super::gains::{DwellKernel, Gains, Seen};
use super::moves::{Interval, drift_integral};
use super::shape::{Drift, Shape};
use super::square::{Entries, entries, product, rows, transpose};
use super::turn::{self, Turn};
use super::{AzimuthStep, Carried, Collected, Collecting, DwellStep, MeasureStep, Place, Wide};
use crate::motion::integral::Panels;

/// An interval of a move without a measurement in it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stretch<N, P> {
    pub turn: Turn<N>,
    pub interval: Interval<N>,
    pub panels: P,
    /// The time that passes in it, s: the interval's length, or 0 in a move without duration.
    pub elapsed_s: N,
    /// 1, or 0 in lanes that have no such stretch.
    pub present: N,
    /// Of lanes whose move ends here 1, else 0.
    pub last: N,
    /// The weight of the measurement after it, 1/arcsec², and 1 where it follows the length, else
    /// 0.
    pub measured: Option<(N, N)>,
}

impl Stretch<f64, Panels> {
    /// A stretch of no length, for lanes that have none.
    pub fn nothing() -> Self {
        Self {
            turn: Turn {
                from: [0.0; 3],
                change: [0.0; 3],
                duration_s: 1.0,
                time: 1.0,
                // Nothing happens in it, in no time or another.
                instant: true,
                way: [0.0, 1.0, 0.0],
                ramp: None,
            },
            interval: Interval {
                start_s: 0.0,
                length_s: 0.0,
            },
            elapsed_s: 0.0,
            present: 0.0,
            panels: Panels::of_half_phase(0.0),
            last: 0.0,
            measured: None,
        }
    }
}

/// The legs of a timeline, or of one per lane.
pub(crate) trait Legs<A: Arithmetic> {
    /// How many there are.
    fn count(&self) -> usize;
    /// C_c^n in the position.
    fn attitude(&self, leg: usize) -> Entries<A::Number>;
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
    /// The information of a measurement of the azimuth beside that of ψ_x or ψ_z, as a ratio; none
    /// where it is not measured.
    fn azimuth(&self) -> Option<f64>;
    /// The information of its measurements of the vertical channel, 1/arcsec².
    fn vertical(&self, leg: usize) -> A::Number;
    /// Whether the dwell has a rest.
    fn remains(&self, leg: usize) -> bool;
    /// The rest, s, and the weight of the measurement that ends it, 1/arcsec².
    fn remainder(&self, leg: usize) -> (A::Number, Option<A::Number>);
}

/// What the reverse mode has to remember of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Step<A: Arithmetic, S: Shape = Drift> {
    /// A change of position: q, V (not shifted by the accelerometers) and P before it.
    Rotate(Entries<A::Number>, Wide<A::Quad, S>, Entries<A::Number>),
    /// A stretch of a move: its index, V and P after it.
    Stretch(usize, Passed<A>, Wide<A::Quad, S>, Entries<A::Number>),
    /// Settling, with Γ C.
    Settle(Passed<A>, S::Groups<Entries<A::Number>>),
    /// Whole periods of a dwell.
    Dwell(DwellStep<A, S>),
    /// The rest of a dwell: Γ C, V and P after it.
    Remainder(
        Passed<A>,
        S::Groups<Entries<A::Number>>,
        Wide<A::Quad, S>,
        Entries<A::Number>,
    ),
    /// A measurement with V after it, and what its weight grows with.
    Measure(MeasureStep<A, S>, Wide<A::Quad, S>, Grows<A::Number>),
    /// The azimuth of a measurement with V after it, and what its weight grows with.
    Azimuth(AzimuthStep<A, S>, Wide<A::Quad, S>, Grows<A::Number>),
    /// The vertical channel of a measurement: its weight, what that grows with, and after which
    /// stretch of a move it is, if it is in one.
    Vertical(A::Number, Grows<A::Number>, Option<usize>),
}

impl<A: Arithmetic, S: Shape> Step<A, S> {
    /// How many rows it tells.
    fn rows(&self) -> usize {
        match self {
            Self::Dwell(_) => dwell_rows::<S>(),
            Self::Measure(..) => MEASURED_ROWS,
            Self::Azimuth(..) | Self::Vertical(..) => 1,
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
pub(crate) struct Tape<A: Arithmetic, S: Shape = Drift> {
    /// Whether anything is kept.
    pub on: bool,
    /// Leg and step, in order.
    pub steps: Vec<(usize, Step<A, S>)>,
}

impl<A: Arithmetic, S: Shape> Tape<A, S> {
    #[inline(always)]
    fn push(&mut self, leg: usize, step: Step<A, S>) {
        if self.on {
            self.steps.push((leg, step));
        }
    }
}

/// The chain on its way through the legs.
struct Forward<'a, A: Arithmetic, S: Collecting, L, G> {
    ar: A,
    legs: &'a L,
    earth: &'a Earth<A::Number>,
    gains: &'a mut G,
    tape: &'a mut Tape<A, S>,
    chain: Carried<A, S>,
}

/// Parts of a leg.
const STRETCH: u8 = 0;
const SETTLE: u8 = 1;
const DWELL: u8 = 2;
const REMAINDER: u8 = 3;

/// One part of a leg, compiled apart in lanes.
struct Part<'b, 'a, A: Arithmetic, S: Collecting, L, G, const PART: u8> {
    forward: &'b mut Forward<'a, A, S, L, G>,
    from: Option<&'b Place<A, S>>,
    at: &'b Place<A, S>,
    leg: usize,
    index: usize,
}

impl<A: Arithmetic, S: Collecting, L: Legs<A>, G: Gains<A>, const PART: u8> Work
    for Part<'_, '_, A, S, L, G, PART>
{
    type Output = ();
    #[inline(always)]
    fn run(self) {
        match PART {
            STRETCH => (self.forward).stretch(self.leg, self.index, self.from, self.at),
            SETTLE => self.forward.settle(self.leg, self.at),
            DWELL => self.forward.dwell(self.leg, self.at),
            _ => self.forward.remainder(self.leg, self.at),
        }
    }
}

/// A place in a move.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OnTheWay<A: Arithmetic, S: Shape> {
    pub place: Place<A, S>,
    /// How far the move is.
    pub way: turn::OnTheWay<A::Number>,
    /// (sin α, cos α).
    pub alpha: (A::Number, A::Number),
}

/// Where a stretch of a move begins or (`end`) ends, if that is not at a position.
#[inline(always)]
pub(crate) fn on_the_way<A: Arithmetic, S: Shape>(
    ar: A,
    earth: &Earth<A::Number>,
    s: &Stretch<A::Number, A::Panels>,
    end: bool,
) -> OnTheWay<A, S> {
    let Interval { start_s, length_s } = s.interval;
    let at_s = if end { start_s + length_s } else { start_s };
    let way = s.turn.at(at_s);
    let (c, alpha) = s.turn.attitude_at(earth.stand(), &way);
    OnTheWay {
        place: Place::new(ar, earth, c),
        way,
        alpha,
    }
}

impl<A: Arithmetic, S: Collecting, L: Legs<A>, G: Gains<A>> Forward<'_, A, S, L, G> {
    #[inline(always)]
    fn part<const PART: u8>(
        &mut self,
        (leg, index): (usize, usize),
        from: Option<&Place<A, S>>,
        at: &Place<A, S>,
    ) {
        let ar = self.ar;
        let part = Part::<A, S, L, G, PART> {
            from,
            at,
            leg,
            index,
            forward: self,
        };
        // Of a wide shape each part is as long as the whole chain of twelve coefficients.
        match S::DRIFT_ONLY {
            true => ar.apart(part),
            false => ar.always_apart(part),
        }
    }

    #[inline(always)]
    fn rotate(&mut self, leg: usize, from: &Place<A, S>, at: &Place<A, S>) {
        let q = entries(&product(&at.c, &rows(self.ar, &transpose(&from.c))));
        let one = self.ar.number(1.0);
        if S::GROUPS > 1 {
            self.chain.shift(from, -one);
        }
        self.tape
            .push(leg, Step::Rotate(q, self.chain.v, self.gains.p()));
        self.chain.rotate(&q);
        self.gains.rotate(&q);
        if S::GROUPS > 1 {
            self.chain.shift(at, one);
        }
    }

    #[inline(always)]
    fn stretch(&mut self, leg: usize, index: usize, from: Option<&Place<A, S>>, at: &Place<A, S>) {
        let s = self.legs.stretch(leg, index);
        let (passed, p, seen) = self.gains.stretch(&s);
        let b = drift_integral::<A, S>(self.ar, self.earth, &s.turn, &s.interval, &s.panels);
        if S::GROUPS > 1 {
            match from {
                Some(from) if index == 0 => self.chain.shift(from, -s.present),
                _ => {
                    let from = on_the_way(self.ar, self.earth, &s, false);
                    self.chain.shift(&from.place, -s.present);
                }
            }
        }
        self.chain.pass(&passed, &b);
        let mut end = *at;
        if S::GROUPS > 1 {
            if index + 1 < self.legs.stretches(leg) {
                end = on_the_way(self.ar, self.earth, &s, true).place;
            }
            self.chain.shift(&end, s.present);
        }
        self.tape
            .push(leg, Step::Stretch(index, passed, self.chain.v, p));
        if let Some((_, grows)) = s.measured
            && let Some(seen) = seen
        {
            self.measure(leg, &seen, Grows::WithMove(grows), Some(index), &end);
        }
    }

    #[inline(always)]
    fn measure(
        &mut self,
        leg: usize,
        seen: &Seen<A>,
        grows: Grows<A::Number>,
        index: Option<usize>,
        at: &Place<A, S>,
    ) {
        let step = self.chain.measure(seen);
        self.tape
            .push(leg, Step::Measure(step, self.chain.v, grows));
        if !S::DRIFT_ONLY
            && let Some(azimuth) = self.gains.azimuth(seen.weight)
        {
            let step = self.chain.measure_azimuth(self.ar, &azimuth);
            self.tape
                .push(leg, Step::Azimuth(step, self.chain.v, grows));
        }
        if S::GROUPS > 1 {
            self.chain.e.of_vertical(at, seen.weight);
            self.tape
                .push(leg, Step::Vertical(seen.weight, grows, index));
        }
    }

    #[inline(always)]
    fn settle(&mut self, leg: usize, at: &Place<A, S>) {
        let passed = self.gains.settle(leg);
        let gamma_c = self.chain.pass_at(&passed, at);
        self.tape.push(leg, Step::Settle(passed, gamma_c));
    }

    #[inline(always)]
    fn dwell(&mut self, leg: usize, at: &Place<A, S>) {
        if let Some(gain) = self.gains.dwell(leg) {
            let step = self
                .chain
                .dwell(&gain, at, vertical::<_, S>(self.ar, self.legs, leg));
            self.tape.push(leg, Step::Dwell(step));
        }
    }

    #[inline(always)]
    fn remainder(&mut self, leg: usize, at: &Place<A, S>) {
        let (passed, p, seen) = self.gains.remainder(leg);
        let gamma_c = self.chain.pass_at(&passed, at);
        self.tape
            .push(leg, Step::Remainder(passed, gamma_c, self.chain.v, p));
        if let Some(seen) = seen {
            self.measure(leg, &seen, Grows::WithDwell, None, at);
        }
    }
}

/// The information of the vertical channel in a dwell; without accelerometers it does not matter.
#[inline(always)]
fn vertical<A: Arithmetic, S: Shape>(ar: A, legs: &impl Legs<A>, leg: usize) -> A::Number {
    match S::GROUPS > 1 {
        true => legs.vertical(leg),
        false => ar.number(0.0),
    }
}

/// Runs the chain over the legs from its start on.
#[inline(always)]
pub(crate) fn forward<A: Arithmetic, S: Collecting>(
    ar: A,
    legs: &impl Legs<A>,
    earth: &Earth<A::Number>,
    gains: &mut impl Gains<A>,
    tape: &mut Tape<A, S>,
) -> Carried<A, S> {
    forward_from(ar, legs, earth, gains, tape, (Carried::new(ar), None))
}

/// Runs the chain on over the legs, `from` where it is and the place it is at.
#[inline(always)]
pub(crate) fn forward_from<A: Arithmetic, S: Collecting>(
    ar: A,
    legs: &impl Legs<A>,
    earth: &Earth<A::Number>,
    gains: &mut impl Gains<A>,
    tape: &mut Tape<A, S>,
    from: (Carried<A, S>, Option<Place<A, S>>),
) -> Carried<A, S> {
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
        let at = Place::new(ar, earth, legs.attitude(leg));
        if S::GROUPS > 1 && previous.is_none() {
            // V is 0 there, and so V' = U.
            forward.chain.shift(&at, ar.number(1.0));
        }
        if let Some(from) = &previous
            && legs.rotates(leg)
        {
            forward.rotate(leg, from, &at);
        }
        for index in 0..legs.stretches(leg) {
            forward.part::<STRETCH>((leg, index), previous.as_ref(), &at);
        }
        if legs.settles(leg) {
            forward.part::<SETTLE>((leg, 0), None, &at);
        }
        forward.part::<DWELL>((leg, 0), None, &at);
        if legs.remains(leg) {
            forward.part::<REMAINDER>((leg, 0), None, &at);
        }
        previous = Some(at);
    }
    forward.chain
}
