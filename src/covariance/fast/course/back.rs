//! The way back through the legs: the reverse mode of [`super::forward`].

use super::{
    DWELL, Grows, Legs, OnTheWay, REMAINDER, SETTLE, STRETCH, Step, Stretch, on_the_way, vertical,
};
use crate::covariance::fast::adjoint::{
    InformationAdjoint, MEASURED_ROWS, PlaceAdjoint, Sweep, dwell_rows,
};
use crate::covariance::fast::arithmetic::{Arithmetic, Number, Work, three};
use crate::covariance::fast::earth::{Earth, Passed};
use crate::covariance::fast::moves::{body_rate, drift_integral_adjoint, pull_to_angles};
use crate::covariance::fast::shape::Shape;
use crate::covariance::fast::square::{Entries, product, transpose};
use crate::covariance::fast::turn::TurnAdjoint;
use crate::covariance::fast::{Place, Wide};
use crate::covariance::gradient::LegGradient;

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

/// Adds the adjoints of the move to a leg: of its angles at both ends, and `duration`, what of that of its
/// duration counts.
#[inline(always)]
pub(crate) fn add_turn<N: Number>(
    out: &mut [impl LegAdjoint<N>],
    leg: usize,
    of: &TurnAdjoint<N>,
    duration: N,
) {
    out[leg].add_angles(&of.change);
    out[leg - 1].add_angles(&three!(|i| of.from[i] - of.change[i]));
    out[leg].add_move(duration);
}

/// The sweep on its way back through the legs.
struct Backward<'a, A: Arithmetic, S: Shape, L, I, O> {
    ar: A,
    legs: &'a L,
    earth: &'a Earth<A::Number>,
    information: &'a I,
    /// Rows that the chain has told before the step at hand.
    row: usize,
    per_weight: A::Number,
    out: &'a mut [O],
    sweep: Sweep<'a, A, S>,
    /// Of the place before, from the change of position.
    before: Option<PlaceAdjoint<A, S>>,
}

const ROTATE: u8 = 4;
const MEASURE: u8 = 5;
const VERTICAL: u8 = 6;
const AZIMUTH: u8 = 7;

/// One step back, compiled apart in lanes.
struct Back<'b, 'a, A: Arithmetic, S: Shape, L, I, O, const PART: u8> {
    backward: &'b mut Backward<'a, A, S, L, I, O>,
    at: &'b Place<A, S>,
    leg: usize,
    step: &'b Step<A, S>,
}

impl<A, S, L, I, O, const PART: u8> Work for Back<'_, '_, A, S, L, I, O, PART>
where
    A: Arithmetic,
    S: Shape,
    L: Legs<A>,
    I: InformationAdjoint<A, S>,
    O: LegAdjoint<A::Number>,
{
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let (backward, leg, at) = (self.backward, self.leg, self.at);
        let sweep = &mut backward.sweep;
        match (PART, self.step) {
            (DWELL, Step::Dwell(dwell)) => {
                backward.row -= dwell_rows::<S>();
                let vertical = vertical::<_, S>(backward.ar, backward.legs, leg);
                sweep.dwell(dwell, at, vertical, (backward.information, backward.row));
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
                backward.add_weight(leg, adjoint, grows);
            }
            (AZIMUTH, Step::Azimuth(azimuth, v, grows)) => {
                backward.row -= 1;
                let adjoint = sweep.azimuth(azimuth, v, (backward.information, backward.row));
                let ratio = backward.legs.azimuth().unwrap_or(0.0);
                backward.add_weight(leg, adjoint * backward.ar.number(ratio), grows);
            }
            (VERTICAL, Step::Vertical(weight, grows, index)) => {
                backward.row -= 1;
                let adjoint = backward.vertical(leg, *weight, *index, at);
                backward.add_weight(leg, adjoint, grows);
            }
            (STRETCH, Step::Stretch(index, passed, v, p)) => {
                backward.stretch(leg, *index, passed, (v, p), at);
            }
            (ROTATE, Step::Rotate(q, v, p)) => backward.rotate(leg, q, (v, p), at),
            _ => {}
        }
    }
}

