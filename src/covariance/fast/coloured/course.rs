//! The legs of a timeline, or of one per lane, through the chain.
//!
//! As [`super::super::course`], with rows over the parameters and more states: what happens on a leg, each
//! part only where some lane has it. A lane that lacks a part that another has takes it with length and
//! weight zero, which changes nothing.

use super::algebra::{
    self, Matrix, add_combined, difference, inverse_root, pass_covariance, product,
    product_transposed, square, square_root, transpose, transposed_product, turn_covariance,
    turn_rows, whitener,
};
use super::cuts::{Around, Entries4, spread};
use super::integral::integral;
use super::moving::Panel;
use super::rows::{append_combined, pass_rows, turn_blocks};
use super::tape::{At, Channel, Memory, Step, Tape, Told, Turning, put};
use super::wander::{Kernel, Share, Transition, Wander, add_noise};
use super::{Columns, Place, shift};
use crate::covariance::fast::arithmetic::{Arithmetic, Number, Row, Work, three};
use crate::covariance::fast::attitude_entries;
use crate::covariance::fast::course::{Grows, Legs, Stretch};
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::moves::Interval;
use crate::covariance::fast::square::Entries;
use crate::covariance::fast::turn;

/// The legs of a timeline, or of one per lane, as far as what wanders is concerned.
pub(super) trait Wanders<A: Arithmetic>: Legs<A> {
    /// The numbers of the kernel of a dwell's whole periods; none where no lane has any.
    fn kernel(&self, leg: usize) -> Option<Vec<A::Number>>;
    /// More than 0 where a lane's dwell has whole periods.
    fn holds(&self, leg: usize) -> A::Number;
    /// In how many panels a stretch of a move is gone through, at most, and in every lane; 0 where it
    /// takes no time.
    fn panels(&self, leg: usize, index: usize) -> (usize, A::Number);
    /// 1 where the gimbals turn on the way to a position, or else 0.
    fn turns(&self, leg: usize) -> A::Number;
}

