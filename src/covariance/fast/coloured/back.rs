//! The way back through the legs: the reverse mode of [`super::course`].
//!
//! As [`super::super::adjoint`] has it for the twelve coefficients. With F = rows · Ē, V̄ and P̄ the adjoints
//! after a dwell and X̄ = 2 F_X those before it are
//!
//! ```text
//! V̄ ← Mᵀ V̄ + Yᵀ X̄,   ū = Nᵀ V̄ + Zᵀ X̄ + 2 R22ᵀ F_R,   P̄ ← Mᵀ P̄ M − sym(Mᵀ V̄ Xᵀ Y) − Yᵀ F_X Xᵀ Y,
//! ```
//!
//! and of a transition T, from V and P before it, T̄ = V̄ Vᵀ + 2 P̄ T P.

mod moves;

use super::algebra::{
    Matrix, add_combined, difference, dots, product, pull_covariance, symmetric, transpose,
    transposed_product, turn_rows, zeros,
};
use super::course::{Wanders, on_the_way};
use super::measuring::seen;
use super::rows::{add, pull_rows};
use super::tape::{At, Channel, Step, Tape, Told};
use super::wander::{Transition, Wander};
use super::{Columns, Place, PlaceAdjoint};
use crate::attitude::UP;
use crate::covariance::fast::arithmetic::{Arithmetic, Number, Row, Work};
use crate::covariance::fast::course::{Grows, LegAdjoint, Stretch, add_turn};
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::moves::pull_to_angles;

/// The sweep on its way back.
pub(super) struct Backward<'a, A: Arithmetic, L, O, const S: usize, const I: usize> {
    pub ar: A,
    pub columns: &'a Columns,
    pub wander: &'a Wander,
    pub legs: &'a L,
    pub earth: &'a Earth<A::Number>,
    pub tape: &'a Tape<A, S, I>,
    pub told: &'a Told<A>,
    /// Every row times Ē.
    pub through: &'a [A::Quad],
    /// The derivative of a relaxed measurement's weight with respect to its length.
    pub per_weight: A::Number,
    pub out: &'a mut [O],
}

/// Adjoints of V and P after the step at hand, and of the place where it happens.
struct Sweep<A: Arithmetic, const S: usize> {
    v: Vec<A::Quad>,
    p: Matrix<A::Number, S, S>,
    place: PlaceAdjoint<A>,
    /// Of the place before.
    before: PlaceAdjoint<A>,
}

/// A place on the way, compiled once.
struct OnTheWay<'b, 'a, A: Arithmetic, L, O, const S: usize, const I: usize> {
    backward: &'b mut Backward<'a, A, L, O, S, I>,
    leg: usize,
    s: &'b Stretch<A::Number, A::Panels>,
    end: bool,
    adjoint: PlaceAdjoint<A>,
}

impl<A: Arithmetic, L, O, const S: usize, const I: usize> Work for OnTheWay<'_, '_, A, L, O, S, I>
where
    L: Wanders<A>,
    O: LegAdjoint<A::Number>,
{
    type Output = ();
    #[inline(always)]
    fn run(self) {
        (self.backward).pull_on_the_way(self.leg, self.s, self.end, self.adjoint);
    }
}