impl<A, S, L, I, O> Backward<'_, A, S, L, I, O>
where
    A: Arithmetic,
    S: Shape,
    L: Legs<A>,
    I: InformationAdjoint<A, S>,
    O: LegAdjoint<A::Number>,
{
    #[inline(always)]
    fn part<const PART: u8>(&mut self, leg: usize, step: &Step<A, S>, at: &Place<A, S>) {
        let ar = self.ar;
        let back = Back::<A, S, L, I, O, PART> {
            at,
            leg,
            step,
            backward: self,
        };
        match S::DRIFT_ONLY {
            true => ar.apart(back),
            false => ar.always_apart(back),
        }
    }

    /// Adds the derivative with respect to a measurement's weight.
    #[inline(always)]
    fn add_weight(&mut self, leg: usize, adjoint: A::Number, grows: &Grows<A::Number>) {
        let slope = adjoint * self.per_weight;
        match grows {
            Grows::WithMove(one) => self.out[leg].add_move(slope * *one),
            Grows::WithDwell => self.out[leg].add_dwell(slope),
        }
    }

    #[inline(always)]
    fn place(&self, leg: usize) -> Place<A, S> {
        Place::new(self.ar, self.earth, self.legs.attitude(leg))
    }

    #[inline(always)]
    fn rotate(
        &mut self,
        leg: usize,
        q: &Entries<A::Number>,
        (v, p): (&Wide<A::Quad, S>, &Entries<A::Number>),
        at: &Place<A, S>,
    ) {
        let one = self.ar.number(1.0);
        let from = self.place(leg - 1);
        if S::GROUPS > 1 {
            self.sweep.place.add_shift(self.ar, at, &self.sweep.v, one);
        }
        let q_bar = self.sweep.rotate(q, v, p);
        self.sweep.place.add(&product(&q_bar, &from.rows[0]));
        let mut before = PlaceAdjoint::nothing(self.ar);
        before.c = product(&transpose(&q_bar), &at.rows[0]);
        if S::GROUPS > 1 {
            before.add_shift(self.ar, &from, &self.sweep.v, -one);
        }
        self.before = Some(before);
    }

    /// Takes the vertical channel of a measurement back.
    #[inline(always)]
    fn vertical(
        &mut self,
        leg: usize,
        weight: A::Number,
        index: Option<usize>,
        at: &Place<A, S>,
    ) -> A::Number {
        let (ar, information, row) = (self.ar, self.information, self.row);
        match index {
            Some(index) if index + 1 < self.legs.stretches(leg) => {
                let s = self.legs.stretch(leg, index);
                let end = on_the_way(ar, self.earth, &s, true);
                let mut adjoint = PlaceAdjoint::nothing(ar);
                let of_weight =
                    information.take_vertical_back(ar, &mut adjoint, row, &end.place, weight);
                self.add_on_the_way(leg, &s, &end, &adjoint);
                of_weight
            }
            _ => {
                let place = &mut self.sweep.place;
                information.take_vertical_back(ar, place, row, at, weight)
            }
        }
    }

    /// Adds the adjoint of a place on the way to the angles at both ends and the duration.
    #[inline(always)]
    fn add_on_the_way(
        &mut self,
        leg: usize,
        s: &Stretch<A::Number, A::Panels>,
        on_the_way: &OnTheWay<A, S>,
        adjoint: &PlaceAdjoint<A, S>,
    ) {
        let OnTheWay { place, way, alpha } = on_the_way;
        let (c, _) = adjoint.pull(&place.c, &self.earth.vector());
        let angles = pull_to_angles(self.earth.stand(), &place.c, *alpha, &c);
        // The place is at a time, and the angles there change by their rates.
        let of = s.turn.pull(way, &angles);
        add_turn(self.out, leg, &of, of.duration);
    }

    /// The place at the end of a move while the platform still turns.
    #[inline(always)]
    fn while_turning(
        &self,
        leg: usize,
        s: &Stretch<A::Number, A::Panels>,
        at: &Place<A, S>,
    ) -> Place<A, S> {
        if S::DRIFT_ONLY {
            return *at;
        }
        let rate = body_rate(
            self.earth.stand(),
            &at.c,
            self.legs.alpha(leg),
            &self.earth.vector(),
            &s.turn.rates_at_end(),
        );
        Place::turning(self.ar, self.earth, at.c, &rate)
    }

    #[inline(always)]
    fn stretch(
        &mut self,
        leg: usize,
        index: usize,
        passed: &Passed<A>,
        (v, p): (&Wide<A::Quad, S>, &Entries<A::Number>),
        at: &Place<A, S>,
    ) {
        let ar = self.ar;
        let s = self.legs.stretch(leg, index);
        let turning = self.while_turning(leg, &s, at);
        let length = self.sweep.length_adjoint(self.earth, v, p, &turning) * s.last;
        if S::GROUPS > 1 {
            if index + 1 < self.legs.stretches(leg) {
                let end = on_the_way(ar, self.earth, &s, true);
                let mut adjoint = PlaceAdjoint::nothing(ar);
                adjoint.add_shift(ar, &end.place, &self.sweep.v, s.present);
                self.add_on_the_way(leg, &s, &end, &adjoint);
            } else {
                self.sweep.place.add_shift(ar, at, &self.sweep.v, s.present);
            }
        }
        let b = drift_integral_adjoint::<A, S>(
            ar,
            self.earth,
            &s.turn,
            &s.interval,
            &s.panels,
            &self.sweep.v,
        );
        let mut of_duration = b.duration + length;
        if !S::DRIFT_ONLY {
            // A move without duration has none to change.
            of_duration = of_duration * s.turn.time;
        }
        add_turn(self.out, leg, &b, of_duration);
        self.sweep.pass(passed);
        if S::GROUPS > 1 {
            if index > 0 {
                let start = on_the_way(ar, self.earth, &s, false);
                let mut adjoint = PlaceAdjoint::nothing(ar);
                adjoint.add_shift(ar, &start.place, &self.sweep.v, -s.present);
                self.add_on_the_way(leg, &s, &start, &adjoint);
            } else {
                let from = self.place(leg - 1);
                let mut before = PlaceAdjoint::nothing(ar);
                before.add_shift(ar, &from, &self.sweep.v, -s.present);
                self.before = Some(before);
            }
        }
    }
}

