//! The legs of a timeline, or of one per lane, through the chain.
//!
//! As [`super::super::course`], with rows over the parameters and more states: what happens on a leg, each
//! part only where some lane has it. A lane that lacks a part that another has takes it with length and
//! weight zero, which changes nothing.

use std::any::Any;
use std::cell::RefCell;

use super::algebra::{
    self, Matrix, add_combined, append_combined, difference, inverse_root, product,
    product_transposed, square, square_root, symmetric, transpose, transposed_product, turn_rows,
    whitener,
};
use super::integral::integral;
use super::moving::Panel;
use super::wander::{Kernel, Share, Wander, add_noise, transition};
use super::{Columns, Place, shift};
use crate::attitude::{EAST, NORTH, UP};
use crate::covariance::fast::arithmetic::{Arithmetic, Number, Row, Work, three};
use crate::covariance::fast::course::{Grows, Legs, Stretch};
use crate::covariance::fast::earth::Earth;
use crate::covariance::fast::moves::Interval;
use crate::covariance::fast::square::Entries;

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

/// What the measurements tell: rows over the parameters, and their weights.
#[derive(Debug)]
pub(super) struct Told<A: Arithmetic> {
    pub rows: Vec<A::Quad>,
    pub weights: Vec<A::Number>,
}

impl<A: Arithmetic> Told<A> {
    /// How many rows.
    pub fn count(&self) -> usize {
        self.weights.len()
    }

    #[inline(always)]
    fn push(&mut self, row: &[A::Quad], weight: A::Number) {
        self.rows.extend_from_slice(row);
        self.weights.push(weight);
    }
}

/// A component of a measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Channel {
    /// ψ_x, by z_3 = −ψ_x + b_3.
    North,
    /// ψ_z, by z_1 = ψ_z + b_1.
    East,
    /// ψ_y, the azimuth.
    Up,
    /// z_2 = b_2, of biases that wander.
    Vertical,
}

impl Channel {
    /// The component of ψ, if it sees one, and that of every block of biases with its sign.
    #[inline(always)]
    pub fn sees(self) -> (Option<usize>, Option<(usize, f64)>) {
        match self {
            Self::North => (Some(NORTH), Some((EAST, -1.0))),
            Self::East => (Some(EAST), Some((NORTH, 1.0))),
            Self::Up => (Some(UP), None),
            Self::Vertical => (None, Some((UP, 1.0))),
        }
    }
}

/// How the blocks of x turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turning {
    /// From one attitude to another: C₂ C₁ᵀ.
    Across,
    /// From n into the platform: C₁ᵀ.
    Into,
    /// From the platform into n: C₂.
    OutOf,
}

/// Where in a move: at a stretch, or nowhere in it where changes of position are of frame-hold.
pub(super) type At = Option<usize>;

/// What the reverse mode has to remember of a step. Matrices are in the tape, by number; rows from
/// where `v` says.
#[derive(Debug, Clone, Copy)]
pub(super) enum Step<N> {
    /// ψ' becomes ψ.
    Leave(At),
    /// ψ becomes ψ'.
    Arrive(At),
    /// Blocks turn: V and P before it.
    Turn {
        at: At,
        kind: Turning,
        q: usize,
        v: usize,
        p: usize,
    },
    /// A panel of a stretch: its transition, V and P before it.
    Panel {
        index: usize,
        panel: usize,
        t: usize,
        v: usize,
        p: usize,
    },
    /// The end of a stretch: V and P there.
    Moved { index: usize, v: usize, p: usize },
    /// Time at a place without a measurement: its transition and Γ.
    Pass { t: usize, gamma: usize },
    /// The length of the time before counts: V and P after it.
    Length { v: usize, p: usize },
    /// Whole periods of a dwell: Y and M, Z and N, R22; its rows begin at `row`.
    Dwell {
        y: usize,
        z: usize,
        r22: usize,
        row: usize,
    },
    /// A component of a measurement with weight w: P hᵀ before it, and s = 1 + w h P hᵀ.
    Measure {
        channel: Channel,
        column: usize,
        weight: N,
        s: N,
        row: usize,
        grows: Grows<N>,
        /// What the weight is of the one that grows.
        ratio: f64,
        /// After which stretch of a move it is, if in one.
        index: At,
    },
    /// The vertical channel of a measurement that sees nothing of x, and after which stretch of a move it
    /// is, if in one; in a dwell it does not grow.
    Vertical {
        row: usize,
        grows: Option<Grows<N>>,
        index: At,
    },
    /// At the end the random walk has come to 0: the inverse of a root of its covariance.
    Pin { root: usize, row: usize },
}