impl<A: Arithmetic, L, O, const S: usize, const I: usize> Backward<'_, A, L, O, S, I>
where
    L: Wanders<A>,
    O: LegAdjoint<A::Number>,
{
    /// V as it was kept.
    #[inline(always)]
    fn kept(&self, at: usize) -> &[A::Quad] {
        &self.tape.rows[at..at + S * self.columns.width]
    }

    #[inline(always)]
    fn rows<'r>(&self, of: &'r [A::Quad], row: usize, count: usize) -> &'r [A::Quad] {
        let width = self.columns.width;
        &of[row * width..(row + count) * width]
    }

    #[inline(always)]
    fn place(&self, leg: usize) -> Place<A> {
        Place::at_rest(self.ar, self.columns, self.earth, self.legs.attitude(leg))
    }

    #[inline(always)]
    fn nothing(&self) -> PlaceAdjoint<A> {
        PlaceAdjoint::nothing(self.ar, self.columns)
    }

    /// Adds the derivatives of every leg to `out`, zero at first.
    #[inline(always)]
    pub fn run(mut self) {
        let zero = self.ar.number(0.0);
        let mut sweep = Sweep {
            v: vec![self.ar.quad([zero; 4]); S * self.columns.width],
            p: zeros(zero),
            place: self.nothing(),
            before: self.nothing(),
        };
        let mut rest = &self.tape.steps[..];
        for leg in (0..self.legs.count()).rev() {
            let at = self.place(leg);
            while let Some(((of, step), earlier)) = rest.split_last() {
                if *of != leg {
                    break;
                }
                rest = earlier;
                self.step(&mut sweep, leg, step, &at);
            }
            if leg == 0 {
                self.start(&mut sweep, &at);
            }
            let rate = self.earth.vector();
            let (c, _) = sweep.place.pull(self.columns, self.earth, &at, &rate);
            let angles = pull_to_angles(self.earth.stand(), &at.c, self.legs.alpha(leg), &c);
            self.out[leg].add_angles(&angles);
            sweep.place = std::mem::replace(&mut sweep.before, self.nothing());
        }
    }

    /// What V and P are before anything is measured.
    #[inline(always)]
    fn start(&self, sweep: &mut Sweep<A, S>, at: &Place<A>) {
        let (columns, two) = (self.columns, self.ar.number(2.0));
        sweep
            .place
            .add_shift(columns, &sweep.v, self.ar.number(1.0));
        if columns.walked.is_empty() {
            return;
        }
        let first = 3 * columns.width;
        let of_walked = &sweep.v[first..2 * first];
        sweep
            .place
            .add_columns(columns, &columns.walked, of_walked, at);
        // Of C D Cᵀ.
        for i in 0..3 {
            for k in 0..3 {
                let sigma = self.ar.number(columns.walked_sigma[k]);
                let mut sum = sweep.p[3 + i][3] * at.c[0][k];
                for j in 1..3 {
                    sum = sweep.p[3 + i][3 + j].mul_add(at.c[j][k], sum);
                }
                let to = &mut sweep.place.c[i][k];
                *to = (sum * two).mul_add(sigma * sigma, *to);
            }
        }
    }

    #[inline(always)]
    fn step(&mut self, sweep: &mut Sweep<A, S>, leg: usize, step: &Step<A::Number>, at: &Place<A>) {
        let width = self.columns.width;
        match step {
            Step::Dwell { .. } => self.dwell(sweep, step),
            Step::Pass { t, gamma } => {
                let gamma = transpose(&self.tape.small[*gamma]);
                add_combined(self.ar, &mut sweep.place.drift, &gamma, &sweep.v, width);
                self.pass(sweep, &self.tape.passed[*t]);
            }
            Step::Length { v, p } => {
                let slope = self.length_adjoint(sweep, *v, *p, at);
                self.out[leg].add_dwell(slope);
            }
            Step::Measure { grows, ratio, .. } => {
                let slope = self.measure(sweep, leg, step);
                self.add_weight(leg, slope * self.ar.number(*ratio), *grows);
            }
            Step::Vertical { row, grows, index } => {
                self.vertical(sweep, leg, (*row, *grows), *index);
            }
            Step::Moved { .. } => self.moved(sweep, leg, step, at),
            Step::Panel { .. } => self.panel(sweep, leg, step),
            Step::Turn { .. } => self.turn(sweep, leg, step, at),
            Step::Arrive(index) => self.shifted(sweep, leg, *index, true),
            Step::Leave(index) => self.shifted(sweep, leg, *index, false),
            Step::Pin { root, row } => self.pin(sweep, *root, *row),
        }
    }

    /// Adds the derivative with respect to a measurement's weight.
    #[inline(always)]
    fn add_weight(&mut self, leg: usize, adjoint: A::Number, grows: Grows<A::Number>) {
        let slope = adjoint * self.per_weight;
        match grows {
            Grows::WithMove(one) => self.out[leg].add_move(slope * one),
            Grows::WithDwell => self.out[leg].add_dwell(slope),
        }
    }

    #[inline(always)]
    fn pin(&self, sweep: &mut Sweep<A, S>, root: usize, row: usize) {
        let width = self.columns.width;
        let root = &self.tape.small[root];
        let (x, through) = (
            self.rows(&self.told.rows, row, 3),
            self.rows(self.through, row, 3),
        );
        let mut twice = through.to_vec();
        for row in &mut twice {
            *row = row.plus(*row);
        }
        add_combined(
            self.ar,
            &mut sweep.v[3 * width..],
            &transpose(root),
            &twice,
            width,
        );
        let told: Matrix<A::Number, 3, 3> = dots(self.ar, through, x, width);
        let of_p = symmetric(&transposed_product(
            self.ar,
            root,
            &product(self.ar, &told, root),
        ));
        for i in 0..3 {
            for j in 0..3 {
                sweep.p[3 + i][3 + j] = sweep.p[3 + i][3 + j] - of_p[i][j];
            }
        }
    }

    #[inline(always)]
    fn dwell(&self, sweep: &mut Sweep<A, S>, step: &Step<A::Number>) {
        let Step::Dwell { y, z, r22, row } = *step else {
            return;
        };
        let (y, m) = (&self.tape.states[y], &self.tape.states[y + 1]);
        let (z, n) = (&self.tape.inputs[z], &self.tape.inputs[z + 1]);
        let r22 = &self.tape.told[r22];
        let width = self.columns.width;
        let x = self.rows(&self.told.rows, row, S);
        let through = self.rows(self.through, row, S);
        let mut twice = self.rows(self.through, row, S + I).to_vec();
        for row in &mut twice {
            *row = row.plus(*row);
        }
        let (twice, second) = twice.split_at(S * width);
        let nothing = self.ar.quad([self.ar.number(0.0); 4]);
        let mut inputs = vec![nothing; I * width];
        add_combined(self.ar, &mut inputs, &transpose(n), &sweep.v, width);
        add_combined(self.ar, &mut inputs, &transpose(z), twice, width);
        add_combined(self.ar, &mut inputs, &transpose(r22), second, width);
        sweep.place.add_inputs(&inputs, width);

        let d1: Matrix<A::Number, S, S> = dots(self.ar, &sweep.v, x, width);
        let d2: Matrix<A::Number, S, S> = dots(self.ar, through, x, width);
        let inside = difference(&product(self.ar, &sweep.p, m), &product(self.ar, &d1, y));
        let told = transposed_product(self.ar, y, &product(self.ar, &d2, y));
        sweep.p = symmetric(&difference(&transposed_product(self.ar, m, &inside), &told));

        turn_rows(self.ar, &transpose(m), &mut sweep.v, width);
        add_combined(self.ar, &mut sweep.v, &transpose(y), twice, width);
    }

    #[inline(always)]
    fn pass(&self, sweep: &mut Sweep<A, S>, t: &Transition<A::Number, S>) {
        pull_rows(&t.top, &t.kept, &mut sweep.v, self.columns.width);
        sweep.p = pull_covariance(self.ar, &t.top, &t.kept, &sweep.p);
    }

    /// The derivative with respect to the length of a time without a measurement, at its end:
    /// d/dt (V, P) = (F V + A', F P + P Fᵀ + Q), F of ψ what the Earth's rotation and the drift do, of the
    /// other blocks −λ.
    #[inline(always)]
    fn length_adjoint(&self, sweep: &Sweep<A, S>, v: usize, p: usize, at: &Place<A>) -> A::Number {
        let two = self.ar.number(2.0);
        let [f02, f12] = self.earth.system();
        let width = self.columns.width;
        let (v, p) = (self.kept(v), &self.tape.states[p]);
        let of_psi: Matrix<A::Number, 3, 3> = dots(self.ar, &sweep.v, v, width);
        let bar = &sweep.p;
        let row_dot = |i: usize, j: usize| {
            let mut sum = bar[i][0] * p[j][0];
            for k in 1..S {
                sum = bar[i][k].mul_add(p[j][k], sum);
            }
            sum
        };
        let turning = [
            of_psi[0][2] - of_psi[2][0] + (row_dot(0, 2) - row_dot(2, 0)) * two,
            of_psi[1][2] - of_psi[2][1] + (row_dot(1, 2) - row_dot(2, 1)) * two,
        ];
        let [[drift]] = dots::<_, 1, 1>(self.ar, &sweep.v, &at.drift, 3 * width);
        let mut sum = (bar[0][0] + bar[1][1] + bar[2][2]).mul_add(self.earth.drift_psd(), drift);
        for (block, slot) in self.wander.slots.iter().enumerate() {
            let block = 3 + 3 * block;
            let (decay, psd) = (self.ar.number(-slot.decay), self.ar.number(slot.psd));
            for i in 0..3 {
                let j = block + i;
                let of = &v[j * width..];
                if slot.drives {
                    let [[by_v]] = dots::<_, 1, 1>(self.ar, &sweep.v[i * width..], of, width);
                    sum = sum + row_dot(i, j).mul_add(two, by_v);
                }
                let [[by_v]] = dots::<_, 1, 1>(self.ar, &sweep.v[j * width..], of, width);
                sum = row_dot(j, j).mul_add(two, by_v).mul_add(decay, sum);
                sum = bar[j][j].mul_add(psd, sum);
            }
        }
        f02.mul_add(turning[0], f12.mul_add(turning[1], sum))
    }

    /// Takes a measurement back; returns the derivative with respect to its weight.
    ///
    /// With ω = w/s: ḡ_i = −V̄_i yᵀ, ω̄ = F yᵀ + ḡ·p − pᵀ P̄ p, p̄ = ω ḡ − 2 ω P̄ p − ω² ω̄ hᵀ and
    /// ȳ = 2 ω F − ω Σ p_i V̄_i; dω/dw = s⁻², so that nothing is singular at w = 0.
    #[inline(always)]
    fn measure(
        &mut self,
        sweep: &mut Sweep<A, S>,
        leg: usize,
        step: &Step<A::Number>,
    ) -> A::Number {
        let Step::Measure {
            channel,
            column,
            weight,
            s,
            row,
            index,
            ..
        } = *step
        else {
            return self.ar.number(0.0);
        };
        let (half, two) = (self.ar.number(0.5), self.ar.number(2.0));
        let column = &self.tape.columns[column];
        let width = self.columns.width;
        let share = weight / s;
        let h = seen::<A, S>(self.ar, self.wander, channel);
        let y = self.rows(&self.told.rows, row, 1);
        let through = self.rows(self.through, row, 1);
        let gains = dots::<_, S, 1>(self.ar, &sweep.v, y, width);
        let [[mut of_share]] = dots::<_, 1, 1>(self.ar, through, y, width);
        let mut of_column = [of_share; S];
        for i in 0..S {
            let mut of_p = sweep.p[i][0] * column[0];
            for k in 1..S {
                of_p = sweep.p[i][k].mul_add(column[k], of_p);
            }
            let of = -(gains[i][0] + of_p);
            of_share = of_share + of * column[i];
            of_column[i] = share * (of - of_p);
        }
        let mut of_y = Vec::with_capacity(width);
        for q in 0..width {
            let mut sum = through[q].times(two);
            for i in 0..S {
                sum = sweep.v[i * width + q].times_add(-column[i], sum);
            }
            of_y.push(sum.times(share));
        }
        let less = share * share * of_share;
        for j in 0..S {
            if let Some(h) = h[j] {
                of_column[j] = of_column[j] - less * h;
            }
        }
        for j in 0..S {
            let Some(h) = h[j] else { continue };
            add(&mut sweep.v[j * width..(j + 1) * width], h, &of_y);
            for i in 0..S {
                let of = half * h * of_column[i];
                sweep.p[i][j] = sweep.p[i][j] + of;
                sweep.p[j][i] = sweep.p[j][i] + of;
            }
        }
        if channel == Channel::Vertical && !sweep.place.output.is_empty() {
            self.add_up(sweep, leg, index, self.ar.number(1.0), &of_y);
        }
        of_share / (s * s)
    }

    /// Takes the vertical channel of a measurement back.
    #[inline(always)]
    fn vertical(
        &mut self,
        sweep: &mut Sweep<A, S>,
        leg: usize,
        (row, grows): (usize, Option<Grows<A::Number>>),
        index: At,
    ) {
        let width = self.columns.width;
        let through = self.rows(self.through, row, 1);
        let twice = self.told.weights[row] * self.ar.number(2.0);
        if let Some(grows) = grows {
            let [[slope]] =
                dots::<_, 1, 1>(self.ar, through, self.rows(&self.told.rows, row, 1), width);
            self.add_weight(leg, slope, grows);
        }
        self.add_up(sweep, leg, index, twice, through);
    }

    /// Adds to the adjoint of what the vertical channel shows at the end of a stretch, or at a position.
    #[inline(always)]
    fn add_up(
        &mut self,
        sweep: &mut Sweep<A, S>,
        leg: usize,
        index: At,
        factor: A::Number,
        of: &[A::Quad],
    ) {
        let width = self.columns.width;
        let up = UP * width..(UP + 1) * width;
        match index {
            Some(index) if index + 1 < self.legs.stretches(leg) => {
                let s = self.legs.stretch(leg, index);
                let mut adjoint = self.nothing();
                add(&mut adjoint.output[up], factor, of);
                self.add_on_the_way(leg, &s, true, adjoint);
            }
            _ => add(&mut sweep.place.output[up], factor, of),
        }
    }

    /// Adds the adjoint of a place on the way to the angles at both ends and the duration.
    #[inline(always)]
    fn add_on_the_way(
        &mut self,
        leg: usize,
        s: &Stretch<A::Number, A::Panels>,
        end: bool,
        adjoint: PlaceAdjoint<A>,
    ) {
        let ar = self.ar;
        ar.always_apart(OnTheWay {
            backward: self,
            leg,
            s,
            end,
            adjoint,
        });
    }

    #[inline(always)]
    fn pull_on_the_way(
        &mut self,
        leg: usize,
        s: &Stretch<A::Number, A::Panels>,
        end: bool,
        mut adjoint: PlaceAdjoint<A>,
    ) {
        let (place, way, alpha) = on_the_way(self.ar, self.columns, self.earth, s, end);
        let (c, _) = adjoint.pull(self.columns, self.earth, &place, &self.earth.vector());
        let angles = pull_to_angles(self.earth.stand(), &place.c, alpha, &c);
        // The place is at a time, and the angles there change by their rates.
        let of = s.turn.pull(&way, &angles);
        add_turn(self.out, leg, &of, of.duration);
    }
}
