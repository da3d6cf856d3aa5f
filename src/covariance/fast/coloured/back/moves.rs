//! The way back through moves.

use super::{Backward, Sweep};
use crate::covariance::fast::arithmetic::{Arithmetic, Number, three};
use crate::covariance::fast::coloured::algebra::{
    Matrix, dots, product, times_passed, transpose, transposed_product, turn_covariance, zeros,
};
use crate::covariance::fast::coloured::course::{Wanders, first_turned, on_the_way, part};
use crate::covariance::fast::coloured::integral::integral_adjoint;
use crate::covariance::fast::coloured::moving::Panel;
use crate::covariance::fast::coloured::rows::turn_blocks;
use crate::covariance::fast::coloured::tape::{At, Step, Turning};
use crate::covariance::fast::coloured::wander::Transition;
use crate::covariance::fast::coloured::{Place, PlaceAdjoint};
use crate::covariance::fast::course::{LegAdjoint, add_turn};
use crate::covariance::fast::moves::body_rate;
use crate::covariance::fast::square::{Entries, dot};

/// What depends on a place at the start or the end of a step of a move: a shift by the accelerometers,
/// an attitude.
struct AtPlace<N> {
    shift: N,
    c: Entries<N>,
}

impl<A: Arithmetic, L, O, const S: usize, const I: usize> Backward<'_, A, L, O, S, I>
where
    L: Wanders<A>,
    O: LegAdjoint<A::Number>,
{
    /// Adds what depends on the place where a stretch starts or ends; none: where the position before was
    /// left, or this one reached.
    #[inline(always)]
    fn add_at(
        &mut self,
        sweep: &mut Sweep<A, S>,
        leg: usize,
        (index, end): (At, bool),
        of: &AtPlace<A::Number>,
    ) {
        let columns = self.columns;
        let at_position = match (index, end) {
            (None, _) => true,
            (Some(index), false) => index == 0,
            (Some(index), true) => index + 1 >= self.legs.stretches(leg),
        };
        let mut adjoint = match (at_position, end) {
            (true, true) => std::mem::replace(&mut sweep.place, PlaceAdjoint::none(self.ar)),
            (true, false) => std::mem::replace(&mut sweep.before, PlaceAdjoint::none(self.ar)),
            (false, _) => self.nothing(),
        };
        adjoint.add_shift(columns, &sweep.v, of.shift);
        for i in 0..3 {
            for j in 0..3 {
                adjoint.c[i][j] = adjoint.c[i][j] + of.c[i][j];
            }
        }
        match (at_position, end, index) {
            (true, true, _) => sweep.place = adjoint,
            (true, false, _) => sweep.before = adjoint,
            (false, _, Some(index)) => {
                let s = self.legs.stretch(leg, index);
                self.add_on_the_way(leg, &s, end, adjoint);
            }
            (false, _, None) => {}
        }
    }

    #[inline(always)]
    pub(super) fn shifted(&mut self, sweep: &mut Sweep<A, S>, leg: usize, index: At, end: bool) {
        let (zero, one) = (self.ar.number(0.0), self.ar.number(1.0));
        if !self.columns.has_accelerometers() {
            return;
        }
        let present = match index {
            Some(index) => self.legs.stretch(leg, index).present,
            None => one,
        };
        let of = AtPlace {
            shift: if end { present } else { -present },
            c: [[zero; 3]; 3],
        };
        self.add_at(sweep, leg, (index, end), &of);
    }

    #[inline(always)]
    pub(super) fn moved(
        &mut self,
        sweep: &mut Sweep<A, S>,
        leg: usize,
        step: &Step<A::Number>,
        at: &Place<A>,
    ) {
        let Step::Moved { index, v, p } = *step else {
            return;
        };
        let (ar, columns, earth) = (self.ar, self.columns, self.earth);
        let s = self.legs.stretch(leg, index);
        // While the platform still turns.
        let alpha = self.legs.alpha(leg);
        let rate = body_rate(
            earth.stand(),
            &at.c,
            alpha,
            &earth.vector(),
            &s.turn.rates_at_end(),
        );
        let turning = Place::new(ar, columns, earth, at.c, &rate);
        let length = self.length_adjoint(sweep, v, p, &turning) * s.last;
        let of = columns.collected(ar, &sweep.v[..3 * columns.width]);
        let b = integral_adjoint(ar, columns, earth, &s.turn, &s.interval, &s.panels, &of);
        // A move without duration has none to change.
        add_turn(self.out, leg, &b, (b.duration + length) * s.turn.time);
    }

    #[inline(always)]
    pub(super) fn panel(&mut self, sweep: &mut Sweep<A, S>, leg: usize, step: &Step<A::Number>) {
        let Step::Panel {
            index,
            panel,
            t,
            v,
            p,
        } = *step
        else {
            return;
        };
        let s = self.legs.stretch(leg, index);
        let (_, count) = self.legs.panels(leg, index);
        let t = &self.tape.passed[t];
        let of_transition = self.of_transition(sweep, t, (v, p));
        let at = Panel::new(self.earth, &s.turn, &part(&s, panel, count));
        let of = at.pull(
            self.earth.stand(),
            &self.wander.slots,
            &of_transition,
            &sweep.p,
        );
        add_turn(self.out, leg, &of, of.duration * s.turn.time);
        self.pass(sweep, t);
    }

    #[inline(always)]
    pub(super) fn turn(
        &mut self,
        sweep: &mut Sweep<A, S>,
        leg: usize,
        step: &Step<A::Number>,
        at: &Place<A>,
    ) {
        let Step::Turn {
            at: index,
            kind,
            q,
            v,
            p,
        } = *step
        else {
            return;
        };
        let zero = self.ar.number(0.0);
        let (q, first) = (&self.tape.small[q], first_turned(index));
        let turns = self.legs.turns(leg);
        let of_q = self.of_turn(sweep, (q, first), (v, p));
        let of_q = three!(|i| three!(|j| of_q[i][j] * turns));
        let (start, end) = self.ends(leg, index, at);
        // q is C₂ C₁ᵀ, C₁ᵀ or C₂.
        let (of_start, of_end) = match kind {
            Turning::Across => (
                Some(transposed_product(self.ar, &of_q, &end)),
                Some(product(self.ar, &of_q, &start)),
            ),
            Turning::Into => (Some(transpose(&of_q)), None),
            Turning::OutOf => (None, Some(of_q)),
        };
        for (of, is_end) in [(of_start, false), (of_end, true)] {
            if let Some(c) = of {
                let of = AtPlace { shift: zero, c };
                self.add_at(sweep, leg, (index, is_end), &of);
            }
        }
        let back = transpose(q);
        turn_blocks::<_, S>(&back, first, &mut sweep.v, self.columns.width);
        sweep.p = turn_covariance(self.ar, &back, first, &sweep.p);
    }

    /// The attitudes where a stretch starts and ends.
    #[inline(always)]
    fn ends(
        &self,
        leg: usize,
        index: At,
        at: &Place<A>,
    ) -> (Entries<A::Number>, Entries<A::Number>) {
        let on_way = |index: usize, end: bool| {
            let s = self.legs.stretch(leg, index);
            on_the_way(self.ar, self.columns, self.earth, &s, end).0.c
        };
        let start = match index {
            Some(index) if index > 0 => on_way(index, false),
            _ => self.legs.attitude(leg - 1),
        };
        let end = match index {
            Some(index) if index + 1 < self.legs.stretches(leg) => on_way(index, true),
            _ => at.c,
        };
        (start, end)
    }

    /// T̄ of ψ's rows.
    #[inline(always)]
    fn of_transition(
        &self,
        sweep: &Sweep<A, S>,
        t: &Transition<A::Number, S>,
        (v, p): (usize, usize),
    ) -> Matrix<A::Number, 3, S> {
        let two = self.ar.number(2.0);
        let width = self.columns.width;
        let mut of: Matrix<A::Number, 3, S> = dots(self.ar, &sweep.v, self.kept(v), width);
        let mut rows = zeros::<_, 3, S>(self.ar.number(0.0));
        rows.copy_from_slice(&sweep.p[..3]);
        let through = times_passed(&rows, &t.top, &t.kept);
        let by_p = product(self.ar, &through, &self.tape.states[p]);
        for i in 0..3 {
            for j in 0..S {
                of[i][j] = by_p[i][j].mul_add(two, of[i][j]);
            }
        }
        of
    }

    /// q̄, of the turn of all blocks from `first` on.
    #[inline(always)]
    fn of_turn(
        &self,
        sweep: &Sweep<A, S>,
        (q, first): (&Entries<A::Number>, usize),
        (v, p): (usize, usize),
    ) -> Entries<A::Number> {
        let (zero, two) = (self.ar.number(0.0), self.ar.number(2.0));
        let width = self.columns.width;
        let (v, p) = (self.kept(v), &self.tape.states[p]);
        let mut of = [[zero; 3]; 3];
        for block in (first..S).step_by(3) {
            let by_v: Entries<A::Number> = dots(
                self.ar,
                &sweep.v[block * width..],
                &v[block * width..],
                width,
            );
            for i in 0..3 {
                // Row i of P̄ T.
                let mut row = sweep.p[block + i];
                for at in (first..S).step_by(3) {
                    let from = three!(|k| sweep.p[block + i][at + k]);
                    for j in 0..3 {
                        row[at + j] = dot(&from, &three!(|k| q[k][j]));
                    }
                }
                for j in 0..3 {
                    let mut by_p = zero;
                    for k in 0..S {
                        by_p = row[k].mul_add(p[k][block + j], by_p);
                    }
                    of[i][j] = of[i][j] + by_p.mul_add(two, by_v[i][j]);
                }
            }
        }
        of
    }
}