/// What the forward run leaves behind.
#[derive(Debug)]
pub(super) struct Tape<A: Arithmetic, const S: usize, const I: usize> {
    /// Whether anything is kept.
    pub on: bool,
    /// Leg and step, in order.
    pub steps: Vec<(usize, Step<A::Number>)>,
    pub rows: Vec<A::Quad>,
    pub states: Vec<Matrix<A::Number, S, S>>,
    pub inputs: Vec<Matrix<A::Number, S, I>>,
    pub told: Vec<Matrix<A::Number, I, I>>,
    pub small: Vec<Entries<A::Number>>,
    pub columns: Vec<[A::Number; S]>,
}

/// Puts something down, and says where.
#[inline(always)]
fn put<T>(to: &mut Vec<T>, of: T) -> usize {
    to.push(of);
    to.len() - 1
}

impl<A: Arithmetic, const S: usize, const I: usize> Tape<A, S, I> {
    /// Empty.
    fn new() -> Self {
        Self {
            on: false,
            steps: Vec::new(),
            rows: Vec::new(),
            states: Vec::new(),
            inputs: Vec::new(),
            told: Vec::new(),
            small: Vec::new(),
            columns: Vec::new(),
        }
    }

    fn clear(&mut self, on: bool) {
        self.on = on;
        self.steps.clear();
        self.rows.clear();
        self.states.clear();
        self.inputs.clear();
        self.told.clear();
        self.small.clear();
        self.columns.clear();
    }

    #[inline(always)]
    fn keep(&mut self, of: &[A::Quad]) -> usize {
        let at = self.rows.len();
        self.rows.extend_from_slice(of);
        at
    }
}

/// A piece of a leg, compiled once for all places where it happens: all in one function takes the compiler
/// minutes.
enum Piece<'b, A: Arithmetic> {
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

/// Tape and rows of a run: their memory is used again.
#[derive(Debug)]
pub(super) struct Memory<A: Arithmetic, const S: usize, const I: usize> {
    pub tape: Tape<A, S, I>,
    pub told: Told<A>,
}

thread_local! {
    /// That of the last run of this thread.
    static MEMORY: RefCell<Option<Box<dyn Any>>> = const { RefCell::new(None) };
}