/// A piece of a leg, compiled once for all places where it happens: all in one function takes the compiler
/// minutes.
pub(super) enum Piece<'b, A: Arithmetic> {
    Turn(At, Turning, &'b Entries<A::Number>),
    Panel((usize, usize), &'b Stretch<A::Number, A::Panels>, A::Number),
    Pass(&'b Place<A>, A::Number, u32),
    Dwell(&'b [A::Number], &'b Place<A>),
    Measure(At, Channel, A::Number, f64, Grows<A::Number>, &'b Place<A>),
}

/// One of them on its leg.
struct Apart<'b, 'a, A: Arithmetic, L, const S: usize, const I: usize> {
    forward: &'b mut Forward<'a, A, L, S, I>,
    leg: usize,
    piece: Piece<'b, A>,
}

impl<A: Arithmetic, L: Wanders<A>, const S: usize, const I: usize> Work
    for Apart<'_, '_, A, L, S, I>
{
    type Output = ();
    #[inline(always)]
    fn run(self) {
        let (forward, leg) = (self.forward, self.leg);
        match self.piece {
            Piece::Turn(at, kind, q) => forward.turn(leg, at, kind, q),
            Piece::Panel(of, s, count) => forward.panel(leg, of, s, count),
            Piece::Pass(at, length_s, halves) => forward.pass(leg, at, length_s, halves),
            Piece::Dwell(kernel, at) => forward.dwell(leg, &Kernel::read(kernel), at),
            Piece::Measure(index, channel, weight, ratio, grows, at) => {
                forward.measure_one((leg, index), channel, weight, ratio, grows, at);
            }
        }
    }
}

/// The chain on its way through the legs.
pub(super) struct Forward<'a, A: Arithmetic, L, const S: usize, const I: usize> {
    pub ar: A,
    pub columns: &'a Columns,
    pub wander: &'a Wander,
    pub legs: &'a L,
    pub earth: &'a Earth<A::Number>,
    pub tape: &'a mut Tape<A, S, I>,
    pub told: &'a mut Told<A>,
    /// V.
    pub v: Vec<A::Quad>,
    pub p: Matrix<A::Number, S, S>,
}

impl<'a, A: Arithmetic, L: Wanders<A>, const S: usize, const I: usize> Forward<'a, A, L, S, I> {
    /// Before the first position, P the prior covariance of ψ.
    #[inline(always)]
    pub fn new(
        ar: A,
        (columns, wander): (&'a Columns, &'a Wander),
        legs: &'a L,
        earth: &'a Earth<A::Number>,
        memory: &'a mut Memory<A, S, I>,
        prior: &nalgebra::Matrix3<f64>,
    ) -> Self {
        let mut p = algebra::zeros(ar.number(0.0));
        for i in 0..3 {
            for j in 0..3 {
                p[i][j] = ar.number(prior[(i, j)]);
            }
        }
        for (at, slot) in wander.slots.iter().enumerate() {
            for i in 3 + 3 * at..6 + 3 * at {
                p[i][i] = ar.number(slot.start_sigma * slot.start_sigma);
            }
        }
        Self {
            ar,
            columns,
            wander,
            legs,
            earth,
            tape: &mut memory.tape,
            told: &mut memory.told,
            v: vec![ar.quad([ar.number(0.0); 4]); S * columns.width],
            p,
        }
    }

    #[inline(always)]
    pub(super) fn apart(&mut self, leg: usize, piece: Piece<'_, A>) {
        let ar = self.ar;
        ar.always_apart(Apart {
            forward: self,
            leg,
            piece,
        });
    }

    #[inline(always)]
    fn place(&self, leg: usize) -> Place<A> {
        Place::at_rest(self.ar, self.columns, self.earth, self.legs.attitude(leg))
    }

    #[inline(always)]
    fn shift(&mut self, at: &Place<A>, by: A::Number) {
        shift(self.columns, &mut self.v, at, by);
    }

    #[inline(always)]
    pub(super) fn step(&mut self, leg: usize, step: Step<A::Number>) {
        self.tape.steps.push((leg, step));
    }

    /// Puts V and P down.
    #[inline(always)]
    fn keep(&mut self) -> (usize, usize) {
        let v = self.tape.keep(&self.v);
        (v, put(&mut self.tape.states, self.p))
    }

    /// Through all legs, of a whole test or of a part with something `around` it.
    #[inline(always)]
    pub fn run(mut self, around: Option<&Around>) {
        let mut previous: Option<Place<A>> = None;
        if let Some((v, p, c)) = around.and_then(Around::before) {
            self.v = spread(self.ar, v);
            for i in 0..S {
                for j in 0..S {
                    self.p[i][j] = self.ar.number(p[i * S + j]);
                }
            }
            let c = attitude_entries(c);
            let c = three!(|i| three!(|j| self.ar.number(c[i][j])));
            previous = Some(Place::at_rest(self.ar, self.columns, self.earth, c));
        }
        for leg in 0..self.legs.count() {
            previous = Some(self.leg(leg, previous.as_ref()));
        }
        match around.and_then(Around::rest) {
            Some((r, s)) => self.join(r, s),
            None if self.columns.walked.is_empty() => {}
            None => self.pin(),
        }
    }

    /// Through a leg, from where it is before; gives where it is then.
    #[inline(always)]
    pub fn leg(&mut self, leg: usize, previous: Option<&Place<A>>) -> Place<A> {
        let at = self.place(leg);
        match previous {
            None => self.start(&at),
            Some(from) => self.arrive(leg, from, &at),
        }
        if self.legs.settles(leg) {
            let (length_s, halves) = (self.legs.settle_s(leg), self.wander.settle_halves);
            self.apart(leg, Piece::Pass(&at, length_s, halves));
        }
        if let Some(kernel) = self.legs.kernel(leg) {
            self.apart(leg, Piece::Dwell(&kernel, &at));
        }
        if self.legs.remains(leg) {
            let (length_s, weight) = self.legs.remainder(leg);
            let halves = self.wander.rest_halves;
            self.apart(leg, Piece::Pass(&at, length_s, halves));
            if self.tape.on {
                let (v, p) = self.keep();
                self.step(leg, Step::Length { v, p });
            }
            if let Some(weight) = weight {
                self.measure(leg, weight, Grows::WithDwell, None, &at);
            }
        }
        at
    }

    /// V is U there and, of the random walk, what D_F is of it.
    #[inline(always)]
    fn start(&mut self, at: &Place<A>) {
        self.shift(at, self.ar.number(1.0));
        if self.columns.walked.is_empty() {
            return;
        }
        let first = 3 * self.columns.width;
        let walked = at.columns_of(self.ar, self.columns, &self.columns.walked);
        self.v[first..2 * first].copy_from_slice(&walked);
        let variance = self.columns.walked_sigma.map(|s| self.ar.number(s * s));
        for i in 0..3 {
            for j in 0..=i {
                let mut sum = at.c[i][0] * variance[0] * at.c[j][0];
                for k in 1..3 {
                    sum = (at.c[i][k] * variance[k]).mul_add(at.c[j][k], sum);
                }
                self.p[3 + i][3 + j] = sum;
                self.p[3 + j][3 + i] = sum;
            }
        }
    }

    /// x ← T x: V and P with it, the process noise apart.
    #[inline(always)]
    fn carry(&mut self, t: &Transition<A::Number, S>) {
        pass_rows(&t.top, &t.kept, &mut self.v, self.columns.width);
        self.p = pass_covariance(self.ar, &t.top, &t.kept, &self.p);
    }

    #[inline(always)]
    fn arrive(&mut self, leg: usize, from: &Place<A>, at: &Place<A>) {
        let one = self.ar.number(1.0);
        if self.legs.rotates(leg) {
            self.leave(leg, None, from, one);
            let q = product_transposed(self.ar, &at.c, &from.c);
            let q = self.where_turning(self.legs.turns(leg), &q);
            self.apart(leg, Piece::Turn(None, Turning::Across, &q));
            self.reach(leg, None, at, one);
        }
        for index in 0..self.legs.stretches(leg) {
            self.stretch(leg, index, from, at);
        }
    }

    #[inline(always)]
    fn leave(&mut self, leg: usize, at: At, place: &Place<A>, present: A::Number) {
        self.shift(place, -present);
        if self.tape.on && self.columns.has_accelerometers() {
            self.step(leg, Step::Leave(at));
        }
    }

    #[inline(always)]
    fn reach(&mut self, leg: usize, at: At, place: &Place<A>, present: A::Number) {
        self.shift(place, present);
        if self.tape.on && self.columns.has_accelerometers() {
            self.step(leg, Step::Arrive(at));
        }
    }

    /// Turns the blocks; that of ψ only in frame-hold.
    #[inline(always)]
    fn turn(&mut self, leg: usize, at: At, kind: Turning, q: &Entries<A::Number>) {
        if self.tape.on {
            let (v, p) = self.keep();
            let q = put(&mut self.tape.small, *q);
            self.step(leg, Step::Turn { at, kind, q, v, p });
        }
        let first = first_turned(at);
        turn_blocks::<_, S>(q, first, &mut self.v, self.columns.width);
        self.p = turn_covariance(self.ar, q, first, &self.p);
    }

    /// `q` where the gimbals turn, or else 1.
    #[inline(always)]
    fn where_turning(&self, turns: A::Number, q: &Entries<A::Number>) -> Entries<A::Number> {
        let (zero, one) = (self.ar.number(0.0), self.ar.number(1.0));
        three!(|i| three!(|j| q[i][j].where_greater(turns, zero, if i == j { one } else { zero })))
    }

    #[inline(always)]
    fn stretch(&mut self, leg: usize, index: usize, from: &Place<A>, at: &Place<A>) {
        let (ar, columns, earth) = (self.ar, self.columns, self.earth);
        let s = self.legs.stretch(leg, index);
        let turns = self.legs.turns(leg);
        let start = match index {
            0 => None,
            _ => Some(on_the_way(ar, columns, earth, &s, false).0),
        };
        let end = match index + 1 < self.legs.stretches(leg) {
            true => Some(on_the_way(ar, columns, earth, &s, true).0),
            false => None,
        };
        let (start, end) = (start.as_ref().unwrap_or(from), end.as_ref().unwrap_or(at));
        self.leave(leg, Some(index), start, s.present);
        let (most, count) = self.legs.panels(leg, index);
        if most == 0 {
            let q = self.where_turning(turns, &product_transposed(self.ar, &end.c, &start.c));
            self.apart(leg, Piece::Turn(Some(index), Turning::Across, &q));
        } else {
            let into = self.where_turning(turns, &transpose(&start.c));
            self.apart(leg, Piece::Turn(Some(index), Turning::Into, &into));
            for panel in 0..most {
                self.apart(leg, Piece::Panel((index, panel), &s, count));
            }
            let out_of = self.where_turning(turns, &end.c);
            self.apart(leg, Piece::Turn(Some(index), Turning::OutOf, &out_of));
        }
        let counts = !s.turn.instant || columns.has_torquers();
        if counts {
            let of = integral(ar, columns, earth, &s.turn, &s.interval, &s.panels);
            let b = columns.spread(ar, &of);
            for (v, b) in self.v.iter_mut().zip(&b) {
                *v = v.plus(*b);
            }
        }
        self.reach(leg, Some(index), end, s.present);
        if self.tape.on && counts {
            let (v, p) = self.keep();
            self.step(leg, Step::Moved { index, v, p });
        }
        if let Some((weight, grows)) = s.measured {
            self.measure(leg, weight, Grows::WithMove(grows), Some(index), end);
        }
    }

    #[inline(always)]
    fn panel(
        &mut self,
        leg: usize,
        (index, panel): (usize, usize),
        s: &Stretch<A::Number, A::Panels>,
        count: A::Number,
    ) {
        let interval = part(s, panel, count);
        let at = Panel::new(self.earth, &s.turn, &interval);
        let mut shares: Vec<Share<A::Number>> = Vec::with_capacity(self.wander.slots.len());
        for slot in &self.wander.slots {
            shares.push(at.share(slot));
        }
        let passed = self.earth.pass::<A>(interval.length_s);
        let t = Transition::new(&self.wander.slots, &passed.phi, &shares);
        if self.tape.on {
            let (v, p) = self.keep();
            let t = put(&mut self.tape.passed, t);
            let step = Step::Panel {
                index,
                panel,
                t,
                v,
                p,
            };
            self.step(leg, step);
        }
        self.carry(&t);
        add_noise(&self.wander.slots, &mut self.p, &shares, passed.process);
    }

    /// Time at a place without a measurement.
    #[inline(always)]
    fn pass(&mut self, leg: usize, at: &Place<A>, length_s: A::Number, halves: u32) {
        let passed = self.earth.pass::<A>(length_s);
        let shares = self.wander.held(self.earth, length_s, halves);
        let t = Transition::new(&self.wander.slots, &passed.phi, &shares);
        self.carry(&t);
        add_noise(&self.wander.slots, &mut self.p, &shares, passed.process);
        add_combined(
            self.ar,
            &mut self.v,
            &passed.gamma,
            &at.drift,
            self.columns.width,
        );
        if self.tape.on {
            let t = put(&mut self.tape.passed, t);
            let gamma = put(&mut self.tape.small, passed.gamma);
            self.step(leg, Step::Pass { t, gamma });
        }
    }

    /// Whole periods at a place.
    #[inline(always)]
    fn dwell(&mut self, leg: usize, k: &Kernel<A::Number, S, I>, at: &Place<A>) {
        let width = self.columns.width;
        // P₊ = W Wᵀ with W = G (I + BᵀB)^{-½}ᵀ, B = R11 G: nothing cancels, and P may be singular.
        let g = square_root(&self.p);
        let b = product(self.ar, &k.r11, &g);
        let w = product_transposed(
            self.ar,
            &g,
            &whitener(self.ar, &transposed_product(self.ar, &b, &b)),
        );
        // Y = S^{-½} R11, Z = S^{-½} R12.
        let white = whitener(self.ar, &square(&b));
        let (y, z) = (
            product(self.ar, &white, &k.r11),
            product(self.ar, &white, &k.r12),
        );
        // M = A_x (I − P₊ J), N = A_u − A_x P₊ R11ᵀ R12.
        let root = product(self.ar, &k.a_x, &w);
        let u = product_transposed(self.ar, &root, &w);
        let m = difference(&k.a_x, &product(self.ar, &u, &k.j));
        let n = difference(&k.a_u, &product(self.ar, &u, &k.cross));
        let (end, holds) = (square(&root), self.legs.holds(leg));
        let zero = self.ar.number(0.0);
        for i in 0..S {
            for j in 0..S {
                // A lane that waits keeps it to the bit.
                let p = end[i][j] + k.c[i][j];
                self.p[i][j] = p.where_greater(holds, zero, self.p[i][j]);
            }
        }
        let row = self.told.count();
        let inputs = at.inputs::<I>(self.ar, self.columns);
        append_combined(&mut self.told.rows, (&y, &self.v), (&z, &inputs), width);
        let from = self.told.rows.len();
        let nothing = self.ar.quad([self.ar.number(0.0); 4]);
        self.told.rows.resize(from + I * width, nothing);
        add_combined(self.ar, &mut self.told.rows[from..], &k.r22, &inputs, width);
        let weights = self.told.weights.len() + S + I;
        self.told.weights.resize(weights, self.ar.number(1.0));
        turn_rows(self.ar, &m, &mut self.v, width);
        add_combined(self.ar, &mut self.v, &n, &inputs, width);
        if self.tape.on {
            let y = put(&mut self.tape.states, y);
            put(&mut self.tape.states, m);
            let z = put(&mut self.tape.inputs, z);
            put(&mut self.tape.inputs, n);
            let r22 = put(&mut self.tape.told, k.r22);
            self.step(leg, Step::Dwell { y, z, r22, row });
        }
        if I == 3 && !at.output.is_empty() {
            let weight = self.legs.vertical(leg);
            self.vertical(leg, weight, None, None, at);
        }
    }

    /// What follows tells R x + S D: with T = R V + S the rows (I + R P Rᵀ)^{-½} T.
    #[inline(always)]
    fn join(&mut self, r: &[f64], s: &[Entries4]) {
        let width = self.columns.width;
        let r: Matrix<A::Number, S, S> = {
            let mut of_x = algebra::zeros(self.ar.number(0.0));
            for i in 0..S {
                for j in 0..S {
                    of_x[i][j] = self.ar.number(r[i * S + j]);
                }
            }
            of_x
        };
        let through = product(self.ar, &r, &square_root(&self.p));
        let white = whitener(self.ar, &square(&through));
        let seen = product(self.ar, &white, &r);
        let s = spread(self.ar, s);
        append_combined(&mut self.told.rows, (&seen, &self.v), (&white, &s), width);
        let weights = self.told.weights.len() + S;
        self.told.weights.resize(weights, self.ar.number(1.0));
    }

    /// At the end of the test the random walk is 0.
    #[inline(always)]
    fn pin(&mut self) {
        let width = self.columns.width;
        let p = three!(|i| three!(|j| self.p[3 + i][3 + j]));
        let root = inverse_root(&p);
        let row = self.told.count();
        let nothing = self.ar.quad([self.ar.number(0.0); 4]);
        let from = self.told.rows.len();
        self.told.rows.resize(from + 3 * width, nothing);
        let walked = &self.v[3 * width..6 * width];
        add_combined(self.ar, &mut self.told.rows[from..], &root, walked, width);
        self.told
            .weights
            .extend_from_slice(&[self.ar.number(1.0); 3]);
        if self.tape.on {
            let root = put(&mut self.tape.small, root);
            let last = self.legs.count().saturating_sub(1);
            self.step(last, Step::Pin { root, row });
        }
    }
}

/// The first component of x that turns: in frame-hold of ψ, or else of the block after it.
#[inline(always)]
pub(super) const fn first_turned(at: At) -> usize {
    match at {
        None => 0,
        Some(_) => 3,
    }
}

/// A panel of a stretch, of those that a lane has; after them none of any length.
#[inline(always)]
pub(super) fn part<N: Number, P>(s: &Stretch<N, P>, panel: usize, count: N) -> Interval<N> {
    let (zero, one) = (count.constant(0.0), count.constant(1.0));
    let at = count.constant(panel as f64);
    let has = |value: N| value.where_greater(count, at, zero);
    let length_s = has(s.interval.length_s / one.where_greater(one, count, count));
    Interval {
        start_s: has(at).mul_add(length_s, s.interval.start_s),
        length_s,
    }
}

/// A place on the way: what is there, how far the move is, and (sin α, cos α).
pub(super) type OnTheWay<A> = (
    Place<A>,
    turn::OnTheWay<<A as Arithmetic>::Number>,
    (<A as Arithmetic>::Number, <A as Arithmetic>::Number),
);

/// Where a stretch of a move begins or (`end`) ends, if that is not at a position.
#[inline(always)]
pub(super) fn on_the_way<A: Arithmetic>(
    ar: A,
    columns: &Columns,
    earth: &Earth<A::Number>,
    s: &Stretch<A::Number, A::Panels>,
    end: bool,
) -> OnTheWay<A> {
    let Interval { start_s, length_s } = s.interval;
    let at_s = if end { start_s + length_s } else { start_s };
    let way = s.turn.at(at_s);
    let (c, alpha) = s.turn.attitude_at(earth.stand(), &way);
    (Place::at_rest(ar, columns, earth, c), way, alpha)
}