/// The way back: adds the derivatives of every leg to `out`, one entry per leg, zero at first.
/// `per_weight` is the derivative of a relaxed measurement's weight with respect to its length.
#[inline(always)]
pub(crate) fn backward<A: Arithmetic, S: Shape>(
    ar: A,
    legs: &impl Legs<A>,
    earth: &Earth<A::Number>,
    tape: &[(usize, Step<A, S>)],
    information: &impl InformationAdjoint<A, S>,
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
        sweep: Sweep::new(ar, earth),
        before: None,
    };
    let mut rest = tape;
    for leg in (0..legs.count()).rev() {
        let at = backward.place(leg);
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
                Step::Azimuth(..) => backward.part::<AZIMUTH>(leg, step, &at),
                Step::Vertical(..) => backward.part::<VERTICAL>(leg, step, &at),
                Step::Stretch(..) => backward.part::<STRETCH>(leg, step, &at),
                Step::Rotate(..) => backward.part::<ROTATE>(leg, step, &at),
            }
        }
        if S::GROUPS > 1 && leg == 0 {
            let sweep = &mut backward.sweep;
            sweep.place.add_shift(ar, &at, &sweep.v, ar.number(1.0));
        }
        let angles = backward.sweep.leave_place(&at, legs.alpha(leg));
        backward.out[leg].add_angles(&angles);
        if let Some(before) = backward.before.take() {
            backward.sweep.place = before;
        }
    }
}