impl<A: Arithmetic + 'static, const S: usize, const I: usize> Memory<A, S, I> {
    /// This thread's, empty. Taken out, not borrowed: a figure of merit may itself ask for a gradient.
    pub fn take(keeps_tape: bool) -> Box<Self> {
        let kept = MEMORY.with(RefCell::take);
        let kept: Option<Box<Self>> = kept.and_then(|m| m.downcast().ok());
        let mut memory = kept.unwrap_or_else(|| {
            Box::new(Self {
                tape: Tape::new(),
                told: Told {
                    rows: Vec::new(),
                    weights: Vec::new(),
                },
            })
        });
        memory.tape.clear(keeps_tape);
        memory.told.rows.clear();
        memory.told.weights.clear();
        memory
    }

    /// Puts it back.
    pub fn keep(self: Box<Self>) {
        MEMORY.with(|slot| slot.replace(Some(self)));
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
    told: &'a mut Told<A>,
    /// V.
    v: Vec<A::Quad>,
    p: Matrix<A::Number, S, S>,
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
    fn apart(&mut self, leg: usize, piece: Piece<'_, A>) {
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
    fn step(&mut self, leg: usize, step: Step<A::Number>) {
        self.tape.steps.push((leg, step));
    }

    /// Puts V and P down.
    #[inline(always)]
    fn keep(&mut self) -> (usize, usize) {
        let v = self.tape.keep(&self.v);
        (v, put(&mut self.tape.states, self.p))
    }

    /// Through all legs.
    #[inline(always)]
    pub fn run(mut self) {
        let mut previous: Option<Place<A>> = None;
        for leg in 0..self.legs.count() {
            let at = self.place(leg);
            match &previous {
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
            previous = Some(at);
        }
        if !self.columns.walked.is_empty() {
            self.pin();
        }
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
            for j in 0..3 {
                let mut sum = at.c[i][0] * variance[0] * at.c[j][0];
                for k in 1..3 {
                    sum = (at.c[i][k] * variance[k]).mul_add(at.c[j][k], sum);
                }
                self.p[3 + i][3 + j] = sum;
            }
        }
    }

    /// x ← T x: V and P with it, the process noise apart.
    #[inline(always)]
    fn carry(&mut self, t: &Matrix<A::Number, S, S>) {
        turn_rows(self.ar, t, &mut self.v, self.columns.width);
        self.p = symmetric(&product_transposed(
            self.ar,
            &product(self.ar, t, &self.p),
            t,
        ));
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
        if self.tape.on {
            self.step(leg, Step::Leave(at));
        }
    }

    #[inline(always)]
    fn reach(&mut self, leg: usize, at: At, place: &Place<A>, present: A::Number) {
        self.shift(place, present);
        if self.tape.on {
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
        let t = turned::<_, S>(q, at.is_none());
        self.carry(&t);
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
        let of = integral(ar, columns, earth, &s.turn, &s.interval, &s.panels);
        let b = columns.spread(ar, &of);
        for (v, b) in self.v.iter_mut().zip(&b) {
            *v = v.plus(*b);
        }
        self.reach(leg, Some(index), end, s.present);
        if self.tape.on {
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
        let t = transition::<_, S>(&self.wander.slots, &passed.phi, &shares);
        if self.tape.on {
            let (v, p) = self.keep();
            let t = put(&mut self.tape.states, t);
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
        let t = transition::<_, S>(&self.wander.slots, &passed.phi, &shares);
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
            let t = put(&mut self.tape.states, t);
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

    #[inline(always)]
    fn vertical(
        &mut self,
        leg: usize,
        weight: A::Number,
        grows: Option<Grows<A::Number>>,
        index: At,
        at: &Place<A>,
    ) {
        let width = self.columns.width;
        let row = self.told.count();
        self.told
            .push(&at.output[UP * width..(UP + 1) * width], weight);
        if self.tape.on {
            self.step(leg, Step::Vertical { row, grows, index });
        }
    }

    /// All channels, with information `weight` each.
    #[inline(always)]
    fn measure(
        &mut self,
        leg: usize,
        weight: A::Number,
        grows: Grows<A::Number>,
        index: At,
        at: &Place<A>,
    ) {
        for channel in [
            Channel::North,
            Channel::East,
            Channel::Vertical,
            Channel::Up,
        ] {
            let ratio = match channel {
                Channel::Vertical if I == 3 => continue,
                Channel::Up => match self.legs.azimuth() {
                    Some(ratio) => ratio,
                    None => continue,
                },
                _ => 1.0,
            };
            let weight = weight * self.ar.number(ratio);
            self.apart(
                leg,
                Piece::Measure(index, channel, weight, ratio, grows, at),
            );
        }
        if I == 3 && !at.output.is_empty() {
            self.vertical(leg, weight, Some(grows), index, at);
        }
    }

    /// A component h x: E += w/s yᵀy, V ← V − (w/s) p y, P ← P − (w/s) p pᵀ with y = h V and p = P hᵀ,
    /// s = 1 + w h p. h x itself shrinks by s: where it is of ψ, that component follows from the others
    /// without a difference.
    #[inline(always)]
    fn measure_one(
        &mut self,
        (leg, index): (usize, At),
        channel: Channel,
        weight: A::Number,
        ratio: f64,
        grows: Grows<A::Number>,
        at: &Place<A>,
    ) {
        let (zero, one) = (self.ar.number(0.0), self.ar.number(1.0));
        let width = self.columns.width;
        let h = seen::<A, S>(self.ar, self.wander, channel);
        let mut column = [zero; S];
        for i in 0..S {
            for j in 0..S {
                if let Some(h) = h[j] {
                    column[i] = self.p[i][j].mul_add(h, column[i]);
                }
            }
        }
        let mut s = one;
        for j in 0..S {
            if let Some(h) = h[j] {
                s = (weight * h).mul_add(column[j], s);
            }
        }
        let (share, left) = (weight / s, one / s);
        let row = self.told.count();
        let nothing = self.ar.quad([zero; 4]);
        let mut y = vec![nothing; width];
        if channel == Channel::Vertical && !at.output.is_empty() {
            y.copy_from_slice(&at.output[UP * width..(UP + 1) * width]);
        }
        for j in 0..S {
            if let Some(h) = h[j] {
                algebra::add(&mut y, h, &self.v[j * width..(j + 1) * width]);
            }
        }
        self.told.push(&y, share);
        let own = channel.sees().0;
        for i in 0..S {
            if Some(i) != own {
                algebra::add(
                    &mut self.v[i * width..(i + 1) * width],
                    -(share * column[i]),
                    &y,
                );
            }
            for j in 0..S {
                self.p[i][j] = self.p[i][j] - share * column[i] * column[j];
            }
        }
        if let Some(own) = own {
            if I > 3 {
                self.shrink_among(own, &h, &column, (weight, left), &y);
            } else {
                self.shrink(own, &column, left, &y);
            }
        }
        if self.tape.on {
            let step = Step::Measure {
                channel,
                column: put(&mut self.tape.columns, column),
                weight,
                s,
                row,
                grows,
                ratio,
                index,
            };
            self.step(leg, step);
        }
    }

    /// V = y/s and P hᵀ = p/s, for the component `own` of x that is seen alone.
    #[inline(always)]
    fn shrink(&mut self, own: usize, column: &[A::Number; S], left: A::Number, y: &[A::Quad]) {
        let width = self.columns.width;
        for q in 0..width {
            self.v[own * width + q] = y[q].times(left);
        }
        for i in 0..S {
            let of = column[i] * left;
            self.p[i][own] = of;
            self.p[own][i] = of;
        }
    }

    /// h V = y/s and P hᵀ = p/s, for the component `own` of x among others that are seen.
    #[inline(always)]
    fn shrink_among(
        &mut self,
        own: usize,
        h: &[Option<A::Number>; S],
        column: &[A::Number; S],
        (weight, left): (A::Number, A::Number),
        y: &[A::Quad],
    ) {
        let (zero, one) = (self.ar.number(0.0), self.ar.number(1.0));
        // A lane that waits keeps everything to the bit.
        let counts = one.where_greater(weight, zero, zero);
        let waits = one - counts;
        let width = self.columns.width;
        for q in 0..width {
            let mut sum = y[q].times(left);
            for j in 0..S {
                if let Some(h) = h[j]
                    && j != own
                {
                    sum = self.v[j * width + q].times_add(-h, sum);
                }
            }
            let to = &mut self.v[own * width + q];
            *to = sum.times(counts).plus(to.times(waits));
        }
        // `own` last: of the others its own entry is made.
        for k in 0..S {
            let i = (own + 1 + k) % S;
            let mut sum = column[i] * left;
            for j in 0..S {
                if let Some(h) = h[j]
                    && j != own
                {
                    sum = sum - h * self.p[i][j];
                }
            }
            let sum = sum.where_greater(weight, zero, self.p[i][own]);
            self.p[i][own] = sum;
            self.p[own][i] = sum;
        }
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

/// h of a channel, component by component.
#[inline(always)]
pub(super) fn seen<A: Arithmetic, const S: usize>(
    ar: A,
    wander: &Wander,
    channel: Channel,
) -> [Option<A::Number>; S] {
    let mut h = [None; S];
    let (psi, bias) = channel.sees();
    if let Some(psi) = psi {
        h[psi] = Some(ar.number(1.0));
    }
    if let Some((axis, sign)) = bias {
        for (at, slot) in wander.slots.iter().enumerate() {
            if !slot.drives {
                h[3 + 3 * at + axis] = Some(ar.number(sign));
            }
        }
    }
    h
}

/// The blocks of x turned by `q`, that of ψ if `with_psi`.
#[inline(always)]
pub(super) fn turned<N: Number, const S: usize>(q: &Entries<N>, with_psi: bool) -> Matrix<N, S, S> {
    let one = q[0][0].constant(1.0);
    let mut t = algebra::zeros(q[0][0].constant(0.0));
    for at in (0..S).step_by(3) {
        for i in 0..3 {
            if at == 0 && !with_psi {
                t[i][i] = one;
            } else {
                t[at + i][at..at + 3].copy_from_slice(&q[i]);
            }
        }
    }
    t
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

/// Where a stretch of a move begins or (`end`) ends, if that is not at a position: the place, the share of
/// the move, and (sin α, cos α).
#[inline(always)]
pub(super) fn on_the_way<A: Arithmetic>(
    ar: A,
    columns: &Columns,
    earth: &Earth<A::Number>,
    s: &Stretch<A::Number, A::Panels>,
    end: bool,
) -> (Place<A>, A::Number, (A::Number, A::Number)) {
    let Interval { start_s, length_s } = s.interval;
    let at_s = if end { start_s + length_s } else { start_s };
    let fraction = at_s / s.turn.duration_s;
    let (c, alpha) = s.turn.attitude_at(fraction);
    (Place::at_rest(ar, columns, earth, c), fraction, alpha)
}
